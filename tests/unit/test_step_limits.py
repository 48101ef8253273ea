"""Limits of an integration: by count, by pace and by memory, over all segments of a motion."""

from __future__ import annotations

import pytest
from trebucheck.models.errors import SimulationError
from trebucheck.reference.integrator import StepLimit


def steps_until_refused(limit: StepLimit, *paces: tuple[int, float]) -> int | None:
    """The step at which a motion is given up, of so many steps of a size each; None if it ends."""
    taken, t = 0, 0.0
    for count, size in paces:
        for _ in range(count):
            taken, t = taken + 1, t + size
            try:
                limit.count(t)
            except SimulationError:
                return taken
    return None


def test_steps_are_counted_in_whole_windows() -> None:
    limit = StepLimit(4, 1e3, most=1400)
    assert limit.most == 1000
    assert steps_until_refused(limit, (2000, 0.1)) == 1000
    assert steps_until_refused(StepLimit(4, 1e3, most=1500), (1499, 0.1)) is None


@pytest.mark.parametrize(("size", "refused"), [(0.9e-4, 500), (1.1e-4, None)])
def test_a_hundred_times_the_most_steps_are_hopeless(size: float, refused: int | None) -> None:
    """Of 10 s, 0.05 s are done after a window: 9.95 s ask for 1e5 steps of 1e-4 s."""
    assert steps_until_refused(StepLimit(4, 10.0, most=1000), (500, size)) == refused


def test_the_pace_is_that_of_the_last_window() -> None:
    """2e5 steps are hopeless: 5 s in steps of 2e-5 s, but not in those of the mean, 5e-3 s."""
    limit = StepLimit(4, 10.0, most=2000)
    assert steps_until_refused(limit, (500, 1e-2), (500, 2e-5)) == 1000
    assert steps_until_refused(StepLimit(4, 10.0, most=2000), (500, 1e-2), (500, 5e-5)) is None


def test_a_motion_that_stands_still_is_given_up() -> None:
    assert steps_until_refused(StepLimit(4, 10.0), (500, 0.0)) == 500


def test_dense_output_fits_into_a_gigabyte() -> None:
    """Eight vectors of eight bytes a state are kept of every step, and 500 bytes beside them."""
    for states in (200, 1000, 40_000):
        most = StepLimit(states, 1.0).most
        assert most * (500 + 64 * states) <= 2**30 < (most + 500) * (500 + 64 * states)
    assert StepLimit(1, 1.0).most == 500_000
