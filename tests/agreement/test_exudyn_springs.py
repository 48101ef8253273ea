"""Exudyn's stops as springs.

The law of their softness, their balance at the start, how they let go.
"""

from __future__ import annotations

import numpy as np
import pytest
from conftest import again
from mechanisms import (
    TABLE_ONE,
    G,
    angle_stop,
    floor,
    position_error,
    rod_pendulum,
    table_one_motion,
)
from scipy import stats
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.errors import InputError
from trebucheck.models.library.trebuchet import (
    HANGER_REST,
    SLING_REST,
    TrebuchetParameters,
    fixed,
    rolling,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve, solve_to_launch

pytest.importorskip("exudyn")

from trebucheck.engines.exudyn.build import build
from trebucheck.engines.exudyn.motion import _springs  # pyright: ignore[reportPrivateUsage]
from trebucheck.engines.exudyn.solver import Solver

RESTS = (HANGER_REST, SLING_REST)
STEP = 5e-4  # [s] second order leaves 0.1 mm: a tenth of what the stiffest springs of the law leave
SOFTEST, STIFFEST = 10**7.5, 10**9.5  # [N m/rad]


def to_launch(mechanism: Mechanism) -> Solution:
    """Reference motion up to the launch."""
    launch = solve_to_launch(mechanism).launch
    assert launch is not None
    return solve(Problem(mechanism, launch.time))


def errors(exact: Solution, stiffnesses: list[float]) -> list[float]:
    """Of the projectile's position [m], by stiffness."""
    engines = [ExudynEngine(timestep=STEP, stop_stiffness=stiffness) for stiffness in stiffnesses]
    return [position_error(engine.simulate(exact.problem), exact) for engine in engines]


@pytest.mark.parametrize("name", ["fixed", pytest.param("rolling", marks=again)])
def test_the_error_falls_with_the_stiffness(name: str) -> None:
    """A preloaded spring lets go at a gap of torque / stiffness, so the error's exponent is -1."""
    stiffnesses = np.geomspace(SOFTEST, STIFFEST, 5)
    fit = stats.linregress(
        np.log(stiffnesses), np.log(errors(table_one_motion(name), stiffnesses.tolist()))
    )
    assert fit.slope == pytest.approx(-1.0, abs=0.1)
    assert stats.t.ppf(0.975, df=3) * fit.stderr <= 0.1  # one line through all of them, not a bend


OTHERS = {
    "other lengths and masses": rolling(
        TrebuchetParameters(l1=9, l2=3, r=5, h=8, m_b=100, m_cw=4000, m_a=500)
    ),
    "on the move": fixed().model_copy(update={"start_speeds": (0.3, 0.3, 0.3)}),
}


@pytest.mark.parametrize("name", OTHERS)
def test_the_law_is_not_table_ones(name: str) -> None:
    soft, stiff = errors(to_launch(OTHERS[name]), [SOFTEST, STIFFEST])
    assert np.log(stiff / soft) / np.log(STIFFEST / SOFTEST) == pytest.approx(-1.0, abs=0.1)


@pytest.mark.parametrize("name", TABLE_ONE)
def test_springs_start_in_balance_and_let_go_where_nothing_is_left(name: str) -> None:
    exact, stiffness = table_one_motion(name), 1e9
    run = ExudynEngine(timestep=STEP, stop_stiffness=stiffness).simulate(exact.problem)
    there = exact.trajectory(run.t)
    for rest in RESTS:
        torque, release = run.stop_torque(rest), run.release_time(rest)
        assert release is not None
        assert torque[0] == pytest.approx(
            there.stop_torque(rest)[0], rel=1e-9
        )  # two extrapolated solves
        assert (torque[run.t < release] > 0).all()
        assert (torque[run.t >= release] == 0).all()
        # Nothing rings from the start, where a spring without its preload would swing from zero to
        # twice its torque.
        assert np.abs(torque - there.stop_torque(rest)).max() <= 1e-2 * torque[0]
    # The damper lags by 2 * 0.1 / w, with w = sqrt(k / I) near 100 rad/s: milliseconds in a throw
    # of seconds.
    gap = np.interp(run.release_time(HANGER_REST) or np.nan, run.t, run.stop_gap(HANGER_REST))
    assert gap == pytest.approx(run.stop_torque(HANGER_REST)[0] / stiffness, rel=0.02)


@pytest.mark.parametrize("name", TABLE_ONE)
def test_the_stiffest_springs_are_as_good_as_constraints(name: str) -> None:
    """Also where the rounding of a stiff spring's force is far above the tolerance of Newton's
    residual.
    """
    exact = table_one_motion(name)
    held = position_error(ExudynEngine(timestep=STEP).simulate(exact.problem), exact)
    assert errors(exact, [1e13])[0] == pytest.approx(held, rel=0.05)


def test_undamped_springs_ring_and_let_go_at_the_wrong_time() -> None:
    """Why they are damped: the hanger's release sets the sling's spring swinging."""
    exact = table_one_motion("fixed")
    time = exact.release_times[SLING_REST]
    assert time is not None
    off: list[float] = []
    for ratio in (0.0, ExudynEngine().stop_damping_ratio):
        engine = ExudynEngine(timestep=STEP, stop_stiffness=1e9, stop_damping_ratio=ratio)
        off.append(abs((engine.simulate(exact.problem).release_time(SLING_REST) or np.nan) - time))
    assert off[0] > 3 * off[1]


def lying_rod(on: str, arm: float) -> Mechanism:
    """A rod that lies on a stop: on its angle, or under a point of it at the arm [m]."""
    stop = angle_stop(0.0) if on == "angle" else floor(0.0, point=(arm, 0.0))
    stop = stop.model_copy(update={"body": "rod", "name": "stop", "closed": True})
    return rod_pendulum().model_copy(update={"stops": (stop,)})


@pytest.mark.parametrize("on", ["angle", "point"])
def test_a_spring_is_preloaded_by_its_load_and_damped_by_the_inertia_it_stops(on: str) -> None:
    """A rod that lies on its stop turns about its pin with the inertia 2.5 kg m^2."""
    arm = 1.6  # [m] of the point that the floor supports
    stiffness, ratio = 4e5, 0.3
    solver = Solver(build(lying_rod(on, arm)), ExudynEngine(stop_damping_ratio=ratio))
    spring = _springs(solver, solver.start(), ("stop",), stiffness)["stop"]
    lever = 1.0 if on == "angle" else arm
    assert spring.stiffness == stiffness
    assert spring.torque == pytest.approx(2.0 * G * 1.0 / lever, rel=1e-9)
    inertia = 2.5 / lever**2
    assert spring.damping == pytest.approx(2 * ratio * (stiffness * inertia) ** 0.5, rel=1e-9)


def test_a_spring_that_would_have_to_pull_is_gone_at_the_start() -> None:
    # Beyond l1 = 12.7255 m the hanger's rest would have to pull (PHYSICS.md); the sling's then
    # pushes by itself.
    problem = Problem(fixed(TrebuchetParameters.with_beam(12.8)), 0.5)
    run, exact = ExudynEngine(timestep=1e-3, stop_stiffness=1e9).simulate(problem), solve(problem)
    assert run.release_time(HANGER_REST) == 0.0
    assert not run.stop_torque(HANGER_REST).any()
    torque = exact.trajectory(np.zeros(1)).stop_torque(SLING_REST)[0]
    assert run.stop_torque(SLING_REST)[0] == pytest.approx(torque, rel=1e-9)


def test_without_a_stiffness_stops_are_constraints() -> None:
    runs = [
        ExudynEngine(timestep=1e-2, **o).simulate(Problem(fixed(), 2.0))
        for o in ({}, {"stop_damping_ratio": 3.0})
    ]
    assert ExudynEngine().stop_stiffness is None
    assert ExudynEngine.presets()["default"]().stop_stiffness is None
    assert np.array_equal(runs[0].q, runs[1].q)
    assert np.abs(runs[0].stop_gap(HANGER_REST)[runs[0].t < 1.19]).max() <= 1e-12


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("stop_stiffness", 0.0),
        ("stop_stiffness", -1e9),
        ("stop_stiffness", np.inf),
        ("stop_damping_ratio", -0.1),
    ],
)
def test_a_wrong_option_is_named(option: str, value: float) -> None:
    with pytest.raises(InputError, match=option):
        ExudynEngine(**{option: value})


def test_a_stiffness_beyond_rounding_is_refused() -> None:
    """Roundings of an angle, 1e-15 rad, may be 1e-4 of the largest torque."""
    start = table_one_motion("fixed").trajectory(np.zeros(1))
    largest = max(start.stop_torque(rest)[0] for rest in RESTS)
    message = (
        "^stop_stiffness = 1e+20 N m/rad would turn the rounding of angles into a torque of "
        f"1e+05 N m, of {largest:.3g} N m in the stops; at most {largest * 1e11:.2g} is resolved"
    )
    with pytest.raises(InputError, match=message.replace("e+", r"e\+")):
        ExudynEngine(stop_stiffness=1e20).simulate(Problem(fixed(), 0.5))


@pytest.mark.parametrize("arm", [0.5, 1.6])
def test_a_stiffness_beyond_the_rounding_of_a_point_is_refused(arm: float) -> None:
    """Roundings are 1e-15 m, or as much of a place beyond one metre."""
    force, rounding = 2.0 * G * 1.0 / arm, 1e-15 * max(1.0, arm)
    message = (
        f"of a point's place into a force of {1e20 * rounding:.2g} N, of {force:.3g} N in the "
        f"stops; at most {1e-4 * force / rounding:.2g} is resolved"
    )
    with pytest.raises(InputError, match=message.replace("e+", r"e\+")):
        ExudynEngine(stop_stiffness=1e20).simulate(Problem(lying_rod("point", arm), 0.5))
