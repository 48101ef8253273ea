"""Error budgets: causes taken out one after the other, and the error split among them.

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

Each preset beside the next shows what every single option buys, from either end.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Annotated, Literal, NamedTuple, Unpack

import numpy as np
from pydantic import Field, JsonValue

from ..engines.protocol import Capabilities, Engine
from ..engines.registry import Engines, Names, causes_of, with_options
from ..engines.study import Cause, Intervention
from ..models.arrays import FloatArray
from ..models.errors import InputError
from ..models.kinematics import Kinematics
from ..models.library.registry import Models
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..models.shown import Reported
from ..models.spec import Real, Spec
from ..models.trajectory import PointMotion, Trajectory
from .runs.process import all_in_order
from .runs.record import Curves, EngineRuns, RunRecord, runs_of
from .runs.results import ResultFile
from .runs.study import Counter, RunOptions, Study

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

# ------------------------------------------------------------------------------ explain.json

FORMAT = "trebucheck-explain-1"

_Fraction = Real | None


class Share(Spec):
    """Contribution of one cause to one quantity's error."""

    cause: str
    fraction: _Fraction = Field(
        description="signed, of the whole error: its projection on it; None if there is none"
    )
    first: _Fraction = Field(description="the same, causes taken out in the order of the table")
    second: _Fraction = Field(description="the same in the reverse order, or by scaling")
    rms: Real = Field(description="over time, in the quantity's unit")
    largest: Real = Field(description="at any time, in the quantity's unit")
    interaction: Real = Field(
        description="rms of half the difference between first and second, in the same unit"
    )


class QuantityBudget(Spec):
    """The budget of one quantity: a function of time, or a single figure."""

    name: str
    unit: str
    rms: Real = Field(description="of the run's error over time")
    largest: Real
    shares: tuple[Share, ...]
    rest: Share = Field(description="what no cause accounts for")
    rest_rms: Real
    rest_largest: Real
    roundoff: Real = Field(
        description="random part of the run, rms, from runs that differ in their last bits"
    )
    roundoff_left: Real = Field(description="random part of what is left, rms")
    explained: _Fraction = Field(
        description="1 - rms of the rest, its random part taken off, over rms of the error"
    )


class Measurement(Spec):
    """A cause, and how it was measured."""

    name: str
    explanation: str
    done: str = Field(description="what was done to the run")
    after: tuple[str, ...] = Field(default=(), description="causes that had to be taken out before")
    message: str | None = Field(
        default=None, description="why it could not be measured; it then counts as unexplained"
    )


class Budget(Spec):
    """One engine and preset on one machine."""

    model: str
    engine: str
    engine_version: str
    preset: str
    settings: dict[str, JsonValue]
    message: str | None = Field(default=None, description="why there is none")
    point: str | None = Field(
        default=None, description="whose position is split: that with the largest error"
    )
    causes: tuple[Measurement, ...] = ()
    quantities: tuple[QuantityBudget, ...] = ()

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"

    def quantity(self, name: str) -> QuantityBudget | None:
        """A quantity's budget, if it has one."""
        return next((quantity for quantity in self.quantities if quantity.name == name), None)


class Figures(Spec):
    """Errors and cost of one setting."""

    message: str | None = Field(default=None, description="why it failed")
    position: Real | None = Field(default=None, description="largest distance of any marker [m]")
    torque: Real | None = Field(
        default=None, description="largest error of any stop's torque [N m, N]"
    )
    release: Real | None = Field(default=None, description="largest error of a release time [s]")
    wall_time: Real | None = Field(default=None, description="median, warm [s]")


class Change(Spec):
    """Gain by a single option."""

    option: str
    first: JsonValue
    second: JsonValue
    alone: Figures = Field(description="the first preset, with this one option as in the second")
    back: Figures = Field(description="the second preset, with this one option as in the first")


class PresetComparison(Spec):
    """Two presets of an engine at the step of the first."""

    model: str
    engine: str
    presets: tuple[str, str] = Field(description="names of the first and the second")
    timestep: Real | None = Field(description="of both [s]")
    force_unit: str = Field(default="N m", description="of what the machine's stops push with")
    first: Figures
    second: Figures
    changes: tuple[Change, ...]


class ExplainedMachine(Spec):
    """A machine whose runs are explained."""

    model: str
    mechanism: Mechanism
    mechanism_hash: str
    launch_time: Annotated[Real, Field(gt=0)] | None = Field(
        description="of the reference [s]; None: it does not launch within what is compared"
    )
    compared_to: Real | None = Field(
        default=None, description="end of the compared motion [s]; None: the launch"
    )
    judged_to: Real | None = Field(
        default=None, description="that, or the predictability horizon if earlier [s]"
    )


class Explanation(Reported, ResultFile):
    """The whole of it."""

    format: Literal["trebucheck-explain-1"] = FORMAT
    machines: tuple[ExplainedMachine, ...]
    failures: dict[str, str] = Field(
        default_factory=dict, description="machines whose reference failed, and why"
    )
    budgets: tuple[Budget, ...]
    comparisons: tuple[PresetComparison, ...]

    def headline(self) -> str:
        """Names the runs that have a budget."""
        runs = ", ".join(f"{budget.model} by {budget.label}" for budget in self.budgets)
        return f"Explanation of {runs or 'no run'}"

    def rows(self) -> Iterator[dict[str, object]]:
        """A cause's share of a quantity's error a row."""
        for budget in self.budgets:
            head = {"model": budget.model, "engine": budget.engine, "preset": budget.preset}
            for quantity in budget.quantities:
                names = {"quantity": quantity.name, "unit": quantity.unit}
                for share in (*quantity.shares, quantity.rest):
                    yield {**head, **names, **share.model_dump()}


# ------------------------------------------------------------------------- changed runs

LAST_BITS = 1e-15
"""Relative change of gravity (without it, of the start speeds), a few units in the last place:
what it does to a run is roundoff."""
_SHAPIRO = np.array([-1.0, 4.0, 10.0, 4.0, -1.0]) / 16.0
_EVEN = 1e-6  # relative difference of steps that are meant to be equal: rounding of the times


@dataclass(frozen=True)
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
        return {
            **self.engine.settings,
            "own_kinematics": self.own_kinematics,
            "filtered_torques": self.filtered_torques,
        }

    def simulate(self, problem: Problem) -> Trajectory:
        """Simulate as the engine does, and read the result otherwise."""
        trajectory = self.engine.simulate(problem)
        if self.own_kinematics:
            trajectory = by_kinematics(trajectory)
        return with_filtered_torques(trajectory) if self.filtered_torques else trajectory


def by_kinematics(trajectory: Trajectory) -> Trajectory:
    """The same motion, its markers and energies computed from q and u."""
    kinematics, q, u = Kinematics(trajectory.mechanism), trajectory.q, trajectory.u
    markers: dict[str, PointMotion] = {}
    for marker in trajectory.mechanism.markers:
        row = kinematics.point(marker.body, marker.point)
        position, velocity = kinematics.position(row, q), kinematics.velocity(row, q, u)
        markers[marker.name] = PointMotion(position, velocity)
    return dataclasses.replace(
        trajectory,
        markers=markers,
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
        torques[name] = torque.copy()
        torques[name][inside] = np.convolve(torque, _SHAPIRO, mode="same")[inside]
    return dataclasses.replace(trajectory, stop_torques=torques)


def varied(
    runs: EngineRuns, base: Engine, interventions: Sequence[Intervention], last_bits: int = 0
) -> RunRecord:
    """The run of an engine with some interventions made, the later ones over the earlier ones.

    Args:
        runs: of one machine.
        base: the engine that is explained.
        interventions: in the order in which they are made.
        last_bits: +1 or -1 changes gravity, or without it the start speeds, by as many
            :data:`LAST_BITS`.

    Raises:
        InputError: an option of an intervention is not valid.
    """
    options: dict[str, JsonValue] = {}
    for intervention in interventions:
        options |= intervention.options
    engine = with_options(base, options)
    kinematics = any(intervention.own_kinematics for intervention in interventions)
    filtered = any(intervention.filtered_torques for intervention in interventions)
    if kinematics or filtered:
        engine = Reread(engine, kinematics, filtered)
    mechanism, factor = runs.mechanism, 1.0 + last_bits * LAST_BITS
    changes: dict[str, object] = {}
    if last_bits and mechanism.gravity:
        changes["gravity"] = mechanism.gravity * factor
    elif last_bits:
        changes["start_speeds"] = tuple(speed * factor for speed in mechanism.start_speeds)
    for intervention in interventions:
        if intervention.point_inertia is not None:
            inertia = {"inertia": intervention.point_inertia}
            changes["bodies"] = tuple(
                body if body.inertia else body.model_copy(update=inertia)
                for body in mechanism.bodies
            )
    changed = mechanism.model_copy(update=changes)
    return runs.record(engine, given=None if changed == mechanism else changed)


# ------------------------------------------------------------------------------ budgets

_ROUNDOFF = "roundoff"


class VariantFailedError(Exception):
    """A run with causes taken out ended early, or with other events than the base run."""

    def __init__(self, cause: str, reason: str) -> None:
        super().__init__(reason)
        self.cause = cause


class TwoWayShare(NamedTuple):
    """A cause's contribution to one quantity, as functions of time."""

    share: FloatArray
    first: FloatArray  # found one way: in the order of the table
    second: FloatArray  # the other way: in the reverse order, or by scaling


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

    def share(self, cause: str, part: TwoWayShare) -> Share:
        """A cause's contribution; fractions are projections, so that all of them add up to one."""
        square = float(self.values @ self.values)

        def fraction(values: FloatArray) -> float | None:
            return float(values @ self.values) / square if square else None

        rms, largest = self.size(part.share)
        return Share(
            cause=cause,
            fraction=fraction(part.share),
            first=fraction(part.first),
            second=fraction(part.second),
            rms=rms,
            largest=largest,
            interaction=self.size((part.first - part.second) / 2)[0],
        )


Errors = Mapping[str, Observed]
"""Every quantity of a run that a budget is made for, by its name."""


def observed(curves: Curves) -> Errors:
    """The errors of a run; what it does not tell is absent."""
    position = np.array(curves.positions[curves.farthest]).ravel()
    quantities = {"position": Observed("m", position, components=2)}
    for stop, torque in curves.torques.items():
        unit = curves.force_units.get(stop, "N m")
        effort = "torque" if unit == "N m" else "force"
        quantities[f"{stop} {effort}"] = Observed(unit, np.array(torque))
    quantities["energy"] = Observed("J", np.array(curves.energy))
    events = {f"{stop} release": ("s", time) for stop, time in curves.release_times.items()}
    events["launch time"] = "s", curves.launch_time
    events["launch speed"] = "m/s", curves.launch_speed
    for name, (unit, value) in events.items():
        quantities[name] = Observed(unit, np.array([math.nan if value is None else value]))
    return {name: each for name, each in quantities.items() if np.isfinite(each.values).all()}


def _noise(run: Errors, others: Sequence[Errors], name: str) -> float:
    """Size of the random part of a run [rms], from runs that differ in their last bits only.

    The difference of two such runs has twice the variance of one.
    """
    squares: list[float] = []
    for other in others:
        if name in other:
            difference = other[name].values - run[name].values
            squares.append(run[name].size(difference)[0] ** 2 / 2)
    return math.sqrt(sum(squares) / len(squares)) if squares else 0.0


def budget(runs: EngineRuns, engine: Engine) -> Budget:
    """Split an engine's error on one machine among its causes.

    Each removal is a run. A cause whose run fails is left out and says so: its part stays
    unexplained.
    """
    base = varied(runs, engine, [])
    empty = Budget(
        model=runs.mechanism.name,
        engine=engine.name,
        engine_version=base.engine_version,
        preset=base.preset,
        settings=engine.settings,
        message=base.message,
    )
    if base.curves is None:
        return empty
    known, point = causes_of(engine, runs.mechanism), base.curves.farthest
    measured = _BudgetRuns(runs, engine, known, point, observed(base.curves.of_point(point)))
    quantities = measured.quantities()
    causes: list[Measurement] = []
    for cause in known:
        ways = [way for way in (cause.removal, cause.scaling) if way is not None]
        causes.append(
            Measurement(
                name=cause.name,
                explanation=cause.explanation,
                done="; or ".join(way.described(engine.settings) for way in ways),
                after=cause.after,
                message=measured.failed.get(cause.name),
            )
        )
    changed = "gravity" if runs.mechanism.gravity else "start speeds"
    roundoff = Measurement(
        name=_ROUNDOFF,
        explanation="the random part: what changes when the machine's data change in their last "
        "bits",
        done=f"{changed} changed by ±{LAST_BITS:g} of itself",
        message=measured.failed.get(_ROUNDOFF),
    )
    update = {"point": point, "causes": (*causes, roundoff), "quantities": quantities}
    return empty.model_copy(update=update)


@dataclass
class _BudgetRuns:
    """The runs of one budget, by their errors."""

    runs: EngineRuns
    engine: Engine
    causes: Sequence[Cause]
    point: str
    """Whose position is split."""
    base: Errors
    failed: dict[str, str] = field(default_factory=dict[str, str])
    """Why a cause could not be measured, by its name."""

    def quantities(self) -> tuple[QuantityBudget, ...]:
        """The budget of every quantity that all runs tell."""
        (first, there), (second, back) = self._chains()
        alone = self._scaled()
        near_base = self._last_bits([], (1, -1))
        near_ideal = self._last_bits(self._removals(first), (1,))
        # What is left is the ideal run, extrapolated with the base where a removal leaves a known
        # part: the weight of the ideal run's own error.
        leaves = [cause.removal.leaves if cause.removal else 0.0 for cause in first]
        weight = 1.0 + sum(part / (1.0 - part) for part in leaves)
        runs = [*there, *back, *(larger for larger, _ in alone.values())]
        quantities: list[QuantityBudget] = []
        for name, whole in self.base.items():
            if not all(name in run for run in runs):
                continue
            e, parts = whole.values, dict[str, TwoWayShare]()
            forwards, backwards = _changes(first, there, name), _changes(second, back, name)
            for cause, change in forwards.items():
                share = (change + backwards[cause]) / 2
                parts[cause] = TwoWayShare(share, change, backwards[cause])
            for cause, (larger, factor) in alone.items():
                scaled = (larger[name].values - e) / (factor - 1.0)
                # Shares of removals add up: scaling, an independent measure, is shown beside them
                # and makes the band.
                share = parts[cause].share if cause in parts else scaled
                parts[cause] = TwoWayShare(share, share, scaled)
            roundoff = _noise(self.base, near_base, name)
            left = math.hypot(
                weight * _noise(there[-1], near_ideal, name), (weight - 1.0) * roundoff
            )
            rest = e - np.sum([part.share for part in parts.values()], axis=0) if parts else e
            rms, largest = whole.size(e)
            rest_rms, rest_largest = whole.size(rest)
            # Roundoff is random: it enters the rest's size, not the rest as a function, and is
            # taken from it in quadrature.
            unexplained = math.sqrt(max(0.0, rest_rms**2 - left**2))
            quantities.append(
                QuantityBudget(
                    name=name,
                    unit=whole.unit,
                    rms=rms,
                    largest=largest,
                    shares=tuple(whole.share(cause, part) for cause, part in parts.items()),
                    rest=whole.share("unexplained", TwoWayShare(rest, rest, rest)),
                    rest_rms=rest_rms,
                    rest_largest=rest_largest,
                    roundoff=roundoff,
                    roundoff_left=left,
                    explained=1.0 - unexplained / rms if rms else None,
                )
            )
        return tuple(quantities)

    def _chains(self) -> list[tuple[tuple[Cause, ...], list[Errors]]]:
        """Chain both orders of removal with their runs: one more than there are causes, base first.

        Causes whose runs fail in either order are in none.
        """
        while True:
            left = [c for c in self.causes if c.removal is not None and c.name not in self.failed]
            chains: list[tuple[tuple[Cause, ...], list[Errors]]] = []
            try:
                for order in orders(left):
                    along = [self.base]
                    for n, cause in enumerate(order, start=1):
                        along.append(self._errors(self._removals(order[:n]), cause.name))
                    chains.append((order, along))
            except VariantFailedError as failure:
                self.failed[failure.cause] = str(failure)
            else:
                return chains

    def _removals(self, causes: Sequence[Cause]) -> list[Intervention]:
        """Take causes out, in the table's order: the same causes are the same run."""
        names = {cause.name for cause in causes}
        table = orders(self.causes)[0]
        return [c.removal for c in table if c.name in names and c.removal is not None]

    def _errors(
        self, interventions: Sequence[Intervention], cause: str, last_bits: int = 0
    ) -> Errors:
        try:
            run = varied(self.runs, self.engine, interventions, last_bits)
        except InputError as error:
            raise VariantFailedError(cause, str(error)) from error
        if run.curves is None:
            raise VariantFailedError(cause, run.message or "it did not run")
        return observed(run.curves.of_point(self.point))

    def _scaled(self) -> dict[str, tuple[Errors, float]]:
        """Errors with one cause made larger, and by what factor."""
        larger: dict[str, tuple[Errors, float]] = {}
        for cause in self.causes:
            if cause.scaling is None:
                continue
            try:
                errors = self._errors([cause.scaling], cause.name)
            except VariantFailedError as failure:
                if cause.removal is None:  # with a removal, this is the second measure only
                    self.failed[cause.name] = str(failure)
            else:
                larger[cause.name] = errors, cause.scaling.leaves
        return larger

    def _last_bits(
        self, interventions: Sequence[Intervention], signs: Sequence[int]
    ) -> list[Errors]:
        near: list[Errors] = []
        for sign in signs:
            try:
                near.append(self._errors(interventions, _ROUNDOFF, sign))
            except VariantFailedError as failure:
                self.failed[_ROUNDOFF] = str(failure)
        return near


def _changes(order: Sequence[Cause], runs: Sequence[Errors], name: str) -> dict[str, FloatArray]:
    """Change of a quantity from taking out each cause after those before it.

    It is extrapolated where a known part of the cause remains.
    """
    changes: dict[str, FloatArray] = {}
    for cause, before, after in zip(order, runs, runs[1:], strict=False):
        assert cause.removal is not None
        change = before[name].values - after[name].values
        changes[cause.name] = change / (1.0 - cause.removal.leaves)
    return changes


def orders(causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """Make both orders of taking out causes: the given one, and its reverse as `after` allows.

    Causes an `after` names that are not among these are taken for absent.
    """
    names = {cause.name for cause in causes}

    def ordered(left: list[Cause]) -> tuple[Cause, ...]:
        done: list[Cause] = []
        while left:
            missing = names - {cause.name for cause in done}
            ready = next((c for c in left if missing.isdisjoint(c.after)), left[0])
            done.append(ready)
            left.remove(ready)
        return tuple(done)

    return ordered(list(causes)), ordered(list(causes[::-1]))


# ------------------------------------------------------------------------------ the study


def explain(
    models: Models = ("fixed", "rolling"),
    engines: Engines | None = None,
    presets: Names | None = None,
    **how: Unpack[RunOptions],
) -> Explanation:
    """Split each engine's error among its causes, each measured by a run without it.

        >>> import trebucheck as tb
        >>> budget = tb.explain("fixed", "mujoco", "default")  # doctest: +SKIP
        >>> budget.to_dataframe()[["cause", "fraction"]]  # doctest: +SKIP

    Args:
        models: one or several: names of machines or of the library's problems, paths of mechanisms'
            .json files, mechanisms, or problems.
        engines: one or several: names, or engines as `tb.engine` makes them; all but the reference
            if left out.
        presets: for which a budget is made; all that an engine has if left out, or those
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
    study = study.on_idle_cores()
    # A part a preset, and one for each preset beside the next.
    engines: list[tuple[Engine, ...]] = []
    # The reference has a budget where it is named: its options may be set otherwise.
    names = study.measured_engines if study.engines is None else study.every_engine
    for name in names:
        presets = study.presets_of(name)
        made = tuple(study.engine(name, preset) for preset in presets)
        engines += [(each,) for each in made]
        engines += pairwise(made)
    count = Counter(len(study.mechanisms) * len(engines), study.progress)

    def part(wanted: tuple[EngineRuns, tuple[Engine, ...]]) -> Budget | PresetComparison:
        runs, compared = wanted
        presets = " to ".join(engine.preset for engine in compared)
        count.start(f"{runs.mechanism.name}: {compared[0].name} {presets}")
        return budget(runs, *compared) if len(compared) == 1 else compare_presets(runs, *compared)

    with study.worker() as worker:
        moved, failures = runs_of(study, worker)
        parts = all_in_order(part, list(product(moved, engines)), study.at_once)
    machines: list[ExplainedMachine] = []
    for runs in moved:
        machines.append(
            ExplainedMachine(
                model=runs.mechanism.name,
                mechanism=runs.mechanism,
                mechanism_hash=runs.mechanism.content_hash,
                launch_time=runs.runner.launch_time,
                compared_to=runs.runner.end,
                judged_to=runs.end,
            )
        )
    return Explanation.made_here(
        machines=tuple(machines),
        budgets=tuple(each for each in parts if isinstance(each, Budget)),
        comparisons=tuple(each for each in parts if isinstance(each, PresetComparison)),
        failures=failures,
        **study.times,
    )


_REPEATS = 3  # timed runs of each preset; one of each changed option


def compare_presets(runs: EngineRuns, first: Engine, second: Engine) -> PresetComparison:
    """Compare two presets of an engine at the first one's step, changing one option at a time."""
    step = first.settings.get("timestep")
    if step is not None:
        second = with_options(second, {"timestep": step})

    def figures(engine: Engine, options: dict[str, JsonValue], repeats: int = 1) -> Figures:
        try:
            changed = with_options(engine, options)
        except InputError as error:
            return Figures(message=str(error))
        record = runs.record(changed, repeats)
        if record.curves is None:
            return Figures(message=record.message or "it did not run")
        late = [abs(time) for time in record.curves.release_times.values() if time is not None]
        return Figures(
            position=record.position,
            torque=record.torque,
            release=max(late, default=None),
            wall_time=float(np.median(record.wall_times)),
        )

    changes: list[Change] = []
    after = second.settings
    for name, value in first.settings.items():
        if name in after and after[name] != value:
            alone, back = figures(first, {name: after[name]}), figures(second, {name: value})
            changes.append(
                Change(option=name, first=value, second=after[name], alone=alone, back=back)
            )
    return PresetComparison(
        model=runs.mechanism.name,
        engine=first.name,
        presets=(first.preset, second.preset),
        timestep=float(step) if isinstance(step, int | float) else None,
        force_unit=runs.mechanism.force_unit,
        first=figures(first, {}, _REPEATS),
        second=figures(second, {}, _REPEATS),
        changes=tuple(changes),
    )
