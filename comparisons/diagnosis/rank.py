"""Ranking of suspects: those that account for enough of a deviation are named as its cause.

Deviations grow towards the launch, and whatever caused them, a good part of them then has the same
shape: nearly every suspect accounts for half of nearly every deviation. So a share alone is no
evidence. A cause is named if it leaves less than a tenth of the deviation (what is left could
otherwise hide a second cause of the same order) *and* clearly less than the next suspect does.
Suspects that all leave less than a hundredth have the same effect on this motion: the deviation
cannot tell them apart, and all of them are named.

What an engine was run without is no matter of shapes: so much of the deviation was gone. It is
named before all suspects if it explains enough, and from a half on, with its share, where nothing
explains enough.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ..runs.results import RankedCause

SUFFICIENT = 0.95
"""Share of a deviation from which on a suspect can be its cause."""
SAME = 0.99
"""Share from which on suspects have the same effect, as far as a deviation can tell."""
MOST_OF_IT = 0.5
"""Share below which nothing is a cause."""
EXACT = 0.999
"""Share from which on what is left is the fit's own error."""
_CLEARLY = 2.0  # times what the best suspect leaves: what the next one has to leave at least
_MOST = 3  # suspects of the same effect that are worth a name
_LISTED = 6
TELLING = 0.05
"""Share below which a cause is not listed."""


@dataclass(frozen=True)
class Estimate:
    """A cause whose share was computed roughly; it is measured only if it may be listed."""

    cause: RankedCause
    """The cause with its rough share."""
    error: float
    """Bound of its error."""
    measured: Callable[[], RankedCause]
    """Computes the share accurately."""


def measured(causes: Sequence[RankedCause | Estimate]) -> list[RankedCause | Estimate]:
    """The causes in their order, with those measured that may be listed or named.

    The list ends with the last of the best six shares. How many causes are named depends on those
    that leave less than a tenth, twice what the best of them may leave. Whatever is below both,
    and by more than its error, changes nothing.
    """
    sure: dict[str, float] = {}
    for each in causes:
        cause, error = (each.cause, each.error) if isinstance(each, Estimate) else (each, 0.0)
        sure[cause.name] = max(cause.explained - error, sure.get(cause.name, 0.0))
    best = sorted(sure.values(), reverse=True)[:_LISTED]
    last = best[-1] if len(best) == _LISTED else 0.0
    least = max(TELLING, min(last, 1.0 - _CLEARLY * (1.0 - SUFFICIENT)))
    return [
        each.measured()
        if isinstance(each, Estimate) and each.cause.explained + each.error >= least
        else each
        for each in causes
    ]


def ranked(causes: Iterable[RankedCause | Estimate]) -> tuple[tuple[RankedCause, ...], int]:
    """Suspects by the share that they explain, and how many of the first are named.

    None is named if the cause is unknown. Estimates that are left can be neither, see `measured`.
    """
    best: dict[str, RankedCause] = {}
    for cause in causes:
        if isinstance(cause, Estimate):
            continue
        if cause.explained > max(
            TELLING, best[cause.name].explained if cause.name in best else 0.0
        ):
            best[cause.name] = cause
    listed = sorted(best.values(), key=lambda cause: -min(cause.explained, EXACT))
    return tuple(listed[:_LISTED]), _named([cause.explained for cause in listed])


def ranked_with_parts(
    causes: Iterable[RankedCause | Estimate],
) -> tuple[tuple[RankedCause, ...], int]:
    """Suspects as :func:`ranked` has them, but for causes that runs have shown: these go first.

    Such a cause explains enough of the deviation; or a half at least, where none is named. Of
    several, those are named that leave less than twice what the best one leaves.
    """
    listed, named = ranked(causes)
    least = SUFFICIENT if named else MOST_OF_IT
    shown = [each for each in listed if each.confirmed and each.explained >= least]
    if not shown:
        return listed, named
    parts = shown[: min(_MOST, _as_good([each.explained for each in shown]))]
    return (*parts, *(each for each in listed if each not in parts)), len(parts)


def _named(shares: list[float]) -> int:
    """Tell how many of the causes are named, from their shares in descending order."""
    if not shares or shares[0] < SUFFICIENT:
        return 0
    near = _as_good(shares)
    if near == 1:
        return 1
    return min(near, _MOST) if shares[near - 1] >= SAME else 0


def _as_good(shares: list[float]) -> int:
    """Number of shares, in descending order, that leave less than twice what the first leaves."""
    left = [1 - min(share, EXACT) for share in shares]
    return sum(other < _CLEARLY * left[0] for other in left)
