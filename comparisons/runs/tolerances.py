"""What agreement is asked of each engine, and why just that much.

A bar is a stated need at a stated step. At a longer step it grows with the engine's order of convergence; at a
shorter one it stays (a need does not sharpen because somebody computes more). Table I is what the needs were stated
for; on any other machine, whose speeds and forces are others, ten times as much is allowed. They hold up to the
launch: after it trajectories part exponentially, whatever moves them, and only the energy is still judged, as long as
no impact takes some of it. A tolerance finer than ten times the reference's own uncertainty is refused: what it would
judge is the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...models.mechanism import Mechanism
from ...reference.certification.certificate import refusal
from .results import Machine, Metric, Run

_OTHER_MACHINES = 10.0
_AT_OR_BEFORE_LAUNCH = ("release_time", "launch_time", "launch_speed")


@dataclass(frozen=True)
class Bar:
    """One stated need."""

    engine: str
    preset: str
    metric: str
    value: float
    timestep: float
    """Step the value is stated for [s]."""
    order: int
    """Order in the step with which the value grows."""
    per: str = ""
    """'' for the metric's own unit, 'start' or 'peak' for a multiple of the stop's torque at the start, or at most."""
    subject: str | None = None
    """None: any."""
    model: str | None = None
    """None: any."""
    on_points: bool | None = None
    """Whether it is for stops on points (True), on angles (False), or any (None)."""
    reason: str = ""
    """Why just that much, where it is not the engine's general need."""

    def fits(self, engine: str, preset: str, metric: str, subject: str | None, mechanism: Mechanism) -> bool:
        """Whether it is about this figure."""
        points = {stop.name for stop in mechanism.point_stops}
        return (
            (self.engine, self.preset, self.metric) == (engine, preset, metric)
            and self.subject in (None, subject)
            and self.model in (None, mechanism.name)
            and self.on_points in (None, subject in points)
        )


_NEED = {
    "mujoco": "second order once releases are located, softness scaled with the step",
    "pymunk": "second order: leapfrog read at its own times",
    "exudyn": "second order: trapezoidal rule, index 2",
    "reference": "certified integrator, tolerance 3e-14 per step",
}
_STOCK = {
    "mujoco": "default soft limits: millimetres, whatever the step",
    "pymunk": "first order: positions and speeds half a step apart, joints drift by error_bias",
    "exudyn": "index-3 multipliers are noisy, so a rest may let go early",
    "reference": "tolerances of 1e-9 per step",
}

# The reference is what the others are measured against, so only an invariant can judge it here; its figures are
# held to independent ones in tests/verification.
BARS: tuple[Bar, ...] = (
    Bar("reference", "tuned", "energy_drift", 1e-12, 1.0, 0),
    Bar("mujoco", "tuned", "position_max", 1e-7, 1e-3, 2, subject="projectile"),
    Bar("mujoco", "tuned", "release_time", 1e-8, 1e-3, 2, on_points=False),
    Bar(
        "mujoco",
        "tuned",
        "release_time",
        1e-7,
        1e-3,
        1,
        on_points=True,
        reason="(1 - impedance) x step: a contact's softness lags a changing force by up to a step",
    ),
    Bar("mujoco", "tuned", "launch_speed", 3e-7, 1e-3, 2),
    Bar("mujoco", "tuned", "stop_torque_max", 1e-6, 1e-3, 2, per="start"),
    Bar("mujoco", "tuned", "energy_drift", 1e-9, 1e-3, 2),
    Bar("pymunk", "tuned", "position_max", 2e-3, 1e-3, 2, subject="projectile", model="fixed"),
    Bar("pymunk", "tuned", "position_max", 3e-3, 1e-3, 2, subject="projectile"),
    Bar("pymunk", "tuned", "position_max", 2.5e-5, 1e-4, 2, subject="projectile"),
    Bar("pymunk", "tuned", "stop_torque_max", 1e-4, 1e-3, 2, per="peak"),
    Bar("pymunk", "tuned", "release_time", 1e-5, 1e-3, 2),
    Bar("exudyn", "tuned", "position_max", 1e-5, 1e-4, 2, subject="projectile"),
    Bar("exudyn", "tuned", "stop_torque_max", 2e-3, 1e-4, 2),
    Bar("exudyn", "tuned", "release_time", 1e-7, 1e-4, 2),
    Bar("exudyn", "tuned", "energy_drift", 1e-6, 1e-4, 2),
    Bar("mujoco", "stock", "position_max", 1e-2, 1e-3, 2, subject="projectile"),
    Bar("pymunk", "stock", "position_max", 5e-1, 1e-3, 1, subject="projectile"),
)


def judge(run: Run, machine: Machine, peaks: dict[str, float]) -> tuple[Metric, ...]:
    """The run's metrics, each with its tolerance where there is one.

    Args:
        peaks: largest torque of each stop in the reference [N m].
    """
    found = run.settings.get("timestep")
    step = found if isinstance(found, float) else None
    judged: list[Metric] = []
    for metric in run.metrics:
        if not _can_be_judged(metric, machine):
            judged.append(metric)
            continue
        of = (run.engine, run.preset, metric.name, metric.subject, machine.mechanism)
        bar = None if step is None else bar_for(*of, step)
        judged.append(metric if bar is None or step is None else _with(metric, bar, step, machine, peaks))
    return tuple(judged)


def _can_be_judged(metric: Metric, machine: Machine) -> bool:
    if metric.name.startswith("energy"):
        return machine.impacts == 0
    beyond = machine.launch_time is not None and machine.compared_to > machine.launch_time * (1 + 1e-9)
    return not beyond or metric.name in _AT_OR_BEFORE_LAUNCH


def bar_for(
    engine: str, preset: str, metric: str, subject: str | None, mechanism: Mechanism, step: float
) -> Bar | None:
    """The bar stated for the longest step not above this one; the one for the shortest if all are above.

    Args:
        subject: marker, stop or joint that the metric is about; None: none.
        step: of the engine [s].
    """
    fitting = [bar for bar in BARS if bar.fits(engine, preset, metric, subject, mechanism)]
    if not fitting:
        return None
    below = [bar for bar in fitting if bar.timestep <= step * (1 + 1e-9)]
    if not below:
        return min(fitting, key=lambda bar: bar.timestep)
    longest = max(bar.timestep for bar in below)
    return min((bar for bar in below if bar.timestep == longest), key=lambda bar: bar.value)


def _with(metric: Metric, bar: Bar, step: float, machine: Machine, peaks: dict[str, float]) -> Metric:
    growth = max(1.0, step / bar.timestep) ** bar.order
    allowance = 1.0 if machine.table_one else _OTHER_MACHINES
    tolerance = bar.value * growth * allowance * _scale(bar, metric, machine, peaks)
    need = _NEED if bar.preset == "tuned" else _STOCK
    reason = f"{bar.value:g}{f' of the {bar.per} value' if bar.per else ''} stated at {bar.timestep:g} s"
    if growth > 1:
        reason += f", grown with order {bar.order} to {step:g} s"
    if allowance > 1:
        reason += f", times {allowance:g} away from Table I"
    known = machine.reference_uncertainty
    uncertainty = known.get(f"{metric.name} ({metric.subject})", known.get(metric.name))
    refused = refusal(metric.name, metric.subject, tolerance, uncertainty)
    if refused is not None:
        return metric.model_copy(update={"note": refused})
    return metric.model_copy(update={"tolerance": tolerance, "reason": f"{reason} ({bar.reason or need[bar.engine]})"})


def _scale(bar: Bar, metric: Metric, machine: Machine, peaks: dict[str, float]) -> float:
    if not bar.per or metric.subject is None:
        return 1.0
    start = machine.start_torques.get(metric.subject, 0.0)
    # A rest that never pushes has no torque of its own to measure by: then the largest of any stop.
    peak = peaks.get(metric.subject, 0.0) or max(peaks.values(), default=0.0)
    return start if bar.per == "start" and start > 0 else peak
