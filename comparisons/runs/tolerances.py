"""Tolerances of the metrics of a run: a user's need, or a share of the quantity's range.

* A **need** is stated by whoever asks, in the quantity's unit or in parts of its range ('0.1%').
* The **default** is the same for every engine and preset: a thousandth of the quantity's range on
  that problem, and no less than the engine's number format can carry::

      tolerance = max(share * range, floor),  floor = eps * size * sqrt(steps) * stretching

  with eps of single or double precision, the size of the numbers that the quantity is computed
  from, the steps of the run, and the growth of a small error (:mod:`.stretching`). An engine that
  does not locate events has its step beside it.

Where a default tolerance is wider than the range itself, holding it would say nothing: the quantity
is not judged. Nor is it where the tolerance is finer than ten times the reference's own
uncertainty, unless the error is larger than both.

A **claim** is an accuracy that trebucheck states for an assisted run (`engines/<name>/study.py`),
at a step on the fixed machine of Table I up to its launch. It replaces a looser default there. On
another machine, and beyond the launch, it is a hundred times the same part of the range, at the
same part of the characteristic time; it grows with the engine's order in the step and with the
motion's stretching. An engine by itself is held to the default.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, Self

import numpy as np
from pydantic import JsonValue

from ...engines.registry import engine_class, engine_study
from ...engines.study import Tolerance
from ...models.errors import InputError
from ...models.features import features_of
from ...models.library.registry import model
from ...models.mechanism import Mechanism
from ...models.spec import Real, Spec
from ...reference.certification.certificate import REFUSED_BELOW, refusal
from ...reference.solver import solve_to_launch
from .impacts import FOLLOWED
from .metrics import THROWN
from .quantities import QUANTITIES, MetricKind, judged_quantity
from .results import Machine, Metric, Run
from .scales import Scales, scales_until
from .stretching import PARTED, stretching_at

DEFAULT = PARTED
"""Default tolerance in parts of the range."""
_EVERYTHING = "default"
_LOCATES = ("locate_releases", "located_releases")  # options by which engines locate events
_OTHER_MACHINES = 10.0  # allowance beside Table I for a tolerance in plain units
# Safety factor for claims extrapolated from Table I, beyond size, step and growth of errors. It is
# calibrated on random mechanisms with late launches or long rests; the default bounds it.
_CARRIED = 100.0
Source = Literal["need", "claim", "default"]


class ToleranceFile(Spec):
    """Tolerances as a file holds them, for `--tolerances` and continuous integration."""

    tolerances: dict[str, Real | str]


@dataclass(frozen=True)
class Need:
    """One tolerance stated by a user."""

    value: float  # in the metric's unit, or in parts of its scale
    relative: bool
    text: str  # as it was stated

    @classmethod
    def of(cls, name: str, given: float | str) -> Self:
        """Read a number, or a text with or without '%'.

        Raises:
            InputError: it is not a positive finite number.
        """
        text, value = str(given).strip(), math.nan
        with suppress(ValueError):
            value = math.nan if isinstance(given, bool) else float(text.removesuffix("%"))
        if not (math.isfinite(value) and value > 0):
            shown = text if len(text) <= 60 else f"{text[:57]}..."
            raise InputError(
                f"tolerance {name} = {shown!r} must be a positive number, or a percentage such "
                "as 0.1%."
            )
        relative = text.endswith("%")
        return cls(value / 100 if relative else value, relative, text)


@dataclass(frozen=True)
class Needs:
    """Tolerances that a user states."""

    # By name of the metric and its subject; None: any subject
    by_quantity: Mapping[tuple[str, str | None], Need] = field(
        default_factory=dict[tuple[str, str | None], Need]
    )
    default: Need | None = None  # in place of the default of every engine

    @classmethod
    def of(cls, given: Mapping[str, float | str] | None) -> Self:
        """Reads values by quantity ('position'), by its subject ('position:tip'), or 'default'.

        Raises:
            InputError: a quantity is unknown or stated twice, a value is not valid, or the default
                is not relative.
        """
        needs: dict[tuple[str, str | None], Need] = {}
        default: Need | None = None
        for name, value in (given or {}).items():
            need = Need.of(name, value)
            if name == _EVERYTHING:
                if not need.relative:
                    raise InputError(
                        f"tolerance default = {need.text!r} must be a percentage: "
                        "quantities differ."
                    )
                default = need
                continue
            title, _, subject = name.partition(":")
            key = judged_quantity(title).name, subject or None
            if key in needs:
                raise InputError(
                    f"tolerance {name[:60]!r} is stated twice, as {needs[key].text!r} and "
                    f"{need.text!r}."
                )
            needs[key] = need
        return cls(needs, default)

    def need(self, metric: Metric) -> Need | None:
        """Need of a metric; None where none was stated."""
        of_all = self.by_quantity.get((metric.name, None))
        return self.by_quantity.get((metric.name, metric.subject), of_all)

    def refuse_what_only_files_tell(self) -> None:
        """Raises InputError for a tolerance that no run of an engine would be held to."""
        for metric, _ in self.by_quantity:
            if QUANTITIES[metric].of_files:
                title = QUANTITIES[metric].title
                raise InputError(
                    f"tolerance {title!r} is of files only (trebucheck judge): no engine is "
                    "judged by it."
                )

    def refuse_unknown_subjects(self, mechanisms: tuple[Mechanism, ...]) -> None:
        """Raises InputError for a subject that the quantity has on no mechanism."""
        for metric, subject in self.by_quantity:
            quantity = QUANTITIES[metric]
            known = {name for machine in mechanisms for name in quantity.subjects(machine)}
            if subject is not None and subject not in known:
                there, what = "it is of the whole mechanism", "subject"
                if quantity.of:
                    there, what = f"there are {sorted(known)}", quantity.of
                raise InputError(
                    f"tolerance {quantity.title}:{subject[:60]}: there is no such {what}; {there}."
                )

    @property
    def texts(self) -> dict[str, str]:
        """Needs as they were stated, by quantity."""
        stated: dict[str, str] = {}
        for (metric, subject), need in self.by_quantity.items():
            title = QUANTITIES[metric].title
            stated[f"{title}:{subject}" if subject else title] = need.text
        if self.default is not None:
            stated[_EVERYTHING] = self.default.text
        return stated


@dataclass(frozen=True)
class AppliedTolerance:
    """A tolerance of one metric of a run."""

    value: float  # in the metric's unit
    source: Source
    reason: str


@dataclass(frozen=True)
class StatedTolerance:
    """An engine's own tolerance at its step, as it is stated: for Table I."""

    stated: Tolerance
    value: float  # in the metric's unit, or in multiples of the stop's torque if stated `per` one
    reason: str


def tolerance_for(
    engine: str,
    preset: str,
    metric: str,
    subject: str | None,
    mechanism: Mechanism,
    step: float | None,
    *,
    table_one: bool,
) -> StatedTolerance | None:
    """Engine's own tolerance in plain units; None where none is stated, or it has no step.

    Args:
        subject: marker, stop or joint that the metric is about; None: none.
        step: of the engine on Table I [s].
        table_one: whether the mechanism is one of Table I (:func:`is_table_one`); ten times as much
            elsewhere.
    """
    every = engine_study(engine).tolerances
    fitting = [each for each in every if each.fits(preset, metric, subject, mechanism)]
    if not fitting or step is None:
        return None
    # The one of the longest step up to this one, else of the shortest; of several the tightest
    steps = [each.timestep for each in fitting]
    at = max((each for each in steps if each <= step * (1 + 1e-9)), default=min(steps))
    stated = min((each for each in fitting if each.timestep == at), key=lambda each: each.value)
    growth = max(1.0, step / stated.timestep) ** stated.order
    allowance = 1.0 if table_one else _OTHER_MACHINES
    per = f" of the {stated.per} value" if stated.per else ""
    reason = f"{stated.value:g}{per} stated at {stated.timestep:g} s"
    if growth > 1:
        reason += f", grown with order {stated.order} to {step:g} s"
    if allowance > 1:
        reason += f", times {allowance:g} away from Table I"
    return StatedTolerance(stated, stated.value * growth * allowance, f"{reason} ({stated.reason})")


def is_table_one(mechanism: Mechanism) -> bool:
    """Tell whether it is a named mechanism with its default parameters (Table I)."""
    try:
        return model(mechanism.name).content_hash == mechanism.content_hash
    except InputError:
        return False


@cache
def _table_one() -> tuple[Scales, float, Mechanism]:
    """Scales and stretching of the machine that claims are stated for, up to its launch."""
    solution = solve_to_launch(model("fixed"))
    assert solution.launch is not None
    end = solution.launch.time
    return scales_until(solution, end), stretching_at(solution, end), solution.problem.mechanism


def judge(run: Run, machine: Machine, needs: Needs | None = None) -> tuple[Metric, ...]:
    """The run's metrics, each with its tolerance, or with a note that says why it has none."""
    return tuple(_judged(metric, run, machine, needs or Needs()) for metric in run.metrics)


def _judged(metric: Metric, run: Run, machine: Machine, needs: Needs) -> Metric:
    quantity = QUANTITIES.get(metric.name)
    if quantity is None:
        return metric
    if not metric.observed:  # what was asked for and cannot be judged is no agreement
        return metric.model_copy(update={"source": "need"}) if needs.need(metric) else metric
    if quantity.follows is not None:
        return metric.model_copy(update={"follows": quantity.follows})
    scales = machine.scales_for(invariant=quantity.invariant)
    scale = quantity.scale_of(scales, metric.subject, machine.mechanism)
    applied = _applied(metric, quantity, scale, run, machine, needs)
    known = machine.reference_uncertainty
    uncertainty = known.get(metric.label, known.get(metric.name))
    unknown = uncertainty or 0.0
    # A claim is raised to what the reference vouches for, up to the default.
    least = REFUSED_BELOW * unknown
    if applied.source == "claim" and applied.value < least <= DEFAULT * scale:
        reason = f"{applied.reason}; raised to ten times the reference's uncertainty"
        applied = AppliedTolerance(least, "claim", reason)
    refused = refusal(metric.name, metric.subject, applied.value, uncertainty)
    if refused is None and applied.source == "default" and applied.value > scale:
        refused = (
            f"the tolerance {applied.value:.2g} {metric.unit} would be wider than the motion: "
            f"{applied.reason}; it cannot be judged"
        )
    # Whether the error is beyond the tolerance by more than the reference can be wrong. An event
    # that only one of the two has is, unless the reference itself does not know whether it has it.
    surely_broken = unknown < scale
    if metric.value is not None:
        surely_broken = abs(metric.value) > applied.value + REFUSED_BELOW * unknown
    if refused is not None and not surely_broken:
        return metric.model_copy(update={"note": refused})
    return _held_against(metric, applied, DEFAULT * scale)


def _held_against(metric: Metric, applied: AppliedTolerance, most: float) -> Metric:
    """The metric with its tolerance, widened by what its samples leave unknown.

    It is not judged if only that much can decide. A claim may be widened up to `most`.
    """
    unknown, value, reason = metric.sampling_error or 0.0, applied.value, applied.reason
    if unknown and metric.value is not None and abs(metric.value) > value:
        least = max(value, most) if applied.source == "claim" else value
        if unknown > least and abs(metric.value) <= value + unknown:
            note = (
                f"the samples leave {unknown:.2g} {metric.unit} of it unknown, "
                f"more than the tolerance {value:.2g}"
            )
            return metric.model_copy(update={"note": note})
        value += unknown
        reason = f"{reason}; and {unknown:.2g} that the samples leave unknown"
    if metric.left_out:
        reason = f"{reason}; {metric.left_out:.2g} s of jumps or poles are not compared"
    update = {"tolerance": value, "source": applied.source, "reason": reason}
    return metric.model_copy(update=update)


def _applied(
    metric: Metric, quantity: MetricKind, scale: float, run: Run, machine: Machine, needs: Needs
) -> AppliedTolerance:
    """The user's need, else the claim of an assisted run, unless the default is tighter."""
    given, need, unresolved = run.settings.get("timestep"), needs.need(metric), ""
    step = float(given) if isinstance(given, int | float) else None
    if metric.name == "impact_time" and step is not None:
        unresolved = f"; rebounds shorter than {FOLLOWED:g} steps of {step:.3g} s may be missing"
    if need is not None:
        value = need.value * (scale if need.relative else 1.0)
        return AppliedTolerance(value, "need", f"{need.text} was asked for{unresolved}")
    part = DEFAULT if needs.default is None else needs.default.value
    value = part * scale
    reason = f"{100 * part:g} % of the range {scale:.4g} {metric.unit}, for every engine"
    floor = rounding_floor(metric, run, machine)
    if floor > value:
        value = floor
        reason = f"its {_format_of(run)} numbers carry no less; {reason}"
    located = engine_class(run.engine).capabilities.located_releases
    located = located and all(run.settings.get(option, True) for option in _LOCATES)
    if quantity.event and step is not None and not located:
        value += step
        reason += ", and the step in which it does not locate an event"
    reason += unresolved
    claim = None
    if needs.default is None and step is not None:
        claim = _claim(metric, quantity, scale, run, machine, step)
    if claim is not None and floor < claim.value <= value:
        return claim
    if claim is not None:
        reason += f"; the claim is looser, or finer than its numbers: {claim.reason}"
    return AppliedTolerance(value, "default", reason)


def _format_of(run: Run) -> str:
    is_single = engine_study(run.engine).single_precision(run.settings)
    return "single-precision" if is_single else "double-precision"


def machine_epsilon(engine: str, settings: Mapping[str, JsonValue]) -> float:
    """Distance of 1 from the next number of an engine's state with these options."""
    is_single = engine_study(engine).single_precision(settings)
    return float(np.finfo(np.float32 if is_single else np.float64).eps)


def rounding_floor(metric: Metric, run: Run, machine: Machine) -> float:
    """Least error that the numbers of an engine can carry, in the metric's unit.

    One rounding error of the numbers that the quantity is computed from in each step, a random
    walk, carried on by the motion.
    """
    quantity = QUANTITIES[metric.name]
    if quantity.scale in ("stop", "gap") and metric.subject not in machine.scales.torques:
        return 0.0
    scales = machine.scales_for(invariant=quantity.invariant)
    size = quantity.size_of(scales, metric.subject, machine.mechanism)
    eps = machine_epsilon(run.engine, run.settings)
    return eps * size * math.sqrt(max(run.steps, 1)) * max(machine.stretching, 1.0)


def _claim(
    metric: Metric, quantity: MetricKind, scale: float, run: Run, machine: Machine, step: float
) -> AppliedTolerance | None:
    """The engine's own, carried from Table I to this machine.

    Claims are stated for motions without impacts, loops and further elements, and up to the
    predictability horizon.
    """
    unlike = machine.impacts or machine.mechanism.loop_joints or features_of(machine.mechanism)
    if unlike or (quantity.invariant and machine.whole_scales is not None):
        return None
    metric_of_run = run.engine, run.preset, metric.name, metric.subject, machine.mechanism
    scales, usual, mechanism = _table_one()
    # Whether no more is judged than the motion that claims are stated for
    launch = machine.launch_time if machine.thrown == THROWN else None
    to_the_launch = launch is not None and machine.judged_to <= launch * (1 + 1e-9)
    if machine.table_one and (machine.stretching <= usual or to_the_launch):
        stated = tolerance_for(*metric_of_run, step, table_one=True)
        if stated is None:
            return None
        value = stated.value
        if stated.stated.per and metric.subject is not None:
            start = machine.start_torques.get(metric.subject, 0.0)
            at_start = stated.stated.per == "start" and start > 0
            value *= start if at_start else machine.scales.torques[metric.subject]
        return AppliedTolerance(value, "claim", stated.reason)
    step = step * scales.time / machine.scales.time
    stated = tolerance_for(*metric_of_run, step, table_one=True)
    if stated is None:
        return None
    part = stated.value
    if not stated.stated.per:
        # The scale on the machine that claims are stated for is that of its least closed stop.
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        stop = min(closed, key=lambda name: scales.torques[name])
        part /= quantity.scale_of(scales, stop, mechanism)
    growth = max(1.0, machine.stretching / usual)
    reason = (
        f"{stated.reason} on Table I, to its launch; the same part of the scale, times "
        f"{_CARRIED * growth:.3g}"
    )
    return AppliedTolerance(part * scale * _CARRIED * growth, "claim", reason)
