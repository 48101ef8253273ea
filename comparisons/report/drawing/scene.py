"""Events of a motion by solver: releases, impacts and the launch."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ....models.arrays import FloatArray
from ....models.errors import InputError
from ....models.trajectory import PointMotion, Trajectory
from .sketch import MOVING, Box, Drawing
from .symbols import draw

_MOST_IMPACTS = 12
"""Impacts of a stop that are shown; a bouncing body has any number of them."""


@dataclass(frozen=True)
class SceneEvent:
    """A release, an impact or the launch, and its time in each solver's motion."""

    kind: Literal["release", "impact", "launch"]
    name: str
    """The event in words."""
    time: float
    """Time in the reference, or in the first run that has it [s]."""
    reference: float | None
    """[s]; None: it does not happen there."""
    runs: Mapping[str, float | None]
    """[s], by run."""
    stop: str = ""


def events_of(
    reference: Trajectory,
    runs: Mapping[str, Trajectory],
    end: float,
    thrown: str | None = None,
    launch: float | None = None,
) -> tuple[SceneEvent, ...]:
    """All events up to the end of the compared motion [s], in their order.

    Args:
        thrown: marker whose launch is one; None: none is thrown.
        launch: the reference's [s]; found on the trajectory's samples where left out.
    """
    found = [*_releases(reference, runs), *_impacts(reference, runs)]
    if thrown is not None:
        own = launch if launch is not None else _launch(reference, thrown)
        found.append(
            (
                "launch",
                "launch",
                "",
                own,
                {name: _launch(run, thrown) for name, run in runs.items()},
            )
        )
    events: list[SceneEvent] = []
    for kind, name, stop, own, others in found:
        first, *rest = (
            time if time is not None and time <= end else None for time in (own, *others.values())
        )
        times = [time for time in (first, *rest) if time is not None]
        if times:
            events.append(
                SceneEvent(kind, name, times[0], first, dict(zip(others, rest, strict=True)), stop)
            )
    return tuple(sorted(events, key=lambda event: event.time))


_Found = tuple[
    Literal["release", "impact", "launch"], str, str, float | None, dict[str, float | None]
]
"""Kind, name, stop, and times in the reference and the runs."""


def _releases(reference: Trajectory, runs: Mapping[str, Trajectory]) -> Iterator[_Found]:
    for stop in reference.release_times:
        times = {name: run.release_times.get(stop) for name, run in runs.items()}
        yield "release", f"{stop} opens", stop, reference.release_times[stop], times


def _impacts(reference: Trajectory, runs: Mapping[str, Trajectory]) -> Iterator[_Found]:
    for stop in reference.mechanism.stops:
        own = _of_stop(reference, stop.name)
        theirs = {name: _of_stop(run, stop.name) for name, run in runs.items()}
        count = min(max(map(len, (own, *theirs.values()))), _MOST_IMPACTS)
        for k in range(count):
            times = {name: times[k] if k < len(times) else None for name, times in theirs.items()}
            name = f"{stop.name} is hit" + (f" ({k + 1})" if count > 1 else "")
            yield "impact", name, stop.name, own[k] if k < len(own) else None, times


def _of_stop(trajectory: Trajectory, stop: str) -> list[float]:
    return [time for time, impulses in trajectory.impacts if impulses.get(stop, 0.0) > 0]


def _launch(trajectory: Trajectory, marker: str) -> float | None:
    launch = trajectory.launch(marker=marker) if marker in trajectory.markers else None
    return None if launch is None else launch.time


_FRAMES, _FEWEST = 180, 60
_NUMBERS = 8_000  # of all frames together; a mechanism of many bodies has fewer frames
_NEAR = 0.015  # parts of the end: about an event the frames are closer
_MOST_EVENTS = 12  # about which they are
_FRAMED = 60  # that have frames of their own
_BEFORE = 1e-7  # parts of the end
_SAME = 1e-3  # a marker is where q puts it, if it is less than this share of its deviation away
_KEPT = 4  # motions at the samples of runs
_SAME_TIME = 1e-9  # parts of the end
# Of the size: by how much runs widen the view at most, and what is left beside them
_WIDER, _MARGIN = (0.15, 0.03)
_ROUNDING = 1e-14  # of the size, below which a deviation is rounding
_SECONDS = 6.0  # of a motion, as files show it
# Slow motion there: how much, and within which part of the end about an event
_SLOWED, _CLOSE = (3.0, 0.02)
HOLD = 1.2
"""How long files show the last picture [s]."""
_MOST = 1e8  # times that a deviation is magnified
States = Callable[[FloatArray], Trajectory]
"""A motion at any times [s] up to its end."""


@dataclass(frozen=True)
class RunLook:
    """A run to be shown beside the reference, and how."""

    trajectory: Trajectory
    colour: str
    """Colour of CSS, '#1f77b4'."""
    dashed: bool = False


@dataclass(frozen=True)
class RunMotion:
    """How a run deviates from the reference, by frame; NaN after its end."""

    name: str
    colour: str
    dashed: bool
    d: FloatArray
    """Deviation of the coordinates, shape (n, n_q) [rad or m]."""
    aside: Mapping[str, FloatArray]
    """Position of a marker less that by its coordinates, shape (n, 2) [m]; where they differ."""
    torques: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Torques of stops [N m], or forces [N] on points, where the run tells them, shape (n,)."""
    forces: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """On the children of the joints whose forces it tells, shape (n, 2) [N]."""


@dataclass(frozen=True)
class Scene:
    """One mechanism in motion, with all its runs."""

    name: str
    drawing: Drawing
    t: FloatArray
    """Times of the frames [s], shape (n,)."""
    reference: Trajectory
    """At the frames."""
    runs: tuple[RunMotion, ...]
    events: tuple[SceneEvent, ...]
    notes: str = field(default="", kw_only=True)
    """A sentence on what is seen, such as which runs are missing."""
    magnify: float | None = field(default=None, kw_only=True)
    """Factor of deviations at first; None: such that they are seen."""

    @property
    def mechanism_title(self) -> str:
        """Its name, as a title."""
        return self.name.replace("-", " ")

    @cached_property
    def points(self) -> FloatArray:
        """The reference's points [m], shape (n, n_points, 2)."""
        return self.drawing.positions(self.reference.q)

    @cached_property
    def box(self) -> Box:
        """Part of the plane that is shown: the drawing's, and what runs need beside it at first."""
        x0, y0, x1, y1 = self.drawing.box
        moving = sorted(
            {i for shape in self.drawing.shapes if shape.role in MOVING for i in shape.points}
        )
        shifted = [self.points + self.magnification * self.deviation(run) for run in self.runs]
        xy = np.concatenate([self.points, *shifted])[:, moving].reshape(-1, 2)
        most, margin = _WIDER * self.drawing.size, _MARGIN * self.drawing.size
        low, high = np.nanmin(xy, axis=0) - margin, np.nanmax(xy, axis=0) + margin
        left, lower = (
            min(a, max(b, a - most)) for a, b in zip((x0, y0), low.tolist(), strict=True)
        )
        right, upper = (
            max(a, min(b, a + most)) for a, b in zip((x1, y1), high.tolist(), strict=True)
        )
        return left, lower, right, upper

    @cached_property
    def states(self) -> CubicHermiteSpline:
        """The reference's coordinates at any instant [s]."""
        return CubicHermiteSpline(self.t, self.reference.q, self.reference.u)

    @cached_property
    def fine(self) -> FloatArray:
        """Instants [s] so close that straight lines between them are smooth traces."""
        middle = (self.t[1:] + self.t[:-1]) / 2
        points = self.points[:, list(self.drawing.compared)]
        off = (
            self.drawing.positions(self.states(middle))[:, list(self.drawing.compared)]
            - (points[1:] + points[:-1]) / 2
        )
        parts = np.ceil(
            np.sqrt(2000 * np.linalg.norm(off, axis=-1).max(axis=-1) / self.drawing.size)
        )
        times = [
            np.linspace(a, b, int(n), endpoint=False)
            for a, b, n in zip(self.t[:-1], self.t[1:], parts.clip(1, 8), strict=True)
        ]
        return np.append(np.concatenate(times), self.t[-1])

    def at(
        self, time: FloatArray, run: RunMotion | None = None, magnification: float = 1.0
    ) -> FloatArray:
        """Positions of all points [m] at instants [s], (n, n_points, 2); a run's magnified."""
        q = self.states(time)
        xy = self.drawing.positions(q)
        if run is None:
            return xy
        shift = self.drawing.deviations(q, _linear(time, self.t, run.d))
        for name, aside in run.aside.items():
            shift[:, self.drawing.markers[name]] += _linear(time, self.t, aside)
        return xy + magnification * shift

    def deviation(self, run: RunMotion) -> FloatArray:
        """Deviation of a run's points from the reference's [m], shape (n, n_points, 2)."""
        deviation = self.drawing.deviations(self.reference.q, run.d)
        for name, aside in run.aside.items():
            deviation[:, self.drawing.markers[name]] += aside
        return deviation

    def error(self, run: RunMotion) -> FloatArray:
        """Largest distance of any compared point from the reference's [m], shape (n,)."""
        compared = self.deviation(run)[:, list(self.drawing.compared)]
        return np.linalg.norm(compared, axis=-1).max(axis=-1)

    @cached_property
    def magnification(self) -> float:
        """Factor by which deviations are magnified at first.

        As asked for, or the power of ten that makes the largest deviation of any run at most an
        eighth of the size.
        """
        if self.magnify is not None:
            return self.magnify
        errors = [self.error(run) for run in self.runs]
        largest = max(
            (float(np.nanmax(error)) for error in errors if np.isfinite(error).any()), default=0.0
        )
        return (
            10.0 ** np.clip(np.floor(np.log10(self.drawing.size / 8 / largest)), 0, 8)
            if largest > 0
            else 1.0
        )


def refuse_magnification(magnify: float | None) -> None:
    """Raise InputError if deviations cannot be magnified by that; None leaves it open."""
    if magnify is not None and not 1 <= magnify <= _MOST:
        raise InputError(f"magnify = {magnify!r} must be between 1 and {_MOST:g}.")


def scene(
    states: States | Trajectory,
    runs: Mapping[str, RunLook] | None = None,
    *,
    end: float | None = None,
    thrown: str | None = "projectile",
    launch: float | None = None,
    name: str = "",
    notes: str = "",
    magnify: float | None = None,
) -> Scene:
    """The data of an animation.

    Args:
        states: the reference motion, at any times or as a trajectory.
        runs: of engines on the same mechanism, by label.
        end: of what is shown [s]; of a trajectory its own where left out.
        thrown: marker whose launch is an event, where there is one of that name.
        launch: the reference's [s]; found on its frames where left out.
        name: of the mechanism, if another one than its own.
        notes: a sentence below the picture.
        magnify: by what deviations are magnified at first; chosen so that they are seen where left
            out.

    Raises:
        InputError: there is no end, the magnification is below 1, or a run is of another mechanism.
    """
    refuse_magnification(magnify)
    runs = runs or {}
    if isinstance(states, Trajectory):
        end = float(states.t[-1]) if end is None else min(end, float(states.t[-1]))
        states = resampled(states)
    if end is None or not end > 0:
        raise InputError(f"end = {end!r} s must be positive: an animation needs some time to show.")
    first = states(np.array([0.0]))
    for label, run in runs.items():
        if run.trajectory.mechanism.coordinates != first.mechanism.coordinates:
            raise InputError(
                f"run {label!r} is of another mechanism than the reference, and cannot be drawn "
                "over it."
            )
    thrown = thrown if thrown in first.markers else None
    t = _grid(end, _event_times(first, runs, end), len(first.q[0]) * (len(runs) + 1))
    events = events_of(
        states(t), {label: run.trajectory for label, run in runs.items()}, end, thrown, launch
    )
    if any(
        event.time not in t for event in events
    ):  # launches and impacts of the reference are known only now
        t = _grid(end, [event.time for event in events], len(first.q[0]) * (len(runs) + 1))
    reference = states(t)
    drawing = draw(first.mechanism, reference.q)
    at_samples = _remembered(states)
    motions = tuple(_motion_of(label, run, at_samples, drawing, t) for label, run in runs.items())
    return Scene(
        name or first.mechanism.name,
        drawing,
        t,
        reference,
        motions,
        events,
        notes=notes,
        magnify=magnify,
    )


def _remembered(states: States) -> States:
    """The same for the last times that were asked for: runs of one step share theirs."""

    @lru_cache(_KEPT)
    def read(times: bytes) -> Trajectory:
        return states(np.frombuffer(times))

    return lambda times: read(times.tobytes())


def _event_times(first: Trajectory, runs: Mapping[str, RunLook], end: float) -> list[float]:
    """Releases and impacts of the reference [s]."""
    times = [time for time in first.release_times.values() if time is not None]
    return [time for time in (*times, *(time for time, _ in first.impacts)) if 0 < time <= end]


def _grid(end: float, events: list[float], width: int) -> FloatArray:
    """Times of the frames [s]: even, closer about events, and the events themselves.

    Args:
        end: of the grid [s].
        events: [s].
        width: numbers that a frame needs.
    """
    n = int(np.clip(_NUMBERS / width, _FEWEST, _FRAMES))
    times = [np.linspace(0.0, end, n)]
    near = events[:_MOST_EVENTS]
    offsets = np.linspace(-1.0, 1.0, max(3, n // 6 // max(len(near), 1))) * _NEAR * end
    times += [time + offsets for time in near]
    grid = np.unique(np.clip(np.concatenate(times), 0.0, end))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-7 * end])]
    grid[-1] = end
    # Speeds and forces jump at an event: a frame just before it has those from before.
    return np.unique(
        np.concatenate([grid, events[:_FRAMED], np.array(events[:_FRAMED]) - _BEFORE * end]).clip(
            0.0
        )
    )


def _motion_of(
    name: str, run: RunLook, states: States, drawing: Drawing, t: FloatArray
) -> RunMotion:
    trajectory = run.trajectory
    samples = _around(trajectory.t, t)
    reference = states(trajectory.t[samples])
    d = trajectory.q[samples] - reference.q
    shifts = drawing.deviations(reference.q, d)
    aside: dict[str, FloatArray] = {}
    for marker, index in drawing.markers.items():
        if marker in trajectory.markers and marker in reference.markers:
            own = trajectory.marker(marker).position[samples] - reference.marker(marker).position
            beside = own - shifts[:, index]
            distance, allowed = (np.linalg.norm(each, axis=1) for each in (beside, own))
            if np.any(distance > np.maximum(_SAME * allowed, _ROUNDING * drawing.size)):
                aside[marker] = _at(t, trajectory.t[samples], beside)

    def told(of: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        finite = {name: values[samples] for name, values in of.items() if np.isfinite(values).any()}
        rows = {name: values.reshape(len(samples), -1) for name, values in finite.items()}
        return {name: _at(t, trajectory.t[samples], values) for name, values in rows.items()}

    torques = {name: values[:, 0] for name, values in told(trajectory.stop_torques).items()}
    moved = _at(t, trajectory.t[samples], d)
    return RunMotion(
        name, run.colour, run.dashed, moved, aside, torques, told(trajectory.joint_reactions)
    )


def _around(samples: FloatArray, t: FloatArray) -> list[int]:
    """Indices of the samples on either side of each frame."""
    after = np.searchsorted(samples, t)
    found = np.unique(np.clip(np.concatenate([after - 1, after]), 0, len(samples) - 1))
    return [int(i) for i in found if samples[i] <= t[-1] or not i or samples[i - 1] < t[-1]]


def _at(t: FloatArray, samples: FloatArray, values: FloatArray) -> FloatArray:
    """Values by columns, at the frames; NaN after the last sample."""
    found = _linear(t, samples, values)
    found[t > samples[-1] + _SAME_TIME * t[-1]] = np.nan
    return found


def _linear(t: FloatArray, samples: FloatArray, values: FloatArray) -> FloatArray:
    """Values by columns, at other times."""
    return np.stack([np.interp(t, samples, column) for column in values.T], axis=1)


def resampled(trajectory: Trajectory) -> States:
    """A trajectory at any times: states by cubic splines, forces and energies linearly."""
    spline = CubicHermiteSpline(trajectory.t, trajectory.q, trajectory.u)

    def at_q(marker: str, q: FloatArray) -> FloatArray:
        found = next(each for each in trajectory.mechanism.markers if each.name == marker)
        return trajectory.kinematics.position(
            trajectory.kinematics.point(found.body, found.point), q
        )

    beside = {
        name: motion.position - at_q(name, trajectory.q)
        for name, motion in trajectory.markers.items()
    }

    def linear(t: FloatArray, values: FloatArray) -> FloatArray:
        if values.ndim == 1:
            return np.interp(t, trajectory.t, values)
        return _linear(t, trajectory.t, values)

    def each_linear(t: FloatArray, values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {name: linear(t, one) for name, one in values.items()}

    def at(t: FloatArray) -> Trajectory:
        t = np.clip(t, trajectory.t[0], trajectory.t[-1])
        q, u = np.asarray(spline(t)), np.asarray(spline(t, 1))
        markers = {
            name: PointMotion(at_q(name, q) + linear(t, beside[name]), linear(t, motion.velocity))
            for name, motion in trajectory.markers.items()
        }
        return dataclasses.replace(
            trajectory,
            t=t,
            q=q,
            u=u,
            markers=markers,
            kinetic_energy=linear(t, trajectory.kinetic_energy),
            potential_energy=linear(t, trajectory.potential_energy),
            stop_torques=each_linear(t, trajectory.stop_torques),
            joint_reactions=each_linear(t, trajectory.joint_reactions),
            joint_gaps=each_linear(t, trajectory.joint_gaps),
        )

    return at


def play_times(scene: Scene, rate: float) -> list[float]:
    """Instants of the motion [s] that are shown at a constant rate [1/s]; closer about events."""
    end, events = float(scene.t[-1]), [event.time for event in scene.events]
    times, time = [0.0], 0.0
    while time < end:
        nearest = min((abs(event - time) for event in events), default=np.inf) / (_CLOSE * end)
        slower = 1.0 + (_SLOWED - 1.0) * float(np.clip(2.0 - nearest, 0.0, 1.0))
        time = min(time + end / _SECONDS / rate / slower, end)
        times.append(time)
    return times
