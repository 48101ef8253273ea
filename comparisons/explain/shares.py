r"""How an error is split among its causes: arithmetic on functions of time.

Causes interact: pymunk's bias lets joints drift by an amount that falls with the step, so that taking out either takes
out the same error. What a cause contributes then depends on what has been taken out before it. The value of Shapley
(A value for n-person games, 1953) is the mean of that contribution over all orders; it is the only split that adds up
to the whole and treats causes alike. Here two orders are taken, one the other's reverse: they already add up, and as
long as causes interact in pairs they give Shapley's value exactly,

    v(S) = sum_i a_i + sum_{i<j} b_ij:  in order  a_i + sum_{j before i} b_ij,  in reverse  a_i + sum_{j after i} b_ij,
    their mean  a_i + 1/2 sum_j b_ij.

Where some causes can only be taken out after others, the orders are those that keep to it (Faigle and Kern, The
Shapley value for cooperative games under precedence constraints, 1992). Half the difference of the two orders is
shown with each share: the part of it that is a matter of order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...engines.study import Cause
from ...models.arrays import FloatArray
from ..runs.deviation import Deviation
from .results import Quantity, Share


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
    found = {"position": Observed("m", deviation.quantity("position"), components=2)}
    for stop in deviation.torques:
        unit = deviation.force_units.get(stop, "N m")
        found[f"{stop} {'torque' if unit == 'N m' else 'force'}"] = Observed(unit, deviation.quantity(stop))
    found["energy"] = Observed("J", deviation.quantity("energy"))
    for stop, time in deviation.release_times.items():
        found[f"{stop} release"] = Observed("s", _single(time))
    found["launch time"] = Observed("s", _single(deviation.launch_time))
    found["launch speed"] = Observed("m/s", _single(deviation.launch_speed))
    return {name: quantity for name, quantity in found.items() if np.isfinite(quantity.values).all()}


def _single(value: float | None) -> FloatArray:
    return np.array([math.nan if value is None else value])


def orders(causes: Sequence[Cause]) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The two orders in which causes are taken out: the given one, and its reverse as far as `after` allows.

    Causes an `after` names that are not among these are taken for absent.
    """
    return _ordered(causes), _ordered(causes[::-1])


def _ordered(wanted: Sequence[Cause]) -> tuple[Cause, ...]:
    names = {cause.name for cause in wanted}
    left, done = list(wanted), list[Cause]()
    while left:
        gone = {cause.name for cause in done}
        ready = next((c for c in left if all(a in gone or a not in names for a in c.after)), left[0])
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
        noise_left: roundoff in the run with every cause taken out. It is random: it enters the rest's size, not
            the rest as a function, and is taken from it in quadrature.
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
