"""Stock against tuned: what each single option buys, from either end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import JsonValue

from ...engines.protocol import Engine
from ...engines.registry import with_options
from ...models.errors import InputError
from ..runs.trials import Trial, Trials
from .results import Change, Figures, StockAgainstTuned

_REPEATS = 3  # timed runs of each setting: a median of fewer says little of runs of some hundredths of a second


def stock_against_tuned(trials: Trials, stock: Engine, tuned: Engine) -> StockAgainstTuned:
    """Set an engine's two presets side by side, at the stock one's step, and change one option at a time."""
    at_stock = stock.settings
    step = at_stock.get("timestep")
    if step is not None:
        tuned = with_options(tuned, {"timestep": step})
    changes = [
        Change(
            option=name,
            stock=ours,
            tuned=theirs,
            alone=_changed(trials, stock, name, theirs),
            back=_changed(trials, tuned, name, ours),
        )
        for name, ours, theirs in _differences(at_stock, tuned.settings)
    ]
    return StockAgainstTuned(
        model=trials.mechanism.name,
        engine=stock.name,
        timestep=float(step) if isinstance(step, int | float) else None,
        force_unit=trials.mechanism.force_unit,
        stock=_measured(trials, stock),
        tuned=_measured(trials, tuned),
        changes=tuple(changes),
    )


def _differences(
    stock: dict[str, JsonValue], tuned: dict[str, JsonValue]
) -> Iterator[tuple[str, JsonValue, JsonValue]]:
    for name, value in stock.items():
        if name in tuned and tuned[name] != value:
            yield name, value, tuned[name]


def _changed(trials: Trials, engine: Engine, option: str, value: JsonValue) -> Figures:
    try:
        return _measured(trials, with_options(engine, {option: value}))
    except InputError as error:
        return Figures(message=str(error))


def _measured(trials: Trials, engine: Engine) -> Figures:
    return figures_of(trials.trial(engine, repeats=_REPEATS))


def figures_of(trial: Trial) -> Figures:
    """The figures of a trial that are compared."""
    if trial.deviation is None:
        return Figures(message=trial.message or "it did not run")
    late = [abs(time) for time in trial.deviation.release_times.values() if time is not None]
    return Figures(
        position=trial.position,
        torque=trial.torque,
        release=max(late, default=None),
        wall_time=float(np.median(trial.wall_times)),
    )
