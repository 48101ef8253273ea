"""Findings of convergence studies, as data: the content of converge.json and its schema."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from ...models.mechanism import Mechanism
from ...models.shown import Reported
from ...models.spec import NonNegative, Positive, Real, Spec
from ..runs.results import ResultFile

FORMAT = "trebucheck-converge-1"

QuantityName = Literal["position", "torque"]


class PowerLaw(Spec):
    """error = factor * value^exponent, over a range of values."""

    exponent: Real
    half_width: NonNegative = Field(
        description="of the exponent's 95 % confidence interval (Student t)"
    )
    factor: Positive = Field(description="error at the value 1, in the quantity's unit")
    low: Positive = Field(description="smallest value of the range")
    high: Positive = Field(description="largest value of the range")
    points: Annotated[int, Field(ge=4)]

    @property
    def decades(self) -> float:
        """Length of the range, in powers of ten."""
        return math.log10(self.high / self.low)

    def at(self, value: float) -> float:
        """The error it tells at a value of the knob."""
        return self.factor * value**self.exponent


class Floor(Spec):
    """An error that turning the knob further does not lower."""

    error: Real
    value: Real | None = Field(
        description="of the knob where it was looked at; None: with the knob's error taken out"
    )
    cause: str
    evidence: str = Field(description="the measurement the cause was decided by")


class Curve(Spec):
    """One quantity along a study."""

    quantity: QuantityName
    force_unit: str = Field(default="N m", description="of what the machine's stops push with")
    law: PowerLaw | None = Field(
        description="None: no power law, or an error that the knob hardly moves"
    )
    floor: Floor | None = Field(
        description="None: not reached, the error still falls at the finest value"
    )

    @property
    def unit(self) -> str:
        """Unit of its error."""
        return "m" if self.quantity == "position" else self.force_unit


class Point(Spec):
    """One setting of the knob."""

    value: Real
    options: dict[str, JsonValue] = Field(description="what the value means to the engine")
    message: str | None = Field(default=None, description="why it failed; None if it ran")
    position: Real | None = Field(
        default=None, description="largest error of any marker's position [m]"
    )
    torque: Real | None = Field(
        default=None, description="largest error of any stop's torque [N m, N]"
    )
    own_position: Real | None = Field(
        default=None, description="the part of it that the knob makes"
    )
    own_torque: Real | None = None
    steps: Annotated[int, Field(ge=0)] = 0
    wall_times: tuple[Real, ...] = Field(default=(), description="warm, one a repeat [s]")

    def error(self, quantity: QuantityName, own: bool = False) -> float | None:
        """Error of a quantity; `own`: the part that the knob makes."""
        whole, part = (
            (self.position, self.own_position)
            if quantity == "position"
            else (self.torque, self.own_torque)
        )
        return part if own else whole


class SweepStudy(Spec):
    """One knob of one engine and preset, turned."""

    engine: str
    engine_version: str
    preset: str
    knob: str
    title: str = Field(description="of what is turned, with its symbol")
    unit: str
    base: dict[str, JsonValue] = Field(
        description="options that stay as they are, over the preset's"
    )
    settings: dict[str, JsonValue] = Field(description="every option of the first point's engine")
    expected: Real | None = Field(
        description="exponent theory expects; None: it expects no power law"
    )
    why: str
    own: bool = Field(
        description="whether exponents are of the part of the error that the knob makes"
    )
    points: tuple[Point, ...] = Field(description="from coarse to fine")
    curves: tuple[Curve, ...]

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"

    def curve(self, quantity: QuantityName) -> Curve:
        """Law and floor of a quantity."""
        return next(curve for curve in self.curves if curve.quantity == quantity)


class RichardsonLimit(Spec):
    """Richardson's extrapolation of a run to no time step at all, over the whole throw."""

    engine: str
    preset: str
    levels: tuple[Real, ...] = Field(
        description="time steps, from coarse to fine [s]; the limit is of the finest two"
    )
    order: Real = Field(description="from the successive differences of the three")
    power: Annotated[int, Field(ge=1)] = Field(
        description="that was extrapolated with: the order, rounded"
    )
    position: Real = Field(description="largest distance of the limit from the reference [m]")
    position_three: Real = Field(
        description="the same with three levels, which take the next power out, too [m]"
    )
    estimate: Real = Field(
        description="largest distance between the two limits: the limit's own error [m]"
    )
    torque: Real | None = Field(
        description="largest distance of any stop's torque from the reference [N m, N]"
    )

    @property
    def label(self) -> str:
        """Engine and preset in one."""
        return f"{self.engine} {self.preset}"


class LimitPair(Spec):
    """Two limits against each other; the reference takes no part."""

    first: str
    second: str
    position: Real = Field(description="largest distance over the throw [m]")


class MachineStudies(Spec):
    """All studies of one machine."""

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
    uncertainty: dict[QuantityName, Real] = Field(
        description="of the reference [m, N m or N], of what it has"
    )
    uncertainty_source: str
    studies: tuple[SweepStudy, ...]
    limits: tuple[RichardsonLimit, ...]
    pairs: tuple[LimitPair, ...]
    absent: tuple[str, ...] = Field(default=(), description="engines that are not installed here")

    def limit(self, label: str) -> RichardsonLimit | None:
        """A run's limit; None if it has none."""
        return next((limit for limit in self.limits if limit.label == label), None)


class Studies(Reported, ResultFile):
    """The whole of `trebucheck converge`."""

    format: Literal["trebucheck-converge-1"] = FORMAT
    machines: tuple[MachineStudies, ...]
    failures: dict[str, str] = Field(
        default_factory=dict, description="machines whose reference failed, and why"
    )

    def headline(self) -> str:
        """How many parameters were swept of what."""
        number = sum(len(machine.studies) for machine in self.machines)
        names = ", ".join(machine.model for machine in self.machines)
        return f"Convergence of {names}: {number} swept parameters"

    def rows(self) -> Iterator[dict[str, object]]:
        """A point of a sweep a row."""
        for machine in self.machines:
            for study in machine.studies:
                head = {
                    "model": machine.model,
                    "engine": study.engine,
                    "preset": study.preset,
                    "knob": study.knob,
                }
                for point in study.points:
                    yield {**head, **point.model_dump(exclude={"options"})}
