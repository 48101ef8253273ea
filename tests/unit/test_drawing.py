"""Drawings of mechanisms from their description.

Any of them draws, and the parts say what the mechanism is.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import (
    body_of,
    chain,
    everything,
    floor,
    hanging_bob,
    parallel_cranks,
    pin,
    slider_crank,
)
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.report.drawing.sketch import ROLES, Drawing, Shape, draw, loaded_rod
from trebucheck.models.elements import GROUND, ConstantForce, CubicTorsionSpring
from trebucheck.models.kinematics import initial_state
from trebucheck.models.library.registry import benchmarks, model, models
from trebucheck.models.mechanism import Body, Mechanism

NAMED = {name: model(name) for name in models()} | {
    b.name: b.problem(None).mechanism for b in benchmarks()
}
OWN = {
    "everything": everything(),
    "chain": chain(),
    "cranks": parallel_cranks(3),
    "slider crank": slider_crank(),
}
MECHANISMS = NAMED | OWN | {f"random {seed}": random_mechanism(seed) for seed in range(12)}


def _motion(mechanism: Mechanism) -> np.ndarray:
    """Some states about the start: a drawing asks of a motion only that it moves."""
    q, _ = initial_state(mechanism)
    return q + np.random.default_rng(7).normal(0.0, 0.1, (5, len(q)))


def _of(drawing: Drawing, role: str) -> list[Shape]:
    return [shape for shape in drawing.shapes if shape.role == role]


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
def test_any_mechanism_draws(mechanism: Mechanism) -> None:
    q = _motion(mechanism)
    drawing = draw(mechanism, q)
    xy = drawing.positions(q)
    assert np.isfinite(xy).all() and drawing.size > 0
    assert {index for shape in drawing.shapes for index in shape.points} <= set(
        range(len(drawing.points))
    )
    x0, y0, x1, y1 = drawing.box
    for shape in drawing.shapes:
        assert shape.points and math.isfinite(shape.size) and shape.size >= 0
        if shape.role in (
            "body",
            "mass",
            "rope",
        ):  # what moves stays in view during the whole motion
            at = xy[:, list(shape.points)]
            assert (at >= (x0, y0)).all() and (at <= (x1, y1)).all()
    ranks = [ROLES.index(shape.role) for shape in drawing.shapes]
    assert ranks == sorted(ranks)


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
def test_each_body_joint_and_marker_has_its_place(mechanism: Mechanism) -> None:
    q = _motion(mechanism)
    drawing = draw(mechanism, q)
    xy, kinematics = drawing.positions(q), drawing.kinematics
    drawn = {drawing.points[i].body for shape in drawing.shapes for i in shape.points}
    assert {body.name for body in mechanism.bodies} <= drawn
    for marker in mechanism.markers:
        there = kinematics.position(kinematics.point(marker.body, marker.point), q)
        np.testing.assert_allclose(xy[:, drawing.markers[marker.name]], there, rtol=0, atol=1e-12)
    for joint in mechanism.joints:
        there = kinematics.position(kinematics.point(joint.child, joint.child_point), q)
        np.testing.assert_allclose(xy[:, drawing.joints[joint.name]], there, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["everything", "chain", "rolling", "squeezer", "random 3"])
def test_deviations_keep_the_digits_that_a_difference_of_positions_loses(name: str) -> None:
    mechanism = MECHANISMS[name]
    q = _motion(mechanism)
    drawing = draw(mechanism, q)
    d = np.random.default_rng(1).normal(0.0, 1e-3, q.shape)
    np.testing.assert_allclose(
        drawing.deviations(q, d),
        drawing.positions(q + d) - drawing.positions(q),
        rtol=1e-9,
        atol=1e-13,
    )
    # The first-order terms of a deviation of 1e-13 rad have 13 digits, its second-order ones none.
    tiny = drawing.deviations(q, 1e-10 * d)
    linear = 0.5e-10 * 1e4 * (drawing.deviations(q, 1e-4 * d) - drawing.deviations(q, -1e-4 * d))
    np.testing.assert_allclose(tiny, linear, rtol=1e-6, atol=1e-12 * np.abs(linear).max())


def test_a_trebuchet_shows_its_parts() -> None:
    drawing = draw(NAMED["fixed"])
    (arm,) = _of(drawing, "body")
    ends = sorted(drawing.points[i].at.real for i in arm.points)
    assert (arm.kind, ends) == ("line", [-4, 10])
    radii = {drawing.points[shape.points[0]].body: shape.size for shape in _of(drawing, "mass")}
    assert radii["hanger"] / radii["sling"] == pytest.approx((3000 / 60) ** (1 / 3))
    assert len(_of(drawing, "rope")) == 2
    assert {shape.stop for shape in _of(drawing, "stop")} == {
        "hanger rest",
        "sling rest",
        "arm stop",
    }
    assert not [shape for shape in draw(NAMED["fixed"]).shapes if shape.kind == "wheel"]
    assert len([shape for shape in draw(NAMED["rolling"]).shapes if shape.kind == "wheel"]) == 1


def test_masses_fixed_to_a_rod_are_found_from_its_centre_and_inertia() -> None:
    """The catapult: a rod of 1000 kg with the projectile at one end and the counterweight at the
    other.
    """
    arm = NAMED["catapult"].body("arm")
    shares = loaded_rod(arm, -4 + 0j, 10 + 0j)
    assert shares is not None
    assert [share * arm.mass for share in shares] == pytest.approx([1000, 3000, 60])
    lighter = Body(
        name="arm", mass=1, centre=(0.5, 0), inertia=1e-3
    )  # in the middle: no masses at the ends do that
    assert loaded_rod(lighter, 0j, 1 + 0j) is None


def test_a_rod_known_by_one_pin_has_the_length_that_its_inertia_says() -> None:
    rod = body_of("rod", "a", 2.0, (0.75, 0.0), 2.0 * 1.5**2 / 12)
    mechanism = hanging_bob(bodies=(rod,), joints=(pin("pin", GROUND, "rod"),), markers=())
    (beam,) = _of(draw(mechanism), "body")
    assert sorted(abs(draw(mechanism).points[i].at) for i in beam.points) == pytest.approx([0, 1.5])


@pytest.mark.parametrize("name", ["fixed", "hinged", "stopped-pendulum"])
def test_a_rest_lies_on_the_side_to_which_the_body_cannot_go(name: str) -> None:
    """At a gap of zero the body touches it; with an open gap it is farther away."""
    mechanism = MECHANISMS[name]
    for stop in mechanism.angle_stops:
        q = np.array([mechanism.start])
        drawing = draw(mechanism, q)
        (rest,) = (shape for shape in drawing.shapes if shape.stop == stop.name)
        index = mechanism.angles.index(mechanism.body(stop.body).angle or "")
        pivot = drawing.stops[stop.name][0]

        def direction(
            q: np.ndarray, i: int, drawing: Drawing = drawing, pivot: int = pivot
        ) -> complex:
            return complex(*(drawing.positions(q)[0, i] - drawing.positions(q)[0, pivot]))

        q[0, index] -= (
            drawing.kinematics.gap(stop.name, q)[0] * stop.sense
        )  # to where the gap is zero
        arms = [complex(*mechanism.body(stop.body).centre), *_outline(mechanism, stop.body)]
        arm = (
            max(arms, key=lambda at: abs(at - drawing.points[pivot].at)) - drawing.points[pivot].at
        )
        line = arm * cmath.exp(-1j * q[0, index])
        for corner in rest.points:
            beside = cmath.phase(direction(q, corner) / line)
            assert (
                0 < stop.sense * beside < 0.5
            )  # anticlockwise of the body, if it may only go clockwise


def _outline(mechanism: Mechanism, body: str) -> list[complex]:
    found = [complex(*joint.parent_point) for joint in mechanism.joints if joint.parent == body]
    found += [complex(*joint.child_point) for joint in mechanism.joints if joint.child == body]
    return found + [complex(*marker.point) for marker in mechanism.markers if marker.body == body]


def test_a_wall_is_where_the_point_touches_it_and_hatched_behind() -> None:
    mechanism = hanging_bob(floor(1.0))
    drawing = draw(mechanism, np.array([[0.2], [0.5], [1.0]]))
    (wall,) = _of(drawing, "stop")
    (a, b) = drawing.positions(np.array([[0.2]]))[0, list(wall.points)]
    assert a[1] == b[1] == -1.0
    assert ((b - a) @ (1, 0)) > 0  # its right-hand side is below: where the point cannot be
    assert a[0] < 2 * math.cos(1.0) and b[0] > 2 * math.cos(0.2)


def test_a_wall_that_is_never_near_is_left_out() -> None:
    assert not _of(draw(hanging_bob(floor(30.0))), "stop")


def test_springs_dampers_and_loads_are_told_apart() -> None:
    drawing = draw(everything())
    kinds = {(shape.role, shape.kind) for shape in drawing.shapes}
    assert {
        ("spring", "between"),
        ("damper", "between"),
        ("spring", "spiral"),
        ("load", "arrow"),
    } <= kinds
    assert {("load", "turn"), ("guide", "line"), ("body", "area")} <= kinds
    only = {shape.role for shape in draw(NAMED["oscillator"]).shapes}
    assert "spring" in only and "damper" not in only


def test_a_cubic_torsion_spring_is_a_spiral() -> None:
    spring = CubicTorsionSpring(name="spring", body="bob", cubic_stiffness=2.0)
    shapes = _of(draw(hanging_bob(force_elements=(spring,))), "spring")
    assert [shape.kind for shape in shapes] == ["spiral"]


class _Magnet(ConstantForce):
    """An element that the drawing does not know."""


def test_an_unknown_element_is_refused_by_name() -> None:
    force = _Magnet(name="coil", body="bob", point=(1.0, 0.0), force=(1.0, 0.0))
    mechanism = hanging_bob().model_copy(update={"force_elements": (force,)})
    with pytest.raises(tb.UnsupportedProblemError, match="coil"):
        draw(mechanism)
