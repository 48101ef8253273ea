"""Figures of a certificate that are proved: what encloses each, or why none does."""

from __future__ import annotations

from collections.abc import Callable

from ...models.errors import InputError, SimulationError
from ...models.problem import Problem
from ..proof.motion import ProvedEvent
from ..proof.proof import Enclosure, Instant, Proof, prove
from .certificate import Figure

DIGITS = 18  # of a proof: two more than a figure's value has
_RELEASE = "release of "


def proof_of(problem: Problem, end: float) -> Proof | str:
    """Prove a problem's motion to a time [s]; a sentence, where that cannot be done."""
    try:
        return prove(problem, DIGITS, end)
    except (InputError, SimulationError) as error:
        return str(error)


def with_proof(figure: Figure, proof: Proof | str) -> Figure:
    """A figure with what is proved of it, or why nothing is.

    Raises:
        InputError: the proof contradicts it.
    """
    found = proof if isinstance(proof, str) else _enclosure(figure, proof)
    if isinstance(found, str):
        return figure.with_fields(not_proved=found)
    return figure.with_fields(
        proved_value=str(found.value), proved_radius=str(found.radius), not_proved=None
    )


def _enclosure(figure: Figure, proof: Proof) -> Enclosure | str:
    if figure.name in _EXTREMA:
        return "it is at an extremum, which a certificate does not enclose"
    when = _instant(figure, proof)
    if when is None:
        return f"the proved motion has no {figure.at or figure.name}"
    try:
        return _ENCLOSURES[figure.name](figure, proof, when)
    except InputError as error:
        return str(error)


def _instant(figure: Figure, proof: Proof) -> Instant | None:
    """Time or event that a figure belongs to; None: there is no such event."""
    if figure.time is not None:
        return figure.time
    if figure.at == "start":
        return 0
    kind, subject = "release", figure.subject
    if figure.name in ("launch_time", "launch_speed") or figure.at == "launch":
        kind, subject = "launch", None
    elif figure.at.startswith(_RELEASE):
        subject = figure.at.removeprefix(_RELEASE)
    return _event(proof, kind, subject)


def _event(proof: Proof, kind: str, subject: str | None) -> ProvedEvent | None:
    for event in proof.motion.events:
        if event.kind == kind and subject in (None, event.name):
            return event
    return None


def _time(_: Figure, proof: Proof, when: Instant) -> Enclosure:
    if not isinstance(when, ProvedEvent):
        raise InputError("the time of an event is needed")
    return proof.time_of(when)


def _launch_speed(_: Figure, proof: Proof, __: Instant) -> Enclosure:
    speed = proof.launch_speed
    if speed is None:
        raise InputError("no launch is proved")
    return speed


def _position(figure: Figure, proof: Proof, when: Instant) -> Enclosure:
    (x, y), _ = proof.marker(figure.subject or "", when)
    return x if figure.name == "position_x" else y


_ENCLOSURES: dict[str, Callable[[Figure, Proof, Instant], Enclosure]] = {
    "stop_torque": lambda figure, proof, t: proof.stop_torque(figure.subject or "", t),
    "total_energy": lambda _, proof, t: proof.total_energy(t),
    "release_time": _time,
    "launch_time": _time,
    "launch_speed": _launch_speed,
    "coordinate": lambda figure, proof, t: proof.q(t)[figure.subject or ""],
    "position_x": _position,
    "position_y": _position,
    "range": lambda _, proof, t: proof.vacuum_range(t),
    "energy_ratio": lambda _, proof, t: proof.energy_ratio(t),
}
_EXTREMA = (
    "position_x_max",
    "best_release_time",
    "best_release_angle",
    "best_release_speed",
    "best_range",
    "largest_ratio_time",
    "largest_ratio",
)
PROVABLE = frozenset((*_ENCLOSURES, *_EXTREMA))
"""Names of the figures of which it is known whether they can be proved."""
