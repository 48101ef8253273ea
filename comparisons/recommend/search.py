"""The cheapest settings that reach what is asked: every step recommended was measured, the order only guesses where.

A set of options is first run at one moderate step on the machine and all its neighbours. The neighbours on which it
did worst go on with it: at every further step the machine and these must reach what is asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...engines.registry import engine
from ...engines.study import OptionSet
from ..runs.trials import Trial, Trials
from .results import Errors
from .target import Asked, errors_of, largest_torque, unit_of

SCREENED_AT = 1
"""Place on the ladder of steps at which all neighbours are run."""
HARDEST = 6
"""Neighbours that go on."""
_SCOUTED_AT = 3
"""Place on the ladder at which the hardest machine shows how its error falls with the step."""
_ORDERS = (0.1, 4.0)  # between which an order found over two steps is believed
_DOUBT = 0.5  # such an order may be wrong by so much: where a release falls inside a step scatters the errors
_GAIN = 0.7  # a rung of the ladder at least halves the step: an error of first order would halve, too
_PATIENCE = 2  # rungs without gain, before a set is given up
_DEARER = 1.5  # times the cheapest found so far: further down, a set can only cost more
_TINY = 1e-12  # times what is asked: as good as nothing
_REPEATS = 3
_TIE = 1.2  # times of runs of some 10 ms repeat no better than to this factor


@dataclass(frozen=True)
class Place:
    """A machine with its trials, and what is asked on it."""

    trials: Trials
    asked: Asked

    @cached_property
    def allowed(self) -> dict[str, float]:
        """Largest error allowed, by quantity."""
        return self.asked.on(self.trials.solution, self.trials.end)

    def unit(self, quantity: str) -> str:
        """Of a quantity, on this machine."""
        return unit_of(quantity, self.trials.mechanism)

    def errors(self, trial: Trial) -> dict[str, float]:
        """By quantity; infinite where the run failed."""
        return errors_of(trial, self.trials.solution, self.trials.end)

    def ratio(self, trial: Trial) -> float:
        """The largest error over what is allowed: up to 1 it is reached."""
        errors = self.errors(trial)
        return max(errors[name] / allowed for name, allowed in self.allowed.items())

    def described(self, trial: Trial) -> Errors:
        """As the report has it."""
        found = {name: value if math.isfinite(value) else None for name, value in self.errors(trial).items()}
        peak = largest_torque(self.trials.solution, self.trials.end)
        torque = found["torque"]
        return Errors(**found, torque_share=None if torque is None or peak == 0 else torque / peak)


@dataclass(frozen=True)
class Rung:
    """One step: how the worst of the machines measured did."""

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
class Course:
    """One set of options, followed over the steps."""

    options: OptionSet
    rungs: dict[float, Rung] = field(default_factory=dict[float, Rung])
    note: str = ""
    dropped: bool = False
    """Given up by what one machine showed: none of its steps was run on the others."""

    @property
    def reached(self) -> Rung | None:
        """The rung of the longest step at which it reaches what is asked on all machines it must."""
        if self.dropped:
            return None
        found = [rung for rung in self.rungs.values() if rung.reached]
        return max(found, key=lambda rung: rung.step, default=None)

    @property
    def best(self) -> Rung:
        """The rung with the least worst error; of equals the one of the longest step."""
        return min(self.rungs.values(), key=lambda rung: (rung.worst, -rung.step))


@dataclass
class Follower:
    """Follows sets of options of one engine over the ladder."""

    engine: str
    places: Sequence[Place]
    steps: Sequence[float]
    cheapest: float = math.inf
    """Wall time of the cheapest settings found so far [s]."""
    _hardest: int | None = field(default=None, init=False)
    """Index of the machine the first set did worst on."""

    def follow(self, options: OptionSet) -> Course:
        """Look whether there is hope, screen, guess the step, and go up or down from there."""
        course = Course(options)
        course.dropped = self._hardest is not None and self._is_hopeless(course, self._hardest)
        if course.dropped:
            return course
        course.rungs.clear()
        panel = self._screen(course)
        self._hardest = panel[0] if self._hardest is None else self._hardest
        self._walk(course, panel)
        if course.reached:
            self.cheapest = min(self.cheapest, _wall(course.reached.trials[0]))
        return course

    def _is_hopeless(self, course: Course, place: int) -> bool:
        """Whether one machine says enough: the one the first set did worst on, as any machine must reach it."""
        screened = self._rung(course, [place], SCREENED_AT)
        if screened.reached or not math.isfinite(screened.worst):
            return False
        guess = self._guess(course, [place])
        if guess is not None and self._is_dearer(screened.trials[place], guess):
            course.note = "by the order found, it would cost more than what is recommended"
            return True
        return guess is None

    def _is_dearer(self, screened: Trial, place: int) -> bool:
        """Whether a step must cost more than the cheapest settings found, by the time of the screened one."""
        return _wall(screened) * self.steps[SCREENED_AT] / self.steps[place] > _DEARER * self.cheapest

    def _screen(self, course: Course) -> list[int]:
        """Run all machines at one step; the machine itself and its hardest neighbours, the hardest first."""
        step = self.steps[SCREENED_AT]
        trials = {i: self._trial(i, course.options, step) for i in range(len(self.places))}
        ratios = {i: self.places[i].ratio(trial) for i, trial in trials.items()}
        hardest = sorted(list(ratios)[1:], key=lambda i: -ratios[i])[:HARDEST]
        panel = sorted([0, *hardest], key=lambda i: -ratios[i])
        course.rungs[step] = Rung(step, ratios[panel[0]], panel[0], {i: trials[i] for i in panel})
        return panel

    def _trial(self, place: int, options: OptionSet, step: float, repeats: int = 1) -> Trial:
        return self.places[place].trials.trial(
            engine(self.engine, options.preset, **options.all_options(step)), repeats
        )

    def _walk(self, course: Course, panel: list[int]) -> None:
        start = self._guess(course, panel)
        if start is None:
            return
        if self._rung(course, panel, start).reached:
            self._upwards(course, panel, start - 1)
        else:
            self._downwards(course, panel, start)

    def _guess(self, course: Course, panel: list[int]) -> int | None:
        """Place on the ladder of the longest step that should do; None if by the order found none can."""
        screened, finest = course.rungs[self.steps[SCREENED_AT]], self.steps[-1]
        if not math.isfinite(screened.worst):
            return SCREENED_AT + 1
        if screened.reached:
            return self._place(screened.step / max(screened.worst, _TINY) ** (1 / _ORDERS[1]))
        scouted = self._rung(course, panel, _SCOUTED_AT)
        if scouted.reached or not math.isfinite(scouted.worst):
            return _SCOUTED_AT
        order = math.log(screened.worst / scouted.worst) / math.log(screened.step / scouted.step)
        likely, at_best = (min(max(p, _ORDERS[0]), _ORDERS[1]) for p in (order, order + _DOUBT))
        if scouted.step / scouted.worst ** (1 / at_best) < finest:
            course.note = f"by the order found, {order:.1f}, no step down to {finest:g} s will do"
            return None
        return self._place(scouted.step / scouted.worst ** (1 / likely))

    def _place(self, wanted: float) -> int:
        return next((i for i, step in enumerate(self.steps) if step <= wanted), len(self.steps) - 1)

    def _upwards(self, course: Course, panel: list[int], place: int) -> None:
        while place >= 0 and self._rung(course, panel, place).reached:
            place -= 1
        course.note = "reached; a longer step does not" if place >= 0 else "reached at the longest step tried"

    def _downwards(self, course: Course, panel: list[int], place: int) -> None:
        screened = course.rungs[self.steps[SCREENED_AT]].trials[0]
        before, idle = self._rung(course, panel, place), 0
        for step in range(place + 1, len(self.steps)):
            if self._is_dearer(screened, step):
                course.note = "a shorter step would cost more than what is recommended"
                return
            now = self._rung(course, panel, step)
            if now.reached:
                course.note = "reached; a longer step does not"
                return
            idle = 0 if now.worst < _GAIN * before.worst else idle + 1
            if idle == _PATIENCE:
                course.note = "shorter steps do not help any more"
                return
            before = now
        course.note = "not reached at the shortest step tried"

    def _rung(self, course: Course, panel: list[int], place: int) -> Rung:
        """Run the panel at a step, the hardest first, up to the first that does not reach what is asked."""
        step = self.steps[place]
        if step in course.rungs:
            return course.rungs[step]
        trials: dict[int, Trial] = {}
        worst, hardest = 0.0, panel[0]
        for i in panel:
            trials[i] = self._trial(i, course.options, step)
            ratio = self.places[i].ratio(trials[i])
            if ratio >= worst:
                worst, hardest = ratio, i
            if worst > 1:
                break
        course.rungs[step] = Rung(step, worst, hardest, trials)
        return course.rungs[step]

    def chosen(self, courses: Sequence[Course]) -> tuple[Course, Rung, Trial] | None:
        """The cheapest that reaches it, with its repeated trial; the plainest of those as cheap as can be told."""
        found: list[tuple[Course, Rung, Trial]] = []
        for course in courses:
            rung = course.reached
            if rung is not None and _wall(rung.trials[0]) <= _DEARER * self.cheapest:
                found.append((course, rung, self._trial(0, course.options, rung.step, _REPEATS)))
        if not found:
            return None
        cheapest = min(_wall(trial) for _, _, trial in found)
        return next(row for row in found if _wall(row[2]) <= _TIE * cheapest)

    def over_the_ladder(self, course: Course, place: int) -> list[tuple[float, Trial]]:
        """One machine's trials at all steps from the screened one down, the longest first."""
        return [(step, self._trial(place, course.options, step)) for step in self.steps[SCREENED_AT:]]


def _wall(trial: Trial) -> float:
    """Median wall time [s]; infinite for a run that failed."""
    return float(np.median(trial.wall_times)) if trial.wall_times else math.inf
