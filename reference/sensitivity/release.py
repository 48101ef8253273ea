"""Derivatives of a release by every parameter and start value, event times included.

The state's derivatives are those of :mod:`.tangent`, of any mechanism; here the release's time
follows by the implicit function theorem, the flight in closed form, and the whipper's numbers from
its parameters by a complex step. Of other machines the derivatives are by all their physical
numbers (:mod:`.numbers`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import AnyJoint
from ...models.errors import InputError, UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.launch import LAUNCH_ANGLE, lead
from ...models.library.registry import model
from ...models.library.trebuchet import TrebuchetParameters
from ...models.mechanism import Marker, Mechanism
from ...models.problem import Problem
from ..solution import Solution
from ..solver import solve, solve_to_launch
from ..throw.flight import LEVEL
from ..throw.release import Projectile
from ..throw.throw import Held, Performance, Sensitivity, origin
from .dual import Dual
from .kinks import one_sided, sides
from .numbers import physical_numbers
from .tangent import PointTangent, StateTangent, marker_tangent, state_tangent
from .variational import Direction, VariationalEquations, moved, numbers

_STEP = 1e-200  # of the complex step: its square underflows, so nothing is truncated
_SAME = 1e-14  # relative: the two formulas may round differently, by a few units in the last place
_ORIGIN = "where ranges are measured from"
_GRAZES = 1e-9  # relative: the time of a release whose condition changes more slowly is lost


@dataclass(frozen=True)
class Moment:
    """A release of a motion, and what is held when the mechanism changes."""

    time: float
    """[s]."""
    held: Held = "velocity"
    angle: float = LAUNCH_ANGLE
    """Of the velocity above the horizontal [rad]; held by "velocity"."""


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of a release by parameters and start values, in SI units per SI unit."""

    names: tuple[str, ...]
    """`TrebuchetParameters`, start speeds ("u_theta", ...), start slides ("x_p0")."""
    values: FloatArray
    """Of each, shape (n,)."""
    launch_time: float
    """Time of the release, by default of the velocity's fall to 45 degrees [s]."""
    launch_speed: float
    """[m/s]."""
    range: float
    """Landing x in the world, in vacuum at y = 0 or the ground asked for [m].

    NaN where it never lands (let go below the ground, too slow to rise to it) or gravity is
    not downwards."""
    d_launch_time: FloatArray
    d_launch_speed: FloatArray
    d_launch_angle: FloatArray
    """Of the velocity above the horizontal [rad per unit]."""
    d_range: FloatArray
    """Shape (n,)."""
    d_release_times: dict[str, FloatArray]
    """By stop, shape (n,); NaN where it did not open between the start and the launch."""
    one_sided: tuple[str, ...] = ()
    """Sentences on derivatives that hold one way only, or do not exist (NaN)."""


def whipper_sensitivities(
    build: Callable[[TrebuchetParameters], Mechanism],
    parameters: TrebuchetParameters | None = None,
    duration: float | None = None,
) -> Sensitivities:
    """Differentiate the launch of a whipper, fixed or rolling, with respect to all it is made of.

    A start angle takes its rest along (the rests stand where the machine starts). A start speed is
    a kick of which only the part counts that the closed rests let through; see
    `VariationalEquations.start`. From a rest gone at t = 0, because it would have to pull, the kick
    leads away; one towards it would strike it, which `one_sided` says.

    Args:
        build: `fixed` or `rolling`, or a function that makes the same machines.
        parameters: Table I where left out.
        duration: how long the machine has to launch [s]; some five of its characteristic times if
            left out.

    Raises:
        InputError: the machine does not launch within the duration, or `build` makes another
        machine.
        SimulationError: an integrator's step size collapsed.
    """
    p = parameters or TrebuchetParameters()
    mechanism = build(p)
    directions = parameter_directions(build, p) | _start_directions(mechanism)
    if duration is None:
        solution = solve_to_launch(mechanism)
    else:
        solution = solve(Problem(mechanism, duration=duration))
    if solution.launch is None:
        spent = solution.problem.duration
        raise InputError(
            f"the {mechanism.name!r} machine does not launch within duration = {spent:g} s: its "
            "projectile's velocity never comes down to 45 degrees; another machine or a longer "
            "duration is needed."
        )
    values = np.array([_value(mechanism, p, name) for name in directions])
    return _of_the_release(
        solution,
        tuple(directions),
        values,
        tuple(directions.values()),
        Moment(solution.launch.time),
    )


def _start_directions(mechanism: Mechanism) -> dict[str, Direction]:
    names, n_angles = mechanism.coordinates, len(mechanism.angles)
    speeds: dict[str, Direction] = {
        f"u_{name}": {f"start_speeds.{i}": 1.0} for i, name in enumerate(names)
    }
    slides: dict[str, Direction] = {
        f"{name}0": {f"start.{n_angles + i}": 1.0} for i, name in enumerate(names[n_angles:])
    }
    return speeds | slides


def _value(mechanism: Mechanism, parameters: TrebuchetParameters, name: str) -> float:
    if name in TrebuchetParameters.model_fields:
        return float(getattr(parameters, name))
    if name.startswith("u_"):
        return float(
            initial_state(mechanism)[1][mechanism.coordinates.index(name.removeprefix("u_"))]
        )
    return mechanism.start[mechanism.coordinates.index(name.removesuffix("0"))]


def _of_the_release(
    solution: Solution,
    names: tuple[str, ...],
    values: FloatArray,
    directions: Sequence[Direction],
    moment: Moment,
    ground: float = 0.0,
    measured_from: AnyJoint | None = None,
) -> Sensitivities:
    """Derivatives along directions, each of the size of its value, at a release.

    Args:
        solution: the motion.
        names, values, directions: of what it is differentiated by.
        moment: the release.
        ground: where the projectile lands [m].
        measured_from: with whose place at the start the ground and the origin of the range move;
            the world's if None.

    Raises:
        UnsupportedProblemError: the motion or the release does not depend smoothly on the numbers.
    """
    # Large values per relative change, so that the integrator's one absolute tolerance suits all
    # directions.
    scale = np.maximum(1.0, np.abs(values))
    scaled = [{k: v * s for k, v in d.items()} for d, s in zip(directions, scale, strict=True)]
    mechanism = solution.problem.mechanism
    if measured_from is not None:
        mechanism, scaled = _with_origin(mechanism, measured_from, scaled)
    equations = VariationalEquations(mechanism, scaled, names)
    state = state_tangent(solution, equations, moment.time)
    if measured_from is not None:
        d_origin = _d_origin(equations, len(state.q))
    else:
        d_origin = np.zeros((len(scaled), 2))
    point = marker_tangent(equations, state)
    # What is held at the release's time t(p) fixes t; what is read there moves with p and with t.
    d_time = release_time_tangent(solution, equations, state, point, moment)
    d_time = np.where(np.isnan(sides(state.kinks, len(names))), np.nan, d_time)
    d_position = point.d_position + d_time[:, None] * point.velocity
    d_velocity = point.d_velocity + d_time[:, None] * point.acceleration
    speed = math.hypot(*point.velocity)
    (vx, vy), (sideways, upwards) = point.velocity, equations.mechanism.gravity_vector
    gravity = -upwards if abs(sideways) <= LEVEL * abs(upwards) else 0.0  # tilted: no landing
    above = d_position - [0.0, 1.0] * d_origin
    landing, d_landing = _landing(
        point, above, d_velocity, gravity, equations.along("gravity"), ground
    )
    return Sensitivities(
        names=names,
        values=values,
        launch_time=state.t,
        launch_speed=speed,
        range=landing,
        d_launch_time=d_time / scale,
        d_launch_speed=d_velocity @ point.velocity / speed / scale,
        d_launch_angle=(d_velocity @ np.array([-vy, vx])) / speed**2 / scale,
        d_range=(d_landing - d_origin[:, 0]) / scale,
        d_release_times={name: d / scale for name, d in state.d_release_times.items()},
        one_sided=tuple(one_sided(state.kinks, names)),
    )


def _with_origin(
    mechanism: Mechanism, joint: AnyJoint, directions: Sequence[Direction]
) -> tuple[Mechanism, list[dict[str, float]]]:
    """The mechanism with a marker where a joint holds its child, moving with its numbers."""
    marker, known = f"markers.{_ORIGIN}.point", f"joints.{joint.name}.child_point"
    moving = [
        dict(d) | {f"{marker}.{i}": d.get(f"{known}.{i}", 0.0) for i in (0, 1)} for d in directions
    ]
    markers = (*mechanism.markers, Marker(name=_ORIGIN, body=joint.child, point=joint.child_point))
    return mechanism.model_copy(update={"markers": markers}), moving


def _d_origin(equations: VariationalEquations, n_q: int) -> FloatArray:
    """Derivatives of that marker's place at the start, shape (m, 2)."""
    start = Dual(initial_state(equations.mechanism)[0], equations.along_each("start", n_q))
    place: Any = equations.kinematics.position(equations.data.markers[_ORIGIN], cast("Any", start))
    return place.tangents.T


def release_time_tangent(
    solution: Solution,
    equations: VariationalEquations,
    state: StateTangent,
    point: PointTangent,
    moment: Moment,
) -> FloatArray:
    """Derivatives of the release's time, by the implicit function theorem, shape (m,)."""
    if moment.held == "time":
        return np.zeros(len(equations.directions))
    if any(time == moment.time for time, _ in solution.impacts):
        raise _not_smooth(moment, "an impact turns the velocity through its angle")
    if moment.held == "velocity":
        rate, changes = lead(point.acceleration, moment.angle), lead(point.d_velocity, moment.angle)
        if abs(rate) <= _GRAZES * math.hypot(*point.acceleration):
            raise _not_smooth(moment, "the velocity only grazes its angle")
        return -changes / rate
    rate, changes = _sling(Projectile(solution), equations, state)
    if abs(rate) <= _GRAZES * np.abs(state.u).max():
        raise _not_smooth(moment, "the sling only grazes its angle")
    return -changes / rate


def _sling(
    projectile: Projectile, equations: VariationalEquations, state: StateTangent
) -> tuple[float, FloatArray]:
    """The sling angle's rate [rad/s], and its derivatives at a fixed time, shape (m,)."""
    names = projectile.body.name, projectile.arm or projectile.body.name
    angle = equations.kinematics.angle(*names)
    turned = [
        float(Kinematics(moved(equations.mechanism, direction)).angle(*names).value(state.q + dq))
        for direction, dq in zip(equations.directions, state.dq, strict=True)
    ]
    start = float(angle.value(state.q))
    return float(angle.value(state.q + state.u)) - start, np.array(turned) - start


def _not_smooth(moment: Moment, why: str) -> UnsupportedProblemError:
    return UnsupportedProblemError(
        f"the release at t = {moment.time:.6g} s has no derivatives: {why}."
    )


def _landing(
    point: PointTangent,
    d_position: FloatArray,
    d_velocity: FloatArray,
    gravity: float,
    d_gravity: FloatArray,
    ground: float,
) -> tuple[float, FloatArray]:
    """Landing x of a thrown point in vacuum [m], and its derivatives, shape (m,)."""
    (x, y), (vx, vy) = point.position, point.velocity
    squared = vy * vy + 2 * gravity * (y - ground)  # of the vertical speed at the ground
    if gravity == 0 or squared <= 0:
        return math.nan, np.full(len(d_gravity), np.nan)
    fall = math.sqrt(squared)
    time = (vy + fall) / gravity
    # y + vy T - g T^2 / 2 = ground differentiated; vy - g T = -fall.
    d_time = (d_position[:, 1] + time * d_velocity[:, 1] - time * time / 2 * d_gravity) / fall
    return float(x + vx * time), d_position[:, 0] + time * d_velocity[:, 0] + vx * d_time


def whipper_numbers(p: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of the whipper that depend on its parameters, as `models/trebuchet.py` has them.

    Plain arithmetic, so that it can be followed by a complex step, which validated descriptions
    cannot. Checked against the machine itself on each use, and in the tests.

    Args:
        p: values of the fields of `TrebuchetParameters`, real or complex.
    """
    return {
        "bodies.arm.mass": p["m_a"],
        "bodies.arm.centre.0": (p["l1"] - p["l2"]) / 2,
        "bodies.arm.inertia": p["m_a"] * (p["l1"] + p["l2"]) ** 2 / 12,
        "bodies.sling.mass": p["m_b"],
        "bodies.sling.centre.0": p["r"],
        "bodies.hanger.mass": p["m_cw"],
        "bodies.hanger.centre.0": p["h"],
        "joints.sling pin.parent_point.0": p["l1"],
        "joints.hanger pin.parent_point.0": -p["l2"],
        "stops.hanger rest.limit": p["theta0"] - p["alpha0"],
        "stops.sling rest.limit": p["phi0"] - p["theta0"],
        "markers.projectile.point.0": p["r"],
        "markers.counterweight.point.0": p["h"],
        "markers.arm centre.point.0": (p["l1"] - p["l2"]) / 2,
        "gravity": p["g"],
        "start.0": p["theta0"],
        "start.1": p["phi0"],
        "start.2": p["alpha0"],
    }


def parameter_directions(
    build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters
) -> dict[str, Direction]:
    """How the machine's numbers change with each field of the parameters: exact, by a complex step.

    f(p + i h) = f(p) + i h f'(p) + O(h^2) (Squire and Trapp, SIAM Review 40 (1998) 110-112): no
    difference is taken, so h can be so small that only rounding is left.

    Raises:
        InputError: `build` does not make a whipper, or makes its numbers otherwise than
            `models/trebuchet.py`.
    """
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    _refuse_another_machine(build, parameters)
    directions: dict[str, Direction] = {}
    for name in values:
        stepped = whipper_numbers({k: complex(v, _STEP * (k == name)) for k, v in values.items()})
        directions[name] = {k: complex(v).imag / _STEP for k, v in stepped.items()}
    return directions


def _refuse_another_machine(
    build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters
) -> None:
    """Compare all numbers at two sets of parameters, which shows what depends on them."""
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    other = {name: value * 1.01 + 0.001 * (i + 1) for i, (name, value) in enumerate(values.items())}
    first = numbers(build(parameters))
    second = numbers(build(parameters.model_copy(update=other)))
    for actual, at in ((first, values), (second, other)):
        expected = first | whipper_numbers(at)
        for name in expected | actual:
            a, b = actual.get(name), expected.get(name)
            if a is None or b is None or abs(a - b) > _SAME * max(1.0, abs(a), abs(b)):
                raise InputError(
                    f"build makes {name} = {a!r} where the whipper trebuchet has {b!r}; "
                    "sensitivities to its "
                    "parameters are known for the fixed and the rolling machine."
                )


def sensitivities_of(
    performance: Performance, name: str | None = None, parameters: TrebuchetParameters | None = None
) -> tuple[tuple[Sensitivity, ...], tuple[str, ...]]:
    """Derivatives of a throw's release in vacuum: of a whipper by parameters and start values.

    Of any other mechanism by all its physical numbers, those first of which one per cent moves the
    landing most.

    Args:
        performance: the throw.
        name: "fixed" or "rolling", if it is one of them.
        parameters: of that machine.

    Returns:
        The derivatives, and sentences on those that do not exist or hold one way only.
    """
    release = performance.flight.release
    moment = Moment(release.time, performance.held, release.angle)
    solution, ground = performance.solution, performance.surroundings.ground
    mechanism = solution.problem.mechanism
    units, sentences, joint = dict[str, str](), list[str](), None
    if name is None:
        joint = origin(mechanism)
        known, sentences = physical_numbers(mechanism, performance.projectile.name)
        units = {each.name: each.unit for each in known}
        values = np.array([each.value for each in known])
        directions = {each.name: each.direction for each in known}
    else:
        p = parameters or TrebuchetParameters()
        directions = parameter_directions(lambda p: model(name, p), p) | _start_directions(
            mechanism
        )
        values = np.array([_value(mechanism, p, each) for each in directions])
    try:
        found = _of_the_release(
            solution, tuple(directions), values, tuple(directions.values()), moment, ground, joint
        )
    except UnsupportedProblemError as error:
        return (), (f"there are no sensitivities: {str(error).removesuffix('.')}",)
    listed = _listed(found, units)
    return (tuple(sorted(listed, key=_effect)) if name is None else listed), (
        *sentences,
        *found.one_sided,
    )


def _listed(found: Sensitivities, units: Mapping[str, str]) -> tuple[Sensitivity, ...]:
    return tuple(
        Sensitivity(
            name=each,
            value=float(found.values[i]),
            unit=units[each] if each in units else _unit(each),
            launch_time=float(found.d_launch_time[i]),
            launch_speed=float(found.d_launch_speed[i]),
            launch_angle=float(found.d_launch_angle[i]),
            range=None if math.isnan(found.d_range[i]) else float(found.d_range[i]),
        )
        for i, each in enumerate(found.names)
        if not math.isnan(found.d_launch_time[i])
    )


def _effect(each: Sensitivity) -> tuple[float, float]:
    """Sort key: the effect of one per cent on the range (or speed), then of one unit."""
    slope = abs(each.launch_speed if each.range is None else each.range)
    return -abs(each.value) * slope, -slope


def _unit(name: str) -> str:
    """Unit of a parameter, from its description; of a start value, by its name."""
    if name in TrebuchetParameters.model_fields:
        unit = re.search(r"\[(.+)\]", TrebuchetParameters.model_fields[name].description or "")
        return unit.group(1) if unit else ""
    slide = "x_p" in name
    return ("m/s" if slide else "rad/s") if name.startswith("u_") else "m" if slide else "rad"
