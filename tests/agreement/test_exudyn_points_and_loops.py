"""Exudyn's stops on points, its loops of joints, and the unilateral law.

Closed forms, bars, order, faults.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from conftest import again
from mechanisms import G, floor, four_bar, hanging_bob, pin, position_error, rods_on_a_slot
from scipy.integrate import quad
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.elements import GROUND, PinJoint, PointStop, SlotJoint, Stop
from trebucheck.models.errors import InputError, SimulationError, UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.trebuchet import (
    ARM_STOP,
    CatapultParameters,
    FloatingArmParameters,
    HingedParameters,
    catapult,
    fixed,
    floating_arm,
    hinged,
)
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve, solve_to_launch

pytest.importorskip("exudyn")

EXACT = 1e-10  # relative; the bar where an engine exposes a quantity
MACHINES = {"catapult": catapult(), "hinged": hinged(), "floating-arm": floating_arm()}


@functools.cache
def reference(name: str) -> Solution:
    """Reference motion of one of the machines up to its launch, and the step in which that
    falls."""
    launch = solve_to_launch(MACHINES[name]).launch
    assert launch is not None
    return solve(Problem(MACHINES[name], launch.time + 1e-4))


def forces_off(run: Trajectory, exact: Solution) -> float:
    """Largest difference of a stop's force from the reference's, where both or neither hold."""
    there = exact.trajectory(run.t)
    worst = 0.0
    for stop in run.mechanism.stops:
        mine, theirs = (
            math.inf if time is None else time for time in _releases(run, exact, stop.name)
        )
        same = (run.t < min(mine, theirs)) | (run.t >= max(mine, theirs))
        worst = max(
            worst, np.abs(run.stop_torque(stop.name) - there.stop_torque(stop.name))[same].max()
        )
    return float(worst)


def _releases(run: Trajectory, exact: Solution, stop: str) -> tuple[float | None, float | None]:
    return run.release_time(stop), exact.release_times[stop]


@pytest.mark.parametrize("name", MACHINES)
def test_tuned_at_its_own_step_stays_within_the_bars(name: str) -> None:
    exact = reference(name)
    run = ExudynEngine().simulate(exact.problem)
    there = exact.trajectory(run.t)
    for marker in run.mechanism.markers:
        assert position_error(run, exact, marker.name) <= 1e-5
    for stop, time in exact.release_times.items():
        assert run.release_time(stop) == pytest.approx(time, abs=1e-7)
    assert (
        forces_off(run, exact) <= 1e-3
    )  # of a projectile's weight of 589 N, second order in the step
    assert (
        np.abs(run.total_energy - there.total_energy[0]).max() <= 1e-6 * there.kinetic_energy.max()
    )
    for joint, force in run.joint_reactions.items():
        scale = np.abs(there.joint_reactions[joint]).max()
        # One Newton iteration fewer in one step leaves newton_relative / h^2 of alternating error
        # in a multiplier.
        assert np.abs(force - there.joint_reactions[joint]).max() <= 1e-12 / run.t[1] ** 2 * scale


@pytest.mark.parametrize("name", MACHINES)
def test_the_order_is_two(name: str) -> None:
    exact = reference(name)
    steps = np.array([4e-3, 2e-3, 1e-3])
    runs = [ExudynEngine(timestep=step).simulate(exact.problem) for step in steps]
    assert len(MACHINES[name].markers) > 0
    for marker in MACHINES[name].markers:
        errors = [position_error(run, exact, marker.name) for run in runs]
        assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("name", MACHINES)
def test_the_built_machine_is_the_described_one(name: str) -> None:
    for stiffness in (None, 1e8):
        found = check_model(ExudynEngine(stop_stiffness=stiffness), MACHINES[name])
        assert found.exposed
        assert found.checks
        assert all(check.value is not None and check.value <= EXACT for check in found.checks)


OTHERS: dict[str, Mechanism] = {
    "catapult": catapult(CatapultParameters(l1=7, l2=3, m_b=200, m_cw=2000, m_a=300, theta0=2.1)),
    "hinged": hinged(
        HingedParameters(l1=8, l2=3, r=5, h=2.5, m_b=120, m_cw=4000, m_a=500, theta0=2.2, phi0=0.1)
    ),
    "floating arm": floating_arm(
        FloatingArmParameters(l1=8, l2=3, r=5, m_b=120, m_cw=4000, m_a=500, phi0=-0.1)
    ),
}


@pytest.mark.parametrize("law", StopLaw)
@pytest.mark.parametrize("name", OTHERS)
def test_other_machines_are_of_order_two_under_both_laws(name: str, law: StopLaw) -> None:
    exact = solve(Problem(OTHERS[name], 1.5, stop_law=law))
    assert check_model(ExudynEngine(), OTHERS[name]).holds
    errors = [
        position_error(ExudynEngine(timestep=step).simulate(exact.problem), exact)
        for step in (2e-3, 1e-3)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


# A ladder slides down a smooth wall: with s = sin of its slope, s' s' = 3 g (s0 - s) / l, and it
# leaves at s = 2/3 s0.
LADDER, MASS, SLOPE = 3.0, 20.0, 1.1


def ladder() -> Mechanism:
    """A uniform ladder whose foot slides on the floor (a slot), its top held back by a wall that
    can only push.
    """
    angle = SLOPE - math.pi  # up and to the left
    return Mechanism(
        name="ladder",
        bodies=(
            Body(
                name="ladder",
                angle="a",
                mass=MASS,
                centre=(LADDER / 2, 0),
                inertia=MASS * LADDER**2 / 12,
            ),
        ),
        joints=(
            SlotJoint(
                name="floor",
                child="ladder",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(1, 0),
                coordinate="x",
            ),
        ),
        stops=(
            PointStop(
                name="wall", body="ladder", point=(LADDER, 0), normal=(1, 0), offset=0, closed=True
            ),
        ),
        markers=(Marker(name="top", body="ladder", point=(LADDER, 0)),),
        gravity=G,
        start=(angle, LADDER * math.cos(SLOPE)),
    )


def test_a_ladder_leaves_its_wall_at_two_thirds_of_its_height() -> None:
    end = math.asin(2 / 3 * math.sin(SLOPE))

    def pace(root: float) -> float:
        """Time over the root of the angle fallen through.

        Without the singularity of a start at rest.
        """
        fallen = math.sin(SLOPE) - math.sin(SLOPE - root**2)
        return (
            2 * root / math.sqrt(3 * G / LADDER * fallen)
            if root
            else 2 / math.sqrt(3 * G / LADDER * math.cos(SLOPE))
        )

    time = quad(pace, 0, math.sqrt(SLOPE - end), epsabs=1e-13)[0]
    off: list[list[float]] = []
    for step in (2e-3, 1e-3):
        run = ExudynEngine(timestep=step).simulate(Problem(ladder(), 1.5))
        found, slope = run.release_time("wall"), run.q[:, 0] + math.pi
        assert found is not None
        push = 0.75 * MASS * G * np.cos(slope) * (3 * np.sin(slope) - 2 * math.sin(SLOPE))
        held = run.t < found
        assert not run.stop_torque("wall")[~held].any()
        off.append([abs(found - time), np.abs(run.stop_torque("wall") - push)[held].max()])
    assert off[1][0] <= 1e-6
    assert np.divide(*off) == pytest.approx(4.0, rel=0.15)


Wall = tuple[str, tuple[float, float], float]
"""Body, its point, and how far the wall's normal is turned from upwards [rad]."""


def walled(mechanism: Mechanism, walls: dict[str, Wall]) -> Mechanism:
    """The machine with walls that touch points of its bodies at the start."""
    kinematics, q = Kinematics(mechanism), np.array(mechanism.start)
    stops: list[Stop | PointStop] = list(mechanism.stops)
    for name, (body, point, tilt) in walls.items():
        normal = (math.sin(tilt), math.cos(tilt))
        offset = float(kinematics.position(kinematics.point(body, point), q) @ np.array(normal))
        stops.append(
            PointStop(name=name, body=body, point=point, normal=normal, offset=offset, closed=True)
        )
    return Mechanism(**(dict(mechanism) | {"stops": tuple(stops)}))


RODS: dict[str, Any] = {"inertia": 0.2, "tip": (0.8, 0.3)}


def rods(start: tuple[float, float, float] = (0.5, -0.4, 0.6)) -> Mechanism:
    """Two rods, the first one on a tilted slot and with a limit on its angle."""
    limit = Stop(name="limit", body="upper", sense=-1, limit=-start[0], closed=True)
    return rods_on_a_slot(limit, start=start, **RODS)


def four_bar_on_a_wall() -> Mechanism:
    """A loop of four pins, and a rod that hangs on its coupler with its end on a tilted wall."""
    rod = Body(name="rod", angle="d", mass=0.8, centre=(0.5, 0), inertia=0.1)
    hung = (pin("E", "coupler", "rod", (1.2, -0.1)),)
    plain = four_bar(
        rod, start=(2.2,), hung=hung, markers=(Marker(name="end", body="rod", point=(1, 0)),)
    )
    return walled(plain, {"wall": ("rod", (1, 0), -1.2)})


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(k, marks=again) for k in range(3, 8))])
def test_limits_and_walls_are_decided_at_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-3, 3, 2)
    tilts = rng.uniform(-math.pi, math.pi, 2)
    walls = {"one": ("upper", (0.7, -0.4), tilts[0]), "two": ("lower", (0.8, 0.3), tilts[1])}
    problem = Problem(walled(rods(start=(a, b, 0.6)), walls), 0.01)
    run, exact = ExudynEngine(timestep=1e-3).simulate(problem), solve(problem)
    assert run.release_times == exact.release_times
    start = exact.trajectory(np.zeros(1))
    for name in run.release_times:
        assert run.stop_torque(name)[0] == pytest.approx(
            start.stop_torque(name)[0], rel=1e-8, abs=1e-8
        )
    for name, force in run.joint_reactions.items():
        assert force[0] == pytest.approx(start.joint_reactions[name][0], rel=1e-8, abs=1e-8)
    assert check_model(ExudynEngine(), problem.mechanism).holds


def on_the_move() -> Mechanism:
    """The rods with speeds that keep the wall touched."""
    machine = walled(
        rods_on_a_slot(start=(0.5, -0.4, 0.6), **RODS), {"wall": ("lower", (0.8, 0.3), 0.4)}
    )
    gradient = Kinematics(machine).gap_jacobian("wall", np.array(machine.start))
    wanted = np.array([1.0, -2.0, 0.3])
    speeds = wanted - gradient * (gradient @ wanted) / (gradient @ gradient)
    return Mechanism(**(dict(machine) | {"start_speeds": tuple(speeds.tolist())}))


WALLED = {
    "a limit and a wall": (walled(rods(), {"wall": ("lower", (0.8, 0.3), -0.4)}), 0.8),
    "on the move": (on_the_move(), 0.3),
    "a loop of pins": (four_bar_on_a_wall(), 1.0),
}


@pytest.mark.parametrize("name", WALLED)
def test_walls_of_any_tilt_and_loops_are_of_order_two(name: str) -> None:
    mechanism, duration = WALLED[name]
    exact = solve(Problem(mechanism, duration))
    off: list[list[float]] = []
    for step in (2e-3, 1e-3):
        run = ExudynEngine(timestep=step).simulate(exact.problem)
        there = exact.trajectory(run.t)
        early = run.t <= 0.1  # before any stop lets go
        reactions = [
            np.abs(run.joint_reactions[n] - there.joint_reactions[n])[early].max()
            for n in run.joint_reactions
        ]
        off.append(
            [
                position_error(run, exact, mechanism.markers[0].name),
                forces_off(run, exact),
                *reactions,
            ]
        )
        for stop, time in exact.release_times.items():
            assert run.release_time(stop) == (
                None if time is None else pytest.approx(time, abs=0.1 * step)
            )
    assert np.divide(*off) == pytest.approx(4.0, rel=0.2)
    assert check_model(ExudynEngine(), mechanism).holds


# Under the unilateral law.


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_a_bob_falls_on_a_floor(e: float) -> None:
    """It arrives with sqrt(2 g depth) along its circle; a rebound reaches e^2 of the height."""
    depth, step = 1.2, 5e-4
    run = ExudynEngine(timestep=step).simulate(
        Problem(hanging_bob(floor(1.2, e)), 1.5, stop_law=StopLaw.UNILATERAL)
    )
    time, impulses = run.impacts[0]
    along = math.sqrt(1 - (depth / 2) ** 2)
    assert impulses["floor"] == pytest.approx(
        (1 + e) * 3 * math.sqrt(2 * G * depth) / along, rel=4 * step**2
    )
    row = int(np.flatnonzero(run.t == time)[0])
    energies = (
        run.kinetic_energy[[row, row - 1]] + run.potential_energy[[row, row - 1]] + 3 * G * depth
    )
    assert energies[0] == pytest.approx(e**2 * energies[1], abs=1e-6 * energies[1])
    assert (
        run.stop_gap("floor").min() >= -10 * step**2
    )  # index 2 holds the gap's speed: its place drifts at order two
    if e == 0:
        assert run.stop_torque("floor")[-1] == pytest.approx(3 * G, rel=1e-6)  # it lies still


def test_rebounds_that_follow_each_other_ever_faster_come_to_rest() -> None:
    """Each impact in its place, and then the weight on the floor."""
    problem = Problem(hanging_bob(floor(1.2, 0.5)), 3.0, stop_law=StopLaw.UNILATERAL)
    run, exact = ExudynEngine(timestep=1e-3).simulate(problem), solve(problem)
    assert (
        abs(len(run.impacts) - len(exact.impacts)) <= 3
    )  # of which the last are of micrometres per second
    for (mine, _), (theirs, _) in zip(run.impacts[:10], exact.impacts[:10], strict=True):
        assert mine == pytest.approx(theirs, abs=10 * 1e-6)  # order two at h = 1e-3
    assert run.stop_torque("floor")[-1] == pytest.approx(3 * G, rel=1e-6)


def hopper() -> Mechanism:
    """A carriage on an upright track stands on the ground.

    A pendulum whirls on it and lifts it off.
    """
    return Mechanism(
        name="hopper",
        bodies=(
            Body(name="carriage", angle="c", mass=1, centre=(0, 0), inertia=0.1),
            Body(name="pendulum", angle="b", mass=1, centre=(1, 0), inertia=0.05),
        ),
        joints=(
            SlotJoint(
                name="track",
                child="carriage",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(0, 1),
                coordinate="y",
            ),
            PinJoint(
                name="pin",
                parent="carriage",
                child="pendulum",
                parent_point=(0, 0),
                child_point=(0, 0),
            ),
        ),
        stops=(
            PointStop(
                name="floor",
                body="carriage",
                point=(0, 0),
                normal=(0, 1),
                offset=0,
                closed=True,
                restitution=0.4,
            ),
        ),
        markers=(Marker(name="end", body="pendulum", point=(1, 0)),),
        gravity=G,
        start=(0, math.pi / 2, 0),
        start_speeds=(0, 8.0, 0),
    )


def test_what_lifts_off_falls_back_and_stands_again() -> None:
    problem = Problem(hopper(), 1.25, stop_law=StopLaw.UNILATERAL)
    exact = solve(problem)
    assert len(exact.impacts) >= 2
    off: list[list[float]] = []
    for step in (1e-3, 5e-4):
        run = ExudynEngine(timestep=step).simulate(problem)
        assert len(run.impacts) == len(exact.impacts)
        pairs = list(zip(run.impacts, exact.impacts, strict=True))
        times = [abs(mine - theirs) for (mine, _), (theirs, _) in pairs]
        impulses = [abs(mine["floor"] - theirs["floor"]) for (_, mine), (_, theirs) in pairs]
        released = abs(
            (run.release_time("floor") or math.nan) - (exact.release_times["floor"] or math.nan)
        )
        off.append([*times, *impulses, released, position_error(run, exact, "end")])
    assert np.divide(*off) == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize("preset", [ExudynEngine, partial(ExudynEngine, locate_releases=False)])
def test_the_arm_meets_its_stop(preset: Callable[..., ExudynEngine]) -> None:
    """After the launch: a limit open at the start is met, releases located or not."""
    problem = Problem(fixed(), 3.2, stop_law=StopLaw.UNILATERAL)
    run, exact = preset(timestep=1e-3).simulate(problem), solve(problem)
    ((mine, impulses),), ((theirs, exact_impulses),) = run.impacts, exact.impacts
    assert mine == pytest.approx(theirs, abs=1e-3)  # its rests go up to a step late
    assert impulses[ARM_STOP] == pytest.approx(exact_impulses[ARM_STOP], rel=1e-2)
    assert run.stop_torque(ARM_STOP)[-1] == pytest.approx(
        exact.trajectory(run.t[-1:]).stop_torque(ARM_STOP)[0], rel=1e-2
    )
    assert not run.stop_torque(ARM_STOP)[run.t < mine].any()


# Springs.


@pytest.mark.parametrize("name", ["hinged", "floating-arm"])
def test_a_wall_as_a_spring_is_off_by_its_softness(name: str) -> None:
    """A preloaded spring lets go at a gap of force / stiffness, so the error's exponent is -1."""
    exact, step = reference(name), 5e-4
    soft, stiff = (
        ExudynEngine(timestep=step, stop_stiffness=stiffness).simulate(exact.problem)
        for stiffness in (1e5, 1e7)
    )
    there = exact.trajectory(soft.t)
    assert math.log10(
        position_error(soft, exact) / position_error(stiff, exact)
    ) / 2 == pytest.approx(1.0, abs=0.1)
    assert soft.stop_torque("trough")[0] == pytest.approx(there.stop_torque("trough")[0], rel=1e-9)


def test_what_cannot_be_is_refused() -> None:
    sliding = Mechanism(
        **(
            dict(walled(rods(), {"wall": ("lower", (0.8, 0.3), 0.4)}))
            | {"start_speeds": (0, 0, 1.0)}
        )
    )
    with pytest.raises(
        UnsupportedProblemError, match=r"'wall' closed while its gap changes at 0\.\d+ m/s"
    ):
        ExudynEngine().simulate(Problem(sliding, 0.1))
    with pytest.raises(UnsupportedProblemError, match=r"'wall': a stop on a point of the ground"):
        ExudynEngine().simulate(Problem(walled(rods(), {"wall": (GROUND, (0.8, 0.3), 0.4)}), 0.1))
    with pytest.raises(
        InputError, match=r"^stop_stiffness = 1e\+08 must be left out under the unilateral law"
    ):
        ExudynEngine(stop_stiffness=1e8).simulate(
            Problem(hinged(), 0.1, stop_law=StopLaw.UNILATERAL)
        )
    with pytest.raises(
        InputError, match=r"^stop_stiffness = 1e\+18 N/m would turn the rounding of a point's place"
    ):
        ExudynEngine(stop_stiffness=1e18).simulate(Problem(hinged(), 0.1))


def test_impacts_without_end_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines import events as module

    monkeypatch.setattr(module, "MOST_IMPACTS", 3)
    problem = Problem(hanging_bob(floor(1.2, 1.0)), 4.0, stop_law=StopLaw.UNILATERAL)
    with pytest.raises(
        SimulationError, match=r"^exudyn gave up at t = .* s: 3 impacts, and no end\.$"
    ):
        ExudynEngine(timestep=1e-2).simulate(problem)


# Faults.


def _item(system: Any, parameter: str, value: object) -> None:
    system.main.SetObjectParameter(system.stops["trough"], parameter, value)


def _marker(system: Any, which: int, place: list[float]) -> None:
    marker = system.main.GetObject(system.stops["trough"])["markerNumbers"][which]
    system.main.SetMarkerParameter(marker, "localPosition", place)


FAULTS: dict[str, Callable[[Any], None]] = {
    "where the wall is": lambda system: _marker(
        system, 1, [0.0, system.mechanism.stop("trough").offset + 1e-3, 0.0]
    ),
    "the wall's tilt": lambda system: _item(
        system, "normalMarker1", [math.sin(1e-3), math.cos(1e-3), 0.0]
    ),
    "the point on the wall": lambda system: _marker(system, 0, [-1e-3, 0.0, 0.0]),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", ["hinged", "floating-arm"])
def test_a_fault_in_a_wall_shows(name: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.exudyn import inspect as module

    rightly = module.build

    def wrongly(*arguments: Any) -> object:
        system = rightly(*arguments)
        FAULTS[fault](system)
        return system

    monkeypatch.setattr(module, "build", wrongly)
    assert not check_model(ExudynEngine(), MACHINES[name]).holds
