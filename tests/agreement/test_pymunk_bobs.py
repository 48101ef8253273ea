"""Bodies that pymunk builds as a point mass without an angle: those whose angle nothing needs."""

from __future__ import annotations

import pytest
from mechanisms import pin
from trebucheck.models.elements import (
    GROUND,
    AnyJoint,
    AnyStop,
    ConstantForce,
    PointStop,
    SlotJoint,
    Stop,
    WeldJoint,
)
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.spec import Vector

pytest.importorskip("pymunk")

from trebucheck.engines.pymunk.bodies import parts_of

END, BESIDE = (1.0, 0.0), (0.4, 0.0)  # of the bob: its mass, and a place on the way there


def turns(
    *joints: AnyJoint,
    stops: tuple[AnyStop, ...] = (),
    forces: tuple[ConstantForce, ...] = (),
    inertia: float = 0.0,
    hung_from: str = "arm",
    held_at: Vector = (0.0, 0.0),
) -> bool:
    """Whether the bob turns; it hangs on an arm, and a rider is where joints put it."""
    bodies = [
        Body(name="arm", angle="a", mass=2.0, centre=(0.5, 0.0), inertia=0.3),
        Body(name="bob", angle="b", mass=0.1, centre=END, inertia=inertia),
        Body(name="rider", angle="c", mass=0.2, centre=(0.1, 0.1), inertia=0.1),
    ]
    hung = pin("hook", hung_from, "bob", (1.0, 0.0), held_at)
    tree = [joint for joint in joints if joint.child == "rider"]
    loops = [joint for joint in joints if joint.child != "rider"]
    rider = tree or [pin("peg", GROUND, "rider", (2.0, 0.0))]
    mechanism = Mechanism(
        name="bob",
        bodies=tuple(bodies),
        joints=(pin("axle", GROUND, "arm"), hung, *rider, *loops),
        stops=stops,
        force_elements=forces,
        gravity=9.81,
        start=(0.0,) * (3 + any(isinstance(joint, SlotJoint) for joint in tree)),
    )
    return next(part.turns for part in parts_of(mechanism, 1e4) if part.name == "bob")


def floor(point: Vector, *, closed: bool = True) -> PointStop:
    return PointStop(
        name="floor", body="bob", point=point, normal=(0, 1), offset=0.0 if closed else -1.0,
        closed=closed,
    )  # fmt: skip


def wall(*, closed: bool) -> PointStop:
    """Of the bob, for a point of the rider."""
    return PointStop(
        name="wall", body="rider", relative_to="bob", point=(0, 0), normal=(0, 1),
        offset=0.0 if closed else -1.0, closed=closed,
    )  # fmt: skip


def slot(at: Vector) -> SlotJoint:
    return SlotJoint(
        name="slot", parent="bob", child="rider", parent_point=at, child_point=(0, 0), axis=(1, 0),
        coordinate="s",
    )  # fmt: skip


def test_a_point_mass_on_a_rod_does_not_turn() -> None:
    assert not turns()
    assert not turns(pin("hinge", "bob", "rider", END))
    assert not turns(stops=(floor(END), wall(closed=False)))
    assert not turns(stops=(floor(BESIDE, closed=False),))
    assert not turns(pin("ring", GROUND, "bob", (2.0, 0.0), END))
    assert not turns(forces=(ConstantForce(name="wind", body="bob", point=BESIDE, force=(1, 0)),))


def test_a_body_turns_if_something_acts_beside_its_mass() -> None:
    assert turns(pin("hinge", "bob", "rider", BESIDE))
    assert turns(stops=(floor(BESIDE),))
    assert turns(pin("ring", GROUND, "bob", (1.4, 0.0), BESIDE))
    assert turns(pin("ring", GROUND, "bob", (1.4, 0.0), BESIDE), stops=(floor(END),))


def test_a_body_turns_if_a_line_or_an_angle_of_it_guides_others() -> None:
    assert turns(slot(END))
    assert turns(stops=(wall(closed=True),))
    weld = WeldJoint(name="weld", parent=GROUND, child="bob", parent_point=(2, 0), child_point=END)
    assert turns(weld)


def test_a_body_with_inertia_is_a_point_mass_if_it_hangs_freely_on_another_body() -> None:
    assert not turns(inertia=0.01)
    assert turns(inertia=0.01, held_at=END)
    assert turns(inertia=0.01, hung_from=GROUND) and not turns(hung_from=GROUND)
    assert turns(pin("hinge", "bob", "rider", END), inertia=0.01)
    assert turns(stops=(floor(END),), inertia=0.01)
    wind = ConstantForce(name="wind", body="bob", point=END, force=(1, 0))
    assert turns(forces=(wind,), inertia=0.01)


def test_an_angle_to_its_parent_needs_none_of_a_point_mass_but_that_to_another_body_does() -> None:
    """A rod from the parent braces it; while a stop is open, nothing is built."""
    for to, closed in (("arm", True), ("arm", False), ("rider", True), ("rider", False)):
        stop = Stop(
            name="angle", body="bob", relative_to=to, sense=1, limit=0.0 if closed else -1.0,
            closed=closed,
        )  # fmt: skip
        assert turns(stops=(stop,), inertia=0.01) == (to == "rider" and closed)
