"""Sensitivities against differences of the solver's own figures, and against what scaling and
symmetry demand.

Identities hold to the stated need of 1e-9, relative to the largest term that enters them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters, machines
from hypothesis import assume, given
from mechanisms import slider_crank
from scipy.linalg import null_space
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.trebuchet import whipper_numbers
from trebucheck.models.stacked import numbers
from trebucheck.reference.equations import Equations
from trebucheck.reference.sensitivity.release import (
    Sensitivities,
    marker_tangent,
    parameter_directions,
    state_tangent,
    whipper_sensitivities,
)
from trebucheck.reference.sensitivity.variational import VariationalEquations
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow  # many machines, or many integrations: not in `make quick`

Build = Callable[[tb.TrebuchetParameters], tb.Mechanism]
LENGTHS, MASSES = ("l1", "l2", "r", "h"), ("m_b", "m_cw", "m_a")
RESTS = ("hanger rest", "sling rest")
IDENTITY = 1e-9

# Steps relative to the value (absolute below 1). The solver's own error is that of values off by
# some 1e-13 (its releases and launch are known to that), times 1 / h in a difference; what
# truncation leaves, the extrapolation tells.
STEP, SOLVER = 1e-4, 1e-13
STEPS = (1, 2, 4)  # times that
NEED = 1e-6  # stated need: relative agreement with the differences
BLIND = 1e-4  # differences that know less than this of themselves would prove nothing


@pytest.fixture(scope="module", params=[tb.fixed, tb.rolling], ids=["fixed", "rolling"])
def table_one(request: pytest.FixtureRequest) -> tuple[Build, Sensitivities]:
    return request.param, whipper_sensitivities(request.param)


def figures(mechanism: tb.Mechanism, duration: float) -> np.ndarray:
    """Launch time, speed, range in vacuum, release times (NaN where there was none before the
    launch).
    """
    solution = solve(tb.Problem(mechanism, duration=duration))
    launch = solution.launch
    assert launch is not None
    x, y = solution.trajectory(np.array([launch.time])).marker("projectile").position[0]
    vx, vy = launch.velocity
    fall = (vy + math.sqrt(vy**2 + 2 * mechanism.gravity * y)) / mechanism.gravity
    times = [solution.release_times[name] for name in RESTS]
    opened = [t if t is not None and 0 < t < launch.time else math.nan for t in times]
    return np.array([launch.time, launch.speed, x + vx * fall, *opened])


def figures_of_all(mechanisms: Sequence[tb.Mechanism], duration: float) -> np.ndarray:
    """A row of :func:`figures` each.

    By a batch of Taylor series where heyoka is here, which takes a tenth.
    """
    if find_spec("heyoka") is None:
        return np.array([figures(mechanism, duration) for mechanism in mechanisms])
    from trebucheck.reference.taylor.batch import launch_batch

    found = launch_batch(mechanisms, duration, tolerance=2.3e-16)
    assert found.launched.all()
    rows = []
    for k, mechanism in enumerate(mechanisms):
        kinematics, thrown = Kinematics(mechanism), mechanism.marker("projectile")
        assert thrown is not None
        x, y = kinematics.position(kinematics.point(thrown.body, thrown.point), found.q[k])
        vx, vy = found.velocity[k]
        fall = (vy + math.sqrt(vy**2 + 2 * mechanism.gravity * y)) / mechanism.gravity
        times = [found.release_times[name][k] for name in RESTS]
        opened = [t if 0 < t < found.time[k] else math.nan for t in times]
        rows.append([found.time[k], found.speed[k], x + vx * fall, *opened])
    return np.array(rows)


def changed(build: Build, p: tb.TrebuchetParameters, name: str, step: float) -> tb.Mechanism:
    if name in tb.TrebuchetParameters.model_fields:
        return build(p.model_copy(update={name: getattr(p, name) + step}))
    mechanism = build(p)
    if name == "x_p0":
        return mechanism.model_copy(
            update={"start": (*mechanism.start[:3], mechanism.start[3] + step)}
        )
    kick = np.array([step * (f"u_{c}" == name) for c in mechanism.coordinates])
    return mechanism.model_copy(
        update={"start_speeds": tuple((let_through(mechanism) @ kick).tolist())}
    )


@cache
def let_through(mechanism: tb.Mechanism) -> np.ndarray:
    """The mass-metric projector on speeds that keep the rests closed which hold at the start."""
    solution = solve(tb.Problem(mechanism, duration=1e-3))
    equations, closed, q = (
        Equations(mechanism),
        solution.segments[0].closed,
        np.array(mechanism.start),
    )
    mass = equations.mass_matrix(q)
    basis = null_space(equations.constraint_jacobian(q, closed)) if closed else np.eye(len(q))
    return basis @ np.linalg.solve(basis.T @ mass @ basis, basis.T @ mass)


def differences(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Central differences, extrapolated twice (Richardson: O(step^6)), and how far the last one
    went.

    Args:
        values: figures at 1, 2 and 4 steps above, then as many below.
        step: of the value.
    """
    first, second, third = (values[:3] - values[3:]) / (2 * step * np.array(STEPS)[:, None])
    fine, coarse = (4 * first - second) / 3, (4 * second - third) / 3
    best = (16 * fine - coarse) / 15
    return best, np.abs(best - fine)


def assert_differences_agree(
    build: Build, p: tb.TrebuchetParameters, found: Sensitivities, leave_out: tuple[str, ...] = ()
) -> None:
    duration = found.launch_time + 0.1
    exact = np.array(
        [
            found.d_launch_time,
            found.d_launch_speed,
            found.d_range,
            *(found.d_release_times[r] for r in RESTS),
        ]
    )
    scale = np.maximum(np.abs(found.values), 1.0)
    kept = [(i, name) for i, name in enumerate(found.names) if name not in leave_out]
    machines = [
        changed(build, p, name, sign * k * STEP * scale[i])
        for i, name in kept
        for sign in (1, -1)
        for k in STEPS
    ]
    nominal, *others = figures_of_all([build(p), *machines], duration)
    noise = SOLVER * (np.abs(nominal) + np.abs(exact) @ scale)
    for (i, name), values in zip(
        kept, np.reshape(others, (len(kept), 2 * len(STEPS), -1)), strict=True
    ):
        step = STEP * scale[i]
        expected, truncation = differences(values, step)
        # Own error of the differences, or the stated need, whichever is larger.
        own = truncation + noise / step
        assert not (own > BLIND * np.maximum(np.abs(expected), np.abs(nominal))).any(), (
            name,
            expected,
            own,
        )
        tolerance = np.maximum(NEED * np.abs(expected), own)
        assert np.array_equal(np.isnan(exact[:, i]), np.isnan(expected)), name
        wrong = np.abs(exact[:, i] - expected) > tolerance
        assert not wrong.any(), (name, exact[:, i], expected, tolerance)


def test_names_and_figures(table_one: tuple[Build, Sensitivities]) -> None:
    build, found = table_one
    coordinates = build(tb.TrebuchetParameters()).coordinates
    slides = ("x_p0",) if build is tb.rolling else ()
    expected = (*tb.TrebuchetParameters.model_fields, *(f"u_{c}" for c in coordinates), *slides)
    assert found.names == expected
    checked = figures(build(tb.TrebuchetParameters()), 3.0)
    # The solver's own figures, to its stated accuracy times the number of figures' conditioning
    # (about 10).
    assert [found.launch_time, found.launch_speed, found.range] == pytest.approx(
        checked[:3], rel=1e-11
    )
    assert np.isnan(found.d_release_times["arm stop"]).all()


def test_table_one_against_differences(table_one: tuple[Build, Sensitivities]) -> None:
    build, found = table_one
    assert_differences_agree(build, tb.TrebuchetParameters(), found)


@machines(2)
@given(p=machine_parameters())
def test_random_machines_against_differences(build: Build, p: tb.TrebuchetParameters) -> None:
    assume(solve(tb.Problem(build(p), duration=4.0)).launch is not None)
    assert_differences_agree(build, p, whipper_sensitivities(build, p))


def test_a_rest_gone_at_the_start_against_differences() -> None:
    """Beyond l1 = 12.73 m of the beam's 14 the fixed machine's hanger rest would have to pull.

    It is gone at t = 0.
    """
    p = tb.TrebuchetParameters.with_beam(13.3)
    found = whipper_sensitivities(tb.fixed, p)
    assert np.isnan(found.d_release_times["hanger rest"]).all()
    assert not np.isnan(found.d_release_times["sling rest"]).any()
    # A kick towards the rest that has gone would still strike it: there is no difference to both
    # sides.
    kicks = tuple(name for name in found.names if name.startswith("u_"))
    assert_differences_agree(tb.fixed, p, found, leave_out=kicks)


def homogeneity(
    found: Sensitivities, names: tuple[str, ...], derivative: np.ndarray, figure: float
) -> tuple[float, float]:
    """Degree of homogeneity in the named values, and the largest term of the sum."""
    terms = [found.values[i] * derivative[i] / figure for i in map(found.names.index, names)]
    return sum(terms), max(map(abs, terms))


def assert_degrees(
    found: Sensitivities, names: tuple[str, ...], time: float, speed: float, range_: float
) -> None:
    rows = [
        (found.d_launch_time, found.launch_time, time),
        (found.d_launch_speed, found.launch_speed, speed),
        (found.d_range, found.range, range_),
    ]
    for derivative, figure, degree in rows:
        sum_, largest = homogeneity(found, names, derivative, figure)
        assert sum_ == pytest.approx(degree, abs=IDENTITY * max(1.0, largest))


@given(p=machine_parameters())
@machines(5)
def test_scaling(build: Build, p: tb.TrebuchetParameters) -> None:
    """Time and speed go with the root of the size and of 1/g and g, range with the size.

    Masses cancel.
    """
    assume(solve(tb.Problem(build(p), duration=4.0)).launch is not None)
    found = whipper_sensitivities(build, p)
    assert_degrees(found, LENGTHS, 0.5, 0.5, 1.0)
    assert_degrees(found, ("g",), -0.5, 0.5, 0.0)
    assert_degrees(found, MASSES, 0.0, 0.0, 0.0)


def test_release_times_scale_like_the_launch_s(table_one: tuple[Build, Sensitivities]) -> None:
    build, found = table_one
    times = solve(tb.Problem(build(tb.TrebuchetParameters()), duration=2.0)).release_times
    for name in RESTS:
        time = times[name]
        assert time is not None
        for names, degree in ((LENGTHS, 0.5), (("g",), -0.5), (MASSES, 0.0)):
            sum_, largest = homogeneity(found, names, found.d_release_times[name], time)
            assert sum_ == pytest.approx(degree, abs=IDENTITY * max(1.0, largest))


def test_a_head_start_shifts_all_times_and_nothing_else(
    table_one: tuple[Build, Sensitivities],
) -> None:
    """At rest, start speeds a(0) s are where the machine itself is a time s later: autonomy."""
    build, found = table_one
    motion = solve(tb.Problem(build(tb.TrebuchetParameters()), duration=0.1)).motion(np.zeros(1))
    u = [i for i, name in enumerate(found.names) if name.startswith("u_")]
    for d_time in (found.d_launch_time, *(found.d_release_times[name] for name in RESTS)):
        assert d_time[u] @ motion.a[0] == pytest.approx(-1.0, abs=IDENTITY)
    for derivative in (found.d_launch_speed, found.d_range):
        largest = np.abs(derivative[u] * motion.a[0]).max()
        assert abs(derivative[u] @ motion.a[0]) < IDENTITY * max(1.0, largest)


def test_moving_the_rolling_machine_moves_its_range() -> None:
    found = whipper_sensitivities(tb.rolling)
    i = found.names.index("x_p0")
    assert found.d_range[i] == pytest.approx(1.0, abs=1e-12)  # nothing but rounding enters
    assert found.d_launch_time[i] == found.d_launch_speed[i] == 0.0


def test_a_rolling_frame_of_reference() -> None:
    """A kick to x_p alone moves everything at that speed (Galilei).

    Rests open when they did, the direction turns.
    """
    found = whipper_sensitivities(tb.rolling)
    i = found.names.index("u_x_p")
    for name in RESTS:
        assert found.d_release_times[name][i] == pytest.approx(0.0, abs=1e-12)
    solution = solve(tb.Problem(tb.rolling(), duration=3.0))
    row = solution.equations.kinematics.point("sling", (6.0, 0.0))
    at = solution.motion(np.array([found.launch_time]))
    ax, ay = solution.equations.kinematics.acceleration(row, at.q, at.u, at.a)[0]
    assert found.d_launch_time[i] == pytest.approx(1.0 / (ay - ax), rel=IDENTITY)


@pytest.mark.parametrize(("coordinate", "kick"), [("theta", -1e-4), ("phi", 1e-4)])
def test_a_kick_that_the_rests_take_up_by_impacts(coordinate: str, kick: float) -> None:
    """The whole kick, under the unilateral law: what is left of it once both rests hold again."""
    found, machine = whipper_sensitivities(tb.fixed), tb.fixed()
    speeds = tuple(kick * (name == coordinate) for name in machine.coordinates)
    kicked = machine.model_copy(update={"start_speeds": speeds})
    launch = solve(tb.Problem(kicked, duration=3.0, stop_law="unilateral")).launch
    assert launch is not None
    expected = found.d_launch_time[found.names.index(f"u_{coordinate}")]
    # A one-sided difference: its error is of the order of the kick, relative to some rad/s of the
    # motion.
    assert (launch.time - found.launch_time) / kick == pytest.approx(expected, rel=10 * abs(kick))


def test_the_state_s_rate_does_not_jump_at_a_release(build: Build) -> None:
    """So the tangent's jump there, (f_after - f_before) dt_release, is zero (saltation is the
    identity).
    """
    solution = solve(tb.Problem(build(tb.TrebuchetParameters()), duration=3.0))
    assert len(solution.segments) > 2
    for before, after in zip(solution.segments[:-1], solution.segments[1:], strict=True):
        y = np.asarray(before.interpolant(before.end))
        q, u = np.split(y, 2)
        old, new = (
            solution.equations.solve(q, u, segment.closed)[0] for segment in (before, after)
        )
        assert (
            np.abs(new - old).max() < 1e-9 * np.abs(old).max()
        )  # the event is known to some 1e-13 s


@given(p=machine_parameters())
def test_the_table_of_numbers_is_the_machine(build: Build, p: tb.TrebuchetParameters) -> None:
    found = numbers(build(p))
    expected = whipper_numbers(p.model_dump())
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-15, abs=1e-15)


@given(p=machine_parameters())
def test_directions_are_the_derivatives_of_the_machine_s_numbers(
    build: Build, p: tb.TrebuchetParameters
) -> None:
    """Every number is of degree 2 at most in each parameter.

    A central difference has no truncation error.
    """
    directions = parameter_directions(build, p)
    assert directions.keys() >= {"l1", "m_b", "g"}
    for name, direction in directions.items():
        step = 2.0**-4
        above, below = (
            numbers(build(p.model_copy(update={name: getattr(p, name) + s}))) for s in (step, -step)
        )
        for number, value in above.items():
            expected = (value - below[number]) / (2 * step)
            # Rounding of the two values, over the step.
            assert direction.get(number, 0.0) == pytest.approx(
                expected, rel=1e-9, abs=1e-13 * (1 + abs(value)) / step
            )


def test_a_mechanism_with_a_loop() -> None:
    """Rod's length, tilt of the slot, mass and gravity of a slider crank, against differences."""
    cos_b = math.sqrt(1 - (math.sin(math.pi / 3) / 2) ** 2)
    b = math.asin(math.sin(math.pi / 3) / 2)
    directions = [
        {
            "joints.slot.child_point.0": 1.0,
            "markers.tip.point.0": 1.0,
            "start.1": -math.sin(b) / (2.0 * cos_b),  # length sin(b) stays
        },
        {"joints.slot.axis.1": 1.0, "start.1": -math.cos(math.pi / 3) / (2.0 * cos_b) - 1.0},
        {"bodies.rod.mass": 1.0},
        {"gravity": 1.0},
    ]
    solution = solve(tb.Problem(slider_crank(), duration=1.5))
    equations = VariationalEquations(slider_crank(), directions)
    state = state_tangent(solution, equations, 1.5)
    tip = marker_tangent(equations, state, "tip")
    exact = np.concatenate([state.dq, state.du, tip.d_position, tip.d_velocity], axis=1)

    def end(**change: float) -> np.ndarray:
        trajectory = solve(tb.Problem(slider_crank(**change), duration=1.5)).trajectory(
            np.array([1.5])
        )
        motion = trajectory.marker("tip")
        return np.concatenate(
            [trajectory.q[0], trajectory.u[0], motion.position[0], motion.velocity[0]]
        )

    nominal = {"length": 2.0, "tilt": 0.0, "mass": 1.0, "gravity": 9.81}
    assert len(exact) > 0
    for row, (name, value) in zip(exact, nominal.items(), strict=True):
        central = [
            (end(**{name: value + h}) - end(**{name: value - h})) / (2 * h) for h in (1e-3, 2e-3)
        ]
        expected = (4 * central[0] - central[1]) / 3
        assert row == pytest.approx(expected, rel=NEED, abs=1e-8)  # h^4 of a state near 1


def test_a_machine_that_does_not_launch_is_refused() -> None:
    with pytest.raises(
        tb.InputError, match=r"'fixed' machine does not launch within duration = 1 s"
    ):
        whipper_sensitivities(tb.fixed, duration=1.0)


def test_another_machine_is_refused() -> None:
    def tied(p: tb.TrebuchetParameters) -> tb.Mechanism:
        return tb.fixed(p.model_copy(update={"l2": 0.4 * p.l1}))

    with pytest.raises(
        tb.InputError, match=r"build makes bodies.arm.centre.0 = .* where the whipper trebuchet has"
    ):
        whipper_sensitivities(tied)


def test_directions_that_do_not_fit_are_refused() -> None:
    solution = solve(tb.Problem(tb.fixed(), duration=1.0))
    with pytest.raises(tb.InputError, match=r"direction 0 moves the start off its closed stops"):
        state_tangent(solution, VariationalEquations(tb.fixed(), [{"start.2": 1.0}]), 0.5)
    with pytest.raises(tb.InputError, match=r"there is no number 'bodies.arm.weight' in 'fixed'"):
        VariationalEquations(tb.fixed(), [{"bodies.arm.weight": 1.0}])
    with pytest.raises(
        tb.InputError, match=r"t = 2 s lies outside the solution, which covers 0 to 1 s"
    ):
        state_tangent(solution, VariationalEquations(tb.fixed(), [{"gravity": 1.0}]), 2.0)
