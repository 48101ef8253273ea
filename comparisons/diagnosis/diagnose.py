"""Diagnoses of motions that exceed tolerances, and of built models that fail their check.

A diagnosis says when a motion first violates a tolerance, in which quantity, which contacts are
active then, and what the likeliest causes are. An error made early grows by itself on the way to
the launch: a whip does that to any error, the reference's own included. So a position is violated
where its error exceeds the tolerance of *that time*: the tolerance, which is stated for the whole
throw, times the share to which an error of the certified motion has grown by then. That growth is
measured on the reference itself, between its integration and a coarser one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

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
from ..runs.quantities import Kind
from ..runs.results import Diagnosis, Equality, Metric, RankedCause
from ..runs.runner import failure
from .case import Case, factor_of, fit, share_of
from .derivatives import mismatches
from .equivalence import (
    EXACT,
    check_model,
    expected,
    gap_errors,
    random_states,
    scaled_differences,
)
from .faults import (
    Fault,
    armatures,
    gross_faults,
    hypotheses,
    machine_suspects,
    missing_faults,
    of_suspects,
    sizeless,
    systematic_faults,
)
from .fit import Fit, better, faults_at_the_same_motion, fitting_faults
from .integrators import integrator_causes
from .rank import SAME, SUFFICIENT, TELLING, Estimate, measured, ranked, ranked_with_parts
from .readings import NO_MOTION, Reading, all_readings, partly_late_readings
from .rerun import Rerun

Causes = Iterator[RankedCause | Estimate]

# -------------------------------------------------------------------------------------- onset

_COARSE = 1e-9  # tolerance of the coarser integration: its error is far above the finer one's
# of the growth to the end: an engine's steps and soft stops show from the first one on
_LEAST = 1e-3
_GROWTH_SAMPLES = 400
_Series = Callable[[Trajectory, str], FloatArray]
_POINTS: dict[str, _Series] = {
    "position_max": lambda run, marker: run.marker(marker).position,
    "velocity_max": lambda run, marker: run.marker(marker).velocity,
}
_COORDINATES: dict[str, _Series] = {
    "angle_max": lambda run, name: run.q[:, run.mechanism.coordinates.index(name)],
    "slide_max": lambda run, name: run.q[:, run.mechanism.coordinates.index(name)],
    "angular_speed_max": lambda run, name: run.u[:, run.mechanism.coordinates.index(name)],
    "slide_speed_max": lambda run, name: run.u[:, run.mechanism.coordinates.index(name)],
}
_CARRIED_ON = _POINTS | _COORDINATES
"""Quantities by metric whose errors the motion carries on to later times."""
_OF_FORCES: dict[str, _Series] = {
    "stop_torque_max": lambda run, stop: run.stop_torque(stop),
    "joint_reaction_max": lambda run, joint: run.joint_reaction(joint),
}
_SERIES: dict[str, _Series] = {
    **_CARRIED_ON,
    **_OF_FORCES,
    "kinetic_energy_max": lambda run, _: run.kinetic_energy,
    "potential_energy_max": lambda run, _: run.potential_energy,
}
"""Quantities along the motion by the metric of their largest error and its subject."""


@dataclass(frozen=True)
class Onset:
    """The first quantity to violate its tolerance, when, and the contacts that are active then."""

    first_violated: str
    time: float
    """[s]"""
    active: tuple[str, ...]


def find_onset(c: AlignedRun, violated: Iterable[Metric]) -> Onset | None:
    """The earliest of all violated quantities; None where none of them belongs to a time."""
    own, right, grown = c.trajectory, c.reference, None
    onsets: dict[str, float] = {}
    for metric in violated:
        name, allowed, times = metric.subject or "", metric.tolerance, list[float | None]()
        if metric.name == "release_time":
            times = [right.release_times.get(name), own.release_times.get(name)]
        elif metric.name == "impact_time":
            times = [*impact_times(c.solution, name), *impact_times(own, name)]
        elif metric.name in ("launch_time", "launch_speed"):
            launch = c.solution.launch_at(LAUNCH_ANGLE, name or THROWN)
            times = [launch.time if launch else None]
        elif allowed is not None and (metric.name in _SERIES or metric.name == "energy_balance"):
            distance = _distance(c, metric)
            limit = np.full_like(c.t, allowed)
            if metric.name in _CARRIED_ON:
                if grown is None:
                    grown = growth(c.solution, c.t)
                limit = allowed * grown
            compared = c.of_forces if metric.name in _OF_FORCES else c.smooth
            times = c.t[~(distance <= limit) & compared][:1].tolist()
        known = [time for time in times if time is not None]
        if known:
            onsets[metric.label] = min(known)
    if not onsets:
        return None
    first = min(onsets, key=lambda label: onsets[label])
    return Onset(first, onsets[first], active_contacts_at(c.solution, onsets[first]))


def _distance(c: AlignedRun, metric: Metric) -> FloatArray:
    """Distance from the reference in a metric's quantity at the compared times, shape (n,)."""
    if metric.name not in _SERIES:
        return c.distance(*c.balance)
    series, name = _SERIES[metric.name], metric.subject or ""
    return c.distance(series(c.trajectory, name), series(c.reference, name))


def _first_violation(c: AlignedRun, violated: Iterable[Metric]) -> float | None:
    """Time when a coordinate or a point exceeds its tolerance [s]; None where none does.

    It is the tolerance of the whole motion, which :func:`find_onset` takes a share of.
    """
    times: list[float] = []
    for metric in violated:
        if metric.name in _CARRIED_ON and metric.tolerance is not None:
            exceeds = ~(_distance(c, metric) <= metric.tolerance)
            times += c.t[exceeds & c.smooth][:1].tolist()
    return min(times, default=None)


def active_contacts_at(solution: Solution, t: float) -> tuple[str, ...]:
    """Stops that are active in the reference at t [s]."""
    return next((s.closed for s in solution.segments if s.start <= t <= s.end), ())


def growth(solution: Solution, t: FloatArray) -> FloatArray:
    """Share of its size at the end to which an error has grown by t, shape (n,).

    It is measured on the certified motion, against a coarser integration; at most 1.
    """
    problem, end = solution.problem, float(t[-1])
    same = Problem(problem.mechanism, duration=problem.duration, stop_law=problem.stop_law)
    grid = np.linspace(0.0, end, _GROWTH_SAMPLES)
    coarse = solve(same, _COARSE, _COARSE).motion(grid).q
    apart = np.linalg.norm(coarse - solution.motion(grid).q, axis=1)
    grown = np.maximum.accumulate(apart)
    return np.interp(t, grid, np.maximum(grown / (grown[-1] or 1.0), _LEAST))


# ------------------------------------------------------------------------------------- motions

_CERTAIN = 0.9999  # share of a reading's mistake from which on no other cause is looked for
_CORRECTIONS = 4  # of a size that has no linear effect
# of the deviation: what deviates by less is right, where other quantities are wrong
_MISREAD = 0.01
_RIGHT = 1e-6  # of the sizes of quantities: what deviates by less is right
_MISSING = "missing_time"
_MOST = 0.8  # of a motion; one that is looked at for longer is looked at to its end
_STATE_METRICS = frozenset(_COORDINATES)
_POINT_METRICS = frozenset(_POINTS)
_FORCES = frozenset({Kind.TORQUE, Kind.FORCE})
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
        told: quantities that the trajectory tells, by their texts
            (:class:`..runs.quantities.Quantity`); None: all that it has.
    """
    case = Case(trajectory, solution, end, frozenset(metric.name for metric in broken), told)
    aligned, to, shown = against(trajectory, solution, end), end, None
    onset = find_onset(aligned, broken)
    if case.can_be_read:
        if rerun is not None:
            to = _end_of_reruns(aligned, broken)
            shown = partial(rerun.causes, replace(case, end=to))
        causes, likeliest = _ranked_causes(case, shown)
        # The motion follows the reference; where forces deviate, only if they are misread.
        named = causes[:likeliest]
        misread = bool(named) and all(cause.kind == "reading" for cause in named)
        agrees = _motion_agrees(case) and (misread or not _forces_deviate(case))
    else:
        shapes = [_reading(f"shape of the {n}", 1.0, shape) for n, shape in case.misshapen.items()]
        (causes, likeliest), agrees = ranked(shapes), False
    return Diagnosis(
        leads=onset.first_violated if onset else broken[0].label,
        parts_at=onset.time if onset else None,
        holding=onset.active if onset else (),
        causes=causes,
        likeliest=likeliest,
        motion_agrees=agrees,
        reruns_to=to if to < end else None,
        left_out=0 if rerun is None else rerun.time.left_out,
    )


def _last_of_forces(c: AlignedRun, violated: Sequence[Metric]) -> float | None:
    """Time when a force exceeds its tolerance last [s]; None where not forces alone do."""
    times: list[float] = []
    for metric in violated:
        if metric.name not in _OF_FORCES or metric.tolerance is None:
            return None
        times += c.t[~(_distance(c, metric) <= metric.tolerance) & c.of_forces][-1:].tolist()
    return max(times, default=None)


def _end_of_reruns(c: AlignedRun, broken: Sequence[Metric]) -> float:
    """End of the motion for which the engine is run with other settings [s].

    It is the first violation, or a characteristic time if that is longer: errors add up as long as
    they are small, and what they grow to later on costs most of a run and hides what made it. Of
    forces, whose errors do not add up, it is the last violation, where nothing else is violated.
    """
    violation = _first_violation(c, broken)
    if violation is None:
        violation = _last_of_forces(c, broken)
    if violation is None:
        return c.end
    to = max(violation, c.scales.time)
    return to if to < _MOST * c.end else c.end


def failed_diagnosis(broken: Sequence[Metric], error: Exception) -> Diagnosis:
    """A diagnosis that says why it failed: it must not cost the motion that it is about."""
    worst = max(broken, key=lambda metric: metric.share or 0.0)
    return Diagnosis(leads=worst.label, note=failure(error)[1].removesuffix("."))


def _ranked_causes(
    case: Case, reruns: Callable[[], Iterable[RankedCause]] | None
) -> tuple[tuple[RankedCause, ...], int]:
    """Suspects, kind after kind; the next kind only if the last explains too little.

    Mistakes of reading cost next to nothing. Where the motion deviates, the engine is then run with
    other settings. What such runs show is named before any suspect
    (:func:`.rank.ranked_with_parts`), as what the step and the options do to a motion may have the
    shape of a suspect: an oscillation in longer steps has that of another rate of time. So suspects
    are looked for only where no run takes out enough. Where no coordinate and no point exceeds its
    tolerance, or nothing moves, they come first: other settings change the little that a right
    motion deviates, whatever is wrong beside it.

    Args:
        case: the deviation.
        reruns: makes the runs with other settings, and tells what they show; None: there is no
            engine.
    """
    readings = [*_outright_causes(case), *_reading_causes(case)]
    is_still = any(c.name == NO_MOTION and c.explained >= SUFFICIENT for c in readings)
    if reruns is not None and not is_still and case.broken & (_STATE_METRICS | _POINT_METRICS):
        shown = list(reruns())
        if any(cause.explained >= SUFFICIENT for cause in shown):
            return ranked_with_parts([*readings, *shown])
        causes = [*_with_suspects(case, readings, is_still), *shown]
    else:
        causes = _with_suspects(case, readings, is_still)
        is_explained = ranked(causes)[1] and (is_still or _motion_agrees(case))
        if reruns is not None and not is_explained:
            causes += reruns()
    if not ranked(causes)[1] and _motion_agrees(case) and not _forces_deviate(case):
        # Quantities that are read wrongly in a way that no suspect has.
        wrong = [quantity for quantity, share in case.shares.items() if share > _MISREAD]
        rest = [share for share in case.shares.values() if not share > _MISREAD]
        name = f"reading of the {', '.join(quantity.text for quantity in wrong)}"
        causes.append(_reading(name, 1.0 - float(np.linalg.norm(rest)), "the motion is right"))
    if not ranked(causes)[1]:
        causes += _mismatch_causes(case)
    return ranked_with_parts(causes)


def _with_suspects(
    case: Case, readings: Sequence[RankedCause], is_still: bool
) -> list[RankedCause | Estimate]:
    """Mistakes of reading, and beside them what else would do this to the reference's motion.

    Args:
        case: the deviation.
        readings: mistakes of reading that may have done it.
        is_still: whether the engine moves nothing.
    """
    causes: list[RankedCause | Estimate] = [*readings]
    if case.told is not None:
        # Of a file nobody knows what made it: its steps stand before all that may be built wrongly.
        causes = [*integrator_causes(case), *causes]
    # Where little is recorded, faults and mistakes of reading may explain it alike.
    if case.told is not None or max((c.explained for c in readings), default=0.0) < _CERTAIN:
        causes += fitting_faults(case)
        causes += [_sizeless(case, fault) for fault in missing_faults(case.mechanism)]
        causes += _law_causes(case)
    elif _motion_agrees(case):
        # A load that moves nothing is as good an explanation as a mistake of reading its force.
        causes += faults_at_the_same_motion(case)
    if is_still:
        # So is the lack of what would move it.
        causes += [_sizeless(case, fault) for fault in missing_faults(case.mechanism)]
        causes += _gross_causes(case)
    else:
        causes = measured(causes)
        listed, named = ranked(causes)
        if not (named and listed[0].explained >= SAME):
            causes += _gross_causes(case)
    return measured(causes)


def _reading(name: str, explained: float, amount: str = "") -> RankedCause:
    return RankedCause(name=name, kind="reading", amount=amount, explained=explained)


def _outright_causes(case: Case) -> Iterator[RankedCause]:
    """Causes that a trajectory shows by itself.

    An early end, a first sample of its own, values that are no numbers, and markers that it does
    not have.
    """
    for marker in case.mechanism.markers:
        if marker.name not in case.whole.markers:
            yield _reading(f"no marker {marker.name}", 1.0)
    last, largest = float(case.whole.t[-1]), float(np.abs(case.differences).max())
    if last < case.end and (_MISSING in case.broken or last < case.end - 2 * case.step):
        missing = 1.0 - last / case.end
        amount = f"at {last:.6g} s instead of {case.end:.6g} s"
        yield _reading("run ends early", missing / (missing + largest), amount)
    # Quantities that are wrong at t = 0 alone, as of engines that compute them in a step.
    first = case.first_errors
    wrong = [quantity for quantity, error in first.items() if error > largest / _MISREAD]
    if wrong:
        what = ", ".join(sorted({quantity.kind for quantity in wrong}))
        share = 1.0 - largest / max(first[quantity] for quantity in wrong)
        yield _reading(f"first sample: {what}", share)
    for quantity, since in case.channels.unusable.items():
        yield _reading(f"{quantity.text}: not a finite number", 1.0, f"from {since:.6g} s")


def _reading_causes(case: Case) -> list[RankedCause]:
    """Read all that deviate late, where no single kind of quantity is."""
    problem = case.solution, case.reference
    found = list(_fitted(case, all_readings(*problem, case.trajectory, case.step)))
    if max((cause.explained for cause in found), default=0.0) < SAME:
        wrong = {quantity.kind for quantity, share in case.shares.items() if share > _MISREAD}
        found += _fitted(case, partly_late_readings(*problem, case.step, wrong))
    return found


def _fitted(case: Case, readings: Iterable[Reading]) -> Iterator[RankedCause]:
    for reading in readings:
        signatures = np.array([case.signature(wrong) for wrong in reading.wrong])
        if reading.text is None:
            share = share_of(case.deviation, signatures[0])
            yield _reading(reading.name, share)
            continue
        factors, explained = fit(case.deviation, signatures)
        if reading.at is not None:
            # The effect is not linear in the size: the share is that of the corrected one.
            corrections = _CORRECTIONS if explained > _HOPELESS else 1
            best, explained = factors, 0.0
            for _ in range(corrections):
                wrong = reading.at(float(factors[0]))
                if wrong is None:
                    break
                signature = case.signature(wrong)
                gained = share_of(case.deviation, signature) - explained
                if gained > 0:
                    best, explained = factors, explained + gained
                if 0.0 <= gained < _GAIN:
                    break
                factors = factors * factor_of(case.deviation, signature)
            factors = best
        if explained > 0 and factors[0] >= reading.least:
            yield _reading(reading.name, explained, reading.text(factors.tolist()))


def _mismatch_causes(case: Case) -> Iterator[RankedCause]:
    """Speeds and places of which either cannot be those of the other's motion.

    In a file what then is left may have causes of its own, which are named beside.
    """
    size = float(np.linalg.norm(case.deviation))
    for mismatch in mismatches(case.whole, case.compared_reference, case.told):
        left = float(np.linalg.norm(case.at_its_times(mismatch.mended))) / size
        yield _reading(mismatch.name, 1.0 - left, mismatch.amount)
        if case.told is None or not 1.0 - SUFFICIENT < left < 1.0 - TELLING:
            continue
        listed, named = _ranked_causes(replace(case, whole=mismatch.mended), None)
        for rest in listed[:named]:
            both = {
                "name": f"{mismatch.name}, and {rest.name}",
                "amount": "; ".join(filter(None, (mismatch.amount, rest.amount))),
                "explained": 1.0 - (1.0 - rest.explained) * left,
            }
            yield rest.model_copy(update=both)


def _motion_agrees(case: Case) -> bool:
    """Tell whether coordinates and speeds, or positions and velocities, alone are right.

    Right is what deviates by a small part of the whole deviation, and keeps its tolerance: an
    energy that depends on the square of a speed outweighs what goes with it.
    """
    kinds = {quantity.kind for quantity in case.shares}
    wrong = {quantity.kind for quantity, share in case.shares.items() if share > _MISREAD}
    state, points = {Kind.COORDINATES, Kind.SPEEDS}, {Kind.POSITION, Kind.VELOCITY}
    state_agrees = state <= kinds and not state & wrong and not case.broken & _STATE_METRICS
    points_agree = points & kinds and not points & wrong and not case.broken & _POINT_METRICS
    return bool(wrong and (state_agrees or points_agree))


def _forces_deviate(case: Case) -> bool:
    return any(q.kind in _FORCES for q, share in case.shares.items() if share > _MISREAD)


def _gross_causes(case: Case) -> Causes:
    """Forces that are quite wrong, and the other law of the stops."""
    for fault in (*gross_faults(case.mechanism), *systematic_faults(case.mechanism)):
        yield _sizeless(case, fault)
    given = StopLaw(case.solution.problem.stop_law)
    other = next(law for law in StopLaw if law != given)
    yield _sizeless(case, other)


def _sizeless(case: Case, fault: Fault | StopLaw) -> RankedCause | Estimate:
    """A fault without a size: roughly where that is enough to tell whether it can be listed."""
    if isinstance(fault, StopLaw):
        wrong, name, kind = fault, f"stops by the law {fault.value}", "law"
    else:
        wrong, name, kind = fault.make(()), fault.name, fault.kind
        assert wrong is not None

    def share(tolerance: float) -> float | None:
        """Share of the deviation that the faulty motion explains, whoever reads it."""
        solution = case.solved(wrong, tolerance=tolerance)
        if solution is None:
            return None
        signatures = case.seen(solution, solution.motion(case.t))
        return max(share_of(case.deviation, s) for s in signatures)

    return case.estimated(RankedCause(name=name, kind=kind, explained=0.0), share)


def _law_causes(case: Case) -> Causes:
    """Stops that open at other times than they should, or never; and forces of the wrong law."""
    own, right = case.whole.release_times, case.solution.release_times
    closed = [stop.name for stop in case.mechanism.stops if stop.closed]
    schedule = {name: right.get(name) for name in closed}
    releases = {name: own.get(name) for name in closed}
    late = [name for name in closed if releases[name] != schedule[name]]

    def wrong_release(name: str) -> float:
        times = releases[name], schedule[name]
        return min((t for t in times if t is not None), default=math.inf)

    for name in late:
        amount = f"{_format_time(releases[name])} instead of {_format_time(schedule[name])}"
        # Either the motion shows it, or only the reported time is wrong.
        signature = _schedule(case, {**schedule, name: releases[name]})
        if signature is not None:
            if not case.has_impacts:
                share = share_of(case.deviation, signature)
                yield RankedCause(
                    name=f"release of the {name}", kind="law", amount=amount, explained=share
                )
            would = float(np.linalg.norm(signature))
            unseen = 1.0 - float(np.linalg.norm(case.deviation)) / would if would else 0.0
            yield _reading(f"reading of the {name}'s release", unseen, amount)
        if len(late) > 1 and name == min(late, key=wrong_release):
            # The others open late or early because of it.
            yield from _scheduled(case, f"release of the {name}", releases, amount)
    # Releases recorded of stops that are open at the start, where nothing else is wrong.
    if not case.has_impacts and float(np.abs(case.differences).max()) < _RIGHT:
        for stop in case.mechanism.stops:
            if not stop.closed and own.get(stop.name) is not None:
                amount = f"{_format_time(own[stop.name])} of a stop that is open"
                yield _reading(f"reading of the {stop.name}'s release", 1.0, amount)
    for name in closed:
        if releases[name] is not None:
            yield from _scheduled(case, f"{name} never opens", {**schedule, name: None})
    if case.has_velocity_forces:
        dropped = without_centrifugal(case.mechanism)
        yield from _scheduled(case, "velocity-dependent forces dropped", releases, "", dropped)


def _format_time(t: float | None) -> str:
    return "never" if t is None else f"{t:.6g} s"


def _scheduled(
    case: Case,
    name: str,
    releases: Mapping[str, float | None],
    amount: str = "",
    equations: Equations | None = None,
) -> Causes:
    """Stops that open by a schedule.

    A scheduled motion has no impacts, and so is no motion of a mechanism that has some.
    """

    def share(tolerance: float) -> float | None:
        signature = _schedule(case, releases, equations, tolerance)
        return None if signature is None else share_of(case.deviation, signature)

    if not case.has_impacts:
        cause = RankedCause(name=name, kind="law", amount=amount, explained=0.0)
        yield case.estimated(cause, share, TOLERANCE)


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


# ---------------------------------------------------------------------------------- built models

_ALIKE = 1e-6  # relative, or [rad]: of a value that was mistaken for another
# Weight of a cause that one quantity shows, against one that explains all of them
_READ_OFF = 0.992
_NO_TORQUE = 0.97  # the same of a stop that carries none: it may be at another position
_SIZE_CORRECTIONS = 6  # of a size, by Gauss and Newton
_PARTS = (1.0, 0.5, 0.25, 0.1, 0.01)  # of a correction that leads to a size that makes no sense
_FITS = 0.99999  # share from which on a size need not be corrected any more
_GAIN = 0.003  # in share: corrections that gain less are at an end
_HOPELESS = 0.2  # share to first order, below which a size is not corrected

Signatures = Callable[[Equations], list[FloatArray]]
"""Signatures of wrong equations, one for each way in which an engine may show them; or none."""


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
    excess = {check.label: math.inf for check in broken.broken}
    for check in broken.broken:
        if check.value is not None:
            excess[check.label] = check.value / check.tolerance
    causes: list[RankedCause] = []
    if isinstance(engine, Inspectable):
        states = random_states(mechanism)
        if broken.states:
            model = _BuiltModel(mechanism, states, engine.inspect(mechanism, states))
            causes = [*model.single_quantities(), *model.walls(), *model.fitted()]
        else:
            # Stops that the model lacks: without them it can be inspected.
            for stop in mechanism.stops:
                without = [state for state in states if stop.name not in state.closed]
                if len(without) < len(states):
                    # The engine may raise anything: then this stop is not the only cause.
                    with suppress(Exception):
                        engine.inspect(mechanism, without)
                        name = f"{stop.name} missing"
                        causes.append(RankedCause(name=name, kind="law", explained=1.0))
    listed, likeliest = ranked(causes)
    return Diagnosis(leads=max(excess, key=excess.__getitem__), causes=listed, likeliest=likeliest)


class _BuiltModel:
    """Model that an engine has built, as far as it shows it, against the reference's equations."""

    def __init__(
        self, mechanism: Mechanism, states: Sequence[State], inspection: Inspection
    ) -> None:
        self.mechanism, self.states, self.inspection = mechanism, states, inspection
        self.right = expected(mechanism, states)
        self.gaps = self._gap_errors(inspection.dynamics)

    def _gap_errors(self, dynamics: Sequence[Dynamics]) -> FloatArray:
        """Errors of the gaps [rad or m] that the engine exposes; all states count as one."""
        errors: list[float] = []
        for shown, right, exposed in zip(
            dynamics, self.right.gaps, self.inspection.dynamics, strict=True
        ):
            errors += [shown.stop_gaps[name] - right[name] for name in exposed.stop_gaps]
        return np.array(errors) / math.sqrt(len(self.states))

    def single_quantities(self) -> Iterator[RankedCause]:
        """Causes that single quantities show: a wrong start, a misplaced stop, a missing one."""
        mechanism, dynamics = self.mechanism, self.inspection.dynamics
        starts = zip(mechanism.coordinates, self.inspection.start, mechanism.start, strict=True)
        for i, (name, value, right) in enumerate(starts):
            if abs(value - right) > EXACT * max(1.0, abs(right)):
                mistake, share = _mistaken(float(value), right), 1.0
                if not mistake:
                    difference, share = float(value) - right, _READ_OFF
                    is_angle = i < len(mechanism.angles)
                    mistake = f"{difference:+.3g} {'rad' if is_angle else 'm'}"
                    if is_angle and abs(difference) > 2 * math.pi:
                        mistake = ""  # a difference of more than a turn says nothing
                yield RankedCause(
                    name=f"start of {name}", kind="start", amount=mistake, explained=share
                )
        for name, gap in gap_errors(self.right, dynamics).items():
            if abs(gap) > EXACT and mechanism.stop(name).effort == "torque":
                amount = f"{math.degrees(gap):+.3g} deg" if abs(gap) < math.pi else ""
                place = f"place of the {name}"
                yield RankedCause(name=place, kind="machine", amount=amount, explained=_READ_OFF)
        for stop in mechanism.stops:
            held = [
                shown.stop_torques.get(stop.name)
                for shown, state in zip(dynamics, self.states, strict=True)
                if stop.name in state.closed
            ]
            if held and not any(held):
                # A stop at another position carries no torque either: its position is then the
                # more likely cause.
                missing = f"{stop.name} missing"
                yield RankedCause(name=missing, kind="law", explained=_NO_TORQUE)

    def walls(self) -> Iterator[RankedCause]:
        """Walls at wrong positions, by the gaps alone: nothing else may show them."""
        if np.abs(self.gaps).max(initial=0.0) <= EXACT:
            return

        def signature(equations: Equations) -> list[FloatArray]:
            wrong = expected(equations.mechanism, self.states, equations)
            return [self._gap_errors(wrong.as_dynamics(self.inspection.dynamics))]

        for suspect in machine_suspects(self.mechanism):
            if suspect.of_wall:
                fault = of_suspects(self.mechanism, suspect.name, [suspect])
                fitted = _fitted_size(fault, self.gaps, signature)
                if fitted is not None:
                    share = _READ_OFF * fitted.explained
                    yield fitted.cause.model_copy(update={"explained": share})

    def fitted(self) -> Iterator[RankedCause]:
        """Suspects whose mechanisms differ from the right one alike, start and stops included."""
        differences = scaled_differences(self.right, self.inspection.dynamics)
        start = self.inspection.start - np.array(self.mechanism.start)
        deviation = np.concatenate([differences, start, self.gaps])
        if not np.isfinite(deviation).all() or not deviation.any():
            return
        best: dict[str, Fit] = {}
        for fault in (*hypotheses(self.mechanism, closing=False), *armatures(self.mechanism)):
            found, group = _fitted_size(fault, deviation, self._signatures), fault.group
            if found is not None:
                best[group] = better(best[group], found) if group in best else found
        yield from (fitted.cause for fitted in best.values())
        suspects = machine_suspects(self.mechanism)
        missing = [sizeless(s.name, s.kind, Equations(s.wrong)) for s in suspects if s.scale == 0]
        for fault in (*missing, *gross_faults(self.mechanism)):
            equations = fault.make(())
            assert equations is not None
            signatures = self._signatures(equations)
            shares = [share_of(deviation, each) for each in signatures]
            share = max(shares, default=0.0)
            yield RankedCause(name=fault.name, kind=fault.kind, explained=share)

    def _signatures(self, equations: Equations) -> list[FloatArray]:
        """Signatures in absolute coordinates and in those from the start, off by its error.

        And a stop at a wrong position need not have moved the start with it. A missing stop shows
        by itself: see :meth:`single_quantities`.
        """
        wrong, mechanism = equations.mechanism, self.mechanism
        if {stop.name for stop in wrong.stops} < {stop.name for stop in mechanism.stops}:
            return []
        start = np.array(wrong.start) - np.array(mechanism.start)

        def shown(shift: FloatArray) -> tuple[FloatArray, FloatArray]:
            states = [replace(state, q=state.q + shift) for state in self.states]
            values = expected(wrong, states, equations).as_dynamics(self.inspection.dynamics)
            return scaled_differences(self.right, values), self._gap_errors(values)

        here = shown(0.0 * start)
        moved = shown(start) if start.any() else here
        ways = ((here, start), (moved, start), (here, 0.0 * start))
        return [np.concatenate([differences, s, gaps]) for (differences, gaps), s in ways]


def _mistaken(angle: float, right: float) -> str:
    """The common mistake that turns one angle into another; '' if there is none."""
    size = max(1.0, abs(right))
    degrees, radians = math.degrees(right), math.radians(right)
    readings = {"sign": -right, "degrees for radians": degrees, "radians for degrees": radians}
    return next(
        (what for what, value in readings.items() if abs(angle - value) <= _ALIKE * size), ""
    )


def _fitted_size(fault: Fault, deviation: FloatArray, signatures: Signatures) -> Fit | None:
    """A fault of the size that fits, with the share that it explains; None if none fits.

    Args:
        fault: with a size of one number or several.
        deviation: flat.
        signatures: of equations, each of the deviation's shape.
    """
    zero = np.zeros(len(fault.components))
    columns = _columns(fault, zero, signatures)
    if columns is None:
        return None
    fits = [fit(deviation, columns[:, way]) for way in range(columns.shape[1])]
    way = max(range(len(fits)), key=lambda k: fits[k][1], default=-1)
    if way < 0 or fits[way][1] <= TELLING:
        return None
    best, factors, step = None, zero, fits[way][0]
    for _ in range(_SIZE_CORRECTIONS if fits[way][1] > _HOPELESS else 1):
        # The correction, or a part of it for which the size makes sense.
        for part in _PARTS:
            equations = fault.equations((factors + part * step).tolist())
            if equations is not None:
                factors = factors + part * step
                break
        else:
            break
        signature = signatures(equations)[way]
        share = share_of(deviation, signature)
        gained = share - best.explained if best else 1.0
        if gained > 0:
            best = Fit(fault, factors, share)
        if share > _FITS or gained < _GAIN:
            break
        tangents = _columns(fault, factors, signatures)
        if tangents is None:
            break
        step = fit(deviation - signature, tangents[:, way])[0]
    return best


def _columns(fault: Fault, factors: FloatArray, signatures: Signatures) -> FloatArray | None:
    """Change of the signatures with each component, shape (n_components, n_ways, n), or None."""
    made = [fault.make(each.tolist()) for each in (factors, *(factors + np.eye(len(factors))))]
    equations = [each for each in made if each is not None]
    if len(equations) < len(made):
        return None
    here, *there = [np.array(signatures(each)) for each in equations]
    return np.array([ahead - here for ahead in there])
