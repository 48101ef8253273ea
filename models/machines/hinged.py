"""The trebuchet with a hinged counterweight in its classical orientation (Denny, Eur. J. Phys. 26 (2005) 561).

The arm starts pointing back and down, the counterweight hangs below its short end, and the sling lies folded forward
under the machine, its projectile in a level trough without friction until it lifts off.
"""

from __future__ import annotations

import math

from pydantic import Field

from ..mechanism import Mechanism, PointStop
from ..spec import Positive, Spec
from .parameters import Angle, TrebuchetParameters
from .trebuchet import COUNTERWEIGHT, PROJECTILE, fixed

TROUGH = "trough"


class HingedParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of the classical trebuchet.

    Masses and lengths are Table I's: the paper's machine, turned to where such machines started.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or an angle is not in range.
    """

    l1: Positive = Field(default=10.0, description="arm, fulcrum to sling pin [m]")
    l2: Positive = Field(default=4.0, description="arm, fulcrum to hanger pin [m]")
    m_b: Positive = Field(default=60.0, description="projectile, a point mass [kg]")
    m_cw: Positive = Field(default=3000.0, description="counterweight, a point mass [kg]")
    m_a: Positive = Field(default=1000.0, description="throwing arm, a uniform rod [kg]")
    h: Positive = Field(default=10.0, description="hanger length [m]")
    r: Positive = Field(default=6.0, description="sling length [m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(default=3 * math.pi / 4, description="start angle of the throwing arm [rad]")
    phi0: Angle = Field(default=0.0, description="start angle of the sling [rad]")
    alpha0: Angle = Field(default=math.pi / 2, description="start angle of the hanger [rad]")


def hinged(parameters: HingedParameters | None = None) -> Mechanism:
    """The classical trebuchet; q = (theta, phi, alpha), and a trough where the projectile starts.

    Args:
        parameters: as documented there where left out.
    """
    p = parameters or HingedParameters()
    whipper = fixed(TrebuchetParameters(**p.model_dump()))
    floor = -p.l1 * math.sin(p.theta0) - p.r * math.sin(p.phi0)
    trough = PointStop(name=TROUGH, body="sling", point=(p.r, 0), normal=(0, 1), offset=floor, closed=True)
    return Mechanism(
        name="hinged",
        bodies=whipper.bodies,
        joints=whipper.joints,
        stops=(trough,),
        markers=tuple(marker for marker in whipper.markers if marker.name in (PROJECTILE, COUNTERWEIGHT)),
        gravity=p.g,
        start=whipper.start,
    )
