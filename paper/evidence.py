"""What the claims are judged by, the throws and the further studies; and one claim as data and a rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from ..models.machines.parameters import TrebuchetParameters
from .printed import Printed
from .quantities import Formula, Readings, ThrowQuantity, Values
from .results import Claim, EngineValue, Quantity
from .throws import EngineThrow, MachineThrow
from .verdicts import Judgement, undecided

FIXED, ROLLING = "fixed", "rolling"
_Key = TypeVar("_Key")
Rule = Callable[[Quantity, str], Judgement]
"""Of our value and the printed text."""


@dataclass(frozen=True)
class Evidence:
    """Everything that was computed."""

    parameters: TrebuchetParameters
    throws: Mapping[str, MachineThrow]
    """By machine."""
    sections: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Results of the further studies, by name; one that failed is absent."""
    failures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Why a study is absent, by name."""

    @property
    def ours(self) -> Values:
        """The reference's values."""
        return _flat({name: throw.values for name, throw in self.throws.items()})

    @property
    def uncertainties(self) -> Values:
        """Of the reference's values."""
        return _flat({name: throw.uncertainties for name, throw in self.throws.items()})

    @property
    def engines(self) -> list[str]:
        """Engines, in the order they were run in."""
        return list(dict.fromkeys(each.engine for throw in self.throws.values() for each in throw.engines))

    def of_engine(self, engine: str) -> dict[str, EngineThrow]:
        """An engine's throws by machine."""
        return {name: each for name, throw in self.throws.items() for each in throw.engines if each.engine == engine}


def _flat(values: Mapping[str, Readings]) -> Values:
    return {(machine, quantity): value for machine, own in values.items() for quantity, value in own.items()}


@dataclass(frozen=True)
class Row:
    """One claim of the paper: what is printed, what is compared with it, and by which rule."""

    name: str
    where: str
    printed: str | Printed
    quantity: str
    ours: Formula | Quantity | None
    """Computed from the throws, or known already; None where there is none."""
    judge: Rule | Judgement
    """A judgement where it does not follow from ours and the printed text alone."""
    machine: str = ""
    engines: tuple[EngineValue, ...] = ()
    """Values of the engines; those of a formula are computed from their throws."""

    def claim(self, evidence: Evidence) -> Claim:
        """Judge it; a quantity that is missing leaves it open."""
        if not isinstance(self.ours, Formula):
            return self.judged(self.ours, self.engines)
        try:
            value, width = spread(self.ours.value, evidence.ours, evidence.uncertainties)
        except KeyError as error:
            machine, quantity = error.args[0]
            missing = undecided(f"the reference's throw of the {machine!r} machine has no {quantity}")
            return self.judged(None, (), missing)
        ours = Quantity(value=value, uncertainty=width, unit=self.ours.unit)
        return self.judged(ours, tuple(_by_engine(self.ours, evidence, name) for name in evidence.engines))

    def judged(
        self, ours: Quantity | None, engines: tuple[EngineValue, ...] = (), judgement: Judgement | None = None
    ) -> Claim:
        """The claim of our value."""
        found = judgement or self.judge
        if not isinstance(found, Judgement):
            assert ours is not None, f"{self.name}: a rule needs a value"
            found = found(ours, str(self.printed))
        return Claim(
            name=self.name,
            where=self.where,
            printed=str(self.printed),
            quantity=self.quantity,
            machine=self.machine,
            ours=ours,
            engines=engines,
            rule=found.rule,
            verdict=found.verdict,
            why=found.why,
            departure=found.departure,
        )


class _Recorder(dict[_Key, float]):
    """Values that record which of them are read."""

    def __init__(self, values: Mapping[_Key, float]) -> None:
        super().__init__(values)
        self.used: dict[_Key, None] = {}

    def __getitem__(self, key: _Key) -> float:
        value = super().__getitem__(key)
        self.used[key] = None
        return value


def spread(
    of: Callable[[Mapping[_Key, float]], float], values: Mapping[_Key, float], widths: Mapping[_Key, float]
) -> tuple[float, float | None]:
    """A function's value, and the sum of what each width changes in it; None where a width is not known.

    A sum, not a root of squares: the errors of one run's quantities are correlated.

    Raises:
        KeyError: a value is missing.
    """
    recorder = _Recorder(values)
    value = of(recorder)
    if not recorder.used.keys() <= widths.keys():
        return value, None
    return value, sum(abs(of({**values, key: values[key] + widths[key]}) - value) for key in recorder.used)


def _by_engine(formula: Formula, evidence: Evidence, engine: str) -> EngineValue:
    throws = evidence.of_engine(engine)
    try:
        value = formula.value(_flat({name: each.values for name, each in throws.items()}))
    except KeyError as error:
        return EngineValue(engine=engine, value=None, note=_missing(throws, *error.args[0]))
    # The tolerance is what the engine's tolerances allow around *our* value.
    _, allowed = spread(formula.value, evidence.ours, _flat({name: each.tolerances for name, each in throws.items()}))
    return EngineValue(engine=engine, value=value, tolerance=allowed)


def _missing(throws: Mapping[str, EngineThrow], machine: str, quantity: ThrowQuantity) -> str:
    throw = throws.get(machine)
    if throw is None:
        return f"it was not run on {machine!r}"
    return throw.note or throw.lacking.get(quantity.law) or f"it has no {quantity}"
