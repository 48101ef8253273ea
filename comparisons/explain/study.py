"""Machines x engines x presets: an error budget each, and each engine's presets side by side."""

from __future__ import annotations

from ...models.errors import InputError
from ..runs.study import PRESETS, Counter, Study
from ..runs.trials import Trials
from .changes import stock_against_tuned
from .measure import budget
from .results import Budget, Explanation, Machine, StockAgainstTuned


def explain(study: Study) -> Explanation:
    """Measure all budgets.

    Args:
        study: mechanisms (each must launch), engines (all known ones but the reference if None), presets for which a
            budget is made, and how engines are run.

    Raises:
        InputError: a name or a value is not valid, or a machine does not launch. A run that fails raises nothing: it
            becomes a budget without shares, or a cause that could not be measured.
    """
    for preset in study.presets:
        if preset not in PRESETS:
            raise InputError(f"there is no preset {preset!r}; there are: {', '.join(PRESETS)}.")
    engines = {name: {preset: study.engine(name, preset) for preset in PRESETS} for name in study.measured_engines}
    # A part a preset, and one for the presets side by side.
    count = Counter(len(study.mechanisms) * len(engines) * (len(list(study.presets)) + 1), study.progress)
    machines: list[Machine] = []
    budgets: list[Budget] = []
    comparisons: list[StockAgainstTuned] = []
    with study.worker() as worker:
        for mechanism in study.mechanisms:
            trials = Trials(mechanism, worker, study.store)
            machines.append(_machine(trials))
            for name, by_preset in engines.items():
                for preset in study.presets:
                    count.start(f"{mechanism.name}: {name} {preset}")
                    budgets.append(budget(trials, by_preset[preset]))
                count.start(f"{mechanism.name}: {name}, option by option")
                comparisons.append(stock_against_tuned(trials, by_preset["stock"], by_preset["tuned"]))
    return Explanation.made_here(machines=tuple(machines), budgets=tuple(budgets), comparisons=tuple(comparisons))


def _machine(trials: Trials) -> Machine:
    return Machine(
        model=trials.mechanism.name,
        mechanism=trials.mechanism,
        mechanism_hash=trials.mechanism.content_hash,
        launch_time=trials.end,
    )
