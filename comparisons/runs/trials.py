"""Trials: one machine, many settings of its engines, each run once and kept.

Convergence studies, error budgets and advice all ask for the same thing: this engine with these options, how far from
the reference, at what cost. A trial is remembered by engine and options, on disk if a folder is given, so that an
interrupted study goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, JsonValue

from ...engines.protocol import Engine
from ...engines.registry import engine_class
from ...models.arrays import FloatArray
from ...models.errors import InputError, TrebucheckError
from ...models.files import write_text
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.spec import Real, Spec
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ...reference.solver import solve_to_launch
from .deviation import Deviation, deviation
from .worker import Worker, simulate_warm

_TAIL_STEPS, _TAIL = 20, 0.02  # an engine runs on past the reference's launch, so that its own can be found
_TIMED_FOR = 0.5  # [s] a longer run averages over what disturbs it, and one run of it is timing enough
# Grids whose reference is kept: runs of one step and engine share theirs. The longest takes some 10 MB; longer ones
# belong to runs beside which the reference is cheap.
_GRIDS, _LONGEST_GRID = 3, 30_000
_NO_CURVES: dict[str, object] = {"position": ((), ()), "torques": {}, "energy": ()}


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
    wall_times: tuple[Real, ...] = Field(default=(), description="of the whole simulate, warm, one a repeat [s]")

    @property
    def timestep(self) -> float:
        """Of the engine [s]."""
        value = self.settings["timestep"]
        assert isinstance(value, int | float)
        return float(value)

    def metric(self, label: str) -> float | None:
        """A figure by its label, e.g. 'position_max (projectile)'; None if it has none (or the run failed)."""
        return None if self.deviation is None else self.deviation.metrics.get(label)

    @property
    def position(self) -> float | None:
        """Largest distance of the projectile from the reference up to the launch [m]."""
        return self.metric("position_max (projectile)")

    @property
    def torque(self) -> float | None:
        """Largest error of any stop's torque at any sample [N m]."""
        found = [] if self.deviation is None else [
            value for label, value in self.deviation.metrics.items() if label.startswith("stop_torque_max")
        ]  # fmt: skip
        return max(found, default=None)


Progress = Callable[[str], None]
"""Called before each run that is really made, with what it is."""


class Trials:
    """Runs engines on one machine, up to the reference's launch, and remembers what it found.

    Args:
        mechanism: the machine; it must launch.
        folder: where trials are kept as JSON; None: only in memory.
        resume: take kept trials again.
        isolate: run in a process of its own (one worker, shared by all trials).
        timeout: longest wait for one run [s].
        progress: called before each run that is made.
        worker: the process to run in, if it is not to be one of its own; its owner closes it.
        curves: keep the deviations as functions of time; without them a trial is its metrics alone, and small.

    Raises:
        InputError: the machine's reference does not launch.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        folder: Path | None = None,
        resume: bool = False,
        isolate: bool = True,
        timeout: float = 600.0,
        progress: Progress | None = None,
        worker: Worker | None = None,
        curves: bool = True,
    ) -> None:
        self.mechanism = mechanism
        self.solution: Solution = solve_to_launch(mechanism)
        launch = self.solution.launch
        if launch is None:
            raise InputError(f"{mechanism.name!r} does not launch, so there is no end to measure up to.")
        self.end = launch.time
        self._folder, self._resume, self._progress = folder, resume, progress
        self._curves, self._shared = curves, worker is not None
        self._worker = worker or Worker(timeout)
        self._simulate = self._worker.simulate if isolate else simulate_warm
        self._known: dict[str, Trial] = {}
        self._at = lru_cache(_GRIDS)(self._evaluated)

    def trial(self, engine: Engine, repeats: int = 1, of: Mechanism | None = None) -> Trial:
        """An engine's trial, made if it is not known yet (or timed less often than asked for).

        Args:
            engine: with its options.
            repeats: how often it is timed; less often where its runs are long.
            of: what the engine is given instead of the machine, which it is still compared with: a slightly wrong
                machine shows what that wrongness does.
        """
        given = of or self.mechanism
        key = _key(engine, given, self.mechanism)
        found = known = self._known.get(key) or (self._kept(key) if self._resume else None)
        if found is None:
            if self._progress:
                self._progress(f"{engine.name} {_short(engine.settings)}")
            found = self._made(engine, given)
        found = self._timed(found, engine, given, repeats)
        if self._folder and found is not known:
            write_text(self._folder / f"{key}.json", found.model_dump_json())
        self._known[key] = found
        return found

    def _made(self, engine: Engine, given: Mechanism) -> Trial:
        settings = engine.settings
        base = Trial(
            engine=engine.name,
            engine_version=engine_class(engine.name).version(),
            preset=engine.preset,
            settings=settings,
            mechanism_hash=given.content_hash,
        )
        try:
            run = self._simulate(engine, self._problem(engine, given))
            found = deviation(run, self.solution, self.end, self._reference(run.t))
            found = found if self._curves else found.model_copy(update=_NO_CURVES)
        except TrebucheckError as error:
            return base.model_copy(update={"message": str(error)})
        except Exception as error:  # a plug-in may raise anything; a study must survive it
            return base.model_copy(update={"message": f"{type(error).__name__}: {error}"})
        took = run.provenance
        return base.model_copy(update={"deviation": found, "steps": took.steps, "wall_times": (took.wall_time,)})

    def _timed(self, trial: Trial, engine: Engine, given: Mechanism, repeats: int) -> Trial:
        """The same trial, timed as often as asked for or for as long as is enough."""
        if trial.message is not None:
            return trial
        walls = list(trial.wall_times)
        with suppress(Exception):  # it did run: that a repeat fails costs a time, not the trial
            while len(walls) < repeats and sum(walls) < _TIMED_FOR:
                walls.append(self._simulate(engine, self._problem(engine, given)).provenance.wall_time)
        return trial if len(walls) == len(trial.wall_times) else trial.model_copy(update={"wall_times": tuple(walls)})

    def _problem(self, engine: Engine, given: Mechanism) -> Problem:
        tail = max(_TAIL, _TAIL_STEPS * (engine.timestep or 0.0))
        return Problem(given, duration=min(self.end + tail, self.solution.problem.duration))

    def _reference(self, t: FloatArray) -> Trajectory:
        """The reference at these times [s], shape (n,)."""
        return self.solution.trajectory(t) if len(t) > _LONGEST_GRID else self._at(t.tobytes())

    def _evaluated(self, times: bytes) -> Trajectory:
        return self.solution.trajectory(np.frombuffer(times))

    def _kept(self, key: str) -> Trial | None:
        if self._folder is None:
            return None
        path = self._folder / f"{key}.json"
        try:
            return Trial.load(path) if path.is_file() else None
        except InputError:
            return None  # a broken file is made anew

    def close(self) -> None:
        """End the worker's process, if it is its own."""
        if not self._shared:
            self._worker.close()

    def __enter__(self) -> Trials:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _key(engine: Engine, given: Mechanism, compared: Mechanism) -> str:
    parts = [
        engine.name,
        engine_class(engine.name).version(),
        engine.settings,
        given.content_hash,
        compared.content_hash,
    ]
    text = json.dumps(parts, sort_keys=True)
    return f"{engine.name}-{hashlib.sha256(text.encode()).hexdigest()[:20]}"


def _short(settings: Mapping[str, JsonValue]) -> str:
    return f"step {settings['timestep']:g} s" if isinstance(settings.get("timestep"), float) else ""
