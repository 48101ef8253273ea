"""Starts of some bits: proved horizons against closed forms, and from both sides."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.horizon import Horizon
from trebucheck.models.library.benchmark import swing
from trebucheck.reference.proof.horizon import parting, spread
from trebucheck.reference.proof.motion import Limits

ROOT = Path(__file__).parents[2]
BITS = 24
AMPLITUDE = 2.0  # [rad] from the lowest position
OMEGA = math.sqrt(9.81)  # of a point mass on a link of 1 m


def pendulum() -> tb.Problem:
    """A pendulum whose start is its angle from the highest position, below which it is let go.

    Its angle counts from +x; with gravity along +x a start of AMPLITUDE is that from the lowest.
    """
    body = tb.Body(name="bob", angle="q", mass=1.0, centre=(1.0, 0.0), inertia=0.0)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="bob", parent_point=(0, 0), child_point=(0, 0)
    )
    mechanism = tb.Mechanism(
        name="bob", bodies=(body,), joints=(pin,), gravity=9.81, gravity_direction=(1.0, 0.0),
        start=(AMPLITUDE,),
    )  # fmt: skip
    return tb.Problem(mechanism, duration=4.0)


def corners(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The closed forms from both ends of the start's ball."""
    low, high = (swing(OMEGA, AMPLITUDE * (1 + side * 2.0**-BITS), t) for side in (-1, 1))
    return low, high


def test_the_enclosure_holds_the_closed_forms_from_both_ends() -> None:
    found = spread(pendulum(), BITS, Fraction(4), np.ones(1), 0.05, Limits())
    low, high = corners(found.times)
    # Rounding of the closed form: some units in the last place of 2 rad, turned by 2^24.
    rounding = 1e-13
    assert found.times[-1] == pytest.approx(4.0)
    assert not found.ended
    assert np.all(2 * found.radii >= np.abs(high - low) - rounding)
    # A step's bound is of the whole step, over which a difference grows by at most exp(L h).
    steps = np.diff(np.concatenate([[0.0], found.times]))
    own = AMPLITUDE * 2.0**-BITS
    assert found.radii[0] >= own
    assert found.radii[0] <= own * math.exp(OMEGA**2 * steps[0])


def test_corners_are_as_far_apart_as_their_closed_forms() -> None:
    apart = parting(pendulum(), BITS, (1.0, 1.0), Fraction(2), np.ones(1), Limits())
    low, high = corners(apart.times)
    assert len(apart.times) == 128
    assert apart.distances == pytest.approx(np.abs(high - low), abs=1e-13)


def test_a_linear_motion_keeps_all_digits_of_its_start() -> None:
    """x = x_0 cos(w t): a difference of starts never grows, so that each digit stays known."""
    problem = tb.problem("oscillator")
    (start, *_), *others = problem.mechanism.start, problem.mechanism.start_speeds
    found = tb.horizon(problem, bits=BITS, until=2.0)
    assert not any(np.ravel(others))
    whole = math.floor(-math.log10(2 * abs(start) / found.length * 2.0**-BITS))
    assert found.known_until(whole - 1) == pytest.approx(2.0)
    assert all(each.lost is None for each in found.known[: whole - 1])
    assert max(each.radius for each in found.linear) <= abs(start) / found.length * 2.0**-BITS


def test_more_bits_are_known_longer() -> None:
    problem = tb.problem("double-pendulum")
    few, more = (
        spread(problem, bits, Fraction(1, 4), np.ones(2), 0.05, Limits()) for bits in (12, 24)
    )
    few_at, more_at = (np.interp(0.25, each.times, each.radii) for each in (few, more))
    # The bound of the smaller set grows no more than that of the larger one.
    assert 0 < more_at <= few_at * 2.0**-12


def test_events_of_all_motions_come_before_the_end() -> None:
    problem = tb.Problem(tb.fixed(), duration=60.0)
    found = spread(problem, 24, None, np.ones(3), 0.05, Limits())
    launch = tb.prove("fixed", digits=5).launch_time
    assert launch is not None
    # Some motions launch later than the mechanism's own, none are enclosed beyond the first.
    assert 2.7 < found.times[-1] <= float(launch.value)
    assert not found.ended


def test_a_file_is_read_as_it_was_written() -> None:
    found = tb.horizon("pendulum", bits=10, until=0.5)
    assert Horizon.model_validate_json(found.to_json()) == found
    assert found.known_until(2) == pytest.approx(0.5)
    assert found.known_until(9) == 0.0


@pytest.mark.parametrize(
    ("options", "named"),
    [({"bits": 2}, "bits"), ({"bits": 24, "digits": 9}, "digits"), ({"until": "x"}, "until")],
)
def test_bad_values_are_named(options: dict[str, int], named: str) -> None:
    with pytest.raises(tb.InputError, match=named):
        tb.horizon("pendulum", **options)


def test_a_start_of_zeros_has_no_bits_to_lose() -> None:
    still = tb.problem("pendulum").mechanism.model_copy(update={"start": (0.0,)})
    with pytest.raises(tb.InputError, match="zero"):
        tb.horizon(tb.Problem(still, duration=1.0))


def test_the_published_horizons_are_as_the_reference_estimates() -> None:
    """No proved bound is below the derivative by the start, which the reference integrates."""
    files = sorted((ROOT / "docs" / "horizons").glob("*.json"))
    assert files
    for file in files:
        found = Horizon.model_validate(json.loads(file.read_text()))
        times = [each.t for each in found.growth]
        for estimate in found.linear:
            after = int(np.searchsorted(times, estimate.t))
            if after < len(times) and estimate.radius < 1e-4:  # where motions are near
                assert found.growth[after].radius >= 0.99 * estimate.radius
