"""PyBullet by itself: its own defaults, what its elements do, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pybullet
import pytest
import trebucheck as tb
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.library.registry import benchmark
from trebucheck_pybullet.alone import BULLETS, OF_LINKS, Alone
from trebucheck_pybullet.build import Client
from trebucheck_pybullet.engine import PyBulletEngine

ROD = """
<robot name="rod">
  <link name="ground"><inertial><mass value="0"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="rod">
    <inertial>
      <origin xyz="0.5 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.2" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="pin" type="revolute">
    <parent link="ground"/>
    <child link="rod"/>
    <axis xyz="0 0 -1"/>
    <limit lower="-0.1" upper="1" effort="0" velocity="0"/>
  </joint>
</robot>
"""


def _engine(preset: str, **options: Any) -> PyBulletEngine:
    return PyBulletEngine.presets()[preset](**options)


def _motion(tmp_path: Any, speed: float | None, **changes: dict[str, float]) -> list[float]:
    """Angles of a rod on a pin: spinning without limits, or driven into its limit by gravity."""
    limited = speed is None
    client: Any = Client()
    client.setPhysicsEngineParameter(**changes.get("engine", {}), enableFileCaching=0)
    client.setGravity(0, 9.81 * limited, 0)
    path = tmp_path / "rod.urdf"
    path.write_text(ROD if limited else ROD.replace("revolute", "continuous"))
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    rod = client.loadURDF(str(path), useFixedBase=True, flags=flags)
    client.setJointMotorControl2(rod, 0, pybullet.VELOCITY_CONTROL, force=0)
    if "links" in changes:
        client.changeDynamics(rod, 0, **changes["links"])
    client.resetJointState(rod, 0, 0.5, speed or 0.0)
    angles: list[float] = []
    for _ in range(120):
        client.stepSimulation()
        angles.append(client.getJointState(rod, 0)[0])
    return angles


def test_the_defaults_are_bullets_own(tmp_path: Any) -> None:
    default, client = _engine(DEFAULT), Client()
    parameters = client.getPhysicsEngineParameters()
    assert default.timestep == parameters["fixedTimeStep"]
    assert default.solver_iterations == parameters["numSolverIterations"]
    for option, value in BULLETS.items():
        assert getattr(default, option) == value
    # Bullet does not tell the others: with them set the motion is that without.
    threshold = {"solverResidualThreshold": BULLETS["solver_threshold"]}
    assert _motion(tmp_path, None, engine=threshold) == _motion(tmp_path, None)
    # Of links it has them in single precision where nothing is set: 1e-7 of some radians.
    single = 1e-6
    cases = {"linear_damping": 3.0, "angular_damping": 3.0, "max_joint_velocity": 200.0}
    for option, speed in cases.items():
        name, value = OF_LINKS[option], BULLETS[option]
        spinning = np.array(_motion(tmp_path, speed))
        again = _motion(tmp_path, speed, links={name: value})
        assert np.abs(again - spinning).max() < single
        other = _motion(tmp_path, speed, links={name: 2 * value})
        assert np.abs(other - spinning).max() > 100 * single


@pytest.mark.parametrize(("preset", "most"), [(DEFAULT, 0), (SETTINGS, 5)])
def test_only_what_differs_from_bullets_is_set(preset: str, most: int) -> None:
    program = _engine(preset).script(tb.Problem(tb.fixed(), duration=0.1))
    calls = ("setPhysicsEngineParameter", "changeDynamics")
    assert all((call in program) == bool(most) for call in calls)
    for word in ("numSolverIterations", "solverResidualThreshold", "linearDamping"):
        assert (word in program) == bool(most)


def test_a_motion_is_no_other_where_forces_are_read() -> None:
    """Joint sensors are on in a row, and not in a program."""
    problem, engine = tb.Problem(tb.fixed(), duration=0.5), _engine(SETTINGS)
    alone, angles = Alone(problem.mechanism, engine), list[Any]()
    row = engine.simulate(problem)
    for _ in row.t:
        angles.append(alone.state()[0])
        alone.step()
    assert np.array_equal(alone.to.mechanism_positions(np.array(angles)), row.q)


def test_forces_of_loops_are_those_of_the_reference() -> None:
    problem = benchmark("n-four-bar").problem().model_copy(update={"duration": 0.5})
    found = _engine(SETTINGS).simulate(problem)
    truth = tb.solve(problem).trajectory(found.t).joint_reactions["right 1"]
    # First order: a step of 1 ms at up to 30 N/s.
    assert np.abs(found.joint_reactions["right 1"] - truth).max() < 3e-2


def test_limits_hold_and_release_by_themselves() -> None:
    problem = tb.Problem(tb.fixed(), duration=1.6)
    found = _engine(SETTINGS).simulate(problem)
    truth = tb.solve(problem).trajectory(found.t)
    for name, time in truth.release_times.items():
        released = found.release_times[name]
        assert (released is None) == (time is None)
        assert released is None or time is None or abs(released - time) <= 2e-3
        scale = np.abs(truth.stop_torques[name]).max()
        assert np.abs(found.stop_torques[name] - truth.stop_torques[name]).max() <= 1e-2 * scale


@pytest.mark.parametrize("problem", ["bouncing", "stopped-pendulum"])
def test_what_is_not_built_is_said_of_the_adapter(problem: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(DEFAULT).simulate(benchmark(problem).problem())
