"""Budgets measured: causes taken out one after the other, in an order and in its reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...engines.protocol import Engine
from ...engines.study import Cause, Intervention
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ..runs.deviation import Deviation
from ..runs.trials import Trial, Trials
from .causes import causes_of, described
from .results import Budget, Measurement, Quantity
from .shares import Measured, Observed, noise_between, observed, orders, split
from .variants import LAST_BITS, varied

_ROUNDOFF = "roundoff"


class VariantFailedError(Exception):
    """A run with causes taken out did not come to its end, or not to the same events as the base."""

    def __init__(self, cause: str, reason: str) -> None:
        super().__init__(reason)
        self.cause = cause


def budget(trials: Trials, engine: Engine) -> Budget:
    """Split an engine's error on one machine among its causes.

    Each removal is a run. A cause whose run fails is left out and says so: its part stays unexplained.
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
    if base.deviation is None:
        return empty
    study = _Study(trials, engine, base.deviation)
    causes = causes_of(engine, trials.mechanism)
    chains = study.chains([cause for cause in causes if cause.removal is not None])
    alone = study.scaled([cause for cause in causes if cause.scaling is not None])
    quantities = study.quantities(chains, alone)
    measured = [_measurement(cause, engine, study.failed.get(cause.name)) for cause in causes]
    return empty.model_copy(update={"causes": (*measured, _roundoff(study)), "quantities": quantities})


def _measurement(cause: Cause, engine: Engine, failure: str | None) -> Measurement:
    settings = engine.settings
    ways = [described(way, settings) for way in (cause.removal, cause.scaling) if way is not None]
    return Measurement(
        name=cause.name, explanation=cause.explanation, done="; or ".join(ways), after=cause.after, message=failure
    )


def _roundoff(study: _Study) -> Measurement:
    return Measurement(
        name=_ROUNDOFF,
        explanation="the random part: what changes when the machine's data change in their last bits",
        done=f"gravity changed by ±{LAST_BITS:g} of itself",
        message=study.failed.get(_ROUNDOFF),
    )


@dataclass
class _Chain:
    """Deviations with more and more causes taken out: one more than there are causes."""

    causes: tuple[Cause, ...]
    deviations: list[Deviation]

    def part(self, cause: str, quantity: str) -> FloatArray:
        """What taking out one more cause changed, extrapolated where it leaves a known part of it."""
        i = next(i for i, known in enumerate(self.causes) if known.name == cause)
        removal = self.causes[i].removal
        assert removal is not None
        before, after = (observed(d)[quantity].values for d in self.deviations[i : i + 2])
        return (before - after) / (1.0 - removal.leaves)


@dataclass
class _Study:
    trials: Trials
    engine: Engine
    base: Deviation
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

    def _along(self, order: Sequence[Cause]) -> list[Deviation]:
        deviations = [self.base]
        for n, cause in enumerate(order, start=1):
            # Merged in the table's order whatever the order of removal: the same causes are the same run.
            deviations.append(self._deviation(self._removals(order[:n]), cause.name))
        return deviations

    def _removals(self, causes: Sequence[Cause]) -> list[Intervention]:
        names = {cause.name for cause in causes}
        table = orders(causes_of(self.engine, self.trials.mechanism))[0]
        return [c.removal for c in table if c.name in names and c.removal is not None]

    def _deviation(self, done: Sequence[Intervention], cause: str, last_bits: int = 0) -> Deviation:
        try:
            trial: Trial = varied(self.trials, self.engine, done, last_bits)
        except InputError as error:
            raise VariantFailedError(cause, str(error)) from error
        if trial.deviation is None:
            raise VariantFailedError(cause, trial.message or "it did not run")
        return trial.deviation

    def scaled(self, causes: Sequence[Cause]) -> dict[str, tuple[Deviation, float]]:
        """Deviations with one cause made larger, and by what factor."""
        found: dict[str, tuple[Deviation, float]] = {}
        for cause in causes:
            assert cause.scaling is not None
            try:
                found[cause.name] = self._deviation([cause.scaling], cause.name), cause.scaling.leaves
            except VariantFailedError as failure:
                if cause.removal is None:  # with a removal, this is the second measure only
                    self.failed[cause.name] = str(failure)
        return found

    def quantities(
        self, chains: tuple[_Chain, _Chain], alone: dict[str, tuple[Deviation, float]]
    ) -> tuple[Quantity, ...]:
        """The budget of every quantity that all these runs tell."""
        ideal = chains[0].deviations[-1]
        runs = [*chains[0].deviations, *chains[1].deviations, *(deviation for deviation, _ in alone.values())]
        near = self._last_bits([], (1, -1)), self._last_bits(self._removals(chains[0].causes), (1,))
        found: list[Quantity] = []
        for name, whole in observed(self.base).items():
            if not all(name in observed(run) for run in runs):
                continue
            parts = {cause.name: self._part(cause, name, chains, alone) for cause in chains[0].causes}
            for cause in alone.keys() - parts.keys():
                only = self._extrapolated(name, *alone[cause])
                parts[cause] = Measured.of(only, only)
            noise = _noise(name, whole, self.base, near[0])
            # What is left is the ideal run, extrapolated with the base where a removal leaves a known part.
            weight = 1.0 + sum(_extrapolation(cause) for cause in chains[0].causes)
            left = math.hypot(weight * _noise(name, whole, ideal, near[1]), (weight - 1.0) * noise)
            found.append(split(name, whole, parts, noise, left))
        return tuple(found)

    def _part(
        self, cause: Cause, quantity: str, chains: tuple[_Chain, _Chain], alone: dict[str, tuple[Deviation, float]]
    ) -> Measured:
        first, second = (chain.part(cause.name, quantity) for chain in chains)
        if cause.name not in alone:
            return Measured.of(first, second)
        # Shares of removals add up: scaling, an independent measure, is shown beside them and makes the band.
        mean = (first + second) / 2
        return Measured(mean, mean, self._extrapolated(quantity, *alone[cause.name]))

    def _extrapolated(self, quantity: str, larger: Deviation, factor: float) -> FloatArray:
        return (observed(larger)[quantity].values - observed(self.base)[quantity].values) / (factor - 1.0)

    def _last_bits(self, done: Sequence[Intervention], signs: Sequence[int]) -> list[Deviation]:
        found: list[Deviation] = []
        for sign in signs:
            try:
                found.append(self._deviation(done, _ROUNDOFF, sign))
            except VariantFailedError as failure:
                self.failed[_ROUNDOFF] = str(failure)
        return found


def _noise(quantity: str, whole: Observed, run: Deviation, near: Sequence[Deviation]) -> float:
    told = [observed(deviation) for deviation in near]
    return noise_between(observed(run)[quantity].values, [t[quantity].values for t in told if quantity in t], whole)


def _extrapolation(cause: Cause) -> float:
    """Weight of the ideal run's own error in what is added for the part that a removal leaves."""
    leaves = cause.removal.leaves if cause.removal else 0.0
    return leaves / (1.0 - leaves)
