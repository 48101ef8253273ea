"""One throw of one mechanism: launch, flight, forces and sensitivities, collected."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ...models.elements import AnyJoint
from ...models.errors import InputError
from ...models.launch import LAUNCH_ANGLE
from ...models.library.registry import Model, model
from ...models.mechanism import Mechanism
from ...models.shown import Reported
from ...models.spec import NonNegative, Positive, Real, Spec
from ..solution import Solution
from .flight import Air, Flight, Projectile, Surroundings, downwards, fly, swing, world
from .members import (
    Interval,
    MemberForce,
    SupportForce,
    carries,
    member_forces,
    support_forces,
    supports,
)

_THROUGH = -1e-9  # [rad] a gap below this is no rounding


def throw(
    mechanism: Model,
    *,
    release_angle: float | None = None,
    release_time: float | None = None,
    sling_angle: float | None = None,
    best: bool = False,
    density: NonNegative | None = None,
    drag_area: NonNegative | None = None,
    body: str | None = None,
    height: float = 0.0,
) -> Throw:
    """Throw with a machine and collect its figures; by default it lets go at 45 degrees.

        >>> import trebucheck as tb
        >>> from trebucheck.reference.throw.throw import throw
        >>> round(throw(tb.fixed(), best=True).flight.range, 3)  # [m]
        1008.259

    Args:
        mechanism: its name, the path of its .json file, itself, or a problem; with a marker
            "projectile".
        release_angle: of the velocity above the horizontal [rad].
        release_time: [s].
        sling_angle: from the arm, phi - theta [rad].
        best: release for the longest range.
        density: of the air [kg/m^3]; with `drag_area`.
        drag_area: C_d A [m^2]; with `density` or `body`.
        body: moon, mars, earth or venus: its gravity takes the mechanism's place, its air is met
        with `drag_area`.
        height: of the landing above the fulcrum at the start [m].

    Raises:
        InputError: a value is not valid, gravity is not downwards, or the motion never comes to the
        one release given.
        SimulationError: the integrator's step size collapsed.
    """
    performance = perform(
        model(mechanism),
        {"release_angle": release_angle, "release_time": release_time, "sling_angle": sling_angle},
        best=best,
        density=density,
        drag_area=drag_area,
        body=body,
        height=height,
    )
    vars(performance.throw)["performance"] = performance
    return performance.throw


def perform(
    mechanism: Mechanism,
    release: dict[str, float | None],
    *,
    best: bool = False,
    density: float | None = None,
    drag_area: float | None = None,
    body: str | None = None,
    height: float = 0.0,
) -> Performance:
    """Throw, with the motion and flights kept; `release` has its three kinds by name."""
    chosen = _one_release(release, best)
    placed, air = _placed(mechanism, density, drag_area, body)
    projectile = swing(placed, chosen.get("release_time"))
    surroundings = surroundings_of(projectile, air, height)
    farthest = projectile.best_release(surroundings)
    held: Held = "time"  # of the best release, too: to first order its range stays
    if "best" in chosen:
        if farthest is None:
            raise InputError(
                f"no release of the first sweep comes up to the landing height = {height!r} m."
            )
        released, description = farthest, "for the longest range"
    elif "release_time" in chosen:
        released = projectile.release_at(chosen["release_time"])
        description = f"at {chosen['release_time']:.9g} s"
    elif "sling_angle" in chosen:
        held, angle = "sling", chosen["sling_angle"]
        description = f"sling at {math.degrees(angle):.6g} deg to arm"
        released = projectile.release_at_sling_angle(angle)
    else:
        held, angle = "velocity", chosen.get("release_angle", LAUNCH_ANGLE)
        released = projectile.release_at_angle(angle)
        description = f"velocity at {math.degrees(angle):.6g} deg"
    flight = fly(released, surroundings)
    best_flight = None if farthest is None else fly(farthest, surroundings)
    figures = _figures(projectile, air, height, description, flight, best_flight)
    return Performance(figures, projectile, surroundings, flight, best_flight, held)


def _one_release(release: dict[str, float | None], best: bool) -> dict[str, float]:
    chosen = {name: value for name, value in release.items() if value is not None}
    for name, value in chosen.items():
        if not math.isfinite(value) or (name == "release_angle" and abs(value) > math.pi / 2):
            what = f"{value!r} s" if name == "release_time" else f"{math.degrees(value):.6g} deg"
            valid = "between -90 and 90 deg, above level" if name == "release_angle" else "finite"
            raise InputError(f"{name} = {what} must be {valid}.")
    if best:
        chosen["best"] = math.nan
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)} each choose the release; only one of them can.")
    return chosen


def _placed(
    mechanism: Mechanism, density: float | None, drag_area: float | None, body: str | None
) -> tuple[Mechanism, Air]:
    """The mechanism under the gravity of the named celestial body, if any, and the air."""
    if body is not None:
        if density is not None:
            raise InputError(
                f"body = {body!r} brings its own density; leave out density = {density!r}, or the "
                "body."
            )
        location = world(body)
        mechanism = mechanism.model_copy(update={"gravity": location.gravity})
        density = location.density if drag_area is not None else 0.0
        return mechanism, Air(density=density, drag_area=drag_area or 0.0)
    values = {"density": density, "drag_area": drag_area}
    air = Air(**{name: value for name, value in values.items() if value is not None})
    if (density is None) != (drag_area is None):
        known, lacking = "density", "drag_area"
        if density is None:
            known, lacking = "drag_area", "density (or a body)"
        raise InputError(
            f"{known} = {values[known]!r} needs a {lacking} as well: drag is 1/2 rho C_d A v^2."
        )
    return mechanism, air


def surroundings_of(projectile: Projectile, air: Air, height: float) -> Surroundings:
    """Forces in flight, and the landing `height` [m] above the machine's :func:`origin`.

    Raises:
        InputError: the height is not finite, gravity is not downwards, or drag lacks the
            projectile's mass.
    """
    if not math.isfinite(height):
        raise InputError(f"height = {height!r} m must be finite.")
    drag = 0.0
    if air.density * air.drag_area > 0:
        if projectile.mass is None:
            raise InputError(
                f"drag needs the projectile's own mass, but the marker {projectile.name!r} has "
                f"none and is not the centre of a point mass {projectile.body.name!r}; leave out "
                "the drag area, or give the marker a mass."
            )
        drag = air.drag(projectile.mass)
    x, y = _fulcrum(projectile.solution)
    gravity = downwards(projectile.mechanism)
    return Surroundings(gravity=gravity, drag=drag, ground=y + height, origin=x)


def origin(mechanism: Mechanism) -> AnyJoint:
    """Joint that places are measured from: the fulcrum, another support, or a free body's."""
    on_ground = supports(mechanism) or mechanism.tree_joints
    return next((joint for joint in on_ground if carries(joint)), on_ground[0])


def _fulcrum(solution: Solution) -> tuple[float, float]:
    """Place where the machine's :func:`origin` stands at the start [m]."""
    joint, kinematics = origin(solution.problem.mechanism), solution.equations.kinematics
    row = kinematics.point(joint.child, joint.child_point)
    x, y = kinematics.position(row, np.array(solution.problem.mechanism.start))
    return float(x), float(y)


def _figures(
    projectile: Projectile,
    air: Air,
    height: float,
    description: str,
    flight: Flight,
    best: Flight | None,
) -> Throw:
    solution, until = projectile.solution, flight.release.time
    mechanism = projectile.mechanism
    of_members, of_supports = member_forces(solution, until), support_forces(solution, until)
    start = solution.trajectory(np.zeros(1))
    energy = float(start.total_energy[0])
    launch, after = _launch_and_flight(projectile, flight, energy)
    best_launch, best_flight = None, None
    if best is not None:
        best_launch, best_flight = _launch_and_flight(projectile, best, energy)
    rests: list[RestFigures] = []
    for stop in mechanism.stops:
        if stop.closed:
            time, torque = solution.release_times[stop.name], start.stop_torques[stop.name][0]
            opened = None if time is None or time > until else time
            rests.append(
                RestFigures(name=stop.name, start_torque=float(torque), release_time=opened)
            )
    return Throw(
        mechanism=mechanism,
        released=description,
        air=air,
        gravity=mechanism.gravity,
        height=height,
        total_energy=energy,
        launch=launch,
        flight=after,
        best_launch=best_launch,
        best_flight=best_flight,
        rests=tuple(rests),
        members=of_members,
        supports=of_supports,
        warnings=_warnings(solution, of_members, of_supports, until),
    )


def _launch_and_flight(
    projectile: Projectile, flight: Flight, energy: float
) -> tuple[LaunchFigures, FlightFigures]:
    release, (x, y) = flight.release, _fulcrum(projectile.solution)
    sling_angle = kinetic = ratio = None
    if projectile.arm is not None:
        sling_angle = float(projectile.sling_angle(np.array([release.time]))[0])
    if projectile.mass is not None:
        kinetic = 0.5 * projectile.mass * release.speed**2
        ratio = kinetic / energy if energy > 0 else None
    launch = LaunchFigures(
        time=release.time,
        speed=release.speed,
        angle=release.angle,
        x=release.position[0] - x,
        y=release.position[1] - y,
        sling_angle=sling_angle,
        kinetic_energy=kinetic,
        energy_ratio=ratio,
    )
    return launch, FlightFigures(
        range=flight.range,
        apex_height=flight.apex_height - y,
        time=flight.time,
        impact_speed=flight.impact_speed,
        impact_angle=flight.impact_angle,
    )


def _warnings(
    solution: Solution,
    of_members: Iterable[MemberForce],
    of_supports: Iterable[SupportForce],
    until: float,
) -> tuple[str, ...]:
    """Sentences on what a real machine would not do: slack ropes, lifted wheels, passed stops."""
    warnings: list[str] = []
    for m in of_members:
        if m.two_force and m.compressed:
            warnings.append(
                f"the {m.name} is in compression {spoken(m.compressed)} (down to "
                f"{m.peak_compression / 1e3:.4g} kN at {m.peak_compression_time:.4g} s): a rope "
                "would be slack there"
            )
    for s in of_supports:
        if s.rolls and s.pulls_down and s.least is not None:
            warnings.append(
                f"the ground would have to pull the wheels of {s.joint!r} down "
                f"{spoken(s.pulls_down)} (with up to {-s.least / 1e3:.4g} kN at "
                f"{s.least_time:.4g} s): they would lift off"
            )
    # The release-once law lets a motion pass through an open stop.
    times = np.linspace(0.0, until, 1500)
    q = solution.motion(times).q
    for stop in solution.problem.mechanism.stops:
        through = np.flatnonzero(solution.equations.kinematics.gap(stop.name, q) < _THROUGH)
        if len(through):
            warnings.append(
                f"the motion goes through the {stop.name!r} at {times[through[0]]:.4g} s, before "
                "the release: a real machine would hit it there"
            )
    return tuple(warnings)


def spoken(intervals: Iterable[Interval]) -> str:
    """Intervals [s] as text."""
    return " and ".join(f"from {start:.5g} to {end:.5g} s" for start, end in intervals)


FORMAT = "trebucheck-throw-1"
Held = Literal["velocity", "sling", "time"]
"""Quantity that a release holds when the machine changes."""


class LaunchFigures(Spec):
    """Figures of the release; places are measured from the fulcrum at the start."""

    time: Real = Field(description="[s]")
    speed: Real = Field(description="[m/s]")
    angle: Real = Field(description="of the velocity above the horizontal [rad]")
    x: Real = Field(description="[m]")
    y: Real = Field(description="upwards [m]")
    sling_angle: Real | None = Field(
        description="from the arm, phi - theta [rad]; None where there is no sling"
    )
    kinetic_energy: Real | None = Field(
        description="of the projectile [J]; None where its mass is not its own"
    )
    energy_ratio: Real | None = Field(
        description="the paper's R: kinetic over total energy; None without a positive E"
    )


class FlightFigures(Spec):
    """Figures of the flight; places are measured from the fulcrum at the start."""

    range: Real = Field(description="x of the landing [m]")
    apex_height: Real = Field(description="highest y [m]")
    time: Real = Field(description="[s]")
    impact_speed: Real = Field(description="[m/s]")
    impact_angle: Real = Field(description="of the velocity below the horizontal [rad]")


class RestFigures(Spec):
    """A stop that is closed at the start."""

    name: str
    start_torque: Real = Field(description="[N m], or the force of a stop on a point [N]")
    release_time: Real | None = Field(
        description="when it opens [s]; None if not before the release"
    )


class Sensitivity(Spec):
    """Derivatives of the release, flying through vacuum, by one number of the machine.

    With the number what chose the release is held: an angle of the velocity or of the sling, or
    else its time.
    """

    name: str
    value: Real = Field(description="of the parameter [its unit]")
    unit: str
    launch_time: Real = Field(description="[s per unit]")
    launch_speed: Real = Field(description="[m/s per unit]")
    launch_angle: Real = Field(
        default=0.0, description="of the velocity above the horizontal [rad per unit]"
    )
    range: Real | None = Field(description="[m per unit]; None where it does not land")


class Throw(Reported, Spec):
    """Results of one throw, in SI units and radians."""

    format: Literal["trebucheck-throw-1"] = FORMAT
    mechanism: Mechanism
    released: str = Field(description="how the release was chosen")
    air: Air
    gravity: Positive = Field(description="[m/s^2]")
    height: Real = Field(description="of the landing above the fulcrum at the start [m]")
    total_energy: Real = Field(description="at the start, zero of potential at y = 0 [J]")
    launch: LaunchFigures
    flight: FlightFigures
    best_launch: LaunchFigures | None = Field(
        description="the release of the first sweep that flies farthest"
    )
    best_flight: FlightFigures | None
    rests: tuple[RestFigures, ...]
    members: tuple[MemberForce, ...] = Field(description="up to the release")
    supports: tuple[SupportForce, ...] = Field(description="up to the release")
    warnings: tuple[str, ...] = ()
    sensitivities: tuple[Sensitivity, ...] = ()

    @cached_property
    def performance(self) -> Performance:
        """The continuous motion and the flights behind the figures.

        Raises:
            InputError: the throw was read from a file, which holds only figures.
        """
        raise InputError(
            "this throw was read from a file and has no motion to show; tb.throw makes it again."
        )

    def __getstate__(self) -> dict[Any, Any]:
        """Copy all but the motion, whose parts are functions."""
        state = super().__getstate__()
        fields = {k: v for k, v in state["__dict__"].items() if k != "performance"}
        return {**state, "__dict__": fields}

    def headline(self) -> str:
        """The range, and how it was let go."""
        return (
            f"Throw of {self.mechanism.name!r}: range {self.flight.range:.6g} m, released "
            f"{self.released}"
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """The release chosen, and the best one: figures of launch and flight."""
        releases = {
            "chosen": (self.launch, self.flight),
            "best": (self.best_launch, self.best_flight),
        }
        for name, (launch, flight) in releases.items():
            if launch is not None and flight is not None:
                row: dict[str, object] = {"release": name}
                row |= {f"launch_{key}": value for key, value in launch}
                yield row | {f"flight_{key}": value for key, value in flight}

    @property
    def gain(self) -> float | None:
        """Range that the best release would add [m]."""
        return None if self.best_flight is None else self.best_flight.range - self.flight.range


@dataclass(frozen=True, eq=False)
class Performance:
    """A throw's figures with the continuous motion and the flights behind them."""

    throw: Throw
    projectile: Projectile
    surroundings: Surroundings
    flight: Flight
    best: Flight | None
    held: Held  # what chose the release

    @property
    def solution(self) -> Solution:
        """The machine's motion."""
        return self.projectile.solution
