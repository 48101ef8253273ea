"""Parts of a run that trebucheck does in the engine's place.

An engine that has no stops can be moved by trebucheck's multipliers on its mass matrix, and one
without an integrator by trebucheck's. That such a run agrees speaks for the engine's dynamics, not
for stops or steps that it does not have; so each engine says what its adapter supplies, and tables
of verdicts show it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import cast


class Part(StrEnum):
    """Parts of a run."""

    STEPS = "time steps"
    STOPS = "stop forces"
    LOOPS = "loop forces"
    ELEMENTS = "springs, dampers and motors"
    EVENTS = "when stops open and are met"
    IMPACTS = "impulses of impacts"
    REACTIONS = "joint forces read off the motion"
    TORQUES = "stop forces read off the motion"


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


def stated(engine: object) -> dict[str, str] | None:
    """The parts that an engine states; None of one that states nothing."""
    given = getattr(engine, "supplied", None)
    if not isinstance(given, Mapping):
        return None
    return {str(part): str(of) for part, of in cast("Supplied", given).items()}


def concerned(*, stops: bool, impacts: bool, loops: bool, elements: bool) -> frozenset[Part]:
    """Parts that a run has on a mechanism with stops (that may be met), loops, force elements."""
    present = {
        Part.STOPS: stops,
        Part.TORQUES: stops,
        Part.EVENTS: stops,
        Part.IMPACTS: stops and impacts,
        Part.LOOPS: loops,
        Part.ELEMENTS: elements,
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
