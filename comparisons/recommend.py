"""Recommended settings of engines for a wanted accuracy; every recommended step was measured.

For each engine there are a few sets of options from default to assisted, and a ladder of time
steps. A set adds to the one before it what changes most. How much each change buys is measured, not
assumed: the order here only decides which of two equally quick sets is recommended, the plainer.

Neighbours are machines of the same kind, drawn at random, each independently of the others. A set
is first run at one moderate step on the machine and all its neighbours; those on which it did worst
go on with it: at every further step the machine and these must reach what is asked. Of n machines
so drawn and one more, each is as likely as any other to be the worst; so a fresh one from the same
ranges is worse than the worst of n in one case of n + 1, whatever the distribution of their errors.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from itertools import islice
from typing import Annotated, Any, Literal, NamedTuple, Self, Unpack

import numpy as np
from pydantic import Field, JsonValue, model_validator

from ..engines.protocol import Engine
from ..engines.registry import Engines, engine, engine_class, engine_study, presets_of
from ..engines.study import OptionSet
from ..models.errors import InputError, TrebucheckError
from ..models.library.registry import Model, models, parameters_type
from ..models.library.registry import model as named_model
from ..models.mechanism import Body, Mechanism
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


class Asked(Spec):
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
    wall_time: Real = Field(description="median, of the machine asked about, warm [s]")
    wall_times: tuple[Real, ...] = Field(description="[s]")


class EngineAdvice(Spec):
    """Settings for one engine, or why there are none."""

    engine: str
    engine_version: str
    choice: Choice | None
    obstacle: Obstacle | None = None
    message: str | None = Field(
        default=None, description="what was reached and what stands in the way"
    )
    attempts: tuple[Attempt, ...] = ()
    snippets: dict[str, str] = Field(
        default_factory=dict, description="texts to paste, by what they are for"
    )


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
    asked: Asked
    rule: str = Field(description="what the settings were measured on")
    neighbours: tuple[NeighbourMachine, ...]
    measured_neighbours: Annotated[int, Field(ge=0)] = Field(
        description="the hardest, measured at every step tried"
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
_SAMPLES = 2001  # of the reference, in search of the largest torque


@dataclass(frozen=True)
class TargetedRuns:
    """Runs on one machine, and the errors that they may have."""

    trials: EngineRuns
    target: Asked

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
                "no error of a release can be asked."
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

RUNGS = 8
# Of the machine's characteristic time. At twice this step even the best sets are not yet in the
# range where their errors follow the order, and one machine says little of another.
_LONGEST = 1 / 150
SCREENED_AT = 1  # index of the time step, of the steps tried, at which all neighbours are run
HARDEST = 6  # neighbours that go on
_SCOUTED_AT = 3  # index of the step at which the hardest machine shows how its error falls
_ORDERS = (0.1, 4.0)  # between which an order found over two steps is believed
_DOUBT = 0.5  # error of such an order: a release inside a step scatters the errors
_GAIN = 0.7  # the next level at least halves the step: an error of first order would halve, too
_PATIENCE = 2  # levels without gain, before a set is given up
_DEARER = 1.5  # times the cheapest found so far: further down, a set can only cost more
_TINY = 1e-12  # times what is asked: as good as nothing
_REPEATS = 3
_TIE = 1.2  # times of runs of some 10 ms repeat no better than to this factor


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Option sets of an engine, from plain to assisted; its presets where its study has none."""
    return engine_study(name).option_sets or tuple(
        OptionSet(preset, f"its preset {preset!r}", preset) for preset in presets_of(name)
    )


def configured(name: str, options: OptionSet, step: float) -> Engine:
    """An engine with the options of a set at a time step [s]."""
    return engine(name, options.preset, **options.all_options(step))


def ladder(characteristic_time: float) -> tuple[float, ...]:
    """Time steps of 1, 2 and 5 times a power of ten, downwards [s]: small machines move quickly."""
    longest = characteristic_time * _LONGEST
    exponent = math.floor(math.log10(longest))
    first = max(i for i, f in enumerate((1, 2, 5)) if f * 10.0**exponent <= longest * (1 + 1e-12))
    steps: list[float] = []
    for position in range(first, first - RUNGS, -1):
        steps.append(float(f"{(1, 2, 5)[position % 3]}e{exponent + position // 3}"))
    return tuple(steps)


@dataclass(frozen=True)
class RefinementLevel:
    """One refinement level: a time step, and the worst of the machines measured with it."""

    step: float  # [s]
    worst: float  # largest error over what is allowed
    hardest: int  # index of the machine of that
    trials: dict[int, RunRecord]  # by index of the machine; the machine asked about is 0

    @property
    def reached(self) -> bool:
        """Tell whether every machine measured reaches what is asked."""
        return self.worst <= 1


@dataclass
class Sweep:
    """One set of options over the time steps tried."""

    options: OptionSet
    levels: dict[float, RefinementLevel] = field(default_factory=dict[float, RefinementLevel])
    note: str = ""
    dropped: bool = False  # by what one machine showed: no step was run on the others

    @property
    def reached(self) -> RefinementLevel | None:
        """The level of the longest step that reaches the target on all machines it must."""
        if self.dropped:
            return None
        levels = [level for level in self.levels.values() if level.reached]
        return max(levels, key=lambda level: level.step, default=None)

    @property
    def best(self) -> RefinementLevel:
        """The level with the least worst error; of equals the one of the longest step."""
        return min(self.levels.values(), key=lambda level: (level.worst, -level.step))


@dataclass
class Search:
    """Searches the time steps of one engine for each set of options."""

    engine: str
    cases: Sequence[TargetedRuns]
    steps: Sequence[float]
    jobs: int = 1  # neighbours that are run at once
    cheapest: float = math.inf  # wall time of the cheapest settings found so far [s]
    _hardest: int | None = field(default=None, init=False)
    """Index of the machine the first set did worst on."""

    def sweep(self, options: OptionSet) -> Sweep:
        """Give up at once, or measure all machines at one step, and refine from there."""
        sweep = Sweep(options)
        if self._hardest is not None:
            # The machine that the first set did worst on may rule this one out.
            panel = [self._hardest]
            screened = self._level(sweep, panel, SCREENED_AT)
            if math.isfinite(screened.worst) and not screened.reached:
                guess = self._guess(sweep, panel)
                if guess is not None and self._is_dearer(screened.trials[self._hardest], guess):
                    sweep.note = "by the order found, it would cost more than what is recommended"
                    guess = None
                if guess is None:
                    sweep.dropped = True
                    return sweep
        sweep.levels.clear()
        panel = self._screen(sweep)
        if self._hardest is None:
            self._hardest = panel[0]
        start = self._guess(sweep, panel)
        if start is not None and self._level(sweep, panel, start).reached:
            longer = start - 1
            while longer >= 0 and self._level(sweep, panel, longer).reached:
                longer -= 1
            sweep.note = "reached at the longest step tried"
            if longer >= 0:
                sweep.note = "reached; a longer step does not"
        elif start is not None:
            self._shorten(sweep, panel, start)
        if sweep.reached:
            self.cheapest = min(self.cheapest, _wall(sweep.reached.trials[0]))
        return sweep

    def _is_dearer(self, screened: RunRecord, index: int) -> bool:
        """Tell whether a step must cost more than the cheapest settings found so far."""
        wall = _wall(screened) * self.steps[SCREENED_AT] / self.steps[index]
        return wall > _DEARER * self.cheapest

    def _screen(self, sweep: Sweep) -> list[int]:
        """Run the machine itself and its hardest neighbours at one step, the hardest first."""
        step = self.steps[SCREENED_AT]

        def trial(case: int) -> RunRecord:
            return self.trial(case, sweep.options, step)

        # The machine's own run is timed, with nothing beside it; of the others only the errors are
        # asked for.
        trials = [trial(0)]
        with closing(in_order(trial, range(1, len(self.cases)), self.jobs)) as others:
            trials += others
        ratios = [case.ratio(trial) for case, trial in zip(self.cases, trials, strict=True)]
        hardest = sorted(range(1, len(ratios)), key=lambda i: -ratios[i])[:HARDEST]
        panel = sorted([0, *hardest], key=lambda i: -ratios[i])
        chosen = {i: trials[i] for i in panel}
        sweep.levels[step] = RefinementLevel(step, ratios[panel[0]], panel[0], chosen)
        return panel

    def trial(self, case: int, options: OptionSet, step: float, repeats: int = 1) -> RunRecord:
        """Run of a set of options at a step [s] on a machine, by its index."""
        return self.cases[case].trials.record(configured(self.engine, options, step), repeats)

    def _guess(self, sweep: Sweep, panel: list[int]) -> int | None:
        """Index of the longest step that should do; None if by the order found none can."""
        screened, finest = sweep.levels[self.steps[SCREENED_AT]], self.steps[-1]
        if not math.isfinite(screened.worst):
            return SCREENED_AT + 1
        if screened.reached:
            longest = screened.step / max(screened.worst, _TINY) ** (1 / _ORDERS[1])
            return self._first_step_within(longest)
        scouted = self._level(sweep, panel, _SCOUTED_AT)
        if scouted.reached or not math.isfinite(scouted.worst):
            return _SCOUTED_AT
        order = math.log(screened.worst / scouted.worst) / math.log(screened.step / scouted.step)
        likely, at_best = (min(max(p, _ORDERS[0]), _ORDERS[1]) for p in (order, order + _DOUBT))
        if scouted.step / scouted.worst ** (1 / at_best) < finest:
            sweep.note = f"by the order found, {order:.1f}, no step down to {finest:g} s will do"
            return None
        return self._first_step_within(scouted.step / scouted.worst ** (1 / likely))

    def _first_step_within(self, longest: float) -> int:
        within = (i for i, step in enumerate(self.steps) if step <= longest)
        return next(within, len(self.steps) - 1)

    def _shorten(self, sweep: Sweep, panel: list[int], index: int) -> None:
        """Try shorter steps, as long as they help and cost less than what is recommended."""
        screened = sweep.levels[self.steps[SCREENED_AT]].trials[0]
        before, idle = self._level(sweep, panel, index), 0
        for step in range(index + 1, len(self.steps)):
            if self._is_dearer(screened, step):
                sweep.note = "a shorter step would cost more than what is recommended"
                return
            now = self._level(sweep, panel, step)
            if now.reached:
                sweep.note = "reached; a longer step does not"
                return
            idle = 0 if now.worst < _GAIN * before.worst else idle + 1
            if idle == _PATIENCE:
                sweep.note = "shorter steps do not help any more"
                return
            before = now
        sweep.note = "not reached at the shortest step tried"

    def _level(self, sweep: Sweep, panel: list[int], index: int) -> RefinementLevel:
        """Run the panel at a step, the hardest first, up to the first that misses the target."""
        step = self.steps[index]
        if step in sweep.levels:
            return sweep.levels[step]
        trials: dict[int, RunRecord] = {}
        worst, hardest = 0.0, panel[0]
        for i in panel:
            trials[i] = self.trial(i, sweep.options, step)
            ratio = self.cases[i].ratio(trials[i])
            if ratio >= worst:
                worst, hardest = ratio, i
            if worst > 1:
                break
        sweep.levels[step] = RefinementLevel(step, worst, hardest, trials)
        return sweep.levels[step]

    def chosen(self, sweeps: Sequence[Sweep]) -> tuple[Sweep, RefinementLevel, RunRecord] | None:
        """Find the cheapest that reaches the target; the plainest of those of equal cost."""
        candidates: list[tuple[Sweep, RefinementLevel, RunRecord]] = []
        for sweep in sweeps:
            level = sweep.reached
            if level is not None and _wall(level.trials[0]) <= _DEARER * self.cheapest:
                repeated = self.trial(0, sweep.options, level.step, _REPEATS)
                candidates.append((sweep, level, repeated))
        cheapest = min((_wall(trial) for _, _, trial in candidates), default=math.inf)
        return next((row for row in candidates if _wall(row[2]) <= _TIE * cheapest), None)


def _wall(trial: RunRecord) -> float:
    """Median wall time [s]; infinite for a run that failed."""
    return float(np.median(trial.wall_times)) if trial.wall_times else math.inf


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


def explain(search: Search, sweeps: Sequence[Sweep]) -> Verdict:
    """Say why no set of an engine reaches the target: the best set, on its worst machine.

    All steps from the screened one down are measured for it.
    """
    sweep = min(sweeps, key=lambda sweep: sweep.best.worst)
    level = sweep.best
    case = search.cases[level.hardest]
    if not math.isfinite(level.worst):
        trials = (trial for tried in sweep.levels.values() for trial in tried.trials.values())
        messages = (trial.message for trial in trials if trial.message)
        return Verdict(Obstacle.FAILURE, next(messages, "a stop does not release"))
    hardest_errors = case.errors(level.trials[level.hardest])
    # The quantity that is furthest off; two of them have two causes, but the first must go before
    # the second shows.
    name = max(case.allowed, key=lambda name: hardest_errors[name] / case.allowed[name])
    allowed, unit = case.allowed[name], unit_of(name, case.trials.mechanism)
    steps, errors = search.steps[SCREENED_AT:], list[float]()
    for step in steps:
        errors.append(case.errors(search.trial(level.hardest, sweep.options, step))[name])
    verdict = classify(steps, errors, allowed, unit)
    least, step = min([(hardest_errors[name], level.step), *zip(errors, steps, strict=True)])
    where = "this machine" if level.hardest == 0 else "its hardest neighbour"
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
    asked = Asked(position=position, release=release, **(read_torque(text) if text else {}))
    return recommend_study(Study.of(model, engines, **how), asked, neighbours)


def recommend_study(study: Study, asked: Asked, neighbours: int = NEIGHBOURS) -> Advice:
    """Search settings for a study of one model; see :func:`recommend`.

    Of a mechanism of your own masses and gravity are varied. The study's presets and options are
    not used.

    Raises:
        InputError: a name or value is not valid, the end does not come, or the reference is not
            certain enough to judge the target. A run that fails raises nothing.
    """
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
        # What launches has neighbours that launch: another one is no trebuchet.
        until = replace(end, required=launch_time is not None or end.required)
        predictable = trials.end == trials.runner.end  # then so are its neighbours

        def solved(neighbour: Neighbour) -> tuple[TargetedRuns, NeighbourMachine] | None:
            """The neighbour; None where its motion has not the same end, or cannot be solved."""
            machine, changes = neighbour
            try:
                runs = case(machine, until, predictable)
            except TrebucheckError:
                return None
            return runs, NeighbourMachine(made_with=changes, mechanism_hash=machine.content_hash)

        cases, rows = [first], list[NeighbourMachine]()
        draws = islice(source, _DRAWS * neighbours)
        with closing(in_order(solved, draws, study.jobs, ahead=2 * study.jobs)) as drawn:
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
            search = Search(name, cases, ladder(trials.time_scale), study.jobs)
            advice.append(_advice(search, sets[name], _model_arguments(study), count))
    rule, measured = "measured on this machine alone: nothing is said of any other", 0
    if rows:
        measured = min(HARDEST, len(rows))
        rule = (
            f"measured on this machine and the worst {measured} of {len(rows)} neighbours "
            f"drawn at random ({varied}); one in {len(rows) + 1} machines so drawn is worse "
            "than all of these"
        )
    return Advice.made_here(
        **trials.compared_motion,
        asked=asked,
        rule=rule,
        neighbours=tuple(rows),
        measured_neighbours=measured,
        engines=tuple(advice),
        jobs=study.timed_at_once,
    )


def _advice(
    search: Search, sets: tuple[OptionSet, ...], words: Sequence[str], count: Counter
) -> EngineAdvice:
    """Settings of one engine; `words` name the machine on the command line."""
    name, trials = search.engine, search.cases[0].trials
    advice = EngineAdvice(engine=name, engine_version=engine_class(name).version(), choice=None)
    if not sets:
        return advice.model_copy(update={"message": f"{name} is not installed here."})
    sweeps: list[Sweep] = []
    # The most accurate first: what the others may cost follows from it
    for options in reversed(sets):
        count.start(f"{name}: {options.name}")
        sweeps.insert(0, search.sweep(options))
    chosen = search.chosen(sweeps)
    attempts: list[Attempt] = []
    for sweep in sweeps:
        reached, worst = sweep.reached, sweep.best.worst
        attempts.append(
            Attempt(
                options=sweep.options.name,
                words=sweep.options.description,
                step=reached.step if reached else None,
                wall_time=reached.trials[0].wall_times[0] if reached else None,
                steps_tried=tuple(sorted(sweep.levels, reverse=True)),
                worst=worst if math.isfinite(worst) else None,
                note=sweep.note,
            )
        )
    advice = advice.model_copy(update={"attempts": tuple(attempts)})
    if chosen is None:
        verdict = explain(search, sweeps)
        return advice.model_copy(update={"obstacle": verdict.obstacle, "message": verdict.sentence})
    choice = _choice(search.cases, *chosen)
    changes, duration = chosen[0].options.all_options(choice.step), trials.runner.end
    if trials.runner.launch_time:
        duration = _TO_A_LAUNCH * trials.time_scale
    texts = snippets(name, trials.mechanism, choice.preset, changes, words, duration)
    return advice.model_copy(update={"choice": choice, "snippets": texts})


def _choice(
    cases: Sequence[TargetedRuns], sweep: Sweep, level: RefinementLevel, repeated: RunRecord
) -> Choice:
    walls, options = sorted(repeated.wall_times), sweep.options
    changes = options.all_options(level.step)
    others = [cases[i].reported(trial) for i, trial in level.trials.items() if i != 0]
    worst: dict[str, float | None] = {}
    for name in Errors.model_fields:  # None if it is missing anywhere
        values: list[float | None] = [getattr(errors, name) for errors in others]
        known = [value for value in values if value is not None]
        worst[name] = max(known, default=None) if len(known) == len(values) else None
    return Choice(
        options=options.name,
        words=options.description,
        preset=options.preset,
        changes={k: list(v) if isinstance(v, tuple) else v for k, v in changes.items()},
        settings=repeated.settings,
        step=level.step,
        here=cases[0].reported(level.trials[0]),
        worst_neighbour=Errors(**worst) if others else None,
        wall_time=walls[len(walls) // 2],
        wall_times=repeated.wall_times,
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
