"""Bodies and joints that several problems are built from."""

from __future__ import annotations

from ..elements import GROUND, PinJoint, PrismaticJoint, SlotJoint
from ..mechanism import Body
from ..spec import Vector


def rod(name: str, angle: str | None, length: float, mass: float) -> Body:
    """A uniform rod whose frame begins at its end; without an angle its joint must hold it."""
    return Body(
        name=name, angle=angle, mass=mass, centre=(length / 2, 0), inertia=mass * length**2 / 12
    )


def pin(name: str, parent: str, child: str, at: Vector = (0, 0), on: Vector = (0, 0)) -> PinJoint:
    """A pin at a point of the parent and a point of the child."""
    return PinJoint(name=name, parent=parent, child=child, parent_point=at, child_point=on)


def disc(name: str, angle: str, mass: float, inertia: float) -> tuple[Body, PinJoint]:
    """A body that turns about its centre on the ground, and its pin."""
    return Body(name=name, angle=angle, mass=mass, centre=(0, 0), inertia=inertia), pin(
        f"{name} pin", GROUND, name
    )


def rail(name: str, parent: str, child: str, coordinate: str) -> PrismaticJoint:
    """A prismatic joint along the parent's x axis."""
    return PrismaticJoint(
        name=name, parent=parent, child=child, parent_point=(0, 0), child_point=(0, 0), axis=(1, 0),
        coordinate=coordinate,
    )  # fmt: skip


def slot(
    name: str,
    child: str,
    axis: Vector,
    on: Vector = (0, 0),
    coordinate: str | None = None,
    parent: str = GROUND,
) -> SlotJoint:
    """A slot along an axis through the parent's origin, in which a point of the child runs."""
    return SlotJoint(
        name=name, parent=parent, child=child, parent_point=(0, 0), child_point=on, axis=axis,
        coordinate=coordinate,
    )  # fmt: skip


def block(mass: float) -> Body:
    """A body that slides without turning."""
    return Body(name="block", mass=mass, centre=(0, 0), inertia=0.01 * mass)
