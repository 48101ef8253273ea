"""Models of inertia in its several forms."""

from __future__ import annotations

from trebucheck.api.mechanics import ConstantForce

from .model import ZooModel
from .parts import GRAVITY, block, of, rod

_PIVOT = (of("pivot", a=1),)


def _from_geoms() -> tuple[float, float, float]:
    """Mass [kg], centre [m] and inertia [kg m^2]: box of 3 kg at 0.3 m, ball of 0.5 kg at 0.7 m."""
    mass = 3.0 + 0.5
    centre = (3.0 * 0.3 + 0.5 * 0.7) / mass
    box = 3.0 / 3 * (0.3**2 + 0.05**2) + 3.0 * (centre - 0.3) ** 2
    ball = 0.4 * 0.5 * 0.1**2 + 0.5 * (0.7 - centre) ** 2
    return mass, centre, box + ball


def inertia_models() -> tuple[ZooModel, ...]:
    """Tensors that are turned, full, computed from geoms, or raised by armature.

    Armature of a joint on the ground is inertia of the body that carries no weight: about a pin
    more moment of inertia, along a rail more mass and a force against its weight.
    """
    mass, centre, inertia = _from_geoms()
    geoms = rod("inertia-from-geoms", mass=mass, centre=(centre, 0.0), inertia=inertia)
    carried = ConstantForce(name="carried", body="block", point=(0, 0), force=(0.0, 0.5 * GRAVITY))
    heavier = block("armature-slide", start=0.5, mass=2.5, forces=(carried,))
    return (
        ZooModel(
            "rotated-inertia",
            "turned principal axes",
            rod("rotated-inertia", inertia=0.057648),
            _PIVOT,
        ),
        ZooModel("full-inertia", "fullinertia", rod("full-inertia"), _PIVOT),
        ZooModel("inertia-from-geoms", "inertia from geoms", geoms, _PIVOT),
        ZooModel("armature", "armature of a hinge", rod("armature", inertia=0.06 + 0.05), _PIVOT),
        ZooModel(
            "armature-slide",
            "armature of a slide",
            heavier,
            (of("rail", s=1),),
            inertia_without_mass=0.5,
        ),
    )
