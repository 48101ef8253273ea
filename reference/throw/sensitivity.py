"""Exact derivatives of a launch with respect to every parameter and start value, event times included.

Forward variational equations (Hairer, Norsett and Wanner, Solving ODEs I, Sec. I.14) are integrated with the motion,
from one release to the next. Nothing is differenced: the equations of motion are differentiated by hand
(:mod:`.variational`), event and launch times by the implicit function theorem, the flight in closed form.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import Kinematics, initial_state
from ...models.launch import lead
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ..integrator import Integrator
from ..solution import Solution
from ..solver import solve, solve_to_launch
from .throw import Sensitivity
from .variational import Direction, VariationalEquations, numbers

TOLERANCE = 1e-13
"""Local error bound of the tangents: identities are then exact to some 1e-10, at half the cost of the solver's own."""

_STEP = 1e-200  # of the complex step: its square is far below the smallest float, so nothing is truncated
_SAME = 1e-14  # relative: the two formulas may round differently, by a few units in the last place


@dataclass(frozen=True)
class StateTangent:
    """A state of a motion at a fixed time and its derivatives along m directions."""

    t: float
    q: FloatArray
    u: FloatArray
    """Shape (n_q,)."""
    dq: FloatArray
    du: FloatArray
    """Shape (m, n_q)."""
    closed: tuple[str, ...]
    """Stops that are active there."""
    d_release_times: dict[str, FloatArray]
    """Of every stop, shape (m,); NaN where it did not open between the start and t."""


@dataclass(frozen=True)
class PointTangent:
    """A marker at a fixed time and its derivatives along m directions."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    """[m], [m/s], [m/s^2], shape (2,)."""
    d_position: FloatArray
    d_velocity: FloatArray
    """Shape (m, 2)."""


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of a launch with respect to parameters and start values, in SI units per SI unit."""

    names: tuple[str, ...]
    """Fields of `TrebuchetParameters`, then start speeds ("u_theta", ...), then start slides ("x_p0")."""
    values: FloatArray
    """Of each, shape (n,)."""
    launch_time: float
    """When the projectile's velocity comes down to 45 degrees [s]."""
    launch_speed: float
    """[m/s]."""
    range: float
    """Where the projectile let go at the launch comes back to y = 0, in vacuum: its x in the world [m]; NaN where it
    never does (let go below the fulcrum's height, too slow to rise to it)."""
    d_launch_time: FloatArray
    d_launch_speed: FloatArray
    d_range: FloatArray
    """Shape (n,)."""
    d_release_times: dict[str, FloatArray]
    """Of every stop, shape (n,); NaN where it did not open between the start and the launch (or opened at t = 0)."""


def sensitivities(
    build: Callable[[TrebuchetParameters], Mechanism],
    parameters: TrebuchetParameters | None = None,
    duration: float | None = None,
) -> Sensitivities:
    """Differentiate the launch of a whipper, fixed or rolling, with respect to all it is made of.

    A start angle takes its rest along (the rests stand where the machine starts). A start speed is a kick of which
    only the part counts that the closed rests let through; see `VariationalEquations.start`. From a rest gone at
    t = 0, because it would have to pull, the kick leads away (one towards it would strike it).

    Args:
        build: `fixed` or `rolling`, or a function that makes the same machines.
        parameters: Table I where left out.
        duration: how long the machine has to launch [s]; some five of its characteristic times if left out.

    Raises:
        InputError: the machine does not launch within the duration, or `build` makes another machine.
        SimulationError: an integrator's step size collapsed.
    """
    p = parameters or TrebuchetParameters()
    mechanism = build(p)
    directions = parameter_directions(build, p) | _start_directions(mechanism)
    solution = solve_to_launch(mechanism) if duration is None else solve(Problem(mechanism, duration=duration))
    if solution.launch is None:
        spent = solution.problem.duration
        raise InputError(
            f"the {mechanism.name!r} machine does not launch within duration = {spent:g} s: its projectile's "
            "velocity never comes down to 45 degrees; another machine or a longer duration is needed."
        )
    values = np.array([_value(mechanism, p, name) for name in directions])
    # Large values per relative change, so that the integrator's one absolute tolerance suits all directions.
    scale = np.maximum(1.0, np.abs(values))
    scaled = [{k: v * s for k, v in d.items()} for d, s in zip(directions.values(), scale, strict=True)]
    equations = VariationalEquations(mechanism, scaled)
    state = state_tangent(solution, equations, solution.launch.time)
    return _of_the_launch(tuple(directions), values, scale, equations, state)


def _start_directions(mechanism: Mechanism) -> dict[str, Direction]:
    names, n_angles = mechanism.coordinates, len(mechanism.angles)
    speeds: dict[str, Direction] = {f"u_{name}": {f"start_speeds.{i}": 1.0} for i, name in enumerate(names)}
    slides: dict[str, Direction] = {
        f"{name}0": {f"start.{n_angles + i}": 1.0} for i, name in enumerate(names[n_angles:])
    }
    return speeds | slides


def _value(mechanism: Mechanism, parameters: TrebuchetParameters, name: str) -> float:
    if name in TrebuchetParameters.model_fields:
        return float(getattr(parameters, name))
    if name.startswith("u_"):
        return float(initial_state(mechanism)[1][mechanism.coordinates.index(name.removeprefix("u_"))])
    return mechanism.start[mechanism.coordinates.index(name.removesuffix("0"))]


def state_tangent(
    solution: Solution, equations: VariationalEquations, t: float, tol: float = TOLERANCE
) -> StateTangent:
    """Derivatives of the state at a fixed time t [s], and of the releases before it, for any mechanism.

    At a release the tangent does not change: its jump (Aizerman and Gantmakher 1958) is
    (f_after - f_before) dt_release, and the torque that ends is zero there, so that f, the state's rate, does not jump.

    Args:
        solution: the motion.
        equations: of the same mechanism, with the directions.
        t: within the solution [s].
        tol: local error bound of the integrator, relative and absolute.

    Raises:
        InputError: t lies outside the solution, there is an impact before t (whose jump is not treated here), or a
            direction moves the start off a closed stop.
        SimulationError: the integrator's step size collapsed.
    """
    if not 0 <= t <= solution.segments[-1].end:
        raise InputError(f"t = {t:g} s lies outside the solution, which covers 0 to {solution.segments[-1].end:.6g} s.")
    if any(0 < time <= t for time, _ in solution.impacts):
        raise InputError(f"there is an impact before t = {t:g} s; derivatives are known through releases only.")
    n_q, m = len(solution.problem.mechanism.coordinates), len(equations.tangents)
    first = solution.segments[0]
    y0 = np.asarray(first.interpolant(0.0), dtype=np.float64)
    dq, du = equations.start(y0[:n_q], y0[n_q:], first.closed)
    y = np.concatenate([y0, np.concatenate([dq, du], axis=1).ravel()])
    releases = {stop.name: np.full(m, np.nan) for stop in solution.problem.mechanism.stops}
    closed = first.closed
    for segment in solution.segments:
        if segment.start >= t:
            break
        closed = segment.closed
        y = _integrated(equations, segment.closed, y, segment.start, min(segment.end, t), tol)
        for name in segment.closed:
            if segment.end <= t and solution.release_times[name] == segment.end:
                releases[name] = _release_tangent(equations, segment.closed, name, y)
    return StateTangent(t, *_unpacked(y, n_q), closed, releases)


def _unpacked(y: FloatArray, n_q: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    tangents = y[2 * n_q :].reshape(-1, 2 * n_q)
    return y[:n_q], y[n_q : 2 * n_q], tangents[:, :n_q], tangents[:, n_q:]


def _integrated(
    equations: VariationalEquations, closed: Sequence[str], y: FloatArray, start: float, end: float, tol: float
) -> FloatArray:
    n_q = len(equations.mechanism.coordinates)

    def rates(t: float, y: FloatArray) -> FloatArray:
        q, u, dq, du = _unpacked(y, n_q)
        tangent = equations.tangent(q, u, dq, du, closed)
        return np.concatenate([u, tangent.a, np.concatenate([du, tangent.da], axis=1).ravel()])

    stepper = Integrator(rates, start, y, end, (tol, tol))
    while stepper.status == "running":
        stepper.step()
    return np.asarray(stepper.y, dtype=np.float64)


def _release_tangent(equations: VariationalEquations, closed: Sequence[str], name: str, y: FloatArray) -> FloatArray:
    """Implicit function theorem on torque(t, p) = 0: dt = -(d torque) / (torque's rate)."""
    q, u, dq, du = _unpacked(y, len(equations.mechanism.coordinates))
    column = equations.n_loops + list(closed).index(name)
    rate = equations.in_time(q, u, closed).d_multipliers[0, column]
    return -equations.tangent(q, u, dq, du, closed).d_multipliers[:, column] / rate


def marker_tangent(equations: VariationalEquations, state: StateTangent, marker: str = "projectile") -> PointTangent:
    """A marker at a state, and its derivatives along the directions at that fixed time."""
    kinematics, q, u = equations.kinematics, state.q, state.u
    at = next(i for i, m in enumerate(equations.mechanism.markers) if m.name == marker)
    marker_model = equations.mechanism.markers[at]
    row = kinematics.point(marker_model.body, marker_model.point)
    phasors, rates, turn = kinematics.phasors(q), kinematics.rates(q), -1j * kinematics.is_angle * state.dq
    d_position = (rates * state.dq) @ row.coefficients
    d_velocity = (rates * (turn * u + state.du)) @ row.coefficients
    for j, tangent in enumerate(equations.tangents):
        moved = Kinematics(tangent).point(marker_model.body, tangent.markers[at].point)
        d_position[j] += moved.offset + phasors @ moved.coefficients
        d_velocity[j] += (rates * u) @ moved.coefficients
    position, velocity, acceleration = kinematics.point_motion(
        marker_model, q, u, equations.solve(q, u, state.closed)[0]
    )
    return PointTangent(
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        d_position=np.stack([d_position.real, d_position.imag], axis=-1),
        d_velocity=np.stack([d_velocity.real, d_velocity.imag], axis=-1),
    )


def _of_the_launch(
    names: tuple[str, ...], values: FloatArray, scale: FloatArray, equations: VariationalEquations, state: StateTangent
) -> Sensitivities:
    point = marker_tangent(equations, state)
    # The launch's time t(p) keeps lead(velocity(t, p)) = 0; what is read there moves with p and with t.
    d_time = -lead(point.d_velocity) / lead(point.acceleration)
    d_position = point.d_position + d_time[:, None] * point.velocity
    d_velocity = point.d_velocity + d_time[:, None] * point.acceleration
    speed = math.hypot(*point.velocity)
    d_gravity = np.array([tangent.gravity for tangent in equations.tangents])
    landing, d_landing = _landing(point, d_position, d_velocity, equations.mechanism.gravity, d_gravity)
    return Sensitivities(
        names=names,
        values=values,
        launch_time=state.t,
        launch_speed=speed,
        range=landing,
        d_launch_time=d_time / scale,
        d_launch_speed=d_velocity @ point.velocity / speed / scale,
        d_range=d_landing / scale,
        d_release_times={name: d / scale for name, d in state.d_release_times.items()},
    )


def _landing(
    point: PointTangent, d_position: FloatArray, d_velocity: FloatArray, gravity: float, d_gravity: FloatArray
) -> tuple[float, FloatArray]:
    """Where a thrown point comes down through y = 0 in vacuum: x [m], and its derivatives, shape (m,)."""
    (x, y), (vx, vy) = point.position, point.velocity
    squared = vy * vy + 2 * gravity * y  # of the vertical speed at y = 0
    if gravity == 0 or squared <= 0:
        return math.nan, np.full(len(d_gravity), np.nan)
    fall = math.sqrt(squared)
    time = (vy + fall) / gravity
    # y + vy T - g T^2 / 2 = 0 differentiated; vy - g T = -fall.
    d_time = (d_position[:, 1] + time * d_velocity[:, 1] - time * time / 2 * d_gravity) / fall
    return float(x + vx * time), d_position[:, 0] + time * d_velocity[:, 0] + vx * d_time


def whipper_numbers(p: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of the whipper that depend on its parameters, as `models/trebuchet.py` has them.

    Plain arithmetic, so that it can be followed by a complex step, which validated descriptions cannot. Checked
    against the machine itself on each use, and in the tests.

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

    f(p + i h) = f(p) + i h f'(p) + O(h^2) (Squire and Trapp, SIAM Review 40 (1998) 110-112): no difference is taken,
    so h can be so small that only rounding is left.

    Raises:
        InputError: `build` does not make a whipper, or makes its numbers otherwise than `models/trebuchet.py`.
    """
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    _refuse_another_machine(build, parameters)
    directions: dict[str, Direction] = {}
    for name in values:
        stepped = whipper_numbers({k: complex(v, _STEP * (k == name)) for k, v in values.items()})
        directions[name] = {k: complex(v).imag / _STEP for k, v in stepped.items()}
    return directions


def _refuse_another_machine(build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters) -> None:
    """Compare all numbers at these and at a second set of parameters, which shows what depends on them."""
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
                    f"build makes {name} = {a!r} where the whipper trebuchet has {b!r}; sensitivities to its "
                    "parameters are known for the fixed and the rolling machine."
                )


def sensitivities_of(name: str, parameters: TrebuchetParameters) -> tuple[Sensitivity, ...]:
    """Derivatives of a named machine's launch at 45 degrees, in vacuum, by all its parameters and start values.

    Raises:
        InputError: there is no such machine, or it does not launch.
    """
    model(name, parameters)  # refuses an unknown name before long work
    derivatives = sensitivities(lambda p: model(name, p), parameters)
    return tuple(
        Sensitivity(
            name=each,
            value=float(derivatives.values[i]),
            unit=_unit(each),
            launch_time=float(derivatives.d_launch_time[i]),
            launch_speed=float(derivatives.d_launch_speed[i]),
            range=None if math.isnan(derivatives.d_range[i]) else float(derivatives.d_range[i]),
        )
        for i, each in enumerate(derivatives.names)
    )


def _unit(name: str) -> str:
    """Of a parameter, from its own description; of a start speed or start slide, by its name."""
    if name in TrebuchetParameters.model_fields:
        unit = re.search(r"\[(.+)\]", TrebuchetParameters.model_fields[name].description or "")
        return unit.group(1) if unit else ""
    slide = "x_p" in name
    return ("m/s" if slide else "rad/s") if name.startswith("u_") else "m" if slide else "rad"
