"""The matrix as data: of each run what its cells show, small enough to be kept."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field

from ...models.spec import Positive, Real, Spec
from ..runs.results import Outcome, ResultFile

FORMAT = "trebucheck-matrix-1"

SHOWN = {
    "position_max": "position",
    "velocity_max": "speed",
    "release_time": "release time",
    "stop_torque_max": "stop torque",
    "joint_reaction_max": "joint force",
    "energy_balance": "energy",
}
"""Title of each quantity that has a table of its own, by the metric's name."""


class Error(Spec):
    """The largest error of a run in one quantity."""

    metric: str
    subject: str | None = Field(
        default=None, description="marker, stop or joint it is of; None: the mechanism, or none"
    )
    value: Real | None = Field(description="None where a figure is missing; `note` says why")
    unit: str
    part: Real | None = Field(description="of the quantity's scale, the same for all engines")
    observed: bool = Field(
        default=True, description="false: the engine does not tell it, or it is not determined"
    )
    tolerance: Real | None = None
    holds: bool | None = Field(
        default=None, description="all of the quantity's figures; None: not judged"
    )
    note: str | None = None


class Breach(Spec):
    """The figure of a run that is the farthest beyond its tolerance, or the nearest to it."""

    label: str
    ratio: Real | None = Field(
        description="of the error to its tolerance; None: there is no figure"
    )


class MatrixRun(Spec):
    """An engine and preset on a problem."""

    problem: str
    engine: str
    preset: str
    engine_version: str
    scheme: str = Field(default="", description="as its study names it; '': not stated")
    order: Real | None = Field(
        default=None, description="that its study declares; None: no power of the step"
    )
    supplied: dict[str, str] | None = Field(
        default=None,
        description="what trebucheck does in the engine's place, by part, and of what; None: not stated",
    )
    timestep: Positive | None = Field(default=None, description="[s]")
    outcome: Outcome
    message: str | None = Field(default=None, description="the refusal's or the failure's sentence")
    judged: Annotated[int, Field(ge=0)] = 0
    held: Annotated[int, Field(ge=0)] = 0
    worst: Breach | None = None
    errors: tuple[Error, ...] = ()
    first_in: str | None = Field(default=None, description="figure that leaves its tolerance first")
    causes: tuple[str, ...] = Field(
        default=(), description="likeliest causes; empty where unknown or not looked for"
    )
    explained: Real | None = Field(
        default=None, description="share of the error that the first cause accounts for"
    )
    date: str = Field(description="of the file of runs, YYYY-MM-DD")
    made_by: str = Field(description="version of trebucheck")

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"

    def error(self, metric: str) -> Error | None:
        """Of a quantity; None if the run has none."""
        return next((error for error in self.errors if error.metric == metric), None)


class MatrixProblem(Spec):
    """A problem as compared."""

    name: str
    number: str = Field(
        default="", description="of the library; '' for machines and for mechanisms of one's own"
    )
    mechanism_hash: str
    stop_law: str
    judged_to: Real = Field(description="[s]")
    stops: bool
    loops: bool
    elements: bool = Field(default=False, description="springs, dampers or motors")

    @property
    def title(self) -> str:
        """Of a column."""
        return self.number or self.name


class MeasuredOrder(Spec):
    """How an engine's position error falls with the time step, measured by `trebucheck converge`."""

    engine: str
    preset: str
    problem: str
    exponent: Real | None = Field(description="None: no power of the step was found")
    half_width: Real | None = Field(default=None, description="of its 95 % confidence interval")
    floor: Real | None = Field(
        default=None, description="error that no smaller step lowers [m]; None: not reached"
    )
    floor_cause: str = Field(default="", description="what sets it")

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"


class Matrix(ResultFile):
    """Runs of several comparisons side by side."""

    format: Literal["trebucheck-matrix-1"] = FORMAT
    problems: tuple[MatrixProblem, ...]
    runs: tuple[MatrixRun, ...]
    orders: tuple[MeasuredOrder, ...] = ()

    def run(self, label: str, problem: str) -> MatrixRun | None:
        """The run of an engine and preset on a problem; None if it was not made."""
        return next(
            (run for run in self.runs if (run.label, run.problem) == (label, problem)), None
        )

    def schemes(self) -> dict[str, list[str]]:
        """Engines with their presets by scheme, in alphabetical order; those that state none come last."""
        found: dict[str, set[str]] = {}
        for run in self.runs:
            found.setdefault(run.scheme, set()).add(run.label)
        return {
            name: sorted(found[name])
            for name in sorted(found, key=lambda name: (not name, name.lower()))
        }

    def of(self, label: str) -> Iterable[MatrixRun]:
        """All runs of an engine and preset."""
        return (run for run in self.runs if run.label == label)
