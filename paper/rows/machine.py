"""Claims on the machine itself: Table I and what follows from it, its scale, and the start."""

from __future__ import annotations

import math

import numpy as np

from ...models.kinematics import Kinematics
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.trebuchet import COUNTERWEIGHT, PROJECTILE, fixed
from ...models.mechanism import Mechanism
from ...reference.solver import solve_to_launch
from ..evidence import Evidence, made
from ..results import Claim, Quantity
from ..verdicts import Cause, as_printed, at_most, positive, vanishes

_ROUNDING = 1e-12  # of sums of a few terms, relative: a thousand times what they can lose
_LENGTH, _ANGLE = "m", "deg"
_ALMOST = 10.0  # [deg]: 'almost' asks for ten
_MASS_SCALE, _LENGTH_SCALE = 10_000.0, 50.0  # Table I over the model that was measured
_SCALED = 1e-9  # relative, of figures of two integrations at a relative tolerance of 1e-13 over a throw


def claims(evidence: Evidence) -> list[Claim]:
    """All of them."""
    p = evidence.parameters
    return [*_lengths(p), *_start(p), *_resting(evidence), _scaled(evidence)]


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
    along = _exact(math.degrees(math.acos(math.cos(p.theta0))), _ANGLE)
    return [
        made(
            "arm points in the direction of launch",
            "Sec. I",
            "along +x",
            "angle of the arm to the direction of launch, at the start",
            along,
            at_most(along, _ALMOST, "ten degrees"),
        ),
        _upright(p),
        _one_side(fixed(p)),
    ]


def _upright(p: TrebuchetParameters) -> Claim:
    """Of the hanger, or of the counterweight as the fulcrum sees it: whichever is nearer to the vertical."""
    x, y = _at_start(fixed(p), COUNTERWEIGHT)
    hanger, seen = (abs(math.degrees(math.atan2(x, y))) for x, y in ((math.cos(p.alpha0), -math.sin(p.alpha0)), (x, y)))
    off = _exact(min(hanger, seen), _ANGLE)
    upright = solve_to_launch(fixed(p.model_copy(update={"alpha0": -math.pi / 2}))).launch
    instead = "would not launch" if upright is None else f"would launch with {upright.speed:.4g} m/s"
    steep = Cause(
        off.value > _ALMOST,
        f"the hanger starts {hanger:.3g} deg from the vertical, and the counterweight stands {seen:.3g} deg from it as "
        f"the fulcrum sees it; with the hanger upright the machine {instead}, not with 99.4 m/s",
    )
    return made(
        "counterweight almost straight up",
        "Sec. I",
        "upright",
        "angle to the vertical at the start, of the hanger or of the line from the fulcrum, the smaller",
        off,
        at_most(off, _ALMOST, "'almost' asks for ten degrees", [steep]),
    )


def _at_start(mechanism: Mechanism, name: str) -> tuple[float, float]:
    """Where a marker is at the start [m]."""
    marker = next(each for each in mechanism.markers if each.name == name)
    kinematics = Kinematics(mechanism)
    x, y = kinematics.position(kinematics.point(marker.body, marker.point), np.array(mechanism.start))
    return float(x), float(y)


def _one_side(mechanism: Mechanism) -> Claim:
    x = min(_at_start(mechanism, COUNTERWEIGHT)[0], _at_start(mechanism, PROJECTILE)[0])
    same = _exact(x, _LENGTH)
    return made(
        "counterweight starts on the projectile's side",
        "Sec. V",
        "same side",
        "distance of the nearer of the two in front of the fulcrum",
        same,
        positive(same, "the distance in front of the fulcrum"),
        machine="fixed",
    )


def _resting(evidence: Evidence) -> list[Claim]:
    """Two constraints act at first: rests that are closed and push."""
    found: list[Claim] = []
    for name, throw in evidence.throws.items():
        closed = [stop.name for stop in throw.mechanism.stops if stop.closed]
        pushing = sum(throw.figures.get(f"stop_torque ({stop}), start", 0.0) > 0 for stop in closed)
        count = Quantity(value=pushing, uncertainty=0.0, unit="")
        where, quantity = "Sec. II" if name == "fixed" else "Sec. VI", "rests that push at the start"
        found.append(
            made(f"constraints at first, {name}", where, "2", quantity, count, as_printed(count, "2"), (), name)
        )
    return found


def _scaled(evidence: Evidence) -> Claim:
    """The model's measures, scaled: the same motion, slower by the root of the lengths' scale."""
    p, throw = evidence.parameters, evidence.throws["fixed"]
    lengths = {name: getattr(p, name) / _LENGTH_SCALE for name in ("l1", "l2", "h", "r")}
    masses = {name: getattr(p, name) / _MASS_SCALE for name in ("m_a", "m_b", "m_cw")}
    launch = solve_to_launch(fixed(p.model_copy(update=lengths | masses))).launch
    speed = 0.0 if launch is None else launch.speed * math.sqrt(_LENGTH_SCALE)
    apart = Quantity(value=speed / throw.figures["launch_speed"] - 1, unit="")
    return made(
        "the model behaves as the machine",
        "Sec. II, Table I",
        "50, 10,000",
        "launch speed of the machine with its lengths over 50 and its masses over 10,000, times √50, relative",
        apart,
        vanishes(apart, _SCALED, "two integrations"),
        machine="fixed",
    )
