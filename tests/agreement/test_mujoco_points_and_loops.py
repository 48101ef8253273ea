"""MuJoCo with stops on points and joints that close loops: troughs, walls, tracks, linkages."""

from __future__ import annotations

import cmath
import functools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from mechanisms import misplaced
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.models.elements import GROUND, PinJoint, PointStop, SlotJoint, Stop
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.library.trebuchet import (
    FloatingArmParameters,
    HingedParameters,
    catapult,
    floating_arm,
    hinged,
)
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

mujoco: Any = pytest.importorskip("mujoco")

G = 9.81
BAR = 1e-6  # [m] at 1 ms, the issue's
# What holds a point gives way by (1 - d) a / k, with 1 - d = 1e-4 and k = 1 / h^2: at 1 ms 1e-10
# s^2 times its acceleration of some 10 to 100 m/s^2, and a motion of a second passes it on a few
# times.
SOFT = 5e-8
# What is asked of a force is kept through a step: it lags by half of one, and softness lets (1 - d)
# f' h / 2 of that show, with rates f' of some 10 to 100 of the peak a second.
LAG = 5e-6
STEPS = np.array([4e-3, 2e-3, 1e-3])
MACHINES: dict[str, Callable[[], Mechanism]] = {
    "catapult": catapult,
    "hinged": hinged,
    "floating arm": floating_arm,
}
machines = pytest.mark.parametrize("name", MACHINES)
with_points = pytest.mark.parametrize("name", ["hinged", "floating arm"])


def to_the_launch(mechanism: Mechanism) -> Solution:
    launch = solve(Problem(mechanism, 3.0)).launch
    assert launch is not None
    return solve(Problem(mechanism, launch.time))


@functools.cache
def reference(name: str) -> Solution:
    return to_the_launch(MACHINES[name]())


@functools.cache
def run(name: str, timestep: float = 1e-3, preset: str = "assisted") -> Trajectory:
    return MujocoEngine.presets()[preset](timestep=timestep).simulate(reference(name).problem)


def assert_forces_agree(found: Trajectory, exact: Solution, tolerance: float = LAG) -> None:
    """All stops' and joints' forces, at all samples, relative to their peak."""
    there = exact.trajectory(found.t)
    assert set(found.joint_reactions) == {joint.name for joint in found.mechanism.joints}
    for name, torque in there.stop_torques.items():
        assert found.stop_torque(name) == pytest.approx(
            torque, abs=tolerance * np.abs(torque).max()
        )
    largest = max(float(np.abs(force).max()) for force in there.joint_reactions.values())
    for name, force in there.joint_reactions.items():
        assert found.joint_reaction(name) == pytest.approx(force, abs=tolerance * largest)


# --- Mechanisms
# --------------------------------------------------------------------------------------------------


def pin(name: str, parent: str, child: str, at: tuple[float, float] = (0, 0)) -> PinJoint:
    return PinJoint(name=name, parent=parent, child=child, parent_point=at, child_point=(0, 0))


CRANK = Body(name="crank", angle="a", mass=2.0, centre=(0.5, 0.05), inertia=0.2)


def four_bar() -> Mechanism:
    """A crank, a coupler and a rocker; the coupler's far end is pinned to the rocker's."""
    coupler = Body(name="coupler", angle="b", mass=3.0, centre=(1.0, -0.1), inertia=0.5)
    rocker = Body(name="rocker", angle="c", mass=1.5, centre=(0.7, 0.1), inertia=0.3)
    a, b, c = start = (-1.0, -0.2, 1.3)
    hinge = cmath.exp(-1j * a) + 2.0 * cmath.exp(-1j * b) - 1.5 * cmath.exp(-1j * c)
    loop = PinJoint(
        name="loop", parent="coupler", child="rocker", parent_point=(2, 0), child_point=(1.5, 0)
    )
    return Mechanism(
        name="four-bar",
        bodies=(CRANK, coupler, rocker),
        joints=(
            pin("hook", GROUND, "crank"),
            pin("knee", "crank", "coupler", (1, 0)),
            pin("foot", GROUND, "rocker", (hinge.real, hinge.imag)),
            loop,
        ),
        markers=(Marker(name="point", body="coupler", point=(1, 0.3)),),
        gravity=G,
        start=start,
    )


def slider_crank() -> Mechanism:
    """The far end of a rod without inertia about its point mass slides along a slot that goes
    downhill.
    """
    rod = Body(name="rod", angle="b", mass=3.0, centre=(1.0, 0), inertia=0)
    a, b = start = (-1.1, 0.4)
    end = cmath.exp(-1j * a) + 2.0 * cmath.exp(-1j * b)
    slot = SlotJoint(
        name="slot",
        child="rod",
        parent_point=(end.real - 0.24, end.imag + 0.18),
        child_point=(2, 0),
        axis=(0.8, -0.6),
    )
    return Mechanism(
        name="slider-crank",
        bodies=(CRANK, rod),
        joints=(pin("hook", GROUND, "crank"), pin("knee", "crank", "rod", (1, 0)), slot),
        markers=(Marker(name="point", body="rod", point=(1, 0.3)),),
        gravity=G,
        start=start,
    )


def many_stops() -> Mechanism:
    """A hand whose tip slides down a slope while its elbow is held.

    Another wall and the shoulder's stop are open.
    """
    fore = Body(name="fore", angle="b", mass=3.0, centre=(0.6, 0.1), inertia=0.3)
    hand = Body(name="hand", angle="c", mass=1.0, centre=(0.3, 0), inertia=0.05)
    a, b, c = start = (-0.3, 0.4, 1.2)
    tip = cmath.exp(-1j * a) + 1.2 * cmath.exp(-1j * b) + complex(0.7, -0.2) * cmath.exp(-1j * c)
    slope = (math.sin(0.3), math.cos(0.3))
    rest = {"body": "hand", "point": (0.7, -0.2)}
    return Mechanism(
        name="many-stops",
        bodies=(CRANK, fore, hand),
        joints=(
            pin("shoulder", GROUND, "crank"),
            pin("elbow", "crank", "fore", (1, 0)),
            pin("wrist", "fore", "hand", (1.2, 0)),
        ),
        stops=(
            PointStop(
                **rest,
                name="slope",
                normal=slope,
                offset=slope[0] * tip.real + slope[1] * tip.imag,
                closed=True,
            ),
            PointStop(**rest, name="far wall", normal=(-1, 0), offset=-4.0, closed=False),
            Stop(
                name="elbow rest",
                body="fore",
                relative_to="crank",
                sense=1,
                limit=b - a,
                closed=True,
            ),
            Stop(name="shoulder rest", body="crank", sense=-1, limit=-2.0, closed=False),
        ),
        markers=(Marker(name="tip", body="hand", point=(0.7, -0.2)),),
        gravity=G,
        start=start,
    )


def ladder(start: float = 1.1, length: float = 3.0) -> Mechanism:
    """A uniform rod whose foot slides on the floor, away from a wall against which its head
    leans."""
    rod = Body(
        name="ladder", angle="a", mass=7.0, centre=(length / 2, 0), inertia=7.0 * length**2 / 12
    )
    floor = SlotJoint(
        name="floor",
        child="ladder",
        parent_point=(0, 0),
        child_point=(0, 0),
        axis=(1, 0),
        coordinate="x",
    )
    head = {"body": "ladder", "point": (length, 0)}
    return Mechanism(
        name="ladder",
        bodies=(rod,),
        joints=(floor,),
        stops=(PointStop(**head, name="wall", normal=(-1, 0), offset=0.0, closed=True),),
        markers=(Marker(name="head", **head),),
        gravity=G,
        start=(-start, -length * math.cos(start)),
    )


def block(slope: float) -> Mechanism:
    """A block in a slot that goes downhill, kept from turning by a second pin in the same slot.

    A loop.
    """
    body = Body(name="block", angle="a", mass=2.5, centre=(0.3, 0.2), inertia=0.4)
    along = (math.cos(slope), -math.sin(slope))
    common = {"child": "block", "parent_point": (1.0, 2.0), "axis": along}
    return Mechanism(
        name="block",
        bodies=(body,),
        joints=(
            SlotJoint(**common, name="front", child_point=(0, 0), coordinate="s"),
            SlotJoint(**common, name="back", child_point=(0.8, 0)),
        ),
        markers=(Marker(name="corner", body="block", point=(1.0, 1.0)),),
        gravity=G,
        start=(slope, 0.5),
    )


def faller(drop: float = 0.7) -> Mechanism:
    """A rod that falls about a pin until its tip meets a floor."""
    rod = Body(name="rod", angle="a", mass=2.0, centre=(1, 0), inertia=0.5)
    floor = PointStop(
        name="floor",
        body="rod",
        point=(1.5, 0),
        normal=(0, 1),
        offset=-1.5 * math.sin(drop),
        closed=False,
    )
    return Mechanism(
        name="faller",
        bodies=(rod,),
        joints=(pin("pin", GROUND, "rod"),),
        stops=(floor,),
        gravity=G,
        start=(0.0,),
    )


GENERIC = {m.name: m for m in (four_bar(), slider_crank(), many_stops(), ladder(), block(0.4))}
generic = pytest.mark.parametrize("name", GENERIC)


# --- Is it the same machine?
# -------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["assisted", "default"])
@pytest.mark.parametrize(
    "mechanism",
    [*(build() for build in MACHINES.values()), *GENERIC.values()],
    ids=lambda m: m.name,
)
def test_the_gate(mechanism: Mechanism, preset: str) -> None:
    found = check_model(MujocoEngine.presets()[preset](), mechanism)
    assert found.exposed and found.states >= 1
    names = {check.name for check in found.checks}
    assert {"mass matrix", "force", "acceleration", "start", "total mass"} <= names
    assert all(check.value is not None and check.value <= EXACT for check in found.checks), (
        found.checks
    )


def test_the_gate_feels_where_a_wall_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of a millimetre: what holds the sling then stands off its trough."""
    from trebucheck.engines.mujoco import build as module

    right = module.mjcf

    def lower(mechanism: Mechanism, timestep: float) -> str:
        moved = mechanism.stops[0].model_copy(
            update={"offset": mechanism.point_stops[0].offset - 1e-4}
        )
        return right(
            mechanism.model_copy(update={"stops": (moved, *mechanism.stops[1:])}), timestep
        )

    monkeypatch.setattr(module, "mjcf", lower)
    found = check_model(MujocoEngine(), hinged())
    (place,) = (check for check in found.checks if check.name == "stop position")
    assert place.value == pytest.approx(1e-4, rel=1e-6)


# --- Is the motion right?
# ----------------------------------------------------------------------------------------


@machines
def test_tuned_keeps_its_bars_at_a_millisecond(name: str) -> None:
    found, exact = run(name), reference(name)
    assert misplaced(found, exact) <= SOFT < BAR
    assert_forces_agree(found, exact)
    there = exact.trajectory(found.t)
    assert found.total_energy == pytest.approx(
        there.total_energy, abs=1e-9 * there.kinetic_energy.max()
    )


@with_points
def test_tuned_is_of_second_order(name: str) -> None:
    errors = [misplaced(run(name, step), reference(name)) for step in STEPS]
    assert np.polyfit(np.log(STEPS), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


@with_points
def test_the_trough_lets_go_inside_a_step(name: str) -> None:
    found, exact = run(name), reference(name)
    time, released = found.release_time("trough"), exact.release_times["trough"]
    assert time is not None and released is not None
    # The lag of the force over its rate of change: (1 - d) h / 2, times how the contact's mass is
    # felt (a few).
    assert time == pytest.approx(released, abs=5e-4 * 1e-3)
    assert time in found.t and (found.stop_torque("trough")[found.t >= time] == 0).all()
    assert (found.stop_torque("trough")[found.t < time] > 0).all()


@generic
def test_linkages_and_walls_of_every_kind(name: str) -> None:
    exact = solve(Problem(GENERIC[name], 0.6))
    found = MujocoEngine().simulate(exact.problem)
    assert misplaced(found, exact) <= SOFT
    assert_forces_agree(found, exact)
    assert {n for n, t in found.release_times.items() if t is not None} == {
        n for n, t in exact.release_times.items() if t is not None
    }


@pytest.mark.parametrize("seed", range(3))
@with_points
def test_other_parameters(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    ranges = {
        "l1": (7, 12),
        "l2": (2.5, 5),
        "m_b": (30, 150),
        "m_cw": (1500, 5000),
        "m_a": (300, 2000),
        "r": (4, 8),
    }
    values = {key: float(random.uniform(*bounds)) for key, bounds in ranges.items()}
    angles = {
        "theta0": 3 * math.pi / 4 + float(random.uniform(-0.2, 0.2)),
        "phi0": float(random.uniform(-0.1, 0.2)),
    }
    if name == "hinged":
        machine = hinged(HingedParameters(h=float(random.uniform(3, 6)), **values, **angles))
    else:
        machine = floating_arm(FloatingArmParameters(**values, **angles))
    exact = solve(Problem(machine, 1.5))
    found = MujocoEngine(timestep=2e-3).simulate(exact.problem)
    assert misplaced(found, exact) <= 4 * SOFT  # twice the step
    assert_forces_agree(found, exact)
    assert all(
        check.value is not None and check.value <= EXACT
        for check in check_model(MujocoEngine(), machine).checks
    )


# --- Versions whose solver stops short of its solution
# ---------------------------------------------------------------


@pytest.mark.parametrize(
    "mechanism", [floating_arm(), slider_crank(), many_stops()], ids=lambda m: m.name
)
def test_the_solution_that_older_solvers_start_at_is_the_solvers(mechanism: Mechanism) -> None:
    from trebucheck.engines.mujoco.build import (
        correction_of,
        load,
        preload,
        slot_contacts,
        start_data,
        stop_constraints,
    )
    from trebucheck.engines.mujoco.reference_acceleration import start_at_the_solution

    model = load(mechanism, MujocoEngine())
    data, correction = start_data(model), correction_of(mechanism, model, MujocoEngine())
    closed = [
        held
        for stop, held in stop_constraints(mechanism, model).items()
        if mechanism.stop(stop).closed
    ]
    with correction.applied():
        preload(data, closed + slot_contacts(mechanism, model), correction)
        correction.forward(data)
    found = data.qacc.copy()
    data.qacc_warmstart[:] = (
        found + [100.0, -30.0, 70.0][: model.nv]
    )  # far enough for other constraints to be active
    start_at_the_solution(model, data)
    assert data.qacc_warmstart == pytest.approx(found, abs=1e-9 * np.abs(found).max())


def test_motions_and_forces_are_right_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.mujoco import build, reference_acceleration

    started: list[float] = []
    right = reference_acceleration.start_at_the_solution
    monkeypatch.setattr(build, "loses_small_gains", lambda: True)
    monkeypatch.setattr(
        reference_acceleration,
        "start_at_the_solution",
        lambda model, data: (started.append(data.time), right(model, data)),
    )
    exact = solve(Problem(slider_crank(), 0.3))
    found = MujocoEngine().simulate(exact.problem)
    assert len(started) >= 4 * 300  # every stage of every step
    assert misplaced(found, exact) <= SOFT
    assert_forces_agree(found, exact)


# --- Closed forms
# ------------------------------------------------------------------------------------------------


def test_a_ladder_leaves_the_wall_at_two_thirds_of_its_height() -> None:
    found = MujocoEngine().simulate(Problem(ladder(), 1.5))
    time = found.release_time("wall")
    assert time is not None
    height = found.marker("head").position[:, 1]
    assert height[found.t == time] == pytest.approx(2 / 3 * height[0], abs=1e-6)
    # From then on nothing pushes along the floor.
    along = found.momentum[found.t >= time, 0]
    assert along == pytest.approx(along[0], abs=1e-9 * abs(along[0]))


@pytest.mark.parametrize("slope", [0.4, -1.2])
def test_a_block_slides_down_its_slot(slope: float) -> None:
    mechanism = block(slope)
    found = MujocoEngine().simulate(Problem(mechanism, 1.0))
    gone = 0.5 * G * math.sin(slope) * found.t**2
    assert found.q[:, 0] == pytest.approx(slope, abs=1e-9)
    assert found.q[:, 1] == pytest.approx(0.5 + gone, abs=1e-9)
    # The two pins share the weight across the slot, by the lever of the centre of mass along it.
    weight, share = 2.5 * G * math.cos(slope), 0.3 / 0.8
    across = np.array([math.sin(slope), math.cos(slope)])
    for joint, part in (("front", 1 - share), ("back", share)):
        assert found.joint_reaction(joint) @ across == pytest.approx(
            part * weight, abs=1e-6 * 2.5 * G
        )


def test_unilateral_comes_to_rest_on_a_wall() -> None:
    problem = Problem(faller(), 2.0, stop_law=StopLaw.UNILATERAL)
    found = MujocoEngine().simulate(problem)
    assert found.q[-1, 0] == pytest.approx(0.7, abs=SOFT)
    # Weight and floor balance about the pin, at levers of 1 and 1.5 along the rod.
    assert found.stop_torque("floor")[-1] == pytest.approx(2 * G / 1.5, rel=1e-6)
    # Under the paper's law there is no floor to fall on.
    assert MujocoEngine().simulate(Problem(faller(), 1.0)).q.max() > 1.5


@with_points
def test_both_laws_agree_up_to_the_launch(name: str) -> None:
    problem = reference(name).problem.model_copy(update={"stop_law": StopLaw.UNILATERAL})
    always = MujocoEngine().simulate(problem)
    assert misplaced(always, reference(name)) <= SOFT
    assert always.release_times == pytest.approx(run(name).release_times, abs=1e-8)


# --- The traps
# --------------------------------------------------------------------------------------------------


def test_mujoco_leaves_the_turning_of_a_contact_out() -> None:
    """Not put in, the slot's point stands off by (dJ/dt) u / k at every instant, with k = 1 /
    h^2."""
    mechanism, step = slider_crank(), 1e-3
    problem, equations = Problem(mechanism, 0.9), Equations(mechanism)
    loose = MujocoEngine(timestep=step, moving_points=False).simulate(problem)
    held = MujocoEngine(timestep=step).simulate(problem)
    for i in (300, 500, 700, 850):
        q, u = loose.q[i], loose.u[i]
        later, earlier = (
            equations.constraint_jacobian(q + sign * 1e-6 * u, ()) for sign in (1, -1)
        )
        turning = float(((later - earlier) / 2e-6 @ u)[0])
        # A spring's answer, with what it lags behind: the term changes by some per cent in the
        # steps it takes.
        assert equations.loop_residual(q)[0] == pytest.approx(turning * step**2, rel=0.1)
        assert abs(equations.loop_residual(held.q[i])[0]) < 1e-3 * abs(turning) * step**2


def test_without_that_the_trough_is_left_at_once() -> None:
    exact = reference("hinged")
    released = exact.release_times["trough"]
    left = (
        MujocoEngine(moving_points=False, preload=False)
        .simulate(exact.problem)
        .release_time("trough")
    )
    assert left is not None and released is not None and left < 0.1 * released
    # Pressed in, it stays: its force then lacks a part that no smaller step brings back.
    for step in (1e-3, 2.5e-4):
        late = (
            MujocoEngine(timestep=step, moving_points=False)
            .simulate(exact.problem)
            .release_time("trough")
        )
        assert late is not None and 1e-3 < released - late < 0.1


@machines
def test_forces_are_right_from_the_start(name: str) -> None:
    found, exact = run(name), reference(name).trajectory(np.zeros(1))
    assert found.stop_torques.keys() == exact.stop_torques.keys()
    assert found.joint_reactions.keys() == exact.joint_reactions.keys() != set()
    for stop, force in found.stop_torques.items():
        assert force[0] == pytest.approx(exact.stop_torque(stop)[0], rel=1e-9)
    largest = max(float(np.abs(force).max()) for force in exact.joint_reactions.values())
    for joint, force in found.joint_reactions.items():
        assert force[0] == pytest.approx(exact.joint_reaction(joint)[0], abs=1e-9 * largest)


def test_the_callback_is_given_back() -> None:
    from trebucheck.engines.mujoco.build import correction_of, load

    def mine(*_: object) -> None: ...

    options = MujocoEngine()
    correction = correction_of(hinged(), load(hinged(), options), options)
    mujoco.set_mjcb_control(mine)
    try:
        with correction.applied():
            assert mujoco.get_mjcb_control() is not mine
        assert mujoco.get_mjcb_control() is mine
    finally:
        mujoco.set_mjcb_control(None)
    MujocoEngine().simulate(Problem(hinged(), 0.01))
    assert mujoco.get_mjcb_control() is None


def test_threads_do_not_meet_in_the_callback() -> None:
    problems = [Problem(build(), 0.1) for build in (hinged, floating_arm, hinged)]
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(MujocoEngine().simulate, problems))
    for problem, found in zip(problems, together, strict=True):
        assert np.array_equal(found.q, MujocoEngine().simulate(problem).q)
    assert mujoco.get_mju_user_warning() is None


def test_a_closed_point_must_not_move_at_the_start() -> None:
    moving = hinged().model_copy(update={"start_speeds": (0.3, 0.0, 0.0)})
    with pytest.raises(UnsupportedProblemError, match=r"trough.*m/s"):
        MujocoEngine().simulate(Problem(moving, 0.1))


def test_a_stop_on_the_ground_holds_nothing() -> None:
    still = PointStop(
        name="still", body=GROUND, point=(0, 1), normal=(0, 1), offset=0.0, closed=False
    )
    with pytest.raises(UnsupportedProblemError, match="still"):
        MujocoEngine().simulate(Problem(faller().model_copy(update={"stops": (still,)}), 0.1))
