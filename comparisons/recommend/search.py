"""Search for the cheapest settings that reach an accuracy; every recommended step was measured.

A set of options is first run at one moderate step on the machine and all its neighbours. The
neighbours on which it did worst go on with it: at every further step the machine and these must
reach what is asked.

For each engine there are a few sets of options from plain to tuned, and a ladder of time steps. A
set adds to the one before it what changes most. How much each change buys is measured, not assumed:
the order here only decides which of two equally quick sets is recommended, the plainer one.

Neighbours are machines of the same kind, drawn at random, each independently of the others.
Of n machines so drawn and one more, each is as likely as any other to be the worst; so a fresh one
from the same ranges is worse than the worst of n in one case of n + 1, whatever the distribution of
their errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_study
from ...engines.study import OptionSet
from ...models.errors import InputError, TrebucheckError
from ...models.library.registry import model, parameters_type
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ...reference.certification.certificate import refusal
from ..runs.process import in_order
from ..runs.record import EngineRuns, RunRecord
from .results import Asked, Errors, Obstacle

_METRICS = {"position": "position_max", "torque": "stop_torque_max", "release": "release_time"}
_SAMPLES = 2001  # of the reference, in search of the largest torque


@dataclass(frozen=True)
class TargetedRuns:
    """A machine with its trials and its accuracy target."""

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
        target = self.target
        torque = (
            target.torque
            if target.torque_share is None
            else target.torque_share * self.largest_torque
        )
        limits = {"position": target.position, "torque": torque, "release": target.release}
        return {name: value for name, value in limits.items() if value is not None}

    def refuse_what_cannot_be_judged(self) -> None:
        """Refuse a quantity that the machine lacks, or whose reference is too uncertain to judge.

        Raises:
            InputError: the sentence names the quantity.
        """
        mechanism = self.trials.mechanism
        if not any(stop.closed for stop in mechanism.stops) and {"torque", "release"} & set(
            self.allowed
        ):
            raise InputError(
                f"{mechanism.name!r} has no stop that is closed at the start: only a position "
                f"can be asked."
            )
        if "release" in self.allowed and not self._due:
            raise InputError(
                f"no stop of {mechanism.name!r} releases within the compared "
                f"{self.trials.end:.6g} s: no error of a "
                "release can be asked."
            )
        if self.target.torque_share is not None and self.largest_torque == 0:
            raise InputError(
                f"no stop of {mechanism.name!r} pushes: its torque can only be asked in "
                f"{self.unit('torque')}."
            )
        for quantity, value in self.allowed.items():
            refused = refusal(
                _METRICS[quantity], None, value, self.trials.uncertainty(_METRICS[quantity])
            )
            if refused is not None:
                raise InputError(f"{quantity} = {value:g} {self.unit(quantity)}: {refused}.")

    def unit(self, quantity: str) -> str:
        """Unit of a quantity, on this machine."""
        return unit_of(quantity, self.trials.mechanism)

    def errors(self, trial: RunRecord) -> dict[str, float]:
        """Errors by quantity; infinite where the run failed or a release did not come."""
        if not trial.ran:
            return dict.fromkeys(_METRICS, math.inf)
        position, torque = trial.position, trial.torque
        return {
            "position": math.inf if position is None else position,
            "torque": math.inf if torque is None else torque,
            "release": self._release_error(trial),
        }

    @property
    def _due(self) -> list[str]:
        """Stops closed at the start that the reference releases within the compared time."""
        mechanism, times = self.trials.mechanism, self.trials.solution.release_times
        due = [name for name, time in times.items() if time is not None and time <= self.trials.end]
        return [name for name in due if mechanism.stop(name).closed]

    def _release_error(self, trial: RunRecord) -> float:
        values = [trial.value("release_time", name) for name in self._due]
        return max((math.inf if value is None else abs(value) for value in values), default=0.0)

    def ratio(self, trial: RunRecord) -> float:
        """The largest error over what is allowed: up to 1 it is reached."""
        errors = self.errors(trial)
        return max(
            errors[name] / allowed if allowed else math.inf
            for name, allowed in self.allowed.items()
        )

    def described(self, trial: RunRecord) -> Errors:
        """Errors as the report has them."""
        errors = {
            name: value if math.isfinite(value) else None
            for name, value in self.errors(trial).items()
        }
        if not self._due:
            errors["release"] = None
        torque, peak = errors["torque"], self.largest_torque
        return Errors(**errors, torque_share=None if torque is None or peak == 0 else torque / peak)


def unit_of(quantity: str, mechanism: Mechanism) -> str:
    """Unit of a quantity that can be asked for."""
    return {"position": "m", "torque": mechanism.force_unit, "release": "s"}[quantity]


def read_torque(text: str) -> dict[str, float]:
    """Read '1e-3' as N m (or N) and '0.1%' as a share: the field of the target, and its value.

    Raises:
        InputError: it is no number.
    """
    number = text.strip()
    share = number.endswith("%")
    try:
        value = float(number.removesuffix("%"))
    except ValueError:
        raise InputError(
            f"--torque {text!r} is not a number of N m, or N (1e-3), nor a share of the largest "
            f"stop torque (0.1%)."
        ) from None
    return {"torque_share": value / 100} if share else {"torque": value}


LENGTH, MASS, ANGLE, GRAVITY = 1.4, 2.5, 0.3, 1.4
"""Lengths, masses and gravity are varied up to these factors, up and down; start angles by that
much [rad].
"""
_LENGTHS, _MASSES, _ANGLES = (
    ("l1", "l2", "r", "h"),
    ("m_b", "m_cw", "m_a"),
    ("theta0", "phi0", "alpha0"),
)
_SEED = 1  # the family is the same in every run
Neighbour = tuple[Mechanism, dict[str, float]]
"""A machine, and the parameters (or factors) it was made with."""


def of_parameters(name: str, parameters: Spec | None) -> Iterator[Neighbour]:
    """Generate neighbours of a named machine without end: lengths, masses and start angles varied.

    Gravity is kept.
    """
    kind = parameters_type(name)
    base = (parameters or kind()).model_dump()
    random = np.random.default_rng(_SEED)
    while True:
        own = {key: base[key] * _factor(random, LENGTH) for key in _LENGTHS if key in base}
        own |= {key: base[key] * _factor(random, MASS) for key in _MASSES if key in base}
        own |= {
            key: base[key] + float(random.uniform(-ANGLE, ANGLE)) for key in _ANGLES if key in base
        }
        yield from _built(lambda own=own: model(name, kind(**(base | own))), own)


def of_mechanism(mechanism: Mechanism) -> Iterator[Neighbour]:
    """Generate neighbours of any mechanism without end: masses, with inertia, and gravity varied.

    The geometry is kept.
    """
    random = np.random.default_rng(_SEED)
    while True:
        factors = {f"mass of {body.name}": _factor(random, MASS) for body in mechanism.bodies}
        gravity = _factor(random, GRAVITY)
        yield from _built(
            lambda factors=factors, gravity=gravity: _scaled(
                mechanism, list(factors.values()), gravity
            ),
            factors | {"gravity": gravity},
        )


def _factor(random: np.random.Generator, largest: float) -> float:
    return float(math.exp(random.uniform(-1.0, 1.0) * math.log(largest)))


def _scaled(mechanism: Mechanism, factors: list[float], gravity: float) -> Mechanism:
    bodies = tuple(
        body.model_copy(update={"mass": body.mass * factor, "inertia": body.inertia * factor})
        for body, factor in zip(mechanism.bodies, factors, strict=True)
    )
    return mechanism.model_copy(update={"bodies": bodies, "gravity": mechanism.gravity * gravity})


def _built(make: Callable[[], Mechanism], own: dict[str, float]) -> Iterator[Neighbour]:
    try:
        yield make(), own
    except TrebucheckError:
        return  # outside what a machine can be: the next draw will do


RUNGS = 8


# Of the machine's characteristic time. At twice this step even the best sets are not yet in the
# range where their errors follow the order, and one machine says little of another.
_LONGEST = 1 / 150
SCREENED_AT = 1
"""Index of the time step at which all neighbours are run, of the steps tried."""
HARDEST = 6
"""Neighbours that go on."""
_SCOUTED_AT = 3
"""Index of the time step at which the hardest machine shows how its error falls with the step."""
_ORDERS = (0.1, 4.0)  # between which an order found over two steps is believed
_DOUBT = 0.5  # error of such an order: a release inside a step scatters the errors
_GAIN = 0.7  # the next level at least halves the step: an error of first order would halve, too
_PATIENCE = 2  # levels without gain, before a set is given up
_DEARER = 1.5  # times the cheapest found so far: further down, a set can only cost more
_TINY = 1e-12  # times what is asked: as good as nothing
_REPEATS = 3
_TIE = 1.2  # times of runs of some 10 ms repeat no better than to this factor


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Option sets of an engine, from plain to tuned; its presets where its study has none."""
    presets = engine_class(name).presets()
    return engine_study(name).option_sets or tuple(
        OptionSet(preset, f"its preset {preset!r}", preset) for preset in sorted(presets)
    )


def configured(name: str, options: OptionSet, step: float) -> Engine:
    """An engine with the options of a set at a time step [s]."""
    return engine(name, options.preset, **options.all_options(step))


def ladder(characteristic_time: float) -> tuple[float, ...]:
    """Time steps of 1, 2 and 5 times a power of ten, downwards [s].

    Args:
        characteristic_time: of the machine [s]; a small machine moves quickly.
    """
    longest = characteristic_time * _LONGEST
    exponent = math.floor(math.log10(longest))
    first = max(factor for factor in (1, 2, 5) if factor * 10.0**exponent <= longest * (1 + 1e-12))
    steps: list[float] = []
    for rung in range(RUNGS):
        position = (1, 2, 5).index(first) - rung
        steps.append(float(f"{(1, 2, 5)[position % 3]}e{exponent + position // 3}"))
    return tuple(steps)


@dataclass(frozen=True)
class RefinementLevel:
    """One refinement level: a time step, and the worst of the machines measured with it."""

    step: float
    worst: float
    """Largest error over what is allowed."""
    hardest: int
    """Index of the machine of that."""
    trials: dict[int, RunRecord]
    """Trials by index of machine; the machine asked about is 0."""

    @property
    def reached(self) -> bool:
        """Whether every machine measured reaches what is asked."""
        return self.worst <= 1


@dataclass
class Sweep:
    """One set of options over the time steps tried."""

    options: OptionSet
    levels: dict[float, RefinementLevel] = field(default_factory=dict[float, RefinementLevel])
    note: str = ""
    dropped: bool = False
    """Given up by what one machine showed: none of its steps was run on the others."""

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
    jobs: int = 1
    """Neighbours that are run at once."""
    cheapest: float = math.inf
    """Wall time of the cheapest settings found so far [s]."""
    _hardest: int | None = field(default=None, init=False)
    """Index of the machine the first set did worst on."""

    def sweep(self, options: OptionSet) -> Sweep:
        """Give up at once, or measure all machines at one step, and refine from there."""
        sweep = Sweep(options)
        sweep.dropped = self._hardest is not None and self._is_hopeless(sweep, self._hardest)
        if sweep.dropped:
            return sweep
        sweep.levels.clear()
        panel = self._screen(sweep)
        self._hardest = panel[0] if self._hardest is None else self._hardest
        self._walk(sweep, panel)
        if sweep.reached:
            self.cheapest = min(self.cheapest, _wall(sweep.reached.trials[0]))
        return sweep

    def _is_hopeless(self, sweep: Sweep, case: int) -> bool:
        """Whether the machine that the first set did worst on rules the set out."""
        screened = self._level(sweep, [case], SCREENED_AT)
        if screened.reached or not math.isfinite(screened.worst):
            return False
        guess = self._guess(sweep, [case])
        if guess is not None and self._is_dearer(screened.trials[case], guess):
            sweep.note = "by the order found, it would cost more than what is recommended"
            return True
        return guess is None

    def _is_dearer(self, screened: RunRecord, index: int) -> bool:
        """Whether a step must cost more than the cheapest settings found so far."""
        return (
            _wall(screened) * self.steps[SCREENED_AT] / self.steps[index] > _DEARER * self.cheapest
        )

    def _screen(self, sweep: Sweep) -> list[int]:
        """Run the machine itself and its hardest neighbours at one step, the hardest first."""
        step = self.steps[SCREENED_AT]
        # The machine's own run is timed, with nothing beside it; of the others only the errors are
        # asked for.
        own, others = self._trial(0, sweep.options, step), range(1, len(self.cases))
        with closing(
            in_order(lambda i: self._trial(i, sweep.options, step), others, self.jobs)
        ) as found:
            trials = dict(enumerate((own, *found)))
        ratios = {i: self.cases[i].ratio(trial) for i, trial in trials.items()}
        hardest = sorted(list(ratios)[1:], key=lambda i: -ratios[i])[:HARDEST]
        panel = sorted([0, *hardest], key=lambda i: -ratios[i])
        sweep.levels[step] = RefinementLevel(
            step, ratios[panel[0]], panel[0], {i: trials[i] for i in panel}
        )
        return panel

    def _trial(self, case: int, options: OptionSet, step: float, repeats: int = 1) -> RunRecord:
        return self.cases[case].trials.record(configured(self.engine, options, step), repeats)

    def _walk(self, sweep: Sweep, panel: list[int]) -> None:
        start = self._guess(sweep, panel)
        if start is None:
            return
        if self._level(sweep, panel, start).reached:
            self._upwards(sweep, panel, start - 1)
        else:
            self._downwards(sweep, panel, start)

    def _guess(self, sweep: Sweep, panel: list[int]) -> int | None:
        """Index of the longest step that should do; None if by the order found none can."""
        screened, finest = sweep.levels[self.steps[SCREENED_AT]], self.steps[-1]
        if not math.isfinite(screened.worst):
            return SCREENED_AT + 1
        if screened.reached:
            return self._first_step_within(
                screened.step / max(screened.worst, _TINY) ** (1 / _ORDERS[1])
            )
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
        return next(
            (i for i, step in enumerate(self.steps) if step <= longest), len(self.steps) - 1
        )

    def _upwards(self, sweep: Sweep, panel: list[int], index: int) -> None:
        while index >= 0 and self._level(sweep, panel, index).reached:
            index -= 1
        sweep.note = (
            "reached; a longer step does not" if index >= 0 else "reached at the longest step tried"
        )

    def _downwards(self, sweep: Sweep, panel: list[int], index: int) -> None:
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
            trials[i] = self._trial(i, sweep.options, step)
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
                candidates.append(
                    (sweep, level, self._trial(0, sweep.options, level.step, _REPEATS))
                )
        if not candidates:
            return None
        cheapest = min(_wall(trial) for _, _, trial in candidates)
        return next(row for row in candidates if _wall(row[2]) <= _TIE * cheapest)

    def over_all_steps(self, sweep: Sweep, case: int) -> list[tuple[float, RunRecord]]:
        """One machine's trials at all steps from the screened one down, the longest first."""
        return [(step, self._trial(case, sweep.options, step)) for step in self.steps[SCREENED_AT:]]


def _wall(trial: RunRecord) -> float:
    """Median wall time [s]; infinite for a run that failed."""
    return float(np.median(trial.wall_times)) if trial.wall_times else math.inf


_RISES = 2.0  # times the least error: more than the scatter from a release inside a step
_FLAT = 1.5  # times the least error: within it, it does not depend on the step
_FALLS = 0.5  # order in the step, at the shortest steps: half of what the least accurate method has


@dataclass(frozen=True)
class Verdict:
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
    least = kept[best][1]
    after = kept[best:]
    if after[-1][1] > _RISES * least:
        return _rounding(after, unit)
    flat = [h for h, e in kept if e <= _FLAT * least]
    if len(flat) == len(kept):
        span = f"from {kept[0][0]:g} s to {kept[-1][0]:g} s"
        return Verdict(
            Obstacle.CONSTANT,
            f"it does not depend on the step ({least:.1e} {unit} {span}): another option "
            f"or the method itself sets it",
        )
    order = _slope(kept[-2:])
    if order >= _FALLS:
        return _falling(kept, order, allowed, unit)
    return Verdict(
        Obstacle.FLOOR,
        f"it no longer falls below a step of {flat[0]:g} s: a floor of {least:.1e} {unit} is met",
    )


def _rounding(after: Sequence[tuple[float, float]], unit: str) -> Verdict:
    (step, least), (last, grown) = after[0], after[-1]
    return Verdict(
        Obstacle.ROUNDING,
        f"it grows again below a step of {step:g} s ({least:.1e} {unit}, but {grown:.1e} {unit} "
        f"at {last:g} s, "
        f"as 1/step^{-_slope(after):.1f}), as rounding or what is left by the solver's "
        f"iteration does",
    )


def _falling(
    kept: Sequence[tuple[float, float]], order: float, allowed: float, unit: str
) -> Verdict:
    step, error = kept[-1]
    needed = step * (allowed / error) ** (1 / order)
    return Verdict(
        Obstacle.STEP,
        f"it is still falling at the shortest step tried ({error:.1e} {unit} at {step:g} s, "
        f"order {order:.1f}); by "
        f"that order some {needed:.1g} s would do, which was not measured",
    )


def _slope(points: Sequence[tuple[float, float]]) -> float:
    logs = np.log(np.array(points))
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def explain(search: Search, sweeps: Sequence[Sweep]) -> Verdict:
    """Say why no set of an engine reaches the target: the best set, on its worst machine.

    The whole ladder of steps is measured for it.
    """
    sweep = min(sweeps, key=lambda sweep: sweep.best.worst)
    level = sweep.best
    case = search.cases[level.hardest]
    messages = [
        trial.message
        for level in sweep.levels.values()
        for trial in level.trials.values()
        if trial.message
    ]
    if not math.isfinite(level.worst):
        return Verdict(Obstacle.FAILURE, messages[0] if messages else "a stop does not release")
    measured = search.over_all_steps(sweep, level.hardest)
    steps, errors = [h for h, _ in measured], [case.errors(trial) for _, trial in measured]
    hardest_errors = case.errors(level.trials[level.hardest])
    # The quantity that is furthest off; two of them have two causes, but the first must go before
    # the second shows.
    name = max(case.allowed, key=lambda name: hardest_errors[name] / case.allowed[name])
    along = [error[name] for error in errors]
    verdict = classify(steps, along, case.allowed[name], case.unit(name))
    least, step = min([(hardest_errors[name], level.step), *zip(along, steps, strict=True)])
    reached = _reached(sweep, case, name, least, step, level.hardest)
    return Verdict(verdict.obstacle, f"{reached}; {verdict.sentence}.")


def _reached(
    sweep: Sweep, case: TargetedRuns, name: str, error: float, step: float, index: int
) -> str:
    where = "this machine" if index == 0 else "its hardest neighbour"
    unit, allowed = case.unit(name), case.allowed[name]
    return (
        f"the best, {sweep.options.name!r} at {step:g} s, has an error of the {name} of "
        f"{error:.1e} {unit} on {where}"
        f", where {allowed:.1e} {unit} are asked"
    )
