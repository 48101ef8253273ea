"""Tables of elements: what one consumer does with each class of element, and what it refuses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Generic, TypeVar

from ..errors import UnsupportedProblemError

T = TypeVar("T")

CONSUMERS: list[ElementTable[object]] = []
"""Every table that has been made, for the test that holds each against the elements that exist."""


class ElementTable(Generic[T]):
    """Handlers of one consumer by class of element; a class that it does not know is refused.

    A table states for every class of its group either what it does (`handlers`) or why it does not
    (`refused`); `tests/unit/test_elements.py` finds the classes that are in neither.

    >>> from trebucheck.models.elements import FORCE_ELEMENTS, ConstantTorque
    >>> table = ElementTable("a printer", FORCE_ELEMENTS, {ConstantTorque: "torque"}, others="no")
    >>> table[ConstantTorque(name="motor", body="arm", torque=2.0)]
    'torque'

    Args:
        consumer: noun with which the sentence of a refusal begins, such as "MuJoCo's builder".
        group: the classes that it must know: `JOINTS`, `STOPS`, `FORCE_ELEMENTS` or `ELEMENTS`.
        handlers: what it does, by class.
        refused: why it does not, by class, as a part of a sentence.
        others: the reason for which every further class of the group is refused; None: there is
            none, and each class must be in one of the two tables.
    """

    def __init__(
        self,
        consumer: str,
        group: tuple[type, ...],
        handlers: Mapping[type, T],
        refused: Mapping[type, str] | None = None,
        *,
        others: str | None = None,
    ) -> None:
        self.consumer = consumer
        self.group = group
        self.handlers = dict(handlers)
        self.refused = dict(refused or {})
        self.others = others
        CONSUMERS.append(self)  # type: ignore[arg-type]

    def missing(self) -> tuple[type, ...]:
        """Classes of the group that are neither handled nor refused."""
        if self.others is not None:
            return ()
        return tuple(c for c in self.group if c not in self.handlers and c not in self.refused)

    def handles(self, element_class: type) -> bool:
        """Whether elements of a class are handled."""
        return element_class in self.handlers

    def __getitem__(self, element: object) -> T:
        """The handler of an element.

        Raises:
            UnsupportedProblemError: the consumer refuses elements of this class or does not know
                them; the sentence names consumer, element and class.
        """
        handler = self.handlers.get(type(element))
        if handler is None:
            reason = self.refused.get(type(element), self.others)
            raise UnsupportedProblemError(refusal(self.consumer, element, reason))
        return handler


def refusal(consumer: str, element: object, reason: str | None) -> str:
    """Sentence that a consumer refuses an element; without a reason it does not know the class."""
    kind = getattr(element, "kind", type(element).__name__)
    name = getattr(element, "name", "?")
    because = "it does not know this element" if reason is None else reason
    return f"{consumer} cannot use {name!r} ({kind}): {because}."
