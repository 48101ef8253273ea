"""Extrema of proved motions, against closed forms and certificates."""

from __future__ import annotations

import math
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.models.errors import InputError
from trebucheck.reference.certification.certificate import load_certificate
from trebucheck.reference.certification.certify import BEYOND_LAUNCH
from trebucheck.reference.certification.proved import ProvedMotionOfFigures, with_proof
from trebucheck.reference.proof.balls import arb, precision
from trebucheck.reference.proof.extrema import largest

LENGTH, GRAVITY = 1.5, 9.75


def test_a_maximum_is_where_a_rate_falls() -> None:
    with precision(100):
        found = largest(lambda t: t.cos(), arb(1), arb(2), 20)
        assert found is not None
        assert found.contains(arb.pi() / 2)
        assert float(found.rad()) < 1e-20


def unknown(_: Any) -> Any:
    """A rate that is known nowhere."""
    raise ValueError


@pytest.mark.parametrize(
    ("rate", "low", "high"),
    [
        pytest.param(lambda t: -t.cos(), 1, 2, id="a minimum"),
        pytest.param(lambda t: t + 1, 1, 2, id="no zero"),
        pytest.param(lambda t: t.cos(), 1, 8.5, id="two maxima"),
        pytest.param(lambda t: 1 - t, 1, 2, id="at the start"),
        pytest.param(lambda t: 2 - t, 1, 2, id="at the end"),
        pytest.param(lambda t: t - t, 1, 2, id="a constant"),
        pytest.param(unknown, 1, 2, id="unknown"),
    ],
)
def test_what_is_no_single_maximum_is_none(rate: Any, low: float, high: float) -> None:
    with precision(100):
        assert largest(rate, arb(low), arb(high), 10) is None


def pendulum(speed: float, gravity_direction: tuple[float, float] = (0.0, -1.0)) -> tb.Problem:
    """A point mass on a massless rod, level on the left at the start, that turns clockwise [m/s].

    Its velocity turns with it, and comes down to the launch angle half way to the top.
    """
    body = tb.Body(name="rod", angle="a", mass=2.0, centre=(LENGTH, 0.0), inertia=0.0)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 3), child_point=(0, 0)
    )
    mechanism = tb.Mechanism(
        name="point-pendulum",
        bodies=(body,),
        joints=(pin,),
        markers=(tb.Marker(name="projectile", body="rod", point=(LENGTH, 0.0)),),
        gravity=GRAVITY,
        gravity_direction=gravity_direction,
        start=(math.pi,),
        start_speeds=(speed / LENGTH,),
    )
    return tb.Problem(mechanism, duration=4.0)


def test_a_pendulum_is_fastest_where_it_has_fallen_farthest() -> None:
    proof = tb.prove(pendulum(0.0, (0.0, 1.0)), digits=15, until=1.25)
    fastest = proof.fastest(0.25)
    assert fastest is not None
    angle, speed = proof.q(fastest)["a"], proof.projectile_speed(fastest)
    assert abs(float(angle.value) - 1.5 * math.pi) <= float(angle.radius) + 1e-15
    assert float(angle.radius) < 1e-10
    expected = math.sqrt(2 * GRAVITY * LENGTH)
    assert abs(float(speed.value) - expected) <= float(speed.radius) + 1e-14
    assert abs(float(proof.projectile_angle(fastest).value)) < 1e-10
    launch = proof.launch_time
    assert launch is not None
    assert launch.value < proof.time_of(fastest).value


def test_the_longest_flight_is_longer_than_its_neighbours() -> None:
    """Beside the maximum the range is less by its curvature; no rate is used to tell that."""
    proof = tb.prove(pendulum(8.0), digits=15, until=0.75)
    best = proof.best_release(0.25)
    assert best is not None
    longest, time = proof.vacuum_range(best), proof.time_of(best).value
    for off in ("-0.01", "-0.0001", "0.0001", "0.01"):
        other = proof.vacuum_range(time + type(time)(off))
        assert other.value + other.radius < longest.value - longest.radius
        assert longest.value - other.value < 1000 * float(off) ** 2


def test_extrema_beyond_the_proof_or_without_a_launch() -> None:
    proof = tb.prove(pendulum(8.0), digits=10, until=0.75)
    assert proof.best_release(1.0) is None  # the motion is not proved that far
    still = tb.prove(pendulum(8.0), digits=10, until=0.0625)
    with pytest.raises(InputError, match="launch"):
        still.fastest(0.125)


def test_extrema_of_a_certificate_are_proved() -> None:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    launch = certificate.figure("launch_time")
    assert launch is not None
    proof = tb.prove("fixed", digits=18, until=launch.value + 1.5 * BEYOND_LAUNCH)
    known = ProvedMotionOfFigures(proof, BEYOND_LAUNCH)
    figures = [with_proof(figure, known) for figure in certificate.figures]
    assert [figure.label for figure in figures if figure.not_proved] == []
    # A value beside its maximum is refused.
    best = next(figure for figure in certificate.figures if figure.name == "best_range")
    off = best.with_fields(
        value=best.value * (1 - 1e-9), proved_value=None, proved_radius=None, not_proved="not yet"
    )
    with pytest.raises(InputError, match="best_range"):
        with_proof(off, known)
