"""What is particular to the MuJoCo engine.

The machine it loads, each trap it avoids, its order, its stops.
"""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanisms import (
    TABLE_ONE,
    chain,
    chain_on_a_slot,
    four_bar,
    position_error,
    rod_pendulum,
    table_one_motion,
)
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.elements import Stop
from trebucheck.models.errors import InputError, SimulationError, UnsupportedProblemError
from trebucheck.models.library.trebuchet import (
    ARM_STOP,
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    TrebuchetParameters,
    fixed,
    rolling,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

mujoco: Any = pytest.importorskip("mujoco")

from trebucheck.engines.mujoco.build import (  # noqa: E402
    _rigid_forces,  # pyright: ignore[reportPrivateUsage]
    correction_of,
    load,
    preload,
    start_data,
    stop_constraints,
)
from trebucheck.engines.mujoco.compat import constraint_jacobian, mass_matrix  # noqa: E402
from trebucheck.engines.mujoco.reference_acceleration import ReferenceAccelerationCorrection  # noqa: E402

RESTS = (HANGER_REST, SLING_REST)
STEPS = np.array([1e-2, 4e-3, 1e-3, 2.5e-4])
machines = pytest.mark.parametrize("name", TABLE_ONE)


@functools.cache
def run(
    name: str, timestep: float = 1e-3, preset: str = "assisted", **options: object
) -> Trajectory:
    """Table I up to the launch."""
    return MujocoEngine.presets()[preset](timestep=timestep, **options).simulate(
        table_one_motion(name).problem
    )


# --- Is it the same machine?
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mechanism", [*TABLE_ONE.values(), chain_on_a_slot()], ids=lambda m: m.name
)
def test_mass_matrix_and_accelerations_at_random_states(mechanism: Mechanism) -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(mechanism))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data = mujoco.MjData(model)
    # Absolute angles from MuJoCo's joints: with one slide it comes first there and last here.
    n, slides = model.nv, len(mechanism.slides)
    hinges = (
        np.tril(np.ones((2, 2)))
        if n - slides == 2
        else np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]])
    )
    sums = np.zeros((n, n))
    sums[: n - slides, slides:], sums[n - slides :, :slides] = hinges, np.eye(slides)
    equations, rng = Equations(mechanism), np.random.default_rng(5)
    for _ in range(20):
        data.qpos, data.qvel = rng.uniform(-3, 3, n), rng.uniform(-3, 3, n)
        mujoco.mj_forward(model, data)
        q, u = np.array(mechanism.start) + sums @ data.qpos, sums @ data.qvel
        mass = np.zeros((n, n))
        for column in np.eye(n):
            mujoco.mj_mulM(model, data, mass[int(np.argmax(column))], column)
        expected = sums.T @ equations.mass_matrix(q) @ sums
        assert mass == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(expected).max())
        accelerations = equations.solve(q, u, ())[0]
        assert sums @ data.qacc == pytest.approx(
            accelerations, rel=1e-9, abs=1e-9 * np.abs(accelerations).max()
        )


@pytest.mark.parametrize("mechanism", [chain(), chain_on_a_slot()], ids=["chain", "slot"])
def test_a_mechanism_off_every_axis(mechanism: Mechanism) -> None:
    problem = Problem(mechanism, 0.5)
    found = MujocoEngine(timestep=1e-3).simulate(problem)
    exact = solve(problem).trajectory(found.t)
    # RK4 without a stop, at a quarter of a millisecond: rounding is what is left.
    assert found.q == pytest.approx(exact.q, abs=1e-10)
    assert found.u == pytest.approx(exact.u, abs=1e-9)
    assert found.total_energy == pytest.approx(exact.total_energy, abs=1e-9)
    for marker in ("tip", "peg"):
        assert found.marker(marker).position == pytest.approx(
            exact.marker(marker).position, abs=1e-10
        )
        assert found.marker(marker).velocity == pytest.approx(
            exact.marker(marker).velocity, abs=1e-9
        )
    for joint in ("hook", "pin"):
        assert found.joint_reaction(joint) == pytest.approx(exact.joint_reaction(joint), abs=1e-7)


# --- Is the motion right?
# ---------------------------------------------------------------------------------------


@machines
def test_tuned_keeps_its_bars_at_a_millisecond(name: str) -> None:
    trajectory, exact = run(name), table_one_motion(name)
    there = exact.trajectory(trajectory.t)
    assert position_error(trajectory, exact) <= 1e-7
    for rest in RESTS:
        released = exact.release_times[rest]
        assert trajectory.release_time(rest) == pytest.approx(released, abs=1e-8)
        start = there.stop_torque(rest)[0]
        assert trajectory.stop_torque(rest) == pytest.approx(
            there.stop_torque(rest), abs=1e-6 * start
        )
    energy = trajectory.total_energy
    assert energy == pytest.approx(energy[0], rel=1e-9)
    assert trajectory.kinetic_energy == pytest.approx(
        there.kinetic_energy, abs=1e-9 * there.kinetic_energy.max()
    )


@machines
def test_tuned_launch_speed(name: str) -> None:
    exact = solve(Problem(TABLE_ONE[name], 2.8))
    launch = run_past_launch(name).launch()
    assert launch is not None and exact.launch is not None
    assert launch.speed == pytest.approx(exact.launch.speed, abs=3e-7)


def run_past_launch(name: str) -> Trajectory:
    return MujocoEngine().simulate(Problem(TABLE_ONE[name], 2.8))


@machines
def test_tuned_is_of_second_order(name: str) -> None:
    """The softness of the stops is scaled with the step, and nothing else is as large."""
    errors = [position_error(run(name, step), table_one_motion(name)) for step in STEPS]
    assert np.polyfit(np.log(STEPS), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


@machines
def test_reactions_are_those_of_the_reference(name: str) -> None:
    trajectory = run(name)
    there = table_one_motion(name).trajectory(trajectory.t)
    assert len(there.joint_reactions) > 0
    for joint, force in there.joint_reactions.items():
        # Forces follow the accelerations: as good as the torques, relative to their own peak.
        assert trajectory.joint_reaction(joint) == pytest.approx(
            force, abs=1e-7 * np.abs(force).max()
        )
    if name == "rolling":
        assert (
            np.abs(trajectory.joint_reaction("fulcrum")[:, 0]).max()
            < 1e-7 * np.abs(there.joint_reactions["fulcrum"]).max()
        )


@machines
def test_default_limits_are_soft_at_any_step(name: str) -> None:
    """Millimetres, and no better at a tenth of the step.

    D = 0.9 to 0.95, not the step, is what costs.
    """
    coarse, fine = (
        position_error(run(name, step, "default", integrator="RK4"), table_one_motion(name))
        for step in (1e-3, 2e-4)
    )
    assert 1e-3 < fine < 1e-2
    assert coarse == pytest.approx(fine, rel=0.02)


# --- The traps
# --------------------------------------------------------------------------------------------------


@machines
def test_torques_are_right_from_the_start(name: str) -> None:
    expected = {
        rest: table_one_motion(name).trajectory(np.zeros(1)).stop_torque(rest)[0] for rest in RESTS
    }
    loose = run(name, preload=False)
    for rest in RESTS:
        assert run(name).stop_torque(rest)[0] == pytest.approx(expected[rest], rel=1e-9)
        # Without the preload the first torque lacks about 1 - d of itself.
        assert 1e-6 < 1 - loose.stop_torque(rest)[0] / expected[rest] < 1e-3


def test_a_margin_of_zero_misses_the_start() -> None:
    """MuJoCo's limits act strictly nearer than the margin.

    The closed stops would be gone at once.
    """
    trajectory = MujocoEngine(margin=0.0).simulate(Problem(fixed(), 0.01))
    assert [trajectory.release_time(rest) for rest in RESTS] == [0.0, 0.0]


@machines
def test_releases_are_located_inside_a_step(name: str) -> None:
    coarse, rough = run(name, 1e-2), run(name, 1e-2, locate_releases=False)
    for rest in RESTS:
        exact = table_one_motion(name).release_times[rest]
        assert exact is not None
        assert coarse.release_time(rest) == pytest.approx(exact, abs=1e-7)  # 1e-5 of the step
        assert coarse.release_time(rest) in coarse.t
        late = rough.release_time(rest)
        assert (
            late is not None
            and 0 <= late - exact < 1e-2
            and late / 1e-2 == pytest.approx(round(late / 1e-2))
        )


@machines
def test_torques_are_zero_from_the_release_on(name: str) -> None:
    trajectory = run(name)
    for rest in RESTS:
        released = trajectory.release_time(rest)
        assert released is not None
        assert (trajectory.stop_torque(rest)[trajectory.t < released] > 0).all()
        assert (trajectory.stop_torque(rest)[trajectory.t >= released] == 0).all()


@pytest.mark.parametrize(
    ("machine", "gone"),
    [
        (fixed(TrebuchetParameters(l1=13.0, l2=1.0)), HANGER_REST),
        (rolling(TrebuchetParameters(m_cw=10.0)), HANGER_REST),
        (rolling(TrebuchetParameters(l1=20.0, l2=1.0)), SLING_REST),
    ],
    ids=["long arm", "light counterweight", "longer arm"],
)
def test_a_rest_that_would_have_to_pull_is_gone_at_the_start(machine: Mechanism, gone: str) -> None:
    problem = Problem(machine, 0.5)
    trajectory, exact = MujocoEngine().simulate(problem), solve(problem)
    assert trajectory.release_time(gone) == exact.release_times[gone] == 0.0
    assert (trajectory.stop_torque(gone) == 0).all()
    # The other's torque is that of the other alone, from the first sample on.
    other = next(rest for rest in RESTS if rest != gone)
    expected = exact.trajectory(trajectory.t).stop_torque(other)
    assert trajectory.release_time(other) is None
    assert trajectory.stop_torque(other) == pytest.approx(expected, abs=1e-5 * expected[0])


def test_samples_end_at_the_duration() -> None:
    for duration in (0.05, 0.0503, 0.1 + 0.2):
        t = MujocoEngine().simulate(Problem(fixed(), duration)).t
        assert t[0] == 0.0 and t[-1] == duration and (np.diff(t) > 1e-5).all()


def test_a_divergence_is_told_and_leaves_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SimulationError, match="MuJoCo gave up"):
        MujocoEngine(timestep=0.5, solref=(-1e9, -1e9)).simulate(Problem(fixed(), 50.0))
    assert list(tmp_path.iterdir()) == []
    assert mujoco.get_mju_user_warning() is None


def test_its_description_needs_no_mujoco() -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from trebucheck.engines.mujoco.engine import MujocoEngine\n"
        "MujocoEngine.presets()['default'](), MujocoEngine.version(), MujocoEngine.capabilities"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "leapfrog"},
        {"solref": (1.0,)},
        {"solimp": (0.9, 2.0, 0.1, 0.5, 2.0)},
        {"margin": -1e-9},
    ],
)
def test_wrong_options_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        MujocoEngine(**options)


# --- Stops of every kind
# -----------------------------------------------------------------------------------------


def test_a_stop_on_the_ground_two_bodies_away() -> None:
    """A limit on a tendon: the lower body rests on the ground's angle while the upper one
    swings."""
    level = Stop(name="level", body="lower", sense=1, limit=0.2, closed=True)
    problem = Problem(chain(level, start_speeds=()), 0.4)
    found, exact = MujocoEngine().simulate(problem), solve(problem)
    there = exact.trajectory(found.t)
    assert there.stop_torque("level")[0] > 0
    assert found.release_time("level") == pytest.approx(exact.release_times["level"], abs=1e-7)
    assert found.stop_torque("level") == pytest.approx(
        there.stop_torque("level"), abs=1e-6 * there.stop_torque("level")[0]
    )
    assert found.q == pytest.approx(there.q, abs=1e-7)


def test_unilateral_comes_to_rest_on_a_stop() -> None:
    """Two stops at the two ends of one joint.

    The one that is met carries the weight, the other nothing.
    """
    met = Stop(name="met", body="rod", sense=-1, limit=-1.0, closed=False)
    left = Stop(name="left", body="rod", sense=1, limit=0.0, closed=True)
    problem = Problem(rod_pendulum(met, left), 2.0, stop_law=StopLaw.UNILATERAL)
    found = MujocoEngine().simulate(problem)
    exact = ReferenceEngine().simulate(problem)
    assert found.release_times == {"met": None, "left": 0.0} == exact.release_times
    assert found.q[-1] == pytest.approx(exact.q[-1], abs=1e-7)
    assert found.stop_torque("met")[-1] == pytest.approx(2 * 9.81 * np.cos(1.0), rel=1e-6)
    assert (found.stop_torque("left") == 0).all()


def test_stock_refuses_a_stop_that_rebounds_and_does_not_soften_it() -> None:
    met = Stop(name="met", body="rod", sense=-1, limit=-1.0, closed=False, restitution=0.5)
    problem = Problem(rod_pendulum(met), 1.0, stop_law=StopLaw.UNILATERAL)
    for engine in (MujocoEngine.presets()["default"](), MujocoEngine(keep_limits=True)):
        with pytest.raises(
            UnsupportedProblemError, match=r"mujoco with these options .* restitution \('met'\)"
        ):
            engine.simulate(problem)
    # Under the release-once law it never acts, and its restitution does not matter.
    assert MujocoEngine().simulate(Problem(rod_pendulum(met), 1.0)).q.max() > 2.0


def test_under_release_once_an_open_stop_never_acts() -> None:
    met = Stop(name="met", body="rod", sense=-1, limit=-1.0, closed=False)
    once = Problem(rod_pendulum(met), 1.0)
    assert MujocoEngine().simulate(once).q.max() > 2.0
    # Stock leaves the limits in, and says so.
    assert MujocoEngine.presets()["default"]().simulate(once).q.max() < 1.1


@machines
def test_both_laws_agree_up_to_the_launch(name: str) -> None:
    problem = Problem(TABLE_ONE[name], 2.5, stop_law=StopLaw.UNILATERAL)
    once, always = (MujocoEngine().simulate(p) for p in (Problem(TABLE_ONE[name], 2.5), problem))
    assert always.release_times == pytest.approx(once.release_times, abs=1e-8)
    assert always.release_time(ARM_STOP) is None
    assert always.marker(PROJECTILE).position[-1] == pytest.approx(
        once.marker(PROJECTILE).position[-1], abs=1e-7
    )


def test_a_closed_stop_must_not_move_at_the_start() -> None:
    level = Stop(name="level", body="lower", sense=1, limit=0.2, closed=True)
    with pytest.raises(UnsupportedProblemError, match="level"):
        MujocoEngine().simulate(Problem(chain(level), 0.1))


# --- Softness
# -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("solref", "there"),
    [
        ((0.02, 1.0), (0.005, 1.0)),  # time constant and damping ratio
        ((-400.0, -30.0), (-6400.0, -120.0)),  # stiffness [1/s^2] and damping [1/s]
        (None, None),
    ],
)
def test_the_stiffness_of_limits_is_the_same_in_another_unit_of_time(
    solref: tuple[float, float] | None, there: tuple[float, float] | None
) -> None:
    assert MujocoEngine(timestep=2e-3, solref=solref).in_time_unit(4.0).solref == there


@pytest.mark.parametrize(
    "mechanism", [*TABLE_ONE.values(), four_bar()], ids=lambda mechanism: mechanism.name
)
@pytest.mark.parametrize("given", [0.0, 1e-5])
def test_forces_of_rigid_rows_make_up_for_all_that_softness_took(
    mechanism: Mechanism, given: float
) -> None:
    """A f = c follows from (A + R) f = c + e, of limits that push and of equalities of any sign."""
    model = load(mechanism, MujocoEngine())
    data, correction = start_data(model), correction_of(mechanism, model, MujocoEngine())
    with correction.applied():
        correction.forward(data)
    soft, softness = np.array(data.efc_force), np.array(data.efc_R)
    jacobian = constraint_jacobian(model, data)
    response = jacobian @ np.linalg.solve(mass_matrix(model, data), jacobian.T)
    limits = [] if mechanism.loop_joints else list(range(len(soft)))
    taken = softness * soft - given
    rigid = _rigid_forces(model, data, limits, None if not given else np.full(len(soft), given))
    moving = np.diag(response) > 0.0  # a pin's third row is across the plane
    assert (response @ (rigid - soft))[moving] == pytest.approx(taken[moving], rel=1e-8)
    assert (soft < 0.0).any() == bool(mechanism.loop_joints)


@pytest.mark.parametrize(
    "mechanism", [*TABLE_ONE.values(), four_bar()], ids=lambda mechanism: mechanism.name
)
def test_a_preload_ends_when_each_round_has_gained_its_digits(
    mechanism: Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six rounds and a look at what they leave."""
    model, rounds = load(mechanism, MujocoEngine()), list[object]()
    data, correction = start_data(model), correction_of(mechanism, model, MujocoEngine())
    forward = type(correction).forward

    def counted(self: ReferenceAccelerationCorrection, data: Any) -> None:
        rounds.append(data)
        forward(self, data)

    monkeypatch.setattr(type(correction), "forward", counted)
    preload(data, stop_constraints(mechanism, model).values(), correction)
    assert len(rounds) == 7
