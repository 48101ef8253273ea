"""Derivatives of any mechanism's motion against closed forms and against differences of the
reference's motions.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from directions import derivatives, random_direction, stepped
from mechanisms import G, bouncing, everything, hanging_bob, parallel_cranks, pin
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.elements import GROUND, RotationalSpringDamper
from trebucheck.models.library.registry import benchmark
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.sensitivity.tangent import marker_tangent, state_tangent
from trebucheck.reference.sensitivity.variational import VariationalEquations, consistent_direction
from trebucheck.reference.solver import solve

STEP = 1e-4
# Of the largest number of a state: what the solver may err by, at a local error of 3e-14 over 100
# steps
SOLVER = 1e-12
BLIND = 1e-4  # differences that know less than this of themselves would prove nothing


def assert_differences_agree(
    mechanism: Mechanism, t: float, law: StopLaw, least: float = 0.1
) -> None:
    """State and times of releases and impacts along one random direction of all numbers."""
    direction = random_direction(mechanism, least)
    found = derivatives(mechanism, [direction], t, law)
    releases = [name for name, values in found.d_release_times.items() if np.isfinite(values).all()]
    exact = np.concatenate(
        [found.dq[0], found.du[0], [found.d_release_times[name][0] for name in releases]]
        + [shift for _, shift in found.d_impact_times]
    )
    active = solve(Problem(mechanism, duration=1e-6, stop_law=law)).segments[0].closed

    def figures(step: float) -> np.ndarray:
        solution = solve(
            Problem(stepped(mechanism, direction, step, active), duration=t, stop_law=law)
        )
        times = [solution.release_times[name] for name in releases] + [
            time for time, _ in solution.impacts if time > 0
        ]
        return np.array([*solution.segments[-1].interpolant(t), *times], dtype=np.float64)

    first, second, third = (
        (figures(k * STEP) - figures(-k * STEP)) / (2 * k * STEP) for k in (1, 2, 4)
    )
    fine, coarse = (4 * first - second) / 3, (4 * second - third) / 3
    expected = (16 * fine - coarse) / 15  # Richardson: O(step^6)
    size = np.abs(np.concatenate([found.q, found.u, exact])).max()
    own = np.abs(expected - fine) + SOLVER * size / STEP
    assert own.max() < BLIND * np.abs(expected).max()
    assert np.abs(exact - expected).max() / own.max() <= 1, (exact, expected, own)


@pytest.mark.slow
def test_every_element_against_differences() -> None:
    assert_differences_agree(everything(), 0.4, StopLaw.UNILATERAL)


# Trees and loops with springs, dampers and motors; number 16 meets stops.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(0, marks=again), 5, 16])
def test_random_mechanisms_against_differences(seed: int) -> None:
    assert_differences_agree(random_mechanism(seed), 0.5, StopLaw.UNILATERAL)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "part"), [("squeezer", 0.3), ("n-four-bar", 0.06), ("stopped-pendulum", 0.5)]
)
def test_problems_of_the_library_against_differences(name: str, part: float) -> None:
    """Up to some part of their durations.

    The N-four-bar, from its first position to one near the singular one.
    """
    problem = benchmark(name).problem()
    assert_differences_agree(
        problem.mechanism, part * problem.duration, problem.stop_law, least=1e-4
    )


def test_an_impact_in_closed_form() -> None:
    """y = e g t1 s - g s^2 / 2 a time s after the first impact at t1 = sqrt(2 h / g)."""
    h, e, s = 2.0, 0.6, 0.3
    t1 = math.sqrt(2 * h / G)
    directions = [
        {"start.0": 1.0},
        {"gravity": 1.0},
        {"stops.floor.restitution": 1.0},
        {"stops.floor.offset": 1.0},
    ]
    found = derivatives(bouncing(h, e), directions, t1 + s, StopLaw.UNILATERAL)
    d_t1 = np.array([t1 / (2 * h), -t1 / (2 * G), 0.0, -t1 / (2 * h)])
    d_explicit = np.array([0.0, e * t1 * s - s**2 / 2, G * t1 * s, 1.0])
    d_speed = np.array([0.0, e * t1 - s, G * t1, 0.0])
    ((time, shifts),) = found.d_impact_times
    assert time == pytest.approx(t1, rel=1e-13)
    assert shifts == pytest.approx(d_t1, abs=1e-11)
    assert found.dq[:, 0] == pytest.approx(
        d_explicit + (e * G * (s - t1) + G * s) * d_t1, abs=1e-10
    )
    assert found.du[:, 0] == pytest.approx(d_speed + (e * G + G) * d_t1, abs=1e-10)


def test_what_has_ceased_to_bounce_rests_where_the_floor_is() -> None:
    """After infinitely many impacts, by t1 (1 + e) / (1 - e)."""
    directions = [{"start.0": 1.0}, {"stops.floor.restitution": 1.0}, {"stops.floor.offset": 1.0}]
    found = derivatives(bouncing(1.0, 0.4), directions, 1.2, StopLaw.UNILATERAL)
    assert found.closed == ("floor",)
    assert found.dq[:, 0] == pytest.approx([0, 0, 1], abs=1e-9)
    assert found.du[:, 0] == pytest.approx(0, abs=1e-9)


def test_a_sprung_and_damped_wheel_in_closed_form() -> None:
    """I a'' + c a' + k (a - r) = T.

    A damped oscillation about r + T / k, differentiated by a complex step.
    """

    def angle(
        t: float,
        inertia: complex,
        c: complex,
        k: complex,
        r: complex,
        torque: complex,
        start: complex,
    ) -> complex:
        rest, decay = r + torque / k, c / (2 * inertia)
        rate = np.sqrt(k / inertia - decay**2)
        return rest + (start - rest) * np.exp(-decay * t) * (
            np.cos(rate * t) + decay / rate * np.sin(rate * t)
        )

    spring = {"stiffness": 20.0, "damping": 0.3, "rest_angle": 0.5}
    wheel = Mechanism(
        name="wheel",
        bodies=(Body(name="wheel", angle="a", mass=1.0, centre=(0, 0), inertia=0.4),),
        joints=(pin("axle", GROUND, "wheel"),),
        force_elements=(
            RotationalSpringDamper(name="spring", body="wheel", **spring),
            tb.ConstantTorque(name="motor", body="wheel", torque=2.0),
        ),
        gravity=G,
        start=(1.2,),
    )
    values = {
        "bodies.wheel.inertia": 0.4,
        "force_elements.spring.damping": 0.3,
        "force_elements.spring.stiffness": 20.0,
        "force_elements.spring.rest_angle": 0.5,
        "force_elements.motor.torque": 2.0,
        "start.0": 1.2,
    }
    found = derivatives(wheel, [{name: 1.0} for name in values], 1.5, StopLaw.RELEASE_ONCE)
    nominal = list(values.values())
    expected = [
        angle(1.5, *(complex(v, 1e-200 * (i == k)) for i, v in enumerate(nominal))).imag / 1e-200
        for k in range(len(nominal))
    ]
    assert found.dq[:, 0] == pytest.approx(expected, abs=1e-11)


def test_redundant_loops_follow_what_they_can_and_refuse_what_tears_them() -> None:
    """A beam on three parallel cranks moves as a pendulum.

    One crank of another length would lock it.
    """
    mechanism, t = parallel_cranks(3), 0.8
    start = {"start.0": 1.0, "start.2": 1.0, "start.3": 1.0}
    found = derivatives(mechanism, [start, {"bodies.beam.mass": 1.0}], t, StopLaw.RELEASE_ONCE)

    def end(step: float) -> np.ndarray:
        solution = solve(Problem(parallel_cranks(3, start=0.3 + step), duration=t))
        return np.asarray(solution.segments[-1].interpolant(t))

    h = 1e-3
    expected = (8 * (end(h) - end(-h)) - (end(2 * h) - end(-2 * h))) / (12 * h)
    # The difference errs by h^4 times a fifth derivative of some 10, over 30; rounding by 1e-13 /
    # h.
    assert np.concatenate([found.dq[0], found.du[0]]) == pytest.approx(expected, abs=1e-9)
    torn = consistent_direction(mechanism, {"joints.head 1.parent_point.0": 1.0})
    with pytest.raises(tb.InputError, match="off its closed stops \\(\\) or loops by"):
        derivatives(mechanism, [torn], t, StopLaw.RELEASE_ONCE)


def test_a_singular_position_is_refused_and_known_before_it() -> None:
    mechanism = benchmark("n-four-bar").problem().mechanism
    solution = solve(Problem(mechanism, duration=1.0))
    equations = VariationalEquations(mechanism, [{"gravity": 1.0}])
    with pytest.raises(tb.UnsupportedProblemError, match=r"passes a singular position at t = 0\.7"):
        state_tangent(solution, equations, 0.9)
    assert np.isfinite(state_tangent(solution, equations, 0.5).dq).all()


def test_stops_met_at_one_instant_are_refused() -> None:
    """Which of them is met first decides on the motion."""
    both = bouncing(1.0, 0.5)
    (floor,) = both.stops
    twin = floor.model_copy(update={"name": "twin"})
    mechanism = both.model_copy(update={"stops": (floor, twin)})
    with pytest.raises(tb.UnsupportedProblemError, match="meets floor and twin at one instant"):
        derivatives(mechanism, [{"stops.floor.offset": 1.0}], 0.6, StopLaw.UNILATERAL)


def test_a_marker_s_place_and_velocity() -> None:
    """Of a pendulum's bob in polar coordinates."""
    mechanism = hanging_bob(start=0.4)
    solution = solve(Problem(mechanism, duration=0.5))
    length = {"bodies.bob.centre.0": 1.0, "markers.bob.point.0": 1.0}
    equations = VariationalEquations(mechanism, [length, {"markers.bob.point.1": 1.0}])
    state = state_tangent(solution, equations, 0.5)
    point = marker_tangent(equations, state, "bob")
    (q,), (u,), dq, du = state.q, state.u, state.dq[0, 0], state.du[0, 0]
    along, across = np.array([math.cos(q), -math.sin(q)]), np.array([-math.sin(q), -math.cos(q)])
    assert point.d_position[0] == pytest.approx(along + 2 * dq * across, abs=1e-12)
    assert point.d_velocity[0] == pytest.approx(
        (u + 2 * du) * across - 2 * u * dq * along, abs=1e-12
    )
    assert point.d_position[1] == pytest.approx(-across, abs=1e-12)
