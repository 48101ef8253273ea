"""The inertia of a rotor that turns with a relative angle: MuJoCo's armature, an inerter."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..functions import AngleFunction
from ..spec import NonNegative
from .base import Feature, Geometry, TorqueElement


class RotorInertia(TorqueElement):
    """Inertia of a rotor that turns with a relative angle, such as a geared motor's.

    With the rate w of the body's angle less that of the other it adds J w^2 / 2 to the kinetic
    energy. The torque on the body is -J dw/dt [N m], and the opposite on the other one: the rotor
    turns fast enough for its own absolute angle not to matter (its reflected inertia; an inerter of
    M. C. Smith, Synthesis of mechanical networks: the inerter, 2002).
    """

    feature: ClassVar[Feature] = Feature.ROTOR_INERTIA

    kind: Literal["rotor-inertia"] = "rotor-inertia"
    inertia: NonNegative = Field(description="J, seen from the joint [kg m^2]")

    @property
    def linear_law(self) -> tuple[float, float]:
        return 0.0, 0.0

    def torque_on_body(self, angle: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """None without accelerations: its part of the mass matrix is on their side [N m]."""
        return np.zeros(q.shape[:-1])

    def mass_matrix(self, geometry: Geometry) -> FloatArray:
        """J g g^T with the gradient g of the angle [kg m^2], shape (..., n_q, n_q)."""
        return self.direction(geometry).outer(self.inertia)
