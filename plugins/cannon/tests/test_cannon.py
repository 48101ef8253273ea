"""cannon-es's defaults, and cannon-es against the reference and closed forms; the rest is in
`plugins/tests`."""

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_cannon.engine import OWN, CannonEngine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
GRAVITY, MASS, LENGTH = 9.81, 2.0, 1.0


def _rod(start: float, speed: float = 0.0, **changes: Any) -> tb.Mechanism:
    """A uniform rod on a pin at its end; the angle pi / 2 hangs."""
    inertia, middle = MASS * LENGTH**2 / 12, (LENGTH / 2, 0.0)
    rod = tb.Body(name="rod", angle="a", mass=MASS, centre=middle, inertia=inertia)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    given = {"stops": (), "gravity": GRAVITY} | changes
    return tb.Mechanism(
        name="rod", bodies=(rod,), joints=(pin,), start=(start,), start_speeds=(speed,), **given
    )


def _error(problem: tb.Problem, step: float, **options: Any) -> float:
    """Greatest error of a coordinate [rad, m]."""
    found = tb.engine("cannon", timestep=step, **options).simulate(problem)
    within = found.t <= problem.duration
    return float(np.abs(found.q - solve(problem).trajectory(found.t[within]).q)[within].max())


def test_the_defaults_are_cannons_own() -> None:
    """Those of a fresh world, a fresh body and a fresh equation, and the step of `fixedStep`."""
    own = CannonEngine.npm.run(
        """
        import * as CANNON from "cannon-es";
        const world = new CANNON.World(), body = new CANNON.Body({ mass: 1 });
        world.fixedStep();
        const { a, b, eps } = new CANNON.Equation(body, body);
        const { iterations, tolerance } = world.solver;
        console.log(JSON.stringify({
          iterations, tolerance, step: [world.dt, world.default_dt], spook: [a, b, eps],
          damping: [body.linearDamping, body.angularDamping],
        }));
        """
    )
    assert own["iterations"] == OWN["iterations"] and own["tolerance"] == OWN["tolerance"]
    assert own["step"] == [OWN["timestep"]] * 2
    assert own["damping"] == [OWN["damping"]] * 2
    # The parameters of SPOOK; the engine keeps no others.
    h, k, d = OWN["equation_step"], OWN["stiffness"], OWN["relaxation"]
    spook = [4 / (h * (1 + 4 * d)), 4 * d / (1 + 4 * d), 4 / (h**2 * k * (1 + 4 * d))]
    assert own["spook"] == pytest.approx(spook, rel=1e-15)
    program = tb.engine("cannon", "default").script(tb.Problem(tb.fixed(), duration=0.1))
    for name in ("solver", "iterations", "setSpookParams", "Damping", "quatNormalize", "allowSl"):
        assert name not in program


def test_shorter_steps_leave_an_error_of_first_order_and_no_floor() -> None:
    """Errors in double precision: that of 0.5 ms is a quarter of that of 2 ms, within a tenth."""
    problem = FREE_SWING.model_copy(update={"duration": 1.0})
    assert _error(problem, 2e-3) / _error(problem, 5e-4) == pytest.approx(4.0, rel=0.1)


def test_to_hold_bodies_in_the_plane_costs_nothing() -> None:
    """Rounding of pi / 2 tilts axes by 1e-16; a motion of 1 s makes no more than 1e-9 of it."""
    problem = FREE_SWING.model_copy(update={"duration": 1.0})
    held, free = (
        tb.engine("cannon", timestep=4e-3, plane=plane).simulate(problem) for plane in (True, False)
    )
    assert np.abs(held.q - free.q).max() < 1e-9


def test_a_hanging_rods_pin_carries_its_weight_upwards() -> None:
    problem = tb.Problem(_rod(np.pi / 2), duration=0.1)
    engine = tb.engine("cannon")
    force = engine.simulate(problem).joint_reactions["pin"]
    # A constraint of stiffness k gives way by 4 / (h^2 k (1 + 4 d)) in parts of its inverse mass
    # (d: relaxation, h: step), until the gap has grown that makes up for it; the solver ends at a
    # sum of changes of 1e-12 N s, a force of 1e-8 N in a step.
    options, weight = engine.settings, MASS * GRAVITY
    names = "timestep", "stiffness", "relaxation"
    h, k, d = (float(options[name]) for name in names)  # type: ignore[arg-type]
    softness = 4 / (h**2 * k * (1 + 4 * d)) * MASS * weight
    assert np.abs(force - [0.0, weight]).max() <= softness + 1e-7


def test_the_force_of_a_swinging_rod_is_its_closed_form() -> None:
    """Newton's second law of its centre, at the engine's own angle and speed; of first order."""

    def error(step: float) -> float:
        problem = tb.Problem(_rod(0.0), duration=1.0)
        found = tb.engine("cannon", timestep=step).simulate(problem)
        q, u = found.q[:, 0], found.u[:, 0]
        turning = 1.5 * GRAVITY / LENGTH * np.cos(q)
        away = np.stack([np.cos(q), -np.sin(q)], axis=1)
        along = np.stack([-np.sin(q), -np.cos(q)], axis=1)
        closed = MASS * LENGTH / 2 * (turning[:, None] * along - u[:, None] ** 2 * away)
        closed += [0.0, MASS * GRAVITY]
        return float(np.abs(found.joint_reactions["pin"] - closed)[:-1].max())

    coarse, fine = error(4e-3), error(2e-3)
    # At 10 rad/s a step of 2 ms turns a force of 50 N by 1 N.
    assert fine < 1.0
    assert coarse / fine == pytest.approx(2.0, rel=0.2)


@pytest.mark.parametrize("name", ["motor", "spring-pendulum", "thrown-plate", "n-four-bar"])
def test_it_builds_every_element_that_it_declares(name: str) -> None:
    """First order at least: half a step leaves half of the error, or less."""
    problem = benchmark(name).problem()
    problem = problem.model_copy(update={"duration": min(0.5, problem.duration)})
    step = problem.duration / 250
    assert _error(problem, step) / _error(problem, step / 2) > 2**0.8


def test_a_weld_holds_an_angle() -> None:
    """Motion of welded bodies is of first order, and forces are those of the reference."""
    problem = benchmark("welded-rods").problem().model_copy(update={"duration": 0.3})
    coarse, fine = (_error(problem, h) for h in (2e-3, 1e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.2)


def test_a_rod_on_two_stops_stays_between_them() -> None:
    """A cone of two edges: the rod meets them at 2 rad/s; SPOOK lets it through by less than it
    goes in a step."""
    rest, end = (
        tb.Stop(name=name, body="rod", sense=sense, limit=-0.5, closed=False)
        for name, sense in (("rest", 1), ("end", -1))
    )
    step, problem = (
        1e-3,
        tb.Problem(
            _rod(0.0, 2.0, stops=(rest, end), gravity=0.0),
            duration=1.0,
            stop_law=tb.StopLaw.UNILATERAL,
        ),
    )
    found = tb.engine("cannon", "settings", timestep=step).simulate(problem)
    assert 0.5 - 2.0 * step < found.q.max() < 0.5 + 2.0 * step
    torque = found.stop_torques["end"]
    # What the stop has taken is what the rod's angular momentum has lost; what a step has let
    # through is pushed back. The gap of the pin is a lever that this leaves out.
    momentum, gap = MASS * LENGTH**2 / 3 * (2.0 - found.u[-1, 0]), found.joint_gaps["pin"].max()
    assert gap < 1e-5 * LENGTH
    assert torque.min() >= 0.0 and torque[:-1].sum() * step == pytest.approx(momentum, rel=1e-5)


def test_the_other_edge_of_a_stops_cone_is_three_quarters_of_a_turn_on() -> None:
    """A range of cannon-es alone; where a stop is let go for good, nothing is there."""
    stop = tb.Stop(name="rest", body="rod", sense=1, limit=0.0, closed=True)
    problem = tb.Problem(_rod(0.0, 8.0, stops=(stop,), gravity=0.0), duration=1.0)
    alone = tb.engine("cannon", "settings", timestep=1e-3).simulate(problem)
    assert alone.q.max() == pytest.approx(1.5 * np.pi, abs=8.0 * 1e-3)
    free = tb.engine("cannon", timestep=1e-3).simulate(problem)
    # A step at 8 rad/s misses the angle by a twelfth of its cube, a thousand of them by 5e-5.
    assert free.q.max() == pytest.approx(8.0, abs=1e-2)


def test_what_it_has_not_is_refused() -> None:
    for name, word in (("slider-crank", "slot"), ("bouncing", "points")):
        with pytest.raises(tb.UnsupportedProblemError, match=word):
            tb.engine("cannon").simulate(benchmark(name).problem())
    far = tb.Stop(name="end", body="rod", sense=-1, limit=-2.2 * np.pi, closed=False)
    problem = tb.Problem(_rod(0.0, stops=(far,)), duration=0.1, stop_law=tb.StopLaw.UNILATERAL)
    with pytest.raises(tb.UnsupportedProblemError, match="within half a turn"):
        tb.engine("cannon").simulate(problem)


def test_a_world_that_breaks_down_is_a_failed_run() -> None:
    with pytest.raises(tb.SimulationError, match=r"cannon-es failed: .*not a function"):
        CannonEngine.npm.run('import * as CANNON from "cannon-es"; new CANNON.World().slide();')
