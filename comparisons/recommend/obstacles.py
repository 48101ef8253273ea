"""What stands in the way, read off the errors over the steps: nothing here knows any engine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .cases import Case
from .results import Obstacle
from .search import Search, Sweep

_RISES = 2.0  # times the least error: more than an error that merely scatters with where a release falls in a step
_FLAT = 1.5  # times the least error: within it, it does not depend on the step
_FALLS = 0.5  # order in the step, at the shortest steps: half of what the least accurate method has


@dataclass(frozen=True)
class Verdict:
    """Why an error does not fall further."""

    obstacle: Obstacle
    sentence: str


def classify(steps: Sequence[float], errors: Sequence[float], allowed: float, unit: str) -> Verdict:
    """Why an error stays above what is allowed.

    Args:
        steps: [s], the longest first; at least two.
        errors: at these steps, in `unit`; infinite where the run failed.
    """
    kept = [(h, e) for h, e in zip(steps, errors, strict=True) if math.isfinite(e) and e > 0]
    if len(kept) < 2:
        return Verdict(Obstacle.FAILURE, "the runs failed")
    best = min(range(len(kept)), key=lambda i: kept[i][1])
    least = kept[best][1]
    after = kept[best:]
    if after[-1][1] > _RISES * least:
        return _rounding(after, unit)
    flat = [h for h, e in kept if e <= _FLAT * least]
    if len(flat) == len(kept):
        span = f"from {kept[0][0]:g} s to {kept[-1][0]:g} s"
        return Verdict(Obstacle.CONSTANT, f"it does not depend on the step ({least:.1e} {unit} {span}): another option "
                       f"or the method itself sets it")  # fmt: skip
    order = _slope(kept[-2:])
    if order >= _FALLS:
        return _falling(kept, order, allowed, unit)
    return Verdict(
        Obstacle.FLOOR,
        f"it no longer falls below a step of {flat[0]:g} s: a floor of {least:.1e} {unit} is met",
    )


def _rounding(after: Sequence[tuple[float, float]], unit: str) -> Verdict:
    (step, least), (last, grown) = after[0], after[-1]
    return Verdict(
        Obstacle.ROUNDING,
        f"it grows again below a step of {step:g} s ({least:.1e} {unit}, but {grown:.1e} {unit} at {last:g} s, "
        f"as 1/step^{-_slope(after):.1f}), as rounding or what is left by the solver's iteration does",
    )


def _falling(
    kept: Sequence[tuple[float, float]], order: float, allowed: float, unit: str
) -> Verdict:
    step, error = kept[-1]
    needed = step * (allowed / error) ** (1 / order)
    return Verdict(
        Obstacle.STEP,
        f"it is still falling at the shortest step tried ({error:.1e} {unit} at {step:g} s, order {order:.1f}); by "
        f"that order some {needed:.1g} s would do, which was not measured",
    )


def _slope(points: Sequence[tuple[float, float]]) -> float:
    logs = np.log(np.array(points))
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def explain(search: Search, sweeps: Sequence[Sweep]) -> Verdict:
    """Why none of an engine's sets reaches what is asked: by the best of them, on the machine it did worst on.

    The whole ladder of steps is measured for it.
    """
    sweep = min(sweeps, key=lambda sweep: sweep.best.worst)
    level = sweep.best
    case = search.cases[level.hardest]
    messages = [
        trial.message
        for level in sweep.levels.values()
        for trial in level.trials.values()
        if trial.message
    ]
    if not math.isfinite(level.worst):
        return Verdict(Obstacle.FAILURE, messages[0] if messages else "a stop does not release")
    measured = search.over_all_steps(sweep, level.hardest)
    steps, errors = [h for h, _ in measured], [case.errors(trial) for _, trial in measured]
    hardest_errors = case.errors(level.trials[level.hardest])
    # The quantity that is furthest off; two of them have two causes, but the first must go before
    # the second shows.
    name = max(case.allowed, key=lambda name: hardest_errors[name] / case.allowed[name])
    along = [error[name] for error in errors]
    verdict = classify(steps, along, case.allowed[name], case.unit(name))
    least, step = min([(hardest_errors[name], level.step), *zip(along, steps, strict=True)])
    reached = _reached(sweep, case, name, least, step, level.hardest)
    return Verdict(verdict.obstacle, f"{reached}; {verdict.sentence}.")


def _reached(sweep: Sweep, case: Case, name: str, error: float, step: float, index: int) -> str:
    where = "this machine" if index == 0 else "its hardest neighbour"
    unit, allowed = case.unit(name), case.allowed[name]
    return (
        f"the best, {sweep.options.name!r} at {step:g} s, has an error of the {name} of {error:.1e} {unit} on {where}"
        f", where {allowed:.1e} {unit} are asked"
    )
