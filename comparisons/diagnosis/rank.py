"""Which of the suspects account for enough of a deviation to be named as its cause.

Deviations grow towards the launch, and whatever caused them, a good part of them then has the same
shape: nearly every suspect accounts for half of nearly every deviation. So a share alone is no
evidence. A cause is named if it leaves less than a tenth of the deviation (what is left could
otherwise hide a second cause of the same order) *and* clearly less than the next suspect does.
Suspects that all leave less than a hundredth have the same effect on this motion: the deviation
cannot tell them apart, and all of them are named.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..runs.results import Cause

SUFFICIENT = 0.95
"""Share of a deviation from which on a suspect can be its cause."""
SAME = 0.99
"""Share from which on suspects have the same effect, as far as a deviation can tell."""
EXACT = 0.999
"""Share from which on what is left is the fit's own error."""
_CLEARLY = 2.0  # times what the best suspect leaves: what the next one has to leave at least
_MOST = 3  # suspects of the same effect that are worth a name
_LISTED = 6
_TELLING = 0.05  # what accounts for less is no suspect


def ranked(causes: Iterable[Cause]) -> tuple[tuple[Cause, ...], int]:
    """Suspects by the share that they account for, and how many of the first are named; 0: the cause is unknown."""
    best: dict[str, Cause] = {}
    for cause in causes:
        if cause.explained > max(
            _TELLING, best[cause.name].explained if cause.name in best else 0.0
        ):
            best[cause.name] = cause
    listed = sorted(best.values(), key=lambda cause: -min(cause.explained, EXACT))
    return tuple(listed[:_LISTED]), _named([cause.explained for cause in listed])


def _named(shares: list[float]) -> int:
    """How many of the causes are named, from their shares in descending order."""
    if not shares or shares[0] < SUFFICIENT:
        return 0
    left = [1 - min(share, EXACT) for share in shares]
    near = sum(other < _CLEARLY * left[0] for other in left)
    if near == 1:
        return 1
    return min(near, _MOST) if shares[near - 1] >= SAME else 0
