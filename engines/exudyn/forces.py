"""Force elements as Exudyn's items: springs and dampers are connectors, constant forces and torques are loads."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.force_elements import (
    ConstantForce,
    ConstantTorque,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from .sensors import Values

items: Any = importlib.import_module("exudyn.itemInterface")

_Spring = SpringDamper | RotationalSpringDamper


def point_spring(spring: SpringDamper, markers: list[int]) -> Any:
    """The item of a spring between points; of one without rest length and damping that where the points may meet."""
    if spring.rest_length or spring.damping:
        return items.ObjectConnectorSpringDamper(
            markerNumbers=markers,
            stiffness=spring.stiffness,
            damping=spring.damping,
            referenceLength=spring.rest_length,
        )
    return items.ObjectConnectorCartesianSpringDamper(
        markerNumbers=markers, stiffness=[spring.stiffness] * 2 + [0.0]
    )


def rotational_spring(
    spring: RotationalSpringDamper, mechanism: Mechanism, markers: list[int]
) -> Any:
    """The item of a spring between the rotations of the other body and the spring's: full turns count."""
    return items.ObjectConnectorCoordinateSpringDamper(
        markerNumbers=markers,
        stiffness=spring.stiffness,
        damping=spring.damping,
        offset=_rest_displacement(spring, mechanism),
    )


def force(element: ConstantForce, marker: int) -> Any:
    """The load of a constant force, whose direction does not turn with the body."""
    return items.LoadForceVector(
        markerNumber=marker, loadVector=[*element.force, 0.0], bodyFixed=False
    )


def torque(element: ConstantTorque, marker: int, sense: int) -> Any:
    """The load of a constant torque on its body (sense 1) or on the other one (-1); Exudyn's are anticlockwise."""
    return items.LoadTorqueVector(
        markerNumber=marker, loadVector=[0.0, 0.0, -sense * element.torque]
    )


def measure(spring: _Spring) -> str:
    """What Exudyn calls the quantity that a spring's energy follows from."""
    return "Distance" if isinstance(spring, SpringDamper) else "Displacement"


def spring_energy(spring: _Spring, mechanism: Mechanism, values: Values) -> FloatArray:
    """Energy of a spring by the connector's own distance or displacement [J], shape (n,)."""
    rest = (
        spring.rest_length
        if isinstance(spring, SpringDamper)
        else _rest_displacement(spring, mechanism)
    )
    return (
        0.5
        * spring.stiffness
        * (values(("spring", spring.name, measure(spring)))[:, 0] - rest) ** 2
    )


def _rest_displacement(spring: RotationalSpringDamper, mechanism: Mechanism) -> float:
    """Displacement at the rest angle [rad]: Exudyn's rotations are anticlockwise, its displacements from the start."""
    start = (
        Kinematics(mechanism)
        .angle(spring.body, spring.relative_to)
        .value(np.array(mechanism.start))
    )
    return float(start) - spring.rest_angle
