"""Error budgets as data: the content of explain.json and its schema."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from ...models.mechanism import Mechanism
from ...models.shown import Reported
from ...models.spec import Real, Spec
from ..runs.results import ResultFile

FORMAT = "trebucheck-explain-1"

_Fraction = Real | None


class Share(Spec):
    """Contribution of one cause to one quantity's error."""

    cause: str
    fraction: _Fraction = Field(
        description="signed, of the whole error: its projection on it; None if there is none"
    )
    first: _Fraction = Field(description="the same, causes taken out in the order of the table")
    second: _Fraction = Field(description="the same in the reverse order, or by scaling")
    rms: Real = Field(description="over time, in the quantity's unit")
    largest: Real = Field(description="at any time, in the quantity's unit")
    interaction: Real = Field(
        description="rms of half the difference between first and second, in the same unit"
    )


class QuantityBudget(Spec):
    """The budget of one quantity: a function of time, or a single figure."""

    name: str
    unit: str
    rms: Real = Field(description="of the run's error over time")
    largest: Real
    shares: tuple[Share, ...]
    rest: Share = Field(description="what no cause accounts for")
    rest_rms: Real
    rest_largest: Real
    roundoff: Real = Field(
        description="random part of the run, rms, from runs that differ in their last bits"
    )
    roundoff_left: Real = Field(description="random part of what is left, rms")
    explained: _Fraction = Field(
        description="1 - rms of the rest, its random part taken off, over rms of the error"
    )


class Measurement(Spec):
    """A cause, and how it was measured."""

    name: str
    explanation: str
    done: str = Field(description="what was done to the run")
    after: tuple[str, ...] = Field(default=(), description="causes that had to be taken out before")
    message: str | None = Field(
        default=None, description="why it could not be measured; it then counts as unexplained"
    )


class Budget(Spec):
    """One engine and preset on one machine."""

    model: str
    engine: str
    engine_version: str
    preset: str
    settings: dict[str, JsonValue]
    message: str | None = Field(default=None, description="why there is none")
    point: str | None = Field(
        default=None, description="whose position is split: that with the largest error"
    )
    causes: tuple[Measurement, ...] = ()
    quantities: tuple[QuantityBudget, ...] = ()

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"

    def quantity(self, name: str) -> QuantityBudget | None:
        """A quantity's budget, if it has one."""
        return next((quantity for quantity in self.quantities if quantity.name == name), None)


class Figures(Spec):
    """How good and how dear one setting is."""

    message: str | None = Field(default=None, description="why it failed")
    position: Real | None = Field(default=None, description="largest distance of any marker [m]")
    torque: Real | None = Field(
        default=None, description="largest error of any stop's torque [N m, N]"
    )
    release: Real | None = Field(default=None, description="largest error of a release time [s]")
    wall_time: Real | None = Field(default=None, description="median, warm [s]")


class Change(Spec):
    """Gain by a single option."""

    option: str
    stock: JsonValue
    tuned: JsonValue
    alone: Figures = Field(description="stock, with this one option as tuned")
    back: Figures = Field(description="tuned, with this one option as stock")


class StockAgainstTuned(Spec):
    """An engine's two presets at the same step."""

    model: str
    engine: str
    timestep: Real | None = Field(description="of both [s]")
    force_unit: str = Field(default="N m", description="of what the machine's stops push with")
    stock: Figures
    tuned: Figures
    changes: tuple[Change, ...]


class ExplainedMachine(Spec):
    """A machine whose runs are explained."""

    model: str
    mechanism: Mechanism
    mechanism_hash: str
    launch_time: Annotated[Real, Field(gt=0)] | None = Field(
        description="of the reference [s]; None: it does not launch within what is compared"
    )
    compared_to: Real | None = Field(
        default=None, description="end of the compared motion [s]; None: the launch"
    )
    judged_to: Real | None = Field(
        default=None, description="that, or the predictability horizon if earlier [s]"
    )


class Explanation(Reported, ResultFile):
    """The whole of it."""

    format: Literal["trebucheck-explain-1"] = FORMAT
    machines: tuple[ExplainedMachine, ...]
    failures: dict[str, str] = Field(
        default_factory=dict, description="machines whose reference failed, and why"
    )
    budgets: tuple[Budget, ...]
    comparisons: tuple[StockAgainstTuned, ...]

    def headline(self) -> str:
        """Which runs have a budget."""
        runs = ", ".join(f"{budget.model} by {budget.label}" for budget in self.budgets)
        return f"Explanation of {runs or 'no run'}"

    def rows(self) -> Iterator[dict[str, object]]:
        """A cause's share of a quantity's error a row."""
        for budget in self.budgets:
            head = {"model": budget.model, "engine": budget.engine, "preset": budget.preset}
            for quantity in budget.quantities:
                for share in (*quantity.shares, quantity.rest):
                    yield {
                        **head,
                        "quantity": quantity.name,
                        "unit": quantity.unit,
                        **share.model_dump(),
                    }
