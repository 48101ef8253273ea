"""Newton's law with complementarity where stops are redundant.

The reference's algorithm and the engines' one.
"""

from __future__ import annotations

import numpy as np
import pytest
from trebucheck.engines.impact import impulses
from trebucheck.models.arrays import FloatArray
from trebucheck.reference.contact import solve_lcp

RESTITUTIONS = np.array([0.0, 0.2, 0.5, 0.8, 1.0])


def speeds_after(
    rows: list[list[float]], u: list[float], restitution: list[float]
) -> list[FloatArray | None]:
    """Of unit masses after an impact, by the reference's least distance and by the engines' choice
    of contacts.
    """
    gaps, before, e = np.array(rows), np.array(u), np.array(restitution)
    matrix, came = gaps @ gaps.T, gaps @ before
    found = solve_lcp(matrix, (1.0 + e) * came), impulses(matrix, came, e)
    return [None if p is None else before + gaps.T @ p for p in found]


@pytest.mark.parametrize(("rows", "u", "restitution", "after"), [
    ([[1], [1]], [-1], [0.2, 0.8], [0.8]),  # least squares gave 0.62
    ([[1], [1]], [-1], [1.0, 0.0], [1.0]),
    ([[1], [1], [1]], [-2], [0.1, 0.5, 0.3], [1.0]),
    ([[1], [3]], [-1], [0.2, 0.8], [0.8]),  # a longer lever is no other stop
    ([[1, 0], [0, 1], [1, 1]], [-1, -1], [0.0, 0.0, 0.5], [0.5, 0.5]),
    ([[1, 0], [0, 1], [1, 1]], [-1, -1], [0.5, 0.0, 0.0], [0.5, 0.0]),
])  # fmt: skip
def test_of_redundant_stops_the_one_that_asks_for_more_decides(
    rows: list[list[float]], u: list[float], restitution: list[float], after: list[float]
) -> None:
    both = list(speeds_after(rows, u, restitution))
    assert len(both) == 2
    for found in both:
        assert found == pytest.approx(after, abs=1e-14)


def test_stops_against_each_other_leave_no_rebound() -> None:
    """Free between them is no speed but zero.

    The law with their e has no solution, the reference says so.
    """
    least_distance, by_choice = speeds_after([[1], [-1]], [-1], [0.5, 0.0])
    assert least_distance is None
    assert by_choice == pytest.approx([0.0], abs=1e-15)


def test_two_algorithms_agree_on_random_stops() -> None:
    """Up to five stops on up to three motions, parallel and opposite ones among them.

    Half have a common e.
    """
    random, unsolvable = np.random.default_rng(18), 0
    for _ in range(400):
        n, m = random.integers(1, 4), random.integers(1, 6)
        rows = random.normal(size=(m, n)) * 10.0 ** random.uniform(-2, 2, size=(m, 1))
        if m > 1 and random.random() < 0.5:
            rows[1] = rows[0] * random.choice([-1.0, 1.0, 2.0])
        e = random.choice(RESTITUTIONS, size=m if random.random() < 0.5 else 1) * np.ones(m)
        matrix, came = rows @ rows.T, rows @ random.normal(size=n)
        offset = (1.0 + e) * came
        x, p = solve_lcp(matrix, offset), impulses(matrix, came, e)
        assert p is not None
        if x is None:
            unsolvable += 1
            x = solve_lcp(matrix, came)
            assert x is not None
        size = (
            np.abs(rows.T @ p).max(initial=1e-12)
            + np.abs(offset / np.linalg.norm(rows, axis=1)).max()
        )
        assert np.abs(rows.T @ (x - p)).max() < 1e-8 * size
    assert 10 < unsolvable < 200


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_impulses_are_those_of_other_speeds_at_any_speed(size: float) -> None:
    """Twenty redundant sets of stops; half of the stops would pull if all took part."""
    random, pulled = np.random.default_rng(5), 0
    for _ in range(20):
        rows = random.normal(size=(4, 3))
        rows[1] = rows[0]
        matrix, came, e = rows @ rows.T, rows @ random.normal(size=3), random.uniform(size=4)
        here, there = impulses(matrix, came, e), impulses(matrix, size * came, e)
        assert here is not None and there is not None
        assert there / size == pytest.approx(here, abs=1e-9)
        pulled += int(np.sum(here == 0.0))
    assert pulled > 20
