"""Convergence of engines on a machine: parameters swept, orders fitted, floors explained, limits extrapolated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ...engines.registry import engine, engine_class
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...reference.certification.certificate import Uncertainties, reference_uncertainty
from ..runs.deviation import Deviation
from ..runs.study import Counter, Study
from ..runs.trials import Trial, Trials
from .fit import power_law
from .floor import Site, floor
from .parameters import Knob, knobs
from .results import Curve, Floor, Limit, LimitPair, MachineStudies, Point, PowerLaw, QuantityName, Studies
from .results import Study as ParameterStudy
from .richardson import Extrapolated, Level, largest, limit
from .steps import fitting

_QUANTITIES: tuple[QuantityName, ...] = ("position", "torque")


@dataclass(frozen=True)
class _Refinement:
    """A study as it is carried out: its data, and the trials behind its points."""

    study: ParameterStudy
    knob: Knob
    trials: tuple[Trial | None, ...]
    """None where the engine refused the options."""


def converge(study: Study, chosen: Sequence[str] | None = None) -> Studies:
    """Carry out the studies; each machine must launch.

    Args:
        study: mechanisms, engines (all known ones but the reference if None; those not installed are listed as
            absent), and how they are run. Its presets and options are not used: each swept parameter has its own.
        chosen: names of swept parameters (:func:`.parameters.knob_names`); all if left out.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a failed point.
    """
    absent, plan = _plan(study.measured_engines, chosen)
    count = Counter(len(study.mechanisms) * sum(len(knob.values) for _, knob in plan), study.progress)
    machines: list[MachineStudies] = []
    with study.worker() as worker:
        for mechanism in study.mechanisms:
            machines.append(_Machine(Trials(mechanism, worker, study.store), count).studies(plan, absent))
    return Studies.made_here(machines=tuple(machines))


_Plan = list[tuple[str, Knob]]


def _plan(names: Sequence[str], chosen: Sequence[str] | None) -> tuple[list[str], _Plan]:
    """Engines that are not installed, and every parameter to be swept of those that are."""
    every = [(name, knob) for name in names for knob in knobs(name, list(chosen) if chosen else None)]
    if not every:
        raise InputError(f"none of the engines {', '.join(names)} has any of the knobs {', '.join(chosen or ())}.")
    absent = [name for name in names if not engine_class(name).is_installed()]
    return absent, [(name, knob) for name, knob in every if name not in absent]


class _Machine:
    """One machine and its trials."""

    def __init__(self, trials: Trials, count: Counter) -> None:
        self.trials, self.count = trials, count
        self.events = [time for time in trials.solution.release_times.values() if time is not None]
        self.known = reference_uncertainty(trials.solution, trials.end)
        self.uncertainty: dict[QuantityName, float] = {
            quantity: _uncertainty(self.known, quantity) for quantity in _QUANTITIES
        }

    def studies(self, plan: _Plan, absent: list[str]) -> MachineStudies:
        """All of the plan, and the limits that follow from it."""
        refined = [self.refined(name, knob) for name, knob in plan]
        limits = {one.study.label: made for one in refined if (made := _limit(one)) is not None}
        mechanism = self.trials.mechanism
        return MachineStudies(
            model=mechanism.name,
            mechanism=mechanism,
            mechanism_hash=mechanism.content_hash,
            launch_time=self.trials.end,
            uncertainty=self.uncertainty,
            uncertainty_source=self.known.source,
            studies=tuple(one.study for one in refined),
            limits=tuple(_described(label, made) for label, made in limits.items()),
            pairs=tuple(_pairs(limits)),
            absent=tuple(absent),
        )

    def refined(self, name: str, knob: Knob) -> _Refinement:
        """Turn one knob through its values."""
        values = [self.fitted(knob, value) for value in knob.values]
        without = None if knob.without is None else self.trial(name, knob, knob.without, 1)
        trials: list[Trial | None] = []
        points: list[Point] = []
        for value in values:
            self.count.start(f"{self.trials.mechanism.name}: {name} {knob.preset} {knob.name}")
            trial, message = self.tried(name, knob, value)
            trials.append(trial)
            points.append(_point(value, knob, trial, message, without))
        study = ParameterStudy(
            engine=name,
            engine_version=engine_class(name).version(),
            preset=knob.preset,
            knob=knob.name,
            title=knob.title,
            unit=knob.unit,
            base=dict(knob.base),
            settings=next((trial.settings for trial in trials if trial is not None), {}),
            expected=knob.expected,
            why=knob.why,
            own=knob.without is not None,
            points=tuple(points),
            curves=tuple(self.curve(name, knob, points, without, quantity) for quantity in _QUANTITIES),
        )
        return _Refinement(study, knob, tuple(trials))

    def fitted(self, knob: Knob, value: float) -> float:
        """The value itself; a time step near it that fits the throw."""
        return fitting(value, self.trials.end, self.events) if _turns_the_step(knob) else value

    def trial(self, name: str, knob: Knob, options: Any, repeats: int) -> Trial:
        """With the knob's base and these options over it."""
        made = engine(name, knob.preset, **{**knob.base, **options})
        return self.trials.trial(made, repeats)

    def tried(self, name: str, knob: Knob, value: float) -> tuple[Trial | None, str | None]:
        """A trial, or why there is none."""
        try:
            trial = self.trial(name, knob, knob.options(value), knob.repeats)
        except InputError as error:
            return None, str(error)
        return trial, trial.message

    def curve(
        self, name: str, knob: Knob, points: Sequence[Point], without: Trial | None, quantity: QuantityName
    ) -> Curve:
        """Law and floor of one quantity along a study."""
        own, unit = without is not None, self.trials.mechanism.force_unit
        errors = [point.error(quantity, own) for point in points]
        known = 0.0 if own else self.uncertainty[quantity]
        law = power_law([point.value for point in points], errors, known)
        if without is not None:
            rest = _whole(without, quantity)
            found = None if rest is None else self.floor(name, knob, knob.without or {}, quantity, (None, rest))
            return Curve(quantity=quantity, force_unit=unit, law=law, floor=found)
        ran = [(point.value, error) for point, error in zip(points, errors, strict=True) if error]
        # The law's finest point is one of these: beyond it errors may only grow.
        beyond = ran if law is None else ran[_finest(law, [value for value, _ in ran]) :]
        if len(beyond) < (1 if law is None else 2) or _still_falls(ran):
            return Curve(quantity=quantity, force_unit=unit, law=law, floor=None)
        at = beyond[-1] if law is None else min(beyond, key=lambda found: found[1])
        finer = beyond[beyond.index(at) + 1 :]
        return Curve(
            quantity=quantity,
            force_unit=unit,
            law=law,
            floor=self.floor(name, knob, knob.options(at[0]), quantity, at, finer),
        )

    def floor(
        self,
        name: str,
        knob: Knob,
        options: Any,
        quantity: QuantityName,
        at: tuple[float | None, float],
        finer: Sequence[tuple[float, float]] = (),
    ) -> Floor:
        """What sets an error, by turning the other knobs there."""
        made = engine(name, knob.preset, **{**knob.base, **options})

        def measure(change: dict[str, Any]) -> float | None:
            return _whole(self.trial(name, knob, {**options, **change}, 1), quantity)

        value, error = at
        site = Site(name, made.settings, tuple(knob.options(knob.values[0])), error, value, measure)
        return floor(site, self.uncertainty[quantity], finer)


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


def _turns_the_step(knob: Knob) -> bool:
    return "timestep" in knob.options(knob.values[0])


def _uncertainty(known: Uncertainties, quantity: QuantityName) -> float:
    metric = "position_max" if quantity == "position" else "stop_torque_max"
    return max((value for name, value in known.values.items() if name.startswith(metric)), default=0.0)


def _whole(trial: Trial, quantity: QuantityName) -> float | None:
    return trial.position if quantity == "position" else trial.torque


def _point(value: float, knob: Knob, trial: Trial | None, message: str | None, without: Trial | None) -> Point:
    options: dict[str, Any] = dict(knob.options(value))
    if trial is None or trial.deviation is None:
        return Point(value=value, options=options, message=message)
    base = without.deviation if without is not None else None
    return Point(
        value=value,
        options=options,
        position=trial.position,
        torque=trial.torque,
        own_position=None if base is None else largest(_position(trial.deviation) - _position(base)),
        own_torque=None if base is None else _largest(_torques(trial.deviation) - _torques(base)),
        steps=trial.steps,
        wall_times=trial.wall_times,
    )


def _position(deviation: Deviation) -> FloatArray:
    return np.array(deviation.position)


def _torques(deviation: Deviation) -> FloatArray:
    """Shape (number of stops, n)."""
    return np.array([deviation.torques[name] for name in sorted(deviation.torques)])


def _largest(torques: FloatArray) -> float | None:
    return float(np.abs(torques).max()) if torques.size else None


def _limit(refined: _Refinement) -> Extrapolated | None:
    """Of a study of the time step with the preset's other options."""
    if not _turns_the_step(refined.knob) or refined.knob.base:
        return None
    return limit(
        [
            Level(point.value, _position(trial.deviation), _torques(trial.deviation))
            for point, trial in zip(refined.study.points, refined.trials, strict=True)
            if trial is not None and trial.deviation is not None
        ]
    )


def _described(label: str, made: Extrapolated) -> Limit:
    name, preset = label.rsplit(" ", 1)
    return Limit(
        engine=name,
        preset=preset,
        levels=made.levels,
        order=made.order,
        power=made.power,
        position=largest(made.position),
        position_three=largest(made.position_three),
        estimate=made.estimate,
        torque=_largest(made.torques),
    )


def _pairs(limits: dict[str, Extrapolated]) -> list[LimitPair]:
    return [
        LimitPair(first=a, second=b, position=largest(limits[a].position - limits[b].position))
        for a, b in combinations(limits, 2)
    ]
