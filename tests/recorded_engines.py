"""Cases of `recorded.py` for the adapters: mechanisms whose joints, stops and loads are nowhere at
an origin, on an axis or at a right angle, so that no sign and no offset can be lost.

What an engine shows of a mechanism is held against the reference's equations at once
(:func:`check_model`), so that no wrong model can be recorded as a right one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import trebucheck as tb
from mechanisms import angle_stop, body_of, chain, hanging_bob, pin, slider_crank
from trebucheck.comparisons.diagnosis.equivalence import check_model, random_states
from trebucheck.engines.registry import causes_of, engine_study
from trebucheck.engines.study import ConstraintKinds
from trebucheck.models.elements import (
    GROUND,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.reference.solver import solve


def between() -> Mechanism:
    """A chain whose bodies rest on each other, named from the upper one, not at rest relative to
    the ground.
    """
    rest = Stop(name="between", body="upper", relative_to="lower", sense=-1, limit=-0.1,
                closed=True)  # fmt: skip
    # Without a load pymunk has a point mass of the lower body
    pull = ConstantForce(name="pull", body="lower", point=(0.1, 0.2), force=(2.0, -1.0))
    return chain(rest, start_speeds=(0.8, 0.8), force_elements=(pull,))


def level() -> Mechanism:
    """The lower body of a chain is held by the ground, which it is not pinned to."""
    rest = Stop(name="level", body="lower", sense=1, limit=0.2, closed=True)
    return chain(rest, start_speeds=())


def braced(named: str = "bob") -> Mechanism:
    """A bob on an arm, held against the arm until it would have to be pulled.

    Args:
        named: the body that the stop is named from.
    """
    other = "arm" if named == "bob" else "bob"
    angle = {"arm": 0.4, "bob": 1.3}
    sense = 1 if named == "bob" else -1
    limit = sense * (angle[named] - angle[other])
    rest = Stop(name="rest", body=named, relative_to=other, sense=sense, limit=limit, closed=True)
    return Mechanism(
        name=f"braced {named}",
        bodies=(
            Body(name="arm", angle="a", mass=2.0, centre=(0.3, 0.1), inertia=0.4),
            Body(name="bob", angle="b", mass=0.7, centre=(0.5, -0.2), inertia=0.0),
        ),
        joints=(pin("axle", GROUND, "arm", (0.1, 1.5), (0.05, 0.02)),
                pin("hook", "arm", "bob", (0.9, 0.2), (0.0, 0.0))),
        stops=(rest,),
        markers=(Marker(name="tip", body="bob", point=(0.5, -0.2)),),
        gravity=9.81,
        start=(0.4, 1.3),
    )  # fmt: skip


def leaning(on: str = GROUND) -> Mechanism:
    """A hook of a chain leans on a tilted wall: of the ground, or of a body that turns."""
    m = chain(start_speeds=())
    normal = (0.6, 0.8)
    wall = PointStop(name="wall", body="lower", point=(0.2, -0.9), relative_to=on, normal=normal,
                     offset=-5.0, closed=False)  # fmt: skip
    bodies, joints, start = list(m.bodies), list(m.joints), list(m.start)
    if on != GROUND:
        bodies.append(Body(name=on, angle="c", mass=4.0, centre=(0.2, -0.1), inertia=1.5))
        joints.append(pin("gate", GROUND, on, (2.0, 0.5), (0.1, 0.0)))
        start.append(0.25)
    fields: dict[str, object] = {
        "bodies": tuple(bodies),
        "joints": tuple(joints),
        "start": tuple(start),
    }
    placed = chain(wall, start_speeds=(), **fields)
    # Its offset is where the hook is
    gap = float(Kinematics(placed).gap("wall", np.array(placed.start)))
    there = wall.model_copy(update={"offset": gap - 5.0, "closed": True})
    return chain(there, start_speeds=(), **fields)


def framed(closing: str) -> Mechanism:
    """Two bodies side by side, tied by a joint that closes a loop in its own way."""
    q = (0.4, 1.1)

    def point(origin: complex, angle: float, local: complex) -> complex:
        return origin + local * np.exp(-1j * angle)

    feet = (0.0 + 0.3j, 1.4 - 0.2j)
    left = 0.8 + 0.15j
    place = point(feet[0], q[0], left)
    if closing in ("slot", "rail"):
        axis = 0.28 + 0.96j
        # A point of the right body on a line of the left one
        along = 0.25
        place = point(feet[0], q[0], left + along * axis)
    there = (place - feet[1]) * np.exp(1j * q[1])
    here = (left.real, left.imag)
    ends = {"name": "tie", "parent": "left", "child": "right", "parent_point": here,
            "child_point": (there.real, there.imag)}  # fmt: skip
    tie: Any = PinJoint(**ends)
    if closing == "weld":
        tie = WeldJoint(**ends, angle=q[1] - q[0])
    if closing == "slot":
        tie = SlotJoint(**ends, axis=(0.28, 0.96))
    if closing == "rail":
        tie = PrismaticJoint(**ends, axis=(0.28, 0.96), angle=q[1] - q[0])
    rails = tuple(
        SlotJoint(name=f"rail {name}", parent=GROUND, child=name,
                  parent_point=(foot.real, foot.imag), child_point=(0.0, 0.0),
                  axis=(math.cos(k), math.sin(k)), coordinate=f"s {name}")
        for k, (name, foot) in enumerate(zip(("left", "right"), feet, strict=True))
    )  # fmt: skip
    return Mechanism(
        name=f"frame with a {closing}",
        bodies=(
            Body(name="left", angle="a", mass=1.5, centre=(0.3, 0.2), inertia=0.2),
            Body(name="right", angle="b", mass=0.8, centre=(-0.1, -0.3), inertia=0.15),
        ),
        joints=(*rails, tie),
        markers=(Marker(name="tip", body="right", point=(0.2, 0.3)),),
        gravity=9.81,
        gravity_direction=(0.6, -0.8),
        start=(*q, 0.0, 0.0),
    )


def loaded_bob() -> Mechanism:
    """Loads on a point mass on a rod: off its mass, against the arm that it hangs on."""
    arm = body_of("arm", "a", 2.0, (0.3, 0.1), 0.4)
    bob = body_of("bob", "b", 0.7, (0.5, -0.2), 0.0)
    return Mechanism(
        name="loaded bob",
        bodies=(arm, bob),
        joints=(pin("axle", GROUND, "arm", (0.1, 1.5), (0.05, 0.02)),
                pin("hook", "arm", "bob", (0.9, 0.2), (0.0, 0.0))),
        force_elements=(
            SpringDamper(name="tie", body="bob", point=(0.25, -0.3), relative_to="arm",
                         relative_point=(-0.4, 0.3), stiffness=60.0, damping=1.2, rest_length=0.5),
            RotationalSpringDamper(name="twist", body="bob", relative_to="arm", stiffness=4.0,
                                   damping=0.3, rest_angle=0.2),
            CubicTorsionSpring(name="bar", body="bob", relative_to=GROUND, stiffness=2.0,
                               cubic_stiffness=1.5, rest_angle=-0.2),
            ConstantForce(name="pull", body="bob", point=(0.1, 0.2), force=(2.0, -1.0)),
            ConstantTorque(name="motor", body="bob", relative_to="arm", torque=0.6),
        ),
        markers=(Marker(name="tip", body="bob", point=(0.6, 0.1)),),
        gravity=9.81,
        start=(0.4, 1.3),
        start_speeds=(0.6, -1.1),
    )  # fmt: skip


def between_stops() -> Mechanism:
    """A chain that meets stops on both sides, with a wall below: several at nearly one time."""
    return chain(
        Stop(name="left", body="upper", sense=-1, limit=-1.2, closed=False, restitution=0.6),
        Stop(name="right", body="lower", relative_to="upper", sense=1, limit=-0.2, closed=False,
             restitution=0.3),
        PointStop(name="floor", body="lower", point=(0.1, -1.0), normal=(0.0, 1.0), offset=0.35,
                  closed=False, restitution=0.4),
    )  # fmt: skip


def held_and_met() -> Mechanism:
    """A bob leaves the stop that it leans on, meets another one and comes back to the first."""
    return hanging_bob(
        angle_stop(1.8, 0.9, name="far"),
        Stop(name="rest", body="bob", sense=1, limit=1.2, closed=True, restitution=0.5),
        start=1.2,
        start_speeds=(2.0,),
    )


MODELS: dict[str, Callable[[], Mechanism]] = {
    "between": between,
    "level": level,
    "braced": braced,
    "braced from the arm": lambda: braced("arm"),
    "leaning": leaning,
    "leaning on a gate": lambda: leaning("gate"),
    **{f"frame: {c}": (lambda c=c: framed(c)) for c in ("pin", "weld", "slot", "rail")},
    "loaded bob": loaded_bob,
    "crank": lambda: slider_crank(tilt=0.3, centres=((0.5, 0.1), (0.9, -0.2))),
}
MOTIONS: dict[str, tuple[Callable[[], Mechanism], float, str]] = {
    "between stops": (between_stops, 0.9, "unilateral"),
    "held and met": (held_and_met, 0.9, "unilateral"),
    "between": (between, 0.3, "unilateral"),
    "braced": (braced, 0.3, "release-once"),
    "leaning": (leaning, 0.2, "unilateral"),
    "frame": (lambda: framed("slot"), 0.2, "release-once"),
    "loaded bob": (loaded_bob, 0.2, "release-once"),
}
"""Mechanism, duration [s] and law of the stops."""


def models(engine: str, shown: Callable[[Any, Mechanism], Any]) -> list[Any]:
    """What an engine shows of each mechanism that it builds; it is the reference's."""
    found: list[Any] = []
    for name, build in MODELS.items():
        mechanism, solver = build(), tb.engine(engine)
        try:
            equality = check_model(solver, mechanism)
        except tb.TrebucheckError as error:
            found.append([name, type(error).__name__])
            continue
        assert equality.holds, (name, equality.broken)
        held = any(state.closed for state in random_states(mechanism))
        assert held == bool(mechanism.stops), name
        found.append([name, shown(solver, mechanism)])
    return found


_FAR = 1e-3
"""[rad or m] Of second order in steps of 4 ms; a wrong sign is a hundred times as much."""


def motions(engine: str, summary: Callable[[tb.Trajectory], Any]) -> list[Any]:
    """An engine's motion, forces and events of each mechanism; they are near the reference's."""
    found: list[Any] = []
    for name, (build, duration, law) in MOTIONS.items():
        solver: Any = tb.engine(engine, timestep=4e-3)
        problem = tb.Problem(build(), duration=duration, stop_law=tb.StopLaw(law))
        try:
            moved = solver.simulate(problem)
        except tb.UnsupportedProblemError as error:
            found.append([name, type(error).__name__])
            continue
        right = solve(problem).trajectory(moved.t)
        assert np.abs(moved.q - right.q).max() < _FAR, name
        found.append([name, summary(moved)])
    return found


VARIANTS: dict[str, list[dict[str, Any]]] = {
    "mujoco": [
        {"integrator": "Euler", "timestep": 2e-3},
        {"solref": (0.01, 1.0), "timestep": 1e-3},
        {"solref": (-4e6, -4e3), "timestep": 1e-3},
        {"solimp": (0.9, 0.95, 0.01, 0.5, 2.0), "timestep": 1e-3},
        {"preload": False, "solver": "CG", "timestep": 2e-3},
        {"moving_points": False, "locate_releases": False, "timestep": 2e-3},
    ],
    "pymunk": [
        {"leapfrog": False, "timestep": 2e-3},
        {"hold_lengths": False, "timestep": 2e-3},
        {"locate_releases": False, "timestep": 4e-3},
        {"iterations": 40, "timestep": 4e-3},
        {"error_bias": 0.1, "timestep": 4e-3},
    ],
    "exudyn": [
        {"integrator": "generalized-alpha-index-3", "timestep": 4e-3},
        {"stop_stiffness": 1e7, "timestep": 2e-3},
        {"stop_stiffness": 1e8, "stop_damping_ratio": 0.5, "timestep": 2e-3},
        {"locate_releases": False, "timestep": 4e-3},
        {"modified_newton": True, "timestep": 4e-3},
        {"adaptive_step": True, "timestep": 4e-3},
    ],
}
"""Options over the preset's that are seldom set."""
AT_LIMITS: dict[str, list[dict[str, Any]]] = {
    "mujoco": [
        {"solref": (0.004, 1.0), "timestep": 1e-3},
        {"solref": (0.0039, 1.0), "timestep": 1e-3},
        {"solimp": (0.9999, 0.5, 0.001, 0.5, 2.0)},
        {"solimp": (0.5, 0.9999, 0.001, 0.5, 2.0)},
        {"tolerance": 0.0, "iterations": 1, "margin": 0.01},
        {"locate_releases": False, "preload": False, "keep_limits": False},
    ],
    "pymunk": [{"iterations": 1, "start_iterations": 1}, {"pivot_mass": 1.0}, {"error_bias": 1.0}],
    "exudyn": [{"newton_relative": 1e-2, "newton_absolute": 1e-2}, {"spectral_radius": 0.0}],
}
"""Options at which a refinement, or the removal of a cause, ends; for tables of studies alone."""
_NEARER = 0.05
"""[rad] Of what is soft, of first order or not located: of a motion over two radians."""


def variants(engine: str, summary: Callable[[tb.Trajectory], Any]) -> list[Any]:
    """Motions with options that are seldom set, of machines whose stops let go."""
    found: list[Any] = []
    for options in VARIANTS[engine]:
        for build, duration in ((tb.fixed, 1.4), (tb.hinged, 0.9)):
            if build is tb.hinged and options.get("solref", (1.0,))[0] < 0:
                continue  # so much damping lets the trough go at once
            problem = tb.Problem(build(), duration=duration)
            try:
                moved = tb.engine(engine, **options).simulate(problem)
            except (tb.UnsupportedProblemError, tb.InputError, tb.SimulationError) as error:
                found.append([type(error).__name__, str(error)])
                continue
            right = solve(problem).trajectory(moved.t)
            assert np.abs(moved.q - right.q).max() < _NEARER, (options, problem.mechanism.name)
            found.append(summary(moved))
    return found


def studied(engine: str) -> list[Any]:
    """What an engine says of its options: causes of error, refinements, sets of options, orders."""
    study = engine_study(engine)
    found: list[Any] = []
    mechanisms = (None, tb.hinged())
    every = [{}, *VARIANTS.get(engine, []), *AT_LIMITS.get(engine, [])]
    for preset in ("assisted", "default"):
        for options in every:
            made = tb.engine(engine, preset, **options)
            for mechanism in mechanisms:
                found.append(len(found))
                for cause in causes_of(made, mechanism):
                    ways = (cause.removal, cause.scaling)
                    described = [way and way.described(made.settings) for way in ways]
                    found.append([cause.name, list(cause.after), _plain(dict(cause.options))])
                    found.append(described)
                kinds = ConstraintKinds.of(mechanism)
                for refinement in study.refinements:
                    found.append(_plain(refinement.change(made.settings, kinds)))
            order = study.step_orders.get(preset)
            found.append(order and order.order)
    for chosen in study.option_sets:
        found.append([chosen.name, *(_plain(chosen.all_options(step)) for step in (1e-4, 3e-3))])
    for swept in study.swept_parameters:
        found.append([swept.name, list(swept.values), swept.expected, _plain(dict(swept.base))])
        found += [_plain(dict(swept.options(value))) for value in swept.values[:3]]
        found.append(_plain(swept.without))
    return found


def _plain(options: Any) -> Any:
    """Options as JSON, numbers in parts that no rounding to zero hides."""
    if isinstance(options, dict):
        return [[name, _plain(options[name])] for name in sorted(options)]
    if isinstance(options, list | tuple):
        return [_plain(value) for value in options]
    small = isinstance(options, float) and 0 < abs(options) < 1e-3
    return math.log10(abs(options)) if small else options
