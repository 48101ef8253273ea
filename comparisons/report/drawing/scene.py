"""A mechanism in motion as data: frames, runs beside the reference, and events by solver."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from itertools import zip_longest
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ....models.arrays import FloatArray
from ....models.errors import InputError
from ....models.kinematics import initial_state
from ....models.mechanism import Mechanism
from ....models.trajectory import PointMotion, Trajectory
from .sketch import MOVING, Box, Drawing, draw

_MOST_IMPACTS = 12  # impacts of a stop that are shown; a bouncing body has any number of them
_FRAMES, _FEWEST = 180, 60
_NUMBERS = 8_000  # of all frames together; a mechanism of many bodies has fewer frames
_NEAR = 0.015  # parts of the end: about an event the frames are closer
_MOST_EVENTS = 12  # about which they are
_FRAMED = 60  # that have frames of their own
_BEFORE = 1e-7  # parts of the end
_SAME = 1e-3  # a marker is where q puts it, if it is less than this share of its deviation away
_SEEN = 1e-2  # [rad], or of the size: a start that is farther away is seen to be another one
_KEPT = 4  # motions at the samples of runs
_SAME_TIME = 1e-9  # parts of the end
# Of the size: by how much runs widen the view at most, and what is left beside them
_WIDER, _MARGIN = (0.15, 0.03)
_ROUNDING = 1e-14  # of the size, below which a deviation is rounding
_SECONDS = 6.0  # of a motion, as files show it
# Slow motion there: how much, and within which part of the end about an event
_SLOWED, _CLOSE = (3.0, 0.02)
HOLD = 1.2  # how long files show the last picture [s]
_MOST = 1e8  # times that a deviation is magnified
States = Callable[[FloatArray], Trajectory]  # a motion at any times [s] up to its end


@dataclass(frozen=True)
class SceneEvent:
    """A release, an impact or the launch, and its time in each solver's motion."""

    kind: Literal["release", "impact", "launch"]
    name: str  # the event in words
    time: float  # time in the reference, or in the first run that has it [s]
    reference: float | None  # [s]; None: it does not happen there
    runs: Mapping[str, float | None]  # [s], by run
    stop: str = ""


def events_of(
    reference: Trajectory,
    runs: Mapping[str, Trajectory],
    end: float,
    thrown: str | None = None,
    launch: float | None = None,
) -> tuple[SceneEvent, ...]:
    """Events up to the end of the compared motion [s], in their order.

    Args:
        thrown: marker whose launch is one; None: none is thrown.
        launch: the reference's [s]; found on the trajectory's samples where left out.
    """
    events: list[SceneEvent] = []

    def add(
        kind: Literal["release", "impact", "launch"], name: str, stop: str,
        times: Sequence[float | None],
    ) -> None:  # fmt: skip
        """Add an event with its times in the reference and the runs, if any of them has it."""
        until = [time if time is not None and time <= end else None for time in times]
        known = [time for time in until if time is not None]
        if known:
            by_run = dict(zip(runs, until[1:], strict=True))
            events.append(SceneEvent(kind, name, known[0], until[0], by_run, stop))

    solvers = (reference, *runs.values())
    for stop, released in reference.release_times.items():
        times = (run.release_times.get(stop) for run in runs.values())
        add("release", f"{stop} opens", stop, [released, *times])
    for stop in reference.mechanism.stops:
        hits: list[list[float]] = []
        for solver in solvers:
            hits.append([t for t, impulses in solver.impacts if impulses.get(stop.name, 0.0) > 0])
        shown = [*zip_longest(*hits)][:_MOST_IMPACTS]
        for k, times in enumerate(shown, 1):
            name = f"{stop.name} is hit" + (f" ({k})" if len(shown) > 1 else "")
            add("impact", name, stop.name, times)
    if thrown is not None:

        def launch_of(solver: Trajectory) -> float | None:
            found = solver.launch(marker=thrown) if thrown in solver.markers else None
            return None if found is None else found.time

        first = launch_of(reference) if launch is None else launch
        add("launch", "launch", "", [first, *map(launch_of, runs.values())])
    return tuple(sorted(events, key=lambda event: event.time))


@dataclass(frozen=True)
class RunLook:
    """A run to be shown beside the reference, and how."""

    trajectory: Trajectory
    colour: str  # colour of CSS, '#1f77b4'
    dashed: bool = False


@dataclass(frozen=True)
class RunMotion:
    """Deviation of a run from the reference, by frame; NaN after its end."""

    name: str
    colour: str
    dashed: bool
    d: FloatArray  # deviation of the coordinates, shape (n, n_q) [rad or m]
    aside: Mapping[str, FloatArray]
    """Position of a marker less that by its coordinates, shape (n, 2) [m]; where they differ."""
    torques: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Torques of stops [N m], or forces [N] on points, where the run tells them, shape (n,)."""
    forces: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """On the children of the joints whose forces it tells, shape (n, 2) [N]."""
    compared: bool = True
    """Whether it begins as the reference does; else it is drawn as a motion of its own."""


@dataclass(frozen=True)
class Scene:
    """One mechanism in motion, with all its runs."""

    name: str
    drawing: Drawing
    t: FloatArray  # times of the frames [s], shape (n,)
    reference: Trajectory  # at the frames
    runs: tuple[RunMotion, ...]
    events: tuple[SceneEvent, ...]
    notes: str = field(default="", kw_only=True)
    """A sentence on what is seen, such as which runs are missing."""
    magnify: float | None = field(default=None, kw_only=True)
    """Factor of deviations at first; None: such that they are seen."""
    label: str = field(default="reference", kw_only=True)
    """Name of the motion that the runs are drawn over."""
    horizon: float | None = field(default=None, kw_only=True)
    """Time from which on the motion cannot be predicted [s]; None: it can, to the end."""

    @property
    def warning(self) -> str:
        """A sentence on what is shown beyond the predictability horizon; '' if nothing is."""
        if self.horizon is None:
            return ""
        return (
            f"Beyond {self.horizon:.4g} s this motion cannot be predicted: what is drawn is one of "
            "many that begin alike."
        )

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
        shapes = self.drawing.shapes
        moving = sorted({i for shape in shapes if shape.role in MOVING for i in shape.points})
        shifted: list[FloatArray] = []
        least, greatest = np.array(self.drawing.box).reshape(2, 2)
        most, margin = _WIDER * self.drawing.size, _MARGIN * self.drawing.size
        for run in self.runs:
            deviation = self.deviation(run)
            if run.compared:
                shifted.append(self.points + self.magnification * deviation)
            else:  # all of it is seen
                there = (self.points + deviation)[:, moving]
                least = np.minimum(least, np.nanmin(there, axis=(0, 1)) - margin)
                greatest = np.maximum(greatest, np.nanmax(there, axis=(0, 1)) + margin)
        xy = np.concatenate([self.points, *shifted])[:, moving].reshape(-1, 2)
        low = np.maximum(np.nanmin(xy, axis=0) - margin, least - most)
        high = np.minimum(np.nanmax(xy, axis=0) + margin, greatest + most)
        left, lower = np.minimum(least, low).tolist()
        right, upper = np.maximum(greatest, high).tolist()
        return left, lower, right, upper

    @cached_property
    def states(self) -> CubicHermiteSpline:
        """The reference's coordinates at any instant [s]."""
        return CubicHermiteSpline(self.t, self.reference.q, self.reference.u)

    @cached_property
    def fine(self) -> FloatArray:
        """Instants [s] so close that straight lines between them are smooth traces."""
        compared = list(self.drawing.compared)
        middle = (self.t[1:] + self.t[:-1]) / 2
        points = self.points[:, compared]
        halfway = self.drawing.positions(self.states(middle))[:, compared]
        bend = np.linalg.norm(halfway - (points[1:] + points[:-1]) / 2, axis=-1).max(axis=-1)
        parts = np.ceil(np.sqrt(2000 * bend / self.drawing.size)).clip(1, 8)
        times: list[FloatArray] = []
        for start, end, count in zip(self.t[:-1], self.t[1:], parts, strict=True):
            times.append(np.linspace(start, end, int(count), endpoint=False))
        return np.append(np.concatenate(times), self.t[-1])

    def at(
        self, time: FloatArray, run: RunMotion | None = None, magnification: float = 1.0
    ) -> FloatArray:
        """Positions of all points [m] at instants [s], (n, n_points, 2); a run's magnified.

        A motion from another start is not magnified.
        """
        q = self.states(time)
        xy = self.drawing.positions(q)
        if run is None:
            return xy
        shift = self.drawing.deviations(q, _linear(time, self.t, run.d))
        for name, aside in run.aside.items():
            shift[:, self.drawing.markers[name]] += _linear(time, self.t, aside)
        if run.compared:
            shift *= magnification
        return xy + shift

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
        """Factor by which deviations are magnified at first."""
        if self.magnify is not None:
            return self.magnify
        errors = [self.error(run) for run in self.runs if run.compared]
        known = [float(np.nanmax(error)) for error in errors if np.isfinite(error).any()]
        largest = max(known, default=0.0)
        if largest == 0:
            return 1.0
        # The power of ten that makes the largest deviation at most an eighth of the size.
        return 10.0 ** np.clip(np.floor(np.log10(self.drawing.size / 8 / largest)), 0, 8)


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
    label: str = "reference",
    horizon: float | None = None,
) -> Scene:
    """The data of an animation.

    Args:
        states: the reference motion, at any times or as a trajectory.
        runs: of engines on the same mechanism, by label; from another start, too.
        end: of what is shown [s]; of a trajectory its own where left out.
        thrown: marker whose launch is an event, where there is one of that name.
        launch: the reference's [s]; found on its frames where left out.
        name: of the mechanism, if another one than its own.
        notes: a sentence below the picture.
        magnify: by what deviations are magnified at first; chosen so that they are seen where left
            out.
        label: name of the motion that the runs are drawn over.
        horizon: time from which on it cannot be predicted [s]; None: it can.

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
    mechanism = first.mechanism
    for own_label, run in runs.items():
        if run.trajectory.mechanism.coordinates != mechanism.coordinates:
            raise InputError(
                f"run {own_label!r} is of another mechanism than the reference, and cannot be "
                "drawn over it."
            )
    thrown = thrown if thrown in first.markers else None
    numbers = len(first.q[0]) * (len(runs) + 1)  # of a frame
    releases = [time for time in first.release_times.values() if time is not None]
    known = [time for time in (*releases, *(t for t, _ in first.impacts)) if 0 < time <= end]
    t = _grid(end, known, numbers)
    trajectories = {own_label: run.trajectory for own_label, run in runs.items()}
    events = events_of(states(t), trajectories, end, thrown, launch)
    # Launches and impacts of the reference are known only now.
    if any(event.time not in t for event in events):
        t = _grid(end, [event.time for event in events], numbers)
    reference = states(t)
    drawing = draw(mechanism, reference.q)

    @lru_cache(_KEPT)  # runs of one step share their times
    def at_samples(times: bytes) -> Trajectory:
        return states(np.frombuffer(times))

    motions = tuple(
        _motion_of(own_label, run, lambda samples: at_samples(samples.tobytes()), drawing, t)
        for own_label, run in runs.items()
    )
    name = name or mechanism.name
    shown = Scene(
        name, drawing, t, reference, motions, events, notes=notes, magnify=magnify, label=label,
        horizon=None if horizon is None or horizon >= end else horizon,
    )  # fmt: skip
    return dataclasses.replace(shown, notes=" ".join(filter(None, (notes, shown.warning))))


def starts_alike(one: Mechanism, other: Mechanism) -> bool:
    """Tell whether two mechanisms begin in the same state."""
    return all(map(np.array_equal, initial_state(one), initial_state(other)))


def _begins_elsewhere(one: Mechanism, other: Mechanism, size: float) -> bool:
    """Tell whether a mechanism begins in another state than another one, and is the same else.

    Where it is not, as its stops are placed by its start, its start must be seen to be another.
    """
    if starts_alike(one, other):
        return False
    start = {"start": other.start, "start_speeds": other.start_speeds}
    apart = np.abs(np.array(one.start) - np.array(other.start))
    apart[len(one.angles) :] /= size
    return one.model_copy(update=start) == other or bool(apart.max() > _SEEN)


def _grid(end: float, events: list[float], numbers: int) -> FloatArray:
    """Times of the frames [s], of so many numbers each: even, closer about events, and these."""
    n = int(np.clip(_NUMBERS / numbers, _FEWEST, _FRAMES))
    times = [np.linspace(0.0, end, n)]
    near = events[:_MOST_EVENTS]
    offsets = np.linspace(-1.0, 1.0, max(3, n // 6 // max(len(near), 1))) * _NEAR * end
    times += [time + offsets for time in near]
    grid = np.unique(np.clip(np.concatenate(times), 0.0, end))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-7 * end])]
    grid[-1] = end
    # Speeds and forces jump at an event: a frame just before it has those from before.
    at_events = np.array(events[:_FRAMED])
    return np.unique(np.concatenate([grid, at_events, at_events - _BEFORE * end]).clip(0.0))


def _motion_of(
    name: str, run: RunLook, states: States, drawing: Drawing, t: FloatArray
) -> RunMotion:
    """A run's deviations and forces at the frames, from its samples on either side of each."""
    trajectory = run.trajectory
    after = np.searchsorted(trajectory.t, t)
    around = np.unique(np.clip(np.concatenate([after - 1, after]), 0, len(trajectory.t) - 1))
    until = (trajectory.t <= t[-1]) | (np.append(-np.inf, trajectory.t[:-1]) < t[-1])
    samples = around[until[around]]
    times = trajectory.t[samples]
    reference = states(times)

    def at_frames(values: FloatArray) -> FloatArray:
        frames = _linear(t, times, values)
        frames[t > times[-1] + _SAME_TIME * t[-1]] = np.nan
        return frames

    d = trajectory.q[samples] - reference.q
    shifts = drawing.deviations(reference.q, d)
    aside: dict[str, FloatArray] = {}
    for marker, index in drawing.markers.items():
        if marker in trajectory.markers and marker in reference.markers:
            shift = trajectory.marker(marker).position[samples] - reference.marker(marker).position
            beside = shift - shifts[:, index]
            allowed = _SAME * np.linalg.norm(shift, axis=1)
            distance = np.linalg.norm(beside, axis=1)
            if np.any(distance > np.maximum(allowed, _ROUNDING * drawing.size)):
                aside[marker] = at_frames(beside)

    loads: list[dict[str, FloatArray]] = []
    for recorded in (trajectory.stop_torques, trajectory.joint_reactions):
        known = [name for name, values in recorded.items() if np.isfinite(values).any()]
        loads.append({name: at_frames(recorded[name][samples]) for name in known})
    compared = not _begins_elsewhere(trajectory.mechanism, reference.mechanism, drawing.size)
    return RunMotion(name, run.colour, run.dashed, at_frames(d), aside, *loads, compared=compared)


def _linear(t: FloatArray, samples: FloatArray, values: FloatArray) -> FloatArray:
    """Values, or their columns, at other times."""
    if values.ndim == 1:
        return np.interp(t, samples, values)
    return np.stack([np.interp(t, samples, column) for column in values.T], axis=1)


def resampled(trajectory: Trajectory) -> States:
    """A trajectory at any times: states by cubic splines, forces and energies linearly."""
    kinematics = trajectory.kinematics
    spline = CubicHermiteSpline(trajectory.t, trajectory.q, trajectory.u)
    rows = {m.name: kinematics.point(m.body, m.point) for m in trajectory.mechanism.markers}
    beside: dict[str, FloatArray] = {}
    for name, motion in trajectory.markers.items():
        beside[name] = motion.position - kinematics.position(rows[name], trajectory.q)

    def at(t: FloatArray) -> Trajectory:
        t = np.clip(t, trajectory.t[0], trajectory.t[-1])
        linear = partial(_linear, t, trajectory.t)
        q, u = np.asarray(spline(t)), np.asarray(spline(t, 1))
        markers: dict[str, PointMotion] = {}
        for name, motion in trajectory.markers.items():
            position = kinematics.position(rows[name], q) + linear(beside[name])
            markers[name] = PointMotion(position, linear(motion.velocity))
        values: dict[str, Any] = {}
        for energy in ("kinetic_energy", "potential_energy"):
            values[energy] = linear(getattr(trajectory, energy))
        for kind in ("stop_torques", "joint_reactions", "joint_gaps"):
            recorded: Mapping[str, FloatArray] = getattr(trajectory, kind)
            values[kind] = {name: linear(force) for name, force in recorded.items()}
        return dataclasses.replace(trajectory, t=t, q=q, u=u, markers=markers, **values)

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
