"""Machines x engines x presets: an error budget each, and each engine's presets side by side.

Stock against tuned shows what each single option buys, from either end.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from pydantic import JsonValue

from ...engines.protocol import Engine
from ...engines.registry import with_options
from ...models.errors import InputError
from ..runs.study import PRESETS, Counter, Study, all_in_order
from ..runs.trials import Trial, Trials, trials_of
from .budget import budget
from .results import Budget, Change, Explanation, Figures, Machine, StockAgainstTuned


def explain(study: Study) -> Explanation:
    """Measure all budgets.

    Args:
        study: mechanisms, engines (all known ones but the reference if None), presets for which a
            budget is made, how engines are run, and the end of the compared motion.

    Raises:
        InputError: a name or a value is not valid, or the end does not come. A run that fails
            raises nothing: it becomes a budget without shares, or a cause that could not be
            measured.
    """
    for preset in study.presets:
        if preset not in PRESETS:
            raise InputError(f"there is no preset {preset!r}; there are: {', '.join(PRESETS)}.")
    # The reference has a budget where it is named: its stock preset differs from the tuned one.
    names = study.measured_engines if study.engines is None else study.every_engine
    engines = {name: {preset: study.engine(name, preset) for preset in PRESETS} for name in names}
    # A part a preset, and one for the presets side by side.
    count = Counter(
        len(study.mechanisms) * len(engines) * (len(list(study.presets)) + 1), study.progress
    )
    with study.worker() as worker:
        moved, failures = trials_of(study, worker)

        def part(trials: Trials, name: str, preset: str | None) -> Budget | StockAgainstTuned:
            made = engines[name]
            count.start(
                f"{trials.mechanism.name}: {name}{f' {preset}' if preset else ', option by option'}"
            )
            return (
                budget(trials, made[preset])
                if preset
                else stock_against_tuned(trials, made["stock"], made["tuned"])
            )

        wanted = list(product(moved, engines, (*study.presets, None)))
        parts = all_in_order(lambda each: part(*each), wanted, study.jobs)
    return Explanation.made_here(
        machines=tuple(map(_machine, moved)),
        budgets=tuple(each for each in parts if isinstance(each, Budget)),
        comparisons=tuple(each for each in parts if isinstance(each, StockAgainstTuned)),
        failures=failures,
        jobs=study.timed_at_once,
    )


def _machine(trials: Trials) -> Machine:
    return Machine(
        model=trials.mechanism.name,
        mechanism=trials.mechanism,
        mechanism_hash=trials.mechanism.content_hash,
        launch_time=trials.runner.launch_time,
        compared_to=trials.runner.end,
        judged_to=trials.end,
    )


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
            stock=stock_value,
            tuned=tuned_value,
            alone=_changed(trials, stock, name, tuned_value),
            back=_changed(trials, tuned, name, stock_value),
        )
        for name, stock_value, tuned_value in _differences(at_stock, tuned.settings)
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
