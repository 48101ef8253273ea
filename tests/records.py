"""Mechanisms that recorded efforts move: a wheel, and a cart with a rod that hangs from it."""

from __future__ import annotations

from typing import Any

import numpy as np
import trebucheck as tb
from mechanisms import pin
from trebucheck.models.arrays import FloatArray

MASS, INERTIA, GRAVITY = 2.5, 0.4, 9.81
INSTANTS, EFFORTS = (0.0, 0.25, 0.4, 1.1), (3.0, -7.0, 0.0, 2.0)


def record(**changes: Any) -> tb.RecordedTorque:
    """A torque on the wheel."""
    fields: dict[str, Any] = {"name": "motor", "body": "wheel", "times": INSTANTS}
    return tb.RecordedTorque(**(fields | {"torques": EFFORTS} | changes))


def push(**changes: Any) -> tb.RecordedForce:
    """A force on the cart."""
    fields: dict[str, Any] = {"name": "motor", "body": "cart", "coordinate": "s"}
    return tb.RecordedForce(**(fields | {"times": INSTANTS, "forces": EFFORTS} | changes))


def wheel(**changes: Any) -> tb.Mechanism:
    """A balanced wheel on a pin."""
    fields: dict[str, Any] = {
        "name": "wheel",
        "bodies": (tb.Body(name="wheel", angle="a", mass=MASS, centre=(0, 0), inertia=INERTIA),),
        "joints": (pin("hinge", "ground", "wheel", (0.0, 0.0)),),
        "force_elements": (record(),),
        "gravity": GRAVITY,
        "start": (0.3,),
        "start_speeds": (0.5,),
    }
    return tb.Mechanism(**(fields | changes))


def summed(
    times: FloatArray,
    order: int,
    instants: tuple[float, ...] = INSTANTS,
    efforts: tuple[float, ...] = EFFORTS,
) -> FloatArray:
    """The record's integral over time, once or twice."""
    jumps = np.diff(np.array(efforts), prepend=0.0)
    since = np.maximum(times[:, None] - np.array(instants), 0.0)
    return (jumps * since**order / order).sum(axis=1)


def cart() -> tb.Mechanism:
    """A cart on a rail, with a rod that hangs from it."""
    return tb.Mechanism(
        name="cart",
        bodies=(
            tb.Body(name="cart", mass=MASS, centre=(0, 0), inertia=0.1),
            tb.Body(name="rod", angle="b", mass=1.0, centre=(0.0, -0.5), inertia=0.08),
        ),
        joints=(
            tb.PrismaticJoint(
                name="rail", child="cart", parent_point=(0, 0), child_point=(0, 0), axis=(1, 0),
                coordinate="s",
            ),
            pin("hinge", "cart", "rod", (0.0, 0.0)),
        ),
        force_elements=(push(), record(name="hip", body="rod")),
        gravity=GRAVITY,
        start=(0.4, 0.1),
    )  # fmt: skip
