"""The Taylor integrator: an integrator and an event finder that share neither steps nor roots with
DOP853.

Tolerances are the stated needs of two independent integrators: releases and launch 3e-13 relative
on Table I, 1e-11 s for releases and 1e-9 for the state at the launch on random machines. Compiled
once for each structure, which is why few structures are used here.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from mechanisms import (
    angle_stop,
    body_of,
    bouncing,
    everything,
    hanging_bob,
    parallel_cranks,
    pin,
    slider_crank,
)
from scipy.special import ellipk
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.elements import PrismaticJoint, SlotJoint
from trebucheck.models.mechanism import Mechanism
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor import batch as batch_module
from trebucheck.reference.taylor.batch import launch_batch
from trebucheck.reference.taylor.expressions import TaylorSystem, heyoka, why_not_taylor
from trebucheck.reference.taylor.numbers import numbers_of, structure_of
from trebucheck.reference.taylor.solve import _Integration, solve_taylor, taylor_quantities

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`

Build = Callable[[tb.TrebuchetParameters], tb.Mechanism]
RELATIVE, RELEASE, STATE = 3e-13, 1e-11, 1e-9


@pytest.fixture
def _heyoka() -> None:
    pytest.importorskip(
        "heyoka", reason="the Taylor integrator is optional: heyoka has wheels for Linux only"
    )


needs_heyoka = pytest.mark.usefixtures("_heyoka")


@needs_heyoka
def test_table_one_agrees_with_dop853(build: Build) -> None:
    problem = tb.Problem(build(tb.TrebuchetParameters()), duration=3.0)
    taylor, dop853 = solve_taylor(problem), solve(problem)
    for name in ("hanger rest", "sling rest"):
        assert taylor.release_times[name] == pytest.approx(
            dop853.release_times[name], rel=RELATIVE, abs=0
        )
    assert taylor.release_times["arm stop"] is None
    assert taylor.launch is not None and dop853.launch is not None
    assert taylor.launch.time == pytest.approx(dop853.launch.time, rel=RELATIVE, abs=0)
    t = np.linspace(0, dop853.launch.time, 700)
    first, second = taylor.trajectory(t), dop853.trajectory(t)
    for name in first.markers:
        apart = first.marker(name).position - second.marker(name).position
        assert np.abs(apart).max() < 1e-10  # [m], a stated need


@needs_heyoka
def test_the_launch_found_on_the_polynomial_is_that_of_the_solution(build: Build) -> None:
    problem = tb.Problem(build(tb.TrebuchetParameters()), duration=3.0)
    fast, scanned = taylor_quantities(problem, "double").launch, solve_taylor(problem).launch
    assert fast is not None and scanned is not None
    assert fast.time == pytest.approx(scanned.time, rel=1e-14, abs=0)  # some sixty roundings
    assert fast.speed == pytest.approx(scanned.speed, rel=1e-13, abs=0)


@needs_heyoka
def test_energy_is_kept_to_rounding(build: Build) -> None:
    solution = solve_taylor(tb.Problem(build(tb.TrebuchetParameters()), duration=3.0))
    assert solution.launch is not None
    energy = solution.trajectory(np.linspace(0, solution.launch.time, 1500)).total_energy
    assert np.abs(energy / energy[0] - 1).max() < 1e-13  # a stated need


@needs_heyoka
@given(parameters=machine_parameters())
def test_random_machines_agree_with_dop853(
    build: Build, parameters: tb.TrebuchetParameters
) -> None:
    problem = tb.Problem(build(parameters), duration=4.0)
    figures, dop853 = taylor_quantities(problem, "double"), solve(problem)
    # A projectile that never leaves its rest is not launched.
    launch = dop853.launch if dop853.release_times["sling rest"] is not None else None
    assert (launch is None) == (figures.launch_time is None)
    end = math.inf if launch is None else launch.time
    for name, expected in dop853.release_times.items():
        if expected is not None and expected < end:
            assert figures.release_times[name] == pytest.approx(expected, abs=RELEASE, rel=0)
    if launch is not None:
        motion = dop853.motion(np.array([launch.time]))
        assert figures.launch_q == pytest.approx(motion.q[0], abs=STATE)
        assert figures.launch_u == pytest.approx(motion.u[0], abs=STATE)


@needs_heyoka
@pytest.mark.skipif(
    np.finfo(np.longdouble).eps >= np.finfo(np.float64).eps,
    reason="this machine has no long double of its own",
)
def test_extended_precision_confirms_the_double_one() -> None:
    problem = tb.Problem(tb.fixed(), duration=3.0)
    double, extended = (
        taylor_quantities(problem, precision) for precision in ("double", "extended")
    )
    assert isinstance(extended.launch_time, np.longdouble)
    # Forty steps of a few roundings each; were "extended" computed in doubles, the two would be
    # equal.
    assert 0 < abs(extended.launch_time - double.launch_time) < 40 * np.finfo(np.float64).eps * 10
    # The checked figures' last printed digit.
    assert float(extended.launch_time) == pytest.approx(2.742817755771455, abs=1e-15)
    assert float(extended.start_torques["hanger rest"]) == pytest.approx(79630.193261, abs=5e-7)
    assert float(extended.start_torques["sling rest"]) == pytest.approx(2671.729500, abs=5e-7)
    assert extended.start_torques["arm stop"] == 0


@needs_heyoka
def test_impacts_agree_with_dop853() -> None:
    """The fixed machine under the unilateral law.

    Its arm meets the arm stop after the launch and bounces.
    """
    machine = tb.fixed()
    stops = [
        s.model_copy(update={"restitution": 0.5}) if s.name == "arm stop" else s
        for s in machine.stops
    ]
    machine = tb.Mechanism(**{**dict(machine), "stops": tuple(stops)})
    problem = tb.Problem(machine, duration=3.5, stop_law="unilateral")
    taylor, dop853 = solve_taylor(problem), solve(problem)
    assert len(taylor.impacts) == len(dop853.impacts) > 0
    for (time, impulses), (expected_time, expected) in zip(
        taylor.impacts, dop853.impacts, strict=True
    ):
        # After the launch errors grow with every swing: a stated need of 1e-9 s and 1e-7 relative.
        assert time == pytest.approx(expected_time, abs=1e-9)
        assert impulses == pytest.approx(expected, rel=1e-7, abs=1e-6)
    assert taylor.release_times == pytest.approx(dop853.release_times, abs=RELEASE)


@needs_heyoka
def test_a_motion_in_every_fourth_power_of_time_keeps_its_step_short() -> None:
    """From level, theta has t^2, t^6, t^10, ...

    Of any two neighbouring coefficients both may be zero.
    """
    problem = tb.Problem(hanging_bob(angle_stop(math.pi / 2)), duration=2.0, stop_law="unilateral")
    ((time, _),) = solve_taylor(problem).impacts
    assert time == pytest.approx(math.sqrt(2.0 / 9.81) * float(ellipk(0.5)), rel=1e-14)


@needs_heyoka
@pytest.mark.parametrize("e", [0.3, 0.7])
def test_bouncing_settles(e: float) -> None:
    """Down to rebounds of 1e-6 rad/s; a missed one would leave the bob beyond its stop."""
    problem = tb.Problem(
        hanging_bob(angle_stop(math.pi / 6, e)), duration=6.0, stop_law="unilateral"
    )
    taylor, dop853 = solve_taylor(problem), solve(problem)
    assert abs(len(taylor.impacts) - len(dop853.impacts)) <= 1
    # Rebounds above 1e-4 rad/s: flight times of 1e-5 s and more, located in angles rounded to
    # 1e-16.
    shared = [
        (a[0], b[0])
        for a, b in zip(taylor.impacts, dop853.impacts, strict=False)
        if a[1]["stop"] > 1e-3
    ]
    assert len(shared) > 5
    assert all(first == pytest.approx(second, abs=1e-10) for first, second in shared)
    end = taylor.motion(np.array([6.0]))
    assert end.q[0, 0] == pytest.approx(math.pi / 6, abs=1e-12)
    assert end.u[0, 0] == pytest.approx(0.0, abs=1e-12)


@needs_heyoka
def test_rattling_between_two_rests_ends() -> None:
    """Kicked at the start, two closed rests throw the machine to and fro.

    None may be lost on the way.
    """
    machine = tb.fixed()
    for kick in ((1e-4, 0.0, 0.0), (0.0, -1e-3, 0.0)):
        kicked = tb.Mechanism(**{**dict(machine), "start_speeds": kick})
        solution = solve_taylor(tb.Problem(kicked, duration=2.8, stop_law="unilateral"))
        trajectory = solution.trajectory(np.linspace(0.0, 2.5, 500))
        # As wide as the smallest rebound that is followed (1e-6 rad/s at an acceleration of 1
        # rad/s^2 and more).
        assert (
            min(trajectory.stop_gap(name).min() for name in ("hanger rest", "sling rest")) > -1e-12
        )
        assert solution.launch is not None


@pytest.mark.parametrize(
    ("gap", "speed", "time"),
    [
        (0.0, 1e-3, 1e-10),
        (1e-12, 1e-3, 1e-10),  # already clear, but within rounding of zero
        (-5e-11, 1e-3, 5.01e-8),  # it has to come up to zero first
        (-5e-11, 1e-6, 2e-6 / 9.81),  # it never does: 2 v / g later it has come back
        (-5e-11, 0.0, 1e-4),
        (0.0, 1e-9, 1e-4),  # standing
        (0.0, 1e-8, 2e-8 / 9.81),
    ],
)
def test_when_a_gap_that_opens_from_zero_is_clear(gap: float, speed: float, time: float) -> None:
    """A gap of 1e-13 m is clear."""
    problem = tb.Problem(bouncing(1.0, 0.5), duration=1.0, stop_law="unilateral")
    run = _Integration(problem, None, "double")
    run.initial = replace(run.initial, q=np.array([gap]), u=np.array([speed]))
    assert run._clearing_times() == {0: pytest.approx(time, rel=1e-9)}


@needs_heyoka
def test_a_loop_of_joints_holds() -> None:
    """A crank whose tip runs in a level slot, as in the closed forms.

    Against DOP853, and on its line.
    """
    mechanism = slider_crank(centres=((0.5, 0), (1.0, 0.1)))
    problem, t = tb.Problem(mechanism, duration=2.0), np.linspace(0, 2, 200)
    taylor, dop853 = solve_taylor(problem).motion(t), solve(problem).motion(t)
    assert np.abs(taylor.q - dop853.q).max() < 1e-10
    row = solve(problem).equations.kinematics.point("rod", (2, 0))
    assert np.abs(solve(problem).equations.kinematics.position(row, taylor.q)[:, 1]).max() < 1e-12


@needs_heyoka
def test_a_batch_is_its_machines_one_by_one(build: Build) -> None:
    """More machines than lanes.

    Among them one that drops a rest at the start and one that throws nothing in time.
    """
    parameters = [tb.TrebuchetParameters(l1=l1) for l1 in np.linspace(8.0, 12.5, 19)]
    parameters.append(
        tb.TrebuchetParameters(l1=12.9, l2=1.1)
    )  # beyond 12.725 on this beam a rest would have to pull
    parameters.append(tb.TrebuchetParameters(g=0.1))
    machines = [build(p) for p in parameters]
    batch = launch_batch(machines, duration=3.5)
    assert not batch.launched[-1] and np.isnan(batch.time[-1]) and np.isnan(batch.speed[-1])
    assert batch.launched[:-2].all()
    alone = launch_batch(machines[:1], duration=3.5)
    assert alone.time == pytest.approx(batch.time[:1], abs=1e-11)
    for i, machine in enumerate(machines):
        figures = taylor_quantities(tb.Problem(machine, duration=3.5), "double", tolerance=1e-12)
        assert batch.launched[i] == (figures.launch_time is not None)
        for name, released in figures.release_times.items():
            expected = math.nan if released is None else float(released)
            # The same tolerance, 1e-12 a step, over some forty steps.
            assert batch.release_times[name][i] == pytest.approx(expected, abs=1e-11, nan_ok=True)
        if figures.launch_time is not None:
            assert batch.time[i] == pytest.approx(float(figures.launch_time), abs=1e-11)
            assert batch.q[i] == pytest.approx(figures.launch_q, abs=1e-10)
            assert batch.u[i] == pytest.approx(figures.launch_u, abs=1e-9)


@needs_heyoka
def test_a_batch_in_pieces_is_the_whole_one(monkeypatch: pytest.MonkeyPatch) -> None:
    machines = [tb.fixed(tb.TrebuchetParameters(l1=l1)) for l1 in (9.0, 9.5, 10.0, 10.5, 11.0)]
    whole = launch_batch(machines, duration=3.5)
    monkeypatch.setattr(batch_module, "_CHUNK", 2)
    pieces = launch_batch(machines, duration=3.5)
    assert pieces.launched.all()
    assert pieces.time == pytest.approx(whole.time, abs=1e-11)
    assert pieces.q == pytest.approx(whole.q, abs=1e-10)
    for name, released in whole.release_times.items():
        assert pieces.release_times[name] == pytest.approx(released, abs=1e-11, nan_ok=True)
    with pytest.raises(tb.InputError, match=r"mechanisms\[3\] \('rolling'\)"):
        launch_batch([*machines[:3], tb.rolling()])


@needs_heyoka
def test_what_cannot_be_asked_for() -> None:
    problem = tb.Problem(tb.fixed(), duration=1.0)
    with pytest.raises(tb.InputError, match=r"tolerance = 0\.5"):
        solve_taylor(problem, tolerance=0.5)
    with pytest.raises(tb.InputError, match="precision = 'quad'"):
        solve_taylor(problem, precision="quad")  # type: ignore[arg-type]
    with pytest.raises(tb.InputError, match=r"mechanisms\[1\] \('rolling'\)"):
        launch_batch([tb.fixed(), tb.rolling()])
    with pytest.raises(tb.InputError, match="mechanisms is empty"):
        launch_batch([])


def test_without_heyoka_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "heyoka", None)
    machine = tb.fixed(tb.TrebuchetParameters())
    with pytest.raises(
        tb.EngineNotInstalledError, match=r"^the Taylor integrator needs heyoka.*brings it\.$"
    ):
        # Another tolerance than elsewhere here: what is compiled already needs no import.
        solve_taylor(tb.Problem(machine, duration=1.0), tolerance=3e-5)


def test_every_element_moves_as_by_dop853() -> None:
    """Slides on turning bodies, a wall that meets the bob, springs, dampers and motors."""
    mechanism = everything()
    deck = mechanism.stops[0].model_copy(update={"offset": 0.1})
    problem = tb.Problem(
        mechanism.model_copy(update={"stops": (deck,)}), duration=1.0, stop_law="unilateral"
    )
    taylor, solution = solve_taylor(problem), solve(problem)
    assert taylor.impacts
    assert [time for time, _ in taylor.impacts] == pytest.approx(
        [time for time, _ in solution.impacts], abs=RELEASE
    )
    times = np.linspace(0.0, 1.0, 9)
    assert taylor.motion(times).q == pytest.approx(solution.motion(times).q, abs=STATE)
    assert taylor.motion(times).u == pytest.approx(solution.motion(times).u, abs=STATE)


def test_loops_of_every_joint_have_the_accelerations_of_the_equations() -> None:
    """A slot in a turning body, a weld and a slider that close loops.

    Rows of three kinds, without compilation.
    """
    quick_return = Mechanism(
        name="loops",
        bodies=(
            body_of("crank", "a", 1.0, (0.15, 0.02), 0.01),
            body_of("rocker", "b", 2.0, (0.6, 0.0), 0.2),
            body_of("rod", "c", 0.5, (0.3, 0.1), 0.03),
            body_of("block", "d", 0.7, (0.1, 0.0), 0.02),
        ),
        joints=(
            pin("O", "ground", "crank", (1.0, 0)),
            pin("C", "ground", "rocker"),
            SlotJoint(
                name="slot",
                parent="rocker",
                child="crank",
                parent_point=(0, 0),
                child_point=(0.3, 0),
                axis=(1, 0),
            ),
            pin("P", "rocker", "rod", (1.5, 0)),
            pin("Q", "rod", "block", (0.8, 0)),
            PrismaticJoint(
                name="rail",
                parent="ground",
                child="block",
                parent_point=(2.3, 0),
                child_point=(0, 0),
                axis=(1, 0),
            ),
        ),
        gravity=9.81,
        start=(0.0, 0.0, 0.0, 0.0),
    )
    problem = tb.Problem(quick_return, duration=1.0)
    equations = Equations(quick_return)
    numbers = numbers_of(problem, equations.kinematics, np.float64)
    structure = structure_of(problem, equations.kinematics, numbers != 0)
    assert {type(row) for row in structure.loop_rows} == {int, type(None), tuple}
    q, u = np.array([0.7, 0.2, -0.4, 0.1]), np.array([1.0, -0.3, 0.5, 0.8])
    system = TaylorSystem(structure)
    solved = heyoka().cfunc(system.solved, [*system.q, *system.u], compact_mode=True)
    found = solved(np.concatenate([q, u]), pars=numbers[numbers != 0])
    accelerations, multipliers = equations.solve(q, u, ())
    assert found == pytest.approx(
        np.concatenate([accelerations, -multipliers]), rel=1e-12, abs=1e-11
    )


def test_auto_says_why_it_does_not_take_taylor_series() -> None:
    n = 40
    chain = Mechanism(
        name="chain",
        bodies=tuple(body_of(f"link {i}", f"a{i}", 1.0, (0.5, 0.0), 0.1) for i in range(n)),
        joints=tuple(
            pin(f"pin {i}", f"link {i - 1}" if i else "ground", f"link {i}", (1.0 if i else 0.0, 0))
            for i in range(n)
        ),
        gravity=9.81,
        start=(0.1,) * n,
    )
    assert why_not_taylor(tb.Problem(tb.fixed(), duration=1.0)) is None
    assert "products" in (why_not_taylor(tb.Problem(chain, duration=1.0)) or "")
    repeated = why_not_taylor(tb.Problem(parallel_cranks(3), duration=1.0))
    assert repeated == "its constraints depend on each other"
    solution = ReferenceEngine(integrator="auto").solve(tb.Problem(chain, duration=0.01))
    assert "products" in str(solution.settings["integrator"])


def test_numbers_that_move_nothing_are_no_parameters() -> None:
    problem = tb.Problem(random_mechanism(6), duration=0.2)
    expected = solve(problem).motion(np.array([0.2])).q
    assert solve_taylor(problem).motion(np.array([0.2])).q == pytest.approx(expected, abs=STATE)
