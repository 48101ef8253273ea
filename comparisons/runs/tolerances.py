"""What agreement is asked of an engine on a mechanism, and why just that much.

A tolerance is a stated need at a stated step; each engine states its own (`engines/<name>/study.py`). At a longer step
it grows with the engine's order of convergence; at a shorter one it stays (a need does not sharpen because somebody
computes more). Table I is what the needs were stated for; on any other machine, whose speeds and forces are others,
ten times as much is allowed. They hold up to the launch: after it trajectories diverge exponentially, whatever moves
them, and only the energy is still judged, as long as no impact takes some of it. A tolerance finer than ten times the
reference's own uncertainty is refused: what it would judge is the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...engines.registry import engine_study
from ...engines.study import Tolerance
from ...models.errors import InputError
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...reference.certification.certificate import refusal
from .results import Machine, Metric, Run

_OTHER_MACHINES = 10.0
_AT_OR_BEFORE_LAUNCH = ("release_time", "launch_time", "launch_speed")


@dataclass(frozen=True)
class AppliedTolerance:
    """A stated tolerance at an engine's step on a mechanism."""

    stated: Tolerance
    value: float
    """In the metric's unit, or in multiples of the stop's torque where it is stated `per` one."""
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
) -> AppliedTolerance | None:
    """The tolerance of a metric; None where none is stated, or the engine has no step.

    That stated for the longest step not above the engine's own counts; that for the shortest one if all are above.

    Args:
        engine: its name.
        preset: of the engine.
        metric: its name.
        subject: marker, stop or joint that the metric is about; None: none.
        mechanism: that the engine moves.
        step: of the engine [s].
        table_one: whether the mechanism is one of Table I (:func:`is_table_one`).
    """
    fitting = [each for each in engine_study(engine).tolerances if each.fits(preset, metric, subject, mechanism)]
    if not fitting or step is None:
        return None
    shortest = min(each.timestep for each in fitting)
    at = max((each.timestep for each in fitting if each.timestep <= step * (1 + 1e-9)), default=shortest)
    stated = min((each for each in fitting if each.timestep == at), key=lambda each: each.value)
    growth = max(1.0, step / stated.timestep) ** stated.order
    allowance = 1.0 if table_one else _OTHER_MACHINES
    reason = f"{stated.value:g}{f' of the {stated.per} value' if stated.per else ''} stated at {stated.timestep:g} s"
    if growth > 1:
        reason += f", grown with order {stated.order} to {step:g} s"
    if allowance > 1:
        reason += f", times {allowance:g} away from Table I"
    return AppliedTolerance(stated, stated.value * growth * allowance, f"{reason} ({stated.reason})")


def is_table_one(mechanism: Mechanism) -> bool:
    """Whether it is a named mechanism with the parameters that it has unless others are given (Table I)."""
    try:
        return model(mechanism.name).content_hash == mechanism.content_hash
    except InputError:
        return False


def judge(run: Run, machine: Machine, peaks: dict[str, float]) -> tuple[Metric, ...]:
    """The run's metrics, each with its tolerance where there is one.

    Args:
        peaks: largest torque of each stop in the reference [N m].
    """
    given = run.settings.get("timestep")
    step = given if isinstance(given, float) else None

    def applied(metric: Metric) -> AppliedTolerance | None:
        if not _can_be_judged(metric, machine):
            return None
        of = (run.engine, run.preset, metric.name, metric.subject, machine.mechanism)
        return tolerance_for(*of, step, table_one=machine.table_one)

    tolerances = [(metric, applied(metric)) for metric in run.metrics]
    return tuple(metric if one is None else _with(metric, one, machine, peaks) for metric, one in tolerances)


def _can_be_judged(metric: Metric, machine: Machine) -> bool:
    if metric.name.startswith("energy"):
        return machine.impacts == 0
    beyond = machine.launch_time is not None and machine.compared_to > machine.launch_time * (1 + 1e-9)
    return not beyond or metric.name in _AT_OR_BEFORE_LAUNCH


def _with(metric: Metric, applied: AppliedTolerance, machine: Machine, peaks: dict[str, float]) -> Metric:
    tolerance = applied.value * _scale(applied.stated, metric, machine, peaks)
    known = machine.reference_uncertainty
    uncertainty = known.get(f"{metric.name} ({metric.subject})", known.get(metric.name))
    refused = refusal(metric.name, metric.subject, tolerance, uncertainty)
    if refused is not None:
        return metric.model_copy(update={"note": refused})
    return metric.model_copy(update={"tolerance": tolerance, "reason": applied.reason})


def _scale(stated: Tolerance, metric: Metric, machine: Machine, peaks: dict[str, float]) -> float:
    if not stated.per or metric.subject is None:
        return 1.0
    start = machine.start_torques.get(metric.subject, 0.0)
    # A rest that never pushes has no torque of its own to measure by: then the largest of any stop.
    peak = peaks.get(metric.subject, 0.0) or max(peaks.values(), default=0.0)
    return start if stated.per == "start" and start > 0 else peak
