"""Newton by itself: its own defaults, and springs of its joints."""

import inspect
from typing import Any

import newton
import numpy as np
import pytest
import trebucheck as tb
from newton.examples.basic import example_basic_pendulum
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.library.registry import library_problem
from trebucheck_newton.alone import Alone, solver_of
from trebucheck_newton.engine import NewtonEngine


def _engine(preset: str, **options: Any) -> NewtonEngine:
    return NewtonEngine.presets()[preset](**options)


def test_the_defaults_are_newtons_own() -> None:
    default = _engine(DEFAULT)
    assert solver_of(default) == ("SolverXPBD", {})
    own = inspect.signature(newton.solvers.SolverXPBD.__init__).parameters
    assert default.iterations == own["iterations"].default
    assert default.angular_damping == own["angular_damping"].default
    # The example's solver, frames and substeps.
    source = inspect.getsource(example_basic_pendulum)
    assert 'getattr(args, "solver", "xpbd")' in source
    assert "SolverXPBD(self.model)" in source
    assert "self.fps = 100\n" in source and "self.sim_substeps = 10\n" in source
    assert default.timestep == 1 / 100 / 10
    axis = newton.ModelBuilder.JointDofConfig()
    model = Alone(tb.fixed(), default).tree.model
    for name in ("limit_ke", "limit_kd", "armature", "friction", "target_ke"):
        numbers = getattr(model, f"joint_{name}").numpy()
        assert (numbers == np.float32(getattr(axis, name))).all(), name


def test_a_spring_on_a_joint_is_newtons_own() -> None:
    known = library_problem("torsion-pendulum", None)
    assert known is not None
    problem = known.model_copy(update={"duration": 0.1})
    engine, found = _engine(SETTINGS), dict[str, Any]()
    row = engine.simulate(problem)
    exec(engine.script(problem), found)
    assert all(np.array_equal(found[name], getattr(row, name)) for name in ("t", "q", "u"))
    truth = tb.solve(problem).trajectory(np.minimum(row.t, problem.duration))
    # A hundred states are rounded to 24 bits.
    assert np.abs(row.q - truth.q).max() < 100 * 2.0**-23 * np.abs(truth.q).max()


@pytest.mark.parametrize(
    ("preset", "name"),
    [(DEFAULT, "torsion-pendulum"), (SETTINGS, "spring-pendulum"), (SETTINGS, "motor")],
)
def test_what_the_adapter_does_not_build_it_says_itself(preset: str, name: str) -> None:
    known = library_problem(name, None)
    assert known is not None
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(preset).simulate(known.model_copy(update={"duration": 0.01}))


def test_options_of_another_solver_are_refused() -> None:
    for options in ({"solver": "xpbd"}, {"angular_damping": 0.1}, {"iterations": 3}):
        with pytest.raises(tb.InputError):
            NewtonEngine(**options)
