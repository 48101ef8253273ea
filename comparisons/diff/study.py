"""Two comparisons of the same mechanisms: which verdicts broke or were mended, and which errors moved.

Runs belong together by model, engine and preset, quantities by name and subject. An error is known
no better than the reference is, and no better than its samples and the rounding of its own steps
allow; less than what both results leave unknown is no movement. A movement beyond that counts from
a factor on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...models.errors import InputError
from ..compare.stored import read_results
from ..compare.study import Comparison
from ..runs.quantities import QUANTITIES
from ..runs.results import COMPARED, Machine, Metric, Outcome, Results, Run
from .changes import Difference, QuantityChange, ReferenceChange, RunChange

FACTOR = 1.1
"""Least factor of a movement: tables show errors with two digits, and a tenth is what their second digit tells."""
_EPS = float(np.finfo(np.float64).eps)
_SAME_END = 1e-6
"""Of the end of a compared motion: largest errors up to ends that differ by less are those of the same motion."""


def diff(
    old: Results | Comparison | str | Path,
    new: Results | Comparison | str | Path,
    factor: float = FACTOR,
) -> Difference:
    """What moved and what broke from one comparison to another.

        >>> import trebucheck as tb
        >>> difference = tb.diff("before", "after/results.json")  # doctest: +SKIP
        >>> difference.passed, difference.to_dataframe().query("moved")  # doctest: +SKIP

    Args:
        old, new: comparisons, their results, or paths of results.json or of the folders that hold
        it.
        factor: least by which an error must change to have moved; above 1.

    Raises:
        InputError: a file is no comparison's of the current format, or the factor is not above 1.
    """
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"factor = {factor!r} must be a finite number above 1.")
    before, after = _results(old), _results(new)
    machines = [{machine.model: machine for machine in each.machines} for each in (before, after)]
    names = {_name(run): None for run in (*before.runs, *after.runs)}
    pairs = [
        (machine, machines[1][model])
        for model, machine in machines[0].items()
        if model in machines[1]
    ]
    return Difference(
        factor=factor,
        runs=tuple(
            _run_change(_run(before, n), _run(after, n), *(m.get(n[0]) for m in machines))
            for n in names
        ),
        references=tuple(
            change for pair in pairs if not _unlike(*pair) for change in _reference_changes(*pair)
        ),
        versions=_versions(before, after),
        conditions=tuple(sentence for pair in pairs for sentence in _conditions(*pair)),
    )


def _results(given: Results | Comparison | str | Path) -> Results:
    if isinstance(given, Results):
        return given
    if isinstance(given, Comparison):
        return given.results
    return read_results(given)


def _name(run: Run) -> tuple[str, str, str]:
    return run.model, run.engine, run.preset


def _run(results: Results, name: tuple[str, str, str]) -> Run | None:
    return next((run for run in results.runs if _name(run) == name), None)


def _versions(old: Results, new: Results) -> dict[str, tuple[str, str]]:
    before, after = _all_versions(old), _all_versions(new)
    return {name: (v, after[name]) for name, v in before.items() if after.get(name, v) != v}


def _all_versions(results: Results) -> dict[str, str]:
    """Of everything that the results name."""
    engines = {
        run.engine: run.engine_version for run in results.runs if run.outcome is not Outcome.ABSENT
    }
    own = {
        "trebucheck": results.trebucheck_version,
        "Python": results.python_version,
        "platform": results.platform,
    }
    return own | engines


def _unlike(old: Machine, new: Machine) -> str:
    """Why motions of the two are not the same motion; '' where they are."""
    if old.mechanism_hash != new.mechanism_hash:
        return f"another mechanism: hash {old.mechanism_hash[:12]}, now {new.mechanism_hash[:12]}"
    if old.thrown != new.thrown:
        return f"another marker is launched: {old.thrown}, now {new.thrown}"
    if old.stop_law is not new.stop_law:
        return f"another law of the stops: {old.stop_law.value}, now {new.stop_law.value}"
    if not math.isclose(old.compared_to, new.compared_to, rel_tol=_SAME_END):
        return f"another end of the motion: {old.compared_to:.6g} s, now {new.compared_to:.6g} s"
    return ""


def _conditions(old: Machine, new: Machine) -> Iterator[str]:
    if old.needs != new.needs:
        asked = [
            ", ".join(f"{name} {text}" for name, text in each.needs.items()) or "none"
            for each in (old, new)
        ]
        yield f"{old.model}: tolerances asked for: {asked[0]}, now {asked[1]}."
    if not _unlike(old, new) and not math.isclose(old.judged_to, new.judged_to, rel_tol=_SAME_END):
        yield f"{old.model}: predictable, and so judged, to {old.judged_to:.6g} s, now to {new.judged_to:.6g} s."


def _run_change(
    old: Run | None, new: Run | None, before: Machine | None, after: Machine | None
) -> RunChange:
    if old is None or new is None or before is None or after is None:
        return RunChange(old, new)
    reason = _unlike(before, after)
    if reason or old.outcome not in COMPARED or new.outcome not in COMPARED:
        return RunChange(old, new, reason)
    labels = {(m.name, m.subject): None for m in (*old.metrics, *new.metrics)}
    changes = (
        _quantity_change(name, subject, (old, before), (new, after)) for name, subject in labels
    )
    own = [change for change in changes if change is not None]
    return RunChange(old, new, reason, (*_model_checks(old, new), *own))


def _quantity_change(
    name: str, subject: str | None, old: tuple[Run, Machine], new: tuple[Run, Machine]
) -> QuantityChange | None:
    """Of a metric that stands for itself and was observed; None of another one."""
    metrics = [run.metric(name, subject) for run, _ in (old, new)]
    found = [metric for metric in metrics if metric is not None]
    if any(metric.follows for metric in found) or not any(metric.observed for metric in found):
        return None
    unknown = sum(
        _unknown(metric, run, machine)
        for metric, (run, machine) in zip(metrics, (old, new), strict=True)
        if metric
    )
    return QuantityChange(new[0].model, new[0].label, metrics[0], metrics[1], unknown)


def _unknown(metric: Metric, run: Run, machine: Machine) -> float:
    """What is not known of an error: by the reference's uncertainty, by the samples, and by rounding of the steps."""
    known = machine.reference_uncertainty
    uncertainty = known.get(metric.label, known.get(metric.name, 0.0))
    return uncertainty + (metric.sampling_error or 0.0) + _rounding(metric, run, machine)


def _rounding(metric: Metric, run: Run, machine: Machine) -> float:
    """Rounding of one part of the scale in each step, random and so as the root of their number, carried on."""
    quantity = QUANTITIES.get(metric.name)
    if quantity is None or (
        quantity.scale in ("stop", "gap") and metric.subject not in machine.scales.torques
    ):
        return 0.0
    scales = (machine.whole_scales if quantity.invariant else None) or machine.scales
    scale = scales.largest_energy if quantity.scale == "energy" else None
    scale = quantity.scale_of(scales, metric.subject, machine.mechanism) if scale is None else scale
    return _EPS * math.sqrt(max(run.steps, 1)) * max(machine.stretching, 1.0) * scale


def _model_checks(old: Run, new: Run) -> Iterator[QuantityChange]:
    """The model-equivalence check as a quantity: its largest value, of its tolerance."""
    checks = [_model_check(run) for run in (old, new)]
    if checks[0] is not None or checks[1] is not None:
        yield QuantityChange(new.model, new.label, checks[0], checks[1], math.inf)


def _model_check(run: Run) -> Metric | None:
    if run.equality is None or not run.equality.checks:
        return None
    values = [
        None if check.value is None else check.value / check.tolerance
        for check in run.equality.checks
    ]
    largest = None if None in values else max(value for value in values if value is not None)
    return Metric(name="model equivalence", value=largest, unit="of its tolerance", tolerance=1.0)


def _reference_changes(old: Machine, new: Machine) -> Iterator[ReferenceChange]:
    """Of figures within what both judge."""
    end = min(old.judged_to, new.judged_to) * (1 + _SAME_END)
    for name, subject, unit in _figures(old, new):
        before, after = (_figure(machine, name, subject, end) for machine in (old, new))
        unknown = _reference_unknown(name, subject, old, before) + _reference_unknown(
            name, subject, new, after
        )
        appeared = (before is None) != (after is None)
        if appeared or (before is not None and after is not None and abs(after - before) > unknown):
            label = name if subject is None else f"{name} ({subject})"
            yield ReferenceChange(old.model, label, unit, before, after, unknown)
    if old.impacts != new.impacts and old.compared_to <= end:
        yield ReferenceChange(old.model, "impacts", "1", old.impacts, new.impacts, 0.0)


def _figures(old: Machine, new: Machine) -> Iterator[tuple[str, str | None, str]]:
    """Name, subject and unit."""
    yield "launch_time", None, "s"
    yield "launch_speed", None, "m/s"
    yield from (
        ("release_time", stop, "s") for stop in old.release_times if stop in new.release_times
    )


def _figure(machine: Machine, name: str, subject: str | None, end: float) -> float | None:
    """None for an event that is not there by the end."""
    time = machine.launch_time if subject is None else machine.release_times[subject]
    if time is None or time > end:
        return None
    return machine.launch_speed if name == "launch_speed" else time


def _reference_unknown(
    name: str, subject: str | None, machine: Machine, value: float | None
) -> float:
    known = machine.reference_uncertainty
    return known.get(f"{name} ({subject})", known.get(name, math.inf)) + _EPS * abs(value or 0.0)
