"""The fulcrum's sweep: closed forms against the equations of motion, the peak against exact
derivatives, both laws.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import solve_scheduled
from trebucheck.reference.sensitivity.release import whipper_sensitivities
from trebucheck.reference.solver import solve_to_launch
from trebucheck_paper.sweep.laws import Searches, bilateral, pulls_at_start
from trebucheck_paper.sweep.rigid_swing import (
    RigidSwing,
    gravity_and_inertia,
    hanger_torque_on_beam,
    on_beam,
)
from trebucheck_paper.sweep.study import Sweep, fulcrum_sweep

pytestmark = pytest.mark.slow  # one sweep for all of them: some 7 s

BEAM = 14.0
AWAY = tb.TrebuchetParameters(
    l1=9.3, l2=4.7, r=5.0, h=8.0, m_a=700.0, theta0=0.15, phi0=3.3, alpha0=-0.6
)
RESTS = ("hanger rest", "sling rest")


@cache
def sweep() -> Sweep:
    """Without engines, which have tests of their own."""
    return fulcrum_sweep(engines=())


@pytest.mark.parametrize("parameters", [tb.TrebuchetParameters(), AWAY], ids=["Table I", "away"])
def test_the_whole_machine_swings_as_the_held_one_is_integrated(
    parameters: tb.TrebuchetParameters,
) -> None:
    rigid = RigidSwing(parameters)
    t = np.linspace(0.0, 0.6 * rigid.period, 60)
    held = solve_scheduled(
        tb.Problem(rigid.mechanism, duration=float(t[-1])), dict.fromkeys(RESTS)
    ).motion(t)
    turned, rate = rigid.turned(t)
    # The integrator's local error is 1e-12; a pendulum multiplies it by its turns, not
    # exponentially.
    assert np.abs(turned - (held.q[:, 0] - parameters.theta0)).max() < 1e-10
    assert np.abs(rate - held.u[:, 0]).max() < 1e-10
    for name in RESTS:
        constant, wave = rigid.rest_torque(name)
        torque = constant + (wave * np.exp(-1j * turned)).real
        assert torque == pytest.approx(held.stop_torques[name], abs=1e-9 * abs(wave))
        zeros = np.array(rigid.zeros(name))
        at = constant + (wave * np.exp(-1j * rigid.turned(zeros)[0])).real
        assert np.abs(at).max(initial=0.0) < 1e-9 * abs(wave)
        assert rigid.largest_torque(name) >= torque.max() * (1 - 1e-12)


@pytest.mark.parametrize("parameters", [tb.TrebuchetParameters(), AWAY], ids=["Table I", "away"])
def test_the_polynomials_on_the_beam_are_the_equations_of_motion(
    parameters: tb.TrebuchetParameters,
) -> None:
    torque, inertia = gravity_and_inertia(parameters, BEAM)
    product = hanger_torque_on_beam(parameters, BEAM)
    for l1 in (6.0, 9.0, 12.5):
        mechanism = tb.fixed(on_beam(parameters, BEAM, l1))
        q = np.array(mechanism.start)
        a, multipliers = Equations(mechanism).solve(q, np.zeros(3), RESTS)
        assert torque(l1) / inertia(l1) == pytest.approx(a[0], rel=1e-12)
        assert product(l1) / inertia(l1) == pytest.approx(multipliers[0], rel=1e-11)


def test_the_peak_is_where_the_exact_derivative_vanishes() -> None:
    peak = sweep().peak
    assert peak.interior
    assert (
        8.9 < peak.l1.value < 9.1 and 107.5 < peak.speed.value < 107.8
    )  # about, as PHYSICS.md has it

    def slope(l1: float) -> float:
        found = whipper_sensitivities(tb.fixed, on_beam(tb.TrebuchetParameters(), BEAM, l1))
        by = dict(zip(found.names, found.d_launch_speed, strict=True))
        return float(by["l1"] - by["l2"])

    here, there = slope(peak.l1.value), slope(peak.l1.value + 1e-3)
    curvature = (there - here) / 1e-3
    # Sensitivities hold to some 1e-10 relative of terms of 100 m/s per m.
    assert abs(here / curvature) < peak.l1.uncertainty + 1e-7


def test_nothing_falls_backward_on_the_swept_range() -> None:
    found = sweep().backward
    assert found.least_torque > 0
    assert found.furthest_back >= 0.0
    assert all(
        p.arm_acceleration > 0 and p.counterweight_acceleration[1] < 0 for p in sweep().positions
    )
    assert found.l1 is not None and found.counterweight_past_pivot is not None
    assert found.counterweight_past_pivot == pytest.approx(BEAM - 10 * math.sqrt(0.5), rel=1e-14)
    for l1, sign in ((found.l1 + 1e-6, 1), (found.l1 - 1e-6, -1)):
        assert (
            math.copysign(1, RigidSwing(on_beam(tb.TrebuchetParameters(), BEAM, l1)).acceleration)
            == sign
        )


def test_a_machine_beyond_that_does_fall_backward() -> None:
    """The check can fail: below the zero of the torque the arm does turn the other way."""
    assert sweep().backward.l1 is not None
    solution = solve_to_launch(tb.fixed(on_beam(tb.TrebuchetParameters(), BEAM, 6.5)))
    assert solution.motion(np.array([0.2])).q[0, 0] < 0


def test_at_the_suspect_the_curve_is_as_smooth_as_its_neighbours() -> None:
    found = sweep().suspect
    assert found.speed == pytest.approx(95.75, abs=0.01)
    assert (
        abs(found.speed - found.from_neighbours) < 1e-9
    )  # the batch's 1e-12 through a whip of some 1e3
    # Central differences leave h^2 / 12 of the fourth derivative, of the order of the second
    # itself.
    assert found.second_difference == pytest.approx(found.second_derivative, rel=1e-3)


def test_the_regime_changes_where_the_rest_would_have_to_pull() -> None:
    regime = sweep().regime
    assert (
        regime.l1 is not None
        and regime.root is not None
        and regime.below
        and regime.above
        and regime.swing
    )
    assert regime.l1.value == pytest.approx(12.725456, abs=1e-6)
    assert regime.root == pytest.approx(regime.l1.value, abs=1e-9)
    assert regime.needed == pytest.approx(regime.available, rel=1e-12)
    assert regime.below.rest_torques["hanger rest"] > 0 > regime.above.rest_torques["hanger rest"]
    assert regime.above.release_times["hanger rest"] == 0.0
    assert (
        regime.below.speed
        and regime.above.speed
        and regime.below.bilateral_speed
        and regime.above.bilateral_speed
    )
    # A rest that can only push: continuous, with the curve's own slope of some -16 m/s per m over
    # 2e-6 m.
    assert abs(regime.above.speed.value - regime.below.speed.value) < 1e-4
    assert regime.below.bilateral_speed == regime.below.speed.value
    assert regime.above.bilateral_speed == pytest.approx(48, abs=0.5)  # about, as PHYSICS.md has it
    # In the paper's order, hanger first, the torque never comes to zero: there is no launch at all.
    assert regime.swing.zeros == () and regime.swing.largest_torque < 0


def test_under_the_bilateral_law_stops_go_at_their_zeros() -> None:
    rigid = RigidSwing(on_beam(tb.TrebuchetParameters(), BEAM, 12.8))
    assert pulls_at_start(rigid) and not pulls_at_start(RigidSwing(tb.TrebuchetParameters()))
    solution = bilateral(rigid)
    for name in RESTS:
        time = solution.release_times[name]
        assert time is not None
        before, after = (
            solution.motion(np.array([time + dt])).stop_torques[name][0] for dt in (-1e-6, 1e-6)
        )
        assert after == 0.0
        assert abs(before) < 1.0  # N m, a microsecond before a zero that is approached at 1e4 N m/s
    held = solution.motion(np.linspace(0.0, 1.0, 20)).stop_torques["hanger rest"]
    assert np.all(held < 0)  # it pulls


def test_without_a_pull_both_laws_are_one() -> None:
    rigid = RigidSwing(tb.TrebuchetParameters())
    found, expected = bilateral(rigid).launch, solve_to_launch(rigid.mechanism).launch
    assert found and expected
    assert found.speed == pytest.approx(expected.speed, abs=1e-8)


def test_the_curve_and_its_line() -> None:
    curve, trend, found = sweep().curve, sweep().trend, sweep()
    assert 150 <= len(curve.l1) <= 250
    assert None not in curve.release_once
    at = found.position(9.91)
    assert at and at.speed and at.speed.value == pytest.approx(100.55, abs=0.005)  # as printed
    assert at.lever_ratio == pytest.approx(2.42, abs=0.005)
    assert trend.falling and -20 < trend.slope < -5
    jumps = np.diff([v for v in curve.bilateral if v is not None])
    assert jumps.min() < -15  # the bilateral law's fall, between two points 25 mm apart


def test_a_search_from_one_guess_ends_on_the_wrong_zero_below_a_threshold() -> None:
    found = sweep().artefact
    by_guess = {search.guess: search for search in found.searches}
    assert by_guess[0.5].lowest is not None and by_guess[0.5].later_zero > 0
    assert by_guess[1.0].lowest == pytest.approx(8.5)
    assert found.matching_search is not None and found.matching_search.lowest is not None
    assert abs(found.matching_search.lowest - found.threshold) <= 2 * found.step
    assert any(speed < 0 for wrong in found.wrong_zeros for _, speed in wrong.crossings)


def test_newton_from_the_zero_itself_stays_there() -> None:
    rigid = RigidSwing(tb.TrebuchetParameters())
    search = Searches(np.array([10.0]), (rigid,)).search(rigid.zeros("hanger rest")[0], (10.0,))
    assert search.lowest == 10.0 and search.fails_at == ()
    late = Searches(np.array([10.0]), (rigid,)).search(rigid.zeros("hanger rest")[1], (10.0,))
    assert late.lowest is None and late.later_zero == 1 and late.fails_at == (10.0,)


@pytest.mark.parametrize(("start", "end"), [(9.0, 8.0), (0.0, 9.0), (9.0, 14.0)])
def test_a_range_off_the_beam_is_refused(start: float, end: float) -> None:
    with pytest.raises(tb.InputError, match="must satisfy"):
        fulcrum_sweep(start=start, end=end, engines=())


def test_it_survives_json() -> None:
    assert Sweep.from_json(sweep().to_json()) == sweep()
