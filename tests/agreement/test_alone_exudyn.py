"""Exudyn by itself: its defaults, its run as a program, its own unilateral elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from elements import ELEMENTS, WALLS
from mechanisms import bouncing, everything, rod_pendulum
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.engines.inspection import State
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.models.elements import CubicTorsionSpring, FreeJoint, PointStop, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import library_problem
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solver import solve

pytest.importorskip("exudyn")

from trebucheck.engines.exudyn.alone import settings_of
from trebucheck.engines.exudyn.read import exu
from trebucheck.engines.exudyn.solver import changed_settings

# What a run to a problem's end needs, and that it is silent and stores every step.
NEEDED = {
    "timeIntegration.numberOfSteps",
    "timeIntegration.endTime",
    "solution.file.write",
    "solution.sensors.writePeriod",
}
# Of an angle that falls onto a stop, and of a point that falls onto a floor.
STOP = Stop(name="stop", body="rod", sense=-1, limit=-0.6, closed=False, restitution=0.6)
RESTITUTIONS = (0.2, 0.6, 0.9)


def made(preset: str, **options: Any) -> ExudynEngine:
    """The engine with a preset."""
    return ExudynEngine.presets()[preset](**options)


def fields_of(settings: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, object]]:
    """Paths and values of Exudyn's settings as a dictionary."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from fields_of(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


# --- Its defaults


@pytest.mark.parametrize("name", ["pendulum", "slider-crank", "fixed"])
def test_the_default_sets_nothing_but_what_a_run_needs(name: str) -> None:
    problem = library_problem(name, None) or Problem(tb.model(name), 2.7)
    ours = changed_settings(settings_of(problem, made(DEFAULT)))
    theirs = dict(fields_of(exu.SimulationSettings().GetDictionary()))
    changed = {path for path, value in fields_of(ours.GetDictionary()) if theirs[path] != value}
    assert changed <= NEEDED


def test_the_options_of_the_default_are_exudyns() -> None:
    time, options = exu.SimulationSettings().timeIntegration, made(DEFAULT)
    assert options.timestep == time.endTime / time.numberOfSteps
    alpha, newton = time.generalizedAlpha, time.newton
    assert options.integrator == "generalized-alpha-index-3"
    assert not alpha.useNewmark and not alpha.useIndex2Constraints
    assert options.loop_integrator is None
    assert options.spectral_radius == alpha.spectralRadius
    assert options.newton_relative == newton.relativeTolerance
    assert options.newton_absolute == newton.absoluteTolerance
    assert options.modified_newton == newton.useModifiedNewton
    assert options.adaptive_step == time.adaptiveStep
    assert options.minimum_step == time.minimumStepSize
    assert options.ignore_singular == (exu.SimulationSettings().linearSolver.ignoreSingularJacobian)


# --- The run as a program

DUFFING = rod_pendulum().model_copy(
    update={"force_elements": (CubicTorsionSpring(name="d", body="rod", cubic_stiffness=7.0),)}
)
PROGRAMS: Mapping[str, tuple[Mechanism, float, StopLaw]] = {
    **{name: (mechanism, 0.1, StopLaw.RELEASE_ONCE) for name, mechanism in ELEMENTS.items()},
    **WALLS,
    "everything": (everything(), 0.1, StopLaw.RELEASE_ONCE),
    "cubic spring": (DUFFING, 0.1, StopLaw.RELEASE_ONCE),
    "rebound": (rod_pendulum(STOP), 0.5, StopLaw.UNILATERAL),
}


@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS])
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_has_the_same_motion_and_writes_nothing(
    name: str,
    preset: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    mechanism, duration, law = PROGRAMS[name]
    problem = Problem(mechanism, duration, stop_law=law)
    engine = made(preset, timestep=1e-3)
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(engine.script(problem), found)
    run = engine.simulate(problem)
    for key in ("t", "q", "u"):
        assert np.array_equal(found[key], getattr(run, key))
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


# --- Its model


@pytest.mark.parametrize("name", [*ELEMENTS, *WALLS])
def test_the_built_system_is_the_described_one(name: str) -> None:
    mechanism = ELEMENTS[name] if name in ELEMENTS else WALLS[name][0]
    assert check_model(made(SETTINGS), mechanism).holds


def test_gaps_are_those_of_its_own_elements() -> None:
    lean, point = (0.6, 0.8), (1.3, 0.2)
    offset = float(np.dot(lean, point))
    stops = (
        Stop(name="angle", body="rod", sense=-1, limit=0.0, closed=True),
        Stop(name="contact", body="rod", sense=-1, limit=0.0, closed=True, restitution=0.5),
        PointStop(name="floor", body="rod", point=point, normal=lean, offset=offset, closed=True),
    )
    mechanism = rod_pendulum().model_copy(update={"stops": stops})
    for angle in (0.2, -0.1):
        state = State(np.array([angle]), np.zeros(1), ("angle", "contact", "floor"))
        (shown,) = made(SETTINGS).inspect(mechanism, (state,)).dynamics
        above = Kinematics(mechanism).gap("floor", state.q)
        # The triangle, a thousand times the mechanism's size, is rounded to 1e-13 of that.
        assert shown.stop_gaps == pytest.approx(
            {"angle": -angle, "contact": -angle, "floor": above}, abs=1e-11
        )


# --- Its stops


def falling(restitution: float) -> tuple[Problem, Problem]:
    """A rod that falls onto a stop, and a ball that falls onto a floor; both once."""
    stop = STOP.model_copy(update={"restitution": restitution})
    return (
        Problem(rod_pendulum(stop), 0.45, stop_law=StopLaw.UNILATERAL),
        Problem(bouncing(0.5, restitution), 0.34, stop_law=StopLaw.UNILATERAL),
    )


@pytest.mark.parametrize("restitution", RESTITUTIONS)
@pytest.mark.parametrize("kind", [0, 1])
def test_a_rebound_has_the_stops_restitution(kind: int, restitution: float) -> None:
    """Exudyn's impact model makes it; to a fiftieth, as its stiffness only follows the steps."""
    problem = falling(restitution)[kind]
    exact = solve(problem)
    run = made(SETTINGS).simulate(problem)
    assert len(exact.impacts) == 1
    after = run.t > exact.impacts[0][0] + 1e-3  # a contact lasts half of ten steps
    theirs = exact.trajectory(run.t[after & (run.t <= problem.duration)])
    mine = run.u[after & (run.t <= problem.duration)]
    assert np.abs(mine - theirs.u).max() <= 0.02 * np.abs(run.u).max()


@pytest.mark.parametrize("restitution", [0.0, *RESTITUTIONS])
@pytest.mark.parametrize("kind", [0, 1])
def test_the_force_of_a_stop_makes_the_change_of_momentum(kind: int, restitution: float) -> None:
    """Its integral, with that of gravity: also of the contact whose force Exudyn has no output of.

    Exudyn's trapezoidal rule is that of the integral, so that only the rounding of sums over
    impacts is left, and what Newton's iteration leaves of thousands of steps, 1e-8 each.
    """
    problem = falling(restitution)[kind]
    run = made(SETTINGS).simulate(problem)
    assert impulse(run) > 0
    assert momentum_gained(run) == pytest.approx(impulse(run), rel=1e-5)


def impulse(run: Trajectory) -> float:
    """Time integral of the only stop's torque or force [N m s, N s]."""
    (force,) = run.stop_torques.values()
    return float(np.trapezoid(force, run.t))


def momentum_gained(run: Trajectory) -> float:
    """Change of the only momentum along the stop's gap, less that by gravity [N m s, N s]."""
    (body,), g = run.mechanism.bodies, run.mechanism.gravity
    if body.angle is None:
        return float(body.mass * (run.u[-1, 0] - run.u[0, 0] + g * run.t[-1]))
    inertia = body.inertia + body.mass * body.centre[0] ** 2
    gravity = body.mass * g * body.centre[0] * np.cos(run.q[:, 0])
    (stop,) = run.mechanism.stops
    assert isinstance(stop, Stop)
    gained = inertia * (run.u[-1, 0] - run.u[0, 0]) - np.trapezoid(gravity, run.t)
    return float(stop.sense * gained)


@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS])
def test_a_stop_stays_for_the_whole_run(preset: str) -> None:
    """Under the release-once law, too: the arm's stop holds the arm after the launch."""
    problem = Problem(tb.fixed(), 3.2)
    run = made(preset, timestep=1e-3).simulate(problem)
    assert run.stop_torque("arm stop").max() > 0
    assert run.stop_gap("arm stop").min() > -0.05
    assert run.release_time("arm stop") is None


@pytest.mark.parametrize("name", ["fixed", "rolling"])
def test_the_softness_of_stops_falls_with_the_steps_square(name: str) -> None:
    """At a quarter of the step a rest gives way a sixteenth; a start in motion tells no step."""
    mechanism, depths = tb.model(name), list[float]()
    for step in (2e-3, 5e-4):
        run = made(SETTINGS, timestep=step).simulate(Problem(mechanism, 0.3))
        depths.append(-float(run.stop_gap("hanger rest")[-1]))
    assert depths[0] / depths[1] == pytest.approx(16.0, rel=0.05)


def test_a_point_that_goes_past_the_end_of_its_wall_is_no_result() -> None:
    ball = Body(name="ball", angle="a", mass=1.0, centre=(0, 0), inertia=0.1)
    stop = PointStop(name="floor", body="ball", point=(0, 0), normal=(0, 1), offset=0, closed=False)
    free = FreeJoint(
        name="free", child="ball", parent_point=(0, 0), child_point=(0, 0), coordinates=("x", "y")
    )
    mechanism = Mechanism(
        name="thrown", bodies=(ball,), joints=(free,), stops=(stop,), gravity=9.81,
        start=(0.0, 0.0, 1.0), start_speeds=(0.0, 1e6, 0.0),
    )  # fmt: skip
    with pytest.raises(tb.SimulationError, match=r"went past the end of its wall, .* our adapter"):
        made(DEFAULT).simulate(Problem(mechanism, 0.1, stop_law=StopLaw.UNILATERAL))


@pytest.mark.parametrize("start", [-0.1, 0.1])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_stop_that_is_closed_at_the_start_holds_or_opens(
    start: float, restitution: float
) -> None:
    """A rod that hangs beside the vertical, on the side of a stop or of the other one's."""
    down = np.pi / 2 + start
    stop = Stop(
        name="stop", body="rod", sense=1, limit=float(down), closed=True, restitution=restitution
    )
    problem = Problem(rod_pendulum(stop, start=float(down)), 0.3, stop_law=StopLaw.UNILATERAL)
    exact = solve(problem)
    assert (exact.release_times["stop"] is None) == (start > 0)
    run = made(SETTINGS).simulate(problem)
    there = exact.trajectory(run.t[run.t <= problem.duration])
    assert np.abs(run.q[: len(there.t)] - there.q).max() <= 1e-6


# --- What it does not do


def test_own_limits_are_not_switched() -> None:
    for options in ({}, {"locate_releases": False, "stop_stiffness": 1e9}):
        with pytest.raises(tb.InputError, match="own_limits"):
            ExudynEngine(own_limits=True, **options).simulate(Problem(tb.fixed(), 0.1))


def test_redundant_joints_are_too_many_for_the_default_and_not_for_the_settings() -> None:
    """Its default solver takes no dependent constraints; an option of its own leaves them out."""
    known = library_problem("three-cranks", None)
    assert known is not None
    problem = known.model_copy(update={"duration": 0.2})
    with pytest.raises(tb.SimulationError, match="gave up after t = "):
        made(DEFAULT).simulate(problem)
    made(SETTINGS).simulate(problem)
