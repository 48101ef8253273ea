"""Certification: quantities from independent computations, and the uncertainty from their scatter.

The uncertainty of a figure is

    3 max_i |v_i - v|  +  3 max_k |v_k - v| (tol / tol_k)^(7/8)  +  16 eps max |v|,

with v the value: that of the extended-precision Taylor integrator where it is there, else the
median of the v_i; v_i the independent computations at their tightest, tol; v_k all coarser rungs of
the ladders of tolerances. The first term is what formulations and integrators differ by. The second
is what the tolerance may still move, extrapolated from every rung (two formulations with the same
coordinates take the same steps, and share their truncation) and taken as the largest over all
figures of the kind: how large the error of an interpolant is at one instant is chance. Both are
tripled, as a handful of values does not show the largest error there is. The third is rounding, a
random walk over some 250 steps, of the largest figure of the kind. It is the uncertainty of *any*
of the computations, the double-precision reference of the suite among them, not only of the best
one.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import math
import platform
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import initial_state
from ...models.launch import Launch
from ...models.library.registry import model
from ...models.library.trebuchet import TrebuchetParameters
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..equations import Equations
from ..solution import Solution
from ..solver import characteristic_time, solve, solve_until
from ..taylor.expressions import why_not_taylor
from .certificate import Certificate, Computation, Figure
from .quantities import Key, Motion, Plan, PointState, grid_step, plan, read_quantities
from .redundant import solve_redundant

if TYPE_CHECKING:
    from ..taylor.solve import Precision

LADDER = (1e-10, 1e-11, 1e-12, 1e-13, 3e-14)
BEST = "taylor, extended"
RULE = (
    "3 max_i |v_i - v| + 3 max_k |v_k - v| (tol / tol_k)^(7/8) + 16 eps max |v|; v: extended "
    "Taylor, else the median of the independent v_i; v_k: coarser rungs; the last two terms the "
    "largest over all figures of the kind"
)
PAPER_MACHINES = ("fixed", "rolling")
_SEARCH = (2.2, 5.5)  # characteristic times up to which the launch is searched
_NO_LAUNCH = 40  # steps of the grid: of a machine that does not launch, this much is certified
_MARGINS = 5  # in a step: one of them lies past the last instant that is read
_AT_REST = 4.0  # [s] the time scale of what nothing moves
_SAFETY = 3.0
# DOP853: error per step ~ h^8 held at the tolerance, so the whole ~ h^7 goes with tolerance^(7/8).
_ORDER = 7 / 8
_ROUNDINGS = 16  # a random walk over some 250 steps
_EPS = float(np.finfo(np.float64).eps)
Values = dict[Key, float]
Progress = Callable[[str, int, int], None]
"""Called before each computation with its name, the number done and the number of all."""


class MinimalMotion:
    """The suite's own reference, read quantity by quantity (:class:`.quantities.Motion`)."""

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        self.kinematics = solution.equations.kinematics

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """When each stop opened [s]."""
        return self.solution.release_times

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees."""
        return self.solution.launch

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        motion = self.solution.motion(np.array([t]))
        return motion.q[0], motion.u[0]

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration of a marker, each (2,)."""
        marker = next(
            marker for marker in self.solution.problem.mechanism.markers if marker.name == name
        )
        motion = self.solution.motion(np.array([t]))
        return self.kinematics.point_motion(marker, motion.q[0], motion.u[0], motion.a[0])

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        torques = self.solution.motion(np.array([t])).stop_torques
        return {name: float(torque[0]) for name, torque in torques.items()}

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        q, u = self.state(t)
        return float(
            self.kinematics.kinetic_energy(q, u) + self.solution.equations.potential_energy(q)
        )


@dataclass(frozen=True)
class _Task:
    """A computation to be made."""

    computation: Computation
    compute: Callable[[], Values]
    optional: bool = False
    """Whether a certificate may lack it."""


def certify(
    mechanism: Mechanism,
    parameters: TrebuchetParameters | None = None,
    *,
    duration: float | None = None,
    stop_law: StopLaw = StopLaw.RELEASE_ONCE,
    command: str = "",
    ladder: Sequence[float] = LADDER,
    progress: Progress | None = None,
    call: Callable[[Callable[[], Any]], Any] = lambda compute: compute(),
) -> Certificate:
    """Compute a machine's figures in every independent way there is, and their uncertainties.

    Args:
        mechanism: any.
        parameters: those it was built from, if it is a named machine: the paper's own equations are
            then solved, too. Left out, Table I is tried.
        duration: of the certified motion [s]; if left out, to the launch, or forty steps of the
            grid of instants, which is a power of ten below a fifth of the characteristic time.
        stop_law: of its stops.
        command: what made this certificate, to be written into it.
        ladder: tolerances of DOP853, the tightest last.
        progress: called before each computation.
        call: makes each computation; it may do so in another process, and raise SimulationError.

    Raises:
        InputError: the ladder has fewer than two rungs or is not falling.
        SimulationError: a computation failed.
    """
    if len(ladder) < 2 or list(ladder) != sorted(ladder, reverse=True):
        raise InputError(f"ladder = {list(ladder)!r} must hold at least two falling tolerances.")
    problem, plan = call(partial(_problem, mechanism, duration, stop_law))
    tasks, absent = _tasks(problem, plan, parameters, ladder)
    results: dict[str, Values] = {}
    for done, task in enumerate(tasks):
        if progress:
            progress(task.computation.name, done, len(tasks))
        _make(task, call, results, absent)
    computations = tuple(task.computation for task in tasks if task.computation.name in results)
    return Certificate(
        model=mechanism.name,
        mechanism_hash=mechanism.content_hash,
        command=command or f"trebucheck certify --models {mechanism.name}",
        rule=RULE,
        versions=_versions(),
        computations=computations,
        absent=tuple(absent),
        figures=tuple(_judged(results, computations)),
    )


def _make(
    task: _Task,
    call: Callable[[Callable[[], Values]], Values],
    results: dict[str, Values],
    absent: list[str],
) -> None:
    try:
        results[task.computation.name] = call(task.compute)
    except Exception as error:  # an optional library may raise anything; the certificate records it
        if not task.optional:
            raise
        absent.append(f"{task.computation.name}: failed with {type(error).__name__}: {error}")


def judge(
    values_by_key: Mapping[Key, Mapping[str, float]], computations: Sequence[Computation]
) -> dict[Key, tuple[float, float]]:
    """The module's rule: value and uncertainty of the figures that all computations have.

    Args:
        values_by_key: values of each figure, by name of computation.
        computations: those that count, independent ones and rungs.
    """
    independent = [c.name for c in computations if c.independent]
    rungs = [c for c in computations if not c.independent]
    tightest = min((c.tolerance for c in computations if c.tolerance), default=0.0)
    # A computation without a launch, say, says that nothing is known of it, not that the others
    # know it better.
    names = {c.name for c in computations}
    kept = {
        key: values
        for key, values in values_by_key.items()
        if len(independent) > 1 and names <= values.keys()
    }
    best = {key: _best(values, independent) for key, values in kept.items()}
    moved = defaultdict[tuple[str, str], float](float)
    scale = defaultdict[tuple[str, str], float](float)
    for key, values in kept.items():
        kind = _kind(key)
        scale[kind] = max(scale[kind], abs(best[key]))
        for c in rungs:
            if c.name in values and c.tolerance:
                expected = abs(values[c.name] - best[key]) * (tightest / c.tolerance) ** _ORDER
                moved[kind] = max(moved[kind], expected)

    def uncertainty(key: Key, values: Mapping[str, float]) -> float:
        difference = max(abs(values[name] - best[key]) for name in independent if name in values)
        return _SAFETY * (difference + moved[_kind(key)]) + _ROUNDINGS * _EPS * scale[_kind(key)]

    return {key: (best[key], uncertainty(key, values)) for key, values in kept.items()}


def _best(values: Mapping[str, float], independent: Sequence[str]) -> float:
    if BEST in values and BEST in independent:
        return values[BEST]
    return median(values[name] for name in independent if name in values)


def _kind(key: Key) -> tuple[str, str]:
    """Quantities with one uncertainty rule: x and y of a position are one kind."""
    return ("position" if key.name.startswith("position") else key.name, key.unit)


def _judged(results: Mapping[str, Values], computations: Sequence[Computation]) -> Iterator[Figure]:
    by_key: dict[Key, dict[str, float]] = defaultdict(dict)
    for name, values in results.items():
        for key, value in values.items():
            by_key[key][name] = value
    for key, (value, uncertainty) in judge(by_key, computations).items():
        yield Figure(**key._asdict(), value=value, uncertainty=uncertainty, values=by_key[key])


def _problem(
    mechanism: Mechanism, duration: float | None, stop_law: StopLaw
) -> tuple[Problem, Plan]:
    """Problem to just past the launch, or for the given duration, and what is read of it."""
    if duration is not None:
        problem = Problem(mechanism, duration=duration, stop_law=stop_law)
        step = grid_step(duration / 2)
        motion = MinimalMotion(solve(problem))
        return problem, replace(plan(mechanism, motion, duration, step), launches=False)
    scale = _time_scale(mechanism)
    step, (first, second) = grid_step(scale), (spans * scale for spans in _SEARCH)
    longest = _NO_LAUNCH * step
    spans = (first, max(second, longest))
    solution = solve_until(mechanism, spans, lambda solution: solution.launch is not None, stop_law)
    motion, launch = MinimalMotion(solution), solution.launch
    if launch is None:
        return Problem(mechanism, duration=longest, stop_law=stop_law), plan(
            mechanism, motion, longest, step
        )
    end = launch.time + step + step / _MARGINS
    return Problem(mechanism, duration=end, stop_law=stop_law), plan(
        mechanism, motion, launch.time, step
    )


def _time_scale(mechanism: Mechanism) -> float:
    """The characteristic time; without gravity that in which a coordinate moves by 1 rad or 1 m."""
    if mechanism.gravity > 0:
        return characteristic_time(mechanism)
    q, u = initial_state(mechanism)
    a, _ = Equations(mechanism).solve(q, u, [stop.name for stop in mechanism.stops if stop.closed])
    fastest = max(float(np.abs(u).max()), math.sqrt(np.abs(a).max()))
    return 1 / fastest if fastest > 0 else _AT_REST


def _tasks(
    problem: Problem, plan: Plan, parameters: TrebuchetParameters | None, ladder: Sequence[float]
) -> tuple[list[_Task], list[str]]:
    def minimal(tolerance: float) -> Motion:
        return MinimalMotion(solve(problem, tolerance, tolerance))

    def redundant(tolerance: float) -> Motion:
        return solve_redundant(problem, tolerance)

    formulations = [("minimal", "absolute angles, stops and loops by KKT", minimal)]
    absent: list[str] = []
    if problem.stop_law is StopLaw.RELEASE_ONCE:
        formulations.append(
            ("redundant", "three coordinates a body, joints and stops by KKT", redundant)
        )
    else:
        absent.append("redundant: it follows the release-once law of a stop only")
    tasks = [
        _Task(
            _by_dop853(name, text, tolerance, tolerance == ladder[-1]),
            partial(_read_at, run, tolerance, plan),
        )
        for name, text, run in formulations
        for tolerance in ladder
    ]
    for more in (_paper_task(problem, plan, parameters, ladder[-1]), *_taylor_tasks(problem, plan)):
        if isinstance(more, _Task):
            tasks.append(more)
        else:
            absent.append(more)
    return tasks, absent


def _read_at(run: Callable[[float], Motion], tolerance: float, plan: Plan) -> Values:
    return read_quantities(run(tolerance), plan)


def _by_dop853(name: str, formulation: str, tolerance: float, independent: bool) -> Computation:
    return Computation(
        name=f"{name}, {tolerance:g}",
        formulation=formulation,
        integrator="DOP853 (SciPy)",
        tolerance=tolerance,
        independent=independent,
    )


def _paper_task(
    problem: Problem, plan: Plan, parameters: TrebuchetParameters | None, tolerance: float
) -> _Task | str:
    mechanism = problem.mechanism
    if importlib.util.find_spec("sympy") is None:
        return "the paper's equations: SymPy is not installed"
    chosen = parameters or TrebuchetParameters()
    if mechanism.name not in PAPER_MACHINES or model(mechanism.name, chosen) != mechanism:
        return "the paper's equations: not one of its machines"
    computation = _by_dop853(
        "paper", "the paper's Lagrangian, Eqs. (1)-(10), by SymPy", tolerance, independent=True
    )

    def compute() -> Values:
        from .paper import solve_paper  # SymPy takes most of a second to import

        return read_quantities(
            solve_paper(chosen, mechanism.name == "rolling", problem.duration, tolerance), plan
        )

    return _Task(computation, compute, optional=True)


def _taylor_tasks(problem: Problem, plan: Plan) -> Iterator[_Task | str]:
    precisions: dict[Precision, int] = {"double": 64, "extended": 80}
    for precision, bits in precisions.items():
        name = f"taylor, {precision}"
        if (reason := why_not_taylor(problem)) is not None:
            yield f"{name}: {reason}"
            continue
        computation = Computation(
            name=name,
            formulation="absolute angles, stops and loops by KKT, as heyoka's expressions",
            integrator=f"adaptive Taylor series (heyoka), {bits}-bit floats",
            tolerance=None,
            independent=True,
        )
        yield _Task(computation, partial(_taylor_values, problem, plan, precision), optional=True)


def _taylor_values(problem: Problem, plan: Plan, precision: Precision) -> Values:
    from ..taylor.solve import solve_taylor, taylor_quantities  # heyoka takes a second to import

    read = read_quantities(MinimalMotion(solve_taylor(problem, precision=precision)), plan)
    # Located and evaluated on the series itself, in its own precision.
    own = taylor_quantities(problem, precision)
    direct: dict[tuple[str, str | None, str], Any] = {
        ("launch_time", None, ""): own.launch_time,
        ("launch_speed", None, ""): own.launch_speed,
    }
    direct |= {("release_time", name, ""): time for name, time in own.release_times.items()}
    direct |= {("stop_torque", name, "start"): torque for name, torque in own.start_torques.items()}
    if own.launch_q is not None:
        names = problem.mechanism.coordinates
        direct |= {
            ("coordinate", name, "launch"): q for name, q in zip(names, own.launch_q, strict=True)
        }
    return {
        key: value if (new := direct.get(key[:3])) is None else float(new)
        for key, value in read.items()
    }


def _versions() -> dict[str, str]:
    from ...version import __version__

    versions = {"trebucheck": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "heyoka", "sympy"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions
