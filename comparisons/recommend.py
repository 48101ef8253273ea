"""Recommended settings of engines for a wanted accuracy; every recommended step was measured.

For each engine there are a few sets of options from default to assisted, and a ladder of time
steps. A set is followed on the machine itself, up to the longest step that reaches what is asked;
the cheapest sets then go on to the neighbours. Of sets that cost the same, within what a busy
machine can tell, that with the longest step is recommended, and of one step the plainest.

Neighbours are machines of the same kind, drawn at random, each independently of the others. At the
recommended step the machine and all of them reach what is asked. Of n machines so drawn and one
more, each is as likely as any other to be the worst; so a fresh one from the same ranges is worse
than the worst of n in one case of n + 1, whatever the distribution of their errors.

An engine alone is recommended before one with trebucheck's assistance: who has chosen an engine has
not chosen trebucheck. Assistance that is cheaper is told beside it.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, partial
from heapq import heappop, heappush
from itertools import islice
from typing import Annotated, Any, Literal, NamedTuple, Self, Unpack

import numpy as np
from pydantic import Field, JsonValue, model_validator

from ..engines.protocol import Engine
from ..engines.registry import Engines, engine, engine_class, engine_study, presets_of
from ..engines.study import OptionSet
from ..engines.supplied import only_read, stated
from ..models.errors import InputError, StudyEndedError, TrebucheckError
from ..models.library.registry import Model, models, parameters_type
from ..models.library.registry import model as named_model
from ..models.mechanism import Body, Mechanism
from ..models.problem import StopLaw
from ..models.shown import Reported
from ..models.spec import Positive, Real, Spec
from ..reference.certification.certificate import refusal
from ..reference.solver import characteristic_time
from .runs.process import in_order
from .runs.record import EngineRuns, RunRecord
from .runs.results import ComparedMotion, ResultFile
from .runs.runner import Runner
from .runs.study import Counter, RunOptions, Study, Until

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

FORMAT = "trebucheck-recommend-1"


class Accuracy(Spec):
    """Errors that must not be exceeded; None: anything will do.

    Raises:
        InputError: nothing is asked, a value is not positive and finite, or the torque is asked for
            in two ways.
    """

    position: Positive | None = Field(default=None, description="of any marker at any sample [m]")
    torque: Positive | None = Field(
        default=None, description="of any stop's torque at any sample [N m, or N on points]"
    )
    torque_share: Positive | None = Field(
        default=None,
        description="the same, of the largest stop torque of each machine's own reference",
    )
    release: Positive | None = Field(default=None, description="of any stop's release [s]")

    @model_validator(mode="after")
    def _asks_for_something(self) -> Self:
        if {self.position, self.torque, self.torque_share, self.release} == {None}:
            raise ValueError(
                "nothing is asked; at least one of position, torque and release must be given"
            )
        if self.torque is not None and self.torque_share is not None:
            raise ValueError("torque is asked in N m and as a share; only one of them can be given")
        return self


class Obstacle(StrEnum):
    """Obstacle that keeps an error from falling further, by its course over the steps."""

    STEP = "the time step"
    FLOOR = "a floor"
    CONSTANT = "not the step"
    ROUNDING = "rounding"
    FAILURE = "failure"


class Errors(Spec):
    """The largest errors over the compared time; None: there is no such figure."""

    position: Real | None = Field(description="[m]")
    torque: Real | None = Field(description="[N m, or N on points]")
    torque_share: Real | None = Field(description="of the largest stop torque of the reference")
    release: Real | None = Field(description="[s]")


class Attempt(Spec):
    """One set of options, followed over the steps."""

    options: str = Field(description="name of the set")
    words: str
    step: Real | None = Field(description="longest that reaches what is asked; None: none [s]")
    wall_time: Real | None = Field(description="of the machine asked about, at that step, once [s]")
    steps_tried: tuple[Real, ...] = Field(description="[s]")
    worst: Real | None = Field(
        description="least found of the worst error over what is asked; None: runs failed"
    )
    note: str = Field(description="why it was not followed further")


class Choice(Spec):
    """Settings that reach what is asked, all measured."""

    alone: bool = Field(
        description="whether the engine runs alone: all that trebucheck does is to read"
    )
    options: str = Field(description="name of the set")
    words: str
    preset: str
    changes: dict[str, JsonValue] = Field(description="over the preset, the time step included")
    settings: dict[str, JsonValue] = Field(description="every numerical option")
    step: Real = Field(description="[s]")
    here: Errors = Field(description="on the machine asked about")
    worst_neighbour: Errors | None = Field(
        description="the worst of each, over the neighbours measured"
    )
    longest_tried: bool = Field(
        description="whether no longer step was tried: it may be shorter than is needed"
    )
    wall_time: Real = Field(description="median, of the machine asked about, warm [s]")
    wall_times: tuple[Real, ...] = Field(description="[s]")
    snippets: dict[str, str] = Field(description="texts to paste, by what they are for")


class EngineAdvice(Spec):
    """Settings for one engine, or why there are none."""

    engine: str
    engine_version: str
    choice: Choice | None = Field(
        default=None,
        description="the cheapest of the engine alone; where it reaches it with none, of those "
        "with which trebucheck does a part of the run",
    )
    assisted: Choice | None = Field(
        default=None,
        description="settings with which trebucheck does a part of the run, if they are cheaper",
    )
    obstacle: Obstacle | None = None
    message: str | None = Field(
        default=None, description="what was reached and what stands in the way"
    )
    attempts: tuple[Attempt, ...] = ()

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Settings that are recommended, those of the engine alone first."""
        return tuple(each for each in (self.choice, self.assisted) if each is not None)

    @property
    def snippets(self) -> dict[str, str]:
        """Texts to paste for the choice, by what they are for; empty without one."""
        return {} if self.choice is None else self.choice.snippets


class NeighbourMachine(Spec):
    """A machine of the same kind."""

    made_with: dict[str, Real] = Field(
        description="its parameters that differ, or factors on a mechanism's own"
    )
    mechanism_hash: str


class Advice(Reported, ComparedMotion, ResultFile):
    """Recommendations for one machine, and their evidence."""

    format: Literal["trebucheck-recommend-1"] = FORMAT
    launch_time: Real | None = Field(
        default=None, description="of the reference [s]; None: none, or later"
    )
    asked: Accuracy
    rule: str = Field(description="what the settings were measured on")
    neighbours: tuple[NeighbourMachine, ...]
    measured_neighbours: Annotated[int, Field(ge=0)] = Field(
        description="those measured at the recommended steps"
    )
    engines: tuple[EngineAdvice, ...]

    def headline(self) -> str:
        """Engines for which there are settings."""
        steps: list[str] = []
        for advice in self.engines:
            step = f"{advice.choice.step:g} s" if advice.choice else "none"
            steps.append(f"{advice.engine} {step}")
        return f"Advice for {self.model!r}: {', '.join(steps)}"

    def rows(self) -> Iterator[dict[str, object]]:
        """An engine a row."""
        for advice in self.engines:
            row: dict[str, object] = {"engine": advice.engine}
            if choice := advice.choice:
                row |= {"preset": choice.preset, "changes": choice.changes, "step": choice.step}
                row |= {"wall_time": choice.wall_time, **dict(choice.here)}
            yield {**row, "message": advice.message}

    def engine(self, name: str) -> EngineAdvice:
        """The advice for the engine of that name."""
        return next(advice for advice in self.engines if advice.engine == name)


# Targets

_METRICS = {"position": "position_max", "torque": "stop_torque_max", "release": "release_time"}
_SAMPLES = 2001  # of the reference, in search of the largest torque, and of gaps below zero
_PENETRATED = 1e-9  # [rad, m], beyond the rounding of a gap that has just opened


@dataclass(frozen=True)
class TargetedRuns:
    """Runs on one machine, and the errors that they may have."""

    trials: EngineRuns
    target: Accuracy

    @cached_property
    def largest_torque(self) -> float:
        """The largest torque of any stop over the compared time, by the reference [N m, N]."""
        times = np.linspace(0.0, self.trials.end, _SAMPLES)
        torques = self.trials.solution.motion(times).stop_torques.values()
        return max((float(torque.max()) for torque in torques), default=0.0)

    @cached_property
    def allowed(self) -> dict[str, float]:
        """Largest error allowed, by quantity, in its own unit."""
        asked = self.target
        limits = {"position": asked.position, "torque": asked.torque, "release": asked.release}
        if asked.torque_share is not None:
            limits["torque"] = asked.torque_share * self.largest_torque
        return {name: value for name, value in limits.items() if value is not None}

    def refuse_what_cannot_be_judged(self) -> None:
        """Raises InputError for a quantity that the machine lacks, or the reference hardly knows.

        Its uncertainty must leave the allowed error to be judged.
        """
        mechanism, trials = self.trials.mechanism, self.trials
        of_stops = self.allowed.keys() & {"torque", "release"}
        if of_stops and not any(stop.closed for stop in mechanism.stops):
            raise InputError(
                f"{mechanism.name!r} has no stop that is closed at the start: only a position "
                "can be asked."
            )
        if "release" in self.allowed and not self._released:
            raise InputError(
                f"no stop of {mechanism.name!r} releases within the compared {trials.end:.6g} s: "
                f"no error of a release (release = {self.allowed['release']:g} s) can be asked."
            )
        if self.target.torque_share is not None and self.largest_torque == 0:
            raise InputError(
                f"no stop of {mechanism.name!r} pushes: its torque can only be asked in "
                f"{mechanism.force_unit}."
            )
        for quantity, value in self.allowed.items():
            metric = _METRICS[quantity]
            refused = refusal(metric, None, value, trials.uncertainty(metric))
            if refused is not None:
                unit = unit_of(quantity, mechanism)
                raise InputError(f"{quantity} = {value:g} {unit}: {refused}.")

    @cached_property
    def _released(self) -> list[str]:
        """Stops closed at the start that the reference releases within the compared time."""
        names: list[str] = []
        for name, time in self.trials.solution.release_times.items():
            due = time is not None and time <= self.trials.end
            if due and self.trials.mechanism.stop(name).closed:
                names.append(name)
        return names

    def errors(self, trial: RunRecord) -> dict[str, float]:
        """Errors by quantity; infinite where the run failed or a release did not come."""
        if not trial.ran:
            return dict.fromkeys(_METRICS, math.inf)
        errors = {"position": trial.position, "torque": trial.torque, "release": 0.0}
        for name in self._released:
            error = trial.value("release_time", name)
            late = math.inf if error is None else abs(error)
            errors["release"] = max(errors["release"] or 0.0, late)
        return {name: math.inf if error is None else error for name, error in errors.items()}

    def ratio(self, trial: RunRecord) -> float:
        """The largest error over what is allowed: up to 1 it is reached."""
        errors, allowed = self.errors(trial), self.allowed
        return max(errors[name] / limit if limit else math.inf for name, limit in allowed.items())

    def reported(self, trial: RunRecord) -> Errors:
        """Errors as the report has them."""
        errors: dict[str, float | None] = dict.fromkeys(Errors.model_fields)
        for name, value in self.errors(trial).items():
            if math.isfinite(value) and (name != "release" or self._released):
                errors[name] = value
        if errors["torque"] is not None and self.largest_torque:
            errors["torque_share"] = errors["torque"] / self.largest_torque
        return Errors(**errors)


def unit_of(quantity: str, mechanism: Mechanism) -> str:
    """Unit of a quantity that can be asked for."""
    return {"position": "m", "torque": mechanism.force_unit, "release": "s"}[quantity]


def read_torque(text: str) -> dict[str, float]:
    """Read '1e-3' as N m (or N) and '0.1%' as a share: the field of the target, and its value.

    Raises:
        InputError: it is no number.
    """
    number = text.strip()
    try:
        value = float(number.removesuffix("%"))
    except ValueError:
        raise InputError(
            f"--torque {text!r} is not a number of N m, or N (1e-3), nor a share of the largest "
            "stop torque (0.1%)."
        ) from None
    return {"torque_share": value / 100} if number.endswith("%") else {"torque": value}


# Neighbours

# Lengths, masses and gravity are varied up to these factors, up and down; start angles by so
# much [rad].
LENGTH, MASS, ANGLE, GRAVITY = 1.4, 2.5, 0.3, 1.4
# In the order of the draws
_FACTORS = {**dict.fromkeys(("l1", "l2", "r", "h"), LENGTH), "m_b": MASS, "m_cw": MASS, "m_a": MASS}
_ANGLES = ("theta0", "phi0", "alpha0")
_SEED = 1  # the family is the same in every run
Neighbour = tuple[Mechanism, dict[str, float]]
"""A machine, and the parameters (or factors) it was made with."""


def of_parameters(name: str, parameters: Spec | None) -> Iterator[Neighbour]:
    """Neighbours of a named machine without end: lengths, masses and start angles varied.

    Gravity is kept.
    """
    kind = parameters_type(name)
    base = (parameters or kind()).model_dump()
    random = np.random.default_rng(_SEED)
    while True:
        drawn: dict[str, float] = {}
        for key, most in _FACTORS.items():
            if key in base:
                drawn[key] = base[key] * _draw(random, most)
        for key in _ANGLES:
            if key in base:
                drawn[key] = base[key] + float(random.uniform(-ANGLE, ANGLE))
        with suppress(TrebucheckError):  # outside what a machine can be: the next draw will do
            yield named_model(name, kind(**(base | drawn))), drawn


def of_mechanism(mechanism: Mechanism) -> Iterator[Neighbour]:
    """Neighbours of any mechanism without end: masses, with inertia, and gravity varied.

    The geometry is kept.
    """
    random = np.random.default_rng(_SEED)
    while True:
        factors, bodies = dict[str, float](), list[Body]()
        for body in mechanism.bodies:
            factor = factors[f"mass of {body.name}"] = _draw(random, MASS)
            update = {"mass": body.mass * factor, "inertia": body.inertia * factor}
            bodies.append(body.model_copy(update=update))
        factors["gravity"] = gravity = _draw(random, GRAVITY)
        changes = {"bodies": tuple(bodies), "gravity": mechanism.gravity * gravity}
        with suppress(TrebucheckError):
            yield mechanism.model_copy(update=changes), factors


def _draw(random: np.random.Generator, most: float) -> float:
    """A factor from 1 / most to most, uniform in its logarithm."""
    return float(math.exp(random.uniform(-1.0, 1.0) * math.log(most)))


# Search

RUNGS = 8  # steps from the moderate one down, at most
# Of the machine's characteristic time. At longer steps even the best sets are not yet in the range
# where their errors follow the order; the search goes both ways from there.
_MODERATE = 1 / 300
_SCOUTED = 2  # rungs further down, where an error shows how it falls
_ORDERS = (0.1, 4.0)  # between which an order found over two steps is believed
_DOUBT = 0.5  # error of such an order: a release inside a step scatters the errors
_GAIN = 0.7  # the next step is at most half as long: an error of first order would halve, too
_PATIENCE = 2  # steps without gain, before a set is given up
_FEWEST = 3  # steps in the compared motion, at least: the reference goes on a step beyond it
_LONGEST = 1.0  # [s], that an engine takes
_REPEATS = 5
_REPEATABLE = 1.2  # times: repeated measurements of a cost on a busy machine are within it
TIE = 1.5
"""Costs closer than this are equal."""
_DEARER = TIE * _REPEATABLE
"""Times the cheapest, from which on a set cannot be equal to it, as its cost is measured."""


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Option sets of an engine, from plain to assisted; its presets where its study has none."""
    return engine_study(name).option_sets or tuple(
        OptionSet(preset, f"its preset {preset!r}", preset) for preset in presets_of(name)
    )


def configured(name: str, options: OptionSet, step: float) -> Engine:
    """An engine with the options of a set at a time step [s]."""
    return engine(name, options.preset, **options.all_options(step))


class Ladder(NamedTuple):
    """Time steps of 1, 2 and 5 times a power of ten, downwards [s]."""

    steps: tuple[float, ...]
    moderate: int  # index of the one that a search begins at

    @classmethod
    def of(cls, characteristic_time: float, end: float) -> Ladder:
        """Steps for a machine: small machines move quickly.

        Args:
            characteristic_time: of the machine [s].
            end: of the compared motion [s]; no step is longer than a third of it.
        """
        steps: list[float] = []
        moderate = min(characteristic_time * _MODERATE, end / _FEWEST)
        longest = min(end / _FEWEST, _LONGEST)
        exponent = math.ceil(math.log10(longest))
        for position in range(3 * exponent, 3 * exponent - 100, -1):
            step = float(f"{(1, 2, 5)[position % 3]}e{position // 3}")
            if step <= longest * (1 + 1e-12):
                steps.append(step)
        start = next(i for i, step in enumerate(steps) if step <= moderate * (1 + 1e-12))
        return cls(tuple(steps[: start + RUNGS]), start)


@dataclass(frozen=True)
class _Rung:
    """Runs of one set of options at a time step, by the index of the machine."""

    step: float  # [s]
    trials: dict[int, RunRecord] = field(default_factory=dict[int, RunRecord])
    ratios: dict[int, float] = field(default_factory=dict[int, float])
    """Errors over what is allowed: up to 1 it is reached."""


@dataclass
class Sweep:
    """One set of options over the time steps tried."""

    options: OptionSet
    rungs: dict[float, _Rung] = field(default_factory=dict[float, _Rung])
    note: str = ""
    reached: _Rung | None = None
    """The longest step that reaches the target on all machines."""
    last: int = 0
    """Index of the machine that was looked at last: where none is reached, that which bars it."""

    @property
    def best(self) -> _Rung:
        """The step with the least error on the last machine; of equals the longest."""
        run = (rung for rung in self.rungs.values() if self.last in rung.ratios)
        return min(run, key=lambda rung: (rung.ratios[self.last], -rung.step))

    @property
    def least(self) -> float:
        """The least error found on the last machine, over what is allowed."""
        return self.best.ratios[self.last]


class _Candidate(NamedTuple):
    """A set, and the longest step that may reach the target on all machines.

    They are ordered by what that step costs on the machine itself, and then from plain to assisted.
    """

    cost: float  # [s]
    place: int  # among the sets
    at: int  # index of the step


class TimedSweep(NamedTuple):
    """A set of options, the step that reaches the target, and its timed run on the machine."""

    sweep: Sweep
    rung: _Rung
    run: RunRecord


def cheapest(timed: Sequence[TimedSweep], below: float = math.inf) -> TimedSweep | None:
    """Find the cheapest; of equals the longest step, and of one step the plainest options.

    Args:
        timed: from plain to assisted.
        below: cost that it must be below [s].
    """
    kept = [each for each in timed if cost_of(each.run) < below]
    least = min((cost_of(each.run) for each in kept), default=math.inf)
    equal = [each for each in kept if cost_of(each.run) <= TIE * least]
    return max(equal, key=lambda each: each.rung.step, default=None)


@dataclass
class Search:
    """Searches the time steps of one engine for each set of options.

    A set is followed on the machine asked about first, from a moderate step to longer ones up to
    the first that misses the target, or to shorter ones; then on the neighbours. Before each
    shorter step it waits until that is the cheapest of all sets, and it ends where that costs more
    than what is found.
    """

    engine: str
    cases: Sequence[TargetedRuns]
    ladder: Ladder
    jobs: int = 1  # neighbours that are run at once
    starts: Callable[[str], None] = lambda _: None
    """Called with the name of each set before it is followed."""

    def sweeps(self, sets: Sequence[OptionSet], bound: float = math.inf) -> list[Sweep]:
        """Follow each set as far as it may be among the cheapest.

        Args:
            sets: from plain to assisted.
            bound: cost of what is recommended so far [s].
        """
        sweeps, waiting = list(map(Sweep, sets)), list[_Candidate]()
        courses = list(map(self._followed, sweeps))

        def follow(place: int) -> None:
            at = next(courses[place], None)
            if at is not None:
                heappush(waiting, _Candidate(self._cost(sweeps[place], at), place, at))

        for place, sweep in enumerate(sweeps):
            self.starts(sweep.options.name)
            follow(place)
        while waiting:
            _, place, at = heappop(waiting)
            sweep = sweeps[place]
            if self._costs_more(sweep, at, _DEARER * bound):
                step = f"{self.ladder.steps[at]:g} s"
                sweep.note = f"would need {step} or less, which costs more than what is recommended"
            else:
                follow(place)
                bound = min(bound, self.cost(sweep))
        return sweeps

    def trial(self, case: int, options: OptionSet, step: float, repeats: int = 1) -> RunRecord:
        """Run of a set of options at a step [s] on a machine, by its index."""
        return self.cases[case].trials.record(configured(self.engine, options, step), repeats)

    def timed(self, sweeps: Sequence[Sweep]) -> list[TimedSweep]:
        """Sets that reach the target, with runs on the machine itself that were timed together.

        They are run in turns, so that what else the computer does meets all of them.
        """
        reached = [(sweep, sweep.reached) for sweep in sweeps if sweep.reached is not None]
        runs = [rung.trials[0] for _, rung in reached]
        for repeats in range(2, _REPEATS + 1):
            for i, (sweep, rung) in enumerate(reached):
                runs[i] = self.trial(0, sweep.options, rung.step, repeats)
        return [TimedSweep(*each, run) for each, run in zip(reached, runs, strict=True)]

    def cost(self, sweep: Sweep) -> float:
        """Cost of the step that reaches the target [s]; infinite where none does."""
        return math.inf if sweep.reached is None else cost_of(sweep.reached.trials[0])

    def _cost(self, sweep: Sweep, index: int) -> float:
        """Cost of a step on the machine itself [s], by the nearest step that was run."""
        step = self.ladder.steps[index]
        run = (rung for rung in sweep.rungs.values() if 0 in rung.trials)
        nearest = min(run, key=lambda rung: abs(math.log(rung.step / step)))
        return cost_of(nearest.trials[0]) * nearest.step / step

    def _costs_more(self, sweep: Sweep, index: int, most: float) -> bool:
        """Tell whether a step costs more on the machine itself; it is run if no longer one does."""
        step = self.ladder.steps[index]
        if math.isinf(most):
            return False
        longer = (rung for rung in sweep.rungs.values() if rung.step > step and 0 in rung.trials)
        nearest = min(longer, key=lambda rung: rung.step, default=None)
        if nearest is None or not _exceeds(nearest.trials[0], most):
            self._ratio(sweep, 0, index)
            nearest = sweep.rungs[step]
        return _exceeds(nearest.trials[0], most)

    def _ratio(self, sweep: Sweep, case: int, index: int) -> float:
        """Error over what is allowed of a machine at a step."""
        step = self.ladder.steps[index]
        rung = sweep.rungs.setdefault(step, _Rung(step))
        if case not in rung.ratios:
            rung.trials[case] = self.trial(case, sweep.options, step)
            rung.ratios[case] = self.cases[case].ratio(rung.trials[case])
        return rung.ratios[case]

    def _followed(self, sweep: Sweep) -> Iterator[int]:
        """Search the longest step of a set with which all machines reach the target.

        Machines are run first that missed the target before. Nothing here depends on what was found
        with other sets, whose order follows from measured costs.

        Yields:
            Index of the longest step that may do, before it is looked at.
        """
        order = list(range(len(self.cases)))
        index = yield from self._longest(sweep)
        while index is not None:
            yield index
            failed = self._first_to_fail(sweep, index, order)
            if failed is None:
                sweep.reached = sweep.rungs[self.ladder.steps[index]]
                return
            order = [failed, *(case for case in order if case != failed)]
            index = yield from self._shorter(sweep, failed, index)

    def _longest(self, sweep: Sweep) -> Generator[int, None, int | None]:
        """Index of the longest step with which the machine itself reaches the target, or None."""
        index = self.ladder.moderate
        if self._ratio(sweep, 0, index) > 1:
            return (yield from self._shorter(sweep, 0, index))
        while index > 0 and self._ratio(sweep, 0, index - 1) <= 1:
            index -= 1
        sweep.note = "reached; a longer step does not"
        if index == 0:
            sweep.note = "reached at the longest step tried"
        return index

    def _shorter(self, sweep: Sweep, case: int, index: int) -> Generator[int, None, int | None]:
        """Index of the longest step below one that misses the target; None: none is likely."""
        sweep.last, last, idle = case, len(self.ladder.steps) - 1, 0
        scouted = min(index + _SCOUTED, last)
        before = self._ratio(sweep, case, index)
        if index < last:
            yield index + 1
        if scouted > index and self._ratio(sweep, case, scouted) > 1:
            if self._hopeless(sweep, case, index, scouted):
                return None
            index, before = scouted, self._ratio(sweep, case, scouted)
        for shorter in range(index + 1, last + 1):
            yield shorter
            now = self._ratio(sweep, case, shorter)
            if now <= 1:
                sweep.note = "reached; a longer step does not"
                return shorter
            idle = 0 if now < _GAIN * before else idle + 1
            if idle == _PATIENCE:
                sweep.note = "shorter steps do not help any more"
                return None
            before = now
        sweep.note = "not reached at the shortest step tried"
        return None

    def _hopeless(self, sweep: Sweep, case: int, index: int, scouted: int) -> bool:
        """Tell whether the error, as it falls between two steps, misses the target at all steps."""
        steps, finest = self.ladder.steps, self.ladder.steps[-1]
        coarse, fine = (self._ratio(sweep, case, i) for i in (index, scouted))
        if not (math.isfinite(coarse) and math.isfinite(fine)):
            return False
        order = math.log(coarse / fine) / math.log(steps[index] / steps[scouted])
        at_best = min(max(order + _DOUBT, _ORDERS[0]), _ORDERS[1])
        if steps[scouted] / fine ** (1 / at_best) >= finest:
            return False
        sweep.note = f"by the order found, {order:.1f}, no step down to {finest:g} s will do"
        return True

    def _first_to_fail(self, sweep: Sweep, index: int, order: Sequence[int]) -> int | None:
        """The first machine, in this order, that misses the target at a step."""

        def ratio(case: int) -> float:
            return self._ratio(sweep, case, index)

        with closing(in_order(ratio, order, self.jobs, ahead=2 * self.jobs)) as ratios:
            for case, value in zip(order, ratios, strict=True):
                if value > 1:
                    return case
        return None


def cost_of(trial: RunRecord) -> float:
    """Least processor time without our reading [s]; infinite for a run that failed."""
    return min(trial.costs or trial.wall_times, default=math.inf)


def _exceeds(trial: RunRecord, cost: float) -> bool:
    """Tell whether a run cost more [s]; one that failed did not."""
    return trial.ran and cost_of(trial) > cost


# Obstacles

_RISES = 2.0  # times the least error: more than the scatter from a release inside a step
_FLAT = 1.5  # times the least error: within it, it does not depend on the step
_FALLS = 0.5  # order in the step, at the shortest steps: half of what the least accurate method has


class Verdict(NamedTuple):
    """Why an error does not fall further."""

    obstacle: Obstacle
    sentence: str


def classify(steps: Sequence[float], errors: Sequence[float], allowed: float, unit: str) -> Verdict:
    """Why an error stays above what is allowed.

    Args:
        steps: [s], the longest first; at least two.
        errors: at these steps, in `unit`; infinite where the run failed.
    """
    kept = [(h, e) for h, e in zip(steps, errors, strict=True) if math.isfinite(e) and e > 0]
    if len(kept) < 2:
        return Verdict(Obstacle.FAILURE, "the runs failed")
    best = min(range(len(kept)), key=lambda i: kept[i][1])
    (step, least), (last_step, last) = kept[best], kept[-1]
    if last > _RISES * least:
        return Verdict(
            Obstacle.ROUNDING,
            f"it grows again below a step of {step:g} s ({least:.1e} {unit}, but {last:.1e} {unit} "
            f"at {last_step:g} s, as 1/step^{-_slope(kept[best:]):.1f}), as rounding or what is "
            "left by the solver's iteration does",
        )
    flat = [h for h, e in kept if e <= _FLAT * least]
    if len(flat) == len(kept):
        return Verdict(
            Obstacle.CONSTANT,
            f"it does not depend on the step ({least:.1e} {unit} from {kept[0][0]:g} s to "
            f"{last_step:g} s): another option or the method itself sets it",
        )
    order = _slope(kept[-2:])
    if order >= _FALLS:
        needed = last_step * (allowed / last) ** (1 / order)
        return Verdict(
            Obstacle.STEP,
            f"it is still falling at the shortest step tried ({last:.1e} {unit} at {last_step:g} "
            f"s, order {order:.1f}); by that order some {needed:.1g} s would do, which was not "
            "measured",
        )
    sentence = f"it no longer falls below a step of {flat[0]:g} s: "
    return Verdict(Obstacle.FLOOR, f"{sentence}a floor of {least:.1e} {unit} is met")


def _slope(points: Sequence[tuple[float, float]]) -> float:
    logs = np.log(np.array(points))
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def explain(search: Search, sweeps: Sequence[Sweep], *, further: bool = True) -> Verdict:
    """Say why no set of an engine reaches the target: the best set, on the machine that bars it.

    Args:
        further: whether to measure all steps from the moderate one down for it; else the verdict is
            of those that were tried.
    """
    sweep = min(sweeps, key=lambda sweep: sweep.least)
    best, case = sweep.best, search.cases[sweep.last]
    if not math.isfinite(sweep.least):
        trials = (trial for tried in sweep.rungs.values() for trial in tried.trials.values())
        messages = (trial.message for trial in trials if trial.message)
        return Verdict(Obstacle.FAILURE, next(messages, "a stop does not release"))
    hardest_errors = case.errors(best.trials[sweep.last])
    # The quantity that is furthest off; two of them have two causes, but the first must go before
    # the second shows.
    name = max(case.allowed, key=lambda name: hardest_errors[name] / case.allowed[name])
    allowed, unit = case.allowed[name], unit_of(name, case.trials.mechanism)
    tried = {step for step, rung in sweep.rungs.items() if sweep.last in rung.trials}
    steps, errors = list[float](), list[float]()
    for step in search.ladder.steps[search.ladder.moderate :]:
        if not further and step not in tried:
            continue
        steps.append(step)
        errors.append(case.errors(search.trial(sweep.last, sweep.options, step))[name])
    verdict = classify(steps, errors, allowed, unit)
    least, step = min([(hardest_errors[name], best.step), *zip(errors, steps, strict=True)])
    where = "this machine" if sweep.last == 0 else "a neighbour"
    reached = (
        f"the best, {sweep.options.name!r} at {step:g} s, has an error of the {name} of "
        f"{least:.1e} {unit} on {where}, where {allowed:.1e} {unit} are asked"
    )
    return Verdict(verdict.obstacle, f"{reached}; {verdict.sentence}.")


# The public function

NEIGHBOURS = 32
_MOST_NEIGHBOURS = 200
_DRAWS = 10  # to a neighbour: some do not come to the same end


def recommend(
    model: Model = "fixed",
    engines: Engines | None = None,
    *,
    position: float | None = None,
    torque: float | str | None = None,
    release: float | None = None,
    neighbours: int = NEIGHBOURS,
    **how: Unpack[RunOptions],
) -> Advice:
    """Find each engine's cheapest measured settings that reach an accuracy, or what bars it.

        >>> import trebucheck as tb
        >>> advice = tb.recommend("rolling", "mujoco", position=1e-3)  # doctest: +SKIP
        >>> print(advice.engine("mujoco").snippets["trebucheck in Python"])  # doctest: +SKIP

    Args:
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        engines: one or several names; all but the reference if left out.
        position: largest distance of any marker from the reference that is allowed [m].
        torque: largest error of any stop's torque [N m, or N on points], or a share of the largest:
            '0.1%'.
        release: largest error of any stop's release [s].
        neighbours: machines of the same kind that the settings must hold on, too; 0: only the
            machine itself.
        how: runs are made; see :class:`..runs.study.RunOptions`. Settings are what is looked for:
            options of engines are not used.

    Raises:
        InputError: nothing is asked, or a name or value is not valid. A run that fails raises
            nothing.
    """
    if position is None and torque is None and release is None:
        raise InputError("nothing is asked; give at least one of position, torque and release.")
    text = torque if isinstance(torque, str | None) else repr(float(torque))
    asked = Accuracy(position=position, release=release, **(read_torque(text) if text else {}))
    return recommend_study(Study.of(model, engines, **how), asked, neighbours)


def recommend_study(study: Study, asked: Accuracy, neighbours: int = NEIGHBOURS) -> Advice:
    """Search settings for a study of one model; see :func:`recommend`.

    Of a mechanism of your own masses and gravity are varied. The study's presets and options are
    not used.

    Raises:
        InputError: a name or value is not valid, the end does not come, or the reference is not
            certain enough to judge the target. A run that fails raises nothing.
    """
    study = study.on_idle_cores()
    (model,), (mechanism,) = study.models, study.mechanisms
    if not 0 <= neighbours <= _MOST_NEIGHBOURS:
        raise InputError(f"neighbours = {neighbours} must be between 0 and {_MOST_NEIGHBOURS}.")
    if not isinstance(model, str) and study.parameters is not None:
        raise InputError("parameters are for named machines; a mechanism holds its own values.")
    names = study.measured_engines
    source = of_mechanism(mechanism)
    varied = (
        f"masses up to {MASS:g} times, gravity up to {GRAVITY:g} times (or as many times less)"
        "; its geometry was not varied"
    )
    if isinstance(model, str) and model in models():
        source = of_parameters(model, study.parameters)
        varied = (
            f"lengths up to {LENGTH:g} times, masses up to {MASS:g} times (or as many times less), "
            f"start angles within {ANGLE:g} rad"
        )
    with study.worker() as worker:

        def case(mechanism: Mechanism, until: Until, predictable: bool = False) -> TargetedRuns:
            law = study.law_of(study.mechanisms[0])
            runner = Runner(mechanism, worker, until, law, predictable=predictable)
            return TargetedRuns(EngineRuns(runner, study.store, curves=False), asked)

        end = study.end_of(mechanism)
        first = case(mechanism, end)
        first.refuse_what_cannot_be_judged()
        trials, launch_time = first.trials, first.trials.runner.launch_time
        # A stop that opens once and for all is a law that no engine alone can follow where a motion
        # comes back to it: the neighbours of a machine that does not come back do not either.
        meets_again = _meets_again(trials)
        # What launches has neighbours that launch: another one is no trebuchet.
        until = replace(end, required=launch_time is not None or end.required)
        predictable = trials.end == trials.runner.end  # then so are its neighbours

        def solved(neighbour: Neighbour) -> tuple[TargetedRuns, NeighbourMachine] | None:
            """The neighbour; None where its motion has not the same end, or cannot be solved."""
            machine, changes = neighbour
            try:
                runs = case(machine, until, predictable)
            except StudyEndedError:
                raise
            except TrebucheckError:
                return None
            if not meets_again and _meets_again(runs.trials):
                return None
            return runs, NeighbourMachine(made_with=changes, mechanism_hash=machine.content_hash)

        cases, rows = [first], list[NeighbourMachine]()
        draws = islice(source, _DRAWS * neighbours)
        with closing(in_order(solved, draws, study.at_once, ahead=2 * study.at_once)) as drawn:
            for runs, row in islice(filter(None, drawn), neighbours):
                cases.append(runs)
                rows.append(row)
        sets = dict.fromkeys(names, tuple[OptionSet, ...]())
        for name in names:
            if engine_class(name).is_installed():
                sets[name] = option_sets(name)
        count = Counter(sum(map(len, sets.values())), study.progress)
        advice: list[EngineAdvice] = []
        for name in names:
            steps = Ladder.of(trials.time_scale, trials.runner.end)
            search = Search(name, cases, steps, study.at_once, partial(_show, count, name))
            advice.append(_advice(search, sets[name], _model_arguments(study)))
    rule = "measured on this machine alone: nothing is said of any other"
    if rows:
        rule = (
            f"measured on this machine and {len(rows)} neighbours drawn at random ({varied}"
            f"{'' if meets_again else '; no motion goes through a stop that has opened'}); one in "
            f"{len(rows) + 1} machines so drawn is worse than all of these"
        )
    return Advice.made_here(
        **trials.compared_motion,
        asked=asked,
        rule=rule,
        neighbours=tuple(rows),
        measured_neighbours=len(rows),
        engines=tuple(advice),
        **study.times,
    )


def _meets_again(trials: EngineRuns) -> bool:
    """Tell whether the compared motion goes through a stop that does not close (again)."""
    solution, times = trials.solution, np.linspace(0.0, trials.end, _SAMPLES)
    if solution.problem.stop_law is not StopLaw.RELEASE_ONCE:
        return False
    q = solution.motion(times).q
    for stop in trials.mechanism.stops:
        opened = solution.release_times[stop.name] if stop.closed else 0.0
        gap = solution.equations.kinematics.gap(stop.name, q)
        if opened is not None and (gap[times > opened] < -_PENETRATED).any():
            return True
    return False


def _show(count: Counter, engine: str, options: str) -> None:
    count.start(f"{engine}: {options}")


def _advice(search: Search, sets: tuple[OptionSet, ...], words: Sequence[str]) -> EngineAdvice:
    """Settings of one engine; `words` name the machine on the command line."""
    name, mechanism = search.engine, search.cases[0].trials.mechanism
    advice = EngineAdvice(engine=name, engine_version=engine_class(name).version())
    if not sets:
        return advice.model_copy(update={"message": f"{name} is not installed here."})
    own = {each.name: _is_alone(name, each, mechanism) for each in sets}
    sweeps = search.sweeps([each for each in sets if own[each.name]])
    costs = [search.cost(sweep) for sweep in sweeps]
    # No cheaper than this, and the engine alone is recommended.
    bound = min(costs, default=math.inf) / _DEARER
    sweeps += search.sweeps([each for each in sets if not own[each.name]], bound)
    timed = search.timed(sweeps)
    alone = cheapest([each for each in timed if own[each.sweep.options.name]])
    below = math.inf if alone is None else cost_of(alone.run) / TIE
    assisted = cheapest([each for each in timed if not own[each.sweep.options.name]], below)
    advice = advice.model_copy(update={"attempts": tuple(map(_attempt, sweeps))})
    choices = [
        _choice(search, each, own[each.sweep.options.name], words)
        for each in (alone, assisted)
        if each is not None
    ]
    if not choices:
        verdict = explain(search, sweeps)
        return advice.model_copy(update={"obstacle": verdict.obstacle, "message": verdict.sentence})
    first, *second = choices
    update: dict[str, object] = {"choice": first, "assisted": next(iter(second), None)}
    followed = [sweep for sweep in sweeps if own[sweep.options.name]]
    if alone is None and followed:
        verdict = explain(search, followed, further=False)
        update |= {"obstacle": verdict.obstacle, "message": f"Alone: {verdict.sentence}"}
    return advice.model_copy(update=update)


def _is_alone(name: str, options: OptionSet, mechanism: Mechanism) -> bool:
    """Tell whether trebucheck does no part of a run with a set, but to read it."""
    supplied = stated(configured(name, options, _LONGEST), mechanism)
    return supplied is not None and only_read(supplied)


def _attempt(sweep: Sweep) -> Attempt:
    reached, worst = sweep.reached, sweep.least
    return Attempt(
        options=sweep.options.name,
        words=sweep.options.description,
        step=reached.step if reached else None,
        wall_time=reached.trials[0].wall_times[0] if reached else None,
        steps_tried=tuple(sorted(sweep.rungs, reverse=True)),
        worst=worst if math.isfinite(worst) else None,
        note=sweep.note if reached or sweep.last == 0 else f"on a neighbour, {sweep.note}",
    )


def _choice(search: Search, found: TimedSweep, alone: bool, words: Sequence[str]) -> Choice:
    cases, options, rung = search.cases, found.sweep.options, found.rung
    walls, changes = sorted(found.run.wall_times), options.all_options(rung.step)
    others = [cases[i].reported(trial) for i, trial in rung.trials.items() if i != 0]
    worst: dict[str, float | None] = {}
    for name in Errors.model_fields:  # None if it is missing anywhere
        values: list[float | None] = [getattr(errors, name) for errors in others]
        known = [value for value in values if value is not None]
        worst[name] = max(known, default=None) if len(known) == len(values) else None
    trials = cases[0].trials
    duration = trials.runner.end
    if trials.runner.launch_time:
        duration = _TO_A_LAUNCH * trials.time_scale
    return Choice(
        alone=alone,
        options=options.name,
        words=options.description,
        preset=options.preset,
        changes={k: list(v) if isinstance(v, tuple) else v for k, v in changes.items()},
        settings=found.run.settings,
        step=rung.step,
        here=cases[0].reported(rung.trials[0]),
        worst_neighbour=Errors(**worst) if others else None,
        longest_tried=rung.step == search.ladder.steps[0],
        wall_time=walls[len(walls) // 2],
        wall_times=found.run.wall_times,
        snippets=snippets(
            search.engine, trials.mechanism, options.preset, changes, words, duration
        ),
    )


# Texts to paste

COMMAND, PYTHON = "trebucheck on the command line", "trebucheck in Python"
_TO_A_LAUNCH = 2.0  # characteristic times: most launches come by then


def _model_arguments(study: Study) -> list[str]:
    """Arguments of the command line that name the machine and the end."""
    (model,), (mechanism,) = study.models, study.mechanisms
    words = ["--model", f"{mechanism.name}.json"]
    if isinstance(model, str):
        words, defaults = ["--model", model], parameters_type(model)()
        usual = defaults.model_dump()
        for name, value in (study.parameters or defaults).model_dump().items():
            if value != usual[name]:
                words += ["--set", f"{name}={value!r}"]
    return words if study.until is None else [*words, "--until", str(study.until)]


def snippets(
    name: str,
    mechanism: Mechanism,
    preset: str,
    changes: Mapping[str, Any],
    words: Sequence[str] = (),
    duration: float | None = None,
) -> dict[str, str]:
    """Texts to paste, by what they are for; the trebucheck ones last.

    Args:
        name: of the engine.
        mechanism: the machine they are for.
        preset: the settings start from.
        changes: options set over the preset, the time step included.
        words: how the machine is named on the command line; by its name if left out.
        duration: that is simulated [s]; two characteristic times if left out.
    """
    settings = engine(name, preset, **changes)
    if duration is None:
        duration = _TO_A_LAUNCH * characteristic_time(mechanism)
    machine = map(shlex.quote, words or ("--model", mechanism.name))
    command = ["trebucheck", "run", "--engine", name, *machine, "--preset", preset]
    for key, value in changes.items():
        if key == "timestep":
            command += ["--timestep", repr(value)]
        else:
            text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
            command += ["--option", shlex.quote(f"{key}={text}")]
    options = "".join(f", {key}={value!r}" for key, value in changes.items())
    python = f'import trebucheck as tb\n\nengine = tb.engine("{name}", "{preset}"{options})'
    texts = engine_study(name).snippets(settings, mechanism, float(f"{duration:.3g}"))
    return {**texts, COMMAND: " ".join(command), PYTHON: python}
