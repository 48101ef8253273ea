"""Derivatives of a release by every parameter and start value, event times included.

The state's derivatives are those of :mod:`.tangent`, of any mechanism; here the release's time
follows by the implicit function theorem, the flight in closed form, and the whipper's numbers from
its parameters by a complex step. Of other machines the derivatives are by all their physical
numbers, which have names that can be read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import AnyJoint, refuse_unknown
from ...models.elements.base import UNIT_VECTORS
from ...models.errors import InputError, UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.launch import LAUNCH_ANGLE, lead
from ...models.library.registry import model
from ...models.library.trebuchet import TrebuchetParameters, whipper_numbers
from ...models.mechanism import Marker, Mechanism
from ...models.problem import Problem
from ...models.spec import Spec, number_units
from ...models.stacked import numbers
from ..equations import Equations, least_step
from ..solution import Solution
from ..solver import solve, solve_to_launch
from ..throw.flight import LEVEL, Projectile
from ..throw.throw import Held, Performance, Sensitivity, origin
from .tangent import PointTangent, StateTangent, marker_tangent, one_sided, sides, state_tangent
from .variational import (
    Direction,
    Dual,
    VariationalEquations,
    consistent_directions,
    movable,
    moved,
)

_STEP = 1e-200  # of the complex step: its square underflows, so nothing is truncated
_SAME = 1e-14  # relative: the two formulas may round differently, by a few units in the last place
_ORIGIN = "where ranges are measured from"
_GRAZES = 1e-9  # relative: the time of a release whose condition changes more slowly is lost
_HELD = 1e-9  # a coordinate of which less is free than this cannot be chosen
_PLACES = {
    "point": "body",
    "relative_point": "relative_to",
    "parent_point": "parent",
    "child_point": "child",
}
"""The field with the body on which a point is."""


@dataclass(frozen=True)
class PhysicalNumber:
    """One number of a mechanism, and how the mechanism changes with it."""

    name: str  # such as "stiffness of strut spring"
    unit: str
    value: float
    direction: Direction


def physical_numbers(
    mechanism: Mechanism, thrown: str | None = None
) -> tuple[list[PhysicalNumber], list[str]]:
    """Numbers that change a motion, and sentences on those along which none is possible.

    With a number the start changes by the least that keeps loops closed and closed stops touching.
    With a coordinate of the start the closed stops move along, and the others of a loop follow.
    Unit vectors turn, anticlockwise.

    Args:
        mechanism: whose motion it is.
        thrown: the marker whose motion counts; all markers if left out.
    """
    described = [*_of_elements(mechanism, thrown)]
    described.append(PhysicalNumber("gravity", "m/s^2", mechanism.gravity, {"gravity": 1.0}))
    directions = consistent_directions(mechanism, [number.direction for number in described])
    known: list[PhysicalNumber] = []
    for number, direction in zip(described, directions, strict=True):
        known.append(replace(number, direction=direction))
    known += _starts(mechanism)
    speeds = initial_state(mechanism)[1]
    for i, (name, value) in enumerate(zip(mechanism.coordinates, speeds, strict=True)):
        unit = "rad/s" if i < len(mechanism.angles) else "m/s"
        direction = {f"start_speeds.{i}": 1.0}
        known.append(PhysicalNumber(f"start speed of {name}", unit, float(value), direction))
    # Without those that tear loops apart, whatever the start does.
    equations = VariationalEquations(mechanism, [number.direction for number in known])
    q = mechanism.start
    start = Dual(np.array(q), equations.along_each("start", len(q)))
    closed = movable(equations, [stop.name for stop in mechanism.stops if stop.closed])
    torn = equations.misfits(start, closed)
    sentences = [
        f"there is no derivative by the {known[j].name}: a change of it alone would lock the "
        "mechanism or open a loop"
        for j in torn
    ]
    return [number for j, number in enumerate(known) if j not in torn], sentences


def _of_elements(mechanism: Mechanism, thrown: str | None) -> Iterator[PhysicalNumber]:
    refuse_unknown("The table of sensitivities", mechanism.elements)
    for kind in ("bodies", "joints", "stops", "force_elements", "couplers", "markers"):
        for part in getattr(mechanism, kind):
            if kind != "markers" or thrown in (None, part.name):
                yield from _of_fields(part, f"{kind}.{part.name}")


def _of_fields(part: Spec, path: str) -> Iterator[PhysicalNumber]:
    """The numbers of a part of a mechanism, in the order of its fields."""
    for field, unit in number_units(type(part)).items():
        value = getattr(part, field)
        if value is None or (isinstance(part, Marker) and field == "mass"):
            continue  # a marker's mass is a part of its body's
        name = _name_of_number(part, field)
        if field in UNIT_VECTORS:
            x, y = value
            turned = {f"{path}.{field}.0": -y, f"{path}.{field}.1": x}
            yield PhysicalNumber(name, "rad", math.atan2(y, x), turned)
        elif isinstance(value, tuple):
            for i, component in enumerate("xy"):
                direction = {f"{path}.{field}.{i}": 1.0}
                yield PhysicalNumber(f"{name}, {component}", unit, value[i], direction)
        else:
            yield PhysicalNumber(name, unit, value, {f"{path}.{field}": 1.0})


def _name_of_number(part: Any, field: str) -> str:
    """Name a number, e.g. "stiffness of strut spring" or "direction of rail"."""
    name = part.name
    if "spring" in getattr(part, "kind", "") and "spring" not in name.lower():
        name += " spring"
    if field in _PLACES:
        return f"place of {name} on {getattr(part, _PLACES[field])}"
    if field in UNIT_VECTORS:
        return f"direction of {name}"
    if field == "centre":
        return f"centre of mass of {name}"
    return f"{field.replace('_', ' ')} of {name}"


def _starts(mechanism: Mechanism) -> Iterator[PhysicalNumber]:
    """The coordinates that loops let choose; closed stops stay where they touch."""
    equations, q = Equations(mechanism), initial_state(mechanism)[0]
    closed = [stop for stop in mechanism.stops if stop.closed]
    jacobian = equations.constraint_jacobian(q, [stop.name for stop in closed])
    loops, gaps = jacobian[: equations.n_loops], jacobian[equations.n_loops :]
    for i, name in enumerate(mechanism.coordinates):
        dq = np.eye(len(q))[i]
        if len(loops):
            dq = dq - least_step(loops, loops @ dq, equations.rank(q, ()))
        if dq[i] < _HELD:
            continue
        dq = dq / dq[i]
        direction = {f"start.{k}": float(value) for k, value in enumerate(dq)}
        for stop, gap in zip(closed, gaps, strict=True):
            direction[f"stops.{stop.name}.{stop.position_field}"] = float(gap @ dq)
        kind, unit = ("angle", "rad") if i < len(mechanism.angles) else ("position", "m")
        yield PhysicalNumber(f"start {kind} {name}", unit, float(q[i]), direction)


def scaled_directions(
    values: FloatArray, directions: Iterable[Direction]
) -> tuple[FloatArray, list[dict[str, float]]]:
    """Sizes of the values, and directions of relative changes of the large ones.

    One absolute tolerance of the integrator then suits all directions.
    """
    scale = np.maximum(1.0, np.abs(values))
    scaled: list[dict[str, float]] = []
    for direction, size in zip(directions, scale, strict=True):
        scaled.append({name: slope * size for name, slope in direction.items()})
    return scale, scaled


@dataclass(frozen=True)
class Moment:
    """A release of a motion, and what is held when the mechanism changes."""

    time: float  # [s]
    held: Held = "velocity"
    angle: float = LAUNCH_ANGLE  # of the velocity above the horizontal [rad]; held by "velocity"


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of a release by parameters and start values, in SI units per SI unit."""

    names: tuple[str, ...]
    """`TrebuchetParameters`, start speeds ("u_theta", ...), start slides ("x_p0")."""
    values: FloatArray  # of each, shape (n,)
    launch_time: float  # time of the release, by default of the velocity's fall to 45 degrees [s]
    launch_speed: float  # [m/s]
    range: float
    """Landing x in the world, in vacuum at y = 0 or the ground asked for [m].

    NaN where it never lands (let go below the ground, too slow to rise to it) or gravity is
    not downwards."""
    d_launch_time: FloatArray
    d_launch_speed: FloatArray
    d_launch_angle: FloatArray  # of the velocity above the horizontal [rad per unit]
    d_range: FloatArray  # as all of these, of shape (n,)
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
    values, directions = _whipper_directions(build, p, mechanism)
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
    return _of_the_release(solution, values, directions, Moment(solution.launch.time))


def _whipper_directions(
    build: Callable[[TrebuchetParameters], Mechanism], p: TrebuchetParameters, mechanism: Mechanism
) -> tuple[FloatArray, dict[str, Direction]]:
    """Values of the parameters, start speeds and start slides, and a direction of each by name."""
    directions = parameter_directions(build, p)
    values = [float(getattr(p, name)) for name in directions]
    names, n_angles = mechanism.coordinates, len(mechanism.angles)
    for i, name in enumerate(names):
        directions[f"u_{name}"] = {f"start_speeds.{i}": 1.0}
    values += initial_state(mechanism)[1].tolist()
    for i, name in enumerate(names[n_angles:], start=n_angles):
        directions[f"{name}0"] = {f"start.{i}": 1.0}
    values += mechanism.start[n_angles:]
    return np.array(values), directions


def _of_the_release(
    solution: Solution,
    values: FloatArray,
    directions: Mapping[str, Direction],
    moment: Moment,
    ground: float = 0.0,
    measured_from: AnyJoint | None = None,
) -> Sensitivities:
    """Derivatives at a release by numbers with these values and directions.

    The projectile lands at `ground` [m]. Ground and origin of the range move with the place at the
    start of the joint that they are measured from; None: they stay.

    Raises:
        UnsupportedProblemError: the motion or the release does not depend smoothly on the numbers.
    """
    names, mechanism = tuple(directions), solution.problem.mechanism
    scale, scaled = scaled_directions(values, directions.values())
    if measured_from is not None:
        # A marker where the joint holds its child moves with the joint's numbers.
        known, body = f"joints.{measured_from.name}.child_point", measured_from.child
        for direction in scaled:
            for i in (0, 1):
                direction[f"markers.{_ORIGIN}.point.{i}"] = direction.get(f"{known}.{i}", 0.0)
        marker = Marker(name=_ORIGIN, body=body, point=measured_from.child_point)
        mechanism = mechanism.model_copy(update={"markers": (*mechanism.markers, marker)})
    equations = VariationalEquations(mechanism, scaled, names)
    state = state_tangent(solution, equations, moment.time)
    d_origin = np.zeros((len(scaled), 2))
    if measured_from is not None:
        start_tangents = equations.along_each("start", len(state.q))
        start: Any = Dual(initial_state(mechanism)[0], start_tangents)
        place: Any = equations.kinematics.position(equations.data.markers[_ORIGIN], start)
        d_origin = place.tangents.T
    point = marker_tangent(equations, state)
    # What is held at the release's time t(p) fixes t; what is read there moves with p and with t.
    d_time = release_time_tangent(solution, equations, state, point, moment)
    d_time = np.where(np.isnan(sides(state.kinks, len(names))), np.nan, d_time)
    d_position = point.d_position + d_time[:, None] * point.velocity
    d_velocity = point.d_velocity + d_time[:, None] * point.acceleration
    speed = math.hypot(*point.velocity)
    (vx, vy), (sideways, upwards) = point.velocity, mechanism.gravity_vector
    gravity = -upwards if abs(sideways) <= LEVEL * abs(upwards) else 0.0  # tilted: no landing
    above = d_position - [0.0, 1.0] * d_origin
    d_gravity = equations.along("gravity")
    landing, d_landing = _landing(point, above, d_velocity, gravity, d_gravity, ground)
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
    why = None
    if any(time == moment.time for time, _ in solution.impacts):
        rate, changes = 0.0, np.zeros(0)
        why = "an impact turns the velocity through its angle"
    elif moment.held == "velocity":
        rate, changes = lead(point.acceleration, moment.angle), lead(point.d_velocity, moment.angle)
        if abs(rate) <= _GRAZES * math.hypot(*point.acceleration):
            why = "the velocity only grazes its angle"
    else:  # the sling's angle
        projectile = Projectile(solution)
        names = projectile.body.name, projectile.arm or projectile.body.name
        angle = equations.kinematics.angle(*names)
        start = float(angle.value(state.q))
        rate = float(angle.value(state.q + state.u)) - start
        turned: list[float] = []
        for direction, dq in zip(equations.directions, state.dq, strict=True):
            other = Kinematics(moved(equations.mechanism, direction)).angle(*names)
            turned.append(float(other.value(state.q + dq)))
        changes = np.array(turned) - start
        if abs(rate) <= _GRAZES * np.abs(state.u).max():
            why = "the sling only grazes its angle"
    if why is not None:
        raise UnsupportedProblemError(
            f"the release at t = {moment.time:.6g} s has no derivatives: {why}."
        )
    return -changes / rate


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


def parameter_directions(
    build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters
) -> dict[str, Direction]:
    """Derivatives of the machine's numbers by each parameter: exact, by complex steps.

    f(p + i h) = f(p) + i h f'(p) + O(h^2) (Squire and Trapp, SIAM Review 40 (1998) 110-112): no
    difference is taken, so h can be so small that only rounding is left.

    Raises:
        InputError: `build` does not make a whipper, or makes its numbers otherwise than
            `models/trebuchet.py`.
    """
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    # All numbers at two sets of parameters show what depends on them.
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
                    "sensitivities to its parameters are known for the fixed and the rolling "
                    "machine."
                )
    directions: dict[str, Direction] = {}
    for name in values:
        stepped = whipper_numbers({k: complex(v, _STEP * (k == name)) for k, v in values.items()})
        directions[name] = {k: complex(v).imag / _STEP for k, v in stepped.items()}
    return directions


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
    sentences, joint = list[str](), None
    if name is None:
        joint = origin(mechanism)
        known, sentences = physical_numbers(mechanism, performance.projectile.name)
        units = {number.name: number.unit for number in known}
        values = np.array([number.value for number in known])
        directions = {number.name: number.direction for number in known}
    else:
        p = parameters or TrebuchetParameters()
        values, directions = _whipper_directions(lambda p: model(name, p), p, mechanism)
        # Of parameters in their descriptions; of start values by their names.
        units = dict(number_units(TrebuchetParameters))
        for start in directions.keys() - units.keys():
            unit = "m" if "x_p" in start else "rad"
            units[start] = f"{unit}/s" if start.startswith("u_") else unit
    try:
        result = _of_the_release(solution, values, directions, moment, ground, joint)
    except UnsupportedProblemError as error:
        return (), (f"there are no sensitivities: {str(error).removesuffix('.')}",)
    listed: list[Sensitivity] = []
    for i, number in enumerate(result.names):
        if not math.isnan(result.d_launch_time[i]):
            sensitivity = Sensitivity(
                name=number,
                value=float(result.values[i]),
                unit=units[number],
                launch_time=float(result.d_launch_time[i]),
                launch_speed=float(result.d_launch_speed[i]),
                launch_angle=float(result.d_launch_angle[i]),
                range=None if math.isnan(result.d_range[i]) else float(result.d_range[i]),
            )
            listed.append(sensitivity)

    def effect(row: Sensitivity) -> tuple[float, float]:
        """The effect of one per cent on the range (or speed), then of one unit."""
        slope = abs(row.launch_speed if row.range is None else row.range)
        return abs(row.value) * slope, slope

    if name is None:
        listed.sort(key=effect, reverse=True)
    return tuple(listed), (*sentences, *result.one_sided)
