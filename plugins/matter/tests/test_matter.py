"""matter-js's defaults, and matter-js against closed forms and the reference; the rest is in
`plugins/tests`."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_matter.engine import OWN, MatterEngine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
GRAVITY, FRAME = 9.81, 1 / 60  # [m/s^2]; time of which matter-js has speeds and stiffness [s]
WARMING = 0.4
"""Part of a correction with which the next one begins, `Constraint._warming` of its source."""


def rod(inertia: float = 1 / 12, *, angle: float = 0.0, speed: float = 0.0) -> tb.Mechanism:
    """A kilogram with its centre 0.5 m from a pin in the ground."""
    body = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=inertia)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    return tb.Mechanism(
        name="rod",
        bodies=(body,),
        joints=(pin,),
        stops=(),
        gravity=GRAVITY,
        start=(angle,),
        start_speeds=(speed,),
        markers=(tb.Marker(name="tip", body="rod", point=(1, 0)),),
    )


def run(problem: tb.Problem, preset: str = "settings", **options: Any) -> tb.Trajectory:
    return tb.engine("matter", preset, **options).simulate(problem)


def error(
    problem: tb.Problem,
    truth: tb.Mechanism | None = None,
    preset: str = "settings",
    **options: Any,
) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = run(problem, preset, **options)
    longer = problem.model_copy(update={"duration": float(found.t[-1]) + 1e-9})
    if truth is not None:
        longer = longer.model_copy(update={"mechanism": truth})
    right = solve(longer).trajectory(found.t).markers
    return max(
        float(np.abs(m.position - right[name].position).max()) for name, m in found.markers.items()
    )


def test_the_defaults_are_matter_js_own() -> None:
    own = MatterEngine.npm.run(
        """
        import Matter from "matter-js";
        const { Body, Constraint, Engine } = Matter;
        const engine = Engine.create(), body = Body.create({});
        const pin = Constraint.create({ pointA: { x: 0, y: 0 }, bodyB: body, length: 0 });
        Engine.update(engine);
        console.log(JSON.stringify({
          timestep: engine.timing.lastDelta, iterations: engine.constraintIterations,
          stiffness: pin.stiffness, air_friction: body.frictionAir, sleep: engine.enableSleeping,
          warming: Constraint._warming, gravity: engine.gravity,
        }));
        """
    )
    assert own == {
        "timestep": 1000 * OWN["timestep"],
        "iterations": OWN["iterations"],
        "stiffness": OWN["stiffness"],
        "air_friction": OWN["air_friction"],
        "sleep": False,
        "warming": WARMING,
        "gravity": {"x": 0, "y": 1, "scale": 0.001},
    }
    default = tb.engine("matter", "default")
    assert {name: getattr(default, name) for name in OWN} == OWN
    program = default.script(tb.Problem(rod(), duration=0.1))
    for word in ("Iterations", "frictionAir", "stiffness", "timeScale", "scale:", "_"):
        assert word not in program


def test_the_free_swing_is_of_first_order_and_its_limit_is_the_reference() -> None:
    """Half the steps leave half the error, and of Richardson's limit's a quarter."""
    ends, errors = list[np.ndarray](), list[float]()
    for step in (1e-3, 5e-4, 2.5e-4, 1.25e-4):
        found = run(FREE_SWING, "assisted", timestep=step)
        ends.append(np.array([m.position[-1] for m in found.markers.values()]))
        errors.append(error(FREE_SWING, preset="assisted", timestep=step))
    truth = solve(FREE_SWING).trajectory(np.array([FREE_SWING.duration])).markers
    right = np.array([truth[name].position[-1] for name in found.markers])
    limits = [float(np.abs(2 * fine - coarse - right).max()) for coarse, fine in pairwise(ends)]
    for coarse, fine in pairwise(errors):
        assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)
    for coarse, fine in pairwise(limits):
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("pixels", [1.0, 3.0])
def test_a_pin_in_the_ground_adds_a_pixel_squared_to_the_inertia_of_each_kilogram(
    pixels: float,
) -> None:
    """Its constraint adds 1/mass and 1/inertia, so that motions converge to those of another
    body."""
    problem = tb.Problem(rod(), duration=2.0)
    heavier = rod(1 / 12 + pixels**-2)
    coarse, fine = (
        error(problem, heavier, timestep=step, pixels=pixels) for step in (5e-4, 2.5e-4)
    )
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)
    assert error(problem, timestep=2.5e-4, pixels=pixels) > 50 * fine


@pytest.mark.parametrize(("iterations", "share"), [(2, 2 / 3), (300, 1.0)])
def test_a_turning_rod_loses_speed_as_its_pins_force_points_where_the_pin_will_be(
    iterations: int, share: float
) -> None:
    """Points from the centre of mass as it is at the end of a step, so that from the speed w it
    takes m r^2 / (m r^2 + I) w^3 h a second. Iterations that end early leave the force to several:
    of it `WARMING` is a correction's that was half a step before, the square of that another half,
    and so on: 0.4 / 0.6 halves of a step less, two thirds of the loss."""
    speed, errors = 10.0, list[float]()
    turning = rod(speed=speed).model_copy(update={"gravity": 0.0})
    assert iterations > 2 or share == pytest.approx(1 - WARMING / (1 - WARMING) / 2)
    for step in (1e-3, 5e-4):
        problem = tb.Problem(turning, duration=2.0 if iterations == 2 else 0.5)
        found = run(problem, timestep=step, iterations=iterations)
        begun = len(found.t) // 2  # the pin has come to rest in its gap
        lost = found.u[-1, 0] ** -2 - found.u[begun, 0] ** -2
        errors.append(abs(lost / (2 * 0.75 * step * (found.t[-1] - found.t[begun])) - share))
        assert errors[-1] < speed * step  # terms of higher order
    assert iterations > 2 or np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


def test_a_hanging_pin_gives_way_less_with_shorter_steps() -> None:
    """Iterations of a step, each with a part of the gap, carry the weight; warming adds to
    them. The gap is of first order, and what the formula leaves out of the order after."""
    errors = list[float]()
    for step in (1e-4, 5e-5):
        found = run(tb.Problem(rod(angle=np.pi / 2), duration=0.5), timestep=step)
        iterations = 2 * tb.engine("matter", "settings").iterations
        part = iterations * OWN["stiffness"] * step / FRAME / (1 - WARMING)
        errors.append(abs(float(found.joint_gaps["pin"][-1]) * part / (GRAVITY * step**2) - 1))
        assert errors[-1] < part
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("below", "holds"), [(0.9, True), (1.1, False)])
def test_a_pin_holds_below_a_stiffness_of_its_lever(below: float, holds: bool) -> None:
    """An iteration takes back 1 + m r^2 / I times the stiffness of the gap across the lever; beyond
    twice the gap it grows. A uniform rod's lever is 3, so that it flies apart at 0.7."""
    limit = 2 / (1 + 3)
    found = run(
        tb.Problem(rod(), duration=2.0), "default", stiffness=below * limit, air_friction=0.0
    )
    assert (found.joint_gaps["pin"].max() < 0.1) == holds
    assert OWN["stiffness"] > limit


def test_inertias_of_its_shapes_are_four_times_those_of_their_areas() -> None:
    ratio = MatterEngine.npm.run(
        """
        import Matter from "matter-js";
        const { inertia, mass } = Matter.Bodies.rectangle(0, 0, 100, 1);
        console.log(JSON.stringify({ ratio: inertia / (mass * (100 ** 2 + 1 ** 2) / 12) }));
        """
    )["ratio"]
    assert ratio == pytest.approx(4.0, rel=1e-12)


@pytest.mark.parametrize(
    "name",
    [
        "n-four-bar",
        "three-cranks",
        "welded-rods",
        "motor",
        "thrown-plate",
        "spring-pendulum",
        "torsion-pendulum",
    ],
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
    coarse, fine = (error(problem, timestep=step) for step in (4e-4, 2e-4))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.2)


def test_gravity_has_any_direction() -> None:
    aslant = rod().model_copy(update={"gravity_direction": (0.6, -0.8)})
    coarse, fine = (error(tb.Problem(aslant, duration=1.0), timestep=step) for step in (4e-4, 2e-4))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def test_it_tells_no_forces_of_joints() -> None:
    found = run(tb.Problem(rod(), duration=0.01))
    assert found.joint_reactions == {} and found.stop_torques == {}
    assert not tb.engine("matter").capabilities.joint_reactions


@pytest.mark.parametrize(
    ("name", "words"),
    [("slider-crank", "slot"), ("incline", "prismatic"), ("bouncing", "restitution")],
)
def test_what_it_has_not_is_refused(name: str, words: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=words):
        run(benchmark(name).problem())
    with pytest.raises(tb.UnsupportedProblemError, match="stops on angles"):
        run(tb.Problem(tb.fixed(), duration=0.1))


def test_what_flies_apart_is_a_failed_run() -> None:
    with pytest.raises(tb.SimulationError, match="not finite"):
        run(tb.Problem(rod(), duration=2.0), "default", stiffness=1e6)
