"""A tolerance finer than ten times the reference's own uncertainty is refused, with the reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.runner import reference_uncertainties
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.reference.certification.certificate import (
    Uncertainties,
    _events,
    estimate_uncertainty,
    refusal,
)
from trebucheck.reference.solver import solve_to_launch


@pytest.mark.parametrize("tolerance", [1e-7, 1.0000001e-11, 1e-11])
def test_coarser_ones_are_judged(tolerance: float) -> None:
    assert refusal("position_max", "projectile", tolerance, 1e-12) is None


def test_finer_ones_are_refused_with_both_numbers() -> None:
    reason = refusal("position_max", "projectile", 9e-12, 1e-12)
    assert reason is not None
    assert "position_max (projectile)" in reason
    assert "9e-12" in reason and "1e-12" in reason and "10 times" in reason


def test_subjects_fall_back_on_the_metric() -> None:
    known = Uncertainties(
        source="estimate", values={"position_max": 1e-11, "release_time (sling rest)": 1e-13}
    )
    assert known.of("position_max", "counterweight") == 1e-11
    assert known.of("release_time", "sling rest") == 1e-13
    assert known.of("release_time", "hanger rest") is None


def test_events_are_as_uncertain_as_two_solutions_differ_whichever_is_the_later() -> None:
    fine, coarse = (
        SimpleNamespace(
            release_times={"first": 1.0 - late, "second": 2.0 + 3 * late, "never": None},
            launch=SimpleNamespace(time=2.5 - 2 * late),
        )
        for late in (0.0, 1e-6)
    )
    found: list[dict[str, float]] = []
    for pair in ((fine, coarse), (coarse, fine)):
        solutions: Any = pair
        found.append(_events(*solutions, 3.0))
    assert found[0] == found[1]
    assert set(found[0]) == {
        "release_time", "release_time (first)", "release_time (second)", "launch_time",
    }  # fmt: skip
    assert all(value >= 3e-6 for value in found[0].values())
    alone: Any = SimpleNamespace(release_times={"first": None}, launch=None)
    known: Any = SimpleNamespace(release_times={"first": 1.0}, launch=None)
    assert _events(alone, known, 3.0) == _events(known, alone, 3.0)
    assert _events(alone, known, 3.0)["release_time (first)"] == 3.0
    assert _events(alone, alone, 3.0) == {}


def test_a_launch_at_the_end_of_the_compared_motion_has_an_uncertainty_of_its_own() -> None:
    """The coarser integration's launch may lie a little later, past the compared motion.

    It was then taken as exact.
    """
    solution = solve_to_launch(tb.fixed(tb.TrebuchetParameters(l1=9.5)))
    assert solution.launch is not None
    end, known = solution.launch.time, estimate_uncertainty(solution).of("launch_time")
    compared = reference_uncertainties(solution, end, scales_until(solution, end), "projectile").of(
        "launch_time"
    )
    assert known is not None and compared is not None
    assert known / 10 < compared < 10 * known
