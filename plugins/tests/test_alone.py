"""Engines of the plug-ins by themselves: the presets `default` and `settings`, what helps beside.

The same as `tests/agreement/test_presets.py` for the built-in ones. An engine has an environment of
its own: where it is not installed, its cases are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.runner import refuse_invalid
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.protocol import BuiltinEngine
from trebucheck.engines.supplied import Part, stated
from trebucheck.models.library.registry import benchmark, library_problem

ALONE = (DEFAULT, SETTINGS)


@dataclass(frozen=True)
class Case:
    """An engine, its own options, and problems: with stops, with a loop or slot, with springs."""

    own: frozenset[str]
    problems: tuple[str, ...]


CASES: Mapping[str, Case] = {
    "drake": Case(
        frozenset({"timestep", "integrator", "accuracy", "continuous_plant"}),
        (
            *("fixed", "rolling", "n-four-bar", "quick-return", "motor"),
            *("damped-oscillator", "spring-pendulum"),
        ),
    ),
    "dart": Case(
        frozenset({"timestep"}),
        ("fixed", "rolling", "three-cranks", "quick-return", "motor", "spring-pendulum"),
    ),
    "pybullet": Case(
        frozenset({"timestep", "solver_iterations", "solver_threshold", "max_joint_velocity"})
        | {"linear_damping", "angular_damping"},
        ("fixed", "rolling", "three-cranks", "quick-return", "motor", "spring-pendulum"),
    ),
    "box2d": Case(
        frozenset({"timestep", "velocity_iterations", "position_iterations", "allow_sleep"}),
        ("fixed", "rolling", "slider-crank", "welded-rods", "motor", "spring-pendulum", "bead"),
    ),
    "pyb2d3": Case(
        frozenset({"timestep", "sub_steps", "allow_sleep"}),
        ("fixed", "rolling", "slider-crank", "welded-rods", "motor", "spring-pendulum", "bead"),
    ),
    "planck": Case(
        frozenset({"timestep", "first_iterations", "velocity_iterations", "position_iterations"})
        | {"linear_slop", "angular_slop", "allow_sleep"},
        ("fixed", "slider-crank", "spring-pendulum", "bead"),
    ),
    "jolt": Case(
        frozenset({"timestep", "collision_steps", "first_velocity_steps", "velocity_steps"})
        | {"position_steps", "baumgarte", "damping", "max_linear_velocity", "max_angular_velocity"}
        | {"gyroscopic_force", "allow_sleep", "plane"},
        ("fixed", "slider-crank", "welded-rods", "spring-pendulum", "bead"),
    ),
    "cannon": Case(
        frozenset({"timestep", "iterations", "tolerance", "stiffness", "relaxation"})
        | {"equation_step", "damping", "plane"},
        ("fixed", "n-four-bar", "welded-rods", "spring-pendulum", "motor"),
    ),
    "opensim": Case(
        frozenset({"timestep", "integrator", "accuracy", "samples"})
        | {"limit_stiffness", "limit_damping", "limit_transition"},
        (
            *("fixed", "rolling", "slider-crank", "singular-slider-crank"),
            *("squeezer", "spring-pendulum", "damped-oscillator"),
        ),
    ),
    # Springs on joints, which its default leaves out, are in its own tests.
    "newton": Case(
        frozenset({"timestep", "solver", "limit_frequency", "angular_damping", "iterations"}),
        ("fixed", "double-pendulum", "welded-rods"),
    ),
    # Each run of it is compiled for some ten seconds.
    "mjx": Case(
        frozenset({"timestep", "precision", "integrator", "solver", "tolerance", "iterations"})
        | {"solref", "solimp", "margin"},
        ("fixed", "slider-crank", "spring-pendulum"),
    ),
    "p2": Case(
        frozenset({"timestep", "iterations", "tolerance", "stiffness", "relaxation", "damping"})
        | {"single_precision"},
        ("fixed", "rolling", "slider-crank", "welded-rods", "motor", "spring-pendulum", "bead"),
    ),
    # Neither slots nor limits.
    "matter": Case(
        frozenset({"timestep", "iterations", "stiffness", "air_friction", "pixels"}),
        ("double-pendulum", "n-four-bar", "welded-rods", "motor", "spring-pendulum"),
    ),
    # It has no stops: the machines are in its own tests, assisted.
    "pydy": Case(
        frozenset({"timestep", "integrator", "tolerance"}),
        ("double-pendulum", "slider-crank", "motor", "spring-pendulum", "welded-rods"),
    ),
    # Of few joints: its kernels are compiled anew for each number of them.
    "mujoco_warp": Case(
        frozenset({"timestep", "integrator", "solver", "tolerance", "iterations"})
        | {"solref", "solimp", "margin"},
        ("fixed", "slider-crank", "spring-pendulum"),
    ),
    # Each run of it is compiled for some ten seconds, too.
    "brax": Case(
        frozenset({"timestep", "pipeline", "precision", "matrix_inv_iterations"})
        | {"solver_iterations", "solver_maxls", "solref", "solimp", "joint_scale_pos"}
        | {"joint_scale_ang", "constraint_stiffness", "constraint_limit_stiffness"}
        | {"constraint_vel_damping"},
        ("fixed", "spring-pendulum"),
    ),
    # Each run of it compiles, or reads what it has compiled, for some ten seconds.
    "genesis": Case(
        frozenset({"timestep", "precision", "integrator", "constraint_timeconst", "solimp"})
        | {"default_armature"},
        ("fixed", "slider-crank", "spring-pendulum"),
    ),
    "rapier": Case(
        frozenset({"timestep", "substeps", "passes", "allow_sleep"}),
        ("fixed", "three-cranks", "spring-pendulum"),
    ),
    "ovphysx": Case(
        frozenset({"timestep", "solver", "position_iterations", "velocity_iterations"})
        | {"angular_damping", "max_angular_velocity", "sleep_threshold"},
        ("fixed", "chain", "spring-pendulum", "bead"),
    ),
    "physx": Case(
        frozenset({"timestep", "position_iterations", "velocity_iterations", "angular_damping"})
        | {"max_angular_velocity", "sleep_threshold", "plane"},
        ("fixed", "slider-crank", "spring-pendulum", "bead"),
    ),
    "havok": Case(
        frozenset({"timestep", "ideal_step", "locks_plane", "angular_damping", "stabilization"})
        | {"speed_limit", "turning_limit", "allow_sleep"},
        ("fixed", "slider-crank", "spring-pendulum", "bead"),
    ),
}


def _run(name: str, program: str) -> dict[str, Any]:
    """Run a program: the names of its module in Python, or what it prints in Node.js."""
    npm = getattr(type(tb.engine(name)), "npm", None)
    if npm is not None:
        return {key: np.array(value) for key, value in npm.run(program).items()}
    if name == "planck":
        from trebucheck_planck.bridge import PLANCK

        return {key: np.array(value) for key, value in PLANCK.run(program).items()}
    if name == "rapier":
        from trebucheck_rapier.bridge import RAPIER

        return {key: np.array(value) for key, value in RAPIER.run(program).items()}
    found: dict[str, Any] = {}
    exec(program, found)
    return found


def _problem(name: str, duration: float) -> tb.Problem:
    """A problem of the library, or a machine, for a short time."""
    known = library_problem(name, None)
    if known is None:
        return tb.Problem(tb.model(name), duration=duration)
    return known.model_copy(update={"duration": min(duration, known.duration)})


def _engine(name: str, preset: str = ASSISTED, **options: Any) -> BuiltinEngine:
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed")
    made = tb.engine(name, preset, **options)
    assert isinstance(made, BuiltinEngine)
    return made


EVERY = [(name, problem) for name, case in CASES.items() for problem in case.problems]


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_a_program_of_the_engine_alone_has_the_same_motion(
    name: str, problem: str, preset: str
) -> None:
    made, given = _engine(name, preset), _problem(problem, 0.4)
    text = made.script(given)
    assert "trebucheck" not in text.replace("Written by trebucheck", "")  # MJCF says so
    found = _run(name, text)
    row = made.simulate(given)
    for key in ("t", "q", "u"):
        assert np.array_equal(found[key], getattr(row, key))


@pytest.mark.parametrize("name", CASES)
def test_every_option_is_the_engines_own_or_assistance(name: str) -> None:
    cls = type(_engine(name))
    assisting = {each.option for each in cls.assistance or ()}
    assert assisting
    assert {*CASES[name].own, *assisting} == set(cls.model_fields) - {"preset"}
    assert not assisting & CASES[name].own


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize("name", CASES)
def test_nothing_helps_an_engine_that_is_alone(name: str, preset: str) -> None:
    made = _engine(name, preset)
    assert made.assisted_by == () and made.supplied == type(made).readings
    with pytest.raises(tb.InputError, match="takes part in the run"):
        _engine(name).script(_problem(CASES[name].problems[0], 0.1))


@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_what_changes_a_state_is_named_and_without_all_of_it_the_engine_is_alone(
    name: str, problem: str
) -> None:
    given, assisted = _problem(problem, 0.1), _engine(name)
    row, named = assisted.simulate(given), stated(assisted, given.mechanism)
    assert named is not None
    off: dict[str, Any] = dict(assisted.settings)
    for option in {each.option for each in assisted.assisted_by}:  # one may stand for several parts
        parts = [each for each in assisted.assisted_by if each.option == option]
        without = {**assisted.settings, **parts[0].options_without}
        off |= parts[0].options_without
        found_without = _engine(name, **without).simulate(given)
        same = np.array_equal(found_without.t, row.t) and np.array_equal(found_without.q, row.q)
        assert same or {each.part for each in parts} & named.keys(), option
    bare = _engine(name, **off)
    assert bare.assisted_by == ()
    found = _run(name, bare.script(given))
    assert np.array_equal(found["q"], bare.simulate(given).q)


@pytest.mark.parametrize(("name", "problem"), EVERY)
def test_settings_are_no_worse_than_the_default(name: str, problem: str) -> None:
    known = library_problem(problem, None)  # the squeezer takes 30 steps of 1 ms
    given = _problem(problem, 1.0 if known is None else min(1.0, known.duration / 4))
    solution = tb.solve(given)

    def error(preset: str) -> float:
        run = _engine(name, preset).simulate(given)
        within = run.t <= given.duration
        return float(np.abs(run.q[within] - np.asarray(solution.q(run.t[within]))).max())

    # The reference is known to 1e-9 and better: below that there is nothing to compare.
    assert error(SETTINGS) <= max(error(DEFAULT), 1e-9)


# --- Forces of joints that close loops


@dataclass(frozen=True)
class LoopCase:
    """Steps of a tenth of a problem's motion, and where in it forces are compared."""

    steps: int
    since: float = 0.0
    """Part of that time which is left out at the start."""
    joints: tuple[str, ...] = ()
    """Whose forces are compared; all if empty."""


LOOPS: Mapping[str, LoopCase] = {
    "dart": LoopCase(2000),
    # Its constraints are compliant: at the start they do not hold in full.
    "drake": LoopCase(500, since=0.1),
}
"""Engines that do not tell the forces of pins that close loops, with a tenth of the squeezer."""
# A step from a moving start finds the speeds in agreement with the loops, and holds no more.
SLOTS: Mapping[str, LoopCase] = {
    "dart": LoopCase(4000, since=0.1),
    "drake": LoopCase(4000, since=0.1),
    # Its joint sensors are wrong in motion, but for the slides of carriers, which do not turn.
    "pybullet": LoopCase(4000, since=0.1, joints=("slot",)),
}


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize(
    ("problem", "loops"), [("n-four-bar", 1), ("squeezer", 3), ("three-cranks", 2)]
)
@pytest.mark.parametrize("name", LOOPS)
def test_each_joint_of_a_mechanism_with_loops_has_its_force(
    name: str, problem: str, loops: int, preset: str
) -> None:
    given = benchmark(problem).problem()
    made = _engine(name, preset, timestep=given.duration / 2000)
    found = made.simulate(given.model_copy(update={"duration": given.duration / 100}))
    mechanism = refuse_invalid(name, found, found.mechanism, made.capabilities).mechanism
    assert len(mechanism.loop_joints) == loops
    supplied = stated(made, mechanism)
    assert supplied is not None and Part.LOOP_REACTIONS in supplied


@pytest.mark.parametrize(
    ("name", "model", "case"),
    [
        *((name, "squeezer", case) for name, case in LOOPS.items()),
        *((name, "slider-crank", case) for name, case in SLOTS.items()),
    ],
)
def test_forces_of_joints_of_loops_and_beside_them_are_of_first_order(
    name: str, model: str, case: LoopCase
) -> None:
    problem = benchmark(model).problem()
    problem = problem.model_copy(update={"duration": problem.duration / 10})
    solution = tb.solve(problem)

    def errors(steps: int) -> dict[str, float]:
        found = _engine(name, SETTINGS, timestep=problem.duration / steps).simulate(problem)
        kept = (found.t >= case.since * problem.duration) & (found.t < problem.duration)
        truth = solution.trajectory(found.t[kept]).joint_reactions
        return {
            joint: float(np.abs(force[kept] - truth[joint]).max())
            for joint, force in found.joint_reactions.items()
        }

    coarse, fine = errors(case.steps), errors(2 * case.steps)
    assert coarse.keys() == {joint.name for joint in problem.mechanism.joints}
    for joint in case.joints or coarse:
        assert np.log2(coarse[joint] / fine[joint]) == pytest.approx(1.0, abs=0.1), joint
