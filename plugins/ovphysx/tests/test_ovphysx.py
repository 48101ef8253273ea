"""ovphysx's defaults, and its articulations against the reference and closed forms; the rest is in
`plugins/tests`."""

import ctypes
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from ovphysx.samples.python_samples.schema_support import physx_schema_paths
from trebucheck.comparisons.runs.process import Worker, simulate
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_ovphysx.engine import ATTRIBUTES, OvphysxEngine
from trebucheck_toolkit.body_program import apart

FIXED = tb.Problem(tb.fixed(), duration=2.0)
FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(found: tb.Trajectory, problem: tb.Problem) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    right = solve(problem).trajectory(found.t).markers
    return float(
        max(np.abs(m.position - right[key].position).max() for key, m in found.markers.items())
    )


def test_the_defaults_are_those_of_the_schema_of_physx() -> None:
    """A program of `default` sets none of them, and PhysX's schema for USD says what they are."""
    folder = next(Path(path) for path in physx_schema_paths() if "PhysxSchema" in str(path))
    schema = (folder / "generatedSchema.usda").read_text()
    own: dict[str, Any] = dict(OvphysxEngine.default_options or {})
    attributes = {name: text for each in ATTRIBUTES.values() for name, text in each.items()}
    for option, attribute in attributes.items():
        found = re.search(rf"^    {re.escape(attribute)} = (\S+)", schema, re.MULTILINE)
        assert found is not None and json.loads(found[1]) == own[option], option
    assert re.search(r"physxScene:timeStepsPerSecond = 60", schema) and own["timestep"] == 1 / 60
    program = tb.engine("ovphysx", "default").script(FREE_SWING)  # type: ignore[attr-defined]
    assert not [attribute for attribute in attributes.values() if attribute in program]


@pytest.mark.parametrize("solver", ["PGS", "TGS"])
def test_a_held_arm_has_its_forces_and_its_limits_torques(solver: str) -> None:
    """Until a stop is let go: first order in the step, from the first sample on."""
    problem = FIXED.model_copy(update={"duration": 0.75})
    engine = tb.engine("ovphysx", "settings", timestep=1e-3, solver=solver)
    found = engine.simulate(problem)
    truth = solve(problem).trajectory(found.t)
    for mine, right in (
        (found.joint_reactions, truth.joint_reactions),
        (found.stop_torques, truth.stop_torques),
    ):
        greatest = max(float(np.abs(values).max()) for values in right.values())
        for name, values in mine.items():
            # At 0.3 rad/s a step of the arm changes forces by 3e-4 of themselves.
            assert np.abs(values - right[name]).max() < 2e-3 * greatest, name


@pytest.mark.parametrize("preset", ["settings", "assisted"])
def test_stops_release_within_two_steps_and_a_hundredth_of_their_gaps(preset: str) -> None:
    """A step late by the scheme and one by its end; a torque below the moment of its joint's force
    on the way of a step is none, which ends the sling's a step before."""
    engine = tb.engine("ovphysx", preset, timestep=1e-3)
    found, right = engine.simulate(FIXED).release_times, solve(FIXED).release_times
    assert found["arm stop"] is right["arm stop"] is None
    for stop in ("hanger rest", "sling rest"):
        assert found[stop] == pytest.approx(right[stop], abs=3e-3)


def test_the_temporal_solver_lets_limits_go_by_turns() -> None:
    """Why `settings` has the other one: a step's limit pushes in some of its sub-steps only, and a
    hundredth of a second before it is let go it pauses."""
    errors = {
        solver: _error(tb.engine("ovphysx", timestep=1e-3, solver=solver).simulate(FIXED), FIXED)
        for solver in ("PGS", "TGS")
    }
    assert errors["TGS"] > 0.1
    assert errors["PGS"] < 0.01


@pytest.mark.parametrize(
    ("name", "reason"),
    [("n-four-bar", "loops of joints"), ("bouncing", "slots"), ("falling-rod", "stops on points")],
)
def test_what_it_has_not_is_refused(name: str, reason: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=reason):
        tb.engine("ovphysx").simulate(benchmark(name).problem())


def test_dynamics_of_free_bodies_with_joints_are_not_read() -> None:
    plate = benchmark("thrown-plate").problem().mechanism
    (body,) = plate.bodies
    other = tb.Body(name="other", angle="b", mass=1.0, centre=(0.1, 0.0), inertia=0.1)
    pin = {"parent_point": (0.0, 0.0), "child_point": (0.0, 0.0)}
    joint = tb.PinJoint(name="hinge", parent=body.name, child="other", **pin)
    update = {"bodies": (body, other), "joints": (*plate.joints, joint)}
    start = {"start": (*plate.start, 0.0), "start_speeds": (*plate.start_speeds, 0.0)}
    engine: Any = tb.engine("ovphysx")
    with pytest.raises(tb.UnsupportedProblemError, match="free bodies with joints"):
        engine.inspect(plate.model_copy(update=update | start), [])


def test_every_fork_of_a_process_can_run_it() -> None:
    """PhysX's libraries keep memory that forks share: there the second run crashed, others hung."""
    problem = FREE_SWING.model_copy(update={"duration": 0.01})
    engine = tb.engine("ovphysx", timestep=1e-3)
    with Worker(60.0, fresh=True) as worker:
        ends = [worker.call(simulate, engine, problem).q[-1].tolist() for _ in range(3)]
    assert ends[0] == ends[1] == ends[2]


def test_a_crash_of_the_process_of_a_run_is_told_with_its_signal() -> None:
    with pytest.raises(tb.SimulationError, match="SIGSEGV"):
        apart(ctypes.string_at, 0)
