"""A plot as data: series over axes, with labels, rules and bands; pictures of it by Matplotlib.

Pages draw the same data by a script. Colours are engines' own; dashes tell the preset and symbols
repeat it, so that no line is told by its colour alone.
"""

from __future__ import annotations

import colorsys
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...engines.presets import ASSISTED, DEFAULT, SETTINGS
from ...engines.registry import engine_study
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.files import write_bytes
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory
from .drawing.scene import RunLook, Scene, States, scene, starts_alike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OKABE_ITO = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1",
)  # fmt: skip
_GOLDEN = (math.sqrt(5) - 1) / 2  # of a turn of hue: multiples of it are never the same
# Of engines that bring none: further ones of Okabe and Ito
_COLOURS = ("#CC79A7", "#56B4E9", "#E69F00", "#8C6BB1")
INK = "currentColor"  # the colour of the text around a plot, for what belongs to no engine


def engine_colour(name: str) -> str:
    """The engine's own colour; for one that brings none, a colour that follows from its name."""
    return engine_study(name).colour or _COLOURS[sum(map(ord, name)) % len(_COLOURS)]


Symbol = Literal["circle", "square", "diamond", "triangle", "star", "times"]


@dataclass(frozen=True)
class Style:
    """Style in which a series is drawn."""

    colour: str = INK
    dashed: bool = False
    width: float = 1.6  # width of a line [px]
    symbol: Symbol = "circle"


_MARKS: Mapping[str, tuple[float, Symbol]] = {
    ASSISTED: (0.0, "circle"),
    SETTINGS: (0.35, "square"),
    DEFAULT: (0.65, "triangle"),
}
"""Share of grey and symbol by preset; another one is shown as the default."""

REFERENCE = Style(INK, width=4.0)  # below the lines of the engines, which hide it where they agree


def run_style(engine: str, preset: str) -> Style:
    """Colour by engine, greyer, dashed and with another symbol by the preset."""
    greyness, symbol = _MARKS.get(preset, _MARKS[DEFAULT])
    return Style(_greyed(engine_colour(engine), greyness), dashed=greyness > 0, symbol=symbol)


def _greyed(colour: str, share: float) -> str:
    """A colour '#rrggbb' with a share of middle grey."""
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round((1 - share) * part + share * 128):02x}" for part in parts)


@dataclass(frozen=True)
class Axis:
    """Title and unit of an axis; a pure number has no unit."""

    title: str
    unit: str = ""
    logarithmic: bool = False  # values that are not positive are then left out
    categories: tuple[str, ...] = ()
    """Names of the positions 0, 1, ...; empty for an axis of numbers."""

    @property
    def heading(self) -> str:
        """Title and unit."""
        return self.title if self.unit in ("", "1") else f"{self.title} [{self.unit}]".strip()


@dataclass(frozen=True)
class Series:
    """Points of one name; NaN is a gap."""

    name: str
    x: FloatArray
    y: FloatArray
    style: Style = Style()
    mark: Literal["line", "points", "both", "bar"] = "line"
    """Bars stand on the categories of one axis, and begin at zero of the other."""
    hints: tuple[str, ...] = ()  # texts that show where a point is pointed at, besides its numbers
    spread: tuple[FloatArray, FloatArray] | None = None
    """Least and largest x of each point; of a bar along x, too."""
    listed: bool = True  # whether the legend lists it


@dataclass(frozen=True)
class Label:
    """A text at a point."""

    x: float
    y: float
    text: str
    colour: str = INK
    beside: bool = False  # whether the text stands to the right of the point, not above it


@dataclass(frozen=True)
class Rule:
    """A line across the plot, at an x or a y."""

    at: float
    text: str = ""
    colour: str = ""  # empty: that of grids
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
    equal: bool = False  # one scale for both axes
    height: int = 280  # [px]; follows from the width where the scales are equal
    choice: str = ""  # a page shows those of one choice of a figure at a time; '': always

    @property
    def legend(self) -> tuple[Series, ...]:
        """Series that a legend lists, each name once."""
        return tuple({each.name: each for each in self.series if each.listed}.values())


Panels = tuple[Plot, ...]  # plots beside each other


def common_legend(panels: Panels) -> tuple[Series, ...] | None:
    """Series of the one legend of several plots, none for one series; None: each has its own."""
    legends = [plot.legend for plot in panels]
    keys = {tuple((each.name, each.style, each.mark) for each in legend) for legend in legends}
    if len(keys) > 1:
        return None
    return legends[0] if len(legends[0]) > 1 else ()


def with_own_colours(panels: Panels) -> Panels:
    """The plots, with another colour for a series that has that of another one in its plot.

    A series has the same colour in all of them. What no legend lists belongs to another series.
    """
    chosen: dict[tuple[str, str], str] = {}  # by name and colour of before
    for plot in panels:
        taken: dict[str, str] = {}  # name by colour
        for series in plot.legend:
            before = series.style.colour
            colour = chosen.get((series.name, before), before)
            if taken.get(colour.lower(), series.name) != series.name:
                colour = next(free for free in distinct_colours() if free not in taken)
            chosen[series.name, before] = colour
            taken[colour.lower()] = series.name

    def coloured(series: Series) -> Series:
        colour = chosen.get((series.name, series.style.colour), series.style.colour)
        return replace(series, style=replace(series.style, colour=colour))

    return tuple(replace(plot, series=tuple(map(coloured, plot.series))) for plot in panels)


def distinct_colours() -> Iterator[str]:
    """Colours without end, no two the same: Okabe and Ito's, then hues a golden angle apart."""
    yield from _OKABE_ITO
    for k in count():
        hue, light = (0.11 + k * _GOLDEN) % 1.0, (0.42, 0.30, 0.55)[k % 3]
        parts = colorsys.hls_to_rgb(hue, light, 0.65)
        yield "#" + "".join(f"{round(255 * part):02x}" for part in parts)


REFERENCE_RUN = f"reference {ASSISTED}"  # label of the run that is the reference itself
_MOST_COORDINATES = 4  # whose start a label has


def motion_scene(states: States, runs: Mapping[str, Trajectory], **how: Any) -> Scene:
    """Returns a mechanism in motion with engines' runs, by label, over the reference at any times.

    A run of the reference's own is left out, and a motion from another start is named by that.
    `how` is what :func:`.drawing.scene.scene` takes.
    """
    mechanism = states(np.zeros(1)).mechanism
    looks: dict[str, RunLook] = {}
    name = "reference"
    made = [run.provenance for run in runs.values()]
    own = [run_style(each.engine, each.preset).colour for each in made]
    for label, run in runs.items():
        if not starts_alike(run.mechanism, mechanism):
            looks[_unlike(looks, motion_label(run, mechanism))] = RunLook(run, _free(looks, own))
            name = f"reference, {_start_in_words(mechanism)}"
        elif label != REFERENCE_RUN:
            style = run_style(run.provenance.engine, run.provenance.preset)
            colour = style.colour
            if any(look.colour == colour for look in looks.values()):
                colour = _free(looks, own)
            looks[label] = RunLook(run, colour, style.dashed)
    return scene(states, looks, label=name, **how)


def motions_scene(first: Trajectory, others: Sequence[Trajectory], horizon: float | None) -> Scene:
    """Returns a trajectory in motion, with others of the same mechanism over it.

    The first one that is the reference's own is what those from the same start deviate from.

    Args:
        first: the trajectory.
        others: drawn over it.
        horizon: time from which on they cannot be predicted [s]; None: they can.
    """
    every = [first, *others]
    alike = [each for each in every if starts_alike(each.mechanism, first.mechanism)]
    base = next((each for each in alike if each.provenance.engine == "reference"), first)
    label = _maker(base)
    if len(alike) < len(every):
        label += f", {_start_in_words(base.mechanism)}"
    looks: dict[str, RunLook] = {}
    for each in every:
        if each is not base:
            look = RunLook(each, _free(looks), each.provenance.preset != ASSISTED)
            looks[_unlike(looks, motion_label(each, base.mechanism))] = look
    return scene(base, looks, label=label, horizon=horizon)


def motion_label(run: Trajectory, reference: Mechanism) -> str:
    """Name of a motion beside a reference motion: whose it is, and its start if that is another."""
    maker = _maker(run)
    if not starts_alike(run.mechanism, reference):
        return f"{maker}, {_start_in_words(run.mechanism, reference)}"
    if maker == "reference":
        return "another run of the reference"
    return maker


def _maker(run: Trajectory) -> str:
    """The reference, or an engine and its preset."""
    made = run.provenance
    return "reference" if made.engine == "reference" else f"{made.engine} {made.preset}"


def _free(looks: Mapping[str, RunLook], taken: Iterable[str] = ()) -> str:
    """A colour that no other motion has."""
    used = {*taken, *(look.colour for look in looks.values())}
    return next(colour for colour in distinct_colours() if colour not in used)


def _unlike(taken: Mapping[str, object], label: str) -> str:
    """The label, with a number if it is taken."""
    same = sum(other == label or other.startswith(f"{label} (") for other in taken)
    if same:
        label += f" ({same + 1})"
    return label


def _start_in_words(mechanism: Mechanism, other: Mechanism | None = None) -> str:
    """Start of the coordinates, and their speeds; only those in which it differs from another."""
    own = initial_state(mechanism)
    known = (np.full_like(own[0], np.nan), np.zeros_like(own[1]))
    if other is not None:
        known = initial_state(other)
    texts: list[str] = []
    for values, others, per, what in zip(own, known, ("", "/s"), ("", "speed of "), strict=True):
        for i, name in enumerate(mechanism.coordinates):
            unit = "rad" if name in mechanism.angles else "m"
            if values[i] != others[i]:
                texts.append(f"{what}{name} = {values[i]:.6g} {unit}{per}")
    if len(texts) > _MOST_COORDINATES:
        texts[_MOST_COORDINATES:] = [f"{len(texts) - _MOST_COORDINATES} more"]
    return f"start {', '.join(texts)}"


# --- Pictures by Matplotlib, for papers, notebooks and the README

FORMATS = ("svg", "png", "pdf")
_MARKERS: dict[Symbol, str] = {
    "circle": "o", "square": "s", "diamond": "D", "triangle": "^", "star": "*", "times": "x",
}  # fmt: skip
_WIDTH, _HEIGHT = 4.2, 3.2  # of one plot [inches]


def picture(panels: Panels, columns: int = 3, title: str = "") -> Figure:
    """Plots beside each other with their legends, at most `columns` in a row."""
    from matplotlib.figure import Figure  # without pyplot: no window, no global state

    panels, columns = with_own_colours(panels), min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = Figure((columns * _WIDTH, rows * _HEIGHT + 0.6), layout="constrained")
    axes: list[Axes] = np.atleast_1d(figure.subplots(rows, columns)).ravel().tolist()
    common = common_legend(panels)
    for plot, on in zip(panels, axes, strict=False):
        _draw(plot, on)
        if common is None:
            on.legend(fontsize=7, frameon=False)
    for empty in axes[len(panels) :]:
        empty.set_visible(False)
    if common:
        lines, names = axes[0].get_legend_handles_labels()
        handles = dict(zip(names, lines, strict=True))
        place = "outside lower center"
        figure.legend(handles.values(), handles.keys(), loc=place, ncols=4, frameon=False,
                      fontsize=8)  # fmt: skip
    if title:
        figure.suptitle(title)
    return figure


def write_picture(figure: Figure, path: str | Path) -> None:
    """Write a picture in the format that its name ends with; the same data give the same bytes.

    Raises:
        InputError: the format is not one of `FORMATS`, or the folder cannot be written to.
    """
    import matplotlib as mpl

    kind = Path(path).suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        endings = ", ".join(f".{ending}" for ending in FORMATS)
        raise InputError(f"picture {str(path)!r} must end with one of {endings}.")
    out = io.BytesIO()
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    with mpl.rc_context({"svg.hashsalt": "trebucheck", "svg.fonttype": "none"}):
        figure.savefig(out, format=kind, dpi=200, metadata=dates[kind])
    write_bytes(Path(path), out.getvalue())


def _draw(plot: Plot, on: Axes) -> None:
    bars = [series for series in plot.series if series.mark == "bar"]
    for series in plot.series:
        _draw_series(series, on, bars, along_x=bool(plot.y.categories))
    for rule in plot.rules:
        line = on.axvline if rule.across == "x" else on.axhline
        line(rule.at, color=rule.colour or "#8a97a5", linewidth=0.8, linestyle=":")
    for band in plot.bands:
        on.axvspan(band.start, band.end, color=band.colour, alpha=0.15, linewidth=0)
    for label in plot.labels:
        across, up = ("left", "center") if label.beside else ("center", "bottom")
        on.annotate(label.text, (label.x, label.y), (4, 2), fontsize=7, color=_ink(label.colour),
                    textcoords="offset points", ha=across, va=up)  # fmt: skip
    on.set_title(plot.title, fontsize=9)
    setters: tuple[tuple[Axis, Any, Any, Any], ...] = (
        (plot.x, on.set_xscale, on.set_xticks, on.set_xlabel),
        (plot.y, on.set_yscale, on.set_yticks, on.set_ylabel),
    )
    for axis, set_scale, set_ticks, set_label in setters:
        if axis.logarithmic:
            set_scale("log", nonpositive="mask")
        if axis.categories:
            set_ticks(range(len(axis.categories)), axis.categories)
        set_label(axis.heading, fontsize=8)
    on.tick_params(labelsize=8)
    on.grid(visible=True, alpha=0.25, linewidth=0.5)
    if plot.equal:
        on.set_aspect("equal", adjustable="datalim")
    if plot.y.categories:
        on.invert_yaxis()


def _draw_series(series: Series, on: Axes, bars: Sequence[Series], *, along_x: bool) -> None:
    """Draw a line, points, or one of the bars, which stand beside each other."""
    style, colour = series.style, _ink(series.style.colour)
    look: dict[str, Any] = {"color": colour, "label": series.name if series.listed else None}
    if series.spread is not None:
        low, high = series.spread
        look["xerr"] = (series.x - low, high - series.x)
    if series.mark == "bar":
        width = 0.8 / len(bars)
        shift = -0.4 + (bars.index(series) + 0.5) * width
        if along_x:
            on.barh(series.y + shift, series.x, width, **look)
        else:
            on.bar(series.x + shift, series.y, width, **look)
        return
    line = {"triangle": ":"}.get(style.symbol, "--") if style.dashed else "-"
    look |= {
        "linestyle": "none" if series.mark == "points" else line, "linewidth": style.width * 0.75,
        "alpha": 0.4 if style.colour == INK and not style.dashed else 1.0,
        "marker": "" if series.mark == "line" else _MARKERS[style.symbol], "markersize": 4.5,
        "markerfacecolor": "white" if style.dashed else colour,
    }  # fmt: skip
    if series.spread is None:
        on.plot(series.x, series.y, **look)
    else:
        on.errorbar(series.x, series.y, elinewidth=0.8, **look)


def _ink(colour: str) -> str:
    return "#1d2733" if colour == INK else colour
