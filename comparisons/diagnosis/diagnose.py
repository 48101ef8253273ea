"""When a motion first violates a tolerance, in which quantity, and which contacts are active then.

An error made early grows by itself on the way to the launch: a whip does that to any error, the
reference's own included. So a position is violated where its error exceeds the tolerance of *that
time*: the tolerance, which is stated for the whole throw, times the share to which an error of the
certified motion has grown by then. That growth is measured on the reference itself, between its
integration and a coarser one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ...engines.inspection import Dynamics, Inspectable, Inspection, State
from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.equations import Equations
from ...reference.integrator import one_thread
from ...reference.perturbed import TOLERANCE, solve_scheduled, without_centrifugal
from ...reference.solution import Solution
from ...reference.solver import solve
from ..runs.impacts import impact_times
from ..runs.metrics import THROWN, AlignedRun, against
from ..runs.quantities import Kind as QuantityKind
from ..runs.quantities import Quantity
from ..runs.results import Diagnosis, Equality, Metric, RankedCause
from ..runs.runner import failure
from .case import FINE, ROUGH, Case, estimate, fit, match
from .equivalence import (
    EXACT,
    Expected,
    check_model,
    expected,
    gap_errors,
    random_states,
    scaled_differences,
)
from .faults import (
    Hypothesis,
    Kind,
    armatures,
    gross_faults,
    hypotheses,
    machine_suspects,
    of_suspects,
    systematic_faults,
    wall_suspects,
    with_closed_loops,
)
from .fit import Found, better, faults_at_the_same_motion, fitting_faults
from .rank import SAME, SUFFICIENT, Estimate, measured, ranked
from .readings import NO_MOTION, Reading, all_readings, partly_late_readings
from .rerun import Rerun

_COARSE = 1e-9  # tolerance of the coarser integration: its error is far above the finer one's
# of the growth to the end: an engine's steps and soft stops show from the first one on
_LEAST = 1e-3
_GROWTH_SAMPLES = 400


@dataclass(frozen=True)
class Onset:
    """The first quantity to violate its tolerance, when, and the contacts that are active then."""

    first_violated: str
    time: float
    """[s]"""
    active: tuple[str, ...]


def find_onset(c: AlignedRun, violated: Iterable[Metric]) -> Onset | None:
    """The earliest of all violated quantities; None where none of them belongs to a time."""

    @cache
    def error_growth() -> FloatArray:
        return growth(c.solution, c.t)

    times = {metric.label: _time(c, metric, error_growth) for metric in violated}
    onsets = {label: t for label, t in times.items() if t is not None}
    if not onsets:
        return None
    first = min(onsets, key=lambda label: onsets[label])
    return Onset(first, onsets[first], active_contacts_at(c.solution, onsets[first]))


def active_contacts_at(solution: Solution, t: float) -> tuple[str, ...]:
    """Stops that are active in the reference at t [s]."""
    return next((s.closed for s in solution.segments if s.start <= t <= s.end), ())


def _time(c: AlignedRun, metric: Metric, error_growth: Callable[[], FloatArray]) -> float | None:
    """When a violated quantity leaves its tolerance [s]."""
    if metric.name == "release_time":
        times = (
            c.reference.release_times.get(metric.subject or ""),
            c.trajectory.release_times.get(metric.subject or ""),
        )
        return min((t for t in times if t is not None), default=None)
    if metric.name == "impact_time":
        stop = metric.subject or ""
        return min(
            (*impact_times(c.solution, stop), *impact_times(c.trajectory, stop)), default=None
        )
    if metric.name in ("launch_time", "launch_speed"):
        launch = c.solution.launch_at(LAUNCH_ANGLE, metric.subject or THROWN)
        return launch.time if launch else None
    series = next(_series(c, metric), None)
    if series is None or metric.tolerance is None:
        return None
    allowed = metric.tolerance * (error_growth() if metric.name in _GROWING else 1.0)
    beyond = np.flatnonzero(~(series <= allowed) & c.smooth)
    return float(c.t[beyond[0]]) if len(beyond) else None


_GROWING = {
    "position_max",
    "velocity_max",
    "angle_max",
    "angular_speed_max",
    "slide_max",
    "slide_speed_max",
}


"""Errors that the motion carries on."""


def _series(c: AlignedRun, metric: Metric) -> Iterator[FloatArray]:
    """The quantity along the motion, shape (n,); nothing for one that is no maximum over time."""
    own, expected, name = c.trajectory, c.reference, metric.subject or ""
    if metric.name == "position_max":
        yield c.distance(own.marker(name).position, expected.marker(name).position)
    elif metric.name == "velocity_max":
        yield c.distance(own.marker(name).velocity, expected.marker(name).velocity)
    elif metric.name in _COORDINATES:
        i = own.mechanism.coordinates.index(name)
        of = _COORDINATES[metric.name]
        yield c.distance(getattr(own, of)[:, i], getattr(expected, of)[:, i])
    elif metric.name == "stop_torque_max":
        yield c.distance(own.stop_torque(name), expected.stop_torque(name))
    elif metric.name == "joint_reaction_max":
        yield c.distance(own.joint_reaction(name), expected.joint_reaction(name))
    elif metric.name == "energy_balance":
        yield c.distance(*c.balance)
    elif metric.name in _ENERGIES:
        of = _ENERGIES[metric.name]
        yield c.distance(getattr(own, of), getattr(expected, of))


_COORDINATES = {
    "angle_max": "q",
    "slide_max": "q",
    "angular_speed_max": "u",
    "slide_speed_max": "u",
}


_ENERGIES = {"kinetic_energy_max": "kinetic_energy", "potential_energy_max": "potential_energy"}


"""Field of a trajectory by metric."""


def growth(solution: Solution, t: FloatArray) -> FloatArray:
    """Share of its size at the end to which an error has grown by t, shape (n,).

    It is measured on the certified motion, against a coarser integration; at most 1.
    """
    problem = solution.problem
    coarse = solve(
        Problem(problem.mechanism, duration=problem.duration, stop_law=problem.stop_law),
        _COARSE,
        _COARSE,
    )
    end = float(t[-1])
    grid = np.linspace(0.0, end, _GROWTH_SAMPLES)
    fine_q, coarse_q = solution.motion(grid).q, coarse.motion(grid).q
    grown = np.maximum.accumulate(np.linalg.norm(coarse_q - fine_q, axis=1))
    return np.interp(t, grid, np.maximum(grown / (grown[-1] or 1.0), _LEAST))


_CERTAIN = 0.9999  # share of a reading's mistake from which on no other cause is looked for
_CORRECTIONS = 4  # of a size that has no linear effect
# of the deviation: what deviates by less is right, where other quantities are wrong
_MISREAD = 0.01
_RIGHT = 1e-6  # of the sizes of quantities: what deviates by less is right
_STATE_METRICS = frozenset({"angle_max", "angular_speed_max", "slide_max", "slide_speed_max"})
_POINT_METRICS = frozenset({"position_max", "velocity_max"})
_FORCES = frozenset({QuantityKind.TORQUE, QuantityKind.FORCE})
"""Solvers find them by iteration: noise in them on a right motion is no mistake of reading."""


@one_thread()
def diagnose_motion(
    broken: Sequence[Metric],
    trajectory: Trajectory,
    solution: Solution,
    end: float,
    rerun: Rerun | None = None,
    told: frozenset[str] | None = None,
) -> Diagnosis:
    """Find the onset of the divergence, the first violated quantity and the likeliest causes.

    Args:
        broken: metrics of the motion that violate their tolerances, at least one.
        trajectory: the motion.
        solution: the reference's.
        end: end of the compared motion [s].
        rerun: the engine, which is run again where no suspect explains the deviation; None: there
        is none.
        told: quantities that the trajectory tells, as :func:`.signatures.quantities` names them;
            None: all that it has.
    """
    case = Case(trajectory, solution, end, frozenset(metric.name for metric in broken), told)
    onset = find_onset(against(trajectory, solution, end), broken)
    causes, likeliest = (
        _ranked_causes(case, rerun) if case.can_be_read else ranked(_misshapen(case))
    )
    return Diagnosis(
        leads=onset.first_violated if onset else broken[0].label,
        parts_at=onset.time if onset else None,
        holding=onset.active if onset else (),
        causes=causes,
        likeliest=likeliest,
        motion_agrees=case.can_be_read and _only_readings(case, causes[:likeliest]),
    )


def failed_diagnosis(broken: Sequence[Metric], error: Exception) -> Diagnosis:
    """A diagnosis that says why it failed: it must not cost the motion that it is about."""
    worst = max(broken, key=lambda metric: metric.share or 0.0)
    return Diagnosis(leads=worst.label, note=failure(error)[1].removesuffix("."))


def _ranked_causes(case: Case, rerun: Rerun | None) -> tuple[tuple[RankedCause, ...], int]:
    """Suspects in the order of their cost; the next kind only if the last explains too little.

    Mistakes of reading cost next to nothing. An engine is run again only if nothing else explains
    its deviation.
    """
    readings = [*_outright_causes(case), *_reading_causes(case)]
    shares = {cause.name: cause.explained for cause in readings}
    causes: list[RankedCause | Estimate] = [*readings]
    certain = max(shares.values(), default=0.0) >= _CERTAIN
    # Where little is recorded, faults and mistakes of reading may explain it alike.
    if case.told is not None or not certain:
        causes += [*fitting_faults(case), *_missing_causes(case), *_law_causes(case)]
    elif _motion_agrees(case):
        # A load that moves nothing is as good an explanation as a mistake of reading its force.
        causes += faults_at_the_same_motion(case)
    if shares.get(NO_MOTION, 0.0) >= SUFFICIENT:
        # So is the lack of what would move it.
        causes += [*_missing_causes(case), *_gross_causes(case)]
    else:
        causes = measured(causes)
        if not _is_settled(causes):
            causes += _gross_causes(case)
    causes = measured(causes)
    if rerun is not None and not ranked(causes)[1]:
        causes += rerun.causes(case)
    if not ranked(causes)[1]:
        causes += _misread(case)
    return ranked(causes)


def _is_settled(causes: Sequence[RankedCause | Estimate]) -> bool:
    """Whether a cause is named that leaves so little that none of another kind is looked for."""
    listed, named = ranked(causes)
    return named > 0 and listed[0].explained >= SAME


def _misshapen(case: Case) -> Iterator[RankedCause]:
    for name, shape in case.misshapen.items():
        yield RankedCause(name=f"shape of the {name}", kind="reading", amount=shape, explained=1.0)


def _outright_causes(case: Case) -> Iterator[RankedCause]:
    """Causes that a trajectory shows by itself.

    An early end, values that are no numbers, and markers that it does not have.
    """
    for name in case.missing_markers:
        yield RankedCause(name=f"no marker {name}", kind="reading", explained=1.0)
    last, step = float(case.whole.t[-1]), case.step
    if last < case.end - 2 * step:
        amount = f"at {last:.6g} s instead of {case.end:.6g} s"
        missing = 1.0 - last / case.end
        size = float(np.abs(case.channels.stacked(case.trajectory, case.reference)).max())
        yield RankedCause(
            name="run ends early",
            kind="reading",
            amount=amount,
            explained=missing / (missing + size),
        )
    yield from _first_sample(case)
    for name, since in case.channels.unusable.items():
        amount = f"from {since:.6g} s"
        yield RankedCause(
            name=f"{name}: not a finite number", kind="reading", amount=amount, explained=1.0
        )


def _first_sample(case: Case) -> Iterator[RankedCause]:
    """Quantities that are wrong at t = 0 alone, as of engines that compute them in a step."""
    error, later = (
        case.first_errors,
        float(np.abs(case.channels.stacked(case.trajectory, case.reference)).max()),
    )
    wrong = [name for name, size in error.items() if size > later / _MISREAD]
    if wrong:
        what = ", ".join(sorted({Quantity.parse(name).kind for name in wrong}))
        share = 1.0 - later / max(error[name] for name in wrong)
        yield RankedCause(name=f"first sample: {what}", kind="reading", explained=share)


def _missing_causes(case: Case) -> Iterator[RankedCause | Estimate]:
    """Parts that are missing, and data that are rounded: faults without a size."""
    for suspect in machine_suspects(case.mechanism):
        closed = None if suspect.scale else with_closed_loops(suspect.wrong)
        if closed is not None:
            yield _estimate(case, suspect.name, suspect.kind, Equations(closed))


def _gross_causes(case: Case) -> Iterator[RankedCause | Estimate]:
    """Forces that are quite wrong, and the other law of the stops."""
    for name, equations in gross_faults(case.mechanism):
        yield _estimate(case, name, "law", equations)
    for fault in systematic_faults(case.mechanism):
        closed = with_closed_loops(fault.wrong)
        if closed is not None:
            yield _estimate(case, fault.name, fault.kind, Equations(closed))
    given = StopLaw(case.solution.problem.stop_law)
    other = next(law for law in StopLaw if law != given)
    yield _estimate(case, f"stops by the law {other.value}", "law", other)


def _estimate(
    case: Case, name: str, kind: Kind, fault: Equations | StopLaw
) -> RankedCause | Estimate:
    """A fault without a size: roughly where that is enough to tell whether it can be listed."""

    def share(rough: bool) -> float | None:
        tolerance = ROUGH if rough else FINE
        if isinstance(fault, StopLaw):
            wrong = case.under(fault, tolerance)
        else:
            wrong = case.solved(fault, tolerance=tolerance)
        return None if wrong is None else _share(case, wrong)

    return estimate(RankedCause(name=name, kind=kind, explained=0.0), share, case.rough_error)


def _share(case: Case, wrong: Solution) -> float:
    """Share of the deviation that a faulty motion explains, whoever reads it."""
    signatures = case.seen(wrong, wrong.motion(case.t))
    return max(match(case.deviation, signature, fixed=True).explained for signature in signatures)


def _law_causes(case: Case) -> Iterator[RankedCause | Estimate]:
    """Stops that open at other times than they should, or never; and forces of the wrong law."""
    engine_times, reference_times = case.whole.release_times, case.solution.release_times
    closed = [stop.name for stop in case.mechanism.stops if stop.closed]
    right: dict[str, float | None] = {name: reference_times.get(name) for name in closed}
    releases = {name: engine_times.get(name) for name in closed}
    wrong = [name for name in closed if releases[name] != right[name]]
    for name in wrong:
        amount = f"{_format_time(releases[name])} instead of {_format_time(right[name])}"
        yield from _release(case, name, amount, {**right, name: releases[name]})
        if len(wrong) > 1 and name == _earliest(wrong, releases, right):
            # The others open late or early because of it.
            yield from _scheduled(case, f"release of the {name}", releases, amount)
    yield from _open_stops(case)
    for name in closed:
        if releases[name] is not None:
            yield from _scheduled(case, f"{name} never opens", {**right, name: None})
    if case.has_velocity_forces:
        dropped = without_centrifugal(case.mechanism)
        yield from _scheduled(case, "velocity-dependent forces dropped", releases, "", dropped)


def _open_stops(case: Case) -> Iterator[RankedCause]:
    """Releases recorded of stops that are open at the start, where nothing else is wrong."""
    wrong = [
        s.name
        for s in case.mechanism.stops
        if not s.closed and case.whole.release_times.get(s.name) is not None
    ]
    if (
        wrong
        and not case.has_impacts
        and float(np.abs(case.channels.stacked(case.trajectory, case.reference)).max()) < _RIGHT
    ):
        for name in wrong:
            amount = f"{_format_time(case.whole.release_times[name])} of a stop that is open"
            yield RankedCause(
                name=f"reading of the {name}'s release",
                kind="reading",
                amount=amount,
                explained=1.0,
            )


def _earliest(
    names: Iterable[str], own: Mapping[str, float | None], right: Mapping[str, float | None]
) -> str:
    """The stop whose wrong release comes first, whether it opens too early or does not open."""

    def time(name: str) -> float:
        return min((t for t in (own[name], right[name]) if t is not None), default=math.inf)

    return min(names, key=time)


def _release(
    case: Case, stop: str, amount: str, releases: Mapping[str, float | None]
) -> Iterator[RankedCause | Estimate]:
    """A release at another time: either the motion shows it, or only the reported time is wrong."""
    signature = _schedule(case, releases)
    if signature is None:
        return
    if not case.has_impacts:
        share = match(case.deviation, signature, fixed=True).explained
        yield RankedCause(name=f"release of the {stop}", kind="law", amount=amount, explained=share)
    would = float(np.linalg.norm(signature))
    explained = 1.0 - float(np.linalg.norm(case.deviation)) / would if would else 0.0
    yield RankedCause(
        name=f"reading of the {stop}'s release", kind="reading", amount=amount, explained=explained
    )


def _format_time(t: float | None) -> str:
    return "never" if t is None else f"{t:.6g} s"


def _scheduled(
    case: Case,
    name: str,
    releases: Mapping[str, float | None],
    amount: str = "",
    equations: Equations | None = None,
) -> Iterator[RankedCause | Estimate]:
    """Stops that open by a schedule.

    A scheduled motion has no impacts, and so is no motion of a mechanism that has some.
    """
    if case.has_impacts:
        return

    def share(rough: bool) -> float | None:
        signature = _schedule(case, releases, equations, ROUGH if rough else TOLERANCE)
        return None if signature is None else match(case.deviation, signature, fixed=True).explained

    cause = RankedCause(name=name, kind="law", amount=amount, explained=0.0)
    yield estimate(cause, share, case.rough_error)


def _schedule(
    case: Case,
    releases: Mapping[str, float | None],
    equations: Equations | None = None,
    tolerance: float = TOLERANCE,
) -> FloatArray | None:
    """Signature of a motion whose stops open by a schedule; None where it cannot be solved."""
    problem = case.problem(case.mechanism)
    try:
        solution = solve_scheduled(problem, releases, equations, tolerance)
    except TrebucheckError:
        return None
    return case.signature(solution.trajectory(case.t))


def _reading_causes(case: Case) -> list[RankedCause]:
    """Where no single kind of quantity is read late, all that deviate may be."""
    readings = all_readings(case.solution, case.reference, case.trajectory, case.step)
    found = list(_fitted(case, readings))
    if max((cause.explained for cause in found), default=0.0) < SAME:
        wrong = {Quantity.parse(name).kind for name in _wrong_quantities(case)}
        late = partly_late_readings(case.solution, case.reference, case.step, wrong)
        found += _fitted(case, late)
    return found


def _fitted(case: Case, readings: Iterable[Reading]) -> Iterator[RankedCause]:
    for reading in readings:
        signatures = np.array([case.signature(wrong) for wrong in reading.wrong])
        if reading.text is None:
            share = match(case.deviation, signatures[0], fixed=True).explained
            yield RankedCause(name=reading.name, kind="reading", explained=share)
            continue
        factors, explained = fit(case.deviation, signatures)
        if reading.at is not None:
            factors, explained = _corrected(case, reading, factors)
        if explained > 0 and factors[0] >= reading.least:
            amount = reading.text(factors.tolist())
            yield RankedCause(name=reading.name, kind="reading", amount=amount, explained=explained)


def _corrected(case: Case, reading: Reading, factors: FloatArray) -> tuple[FloatArray, float]:
    """Size and measured share of a mistake whose effect is not linear in it."""
    best, share = factors, 0.0
    for _ in range(_CORRECTIONS):
        wrong = reading.at(float(factors[0])) if reading.at else None
        if wrong is None:
            break
        signature = case.signature(wrong)
        left = match(case.deviation, signature, fixed=True).explained
        if left > share:
            best, share = factors, left
        factors = factors * match(case.deviation, signature).factor
    return best, share


def _wrong_quantities(case: Case) -> list[str]:
    """Those that deviate by more than a small part of the whole deviation."""
    return [name for name, share in case.shares.items() if share > _MISREAD]


def _motion_agrees(case: Case) -> bool:
    """Whether coordinates and speeds are right, or all positions and velocities, and others not.

    Right is what deviates by a small part of the whole deviation, and keeps its tolerance: an
    energy that depends on the square of a speed outweighs what goes with it.
    """
    wrong = set(_wrong_quantities(case))
    state = {QuantityKind.COORDINATES.value, QuantityKind.SPEEDS.value}
    points = {
        name
        for name in case.shares
        if Quantity.parse(name).kind in (QuantityKind.POSITION, QuantityKind.VELOCITY)
    }
    state_agrees = (
        state <= case.shares.keys() and not state & wrong and not case.broken & _STATE_METRICS
    )
    points_agree = bool(points) and not points & wrong and not case.broken & _POINT_METRICS
    return bool(wrong) and (state_agrees or points_agree)


def _forces_deviate(case: Case) -> bool:
    return any(Quantity.parse(name).kind in _FORCES for name in _wrong_quantities(case))


def _only_readings(case: Case, named: Sequence[RankedCause]) -> bool:
    """Whether the motion follows the reference.

    Where forces deviate, it does only if a mistake of reading them is named.
    """
    misread = bool(named) and all(cause.kind == "reading" for cause in named)
    return _motion_agrees(case) and (misread or not _forces_deviate(case))


def _misread(case: Case) -> Iterator[RankedCause]:
    """Quantities that are read wrongly in a way that no suspect has: the motion itself is right."""
    wrong = _wrong_quantities(case)
    if _motion_agrees(case) and not _forces_deviate(case):
        rest = float(
            np.linalg.norm([share for name, share in case.shares.items() if name not in wrong])
        )
        name = f"reading of the {', '.join(wrong)}"
        yield RankedCause(
            name=name, kind="reading", amount="the motion is right", explained=1.0 - rest
        )


_TELLING = 0.05  # of a deviation: what accounts for less is no suspect
_ALIKE = 1e-6  # relative, or [rad]: of a value that was mistaken for another
# Weight of a cause that one quantity shows, against one that explains all of them
_READ_OFF = 0.992
_NO_TORQUE = 0.97  # the same of a stop that carries none: it may be at another position


_CORRECTIONS_model = 6  # of a size, by Gauss and Newton


_PARTS = (1.0, 0.5, 0.25, 0.1, 0.01)  # of a correction that leads to a size that makes no sense
_FITS = 0.99999  # share from which on a size need not be corrected any more
_GAIN = 0.003  # in share: corrections that gain less are at an end
_HOPELESS = 0.2  # share to first order, below which a size is not corrected


def check_and_diagnose(engine: Engine, mechanism: Mechanism) -> tuple[Equality, Diagnosis | None]:
    """The model-equivalence check, and the suspected causes where it fails.

    Raises:
        TrebucheckError: the engine is not here, or cannot build the mechanism.
    """
    equality = check_model(engine, mechanism)
    return equality, None if equality.holds else diagnose_model(engine, mechanism, equality)


@one_thread()
def diagnose_model(engine: Engine, mechanism: Mechanism, broken: Equality) -> Diagnosis:
    """Suspected mistakes of a built model, the most likely first."""
    worst = max(
        broken.broken,
        key=lambda check: math.inf if check.value is None else check.value / check.tolerance,
    )
    causes: list[RankedCause] = []
    if isinstance(engine, Inspectable):
        states = random_states(mechanism)
        if broken.states:
            inspection = engine.inspect(mechanism, states)
            causes = [
                part
                for read in (_plain, _walls, _fitted_model)
                for part in read(mechanism, states, inspection)
            ]
        else:
            causes = list(_unknown_stops(engine, mechanism, states))
    listed, likeliest = ranked(causes)
    return Diagnosis(leads=worst.label, causes=listed, likeliest=likeliest)


def _unknown_stops(
    engine: Inspectable, mechanism: Mechanism, states: Sequence[State]
) -> Iterator[RankedCause]:
    """Stops that the model lacks: without them it can be inspected."""
    for stop in mechanism.stops:
        without = [state for state in states if stop.name not in state.closed]
        if len(without) < len(states):
            with suppress(
                Exception
            ):  # the engine may raise anything: then this stop is not the only cause
                engine.inspect(mechanism, without)
                yield RankedCause(name=f"{stop.name} missing", kind="law", explained=1.0)


def _plain(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[RankedCause]:
    """Causes that single quantities show: a wrong start, a misplaced stop, a missing one."""
    for i, (name, value, right) in enumerate(
        zip(mechanism.coordinates, inspection.start, mechanism.start, strict=True)
    ):
        if abs(value - right) > EXACT * max(1.0, abs(right)):
            mistake = _mistaken(float(value), right)
            amount = mistake or _difference(
                float(value) - right, "rad" if i < len(mechanism.angles) else "m"
            )
            yield RankedCause(
                name=f"start of {name}",
                kind="start",
                amount=amount,
                explained=1.0 if mistake else _READ_OFF,
            )
    for name, gap in gap_errors(expected(mechanism, states), inspection.dynamics).items():
        if abs(gap) > EXACT and mechanism.stop(name).effort == "torque":
            amount = f"{math.degrees(gap):+.3g} deg" if abs(gap) < math.pi else ""
            yield RankedCause(
                name=f"place of the {name}", kind="machine", amount=amount, explained=_READ_OFF
            )
    for stop in mechanism.stops:
        pairs = zip(inspection.dynamics, states, strict=True)
        held = [d.stop_torques.get(stop.name) for d, state in pairs if stop.name in state.closed]
        if held and not any(held):
            # A stop at another position carries no torque either: its position is then the more
            # likely cause.
            yield RankedCause(name=f"{stop.name} missing", kind="law", explained=_NO_TORQUE)


def _difference(value: float, unit: str) -> str:
    """A difference in words; nothing for an angle of more than a turn."""
    return "" if unit == "rad" and abs(value) > 2 * math.pi else f"{value:+.3g} {unit}"


def _walls(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[RankedCause]:
    """Walls at wrong positions, by the gaps alone: nothing else may show them."""
    right = expected(mechanism, states)
    deviation = _gaps(right, inspection.dynamics, inspection.dynamics)
    if np.abs(deviation).max(initial=0.0) <= EXACT:
        return

    def signature(equations: Equations) -> FloatArray:
        gaps = expected(equations.mechanism, states, equations).gaps
        faulty = [
            replace(dynamics, stop_gaps=wrong)
            for dynamics, wrong in zip(inspection.dynamics, gaps, strict=True)
        ]
        return _gaps(right, faulty, inspection.dynamics)[None]

    for suspect in wall_suspects(mechanism):
        found = _measured(of_suspects(mechanism, suspect.name, [suspect]), deviation, signature)
        if found is not None:
            yield found.cause.model_copy(update={"explained": _READ_OFF * found.explained})


def _mistaken(angle: float, right: float) -> str:
    """The common mistake that turns one angle into another; '' if there is none."""
    size = max(1.0, abs(right))
    degrees, radians = math.degrees(right), math.radians(right)
    readings = {"sign": -right, "degrees for radians": degrees, "radians for degrees": radians}
    return next(
        (what for what, value in readings.items() if abs(angle - value) <= _ALIKE * size), ""
    )


def _fitted_model(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[RankedCause]:
    """Suspects whose mechanisms differ from the right one alike, start and stops included."""
    right = expected(mechanism, states)
    gaps = _gaps(right, inspection.dynamics, inspection.dynamics)
    start = inspection.start - np.array(mechanism.start)
    deviation = np.concatenate([scaled_differences(right, inspection.dynamics), start, gaps])
    if not np.isfinite(deviation).all() or not deviation.any():
        return

    def signatures(equations: Equations) -> FloatArray:
        return np.array(list(_signatures(mechanism, right, equations, states, inspection)))

    found: dict[str, Found] = {}
    for hypothesis in (*hypotheses(mechanism, closing=False), *armatures(mechanism)):
        result, group = _measured(hypothesis, deviation, signatures), hypothesis.group
        if result is not None:
            found[group] = better(found[group], result) if group in found else result
    yield from (each.cause for each in found.values())
    for name, kind, equations in _gross(mechanism):
        shares = [
            match(deviation, signature, fixed=True).explained for signature in signatures(equations)
        ]
        yield RankedCause(name=name, kind=kind, explained=max(shares, default=0.0))


def _gross(mechanism: Mechanism) -> Iterator[tuple[str, Kind, Equations]]:
    """Faults without a size."""
    for suspect in machine_suspects(mechanism):
        if suspect.scale == 0:
            yield suspect.name, suspect.kind, Equations(suspect.wrong)
    for name, equations in gross_faults(mechanism):
        yield name, "law", equations


def _measured(
    hypothesis: Hypothesis, deviation: FloatArray, signatures: Callable[[Equations], FloatArray]
) -> Found | None:
    """A hypothesis of the size that fits, with the share that it explains; None if none fits.

    Args:
        hypothesis: with a size of one number or several.
        deviation: flat.
        signatures: of equations, as it may show in different engines, shape (n_ways, n).
    """
    zero = np.zeros(len(hypothesis.components))
    columns = _columns(hypothesis, zero, signatures)
    fits = (
        []
        if columns is None
        else [fit(deviation, columns[:, way]) for way in range(columns.shape[1])]
    )
    way = max(range(len(fits)), key=lambda k: fits[k][1], default=-1)
    if columns is None or way < 0 or fits[way][1] <= _TELLING:
        return None
    best, factors, step = None, zero, fits[way][0]
    for _ in range(_CORRECTIONS_model if fits[way][1] > _HOPELESS else 1):
        factors = _sensible(hypothesis, factors, step)
        equations = None if factors is None else hypothesis.equations(factors.tolist())
        if factors is None or equations is None:
            break
        signature = signatures(equations)[way]
        share = match(deviation, signature, fixed=True).explained
        gained = share - best.explained if best else 1.0
        if gained > 0:
            best = Found(hypothesis, factors, share)
        tangents = (
            None if share > _FITS or gained < _GAIN else _columns(hypothesis, factors, signatures)
        )
        if tangents is None:
            break
        step = fit(deviation - signature, tangents[:, way])[0]
    return best


def _columns(
    hypothesis: Hypothesis, factors: FloatArray, signatures: Callable[[Equations], FloatArray]
) -> FloatArray | None:
    """Change of the signatures with each component, shape (n_components, n_ways, n), or None."""
    units = np.eye(len(factors))
    made = [hypothesis.make(each.tolist()) for each in (factors, *(factors + units))]
    if any(equations is None for equations in made):
        return None
    here, *there = [signatures(equations) for equations in made if equations is not None]
    return np.array([ahead - here for ahead in there])


def _sensible(hypothesis: Hypothesis, factors: FloatArray, step: FloatArray) -> FloatArray | None:
    """The factors after the step, or after a part of it for which the size makes sense."""
    for part in _PARTS:
        if hypothesis.equations((factors + part * step).tolist()) is not None:
            return factors + part * step
    return None


def _signatures(
    mechanism: Mechanism,
    right: Expected,
    equations: Equations,
    states: Sequence[State],
    inspection: Inspection,
) -> Iterator[FloatArray]:
    """Signatures of wrong equations, in absolute coordinates and in those from the start.

    The latter's coordinates are off by the error of its start. And a stop at a wrong position need
    not have moved the start with it.
    """
    wrong = equations.mechanism
    if {stop.name for stop in wrong.stops} < {stop.name for stop in mechanism.stops}:
        return  # a missing stop: see _plain
    start = np.array(wrong.start) - np.array(mechanism.start)

    def shown(shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        exposed = expected(
            wrong, [replace(state, q=state.q + shift) for state in states], equations
        )
        values = exposed.as_dynamics(inspection.dynamics)
        return scaled_differences(right, values), _gaps(right, values, inspection.dynamics)

    here = shown(0.0 * start)
    moved = shown(start) if start.any() else here
    for (differences, gaps), start_error in ((here, start), (moved, start), (here, 0.0 * start)):
        yield np.concatenate([differences, start_error, gaps])


def _gaps(right: Expected, dynamics: Sequence[Dynamics], like: Sequence[Dynamics]) -> FloatArray:
    """Errors of the stops' gaps [rad or m] that an engine exposes; all states count as one."""
    errors = [
        engine_values.stop_gaps[name] - reference_gaps[name]
        for engine_values, reference_gaps, exposed in zip(dynamics, right.gaps, like, strict=True)
        for name in exposed.stop_gaps
    ]
    return np.array(errors) / math.sqrt(len(right.gaps))
