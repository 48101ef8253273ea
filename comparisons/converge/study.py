"""Convergence of engines on a machine: parameters swept, orders fitted, floors explained, limits extrapolated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_names, engine_study, options_for
from ...engines.study import ConstraintKinds, StepOrder, SweptParameter
from ...models.arrays import FloatArray
from ...models.errors import InputError, SimulationError
from ..runs.study import Counter, Study, all_in_order
from ..runs.trials import Deviation, Trial, Trials, trials_of
from .floor import Site, floor
from .orders import FEWEST, Extrapolated, Level, fitting, largest, limit, power_law
from .results import (
    Curve,
    Floor,
    Limit,
    LimitPair,
    MachineStudies,
    Point,
    PowerLaw,
    QuantityName,
    Studies,
)
from .results import Study as ParameterStudy

_METRICS: Mapping[QuantityName, str] = {"position": "position_max", "torque": "stop_torque_max"}
_STEPS = tuple(1e-2 / 2**k for k in range(8))  # 1e-2 to 7.8e-5 s: two decades and a little
_STOCK_STEPS = _STEPS[:6]  # down to 3e-4 s: finer ones are no newcomer's, and cost the most
_STEPS_TIME = (
    1.36  # [s] characteristic time of machines with these steps, the mean of the named ones
)
_COARSER = tuple(
    _STEPS[0] * 2 ** (k / 2) for k in range(1, 9)
)  # to 0.16 s, an eighth of the time below
_UNKNOWN = StepOrder(None, "the order of a plug-in is not known beforehand")


def converge(study: Study, chosen: Sequence[str] | None = None) -> Studies:
    """Carry out the studies.

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
        moved, failures = trials_of(study, worker)
        known = dict(_uncertainties(moved, failures))
        swept = [
            (each, name, parameter)
            for each in moved
            if each.mechanism.name in known
            for name, parameter in plan
        ]

        def sweep(
            trials: Trials, name: str, parameter: SweptParameter
        ) -> tuple[str, ParameterStudy, Extrapolated | None]:
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
    moved: Iterable[Trials], failures: dict[str, str]
) -> Iterator[tuple[str, dict[QuantityName, float]]]:
    """Of each machine's reference, by the machine's name; notes where that failed."""
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
        name="timestep", title="time step h", unit="s", options=lambda h: {"timestep": h},
        values=_STEPS if preset == "tuned" else _STOCK_STEPS, expected=expected.order, why=expected.reason,
        preset=preset, repeats=3,
    )  # fmt: skip


def parameter_names() -> tuple[str, ...]:
    """What `--knobs` can ask for."""
    own = [
        parameter.name
        for name in engine_names()
        for parameter in engine_study(name).swept_parameters
    ]
    return tuple(dict.fromkeys(["timestep", *own]))


def swept_parameters(name: str, names: list[str] | None = None) -> list[SweptParameter]:
    """Every swept parameter of an engine, or those asked for, without those whose options its version does not have.

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
            f"none of the engines {', '.join(names)} has any of the knobs {', '.join(chosen or ())}."
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
                f"option {option} of {name} is what its knob {parameter.name!r} turns; leave the option out, or choose "
                "other knobs."
            )
    if own:
        engine(name, parameter.preset, **{**parameter.base, **own})


def _machine(
    trials: Trials,
    uncertainty: dict[QuantityName, float],
    swept: Sequence[tuple[ParameterStudy, Extrapolated | None]],
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
        trials: Trials,
        uncertainty: dict[QuantityName, float],
        name: str,
        parameter: SweptParameter,
        count: Counter,
        own: Mapping[str, Any],
    ) -> None:
        self.machine, self.uncertainty, self.name, self.parameter = (
            trials,
            uncertainty,
            name,
            parameter,
        )
        self.fixed = {**parameter.base, **own}
        """Options that stay as they are, the user's own among them."""
        self.of_step = "timestep" in parameter.options(parameter.values[0])
        self.without = None if parameter.without is None else self.trial(parameter.without, 1)
        self.trials: list[Trial | None] = []
        """One a value; None where the engine refused the options."""
        self.points: list[Point] = []
        for value in parameter.values:
            count.start(f"{trials.mechanism.name}: {name} {parameter.preset} {parameter.name}")
            self._measure(self._fitting_step(value) if self.of_step else value)
        if parameter.name == "timestep":
            self._coarsen()

    def _coarsen(self) -> None:
        """Go on at the coarse end while too few errors stand above the reference's uncertainty to show an order.

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
        """A step scaled to this machine's time by a power of two, and such that whole numbers fit."""
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
        """With the options that stay, and these over them."""
        return engine(self.name, self.parameter.preset, **{**self.fixed, **options})

    def trial(self, options: Mapping[str, Any], repeats: int) -> Trial:
        """Of the engine with these options."""
        return self.machine.trial(self.engine(options), repeats)

    def study(self) -> ParameterStudy:
        """As data, with laws and floors."""
        return ParameterStudy(
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
        errors = [point.error(quantity, own) for point in self.points]
        law = power_law(
            [point.value for point in self.points],
            errors,
            0.0 if own else self.uncertainty[quantity],
        )
        ran = [
            (point.value, error) for point, error in zip(self.points, errors, strict=True) if error
        ]
        explained = (
            self._floor_along(quantity, law, ran)
            if self.without is None
            else self._floor_without(quantity)
        )
        unit = self.machine.mechanism.force_unit
        return Curve(quantity=quantity, force_unit=unit, law=law, floor=explained)

    def _floor_without(self, quantity: QuantityName) -> Floor | None:
        """What sets the error that is left with the parameter's own error taken out."""
        left = None if self.without is None else _whole(self.without, quantity)
        return (
            None
            if left is None
            else self.floor(self.parameter.without or {}, quantity, (None, left))
        )

    def _floor_along(
        self, quantity: QuantityName, law: PowerLaw | None, ran: Sequence[tuple[float, float]]
    ) -> Floor | None:
        """What sets the least error, unless it still falls at the finest value."""
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
        """What sets an error, found by changing other options there."""

        def measure(change: Mapping[str, Any]) -> float | None:
            return _whole(self.trial({**options, **change}, 1), quantity)

        value, error = at
        swept, constraints = (
            tuple(self.parameter.options(self.parameter.values[0])),
            ConstraintKinds.of(self.machine.mechanism),
        )
        site = Site(
            self.name, self.engine(options).settings, swept, error, value, measure, constraints
        )
        return floor(site, self.uncertainty[quantity], finer)

    def limit(self) -> Extrapolated | None:
        """Of a sweep of the time step with the preset's other options."""
        if not self.of_step or self.parameter.base:
            return None
        return limit(
            [
                Level(point.value, trial.deviation.position, _torques(trial.deviation))
                for point, trial in zip(self.points, self.trials, strict=True)
                if trial is not None and trial.deviation is not None
            ]
        )


def _finest(law: PowerLaw, values: Sequence[float]) -> int:
    """Index of a law's finest value among those of a study, which go from coarse to fine."""
    end = law.low if values[0] > values[-1] else law.high
    return min(range(len(values)), key=lambda i: abs(values[i] / end - 1.0))


def _still_falls(ran: Sequence[tuple[float, float]]) -> bool:
    """Whether the error goes on falling at the finest values, with half a power or more: then there is no floor yet."""
    if len(ran) < 2 or ran[-1][1] > min(error for _, error in ran):
        return False
    (before, larger), (last, smaller) = ran[-2:]
    return np.log(larger / smaller) >= 0.5 * abs(np.log(before / last))


def _whole(trial: Trial, quantity: QuantityName) -> float | None:
    return trial.position if quantity == "position" else trial.torque


def _position(trial: Trial) -> float | None:
    """Largest error at any sample or at the end [m].

    The end lies between two samples of a coarse step, and a growing error is largest there. What
    gives the reference back is not interpolated.
    """
    sampled = trial.position
    if not sampled or trial.deviation is None:
        return sampled
    return max(sampled, float(np.linalg.norm(trial.deviation.position[..., -1], axis=-1).max()))


def _point(
    value: float,
    parameter: SweptParameter,
    trial: Trial | None,
    message: str | None,
    without: Trial | None,
) -> Point:
    options: dict[str, Any] = dict(parameter.options(value))
    if trial is None or trial.deviation is None:
        return Point(value=value, options=options, message=message)
    base = without.deviation if without is not None else None
    return Point(
        value=value,
        options=options,
        position=_position(trial),
        torque=trial.torque,
        own_position=None if base is None else largest(trial.deviation.position - base.position),
        own_torque=None if base is None else _largest(_torques(trial.deviation) - _torques(base)),
        steps=trial.steps,
        wall_times=trial.wall_times,
    )


def _torques(deviation: Deviation) -> FloatArray:
    """Shape (number of stops, n)."""
    return np.array([deviation.torques[name] for name in sorted(deviation.torques)])


def _largest(torques: FloatArray) -> float | None:
    return float(np.abs(torques).max()) if torques.size else None


def _limit_row(label: str, limit: Extrapolated) -> Limit:
    name, preset = label.rsplit(" ", 1)
    return Limit(
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
