"""Quantities of a motion, and kinds of metrics with their scales and their names for users.

A metric that follows from another one (a mean square beside its largest value) has no verdict of
its own: counting one fact twice would make an agreement look broader than it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from typing import NamedTuple, Self

from ...models.errors import InputError
from ...models.mechanism import Mechanism
from .scales import LIMIT, Scales


class Kind(StrEnum):
    """Kind of a quantity of a motion; the text is what reports and files say."""

    COORDINATES = "coordinates"
    SPEEDS = "speeds of coordinates"
    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE = "torque"
    """Torque of a stop on an angle."""
    FORCE = "force"
    """Force of a joint, or of a stop on a point."""
    KINETIC_ENERGY = "kinetic energy"
    POTENTIAL_ENERGY = "potential energy"


class Quantity(NamedTuple):
    """A quantity of a motion: its kind, and the marker, stop or joint that it is about."""

    kind: Kind
    subject: str | None = None

    @property
    def text(self) -> str:
        """Name in reports and files, such as 'position of the projectile'."""
        return self.kind.value if self.subject is None else f"{self.kind} of the {self.subject}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads such a name.

        Raises:
            ValueError: it begins with no kind of quantity.
        """
        kind, _, subject = text.partition(" of the ")
        return cls(Kind(kind), subject or None)


def metric_label(name: str, subject: str | None) -> str:
    """Label of a metric: its name, and its subject in parentheses if it has one."""
    return name if subject is None else f"{name} ({subject})"


def parse_label(label: str) -> tuple[str, str | None]:
    """Name and subject of a metric's label, as :func:`metric_label` makes it."""
    name, separator, subject = label.partition(" (")
    return name, subject.removesuffix(")") if separator else None


@dataclass(frozen=True)
class MetricKind:
    """One kind of metric: how far two motions are apart in some respect."""

    name: str  # of the metric in results
    title: str  # for users, in `--tolerance` as well
    scale: str
    """Its range: a field of :class:`Scales`; 'stop' for that of the stop it is about, 'gap' for its
    gap's, 'base error' for what the stretching at the predictability horizon makes one of, '' for
    none."""
    follows: str | None = None  # metric from which it follows, and which is judged in its place
    invariant: bool = False  # whether it is judged beyond the predictability horizon
    event: bool = False  # whether it is the time of an event
    of: str = ""
    """Kind of its subjects: 'marker', 'angle', 'slide', 'moving' (coordinates and markers), 'stop',
    'closed stop' or 'joint'; '' the whole mechanism."""
    of_files: bool = False  # whether it is judged of files only: engines are not asked for it
    symbol: str = ""  # of its kind of quantity (:data:`SYMBOLS`); '' where it follows from another

    @property
    def words(self) -> str:
        """The title in words, as pages have it."""
        return self.title.replace("-", " ")

    @property
    def is_error(self) -> bool:
        """Tell whether it is an error of the motion that falls with the step, judged by itself."""
        return self.follows is None and self.scale != "base error" and self.name not in _OF_SAMPLES

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
        """Scale of which its relative values are parts, in the metric's unit."""
        if subject is not None and self.scale == "stop":
            return scales.torques[subject]
        if subject is not None and self.scale == "gap":
            return scales.turn if mechanism.stop(subject).gap_unit == "rad" else scales.way
        if self.scale in ("impulse", "momentum"):
            turns = subject is not None and mechanism.stop(subject).effort == "torque"
            return scales.mass * scales.speed * (scales.length if turns else 1.0)
        if self.scale == "impact speed":
            return scales.angular_speed if subject in mechanism.angles else scales.speed
        if self.scale == "base error":
            return 1.0 / LIMIT
        return float(getattr(scales, self.scale)) if self.scale else 1.0

    def size_of(self, scales: Scales, subject: str | None, mechanism: Mechanism) -> float:
        """Size of the numbers that it is computed from, of which rounding errors are parts."""
        if self.scale == "way":
            return scales.length
        if self.scale == "turn":
            return scales.angle
        if self.scale == "gap" and subject is not None:
            return scales.angle if mechanism.stop(subject).gap_unit == "rad" else scales.length
        if self.scale == "energy":
            return scales.largest_energy
        return self.scale_of(scales, subject, mechanism)


_OF_SAMPLES = ("missing_time", "unseen_time")  # which a motion's samples have, not the motion
SYMBOLS: Mapping[str, str] = {
    "x": "position",
    "v": "speed",
    "φ": "angle",
    "ω": "angular speed",
    "t": "time of an event",
    "F": "force or torque of a joint or stop",
    "E": "energy",
    "p": "momentum or impulse",
    "g": "gap of a stop or joint",
}
"""Kinds of quantities by the symbol that stands for them where there is no room for a name."""
_ALL = (
    MetricKind("position_max", "position", "way", of="marker", symbol="x"),
    MetricKind("position_rms", "position (mean square)", "way", follows="position_max"),
    MetricKind("velocity_max", "speed", "speed", of="marker", symbol="v"),
    MetricKind("angle_max", "angle", "turn", of="angle", symbol="φ"),
    MetricKind("slide_max", "slide", "way", of="slide", symbol="x"),
    MetricKind("angular_speed_max", "angular-speed", "angular_speed", of="angle", symbol="ω"),
    MetricKind("slide_speed_max", "slide-speed", "speed", of="slide", symbol="v"),
    MetricKind("launch_time", "launch-time", "time", event=True, symbol="t"),
    MetricKind("launch_speed", "launch-speed", "speed", symbol="v"),
    MetricKind("release_time", "release", "time", event=True, of="closed stop", symbol="t"),
    MetricKind("impact_time", "impact", "time", event=True, of="stop", symbol="t"),
    MetricKind("impact_impulse", "impulse", "impulse", of="stop", of_files=True, symbol="p"),
    MetricKind(
        "impact_speed", "impact-speed", "impact speed", of="moving", of_files=True, symbol="v"
    ),
    MetricKind("stop_torque_max", "stop-torque", "stop", of="stop", symbol="F"),
    MetricKind(
        "stop_torque_settled", "stop-torque (away from releases)", "stop", follows="stop_torque_max"
    ),
    MetricKind("stop_impulse", "stop-impulse", "", follows="stop_torque_max"),
    MetricKind("joint_reaction_max", "reaction", "force", of="joint", symbol="F"),
    MetricKind("joint_reaction_relative", "reaction (relative)", "", follows="joint_reaction_max"),
    MetricKind("kinetic_energy_max", "kinetic-energy", "energy", symbol="E"),
    MetricKind("potential_energy_max", "potential-energy", "energy", symbol="E"),
    MetricKind("energy_balance", "energy", "energy", invariant=True, symbol="E"),
    MetricKind("energy_drift", "energy (of the start's)", "", follows="energy_balance"),
    MetricKind("energy_drift_kinetic", "energy (of the kinetic)", "", follows="energy_balance"),
    MetricKind("horizontal_momentum", "momentum", "momentum", invariant=True, symbol="p"),
    MetricKind("stop_gap_held", "stop-gap", "gap", of="closed stop", symbol="g"),
    MetricKind("stop_penetration", "penetration", "gap", of="stop", symbol="g"),
    MetricKind("complementarity", "complementarity", "gap", follows="stop_penetration"),
    MetricKind("joint_gap_max", "joint-gap", "way", invariant=True, of="joint", symbol="g"),
    MetricKind("base_error", "base-error", "base error", symbol="x"),
    MetricKind("first_parting", "first-parting", "time", follows="base_error"),
    MetricKind("missing_time", "duration", "time", symbol="t"),
    MetricKind("unseen_time", "sampling", "time", symbol="t"),
)
QUANTITIES: Mapping[str, MetricKind] = {kind.name: kind for kind in _ALL}
"""Kinds of metrics by their name."""
JUDGED: Mapping[str, MetricKind] = {kind.title: kind for kind in _ALL if kind.follows is None}
"""Kinds that a tolerance can be stated for, by title."""


def judged_quantity(title: str) -> MetricKind:
    """Kind of metric of that title or name.

    Raises:
        InputError: there is none, or it has no verdict of its own.
    """
    quantity = JUDGED.get(title) or QUANTITIES.get(title)
    if quantity is None or quantity.follows is not None:
        close = get_close_matches(title, JUDGED, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise InputError(
            f"tolerance {title[:60]!r} is not of a judged quantity{hint}; "
            f"there are: {', '.join(JUDGED)}."
        )
    return quantity
