"""How far the reference itself is known, for every metric: from its certificate, else by a coarser integration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...models.launch import LAUNCH_ANGLE, Launch
from ...models.problem import Problem
from ...reference.certification.certificate import Uncertainties, certified, covering_certificate
from ...reference.solution import Solution
from ...reference.solver import solve
from .metrics import measure
from .quantities import QUANTITIES
from .results import Metric
from .scales import Scales
from .stretching import Stretching

_COARSE = 1e-12  # tolerance of the second integration: some thirty times the reference's own
_SAFETY = 4.0
_ROUNDING = 64 * float(np.finfo(np.float64).eps)
_DENSE, _LEAST, _MOST = 40, 60, 20_000  # samples in a characteristic time, and of all


def reference_uncertainties(
    solution: Solution,
    end: float,
    scales: Scales,
    thrown: str,
    invariants_to: float | None = None,
    stretching: Stretching | None = None,
) -> Uncertainties:
    """Uncertainty of the reference in each metric, in its unit, by its label; the largest of all subjects by its name.

    The coarser integration is measured as any engine is. Its distance is about its own error,
    thirty times that of the reference unless they agree by chance: hence four times the distance,
    and sixty-four roundings of the scale. What a certificate says of its quantities, up to the
    launch, replaces that.

    Args:
        end: of the compared motion [s].
        scales: of the motion up to there.
        thrown: marker whose launch is measured.
        invariants_to: end of what invariants are compared over [s].
        stretching: of the motion up to there.
    """
    estimated = _estimated(solution, end, scales, thrown, invariants_to, stretching)
    certificate = covering_certificate(solution, invariants_to or end)
    if certificate is None:
        return Uncertainties(source="estimate", values=estimated)
    known = certified(certificate).values
    kept = {label: value for label, value in estimated.items() if label.split(" (")[0] not in known}
    return Uncertainties(source="certificate", values=kept | known)


def _estimated(
    solution: Solution,
    end: float,
    scales: Scales,
    thrown: str,
    invariants_to: float | None,
    stretching: Stretching | None,
) -> dict[str, float]:
    problem, until = solution.problem, invariants_to or end
    margin = min(problem.duration, until * 1.02)  # so that the coarser one's events lie inside, too
    coarse = solve(
        Problem(problem.mechanism, duration=margin, stop_law=problem.stop_law), _COARSE, _COARSE
    )
    n = int(np.clip(_DENSE * until / scales.time, _LEAST, _MOST))
    samples = np.unique(np.concatenate([np.linspace(0.0, margin, n), [end, until]]))
    metrics = measure(
        coarse.trajectory(samples[samples <= margin]), solution, end,
        scales=scales, thrown=thrown, invariants_to=invariants_to, stretching=stretching,
    )  # fmt: skip
    values: dict[str, float] = {}
    for metric in _without_sampling(
        metrics, coarse.launch_at(LAUNCH_ANGLE, thrown), solution, thrown
    ):
        value = _SAFETY * _distance(metric, scales, solution) + _rounding(metric, scales, solution)
        values[metric.label] = value
        values[metric.name] = max(values.get(metric.name, 0.0), value)
    return values


def _without_sampling(
    metrics: Sequence[Metric], launch: Launch | None, solution: Solution, thrown: str
) -> Iterator[Metric]:
    """The metrics with what a solution tells by itself, and a trajectory by its samples: its launch.

    A motion that does not part shows no base error, but a bound of it.
    """
    parted = any(metric.name == "first_parting" and metric.value is not None for metric in metrics)
    expected = solution.launch_at(LAUNCH_ANGLE, thrown)
    located: dict[str, float] = {}
    if launch is not None and expected is not None:
        located = {
            "launch_time": launch.time - expected.time,
            "launch_speed": launch.speed - expected.speed,
        }
    for metric in metrics:
        if metric.name in ("launch_time", "launch_speed"):
            yield metric.model_copy(update={"value": located.get(metric.name)})
        elif metric.name not in ("missing_time", "first_parting") and (
            parted or metric.name != "base_error"
        ):
            yield metric


def _distance(metric: Metric, scales: Scales, solution: Solution) -> float:
    """Between the two integrations; as large as its scale, and so unknown, for an event that only one of them has."""
    if metric.value is None:
        return QUANTITIES[metric.name].scale_of(scales, metric.subject, solution.problem.mechanism)
    return max(
        0.0, abs(metric.value) - (metric.sampling_error or 0.0)
    )  # the reference is not known by samples


def _rounding(metric: Metric, scales: Scales, solution: Solution) -> float:
    quantity = QUANTITIES[metric.name]
    if quantity.scale == "energy":
        return _ROUNDING * scales.largest_energy
    return _ROUNDING * quantity.scale_of(scales, metric.subject, solution.problem.mechanism)
