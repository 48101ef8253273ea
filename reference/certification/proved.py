"""Figures of a certificate that are proved: what encloses each, or why none does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from ...models.errors import InputError, SimulationError
from ...models.problem import Problem
from ..proof.motion import ProvedEvent
from ..proof.proof import Enclosure, Instant, Proof, prove
from .certificate import Figure

DIGITS = 18  # of a proof: two more than a figure's value has
_RELEASE = "release of "


@dataclass(frozen=True)
class ProvedMotionOfFigures:
    """A proved motion, and where its extrema are."""

    proof: Proof
    step: float
    """Distance from the launch within which extrema are sought [s]."""

    @cached_property
    def best_release(self) -> ProvedEvent | None:
        """The release with the longest range."""
        return self.proof.best_release(self.step)

    @cached_property
    def fastest(self) -> ProvedEvent | None:
        """Where the projectile is fastest."""
        return self.proof.fastest(self.step)


def proof_of(problem: Problem, end: float, step: float) -> ProvedMotionOfFigures | str:
    """Prove a problem's motion to a time [s]; a sentence, where that cannot be done.

    Args:
        problem: the certificate's.
        end: of the motion [s].
        step: distance from the launch within which extrema are sought [s].
    """
    try:
        return ProvedMotionOfFigures(prove(problem, DIGITS, end), step)
    except (InputError, SimulationError) as error:
        return str(error)


def with_proof(figure: Figure, known: ProvedMotionOfFigures | str) -> Figure:
    """A figure with what is proved of it, or why nothing is.

    Raises:
        InputError: the proof contradicts it.
    """
    found = known if isinstance(known, str) else _enclosure(figure, known)
    if isinstance(found, str):
        return figure.with_fields(not_proved=found)
    return figure.with_fields(
        proved_value=str(found.value), proved_radius=str(found.radius), not_proved=None
    )


def _enclosure(figure: Figure, known: ProvedMotionOfFigures) -> Enclosure | str:
    when = _instant(figure, known)
    if when is None and figure.name in _EXTREMA:
        return "no single maximum is proved"
    if when is None:
        return f"the proved motion has no {figure.at or figure.name}"
    try:
        return _ENCLOSURES[figure.name](figure, known.proof, when)
    except InputError as error:
        return str(error)


def _instant(figure: Figure, known: ProvedMotionOfFigures) -> Instant | None:
    """Time or event that a figure belongs to; None: there is no such event."""
    if figure.name in _EXTREMA:
        return None if known.proof.motion.launch is None else _EXTREMA[figure.name](figure, known)
    if figure.time is not None:
        return figure.time
    if figure.at == "start":
        return 0
    kind, subject = "release", figure.subject
    if figure.name in ("launch_time", "launch_speed") or figure.at == "launch":
        kind, subject = "launch", None
    elif figure.at.startswith(_RELEASE):
        subject = figure.at.removeprefix(_RELEASE)
    return _event(known.proof, kind, subject)


def _event(proof: Proof, kind: str, subject: str | None) -> ProvedEvent | None:
    for event in proof.motion.events:
        if event.kind == kind and subject in (None, event.name):
            return event
    return None


def _time(_: Figure, proof: Proof, when: Instant) -> Enclosure:
    if not isinstance(when, ProvedEvent):
        raise InputError("the time of an event is needed")
    return proof.time_of(when)


def _position(figure: Figure, proof: Proof, when: Instant) -> Enclosure:
    (x, y), _ = proof.marker(figure.subject or "", when)
    return y if figure.name == "position_y" else x


_ENCLOSURES: dict[str, Callable[[Figure, Proof, Instant], Enclosure]] = {
    "stop_torque": lambda figure, proof, t: proof.stop_torque(figure.subject or "", t),
    "total_energy": lambda _, proof, t: proof.total_energy(t),
    "release_time": _time,
    "launch_time": _time,
    "launch_speed": lambda _, proof, t: proof.projectile_speed(t),
    "coordinate": lambda figure, proof, t: proof.q(t)[figure.subject or ""],
    "position_x": _position,
    "position_y": _position,
    "position_x_max": _position,
    "range": lambda _, proof, t: proof.vacuum_range(t),
    "energy_ratio": lambda _, proof, t: proof.energy_ratio(t),
    "best_release_time": _time,
    "best_release_angle": lambda _, proof, t: proof.projectile_angle(t),
    "best_release_speed": lambda _, proof, t: proof.projectile_speed(t),
    "best_range": lambda _, proof, t: proof.vacuum_range(t),
    "largest_ratio_time": _time,
    "largest_ratio": lambda _, proof, t: proof.energy_ratio(t),
}
_EXTREMA: dict[str, Callable[[Figure, ProvedMotionOfFigures], ProvedEvent | None]] = {
    "position_x_max": lambda figure, known: known.proof.rightmost(figure.subject or ""),
    **dict.fromkeys(
        ("best_release_time", "best_release_angle", "best_release_speed", "best_range"),
        lambda _, known: known.best_release,
    ),
    **dict.fromkeys(("largest_ratio_time", "largest_ratio"), lambda _, known: known.fastest),
}
PROVABLE = frozenset(_ENCLOSURES)
"""Names of the figures that a proof can enclose."""
