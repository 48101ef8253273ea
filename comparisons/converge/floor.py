"""What sets an accuracy floor: decided by refining every other parameter once there, to see which lowers it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engines.registry import engine, engine_study
from ...engines.study import ConstraintKinds, Options, Refinement
from ...models.errors import InputError
from ...reference.certification.certificate import REFUSED_BELOW
from ..report.numbers import format_number
from .results import Floor

LOWERED = 0.8
"""A refinement that leaves less than this share of an error has lowered it: the smallest one, a halving at first order,
leaves 0.5, and 0.8 where only two fifths of the error are of its making."""
_SINGLE = float(np.finfo(np.float32).epsneg)
_NAMED = 3  # refinements in the evidence
GROWN = 1.5
"""An error this many times the floor, at a finer value, is one that grows."""


def refinements(
    name: str, settings: Options, swept: Sequence[str], constraints: ConstraintKinds
) -> Iterator[tuple[Refinement, dict[str, Any]]]:
    """Every refinement at an engine's settings, and every option the tuned preset has otherwise, one at a time.

    Args:
        name: of the engine.
        settings: of the engine.
        swept: options of the swept parameter, which are left alone.
        constraints: what those of the mechanism hold.
    """
    for refinement in engine_study(name).refinements:
        change = refinement.change(settings, constraints)
        if change and not set(change) & set(swept) and set(change) <= set(settings):
            yield refinement, change
    for option, value in engine(name, "tuned").settings.items():
        if option in settings and settings[option] != value and option not in (*swept, "timestep"):
            yield Refinement(f"option {option}", f"{option} as tuned", _unchanged), {option: value}


def _unchanged(_: Options, __: ConstraintKinds) -> None:
    return None


@dataclass(frozen=True)
class Site:
    """Where a floor is looked into."""

    engine: str
    settings: Options
    swept: Sequence[str]
    error: float
    value: float | None
    measure: Callable[[dict[str, Any]], float | None]
    """The error with some options changed; None if the run fails."""
    constraints: ConstraintKinds
    """What those of the mechanism hold."""


def floor(site: Site, uncertainty: float, finer: Sequence[tuple[float, float]] = ()) -> Floor:
    """Decide what sets an error that the swept parameter does not lower.

    Args:
        site: where, and how errors are measured there.
        uncertainty: of the reference, in the error's unit.
        finer: value and error of points beyond, towards finer values.
    """

    def because(cause: str, evidence: str) -> Floor:
        return Floor(error=site.error, value=site.value, cause=cause, evidence=evidence)

    if site.error <= REFUSED_BELOW * uncertainty:
        return because(
            "the reference's uncertainty",
            f"it is known to {format_number(uncertainty)}, a tenth of this or more",
        )
    grown = [(value, error) for value, error in finer if error >= GROWN * site.error]
    if grown and site.value is not None and "timestep" in site.swept:
        value, error = grown[-1]
        power = math.log(error / site.error) / math.log(value / site.value)
        return because(
            "rounding",
            f"grows again as the step h shrinks, as h^{power:.1f} to {format_number(value)} s",
        )
    return because(*_lowered_most(site))


def _lowered_most(site: Site) -> tuple[str, str]:
    remaining: list[tuple[float, Refinement]] = []
    for refinement, change in refinements(site.engine, site.settings, site.swept, site.constraints):
        try:
            error = site.measure(change)
        except InputError:
            continue  # finer than the engine takes
        if error is not None:
            remaining.append((error / site.error, refinement))
    lowered = sorted(
        ((share, refinement) for share, refinement in remaining if share <= LOWERED),
        key=lambda lowering: lowering[0],
    )
    if not lowered:
        nothing = f"none of {len(remaining)} other knobs, turned one notch, lowers it by a fifth"
        if engine_study(site.engine).single_precision:
            return "single precision", f"{nothing}; it rounds to {_SINGLE:.1e}, as its study says"
        return "not found", nothing
    effects = "; ".join(
        f"{refinement.description} leaves {share:.2g}" for share, refinement in lowered[:_NAMED]
    )
    return lowered[0][1].cause, effects
