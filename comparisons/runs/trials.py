"""Trials: one machine, many settings of its engines, each run once and kept.

Convergence studies, error budgets and advice all ask for the same thing: this engine with these
options, how far from the reference, at what cost. A trial is remembered by engine and options, on
disk if a folder is given, so that an interrupted study goes on where it stopped.

A trial keeps its trajectory minus the reference, as functions on one grid of times, so that trials
can be added and subtracted. Engines sample at times of their own; the deviation, not the motion, is
interpolated to the common grid: it is small and smooth (with kinks of higher order at releases), so
that only a small part of it is lost. Positions are interpolated by cubic splines; torques, which
have kinks in their slope, linearly.
"""

from __future__ import annotations

from contextlib import suppress
from threading import Lock
from typing import Annotated

import numpy as np
from pydantic import Field, JsonValue
from scipy.interpolate import make_interp_spline

from ...engines.protocol import Engine
from ...engines.registry import engine_class
from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...models.spec import Real, Spec
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ...reference.solver import characteristic_time
from .metrics import THROWN, against, measure, points
from .runner import Runner, Worker, failure
from .scales import Scales, scales_until
from .store import Store, conditions
from .study import Study, Until, all_in_order

GRID = 1000
"""Intervals of the common grid."""
Positions = dict[str, tuple[tuple[Real, ...], tuple[Real, ...]]]


class Deviation(Spec):
    """Of one trajectory, on a uniform grid from 0 to the end of the compared motion."""

    end: Real = Field(description="end of the compared motion [s]")
    positions: Positions = Field(
        description="x and y of each point of :func:`points` [m], each of GRID + 1 values"
    )
    torques: dict[str, tuple[Real, ...]] = Field(
        description="of stops closed at the start [N m, N], on the grid"
    )
    force_units: dict[str, str] = Field(
        default_factory=dict, description="of the torques; N m where left out"
    )
    energy: tuple[Real, ...] = Field(
        description="total energy, of that at the start [J], on the grid"
    )
    release_times: dict[str, Real | None] = Field(
        description="[s]; None where only one of the two releases"
    )
    launch_time: Real | None = Field(description="[s]; None where not both launch")
    launch_speed: Real | None = Field(description="[m/s]; None where not both launch")
    metrics: dict[str, Real] = Field(description="by label, as in a comparison")

    @property
    def t(self) -> FloatArray:
        """The grid [s], shape (GRID + 1,)."""
        return np.linspace(0.0, self.end, GRID + 1)

    @property
    def position(self) -> FloatArray:
        """Of all points in the order of their names [m], shape (points, 2, GRID + 1)."""
        return np.array([self.positions[name] for name in sorted(self.positions)])

    @property
    def farthest(self) -> str:
        """The point with the largest distance from the reference."""
        return max(
            self.positions, key=lambda name: np.linalg.norm(self.positions[name], axis=0).max()
        )

    def of_point(self, name: str) -> Deviation:
        """The same with the position of one point only."""
        return self.model_copy(update={"positions": {name: self.positions[name]}})


def deviation(
    trajectory: Trajectory,
    solution: Solution,
    end: float,
    reference: Trajectory | None = None,
    scales: Scales | None = None,
    thrown: str = THROWN,
) -> Deviation:
    """Set a trajectory beside the reference, at its own times, and interpolate the difference to the common grid.

    Args:
        end: end of the compared motion [s]; the trajectory should go on a little beyond it.
        reference: at the trajectory's times, where it is known already.
        scales: of the reference motion up to the end, where they are known already.
        thrown: marker whose launch is measured.
    """
    reference = reference or solution.trajectory(trajectory.t)
    grid = np.linspace(0.0, end, GRID + 1)
    expected = points(reference)
    errors = {name: position - expected[name] for name, position in points(trajectory).items()}
    closed = [stop.name for stop in trajectory.mechanism.stops if stop.closed]
    torques = {
        name: np.interp(
            grid, trajectory.t, trajectory.stop_torque(name) - reference.stop_torque(name)
        )
        for name in closed
        if name in trajectory.stop_torques
    }
    balance, kept = against(trajectory, solution, end, reference).balance
    measured = measure(trajectory, solution, end, reference, scales=scales, thrown=thrown)
    metrics = {m.label: m.value for m in measured if m.value is not None}
    farthest = {
        name: np.linalg.norm(error[trajectory.t <= end], axis=1).max()
        for name, error in errors.items()
    }
    launch_time, launch_speed = _launch_differences(trajectory, solution, thrown)
    return Deviation(
        end=end,
        force_units={name: trajectory.mechanism.stop(name).force_unit for name in torques},
        positions={name: _on_grid(trajectory.t, error, grid) for name, error in errors.items()},
        torques={name: tuple(values.tolist()) for name, values in torques.items()},
        energy=tuple(np.interp(grid, trajectory.t, balance - kept[0]).tolist()),
        release_times={
            name: _difference(trajectory.release_time(name), solution.release_times[name])
            for name in closed
        },
        launch_time=launch_time,
        launch_speed=launch_speed,
        metrics={f"position_max ({name})": float(distance) for name, distance in farthest.items()}
        | metrics,
    )


def _launch_differences(
    trajectory: Trajectory, solution: Solution, thrown: str
) -> tuple[float, float] | tuple[None, None]:
    """Of time [s] and speed [m/s]; None where not both launch."""
    if thrown not in trajectory.markers:
        return None, None
    launch, expected = trajectory.launch(marker=thrown), solution.launch_at(LAUNCH_ANGLE, thrown)
    return (
        (launch.time - expected.time, launch.speed - expected.speed)
        if launch and expected
        else (None, None)
    )


def _on_grid(
    t: FloatArray, error: FloatArray, grid: FloatArray
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    x, y = _interpolated(t, error, grid).T.tolist()
    return tuple(x), tuple(y)


def _interpolated(t: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    if len(t) < 8:
        return np.stack([np.interp(grid, t, column) for column in values.T], axis=1)
    return np.asarray(make_interp_spline(t, values, k=3)(np.minimum(grid, t[-1])), dtype=np.float64)


def _difference(value: float | None, expected: float | None) -> float | None:
    return None if value is None or expected is None else value - expected


_TIMED_FOR = (
    0.5  # [s] a longer run averages over what disturbs it, and one run of it is timing enough
)
_NO_CURVES: dict[str, object] = {"positions": {}, "torques": {}, "energy": ()}


class Trial(Spec):
    """One engine with its options on one machine."""

    engine: str
    engine_version: str
    preset: str
    settings: dict[str, JsonValue]
    mechanism_hash: str
    message: str | None = Field(default=None, description="why it failed; None if it ran")
    deviation: Deviation | None = None
    steps: Annotated[int, Field(ge=0)] = 0
    wall_times: tuple[Real, ...] = Field(
        default=(), description="of the whole simulate, warm, one a repeat [s]"
    )

    def metric(self, label: str) -> float | None:
        """A figure by its label, e.g. 'position_max (projectile)'; None if it has none (or the run failed)."""
        return None if self.deviation is None else self.deviation.metrics.get(label)

    @property
    def position(self) -> float | None:
        """Largest distance of any point of :func:`points` from the reference [m]."""
        return self._largest("position_max")

    @property
    def torque(self) -> float | None:
        """Largest error of any stop's torque at any sample [N m]."""
        return self._largest("stop_torque_max")

    def _largest(self, metric: str) -> float | None:
        metrics = {} if self.deviation is None else self.deviation.metrics
        return max(
            (value for label, value in metrics.items() if label.startswith(metric)), default=None
        )


class Trials:
    """Runs engines on one mechanism and remembers the results.

    They are compared up to the end of the motion, or to the predictability horizon if that is
    earlier.

    Args:
        mechanism: that moves.
        worker: the process to run in; None: this one. Its owner closes it.
        store: where trials are kept as JSON; None: only in memory.
        curves: keep the deviations as functions of time; without them a trial is its metrics alone,
        and small.
        until: end of the compared motion; None: the launch, if there is one.
        law: of the stops.
        predictable: up to the end, as is known: the horizon is not computed.

    Raises:
        InputError: the end is not valid, or does not come.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        worker: Worker | None = None,
        store: Store | None = None,
        *,
        curves: bool = True,
        until: Until | None = None,
        law: StopLaw = StopLaw.RELEASE_ONCE,
        predictable: bool = False,
    ) -> None:
        self.runner = Runner(mechanism, worker, until, law)
        self.mechanism, self.solution = mechanism, self.runner.solution
        self.end = self.runner.end if predictable else self.runner.judged_to
        self._scales = scales_until(self.solution, self.end) if predictable else self.runner.scales
        self._store, self._curves = store, curves
        self._known: dict[str, Trial] = {}
        self._locks: dict[str, Lock] = {}

    @property
    def time_scale(self) -> float:
        """What steps are parts of: characteristic time (without gravity, of the motion) or, if less, the end [s]."""
        own = characteristic_time(self.mechanism) if self.mechanism.gravity else self._scales.time
        return min(own, self.runner.end)

    def uncertainty(self, metric: str) -> float | None:
        """Of the reference in a metric, the largest of all its subjects, in its unit; None where nothing is known.

        That of the centres of mass of a mechanism without markers follows from those of its
        coordinates: each is at the end of a chain of bodies, whose angles count with their lengths.
        """
        known = self.runner.uncertainties.values
        if metric == "position_max" and not self.mechanism.markers:
            slides = len(self.mechanism.slides) * known.get("slide_max", 0.0)
            return self._scales.length * known.get("angle_max", 0.0) + slides
        return max(
            (value for name, value in known.items() if name.startswith(metric)), default=None
        )

    def trial(self, engine: Engine, repeats: int = 1, of: Mechanism | None = None) -> Trial:
        """An engine's trial, run if it is not known yet (or timed less often than asked for).

        Args:
            engine: with its options.
            repeats: how often it is timed; less often where its runs are long.
            of: what the engine is given instead of the machine, which it is still compared with: a
                slightly wrong machine shows what that wrongness does.
        """
        given = of or self.mechanism
        run = (
            given.content_hash,
            self.mechanism.content_hash,
            self.runner.law.value,
            repr(self.runner.until),
        )
        made_by = conditions(*run, self._curves, engine=engine)
        key = f"{engine.name}-{made_by[:20]}"
        with self._locks.setdefault(key, Lock()):  # threads that ask for the same trial wait for it
            known = self._known.get(key) or self._kept(key, made_by)
            trial = self._timed(known or self._run(engine, given), engine, given, repeats)
            if self._store and trial is not known:
                self._store.keep_record(key, trial, made_by, self.runner.worker.jobs)
            self._known[key] = trial
            return trial

    def _kept(self, key: str, made_by: str) -> Trial | None:
        """The store's trial, counted there as taken; None, and counted as made, if it has none."""
        if self._store is None:
            return None
        trial = self._store.record(key, Trial, made_by)
        (self._store.taken if trial else self._store.made).add(key)
        return trial

    def _run(self, engine: Engine, given: Mechanism) -> Trial:
        base = Trial(
            engine=engine.name,
            engine_version=engine_class(engine.name).version(),
            preset=engine.preset,
            settings=engine.settings,
            mechanism_hash=given.content_hash,
        )
        try:
            run = self.runner.simulate(engine, given)
            given_reference, thrown = self.runner.reference(run.t), self.runner.until.thrown
            measured = deviation(
                run, self.solution, self.end, given_reference, self._scales, thrown
            )
        except Exception as error:
            return base.model_copy(update={"message": failure(error)[1]})
        took = run.provenance
        measured = measured if self._curves else measured.model_copy(update=_NO_CURVES)
        return base.model_copy(
            update={"deviation": measured, "steps": took.steps, "wall_times": (took.wall_time,)}
        )

    def _timed(self, trial: Trial, engine: Engine, given: Mechanism, repeats: int) -> Trial:
        """The same trial, timed as often as asked for or for as long as is enough."""
        if trial.message is not None:
            return trial
        walls = list(trial.wall_times)
        with suppress(Exception):  # it did run: that a repeat fails costs a time, not the trial
            while len(walls) < repeats and sum(walls) < _TIMED_FOR:
                walls.append(self.runner.simulate(engine, given).provenance.wall_time)
        return (
            trial
            if len(walls) == len(trial.wall_times)
            else trial.model_copy(update={"wall_times": tuple(walls)})
        )


def trials_of(study: Study, worker: Worker) -> tuple[list[Trials], dict[str, str]]:
    """Of each mechanism of a study; and by name, why the references of the others failed: those must not be lost.

    Raises:
        InputError: as :class:`Trials`.
    """

    def solved(mechanism: Mechanism) -> Trials | tuple[str, str]:
        end, law = study.end_of(mechanism), study.law_of(mechanism)
        try:
            return Trials(mechanism, worker, study.store, until=end, law=law)
        except SimulationError as error:
            return mechanism.name, str(error)

    found = all_in_order(solved, study.mechanisms, study.jobs)
    return [each for each in found if isinstance(each, Trials)], dict(
        each for each in found if isinstance(each, tuple)
    )
