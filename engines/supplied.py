"""Parts of a run that trebucheck does in the engine's place.

An engine that has no stops can be moved by trebucheck's multipliers on its mass matrix, and one
without an integrator by trebucheck's. That such a run agrees speaks for the engine's dynamics, not
for stops or steps that it does not have; so each engine says what its adapter supplies, and tables
of verdicts show it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, cast

from pydantic import JsonValue

from ..models.mechanism import Mechanism
from .study import same_value


class Part(StrEnum):
    """Parts of a run."""

    STEPS = "time steps"
    STOPS = "stop forces"
    LOOPS = "loop forces"
    ELEMENTS = "springs, dampers and motors"
    EVENTS = "when stops open and are met"
    IMPACTS = "impulses of impacts"
    START = "the first step"
    CORRECTIONS = "corrections in each step"
    SUBSTEPS = "shorter steps between events"
    RESTARTS = "new starts within a run"
    MODEL = "joints and bodies in another form"
    UNITS = "units of the mechanism's size"
    REACTIONS = "joint forces read off the motion"
    TORQUES = "stop forces read off the motion"
    LOOP_REACTIONS = "loop forces read off the motion"


class Own(StrEnum):
    """Share of a run that is the engine's."""

    ALL = "all"  # every part of it
    MOST = "most"
    """Trebucheck finds when stops open and are met, computes impulses, or adds or reads forces."""
    STEPS = "steps"
    """Its dynamics and its integrator; what stops, loops or springs do is trebucheck's."""
    DYNAMICS = "dynamics"  # mass matrix, forces, energies and points; the steps are trebucheck's


Supplied = Mapping[Part, str]
"""Parts that trebucheck does, each with its case; '': always and all of it."""

NOTHING: Supplied = MappingProxyType({})
HELD: Supplied = MappingProxyType(
    dict.fromkeys((Part.STOPS, Part.LOOPS, Part.ELEMENTS, Part.EVENTS, Part.IMPACTS), "")
)
"""With the toolkit's event driver and multipliers: all but the steps of a free tree."""
MOVED: Supplied = MappingProxyType({Part.STEPS: "", **HELD})
"""The same of an engine that is moved by one of the toolkit's schemes."""

LIMITED: Supplied = MappingProxyType({Part.ELEMENTS: "", Part.TORQUES: ""})
"""By :class:`.joint_tree.LimitedMotion`, of an engine that steps and holds limits itself."""


@dataclass(frozen=True)
class Assistance:
    """Something that trebucheck does in an engine's place, and how it is switched off."""

    part: Part
    does: str
    """Action of trebucheck, as a verb with its object."""
    option: str
    """Name of the option that asks for it."""
    off: JsonValue
    """Value of that option without it."""
    depending: Mapping[str, JsonValue] = field(default_factory=dict[str, JsonValue])
    """Options that have to be set as well where it is off: they are refused without it."""
    acts_on: Callable[[Mechanism], bool] = lambda _: True
    """Whether it can change the motion of a mechanism."""

    def is_on(self, settings: Mapping[str, Any]) -> bool:
        """Tell whether it is asked for by these options."""
        return not same_value(settings[self.option], self.off)

    @property
    def options_without(self) -> dict[str, JsonValue]:
        """The options that switch it off."""
        return {self.option: self.off, **self.depending}


def has_stops(mechanism: Mechanism) -> bool:
    """Tell whether a mechanism has stops."""
    return bool(mechanism.stops)


def has_loops(mechanism: Mechanism) -> bool:
    """Tell whether a mechanism has loops of joints, or couplers."""
    return bool(mechanism.bound_by)


def has_instants(mechanism: Mechanism) -> bool:
    """Tell whether a recorded effort of a mechanism changes."""
    return bool(mechanism.instants)


_CONCERNED: Mapping[Part, Callable[[Mechanism], bool]] = {
    Part.STOPS: has_stops,
    Part.EVENTS: has_stops,
    Part.IMPACTS: has_stops,
    Part.LOOPS: has_loops,
    Part.ELEMENTS: lambda mechanism: bool(mechanism.force_elements),
}


def all_by(option: str, off: JsonValue, supplied: Supplied) -> tuple[Assistance, ...]:
    """Assistance by which an adapter does all of these parts, and one option switches all off."""
    return tuple(
        Assistance(part, does, option, off, acts_on=_CONCERNED.get(part, lambda _: True))
        for part, does in supplied.items()
    )


def by_part(assistance: Iterable[Assistance]) -> dict[Part, str]:
    """Texts of what trebucheck does, by the part of a run."""
    does: dict[Part, list[str]] = {}
    for each in assistance:
        does.setdefault(each.part, []).append(each.does)
    return {part: ", ".join(texts) for part, texts in does.items()}


def stated(engine: object, mechanism: Mechanism | None = None) -> dict[str, str] | None:
    """The parts that an engine states; None of one that states nothing.

    Args:
        engine: any object with a mapping `supplied`.
        mechanism: assistance that cannot act on it is left out; None: all is stated.
    """
    given = getattr(engine, "supplied", None)
    if not isinstance(given, Mapping):
        return None
    parts = {str(part): str(of) for part, of in cast("Supplied", given).items()}
    if mechanism is not None:
        assistance = cast("tuple[Assistance, ...]", getattr(engine, "assisted_by", ()))
        acting = by_part(each for each in assistance if each.acts_on(mechanism))
        idle = {str(each.part) for each in assistance}.difference(map(str, acting))
        parts = {part: of for part, of in parts.items() if part not in idle}
        parts |= {str(part): of for part, of in acting.items()}
    return parts


def idle_options(engine: object, mechanism: Mechanism) -> frozenset[str]:
    """Options that ask for nothing but assistance that cannot act on a mechanism."""
    assistance = cast("tuple[Assistance, ...] | None", getattr(engine, "assistance", None)) or ()
    acting = {each.option for each in assistance if each.acts_on(mechanism)}
    return frozenset(each.option for each in assistance) - acting


def only_read(supplied: Mapping[str, str]) -> bool:
    """Tell whether trebucheck does no part of a run, but to read quantities off its motion."""
    return set(supplied) <= {Part.REACTIONS, Part.TORQUES, Part.LOOP_REACTIONS}


def concerned(*, stops: bool, impacts: bool, loops: bool, elements: bool) -> frozenset[Part]:
    """Parts that a run has on a mechanism with stops (that may be met), loops, force elements."""
    present = {
        Part.STOPS: stops,
        Part.TORQUES: stops,
        Part.EVENTS: stops,
        Part.IMPACTS: stops and impacts,
        Part.LOOPS: loops,
        Part.LOOP_REACTIONS: loops,
        Part.ELEMENTS: elements,
        Part.RESTARTS: loops or elements,
    }
    return frozenset(part for part in Part if present.get(part, True))


def own(supplied: Mapping[str, str], concerned: Collection[Part] = tuple(Part)) -> Own:
    """Tell how much of a run with the parts `concerned` is the engine's."""
    if supplied.get(Part.STEPS) == "":
        return Own.DYNAMICS
    held = {Part.STOPS, Part.LOOPS}
    if Part.STEPS in supplied:  # in some cases: of what is held or pushed
        held.add(Part.ELEMENTS)
    of_run = set(supplied).intersection(concerned) - {Part.STEPS}
    if held & of_run:
        return Own.STEPS
    return Own.MOST if of_run else Own.ALL


def parts(supplied: Mapping[str, str]) -> str:
    """The parts in one line; '' for none."""
    return "; ".join(f"{part} ({of})" if of else str(part) for part, of in supplied.items())


def sentence(supplied: Mapping[str, str]) -> str:
    """The parts as a sentence or two."""
    if not supplied:
        return "All of a run is the engine's own."
    return f"Trebucheck supplies: {parts(supplied)}. The rest is the engine's own."
