"""Advice as data: the content of recommend.json and its schema."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, JsonValue, model_validator

from ...models.mechanism import Mechanism
from ...models.shown import Reported
from ...models.spec import Positive, Real, Spec
from ..runs.results import ResultFile

FORMAT = "trebucheck-recommend-1"


class Asked(Spec):
    """Errors that must not be exceeded; None: anything will do.

    Raises:
        InputError: nothing is asked, a value is not positive and finite, or the torque is asked for
            in two ways.
    """

    position: Positive | None = Field(
        default=None, description="distance of any marker at any sample [m]"
    )
    torque: Positive | None = Field(
        default=None, description="of any stop's torque at any sample [N m, or N on points]"
    )
    torque_share: Positive | None = Field(
        default=None,
        description="the same, as a share of the largest stop torque of each machine's own "
        "reference",
    )
    release: Positive | None = Field(default=None, description="of any stop's release [s]")

    @model_validator(mode="after")
    def _asks_for_something(self) -> Self:
        if all(
            value is None for value in (self.position, self.torque, self.torque_share, self.release)
        ):
            raise ValueError(
                "nothing is asked; at least one of position, torque and release must be given"
            )
        if self.torque is not None and self.torque_share is not None:
            raise ValueError("torque is asked in N m and as a share; only one of them can be given")
        return self


class Obstacle(StrEnum):
    """Obstacle that keeps an error from falling further, by its course over the steps."""

    STEP = "the time step"
    FLOOR = "a floor"
    CONSTANT = "not the step"
    ROUNDING = "rounding"
    FAILURE = "failure"


class Errors(Spec):
    """The largest errors over the compared time; None: there is no such figure."""

    position: Real | None = Field(description="[m]")
    torque: Real | None = Field(description="[N m, or N on points]")
    torque_share: Real | None = Field(
        description="of the largest stop torque of the machine's own reference"
    )
    release: Real | None = Field(description="[s]")


class Attempt(Spec):
    """One set of options, followed over the steps."""

    options: str = Field(description="name of the set")
    words: str
    step: Real | None = Field(
        description="longest step at which it reaches what is asked; None: it does not [s]"
    )
    wall_time: Real | None = Field(description="of the machine asked about, at that step, once [s]")
    steps_tried: tuple[Real, ...] = Field(description="[s]")
    worst: Real | None = Field(
        description="least found of the worst error over what is asked; None: runs failed"
    )
    note: str = Field(description="why it was not followed further")


class Choice(Spec):
    """Settings that reach what is asked, all measured."""

    options: str = Field(description="name of the set")
    words: str
    preset: str
    changes: dict[str, JsonValue] = Field(
        description="what to set over the preset, the time step included"
    )
    settings: dict[str, JsonValue] = Field(description="every numerical option")
    step: Real = Field(description="[s]")
    here: Errors = Field(description="on the machine asked about")
    worst_neighbour: Errors | None = Field(
        description="the worst of each, over the neighbours measured"
    )
    wall_time: Real = Field(description="median, of the machine asked about, warm [s]")
    wall_times: tuple[Real, ...] = Field(description="[s]")


class EngineAdvice(Spec):
    """Settings for one engine, or why there are none."""

    engine: str
    engine_version: str
    choice: Choice | None
    obstacle: Obstacle | None = None
    message: str | None = Field(
        default=None, description="what was reached and what stands in the way"
    )
    attempts: tuple[Attempt, ...] = ()
    snippets: dict[str, str] = Field(
        default_factory=dict, description="texts to paste, by what they are for"
    )


class NeighbourMachine(Spec):
    """A machine of the same kind."""

    made_with: dict[str, Real] = Field(
        description="its parameters that differ, or factors on a mechanism's own"
    )
    mechanism_hash: str


class Advice(Reported, ResultFile):
    """Recommendations for one machine, and their evidence."""

    format: Literal["trebucheck-recommend-1"] = FORMAT
    model: str
    mechanism: Mechanism
    mechanism_hash: str
    launch_time: Real | None = Field(
        default=None,
        description="of the reference [s]; None: it does not launch within what is compared",
    )
    compared_to: Real | None = Field(
        default=None, description="end of the compared motion [s]; None: the launch"
    )
    judged_to: Real | None = Field(
        default=None, description="that, or the predictability horizon if earlier [s]"
    )
    asked: Asked
    rule: str = Field(description="what the settings were measured on")
    neighbours: tuple[NeighbourMachine, ...]
    measured_neighbours: Annotated[int, Field(ge=0)] = Field(
        description="the hardest, measured at every step tried"
    )
    engines: tuple[EngineAdvice, ...]

    def headline(self) -> str:
        """Engines for which there are settings."""
        found = ", ".join(
            f"{e.engine} {f'{e.choice.step:g} s' if e.choice else 'none'}" for e in self.engines
        )
        return f"Advice for {self.model!r}: {found}"

    def rows(self) -> Iterator[dict[str, object]]:
        """An engine a row."""
        for each in self.engines:
            choice = each.choice
            found = (
                {}
                if choice is None
                else {"step": choice.step, "wall_time": choice.wall_time, **dict(choice.here)}
            )
            settings = (
                {} if choice is None else {"preset": choice.preset, "changes": choice.changes}
            )
            yield {"engine": each.engine, **settings, **found, "message": each.message}

    def engine(self, name: str) -> EngineAdvice:
        """The advice for the engine of that name."""
        return next(advice for advice in self.engines if advice.engine == name)
