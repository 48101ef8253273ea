"""What is particular to the Exudyn engine.

Each trap it avoids, its order, its releases, its limits.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import again
from mechanisms import (
    TABLE_ONE,
    chain,
    four_bar,
    hanging_bob,
    position_error,
    rod_pendulum,
    rods_on_a_slot,
    table_one_motion,
)
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.elements import PointStop, Stop
from trebucheck.models.errors import InputError, SimulationError, UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.trebuchet import (
    HANGER_REST,
    SLING_REST,
    TrebuchetParameters,
    fixed,
    rolling,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

pytest.importorskip("exudyn")

from trebucheck.engines.exudyn.build import build
from trebucheck.engines.exudyn.motion import ExudynMotion
from trebucheck.engines.exudyn.solver import Solver, is_at

ONE = Stop(name="one", body="upper", sense=-1, limit=-0.5, closed=True)
TWO = Stop(name="two", body="lower", relative_to="upper", sense=1, limit=-0.3, closed=True)


def double_pendulum(*stops: Stop, **changes: object) -> Mechanism:
    """Two rods on a tilted slot, the lower one without an inertia of its own."""
    return rods_on_a_slot(*stops, inertia=0, tip=(0.5, 0.2), **changes)


@pytest.fixture(scope="module", params=TABLE_ONE)
def reference(request: pytest.FixtureRequest) -> Solution:
    """Reference motion of Table I, up to the launch."""
    return table_one_motion(request.param)


def test_tuned_at_its_own_step_stays_within_the_bars(reference: Solution) -> None:
    run = ExudynEngine().simulate(reference.problem)
    exact = reference.trajectory(run.t)
    assert position_error(run, reference) <= 1e-5
    for name in (HANGER_REST, SLING_REST):
        assert np.abs(run.stop_torque(name) - exact.stop_torque(name)).max() <= 2e-3
        # Second order, found 2e-10 to 4e-10 s; the bar is 1e-7.
        assert run.release_time(name) == pytest.approx(exact.release_time(name), abs=1e-8)
    energy = exact.total_energy[0]
    assert np.abs(run.total_energy - energy).max() <= 1e-6 * abs(energy)
    for name, force in run.joint_reactions.items():
        scale = np.abs(exact.joint_reactions[name]).max()
        assert (
            np.abs(force - exact.joint_reactions[name]).max() <= 3e-6 * scale
        )  # found 1.3e-6 = 130 h^2


def test_the_order_is_two(reference: Solution) -> None:
    steps = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    runs = [ExudynEngine(timestep=step).simulate(reference.problem) for step in steps]
    errors = [position_error(run, reference) for run in runs]
    gaps = [max(gap.max() for gap in run.joint_gaps.values()) for run in runs]
    for series in (errors, gaps):
        assert np.polyfit(np.log(steps), np.log(series), 1)[0] == pytest.approx(2.0, abs=0.1)


def test_release_times_are_of_order_two_too(reference: Solution) -> None:
    coarse, fine = (
        ExudynEngine(timestep=step).simulate(reference.problem) for step in (4e-3, 1e-3)
    )
    for name in (HANGER_REST, SLING_REST):
        exact = reference.release_times[name]
        assert exact is not None
        errors = [abs((run.release_time(name) or 0.0) - exact) for run in (coarse, fine)]
        assert errors[0] / errors[1] == pytest.approx(16, rel=0.3)


def test_stop_torques_are_right_from_the_first_sample(reference: Solution) -> None:
    run = ExudynEngine(timestep=1e-2).simulate(reference.problem)
    exact = reference.trajectory(np.zeros(1))
    for name in (HANGER_REST, SLING_REST):
        # Rounding of two extrapolated solves; no trace of the coarse step.
        assert run.stop_torque(name)[0] == pytest.approx(exact.stop_torque(name)[0], rel=1e-10)
    for name, force in run.joint_reactions.items():
        assert force[0] == pytest.approx(exact.joint_reactions[name][0], rel=1e-9, abs=1e-6)


def test_a_torque_pushes_until_its_release_and_is_zero_from_there(reference: Solution) -> None:
    run = ExudynEngine(timestep=1e-3).simulate(reference.problem)
    for name in (HANGER_REST, SLING_REST):
        release, torque = run.release_time(name), run.stop_torque(name)
        assert release is not None
        assert release in run.t
        assert (torque[run.t < release] > 0).all()
        assert (torque[run.t >= release] == 0).all()
    assert run.release_time("arm stop") is None
    assert not run.stop_torque("arm stop").any()


def test_times_are_equal_steps_that_end_at_the_end(reference: Solution) -> None:
    run = ExudynEngine(timestep=1e-3).simulate(reference.problem)
    steps = np.diff(run.t)
    assert run.t[0] == 0.0
    assert run.t[-1] == reference.problem.duration
    # Only the two steps onto each of the two releases may be shorter, and not below half a step.
    assert np.sum(steps < 0.999e-3) <= 4
    assert steps.min() >= 0.5e-3 * (1 - 1e-9)
    assert steps.max() <= 1e-3 * (1 + 1e-9)


INDEX_3 = {
    "integrator": "generalized-alpha-index-3",
    "newton_relative": 1e-8,
    "newton_absolute": 1e-10,
    "modified_newton": True,
    "adaptive_step": True,
}


def test_without_location_stops_open_at_the_end_of_a_step() -> None:
    engine = ExudynEngine(timestep=1e-3, locate_releases=False, **INDEX_3)
    run = engine.simulate(Problem(fixed(), 1.5))
    for name in (HANGER_REST, SLING_REST):
        release = run.release_time(name)
        assert release is not None
        assert release / engine.timestep == pytest.approx(
            round(release / engine.timestep), abs=1e-6
        )
    exact = {HANGER_REST: 1.194940568904336, SLING_REST: 1.437345284636296}  # PHYSICS.md
    assert all(
        abs((run.release_time(name) or 0) - time) <= 2 * engine.timestep
        for name, time in exact.items()
    )
    # Index 3 holds the joints' positions, to Newton's tolerance, where index 2 lets them drift by
    # 1e-5 m.
    assert max(gap.max() for gap in run.joint_gaps.values()) <= 1e-9


def test_a_stop_that_would_have_to_pull_is_gone_at_the_start() -> None:
    # Beyond l1 = 12.7255 m the hanger's rest would have to pull (PHYSICS.md); the sling's then
    # pushes by itself.
    problem = Problem(fixed(TrebuchetParameters.with_beam(12.8)), 0.5)
    run, exact = ExudynEngine(timestep=1e-3).simulate(problem), solve(problem)
    assert run.release_time(HANGER_REST) == 0.0
    assert run.release_time(SLING_REST) == exact.release_times[SLING_REST]
    torque = exact.trajectory(np.zeros(1)).stop_torque(SLING_REST)[0]
    assert run.stop_torque(SLING_REST)[0] == pytest.approx(torque, rel=1e-9)
    assert not run.stop_torque(HANGER_REST).any()


@pytest.mark.parametrize("seed", range(8))
def test_all_stops_are_decided_at_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-3, 3, 2)
    senses = rng.choice([-1, 1], 2)
    stops = (
        Stop(name="one", body="upper", sense=int(senses[0]), limit=senses[0] * a, closed=True),
        Stop(
            name="two",
            body="lower",
            relative_to="upper",
            sense=int(senses[1]),
            limit=senses[1] * (b - a),
            closed=True,
        ),
    )
    problem = Problem(double_pendulum(*stops, start=(a, b, 0.6)), 0.01)
    run, exact = ExudynEngine(timestep=1e-3).simulate(problem), solve(problem)
    assert run.release_times == exact.release_times
    start = exact.trajectory(np.zeros(1))
    for stop in stops:
        assert run.stop_torque(stop.name)[0] == pytest.approx(
            start.stop_torque(stop.name)[0], rel=1e-8, abs=1e-9
        )


def test_a_tilted_slot_does_not_turn_with_its_body_and_speeds_may_start_anywhere() -> None:
    problem = Problem(double_pendulum(start_speeds=(1.0, -2.0, 0.3)), 1.0)
    runs = [ExudynEngine(timestep=step).simulate(problem) for step in (2e-3, 1e-3)]
    errors: list[list[float]] = []
    for run in runs:
        exact = solve(problem).trajectory(run.t)
        reactions = [
            np.abs(run.joint_reactions[n] - exact.joint_reactions[n]).max() for n in ("slot", "pin")
        ]
        speeds = np.abs(run.marker("tip").velocity - exact.marker("tip").velocity).max()
        errors.append(
            [*reactions, speeds, np.abs(run.q - exact.q).max(), np.abs(run.u - exact.u).max()]
        )
    assert max(errors[1]) <= 1e-2  # of forces up to 1e2 N at h = 1e-3
    assert np.divide(*errors) == pytest.approx(
        4.0, rel=0.1
    )  # order two, so nothing is merely nearly right


def test_loops_are_joints_like_any_other() -> None:
    problem = Problem(four_bar(), 1.0)
    errors: list[list[float]] = []
    for step in (2e-3, 1e-3):
        run = ExudynEngine(timestep=step).simulate(problem)
        exact = solve(problem).trajectory(run.t)
        errors.append(
            [
                np.abs(run.q - exact.q).max(),
                np.abs(run.joint_reactions["C"] - exact.joint_reactions["C"]).max(),
            ]
        )
        assert set(run.joint_gaps) == {"A", "B", "C", "D"}
    assert np.divide(*errors) == pytest.approx(4.0, rel=0.1)


def test_nothing_is_printed_and_no_file_is_written(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exudyn = pytest.importorskip("exudyn")
    monkeypatch.chdir(tmp_path)
    before = exudyn.config.printToConsole
    for preset in ExudynEngine.presets().values():
        preset(timestep=1e-2).simulate(Problem(fixed(), 1.6))
    with pytest.raises(SimulationError):
        _hopeless().simulate(Problem(fixed(), 0.1))
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())
    assert exudyn.config.printToConsole == before


def _hopeless() -> ExudynEngine:
    return ExudynEngine(timestep=1e-2, newton_relative=1e-300, newton_absolute=1e-300)


def test_a_failed_step_is_one_sentence() -> None:
    with pytest.raises(
        SimulationError,
        match=r"^exudyn's trapezoidal-index-2 solver gave up after t = 0 s of 0\.1 s; .*\.$",
    ):
        _hopeless().simulate(Problem(fixed(), 0.1))


@pytest.mark.parametrize("raises", [False, True])
def test_a_failed_solve_leaves_no_accelerations_of_an_earlier_state(
    raises: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.engines.exudyn.build import build
    from trebucheck.engines.exudyn.read import exu
    from trebucheck.engines.exudyn.solver import Solver

    class FailingSolver:
        def InitializeSolver(self, *_: object) -> bool:  # noqa: N802
            if raises:
                raise RuntimeError("a page of text")
            return False

    solver = Solver(build(double_pendulum()), ExudynEngine())
    start = solver.start()
    assert np.isfinite(solver.balance(start, ()).accelerations).all()  # these stay in the system
    monkeypatch.setattr(exu, "MainSolverImplicitSecondOrder", FailingSolver)
    with pytest.raises(SimulationError, match="no accelerations at t = 0 s"):
        solver.balance(start, ())


def test_a_second_run_gives_the_same_bits() -> None:
    first, second = (
        ExudynEngine(timestep=1e-2).simulate(Problem(rolling(), 2.0)) for _ in range(2)
    )
    assert np.array_equal(first.q, second.q)
    assert np.array_equal(first.stop_torque(SLING_REST), second.stop_torque(SLING_REST))


def test_a_long_run_has_no_step_of_rounding_at_its_end() -> None:
    """Exudyn adds up its steps.

    The sum of these is 2e-12 s short, and a step over that has no solution.
    """
    duration = 21.1302
    engine = ExudynEngine(timestep=4e-3, locate_releases=False, **INDEX_3)
    found = engine.simulate(Problem(hanging_bob(start=1.2), duration))
    assert found.t[-1] == duration and np.diff(found.t).min() > 3e-3


def test_a_closed_stop_whose_gap_moves_is_refused() -> None:
    mechanism = double_pendulum(ONE, TWO, start_speeds=(0.0, 0.5, 0.0))
    with pytest.raises(UnsupportedProblemError, match="'two' closed while its gap changes"):
        ExudynEngine().simulate(Problem(mechanism, 0.1))


def test_the_laws_agree_until_a_stop_is_met() -> None:
    once, again = (
        ExudynEngine(timestep=1e-3).simulate(Problem(fixed(), 2.0, stop_law=law)) for law in StopLaw
    )
    assert again.impacts == ()
    assert again.release_times == pytest.approx(once.release_times, abs=1e-9)
    assert np.abs(again.q - once.q).max() <= 1e-9  # of rounding, amplified by the throw


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("integrator", "rk4"),
        ("spectral_radius", 1.0),
        ("newton_relative", 0.0),
        ("newton_absolute", 1.0),
        ("step", 1e-3),
    ],
)
def test_a_wrong_option_is_named(option: str, value: object) -> None:
    with pytest.raises(InputError, match=option):
        ExudynEngine(**{option: value})


@again  # as test_front_door.py asks of all engines
def test_the_class_does_not_load_exudyn() -> None:
    code = (
        "import sys, trebucheck.engines.exudyn.engine as m; E = m.ExudynEngine; E.version(); "
        "E.is_installed(); E()"
    )
    subprocess.run(
        [sys.executable, "-c", f"{code}; assert 'exudyn' not in sys.modules"], check=True, cwd="/"
    )


@pytest.mark.parametrize("end", [1e-3, 0.5, 1.0, 8.0])
def test_the_end_of_a_run_is_met_to_a_billionth_of_its_time_or_of_a_second(end: float) -> None:
    for one in (-1e-9 * max(1.0, end), 1e-9 * max(1.0, end)):
        assert is_at(end + 0.9 * one, end) and not is_at(end + 1.1 * one, end)


def test_a_step_without_iterations_is_of_second_order() -> None:
    """Its error is of third order in its length, in angles and speeds."""
    mechanism = rod_pendulum(start=0.3).model_copy(update={"start_speeds": (1.5,)})
    exact, errors = solve(Problem(mechanism, 0.1)), list[np.ndarray]()
    for step in (0.08, 0.04):
        solver = Solver(build(mechanism), ExudynEngine())
        first, last = solver._explicit_step(solver.start(), (), step)  # pyright: ignore[reportPrivateUsage]
        assert solver.steps == 1 and (first[0], last[0]) == (0.0, step)
        right = exact.trajectory(np.array([0.0, step]))
        assert np.ravel(solver.coordinates(first)) == pytest.approx([0.3, 1.5], abs=1e-12)
        errors.append(np.ravel(solver.coordinates(last)) - [right.q[1, 0], right.u[1, 0]])
    assert np.abs(errors[0] / errors[1]) == pytest.approx(8.0, rel=0.15)


def test_gaps_by_the_bodies_sensors_are_those_of_the_coordinates() -> None:
    """With their speeds and accelerations: of angles and points, from the ground and from a body.

    Stops are so far open that none acts.
    """
    stops = (
        Stop(name="angle", body="upper", sense=-1, limit=-9.0, closed=False),
        Stop(name="between", body="lower", relative_to="upper", sense=1, limit=-9.0, closed=False),
        PointStop(
            name="floor", body="lower", point=(0.3, -0.8), normal=(0.6, 0.8), offset=-9.0,
            closed=False,
        ),
        PointStop(
            name="shelf", body="lower", relative_to="upper", point=(0.2, 0.7), normal=(-0.8, 0.6),
            offset=-9.0, closed=False,
        ),
    )  # fmt: skip
    problem = Problem(chain(*stops), 0.1, stop_law=StopLaw.UNILATERAL)
    motion, kinematics = ExudynMotion(problem, ExudynEngine()), Kinematics(problem.mechanism)
    q, u = (np.array(x) for x in (problem.mechanism.start, problem.mechanism.start_speeds))
    a, _ = Equations(problem.mechanism).solve(q, u, ())
    balance = motion.solver.balance(motion.now, ())
    values = motion.solver.values(balance.row)
    for stop in stops:
        constraint, row = (
            motion.system.constraints[stop.name],
            kinematics.gap_jacobian(stop.name, q),
        )
        right = float(row @ a) + float(kinematics.gap_bias(stop.name, q, u))
        assert constraint.gap(values) == pytest.approx(float(kinematics.gap(stop.name, q)))
        assert constraint.gap_speed(values) == pytest.approx(float(row @ u))
        assert motion._opening(stop.name, balance) == pytest.approx(right, rel=1e-6)


@pytest.mark.parametrize(
    ("steps", "wanted", "rows", "kept"),
    [(5, 4.3, 6, 4), (5, 3.4, 6, 4), (5, 3.0, 4, 4), (5, 9.0, 6, 6), (1, 0.6, 2, 1), (1, 0, 1, 1)],
)
def test_steps_onto_an_event_begin_two_steps_back(
    steps: int, wanted: float, rows: int, kept: int
) -> None:
    """Whole steps before are as they were; beyond the last one is no event."""
    step = 1e-3
    motion = ExudynMotion(Problem(rod_pendulum(start=0.3), 0.1), ExudynEngine(timestep=step))
    table = motion._run(steps * step, None)
    time, cut = motion._onto(table, lambda _: wanted * step)
    assert time == pytest.approx(min(wanted, steps) * step, abs=1e-12) and cut[-1, 0] == time
    assert len(cut) == rows and np.array_equal(cut[:kept], table[:kept])
