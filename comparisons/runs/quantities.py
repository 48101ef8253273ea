"""The quantities of a comparison: what each metric measures, in which scale, and what a user calls it.

A quantity that follows from another one (a mean square beside its largest value) has no verdict of
its own: counting one fact twice would make an agreement look broader than it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from ...models.errors import InputError
from ...models.mechanism import Mechanism
from .scales import Scales
from .stretching import LIMIT

_NUMBER = 1.0


@dataclass(frozen=True)
class Quantity:
    """One metric."""

    name: str
    """Of the metric in results."""
    title: str
    """What users call it, in `--tolerance` as well."""
    scale: str
    """Field of :class:`Scales`; 'stop' for that of the stop it is about, 'gap' for its gap's, 'base error' for what the
    stretching at the predictability horizon makes one of, '' for none."""
    follows: str | None = None
    """Metric from which it follows, and which is judged in its place."""
    invariant: bool = False
    """It is judged beyond the predictability horizon."""
    event: bool = False
    """It is the time of an event."""
    of: str = ""
    """What its subjects are: 'marker', 'angle', 'slide', 'moving' (coordinates and markers), 'stop', 'closed stop' or
    'joint'; '' the whole mechanism."""
    of_files: bool = False
    """It is judged of files only: engines are not asked for it."""

    def subjects(self, mechanism: Mechanism) -> tuple[str, ...]:
        """Names that a tolerance of it can be stated for."""
        of: dict[str, Iterable[str | None]] = {
            "marker": (marker.name for marker in mechanism.markers),
            "moving": (*mechanism.coordinates, *(marker.name for marker in mechanism.markers)),
            "angle": mechanism.angles,
            "slide": (slide.coordinate for slide in mechanism.slides),
            "stop": (stop.name for stop in mechanism.stops),
            "closed stop": (stop.name for stop in mechanism.stops if stop.closed),
            "joint": (joint.name for joint in mechanism.joints if joint.held_directions),
        }
        return tuple(name for name in of.get(self.of, ()) if name is not None)

    def scale_of(self, scales: Scales, subject: str | None, mechanism: Mechanism) -> float:
        """What parts of it are measured in, in the metric's unit."""
        if self.scale == "stop":
            assert subject is not None
            return scales.torques[subject]
        if self.scale == "gap":
            assert subject is not None
            return scales.angle if mechanism.stop(subject).gap_unit == "rad" else scales.length
        if self.scale in ("impulse", "momentum"):
            turns = subject is not None and mechanism.stop(subject).effort == "torque"
            return scales.mass * scales.speed * (scales.length if turns else 1.0)
        if self.scale == "impact speed":
            return scales.angular_speed if subject in mechanism.angles else scales.speed
        if self.scale == "base error":
            return 1.0 / LIMIT
        return float(getattr(scales, self.scale)) if self.scale else _NUMBER


_ALL = (
    Quantity("position_max", "position", "length", of="marker"),
    Quantity("position_rms", "position (mean square)", "length", follows="position_max"),
    Quantity("velocity_max", "speed", "speed", of="marker"),
    Quantity("angle_max", "angle", "angle", of="angle"),
    Quantity("slide_max", "slide", "length", of="slide"),
    Quantity("angular_speed_max", "angular-speed", "angular_speed", of="angle"),
    Quantity("slide_speed_max", "slide-speed", "speed", of="slide"),
    Quantity("launch_time", "launch-time", "time", event=True),
    Quantity("launch_speed", "launch-speed", "speed"),
    Quantity("release_time", "release", "time", event=True, of="closed stop"),
    Quantity("impact_time", "impact", "time", event=True, of="stop"),
    Quantity("impact_impulse", "impulse", "impulse", of="stop", of_files=True),
    Quantity("impact_speed", "impact-speed", "impact speed", of="moving", of_files=True),
    Quantity("stop_torque_max", "stop-torque", "stop", of="stop"),
    Quantity(
        "stop_torque_settled", "stop-torque (away from releases)", "stop", follows="stop_torque_max"
    ),
    Quantity("stop_impulse", "stop-impulse", "", follows="stop_torque_max"),
    Quantity("joint_reaction_max", "reaction", "force", of="joint"),
    Quantity("joint_reaction_relative", "reaction (relative)", "", follows="joint_reaction_max"),
    Quantity("kinetic_energy_max", "kinetic-energy", "energy"),
    Quantity("potential_energy_max", "potential-energy", "energy"),
    Quantity("energy_balance", "energy", "energy", invariant=True),
    Quantity("energy_drift", "energy (of the start's)", "", follows="energy_balance"),
    Quantity("energy_drift_kinetic", "energy (of the kinetic)", "", follows="energy_balance"),
    Quantity("horizontal_momentum", "momentum", "momentum", invariant=True),
    Quantity("stop_gap_held", "stop-gap", "gap", of="closed stop"),
    Quantity("stop_penetration", "penetration", "gap", of="stop"),
    Quantity("complementarity", "complementarity", "gap", follows="stop_penetration"),
    Quantity("joint_gap_max", "joint-gap", "length", invariant=True, of="joint"),
    Quantity("base_error", "base-error", "base error"),
    Quantity("first_parting", "first-parting", "time", follows="base_error"),
    Quantity("missing_time", "duration", "time"),
)
QUANTITIES: Mapping[str, Quantity] = {quantity.name: quantity for quantity in _ALL}
"""By name of the metric."""
JUDGED: Mapping[str, Quantity] = {
    quantity.title: quantity for quantity in _ALL if quantity.follows is None
}
"""By title: those that a tolerance can be stated for."""


def judged_quantity(title: str) -> Quantity:
    """The quantity of that title, or of that metric's name.

    Raises:
        InputError: there is none, or it has no verdict of its own.
    """
    quantity = JUDGED.get(title) or QUANTITIES.get(title)
    if quantity is None or quantity.follows is not None:
        close = get_close_matches(title, JUDGED, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise InputError(
            f"tolerance {title[:60]!r} is not of a judged quantity{hint}; there are: {', '.join(JUDGED)}."
        )
    return quantity
