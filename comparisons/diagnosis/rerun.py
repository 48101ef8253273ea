"""Causes that only the engine shows: run with other settings, what then vanishes is theirs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Self

import numpy as np

from ...engines.presets import ASSISTED
from ...engines.protocol import Engine
from ...engines.registry import causes_of, engine_study, presets_of, with_options
from ...engines.registry import engine as make
from ...engines.study import Intervention, Options, same_value
from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ..runs.results import RankedCause
from .case import Case
from .rank import SUFFICIENT

Simulate = Callable[[Engine, Problem], Trajectory]

_STEP = "timestep"
# Share that an eighth of the step takes out of a first-order error: 7/8, rounded
_FIRST_ORDER = 0.8
_MOST_OF_IT = 0.5  # share of a deviation from which on a cause may be one of several
_TOGETHER = 4  # causes at most that are taken out together


@dataclass(frozen=True)
class _Setting:
    """Options that take out one cause, or several."""

    name: str
    amount: str
    options: Options

    def with_other(self, other: Self) -> Self:
        """Both; no option is in both."""
        joined = {**self.options, **other.options}
        return type(self)(f"{self.name}, {other.name}", f"{self.amount}, {other.amount}", joined)

    def cause(self, explained: float) -> RankedCause:
        return RankedCause(name=self.name, kind="settings", amount=self.amount, explained=explained)


@dataclass(frozen=True)
class Rerun:
    """An engine with its options, and how it is run again with other ones."""

    engine: Engine
    simulate: Simulate

    def causes(self, case: Case) -> Iterator[RankedCause]:
        """Causes of the engine's error budget, removed one at a time, by what then vanishes.

        Where none does alone, what explains most is taken out with each of the others, and so on.
        """
        size = float(np.linalg.norm(case.deviation))
        most, best = 0.0, None
        settings = tuple(_other_settings(self.engine, case.mechanism))
        for setting in settings:
            cause = self._alone(case, setting)
            if cause.explained > 0:
                yield cause
            if cause.explained > most:
                most, best = cause.explained, setting
        together = 1
        while best is not None and _MOST_OF_IT < most < SUFFICIENT and together < _TOGETHER:
            joined: list[tuple[float, _Setting]] = []
            for other in settings:
                if best.options.keys().isdisjoint(other.options):
                    both = best.with_other(other)
                    left = self._left(case, both.options)
                    explained = 0.0 if left is None else _share(left, size)
                    if 1.0 - explained < (1.0 - most) / 2:
                        joined.append((explained, both))
                        yield both.cause(explained)
            most, best = max(joined, key=lambda found: found[0], default=(most, None))
            together += 1
        if most < SUFFICIENT:
            yield from self._of_presets(case, settings)

    def _of_presets(self, case: Case, settings: Sequence[_Setting]) -> Iterator[RankedCause]:
        """Causes that vanish together, with the options of a preset that asks for more.

        Some options do harm alone: a limit that is stiffer must be felt earlier. So all of them are
        changed, at the run's own step or a finer one; then those that are not needed are left out.
        """
        finer = [setting for setting in settings if _STEP in setting.options]
        for groups in _presets_beyond(self.engine, settings):
            for beside in ([], finer[:1]):
                needed = [*groups, *beside]
                if self._together(case, needed) < SUFFICIENT:
                    continue
                for group in groups:
                    fewer = [each for each in needed if each is not group]
                    if fewer and self._together(case, fewer) >= SUFFICIENT:
                        needed = fewer
                yield reduce(_Setting.with_other, needed).cause(self._together(case, needed))
                return

    def _together(self, case: Case, settings: Sequence[_Setting]) -> float:
        """Share of a deviation that vanishes with all of these."""
        left = self._left(case, reduce(_Setting.with_other, settings).options)
        return 0.0 if left is None else _share(left, float(np.linalg.norm(case.deviation)))

    def _alone(self, case: Case, setting: _Setting) -> RankedCause:
        """Share that a setting takes out alone; of a step, with the order of the error."""
        size = float(np.linalg.norm(case.deviation))
        left = self._left(case, setting.options)
        if left is None:
            return setting.cause(0.0)
        explained = _share(left, size)
        if _STEP not in setting.options:
            return setting.cause(explained)
        if _FIRST_ORDER < explained < SUFFICIENT:
            rest = self._beside_the_step(case, setting.options, left)
            explained = max(explained, 1.0 - rest / size)
        order = self._order(setting.options, float(np.linalg.norm(left)) / size)
        return replace(setting, amount=f"{setting.amount}{order}").cause(explained)

    def _order(self, options: Options, left: float) -> str:
        """Power of the step by which the error falls, from what a finer one leaves of it."""
        step, finer = self.engine.timestep, with_options(self.engine, options).timestep
        if not step or not finer or not 0.0 < left < 1.0:
            return ""
        return f"; the error falls with order {math.log(left) / math.log(finer / step):.2g}"

    def _left(self, case: Case, options: Options) -> FloatArray | None:
        """The deviation of a run with other settings; None where they cannot be run."""
        law, duration = case.solution.problem.stop_law, case.whole.provenance.duration
        problem = Problem(case.mechanism, duration=duration, stop_law=law)
        try:
            return case.carried(self.simulate(with_options(self.engine, options), problem))
        except TrebucheckError:
            return None

    def _beside_the_step(self, case: Case, options: Options, left: FloatArray) -> float:
        """Size of the part of a deviation that no step takes out, however short it is.

        Either it is what is no error of first order in the step: with d(h) = c h + rest, steps h
        and r h tell rest = (d(r h) - r d(h)) / (1 - r), the larger one of two, with r of the finer
        engine and with a half, so that only what falls as the step does is gone.

        Or, where that is too much, it is what is no error of several orders, as of a rule of second
        and a soft contact of first order. Of the finer engine's error the first order is most, so
        that half of its step h tells what stays: 2 d(h / 2) - d(h) has all of what no step takes
        out, and of the second order a 128th of the whole, h being an eighth.

        Args:
            case: the deviation.
            options: of the finer engine.
            left: its deviation.
        """
        step, finer = self.engine.timestep, with_options(self.engine, options).timestep

        def beside_first_order(r: float, other: FloatArray | None) -> float:
            if other is None:
                return math.inf
            return float(np.linalg.norm((other - r * case.deviation) / (1 - r)))

        def beside_all_orders() -> float:
            half = None if finer is None else self._left(case, {**options, _STEP: 0.5 * finer})
            return math.inf if half is None else float(np.linalg.norm(2.0 * half - left))

        if step is None or finer is None:
            return beside_all_orders()
        allowed = (1.0 - SUFFICIENT) * float(np.linalg.norm(case.deviation))
        rest = beside_first_order(finer / step, left)
        if rest > allowed:
            # The larger of two is no smaller: if all orders leave less than this, it is not needed.
            of_all_orders = beside_all_orders()
            if of_all_orders <= rest:
                return of_all_orders
            half = self._left(case, {_STEP: 0.5 * step})
            return min(of_all_orders, max(rest, beside_first_order(0.5, half)))
        half = self._left(case, {_STEP: 0.5 * step})
        rest = max(rest, beside_first_order(0.5, half))
        return rest if rest <= allowed else min(rest, beside_all_orders())


def _share(left: FloatArray, size: float) -> float:
    return 1.0 - float(np.linalg.norm(left)) / size if size else 0.0


def _presets_beyond(engine: Engine, settings: Sequence[_Setting]) -> Iterator[tuple[_Setting, ...]]:
    """Options that the presets after an engine's own set otherwise, but for the step, by cause."""
    options, known = engine.settings, presets_of(engine.name)
    if engine.preset not in known:
        return
    for preset in known[known.index(engine.preset) + 1 :]:
        asked = make(engine.name, preset).settings
        changed = {
            name: value
            for name, value in asked.items()
            if name != _STEP and not same_value(options.get(name), value)
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
    """
    options = engine.settings
    known: set[str] = set()
    for cause in causes_of(engine, mechanism):
        removal = cause.removal
        if removal is None or not removal.options:
            continue
        known |= removal.options.keys()
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
        if name in assisted and value != assisted[name] and name not in known | {_STEP}:
            text = f"{value}; {ASSISTED}: {assisted[name]}"
            yield _Setting(f"option {name}", text, {name: assisted[name]})
