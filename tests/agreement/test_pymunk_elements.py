"""pymunk's joints, walls and force elements of every kind.

The built space, order of convergence, faults.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from elements import ELEMENTS, HINGE, UP, WALLS, tied
from mechanisms import body_of, everything, pin
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.pymunk.build import build
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.models.elements import (
    GROUND,
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from trebucheck.models.errors import SimulationError, UnsupportedProblemError
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import characteristic_time, solve

pytest.importorskip("pymunk")

ROD = body_of("rod", "a", 2.0, (1.0, 0.2), 0.0)
"""A point mass on a massless rod."""
NEXT = body_of("next", "b", 1.0, (0.8, -0.1), 0.0)
"""Another one, on the mass of the first."""


def rods(*elements: Any) -> Mechanism:
    """Two massless rods with a point mass each, and force elements on them."""
    return Mechanism(
        name="rods",
        bodies=(ROD, NEXT),
        joints=(pin("foot", GROUND, "rod"), pin("knee", "rod", "next", (1.0, 0.2))),
        force_elements=elements,
        gravity=9.81,
        start=(0.3, 0.8),
        start_speeds=(1.0, -1.0),
    )


def on_brackets() -> Mechanism:
    """A bracket on the wall, an arm on it, a plate on the arm, a bob on the plate that stands on a
    stop: two welds.
    """
    return Mechanism(
        name="brackets",
        bodies=(
            body_of("bracket", None, 1.0, (0.1, 0.2), 0.1),
            body_of("arm", "a", 2.0, (0.5, 0.1), 0.2),
            body_of("plate", None, 0.7, (0.2, 0.1), 0.05),
            body_of("bob", "b", 1.0, (0.4, 0.0), 0.03),
        ),
        joints=(
            WeldJoint(
                name="wall",
                parent=GROUND,
                child="bracket",
                parent_point=(0.1, 0.2),
                child_point=(0.3, 0),
                angle=0.4,
            ),
            pin("shoulder", "bracket", "arm", (0.5, 0.1)),
            WeldJoint(
                name="seam",
                parent="arm",
                child="plate",
                parent_point=(0.8, 0.1),
                child_point=(0.05, 0.02),
                angle=-0.8,
            ),
            pin("hook", "plate", "bob", (0.4, 0.1)),
        ),
        force_elements=(
            SpringDamper(
                name="tie",
                body="bob",
                point=(0.3, 0.1),
                relative_to="bracket",
                relative_point=(0.4, 0.3),
                stiffness=30.0,
                damping=1.0,
                rest_length=0.2,
            ),
            RotationalSpringDamper(
                name="twist", body="plate", relative_to="bracket", stiffness=4.0, rest_angle=0.3
            ),
            RotationalSpringDamper(
                name="curl", body="bob", relative_to="plate", stiffness=4.0, damping=0.1
            ),
            RotationalSpringDamper(
                name="seal", body="plate", relative_to="arm", stiffness=4.0, damping=0.1
            ),
            ConstantForce(name="push", body="plate", point=(0.1, 0.3), force=(1.0, 2.0)),
        ),
        stops=(
            Stop(name="catch", body="bob", relative_to="plate", sense=1, limit=1.4, closed=True),
        ),
        gravity=9.81,
        start=(0.3, 0.9),
    )


def point_mass_on_a_rail() -> Mechanism:
    """A slider without inertia on a turning arm, off its rail's point, and one on a rail of the
    ground.
    """
    rail: dict[str, Any] = {
        "parent_point": (0.2, 0.1),
        "child_point": (0.1, 0.0),
        "axis": (0.6, 0.8),
        "angle": 0.5,
    }
    return Mechanism(
        name="beads",
        bodies=(
            body_of("cart", None, 1.0, (0.3, 0.2), 0.0),
            body_of("arm", "a", 2.0, (0.5, 0.1), 0.2),
            body_of("bead", None, 1.0, (0.3, 0.2), 0.0),
        ),
        joints=(
            PrismaticJoint(name="track", child="cart", coordinate="x", **rail),
            pin("axle", "cart", "arm", (0.1, 0.3)),
            PrismaticJoint(name="rail", parent="arm", child="bead", coordinate="s", **rail),
        ),
        gravity=9.81,
        start=(0.3, 0.2, -0.1),
        start_speeds=(1.0, 0.5, -0.7),
    )


def slot_over_the_ground() -> Mechanism:
    """Loops between a turning body and a bracket on the ground, whose joint has the bracket as its
    child.
    """
    tip = 0.9 * np.exp(-0.3j)
    guide = SlotJoint(
        name="guide",
        parent="arm",
        child="bracket",
        parent_point=(0.2, 0.0),
        child_point=(0.0, 0.0),
        axis=(1.0, 0.0),
    )
    return Mechanism(
        name="guide",
        bodies=(
            body_of("bracket", None, 1.0, (0.1, 0.2), 0.1),
            body_of("arm", "a", 2.0, (0.5, 0.1), 0.2),
        ),
        joints=(
            WeldJoint(
                name="wall",
                parent=GROUND,
                child="bracket",
                parent_point=(tip.real, tip.imag),
                child_point=(0, 0),
            ),
            SlotJoint(
                name="slide",
                child="arm",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(0, 1),
                coordinate="s",
            ),
            guide,
        ),
        force_elements=(
            SpringDamper(
                name="tie", body="arm", point=(0.1, 0), relative_point=(1, 1), stiffness=20.0
            ),
        ),
        gravity=9.81,
        start=(0.3, 0.0),
    )


OWN: dict[str, Mechanism] = {
    "forces on massless rods": rods(
        SpringDamper(
            name="tie",
            body="next",
            point=(0.3, 0.3),
            relative_to="rod",
            relative_point=(0.2, 0.1),
            stiffness=50.0,
            damping=2.0,
            rest_length=0.5,
        ),
        ConstantForce(name="pull", body="rod", point=(0.4, -0.5), force=(3.0, 2.0)),
    ),
    "couples on massless rods": rods(
        RotationalSpringDamper(
            name="one", body="next", relative_to="rod", stiffness=20, damping=0.5, rest_angle=7
        ),
        RotationalSpringDamper(name="two", body="rod", stiffness=5.0, damping=0.2, rest_angle=-7),
        ConstantTorque(name="motor", body="next", relative_to="rod", torque=2.0),
    ),
    "welds to the ground and to an arm": on_brackets(),
    "sliders without inertia": point_mass_on_a_rail(),
    "a slot that slides over the ground": slot_over_the_ground(),
}
ALL = ELEMENTS | OWN


@pytest.mark.parametrize("name", ALL)
def test_the_built_space_is_the_described_one(name: str) -> None:
    found = check_model(PymunkEngine(), ALL[name])
    assert found.exposed
    assert {check.name for check in found.checks} >= {
        "mass matrix",
        "force",
        "acceleration",
        "centre of mass",
    }
    assert found.holds


def errors(exact: Solution, step: float) -> dict[str, float]:
    """Largest errors of all that is observed, and of the times and impulses of events."""
    run = PymunkEngine(timestep=step).simulate(exact.problem)
    there, events = (
        exact.trajectory(run.t),
        np.array([*exact.release_times.values()], dtype=np.float64),
    )
    events = np.append(events[np.isfinite(events)], [time for time, _ in exact.impacts])
    smooth = np.all(
        np.abs(run.t[:, None] - events) > 3 * step, axis=1
    )  # there forces and speeds jump
    pairs = {
        "q": (run.q, there.q),
        "u": (run.u, there.u),
        "potential": (run.potential_energy, there.potential_energy),
    }
    pairs |= {
        joint: (force, there.joint_reaction(joint)) for joint, force in run.joint_reactions.items()
    }
    pairs |= {stop: (force, there.stop_torque(stop)) for stop, force in run.stop_torques.items()}
    assert set(run.joint_reactions) == set(run.joint_gaps) == set(there.joint_reactions)
    found = {
        name: float(np.abs(mine - theirs)[smooth].max()) for name, (mine, theirs) in pairs.items()
    }
    assert {name for name, time in run.release_times.items() if time is None} == {
        name for name, time in exact.release_times.items() if time is None
    }
    for name, time in exact.release_times.items():
        found[f"release of {name}"] = abs((run.release_time(name) or 0.0) - (time or 0.0))
    for (mine, impulses), (theirs, exact_impulses) in zip(run.impacts, exact.impacts, strict=True):
        found["impact"] = max(found.get("impact", 0.0), abs(mine - theirs))
        assert impulses == pytest.approx(exact_impulses, rel=1e-3)
    return found


def assert_order_two(exact: Solution, step: float) -> None:
    """A quarter of the step leaves a sixteenth of each error that is more than what the passes
    leave.

    Events fall elsewhere in a step, hence the margin; a release is found by extrapolation, within
    the step's square.
    """
    coarse, fine = (errors(exact, h) for h in (step, step / 4))
    for name in coarse:
        if name.startswith("release of"):
            assert max(coarse[name], 16 * fine[name]) <= 10 * step**2
        else:
            assert fine[name] <= 1e-7 or 10 < coarse[name] / fine[name] < 25, (name, coarse, fine)


@pytest.mark.parametrize("name", ALL)
def test_motion_forces_and_energies_are_of_order_two(name: str) -> None:
    assert_order_two(solve(Problem(ALL[name], 0.2)), 1.6e-3)


@pytest.mark.parametrize("name", WALLS)
def test_walls_of_moving_bodies(name: str) -> None:
    mechanism, duration, law = WALLS[name]
    assert check_model(PymunkEngine(), mechanism).holds
    exact = solve(Problem(mechanism, duration, stop_law=law))
    assert exact.impacts or exact.release_times["wall"]
    assert_order_two(exact, 2e-3)


def test_tuned_stays_within_its_bar() -> None:
    """1e-3 (metre or radian) at a thousandth of the characteristic time."""
    time = characteristic_time(everything())
    exact = solve(Problem(everything(), time))
    run = PymunkEngine(timestep=1e-3 * time).simulate(exact.problem)
    assert np.abs(run.q - exact.trajectory(run.t).q).max() <= 1e-3


def test_a_damper_is_of_order_two_where_the_librarys_own_is_not() -> None:
    """Chipmunk slows bodies down after the other forces of a step: by half a step too much."""
    sled = Mechanism(
        name="sled",
        bodies=(body_of("sled", None, 2.0, (0, 0), 0.0),),
        joints=(
            PrismaticJoint(
                name="rail",
                child="sled",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(1, 0),
                coordinate="x",
            ),
        ),
        force_elements=(
            SpringDamper(
                name="tie",
                body="sled",
                point=(0, 0),
                relative_point=(-1, 0),
                stiffness=50,
                damping=8,
                rest_length=1,
            ),
        ),
        gravity=9.81,
        start=(0.3,),
    )
    found, decay = [], 8.0 / 4.0
    w = math.sqrt(50.0 / 2.0 - decay**2)
    for step in (4e-3, 2e-3):
        run = PymunkEngine(timestep=step).simulate(Problem(sled, 2.0))
        exact = 0.3 * np.exp(-decay * run.t) * (np.cos(w * run.t) + decay / w * np.sin(w * run.t))
        found.append(float(np.abs(run.q[:, 0] - exact).max()))
    assert found[0] / found[1] == pytest.approx(4.0, rel=0.1)
    assert (
        found[1] <= (w * 2e-3) ** 2
    )  # the leapfrog's phase is late by (w h)^2 / 24 of what it has turned


def test_a_start_with_speeds_has_forces_of_order_two_from_the_first_sample_on() -> None:
    """A chain on a pin in the ground.

    Half an increment alone would miss the rods' lengths by O(h^3).
    """
    mechanism = tied()
    assert any(mechanism.start_speeds)
    exact, first = solve(Problem(mechanism, 0.02)), list[float]()
    for step in (2e-3, 1e-3, 5e-4):
        run = PymunkEngine(timestep=step).simulate(exact.problem)
        there = exact.trajectory(run.t)
        apart = [
            np.abs(force - there.joint_reaction(name))
            for name, force in run.joint_reactions.items()
        ]
        first.append(float(np.max([force[:4].max() for force in apart])))
    assert first[0] / first[1] == pytest.approx(4.0, rel=0.2)
    assert first[1] / first[2] == pytest.approx(4.0, rel=0.2)


def test_what_pymunk_cannot_build_is_refused() -> None:
    wheel = body_of("hull", "a", 2.0, (0.0, 0.0), 0.4)
    alone: dict[str, Any] = {
        "name": "alone",
        "bodies": (wheel,),
        "joints": (HINGE,),
        "gravity": 0.0,
        "start": (0.0,),
    }
    itself = PointStop(
        name="wall", body="hull", point=(1, 0), relative_to="hull", normal=UP, offset=0, closed=True
    )
    with pytest.raises(UnsupportedProblemError, match="stop 'wall': nothing can move against it"):
        PymunkEngine().simulate(Problem(Mechanism(**(alone | {"stops": (itself,)})), 0.1))
    away = itself.model_copy(update={"offset": -1.0, "normal": (1.0, 0.0), "closed": False})
    spun = Mechanism(**(alone | {"stops": (away,), "start_speeds": (1.0,)}))
    run = PymunkEngine().simulate(Problem(spun, 0.1, stop_law=StopLaw.UNILATERAL))
    assert run.q[-1, 0] == pytest.approx(0.1, abs=1e-12)
    speck = body_of("hull", "a", 2.0, (0.1, 0.0), 0.0)
    loose = FreeJoint(name="air", child="hull", coordinates=("x", "y"))
    free = alone | {"bodies": (speck,), "joints": (loose,), "start": (0.0, 0.0, 0.0)}
    with pytest.raises(UnsupportedProblemError, match="'hull', whose inertia is 0"):
        PymunkEngine().simulate(Problem(Mechanism(**free), 0.1))


def test_two_equal_stops_that_would_have_to_pull_open_at_once() -> None:
    """While one of them holds, the other's gap moves by rounding only: that is no closing."""
    wheel = body_of("hull", "a", 2.7, (0.3, 0.02), 0.3)
    stops = tuple(
        Stop(name=name, body="hull", sense=-1, limit=-0.4, closed=True) for name in ("one", "two")
    )
    mechanism = Mechanism(
        name="wheel",
        bodies=(wheel,),
        joints=(HINGE,),
        stops=stops,
        gravity=9.81,
        gravity_direction=(0.6, 0.8),
        start=(0.4,),
    )
    exact = solve(Problem(mechanism, 0.2))
    run = PymunkEngine().simulate(exact.problem)
    assert dict(run.release_times) == dict(exact.release_times) == {"one": 0.0, "two": 0.0}
    assert np.abs(run.q - exact.trajectory(run.t).q).max() <= 1e-6


def test_a_spring_too_stiff_for_the_step_is_an_error_and_not_a_result() -> None:
    spring = SpringDamper(
        name="tie", body="bob", point=(0.4, 0.1), relative_point=(0.5, -1.0), stiffness=1e12
    )
    with pytest.raises(SimulationError, match=r"lost the joint .* a shorter timestep"):
        PymunkEngine(timestep=1e-2).simulate(Problem(tied(spring), 3.0))


def _change(kind: str, **values: object) -> Callable[[Any], None]:
    """Change the first of Chipmunk's constraints of a kind."""

    def change(machine: Any) -> None:
        joint = next(joint for joint in machine.space.constraints if type(joint).__name__ == kind)
        for name, value in values.items():
            setattr(joint, name, value)

    return change


def _without_loads(machine: Any) -> None:
    machine.loads.pop()


def _turned_line(machine: Any) -> None:
    rod = next(rod for rod in machine.rods if rod.axis is not None)
    rod.joint.anchor_a = (rod.joint.anchor_a[0] + 1e-3, rod.joint.anchor_a[1])


FAULTS: dict[str, Callable[[Any], None]] = {
    "spring": _change("DampedSpring", stiffness=40.04),
    "rest length": _change("DampedSpring", rest_length=0.301),
    "rotary spring": _change("DampedRotarySpring", rest_angle=0.301),
    "motor left out": _without_loads,
    "slot aside": _turned_line,
    "gravity": lambda machine: setattr(machine.space, "gravity", (0.0, -9.81)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_the_space_shows(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.pymunk import inspect as module

    rightly = module.build

    def wrongly(*arguments: Any) -> Any:
        machine = rightly(*arguments)
        FAULTS[fault](machine)
        return machine

    monkeypatch.setattr(module, "build", wrongly)
    assert not check_model(PymunkEngine(), everything()).holds


def test_the_angle_of_a_point_mass_is_from_its_pin_wherever_that_is_in_the_body() -> None:
    hung = rods(
        RotationalSpringDamper(name="one", body="rod", stiffness=30.0, rest_angle=0.2),
        RotationalSpringDamper(
            name="two", body="next", relative_to="rod", stiffness=5.0, damping=0.2, rest_angle=-0.4
        ),
    )
    joints = (
        pin("foot", GROUND, "rod", (0.3, 0.1), (0.2, -0.3)),
        pin("knee", "rod", "next", (1.0, 0.2), (-0.1, 0.4)),
    )
    assert check_model(PymunkEngine(), hung.model_copy(update={"joints": joints})).holds


@pytest.mark.parametrize("turning", [True, False])
def test_a_spring_between_bodies_that_turn_is_chipmunks_own(turning: bool) -> None:
    """Its impulse is that of the angle at the step's end, whatever else acts on the bodies."""
    spring = RotationalSpringDamper(name="spring", body="next", relative_to="rod", stiffness=30.0)
    mechanism = rods(spring)
    if turning:  # by inertias, and by what hangs beside the outer one's mass
        rod, outer = (body.model_copy(update={"inertia": 0.2}) for body in mechanism.bodies)
        mechanism = mechanism.model_copy(
            update={
                "bodies": (rod, outer, body_of("last", "c", 1.0, (0.5, 0.0), 0.1)),
                "joints": (*mechanism.joints, pin("hinge", "next", "last", (0.1, 0.0))),
                "start": (*mechanism.start, 0.0),
                "start_speeds": (*mechanism.start_speeds, 0.0),
            }
        )
    assembly = build(mechanism, (), 0.0, 1e4)
    kinds = [type(joint).__name__ for joint in assembly.space.constraints]
    assert kinds.count("DampedRotarySpring") == turning and len(assembly.loads) == (not turning)


def test_point_masses_that_meet_in_a_pin_of_a_free_mechanism() -> None:
    """The space has no static body until it is asked for, which is in its rows as others are."""
    half = math.pi / 3
    hull = Body(name="hull", angle="h", mass=3.0, centre=(0, 0), inertia=0.7)
    bobs = tuple(
        Body(name=name, angle=name[0], mass=1.0, centre=(1, 0), inertia=0.0)
        for name in ("left", "right")
    )
    joints = (
        FreeJoint(name="flight", child="hull", coordinates=("x", "y")),
        pin("on the left", "hull", "left", at=(-0.5, 0)),
        pin("on the right", "hull", "right", at=(0.5, 0)),
        pin("top", "left", "right", at=(1, 0), on=(1, 0)),
    )
    free = Mechanism(
        name="vee", bodies=(hull, *bobs), joints=joints, stops=(), gravity=9.81,
        start=(0.0, half, math.pi - half, 0.0, 0.0),
    )  # fmt: skip
    problem = Problem(free, duration=0.3)
    row = PymunkEngine(hold_lengths=False).simulate(problem)
    assert row.q[-1, :3] == pytest.approx(free.start[:3], abs=1e-9)  # it falls as it is
