"""Trials: one machine, many settings of its engines, each run once and kept.

Convergence studies, error budgets and advice all ask for the same thing: this engine with these options, how far from
the reference, at what cost. A trial is remembered by engine and options, on disk if a folder is given, so that an
interrupted study goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from typing import Annotated

from pydantic import Field, JsonValue

from ...engines.protocol import Engine
from ...engines.registry import engine_class
from ...models.mechanism import Mechanism
from ...models.spec import Real, Spec
from .deviation import Deviation, deviation
from .runner import Runner, failure
from .store import Store
from .worker import Worker

_TIMED_FOR = 0.5  # [s] a longer run averages over what disturbs it, and one run of it is timing enough
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
        metrics = {} if self.deviation is None else self.deviation.metrics
        return max((value for label, value in metrics.items() if label.startswith("stop_torque_max")), default=None)


class Trials:
    """Runs engines on one machine, up to the reference's launch, and remembers the results.

    Args:
        mechanism: the machine; it must launch.
        worker: the process to run in; None: this one. Its owner closes it.
        store: where trials are kept as JSON; None: only in memory.
        curves: keep the deviations as functions of time; without them a trial is its metrics alone, and small.

    Raises:
        InputError: the machine's reference does not launch.
    """

    def __init__(
        self, mechanism: Mechanism, worker: Worker | None = None, store: Store | None = None, *, curves: bool = True
    ) -> None:
        self.runner = Runner(mechanism, worker)
        self.runner.refuse_no_launch()
        self.mechanism, self.solution, self.end = mechanism, self.runner.solution, self.runner.end
        self._store, self._curves = store, curves
        self._known: dict[str, Trial] = {}

    def trial(self, engine: Engine, repeats: int = 1, of: Mechanism | None = None) -> Trial:
        """An engine's trial, run if it is not known yet (or timed less often than asked for).

        Args:
            engine: with its options.
            repeats: how often it is timed; less often where its runs are long.
            of: what the engine is given instead of the machine, which it is still compared with: a slightly wrong
                machine shows what that wrongness does.
        """
        given = of or self.mechanism
        key = _key(engine, given, self.mechanism)
        known = self._known.get(key) or (self._store.record(key, Trial) if self._store else None)
        trial = self._timed(known or self._run(engine, given), engine, given, repeats)
        if self._store and trial is not known:
            self._store.keep_record(key, trial)
        self._known[key] = trial
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
            measured = deviation(run, self.solution, self.end, self.runner.reference(run.t))
        except Exception as error:
            return base.model_copy(update={"message": failure(error)[1]})
        took = run.provenance
        measured = measured if self._curves else measured.model_copy(update=_NO_CURVES)
        return base.model_copy(update={"deviation": measured, "steps": took.steps, "wall_times": (took.wall_time,)})

    def _timed(self, trial: Trial, engine: Engine, given: Mechanism, repeats: int) -> Trial:
        """The same trial, timed as often as asked for or for as long as is enough."""
        if trial.message is not None:
            return trial
        walls = list(trial.wall_times)
        with suppress(Exception):  # it did run: that a repeat fails costs a time, not the trial
            while len(walls) < repeats and sum(walls) < _TIMED_FOR:
                walls.append(self.runner.simulate(engine, given).provenance.wall_time)
        return trial if len(walls) == len(trial.wall_times) else trial.model_copy(update={"wall_times": tuple(walls)})


def _key(engine: Engine, given: Mechanism, compared: Mechanism) -> str:
    version = engine_class(engine.name).version()
    parts = [engine.name, version, engine.settings, given.content_hash, compared.content_hash]
    text = json.dumps(parts, sort_keys=True)
    return f"{engine.name}-{hashlib.sha256(text.encode()).hexdigest()[:20]}"
