"""Claims on the equations: Eqs. (2) to (5) and (8) to (10) against the mechanism, and how many coordinates it takes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...models.arrays import FloatArray
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ..evidence import Evidence, made
from ..results import Claim, Quantity
from ..verdicts import as_printed, not_told, vanishes

_ROUNDING = 1e-12  # of sums of a few terms, relative: a thousand times what they can lose
_STATES, _SEED = 64, 1  # random states, angles all round: energies that agree there agree
_SPEEDS = 3.0  # [rad/s, m/s] standard deviation of the random speeds

Energies = Callable[[TrebuchetParameters, FloatArray, FloatArray], tuple[float, float]]
"""Kinetic and potential energy [J] as the paper writes them, of parameters, q and u."""


def claims(evidence: Evidence) -> list[Claim]:
    """All of them."""
    return [*_inertias(evidence), *_energies(evidence), *_freedom(evidence), _rigid_catapult(), _floating_arm()]


def _inertias(evidence: Evidence) -> list[Claim]:
    """Eq. (5), about the fulcrum, against the rod of the mechanism; Eq. (9), about its centre."""
    p = evidence.parameters
    arm = evidence.throws["fixed"].mechanism.body("arm")
    about_fulcrum = arm.inertia + arm.mass * (arm.centre[0] ** 2 + arm.centre[1] ** 2)
    return [
        _inertia(
            "Eq. (5)", "arm's moment of inertia about the fulcrum, Eq. (5) less the rod's", _five(p), about_fulcrum
        ),
        _inertia("Eq. (9)", "arm's moment of inertia about its centre, Eq. (9) less the rod's", _nine(p), arm.inertia),
    ]


def _five(p: TrebuchetParameters) -> float:
    return p.m_a * (p.l1**3 + p.l2**3) / (p.l1 + p.l2) / 3


def _nine(p: TrebuchetParameters) -> float:
    return p.m_a * (p.l1 + p.l2) ** 2 / 12


def _inertia(where: str, quantity: str, paper: float, ours: float) -> Claim:
    apart = Quantity(value=paper - ours, uncertainty=_ROUNDING * ours, unit="kg m²")
    judgement = vanishes(apart, 0.0, "the same rod")
    printed = "m_a (l1³ + l2³) / 3 (l1 + l2)" if where == "Eq. (5)" else "m_a (l1 + l2)² / 12"
    return made(f"moment of inertia, {where}", where, printed, quantity, apart, judgement)


def _energies(evidence: Evidence) -> list[Claim]:
    """The paper's T and U against the mechanism's, which is built from bodies and joints."""
    named: list[tuple[str, str, Energies]] = [
        ("fixed", "Eqs. (2) to (5)", fixed_energies),
        ("rolling", "Eqs. (3), (8) to (10)", rolling_energies),
    ]
    return [_same_energies(name, where, evidence, of) for name, where, of in named if name in evidence.throws]


def _same_energies(name: str, where: str, evidence: Evidence, of: Energies) -> Claim:
    worst = Quantity(
        value=largest_difference(evidence.throws[name].mechanism, evidence.parameters, of),
        uncertainty=_ROUNDING,
        unit="",
    )
    return made(
        f"kinetic and potential energy, {name}",
        where,
        "T, U",
        f"largest difference of the paper's T and U from the mechanism's in {_STATES} random states, relative",
        worst,
        vanishes(worst, 0.0, "the same machine"),
        machine=name,
    )


def largest_difference(mechanism: Mechanism, p: TrebuchetParameters, of: Energies) -> float:
    """Of a mechanism's kinetic and potential energy from the paper's, relative to their sum, in random states."""
    equations, random = Equations(mechanism), np.random.default_rng(_SEED)
    n, found = len(mechanism.coordinates), list[float]()
    for _ in range(_STATES):
        q, u = random.uniform(-np.pi, np.pi, n), random.normal(0.0, _SPEEDS, n)
        ours = (
            0.5 * float(u @ equations.mass_matrix(q) @ u),
            float(equations.kinematics.potential_energy(q)),
        )
        # Relative to the sum of both: a potential energy may be zero by chance.
        found += [abs(a - b) / (abs(ours[0]) + abs(ours[1])) for a, b in zip(of(p, q, u), ours, strict=True)]
    return max(found)


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


def _of_points(p: TrebuchetParameters, q: FloatArray, u: FloatArray, rolling: float) -> tuple[float, float]:
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


def _freedom(evidence: Evidence) -> list[Claim]:
    printed = {"fixed": ("Sec. II", "3"), "rolling": ("Sec. VI", "4")}
    return [
        _counted(f"degrees of freedom, {name}", where, number, evidence.throws[name].mechanism, name)
        for name, (where, number) in printed.items()
    ]


def _counted(name: str, where: str, printed: str, mechanism: Mechanism, machine: str) -> Claim:
    count = Quantity(value=_free(mechanism), uncertainty=0.0, unit="")
    quantity = "generalized coordinates less loops, all rests open"
    return made(name, where, printed, quantity, count, as_printed(count, printed), machine=machine)


def _free(mechanism: Mechanism) -> int:
    return len(mechanism.coordinates) - Equations(mechanism).n_loops


def _rigid_catapult() -> Claim:
    return _counted("a catapult turns as one rigid body", "Sec. I", "1", model("catapult"), "catapult")


def _floating_arm() -> Claim:
    """Of another machine than ours, perhaps: the paper cites it without a drawing or a number but this one."""
    machine = model("floating-arm")
    count = Quantity(value=_free(machine), uncertainty=0.0, unit="")
    # Planar: an arm with nothing to hold it has three freedoms; a sling adds its angle, a counterweight its height.
    unbound = 3 + (len(machine.bodies) - 1) + 1
    why = (
        f"the paper does not say how it is built; an arm on two tracks with its sling has {count.value:g} degrees of "
        f"freedom, and {unbound} coordinates before the tracks and the counterweight's pin bind them"
    )
    quantity = "generalized coordinates less loops, of the arm on two tracks"
    return made(
        "degrees of freedom, floating arm", "Sec. VI", "5", quantity, count, not_told(why), machine="floating-arm"
    )
