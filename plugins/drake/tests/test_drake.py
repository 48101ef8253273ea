"""Drake by itself: its own defaults, what its elements do; the continuous plant's accuracy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from trebucheck.engines.inspection import State
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_drake.alone import Alone, is_free
from trebucheck_drake.engine import DrakeEngine

FREE_SWING = tb.fixed().model_copy(update={"stops": ()})


def _engine(preset: str, **options: Any) -> DrakeEngine:
    return DrakeEngine.presets()[preset](**options)


def _error(problem: tb.Problem, **options: object) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("drake", **options).simulate(problem)  # type: ignore[arg-type]
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


@pytest.mark.parametrize("mode", ["continuous", "discrete"])
def test_the_continuous_plant_follows_its_accuracy_and_not_the_step(mode: str) -> None:
    problem = tb.Problem(FREE_SWING, duration=2.0)
    assert _error(problem, timestep=0.1, accuracy=1e-13, mode=mode) < 1e-8
    assert _error(problem, timestep=0.1, accuracy=1e-3, mode=mode) > 1e-8


def test_the_defaults_are_drakes_own() -> None:
    """A plant's constructor asks for a step; that of Drake's configuration has one."""
    default, config = _engine(DEFAULT), MultibodyPlantConfig()
    assert default.timestep == config.time_step
    bare = MultibodyPlant(time_step=config.time_step)
    kept = (
        "time_step",
        "get_discrete_contact_approximation",
        "get_contact_model",
        "get_sap_near_rigid_threshold",
        "get_contact_surface_representation",
        "get_adjacent_bodies_collision_filters",
        "has_sampled_output_ports",
    )
    for name in ("n-four-bar", "motor", "damped-oscillator"):
        plant = Alone(benchmark(name).problem().mechanism, default).plant
        for function in kept:
            assert getattr(plant, function)() == getattr(bare, function)(), function
    plain = Alone(tb.fixed(), default)
    assert [getattr(plain.plant, f)() for f in kept] == [getattr(bare, f)() for f in kept]
    for index, joint in enumerate(plain.moving):
        assert not joint.default_damping_vector().any()
        limited = np.isfinite([*joint.position_lower_limits(), *joint.position_upper_limits()])
        assert limited.any() == (index in plain.ranges)


def test_its_own_springs_are_drakes_force_elements() -> None:
    bare = MultibodyPlant(time_step=1e-3).num_force_elements()  # gravity
    for name, own in (("torsion-pendulum", 1), ("damped-oscillator", 1), ("thrown-plate", 0)):
        alone = Alone(benchmark(name).problem().mechanism, _engine(DEFAULT))
        assert alone.plant.num_force_elements() == bare + own
        assert len(alone.pushed.force_elements) == 1 - own


@pytest.mark.parametrize(
    "name", ["torsion-pendulum", "damped-oscillator", "spring-pendulum", "motor", "squeezer"]
)
def test_a_continuous_plant_has_its_own_springs_too(name: str) -> None:
    """Nothing of them is counted twice, or left out, in forces, reactions and energies."""
    problem = benchmark(name).problem()
    problem = problem.model_copy(update={"duration": problem.duration / 100})
    made = _engine(ASSISTED, timestep=problem.duration / 50)
    found, solution = made.simulate(problem), tb.solve(problem)
    kept = found.t <= problem.duration
    truth = solution.trajectory(found.t[kept])
    for own, right in (
        (found.u[kept], truth.u),
        (found.potential_energy[kept], truth.potential_energy),
        *((found.joint_reactions[name][kept], f) for name, f in truth.joint_reactions.items()),
    ):
        assert own == pytest.approx(right, abs=1e-8 * max(1.0, np.abs(right).max()))
    # The forces of an inspection give its accelerations; between loops there are others.
    if not problem.mechanism.loop_joints:
        state = State(found.q[-1], found.u[-1], ())
        (seen,) = made.inspect(problem.mechanism, [state]).dynamics
        assert seen.mass_matrix is not None and seen.forces is not None
        moved = seen.mass_matrix @ seen.accelerations
        assert moved == pytest.approx(seen.forces, abs=1e-9 * np.abs(seen.forces).max())


def test_settings_are_continuous_where_nothing_has_to_be_held() -> None:
    for name, free in (("pendulum", True), ("torsion-pendulum", True), ("n-four-bar", False)):
        problem = benchmark(name).problem().model_copy(update={"duration": 0.2})
        assert is_free(problem.mechanism) is free
        program = _engine(SETTINGS).script(problem)
        assert ("SimulatorConfig(" in program) is free
        assert "SimulatorConfig(" not in _engine(DEFAULT).script(problem)


def test_limits_hold_and_release_by_themselves() -> None:
    problem = tb.Problem(tb.fixed(), duration=1.6)
    found = _engine(DEFAULT).simulate(problem)
    truth = tb.solve(problem).trajectory(found.t)
    for name, time in truth.release_times.items():
        released = found.release_times[name]
        assert (released is None) == (time is None)
        assert released is None or time is None or abs(released - time) <= 2e-3


@pytest.mark.parametrize("problem", ["bouncing", "stopped-pendulum"])
def test_what_is_not_built_is_said_of_the_adapter(problem: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="adapter"):
        _engine(DEFAULT).simulate(benchmark(problem).problem())
