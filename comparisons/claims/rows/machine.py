"""Claims on the machine itself: Table I and what follows from it without a motion, Eqs. (5)-(9), the start."""

from __future__ import annotations

import math

from ....models.parameters import TrebuchetParameters
from ....models.trebuchet import fixed
from ....reference.solver import solve_to_launch
from ..evidence import Evidence, made
from ..results import Claim, Quantity
from ..verdicts import Cause, Judgement, as_printed, at_least, vanishes

_ROUNDING = 1e-12  # of sums of a few terms, relative: a thousand times what they can lose
_LENGTH, _ANGLE = "m", "deg"
_ALMOST = math.cos(math.radians(10.0))  # 'almost straight up' asks for ten degrees


def claims(evidence: Evidence) -> list[Claim]:
    """All of them."""
    p = evidence.parameters
    return [*_lengths(p), *_start(p), *_equations(evidence), *_freedom(evidence)]


def _exact(value: float, unit: str = "") -> Quantity:
    return Quantity(value=value, uncertainty=_ROUNDING * abs(value), unit=unit)


def _lengths(p: TrebuchetParameters) -> list[Claim]:
    beam, ratio = _exact(p.l1 + p.l2, _LENGTH), _exact(p.l1 / p.l2)
    shorter = _exact(9.91 / (beam.value - 9.91))
    turned = _exact(math.remainder(-(585.0 + 90.0), 360.0), _ANGLE)
    radians = _exact(math.radians(585.0), "rad")
    return [
        made("length of the arm", "Sec. V, Table I", "14 m", "l1 + l2", beam, as_printed(beam, "14")),
        made("lever ratio", "Sec. V, Table I", "2.5:1", "l1 / l2", ratio, as_printed(ratio, "2.5:1")),
        made(
            "lever ratio of l1 = 9.91",
            "Sec. V",
            "2.42:1",
            "9.91 / (l1 + l2 - 9.91)",
            shorter,
            as_printed(shorter, "2.42:1"),
        ),
        made("585° in radians", "Sec. IV", "10.2 rad", "585 deg in radians", radians, as_printed(radians, "10.2")),
        made(
            "585° and 90°",
            "Sec. IV",
            "45°",
            "a quarter turn on from 585 deg, clockwise, above the horizontal",
            turned,
            as_printed(turned, "45"),
        ),
    ]


def _start(p: TrebuchetParameters) -> list[Claim]:
    along, up = _exact(math.cos(p.theta0)), _exact(-math.sin(p.alpha0))
    off = math.degrees(math.acos(max(-1.0, min(1.0, up.value))))
    upright = solve_to_launch(fixed(p.model_copy(update={"alpha0": -math.pi / 2}))).launch
    instead = "would not launch" if upright is None else f"would launch with {upright.speed:.4g} m/s"
    steep = Cause(
        up.value < _ALMOST,
        f"the hanger starts {off:.3g} deg from the vertical; with it upright the machine {instead}, not with 99.4 m/s",
    )
    return [
        made(
            "arm points in the direction of launch",
            "Sec. I",
            "along +x",
            "cosine of theta at the start",
            along,
            at_least(along, _ALMOST, "within ten degrees"),
        ),
        made(
            "counterweight almost straight up",
            "Sec. I",
            "upright",
            "sine of the hanger's elevation at the start",
            up,
            at_least(up, _ALMOST, "'almost' asks for ten degrees", [steep]),
        ),
    ]


def _equations(evidence: Evidence) -> list[Claim]:
    """Eq. (5), about the fulcrum, against the rod of the mechanism; Eq. (9), about its centre."""
    p = evidence.parameters
    arm = evidence.throws["fixed"].mechanism.body("arm")
    about_fulcrum = arm.inertia + arm.mass * (arm.centre[0] ** 2 + arm.centre[1] ** 2)
    five = p.m_a * (p.l1**3 + p.l2**3) / (p.l1 + p.l2) / 3
    nine = p.m_a * (p.l1 + p.l2) ** 2 / 12
    return [
        _inertia("Eq. (5)", "arm's moment of inertia about the fulcrum, Eq. (5) less the rod's", five, about_fulcrum),
        _inertia("Eq. (9)", "arm's moment of inertia about its centre, Eq. (9) less the rod's", nine, arm.inertia),
    ]


def _inertia(where: str, quantity: str, paper: float, ours: float) -> Claim:
    apart = Quantity(value=paper - ours, uncertainty=_ROUNDING * ours, unit="kg m²")
    return made(
        f"moment of inertia, {where}",
        where,
        f"{paper:.6g} kg m²",
        quantity,
        apart,
        vanishes(apart, 0.0, "the same rod"),
    )


def _freedom(evidence: Evidence) -> list[Claim]:
    printed = {"fixed": ("Sec. II", "3"), "rolling": ("Sec. VI", "4")}
    found: list[Claim] = []
    for name, (where, number) in printed.items():
        count = Quantity(value=len(evidence.throws[name].mechanism.coordinates), uncertainty=0.0, unit="")
        judgement: Judgement = as_printed(count, number)
        found.append(
            made(
                f"degrees of freedom, {name}",
                where,
                number,
                "generalized coordinates, all rests open",
                count,
                judgement,
                machine=name,
            )
        )
    return found
