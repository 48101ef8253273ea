r"""Error budgets: causes taken out one after the other, and the error split among them.

Causes interact: pymunk's bias lets joints drift by an amount that falls with the step, so that
taking out either takes out the same error. What a cause contributes then depends on what has been
taken out before it. The value of Shapley (A value for n-person games, 1953) is the mean of that
contribution over all orders; it is the only split that adds up to the whole and treats causes
alike. Here two orders are taken, one the other's reverse: they already add up, and as long as
causes interact in pairs they give Shapley's value exactly,

    v(S) = sum_i a_i + sum_{i<j} b_ij:  in order  a_i + sum_{j before i} b_ij,  in reverse  a_i +
    sum_{j after i} b_ij, their mean  a_i + 1/2 sum_j b_ij.

Where some causes can only be taken out after others, the orders are those that keep to it (Faigle
and Kern, The Shapley value for cooperative games under precedence constraints, 1992). Half the
difference of the two orders is shown with each share: the part of it that is a matter of order.

Stock against tuned shows what each single option buys, from either end.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Unpack

import numpy as np
from pydantic import JsonValue

from ...engines.given import Engines, Names
from ...engines.protocol import Capabilities, Engine
from ...engines.registry import causes_of, with_options
from ...engines.study import Cause, Intervention
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import Kinematics
from ...models.library.registry import Models
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import PointMotion, Trajectory
from ..runs.process import all_in_order
from ..runs.record import Curves, EngineRuns, RunRecord, runs_of
from ..runs.study import PRESETS, Counter, RunOptions, Study
from .results import (
    Budget,
    Change,
    ExplainedMachine,
    Explanation,
    Figures,
    Measurement,
    QuantityBudget,
    Share,
    StockAgainstTuned,
)

LAST_BITS = 1e-15
"""Relative change of gravity (without it, of the start speeds), a few units in the last place: what
it does to a run is
roundoff."""
_SHAPIRO = np.array([-1.0, 4.0, 10.0, 4.0, -1.0]) / 16.0
_EVEN = 1e-6  # relative difference of steps that are meant to be equal: rounding of the times


@dataclasses.dataclass(frozen=True)
class Reread:
    """An engine whose runs are read otherwise."""

    engine: Engine
    own_kinematics: bool
    """Markers and energies are taken from its coordinates by the machine's kinematics."""
    filtered_torques: bool
    """Torques are rid of what changes sign with every step."""

    @property
    def name(self) -> str:
        """Name of the engine."""
        return self.engine.name

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the engine."""
        return self.engine.capabilities

    @property
    def timestep(self) -> float | None:
        """Time step of the engine [s]."""
        return self.engine.timestep

    @property
    def preset(self) -> str:
        """Preset of the engine."""
        return self.engine.preset

    @property
    def settings(self) -> dict[str, JsonValue]:
        """The engine's options and how it is read: what a trial is remembered by."""
        ways: dict[str, JsonValue] = {
            "own_kinematics": self.own_kinematics,
            "filtered_torques": self.filtered_torques,
        }
        return {**self.engine.settings, **ways}

    def simulate(self, problem: Problem) -> Trajectory:
        """Simulate as the engine does, and read the result otherwise."""
        trajectory = self.engine.simulate(problem)
        if self.own_kinematics:
            trajectory = by_kinematics(trajectory)
        return with_filtered_torques(trajectory) if self.filtered_torques else trajectory


def by_kinematics(trajectory: Trajectory) -> Trajectory:
    """The same motion, its markers and energies computed from q and u."""
    kinematics, q, u = Kinematics(trajectory.mechanism), trajectory.q, trajectory.u
    rows = {m.name: kinematics.point(m.body, m.point) for m in trajectory.mechanism.markers}
    return dataclasses.replace(
        trajectory,
        markers={
            name: PointMotion(kinematics.position(row, q), kinematics.velocity(row, q, u))
            for name, row in rows.items()
        },
        kinetic_energy=kinematics.kinetic_energy(q, u),
        potential_energy=kinematics.potential_energy(q),
    )


def with_filtered_torques(trajectory: Trajectory) -> Trajectory:
    """The same motion, its torques rid of what alternates from sample to sample.

    By the filter of fourth order of Shapiro (Smoothing, filtering, and boundary effects, 1970),
    (-1, 4, 10, 4, -1)/16, which leaves every cubic as it is. Samples stay as they are where the
    five are not equally spaced, or a stop releases among them.
    """
    t = trajectory.t
    if len(t) < len(_SHAPIRO):
        return trajectory
    spans = np.lib.stride_tricks.sliding_window_view(np.diff(t), len(_SHAPIRO) - 1)
    even = spans.max(axis=1) - spans.min(axis=1) <= _EVEN * spans.max(axis=1)
    for time in trajectory.release_times.values():
        if time is not None and time > 0:
            even &= (time < t[:-4]) | (time > t[4:])
    inside = np.flatnonzero(even) + 2
    torques: dict[str, FloatArray] = {}
    for name, torque in trajectory.stop_torques.items():
        filtered = torque.copy()
        filtered[inside] = np.convolve(torque, _SHAPIRO, mode="same")[inside]
        torques[name] = filtered
    return dataclasses.replace(trajectory, stop_torques=torques)


def varied(
    trials: EngineRuns, base: Engine, done: Sequence[Intervention], last_bits: int = 0
) -> RunRecord:
    """The trial of a base with some interventions made, the later ones over the earlier ones.

    Args:
        trials: of one machine.
        base: the run that is explained.
        done: interventions.
        last_bits: +1 or -1 changes gravity, or without it the start speeds, by as many
            :data:`LAST_BITS`.

    Raises:
        InputError: an option of an intervention is not valid.
    """
    options: dict[str, JsonValue] = {}
    for intervention in done:
        options |= intervention.options
    engine = with_options(base, options)
    kinematics = any(intervention.own_kinematics for intervention in done)
    filtered = any(intervention.filtered_torques for intervention in done)
    if kinematics or filtered:
        engine = Reread(engine, kinematics, filtered)
    given = _given(trials.mechanism, done, last_bits)
    return trials.record(engine, given=None if given == trials.mechanism else given)


def _given(mechanism: Mechanism, done: Sequence[Intervention], last_bits: int) -> Mechanism:
    changes: dict[str, object] = {}
    factor = 1.0 + last_bits * LAST_BITS
    if last_bits and mechanism.gravity:
        changes["gravity"] = mechanism.gravity * factor
    elif last_bits:
        changes["start_speeds"] = tuple(speed * factor for speed in mechanism.start_speeds)
    for intervention in done:
        if intervention.point_inertia is not None:
            given = {"inertia": intervention.point_inertia}
            changes["bodies"] = tuple(
                body if body.inertia else body.model_copy(update=given) for body in mechanism.bodies
            )
    return mechanism.model_copy(update=changes)


_ROUNDOFF = "roundoff"


class VariantFailedError(Exception):
    """A run with causes taken out ended early, or with other events than the base run."""

    def __init__(self, cause: str, reason: str) -> None:
        super().__init__(reason)
        self.cause = cause


def budget(trials: EngineRuns, engine: Engine) -> Budget:
    """Split an engine's error on one machine among its causes.

    Each removal is a run. A cause whose run fails is left out and says so: its part stays
    unexplained.
    """
    base = varied(trials, engine, [])
    empty = Budget(
        model=trials.mechanism.name,
        engine=engine.name,
        engine_version=base.engine_version,
        preset=base.preset,
        settings=engine.settings,
        message=base.message,
    )
    if base.curves is None:
        return empty
    point = base.curves.farthest
    study = _Study(trials, engine, base.curves.of_point(point))
    known = causes_of(engine, trials.mechanism)
    chains = study.chains([cause for cause in known if cause.removal is not None])
    alone = study.scaled([cause for cause in known if cause.scaling is not None])
    quantities = study.quantities(chains, alone)
    measured = [_measurement(cause, engine, study.failed.get(cause.name)) for cause in known]
    causes = (*measured, _roundoff(study))
    return empty.model_copy(update={"point": point, "causes": causes, "quantities": quantities})


def _measurement(cause: Cause, engine: Engine, failure: str | None) -> Measurement:
    settings = engine.settings
    ways = [way.described(settings) for way in (cause.removal, cause.scaling) if way is not None]
    return Measurement(
        name=cause.name,
        explanation=cause.explanation,
        done="; or ".join(ways),
        after=cause.after,
        message=failure,
    )


def _roundoff(study: _Study) -> Measurement:
    return Measurement(
        name=_ROUNDOFF,
        explanation="the random part: what changes when the machine's data change in their last "
        "bits",
        done=f"{'gravity' if study.trials.mechanism.gravity else 'start speeds'} changed by "
        f"±{LAST_BITS:g} of itself",
        message=study.failed.get(_ROUNDOFF),
    )


@dataclass
class _Chain:
    """Deviations with more and more causes taken out: one more than there are causes."""

    causes: tuple[Cause, ...]
    deviations: list[Curves]

    def part(self, cause: str, quantity: str) -> FloatArray:
        """Change from taking out one more cause, extrapolated where a known part of it remains."""
        i = next(i for i, known in enumerate(self.causes) if known.name == cause)
        removal = self.causes[i].removal
        assert removal is not None
        before, after = (observed(d)[quantity].values for d in self.deviations[i : i + 2])
        return (before - after) / (1.0 - removal.leaves)


@dataclass
class _Study:
    trials: EngineRuns
    engine: Engine
    base: Curves
    failed: dict[str, str] = field(default_factory=dict[str, str])

    def chains(self, causes: Sequence[Cause]) -> tuple[_Chain, _Chain]:
        """Both orders of removal, without the causes whose runs fail in either."""
        while True:
            left = [cause for cause in causes if cause.name not in self.failed]
            try:
                first, second = (_Chain(order, self._along(order)) for order in orders(left))
            except VariantFailedError as failure:
                self.failed[failure.cause] = str(failure)
            else:
                return first, second

    def _along(self, order: Sequence[Cause]) -> list[Curves]:
        deviations = [self.base]
        for n, cause in enumerate(order, start=1):
            # Merged in the table's order whatever the order of removal: the same causes are the
            # same run.
            deviations.append(self._deviation(self._removals(order[:n]), cause.name))
        return deviations

    def _removals(self, causes: Sequence[Cause]) -> list[Intervention]:
        names = {cause.name for cause in causes}
        table = orders(causes_of(self.engine, self.trials.mechanism))[0]
        return [c.removal for c in table if c.name in names and c.removal is not None]

    def _deviation(self, done: Sequence[Intervention], cause: str, last_bits: int = 0) -> Curves:
        try:
            trial: RunRecord = varied(self.trials, self.engine, done, last_bits)
        except InputError as error:
            raise VariantFailedError(cause, str(error)) from error
        if trial.curves is None:
            raise VariantFailedError(cause, trial.message or "it did not run")
        return trial.curves.of_point(self.base.farthest)

    def scaled(self, causes: Sequence[Cause]) -> dict[str, tuple[Curves, float]]:
        """Deviations with one cause made larger, and by what factor."""
        deviations: dict[str, tuple[Curves, float]] = {}
        for cause in causes:
            assert cause.scaling is not None
            try:
                deviations[cause.name] = (
                    self._deviation([cause.scaling], cause.name),
                    cause.scaling.leaves,
                )
            except VariantFailedError as failure:
                if cause.removal is None:  # with a removal, this is the second measure only
                    self.failed[cause.name] = str(failure)
        return deviations

    def quantities(
        self, chains: tuple[_Chain, _Chain], alone: dict[str, tuple[Curves, float]]
    ) -> tuple[QuantityBudget, ...]:
        """The budget of every quantity that all these runs tell."""
        ideal = chains[0].deviations[-1]
        runs = [
            *chains[0].deviations,
            *chains[1].deviations,
            *(deviation for deviation, _ in alone.values()),
        ]
        near = self._last_bits([], (1, -1)), self._last_bits(self._removals(chains[0].causes), (1,))
        quantities: list[QuantityBudget] = []
        for name, whole in observed(self.base).items():
            if not all(name in observed(run) for run in runs):
                continue
            parts = {
                cause.name: self._part(cause, name, chains, alone) for cause in chains[0].causes
            }
            for cause in alone.keys() - parts.keys():
                only = self._extrapolated(name, *alone[cause])
                parts[cause] = TwoWayShare.of(only, only)
            noise = _noise(name, whole, self.base, near[0])
            # What is left is the ideal run, extrapolated with the base where a removal leaves a
            # known part.
            weight = 1.0 + sum(_extrapolation(cause) for cause in chains[0].causes)
            left = math.hypot(weight * _noise(name, whole, ideal, near[1]), (weight - 1.0) * noise)
            quantities.append(split(name, whole, parts, noise, left))
        return tuple(quantities)

    def _part(
        self,
        cause: Cause,
        quantity: str,
        chains: tuple[_Chain, _Chain],
        alone: dict[str, tuple[Curves, float]],
    ) -> TwoWayShare:
        first, second = (chain.part(cause.name, quantity) for chain in chains)
        if cause.name not in alone:
            return TwoWayShare.of(first, second)
        # Shares of removals add up: scaling, an independent measure, is shown beside them and makes
        # the band.
        mean = (first + second) / 2
        return TwoWayShare(mean, mean, self._extrapolated(quantity, *alone[cause.name]))

    def _extrapolated(self, quantity: str, larger: Curves, factor: float) -> FloatArray:
        return (observed(larger)[quantity].values - observed(self.base)[quantity].values) / (
            factor - 1.0
        )

    def _last_bits(self, done: Sequence[Intervention], signs: Sequence[int]) -> list[Curves]:
        deviations: list[Curves] = []
        for sign in signs:
            try:
                deviations.append(self._deviation(done, _ROUNDOFF, sign))
            except VariantFailedError as failure:
                self.failed[_ROUNDOFF] = str(failure)
        return deviations


def _noise(quantity: str, whole: Observed, run: Curves, near: Sequence[Curves]) -> float:
    nearby = [observed(deviation) for deviation in near]
    return noise_between(
        observed(run)[quantity].values, [t[quantity].values for t in nearby if quantity in t], whole
    )


def _extrapolation(cause: Cause) -> float:
    """Weight of the ideal run's own error in what is added for the part that a removal leaves."""
    leaves = cause.removal.leaves if cause.removal else 0.0
    return leaves / (1.0 - leaves)


@dataclass(frozen=True)
class TwoWayShare:
    """A cause's contribution to one quantity, as functions of time."""

    share: FloatArray
    first: FloatArray
    """Found one way: in the order of the table."""
    second: FloatArray
    """Found the other way: in the reverse order, or by scaling."""

    @classmethod
    def of(cls, first: FloatArray, second: FloatArray) -> TwoWayShare:
        """The mean of two ways."""
        return cls((first + second) / 2, first, second)


@dataclass(frozen=True)
class Observed:
    """Error of one quantity, from a deviation."""

    unit: str
    values: FloatArray
    components: int = 1
    """Whether it is a vector: its values are all x, then all y."""

    def size(self, values: FloatArray) -> tuple[float, float]:
        """Root mean square over time and largest value of a function, Euclidean over components."""
        lengths = np.linalg.norm(values.reshape(self.components, -1), axis=0)
        return float(np.sqrt(np.mean(lengths**2))), float(lengths.max())


def observed(deviation: Curves) -> dict[str, Observed]:
    """Every quantity a budget is made for, by its name; what the run does not tell is absent."""
    position = np.array(deviation.positions[deviation.farthest]).ravel()
    quantities = {"position": Observed("m", position, components=2)}
    for stop, torque in deviation.torques.items():
        unit = deviation.force_units.get(stop, "N m")
        quantities[f"{stop} {'torque' if unit == 'N m' else 'force'}"] = Observed(
            unit, np.array(torque)
        )
    quantities["energy"] = Observed("J", np.array(deviation.energy))
    for stop, time in deviation.release_times.items():
        quantities[f"{stop} release"] = Observed("s", _single(time))
    quantities["launch time"] = Observed("s", _single(deviation.launch_time))
    quantities["launch speed"] = Observed("m/s", _single(deviation.launch_speed))
    return {
        name: quantity
        for name, quantity in quantities.items()
        if np.isfinite(quantity.values).all()
    }


def _single(value: float | None) -> FloatArray:
    return np.array([math.nan if value is None else value])


def orders(causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """Make both orders of taking out causes: the given one, and its reverse as `after` allows.

    Causes an `after` names that are not among these are taken for absent.
    """
    return _ordered(causes), _ordered(causes[::-1])


def _ordered(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    names = {cause.name for cause in causes}
    left, done = list(causes), list[Cause]()
    while left:
        gone = {cause.name for cause in done}
        ready = next(
            (c for c in left if all(a in gone or a not in names for a in c.after)), left[0]
        )
        done.append(ready)
        left.remove(ready)
    return tuple(done)


def split(
    name: str, whole: Observed, parts: Mapping[str, TwoWayShare], noise: float, noise_left: float
) -> QuantityBudget:
    """The budget of one quantity.

    Args:
        name: of the quantity.
        whole: the run's error.
        parts: contributions by cause.
        noise: roundoff in the run, root mean square in the quantity's unit.
        noise_left: roundoff in the run with every cause taken out. It is random: it enters the
            rest's size, not the rest as a function, and is taken from it in quadrature.
    """
    e = whole.values
    rest = e - np.sum([part.share for part in parts.values()], axis=0) if parts else e
    rms, largest = whole.size(e)
    rest_rms, rest_largest = whole.size(rest)
    unexplained = math.sqrt(max(0.0, rest_rms**2 - noise_left**2))
    return QuantityBudget(
        name=name,
        unit=whole.unit,
        rms=rms,
        largest=largest,
        shares=tuple(_share(cause, part, whole) for cause, part in parts.items()),
        rest=_share("unexplained", TwoWayShare.of(rest, rest), whole),
        rest_rms=rest_rms,
        rest_largest=rest_largest,
        roundoff=noise,
        roundoff_left=noise_left,
        explained=1.0 - unexplained / rms if rms else None,
    )


def _share(cause: str, part: TwoWayShare, whole: Observed) -> Share:
    rms, largest = whole.size(part.share)
    return Share(
        cause=cause,
        fraction=_fraction(part.share, whole.values),
        first=_fraction(part.first, whole.values),
        second=_fraction(part.second, whole.values),
        rms=rms,
        largest=largest,
        interaction=whole.size((part.first - part.second) / 2)[0],
    )


def _fraction(part: FloatArray, whole: FloatArray) -> float | None:
    """Signed share of the whole, its projection on it; all shares and the rest add up to one."""
    square = float(whole @ whole)
    return float(part @ whole) / square if square else None


def noise_between(base: FloatArray, others: Sequence[FloatArray], whole: Observed) -> float:
    """Size of the random part of a run [rms], from runs that differ in their last bits only.

    The difference of two such runs has twice the variance of one.
    """
    squares = [whole.size(other - base)[0] ** 2 / 2 for other in others]
    return math.sqrt(sum(squares) / len(squares)) if squares else 0.0


def explain(
    models: Models = ("fixed", "rolling"),
    engines: Engines | None = None,
    presets: Names | None = None,
    **how: Unpack[RunOptions],
) -> Explanation:
    """Split each engine's error among its causes, each measured by a run without it.

        >>> import trebucheck as tb
        >>> budget = tb.explain("fixed", "mujoco", "stock")  # doctest: +SKIP
        >>> budget.to_dataframe()[["cause", "fraction"]]  # doctest: +SKIP

    Args:
        models: one or several: names of machines or of the library's problems, paths of mechanisms'
            .json files, mechanisms, or problems.
        engines: one or several: names, or engines as `tb.engine` makes them; all but the reference
            if left out.
        presets: for which a budget is made: 'tuned', 'stock', or both; both if left out, or those
            of the engines given.
        how: runs are made; see :class:`..runs.study.RunOptions`.

    Raises:
        InputError: a name or value is not valid. A run that fails becomes a budget without shares.
    """
    return explain_study(Study.of(models, engines, presets, **how))


def explain_study(study: Study) -> Explanation:
    """Measure the budgets of a study; see :func:`explain`.

    Args:
        study: mechanisms, engines (all known ones but the reference if None), presets for which a
            budget is made, how engines are run, and the end of the compared motion.

    Raises:
        InputError: a name or a value is not valid, or the end does not come. A run that fails
            raises nothing: it becomes a budget without shares, or a cause that could not be
            measured.
    """
    for preset in study.presets:
        if preset not in PRESETS:
            raise InputError(f"there is no preset {preset!r}; there are: {', '.join(PRESETS)}.")
    # The reference has a budget where it is named: its stock preset differs from the tuned one.
    names = study.measured_engines if study.engines is None else study.every_engine
    engines = {name: {preset: study.engine(name, preset) for preset in PRESETS} for name in names}
    # A part a preset, and one for the presets side by side.
    count = Counter(
        len(study.mechanisms) * len(engines) * (len(list(study.presets)) + 1), study.progress
    )
    with study.worker() as worker:
        moved, failures = runs_of(study, worker)

        def part(trials: EngineRuns, name: str, preset: str | None) -> Budget | StockAgainstTuned:
            made = engines[name]
            count.start(
                f"{trials.mechanism.name}: {name}{f' {preset}' if preset else ', option by option'}"
            )
            return (
                budget(trials, made[preset])
                if preset
                else stock_against_tuned(trials, made["stock"], made["tuned"])
            )

        wanted = list(product(moved, engines, (*study.presets, None)))
        parts = all_in_order(lambda each: part(*each), wanted, study.jobs)
    return Explanation.made_here(
        machines=tuple(map(_machine, moved)),
        budgets=tuple(each for each in parts if isinstance(each, Budget)),
        comparisons=tuple(each for each in parts if isinstance(each, StockAgainstTuned)),
        failures=failures,
        jobs=study.timed_at_once,
    )


def _machine(trials: EngineRuns) -> ExplainedMachine:
    return ExplainedMachine(
        model=trials.mechanism.name,
        mechanism=trials.mechanism,
        mechanism_hash=trials.mechanism.content_hash,
        launch_time=trials.runner.launch_time,
        compared_to=trials.runner.end,
        judged_to=trials.end,
    )


_REPEATS = 3  # timed runs of each setting, of some hundredths of a second each


def stock_against_tuned(trials: EngineRuns, stock: Engine, tuned: Engine) -> StockAgainstTuned:
    """Compare an engine's presets at the stock one's step, changing one option at a time."""
    at_stock = stock.settings
    step = at_stock.get("timestep")
    if step is not None:
        tuned = with_options(tuned, {"timestep": step})
    changes = [
        Change(
            option=name,
            stock=stock_value,
            tuned=tuned_value,
            alone=_changed(trials, stock, name, tuned_value),
            back=_changed(trials, tuned, name, stock_value),
        )
        for name, stock_value, tuned_value in _differences(at_stock, tuned.settings)
    ]
    return StockAgainstTuned(
        model=trials.mechanism.name,
        engine=stock.name,
        timestep=float(step) if isinstance(step, int | float) else None,
        force_unit=trials.mechanism.force_unit,
        stock=_measured(trials, stock),
        tuned=_measured(trials, tuned),
        changes=tuple(changes),
    )


def _differences(
    stock: dict[str, JsonValue], tuned: dict[str, JsonValue]
) -> Iterator[tuple[str, JsonValue, JsonValue]]:
    for name, value in stock.items():
        if name in tuned and tuned[name] != value:
            yield name, value, tuned[name]


def _changed(trials: EngineRuns, engine: Engine, option: str, value: JsonValue) -> Figures:
    try:
        return _measured(trials, with_options(engine, {option: value}))
    except InputError as error:
        return Figures(message=str(error))


def _measured(trials: EngineRuns, engine: Engine) -> Figures:
    return figures_of(trials.record(engine, repeats=_REPEATS))


def figures_of(trial: RunRecord) -> Figures:
    """The figures of a trial that are compared."""
    if trial.curves is None:
        return Figures(message=trial.message or "it did not run")
    late = [abs(time) for time in trial.curves.release_times.values() if time is not None]
    return Figures(
        position=trial.position,
        torque=trial.torque,
        release=max(late, default=None),
        wall_time=float(np.median(trial.wall_times)),
    )
