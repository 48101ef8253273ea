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
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import initial_state
from ...models.launch import Launch
from ...models.library.registry import model
from ...models.library.trebuchet import TrebuchetParameters
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...version import __version__
from ..equations import Equations
from ..solution import Solution
from ..solver import characteristic_time, solve, solve_until
from ..taylor.expressions import why_not_taylor
from .certificate import Certificate, Computation, Figure
from .constrained import PointState
from .proved import proof_of, with_proof
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
PROJECTILE, COUNTERWEIGHT = "projectile", "counterweight"
BEYOND_LAUNCH = 0.1  # [s] the step of machines that swing for some seconds, such as the paper's
_SEARCH = (2.2, 5.5)  # characteristic times up to which the launch is searched
_NO_LAUNCH = 40  # steps of the grid: of a machine that does not launch, this much is certified
_MARGINS = 5  # in a step: one of them lies past the last instant that is read
_AT_REST = 4.0  # [s] the time scale of what nothing moves
_SAFETY = 3.0
# DOP853: error per step ~ h^8 held at the tolerance, so the whole ~ h^7 goes with tolerance^(7/8).
_ORDER = 7 / 8
_ROUNDINGS = 16  # a random walk over some 250 steps
_SHORTEST = 1e-9  # [s] of a motion to a given end
_EPS = float(np.finfo(np.float64).eps)
Progress = Callable[[str, int, int], None]
"""Called before each computation with its name, the number done and the number of all."""


class Motion(Protocol):
    """A motion as every computation offers it; times are single floats [s]."""

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """Times when the stops opened [s]."""
        ...

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees."""
        ...

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        ...

    def marker(self, name: str, t: float) -> PointState:
        """A marker's position, velocity and acceleration."""
        ...

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        ...

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        ...


class MinimalMotion:
    """The suite's own reference, read quantity by quantity."""

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        self.kinematics = solution.equations.kinematics
        self.release_times: Mapping[str, float | None] = solution.release_times
        self.launch = solution.launch

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        motion = self.solution.motion(np.array([t]))
        return motion.q[0], motion.u[0]

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration of a marker, each (2,)."""
        marker = next(m for m in self.solution.problem.mechanism.markers if m.name == name)
        motion = self.solution.motion(np.array([t]))
        return self.kinematics.point_motion(marker, motion.q[0], motion.u[0], motion.a[0])

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        torques = self.solution.motion(np.array([t])).stop_torques
        return {name: float(torque[0]) for name, torque in torques.items()}

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        q, u = self.state(t)
        kinetic = self.kinematics.kinetic_energy(q, u)
        return float(kinetic + self.solution.equations.potential_energy(q))


class Key(NamedTuple):
    """Quantity that a figure is of."""

    name: str
    subject: str | None
    at: str
    unit: str
    time: float | None = None


@dataclass(frozen=True)
class Plan:
    """Quantities of a machine, decided once, so that every computation yields the same ones."""

    mechanism: Mechanism
    releases: tuple[str, ...]
    halfway: Mapping[str, float]  # a fixed instant about half way to each release [s]
    grid: tuple[float, ...]
    launches: bool
    step: float = BEYOND_LAUNCH
    """Step of the grid of instants, a power of ten [s]; the best release and the largest energy
    ratio are searched up to one step about the launch."""


def _grid_step(scale: float) -> float:
    """The largest power of ten below a fifth of a time scale, both [s]."""
    return 10.0 ** math.floor(math.log10(scale / 5))


def _plan(mechanism: Mechanism, motion: Motion, end: float, step: float) -> Plan:
    """Quantities up to `end` [s], of a motion that is known well enough to say which there are."""
    # Rounded to a hundredth of the step: all computations must use the same number.
    decimals = -round(math.log10(step))
    least = 10.0 ** -(decimals + 2)
    releases: list[str] = []
    halfway: dict[str, float] = {}
    for name, time in motion.release_times.items():
        if time is not None and time <= end:
            releases.append(name)
            if time > 4 * least:
                halfway[name] = max(round(time / 2, decimals + 2), least)
    grid = tuple(round(i * step, decimals) for i in range(1, int(end / step) + 1))
    return Plan(mechanism, tuple(releases), halfway, grid, motion.launch is not None, step)


_KeyedValues = Iterator[tuple[Key, float]]


def read_quantities(motion: Motion, plan: Plan) -> dict[Key, float]:
    """Quantities of the plan, in the same way from every computation."""
    values = [*_along(motion, plan)]
    if plan.launches and (launch := motion.launch) is not None:
        values += _at_launch(motion, plan.mechanism, launch)
        values += _rightmost(motion, plan, launch)
        values += _best_release(motion, plan, launch)
        values += _largest_ratio(motion, plan, launch)
    return {key: float(value) for key, value in values if math.isfinite(value)}


def _along(motion: Motion, plan: Plan) -> _KeyedValues:
    """Quantities at the start, at releases and at fixed instants."""
    mechanism = plan.mechanism
    torques = motion.stop_torques(0.0)
    for stop in mechanism.stops:
        if stop.closed:
            yield Key("stop_torque", stop.name, "start", stop.force_unit), torques[stop.name]
    yield Key("total_energy", None, "start", "J"), motion.energy(0.0)
    for name in plan.releases:
        time = motion.release_times[name]
        if time is not None:
            yield Key("release_time", name, "", "s"), time
            yield from _coordinates(motion, mechanism, time, f"release of {name}")
    for name, time in plan.halfway.items():
        key = Key("stop_torque", name, f"{time:g} s", mechanism.stop(name).force_unit, time)
        yield key, motion.stop_torques(time)[name]
    # Where the projectile is; of a mechanism that has none, all coordinates and markers.
    markers = [marker.name for marker in mechanism.markers]
    for time in plan.grid:
        if PROJECTILE not in markers:
            yield from _coordinates(motion, mechanism, time, f"{time:g} s", time)
        for name in [PROJECTILE] if PROJECTILE in markers else markers:
            yield from _position(motion, name, time, f"{time:g} s", time)


def _coordinates(
    motion: Motion, mechanism: Mechanism, time: float, at: str, instant: float | None = None
) -> _KeyedValues:
    q, _ = motion.state(time)
    for i, name in enumerate(mechanism.coordinates):
        unit = "rad" if i < len(mechanism.angles) else "m"
        yield Key("coordinate", name, at, unit, instant), q[i]


def _position(
    motion: Motion, name: str, time: float, at: str, instant: float | None = None
) -> _KeyedValues:
    x, y = motion.marker(name, time)[0]
    yield Key("position_x", name, at, "m", instant), x
    yield Key("position_y", name, at, "m", instant), y


def _at_launch(motion: Motion, mechanism: Mechanism, launch: Launch) -> _KeyedValues:
    yield Key("launch_time", None, "", "s"), launch.time
    yield Key("launch_speed", None, "", "m/s"), launch.speed
    yield from _coordinates(motion, mechanism, launch.time, "launch")
    yield from _position(motion, PROJECTILE, launch.time, "launch")
    distance = vacuum_range(motion, mechanism.gravity, launch.time)
    yield Key("range", None, "launch", "m"), distance
    yield Key("energy_ratio", None, "launch", "1"), _energy_ratio(motion, mechanism, launch.time)


def _rightmost(motion: Motion, plan: Plan, launch: Launch) -> _KeyedValues:
    if COUNTERWEIGHT not in {marker.name for marker in plan.mechanism.markers}:
        return
    yield Key("position_x", COUNTERWEIGHT, "start", "m"), motion.marker(COUNTERWEIGHT, 0.0)[0][0]

    def x(t: float, derivative: int = 0) -> float:
        return float(motion.marker(COUNTERWEIGHT, t)[derivative][0])

    time = _maximum(x, lambda t: x(t, 1), 0.0, launch.time, plan.step / 10)
    if time is not None:
        yield Key("position_x_max", COUNTERWEIGHT, "before launch", "m"), x(time)


def _best_release(motion: Motion, plan: Plan, launch: Launch) -> _KeyedValues:
    """The release with the longest flight without air, near the launch."""
    g = plan.mechanism.gravity
    if g == 0:
        return

    def rate(t: float) -> float:
        """dR/dt of R = x + vx T, g T = vy + sqrt(vy^2 + 2 g y)."""
        (_, y), (vx, vy), (ax, ay) = motion.marker(PROJECTILE, t)
        time = _flight_time(y, vy, g)
        time_rate = (ay + (vy * ay + g * vy) / math.sqrt(vy * vy + 2 * g * y)) / g
        return float(vx + ax * time + vx * time_rate)

    time = _near(motion, launch, plan.step, lambda t: vacuum_range(motion, g, t), rate)
    if time is not None:
        _, (vx, vy), _ = motion.marker(PROJECTILE, time)
        yield Key("best_release_time", None, "longest range", "s"), time
        yield Key("best_release_angle", None, "longest range", "rad"), math.atan2(vy, vx)
        yield Key("best_release_speed", None, "longest range", "m/s"), math.hypot(vx, vy)
        yield Key("best_range", None, "longest range", "m"), vacuum_range(motion, g, time)


def _largest_ratio(motion: Motion, plan: Plan, launch: Launch) -> _KeyedValues:
    if not motion.energy(0.0):
        return

    def rate(t: float) -> float:
        _, v, a = motion.marker(PROJECTILE, t)
        return float(v @ a)

    time = _near(motion, launch, plan.step, lambda t: _half_squared_speed(motion, t), rate)
    if time is not None:
        yield Key("largest_ratio_time", None, "fastest", "s"), time
        ratio = _energy_ratio(motion, plan.mechanism, time)
        yield Key("largest_ratio", None, "fastest", "1"), ratio


def _near(
    motion: Motion,
    launch: Launch,
    step: float,
    value: Callable[[float], float],
    rate: Callable[[float], float],
) -> float | None:
    """Find when a function is largest within a step of the launch, after the last release [s]."""
    times = motion.release_times.values()
    opened = [time for time in times if time is not None and time < launch.time]
    before = max(max(opened, default=0.0), launch.time - step)
    return _maximum(value, rate, before, launch.time + step, step / 100)


def _maximum(
    value: Callable[[float], float],
    rate: Callable[[float], float],
    start: float,
    end: float,
    step: float,
) -> float | None:
    """Find when a smooth function is largest [s]; None at an end of the interval."""
    times = np.linspace(start, end, max(3, math.ceil((end - start) / step) + 1))
    best = int(np.argmax([value(float(t)) for t in times]))
    if best in (0, len(times) - 1):
        return None
    before, after = float(times[best - 1]), float(times[best + 1])
    if not rate(before) > 0 > rate(after):
        return None
    return float(brentq(rate, before, after, xtol=1e-15, rtol=1e-15))


def vacuum_range(motion: Motion, gravity: float, t: float) -> float:
    """Compute where a projectile let go at t comes back to y = 0 [m]; NaN where it never does."""
    (x, y), (vx, vy), _ = motion.marker(PROJECTILE, t)
    return float(x + vx * _flight_time(y, vy, gravity))


def _flight_time(y: float, vy: float, gravity: float) -> float:
    under = vy * vy + 2 * gravity * y
    return (vy + math.sqrt(under)) / gravity if under >= 0 and gravity > 0 else math.nan


def _half_squared_speed(motion: Motion, t: float) -> float:
    _, v, _ = motion.marker(PROJECTILE, t)
    return float(v @ v) / 2


def _energy_ratio(motion: Motion, mechanism: Mechanism, t: float) -> float:
    """The paper's R: kinetic energy of the projectile over the total energy at the start."""
    marker = next(m for m in mechanism.markers if m.name == PROJECTILE)
    mass, energy = mechanism.thrown_mass(marker), motion.energy(0.0)
    return mass * _half_squared_speed(motion, t) / energy if mass and energy else math.nan


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
        InputError: the ladder has fewer than two rungs or is not falling, or the duration is too
            short for instants to be told apart.
        SimulationError: a computation failed.
    """
    if len(ladder) < 2 or list(ladder) != sorted(ladder, reverse=True):
        raise InputError(f"ladder = {list(ladder)!r} must hold at least two falling tolerances.")
    if duration is not None and duration < _SHORTEST:
        raise InputError(
            f"duration = {duration!r} s must be at least {_SHORTEST:g} s: events are located to "
            "1e-13 s."
        )
    problem, plan = call(partial(_problem, mechanism, duration, stop_law))
    tasks, absent = _tasks(problem, plan, parameters, ladder)
    computations: list[Computation] = []
    by_key: dict[Key, dict[str, float]] = defaultdict(dict)
    for done, task in enumerate(tasks):
        name = task.computation.name
        if progress:
            progress(name, done, len(tasks) + 1)
        try:
            values = call(task.compute)
        except Exception as error:  # an optional library may raise anything; it is recorded
            if not task.optional:
                raise
            absent.append(f"{name}: failed with {type(error).__name__}: {error}")
            continue
        computations.append(task.computation)
        for key, value in values.items():
            by_key[key][name] = value
    versions = {"trebucheck": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "heyoka", "sympy"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "not installed"
    if progress:
        progress("proof", len(tasks), len(tasks) + 1)
    figures: list[Figure] = []
    for key, (value, uncertainty) in judge(by_key, computations).items():
        given = key._asdict()
        figures.append(Figure(**given, value=value, uncertainty=uncertainty, values=by_key[key]))
    figures = call(partial(_proved, problem, plan, figures))
    return Certificate(
        model=mechanism.name,
        mechanism_hash=mechanism.content_hash,
        command=command or f"trebucheck certify --models {mechanism.name}",
        rule=RULE,
        versions=versions,
        computations=tuple(computations),
        absent=tuple(absent),
        figures=tuple(figures),
    )


def _proved(problem: Problem, plan: Plan, figures: Sequence[Figure]) -> list[Figure]:
    """The figures, with what is proved of each."""
    launch = [figure.value for figure in figures if figure.name == "launch_time"]
    # A step beyond the launch, within which extrema are sought, and a little more: what is read of
    # a proof ends before it.
    beyond = plan.step * (1 + 1 / _MARGINS)
    end = max([*plan.grid, *plan.halfway.values(), *(t + beyond for t in launch)])
    known = proof_of(problem, min(end, problem.duration), plan.step)
    return [with_proof(figure, known) for figure in figures]


def judge(
    values_by_key: Mapping[Key, Mapping[str, float]], computations: Sequence[Computation]
) -> dict[Key, tuple[float, float]]:
    """The module's rule: value and uncertainty of the figures that all computations have.

    Args:
        values_by_key: values of each figure, by name of computation.
        computations: those that count, independent ones and rungs.
    """
    independent = [c.name for c in computations if c.independent]
    if len(independent) < 2:
        return {}
    tightest = min((c.tolerance for c in computations if c.tolerance), default=0.0)
    names = {c.name for c in computations}
    best: dict[Key, float] = {}
    moved = defaultdict[tuple[str, str], float](float)
    scale = defaultdict[tuple[str, str], float](float)
    for key, values in values_by_key.items():
        # A computation without a launch, say, says that nothing is known of it, not that the others
        # know it better.
        if not names <= values.keys():
            continue
        value = values[BEST] if BEST in independent else median(values[c] for c in independent)
        kind = _kind(key)
        best[key], scale[kind] = value, max(scale[kind], abs(value))
        for c in computations:
            if c.tolerance and not c.independent:
                expected = abs(values[c.name] - value) * (tightest / c.tolerance) ** _ORDER
                moved[kind] = max(moved[kind], expected)
    judged: dict[Key, tuple[float, float]] = {}
    for key, value in best.items():
        kind = _kind(key)
        difference = max(abs(values_by_key[key][name] - value) for name in independent)
        rounding = _ROUNDINGS * _EPS * scale[kind]
        judged[key] = value, _SAFETY * (difference + moved[kind]) + rounding
    return judged


def _kind(key: Key) -> tuple[str, str]:
    """Quantities with one uncertainty rule: x and y of a position are one kind."""
    return ("position" if key.name.startswith("position") else key.name, key.unit)


def _problem(
    mechanism: Mechanism, duration: float | None, stop_law: StopLaw
) -> tuple[Problem, Plan]:
    """Problem to just past the launch, or for the given duration, and what is read of it."""
    if duration is not None:
        problem = Problem(mechanism, duration=duration, stop_law=stop_law)
        motion = MinimalMotion(solve(problem))
        plan = _plan(mechanism, motion, duration, _grid_step(duration / 2))
        return problem, replace(plan, launches=False)
    if mechanism.gravity > 0:
        scale = characteristic_time(mechanism)
    else:  # the time in which a coordinate moves by 1 rad or 1 m
        q, u = initial_state(mechanism)
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        a, _ = Equations(mechanism).solve(q, u, closed)
        fastest = max(float(np.abs(u).max()), math.sqrt(np.abs(a).max()))
        scale = 1 / fastest if fastest > 0 else _AT_REST
    step, (first, second) = _grid_step(scale), (span * scale for span in _SEARCH)
    longest = _NO_LAUNCH * step
    spans = (first, max(second, longest))
    solution = solve_until(mechanism, spans, lambda solution: solution.launch is not None, stop_law)
    launch = solution.launch
    last, end = longest, longest
    if launch is not None:
        last, end = launch.time, launch.time + step + step / _MARGINS
    problem = Problem(mechanism, duration=end, stop_law=stop_law)
    return problem, _plan(mechanism, MinimalMotion(solution), last, step)


@dataclass(frozen=True)
class _Task:
    """A computation to be made."""

    computation: Computation
    compute: Callable[[], dict[Key, float]]
    optional: bool = False  # whether a certificate may lack it


def _tasks(
    problem: Problem, plan: Plan, parameters: TrebuchetParameters | None, ladder: Sequence[float]
) -> tuple[list[_Task], list[str]]:
    """The computations that can be made here, and sentences on those that cannot."""
    tasks, absent = list[_Task](), list[str]()
    mechanism, chosen = problem.mechanism, parameters or TrebuchetParameters()

    def minimal(tolerance: float) -> Motion:
        return MinimalMotion(solve(problem, tolerance, tolerance))

    def redundant(tolerance: float) -> Motion:
        return solve_redundant(problem, tolerance)

    def paper(tolerance: float) -> Motion:
        from .paper import solve_paper  # SymPy takes most of a second to import

        return solve_paper(chosen, mechanism.name == "rolling", problem.duration, tolerance)

    def add(name: str, formulation: str, run: Callable[[float], Motion], tolerance: float) -> None:
        computation = Computation(
            name=f"{name}, {tolerance:g}",
            formulation=formulation,
            integrator="DOP853 (SciPy)",
            tolerance=tolerance,
            independent=tolerance == ladder[-1],
        )

        def compute() -> dict[Key, float]:
            return read_quantities(run(tolerance), plan)

        tasks.append(_Task(computation, compute, optional=run is paper))

    for tolerance in ladder:
        add("minimal", "absolute angles, stops and loops by KKT", minimal, tolerance)
    if problem.stop_law is StopLaw.RELEASE_ONCE:
        for tolerance in ladder:
            text = "three coordinates a body, joints and stops by KKT"
            add("redundant", text, redundant, tolerance)
    else:
        absent.append("redundant: it follows the release-once law of a stop only")
    if importlib.util.find_spec("sympy") is None:
        absent.append("the paper's equations: SymPy is not installed")
    elif mechanism.name not in PAPER_MACHINES or model(mechanism.name, chosen) != mechanism:
        absent.append("the paper's equations: not one of its machines")
    else:
        add("paper", "the paper's Lagrangian, Eqs. (1)-(10), by SymPy", paper, ladder[-1])
    precisions: dict[Precision, int] = {"double": 64, "extended": 80}
    for precision, bits in precisions.items():
        name = f"taylor, {precision}"
        if (reason := why_not_taylor(problem)) is not None:
            absent.append(f"{name}: {reason}")
            continue
        computation = Computation(
            name=name,
            formulation="absolute angles, stops and loops by KKT, as heyoka's expressions",
            integrator=f"adaptive Taylor series (heyoka), {bits}-bit floats",
            tolerance=None,
            independent=True,
        )
        compute = partial(_taylor_values, problem, plan, precision)
        tasks.append(_Task(computation, compute, optional=True))
    return tasks, absent


def _taylor_values(problem: Problem, plan: Plan, precision: Precision) -> dict[Key, float]:
    from ..taylor.solve import solve_taylor, taylor_quantities  # heyoka takes a second to import

    values = read_quantities(MinimalMotion(solve_taylor(problem, precision=precision)), plan)
    # Located and evaluated on the series itself, in its own precision.
    throw = taylor_quantities(problem, precision)
    direct: dict[tuple[str, str | None, str], Any] = {
        ("launch_time", None, ""): throw.launch_time,
        ("launch_speed", None, ""): throw.launch_speed,
    }
    for name, time in throw.release_times.items():
        direct["release_time", name, ""] = time
    for name, torque in throw.start_torques.items():
        direct["stop_torque", name, "start"] = torque
    if throw.launch_q is not None:
        for name, q in zip(problem.mechanism.coordinates, throw.launch_q, strict=True):
            direct["coordinate", name, "launch"] = q
    for key in values:
        if (value := direct.get(key[:3])) is not None:
            values[key] = float(value)
    return values
