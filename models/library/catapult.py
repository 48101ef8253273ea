"""The catapult of the paper's introduction (Sec. I): one rigid body on a pivot."""

from __future__ import annotations

import math

from pydantic import Field

from ..elements import GROUND, PinJoint
from ..mechanism import Marker, Mechanism
from ..spec import Positive, Spec
from .trebuchet import COUNTERWEIGHT, FULCRUM, PROJECTILE, Angle, loaded_arm


class CatapultParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angle [rad] of the catapult.

    Masses and arm are Table I's. The arm starts pointing back and down, away from the launch, at 45
    degrees.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or the angle is not in
            range.
    """

    l1: Positive = Field(default=10.0, description="arm, fulcrum to projectile [m]")
    l2: Positive = Field(default=4.0, description="arm, fulcrum to counterweight [m]")
    m_b: Positive = Field(
        default=60.0, description="projectile, in a cup at the end of the arm [kg]"
    )
    m_cw: Positive = Field(default=3000.0, description="counterweight, fixed to the arm [kg]")
    m_a: Positive = Field(default=1000.0, description="arm, a uniform rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(default=3 * math.pi / 4, description="start angle of the arm [rad]")


def catapult(parameters: CatapultParameters | None = None) -> Mechanism:
    """One body: arm, counterweight fixed to it, projectile in its cup; q = (theta,).

    The projectile is part of the body for as long as the motion is followed: a launch is an instant
    of it.

    Args:
        parameters: Table I's masses and arm where left out.
    """
    p = parameters or CatapultParameters()
    return Mechanism(
        name="catapult",
        bodies=(loaded_arm(p.l1, p.l2, p.m_a, {p.l1: p.m_b, -p.l2: p.m_cw}),),
        joints=(
            PinJoint(
                name=FULCRUM, parent=GROUND, child="arm", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        markers=(
            Marker(name=PROJECTILE, body="arm", point=(p.l1, 0), mass=p.m_b),
            Marker(name=COUNTERWEIGHT, body="arm", point=(-p.l2, 0)),
        ),
        gravity=p.g,
        start=(p.theta0,),
    )
