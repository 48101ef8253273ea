"""A problem as the program that Genesis runs, with its MJCF model.

The plane is Genesis's x-z plane, and a hinge about `0 1 0` is positive clockwise. A joint reads
zero at the start; one with a spring reads zero at its rest angle, as Genesis's joint springs do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.study import filled_template
from trebucheck.models.elements import GROUND, JOINTS, ElementTable, PinJoint, SlotJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Body
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.given_forces import program, springs_of_joints
from trebucheck_toolkit.joint_coordinates import JointCoordinates, Limit
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.node_scene import lawful_stops

if TYPE_CHECKING:
    from .engine import GenesisEngine

CARRIED = 0.1
"""Part of a body's mass on the carrier of a slot that closes a loop."""


@dataclass
class Link:
    """A body of the MJCF model; points are x + i y in the frame of its mechanism's body [m]."""

    name: str
    place: complex = 0j  # of its origin on the parent
    turn: float = 0.0  # clockwise, where its joint reads zero [rad]
    origin: complex = 0j
    mass: float = 0.0
    centre: complex = 0j
    inertia: float = 0.0
    joints: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    sites: list[tuple[str, complex]] = field(default_factory=list[tuple[str, complex]])
    children: list[Link] = field(default_factory=list["Link"])


class Model:
    """What a problem is built of.

    Raises:
        UnsupportedProblemError: a stop is on no joint, a loop is closed by neither a pin nor a
            slot, or a slot closes it on a body that no mass can be taken from.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.mechanism = problem, problem.mechanism
        self.to, self.kinematics = JointCoordinates(self.mechanism), Kinematics(self.mechanism)
        self.q, self.u = initial_state(self.mechanism)
        self.start, springs = self.to.positions(self.q), springs_of_joints(self.to)
        self.springs = dict(springs.values())
        self.zeros = self.start.copy()
        """Joint coordinates where Genesis's read zero."""
        for index, (_, rest, _) in self.springs.items():
            self.zeros[index] = rest
        stops = JointLimits(self.to, "genesis").limits
        self.stops = {stop.name: stops[stop.name] for stop in lawful_stops(problem)}
        self.ranges = Limit.ranges(self.stops.values())
        given = [each for each in self.mechanism.force_elements if each.name not in springs]
        self.pushed = self.mechanism.model_copy(update={"force_elements": tuple(given)})
        """With the springs and loads that are given as forces before each step."""
        self.links = {GROUND: Link(GROUND)}
        for body, _ in self.to.links:
            self._add(body)
        self.carriers: dict[str, float] = {}
        """Carriers of slots, and their speeds at the start [m/s]."""
        self.pairs = [_CLOSING[joint](self, joint) for joint in self.mechanism.loop_joints]

    def _add(self, body: Body) -> None:
        joint, made = self.mechanism.joint_of(body.name), list[dict[str, Any]]()
        place, turn = complex(*joint.parent_point), joint.turned_by or 0.0
        for k, freedom in enumerate(self.to.freedoms):
            if freedom.joint is joint:
                low, high = self.ranges.get(k, (-np.inf, np.inf)) - self.zeros[k]
                ends = [max(-1e10, low), min(1e10, high)] if k in self.ranges else None
                spring = self.springs.get(k)
                made.append({"name": f"joint {k}", "along": None, "range": ends, "spring": spring})
                if freedom.direction is None:
                    turn = float(self.zeros[k])
                else:
                    place += float(self.zeros[k]) * freedom.direction
                    made[-1]["along"] = freedom.direction
        for each in made:
            each["along"] = each["along"] and complex(each["along"] * np.exp(1j * turn))
        own = complex(*joint.child_point), body.mass, complex(*body.centre), body.inertia
        link = Link(body.name, place - self.links[joint.parent].origin, turn, *own, made)
        self.links[joint.parent].children.append(link)
        self.links[body.name] = link

    # --- Joints that close loops, as two sites that a `connect` holds together

    def _pin(self, joint: PinJoint) -> tuple[str, str]:
        return (
            self._site(f"{joint.name} 1", joint.child, complex(*joint.child_point)),
            self._site(f"{joint.name} 2", joint.parent, complex(*joint.parent_point)),
        )

    def _site(self, name: str, body: str, point: complex) -> str:
        self.links[body].sites.append((name, point - self.links[body].origin))
        return name

    def _slot(self, joint: SlotJoint) -> tuple[str, str]:
        """Hold a carrier on a slide of the parent to the child, of whose mass it has a part."""
        name, point, axis = (
            f"{joint.name} carrier",
            complex(*joint.child_point),
            complex(*joint.axis),
        )
        place, speed = self._relative(joint)
        child, parent = self.links[joint.child], self.links[joint.parent]
        carrier = Link(name, place - parent.origin, mass=CARRIED * child.mass)
        carrier.joints.append({"name": name, "along": axis, "range": None, "spring": None})
        parent.children.append(carrier)
        self.links[name], self.carriers[name] = carrier, (speed * axis.conjugate()).real
        centre = (child.centre - CARRIED * point) / (1 - CARRIED)
        child.inertia += child.mass * abs(child.centre - centre) ** 2
        child.inertia -= carrier.mass * abs(point - centre) ** 2
        child.mass, child.centre = child.mass - carrier.mass, centre
        if child.inertia < 0:
            raise UnsupportedProblemError(
                f"our adapter takes the mass of the carrier in {joint.name!r}, which no engine of "
                f"MJCF moves without, from {joint.child!r}, and that has too little inertia."
            )
        return self._site(f"{joint.name} 1", joint.child, point), self._site(name, name, 0j)

    def _relative(self, joint: SlotJoint) -> tuple[complex, complex]:
        """Place [m] and speed [m/s] of the point in the slot, in the parent's frame."""
        of, q, u = self.kinematics, self.q, self.u
        child, frame = of.point(joint.child, joint.child_point), of.point(joint.parent, (0.0, 0.0))
        back = complex(np.exp(1j * float(of.angle(joint.parent).value(q))))
        place = complex(*(of.position(child, q) - of.position(frame, q))) * back
        met = of.point(joint.parent, (place.real, place.imag))
        return place, complex(*(of.velocity(child, q, u) - of.velocity(met, q, u))) * back

    def program(self, options: GenesisEngine) -> str:
        """The run as a program with nothing but Genesis and NumPy."""
        once = self.problem.stop_law is StopLaw.RELEASE_ONCE
        definitions, forces = program(self.pushed)
        return filled_template(
            __name__,
            "alone.py.j2",
            mjcf=filled_template(__name__, "model.xml.j2", model=self, solimp=options.solimp),
            model=self,
            options=options,
            own=options.default_options,
            gravity=(self.mechanism.gravity_vector[0], 0.0, self.mechanism.gravity_vector[1]),
            steps=whole_steps(self.problem.duration, options.timestep),
            markers=[
                (each.body, complex(*each.point) - self.links[each.body].origin)
                for each in self.mechanism.markers
            ],
            limits=[(limit.index, limit.sense) for limit in self.stops.values()],
            drops=once and not options.keep_limits,
            definitions=definitions,
            forces=forces,
        )


_CLOSING: ElementTable[Callable[[Model, Any], tuple[str, str]]] = ElementTable(
    "genesis",
    JOINTS,
    {PinJoint: Model._pin, SlotJoint: Model._slot},
    others="our adapter closes loops by Genesis's `connect` alone",
)
