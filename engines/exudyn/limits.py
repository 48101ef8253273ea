"""Stops as Exudyn's own unilateral elements, which stay in the system from start to end.

A stop on an angle is the limit of a coordinate spring (`limitStopsStiffness`), one that rebounds a
coordinate contact; a stop on a point is the contact of a sphere about it with a triangle. All are
springs and dampers that act where a gap is negative; rebounds are those of Exudyn's impact models.

Exudyn has no stiffness of its own for them. The rule here: with the inertia that it feels at the
start, a stop vibrates with a given period, some time steps long, and is damped critically if it is
without a restitution. So it is as stiff as the steps can follow, whatever the mechanism's size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models import elements
from ...models.arrays import FloatArray
from ...models.elements import STOPS, AnyStop, ElementTable
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ...models.mjcf.appearance import reach_of
from ...models.problem import StopLaw
from ..events import ContactEvents, note_own_releases
from ..impact import Inertia, inverse, mass_matrix
from ..protocol import Recording
from ..reading import timed_reading
from .build import Builder, items, refuse_own_wall
from .read import (
    AngleLimit,
    SensorKey,
    System,
    Values,
    exu,
    on_wall,
    recording,
    rotation,
    turned,
)
from .solver import DEPENDENT

_NO_LIMIT = 1e9  # [rad] the other side of a limit, which nothing turns to
# In reaches of the mechanism: a sphere's radius, more than a stop gives way; how far its triangle
# extends from where it is at the start to both sides. The gap is then rounded to some 1e-13.
_RADIUS, _EXTENT = 1.0, 1e3
_IMPACT_MODEL = 2  # "much more accurate regarding the coefficient of restitution" (itemInterface)


@dataclass(frozen=True)
class LimitSpring:
    """Numbers of a unilateral element; of an angle [N m/rad, N m s/rad], a point [N/m, N s/m]."""

    stiffness: float
    damping: float
    restitution: float

    @property
    def contact_fields(self) -> dict[str, Any]:
        """Parameters that Exudyn's contacts have in common."""
        if not self.restitution:
            return {"contactStiffness": self.stiffness, "contactDamping": self.damping}
        return {
            "contactStiffness": self.stiffness,
            "restitutionCoefficient": self.restitution,
            "impactModel": _IMPACT_MODEL,
        }


def build_with_limits(mechanism: Mechanism, law: StopLaw, period: float) -> System:
    """Build and assemble a system whose stops vibrate with a period [s].

    Under the release-once law, in which a stop is not met, it has no restitution.

    Raises:
        UnsupportedProblemError: an element is refused, or a stop is on a point of the body that it
            stands on.
    """
    builder = Builder(mechanism, alone=True)
    for stop in mechanism.stops:
        restitution = stop.restitution if law is StopLaw.UNILATERAL else 0.0
        LIMITS[stop](builder, stop, _spring(mechanism, stop, period, restitution))
    return builder.finished()


@timed_reading()
def recording_with_limits(
    system: System, columns: Mapping[SensorKey, slice], table: FloatArray, steps: int
) -> Recording:
    """The run of such a system in the mechanism's terms, as :func:`.read.recording` reads it."""
    events = ContactEvents(system.mechanism, "exudyn")
    recorded = recording(system, columns, table, events, steps, reopens=True)
    note_own_releases(events, recorded.t, recorded.stop_torques)
    return recorded


def _spring(mechanism: Mechanism, stop: AnyStop, period: float, restitution: float) -> LimitSpring:
    """The spring with a period [s] under the inertia that a stop feels at the start."""
    kinematics, (q, _) = Kinematics(mechanism), initial_state(mechanism)
    row, mass = kinematics.gap_jacobian(stop.name, q), mass_matrix(kinematics, q)
    response = float(row @ inverse(mass) @ row)
    in_loops = float(row @ Inertia(mass, kinematics.loop_jacobian(q)).response() @ row)
    # Loops that hold a gap leave nothing but rounding of it.
    felt = 1.0 / (in_loops if in_loops > DEPENDENT * response else response)
    rate = 2.0 * math.pi / period
    return LimitSpring(felt * rate**2, 2.0 * felt * rate, restitution)


def _start_gap(mechanism: Mechanism, stop: AnyStop) -> float:
    """Gap of a stop at the start [rad, m]; zero for a closed one."""
    start, _ = initial_state(mechanism)
    return 0.0 if stop.closed else float(Kinematics(mechanism).gap(stop.name, start))


# --- Stops on angles


def _add_angle(builder: Builder, stop: elements.Stop, spring: LimitSpring) -> None:
    if spring.restitution:
        _add_rebounding_angle(builder, stop, spring)
        return
    gap = _start_gap(builder.mechanism, stop)
    # Displacements count from the start.
    lower, upper = (-_NO_LIMIT, gap) if stop.sense > 0 else (-gap, _NO_LIMIT)
    item = items.ObjectConnectorCoordinateSpringDamperExt(
        markerNumbers=builder.rotations(stop.relative_to, stop.body),
        nodeNumber=_add_data(builder, [0.0, 0.0, 0.0]),
        useLimitStops=True,
        limitStopsLower=lower,
        limitStopsUpper=upper,
        limitStopsStiffness=spring.stiffness,
        limitStopsDamping=spring.damping,
    )
    number = builder.connect(item, "stop", stop.name, AngleLimit.force_sensor)
    builder.system.limits[stop.name] = _AngleSpring(stop, gap, number)


def _add_rebounding_angle(builder: Builder, stop: elements.Stop, spring: LimitSpring) -> None:
    gap = _start_gap(builder.mechanism, stop)
    # Exudyn shortens a step to the time in which the gap before it closes: to nothing where that is
    # none. So a closed stop begins as if it were open.
    node = _add_data(builder, [gap or 1.0, 0.0])
    # The contact's gap is the second coordinate less the first, and less the offset.
    item = items.ObjectContactCoordinate(
        markerNumbers=builder.rotations(stop.relative_to, stop.body)[:: -stop.sense],
        nodeNumber=node,
        offset=-gap,
        **spring.contact_fields,
    )
    builder.observe(items.SensorNode, ("stop", stop.name, "Coordinates"), nodeNumber=node)
    number = builder.connect(item, "stop", stop.name, "Distance")
    builder.system.limits[stop.name] = _ReboundingAngle(stop, spring, number)


def _add_data(builder: Builder, start: list[float]) -> int:
    """Add the node in which Exudyn keeps whether a unilateral element acts; its number."""
    node = items.NodeGenericData(initialCoordinates=start, numberOfDataCoordinates=len(start))
    return builder.add(node)


@dataclass(frozen=True)
class _AngleSpring:
    """A limit of a coordinate spring."""

    stop: elements.Stop
    start_gap: float
    """[rad]"""
    number: int
    """The item's."""

    def torque(self, values: Values) -> FloatArray:
        """Torque [N m], shape (n,)."""
        return AngleLimit(self.stop, None).torque(values)

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state [rad]."""
        displacement = system.output(self.number, "Displacement")
        return self.start_gap - self.stop.sense * float(displacement)


@dataclass(frozen=True)
class _ReboundingAngle:
    """A coordinate contact, which has no output of its force: it follows from the contact's law."""

    stop: elements.Stop
    spring: LimitSpring
    number: int

    def torque(self, values: Values) -> FloatArray:
        """Torque [N m], shape (n,)."""
        stop, e = self.stop, self.spring.restitution
        gap = values(("stop", stop.name, "Distance"))[:, 0]
        # The node's data: the gap in the last iteration, the speed at which the stop was met.
        state, met = values(("stop", stop.name, "Coordinates")).T
        speed = AngleLimit(stop, None).gap_speeds(values)
        loss = 1.5 * (1 - e) * (11 - e) / (1 + 9 * e) if e > 1 / 3 else (1 - e * e) / e
        damped = np.divide(loss * speed, met, out=np.zeros(len(gap)), where=met > 0)
        return np.where(state <= 0, -self.spring.stiffness * gap * (1 - damped), 0.0)

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state [rad]."""
        return float(system.output(self.number, "Distance"))


# --- Stops on points


def _add_point(builder: Builder, stop: elements.PointStop, spring: LimitSpring) -> None:
    refuse_own_wall(stop)
    mechanism, (start, _) = builder.mechanism, initial_state(builder.mechanism)
    kinematics, reach = Kinematics(mechanism), reach_of(mechanism)
    normal = complex(*stop.normal)
    from_wall = kinematics.between(stop.body, stop.point, stop.relative_to, (0.0, 0.0))
    beside = float(kinematics.component(1j * normal, stop.relative_to, from_wall).value(start))
    radius, extent = _RADIUS * reach, _EXTENT * reach
    centre = (stop.offset - radius) * normal + beside * 1j * normal
    # So wide where the mechanism moves; the third axis is out of its plane.
    corners = [(-2.0 * extent, -2.0 * extent), (2.0 * extent, -2.0 * extent), (0.0, 2.0 * extent)]
    item = items.ObjectContactSphereTriangle(
        markerNumbers=[
            builder.frame(stop.body, stop.point),
            builder.frame(stop.relative_to, (centre.real, centre.imag)),
        ],
        nodeNumber=_add_data(builder, [_start_gap(mechanism, stop), 0.0, 0.0, 0.0]),
        sphereRadius=radius,
        trianglePoints=exu.Vector3DList(
            [[(1j * normal * x).real, (1j * normal * x).imag, z] for x, z in corners]
        ),
        includeEdges=0,
        **spring.contact_fields,
    )
    builder.observe_relative(on_wall(stop))
    number = builder.connect(item, "stop", stop.name, "Force")
    builder.system.limits[stop.name] = _PlaneContact(stop, beside, extent, number)


@dataclass(frozen=True)
class _PlaneContact:
    """A sphere about a point and a triangle of a body or the ground."""

    stop: elements.PointStop
    beside: float
    """Place of the triangle's centre along the wall, anticlockwise from its normal [m]."""
    extent: float
    """Half the width of the triangle there [m]."""
    number: int

    def torque(self, values: Values) -> FloatArray:
        """Force along the wall's normal [N], shape (n,).

        Raises:
            SimulationError: the point went past the end of the triangle, where no force acts.
        """
        place = on_wall(self.stop).place(values) * complex(*self.stop.normal).conjugate()
        if float(np.abs(place.imag - self.beside).max()) >= self.extent:
            raise SimulationError(
                f"exudyn: the point of {self.stop.name!r} went past the end of its wall, which our "
                f"adapter builds as a triangle of {self.extent:.3g} m to both sides of the start."
            )
        force = values(("stop", self.stop.name, "Force"))
        local = turned(force, -rotation(self.stop.relative_to, values))
        return local @ np.array(self.stop.normal)

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state [m]."""
        return float(system.output(self.number, "DisplacementLocal"))


LIMITS: ElementTable[Callable[[Builder, Any, LimitSpring], None]] = ElementTable(
    "exudyn's limits",
    STOPS,
    {elements.Stop: _add_angle, elements.PointStop: _add_point},
)
"""Adders of a stop as Exudyn's own unilateral element."""
