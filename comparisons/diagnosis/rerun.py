"""Causes that only the engine shows: run with other settings, what then vanishes is theirs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import causes_of, with_options
from ...engines.registry import engine as make
from ...engines.study import Intervention, Options
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
_MOST_OF_IT = 0.5  # share of a deviation from which on a cause may be one of two


@dataclass(frozen=True)
class _Setting:
    """Options that take out one cause, or two."""

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

        Where none does alone, what explains most is taken out with each of the others.
        """
        found: list[tuple[float, _Setting]] = []
        settings = tuple(_other_settings(self.engine, case.mechanism))
        for setting in settings:
            explained = self._explained(case, setting, self._of_the_step)
            if explained > 0:
                found.append((explained, setting))
                yield setting.cause(explained)
        most, best = max(found, key=lambda each: each[0], default=(0.0, None))
        if best is None or not _MOST_OF_IT < most < SUFFICIENT:
            return
        for other in settings:
            if best.options.keys().isdisjoint(other.options):
                both = best.with_other(other)
                explained = self._explained(case, both)
                if 1.0 - explained < (1.0 - most) / 2:
                    yield both.cause(explained)

    def _explained(
        self, case: Case, setting: _Setting, further: Callable[..., float] | None = None
    ) -> float:
        """Share of the deviation that vanishes with other settings; 0 where they cannot be run."""
        size = float(np.linalg.norm(case.deviation))
        given = case.solution.problem.stop_law
        problem = Problem(case.mechanism, duration=case.whole.provenance.duration, stop_law=given)
        changed = with_options(self.engine, setting.options)
        try:
            left = case.carried(self.simulate(changed, problem))
        except TrebucheckError:
            return 0.0
        explained = 1.0 - float(np.linalg.norm(left)) / size if size else 0.0
        if (
            further is None
            or _STEP not in setting.options
            or not _FIRST_ORDER < explained < SUFFICIENT
        ):
            return explained
        return max(explained, 1.0 - further(case, problem, changed, left) / size)

    def _of_the_step(self, case: Case, problem: Problem, finer: Engine, left: FloatArray) -> float:
        """How much of a deviation the step does not take out, however short it is."""
        rest = self._beside_first_order(case, problem, finer, left)
        if rest <= (1.0 - SUFFICIENT) * float(np.linalg.norm(case.deviation)):
            return rest
        return min(rest, self._beside_all_orders(case, problem, finer, left))

    def _beside_first_order(
        self, case: Case, problem: Problem, finer: Engine, left: FloatArray
    ) -> float:
        """Part of a deviation that is no error of first order in the step.

        A finer step leaves a part of such an error.

        With d(h) = c h + rest, steps h and r h tell rest = (d(r h) - r d(h)) / (1 - r): the larger
        one of two, with r of the finer engine and with a half, so that only what falls as the step
        does is gone. Infinite where half the step cannot be run.
        """
        step = self.engine.timestep
        half = self._at_half(self.engine, case, problem)
        if half is None or step is None or finer.timestep is None:
            return math.inf
        pairs = ((finer.timestep / step, left), (0.5, half))
        return max(
            float(np.linalg.norm((other - r * case.deviation) / (1 - r))) for r, other in pairs
        )

    def _beside_all_orders(
        self, case: Case, problem: Problem, finer: Engine, left: FloatArray
    ) -> float:
        """Part of a deviation that is no error of several orders in the step.

        Such is a rule's of second and a soft contact's of first order.

        Of the finer engine's error the first order is most, so that half of its step h tells what
        stays: 2 d(h / 2) - d(h) has all of what no step takes out, and of the second order a 128th
        of the whole, h being an eighth.
        """
        half = self._at_half(finer, case, problem)
        return math.inf if half is None else float(np.linalg.norm(2.0 * half - left))

    def _at_half(self, engine: Engine, case: Case, problem: Problem) -> FloatArray | None:
        """Signature of an engine's run at half its step; None where it cannot be run."""
        if engine.timestep is None:
            return None
        try:
            return case.carried(
                self.simulate(with_options(engine, {_STEP: 0.5 * engine.timestep}), problem)
            )
        except TrebucheckError:
            return None


def _other_settings(engine: Engine, mechanism: Mechanism) -> Iterator[_Setting]:
    """The engine without one of its budget's causes, or with one option as tuned."""
    options = engine.settings
    known: set[str] = set()
    for cause in causes_of(engine, mechanism):
        if cause.removal is not None and cause.removal.options:
            known |= cause.removal.options.keys()
            removal = _of_one_knob(cause.removal, options)
            yield _Setting(cause.name, removal.described(options), removal.options)
    tuned = make(engine.name, "tuned").settings
    for name, value in options.items():
        if name in tuned and value != tuned[name] and name not in known | {_STEP}:
            yield _Setting(f"option {name}", f"{value}; tuned: {tuned[name]}", {name: tuned[name]})


def _of_one_knob(removal: Intervention, settings: Options) -> Intervention:
    """A removal that shortens the step, with what follows the step left to follow it.

    What follows it are options that are None.

    An error budget keeps that, to tell the parts of an error. Who looks for a cause has the step
    alone to turn, and neither part explains a deviation that both make.
    """
    if _STEP not in removal.options:
        return removal
    kept = {
        name: value
        for name, value in removal.options.items()
        if name == _STEP or settings.get(name) is not None
    }
    return replace(removal, options=kept)
