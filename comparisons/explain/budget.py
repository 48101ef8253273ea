r"""Error budgets: causes taken out one after the other, in an order and in its reverse, and the error split among them.

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
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import causes_of
from ...engines.study import Cause, Intervention
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ..runs.trials import Deviation, Trial, Trials
from .results import Budget, Measurement, Quantity, Share
from .variants import LAST_BITS, varied

_ROUNDOFF = "roundoff"


class VariantFailedError(Exception):
    """A run with causes taken out did not come to its end, or not to the same events as the base."""

    def __init__(self, cause: str, reason: str) -> None:
        super().__init__(reason)
        self.cause = cause


def budget(trials: Trials, engine: Engine) -> Budget:
    """Split an engine's error on one machine among its causes.

    Each removal is a run. A cause whose run fails is left out and says so: its part stays
    unexplained.
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
    point = base.deviation.farthest
    study = _Study(trials, engine, base.deviation.of_point(point))
    known = causes_of(engine, trials.mechanism)
    chains = study.chains([cause for cause in known if cause.removal is not None])
    alone = study.scaled([cause for cause in known if cause.scaling is not None])
    quantities = study.quantities(chains, alone)
    measured = [_measurement(cause, engine, study.failed.get(cause.name)) for cause in known]
    causes = (*measured, _roundoff(study))
    return empty.model_copy(update={"point": point, "causes": causes, "quantities": quantities})


def _measurement(cause: Cause, engine: Engine, failure: str | None) -> Measurement:
    settings = engine.settings
    ways = [way.described(settings) for way in (cause.removal, cause.scaling) if way is not None]
    return Measurement(
        name=cause.name,
        explanation=cause.explanation,
        done="; or ".join(ways),
        after=cause.after,
        message=failure,
    )


def _roundoff(study: _Study) -> Measurement:
    return Measurement(
        name=_ROUNDOFF,
        explanation="the random part: what changes when the machine's data change in their last bits",
        done=f"{'gravity' if study.trials.mechanism.gravity else 'start speeds'} changed by ±{LAST_BITS:g} of itself",
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
            # Merged in the table's order whatever the order of removal: the same causes are the
            # same run.
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
        return trial.deviation.of_point(self.base.farthest)

    def scaled(self, causes: Sequence[Cause]) -> dict[str, tuple[Deviation, float]]:
        """Deviations with one cause made larger, and by what factor."""
        deviations: dict[str, tuple[Deviation, float]] = {}
        for cause in causes:
            assert cause.scaling is not None
            try:
                deviations[cause.name] = (
                    self._deviation([cause.scaling], cause.name),
                    cause.scaling.leaves,
                )
            except VariantFailedError as failure:
                if cause.removal is None:  # with a removal, this is the second measure only
                    self.failed[cause.name] = str(failure)
        return deviations

    def quantities(
        self, chains: tuple[_Chain, _Chain], alone: dict[str, tuple[Deviation, float]]
    ) -> tuple[Quantity, ...]:
        """The budget of every quantity that all these runs tell."""
        ideal = chains[0].deviations[-1]
        runs = [
            *chains[0].deviations,
            *chains[1].deviations,
            *(deviation for deviation, _ in alone.values()),
        ]
        near = self._last_bits([], (1, -1)), self._last_bits(self._removals(chains[0].causes), (1,))
        quantities: list[Quantity] = []
        for name, whole in observed(self.base).items():
            if not all(name in observed(run) for run in runs):
                continue
            parts = {
                cause.name: self._part(cause, name, chains, alone) for cause in chains[0].causes
            }
            for cause in alone.keys() - parts.keys():
                only = self._extrapolated(name, *alone[cause])
                parts[cause] = Measured.of(only, only)
            noise = _noise(name, whole, self.base, near[0])
            # What is left is the ideal run, extrapolated with the base where a removal leaves a
            # known part.
            weight = 1.0 + sum(_extrapolation(cause) for cause in chains[0].causes)
            left = math.hypot(weight * _noise(name, whole, ideal, near[1]), (weight - 1.0) * noise)
            quantities.append(split(name, whole, parts, noise, left))
        return tuple(quantities)

    def _part(
        self,
        cause: Cause,
        quantity: str,
        chains: tuple[_Chain, _Chain],
        alone: dict[str, tuple[Deviation, float]],
    ) -> Measured:
        first, second = (chain.part(cause.name, quantity) for chain in chains)
        if cause.name not in alone:
            return Measured.of(first, second)
        # Shares of removals add up: scaling, an independent measure, is shown beside them and makes
        # the band.
        mean = (first + second) / 2
        return Measured(mean, mean, self._extrapolated(quantity, *alone[cause.name]))

    def _extrapolated(self, quantity: str, larger: Deviation, factor: float) -> FloatArray:
        return (observed(larger)[quantity].values - observed(self.base)[quantity].values) / (
            factor - 1.0
        )

    def _last_bits(self, done: Sequence[Intervention], signs: Sequence[int]) -> list[Deviation]:
        deviations: list[Deviation] = []
        for sign in signs:
            try:
                deviations.append(self._deviation(done, _ROUNDOFF, sign))
            except VariantFailedError as failure:
                self.failed[_ROUNDOFF] = str(failure)
        return deviations


def _noise(quantity: str, whole: Observed, run: Deviation, near: Sequence[Deviation]) -> float:
    nearby = [observed(deviation) for deviation in near]
    return noise_between(
        observed(run)[quantity].values, [t[quantity].values for t in nearby if quantity in t], whole
    )


def _extrapolation(cause: Cause) -> float:
    """Weight of the ideal run's own error in what is added for the part that a removal leaves."""
    leaves = cause.removal.leaves if cause.removal else 0.0
    return leaves / (1.0 - leaves)


@dataclass(frozen=True)
class Measured:
    """A cause's contribution to one quantity, as functions of time."""

    share: FloatArray
    first: FloatArray
    """Found one way: in the order of the table."""
    second: FloatArray
    """Found the other way: in the reverse order, or by scaling."""

    @classmethod
    def of(cls, first: FloatArray, second: FloatArray) -> Measured:
        """The mean of two ways."""
        return cls((first + second) / 2, first, second)


@dataclass(frozen=True)
class Observed:
    """What a deviation says of one quantity."""

    unit: str
    values: FloatArray
    components: int = 1
    """Of a vector quantity: its values are all x, then all y."""

    def size(self, values: FloatArray) -> tuple[float, float]:
        """Root mean square over time and largest value of a function like this one, Euclidean over components."""
        lengths = np.linalg.norm(values.reshape(self.components, -1), axis=0)
        return float(np.sqrt(np.mean(lengths**2))), float(lengths.max())


def observed(deviation: Deviation) -> dict[str, Observed]:
    """Every quantity a budget is made for, by its name; what the run does not tell is absent."""
    position = np.array(deviation.positions[deviation.farthest]).ravel()
    quantities = {"position": Observed("m", position, components=2)}
    for stop, torque in deviation.torques.items():
        unit = deviation.force_units.get(stop, "N m")
        quantities[f"{stop} {'torque' if unit == 'N m' else 'force'}"] = Observed(
            unit, np.array(torque)
        )
    quantities["energy"] = Observed("J", np.array(deviation.energy))
    for stop, time in deviation.release_times.items():
        quantities[f"{stop} release"] = Observed("s", _single(time))
    quantities["launch time"] = Observed("s", _single(deviation.launch_time))
    quantities["launch speed"] = Observed("m/s", _single(deviation.launch_speed))
    return {
        name: quantity
        for name, quantity in quantities.items()
        if np.isfinite(quantity.values).all()
    }


def _single(value: float | None) -> FloatArray:
    return np.array([math.nan if value is None else value])


def orders(causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The two orders in which causes are taken out: the given one, and its reverse as far as `after` allows.

    Causes an `after` names that are not among these are taken for absent.
    """
    return _ordered(causes), _ordered(causes[::-1])


def _ordered(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    names = {cause.name for cause in causes}
    left, done = list(causes), list[Cause]()
    while left:
        gone = {cause.name for cause in done}
        ready = next(
            (c for c in left if all(a in gone or a not in names for a in c.after)), left[0]
        )
        done.append(ready)
        left.remove(ready)
    return tuple(done)


def split(
    name: str,
    whole: Observed,
    parts: Mapping[str, Measured],
    noise: float,
    noise_left: float,
) -> Quantity:
    """The budget of one quantity.

    Args:
        name: of the quantity.
        whole: the run's error.
        parts: contributions by cause.
        noise: roundoff in the run, root mean square in the quantity's unit.
        noise_left: roundoff in the run with every cause taken out. It is random: it enters the
            rest's size, not the rest as a function, and is taken from it in quadrature.
    """
    e = whole.values
    rest = e - np.sum([part.share for part in parts.values()], axis=0) if parts else e
    rms, largest = whole.size(e)
    rest_rms, rest_largest = whole.size(rest)
    unexplained = math.sqrt(max(0.0, rest_rms**2 - noise_left**2))
    return Quantity(
        name=name,
        unit=whole.unit,
        rms=rms,
        largest=largest,
        shares=tuple(_share(cause, part, whole) for cause, part in parts.items()),
        rest=_share("unexplained", Measured.of(rest, rest), whole),
        rest_rms=rest_rms,
        rest_largest=rest_largest,
        roundoff=noise,
        roundoff_left=noise_left,
        explained=1.0 - unexplained / rms if rms else None,
    )


def _share(cause: str, part: Measured, whole: Observed) -> Share:
    rms, largest = whole.size(part.share)
    return Share(
        cause=cause,
        fraction=_fraction(part.share, whole.values),
        first=_fraction(part.first, whole.values),
        second=_fraction(part.second, whole.values),
        rms=rms,
        largest=largest,
        interaction=whole.size((part.first - part.second) / 2)[0],
    )


def _fraction(part: FloatArray, whole: FloatArray) -> float | None:
    """Signed share of the whole: the part's projection on it; all shares and the rest add up to one."""
    square = float(whole @ whole)
    return float(part @ whole) / square if square else None


def noise_between(base: FloatArray, others: Sequence[FloatArray], whole: Observed) -> float:
    """Size of the random part of a run [rms], from runs that differ from it in their last bits only.

    The difference of two such runs has twice the variance of one.
    """
    squares = [whole.size(other - base)[0] ** 2 / 2 for other in others]
    return math.sqrt(sum(squares) / len(squares)) if squares else 0.0
