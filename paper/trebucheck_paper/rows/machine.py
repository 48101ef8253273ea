"""Claims on the machine: Table I, Eqs. (2) to (5) and (8) to (10), scale, coordinates, start."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from trebucheck.api.mechanics import (
    COUNTERWEIGHT,
    PROJECTILE,
    Equations,
    FloatArray,
    Kinematics,
    Mechanism,
    TrebuchetParameters,
    fixed,
    model,
    solve_to_launch,
)

from ..evidence.claims import (
    BEAM,
    BEST_ANGLE,
    BEST_L1,
    BEST_RATIO,
    LAUNCH_SPEED,
    LEVER_RATIO,
    SLING_ANGLE,
    SLING_RADIANS,
    Quantity,
)
from ..evidence.quantities import LAUNCH_SPEED as SPEED
from ..evidence.quantities import start_torque
from ..evidence.verdicts import (
    FIXED,
    ROLLING,
    Cause,
    Evidence,
    Row,
    as_printed,
    at_most,
    positive,
    undecided,
    vanishes,
)

_ROUNDING = 1e-12  # of sums of a few terms, relative: a thousand times what they can lose
_ALMOST = 10.0  # [deg]: 'almost' is taken as within ten
_MASS_SCALE, _LENGTH_SCALE = 10_000.0, 50.0  # Table I over the model that was measured
_SCALED = 1e-9  # relative, of two integrations of a throw at a relative tolerance of 1e-13
# Random states, with angles all round: energies that agree in all of them are taken as equal.
_STATES, _SEED = (64, 1)
_SPEEDS = 3.0  # [rad/s, m/s] standard deviation of the random speeds

Energies = Callable[[TrebuchetParameters, FloatArray, FloatArray], tuple[float, float]]
"""Kinetic and potential energy [J] as the paper writes them, of parameters, q and u."""


def rows(evidence: Evidence) -> Iterator[Row]:
    """Rows of this section."""
    p = evidence.parameters
    yield from _lengths(p)
    yield from _start(p)
    yield from _resting(evidence)
    yield _scaled(evidence)
    yield from _inertias(evidence)
    yield from _energies(evidence)
    yield from _freedom(evidence)


def _exact(value: float, unit: str = "") -> Quantity:
    return Quantity(value=value, uncertainty=_ROUNDING * abs(value), unit=unit)


def _lengths(p: TrebuchetParameters) -> Iterator[Row]:
    beam, l1, turned = p.l1 + p.l2, BEST_L1.value, SLING_ANGLE.value
    where = "Sec. V, Table I"
    above = _exact(math.remainder(-(turned + 90.0), 360.0), "deg")
    yield Row("length of the arm", where, BEAM, "l1 + l2", _exact(beam, "m"), as_printed)
    yield Row("lever ratio", where, LEVER_RATIO, "l1 / l2", _exact(p.l1 / p.l2), as_printed)
    shorter = _exact(l1 / (beam - l1))
    # Arithmetic of the print: part of the claims whose numbers it gives.
    quantity, fact = "9.91 / (l1 + l2 - 9.91)", "best lever ratio"
    yield Row(
        "lever ratio of l1 = 9.91", "Sec. V", BEST_RATIO, quantity, shorter, as_printed, fact=fact
    )
    radians = _exact(math.radians(turned), "rad")
    fact = "sling's angle at the best release"
    yield Row(
        "585° in radians",
        "Sec. IV",
        SLING_RADIANS,
        "585 deg in radians",
        radians,
        as_printed,
        fact=fact,
    )
    quantity = "a quarter turn on from 585 deg, clockwise, above the horizontal"
    yield Row(
        "585° and 90°",
        "Sec. IV",
        BEST_ANGLE,
        quantity,
        above,
        as_printed,
        fact="best angle of release",
    )


def _start(p: TrebuchetParameters) -> Iterator[Row]:
    yield Row(
        "arm points in the direction of launch",
        "Sec. I",
        "along +x",
        "angle of the arm to the direction of launch, at the start",
        _exact(math.degrees(math.acos(math.cos(p.theta0))), "deg"),
        lambda q, _: at_most(q, _ALMOST, "ten degrees"),
        fact="Eqs. (6), (7) hold at the start",  # theta(0), assumed here and fitted there
    )
    yield _upright(p)
    machine = fixed(p)
    yield Row(
        "counterweight starts on the projectile's side",
        "Sec. V",
        "same side",
        "distance of the nearer of the two in front of the fulcrum",
        _exact(min(_at_start(machine, name)[0] for name in (COUNTERWEIGHT, PROJECTILE)), "m"),
        lambda q, _: positive(q, "the distance in front of the fulcrum"),
        FIXED,
    )


def _upright(p: TrebuchetParameters) -> Row:
    """Angle of the hanger, or of the counterweight from the fulcrum: the more vertical one."""
    x, y = _at_start(fixed(p), COUNTERWEIGHT)
    hanger, seen = (
        abs(math.degrees(math.atan2(x, y)))
        for x, y in ((math.cos(p.alpha0), -math.sin(p.alpha0)), (x, y))
    )
    off = _exact(min(hanger, seen), "deg")
    upright = solve_to_launch(fixed(p.model_copy(update={"alpha0": -math.pi / 2}))).launch
    instead = (
        "would not launch" if upright is None else f"would launch with {upright.speed:.4g} m/s"
    )
    steep = Cause(
        off.value > _ALMOST,
        f"the hanger starts {hanger:.3g} deg from the vertical, and the counterweight stands "
        f"{seen:.3g} deg from it as the fulcrum sees it; with the hanger upright the machine "
        f"{instead}, not with {LAUNCH_SPEED}",
    )
    return Row(
        "counterweight almost straight up",
        "Sec. I",
        "upright",
        "angle to the vertical at the start, of the hanger or of the line from the fulcrum, the "
        "smaller",
        off,
        lambda q, _: at_most(q, _ALMOST, "'almost' asks for ten degrees", [steep]),
    )


def _at_start(mechanism: Mechanism, name: str) -> tuple[float, float]:
    """Position of a marker at the start [m]."""
    marker = next(each for each in mechanism.markers if each.name == name)
    kinematics = Kinematics(mechanism)
    x, y = kinematics.position(
        kinematics.point(marker.body, marker.point), np.array(mechanism.start)
    )
    return float(x), float(y)


def _count(value: int) -> Quantity:
    return Quantity(value=value, uncertainty=0.0, unit="")


def _resting(evidence: Evidence) -> Iterator[Row]:
    """Two constraints act at first: stops that are closed and push."""
    for name, throw in evidence.throws.items():
        closed = [stop.name for stop in throw.mechanism.stops if stop.closed]
        pushing = _count(sum(throw.values.get(start_torque(stop), 0.0) > 0 for stop in closed))
        where, quantity = "Sec. II" if name == FIXED else "Sec. VI", "rests that push at the start"
        yield Row(f"constraints at first, {name}", where, "2", quantity, pushing, as_printed, name)


def _scaled(evidence: Evidence) -> Row:
    """The model's measures, scaled: the same motion, slower by the root of the lengths' scale."""
    p = evidence.parameters
    lengths = {name: getattr(p, name) / _LENGTH_SCALE for name in ("l1", "l2", "h", "r")}
    masses = {name: getattr(p, name) / _MASS_SCALE for name in ("m_a", "m_b", "m_cw")}
    launch = solve_to_launch(fixed(p.model_copy(update=lengths | masses))).launch
    speed = 0.0 if launch is None else launch.speed * math.sqrt(_LENGTH_SCALE)
    return Row(
        "the model behaves as the machine",
        "Sec. II, Table I",
        "50, 10,000",
        "launch speed of the machine with its lengths over 50 and its masses over 10,000, times "
        "√50, relative",
        Quantity(
            value=speed / evidence.throws[FIXED].values[SPEED] - 1, uncertainty=_SCALED, unit=""
        ),
        lambda q, _: vanishes(q, 0.0, "the same motion, in two integrations"),
        FIXED,
    )


def _inertias(evidence: Evidence) -> Iterator[Row]:
    """Eq. (5), about the fulcrum, against the rod of the mechanism; Eq. (9), about its centre."""
    p = evidence.parameters
    arm = evidence.throws[FIXED].mechanism.body("arm")
    about_fulcrum = arm.inertia + arm.mass * (arm.centre[0] ** 2 + arm.centre[1] ** 2)
    for where, printed, point, paper, ours, machine in (
        ("Eq. (5)", "m_a (l1³ + l2³) / 3 (l1 + l2)", "the fulcrum", _five(p), about_fulcrum, FIXED),
        ("Eq. (9)", "m_a (l1 + l2)² / 12", "its centre", _nine(p), arm.inertia, ROLLING),
    ):
        yield Row(
            f"moment of inertia, {where}",
            where,
            printed,
            f"arm's moment of inertia about {point}, {where} less the rod's",
            Quantity(value=paper - ours, uncertainty=_ROUNDING * ours, unit="kg m²"),
            lambda q, _: vanishes(q, 0.0, "the same rod"),
            fact=f"kinetic and potential energy, {machine}",  # of which it is a part
        )


def _five(p: TrebuchetParameters) -> float:
    return p.m_a * (p.l1**3 + p.l2**3) / (p.l1 + p.l2) / 3


def _nine(p: TrebuchetParameters) -> float:
    return p.m_a * (p.l1 + p.l2) ** 2 / 12


def _energies(evidence: Evidence) -> Iterator[Row]:
    """The paper's T and U against the mechanism's, which is built from bodies and joints."""
    named: list[tuple[str, str, Energies]] = [
        (FIXED, "Eqs. (2) to (5)", fixed_energies),
        (ROLLING, "Eqs. (3), (8) to (10)", rolling_energies),
    ]
    for name, where, energies in named:
        if name not in evidence.throws:
            continue
        worst = largest_difference(evidence.throws[name].mechanism, evidence.parameters, energies)
        yield Row(
            f"kinetic and potential energy, {name}",
            where,
            "T, U",
            f"largest difference of the paper's T and U from the mechanism's in {_STATES} random "
            "states, relative",
            Quantity(value=worst, uncertainty=_ROUNDING, unit=""),
            lambda q, _: vanishes(q, 0.0, "the same machine"),
            name,
        )


def largest_difference(mechanism: Mechanism, p: TrebuchetParameters, of: Energies) -> float:
    """Largest relative difference of a mechanism's energies from the paper's, in random states."""
    equations, random = Equations(mechanism), np.random.default_rng(_SEED)
    n, differences = len(mechanism.coordinates), list[float]()
    for _ in range(_STATES):
        q, u = random.uniform(-np.pi, np.pi, n), random.normal(0.0, _SPEEDS, n)
        ours = (
            0.5 * float(u @ equations.mass_matrix(q) @ u),
            float(equations.kinematics.potential_energy(q)),
        )
        # Relative to the sum of both: a potential energy may be zero by chance.
        differences += [
            abs(a - b) / (abs(ours[0]) + abs(ours[1]))
            for a, b in zip(of(p, q, u), ours, strict=True)
        ]
    return max(differences)


def fixed_energies(p: TrebuchetParameters, q: FloatArray, u: FloatArray) -> tuple[float, float]:
    """T and U of Eqs. (2) to (5) [J]."""
    kinetic, potential = _of_points(p, q, u, 0.0)  # Eqs. (2), (3), (4)
    return kinetic + 0.5 * _five(p) * float(u[0]) ** 2, potential


def rolling_energies(p: TrebuchetParameters, q: FloatArray, u: FloatArray) -> tuple[float, float]:
    """T and U of Eqs. (3) and (8) to (10) [J]."""
    kinetic, potential = _of_points(p, q, u, float(u[3]))  # Eqs. (8), (10a), (10b)
    d = (p.l1 - p.l2) / 2
    v = complex(u[3], 0) + d * _turning(q[0], u[0])  # Eq. (10c) and (4e), differentiated
    return kinetic + 0.5 * p.m_a * abs(v) ** 2 + 0.5 * _nine(p) * float(u[0]) ** 2, potential


def _of_points(
    p: TrebuchetParameters, q: FloatArray, u: FloatArray, rolling: float
) -> tuple[float, float]:
    """Projectile's and counterweight's kinetic energy, and all potential energy [J]."""
    theta, phi, alpha = (float(angle) for angle in q[:3])
    thrown = rolling + p.l1 * _turning(theta, u[0]) + p.r * _turning(phi, u[1])
    falling = rolling - p.l2 * _turning(theta, u[0]) + p.h * _turning(alpha, u[2])
    y_b = -p.l1 * np.sin(theta) - p.r * np.sin(phi)  # (4b)
    y_cw = p.l2 * np.sin(theta) - p.h * np.sin(alpha)  # (4d)
    y_a = -(p.l1 - p.l2) / 2 * np.sin(theta)  # (4e)
    kinetic = 0.5 * (p.m_b * abs(thrown) ** 2 + p.m_cw * abs(falling) ** 2)
    return kinetic, p.g * float(p.m_cw * y_cw + p.m_b * y_b + p.m_a * y_a)


def _turning(angle: float, rate: float) -> complex:
    """Velocity of the end of a unit lever, x + i y: d/dt of (cos angle, -sin angle)."""
    return complex(-np.sin(angle), -np.cos(angle)) * float(rate)


def _freedom(evidence: Evidence) -> Iterator[Row]:
    counted = partial(
        Row, quantity="generalized coordinates less loops, all rests open", judge=as_printed
    )
    for name, where, printed in ((FIXED, "Sec. II", "3"), (ROLLING, "Sec. VI", "4")):
        free = _count(_freedoms(evidence.throws[name].mechanism))
        yield counted(f"degrees of freedom, {name}", where, printed, ours=free, machine=name)
    free = _count(_freedoms(model("catapult")))
    yield counted(
        "a catapult turns as one rigid body", "Sec. I", "1", ours=free, machine="catapult"
    )
    yield _floating_arm()


def _freedoms(mechanism: Mechanism) -> int:
    return len(mechanism.coordinates) - Equations(mechanism).n_loops


def _floating_arm() -> Row:
    """Claim on a floating arm, perhaps another machine: cited without a drawing."""
    machine = model("floating-arm")
    count = _count(_freedoms(machine))
    # Planar: an arm with nothing to hold it has three freedoms; a sling adds its angle, a
    # counterweight its height.
    unbound = 3 + (len(machine.bodies) - 1) + 1
    why = (
        "the paper does not say how it is built; an arm on two tracks with its sling has "
        f"{count.value:g} degrees of freedom, and {unbound} coordinates before the tracks and the "
        "counterweight's pin bind them"
    )
    quantity = "generalized coordinates less loops, of the arm on two tracks"
    return Row(
        "degrees of freedom, floating arm",
        "Sec. VI",
        "5",
        quantity,
        count,
        undecided(why),
        "floating-arm",
    )
