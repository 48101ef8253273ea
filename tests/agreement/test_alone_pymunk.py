"""pymunk by itself: its own defaults, and every element of its documentation."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import bouncing, everything, pin, position_error, rod_pendulum, table_one_motion
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.presets import DEFAULT, SETTINGS
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.engines.pymunk.options import ALONE
from trebucheck.models.library.registry import library_problem
from trebucheck.models.library.trebuchet import HANGER_REST, SLING_REST

pymunk = pytest.importorskip("pymunk")


def _engine(preset: str, **options: Any) -> PymunkEngine:
    return PymunkEngine.presets()[preset](**options)


def _duffing() -> tb.Mechanism:
    """A rotor on a spring with a cubic term, and a constant torque against the ground."""
    return tb.Mechanism(
        name="duffing",
        bodies=(tb.Body(name="the rotor", angle="q", mass=2.0, centre=(0.1, 0), inertia=0.2),),
        joints=(pin("axle", "ground", "the rotor"),),
        stops=(),
        force_elements=(
            tb.CubicTorsionSpring(
                name="spring",
                body="the rotor",
                stiffness=3.0,
                cubic_stiffness=20.0,
                rest_angle=0.2,
            ),
            tb.ConstantTorque(name="motor", body="the rotor", torque=0.4),
        ),
        gravity=9.81,
        start=(1.1,),
    )


def _held_rod() -> tb.Mechanism:
    """A level rod of 2 kg, a metre long, on a pin at its end, that a stop keeps from falling."""
    stop = tb.Stop(name="rest", body="rod", sense=-1, limit=0.0, closed=True)
    body = tb.Body(name="rod", angle="q", mass=2.0, centre=(0.5, 0), inertia=2.0 / 12)
    return tb.Mechanism(
        name="held",
        bodies=(body,),
        joints=(pin("pivot", "ground", "rod"),),
        stops=(stop,),
        gravity=9.81,
        start=(0.0,),
    )


# --- Defaults of the installed pymunk


def _plain(thing: object) -> dict[str, object]:
    """Numbers of an object of pymunk's, by name."""
    values: dict[str, object] = {}
    for name in dir(thing):
        value = getattr(thing, name)
        if not name.startswith("_") and isinstance(value, int | float | bool):
            values[name] = value
    return values


def test_the_defaults_are_pymunks_own() -> None:
    from trebucheck.engines.pymunk.alone import build

    default = _engine(DEFAULT)
    bare, body = pymunk.Space(), pymunk.Body(1, 1)
    joint = pymunk.PivotJoint(bare.static_body, body, (0, 0), (0, 0))
    assert default.iterations == default.start_iterations == bare.iterations
    assert default.error_bias == joint.error_bias
    # A space has no step of its own: the first example of the README has 0.02 s.
    readme = importlib.metadata.distribution("pymunk").read_text("METADATA") or ""
    first = readme.index("space.step(")
    assert readme[first:].startswith(f"space.step({default.timestep!r})")

    made = build(everything(), default)
    space, own = made.assembly.space, _plain(bare)
    assert {"iterations", "damping", "collision_slop", "collision_bias"} <= own.keys()
    of_run = {"current_time_step"}
    for name, value in _plain(space).items():
        assert name in of_run or value == own[name], name
    kept = ("error_bias", "max_bias", "max_force", "collide_bodies")
    for constraint in space.constraints:
        assert [getattr(constraint, name) for name in kept] == [
            getattr(joint, name) for name in kept
        ]
    (wall,) = made.walls.values()
    assert wall.circle.friction == wall.segment.friction == pymunk.Circle(body, 1).friction


# --- Programs


CASES: Mapping[str, tb.Problem] = {
    # A contact with a restitution, all elements on moving bodies and a weld, and a cubic spring.
    "bouncing": tb.Problem(bouncing(0.3, 0.6), duration=1.0, stop_law=tb.StopLaw.UNILATERAL),
    "everything": tb.Problem(everything(), duration=0.3, stop_law=tb.StopLaw.UNILATERAL),
    "duffing": tb.Problem(_duffing(), duration=0.5),
}


@pytest.mark.parametrize("options", [{}, {"start_iterations": 50, "collision_slop": 0.01}])
@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS])
@pytest.mark.parametrize("name", CASES)
def test_a_program_has_the_same_motion(name: str, preset: str, options: dict[str, Any]) -> None:
    problem, engine = CASES[name], _engine(preset, **options)
    found: dict[str, Any] = {}
    exec(engine.script(problem), found)
    row = engine.simulate(problem)
    for key in ("t", "q", "u"):
        assert np.array_equal(found[key], getattr(row, key))


# --- The built model


@pytest.mark.parametrize(
    "name", ["squeezer", "quick-return", "bead", "motor", "welded-rods", "falling-rod", "hinged"]
)
def test_the_built_model_is_the_mechanism(name: str) -> None:
    problem = library_problem(name, None)
    mechanism = tb.model(name) if problem is None else problem.mechanism
    found = check_model(_engine(DEFAULT), mechanism)
    assert found.exposed and found.holds, found


def test_the_built_model_with_every_element_is_the_mechanism() -> None:
    for mechanism in (everything(), _duffing(), tb.fixed()):
        assert check_model(_engine(DEFAULT), mechanism).holds


def test_a_wrong_joint_is_seen_in_the_built_model(monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.pymunk import inspect

    right = inspect.build_documented

    def displaced(*arguments: Any) -> Any:
        made = right(*arguments)
        joint = next(iter(made.assembly.space.constraints))
        joint.anchor_b += pymunk.Vec2d(1e-6, 0.0)
        return made

    monkeypatch.setattr(inspect, "build_documented", displaced)
    assert not check_model(_engine(DEFAULT), tb.fixed()).holds


# --- What its elements do


def _errors(name: str, preset: str, steps: tuple[float, ...]) -> list[float]:
    """Largest distance of the projectile from the reference, nearly up to the launch [m]."""
    exact = table_one_motion(name)
    # To a whole number of the longest steps: the reference ends at the launch.
    end = exact.problem.duration // max(steps) * max(steps)
    problem = exact.problem.model_copy(update={"duration": end})
    runs = (_engine(preset, timestep=step).simulate(problem) for step in steps)
    return [position_error(row, exact) for row in runs]


@pytest.mark.parametrize("preset", [DEFAULT, SETTINGS])
def test_pins_are_of_first_order(preset: str) -> None:
    errors = _errors("fixed", preset, (2e-3, 1e-3))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.15)


def test_a_groove_lets_a_point_beside_the_centre_leave_its_line() -> None:
    """Where a release of pymunk mends that, what the engine's class says is to be changed."""
    space, body = pymunk.Space(), pymunk.Body(1.0, 0.5)
    space.iterations = 1000
    body.velocity = 1.0, 0.0
    groove = pymunk.GrooveJoint(space.static_body, body, (-9, 0.5), (9, 0.5), (0.5, 0.5))
    groove.error_bias = 1.0  # nothing is corrected
    space.add(body, groove)
    space.step(1e-9)
    speed = body.velocity_at_local_point((0.5, 0.5))
    # A point of the groove has no speed across it.
    assert abs(speed.y) > 0.1 * speed.x > 0.0


def test_a_limit_holds_what_leans_on_it() -> None:
    """The torque is the weight's, m g / 2, once a second step has found an error to hold."""
    problem = tb.Problem(_held_rod(), duration=0.5)
    engine = _engine(SETTINGS, limit_error_bias=0.5)
    row = engine.simulate(problem)
    torque = row.stop_torques["rest"]
    assert not torque[:2].any() and row.release_times["rest"] is None
    # A share 1 - bias^h of the error is undone in a step, and as much less is held.
    share = 1.0 - 0.5**engine.timestep
    assert torque[4:] == pytest.approx(9.81, rel=2 * share)
    # A couple carries no weight: that is all the pivot's.
    assert row.joint_reactions["pivot"][4:] == pytest.approx(
        np.broadcast_to([0.0, 19.62], (len(torque) - 4, 2)), abs=19.62 * 2 * share
    )


def test_releases_are_read_at_the_end_of_a_step() -> None:
    exact = table_one_motion("fixed")
    row = _engine(SETTINGS).simulate(exact.problem)
    for stop in (HANGER_REST, SLING_REST):
        released = row.release_times[stop]
        # Two steps: the end of the one in which the torque vanishes, and an error of first order.
        assert released in row.t
        assert released == pytest.approx(exact.release_times[stop], abs=2e-3)


def test_a_ball_bounces_with_its_restitution() -> None:
    problem = CASES["bouncing"]
    row = _engine(DEFAULT, timestep=1e-4).simulate(problem)
    speed = row.u[:, row.mechanism.coordinates.index("height")]
    first = int(np.flatnonzero(np.diff(speed) > 1.0)[0])
    # To gravity in a step or two.
    assert speed[first + 1] == pytest.approx(-0.6 * speed[first], abs=2 * 9.81e-4)


# --- Refusals


@pytest.mark.parametrize(
    "options",
    [
        {"leapfrog": True},
        {"hold_lengths": True},
        {"locate_releases": True},
        {"pivot_mass": 2.0},
        {"scaled_units": True},
    ],
)
def test_what_does_nothing_with_documented_joints_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(tb.InputError, match="documented"):
        PymunkEngine(**{**ALONE, **options})


@pytest.mark.parametrize(
    "name", ["groove_error_bias", "limit_error_bias", "collision_slop", "collision_bias"]
)
def test_what_does_nothing_with_rods_is_refused(name: str) -> None:
    with pytest.raises(tb.InputError, match="rods"):
        PymunkEngine(**{name: 0.5})


def test_a_restitution_on_an_angle_is_refused_where_it_matters() -> None:
    stop = tb.Stop(name="side", body="rod", sense=1, limit=-0.2, closed=False, restitution=0.5)
    mechanism = rod_pendulum(stop)
    met = tb.Problem(mechanism, duration=0.1, stop_law=tb.StopLaw.UNILATERAL)
    engine = _engine(DEFAULT)
    for run in (engine.simulate, engine.script):
        with pytest.raises(tb.UnsupportedProblemError, match="our adapter"):
            run(met)
    never_met = met.model_copy(update={"stop_law": tb.StopLaw.RELEASE_ONCE})
    assert engine.simulate(never_met).provenance.steps == 5


def test_a_point_mass_without_a_pin_to_take_mass_along_is_refused() -> None:
    trammel = library_problem("trammel", None)
    assert trammel is not None
    (rod,) = trammel.mechanism.bodies
    massless = trammel.mechanism.model_copy(
        update={"bodies": (rod.model_copy(update={"inertia": 0.0}),)}
    )
    with pytest.raises(tb.UnsupportedProblemError, match=rod.name):
        _engine(DEFAULT).simulate(tb.Problem(massless, duration=0.1))


def test_the_end_of_a_groove_is_no_stop() -> None:
    incline = library_problem("incline", None)
    assert incline is not None
    with pytest.raises(tb.SimulationError, match="rail"):
        _engine(DEFAULT).simulate(incline.model_copy(update={"duration": 30.0}))


def test_a_loop_with_a_slot_passes_its_singular_positions_with_an_error_of_first_order() -> None:
    """In its energy; with all of the pins' error undone in a step it is off by kilojoules."""
    problem = library_problem("singular-slider-crank", None)
    assert problem is not None

    def error(step: float, **options: Any) -> float:
        run = tb.engine("pymunk", SETTINGS, timestep=step, **options).simulate(problem)
        return float(np.abs(run.total_energy - run.total_energy[0]).max())

    coarse, fine = error(3.6e-4), error(1.8e-4)
    assert fine == pytest.approx(coarse / 2, rel=0.3)
    assert error(3.6e-4, slot_pin_error_bias=0.0) > 100 * coarse
