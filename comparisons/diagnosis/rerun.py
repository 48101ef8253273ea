"""Causes that only the engine shows: run with other settings, what then vanishes is theirs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from time import perf_counter
from typing import Self

import numpy as np

from ...engines.presets import ASSISTED
from ...engines.protocol import Engine
from ...engines.registry import causes_of, engine_study, presets_of, with_options
from ...engines.registry import engine as make
from ...engines.study import Intervention, Options, same_value
from ...engines.supplied import idle_options
from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ..runs.results import RankedCause
from ..runs.runner import run_duration
from .case import Case, share_of
from .rank import MOST_OF_IT, SAME, SUFFICIENT

Simulate = Callable[[Engine, Problem], Trajectory]

_STEP = "timestep"
_HALVINGS = 3  # of a step: an eighth leaves an eighth of a first-order error
_TRIED = 2  # of them, after which a step that takes out next to nothing is given up
_MANY_STEPS = 50_000  # of a run: more than the paper's machines take with any preset
_ROUNDING = 1e-9  # of a deviation: what changes it by less changes nothing
_NO_PART = 0.1  # share that is next to nothing
_ORDERS = (1, 2, 4)  # of the integrators that engines have
_PART_OF_IT = 0.2  # share of a deviation from which on a cause may be one of several
_TOGETHER = 4  # causes at most that are taken out together
_ALIKE = (1.0 - 1e-4, 1.0 + 1e-4)  # of the step: of other roundings, and of the same error else
_LOW_ORDERS = (1, 2)  # of the integrators of engines in single precision
_POWERS = (1, 2)  # of 1 / h: roundings add up with the steps, and twice from speeds to positions
_GROWN = 1.5  # times at half the step: what grows by less may be noise


@dataclass(frozen=True)
class _Setting:
    """Options that take out one cause, or several."""

    name: str
    amount: str
    options: Options
    of_budget: bool = True
    """Whether it is a cause of the engine's error budget, and not just an option."""

    def with_other(self, other: Self) -> Self:
        """Both; no option is in both."""
        joined = {**self.options, **other.options}
        return type(self)(f"{self.name}, {other.name}", f"{self.amount}, {other.amount}", joined)

    def cause(self, explained: float) -> RankedCause:
        return _shown(self.name, self.amount, explained)


@dataclass
class SearchTime:
    """Time that runs of a diagnosis take, of what they may take together."""

    allowed: float = math.inf  # [s]
    spent: float = 0.0  # [s]
    left_out: int = 0
    """Runs that were not made, as they would have taken more than is left."""
    _of_steps: list[tuple[Options, float]] = field(default_factory=list[tuple[Options, float]])
    """Options but for the step, and what a step took with them [s]."""

    def suffices(self, options: Options, steps: float) -> bool:
        """Tell whether there is time for a run of so many steps; one more is left out if not.

        A step takes what it took with a part of these options, at the least. What it takes with
        options that were not tried is not known: one such run may take longer than is left.
        """
        asked = _but_step(options).items()
        known = [seconds for part, seconds in self._of_steps if part.items() <= asked]
        least = min((seconds for _, seconds in self._of_steps), default=0.0)
        suffices = self.spent + steps * max(known, default=least) <= self.allowed
        self.left_out += not suffices
        return suffices

    def add(self, options: Options, steps: float, seconds: float) -> None:
        """Count a run."""
        self.spent += seconds
        self._of_steps.append((_but_step(options), seconds / max(1.0, steps)))


def _but_step(options: Options) -> Options:
    return {name: value for name, value in options.items() if name != _STEP}


@dataclass(frozen=True)
class Rerun:
    """An engine with its options, and how it is run again with other ones."""

    engine: Engine
    simulate: Simulate
    finest: float | None = None
    """Step of the preset `settings` on this problem [s]; None: not known, or not beyond this one's.
    """
    time: SearchTime = field(default_factory=SearchTime, compare=False)
    """What runs with other settings may take together."""
    kept: dict[str, FloatArray | None] = field(
        default_factory=dict[str, "FloatArray | None"], compare=False, repr=False
    )
    """Deviations of runs with other settings, by the settings: some are asked for twice."""

    def causes(self, case: Case) -> Iterator[RankedCause]:
        """Causes of the engine's error budget, removed one at a time, by what then vanishes.

        Where none does alone, what explains most is taken out with each of the others, and so on.
        The step comes after the other causes, as shorter ones cost more. Where one takes out all of
        it, no other is looked for. In single precision, and of a run of many steps, the step is
        asked for first, as iterations without end and assistance take ten times as long: nothing
        else is where it or rounding makes nearly all of the deviation, or half of it in a run of
        many steps.
        """
        if not case.deviation.any():  # what is there is right, and the rest is missing
            return
        removals = sorted(_other_settings(self.engine, case.mechanism), key=_costs)
        if self._is_long(case) or self._is_single:
            of_steps = list(self._of_steps(case, removals))
            enough = MOST_OF_IT if self._is_long(case) else SUFFICIENT
            if any(cause.explained >= enough for cause in of_steps):
                yield from of_steps
                return
        yield from self._of_settings(case, removals)

    def _is_long(self, case: Case) -> bool:
        """Tell whether it is a run of many steps."""
        return case.end > _MANY_STEPS * (self.engine.timestep or math.inf)

    def _of_steps(self, case: Case, removals: Sequence[_Setting]) -> Iterator[RankedCause]:
        """The step, and rounding beside it."""
        for removal in removals:
            if _STEP in removal.options:
                cause, _ = self._without_the_step(case, removal)
                yield cause
                if cause.explained < SUFFICIENT:
                    yield from self._of_rounding(case, removals)

    def _of_settings(self, case: Case, removals: Sequence[_Setting]) -> Iterator[RankedCause]:
        """Causes of the budget, then other options, alone and together."""
        most, best = 0.0, None
        settings: list[_Setting] = []
        for removal in removals:
            if most >= (SAME if removal.of_budget else SUFFICIENT):
                return
            cause, setting = self._alone(case, removal)
            settings.append(setting)
            if cause.explained > 0:
                yield cause
            if cause.explained > most:
                most, best = cause.explained, setting
        if most >= SUFFICIENT:
            return
        rounding = list(self._of_rounding(case, removals))
        yield from rounding
        if any(cause.explained >= MOST_OF_IT for cause in rounding):
            return
        # What changes nothing alone is tried with the others of a preset, below.
        effective = [each for each in settings if self._changes(case, each.options)]
        together = 1
        while best is not None and _PART_OF_IT < most < SUFFICIENT and together < _TOGETHER:
            joined: list[tuple[float, _Setting]] = []
            for other in effective:
                if best.options.keys().isdisjoint(other.options):
                    both = best.with_other(other)
                    explained = self._explained(case, both)
                    if 1.0 - explained < (1.0 - most) / 2:
                        joined.append((explained, both))
                        yield both.cause(explained)
            most, best = max(joined, key=lambda found: found[0], default=(most, None))
            together += 1
        if most < SUFFICIENT:
            yield from self._of_presets(case, removals)

    def _of_rounding(self, case: Case, settings: Sequence[_Setting]) -> Iterator[RankedCause]:
        """Rounding to single precision, by runs at other steps; in double precision none shows."""
        step, of_step = self.engine.timestep, [each for each in settings if _STEP in each.options]
        if not (step and of_step and self._is_single):
            return

        def at(other: float) -> FloatArray | None:
            return self._left(case, {**of_step[0].options, _STEP: other})

        yield from rounding_causes(case.deviation, step, at)

    def _of_presets(self, case: Case, settings: Sequence[_Setting]) -> Iterator[RankedCause]:
        """Causes that vanish together, with the options of a preset that asks for more.

        Some options do harm alone: a limit that is stiffer must be felt earlier. So all of them are
        changed, at the run's own step or a finer one; then those that are not needed are left out.
        Where no preset takes out enough, the one that takes out most is a cause with its share.
        """
        finer = [self._shorter(setting) for setting in settings if _STEP in setting.options]
        most, best = 0.0, None
        for groups in _presets_beyond(self.engine, case.mechanism, settings):
            for beside in ([], finer[:1]):
                needed = [*groups, *beside]
                share = self._explained(case, *needed)
                if share < SUFFICIENT:
                    if share > most:
                        most, best = share, needed
                    continue
                for group in groups:
                    fewer = [each for each in needed if each is not group]
                    if fewer and self._explained(case, *fewer) >= SUFFICIENT:
                        needed = fewer
                yield reduce(_Setting.with_other, needed).cause(self._explained(case, *needed))
                return
        if best is not None:
            yield reduce(_Setting.with_other, best).cause(most)

    def _shorter(self, setting: _Setting) -> _Setting:
        """The setting of a shorter step, or of the next preset's if that is shorter yet."""
        step = setting.options[_STEP]
        if self.finest is None or not isinstance(step, int | float) or self.finest >= step:
            return setting
        return self._at_step(setting, self.finest)

    def _at_step(self, setting: _Setting, step: float) -> _Setting:
        """The setting of a shorter step, at this one [s]."""
        to = {**setting.options, _STEP: step}
        amount = Intervention(options=to).described(self.engine.settings)
        return replace(setting, amount=f"{amount}{_scheme(self.engine)}", options=to)

    def _changes(self, case: Case, options: Options) -> bool:
        """Tell whether a run with other settings is another motion."""
        left = self._left(case, options)
        if left is None:
            return False
        size = float(np.linalg.norm(case.deviation))
        return float(np.linalg.norm(left - case.deviation)) > _ROUNDING * size

    def _explained(self, case: Case, *settings: _Setting) -> float:
        """Share of a deviation that vanishes with all of these; 0 where they cannot be run."""
        left = self._left(case, reduce(_Setting.with_other, settings).options)
        return 0.0 if left is None else _share(left, case.deviation)

    def _alone(self, case: Case, setting: _Setting) -> tuple[RankedCause, _Setting]:
        """Share that a setting takes out alone, and the setting with which it does."""
        if _STEP in setting.options:
            return self._without_the_step(case, setting)
        return setting.cause(self._explained(case, setting)), setting

    def _without_the_step(self, case: Case, setting: _Setting) -> tuple[RankedCause, _Setting]:
        """Share that the step takes out, told by steps ever shorter until it is enough.

        A step's share is the larger one of two: what vanishes with it, and what it and the step
        before tell to vanish with no step at all (:func:`_beside_the_step`). Half the step costs
        little and is enough for most errors; large ones are of no order until the step is far
        shorter.
        """
        size = float(np.linalg.norm(case.deviation))
        cause, nearest, least = setting.cause(0.0), setting, math.inf
        longer, before = self.engine.timestep or math.inf, case.deviation
        halves, beyond = self._shorter_steps(case)
        for i, step in enumerate((*halves, *beyond)):
            if _TRIED <= i < len(halves) and cause.explained < _NO_PART:
                continue
            tried = self._at_step(setting, step)
            left = self._left(case, tried.options)
            if left is None:
                continue
            length, ratio = float(np.linalg.norm(left)), step / longer
            if length < least:
                least, nearest = length, tried
            rest = _beside_the_step(before, left, ratio)
            explained = max(_share(left, case.deviation), 1.0 - rest / size)
            if explained > cause.explained:
                order = _order(length / float(np.linalg.norm(before)), ratio)
                cause = replace(tried, amount=f"{tried.amount}{order}").cause(explained)
            if explained >= SUFFICIENT:
                break
            if self._is_at_rounding and length > float(np.linalg.norm(before)):
                break  # shorter steps make it larger
            longer, before = step, left
        return cause, nearest

    @property
    def _is_at_rounding(self) -> bool:
        """Tell whether steps in single precision are as short as those of `settings`."""
        is_longer = self.finest is not None and self.finest < (self.engine.timestep or 0.0)
        return self._is_single and not is_longer

    @property
    def _is_single(self) -> bool:
        """Tell whether the engine computes in single precision."""
        return engine_study(self.engine.name).single_precision(self.engine.settings)

    def _shorter_steps(self, case: Case) -> tuple[list[float], list[float]]:
        """Steps to try [s]: halves, and that of the next preset if it is shorter yet."""
        step, halvings = self.engine.timestep, _HALVINGS
        if not step:
            return [], []
        if self._is_long(case):
            halvings = 1 if self._is_at_rounding else _TRIED
        halves = [step / 2**halved for halved in range(1, halvings + 1)]
        if self.finest is None or self.finest >= halves[-1]:
            return halves, []
        return halves, [self.finest, self.finest / 2]

    def _left(self, case: Case, options: Options) -> FloatArray | None:
        """The deviation of a run with other settings; None where they cannot be run."""
        key = json.dumps(options, sort_keys=True)
        if key not in self.kept:
            self.kept[key] = self._run(case, options)
        return self.kept[key]

    def _run(self, case: Case, options: Options) -> FloatArray | None:
        law, duration = case.solution.problem.stop_law, case.whole.provenance.duration
        duration = min(duration, run_duration(case.end, self.engine.timestep or 0.0))
        problem = Problem(case.mechanism, duration=duration, stop_law=law)
        try:
            engine = with_options(self.engine, options)
        except TrebucheckError:
            return None
        steps = problem.duration / (engine.timestep or problem.duration)
        if not self.time.suffices(options, steps):
            return None
        begun = perf_counter()
        try:
            return case.carried(self.simulate(engine, problem))
        except TrebucheckError:
            return None
        finally:
            self.time.add(options, steps, perf_counter() - begun)


def _beside_the_step(before: FloatArray, left: FloatArray, ratio: float) -> float:
    """Size of the part of a deviation that no step takes out, however short it is.

    With d(h) = c h^p + rest, the deviations d(h) and d(r h) tell
    rest = (d(r h) - r^p d(h)) / (1 - r^p). The order p is the one of `_ORDERS` that leaves least:
    a part that does not fall with the step is of none of them, and stays.

    Args:
        before: d(h).
        left: d(r h).
        ratio: r, between 0 and 1.
    """
    if not 0.0 < ratio < 1.0:
        return math.inf
    falls = [ratio**order for order in _ORDERS]
    return min(float(np.linalg.norm((left - fall * before) / (1.0 - fall))) for fall in falls)


def _order(left: float, ratio: float) -> str:
    """Power of the step by which the error falls, from the share that a finer one leaves of it."""
    if not (0.0 < left < 1.0 and 0.0 < ratio < 1.0):
        return ""
    return f"; the error falls with order {math.log(left) / math.log(ratio):.2g}"


def _costs(setting: _Setting) -> tuple[bool, bool]:
    """Order in which settings are tried: causes of the budget, of these the step last."""
    return not setting.of_budget, _STEP in setting.options


def _share(left: FloatArray, deviation: FloatArray) -> float:
    """Share of a deviation that is gone where this is left."""
    return 1.0 - float(np.linalg.norm(left) / np.linalg.norm(deviation))


def _presets_beyond(
    engine: Engine, mechanism: Mechanism, settings: Sequence[_Setting]
) -> Iterator[tuple[_Setting, ...]]:
    """Options that the presets after an engine's own set otherwise, but for the step, by cause."""
    options, known = engine.settings, presets_of(engine.name)
    idle = {_STEP} | idle_options(engine, mechanism)
    if engine.preset not in known:
        return
    for preset in known[known.index(engine.preset) + 1 :]:
        asked = make(engine.name, preset).settings
        changed = {
            name: value
            for name, value in asked.items()
            if name not in idle and not same_value(options.get(name), value)
        }
        groups: list[_Setting] = []
        for setting in settings:
            of_cause = {name: changed.pop(name) for name in setting.options if name in changed}
            if of_cause and _STEP not in setting.options:
                groups.append(_changed(setting.name, options, of_cause))
        groups += [_changed(f"option {name}", options, {name: changed[name]}) for name in changed]
        if groups:
            yield tuple(groups)


def _changed(name: str, options: Options, to: Options) -> _Setting:
    """A cause that these options take out."""
    return _Setting(name, Intervention(options=to).described(options), to)


def _scheme(engine: Engine) -> str:
    """The integrator that an engine's study states for its preset, with its order."""
    stated = engine_study(engine.name).step_orders.get(engine.preset)
    if stated is None or not stated.scheme:
        return ""
    order = f", order {stated.order:g}" if stated.order is not None else ""
    return f"; {stated.scheme}{order}"


def _other_settings(engine: Engine, mechanism: Mechanism) -> Iterator[_Setting]:
    """The engine without one of its budget's causes, or with one option as in its assisted preset.

    A removal that shortens the step leaves what follows the step, options that are None, to follow
    it. An error budget keeps it as it is, to tell the parts of an error. Who looks for a cause has
    the step alone to turn, and neither part explains a deviation that both make.

    Options that ask for assistance which cannot act on the mechanism are left as they are: a run
    with them is the same run, and another name for a cause that is not there.
    """
    options, idle = engine.settings, idle_options(engine, mechanism)
    known: set[str] = set()
    for cause in causes_of(engine, mechanism):
        removal = cause.removal
        if removal is None:
            continue
        known |= removal.options.keys()
        acting = {name: value for name, value in removal.options.items() if name not in idle}
        if not acting:
            continue
        removal = replace(removal, options=acting)
        if _STEP in removal.options:
            followers = [o for o in removal.options if o != _STEP and options.get(o) is None]
            kept = {name: v for name, v in removal.options.items() if name not in followers}
            removal = replace(removal, options=kept)
        amount = removal.described(options)
        if _STEP in removal.options:
            amount += _scheme(engine)
        yield _Setting(cause.name, amount, removal.options)
    assisted = make(engine.name, ASSISTED).settings
    for name, value in options.items():
        if name in assisted and value != assisted[name] and name not in known | idle | {_STEP}:
            text = f"{value}; {ASSISTED}: {assisted[name]}"
            yield _Setting(f"option {name}", text, {name: assisted[name]}, of_budget=False)


def rounding_causes(
    deviation: FloatArray, step: float, run: Callable[[float], FloatArray | None]
) -> Iterator[RankedCause]:
    """The step's own error, rounding, and both, with the shares that runs tell of them.

    Shorter steps do not take out what is rounded: there are more of them, and each is rounded.
    Three kinds of runs tell its parts:

    - Steps of two and four times the length. Rounding matters less in them; what grows with them as
      h^p is the step's own error, d(4h) - d(2h) = (4^p - 2^p) c h^p.
    - Steps that differ by 1e-4 of their length. The step's error differs by as little, but every
      sum is rounded otherwise: the distance of such motions is sqrt(2) times what rounding makes of
      one.
    - Half the step. What remains of the deviation without the step's error, and is larger there by
      half or more, is made by the number of steps; it falls as 1 / h or 1 / h^2.

    Args:
        deviation: of the engine at its step, flat.
        step: [s].
        run: deviation of the engine at another step [s]; None where it cannot be run.
    """
    of_step, order = _error_of_step(deviation, run(2 * step), run(4 * step))
    noise = _noise(deviation, [run(factor * step) for factor in _ALIKE])
    if noise is None:
        return
    half = run(step / 2)
    growing, power = np.zeros_like(deviation), 0
    if half is not None:
        growing, power = _growing(deviation - of_step, half - of_step / 2**order)
    alone = share_of(deviation, of_step)
    rounded = max(_with_noise(part, noise, deviation) for part in (0.0, growing))
    both = _with_noise(of_step + growing, noise, deviation)
    size = float(np.linalg.norm(deviation))
    in_steps = f"steps of {2 * step:.3g} and {4 * step:.3g} s show an error of order {order}"
    in_sums = f"in steps that differ by 1e-4 motions are {noise / size:.2g} of the deviation apart"
    if power:
        in_sums += f", and a part grows with shorter steps as 1/h^{power}"
    yield _shown("time step", in_steps, alone)
    yield _shown("rounding to single precision", in_sums, rounded)
    if 1.0 - both < (1.0 - max(alone, rounded)) / 2:
        yield _shown("time step, rounding to single precision", f"{in_steps}; {in_sums}", both)


def _noise(deviation: FloatArray, alike: list[FloatArray | None]) -> float | None:
    """Size of what rounding makes of a motion at random; None where no run tells it."""
    apart = [float(np.linalg.norm(other - deviation)) for other in alike if other is not None]
    return math.sqrt(np.mean(np.square(apart)) / 2) if apart else None


def _error_of_step(
    deviation: FloatArray, twice: FloatArray | None, four_times: FloatArray | None
) -> tuple[FloatArray, int]:
    """Part of the deviation that grows with the step, and its order; zeros where none does."""
    nothing = np.zeros_like(deviation), _LOW_ORDERS[0]
    if twice is None or four_times is None:
        return nothing
    parts = {order: (four_times - twice) / (4**order - 2**order) for order in _LOW_ORDERS}
    return _best_part(deviation, parts) or nothing


def _growing(rest: FloatArray, rest_at_half: FloatArray) -> tuple[FloatArray, int]:
    """Part of a rest that shorter steps make larger, and its power of 1/h; 0: there is none."""
    nothing = np.zeros_like(rest), 0
    if not float(np.linalg.norm(rest_at_half)) > _GROWN * float(np.linalg.norm(rest)):
        return nothing
    return _best_part(rest, {power: rest_at_half / 2**power for power in _POWERS}) or nothing


def _best_part(
    deviation: FloatArray, parts: Mapping[int, FloatArray]
) -> tuple[FloatArray, int] | None:
    """The part that explains most of a deviation, and its power; None where none explains any."""
    power = max(parts, key=lambda power: share_of(deviation, parts[power]))
    return (parts[power], power) if share_of(deviation, parts[power]) > 0 else None


def _with_noise(part: FloatArray | float, noise: float, deviation: FloatArray) -> float:
    """Share of a deviation that a part of it and noise of this size explain together."""
    left = float(np.linalg.norm(deviation - part)) ** 2 - noise**2
    return 1.0 - math.sqrt(max(0.0, left)) / float(np.linalg.norm(deviation))


def _shown(name: str, amount: str, explained: float) -> RankedCause:
    """A cause that runs with other settings show."""
    return RankedCause(
        name=name, kind="settings", amount=amount, explained=explained, confirmed=True
    )
