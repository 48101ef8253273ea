"""Names of a built system's sensors, and what they say of the bodies' rotations: positive anticlockwise in Exudyn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import GROUND

SensorKey = tuple[str, str, str]
"""Kind of item (body, marker, joint, stop, spring), its name, the quantity as Exudyn calls it."""

Values = Callable[[SensorKey], FloatArray]
"""Values of a sensor, shape (n, components): over a table, or one row of the present."""


def rotation(body: str, values: Values, quantity: str = "CoordinatesTotal") -> FloatArray:
    """Rotation of a body [rad], or its derivative by the quantity's name, shape (n,); of the ground 0, shape (1,)."""
    return np.zeros(1) if body == GROUND else values(("body", body, quantity))[:, 2]


def turned(local: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors of a frame in the one it is turned in, shape (n, 2); angles [rad] anticlockwise, shape (n,)."""
    world = (local[:, 0] + 1j * local[:, 1]) * np.exp(1j * angle)
    return np.stack([world.real, world.imag], axis=-1)
