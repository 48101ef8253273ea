"""A motion that violates a tolerance: the suspects whose effect fits its deviation from the reference."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.problem import StopLaw
from ...models.trajectory import Trajectory
from ...reference.equations import Equations
from ...reference.integrator import one_thread
from ...reference.perturbed import WithoutCentrifugal, solve_scheduled
from ...reference.solution import Solution
from ..runs.comparison import against
from ..runs.results import Cause, Diagnosis, Metric
from ..runs.runner import failure
from .case import Case
from .consistent import with_closed_loops
from .energies import energy_readings
from .hypotheses import gross_faults
from .late import late_readings, partly_late_readings
from .mistaken import mistaken_readings
from .onset import find_onset
from .ranking import SAME, SUFFICIENT, ranked
from .readings import NO_MOTION, Reading, plain_readings
from .search import faults_at_the_same_motion, fitting_faults
from .settings import Rerun
from .signatures import fit, match
from .suspects import machine_suspects
from .systematic import systematic_faults

_CERTAIN = 0.9999  # share of a reading's mistake from which on no other cause is looked for
_CORRECTIONS = 4  # of a size that has no linear effect
_MISREAD = (
    0.01  # of the deviation: what deviates by less is right, where other quantities are wrong
)
_RIGHT = 1e-6  # of the sizes of quantities: what deviates by less is right
_STATE = ("coordinates", "speeds of coordinates")
_STATE_METRICS = frozenset({"angle_max", "angular_speed_max", "slide_max", "slide_speed_max"})
_POINT_METRICS = frozenset({"position_max", "velocity_max"})
_UNTOLD = (
    "torque",
    "force",
)  # what solvers compute by iteration may be noisy on a right motion: no mistake of reading


@one_thread()
def diagnose_motion(
    broken: Sequence[Metric],
    trajectory: Trajectory,
    solution: Solution,
    end: float,
    rerun: Rerun | None = None,
    told: frozenset[str] | None = None,
) -> Diagnosis:
    """The onset of the divergence from the reference, the first violated quantity, and the likeliest causes.

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
    """In the place of a diagnosis that raised: it must not cost the motion that it is about, and it says why."""
    worst = max(broken, key=lambda metric: metric.share or 0.0)
    return Diagnosis(leads=worst.label, note=failure(error)[1].removesuffix("."))


def _ranked_causes(case: Case, rerun: Rerun | None) -> tuple[tuple[Cause, ...], int]:
    """Mistakes of reading first, which cost nothing to compute; engines run again only if nothing else explains it."""
    causes = [*_outright_causes(case), *_reading_causes(case)]
    certain = max((cause.explained for cause in causes), default=0.0) >= _CERTAIN
    if (
        case.told is not None or not certain
    ):  # of what tells little, faults and mistakes may account alike
        causes += [*fitting_faults(case), *_missing_causes(case), *_law_causes(case)]
    elif _motion_agrees(case):
        causes += faults_at_the_same_motion(
            case
        )  # a load that moves nothing is no worse an explanation
    if NO_MOTION in {cause.name for cause in causes if cause.explained >= SUFFICIENT}:
        causes += [*_missing_causes(case), *_gross_causes(case)]  # nor is the lack of what moves it
    elif not _is_settled(causes):
        causes += _gross_causes(case)
    if rerun is not None and not ranked(causes)[1]:
        causes += rerun.causes(case)
    if not ranked(causes)[1]:
        causes += _misread(case)
    return ranked(causes)


def _is_settled(causes: Sequence[Cause]) -> bool:
    """Whether a cause is named that leaves so little that none of another kind is looked for."""
    listed, named = ranked(causes)
    return named > 0 and listed[0].explained >= SAME


def _misshapen(case: Case) -> Iterator[Cause]:
    for name, shape in case.misshapen.items():
        yield Cause(name=f"shape of the {name}", kind="reading", amount=shape, explained=1.0)


def _outright_causes(case: Case) -> Iterator[Cause]:
    """What a trajectory shows by itself: an early end, values that are no numbers, markers that it does not have."""
    for name in case.missing_markers:
        yield Cause(name=f"no marker {name}", kind="reading", explained=1.0)
    last, step = float(case.whole.t[-1]), case.step
    if last < case.end - 2 * step:
        amount = f"at {last:.6g} s instead of {case.end:.6g} s"
        missing = 1.0 - last / case.end
        size = float(np.abs(case.channels.stacked(case.trajectory, case.reference)).max())
        yield Cause(
            name="run ends early",
            kind="reading",
            amount=amount,
            explained=missing / (missing + size),
        )
    yield from _first_sample(case)
    for name, since in case.channels.unusable.items():
        amount = f"from {since:.6g} s"
        yield Cause(
            name=f"{name}: not a finite number", kind="reading", amount=amount, explained=1.0
        )


def _first_sample(case: Case) -> Iterator[Cause]:
    """Quantities that are wrong at t = 0 and nowhere else, as of engines that compute them in a step."""
    error, later = (
        case.first_errors,
        float(np.abs(case.channels.stacked(case.trajectory, case.reference)).max()),
    )
    wrong = [name for name, size in error.items() if size > later / _MISREAD]
    if wrong:
        what = ", ".join(sorted({name.split(" of the ")[0] for name in wrong}))
        share = 1.0 - later / max(error[name] for name in wrong)
        yield Cause(name=f"first sample: {what}", kind="reading", explained=share)


def _missing_causes(case: Case) -> Iterator[Cause]:
    """Parts that are missing, and data that are rounded: faults without a size."""
    for suspect in machine_suspects(case.mechanism):
        closed = None if suspect.scale else with_closed_loops(suspect.wrong)
        if closed is not None:
            yield suspect.cause(1.0, _share(case, case.solved(Equations(closed))))


def _gross_causes(case: Case) -> Iterator[Cause]:
    """Forces that are quite wrong, and the other law of the stops."""
    for name, equations in gross_faults(case.mechanism):
        yield Cause(name=name, kind="law", explained=_share(case, case.solved(equations)))
    for fault in systematic_faults(case.mechanism):
        closed = with_closed_loops(fault.wrong)
        if closed is not None:
            yield fault.cause(1.0, _share(case, case.solved(Equations(closed))))
    given = StopLaw(case.solution.problem.stop_law)
    other = next(law for law in StopLaw if law != given)
    yield Cause(
        name=f"stops by the law {other.value}",
        kind="law",
        explained=_share(case, case.under(other)),
    )


def _share(case: Case, wrong: Solution | None) -> float:
    """Of the deviation, that the motion with a fault accounts for, whoever reads it; 0 where there is none."""
    if wrong is None:
        return 0.0
    signatures = case.seen(wrong, wrong.motion(case.t))
    return max(match(case.deviation, signature, fixed=True).explained for signature in signatures)


def _law_causes(case: Case) -> Iterator[Cause]:
    """Stops that open at other times than they should, or never; and forces of the wrong law."""
    engine_times, reference_times = case.whole.release_times, case.solution.release_times
    closed = [stop.name for stop in case.mechanism.stops if stop.closed]
    right: dict[str, float | None] = {name: reference_times.get(name) for name in closed}
    own = {name: engine_times.get(name) for name in closed}
    wrong = [name for name in closed if own[name] != right[name]]
    for name in wrong:
        amount = f"{_format_time(own[name])} instead of {_format_time(right[name])}"
        yield from _release(case, name, amount, {**right, name: own[name]})
        if len(wrong) > 1 and name == _earliest(
            wrong, own, right
        ):  # the others open late or early because of it
            yield from _scheduled(case, f"release of the {name}", own, amount)
    yield from _open_stops(case)
    for name in closed:
        if own[name] is not None:
            yield from _scheduled(case, f"{name} never opens", {**right, name: None})
    if case.has_velocity_forces:
        yield from _scheduled(
            case, "velocity-dependent forces dropped", own, "", WithoutCentrifugal(case.mechanism)
        )


def _open_stops(case: Case) -> Iterator[Cause]:
    """Releases told of stops that are open at the start, where nothing else is wrong and the law knows none."""
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
            yield Cause(
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
) -> Iterator[Cause]:
    """A release at another time: either the motion shows it, or only the reported time is wrong."""
    signature = _schedule(case, releases)
    if signature is None:
        return
    if not case.has_impacts:
        share = match(case.deviation, signature, fixed=True).explained
        yield Cause(name=f"release of the {stop}", kind="law", amount=amount, explained=share)
    would = float(np.linalg.norm(signature))
    explained = 1.0 - float(np.linalg.norm(case.deviation)) / would if would else 0.0
    yield Cause(
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
) -> Iterator[Cause]:
    """Stops that open by a schedule; it has no impacts, and so is no motion of a mechanism that has some."""
    signature = None if case.has_impacts else _schedule(case, releases, equations)
    if signature is not None:
        share = match(case.deviation, signature, fixed=True).explained
        yield Cause(name=name, kind="law", amount=amount, explained=share)


def _schedule(
    case: Case, releases: Mapping[str, float | None], equations: Equations | None = None
) -> FloatArray | None:
    try:
        solution = solve_scheduled(case.problem(case.mechanism), releases, equations)
    except TrebucheckError:
        return None
    return case.signature(solution.trajectory(case.t))


def _readings(case: Case) -> Iterator[Reading]:
    """Readings of the reference that are wrong in one way."""
    yield from plain_readings(case.solution, case.reference, case.trajectory, case.step)
    yield from energy_readings(case.reference)
    yield from late_readings(case.solution, case.reference, case.step)
    yield from mistaken_readings(case.reference, case.trajectory)


def _reading_causes(case: Case) -> list[Cause]:
    """Where no single kind of quantity is read late, all that deviate may be."""
    found = list(_fitted(case, _readings(case)))
    if max((cause.explained for cause in found), default=0.0) < SAME:
        wrong = _wrong_quantities(case)
        found += _fitted(
            case, partly_late_readings(case.solution, case.reference, case.step, wrong)
        )
    return found


def _fitted(case: Case, readings: Iterable[Reading]) -> Iterator[Cause]:
    for reading in readings:
        signatures = np.array([case.signature(wrong) for wrong in reading.wrong])
        if reading.text is None:
            share = match(case.deviation, signatures[0], fixed=True).explained
            yield Cause(name=reading.name, kind="reading", explained=share)
            continue
        factors, explained = fit(case.deviation, signatures)
        if reading.at is not None:
            factors, explained = _corrected(case, reading, factors)
        if explained > 0 and factors[0] >= reading.least:
            amount = reading.text(factors.tolist())
            yield Cause(name=reading.name, kind="reading", amount=amount, explained=explained)


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
    """Whether coordinates and speeds are right, or all positions and velocities are, while others deviate.

    Right is what deviates by a small part of the whole deviation, and keeps its tolerance: an
    energy that depends on the square of a speed outweighs what goes with it.
    """
    wrong = _wrong_quantities(case)
    points = [name for name in case.shares if name.startswith(("position", "velocity"))]
    right = [
        all(name in case.shares and name not in wrong for name in names)
        and not case.broken & metrics
        for names, metrics in ((_STATE, _STATE_METRICS), (points, _POINT_METRICS))
        if names
    ]
    return bool(wrong) and any(right)


def _only_readings(case: Case, named: Sequence[Cause]) -> bool:
    """Whether the motion follows the reference; where forces deviate, only if a mistake of reading them is named."""
    forces = any(name.startswith(_UNTOLD) for name in _wrong_quantities(case))
    misread = bool(named) and all(cause.kind == "reading" for cause in named)
    return _motion_agrees(case) and (misread or not forces)


def _misread(case: Case) -> Iterator[Cause]:
    """Quantities that are read wrongly in a way that no suspect has: the motion itself is right."""
    wrong = _wrong_quantities(case)
    if _motion_agrees(case) and not any(name.startswith(_UNTOLD) for name in wrong):
        rest = float(
            np.linalg.norm([share for name, share in case.shares.items() if name not in wrong])
        )
        name = f"reading of the {', '.join(wrong)}"
        yield Cause(name=name, kind="reading", amount="the motion is right", explained=1.0 - rest)
