"""Machines x engines x presets: a budget each, and each engine's presets side by side."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_names
from ...models.errors import InputError
from ...models.mechanism import Mechanism
from ..runs.trials import Progress, Trials
from .changes import stock_against_tuned
from .measure import budget
from .results import Budget, Explanation, Machine, StockAgainstTuned

_REFERENCE = "reference"
_PRESETS = ("tuned", "stock")

Started = Callable[[str, int, int], None]
"""Called before each part with its description, the number done and the number of all."""


@dataclass(frozen=True)
class Study:
    """What is to be explained, and how it is run.

    Args:
        machines: each must launch.
        engines: names; all but the reference if None. Those not installed are left out, unless named.
        presets: of 'tuned' and 'stock'.
        timestep: of every engine [s]; each preset's own if None.
        folder: where trials are kept; None: only in memory.
        resume: take kept trials again.
        timeout: longest wait for one run [s].
        isolate: run in a process of its own.
    """

    machines: Sequence[Mechanism]
    engines: Sequence[str] | None = None
    presets: Sequence[str] = _PRESETS
    timestep: float | None = None
    folder: Path | None = None
    resume: bool = False
    timeout: float = 600.0
    isolate: bool = True

    def explain(self, started: Started | None = None, progress: Progress | None = None) -> Explanation:
        """Measure all budgets.

        Args:
            started: called before each budget or comparison.
            progress: called before each run.

        Raises:
            InputError: a name or a value is not valid, or a machine does not launch. A run that fails raises
                nothing: it becomes a budget without shares, or a cause that could not be measured.
        """
        if not self.timeout > 0:
            raise InputError(f"timeout = {self.timeout!r} s must be positive.")
        made = self._made()
        # A part a preset, and one for the presets side by side.
        every = len(self.machines) * len(made) * (len(self.presets) + 1)
        count = _Count(started, every)
        machines: list[Machine] = []
        budgets: list[Budget] = []
        comparisons: list[StockAgainstTuned] = []
        for mechanism in self.machines:
            with self._trials(mechanism, progress) as trials:
                machines.append(_machine(trials))
                for name, of in made.items():
                    for preset in self.presets:
                        count.next(f"{mechanism.name}: {name} {preset}")
                        budgets.append(budget(trials, of[preset]))
                    count.next(f"{mechanism.name}: {name}, option by option")
                    comparisons.append(stock_against_tuned(trials, of["stock"], of["tuned"]))
        return _explanation(machines, budgets, comparisons)

    def _trials(self, mechanism: Mechanism, progress: Progress | None) -> Trials:
        return Trials(
            mechanism,
            folder=self.folder,
            resume=self.resume,
            isolate=self.isolate,
            timeout=self.timeout,
            progress=progress,
        )

    def _made(self) -> dict[str, dict[str, Engine]]:
        for preset in self.presets:
            if preset not in _PRESETS:
                raise InputError(f"there is no preset {preset!r}; there are: {', '.join(_PRESETS)}.")
        options: dict[str, Any] = {} if self.timestep is None else {"timestep": self.timestep}
        return {name: {p: engine(name, p, **options) for p in _PRESETS} for name in self._names()}

    def _names(self) -> list[str]:
        if self.engines is not None:
            return list(dict.fromkeys(self.engines))
        return [name for name in engine_names() if name != _REFERENCE and engine_class(name).is_installed()]


class _Count:
    def __init__(self, started: Started | None, every: int) -> None:
        self._started, self._every, self._done = started, every, 0

    def next(self, what: str) -> None:
        if self._started:
            self._started(what, self._done, self._every)
        self._done += 1


def _machine(trials: Trials) -> Machine:
    return Machine(
        model=trials.mechanism.name,
        mechanism=trials.mechanism,
        mechanism_hash=trials.mechanism.content_hash,
        launch_time=trials.end,
    )


def _explanation(machines: list[Machine], budgets: list[Budget], comparisons: list[StockAgainstTuned]) -> Explanation:
    from ...version import __version__

    return Explanation(
        trebucheck_version=__version__,
        python_version=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        machines=tuple(machines),
        budgets=tuple(budgets),
        comparisons=tuple(comparisons),
    )
