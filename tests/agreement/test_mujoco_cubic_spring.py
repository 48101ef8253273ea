"""A cubic torsion spring is a tendon of polynomial stiffness in MuJoCo, or refused by name."""

from __future__ import annotations

import pytest
import trebucheck as tb
from conftest import again
from trebucheck.engines.mujoco import build

pytest.importorskip("mujoco")


def two_rods(**spring: float) -> tb.Mechanism:
    """A double pendulum with the spring between its rods, which does not lie at rest at the
    start."""
    rods = [
        tb.Body(name=name, angle=angle, mass=2.0, centre=(0.5, 0.0), inertia=0.2)
        for name, angle in (("upper", "a"), ("lower", "b"))
    ]
    pins = [
        tb.PinJoint(
            name="top", parent="ground", child="upper", parent_point=(0, 0), child_point=(0, 0)
        ),
        tb.PinJoint(
            name="knee", parent="upper", child="lower", parent_point=(1, 0), child_point=(0, 0)
        ),
    ]
    element = tb.CubicTorsionSpring(name="spring", body="lower", relative_to="upper", **spring)
    return tb.Mechanism(
        name="two rods",
        bodies=tuple(rods),
        joints=tuple(pins),
        force_elements=(element,),
        markers=(tb.Marker(name="tip", body="lower", point=(1.0, 0.0)),),
        gravity=9.81,
        start=(0.3, 1.4),
    )


@pytest.mark.parametrize(
    ("rest_angle", "stiffness"),
    [
        (-0.4, 30.0),
        (0.0, 0.0),
        *(
            pytest.param(a, k, marks=again)
            for a, k in [(-0.4, 0), (0, 30.0), (2.0, 0), (2.0, 30.0)]
        ),
    ],
)
def test_it_is_the_mechanism_that_was_asked_for(rest_angle: float, stiffness: float) -> None:
    """Mass matrix, forces and accelerations of the built model, then the motion and its energy."""
    spring = {"rest_angle": rest_angle, "stiffness": stiffness, "cubic_stiffness": 40.0}
    run = tb.check(
        "mujoco",
        two_rods(**spring),
        duration=1.0,
        isolate=False,
        position=1e-8,
        energy_balance=1e-7,
    )
    assert run.equality is not None and run.equality.exposed


def test_a_wrong_cubic_term_is_another_mechanism(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = two_rods(cubic_stiffness=40.0)
    other = build.mjcf(two_rods(cubic_stiffness=40.5))
    monkeypatch.setattr(build, "mjcf", lambda *_: other)
    with pytest.raises(AssertionError, match=r"(?i)model|force"):
        tb.check("mujoco", mechanism, duration=0.5, isolate=False)


def test_a_version_with_linear_springs_refuses_it_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "has_polynomial_springs", lambda: False)
    with pytest.raises(tb.UnsupportedProblemError, match=r"'spring'.* linear"):
        tb.engine("mujoco").simulate(tb.Problem(two_rods(cubic_stiffness=1.0), duration=0.1))
