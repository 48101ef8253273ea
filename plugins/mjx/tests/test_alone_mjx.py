"""MJX by itself: its own defaults, and what is read of it."""

from typing import Any

import mujoco
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.mujoco.alone import model_text
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.library.registry import library_problem
from trebucheck_mjx.build import jax, mjx
from trebucheck_mjx.engine import MjxEngine

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


def _engine(preset: str, **options: Any) -> MjxEngine:
    return MjxEngine.presets()[preset](**options)


def test_the_defaults_are_mjxs_own() -> None:
    default = _engine(DEFAULT)
    bare = mjx.put_model(mujoco.MjModel.from_xml_string(_EMPTY))
    own = {
        "timestep": bare.opt.timestep,
        "tolerance": bare.opt.tolerance,
        "iterations": bare.opt.iterations,
        "solref": bare.jnt_solref[0],
        "solimp": bare.jnt_solimp[0],
        "margin": bare.jnt_margin[0],
    }
    for name, value in own.items():
        # In JAX's precision, which is its own default.
        assert np.array_equal(np.float32(default.settings[name]), np.float32(value)), name
    assert default.integrator.upper() == bare.opt.integrator.name
    assert default.solver.upper() == bare.opt.solver.name
    fresh = "import jax; print(jax.numpy.zeros(1).dtype)"
    assert default.precision == "single" and _printed(fresh) == "float32"
    for name in ("fixed", "slider-crank", "spring-pendulum"):
        problem = library_problem(name, None)
        mechanism = tb.model(name) if problem is None else problem.mechanism
        text = model_text(mechanism, default.of_mujoco)
        model = mujoco.MjModel.from_xml_string(text)
        plain = mujoco.MjModel.from_xml_string(_EMPTY)
        for option in dir(plain.opt):
            value = getattr(plain.opt, option)
            if option.startswith("_") or callable(value) or option == "gravity":
                continue
            assert np.array_equal(getattr(model.opt, option), value), option
        for kind in ("jnt_solref", "jnt_solimp", "pair_solref", "pair_solimp", "eq_solref"):
            for row in getattr(model, kind):
                assert np.array_equal(row, getattr(plain, kind)[0]), kind


def _printed(code: str) -> str:
    import subprocess
    import sys

    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.mark.parametrize("name", ["slider-crank", "squeezer"])
def test_forces_and_energies_are_those_of_the_motion(name: str) -> None:
    """Of the first thousandth of the motion, which the soft constraints hardly change."""
    known = library_problem(name, None)
    assert known is not None
    step = 1e-5 * known.duration
    problem = known.model_copy(update={"duration": 100 * step})
    run = _engine(SETTINGS, timestep=step).simulate(problem)
    truth = tb.solve(problem).trajectory(np.minimum(run.t, problem.duration))
    # Soft equalities settle in some steps, to 1 - impedance = 1e-4 and what that does to others.
    for joint, force in truth.joint_reactions.items():
        error = np.abs(run.joint_reactions[joint] - force)[50:].max()
        assert error <= 1e-2 * max(np.abs(f).max() for f in truth.joint_reactions.values()), joint
    assert run.kinetic_energy == pytest.approx(truth.kinetic_energy, rel=1e-3, abs=1e-9)
    # Where they begin: a spring of the squeezer is stretched there.
    assert run.potential_energy[0] == pytest.approx(truth.potential_energy[0], rel=1e-12)


def test_options_of_mjx_are_refused_beside_multipliers() -> None:
    with pytest.raises(tb.InputError, match="multipliers"):
        MjxEngine(precision="single")
    with pytest.raises(tb.InputError, match="multipliers"):
        MjxEngine(integrator="Euler")


def test_a_restitution_is_refused_by_the_adapter() -> None:
    bouncing = library_problem("bouncing", None)
    assert bouncing is not None
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(SETTINGS).simulate(bouncing)


def test_precision_is_that_of_the_options() -> None:
    """Of one joint, whose speed is the mechanism's."""
    pendulum = library_problem("pendulum", None)
    assert pendulum is not None
    problem = pendulum.model_copy(update={"duration": 0.01})
    for precision, kept in (("single", True), ("double", False)):
        run = _engine(SETTINGS, precision=precision).simulate(problem)
        assert np.array_equal(run.u.astype(np.float32), run.u) == kept
        assert jax.config.jax_enable_x64 is not kept
