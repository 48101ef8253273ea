"""The law of impacts, for adapters that resolve them by their engine's mass matrix or impulses.

Newton's law of restitution with complementarity (Moreau 1988; Glocker and Pfeiffer, Nonlinear
Dynamics 7, 1995): with v the speeds of the gaps before an impact and v+ after it, the impulses p of
the contacts that touch are

    0 <= p  complementary to  v+ + e v >= 0,        v+ = v + A p,

A being the inverse inertia that they feel. v+ is unique; impulses of redundant contacts are not.
Where these have different e, the one that asks for the highest speed pushes and the others part.
Where contacts stand against each other no v+ may give each its rebound: then none of them rebounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from ..models.arrays import FloatArray
from .contact_events import Contacts, active_contacts

_ROUNDING = 1e-10  # of the largest impulse, or speed: error of those that are zero
_RANK = 1e-12  # of the largest singular value: redundant contacts have smaller ones


def impulses(matrix: FloatArray, speeds: FloatArray, restitution: FloatArray) -> FloatArray | None:
    """Impulses of the contacts that touch [N m s, N s]; of redundant ones those of the least norm; None if none exist.

    Args:
        matrix: A, symmetric and positive semidefinite, shape (n, n).
        speeds: v [rad/s, m/s], shape (n,).
        restitution: e, shape (n,).
    """
    found = _complementary(matrix, (1.0 + restitution) * speeds)
    return _complementary(matrix, speeds) if found is None else found


def pushing(touching: Contacts, violated: Callable[[Contacts], str | None]) -> Contacts | None:
    """The contacts that push in an impact; None if no set of them fulfils the law.

    Args:
        touching: contacts that touch.
        violated: of a set of contacts that push, one of `touching` that breaks the law; None if all
            fulfil it.
    """
    found = active_contacts(touching, violated)
    if violated(found) is None:
        return found
    # Pivoting has no end where redundant contacts ask for different speeds: the sets are tried one
    # by one.
    return next((chosen for chosen in _subsets(touching) if violated(chosen) is None), None)


def _complementary(matrix: FloatArray, offset: FloatArray) -> FloatArray | None:
    """The p >= 0 complementary to matrix p + offset >= 0, or None."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    scaled, target = scale[:, None] * matrix * scale, -scale * offset
    rounding = _ROUNDING * np.abs(target).max(initial=0.0)
    names = tuple(map(str, range(len(offset))))

    def of(active: Contacts) -> FloatArray:
        where = [int(name) for name in active]
        result = np.zeros(len(names))
        result[where] = np.linalg.lstsq(scaled[np.ix_(where, where)], target[where], _RANK)[0]
        return result

    def violated(active: Contacts) -> str | None:
        result = of(active)
        left, acts = scaled @ result - target, np.isin(names, active)
        pulls, closes, parts = (
            acts & (result < -rounding),
            ~acts & (left < -rounding),
            acts & (abs(left) > rounding),
        )
        wrong = pulls | closes if (pulls | closes).any() else parts
        return names[int(np.argmax(wrong))] if wrong.any() else None

    found = pushing(names, violated)
    return None if found is None else scale * np.maximum(of(found), 0.0)


def _subsets(touching: Contacts) -> Iterator[Contacts]:
    """All of them, the largest first."""
    sizes = range(len(touching), -1, -1)
    return itertools.chain.from_iterable(itertools.combinations(touching, size) for size in sizes)
