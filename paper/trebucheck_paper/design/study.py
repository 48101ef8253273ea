"""A rolling machine that is fastest at its best release, the question that ends Sec. VI."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from trebucheck.api.engines import engine
from trebucheck.api.mechanics import (
    BEYOND_LAUNCH,
    FloatArray,
    InputError,
    Mechanism,
    SimulationError,
    TrebuchetParameters,
    fixed,
    fly,
    range_rate,
    rolling,
    solve,
    throw,
)
from trebucheck.api.studies import Worker

from ..evidence.claims import EngineValue, Quantity
from ..evidence.engine_runs import TAIL, SampledMotion, allowed, simulated, turning
from ..evidence.quantities import (
    BEST_ANGLE,
    BEST_RANGE,
    BEST_SPEED,
    BEST_TIME,
    FASTEST_TIME,
    read_certified,
)
from ..sweep.study import ENGINES
from .first_forward_swing import (
    Bounds,
    CoincidingDesign,
    Design,
    FirstForwardSwing,
    Reading,
    Throwing,
    first_forward_swing_of,
    kinetic_rate,
    read_throw,
)
from .search import NAMES, NEARNESS, RANGE, Family, Objective

__all__ = ["Bounds", "Design", "design_rolling"]

FARTHEST, NEAREST, AT_45 = "farthest", "nearest to the paper's", "fastest at 45 degrees"
"""Names of the designs."""
CONSTRAINTS = (
    "same masses, gravity and start angles as the given machine; arm of the given length, l1 + l2",
    "the sling's rest opens, and the velocity then comes down to 45 degrees within three natural "
    "times",
    "the projectile's speed is largest inside the first sweep, not at an end of it",
    "the best release of the first sweep throws forward, back to the fulcrum's height",
    "the arm does not come to its stop (theta = 3 pi / 2) before either instant",
)
_SAFETY = 4.0  # on the difference of two integrators, as where certificates are estimated


def design_rolling(
    parameters: TrebuchetParameters | None = None,
    bounds: Bounds | None = None,
    engines: Sequence[str] = ENGINES,
    worker: Worker | None = None,
) -> Design:
    """Choose r, h, l1 of a rolling machine so that its energy is largest at its best release.

    One condition on three lengths: of all machines that meet it, the one that throws farthest and
    the one nearest to the given machine are looked for, by sequential quadratic programming from
    the best of a coarse grid; and the one that throws farthest with its largest kinetic energy at
    45 degrees. What is reported is computed anew by the reference, and its optimality conditions
    are checked.

    Args:
        parameters: masses, gravity, start angles, length of the arm, and the machine to compare
            with; Table I if left out.
        bounds: of r, h and l1.
        engines: names; one that fails or is absent becomes a note.
        worker: the process engines run in; None: this one.

    Raises:
        InputError: the bounds are empty or leave the arm, the given machine does not throw, or no
        design was found.
        SimulationError: the reference's own integrator does not reproduce the throw of the search.
    """
    began = time.perf_counter()
    p, within = parameters or TrebuchetParameters(), bounds or Bounds()
    _refuse_bounds(within, p.l1 + p.l2)
    search = _Search(p, within, engines, worker)
    designs = search.designs()
    return Design(
        bounds=within,
        constraints=CONSTRAINTS,
        paper_rolling=_reference_throw(p, rolling),
        paper_fixed=_reference_throw(p, fixed),
        designs=designs,
        unconstrained=search.unconstrained(),
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True)
class _Search:
    parameters: TrebuchetParameters
    bounds: Bounds
    engines: Sequence[str]
    worker: Worker | None

    @cached_property
    def family(self) -> Family:
        return Family(self.parameters, self.parameters.l1 + self.parameters.l2, self.bounds)

    @cached_property
    def starts(self) -> list[FloatArray]:
        starts = self.family.starts()
        if not starts:
            raise InputError(
                f"bounds = {self.bounds.model_dump()} hold no machine of the coarse grid that "
                "throws and has its largest kinetic energy near its best release; wider ones are "
                "needed."
            )
        return starts

    def designs(self) -> tuple[CoincidingDesign, ...]:
        farthest = self._design(FARTHEST, self.family, RANGE, self.starts)
        given = np.ones(len(NAMES))
        first = given if farthest is None else self.family.scaled(farthest.throwing.parameters)
        nearest = self._design(NEAREST, self.family, NEARNESS, [given, first])
        at_45 = Family(self.family.parameters, self.family.beam, self.bounds, Reading.FORTY_FIVE)
        designs = (farthest, nearest, self._design(AT_45, at_45, RANGE, [first]))
        return tuple(design for design in designs if design is not None)

    def unconstrained(self) -> Throwing | None:
        x = self.family.farthest(self.starts[0])
        return None if x is None else _reference_throw(self.family.machine(x), rolling)

    def _design(
        self, name: str, family: Family, objective: Objective, starts: Sequence[FloatArray]
    ) -> CoincidingDesign | None:
        """The best that was reached from any start; None if none reached one."""
        reached = family.maximised(starts, objective)
        if not reached:
            return None
        x = reached[0]
        sketched, swing = family.sweep(x), first_forward_swing_of(rolling(family.machine(x)), solve)
        if sketched is None or swing is None:
            raise SimulationError(
                f"the design {name!r} throws by one integrator of the reference and not by another."
            )
        delay = swing.delay(family.reading)
        width = _SAFETY * abs(delay - sketched.delay(family.reading)) + float(
            np.spacing(swing.fastest)
        )
        return CoincidingDesign(
            name=name,
            objective="range" if objective is RANGE else "nearness",
            reading=family.reading,
            throwing=read_throw(family.machine(x), swing),
            difference=Quantity(value=delay, uncertainty=width, unit="s"),
            change=float(np.linalg.norm(x - 1)),
            optimality=family.conditions(x, objective, reached, len(starts)),
            warnings=throw(rolling(family.machine(x)), best=True).warnings,
            engines=confirmed(self.engines, swing, self.worker),
        )


def _reference_throw(
    parameters: TrebuchetParameters, build: Callable[[TrebuchetParameters], Mechanism]
) -> Throwing:
    mechanism = build(parameters)
    swing = first_forward_swing_of(mechanism, solve)
    if swing is None:
        raise InputError(
            f"the {mechanism.name!r} machine to compare with does not throw in its first forward "
            "swing."
        )
    return read_throw(parameters, swing)


def _refuse_bounds(bounds: Bounds, beam: float) -> None:
    for name in NAMES:
        low, high = getattr(bounds, name)
        if not 0 < low < high:
            raise InputError(
                f"{name} = {(low, high)!r} of the bounds must be two positive lengths in m, rising."
            )
    if not bounds.l1[1] < beam:
        raise InputError(
            f"l1 = {bounds.l1!r} of the bounds must stay below the arm's length of {beam!r} m."
        )


QUANTITIES = {
    "largest_ratio_time": FASTEST_TIME,
    "best_release_time": BEST_TIME,
    "best_release_angle": BEST_ANGLE,
    "best_release_speed": BEST_SPEED,
    "best_range": BEST_RANGE,
}
"""Quantities by their names in the data."""
_STEP = 1e-4  # [s] for derivatives in time of what changes over hundredths of a second


def confirmed(
    engines: Sequence[str], swing: FirstForwardSwing, worker: Worker | None
) -> dict[str, tuple[EngineValue, ...]]:
    """Values of :data:`QUANTITIES` of each engine, in SI units and radians, with their tolerances.

    Args:
        engines: names; one that fails or is absent has a note instead of a value.
        swing: the design's first forward swing by the reference.
        worker: the process engines run in; None: this one.
    """
    mechanism = swing.solution.problem.mechanism
    end = max(swing.launch + BEYOND_LAUNCH, swing.fastest, swing.best.time) + TAIL
    values: dict[str, list[EngineValue]] = {name: [] for name in QUANTITIES}
    for name in engines:
        run = simulated(name, mechanism, end, worker)
        note = run if isinstance(run, str) else "its motion has no such instant"
        read = {} if isinstance(run, str) else read_certified(SampledMotion(run), mechanism)
        allowed_of = tolerances(swing, allowed(engine(name), mechanism).position) if read else {}
        for label, quantity in QUANTITIES.items():
            value, tolerance = read.get(quantity), allowed_of.get(label)
            note_of = note if value is None else None
            values[label].append(
                EngineValue(engine=name, value=value, tolerance=tolerance, note=note_of)
            )
    return {label: tuple(each) for label, each in values.items()}


def tolerances(swing: FirstForwardSwing, position: float | None) -> dict[str, float]:
    """Tolerances of quantities that follow from the projectile's position [m], to first order.

    The velocity is allowed w times as much and the acceleration w^2 times, w being the rate at
    which the velocity turns (see `paper.evidence.engine_runs`). Where a quantity's instant is a
    zero of a rate, the instant may move by what the rate may, over the rate's own slope.

    Args:
        position: None gives no tolerances.
    """
    if position is None:
        return {}
    projectile, best = swing.projectile, swing.best
    flight = fly(best, swing.surroundings)
    vx, vy = flight.impact_velocity
    lands = math.hypot(1.0, vx / vy)  # a displacement at the landing to one along the ground
    rate = turning(projectile, best.time)
    velocity, acceleration = rate * position, rate**2 * position
    late = (
        lands
        * (velocity + flight.time * acceleration)
        / _slope(lambda t: _range_rate(swing, t), best.time)
    )
    _, v, a = (part[0] for part in projectile.states(np.array([swing.fastest])))
    turn = turning(projectile, swing.fastest)
    force = (
        float(np.linalg.norm(v)) * turn**2 * position + float(np.linalg.norm(a)) * turn * position
    )
    along = abs(kinetic_rate(projectile, best.time)) / best.speed
    return {
        "largest_ratio_time": force / _slope(lambda t: kinetic_rate(projectile, t), swing.fastest),
        "best_release_time": late,
        "best_release_angle": velocity / best.speed + rate * late,
        "best_release_speed": velocity + along * late,
        "best_range": lands * (position + flight.time * velocity),
    }


def _range_rate(swing: FirstForwardSwing, t: float) -> float:
    return range_rate(swing.projectile.release_at(t), swing.surroundings)


def _slope(rate: Callable[[float], float], time: float) -> float:
    return abs(rate(time + _STEP) - rate(time - _STEP)) / (2 * _STEP)
