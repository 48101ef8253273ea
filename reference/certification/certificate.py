"""Uncertainty of the reference's quantities: published certificates, and what follows from them.

A certificate is committed for each named machine (`certificates/`, made by `trebucheck certify`);
for any other an estimate costs one more, coarser, integration. Both decide which tolerances can be
checked against the reference.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...models.problem import LONGEST, Problem
from ...models.shown import Reported
from ...models.spec import NonNegative, Real, Spec
from ..solution import Solution
from ..solver import solve

FORMAT = "trebucheck-certificate-1"
SCHEMA = "certificate.schema.json"
REFUSED_BELOW = 10.0
"""Least tolerance, in uncertainties of the reference, of which a tenth would be its own error."""

# Tolerance of the estimate's second integration: some thirty times the reference's own.
_COARSE = 1e-12
_SAMPLES = 60
_BEYOND = 1.02  # times the compared motion: so that the coarser one's events lie inside, too
_SAFETY = 4.0
_PROJECTILE = "projectile"
# Of the sums behind a value, relative to the largest of its kind.
_ROUNDING = 64 * float(np.finfo(np.float64).eps)


class Computation(Spec):
    """One way the figures were computed."""

    name: str
    formulation: str
    integrator: str
    tolerance: Real | None = Field(
        default=None, description="local error bound of the integrator; None: to the last digit"
    )
    independent: bool = Field(
        description="whether it is the tightest of its kind, or a coarser rung of its ladder"
    )


class Figure(Spec):
    """One figure: best value, uncertainty, and what each computation found."""

    name: str
    subject: str | None = Field(default=None, description="stop, coordinate or marker it is about")
    at: str = Field(description="the instant or event it belongs to")
    time: Real | None = Field(default=None, description="the instant where it is a fixed one [s]")
    unit: str
    value: Real
    uncertainty: NonNegative
    values: dict[str, Real] = Field(description="by name of computation")
    proved_value: str | None = Field(
        default=None, description="of an enclosure in ball arithmetic, decimal digits"
    )
    proved_radius: str | None = Field(
        default=None, description="the exact value is within it of the proved one"
    )
    not_proved: str | None = Field(default=None, description="why there is no such enclosure")

    @model_validator(mode="after")
    def _within_proof(self) -> Figure:
        if self.proved_value is None or self.proved_radius is None:
            return self
        off = abs(Fraction(self.value) - Fraction(self.proved_value))
        if off > Fraction(self.uncertainty) + Fraction(self.proved_radius):
            raise ValueError(
                f"{self.label} = {self.value!r} {self.unit} with an uncertainty of "
                f"{self.uncertainty:.1e} is contradicted by a proof, which finds "
                f"{self.proved_value} with a radius of {self.proved_radius}"
            )
        return self

    def with_fields(self, **fields: str | None) -> Figure:
        """The same figure with other fields; InputError if a proof contradicts it."""
        changed: dict[str, Any] = {**self.model_dump(), **fields}
        return Figure(**changed)

    @property
    def label(self) -> str:
        """Name, subject and instant in one text."""
        subject = "" if self.subject is None else f" ({self.subject})"
        return f"{self.name}{subject}, {self.at}" if self.at else f"{self.name}{subject}"

    @property
    def texts(self) -> tuple[str, str]:
        """Value and uncertainty as printed: two digits of the uncertainty, as many of the value."""
        if self.uncertainty == 0:
            return repr(self.value), "0"
        decimals = 1 - math.floor(math.log10(self.uncertainty))
        return f"{self.value:.{max(decimals, 0)}f}", f"{self.uncertainty:.1e}"


class Certificate(Reported, Spec):
    """Figures of one machine."""

    format: Literal["trebucheck-certificate-1"] = FORMAT
    model: str
    mechanism_hash: str
    command: str = Field(description="what makes this file again")
    rule: str = Field(description="how uncertainties follow from the computations")
    versions: dict[str, str]
    computations: tuple[Computation, ...]
    absent: tuple[str, ...] = Field(
        default=(), description="computations that could not be made here, and why"
    )
    figures: tuple[Figure, ...]

    def headline(self) -> str:
        """Tell how many figures, from how many computations."""
        number = sum(computation.independent for computation in self.computations)
        return (
            f"Certificate of {self.model!r}: {len(self.figures)} figures from {number} independent "
            "computations"
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """A figure a row."""
        for figure in self.figures:
            yield figure.model_dump(exclude={"values"})

    def figure(self, name: str, subject: str | None = None, at: str | None = None) -> Figure | None:
        """The first figure of that name (and subject, and instant); None if there is none."""
        for figure in self.figures:
            wanted = subject in (None, figure.subject) and at in (None, figure.at)
            if figure.name == name and wanted:
                return figure
        return None


class Uncertainties(Spec):
    """Uncertainty of the reference, by the metric it enters.

    Keys are a metric's name, or 'name (subject)'; the bare name holds the largest of its subjects.
    """

    source: str = Field(description="'certificate', or 'estimate'")
    values: dict[str, NonNegative]

    def of(self, metric: str, subject: str | None = None) -> float | None:
        """Uncertainty in the metric's unit; None where nothing is known."""
        return self.values.get(f"{metric} ({subject})", self.values.get(metric))


@cache
def committed_certificates() -> dict[str, Certificate]:
    """The package's certificates, by hash of their mechanism."""
    certificates: dict[str, Certificate] = {}
    folder = files(__name__.rpartition(".")[0]) / "certificates"
    for entry in folder.iterdir() if folder.is_dir() else ():
        if entry.name.endswith(".json") and entry.name != SCHEMA:
            certificate = Certificate.from_json(entry.read_bytes())
            certificates[certificate.mechanism_hash] = certificate
    return certificates


def load_certificate(mechanism: Mechanism) -> Certificate | None:
    """The committed certificate of exactly this mechanism, by its content; None without one."""
    return committed_certificates().get(mechanism.content_hash)


def reference_uncertainty(solution: Solution, end: float | None = None) -> Uncertainties:
    """Uncertainty of the reference: from the certificate if there is one, else estimated.

    Args:
        end: end of the compared motion [s]; a certificate covers times up to the launch only.
    """
    certificate = covering_certificate(solution, end)
    return certified(certificate) if certificate else estimate_uncertainty(solution, end)


def covering_certificate(solution: Solution, end: float | None = None) -> Certificate | None:
    """The mechanism's committed certificate, if it covers the motion up to `end` [s]."""
    launch = solution.launch
    if launch is None or (end is not None and end > launch.time * (1 + 1e-9)):
        return None
    return load_certificate(solution.problem.mechanism)


_METRICS = {
    "release_time": "release_time",
    "launch_time": "launch_time",
    "launch_speed": "launch_speed",
    "stop_torque": "stop_torque_max",
    "position_x": "position_max",
    "position_y": "position_max",
    "total_energy": "energy_drift",
}
"""Metric that a figure's uncertainty enters, by name of the figure."""


def certified(certificate: Certificate) -> Uncertainties:
    """A certificate's uncertainties by metric: the largest over the instants certified."""
    uncertainties: dict[str, float] = defaultdict(float)
    for figure in certificate.figures:
        metric = _METRICS.get(figure.name)
        if metric is None:
            continue
        value, keys = figure.uncertainty, [metric, f"{metric} ({figure.subject})"]
        if metric == "energy_drift":  # relative
            value = value / abs(figure.value) if figure.value else 0.0
        elif metric == "position_max":
            # x and y together: their uncertainties add at most as a sum does. Only the projectile's
            # positions are certified; it is last in the chain, so they bound every marker's.
            value, keys = value * math.sqrt(2), [metric]
        for key in keys:
            uncertainties[key] = max(uncertainties[key], value)
    return Uncertainties(source="certificate", values=dict(uncertainties))


def estimate_uncertainty(solution: Solution, end: float | None = None) -> Uncertainties:
    """An estimate for any machine, at the cost of one more integration with a coarser tolerance.

    The difference of the two is about the error of the *coarser*, thirty times looser in tolerance,
    and so well above that of the finer unless they agree by chance. Against that: four times the
    difference, for a time the largest of all events, for a speed the largest along the motion, and
    sixty-four roundings of the largest value of the kind. An event that only one of the two has is
    unknown: its uncertainty is as large as what it is of.

    Args:
        solution: the reference's own.
        end: end of the compared motion [s]; the launch, or the solution's end, if left out.
    """
    problem, launch = solution.problem, solution.launch
    end = end if end is not None else (launch.time if launch else problem.duration)
    horizon = min(_BEYOND * max(end, launch.time if launch else 0.0), LONGEST)
    other = solve(
        Problem(problem.mechanism, duration=horizon, stop_law=problem.stop_law), _COARSE, _COARSE
    )
    t = np.linspace(0.0, min(end, problem.duration), _SAMPLES)
    fine, coarse = solution.trajectory(t), other.trajectory(t)
    uncertainties: dict[str, float] = {}

    def enter(metric: str, subject: str | None, first: FloatArray, second: FloatArray) -> None:
        value = float(_SAFETY * np.abs(first - second).max() + _ROUNDING * np.abs(first).max())
        if subject is not None:
            uncertainties[f"{metric} ({subject})"] = value
        uncertainties[metric] = max(uncertainties.get(metric, 0.0), value)

    for name, marker in fine.markers.items():
        enter("position_max", name, marker.position, coarse.marker(name).position)
    for name, torque in fine.stop_torques.items():
        enter("stop_torque_max", name, torque, coarse.stop_torque(name))
    start = abs(float(fine.total_energy[0]))
    if start > 0:
        size = float((np.abs(fine.kinetic_energy) + np.abs(fine.potential_energy)).max())
        # An energy is compared with that of the start, a closed form: only rounding is in it.
        uncertainties["energy_drift"] = float(np.finfo(np.float64).eps) * size / start
    uncertainties |= _events(solution, other, end)
    if launch is not None and other.launch is not None:
        velocities = fine.marker(_PROJECTILE).velocity, coarse.marker(_PROJECTILE).velocity
        enter("launch_speed", None, *(np.linalg.norm(v, axis=1) for v in velocities))
    elif launch is not None:
        uncertainties["launch_speed"] = launch.speed
    return Uncertainties(source="estimate", values=uncertainties)


def _events(fine: Solution, coarse: Solution, end: float) -> dict[str, float]:
    """Uncertainty [s] of each release and of the launch."""
    pairs: dict[str, tuple[float | None, float | None]] = {}
    for name, time in fine.release_times.items():
        pairs[f"release_time ({name})"] = time, coarse.release_times[name]
    launch, other = (None if s.launch is None else s.launch.time for s in (fine, coarse))
    pairs["launch_time"] = launch, other
    known: dict[str, float] = {}
    # An event that only one solution has is as uncertain as the motion is long.
    values: dict[str, float] = {}
    for event, (first, second) in pairs.items():
        if any(time is not None and time <= end for time in (first, second)):
            values[event] = end
            if first is not None and second is not None:
                known[event] = abs(first - second)
    values |= dict.fromkeys(known, _SAFETY * max(known.values(), default=0.0) + _ROUNDING * end)
    releases = [value for event, value in values.items() if event != "launch_time"]
    if releases:
        values["release_time"] = max(releases)
    return values


def refusal(
    metric: str, subject: str | None, tolerance: float, uncertainty: float | None
) -> str | None:
    """Why a tolerance cannot be checked against this reference; None where it can.

    Args:
        tolerance, uncertainty: in the metric's unit; an unknown uncertainty (None) refuses nothing.
    """
    if uncertainty is None or tolerance >= REFUSED_BELOW * uncertainty:
        return None
    label = metric if subject is None else f"{metric} ({subject})"
    return (
        f"the tolerance {tolerance:.2g} of {label} is finer than {REFUSED_BELOW:g} times the "
        f"reference's own uncertainty, {uncertainty:.2g}: it cannot be judged"
    )
