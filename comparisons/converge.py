"""Convergence of an engine on a mechanism: parameters swept, orders fitted, floors explained.

The order is the slope of the straight part of the error in the log-log plane. Richardson's limit is
what an engine would say with no time step at all, as functions of time: deviations from the
reference stand on one grid of times, so that those of different steps can be subtracted and
extrapolated sample by sample. (Richardson 1911; Roache, Verification and Validation, on
observed orders.) The cause of a floor is decided by refining every other parameter once there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Any, Literal, Unpack

import numpy as np
from pydantic import Field, JsonValue
from scipy.optimize import brentq
from scipy.special import stdtrit

from ..engines.presets import ASSISTED, PRESETS
from ..engines.protocol import Engine
from ..engines.registry import (
    Engines,
    Names,
    engine,
    engine_class,
    engine_names,
    engine_study,
    names_of,
    options_for,
    presets_of,
)
from ..engines.study import ConstraintKinds, Options, Refinement, StepOrder, SweptParameter
from ..models.arrays import FloatArray
from ..models.errors import InputError, SimulationError
from ..models.library.registry import Models
from ..models.shown import Reported
from ..models.spec import NonNegative, Positive, Real, Spec
from ..reference.certification.certificate import REFUSED_BELOW
from .report.document import format_number
from .runs.process import all_in_order
from .runs.record import Curves, EngineRuns, RunRecord, runs_of
from .runs.results import ComparedMotion, OfEngine, ResultFile, WorkPoint, optional
from .runs.runner import run_duration
from .runs.study import Counter, RunOptions, Study

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

# ----------------------------------------------------------------------------- converge.json

FORMAT = "trebucheck-converge-1"

QuantityName = Literal["position", "torque"]


class PowerLaw(Spec):
    """error = factor * value^exponent, over a range of values."""

    exponent: Real
    half_width: NonNegative = Field(description="of its 95 % confidence interval (Student t)")
    factor: Positive = Field(description="error at the value 1, in the quantity's unit")
    low: Positive = Field(description="smallest value of the range")
    high: Positive = Field(description="largest value of the range")
    points: Annotated[int, Field(ge=4)]

    @property
    def decades(self) -> float:
        """Length of the range, in powers of ten."""
        return math.log10(self.high / self.low)

    def at(self, value: float) -> float:
        """The error it tells at a value of the knob."""
        return self.factor * value**self.exponent


class Floor(Spec):
    """An error that turning the knob further does not lower."""

    error: Real
    value: Real | None = Field(
        description="of the knob where it was looked at; None: with its error taken out"
    )
    cause: str
    evidence: str = Field(description="the measurement the cause was decided by")


class Curve(Spec):
    """One quantity along a study."""

    quantity: QuantityName
    force_unit: str = Field(default="N m", description="of what the machine's stops push with")
    law: PowerLaw | None = Field(description="None: none, or the knob hardly moves the error")
    floor: Floor | None = Field(description="None: the error still falls at the finest value")

    @property
    def unit(self) -> str:
        """Unit of its error."""
        return "m" if self.quantity == "position" else self.force_unit


class Point(Spec):
    """One setting of the knob."""

    value: Real
    options: dict[str, JsonValue] = Field(description="what the value means to the engine")
    message: str | None = Field(default=None, description="why it failed; None if it ran")
    position: Real | None = Field(
        default=None, description="largest error of any marker's position [m]"
    )
    torque: Real | None = Field(
        default=None, description="largest error of any stop's torque [N m, N]"
    )
    own_position: Real | None = Field(
        default=None, description="the part of it that the knob makes"
    )
    own_torque: Real | None = None
    steps: Annotated[int, Field(ge=0)] = 0
    wall_times: tuple[Real, ...] = Field(default=(), description="warm, one a repeat [s]")
    work: WorkPoint | None = optional(None, "of a time step; null of other knobs, or not kept")

    def error(self, quantity: QuantityName, own: bool = False) -> float | None:
        """Error of a quantity; `own`: the part that the knob makes."""
        return getattr(self, f"own_{quantity}" if own else quantity)


class SweepStudy(OfEngine, Spec):
    """One knob of one engine and preset, turned."""

    engine: str
    engine_version: str
    preset: str
    knob: str
    title: str = Field(description="of what is turned, with its symbol")
    unit: str
    base: dict[str, JsonValue] = Field(description="options that stay, over the preset's")
    settings: dict[str, JsonValue] = Field(description="every option of the first point's engine")
    expected: Real | None = Field(description="exponent; None: theory expects no power law")
    why: str
    own: bool = Field(description="whether exponents are of the knob's own part of the error")
    points: tuple[Point, ...] = Field(description="from coarse to fine")
    curves: tuple[Curve, ...]

    def curve(self, quantity: QuantityName) -> Curve:
        """Law and floor of a quantity."""
        return next(curve for curve in self.curves if curve.quantity == quantity)


class RichardsonLimit(OfEngine, Spec):
    """Richardson's extrapolation of a run to no time step at all, over the whole throw."""

    engine: str
    preset: str
    levels: tuple[Real, ...] = Field(
        description="time steps, from coarse to fine [s]; the limit is of the finest two"
    )
    order: Real = Field(description="from the successive differences of the three")
    power: Annotated[int, Field(ge=1)] = Field(
        description="that was extrapolated with: the order, rounded"
    )
    position: Real = Field(description="largest distance of the limit from the reference [m]")
    position_three: Real = Field(
        description="the same with three levels, which take the next power out, too [m]"
    )
    estimate: Real = Field(
        description="largest distance between the two limits: the limit's own error [m]"
    )
    torque: Real | None = Field(
        description="largest distance of any stop's torque from the reference [N m, N]"
    )


class LimitPair(Spec):
    """Two limits against each other; the reference takes no part."""

    first: str
    second: str
    position: Real = Field(description="largest distance over the throw [m]")


class MachineStudies(ComparedMotion):
    """Studies of one machine."""

    uncertainty: dict[QuantityName, Real] = Field(
        description="of the reference [m, N m or N], of what it has"
    )
    uncertainty_source: str
    way: Real | None = optional(
        None, "longest way of any point, by which position errors are judged [m]; null: not kept"
    )
    units: dict[str, str] = optional({}, "of the errors at time steps, by metric")
    studies: tuple[SweepStudy, ...]
    limits: tuple[RichardsonLimit, ...]
    pairs: tuple[LimitPair, ...]
    absent: tuple[str, ...] = Field(default=(), description="engines that are not installed here")

    def limit(self, label: str) -> RichardsonLimit | None:
        """A run's limit; None if it has none."""
        return next((limit for limit in self.limits if limit.label == label), None)


class Studies(Reported, ResultFile):
    """The whole of `trebucheck converge`."""

    format: Literal["trebucheck-converge-1"] = FORMAT
    machines: tuple[MachineStudies, ...]
    failures: dict[str, str] = Field(
        default_factory=dict, description="machines whose reference failed, and why"
    )

    def headline(self) -> str:
        """Tell how many parameters were swept of what."""
        number = sum(len(machine.studies) for machine in self.machines)
        names = ", ".join(machine.model for machine in self.machines)
        return f"Convergence of {names}: {number} swept parameters"

    def rows(self) -> Iterator[dict[str, object]]:
        """A point of a sweep a row."""
        for machine in self.machines:
            for study in machine.studies:
                head = study.model_dump(include={"engine", "preset", "knob"})
                for point in study.points:
                    yield {"model": machine.model, **head, **point.model_dump(exclude={"options"})}


# ------------------------------------------------------------------------------ power laws

CONFIDENCE = 0.95
FEWEST = 4  # points of a line: two make it, two more can gainsay it
# How far the local slope may depart from a line's along its run: the bar the suite states for
# orders. A parabola that is off a line by r at worst, over a length L of the logarithm, has slopes
# that are off by 6 r / L at its ends; so a run is taken for straight if its worst point is off by
# no more than SLOPE * L / 6.
SLOPE = 0.1
# An exponent is only claimed where the error changes at least so much: less may be a floor with a
# slope.
TENFOLD = 10.0


def power_law(
    values: Sequence[float], errors: Sequence[float | None], uncertainty: float = 0.0
) -> PowerLaw | None:
    """The power law that tells the most of a study: error = factor * value^exponent.

    Of all runs of at least four neighbouring points on a line (least squares of the logarithms)
    whose slope departs by less than `SLOPE`, the one along which the error changes most. The rule
    knows of no expected exponent; it leaves out a floor, on which the error does not change, and a
    coarse end with another slope.

    Args:
        values: of the swept parameter, positive.
        errors: None where a run failed, which parts neighbours.
        uncertainty: errors not above it are not fitted: they measure the reference.

    Returns:
        None where no run of points qualifies, or along none the error changes tenfold.
    """
    order = np.argsort(values)
    x = np.array(values, dtype=np.float64)[order]
    fitted = [np.nan if e is None or e <= uncertainty or e <= 0 else e for e in errors]
    y = np.array(fitted, dtype=np.float64)[order]
    best, most = None, -math.inf
    for first, end in combinations(range(len(x) + 1), 2):
        # A run of one and the same error is a floor.
        if end - first < FEWEST or not np.isfinite(y[first:end]).all() or not np.ptp(y[first:end]):
            continue
        log_x, log_y = np.log(x[first:end]), np.log(y[first:end])
        (slope, intercept), covariance = np.polyfit(log_x, log_y, 1, cov=True)
        quantile = stdtrit(len(log_x) - 2, (1 + CONFIDENCE) / 2)  # of Student's distribution
        law = PowerLaw(
            exponent=float(slope),
            half_width=float(quantile * np.sqrt(covariance[0, 0])),
            factor=float(np.exp(intercept)),
            low=float(np.exp(log_x[0])),
            high=float(np.exp(log_x[-1])),
            points=len(log_x),
        )
        length = np.log(law.high / law.low)
        off = float(np.abs(log_y - intercept - slope * log_x).max())
        change = abs(law.exponent) * length
        if 6.0 * off <= SLOPE * length and change >= np.log(TENFOLD) and change > most:
            best, most = law, change
    return best


# ----------------------------------------------------------------------- Richardson's limits

ASYMPTOTIC = 0.1  # distance of an observed order from a whole number: the suite's bar for them
_LOWEST, _HIGHEST = 0.1, 8.0  # orders that are looked for
_NEAR, _CANDIDATES = 0.03, 6001  # relative range about the step asked for; steps tried in it


@dataclass(frozen=True)
class Level:
    """A motion's deviation at one time step."""

    step: float  # [s]
    position: FloatArray  # of one point or several [m], shape (..., 2, n)
    torques: FloatArray  # [N m], shape (number of stops, n)


@dataclass(frozen=True)
class Extrapolated:
    """A limit, and how it was come by."""

    levels: tuple[float, ...]
    order: float
    power: int
    position: FloatArray  # deviation of the limit from the reference [m], shape (..., 2, n)
    torques: FloatArray
    position_three: FloatArray

    @property
    def estimate(self) -> float:
        """Error of the limit [m] without the reference: distance from that of three levels."""
        return largest(self.position - self.position_three)


def largest(position: FloatArray) -> float:
    """Largest length of any vector over time [m]; shape (..., 2, n)."""
    return float(np.linalg.norm(position, axis=-2).max())


def limit(levels: Sequence[Level]) -> Extrapolated | None:
    """The best limit of a ladder of levels, judged without the reference.

    Of all three neighbouring levels whose successive differences show a whole order, those whose
    limits from two and from three levels lie nearest to each other. A coarse triple fails by the
    next power, a fine one by rounding.

    Args:
        levels: of one engine and preset, at least three.

    Returns:
        None if no three levels show a whole order.
    """
    ladder = sorted(levels, key=lambda level: -level.step)
    limits: list[Extrapolated] = []
    for triple in zip(ladder, ladder[1:], ladder[2:], strict=False):
        steps = tuple(level.step for level in triple)
        coarse, middle, fine = (level.position for level in triple)
        order = observed_order(steps, largest(coarse - middle), largest(middle - fine))
        if order is None or round(order) < 1 or abs(order - round(order)) > ASYMPTOTIC:
            continue
        power = round(order)
        two, three = weights(steps[1:], (power,)), weights(steps, (power, power + 1))
        torques = np.stack([level.torques for level in triple[1:]])
        extrapolated = Extrapolated(
            levels=steps,
            order=order,
            power=power,
            position=np.tensordot(two, np.stack([middle, fine]), 1),
            torques=np.tensordot(two, torques, 1),
            position_three=np.tensordot(three, np.stack([coarse, middle, fine]), 1),
        )
        limits.append(extrapolated)
    return min(limits, key=lambda extrapolated: extrapolated.estimate, default=None)


def observed_order(steps: Sequence[float], first: float, second: float) -> float | None:
    """Order p at which (h0^p - h1^p) / (h1^p - h2^p) is the ratio of two successive differences.

    Args:
        steps: three, from coarse to fine [s]; their ratios need not be the same.
        first: size of the difference between the coarser two.
        second: between the finer two.

    Returns:
        None where no order between 0.1 and 8 does.
    """
    h0, h1, h2 = steps

    def excess(p: float) -> float:
        return np.log((h0**p - h1**p) / (h1**p - h2**p)) - np.log(first / second)

    if not (first > 0 and second > 0) or excess(_LOWEST) * excess(_HIGHEST) > 0:
        return None
    return float(brentq(excess, _LOWEST, _HIGHEST))


def weights(steps: Sequence[float], powers: Sequence[int]) -> FloatArray:
    """Weights of the levels, so that the given powers of the step cancel; they sum to 1.

    There is one step [s] more than there are powers.
    """
    h = np.array(steps) / min(steps)
    matrix = np.stack([h ** float(p) for p in (0, *powers)])
    return np.linalg.solve(matrix, np.eye(len(steps))[0])


def fitting(step: float, end: float, events: Sequence[float], longest: float = math.inf) -> float:
    """The step near the one asked for that comes nearest to dividing what remains after each event.

    Engines fit a whole number of equal steps between an event and the end, and so shorten them by
    up to one part in that number. Unequal shortening would spoil the ratio of the steps, on which
    Richardson's extrapolation rests.

    Args:
        step: asked for [s].
        end: of the compared motion [s].
        events: times of the reference's releases [s].
        longest: that the reference goes on to [s].
    """
    candidates = step * np.linspace(1.0 - _NEAR, 1.0 + _NEAR, _CANDIDATES)
    durations = np.array([run_duration(end, float(candidate), longest) for candidate in candidates])
    left = [(durations - start) / candidates for start in (0.0, *events)]
    shortened = np.max([(np.ceil(n - 1e-9) - n) / n for n in left], axis=0)
    return float(candidates[int(np.argmin(shortened))])


# --------------------------------------------------------------------------------- floors

# A refinement that leaves less than this share of an error has lowered it: the smallest one, a
# halving at first order, leaves 0.5, and 0.8 where only two fifths of the error are of its making.
LOWERED = 0.8
GROWN = 1.5  # an error this many times the floor, at a finer value, is one that grows
_SINGLE = float(np.finfo(np.float32).epsneg)
_NAMED = 3  # refinements in the evidence


def refinements(
    name: str, settings: Options, swept: Sequence[str], constraints: ConstraintKinds
) -> Iterator[tuple[Refinement, dict[str, Any]]]:
    """Sweep every refinement at an engine's settings, and each option that `assisted` changes.

    Options that the engine does not take unless others change with them are left out.

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
    for option, value in engine(name, ASSISTED).settings.items():
        if option in settings and settings[option] != value and option not in (*swept, "timestep"):
            if not _takes(name, {**settings, option: value}):
                continue  # it does nothing unless others are changed with it
            text = f"{option} as in {ASSISTED}"
            yield Refinement(f"option {option}", text, lambda _, __: None), {option: value}


def _takes(name: str, settings: Options) -> bool:
    """Tell whether an engine takes these options together."""
    own = {option: value for option, value in settings.items() if option != "preset"}
    try:
        engine(name, ASSISTED, **own)
    except InputError:
        return False
    return True


@dataclass(frozen=True)
class Site:
    """Place where a floor is looked into."""

    engine: str
    settings: Options
    swept: Sequence[str]
    error: float
    value: float | None
    measure: Callable[[dict[str, Any]], float | None]
    """The error with some options changed; None if the run fails."""
    constraints: ConstraintKinds  # of the mechanism


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
    measured, lowered = 0, list[tuple[float, Refinement]]()
    for refinement, change in refinements(site.engine, site.settings, site.swept, site.constraints):
        try:
            error = site.measure(change)
        except InputError:
            continue  # finer than the engine takes
        if error is not None:
            measured += 1
            if error / site.error <= LOWERED:
                lowered.append((error / site.error, refinement))
    if lowered:
        lowered.sort(key=lambda lowering: lowering[0])
        effects = [f"{refinement.description} leaves {share:.2g}" for share, refinement in lowered]
        return because(lowered[0][1].cause, "; ".join(effects[:_NAMED]))
    nothing = f"none of {measured} other knobs, turned one notch, lowers it by a fifth"
    if engine_study(site.engine).single_precision(site.settings):
        rounds = f"{nothing}; it rounds to {_SINGLE:.1e}, as its study says"
        return because("single precision", rounds)
    return because("not found", nothing)


# --------------------------------------------------------------------------------- sweeps

_METRICS: Mapping[QuantityName, str] = {"position": "position_max", "torque": "stop_torque_max"}
_STEPS = tuple(1e-2 / 2**k for k in range(8))  # 1e-2 to 7.8e-5 s: two decades and a little
_LONGER_STEPS = _STEPS[:6]  # down to 3e-4 s: finer ones are no newcomer's, and cost the most
# [s] characteristic time of machines with these steps, the mean of the named ones
_STEPS_TIME = 1.36
_COARSER = tuple(_STEPS[0] * 2 ** (k / 2) for k in range(1, 9))  # to 0.16 s, an eighth of that time
_UNKNOWN = StepOrder(None, "the order of a plug-in is not known beforehand")


def converge(
    models: Models = ("fixed", "rolling"),
    engines: Engines | None = None,
    presets: Names | None = None,
    *,
    knobs: Names | None = None,
    **how: Unpack[RunOptions],
) -> Studies:
    """Turn each engine's knobs and see how its error falls: orders, floors, Richardson limits.

        >>> import trebucheck as tb
        >>> studies = tb.converge("fixed", "pymunk", knobs="timestep")  # doctest: +SKIP
        >>> studies.plot("fixed-errors")  # doctest: +SKIP

    Args:
        models: one or several: names of machines or of the library's problems, paths of mechanisms'
            .json files, mechanisms, or problems.
        engines: one or several: names, or engines as `tb.engine` makes them; all but the reference
            if left out.
        presets: in which the time step is swept; all that an engine has, or those of the engines
            given, if left out.
        knobs: names of the parameters to be swept, such as 'timestep'; all if left out.
        how: runs are made; see :class:`..runs.study.RunOptions`.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a
            failed point.
    """
    study = Study.of(models, engines, presets, **how)
    return converge_study(study, None if knobs is None else names_of(knobs))


def converge_study(study: Study, chosen: Sequence[str] | None = None) -> Studies:
    """Carry out the sweeps of a study; see :func:`converge`.

    Args:
        study: mechanisms, engines (all known ones but the reference if None; those not installed
            are listed as absent), how they are run, and the end of the compared motion. Its options
            are set in every sweep of an engine that has them, over those of the sweep. The time
            step is swept in each of its presets, another parameter in its own if that is among
            them.
        chosen: names of swept parameters (:func:`parameter_names`); all if left out.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a
            failed point, a machine whose reference fails is left out, with its reason.
    """
    absent, plan = _plan(study, chosen)
    per_machine = sum(len(parameter.values) for _, parameter in plan)
    count = Counter(len(study.mechanisms) * per_machine, study.progress)
    uncertainties: dict[str, dict[QuantityName, float]] = {}

    def sweep(wanted: tuple[EngineRuns, str, SweptParameter]) -> _Sweep:
        runs, name, parameter = wanted
        own = options_for(name, study.options)
        return _Sweep(runs, uncertainties[runs.mechanism.name], name, parameter, count, own)

    with study.worker() as worker:
        moved, failures = runs_of(study, worker)
        for runs in moved:
            mechanism, known = runs.mechanism, dict[QuantityName, float]()
            try:
                for quantity, metric in _METRICS.items():
                    if quantity == "position" or mechanism.stops:
                        known[quantity] = runs.uncertainty(metric) or 0.0
            except SimulationError as error:  # the other machines must not be lost with it
                failures[mechanism.name] = str(error)
            else:
                uncertainties[mechanism.name] = known
        solved = [runs for runs in moved if runs.mechanism.name in uncertainties]
        wanted = [(runs, name, parameter) for runs in solved for name, parameter in plan]
        sweeps = all_in_order(sweep, wanted, study.at_once)
    machines: list[MachineStudies] = []
    for runs in solved:
        swept = [sweep for sweep in sweeps if sweep.machine is runs]
        machines.append(_machine(runs, uncertainties[runs.mechanism.name], swept, absent))
    return Studies.made_here(machines=tuple(machines), failures=failures, **study.times)


def parameter_names() -> tuple[str, ...]:
    """Names that `--knobs` can have."""
    names = ["timestep"]
    for name in engine_names():
        names += [parameter.name for parameter in engine_study(name).swept_parameters]
    return tuple(dict.fromkeys(names))


def swept_parameters(
    name: str, names: list[str] | None = None, presets: Iterable[str] = PRESETS
) -> list[SweptParameter]:
    """Select an engine's swept parameters, all or those asked for, that its version has.

    Args:
        name: of the engine.
        names: of parameters; None: all.
        presets: in which they are swept.

    Raises:
        InputError: there is no such engine or parameter.
    """
    for chosen in names or ():
        if chosen not in parameter_names():
            raise InputError(
                f"there is no knob {chosen!r}; there are: {', '.join(parameter_names())}."
            )
    parameters: list[SweptParameter] = []
    for preset in presets_of(name, presets):
        expected = engine_study(name).step_orders.get(preset, _UNKNOWN)
        timestep = SweptParameter(
            name="timestep",
            title="time step h",
            unit="s",
            options=lambda h: {"timestep": h},
            values=_STEPS if preset == ASSISTED else _LONGER_STEPS,
            expected=expected.order,
            why=expected.reason,
            preset=preset,
            repeats=3,
        )
        parameters.append(timestep)
    for parameter in engine_study(name).swept_parameters:
        chosen = parameter.preset in presets_of(name, presets)
        if chosen and parameter.requires <= set(engine(name, parameter.preset).settings):
            parameters.append(parameter)
    return [parameter for parameter in parameters if names is None or parameter.name in names]


def _plan(
    study: Study, chosen: Sequence[str] | None
) -> tuple[list[str], list[tuple[str, SweptParameter]]]:
    """Engines that are not installed, and every parameter to be swept of those that are.

    Raises:
        InputError: there is nothing to do, or an option is not valid or is what is swept.
    """
    names, parameters = study.measured_engines, list(chosen) if chosen else None
    every = [
        (name, swept)
        for name in names
        for swept in swept_parameters(name, parameters, study.presets)
    ]
    if not every:
        raise InputError(
            f"none of the engines {', '.join(names)} has any of the knobs "
            f"{', '.join(chosen or ())}."
        )
    absent = [name for name in names if not engine_class(name).is_installed()]
    plan = [(name, parameter) for name, parameter in every if name not in absent]
    for name, parameter in plan:
        own = options_for(name, study.options)
        turned = {parameter.name, *parameter.options(parameter.values[0])}
        for option in own:
            if option in turned | set(parameter.without or {}):
                raise InputError(
                    f"option {option} of {name} is what its knob {parameter.name!r} turns; leave "
                    "the option out, or choose other knobs."
                )
        if own:  # refuses what the engine does not take
            engine(name, parameter.preset, **{**parameter.base, **own})
    return absent, plan


class _Sweep:
    """One parameter of an engine, taken through its values on one machine."""

    def __init__(
        self,
        machine: EngineRuns,
        uncertainty: Mapping[QuantityName, float],
        name: str,
        parameter: SweptParameter,
        count: Counter,
        own: Mapping[str, Any],
    ) -> None:
        self.machine, self.uncertainty = machine, uncertainty
        self.name, self.parameter = name, parameter
        # Options that stay as they are, the user's own among them
        self.fixed = {**parameter.base, **own}
        self.of_step = "timestep" in parameter.options(parameter.values[0])
        # The run with the parameter's error taken out
        self.without = None if parameter.without is None else self._record(parameter.without, 1)
        self.records: list[RunRecord | None] = []  # None where the engine refused the options
        self.points: list[Point] = []
        self.units: dict[str, str] = {}
        """Units of the points' errors, by metric."""
        for value in parameter.values:
            count.start(f"{machine.mechanism.name}: {name} {parameter.preset} {parameter.name}")
            self._measure(value)
        # Coarser levels, while too few errors exceed the reference's uncertainty: a high order is
        # at rounding with every step that a low one is measured at.
        for value in _COARSER if parameter.name == "timestep" else ():
            errors = [point.position or 0.0 for point in self.points]
            above = sum(error > uncertainty["position"] for error in errors)
            if not self.points[0].position or above >= FEWEST:
                break
            self._measure(value)
            self.points.insert(0, self.points.pop())
            self.records.insert(0, self.records.pop())
        self.study = SweepStudy(
            engine=name,
            engine_version=engine_class(name).version(),
            preset=parameter.preset,
            knob=parameter.name,
            title=parameter.title,
            unit=parameter.unit,
            base=self.fixed,
            settings=next((record.settings for record in self.records if record is not None), {}),
            expected=parameter.expected,
            why=parameter.why,
            own=self.without is not None,
            points=tuple(self.points),
            curves=tuple(self._curve(quantity) for quantity in uncertainty),
        )

    def _measure(self, value: float) -> None:
        if self.of_step:
            # Scaled to the machine's time by a power of two, such that whole numbers fit.
            solution, end = self.machine.solution, self.machine.runner.end
            events = [time for time in solution.release_times.values() if time is not None]
            size = 2.0 ** round(math.log2(self.machine.time_scale / _STEPS_TIME))
            value = fitting(value * size, end, events, solution.problem.duration)
        options: dict[str, Any] = dict(self.parameter.options(value))
        record, message = None, None
        try:
            record = self._record(options, self.parameter.repeats)
            message = record.message
        except InputError as error:
            message = str(error)
        self.records.append(record)
        if record is None or record.curves is None:
            self.points.append(Point(value=value, options=options, message=message))
            return
        curves, position = record.curves, record.position
        if position:
            # The end lies between two samples of a coarse step, and a growing error is largest
            # there. What gives the reference back is not interpolated.
            at_end = float(np.linalg.norm(curves.position[..., -1], axis=-1).max())
            position = max(position, at_end)
        own_position, own_torque = None, None
        if self.without is not None and self.without.curves is not None:
            base = self.without.curves
            own_position = largest(curves.position - base.position)
            own_torque = _largest(_torques(curves) - _torques(base))
        work = record.work
        if position and "position_max" in work.errors:
            work.errors["position_max"] = position
        self.units |= {m.name: m.unit for m in record.metrics if m.name in work.errors}
        self.points.append(
            Point(
                value=value,
                options=options,
                work=work if self.of_step else None,
                position=position,
                torque=record.torque,
                own_position=own_position,
                own_torque=own_torque,
                steps=record.steps,
                wall_times=record.wall_times,
            )
        )

    def _engine(self, options: Mapping[str, Any]) -> Engine:
        """The engine with the options that stay, and these over them."""
        return engine(self.name, self.parameter.preset, **{**self.fixed, **options})

    def _record(self, options: Mapping[str, Any], repeats: int) -> RunRecord:
        return self.machine.record(self._engine(options), repeats)

    def _curve(self, quantity: QuantityName) -> Curve:
        """Law and floor of one quantity along the sweep."""
        own = self.without is not None
        values = [point.value for point in self.points]
        errors = [point.error(quantity, own) for point in self.points]
        law = power_law(values, errors, 0.0 if own else self.uncertainty[quantity])
        explained: Floor | None = None
        if self.without is not None:
            # What sets the error that is left with the parameter's own error taken out.
            left = self.without.largest(_METRICS[quantity])
            if left is not None:
                explained = self._floor(self.parameter.without or {}, quantity, (None, left))
        else:
            # What sets the least error, unless it still falls at the finest value. The law's finest
            # point is one of those beyond: there errors may only grow.
            ran = [(value, error) for value, error in zip(values, errors, strict=True) if error]
            beyond = ran
            if law is not None and ran:
                finest = law.low if ran[0][0] > ran[-1][0] else law.high
                distances = [abs(value / finest - 1.0) for value, _ in ran]
                beyond = ran[distances.index(min(distances)) :]
            if len(beyond) >= (1 if law is None else 2) and not _still_falls(ran):
                at = beyond[-1] if law is None else min(beyond, key=lambda point: point[1])
                options = self.parameter.options(at[0])
                finer = beyond[beyond.index(at) + 1 :]
                explained = self._floor(options, quantity, at, finer)
        unit = self.machine.mechanism.force_unit
        return Curve(quantity=quantity, force_unit=unit, law=law, floor=explained)

    def _floor(
        self,
        options: Mapping[str, Any],
        quantity: QuantityName,
        at: tuple[float | None, float],
        finer: Sequence[tuple[float, float]] = (),
    ) -> Floor:
        """Find what sets an error by changing other options there."""
        (value, error), metric = at, _METRICS[quantity]
        site = Site(
            engine=self.name,
            settings=self._engine(options).settings,
            swept=tuple(self.parameter.options(self.parameter.values[0])),
            error=error,
            value=value,
            measure=lambda change: self._record({**options, **change}, 1).largest(metric),
            constraints=ConstraintKinds.of(self.machine.mechanism),
        )
        return floor(site, self.uncertainty[quantity], finer)

    def limit(self) -> Extrapolated | None:
        """Limit of a sweep of the time step with the preset's other options."""
        if not self.of_step or self.parameter.base:
            return None
        levels: list[Level] = []
        for point, record in zip(self.points, self.records, strict=True):
            if record is not None and record.curves is not None:
                curves = record.curves
                levels.append(Level(point.value, curves.position, _torques(curves)))
        return limit(levels)


def _still_falls(ran: Sequence[tuple[float, float]]) -> bool:
    """Tell whether the error still falls at the finest values, with an order of 0.5 or more."""
    if len(ran) < 2 or ran[-1][1] > min(error for _, error in ran):
        return False
    (before, larger), (last, smaller) = ran[-2:]
    return np.log(larger / smaller) >= 0.5 * abs(np.log(before / last))


def _torques(deviation: Curves) -> FloatArray:
    """Shape (number of stops, n)."""
    return np.array([deviation.torques[name] for name in sorted(deviation.torques)])


def _largest(torques: FloatArray) -> float | None:
    return float(np.abs(torques).max()) if torques.size else None


def _machine(
    runs: EngineRuns,
    uncertainty: dict[QuantityName, float],
    sweeps: Sequence[_Sweep],
    absent: list[str],
) -> MachineStudies:
    """Studies of one machine, and the limits that follow from them."""
    positions: dict[str, FloatArray] = {}
    limits: dict[str, RichardsonLimit] = {}
    for sweep in sweeps:
        extrapolated, label = sweep.limit(), sweep.study.label
        if extrapolated is not None:
            positions[label] = extrapolated.position
            limits[label] = RichardsonLimit(
                engine=sweep.study.engine,
                preset=sweep.study.preset,
                levels=extrapolated.levels,
                order=extrapolated.order,
                power=extrapolated.power,
                position=largest(extrapolated.position),
                position_three=largest(extrapolated.position_three),
                estimate=extrapolated.estimate,
                torque=_largest(extrapolated.torques),
            )
    pairs: list[LimitPair] = []
    for first, second in combinations(positions, 2):
        distance = largest(positions[first] - positions[second])
        pairs.append(LimitPair(first=first, second=second, position=distance))
    return MachineStudies(
        **runs.compared_motion,
        uncertainty=uncertainty,
        uncertainty_source=runs.runner.uncertainties.source,
        way=runs.runner.scales.way,
        units={name: unit for sweep in sweeps for name, unit in sweep.units.items()},
        studies=tuple(sweep.study for sweep in sweeps),
        limits=tuple(limits.values()),
        pairs=tuple(pairs),
        absent=tuple(absent),
    )
