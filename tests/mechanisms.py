"""Mechanisms that many tests need.

Table I's two machines, pendulums, chains of two bodies, ladders, linkages.
"""

from __future__ import annotations

import cmath
import functools
import math

import numpy as np
import trebucheck as tb
from trebucheck.models.elements import (
    GROUND,
    AnyForceElement,
    ConstantForce,
    ConstantTorque,
    Coupler,
    CouplerTerm,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from trebucheck.models.library.trebuchet import PROJECTILE, fixed, rolling
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Vector
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

G = 9.81

# --- The paper's Table I
# ----------------------------------------------------------------------------------------

TABLE_ONE: dict[str, Mechanism] = {"fixed": fixed(), "rolling": rolling()}


@functools.cache
def table_one_motion(name: str) -> Solution:
    """Reference motion of a Table I machine, up to the launch."""
    launch = solve(Problem(TABLE_ONE[name], 2.8)).launch
    assert launch is not None
    return solve(Problem(TABLE_ONE[name], launch.time))


def position_error(trajectory: Trajectory, exact: Solution, marker: str = PROJECTILE) -> float:
    """Largest distance of a marker from the reference [m]."""
    # An engine of whole steps may end a step later.
    within = trajectory.t[trajectory.t <= exact.problem.duration]
    there = exact.trajectory(within).marker(marker).position
    found = trajectory.marker(marker).position[: len(within)]
    return float(np.linalg.norm(found - there, axis=1).max())


def misplaced(found: Trajectory, exact: Solution) -> float:
    """Largest distance of any marker from the reference [m]."""
    return max(position_error(found, exact, marker.name) for marker in found.mechanism.markers)


def errors_of(found: Trajectory, exact: Solution) -> dict[str, float]:
    """Largest errors of coordinates, energies and forces of joints against the reference."""
    there = exact.trajectory(found.t)
    pairs = {
        "q": (found.q, there.q),
        "kinetic energy": (found.kinetic_energy, there.kinetic_energy),
        "potential energy": (found.potential_energy, there.potential_energy),
    }
    for joint, force in there.joint_reactions.items():
        pairs[joint] = found.joint_reactions[joint], force
    return {name: float(np.abs(mine - its).max()) for name, (mine, its) in pairs.items()}


def errors_at(
    steps: tuple[float, ...], engine: str, preset: str, problem: Problem
) -> list[dict[str, float]]:
    """The same of an engine's runs with these steps [s], the last of which may end beyond."""
    longer = problem.duration + max(steps)
    exact = solve(problem.model_copy(update={"duration": longer}))
    return [
        errors_of(tb.engine(engine, preset, timestep=step).simulate(problem), exact)
        for step in steps
    ]


# --- Parts
# --------------------------------------------------------------------------------------------------


def pin(name: str, parent: str, child: str, at: Vector = (0, 0), on: Vector = (0, 0)) -> PinJoint:
    """A pin at a point of the parent and a point of the child."""
    return PinJoint(name=name, parent=parent, child=child, parent_point=at, child_point=on)


def geared(rail_on: str = "second") -> Mechanism:
    """A double pendulum whose second rod is geared to the first, and a slider that both push."""
    return Mechanism(
        name="geared",
        bodies=(
            Body(name="first", angle="alpha", mass=2.0, centre=(0.3, 0.0), inertia=0.1),
            Body(name="second", angle="beta", mass=1.0, centre=(0.0, -0.2), inertia=0.3),
            Body(name="slider", mass=3.0, centre=(0.1, 0.0), inertia=1.0),
        ),
        joints=(
            pin("axle", GROUND, "first"),
            pin("elbow", "first", "second", (1.0, 0.0)),
            PrismaticJoint(
                name="rail", parent=rail_on, child="slider", parent_point=(0.0, 1.0),
                child_point=(0.0, 0.0), axis=(0.6, 0.8), coordinate="s",
            ),
        ),
        couplers=(
            Coupler(
                name="gear", coordinate="beta", offset=0.4,
                terms=(CouplerTerm(coordinate="alpha", ratio=-1.7),),
            ),
            Coupler(
                name="rack", coordinate="s",
                terms=(
                    CouplerTerm(coordinate="alpha", ratio=0.25),
                    CouplerTerm(coordinate="beta", ratio=-0.1),
                ),
            ),
        ),
        markers=(Marker(name="tip", body="slider", point=(0.2, 0.1)),),
        gravity=G,
        start=(0.3, 0.4 - 1.7 * 0.3, 0.25 * 0.3 - 0.1 * (0.4 - 1.7 * 0.3)),
    )  # fmt: skip


def angle_stop(
    limit: float, restitution: float = 0.0, body: str = "bob", name: str = "stop"
) -> Stop:
    """An open stop that a clockwise rotation of a body meets at `limit` [rad]."""
    return Stop(name=name, body=body, sense=-1, limit=-limit, closed=False, restitution=restitution)


def floor(
    depth: float, restitution: float = 0.0, body: str = "bob", point: Vector = (2.0, 0)
) -> PointStop:
    """An open floor for a point of a body, `depth` below the origin [m]."""
    return PointStop(
        name="floor",
        body=body,
        point=point,
        normal=(0, 1),
        offset=-depth,
        closed=False,
        restitution=restitution,
    )


# --- Pendulums
# --------------------------------------------------------------------------------------------------


def hanging_bob(
    *stops: Stop | PointStop, start: float = 0.0, length: float = 2.0, **changes: object
) -> Mechanism:
    """A point mass of 3 kg on a massless rod; angle 0 points along +x, pi/2 straight down."""
    fields: dict[str, object] = {
        "name": "pendulum",
        "bodies": (Body(name="bob", angle="beta", mass=3.0, centre=(length, 0), inertia=0.0),),
        "joints": (pin("pivot", GROUND, "bob"),),
        "stops": stops,
        "markers": (Marker(name="bob", body="bob", point=(length, 0)),),
        "gravity": G,
        "start": (start,),
    }
    return Mechanism(**(fields | changes))


def rod_pendulum(*stops: Stop, start: float = 0.0) -> Mechanism:
    """A rod with inertia that falls clockwise about its pin."""
    rod = Body(name="rod", angle="a", mass=2.0, centre=(1, 0), inertia=0.5)
    return Mechanism(
        name="pendulum",
        bodies=(rod,),
        joints=(pin("pin", GROUND, "rod"),),
        stops=stops,
        gravity=G,
        start=(start,),
    )


# --- Chains of two bodies
# ---------------------------------------------------------------------------------------

OBLIQUE_SLOT = SlotJoint(
    name="hook",
    child="upper",
    parent_point=(1, 2),
    child_point=(0.1, 0.1),
    axis=(0.8, 0.6),
    coordinate="s",
)
"""A slot that goes uphill, for the upper body of a chain."""


def chain(
    *stops: Stop | PointStop,
    inertias: tuple[float, float] = (0.1, 0.2),
    hook: Vector = (0.1, 0.2),
    **changes: object,
) -> Mechanism:
    """Two bodies off every axis, hung from a point that is not the world's origin, moving at the
    start.

    Args:
        stops: of the chain.
        inertias: of the upper and the lower body [kg m^2].
        hook: point of the upper body that hangs on the ground [m].
        changes: fields of the mechanism.
    """
    fields: dict[str, object] = {
        "name": "chain",
        "bodies": (
            Body(name="upper", angle="a", mass=1, centre=(0.5, 0.1), inertia=inertias[0]),
            Body(name="lower", angle="b", mass=2, centre=(0.4, -0.5), inertia=inertias[1]),
        ),
        "joints": (
            pin("hook", GROUND, "upper", (0.3, 2), hook),
            pin("pin", "upper", "lower", (1, 0), (0, 0.1)),
        ),
        "stops": stops,
        "markers": (
            Marker(name="tip", body="lower", point=(0.1, -1.5)),
            Marker(name="peg", body=GROUND, point=(1, 2)),
        ),
        "gravity": G,
        "start": (0.3, 0.2),
        "start_speeds": (1.0, -2.0),
    }
    return Mechanism(**(fields | changes))


def chain_on_a_slot(**changes: object) -> Mechanism:
    """The chain on a slot that goes uphill, moving at the start."""
    here = chain(**changes)
    return chain(
        **{
            "joints": (OBLIQUE_SLOT, here.joints[1]),
            "start": (0.3, 0.2, 0.4),
            "start_speeds": (1.0, -2.0, 0.7),
        }
        | changes
    )


def rods_on_a_slot(
    *stops: Stop | PointStop, inertia: float, tip: Vector, **changes: object
) -> Mechanism:
    """Two rods, the upper one on a tilted slot, with no point where it would be easy.

    Args:
        stops: of the rods.
        inertia: of the lower rod [kg m^2].
        tip: the marker's point on the lower rod [m].
        changes: fields of the mechanism.
    """
    slot = SlotJoint(
        name="slot",
        child="upper",
        parent_point=(1, 2),
        child_point=(-0.1, 0.3),
        axis=(0.6, 0.8),
        coordinate="s",
    )
    fields: dict[str, object] = {
        "name": "rods",
        "bodies": (
            Body(name="upper", angle="a", mass=2, centre=(0.4, 0.2), inertia=0.3),
            Body(name="lower", angle="b", mass=1, centre=(0.1, -0.5), inertia=inertia),
        ),
        "joints": (slot, pin("pin", "upper", "lower", (0.9, 0.1), (0.05, 0.1))),
        "stops": stops,
        "markers": (Marker(name="tip", body="lower", point=tip),),
        "gravity": G,
        "start": (0.5, 0.2, 0.6),
    }
    return Mechanism(**(fields | changes))


# --- Linkages and ladders
# ---------------------------------------------------------------------------------------


def slider_crank(
    length: float = 2.0,
    tilt: float = 0.0,
    centres: tuple[Vector, Vector] = ((0.5, 0), (1.0, 0)),
    mass: float = 1.0,
    **changes: object,
) -> Mechanism:
    """A loop: a crank of 1 m whose rod's tip runs in a slot through the pivot.

    Args:
        length: of the rod [m].
        tilt: of the slot, anticlockwise [rad].
        centres: centres of mass of crank and rod [m].
        mass: of the rod [kg].
        changes: fields of the mechanism.
    """
    crank = -math.pi / 3
    # The tip is on the line: sin(b + tilt) length = -sin(crank + tilt).
    rod = -math.asin(math.sin(crank + tilt) / length) - tilt
    slot = SlotJoint(
        name="slot",
        child="rod",
        parent_point=(0, 0),
        child_point=(length, 0),
        axis=(math.cos(tilt), math.sin(tilt)),
    )
    fields: dict[str, object] = {
        "name": "slider crank",
        "bodies": (
            Body(name="crank", angle="a", mass=2.0, centre=centres[0], inertia=0.2),
            Body(name="rod", angle="b", mass=mass, centre=centres[1], inertia=0.3),
        ),
        "joints": (pin("pivot", GROUND, "crank"), pin("elbow", "crank", "rod", (1, 0)), slot),
        "markers": (Marker(name="tip", body="rod", point=(length, 0)),),
        "gravity": G,
        "start": (crank, rod),
    }
    return Mechanism(**(fields | changes))


def four_bar(*further: Body, start: tuple[float, ...] = (), **changes: object) -> Mechanism:
    """A loop of four pins; the angles of coupler and rocker close it.

    Args:
        further: bodies beside crank, coupler and rocker; their joints follow in `changes["hung"]`.
        start: angles of the further bodies [rad].
        changes: fields of the mechanism; `hung` are joints of the further bodies.
    """
    crank, coupler, rocker, foot = -1.2, 2.5, 2.0, complex(3, 0)
    end = cmath.exp(-1j * crank)
    span = foot - end
    # The circles around the crank's end and the rocker's foot meet where the coupler meets the
    # rocker.
    along = (coupler**2 - rocker**2 + abs(span) ** 2) / (2 * abs(span))
    meeting = end + span / abs(span) * complex(along, math.sqrt(coupler**2 - along**2))
    hung = changes.pop("hung", ())
    assert isinstance(hung, tuple)
    fields: dict[str, object] = {
        "name": "four-bar",
        "bodies": (
            Body(name="crank", angle="a", mass=1, centre=(0.5, 0), inertia=0.1),
            Body(name="coupler", angle="b", mass=2, centre=(1.2, 0.1), inertia=0.5),
            Body(name="rocker", angle="c", mass=1.5, centre=(1, 0), inertia=0.4),
            *further,
        ),
        "joints": (
            pin("A", GROUND, "crank"),
            pin("B", "crank", "coupler", (1, 0)),
            pin("D", GROUND, "rocker", (3, 0)),
            pin("C", "coupler", "rocker", (coupler, 0), (rocker, 0)),
            *hung,
        ),
        "gravity": G,
        "start": (crank, -cmath.phase(meeting - end), -cmath.phase(meeting - foot), *start),
    }
    return Mechanism(**(fields | changes))


def parallel_cranks(
    n: int, *stops: Stop | PointStop, start: float = 0.3, hung: bool = False
) -> Mechanism:
    """A beam on n equal, parallel cranks, as a pendulum of one degree of freedom: more than two
    cranks are redundant.

    Args:
        n: number of cranks.
        stops: of the mechanism.
        start: angle of the cranks [rad].
        hung: whether a pendulum hangs on the beam.
    """
    crank, beam = {"centre": (0.25, 0), "inertia": 0.02, "mass": 1.0}, "beam"
    further = Body(name="bob", angle="bob angle", mass=0.5, centre=(0.4, 0), inertia=0.01)
    return Mechanism(
        name="parallel cranks",
        bodies=(
            Body.model_validate({"name": "crank 0", "angle": "angle 0", **crank}),
            Body(name=beam, angle="tilt", mass=3.0, centre=(0.7, 0.1), inertia=0.5),
            *(
                Body.model_validate({"name": f"crank {k}", "angle": f"angle {k}", **crank})
                for k in range(1, n)
            ),
            *((further,) if hung else ()),
        ),
        joints=(
            pin("foot 0", GROUND, "crank 0"),
            pin("head 0", "crank 0", beam, (0.5, 0)),
            *(pin(f"foot {k}", GROUND, f"crank {k}", (k, 0)) for k in range(1, n)),
            *((pin("hook", beam, "bob", (0.2, 0.3)),) if hung else ()),
            *(pin(f"head {k}", f"crank {k}", beam, (0.5, 0), (k, 0)) for k in range(1, n)),
        ),
        stops=stops,
        markers=(Marker(name="tip", body=beam, point=(1.0, 0.2)),),
        gravity=G,
        start=(start, 0.0, *[start] * (n - 1), *((1.0,) if hung else ())),
    )


def scaled(mechanism: Mechanism, s: float) -> Mechanism:
    """The same mechanism, s times as large, of the same density.

    Its motion takes sqrt(s) times as long.
    """

    def vector(point: Vector) -> Vector:
        return point[0] * s, point[1] * s

    changes: dict[str, object] = {
        "bodies": tuple(
            b.model_copy(
                update={
                    "mass": b.mass * s**3,
                    "inertia": b.inertia * s**5,
                    "centre": vector(b.centre),
                }
            )
            for b in mechanism.bodies
        ),
        "joints": tuple(
            j.model_copy(
                update={
                    "parent_point": vector(j.parent_point),
                    "child_point": vector(j.child_point),
                }
            )
            for j in mechanism.joints
        ),
        "stops": tuple(
            p.model_copy(update={"point": vector(p.point), "offset": p.offset * s})
            if isinstance(p, PointStop)
            else p
            for p in mechanism.stops
        ),
        "markers": tuple(
            m.model_copy(update={"point": vector(m.point), "mass": m.mass and m.mass * s**3})
            for m in mechanism.markers
        ),
        "force_elements": tuple(_scaled_element(e, s) for e in mechanism.force_elements),
    }
    angles = len(mechanism.angles)
    start = (*mechanism.start[:angles], *(x * s for x in mechanism.start[angles:]))
    return Mechanism(**{**dict(mechanism), **changes, "start": start})


def _scaled_element(element: AnyForceElement, s: float) -> AnyForceElement:
    """Scale an element: with gravity as it is, forces grow as s^3 and speeds as sqrt(s)."""
    powers = {"point": 1, "relative_point": 1, "rest_length": 1, "force": 3, "torque": 4}
    rotational = isinstance(element, RotationalSpringDamper)
    powers |= {"stiffness": 4, "damping": 4.5} if rotational else {"stiffness": 2, "damping": 2.5}
    fields = {name: value for name, value in element.model_dump().items() if name in powers}
    return element.model_copy(
        update={
            name: tuple(x * s ** powers[name] for x in value)
            if isinstance(value, tuple)
            else value * s ** powers[name]
            for name, value in fields.items()
        }
    )


# --- Every element
# --------------------------------------------------------------------------------------------------


def body_of(
    name: str, angle: str | None, mass: float, centre: tuple[float, float], inertia: float
) -> Body:
    """A body; one without the name of an angle hangs on a joint that holds its angle."""
    return Body(name=name, angle=angle, mass=mass, centre=centre, inertia=inertia)


def everything() -> Mechanism:
    """One of each element: a free hull, a slot and a slider on turning bodies, a weld, springs,
    motors, a wall.
    """
    return Mechanism(
        name="everything",
        bodies=(
            body_of("hull", "hull angle", 3.0, (0.1, -0.05), 0.7),
            body_of("arm", "arm angle", 1.2, (0.4, 0.1), 0.11),
            body_of("slider", None, 0.5, (0.05, 0.02), 0.03),
            body_of("bracket", None, 0.3, (0.2, 0.0), 0.01),
            body_of("bob", "bob angle", 0.4, (0.3, 0.0), 0.02),
        ),
        joints=(
            FreeJoint(name="sea", parent="ground", child="hull", coordinates=("x", "y")),
            SlotJoint(
                name="slot",
                parent="hull",
                child="arm",
                parent_point=(0.2, 0.3),
                child_point=(0.05, 0.0),
                axis=(0.6, 0.8),
                coordinate="s",
            ),
            PrismaticJoint(
                name="rail",
                parent="arm",
                child="slider",
                parent_point=(0.3, 0.1),
                child_point=(0.01, 0.0),
                axis=(0.8, -0.6),
                angle=0.4,
                coordinate="p",
            ),
            WeldJoint(
                name="weld",
                parent="slider",
                child="bracket",
                parent_point=(0.1, 0.1),
                child_point=(0, 0),
                angle=-0.7,
            ),
            PinJoint(
                name="pin",
                parent="bracket",
                child="bob",
                parent_point=(0.4, 0.0),
                child_point=(0, 0),
            ),
        ),
        force_elements=(
            SpringDamper(
                name="tie",
                body="bob",
                point=(0.3, 0.1),
                relative_to="hull",
                relative_point=(-0.2, 0.1),
                stiffness=40.0,
                damping=1.5,
                rest_length=0.3,
            ),
            RotationalSpringDamper(
                name="twist",
                body="bob",
                relative_to="arm",
                stiffness=3.0,
                damping=0.2,
                rest_angle=0.3,
            ),
            ConstantForce(name="pull", body="bob", point=(0.1, 0.2), force=(2.0, -1.0)),
            ConstantTorque(name="motor", body="arm", relative_to="hull", torque=0.9),
        ),
        stops=(
            PointStop(
                name="deck",
                body="bob",
                point=(0.5, 0.0),
                relative_to="hull",
                normal=(0.0, 1.0),
                offset=-3.0,
                closed=False,
            ),
        ),
        gravity=9.81,
        gravity_direction=(0.6, -0.8),
        start=(0.3, -0.4, 0.9, 0.1, 0.2, 0.35, -0.2),
        start_speeds=(0.5, 1.0, -0.7, 0.2, -0.3, 0.4, 0.6),
    )


def bouncing(height: float, restitution: float) -> Mechanism:
    """A point mass on an upright rail above a floor."""
    rail = PrismaticJoint(
        name="rail",
        child="ball",
        parent_point=(0, 0),
        child_point=(0, 0),
        axis=(0, 1),
        coordinate="height",
    )
    floor = PointStop(
        name="floor",
        body="ball",
        point=(0, 0),
        normal=(0, 1),
        offset=0,
        closed=False,
        restitution=restitution,
    )
    ball = Body(name="ball", mass=1.0, centre=(0, 0), inertia=0)
    return Mechanism(
        name="ball", bodies=(ball,), joints=(rail,), stops=(floor,), gravity=G, start=(height,)
    )
