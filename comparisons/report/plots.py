"""A plot as data: series over axes, with labels, rules and bands; pages and `figures` draw it.

Colours are engines' own; dashes tell the preset and symbols repeat it, so that no line is told by
its colour alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from ...engines.registry import engine_study
from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from .drawing.scene import RunLook, Scene, States, scene

# Of engines that bring none: further ones of Okabe and Ito
_COLOURS = ("#CC79A7", "#56B4E9", "#E69F00", "#8C6BB1")
INK = "currentColor"
"""The colour of the text around a plot, for what belongs to no engine."""


def engine_colour(name: str) -> str:
    """The engine's own colour; for one that brings none, a colour that follows from its name."""
    return engine_study(name).colour or _COLOURS[sum(map(ord, name)) % len(_COLOURS)]


Symbol = Literal["circle", "square", "diamond", "triangle", "star", "times"]


@dataclass(frozen=True)
class Style:
    """How a series is drawn."""

    colour: str = INK
    dashed: bool = False
    width: float = 1.6
    """Width of a line [px]."""
    symbol: Symbol = "circle"


REFERENCE = Style(INK, width=4.0)
"""Below the lines of the engines, which hide it where they agree."""


def run_style(engine: str, preset: str) -> Style:
    """Colour by engine; a preset that is not the tuned one is dashed and has squares."""
    tuned = preset == "tuned"
    return Style(engine_colour(engine), dashed=not tuned, symbol="circle" if tuned else "square")


@dataclass(frozen=True)
class Axis:
    """Title and unit of an axis; a pure number has no unit."""

    title: str
    unit: str = ""
    logarithmic: bool = False
    """Values that are not positive are then left out."""
    categories: tuple[str, ...] = ()
    """Names of the positions 0, 1, ...; empty for an axis of numbers."""


@dataclass(frozen=True)
class Series:
    """Points of one name; NaN is a gap."""

    name: str
    x: FloatArray
    y: FloatArray
    style: Style = Style()
    mark: Literal["line", "points", "both", "bar"] = "line"
    """Bars stand on the categories of one axis, and begin at zero of the other."""
    hints: tuple[str, ...] = ()
    """Texts that show where a point is pointed at, besides its numbers."""
    spread: tuple[FloatArray, FloatArray] | None = None
    """Least and largest x of each point; of a bar along x, too."""
    listed: bool = True
    """Whether the legend lists it."""


@dataclass(frozen=True)
class Label:
    """A text at a point."""

    x: float
    y: float
    text: str
    colour: str = INK
    beside: bool = False
    """Whether the text stands to the right of the point, not above it."""


@dataclass(frozen=True)
class Rule:
    """A line across the plot, at an x or a y."""

    at: float
    text: str = ""
    colour: str = ""
    """Empty: that of grids."""
    across: Literal["x", "y"] = "x"


@dataclass(frozen=True)
class Band:
    """An interval of x, shaded."""

    start: float
    end: float
    colour: str


@dataclass(frozen=True)
class Plot:
    """Series over two axes."""

    x: Axis
    y: Axis
    series: tuple[Series, ...]
    title: str = ""
    labels: tuple[Label, ...] = ()
    rules: tuple[Rule, ...] = ()
    bands: tuple[Band, ...] = ()
    equal: bool = False
    """One scale for both axes."""
    height: int = 280
    """[px]; follows from the width where the scales are equal."""


Panels = tuple[Plot, ...]
"""Plots beside each other under one legend."""


REFERENCE_RUN = "reference tuned"
"""Label of the run that is the reference itself."""


def motion_scene(states: States, runs: Mapping[str, Trajectory], **how: Any) -> Scene:
    """Returns a mechanism in motion with engines' runs over the reference, each in its colour.

    A run of the reference's own is left out.

    Args:
        states: the reference motion at any times.
        runs: by label, such as 'mujoco tuned'.
        how: as :func:`.drawing.scene.scene` takes it.
    """
    looks: dict[str, RunLook] = {}
    for label, run in runs.items():
        if label != REFERENCE_RUN:
            style = run_style(run.provenance.engine, run.provenance.preset)
            looks[label] = RunLook(run, style.colour, style.dashed)
    return scene(states, looks, **how)
