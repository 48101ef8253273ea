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
from typing import Any, Unpack

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from ...engines.given import Engines, Names, names_of
from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_names, engine_study, options_for
from ...engines.study import ConstraintKinds, Options, Refinement, StepOrder, SweptParameter
from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ...models.library.registry import Models
from ...reference.certification.certificate import REFUSED_BELOW
from ..report.document import format_number
from ..runs.process import all_in_order
from ..runs.record import Curves, EngineRuns, RunRecord, runs_of
from ..runs.runner import run_duration
from ..runs.study import Counter, RunOptions, Study
from .results import (
    Curve,
    Floor,
    LimitPair,
    MachineStudies,
    Point,
    PowerLaw,
    QuantityName,
    RichardsonLimit,
    Studies,
    SweepStudy,
)

CONFIDENCE = 0.95
FEWEST = 4  # points of a line: two make it, two more can gainsay it
SLOPE = 0.1
"""How far the local slope may depart from a line's along its run: the bar the suite states for
orders. A parabola that is off a line by r at worst, over a length L of the logarithm, has slopes
that are off by 6 r / L at its ends; so a run is taken for straight if its worst point is off by no
more than SLOPE * L / 6."""
TENFOLD = 10.0
"""An exponent is only claimed where the error changes at least so much: less may be a floor with a
slope.
"""


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
    y = np.array(
        [np.nan if e is None or e <= uncertainty or e <= 0 else e for e in errors], dtype=np.float64
    )[order]
    laws = [
        law
        for law in _lines(x, y)
        if abs(law.exponent) * np.log(law.high / law.low) >= np.log(TENFOLD)
    ]
    return max(laws, key=lambda law: abs(law.exponent) * np.log(law.high / law.low), default=None)


def _lines(x: FloatArray, y: FloatArray) -> Iterator[PowerLaw]:
    """Every run of neighbours that one line tells well enough."""
    for first, end in combinations(range(len(x) + 1), 2):
        # A run of one and the same error is a floor; linregress has no deviation for it.
        if end - first >= FEWEST and np.isfinite(y[first:end]).all() and np.ptp(y[first:end]) > 0:
            law, off = _line(np.log(x[first:end]), np.log(y[first:end]))
            if 6.0 * off <= SLOPE * np.log(law.high / law.low):
                yield law


def _line(x: FloatArray, y: FloatArray) -> tuple[PowerLaw, float]:
    """The line through all these logarithms, and how far the worst point is off it."""
    line = stats.linregress(x, y)
    quantile = stats.t.ppf((1 + CONFIDENCE) / 2, len(x) - 2)
    law = PowerLaw(
        exponent=float(line.slope),
        half_width=float(quantile * line.stderr),
        factor=float(np.exp(line.intercept)),
        low=float(np.exp(x[0])),
        high=float(np.exp(x[-1])),
        points=len(x),
    )
    return law, float(np.abs(y - line.intercept - line.slope * x).max())


ASYMPTOTIC = 0.1
"""How far an observed order may lie from a whole number: the bar the suite states for orders
themselves.
"""
_LOWEST, _HIGHEST = 0.1, 8.0  # orders that are looked for
_NEAR, _CANDIDATES = 0.03, 6001  # relative range about the step asked for; steps tried in it


@dataclass(frozen=True)
class Level:
    """A motion's deviation at one time step."""

    step: float
    """[s]"""
    position: FloatArray
    """[m], shape (..., 2, n): of one point or several."""
    torques: FloatArray
    """[N m], shape (number of stops, n)."""


@dataclass(frozen=True)
class Extrapolated:
    """A limit, and how it was come by."""

    levels: tuple[float, ...]
    order: float
    power: int
    position: FloatArray
    """Deviation of the limit from the reference [m], shape (..., 2, n)."""
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
    triples = zip(ladder, ladder[1:], ladder[2:], strict=False)
    limits = [
        extrapolated for triple in triples if (extrapolated := _extrapolated(triple)) is not None
    ]
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

    Args:
        steps: one more than there are powers [s].
    """
    h = np.array(steps) / min(steps)
    matrix = np.stack([h ** float(p) for p in (0, *powers)])
    return np.linalg.solve(matrix, np.eye(len(steps))[0])


def _extrapolated(triple: tuple[Level, Level, Level]) -> Extrapolated | None:
    steps = tuple(level.step for level in triple)
    coarse, middle, fine = (level.position for level in triple)
    order = observed_order(steps, largest(coarse - middle), largest(middle - fine))
    if order is None or round(order) < 1 or abs(order - round(order)) > ASYMPTOTIC:
        return None
    power = round(order)
    two, three = weights(steps[1:], (power,)), weights(steps, (power, power + 1))
    return Extrapolated(
        levels=steps,
        order=order,
        power=power,
        position=np.tensordot(two, np.stack([middle, fine]), 1),
        torques=np.tensordot(two, np.stack([level.torques for level in triple[1:]]), 1),
        position_three=np.tensordot(three, np.stack([coarse, middle, fine]), 1),
    )


def fitting(step: float, end: float, events: Sequence[float], longest: float = math.inf) -> float:
    """Choose the step near `around` that comes nearest to dividing what remains after each event.

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


LOWERED = 0.8
"""A refinement that leaves less than this share of an error has lowered it: the smallest one, a
halving at first order, leaves 0.5, and 0.8 where only two fifths of the error are of its making."""
_SINGLE = float(np.finfo(np.float32).epsneg)
_NAMED = 3  # refinements in the evidence
GROWN = 1.5
"""An error this many times the floor, at a finer value, is one that grows."""


def refinements(
    name: str, settings: Options, swept: Sequence[str], constraints: ConstraintKinds
) -> Iterator[tuple[Refinement, dict[str, Any]]]:
    """Sweep every refinement at an engine's settings, and each option its tuned preset changes.

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
    """Constraints that the mechanism has."""


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
    lowered = [lowering for lowering in remaining if lowering[0] <= LOWERED]
    lowered.sort(key=lambda lowering: lowering[0])
    if not lowered:
        nothing = f"none of {len(remaining)} other knobs, turned one notch, lowers it by a fifth"
        if engine_study(site.engine).single_precision:
            return "single precision", f"{nothing}; it rounds to {_SINGLE:.1e}, as its study says"
        return "not found", nothing
    effects = "; ".join(
        f"{refinement.description} leaves {share:.2g}" for share, refinement in lowered[:_NAMED]
    )
    return lowered[0][1].cause, effects


_METRICS: Mapping[QuantityName, str] = {"position": "position_max", "torque": "stop_torque_max"}
_STEPS = tuple(1e-2 / 2**k for k in range(8))  # 1e-2 to 7.8e-5 s: two decades and a little
_STOCK_STEPS = _STEPS[:6]  # down to 3e-4 s: finer ones are no newcomer's, and cost the most
# [s] characteristic time of machines with these steps, the mean of the named ones
_STEPS_TIME = 1.36
# To 0.16 s, an eighth of the time above.
_COARSER = tuple(_STEPS[0] * 2 ** (k / 2) for k in range(1, 9))
_UNKNOWN = StepOrder(None, "the order of a plug-in is not known beforehand")


def converge(
    models: Models = ("fixed", "rolling"),
    engines: Engines | None = None,
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
        knobs: names of the parameters to be swept, such as 'timestep'; all if left out.
        how: runs are made; see :class:`..runs.study.RunOptions`.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a
            failed point.
    """
    study = Study.of(models, engines, **how)
    return converge_study(study, None if knobs is None else names_of(knobs))


def converge_study(study: Study, chosen: Sequence[str] | None = None) -> Studies:
    """Carry out the sweeps of a study; see :func:`converge`.

    Args:
        study: mechanisms, engines (all known ones but the reference if None; those not installed
            are listed as absent), how they are run, and the end of the compared motion. Its options
            are set in every sweep of an engine that has them, over those of the sweep. Its presets
            are not used: each swept parameter has its own.
        chosen: names of swept parameters (:func:`parameter_names`); all if left out.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a
            failed point, a machine whose reference fails is left out, with its reason.
    """
    absent, plan = _plan(study, chosen)
    count = Counter(
        len(study.mechanisms) * sum(len(parameter.values) for _, parameter in plan), study.progress
    )
    with study.worker() as worker:
        moved, failures = runs_of(study, worker)
        known = dict(_uncertainties(moved, failures))
        swept = [
            (each, name, parameter)
            for each in moved
            if each.mechanism.name in known
            for name, parameter in plan
        ]

        def sweep(
            trials: EngineRuns, name: str, parameter: SweptParameter
        ) -> tuple[str, SweepStudy, Extrapolated | None]:
            own = options_for(name, study.options)
            found = _Sweep(trials, known[trials.mechanism.name], name, parameter, count, own)
            return trials.mechanism.name, found.study(), found.limit()

        found = all_in_order(lambda each: sweep(*each), swept, study.jobs)
        machines = [
            _machine(
                each,
                known[model],
                [(study, limit) for of, study, limit in found if of == model],
                absent,
            )
            for each in moved
            if (model := each.mechanism.name) in known
        ]
    return Studies.made_here(machines=tuple(machines), failures=failures, jobs=study.timed_at_once)


def _uncertainties(
    moved: Iterable[EngineRuns], failures: dict[str, str]
) -> Iterator[tuple[str, dict[QuantityName, float]]]:
    """Uncertainty of each machine's reference, by the machine's name; notes where that failed."""
    for trials in moved:
        mechanism = trials.mechanism
        quantities: list[QuantityName] = [q for q in _METRICS if q == "position" or mechanism.stops]
        try:
            known: dict[QuantityName, float] = {}
            for quantity in quantities:
                known[quantity] = trials.uncertainty(_METRICS[quantity]) or 0.0
        except SimulationError as error:  # the other machines must not be lost with it
            failures[mechanism.name] = str(error)
        else:
            yield mechanism.name, known


def _timestep(engine: str, preset: str) -> SweptParameter:
    expected = engine_study(engine).step_orders.get(preset, _UNKNOWN)
    return SweptParameter(
        name="timestep",
        title="time step h",
        unit="s",
        options=lambda h: {"timestep": h},
        values=_STEPS if preset == "tuned" else _STOCK_STEPS,
        expected=expected.order,
        why=expected.reason,
        preset=preset,
        repeats=3,
    )


def parameter_names() -> tuple[str, ...]:
    """Names that `--knobs` can have."""
    names = ["timestep"]
    for name in engine_names():
        names += [parameter.name for parameter in engine_study(name).swept_parameters]
    return tuple(dict.fromkeys(names))


def swept_parameters(name: str, names: list[str] | None = None) -> list[SweptParameter]:
    """Select an engine's swept parameters, all or those asked for, that its version has.

    Raises:
        InputError: there is no such engine or parameter.
    """
    for chosen in names or ():
        if chosen not in parameter_names():
            raise InputError(
                f"there is no knob {chosen!r}; there are: {', '.join(parameter_names())}."
            )
    presets = [preset for preset in ("tuned", "stock") if preset in engine_class(name).presets()]
    options = set(engine(name, "tuned").settings)
    own = [
        parameter
        for parameter in engine_study(name).swept_parameters
        if parameter.requires <= options
    ]
    every = [*(_timestep(name, preset) for preset in presets), *own]
    return [parameter for parameter in every if names is None or parameter.name in names]


_Plan = list[tuple[str, SweptParameter]]


def _plan(study: Study, chosen: Sequence[str] | None) -> tuple[list[str], _Plan]:
    """Engines that are not installed, and every parameter to be swept of those that are.

    Raises:
        InputError: there is nothing to do, or an option is not valid or is what is swept.
    """
    names, parameters = study.measured_engines, list(chosen) if chosen else None
    every = [
        (name, parameter) for name in names for parameter in swept_parameters(name, parameters)
    ]
    if not every:
        raise InputError(
            f"none of the engines {', '.join(names)} has any of the knobs "
            f"{', '.join(chosen or ())}."
        )
    absent = [name for name in names if not engine_class(name).is_installed()]
    plan = [(name, parameter) for name, parameter in every if name not in absent]
    for name, parameter in plan:
        _refuse_options(name, parameter, options_for(name, study.options))
    return absent, plan


def _refuse_options(name: str, parameter: SweptParameter, own: Mapping[str, Any]) -> None:
    """Refuse the user's options that the sweep sets itself, or that the engine does not take."""
    swept = {parameter.name, *parameter.options(parameter.values[0]), *(parameter.without or {})}
    for option in own:
        if option in swept:
            raise InputError(
                f"option {option} of {name} is what its knob {parameter.name!r} turns; leave "
                "the option out, or choose other knobs."
            )
    if own:
        engine(name, parameter.preset, **{**parameter.base, **own})


def _machine(
    trials: EngineRuns,
    uncertainty: dict[QuantityName, float],
    swept: Sequence[tuple[SweepStudy, Extrapolated | None]],
    absent: list[str],
) -> MachineStudies:
    """All studies of one machine, and the limits that follow from them."""
    mechanism, runner = trials.mechanism, trials.runner
    limits = {study.label: limit for study, limit in swept if limit is not None}
    return MachineStudies(
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        launch_time=runner.launch_time,
        compared_to=runner.end,
        judged_to=trials.end,
        uncertainty=uncertainty,
        uncertainty_source=runner.uncertainties.source,
        studies=tuple(study for study, _ in swept),
        limits=tuple(_limit_row(label, limit) for label, limit in limits.items()),
        pairs=tuple(_pairs(limits)),
        absent=tuple(absent),
    )


class _Sweep:
    """One parameter of an engine, taken through its values on one machine."""

    def __init__(
        self,
        trials: EngineRuns,
        uncertainty: dict[QuantityName, float],
        name: str,
        parameter: SweptParameter,
        count: Counter,
        own: Mapping[str, Any],
    ) -> None:
        self.machine, self.uncertainty = trials, uncertainty
        self.name, self.parameter = name, parameter
        self.fixed = {**parameter.base, **own}
        """Options that stay as they are, the user's own among them."""
        self.of_step = "timestep" in parameter.options(parameter.values[0])
        self.without = None if parameter.without is None else self.trial(parameter.without, 1)
        self.trials: list[RunRecord | None] = []
        """One a value; None where the engine refused the options."""
        self.points: list[Point] = []
        for value in parameter.values:
            count.start(f"{trials.mechanism.name}: {name} {parameter.preset} {parameter.name}")
            self._measure(self._fitting_step(value) if self.of_step else value)
        if parameter.name == "timestep":
            self._coarsen()

    def _coarsen(self) -> None:
        """Add coarser levels while too few errors exceed the reference's uncertainty.

        A high order is at rounding with every step that a low one is measured at.
        """
        for value in _COARSER:
            coarsest = self.points[0].position
            above = sum(
                (point.position or 0.0) > self.uncertainty["position"] for point in self.points
            )
            if not coarsest or above >= FEWEST:
                return
            self._measure(self._fitting_step(value))
            self.points.insert(0, self.points.pop())
            self.trials.insert(0, self.trials.pop())

    def _fitting_step(self, step: float) -> float:
        """Scale a step to this machine's time by a power of two, such that whole numbers fit."""
        solution, end = self.machine.solution, self.machine.runner.end
        events = [time for time in solution.release_times.values() if time is not None]
        size = 2.0 ** round(math.log2(self.machine.time_scale / _STEPS_TIME))
        return fitting(step * size, end, events, solution.problem.duration)

    def _measure(self, value: float) -> None:
        try:
            trial = self.trial(self.parameter.options(value), self.parameter.repeats)
            message = trial.message
        except InputError as error:
            trial, message = None, str(error)
        self.trials.append(trial)
        self.points.append(_point(value, self.parameter, trial, message, self.without))

    def engine(self, options: Mapping[str, Any]) -> Engine:
        """The engine with the options that stay, and these over them."""
        return engine(self.name, self.parameter.preset, **{**self.fixed, **options})

    def trial(self, options: Mapping[str, Any], repeats: int) -> RunRecord:
        """Run of the engine with these options."""
        return self.machine.record(self.engine(options), repeats)

    def study(self) -> SweepStudy:
        """The sweep as data, with laws and floors."""
        return SweepStudy(
            engine=self.name,
            engine_version=engine_class(self.name).version(),
            preset=self.parameter.preset,
            knob=self.parameter.name,
            title=self.parameter.title,
            unit=self.parameter.unit,
            base=self.fixed,
            settings=next((trial.settings for trial in self.trials if trial is not None), {}),
            expected=self.parameter.expected,
            why=self.parameter.why,
            own=self.without is not None,
            points=tuple(self.points),
            curves=tuple(self.curve(quantity) for quantity in self.uncertainty),
        )

    def curve(self, quantity: QuantityName) -> Curve:
        """Law and floor of one quantity along the sweep."""
        own = self.without is not None
        values = [point.value for point in self.points]
        errors = [point.error(quantity, own) for point in self.points]
        law = power_law(values, errors, 0.0 if own else self.uncertainty[quantity])
        if own:
            explained = self._floor_without(quantity)
        else:
            ran = [(value, error) for value, error in zip(values, errors, strict=True) if error]
            explained = self._floor_along(quantity, law, ran)
        unit = self.machine.mechanism.force_unit
        return Curve(quantity=quantity, force_unit=unit, law=law, floor=explained)

    def _floor_without(self, quantity: QuantityName) -> Floor | None:
        """Find what sets the error that is left with the parameter's own error taken out."""
        left = None if self.without is None else _whole(self.without, quantity)
        if left is None:
            return None
        return self.floor(self.parameter.without or {}, quantity, (None, left))

    def _floor_along(
        self, quantity: QuantityName, law: PowerLaw | None, ran: Sequence[tuple[float, float]]
    ) -> Floor | None:
        """Find what sets the least error, unless it still falls at the finest value."""
        # The law's finest point is one of these: beyond it errors may only grow.
        beyond = ran if law is None else ran[_finest(law, [value for value, _ in ran]) :]
        if len(beyond) < (1 if law is None else 2) or _still_falls(ran):
            return None
        at = beyond[-1] if law is None else min(beyond, key=lambda point: point[1])
        return self.floor(
            self.parameter.options(at[0]), quantity, at, beyond[beyond.index(at) + 1 :]
        )

    def floor(
        self,
        options: Mapping[str, Any],
        quantity: QuantityName,
        at: tuple[float | None, float],
        finer: Sequence[tuple[float, float]] = (),
    ) -> Floor:
        """Find what sets an error by changing other options there."""

        def measure(change: Mapping[str, Any]) -> float | None:
            return _whole(self.trial({**options, **change}, 1), quantity)

        value, error = at
        site = Site(
            engine=self.name,
            settings=self.engine(options).settings,
            swept=tuple(self.parameter.options(self.parameter.values[0])),
            error=error,
            value=value,
            measure=measure,
            constraints=ConstraintKinds.of(self.machine.mechanism),
        )
        return floor(site, self.uncertainty[quantity], finer)

    def limit(self) -> Extrapolated | None:
        """Limit of a sweep of the time step with the preset's other options."""
        if not self.of_step or self.parameter.base:
            return None
        return limit(
            [
                Level(point.value, trial.curves.position, _torques(trial.curves))
                for point, trial in zip(self.points, self.trials, strict=True)
                if trial is not None and trial.curves is not None
            ]
        )


def _finest(law: PowerLaw, values: Sequence[float]) -> int:
    """Index of a law's finest value among those of a study, which go from coarse to fine."""
    end = law.low if values[0] > values[-1] else law.high
    return min(range(len(values)), key=lambda i: abs(values[i] / end - 1.0))


def _still_falls(ran: Sequence[tuple[float, float]]) -> bool:
    """Whether the error still falls at the finest values, with an order of 0.5 or more."""
    if len(ran) < 2 or ran[-1][1] > min(error for _, error in ran):
        return False
    (before, larger), (last, smaller) = ran[-2:]
    return np.log(larger / smaller) >= 0.5 * abs(np.log(before / last))


def _whole(trial: RunRecord, quantity: QuantityName) -> float | None:
    return trial.position if quantity == "position" else trial.torque


def _position(trial: RunRecord) -> float | None:
    """Largest error at any sample or at the end [m].

    The end lies between two samples of a coarse step, and a growing error is largest there. What
    gives the reference back is not interpolated.
    """
    sampled = trial.position
    if not sampled or trial.curves is None:
        return sampled
    return max(sampled, float(np.linalg.norm(trial.curves.position[..., -1], axis=-1).max()))


def _point(
    value: float,
    parameter: SweptParameter,
    trial: RunRecord | None,
    message: str | None,
    without: RunRecord | None,
) -> Point:
    options: dict[str, Any] = dict(parameter.options(value))
    if trial is None or trial.curves is None:
        return Point(value=value, options=options, message=message)
    base = without.curves if without is not None else None
    return Point(
        value=value,
        options=options,
        position=_position(trial),
        torque=trial.torque,
        own_position=None if base is None else largest(trial.curves.position - base.position),
        own_torque=None if base is None else _largest(_torques(trial.curves) - _torques(base)),
        steps=trial.steps,
        wall_times=trial.wall_times,
    )


def _torques(deviation: Curves) -> FloatArray:
    """Shape (number of stops, n)."""
    return np.array([deviation.torques[name] for name in sorted(deviation.torques)])


def _largest(torques: FloatArray) -> float | None:
    return float(np.abs(torques).max()) if torques.size else None


def _limit_row(label: str, limit: Extrapolated) -> RichardsonLimit:
    name, preset = label.rsplit(" ", 1)
    return RichardsonLimit(
        engine=name,
        preset=preset,
        levels=limit.levels,
        order=limit.order,
        power=limit.power,
        position=largest(limit.position),
        position_three=largest(limit.position_three),
        estimate=limit.estimate,
        torque=_largest(limit.torques),
    )


def _pairs(limits: dict[str, Extrapolated]) -> list[LimitPair]:
    return [
        LimitPair(first=a, second=b, position=largest(limits[a].position - limits[b].position))
        for a, b in combinations(limits, 2)
    ]
