"""Results of a comparison as data: the content of results.json and its schema."""

from __future__ import annotations

import math
import os
import platform
import re
from contextlib import suppress
from enum import StrEnum
from functools import cache
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, cast

from pydantic import Field, JsonValue, model_validator

from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...models.spec import Positive, Real, Spec
from .scales import Scales

FORMAT = "trebucheck-results-2"
REFERENCE = "reference"
"""Name of the engine that the others are measured against."""
_OLD_TIME_LIMIT = re.compile(r"did not finish within ([0-9.e+-]+) s and was stopped\.$")


def with_time_limit(given: Any) -> Any:
    """Fields of a stored run, with its time limit as a type.

    Results of earlier releases tell a time-out by the words of the message alone.
    """
    if isinstance(given, dict):
        fields = cast("dict[str, Any]", given)
        limit = _OLD_TIME_LIMIT.search(str(fields.get("message")))
        if fields.get("outcome") == Outcome.FAILED and limit is not None:
            return {**fields, "outcome": Outcome.TIMED_OUT, "time_limit": float(limit.group(1))}
    return given


def optional(default: Any, description: str) -> Any:
    """A field that is written only where it has another value than the default."""
    return Field(
        default=default, exclude_if=lambda value: value == default, description=description
    )


class ResultFile(Spec):
    """A command's results: its format, where they were made, and then what the command adds."""

    format: Any  # a literal in each command's own
    trebucheck_version: str
    python_version: str
    platform: str
    processor: str | None = optional(None, "and the number of its cores; absent where unknown")
    command: str | None = optional(
        None, "command line that makes it again; absent where Python made it"
    )
    jobs: int = optional(
        1, "runs made at once: with more than one, wall times include what they cost each other"
    )
    shared: bool = optional(
        False, "whether a cluster's workers made the runs: their times compare no engines then"
    )

    @classmethod
    def made_here(cls, **content: Any) -> Self:
        """Results with this content, made by these versions on this machine."""
        from ...version import __version__

        return cls(
            trebucheck_version=__version__,
            python_version=platform.python_version(),
            platform=f"{platform.system()} {platform.machine()}",
            processor=_processor(),
            **content,
        )

    @property
    def machine_text(self) -> str:
        """Versions and hardware that the results were made with, as a part of a sentence."""
        where = self.platform if self.processor is None else f"{self.platform}, {self.processor}"
        return f"trebucheck {self.trebucheck_version}, Python {self.python_version}, {where}"

    def made_by(self, command: str | None, jobs: int | None = None) -> Self:
        """Returns the same with the command line that makes it again and the runs made at once."""
        jobs = self.jobs if jobs is None else jobs
        return self.model_copy(update={"command": command, "jobs": jobs})


@cache
def _processor() -> str | None:
    """Name and number of cores of the processor, where the system tells them."""
    name = platform.processor()
    with suppress(OSError):  # Linux, where the library knows the architecture alone
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next((line.partition(":")[2] for line in lines if line.startswith("model name")), "")
    cores = os.cpu_count()
    return f"{' '.join(name.split())}, {cores} cores" if name and cores else None


class ComparedMotion(Spec):
    """Base of results on one mechanism: the reference motion that its runs are compared with."""

    model: str
    mechanism: Mechanism
    mechanism_hash: str
    launch_time: Real | None = Field(
        description="of the reference [s]; None: it does not launch within what is compared"
    )
    compared_to: Real | None = Field(
        default=None, description="end of the compared motion [s]; None: the launch"
    )
    judged_to: Real | None = Field(
        default=None, description="that, or the predictability horizon if earlier [s]"
    )


class Outcome(StrEnum):
    """The verdict on a run; the text is what the table shows."""

    AGREES = "agrees"
    """Every quantity that was compared holds its tolerance."""
    DISAGREES = "disagrees"
    NOT_JUDGED = "not judged"
    """No tolerance is exceeded, but something has none, or nothing could be compared."""
    NOT_EQUIVALENT = "not equivalent"
    """The built model is another one: its motion was not compared."""
    FAILED = "failed"
    TIMED_OUT = "timed out"
    """It did not come to an end within the limit of time, and was stopped."""
    ABSENT = "not installed"
    UNSUPPORTED = "not supported"


def share_of(value: float | None, tolerance: float | None) -> float | None:
    """Value / tolerance; infinite for a missing value, None without a tolerance."""
    if tolerance is None:
        return None
    return math.inf if value is None else abs(value) / (tolerance or _LEAST)


_LEAST = 1e-300  # in the place of a tolerance of zero


class OnSubject:
    """Base of what has a name, and may have a subject, among its fields."""

    if TYPE_CHECKING:
        name: str
        subject: str | None

    @property
    def label(self) -> str:
        """Name and subject in one."""
        return self.name if self.subject is None else f"{self.name} ({self.subject})"


class OfEngine:
    """Base of what has an engine and a preset among its fields."""

    if TYPE_CHECKING:
        engine: str
        preset: str

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"


class Metric(OnSubject, Spec):
    """One figure of a run, a distance from the reference unless its name says otherwise.

    `value` is None where there is nothing to compare; `note` then says why.
    """

    name: str
    subject: str | None = Field(default=None, description="marker, coordinate, stop or joint")
    value: Real | None
    unit: str
    sampling_error: Real | None = optional(None, "of the samples; added to the tolerance")
    left_out: Real | None = optional(
        None, "time at impacts or beside singular positions that is not compared [s]"
    )
    observed: bool = Field(default=True, description="false: not told, or not determined")
    follows: str | None = Field(default=None, description="metric that is judged in its place")
    tolerance: Real | None = None
    source: Literal["need", "claim", "default"] | None = Field(
        default=None, description="the user's need, the claim of an assisted run, or the default"
    )
    reason: str | None = Field(default=None, description="where the tolerance comes from")
    note: str | None = None

    @property
    def holds(self) -> bool | None:
        """Tell whether it is within its tolerance; None without one. A missing value is not."""
        if self.tolerance is None:
            return None
        return self.value is not None and abs(self.value) <= self.tolerance

    @property
    def share(self) -> float | None:
        """Value / tolerance; infinite for a missing value, None without a tolerance."""
        return share_of(self.value, self.tolerance)

    @property
    def unjudged(self) -> bool:
        """Tell whether it stands for itself, compared or asked for, without a tolerance."""
        wanted = self.observed or self.source == "need"
        return wanted and self.follows is None and self.tolerance is None


class Check(OnSubject, Spec):
    """One quantity of the built model against the reference's equations, at the worst state."""

    name: str
    subject: str | None = Field(default=None, description="coordinate, body or stop, the worst")
    value: Real | None = Field(description="None where the engine gave no number")
    unit: str
    tolerance: Real
    reason: str = Field(description="where the tolerance comes from")

    @property
    def holds(self) -> bool:
        """Tell whether it is within its tolerance; a missing number is not."""
        return self.value is not None and self.value <= self.tolerance


class Equality(Spec):
    """Tell whether an engine has built the same machine, before any motion."""

    exposed: bool = Field(description="whether the engine shows its built model at all")
    note: str | None = None
    states: Annotated[int, Field(ge=0)] = Field(default=0, description="random states looked at")
    checks: tuple[Check, ...] = ()

    @property
    def holds(self) -> bool:
        """No check fails. An engine that shows nothing fails nothing."""
        return all(check.holds for check in self.checks)

    @property
    def broken(self) -> tuple[Check, ...]:
        """Checks that fail."""
        return tuple(check for check in self.checks if not check.holds)


class RankedCause(Spec):
    """A suspect: what may be wrong, and how much of the deviation it accounts for."""

    name: str
    kind: Literal["machine", "start", "law", "reading", "settings"] = Field(
        description="where it would have to be mended"
    )
    amount: str = Field(default="", description="how large it would have to be, in words")
    explained: Real = Field(description="share of the deviation, 1: all of it")
    confirmed: bool = optional(
        False,
        "by runs of the engine without it; of a step and of rounding, by what other steps tell",
    )


class Diagnosis(Spec):
    """Onset of a run's departure from the reference, and what is likely to be wrong."""

    leads: str = Field(description="label of the figure that leaves its tolerance first")
    parts_at: Real | None = Field(default=None, description="[s]; None before any motion")
    holding: tuple[str, ...] = Field(default=(), description="stops closed then, by the reference")
    causes: tuple[RankedCause, ...] = Field(default=(), description="the likeliest first")
    likeliest: Annotated[int, Field(ge=0)] = Field(
        default=0,
        description="number of the first causes that account for enough of the deviation to be "
        "named, and cannot be told apart by it; 0: the cause is unknown",
    )
    motion_agrees: bool = Field(default=False, description="only what is read from it differs")
    note: str = optional("", "why no cause was looked for; what leads is then what is worst")
    reruns_to: Real | None = optional(
        None,
        "end of the motion for which the engine was run with other settings [s], where it is not "
        "the end of all: the first violation, or a characteristic time",
    )
    left_out: Annotated[int, Field(ge=0)] = optional(
        0, "runs with other settings that were not made, as they would have taken too long"
    )

    @property
    def named(self) -> tuple[RankedCause, ...]:
        """The likeliest causes; empty where the cause is unknown."""
        return self.causes[: self.likeliest]


class Measured:
    """Base of results with metrics and a diagnosis among their fields."""

    if TYPE_CHECKING:
        metrics: tuple[Metric, ...]
        diagnosis: Diagnosis | None

    @property
    def judged(self) -> tuple[Metric, ...]:
        """Metrics held against a tolerance."""
        return tuple(m for m in self.metrics if m.holds is not None)

    @property
    def broken(self) -> tuple[Metric, ...]:
        """Metrics whose tolerance does not hold."""
        return tuple(m for m in self.metrics if m.holds is False)

    @property
    def unjudged(self) -> tuple[Metric, ...]:
        """Metrics that were compared and could not be judged."""
        return tuple(m for m in self.metrics if m.unjudged)


class WorkPoint(Spec):
    """Cost and errors of a run at one time step."""

    timestep: Positive = Field(description="[s]")
    steps: Annotated[int, Field(ge=0)]
    costs: tuple[Real, ...] = Field(
        description="processor time without the adapter's reading, one a repeat [s]; empty: not "
        "measured"
    )
    reading_time: Real | None = optional(
        None, "median, by the processor [s]; null: not told apart from the costs"
    )
    errors: dict[str, Real] = Field(description="largest error of each quantity, by its metric")

    @property
    def cost(self) -> float | None:
        """Median of the costs [s]; None: not measured."""
        return median(self.costs) if self.costs else None


class Run(OfEngine, Measured, Spec):
    """One engine, preset and machine."""

    model: str
    engine: str
    preset: str
    outcome: Outcome
    message: str | None = Field(default=None, description="why it failed")
    time_limit: Real | None = optional(None, "at which a run that timed out was stopped [s]")
    engine_version: str
    scheme: str = optional("", "by which it integrates, as its study names it")
    order: Real | None = optional(None, "power of the time step of its error, by its study")
    supplied: dict[str, str] | None = optional(
        None, "what trebucheck does in its place, by part, and of what; null: it does not say"
    )
    settings: dict[str, JsonValue] = Field(default_factory=dict)
    steps: Annotated[int, Field(ge=0)] = 0
    wall_time: Real | None = Field(default=None, description="of the whole simulate, warm [s]")
    processor_time: Real | None = optional(None, "of the same, by all threads [s]")
    reading_time: Real | None = optional(
        None, "part of the processor time in which the adapter read the engine [s]"
    )
    sweep: tuple[WorkPoint, ...] = optional(
        (), "the same at other time steps, from long to short; empty: not asked for"
    )
    equality: Equality | None = Field(default=None, description="None where nothing was built")
    metrics: tuple[Metric, ...] = ()
    diagnosis: Diagnosis | None = Field(default=None, description="of a failed check or tolerance")

    @model_validator(mode="before")
    @classmethod
    def _read_old_outcome(cls, given: Any) -> Any:
        return with_time_limit(given)

    @property
    def cost(self) -> float | None:
        """Processor time without reading, where that is told apart [s]; None: not measured."""
        if self.processor_time is None:
            return None
        return self.processor_time - (self.reading_time or 0.0)

    def metric(self, name: str, subject: str | None = None) -> Metric | None:
        """The metric of that name and subject, if the run has it."""
        return next((m for m in self.metrics if (m.name, m.subject) == (name, subject)), None)


class Pair(Spec):
    """Two runs of one machine against each other."""

    model: str
    first: str
    second: str
    position_max: Real | None = Field(description="of all markers [m]; None without a marker")
    release_time_max: Real | None = Field(description="[s]; None if not the same stops opened")
    launch_speed: Real | None = Field(description="[m/s]; None if one of them does not launch")


class Predictability(Spec):
    """Growth of errors up to some times: in parts of scales, per part of what is wrong."""

    times: tuple[Real, ...] = Field(description="[s]")
    # By inertias and force elements, and by coordinates and speeds at the start
    parameters: tuple[Real | None, ...] = Field(description="null: without limit")
    start: tuple[Real | None, ...] = Field(description="null: without limit")


class SingularPosition(Spec):
    """A singular position that the reference passes on the smooth branch of its motion."""

    time: Real = Field(description="[s]")
    time_uncertainty: Real = Field(description="[s]")
    uncertainty: Real = Field(description="of coordinates behind it, of the longest arm")
    lost: Annotated[int, Field(ge=1)] = Field(description="constraints that depend on the others")


class Machine(Spec):
    """A machine as compared, with the reference's figures."""

    model: str
    mechanism: Mechanism
    mechanism_hash: str
    table_one: bool = Field(description="whether it is the paper's Table I machine")
    stop_law: StopLaw = Field(default=StopLaw.RELEASE_ONCE, description="that the stops follow")
    compared_to: Real = Field(description="end of the motion: the launch, or the duration [s]")
    judged_to: Real = Field(description="that, or the predictability horizon if earlier [s]")
    stretching: Real = Field(description="displacement up to there per change of inertia")
    predictability: Predictability | None = None
    scales: Scales
    whole_scales: Scales | None = Field(default=None, description="to the end, for invariants")
    needs: dict[str, str] = Field(default_factory=dict, description="tolerances, as stated")
    thrown: str = Field(description="marker whose launch is measured")
    launch_time: Real | None
    launch_speed: Real | None
    impacts: Annotated[int, Field(ge=0)] = Field(description="of the reference, to the end")
    reference_uncertainty: dict[str, Real] = Field(
        default_factory=dict, description="by the metric it enters, in the metric's unit"
    )
    uncertainty_source: str = Field(default="unknown", description="certificate, or estimate")
    singular_positions: tuple[SingularPosition, ...] = ()  # that the reference passes
    release_times: dict[str, Real | None]
    start_torques: dict[str, Real]

    def scales_for(self, *, invariant: bool) -> Scales:
        """Scales of the judged motion; of the whole one for what is judged beyond the horizon."""
        return (self.whole_scales if invariant else None) or self.scales


class Results(ResultFile):
    """The whole of a comparison."""

    format: Literal["trebucheck-results-2"] = FORMAT
    machines: tuple[Machine, ...]
    runs: tuple[Run, ...]
    pairs: tuple[Pair, ...]

    @property
    def ran(self) -> tuple[Run, ...]:
        """Runs whose motion was compared."""
        return tuple(run for run in self.runs if run.outcome in COMPARED)

    @property
    def counted(self) -> tuple[Run, ...]:
        """Runs that verdicts are counted of: the reference's own only where no engine was run."""
        return tuple(run for run in self.runs if run.engine != REFERENCE) or self.runs

    @property
    def passed(self) -> bool:
        """Tell whether no run disagrees, differs or fails, and something was judged."""
        bad = {Outcome.DISAGREES, Outcome.NOT_EQUIVALENT, *FAILURES}
        broken = bad & {run.outcome for run in self.runs}
        return not broken and any(run.judged for run in self.runs)


# Outcomes of runs that did not come to an end, and of those whose motion was compared
FAILURES = (Outcome.FAILED, Outcome.TIMED_OUT)
COMPARED = (Outcome.AGREES, Outcome.DISAGREES, Outcome.NOT_JUDGED)


def verdict_on(metrics: tuple[Metric, ...]) -> Outcome:
    """Verdict on a run by its metrics: it agrees if all are judged, and there is one."""
    verdicts = [metric.holds for metric in metrics if metric.holds is not None]
    if not all(verdicts):
        return Outcome.DISAGREES
    if verdicts and not any(metric.unjudged for metric in metrics):
        return Outcome.AGREES
    return Outcome.NOT_JUDGED
