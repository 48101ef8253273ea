"""What a release and an impact do to the contacts, for adapters that locate these events themselves.

Between events an engine moves the mechanism with a fixed set of active contacts. How it finds an
event, and by which impulses it resolves an impact, is the adapter's; what follows from an event is
decided here. The semantics are those of the reference, which has a formulation of its own.

- **Release.** The force of an active contact falls through zero, and the contact becomes inactive.
  The release time of a stop is that of its first opening.
- **Impact** (unilateral law only). The gap of an inactive contact falls through zero. All contacts
  that touch at that instant take part, active ones included, each with its restitution e. A contact
  met too slowly to rebound (:mod:`..models.rebound`, the rule of the reference) is plastic (e = 0),
  so that bouncing with 0 < e < 1 comes to rest after finitely many impacts.
- **After an impact.** Contacts whose gap speed is zero rest; the others part, which is a release.
- **Simultaneous impacts.** Two stops may throw a mechanism to and fro ever faster, towards an
  instant that is never reached. Impacts within `TOGETHER` of each other are therefore resolved at
  once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import SimulationError, UnsupportedProblemError
from ..models.kinematics import Kinematics, initial_state
from ..models.mechanism import Mechanism
from ..models.rebound import Rebounds
from ..models.trajectory import PointMotion
from .protocol import Recording

SAME_TIME = 1e-12  # [s] times closer than this are one instant
AT_REST = 1e-9  # [rad/s, m/s] gap speeds below this are rounding errors of an impact's solution
TOGETHER = 1e-9  # [s] impacts closer than this are resolved at once
MOST_IMPACTS = 10_000
_TOUCHING = 1e-11  # [rad, m] an inactive contact with a gap below this takes part in an impact
_RECENT = 10  # impacts that are searched for those within TOGETHER
_ROUNDING = 1e-12  # [rad/s, m/s], or of the terms whose sum is a gap speed: below this it is their rounding error

Contacts = tuple[str, ...]
"""Names of stops, in the order of the mechanism's."""


class ContactEvents:
    """Keeps the releases and impacts of one run, and applies their rules."""

    def __init__(self, mechanism: Mechanism, engine: str) -> None:
        """Start with no event; `engine` is the name in messages."""
        self.mechanism, self.engine = mechanism, engine
        self.releases: dict[str, float | None] = {stop.name: None for stop in mechanism.stops}
        """First opening of each stop that was closed at the start [s]."""
        self.rebounds = Rebounds(mechanism)
        self.impacts: list[tuple[float, Mapping[str, float]]] = []
        """Time [s] and impulse of each contact that took part [N m s, N s]."""

    def release(self, names: Iterable[str], time: float) -> None:
        """Contacts open at a time [s]; the first opening counts, because the throw depends on it."""
        for name in names:
            if self.releases[name] is None and self.mechanism.stop(name).closed:
                self.releases[name] = time

    def touching(
        self, time: float, met: str, active: Collection[str], gap: Callable[[str], float]
    ) -> Contacts:
        """Contacts that take part in an impact.

        Args:
            time: of the impact [s].
            met: the contact whose gap falls through zero.
            active: contacts that are active there.
            gap: gap of an inactive contact there [rad, m], by its name.
        """
        recent = {
            name
            for before, impulses in self.impacts[-_RECENT:]
            if time - before <= TOGETHER
            for name, impulse in impulses.items()
            if impulse > 0
        }
        certain = {met, *active, *recent}
        return tuple(
            name for name in self.releases if name in certain or abs(gap(name)) <= _TOUCHING
        )

    def restitution(
        self,
        speeds: Mapping[str, float],
        q: FloatArray,
        u: FloatArray,
        plastic: Collection[str] = (),
    ) -> dict[str, float]:
        """Restitution e of each contact in an impact: 0 for the plastic ones.

        Args:
            speeds: of the gaps before the impact [rad/s, m/s].
            q, u: the state before it, shape (n_q,).
            plastic: contacts whose rebounds are too low for the adapter's steps to follow.
        """
        self.rebounds.note_impact(q, u)
        rebounding = (name for name in speeds if name not in plastic)
        fast = {name for name in rebounding if speeds[name] < -self.rebounds.least_speed(name, q)}
        return {
            name: self.mechanism.stop(name).restitution if name in fast else 0.0 for name in speeds
        }

    def note_impact(self, time: float, impulses: Mapping[str, float]) -> None:
        """Record an impact.

        Raises:
            SimulationError: there are `MOST_IMPACTS` already.
        """
        if len(self.impacts) >= MOST_IMPACTS:
            raise SimulationError(
                f"{self.engine} gave up at t = {time:.6g} s: {MOST_IMPACTS} impacts, and no end."
            )
        self.impacts.append((time, impulses))

    def retract_impact(self) -> None:
        """Forget the last impact, which is resolved anew."""
        self.impacts.pop()


def resting(speeds: Mapping[str, float], rounding: float = AT_REST) -> Contacts:
    """Contacts that neither part nor close, by the speeds of their gaps after an impact [rad/s, m/s]."""
    return tuple(name for name, speed in speeds.items() if abs(speed) <= rounding)


def active_contacts(touching: Contacts, violated: Callable[[Contacts], str | None]) -> Contacts:
    """The touching contacts that push while the others open, all decided at once.

    This is the complementarity problem 0 <= force, complementary to gap acceleration (or speed) >=
    0. Murty's least-index pivoting (Opsearch 11, 1974) moves the first contact that violates its
    condition to the other side until none does; it ends because the problem has one solution. A set
    that comes up twice means zeros, whose sign is that of their rounding errors: it is accepted.

    Args:
        touching: contacts with zero gap and zero gap speed.
        violated: of a set of active contacts, the first one of `touching` that would have to pull
            while it is active, or that would close while it is inactive; None if there is none.
    """
    active, tried = touching, set[Contacts]()
    while touching and active not in tried and (wrong := violated(active)):
        tried.add(active)
        active = tuple(name for name in touching if (name in active) != (name == wrong))
    return active


def refuse_moving_gaps(mechanism: Mechanism, engine: str) -> None:
    """Refuse a start with a closed stop whose gap changes.

    Raises:
        UnsupportedProblemError: there is one; the engine would have to begin with an impact or an
            opening.
    """
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
    for stop in mechanism.stops:
        terms = kinematics.gap_jacobian(stop.name, q) * u
        if stop.closed and abs(terms.sum()) > _ROUNDING * max(1.0, float(np.abs(terms).sum())):
            raise UnsupportedProblemError(
                f"{engine} cannot start with stop {stop.name!r} closed while its gap changes at {terms.sum():.3g} "
                f"{stop.speed_unit}: that is an impact or an opening at t = 0."
            )


def joined(segments: Sequence[Recording], events: ContactEvents) -> Recording:
    """The recordings of one run's segments, one after the other, with the run's events."""
    merged = {
        field.name: _merged([getattr(segment, field.name) for segment in segments])
        for field in fields(Recording)
        if field.name not in ("release_times", "impacts", "steps")
    }
    steps = sum(segment.steps for segment in segments)
    return Recording(
        **merged, release_times=events.releases, impacts=tuple(events.impacts), steps=steps
    )


def _merged(parts: Sequence[Any]) -> Any:
    if isinstance(parts[0], Mapping):
        return {name: _merged([part[name] for part in parts]) for name in parts[0]}
    if isinstance(parts[0], PointMotion):
        return PointMotion(
            *(np.concatenate([getattr(p, key) for p in parts]) for key in ("position", "velocity"))
        )
    return np.concatenate(parts)
