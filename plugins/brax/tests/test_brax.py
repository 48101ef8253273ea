"""Brax's own defaults, what it builds and tells, and traps; the rest is in `plugins/tests`."""

import inspect
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.models.library.registry import benchmark
from trebucheck.models.problem import Problem
from trebucheck_brax.engine import BraxEngine

_EMPTY = """
<mujoco>
  <worldbody>
    <body>
      <joint type="hinge" axis="0 1 0" limited="true" range="-1 1"/>
      <geom size="1"/>
    </body>
  </worldbody>
</mujoco>
"""
"""A model that sets no option."""


def _engine(preset: str, **options: Any) -> BraxEngine:
    return BraxEngine.presets()[preset](**options)


def test_the_defaults_are_braxs_own() -> None:
    from brax.envs import inverted_pendulum
    from brax.io import mjcf

    bare, default = mjcf.loads(_EMPTY), _engine(DEFAULT)
    own = {
        "timestep": bare.opt.timestep,
        "matrix_inv_iterations": bare.matrix_inv_iterations,
        "solver_iterations": bare.solver_iterations,
        "solver_maxls": bare.solver_maxls,
        "solref": bare.dof.solver_params[0, :2],
        "solimp": bare.dof.solver_params[0, 2:],
        "joint_scale_pos": bare.joint_scale_pos,
        "joint_scale_ang": bare.joint_scale_ang,
        "constraint_stiffness": bare.link.constraint_stiffness[0],
        "constraint_limit_stiffness": bare.link.constraint_limit_stiffness[0],
        "constraint_vel_damping": bare.link.constraint_vel_damping[0],
    }
    for name, value in own.items():
        assert np.array_equal(np.float32(getattr(default, name)), np.float32(value)), name
    environment = inspect.signature(inverted_pendulum.InvertedPendulum.__init__)
    assert environment.parameters["backend"].default == default.pipeline
    fresh = [sys.executable, "-c", "import jax; print(jax.numpy.zeros(1).dtype)"]
    done = subprocess.run(fresh, check=True, capture_output=True, text=True)
    assert default.precision == "single" and done.stdout.strip() == "float32"
    text = default.script(Problem(tb.fixed(), duration=1.0))
    assert "solref" not in text and "timestep" not in text and "numeric" not in text
    of_the_model = {"timestep", "solver_iterations", "solref", "solimp"}
    others = {name: 1 + getattr(default, name) for name in own if name not in of_the_model}
    text = _engine(DEFAULT, **others).script(Problem(tb.fixed(), duration=1.0))
    assert all(f'add_numeric(name="{name}"' in text for name in others)


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("motor", 2e-3),
        ("welded-rods", 2e-3),
        ("spring-pendulum", 2e-3),
        ("incline", 2e-3),
        ("thrown-plate", 1e-4),
    ],
)
def test_every_element_that_it_builds_converges(name: str, step: float) -> None:
    """The order is its scheme's, one, to its half; a wrong force would leave an error."""
    problem = benchmark(name).problem()
    problem = problem.model_copy(update={"duration": min(0.5, problem.duration / 4)})

    def error(step: float) -> float:
        run = _engine(ASSISTED, timestep=step).simulate(problem)
        within = run.t <= problem.duration
        truth = tb.solve(problem).trajectory(run.t[within])
        return float(np.abs(run.q[within] - truth.q).max())

    assert np.log2(error(step) / error(step / 2)) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("preset", [DEFAULT, ASSISTED])
def test_a_limit_carries_the_weight_of_a_rod_by_the_closed_form(preset: str) -> None:
    """A horizontal rod that rests on its stop: m g a / 2, clockwise less, in the stop's sense.

    Of the force's settling there is nothing left after 50 time constants of 0.02 s; the solver ends
    at a residual of 1e-3 rad/s^2, which is a thousandth of what gravity does to 10 m and less, and
    single precision has 6e-8 of it.
    """
    length, mass = 1.0, 2.0
    rod = tb.Body(
        name="rod", angle="q", mass=mass, centre=(length / 2, 0.0), inertia=mass * length**2 / 12
    )
    made = tb.Mechanism(
        name="rod at rest",
        gravity=9.81,
        bodies=(rod,),
        joints=(
            tb.PinJoint(
                name="pin",
                parent="ground",
                child="rod",
                parent_point=(0.0, 0.0),
                child_point=(0.0, 0.0),
            ),
        ),
        stops=(tb.Stop(name="rest", body="rod", sense=-1, limit=0.0, closed=True),),
        start=(0.0,),
    )
    run = _engine(preset).simulate(tb.Problem(made, duration=1.0))
    weight = mass * made.gravity * length / 2
    assert run.stop_torques["rest"][-1] == pytest.approx(weight, rel=1e-3)
    assert run.release_times["rest"] is None


def test_limits_of_heavy_machines_chatter_without_a_unit_of_their_size() -> None:
    """The trap that `mass_unit` is for: the solver's residual and step have fixed sizes."""
    problem, middle = tb.Problem(tb.fixed(), duration=0.5), {}
    for unit in ("kg", "machine"):
        run = _engine(ASSISTED, timestep=1e-3, mass_unit=unit).simulate(problem)
        truth = tb.solve(problem).trajectory(np.minimum(run.t, problem.duration))
        error = np.abs(run.stop_torques["hanger rest"] - truth.stop_torques["hanger rest"])
        middle[unit] = float(error[250:].max() / truth.stop_torques["hanger rest"].max())
    assert middle["machine"] < 1e-2 < middle["kg"]  # of a step of 1 ms, see test_steps


@pytest.mark.parametrize("pipeline", ["positional", "spring"])
def test_other_pipelines_tell_gaps_and_no_torques(pipeline: str) -> None:
    engine = _engine(DEFAULT, pipeline=pipeline)
    assert not engine.capabilities.stop_torques and BraxEngine.capabilities.stop_torques
    problem = tb.Problem(tb.fixed(), duration=0.1)
    run = engine.simulate(problem)
    assert run.stop_torques == {} and set(run.release_times) == {"hanger rest", "sling rest"}
    assert max(gap.max() for gap in run.joint_gaps.values()) > 0.0


def test_the_model_check_finds_a_wrong_mass() -> None:
    mechanism = tb.model("rolling")
    assert check_model(_engine(ASSISTED), mechanism).holds

    class Wrong(BraxEngine):
        def inspect(self, mechanism: Any, states: Any) -> Any:
            bodies = (
                mechanism.bodies[0].model_copy(update={"mass": 1010.0}),
                *mechanism.bodies[1:],
            )
            return super().inspect(mechanism.model_copy(update={"bodies": bodies}), states)

    assert not check_model(Wrong(), mechanism).holds  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "words"),
    [("slider-crank", "loop"), ("bouncing", "restitution"), ("squeezer", "loop")],
)
def test_what_it_does_not_build_is_refused_by_name(name: str, words: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=words):
        _engine(ASSISTED).simulate(benchmark(name).problem())


def test_a_slide_on_a_body_that_turns_keeps_its_direction_in_brax() -> None:
    """Brax's `generalized` turns the axes of hinges with their bodies, and not those of slides."""
    mechanism = benchmark("bead").problem().mechanism
    found = check_model(_engine(ASSISTED), mechanism)
    wrong = {check.name for check in found.checks if not check.holds}
    assert {"mass matrix", "acceleration"} <= wrong
    incline = benchmark("incline").problem().mechanism
    assert check_model(_engine(ASSISTED), incline).holds


def test_braxs_own_loader_loses_welded_masses() -> None:
    """So the adapter has MuJoCo's compiler join welded bodies (`fusestatic`)."""
    from brax.io import mjcf

    mechanism, found = benchmark("welded-rods").problem().mechanism, dict[str, Any]()
    exec(_engine(DEFAULT).script(Problem(mechanism, duration=0.01)), found)
    total = sum(body.mass for body in mechanism.bodies)
    joined = float(found["system"].link.inertia.mass.sum())
    assert joined == pytest.approx(total, rel=1e-6)
    try:
        lost = float(mjcf.loads(found["MJCF"]).link.inertia.mass.sum())
    except ValueError:  # two `inertial` in a body: MuJoCo refuses it
        return
    assert lost != pytest.approx(total, rel=1e-6)
