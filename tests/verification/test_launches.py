"""The launch on the reference's continuous motion, against searches that share nothing with it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import TABLE_ONE, chain
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.launch import SmoothVelocity, first_launch, lead
from trebucheck.models.mechanism import Marker
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.certification.certificate import estimate_uncertainty
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import characteristic_time, solve
from trebucheck.reference.taylor.solve import solve_taylor, taylor_quantities

_SAME = (
    1e-12  # relative: a later end changes only the last step of a motion, whose error is some 3e-14
)
_FINE = 1e-5  # of the characteristic time

WHIRLING = tb.TrebuchetParameters(
    l1=103.3,
    l2=105.3,
    m_b=35130,
    m_cw=620.1,
    m_a=72.35,
    h=184.4,
    r=24.84,
    theta0=-1.098,
    phi0=3.201,
    alpha0=0.09984,
)
"""A counterweight that whirls about a heavy projectile.

Its velocity turns through a right angle in milliseconds.
"""


def _scanned(solution: Solution, angle: float) -> float | None:
    """The first fall through the launch direction, forwards, by a very fine scan."""
    kinematics, mechanism = solution.equations.kinematics, solution.problem.mechanism
    row = kinematics.point(
        "sling", next(m.point for m in mechanism.markers if m.name == "projectile")
    )
    after, end = solution.release_times["sling rest"], solution.segments[-1].end
    if after is None:
        return None
    t = np.linspace(after, end, int((end - after) / (_FINE * characteristic_time(mechanism))) + 2)
    q, u = np.split(
        np.concatenate([_states(solution, part) for part in np.array_split(t, len(t) // 5000 + 1)]),
        2,
        1,
    )
    velocity = kinematics.velocity(row, q, u)
    across, forward = lead(velocity, angle), lead(velocity, angle - math.pi / 2)
    falls = np.flatnonzero((across[:-1] > 0) & (across[1:] <= 0) & (forward[1:] > 0))
    return float(t[falls[0]]) if len(falls) else None


def _states(solution: Solution, t: np.ndarray) -> np.ndarray:
    of = np.searchsorted([segment.end for segment in solution.segments[:-1]], t, side="right")
    parts = [np.asarray(solution.segments[k].interpolant(t[of == k])).T for k in np.unique(of)]
    return np.concatenate(parts)


def _random_machines() -> Iterator[tuple[str, tb.TrebuchetParameters, float, float]]:
    """Machines of every size from 1:10 000 up, with an angle, and an end in characteristic
    times."""
    random = np.random.default_rng(11)
    for i in range(6):
        size = 10 ** random.uniform(-4, 2)
        lengths = {name: size * 10 ** random.uniform(-0.3, 0.3) for name in ("l1", "l2", "h", "r")}
        masses = {name: 10 ** random.uniform(0, 3) for name in ("m_b", "m_cw", "m_a")}
        start = {
            "theta0": random.uniform(-1, 1),
            "phi0": random.uniform(2, 4),
            "alpha0": random.uniform(-3, 3),
        }
        angle = math.pi / 4 if i % 2 else random.uniform(-1.5, 1.5)
        yield (
            ("fixed", "rolling")[i % 2],
            tb.TrebuchetParameters(**lengths, **masses, **start),
            angle,
            1.0 + i / 10,
        )


@pytest.mark.parametrize(("kind", "parameters", "angle", "spans"), list(_random_machines()))
def test_the_first_launch_whatever_the_end(
    kind: str, parameters: tb.TrebuchetParameters, angle: float, spans: float
) -> None:
    machine = {"fixed": tb.fixed, "rolling": tb.rolling}[kind](parameters)
    duration = spans * characteristic_time(machine)
    long, short = (
        solve(tb.Problem(machine, duration=1.7 * duration)),
        solve(tb.Problem(machine, duration=duration)),
    )
    launch, scanned = long.launch_at(angle), _scanned(long, angle)
    assert (launch is None) == (scanned is None)
    if launch is None or scanned is None:
        assert short.launch_at(angle) is None
        return
    assert 0 <= launch.time - scanned <= 1.001 * _FINE * characteristic_time(machine)
    assert math.atan2(launch.velocity[1], launch.velocity[0]) == pytest.approx(angle, abs=1e-9)
    early = short.launch_at(angle)
    assert (early is None) == (launch.time > duration)
    if early is not None:
        assert early.time == pytest.approx(launch.time, rel=_SAME)


def test_a_velocity_that_whirls_through_the_direction() -> None:
    """A scan every 2 ms finds its direction already turned away, and takes the next launch, two
    seconds later.
    """
    solution = solve(tb.Problem(tb.rolling(WHIRLING), duration=12.0), 1e-10, 1e-10)
    assert solution.launch is not None
    # Sensitive to rounding by now, but not by a millisecond.
    assert solution.launch.time == pytest.approx(11.7957, abs=1e-3)


@pytest.mark.parametrize("name", ["fixed", "rolling"])
def test_models_of_any_scale_launch_alike(name: str) -> None:
    p = tb.TrebuchetParameters()
    lengths = {key: 1e-4 * getattr(p, key) for key in ("l1", "l2", "h", "r")}
    small = solve(
        tb.Problem(
            {"fixed": tb.fixed, "rolling": tb.rolling}[name](p.model_copy(update=lengths)), 0.028
        )
    )
    full = solve(tb.Problem(TABLE_ONE[name], 2.8))
    assert small.launch is not None and full.launch is not None
    assert 100 * small.launch.time == pytest.approx(full.launch.time, rel=1e-10)


def _piece(*knots: float, across: np.polynomial.Polynomial, along: float = 1.0) -> SmoothVelocity:
    """A velocity with a given component across 45 degrees, and a constant one along."""

    def at(t: np.ndarray) -> np.ndarray:
        side = across(t)
        return np.stack([along - side, along + side], axis=1) / math.sqrt(2)

    return SmoothVelocity(np.array(knots), at)


@pytest.mark.parametrize("width", [1e-1, 1e-3, 1e-5])
def test_two_crossings_within_one_step(width: float) -> None:
    """The component is positive at both ends, and negative for a small part of the step."""
    across = np.polynomial.Polynomial.fromroots([0.4, 0.4 + width])
    launch = first_launch([_piece(0.0, 1.0, across=across)])
    assert launch is not None
    assert launch.time == pytest.approx(0.4, abs=1e-9)
    assert first_launch([_piece(0.0, 1.0, across=across + width**2)]) is None


def test_direction_counts_at_the_root_only() -> None:
    falls = np.polynomial.Polynomial([0.5, -1.0])
    assert first_launch([_piece(0.0, 1.0, across=falls, along=-1.0)]) is None
    assert first_launch([_piece(0.0, 1.0, across=-falls)]) is None
    launch = first_launch([_piece(0.0, 0.5, 1.0, across=falls)])  # at the end of a step
    assert launch is not None
    assert launch.time == pytest.approx(0.5, abs=1e-15)


def test_a_motion_may_end_with_its_launch() -> None:
    launch = first_launch([_piece(0.0, 0.5, across=np.polynomial.Polynomial([0.5 + 1e-15, -1.0]))])
    assert launch is not None and launch.time == 0.5
    assert first_launch([_piece(0.0, 0.49, across=np.polynomial.Polynomial([0.5, -1.0]))]) is None


def test_a_rest_that_pushes_again_starts_the_search_anew() -> None:
    above, below = (
        _piece(t, t + 1, across=np.polynomial.Polynomial([side]))
        for t, side in ((0.0, 1.0), (1.0, -1.0))
    )
    assert first_launch([above, None, below]) is None
    launch = first_launch([above, below])
    assert launch is not None
    assert (launch.time, launch.speed) == (1.0, pytest.approx(1.0))


def test_an_impact_that_turns_the_velocity_through_the_direction() -> None:
    stop = tb.Stop(name="stop", body="upper", sense=-1, limit=-2.2, closed=False, restitution=0.5)
    thrown = tb.Marker(name="projectile", body="lower", point=(0.1, -1.5))
    machine = chain(stop, start=(1.9, 2.1), start_speeds=(4.1, 2.5), markers=(thrown,))
    problem = tb.Problem(machine, duration=1.0, stop_law=tb.StopLaw.UNILATERAL)
    solution = solve(problem)
    impact = solution.impacts[0][0]
    before, after = (
        solution.trajectory(np.array([impact + dt])).marker("projectile").velocity[0]
        for dt in (-1e-9, 0)
    )
    assert lead(before) > 0.1 and lead(after) < -0.1
    launch = solution.launch
    assert launch is not None and launch.time == impact
    # On the straight line between the two velocities, and along the launch direction.
    change, part = after - before, np.array(launch.velocity) - before
    assert abs(change[0] * part[1] - change[1] * part[0]) < 1e-6
    assert launch.velocity[0] == pytest.approx(launch.velocity[1], rel=1e-12)
    pytest.importorskip("heyoka")
    for other in (solve_taylor(problem).launch, taylor_quantities(problem, "double").launch):
        assert other is not None
        assert other.time == pytest.approx(launch.time, rel=_SAME)
        assert other.speed == pytest.approx(launch.speed, rel=1e-10)


def test_a_launch_that_the_coarser_solution_lacks_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its uncertainty is not that of the releases, which both solutions have."""
    solution = solve(tb.Problem(tb.fixed(tb.TrebuchetParameters(l1=9.5)), 3.0))
    launch = solution.launch
    assert launch is not None
    known = estimate_uncertainty(solution)
    assert (known.of("launch_time") or 1.0) < 1e-9
    monkeypatch.setattr("trebucheck.reference.certification.certificate._BEYOND", 1.0 - 1e-3)
    monkeypatch.setattr("trebucheck.reference.certification.certificate._SAMPLES", 1)
    unknown = estimate_uncertainty(solution)
    assert unknown.of("launch_time") == launch.time
    assert unknown.of("launch_speed") == launch.speed
    assert (unknown.of("release_time", "sling rest") or 1.0) < 1e-9


@pytest.mark.parametrize("taylor", [False, True])
@pytest.mark.parametrize("law", list(StopLaw))
def test_what_loops_hold_fast_is_not_launched(taylor: bool, law: StopLaw) -> None:
    """A body that a loop locks, beside others that swing.

    Its velocity is rounding, which points anywhere.
    """
    mechanism = random_mechanism(32)
    thrown = Marker(name="projectile", body=mechanism.bodies[-1].name, point=(0.5, 0.1))
    locked = mechanism.model_copy(update={"markers": (thrown,)})
    problem = Problem(locked, duration=2.0, stop_law=law)
    if taylor:
        pytest.importorskip("heyoka")
        assert taylor_quantities(problem, "double").launch is None
    else:
        assert solve(problem).launch is None
