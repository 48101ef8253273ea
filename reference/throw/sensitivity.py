"""Exact derivatives of a launch with respect to every parameter and start value, event times included.

The state's derivatives are those of :mod:`.tangent`, of any mechanism; here the launch time follows by the implicit
function theorem, the flight in closed form, and the machine's numbers from its parameters by a complex step.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import initial_state
from ...models.launch import lead
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ..solver import solve, solve_to_launch
from .tangent import PointTangent, StateTangent, marker_tangent, state_tangent
from .throw import Sensitivity
from .variational import Direction, VariationalEquations, numbers

_STEP = 1e-200  # of the complex step: its square is far below the smallest float, so nothing is truncated
_SAME = 1e-14  # relative: the two formulas may round differently, by a few units in the last place


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


def _of_the_launch(
    names: tuple[str, ...], values: FloatArray, scale: FloatArray, equations: VariationalEquations, state: StateTangent
) -> Sensitivities:
    point = marker_tangent(equations, state)
    # The launch's time t(p) keeps lead(velocity(t, p)) = 0; what is read there moves with p and with t.
    d_time = -lead(point.d_velocity) / lead(point.acceleration)
    d_position = point.d_position + d_time[:, None] * point.velocity
    d_velocity = point.d_velocity + d_time[:, None] * point.acceleration
    speed = math.hypot(*point.velocity)
    landing, d_landing = _landing(
        point, d_position, d_velocity, equations.mechanism.gravity, equations.along("gravity")
    )
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
