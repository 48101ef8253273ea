"""When bouncing ends: times of rest against sums of flights, and impacts of any speed in mechanisms
of any size.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import angle_stop, hanging_bob
from trebucheck.models.library.contacts import BouncingParameters
from trebucheck.models.library.pendulums import pin_links, rods
from trebucheck.reference import contact as bouncing
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

G, LENGTH = 9.81, 2.0


def _bouncing(**changes: float) -> tuple[BouncingParameters, Solution]:
    parameters = BouncingParameters(**changes)
    return parameters, solve(parameters.problem())


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
@pytest.mark.parametrize(("height", "g"), [(1e-3, 2e3), (200.0, 1.62)])
def test_a_body_on_a_floor(e: float, height: float, g: float) -> None:
    parameters, motion = _bouncing(restitution=e, height=height, g=g)
    (rest,) = motion.rest_times["floor"]
    fall = parameters.speed / g
    assert rest == pytest.approx(parameters.rest_time, abs=1e-10 * min(1.0, fall))
    # As many impacts as it takes to 5e-7 of the first speed.
    expected = 1 if e == 0 else 1 + math.log(5e-7) / math.log(e)
    assert len(motion.impacts) == pytest.approx(expected, abs=1)


def test_taylor_series_has_the_same_time_of_rest() -> None:
    parameters = BouncingParameters(restitution=0.8)
    motion = solve_taylor(parameters.problem())
    assert motion.rest_times["floor"] == (pytest.approx(parameters.rest_time, abs=1e-10),)


def test_without_loss_nothing_rests() -> None:
    _, motion = _bouncing(restitution=1.0)
    assert motion.rest_times == {"floor": ()}


def _rest_of_a_bob(e: float, limit: float) -> float:
    """When a bob let go level ceases to bounce on its stop [s].

    It comes back as fast as it left, in known times.
    """
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(25):
        rate = mpmath.mpf(G) / LENGTH

        def rise(speed: object) -> object:
            """Time from the stop to the turning point, by quadrature of the energy."""
            highest = mpmath.asin(mpmath.sin(limit) - speed**2 / (2 * rate))

            # a = highest + x^2 takes the root at the turning point away.
            def slowness(x: object) -> object:
                height = mpmath.sin(x**2 / 2) * mpmath.cos(highest + x**2 / 2)
                return x / mpmath.sqrt(rate * height)

            return mpmath.quad(slowness, [0, mpmath.sqrt(limit - highest)])

        speed = mpmath.sqrt(2 * rate * mpmath.sin(limit))
        rest = rise(speed)
        while e * speed > 1e-7:
            speed *= e
            rest += 2 * rise(speed)
        return float(rest + 2 * e * speed / (rate * mpmath.cos(limit) * (1 - e)))


@pytest.mark.parametrize("e", [0.4, 0.85])
def test_a_bob_on_a_stop(e: float) -> None:
    mechanism = hanging_bob(angle_stop(0.6, e), start=0.0)
    motion = solve(tb.Problem(mechanism, duration=10.0, stop_law="unilateral"))
    assert motion.rest_times["stop"] == (pytest.approx(_rest_of_a_bob(e, 0.6), abs=1e-10),)


def _lower_rod_swings(e: float) -> tb.Problem:
    """The upper rod bounces on its stop while the lower one swings.

    What presses it on changes meanwhile.
    """
    stop = angle_stop(0.7, e, body="rod 1")
    mechanism = pin_links("rods", rods(2, 1.0, 1.0), 1.0, G, (0.4, 2.4), (stop,))
    return tb.Problem(mechanism, duration=4.0, stop_law="unilateral")


@pytest.mark.parametrize("e", [0.3, 0.5])
def test_the_time_does_not_depend_on_where_the_sum_begins(
    monkeypatch: pytest.MonkeyPatch, e: float
) -> None:
    rests: list[float] = []
    for begins in (1e-3, 1e-4, 1e-5):
        monkeypatch.setattr(bouncing, "_SUMMED", begins)
        rests.append(solve(_lower_rod_swings(e)).rest_times["stop"][0])
    # The sum errs by the cube of what remains: some 1e-3 of the motion's own time, and less.
    assert rests[0] == pytest.approx(rests[1], abs=1e-8)
    assert rests[1] == pytest.approx(rests[2], abs=1e-10)


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_what_is_summed_is_as_short_whatever_the_restitution(
    monkeypatch: pytest.MonkeyPatch, e: float
) -> None:
    """Up to 2e-4 of the time in which gravity makes the greatest speed; one rebound more is not."""
    summed: list[float] = []
    remaining = bouncing.Bouncing._remaining

    def noted(*given: Any) -> float:
        summed.append(remaining(*given))
        return summed[-1]

    monkeypatch.setattr(bouncing.Bouncing, "_remaining", noted)
    parameters, motion = _bouncing(restitution=e)
    assert len(summed) == len(motion.rest_times["floor"]) == 1
    longest = 2e-4 * parameters.speed / parameters.g
    assert e * longest < summed[0] <= longest


def test_a_tiny_mechanism_bounces_like_a_large_one() -> None:
    """Impact by impact: no speed or length decides."""
    _, large = _bouncing(restitution=0.6, height=100.0)
    _, tiny = _bouncing(restitution=0.6, height=1e-4)
    assert len(tiny.impacts) == len(large.impacts)
    times = np.array(
        [[a, b * 1e3] for (a, _), (b, _) in zip(large.impacts, tiny.impacts, strict=True)]
    )
    assert times[:, 1] == pytest.approx(times[:, 0], rel=1e-9)
