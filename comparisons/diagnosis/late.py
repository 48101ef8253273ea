"""Readings of a right motion at other times: of all, or of some kinds of quantity; or at another rate of time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .readings import Reading

_INSTANT = 1e-6  # of the compared time
_LATEST = 0.2  # of the compared time: what is later by more is not the same motion at another time

Take = Callable[[Trajectory], Trajectory]
"""The reference with those quantities taken from the later motion that are read late."""


@dataclass(frozen=True)
class _Times:
    """The reference at other times, by the size of the mistake."""

    solution: Solution
    reference: Trajectory
    step: float

    @property
    def instant(self) -> float:
        """A shift of size one [s]."""
        return _INSTANT * float(self.reference.t[-1])

    def read(self, times: FloatArray) -> Trajectory:
        """What is said to be at the reference's times, but is at others."""
        end = self.solution.segments[-1].end
        return replace(self.solution.trajectory(np.clip(times, 0.0, end)), t=self.reference.t)

    def shifted(self, name: str, taken: Take) -> Reading:
        """Some quantities read at other times."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            return (
                taken(self.read(t + factor * self.instant))
                if abs(factor) * _INSTANT < _LATEST
                else None
            )

        def text(f: Sequence[float]) -> str:
            return f"{f[0] * self.instant:+.3g} s, {f[0] * self.instant / self.step:+.3g} steps"

        return Reading(name, (taken(self._later),), text, at)

    @cached_property
    def _later(self) -> Trajectory:
        return self.read(self.reference.t + self.instant)

    def rated(self) -> Reading:
        """Times that run at another rate."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            return (
                self.read(t * (1 + factor * _INSTANT)) if abs(factor) * _INSTANT < _LATEST else None
            )

        first = self.read(t * (1 + _INSTANT))
        return Reading(
            "rate of time", (first,), lambda f: f"times {1 / (1 + f[0] * _INSTANT):.6g}", at
        )


def late_readings(solution: Solution, r: Trajectory, step: float) -> Iterator[Reading]:
    """Everything, or one kind of quantity, read at another time; or times that run at another rate."""
    times = _Times(solution, r, step)
    yield times.rated()
    yield times.shifted("time shifted", lambda x: x)
    forces = {"stop_torques": r.stop_torques, "joint_reactions": r.joint_reactions}
    yield times.shifted("motion shifted in time, and no force", lambda x: replace(x, **forces))
    speeds = _SPEEDS | {"velocity": _velocities}
    yield times.shifted("velocities shifted in time", lambda x: _taken(r, x, speeds.values()))
    places = {"coordinates": _coordinates, "position": _positions}
    yield times.shifted("positions shifted in time", lambda x: _taken(r, x, places.values()))
    points = (_positions, _velocities)
    yield times.shifted("markers shifted in time", lambda x: _taken(r, x, points))
    for kind, name in _ALONE.items():
        yield times.shifted(f"{name} shifted in time", lambda x, kind=kind: _KINDS[kind](r, x))


def partly_late_readings(
    solution: Solution, r: Trajectory, step: float, wrong: Sequence[str]
) -> Iterator[Reading]:
    """All those kinds of quantity read at one other time that deviate, and no others.

    Args:
        wrong: names of the quantities that deviate.
    """
    times = _Times(solution, r, step)
    kinds = [kind for kind in _KINDS if any(name.split(" of the ")[0] == kind for name in wrong)]
    kinds = [kind for kind in _KINDS if kind in kinds or (kind == "torque" and "force" in kinds)]
    if len(kinds) > 1 and {*kinds} not in _TOGETHER:
        name = f"{', '.join(_ALONE[kind] for kind in kinds)} shifted in time"
        yield times.shifted(name, lambda x: _taken(r, x, [_KINDS[kind] for kind in kinds]))
    if {*_SPEEDS, "kinetic energy"} <= {*kinds} and "coordinates" not in kinds:
        yield times.shifted(
            "speeds, and the energy of them, shifted in time", lambda x: _of_speeds(solution, r, x)
        )


def _of_speeds(solution: Solution, r: Trajectory, x: Trajectory) -> Trajectory:
    """What an engine shows whose speeds are those of another time than its coordinates."""
    mixed = solution.reading(r.t, solution.motion_of(r.t, r.q, x.u))
    return replace(mixed, stop_torques=r.stop_torques, joint_reactions=r.joint_reactions)


def _taken(
    r: Trajectory, x: Trajectory, takes: Iterable[Callable[[Trajectory, Trajectory], Trajectory]]
) -> Trajectory:
    for take in takes:
        r = take(r, x)
    return r


def _coordinates(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(r, q=x.q)


def _speeds(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(r, u=x.u)


def _positions(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(
        r, markers={n: replace(m, position=x.markers[n].position) for n, m in r.markers.items()}
    )


def _velocities(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(
        r, markers={n: replace(m, velocity=x.markers[n].velocity) for n, m in r.markers.items()}
    )


_SPEEDS = {"speeds of coordinates": _speeds}
_KINDS: dict[str, Callable[[Trajectory, Trajectory], Trajectory]] = {
    "coordinates": _coordinates,
    **_SPEEDS,
    "position": _positions,
    "velocity": _velocities,
    "torque": lambda r, x: replace(r, stop_torques=x.stop_torques),
    "force": lambda r, x: replace(r, joint_reactions=x.joint_reactions),
    "kinetic energy": lambda r, x: replace(r, kinetic_energy=x.kinetic_energy),
    "potential energy": lambda r, x: replace(r, potential_energy=x.potential_energy),
}
"""By the beginning of a quantity's name (:mod:`.signatures`); a stop on a point has a force, too."""
_TOGETHER = (
    {"speeds of coordinates", "velocity"},
    {"coordinates", "position"},
    {"position", "velocity"},
    {*_KINDS},
    {*_KINDS} - {"torque", "force"},
)
"""Those that :func:`late_readings` has."""
_ALONE = {
    "coordinates": "coordinates",
    "speeds of coordinates": "speeds of the coordinates",
    "position": "positions of the markers",
    "velocity": "velocities of the markers",
    "torque": "torques",
    "force": "forces",
    "kinetic energy": "kinetic energy",
    "potential energy": "potential energy",
}
"""As a report names them."""
