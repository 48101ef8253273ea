"""How well each machine the paper names turns the energy it has into the projectile's, as data."""

from __future__ import annotations

from pydantic import Field

from ...models.spec import Real, Spec
from ..results import EngineValue


class SlingThrow(Spec):
    """One machine's throw at 45 degrees, by the reference."""

    sling: Real | None = Field(description="length [m]; None: it has no sling")
    launch_time: Real = Field(description="[s]")
    speed: Real = Field(description="of the projectile [m/s]")
    kinetic_energy: Real = Field(description="of the projectile [J]")
    efficiency: Real = Field(description="kinetic energy over the energy available with that sling")
    arm_angle: Real = Field(description="of the arm at the launch [rad]; 3 pi / 2 points straight up")


class WidestThrow(SlingThrow):
    """The throw of the most efficient machine of a kind within the bounds."""

    l1: Real = Field(description="arm on the sling's side [m]; l1 + l2 as given")
    theta0: Real = Field(description="start angle of the arm [rad]")


class MachineEfficiency(Spec):
    """One machine at the paper's masses and arm, with the paper's sling and with its fastest one."""

    name: str
    text: str
    available_energy: Real = Field(description="from the start down to its lowest position of all [J]")
    total_energy: Real = Field(description="the paper's E: of the start, zero at the fulcrum's height [J]")
    table_one: SlingThrow
    fastest_sling: SlingThrow | None = Field(description="with the sling that throws fastest; None: no sling")
    most_efficient: WidestThrow | None = Field(
        default=None, description="of all within the bounds; None: not looked for, since that needs heyoka"
    )
    speed_uncertainty: Real | None = Field(description="of the speed with the paper's sling [m/s]")
    engines: tuple[EngineValue, ...] = Field(default=(), description="efficiency with the paper's sling")
    distances: tuple[EngineValue, ...] = Field(
        default=(), description="largest distance of any marker from ours up to the launch [m], each with its bar"
    )


class Machines(Spec):
    """All of them, in the registry's order."""

    machines: tuple[MachineEfficiency, ...]
    slings: tuple[Real, Real] = Field(description="sling lengths looked at, from and to [m]")
    bounds: dict[str, tuple[Real, Real]] = Field(
        description="of l1 [m], r [m] and, where the arm begins backward, theta0 [rad], for the most efficient"
    )
    seconds: Real = Field(description="wall time [s]")

    def named(self, name: str) -> MachineEfficiency:
        """The machine of that name."""
        return next(machine for machine in self.machines if machine.name == name)
