"""Which of the suspects account for enough of a deviation to be named as its cause.

Deviations grow towards the launch, and whatever caused them, a good part of them then has the same shape: nearly every
suspect accounts for half of nearly every deviation. So a share alone is no evidence. A cause is named if it leaves
less than a tenth of the deviation (what is left could otherwise hide a second cause of the same order) *and* clearly
less than the next suspect does. Suspects that all leave less than a hundredth have the same effect on this motion: the
deviation cannot tell them apart, and all of them are named.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..runs.results import Cause

SUFFICIENT = 0.9
"""Share of a deviation from which on a suspect can be its cause."""
SAME = 0.99
"""Share from which on suspects have the same effect, as far as a deviation can tell."""
_CLEARLY = 2.0  # times what the best suspect leaves: what the next one has to leave at least
_MOST = 3  # suspects of the same effect that are worth a name
_LISTED = 6
_TELLING = 0.05  # what accounts for less is no suspect


def ranked(causes: Iterable[Cause]) -> tuple[tuple[Cause, ...], int]:
    """Suspects by the share that they account for, and how many of the first are named; 0: the cause is unknown."""
    listed = sorted((c for c in causes if c.explained > _TELLING), key=lambda cause: -cause.explained)
    return tuple(listed[:_LISTED]), _named([cause.explained for cause in listed])


def _named(shares: list[float]) -> int:
    """How many of the causes are named, from their shares in descending order."""
    if not shares or shares[0] < SUFFICIENT:
        return 0
    near = sum(1 - share < _CLEARLY * (1 - shares[0]) for share in shares[1:]) + 1
    same = 1 < near <= _MOST and shares[near - 1] >= SAME
    return near if near == 1 or same else 0
