"""Energies of a right motion that are counted wrongly: from another zero, as the other kind, or in part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import Body, Mechanism
from ...models.trajectory import Trajectory
from ...reference.equations import Equations
from .readings import Reading, scale_text


def energy_readings(r: Trajectory) -> Iterator[Reading]:
    """Readings of the reference whose energies are wrong."""
    unit = float(np.abs(r.kinetic_energy).max()) or 1.0
    raised = replace(r, potential_energy=r.potential_energy + unit)
    yield Reading("zero of the potential energy", (raised,), lambda f: f"{f[0] * unit:+.4g} J")
    moved = replace(
        r,
        kinetic_energy=2 * r.kinetic_energy,
        potential_energy=r.potential_energy - r.kinetic_energy,
    )
    yield Reading(
        "kinetic energy counted as potential", (moved,), lambda f: f"{-100 * f[0]:+.3g} %"
    )
    yield from _kinetic(r)
    for name, part in _potential_parts(r):
        if part.any() and _is_part(part, r.potential_energy):
            wrong = replace(r, potential_energy=r.potential_energy + part)
            yield Reading(f"{name} in the potential energy", (wrong,), lambda f: scale_text(f[0]))
    origins = Equations(_changed_bodies(r.mechanism, centre=(0.0, 0.0))).potential_energy(r.q)
    if (origins != r.potential_energy).any():
        yield Reading(
            "potential energy of the bodies' origins", (replace(r, potential_energy=origins),)
        )


def _is_part(part: FloatArray, whole: FloatArray) -> bool:
    """Whether it has another course than the whole: else its scale is that of the whole."""
    left = part - whole * float(part @ whole) / (float(whole @ whole) or 1.0)
    return bool(np.linalg.norm(left) > _ALIKE * np.linalg.norm(part))


_ALIKE = 1e-6


def _kinetic(r: Trajectory) -> Iterator[Reading]:
    """Without a body, of it alone, without that it turns, or with its inertia about the joint."""
    bodies = r.mechanism.bodies
    spin = {body.name: _spin(r, body.name) for body in bodies}
    turning = {body.name: 0.5 * body.inertia * spin[body.name] for body in bodies if body.inertia}
    every, zero = r.kinetic_energy, np.zeros_like(r.t)
    wrong: dict[str, FloatArray] = {}
    for body in bodies if len(bodies) > 1 else ():
        own = 0.5 * body.mass * _square(r, body) + turning.get(body.name, zero)
        wrong |= {f"without the {body.name}": every - own, f"of the {body.name} alone": own}
    wrong |= {f"without the rotation of the {name}": every - own for name, own in turning.items()}
    if len(turning) > 1:
        wrong["without the rotation of the bodies"] = every - sum(turning.values(), zero)
    arms = {b.name: np.subtract(b.centre, r.mechanism.joint_of(b.name).child_point) for b in bodies}
    parallel = [0.5 * b.mass * float(arms[b.name] @ arms[b.name]) * spin[b.name] for b in bodies]
    wrong["with inertias about the joints"] = every + sum(parallel, zero)
    for how, energy in wrong.items():
        if _is_part(energy, every):
            yield Reading(f"kinetic energy {how}", (replace(r, kinetic_energy=energy),))


def _square(r: Trajectory, body: Body) -> FloatArray:
    row = r.kinematics.point(body.name, body.centre)
    return (r.kinematics.velocity(row, r.q, r.u) ** 2).sum(axis=1)


def _spin(r: Trajectory, body: str) -> FloatArray:
    return (r.u @ r.kinematics.angle(body).coefficients) ** 2


def _potential_parts(r: Trajectory) -> Iterator[tuple[str, FloatArray]]:
    """Of single bodies' weights, of single springs, and of all of these; each of shape (n,)."""
    m = r.mechanism

    def less(other: Mechanism) -> FloatArray:
        return r.potential_energy - Equations(other).potential_energy(r.q)

    if m.gravity:
        for body in m.bodies:
            yield f"weight of the {body.name}", less(_changed_bodies(m, body.name, mass=0.0))
    for element in m.force_elements:
        others = tuple(each for each in m.force_elements if each != element)
        yield element.name, less(m.model_copy(update={"force_elements": others}))
    if m.force_elements:
        yield "springs", less(m.model_copy(update={"force_elements": ()}))


def _changed_bodies(m: Mechanism, only: str = "", **fields: object) -> Mechanism:
    """With other fields of a body, or of all."""
    bodies = [b.model_copy(update=fields) if only in ("", b.name) else b for b in m.bodies]
    return m.model_copy(update={"bodies": tuple(bodies)})
