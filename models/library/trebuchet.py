"""The named machines: the paper's whipper trebuchet, what came before and what may come after it.

Masses and lengths are Table I's. The catapult of the introduction (Sec. I) is one rigid body on a
pivot. The floating arm of the outlook (Sec. VI) has no fixed pivot: the counterweight, at the arm's
short end, falls in a vertical track; the arm's wheel rolls on a level one. The arm's two points on
crossing lines make it a trammel: while the counterweight falls straight down, the arm turns over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field

from ..elements import GROUND, PinJoint, SlotJoint, Stop
from ..errors import InputError
from ..mechanism import Body, Marker, Mechanism
from ..spec import Positive, Real, Spec
from .benchmark import bob, floor, marker, pin, slot

Angle = Annotated[Real, Field(ge=-4 * math.pi, le=4 * math.pi)]
"""[rad] up to two turns either way: more are degrees more often than not."""


class TrebuchetParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of the whipper trebuchet.

    Defaults are Table I of the paper. Angles are absolute, from +x, positive clockwise. The paper
    does not print its start angles; (0, pi, -pi/4) is what its headline figures single out. Angles
    beyond two turns (4 pi) are refused: they are degrees more often than not.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or an angle is not in
            range.
    """

    l1: Positive = Field(default=10.0, description="arm, fulcrum to sling pin [m]")
    l2: Positive = Field(default=4.0, description="arm, fulcrum to hanger pin [m]")
    m_b: Positive = Field(default=60.0, description="projectile ('barrel') [kg]")
    m_cw: Positive = Field(default=3000.0, description="counterweight [kg]")
    m_a: Positive = Field(default=1000.0, description="throwing arm, a uniform rod [kg]")
    h: Positive = Field(default=10.0, description="hanger ('counterweight arm') length [m]")
    r: Positive = Field(default=6.0, description="sling length [m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(default=0.0, description="start angle of the throwing arm [rad]")
    phi0: Angle = Field(default=math.pi, description="start angle of the sling [rad]")
    alpha0: Angle = Field(default=-math.pi / 4, description="start angle of the hanger [rad]")

    @classmethod
    def with_beam(cls, l1: float, beam: float = 14.0, **others: float) -> Self:
        """Parameters on a beam of fixed length (the paper's fulcrum sweep): l2 = beam - l1.

        Args:
            l1: arm from the fulcrum to the sling pin [m].
            beam: whole length of the arm, l1 + l2 [m].
            others: any other parameter but l2.

        Raises:
            InputError: l1 is not shorter than the beam, or a value is not valid.
        """
        return cls(l1=l1, l2=short_end(l1, beam), **others)


def short_end(l1: float, beam: float) -> float:
    """The arm's other side on a beam of fixed length, l2 = beam - l1 [m].

    Raises:
        InputError: l1 is not shorter than the beam.
    """
    if not l1 < beam:
        raise InputError(
            f"l1 = {l1!r} must be shorter than the beam of {beam!r} m, so that l2 = beam - l1 > 0."
        )
    return beam - l1


FULCRUM, SLING_PIN, HANGER_PIN = "fulcrum", "sling pin", "hanger pin"
HANGER_REST, SLING_REST, ARM_STOP, TROUGH = "hanger rest", "sling rest", "arm stop", "trough"
PROJECTILE, COUNTERWEIGHT = "projectile", "counterweight"
DROP, TRACK = "drop", "track"


class HingedParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of the classical trebuchet.

    Masses and lengths are Table I's: the paper's machine, turned to where such machines started.
    Values are refused as by :class:`TrebuchetParameters`.
    """

    l1: Positive = Field(default=10.0, description="arm, fulcrum to sling pin [m]")
    l2: Positive = Field(default=4.0, description="arm, fulcrum to hanger pin [m]")
    m_b: Positive = Field(default=60.0, description="projectile, a point mass [kg]")
    m_cw: Positive = Field(default=3000.0, description="counterweight, a point mass [kg]")
    m_a: Positive = Field(default=1000.0, description="throwing arm, a uniform rod [kg]")
    h: Positive = Field(default=10.0, description="hanger length [m]")
    r: Positive = Field(default=6.0, description="sling length [m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(
        default=3 * math.pi / 4, description="start angle of the throwing arm [rad]"
    )
    phi0: Angle = Field(default=0.0, description="start angle of the sling [rad]")
    alpha0: Angle = Field(default=math.pi / 2, description="start angle of the hanger [rad]")


def fixed(parameters: TrebuchetParameters | None = None) -> Mechanism:
    """The machine whose fulcrum is pinned to the ground; q = (theta, phi, alpha)."""
    p = parameters or TrebuchetParameters()
    return _whipper("fixed", p, pin(FULCRUM, GROUND, "arm"), (p.theta0, p.phi0, p.alpha0))


def rolling(parameters: TrebuchetParameters | None = None) -> Mechanism:
    """The machine whose fulcrum rolls along x on massless wheels; q = (theta, phi, alpha, x_p)."""
    p = parameters or TrebuchetParameters()
    fulcrum = slot(FULCRUM, "arm", (1, 0), coordinate="x_p")
    return _whipper("rolling", p, fulcrum, (p.theta0, p.phi0, p.alpha0, 0.0))


def hinged(parameters: HingedParameters | None = None) -> Mechanism:
    """The classical trebuchet, whose projectile starts in a trough; q = (theta, phi, alpha)."""
    p = parameters or HingedParameters()
    whipper = fixed(TrebuchetParameters(**p.model_dump()))
    height = -p.l1 * math.sin(p.theta0) - p.r * math.sin(p.phi0)
    return Mechanism(
        name="hinged",
        bodies=whipper.bodies,
        joints=whipper.joints,
        stops=(floor(TROUGH, "sling", (p.r, 0), height=height, closed=True),),
        markers=whipper.markers[:2],  # of the projectile and the counterweight
        gravity=p.g,
        start=whipper.start,
    )


def parameters_of(mechanism: Mechanism) -> TrebuchetParameters | None:
    """The parameters a machine was built from; None if it is not exactly one of these two."""
    build = {"fixed": fixed, "rolling": rolling}.get(mechanism.name)
    bodies = {body.name: body for body in mechanism.bodies}
    if not build or bodies.keys() != {"arm", "sling", "hanger"} or len(mechanism.joints) != 3:
        return None
    _, sling_pin, hanger_pin = mechanism.joints
    sling, hanger = bodies["sling"], bodies["hanger"]
    try:
        parameters = TrebuchetParameters(
            l1=sling_pin.parent_point[0],
            l2=-hanger_pin.parent_point[0],
            m_b=sling.mass,
            m_cw=hanger.mass,
            m_a=bodies["arm"].mass,
            h=hanger.centre[0],
            r=sling.centre[0],
            g=mechanism.gravity,
            theta0=mechanism.start[0],
            phi0=mechanism.start[1],
            alpha0=mechanism.start[2],
        )
    except InputError:
        return None
    return parameters if build(parameters) == mechanism else None


def whipper_numbers(p: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the whipper that depend on its parameters, by name (:mod:`..stacked`).

    Plain arithmetic, which takes arrays and complex steps, as a validated description does not.
    The tests hold it against the machine itself.

    Args:
        p: values of the fields of `TrebuchetParameters`, real or complex, or arrays of them.
    """
    return {
        "bodies.arm.mass": p["m_a"],
        "bodies.arm.centre.0": (p["l1"] - p["l2"]) / 2,
        "bodies.arm.inertia": p["m_a"] * (p["l1"] + p["l2"]) ** 2 / 12,
        "bodies.sling.mass": p["m_b"],
        "bodies.sling.centre.0": p["r"],
        "bodies.hanger.mass": p["m_cw"],
        "bodies.hanger.centre.0": p["h"],
        "joints.sling pin.parent_point.0": p["l1"],
        "joints.hanger pin.parent_point.0": -p["l2"],
        "stops.hanger rest.limit": p["theta0"] - p["alpha0"],
        "stops.sling rest.limit": p["phi0"] - p["theta0"],
        "markers.projectile.point.0": p["r"],
        "markers.counterweight.point.0": p["h"],
        "markers.arm centre.point.0": (p["l1"] - p["l2"]) / 2,
        "gravity": p["g"],
        "start.0": p["theta0"],
        "start.1": p["phi0"],
        "start.2": p["alpha0"],
    }


def _whipper(
    name: str, p: TrebuchetParameters, fulcrum: PinJoint | SlotJoint, start: tuple[float, ...]
) -> Mechanism:
    centre, inertia = ((p.l1 - p.l2) / 2, 0.0), p.m_a * _square(p.l1 + p.l2) / 12
    # The two rests stand where the machine starts (paper Eqs. 6, 7: phi_0 = phi[0], alpha_0 =
    # alpha[0]), so a machine with other start angles has its rests elsewhere, and both always touch
    # at the start.
    hanger_rest = Stop(
        name=HANGER_REST, body="hanger", relative_to="arm", sense=-1, limit=p.theta0 - p.alpha0,
        closed=True,
    )  # fmt: skip
    sling_rest = Stop(
        name=SLING_REST, body="sling", relative_to="arm", sense=1, limit=p.phi0 - p.theta0,
        closed=True,
    )  # fmt: skip
    arm_stop = Stop(name=ARM_STOP, body="arm", sense=-1, limit=-3 * math.pi / 2, closed=False)
    return Mechanism(
        name=name,
        bodies=(
            Body(name="arm", angle="theta", mass=p.m_a, centre=centre, inertia=inertia),
            bob("sling", "phi", p.r, p.m_b),
            bob("hanger", "alpha", p.h, p.m_cw),
        ),
        joints=(
            fulcrum,
            pin(SLING_PIN, "arm", "sling", (p.l1, 0)),
            pin(HANGER_PIN, "arm", "hanger", (-p.l2, 0)),
        ),
        stops=(hanger_rest, sling_rest, arm_stop),
        markers=(
            marker(PROJECTILE, "sling", (p.r, 0)),
            marker(COUNTERWEIGHT, "hanger", (p.h, 0)),
            marker("arm centre", "arm", centre),
        ),
        gravity=p.g,
        start=start,
    )


def _loaded_arm(l1: float, l2: float, mass: float, loads: Mapping[float, float]) -> Body:
    """A uniform rod from -l2 to l1 along its own x axis, with point masses fixed to it.

    Args:
        l1, l2: from the fulcrum to the sling's and to the counterweight's end [m].
        mass: of the rod alone [kg].
        loads: mass [kg] at each position along the arm [m].
    """
    middle, whole = (l1 - l2) / 2, mass + sum(loads.values())
    centre = (mass * middle + sum(load * x for x, load in loads.items())) / whole
    rod = mass * (_square(l1 + l2) / 12 + _square(middle - centre))
    points = sum(load * _square(x - centre) for x, load in loads.items())
    return Body(name="arm", angle="theta", mass=whole, centre=(centre, 0), inertia=rod + points)


def _square(length: float) -> float:
    """Square of a length [m^2]; InputError if it is beyond the largest float64."""
    try:
        return length**2
    except OverflowError:
        raise InputError(
            f"a length of {length!r} m is too large: its square must be a number, below 1.8e308."
        ) from None


class CatapultParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angle [rad] of the catapult.

    Masses and arm are Table I's. The arm starts pointing back and down, away from the launch, at 45
    degrees.
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
    """
    p = parameters or CatapultParameters()
    return Mechanism(
        name="catapult",
        bodies=(_loaded_arm(p.l1, p.l2, p.m_a, {p.l1: p.m_b, -p.l2: p.m_cw}),),
        joints=(pin(FULCRUM, GROUND, "arm"),),
        markers=(
            Marker(name=PROJECTILE, body="arm", point=(p.l1, 0), mass=p.m_b),
            marker(COUNTERWEIGHT, "arm", (-p.l2, 0)),
        ),
        gravity=p.g,
        start=(p.theta0,),
    )


class FloatingArmParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of a floating arm.

    Masses and lengths are Table I's; the wheel stands where the fulcrum of the others is.
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
    """
    p = parameters or FloatingArmParameters()
    height = -p.l1 * math.sin(p.theta0) - p.r * math.sin(p.phi0)
    return Mechanism(
        name="floating-arm",
        bodies=(_loaded_arm(p.l1, p.l2, p.m_a, {-p.l2: p.m_cw}), bob("sling", "phi", p.r, p.m_b)),
        joints=(
            slot(DROP, "arm", (0, 1), on=(-p.l2, 0), coordinate="drop"),
            pin(SLING_PIN, "arm", "sling", (p.l1, 0)),
            slot(TRACK, "arm", (1, 0)),
        ),
        stops=(floor(TROUGH, "sling", (p.r, 0), height=height, closed=True),),
        markers=(
            marker(PROJECTILE, "sling", (p.r, 0)),
            marker(COUNTERWEIGHT, "arm", (-p.l2, 0)),
            marker("wheel", "arm"),
        ),
        gravity=p.g,
        start=(p.theta0, p.phi0, p.l2 * math.sin(p.theta0)),
    )
