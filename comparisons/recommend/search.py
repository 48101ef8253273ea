"""The cheapest settings that reach what is asked: every step recommended was measured, the order only guesses where.

A set of options is first run at one moderate step on the machine and all its neighbours. The
neighbours on which it did worst go on with it: at every further step the machine and these must
reach what is asked.

For each engine there are a few sets of options from plain to tuned, and a ladder of time steps. A
set adds to the one before it what changes most. How much each change buys is measured, not assumed:
the order here only decides which of two equally quick sets is recommended, the plainer one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_study
from ...engines.study import OptionSet
from ..runs.study import in_order
from ..runs.trials import Trial
from .cases import Case

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
_DOUBT = 0.5  # such an order may be wrong by so much: where a release falls inside a step scatters the errors
_GAIN = 0.7  # the next level at least halves the step: an error of first order would halve, too
_PATIENCE = 2  # levels without gain, before a set is given up
_DEARER = 1.5  # times the cheapest found so far: further down, a set can only cost more
_TINY = 1e-12  # times what is asked: as good as nothing
_REPEATS = 3
_TIE = 1.2  # times of runs of some 10 ms repeat no better than to this factor


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Of an engine, from plain to tuned; its presets where its study has none."""
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
class Level:
    """One refinement level: a time step, and the worst of the machines measured with it."""

    step: float
    worst: float
    """Largest error over what is allowed."""
    hardest: int
    """Index of the machine of that."""
    trials: dict[int, Trial]
    """By index of machine; the machine asked about is 0."""

    @property
    def reached(self) -> bool:
        """Whether every machine measured reaches what is asked."""
        return self.worst <= 1


@dataclass
class Sweep:
    """One set of options over the time steps tried."""

    options: OptionSet
    levels: dict[float, Level] = field(default_factory=dict[float, Level])
    note: str = ""
    dropped: bool = False
    """Given up by what one machine showed: none of its steps was run on the others."""

    @property
    def reached(self) -> Level | None:
        """The level of the longest step at which it reaches what is asked on all machines it must."""
        if self.dropped:
            return None
        levels = [level for level in self.levels.values() if level.reached]
        return max(levels, key=lambda level: level.step, default=None)

    @property
    def best(self) -> Level:
        """The level with the least worst error; of equals the one of the longest step."""
        return min(self.levels.values(), key=lambda level: (level.worst, -level.step))


@dataclass
class Search:
    """Searches the time steps of one engine for each set of options."""

    engine: str
    cases: Sequence[Case]
    steps: Sequence[float]
    jobs: int = 1
    """Neighbours that are run at once."""
    cheapest: float = math.inf
    """Wall time of the cheapest settings found so far [s]."""
    _hardest: int | None = field(default=None, init=False)
    """Index of the machine the first set did worst on."""

    def sweep(self, options: OptionSet) -> Sweep:
        """Give up at once, or measure all machines at one step, estimate the step needed and refine from there."""
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
        """Whether the machine that the first set did worst on rules the set out, as any machine must reach it."""
        screened = self._level(sweep, [case], SCREENED_AT)
        if screened.reached or not math.isfinite(screened.worst):
            return False
        guess = self._guess(sweep, [case])
        if guess is not None and self._is_dearer(screened.trials[case], guess):
            sweep.note = "by the order found, it would cost more than what is recommended"
            return True
        return guess is None

    def _is_dearer(self, screened: Trial, index: int) -> bool:
        """Whether a step must cost more than the cheapest settings found, by the time of the screened one."""
        return (
            _wall(screened) * self.steps[SCREENED_AT] / self.steps[index] > _DEARER * self.cheapest
        )

    def _screen(self, sweep: Sweep) -> list[int]:
        """Run all machines at one step; the machine itself and its hardest neighbours, the hardest first."""
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
        sweep.levels[step] = Level(step, ratios[panel[0]], panel[0], {i: trials[i] for i in panel})
        return panel

    def _trial(self, case: int, options: OptionSet, step: float, repeats: int = 1) -> Trial:
        return self.cases[case].trials.trial(configured(self.engine, options, step), repeats)

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

    def _level(self, sweep: Sweep, panel: list[int], index: int) -> Level:
        """Run the panel at a step, the hardest first, up to the first that does not reach what is asked."""
        step = self.steps[index]
        if step in sweep.levels:
            return sweep.levels[step]
        trials: dict[int, Trial] = {}
        worst, hardest = 0.0, panel[0]
        for i in panel:
            trials[i] = self._trial(i, sweep.options, step)
            ratio = self.cases[i].ratio(trials[i])
            if ratio >= worst:
                worst, hardest = ratio, i
            if worst > 1:
                break
        sweep.levels[step] = Level(step, worst, hardest, trials)
        return sweep.levels[step]

    def chosen(self, sweeps: Sequence[Sweep]) -> tuple[Sweep, Level, Trial] | None:
        """The cheapest that reaches it, with its repeated trial; the plainest of those as cheap as can be told."""
        candidates: list[tuple[Sweep, Level, Trial]] = []
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

    def over_all_steps(self, sweep: Sweep, case: int) -> list[tuple[float, Trial]]:
        """One machine's trials at all steps from the screened one down, the longest first."""
        return [(step, self._trial(case, sweep.options, step)) for step in self.steps[SCREENED_AT:]]


def _wall(trial: Trial) -> float:
    """Median wall time [s]; infinite for a run that failed."""
    return float(np.median(trial.wall_times)) if trial.wall_times else math.inf
