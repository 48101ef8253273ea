"""The floating arm trebuchet of the paper's outlook (Sec. VI): an arm without a fixed pivot.

The counterweight, at the arm's short end, falls in a vertical track; the arm's wheel rolls on a
level one. The arm's two points on crossing lines make it a trammel: while the counterweight falls
straight down, the arm turns over.
"""

from __future__ import annotations

import math

from pydantic import Field

from ..elements import PinJoint, PointStop, SlotJoint
from ..mechanism import Body, Marker, Mechanism
from ..spec import Positive, Spec
from .trebuchet import COUNTERWEIGHT, PROJECTILE, SLING_PIN, TROUGH, Angle, loaded_arm

DROP, TRACK = "drop", "track"


class FloatingArmParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of a floating arm.

    Masses and lengths are Table I's; the wheel stands where the fulcrum of the others is.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or an angle is not in
            range.
    """

    l1: Positive = Field(default=10.0, description="arm, wheel to sling pin [m]")
    l2: Positive = Field(default=4.0, description="arm, wheel to counterweight [m]")
    m_b: Positive = Field(default=60.0, description="projectile, a point mass [kg]")
    m_cw: Positive = Field(
        default=3000.0, description="counterweight, a point mass on the arm's end [kg]"
    )
    m_a: Positive = Field(default=1000.0, description="arm, a uniform rod [kg]")
    r: Positive = Field(default=6.0, description="sling length [m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(default=3 * math.pi / 4, description="start angle of the arm [rad]")
    phi0: Angle = Field(default=0.0, description="start angle of the sling [rad]")


def floating_arm(parameters: FloatingArmParameters | None = None) -> Mechanism:
    """The arm on its two tracks and its sling; q = (theta, phi, drop), one loop.

    The tracks cross at the origin; `drop` is the counterweight's height above the wheel's track.

    Args:
        parameters: Table I's where left out.
    """
    p = parameters or FloatingArmParameters()
    sling = Body(name="sling", angle="phi", mass=p.m_b, centre=(p.r, 0), inertia=0)
    floor = -p.l1 * math.sin(p.theta0) - p.r * math.sin(p.phi0)
    trough = PointStop(
        name=TROUGH, body="sling", point=(p.r, 0), normal=(0, 1), offset=floor, closed=True
    )
    return Mechanism(
        name="floating-arm",
        bodies=(loaded_arm(p.l1, p.l2, p.m_a, {-p.l2: p.m_cw}), sling),
        joints=(
            SlotJoint(
                name=DROP,
                child="arm",
                parent_point=(0, 0),
                child_point=(-p.l2, 0),
                axis=(0, 1),
                coordinate="drop",
            ),
            PinJoint(
                name=SLING_PIN,
                parent="arm",
                child="sling",
                parent_point=(p.l1, 0),
                child_point=(0, 0),
            ),
            SlotJoint(
                name=TRACK, child="arm", parent_point=(0, 0), child_point=(0, 0), axis=(1, 0)
            ),
        ),
        stops=(trough,),
        markers=(
            Marker(name=PROJECTILE, body="sling", point=(p.r, 0)),
            Marker(name=COUNTERWEIGHT, body="arm", point=(-p.l2, 0)),
            Marker(name="wheel", body="arm", point=(0, 0)),
        ),
        gravity=p.g,
        start=(p.theta0, p.phi0, p.l2 * math.sin(p.theta0)),
    )
