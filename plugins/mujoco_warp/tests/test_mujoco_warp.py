"""MuJoCo Warp: its own defaults, forces and signs by closed forms, its order and its floor."""

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import pytest
import trebucheck as tb
import warp
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.mujoco.alone import model_text
from trebucheck.engines.mujoco.build import start_data
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.models.library.registry import library_problem
from trebucheck_mujoco_warp.engine import MujocoWarpEngine
from trebucheck_mujoco_warp.world import World

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
ROUNDOFF = 2.0**-24
_EMPTY = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body>
      <joint type="hinge" axis="0 1 0" range="-1 1"/>
      <geom name="ball" size="1"/>
      <site name="a"/>
    </body>
    <site name="b"/>
  </worldbody>
  <contact><pair geom1="floor" geom2="ball"/></contact>
  <equality><connect site1="a" site2="b"/></equality>
</mujoco>
"""
"""A model that sets no option."""


def _engine(preset: str, **options: Any) -> MujocoWarpEngine:
    return MujocoWarpEngine.presets()[preset](**options)


def _problem(name: str, duration: float) -> tb.Problem:
    known = library_problem(name, None)
    assert known is not None
    return known.model_copy(update={"duration": duration})


def test_the_defaults_are_its_own() -> None:
    default = _engine(DEFAULT)
    plain = mujoco.MjModel.from_xml_string(_EMPTY)
    with warp.ScopedDevice("cpu"):
        bare = mujoco_warp.put_model(plain)
    own = {
        "timestep": bare.opt.timestep,
        "tolerance": bare.opt.tolerance,
        "solref": bare.jnt_solref,
        "solimp": bare.jnt_solimp,
        "margin": bare.jnt_margin,
    }
    for name, array in own.items():
        values = np.ravel(array.numpy())
        assert np.array_equal(np.ravel(np.float32(default.settings[name])), values), name
    assert default.iterations == bare.opt.iterations
    assert default.integrator.upper() == mujoco_warp.IntegratorType(bare.opt.integrator).name
    assert default.solver.upper() == mujoco_warp.SolverType(bare.opt.solver).name
    for name in ("fixed", "slider-crank", "spring-pendulum"):
        problem = library_problem(name, None)
        mechanism = tb.model(name) if problem is None else problem.mechanism
        model = mujoco.MjModel.from_xml_string(model_text(mechanism, default.of_mujoco))
        for option in dir(plain.opt):
            value = getattr(plain.opt, option)
            # The least tolerance that `put_model` takes is written as such.
            if option[0] == "_" or callable(value) or option in ("gravity", "tolerance"):
                continue
            assert np.array_equal(getattr(model.opt, option), value), option
        for kind in ("jnt_solref", "jnt_solimp", "pair_solref", "pair_solimp", "eq_solref"):
            for row in getattr(model, kind):
                assert np.array_equal(row, getattr(plain, kind)[0]), kind


# --- Order and floor


def _error(problem: tb.Problem, preset: str, step: float, **options: Any) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = _engine(preset, timestep=step, **options).simulate(problem)
    truth = tb.solve(problem).trajectory(np.minimum(found.t, problem.duration))
    return max(
        float(np.abs(motion.position - truth.markers[name].position).max())
        for name, motion in found.markers.items()
    )


@pytest.mark.parametrize(
    ("preset", "integrator", "step", "order"),
    [
        (DEFAULT, "Euler", 16e-3, 1.0),
        (SETTINGS, "implicitfast", 16e-3, 1.0),
        (SETTINGS, "RK4", 0.2, 4.0),
        (ASSISTED, "RK4", 0.2, 4.0),
    ],
)
def test_the_free_swing_falls_with_the_order(
    preset: str, integrator: str, step: float, order: float
) -> None:
    """Steps have errors far above rounding."""
    coarse, fine = (_error(FREE_SWING, preset, h, integrator=integrator) for h in (step, step / 2))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize("preset", [SETTINGS, ASSISTED])
@pytest.mark.parametrize("step", [4e-3, 1e-3])
def test_its_floor_is_the_rounding_of_single_precision(preset: str, step: float) -> None:
    """A step rounds angles and speeds, which stand for 2 s of way, to 24 bits, 16 m from the axis:
    at random, so that n steps are sqrt(n) times as far off."""
    truth = tb.solve(FREE_SWING).trajectory(np.linspace(0.0, 2.0, 201))
    size = np.abs(truth.q).max() + 2.0 * np.abs(truth.u).max()
    assert _error(FREE_SWING, preset, step) < np.sqrt(2.0 / step) * ROUNDOFF * size * 16


# --- Forces and signs


def _rod(angle: float) -> tb.Problem:
    """A rod of 2 kg and 1 m, pinned at its end, at rest at a clockwise angle."""
    rod = tb.Body(name="rod", mass=2.0, inertia=2.0 / 12, centre=(0.5, 0.0), angle="rod")
    pin = tb.PinJoint(
        name="pin", parent="ground", parent_point=(0.0, 0.0), child="rod", child_point=(0.0, 0.0)
    )
    mechanism = tb.Mechanism(name="rod", bodies=(rod,), joints=(pin,), start=(angle,), gravity=9.81)
    return tb.Problem(mechanism, duration=0.5)


@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS, ASSISTED])
def test_a_hanging_rod_is_held_by_its_weight_upwards(preset: str) -> None:
    found = _engine(preset).simulate(_rod(np.pi / 2))
    force = found.joint_reactions["pin"]
    # Of quarter of a turn in single precision the weight's moment moves it hardly.
    assert np.abs(force - np.array([0.0, 2.0 * 9.81])).max() < 1e3 * ROUNDOFF * 2.0 * 9.81


@pytest.mark.parametrize("preset", [SETTINGS, ASSISTED])
def test_a_swinging_rod_pulls_by_the_closed_form(preset: str) -> None:
    """F = m (a - g), with the centre's acceleration of the rod's angle and speed."""
    found = _engine(preset).simulate(_rod(0.0))
    q, u = found.q[:, 0], found.u[:, 0]
    alpha = 1.5 * 9.81 * np.cos(q)  # m g l/2 cos q over m l^2/3, clockwise
    a = 0.5 * np.stack(
        [-np.sin(q) * alpha - np.cos(q) * u**2, -np.cos(q) * alpha + np.sin(q) * u**2], axis=1
    )
    force = 2.0 * (a + np.array([0.0, 9.81]))
    error = np.abs(found.joint_reactions["pin"] - force).max()
    assert error < 1e2 * ROUNDOFF * np.abs(force).max()
    # From rest at the height of the pin: m g l/2 (1 - ...) is what it has in motion.
    assert found.kinetic_energy == pytest.approx(1 / 3 * u**2, rel=1e2 * ROUNDOFF, abs=1e-6)
    total = found.kinetic_energy + found.potential_energy
    assert np.abs(total).max() < 500 * ROUNDOFF * 2.0 * 9.81 * 0.5


@pytest.mark.parametrize("preset", [SETTINGS, ASSISTED])
def test_a_stop_has_the_torque_of_the_weight_that_it_holds(preset: str) -> None:
    """Machines start at rest on their stops, with torques that the reference has, too."""
    problem = tb.Problem(tb.fixed(), duration=1.0)
    found = _engine(preset, timestep=1e-3).simulate(problem)
    truth = tb.solve(problem.model_copy(update={"duration": 1.01})).trajectory(found.t)
    settled = found.t > 0.02  # twenty of the soft limit's time constants, one step each
    for name, torque in truth.stop_torques.items():
        error = np.abs(found.stop_torques[name] - torque)[settled].max()
        assert error <= 1e-3 * max(torque.max(), 1.0), name


@pytest.mark.parametrize("name", ["squeezer", "slider-crank", "n-four-bar"])
def test_a_loop_has_the_force_of_each_joint(name: str) -> None:
    """Multipliers of accelerations in single precision: 1e4 is what a mass matrix and closures
    of such mechanisms multiply rounding by, at most."""
    known = library_problem(name, None)
    assert known is not None
    problem = known.model_copy(update={"duration": known.duration / 100})
    assert _force_error(problem, ASSISTED, problem.duration / 50) < 1e4 * ROUNDOFF


def test_equalities_tell_the_forces_of_a_loop() -> None:
    """A time constant of 20 steps, after 15 of which critical damping leaves 5e-6. With one of
    a step the rounding of places, by 1 / h^2, is larger than the forces."""
    known = library_problem("squeezer", None)
    assert known is not None
    problem = known.model_copy(update={"duration": known.duration / 10})
    step = problem.duration / 400
    assert _force_error(problem, SETTINGS, step, 300, solref=(20 * step, 1.0)) < 1e-2
    assert _force_error(problem, SETTINGS, step, 300) > 1e-2  # the trap is there


def _force_error(
    problem: tb.Problem, preset: str, step: float, settled: int = 0, **options: Any
) -> float:
    """Greatest error of a joint's force after some steps, of the greatest force."""
    found = _engine(preset, timestep=step, **options).simulate(problem)
    truth = tb.solve(problem).trajectory(np.minimum(found.t, problem.duration)).joint_reactions
    assert found.joint_reactions.keys() == truth.keys()
    errors = (np.abs(found.joint_reactions[joint] - truth[joint])[settled:] for joint in truth)
    return float(max(map(np.max, errors)) / max(np.abs(force).max() for force in truth.values()))


# --- The built model, and what it refuses


@pytest.mark.parametrize("name", ["fixed", "rolling", "squeezer", "thrown-plate"])
def test_the_built_model_is_shown_and_a_fault_in_it_is_found(name: str) -> None:
    known = library_problem(name, None)
    mechanism = tb.model(name) if known is None else known.mechanism
    engine, first = _engine(ASSISTED), mechanism.bodies[0]
    assert check_model(engine, mechanism).holds
    heavy = mechanism.model_copy(
        update={
            "bodies": (first.model_copy(update={"mass": 1.01 * first.mass}), *mechanism.bodies[1:])
        }
    )
    wrong = SimpleNamespace(
        name="mujoco_warp",
        capabilities=engine.capabilities,
        inspect=lambda _, states: engine.inspect(heavy, states),
    )
    assert not check_model(wrong, mechanism).holds  # type: ignore[arg-type]


def test_a_restitution_is_refused_by_the_adapter() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="restitution"):
        _engine(SETTINGS).simulate(_problem("bouncing", 0.1))


def test_options_that_do_nothing_are_refused() -> None:
    with pytest.raises(tb.InputError, match="multipliers"):
        MujocoWarpEngine(integrator="Euler")
    with pytest.raises(tb.InputError, match="tolerance"):
        _engine(SETTINGS, tolerance=1e-7)


def test_constraints_that_find_no_room_are_no_result() -> None:
    mechanism = _problem("squeezer", 0.1).mechanism
    model = mujoco.MjModel.from_xml_string(model_text(mechanism, _engine(SETTINGS).of_mujoco))
    world = World(model, start_data(model))
    world.step()
    world.refuse_overflow()
    world.data.overflow.fill_(int(mujoco_warp.OverflowType.ITERATIONS))  # the solver goes on
    world.refuse_overflow()
    world.data.overflow.fill_(int(mujoco_warp.OverflowType.NEFC))
    with pytest.raises(tb.SimulationError, match="NEFC"):
        world.refuse_overflow()


def test_a_run_that_diverges_is_a_failed_run() -> None:
    """A spring at steps beyond the limit of stability of semi-implicit Euler."""
    with pytest.raises(tb.SimulationError, match="finite"):
        _engine(DEFAULT, timestep=1.0).simulate(_problem("oscillator", 100.0))


def test_nothing_is_printed_of_kernels_and_solvers() -> None:
    code = (
        "import trebucheck as tb\n"
        "from trebucheck.models.library.registry import library_problem\n"
        "p = library_problem('slider-crank', None).model_copy(update={'duration': 0.1})\n"
        "tb.engine('mujoco_warp', 'settings').simulate(p)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == ""


def test_without_its_package_it_says_what_brings_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MujocoWarpEngine, "is_installed", classmethod(lambda _: False))
    with pytest.raises(tb.EngineNotInstalledError, match="pip install mujoco-warp"):
        _engine(DEFAULT).simulate(FREE_SWING)
