"""Animations: as HTML, by a script and its data; as GIF, MP4 and SVG, by Matplotlib.

Both draw the same scene and shapes. The script moves the points by the rows of
:class:`....models.kinematics.Kinematics`: position = offset + sum of coefficients times exp(-i q)
(a slide: q, along a line that turns: q exp(-i q_c)).
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
import tempfile
import textwrap
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from ....models.arrays import ComplexArray, FloatArray
from ....models.errors import InputError
from ....models.files import refuse_unwritable, write_bytes, write_text
from .scene import HOLD, RunMotion, Scene, play_times
from .sketch import MOVING, Role, Shape, polylines

if TYPE_CHECKING:
    from matplotlib.artist import Artist

_NARROWEST, _WIDEST = 100, 4000  # [px]
_MOST_HALF = 65504.0  # the largest number of half precision
_DIGITS = 9  # of coefficients and sizes: more than a float32 has


def refuse_other_files(path: Path, width: int, at: Sequence[float] = ()) -> None:
    """Refuse, before anything is computed, a file that no animation can be written to.

    Raises:
        InputError: its ending is not known, what it needs is not installed, the picture's width
            [px] is not valid, or instants [s] are chosen for what is no still picture.
        UnwritableError: its folder cannot be written to.
    """
    ending = path.suffix.lower()
    if ending not in (*WRITERS, ".html"):
        raise InputError(f"{str(path)!r} must end in one of: {', '.join(WRITERS)}, .html.")
    if not _NARROWEST <= width <= _WIDEST:
        raise InputError(f"width = {width!r} px must be between {_NARROWEST} and {_WIDEST}.")
    if at and ending != ".svg":
        raise InputError(
            f"instants are chosen for a still picture (.svg), and {str(path)!r} is none."
        )
    if ending == ".mp4":
        _ffmpeg()  # refuses where it is not installed
    refuse_unwritable(path.parent, path.name)


@dataclass(frozen=True, repr=False)
class Animation:
    """One or several mechanisms in motion, of which one is shown at a time."""

    scenes: Sequence[Scene]
    title: str = "animation"
    _data: list[Markup] = field(default_factory=list[Markup], init=False, compare=False)
    """The scenes as JSON, once that was made."""

    def fragment(self, identity: str = "animation") -> Markup:
        """HTML to be placed into a page that has :func:`assets`; `identity` is unique there."""
        if not self._data:
            self._data.append(script_json([scene_data(shown) for shown in self.scenes]))
        fragment = template(__package__ or "", "assets/fragment.html.j2")
        (data,) = self._data
        return Markup(fragment.render(animation=self, identity=identity, data=data))

    def to_html(self) -> str:
        """A page of its own."""
        page = template(__package__ or "", "assets/page.html.j2")
        return page.render(animation=self, fragment=self.fragment(), assets=assets())

    def save(self, path: str | Path, width: int = 640, at: float | Sequence[float] = ()) -> None:
        """Write it: by its ending as GIF, MP4, SVG (all of which play by themselves) or HTML.

        Args:
            path: ends in .gif, .mp4, .svg or .html; only a page holds several mechanisms.
            width: of the picture [px].
            at: instant [s] of a still picture (.svg); several in one picture, the earlier fainter;
                else the motion.

        Raises:
            InputError: the ending is not known, what it needs is not installed, the width is not
                valid, there are several mechanisms, or an instant is not within the motion or the
                file no still picture.
            UnwritableError: the folder cannot be written to.
        """
        path = Path(path)
        instants = (float(at),) if isinstance(at, int | float) else tuple(map(float, at))
        refuse_other_files(path, width, instants)
        if path.suffix.lower() == ".html":
            write_text(path, self.to_html())
            return
        if len(self.scenes) != 1:
            count = len(self.scenes)
            raise InputError(
                f"{path} can show one mechanism, not {count}; a page (.html) shows several."
            )
        end = float(self.scenes[0].t[-1])
        for time in instants:
            if not 0 <= time <= end:
                raise InputError(f"at = {time!r} s is not within the motion, 0 to {end:.6g} s.")
        stage = Stage(self.scenes[0], width)
        if not instants:
            write_bytes(path, WRITERS[path.suffix.lower()](stage))
            return
        *before, last = sorted(instants)
        stage.show(last, before)
        write_bytes(path, _svg_of(stage))

    def __repr__(self) -> str:
        names = ", ".join(f"{shown.name} ({len(shown.runs)} runs)" for shown in self.scenes)
        return f"Animation of {names}"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, for a notebook."""
        frame = template(__package__ or "", "assets/frame.html.j2")
        return frame.render(page=self.to_html(), title=self.title)


@cache
def assets() -> Markup:
    """Style and script of all animations of a page."""
    style, script = (resource(__package__ or "", f"assets/animation.{e}") for e in ("css", "js"))
    return Markup(f"<style>\n{style}</style>\n<script>\n{script}</script>")


@cache
def template(package: str, path: str) -> Template:
    """A template of HTML among the files of a package."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(resource(package, path))


@cache
def resource(package: str, path: str) -> Markup:
    """The text of one of the files of a package."""
    return Markup(files(package).joinpath(path).read_text(encoding="utf-8"))


def script_json(value: object) -> Markup:
    """JSON that is safe inside a script element."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def scene_data(shown: Scene) -> dict[str, Any]:
    """Data from which the script draws a scene; arrays in base64, little-endian, by frame."""
    drawing, reference = shown.drawing, shown.reference
    mechanism = drawing.kinematics.mechanism
    stops = [name for name in drawing.stops if name in reference.stop_torques]
    stop_rows: list[list[Any]] = []
    for name in stops:
        stop = mechanism.stop(name)
        stop_rows.append([name, *drawing.stops[name], stop.force_unit, getattr(stop, "sense", 0)])
    torques = [reference.stop_torque(name)[:, None] for name in stops]
    joints: list[str] = []
    for joint in mechanism.joints:
        force = reference.joint_reactions.get(joint.name)
        recorded = force is not None and np.isfinite(force).all() and np.any(force)
        if joint.held_directions and recorded:
            joints.append(joint.name)
    forces = [reference.joint_reaction(name) for name in joints]
    # Offset x, y of each point, then triples of coordinate and coefficient.
    points: list[list[float]] = []
    for row in drawing.rows:
        offset = complex(row.offset)
        numbers = [_short(offset.real), _short(offset.imag)]
        for k, coefficient in enumerate(row.coefficients.tolist()):
            if coefficient:
                numbers += [k, _short(coefficient.real), _short(coefficient.imag)]
        points.append(numbers)
    shapes: list[list[Any]] = []
    for shape in drawing.shapes:
        path = [[_short(s), _short(aside)] for s, aside in shape.path]
        kind, size, moves = shape.kind, _short(shape.size), int(shape.role in MOVING)
        shapes.append([kind, shape.role, shape.points, size, path, shape.stop, moves])
    runs: list[dict[str, Any]] = []
    for run in shown.runs:
        aside = {name: packed(values) for name, values in run.aside.items()}
        runs.append({
            "name": run.name, "colour": run.colour, "dashed": run.dashed, "d": packed(run.d),
            "compared": run.compared,
            "aside": aside, "torques": _forces(stops, run.torques, (len(shown.t), 1)),
            "forces": _forces(joints, run.forces, (len(shown.t), 2)),
        })  # fmt: skip
    return {
        "name": shown.name, "notes": shown.notes, "label": shown.label, "horizon": shown.horizon,
        "t": packed(shown.t, "<f8"),
        "q": packed(reference.q), "u": packed(reference.u),
        "width": len(mechanism.coordinates), "angles": int(drawing.kinematics.is_angle.sum()),
        "carried": drawing.kinematics.carried, "points": points, "shapes": shapes,
        "markers": drawing.markers, "compared": drawing.compared,
        "box": [_short(edge) for edge in shown.box], "size": _short(drawing.size),
        "stops": stop_rows, "torques": packed(np.hstack(torques)) if torques else "",
        "joints": [[name, drawing.joints[name]] for name in joints],
        "forces": packed(np.hstack(forces)) if forces else "", "runs": runs,
        "events": [asdict(event) for event in shown.events],
        "magnification": math.log10(shown.magnification), "down": mechanism.gravity_direction,
    }  # fmt: skip


def _forces(
    names: Sequence[str], recorded: Mapping[str, FloatArray], shape: tuple[int, int]
) -> list[Any] | None:
    """Forces in half precision, beside their unit; None if the run tells none of them."""
    if not any(name in recorded for name in names):
        return None
    nothing = np.full(shape, np.nan)
    values = np.hstack([recorded.get(name, nothing).reshape(shape) for name in names])
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    unit = _short(float(np.median(sizes))) if len(sizes) else 1.0
    return [unit, packed(np.clip(values / unit, -_MOST_HALF, _MOST_HALF), "<f2")]


def _wrapped(text: str, letters: int) -> list[str]:
    """Lines of a text of at most so many letters."""
    return textwrap.wrap(text, max(letters, 20))


def packed(values: FloatArray, kind: str = "<f4") -> str:
    """An array in base64; what is beyond the kind's range is infinite, and not drawn."""
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(values, dtype=kind)
    return base64.b64encode(array.tobytes()).decode()


def _short(number: float) -> float:
    """A number to the digits that are drawn."""
    return float(f"{number:.{_DIGITS}g}") if math.isfinite(number) else 0.0


# --- Files by Matplotlib

PALETTE = {
    "ink": "#1d2733", "soft": "#5d6b7a", "line": "#dde3ea", "surface": "#ffffff",
    "body": "#c9a46a", "edge": "#7b5c2e", "mass": "#4b5967", "rope": "#7b6a4c",
    "ground": "#8593a1", "stop": "#a3542c", "force": "#b3261e",
}  # fmt: skip
"""The colours in which the script of pages prints."""
_FILLS: dict[Role, str] = {
    "mass": "mass", "body": "body", "joint": "surface", "ground": "line", "stop": "stop",
    "marker": "ink",
}  # fmt: skip
_LINES: dict[Role, str] = {
    "rope": "rope", "mass": "surface", "body": "edge", "joint": "edge", "ground": "ground",
    "guide": "ground", "stop": "stop", "centre": "edge",
}  # fmt: skip
_OF_BODIES = ("body", "mass", "rope")  # colours of what a motion has of its own
_DPI = 96  # pixels of CSS in an inch, so that an SVG is as wide as asked for
_FONT = 9.0  # points
_HALO = {"facecolor": PALETTE["surface"], "alpha": 0.7, "linewidth": 0, "pad": 0.5}
_POINT = 72 / _DPI  # points in a pixel
_LOWEST, _HIGHEST = 0.5, 1.0  # height of the picture in parts of its width
_LEFT, _ROW = 110, 20  # of the legend: its left edge and the height of a row [px]
_GIF_RATE, _MP4_RATE, _SVG_RATE = 18, 30, 10  # frames a second
_COLOURS = 96  # of a GIF
_SVG_NAMESPACE = "http://www.w3.org/2000/svg"


@dataclass(frozen=True)
class Pen:
    """A line's colour ("" draws none), width [px] and look; opacity is that of fills, too."""

    colour: str
    width: float
    opacity: float = 1.0
    dashed: bool = False

    @property
    def style(self) -> dict[str, Any]:
        """Matplotlib's options; dashes of 7 pixels have 5 between them."""
        dashes = (0.0, (7 / self.width, 5 / self.width)) if self.dashed else "-"
        return {"edgecolor": self.colour or "none", "linewidth": self.width * _POINT,
                "linestyle": dashes, "alpha": self.opacity}  # fmt: skip


class Stage:
    """A scene on a Matplotlib figure: axes in metres, and a band below them with the legend."""

    def __init__(self, scene: Scene, width: int = 640) -> None:
        from matplotlib.figure import Figure  # without pyplot: no window, no global state

        self.scene = scene
        self.width = 2 * (width // 2)  # videos need even numbers
        x0, y0, x1, y1 = scene.box
        share = min(max((y1 - y0) / (x1 - x0), _LOWEST), _HIGHEST)
        self.stage_height = 2 * round(self.width * share / 2)
        # Where each entry of the legend begins: x [px] and row; rows are as wide as the picture.
        entries: list[tuple[RunMotion | None, float, int]] = []
        x, row = float(_LEFT), 0
        for run in (None, *scene.runs) if scene.runs else ():
            room = 52 + 7.2 * len(run.name if run else scene.label)
            if x + room > self.width and x > _LEFT:
                x, row = float(_LEFT), row + 1
            entries.append((run, x, row))
            x += room
        self._texts = [*_wrapped(scene.warning, int((self.width - _LEFT) / 6.4))]
        if scene.magnification != 1:
            factor = scene.magnification
            times = f"{factor:,.0f}" if factor < 1e6 else f"{factor:.0e}"
            self._texts.append(f"deviations from the reference magnified {times} times")
        rows = 1 + row + len(self._texts)
        band = 2 * math.ceil((rows * _ROW + 12) / 2)
        self.height = self.stage_height + band
        self.scale = min(self.width / (x1 - x0), self.stage_height / (y1 - y0))  # pixels in a metre
        size = (self.width / _DPI, self.height / _DPI)
        self.figure = Figure(size, dpi=_DPI, facecolor=PALETTE["surface"])
        place = (0, band / self.height, 1, self.stage_height / self.height)
        self.traces, self.stage = (self._axes(place, name) for name in ("traces", "stage"))
        half_width = self.width / 2 / self.scale
        half_height = self.stage_height / 2 / self.scale
        for axes in (self.traces, self.stage):
            axes.set_xlim((x0 + x1) / 2 - half_width, (x0 + x1) / 2 + half_width)
            axes.set_ylim((y0 + y1) / 2 - half_height, (y0 + y1) / 2 + half_height)
        self.legend = self._axes((0, 0, 1, band / self.height), "legend")
        self.legend.set_xlim(0, self.width)
        self.legend.set_ylim(band, 0)
        self._draw_legend(entries, 1 + row)
        self._marked = list(scene.drawing.compared)
        # Positions of the compared points of the reference and each run at the fine instants [m].
        self._paths: list[tuple[RunMotion | None, ComplexArray]] = []
        for run in (None, *scene.runs):
            xy = scene.at(scene.fine, run, scene.magnification)[:, self._marked]
            self._paths.append((run, xy[..., 0] + 1j * xy[..., 1]))
        self._zorder = 0

    def _axes(self, place: tuple[float, float, float, float], name: str) -> Any:
        axes = self.figure.add_axes(place)
        axes.set_axis_off()
        axes.set_gid(name)
        return axes

    def _draw_legend(
        self, entries: Sequence[tuple[RunMotion | None, float, int]], rows: int
    ) -> None:
        """Draw the motions' lines and names, and below those rows what else is to be said."""
        for run, x, row in entries:
            y = 20 + _ROW * row
            name, colour, width, style = self.scene.label, PALETTE["body"], 7.0, "-"
            if run is not None:
                name, colour = run.name, run.colour
            if run is not None and run.compared:
                width, style = 2.5, (0, (2.8, 2)) if run.dashed else "-"
            self.legend.plot([x, x + 28], [y - 4, y - 4], color=colour, linestyle=style,
                             linewidth=width * _POINT, solid_capstyle="butt")  # fmt: skip
            self.legend.text(x + 34, y, name, color=PALETTE["soft"], fontsize=_FONT)
        for k, text in enumerate(self._texts):
            y = 20 + _ROW * (rows + k)
            self.legend.text(_LEFT, y, text, color=PALETTE["soft"], fontsize=_FONT)

    # --- Frames

    def show(self, time: float, before: Sequence[float] = (), traced: float = 0.0) -> None:
        """Draw an instant [s] in place of what is on the stage.

        Args:
            time: the instant.
            before: earlier ones, whose mechanisms are drawn behind it, the earlier the fainter.
            traced: where the traces up to the instant begin [s].
        """
        for axes in (self.stage, self.traces):
            for artist in (*axes.patches, *axes.texts):
                artist.remove()
        self._zorder = 0
        for k, earlier in enumerate(before):
            self._draw_reference(earlier, 0.25 + 0.2 * k / len(before))
        self._draw_reference(time)
        self._draw_runs(time)
        self._draw_names(time)
        if traced < time:
            self._draw_traces(traced, time)
        places = min(max(3 - math.floor(math.log10(self.scene.t[-1])), 0), 6)
        clock = f"{before[0]:.4g} to {time:.4g} s" if before else f"t = {time:.{places}f} s"
        lost = self.scene.horizon is not None and time > self.scene.horizon
        self.stage.text(10 / self.width, -20 / self.stage_height, clock,
                        color=PALETTE["force" if lost else "ink"],
                        fontsize=_FONT, va="baseline", transform=self.stage.transAxes)  # fmt: skip

    def points(self, time: float, run: RunMotion | None = None) -> ComplexArray:
        """Positions of all points [m], of a run with its deviations magnified."""
        xy = self.scene.at(np.array([time]), run, self.scene.magnification)[0]
        return xy[:, 0] + 1j * xy[:, 1]

    def pixels(self, z: ComplexArray) -> ComplexArray:
        """Points of the world [m] in the picture: x + i y [px], y down."""
        left, top = self.stage.get_xlim()[0], self.stage.get_ylim()[1]
        return np.asarray(self.scale * np.conj(z - complex(left, top)), dtype=np.complex128)

    def _draw_reference(self, time: float, opacity: float = 1.0) -> None:
        """Draw the mechanism; stops that have opened are faint."""
        z = self.points(time)
        opened = {
            event.stop
            for event in self.scene.events
            if event.kind == "release" and event.stop and event.time < time
        }
        for shape in self.scene.drawing.shapes:
            faint = 0.3 if shape.stop in opened else 1.0
            self._draw_shape(shape, z[list(shape.points)], opacity * faint)

    def _draw_runs(self, time: float) -> None:
        """Draw what moves of each run over the reference; nothing after the run's end."""
        for k, run in enumerate(self.scene.runs):
            z = self.points(time, run)
            if not np.isfinite(z).all():
                continue
            if not run.compared:
                for shape in self.scene.drawing.shapes:
                    self._draw_shape(shape, z[list(shape.points)], 1.0, run.colour)
                continue
            # Lines of later runs are thinner, so that of lines that coincide each is seen.
            width = 1.6 + 1.1 * min(len(self.scene.runs) - 1 - k, 7)
            pen = Pen(run.colour, width, dashed=run.dashed)
            thin = Pen(run.colour, 0.6 * width, dashed=run.dashed)
            for shape in self.scene.drawing.shapes:
                if shape.role not in MOVING:
                    continue
                at = z[list(shape.points)]
                fine = shape.kind in ("between", "spiral")
                self._lines(polylines(shape, at), thin if fine else pen, run.name)
                if shape.kind == "disc" and shape.role == "marker":
                    self._disc(at[0], shape.size, Pen("", 0.0), run.colour, run.name)
                elif shape.kind == "disc":
                    self._disc(at[0], shape.size, pen, "", run.name)

    def _draw_names(self, time: float) -> None:
        """Write the markers' names beside them; below each other where they would overlap."""
        pixels = self.pixels(self.points(time))
        taken: list[complex] = []
        for name, index in self.scene.drawing.markers.items():
            pixel = complex(pixels[index])
            at = complex(min(pixel.real + 9, self.width - 7.0 * len(name)), pixel.imag - 8)
            while any(abs((at - t).real) < 90 and abs((at - t).imag) < 13 for t in taken):
                at += 14j
            taken.append(at)
            place = (at.real / self.width, 1 - at.imag / self.stage_height)
            self.stage.text(*place, name, color=PALETTE["soft"], fontsize=_FONT, zorder=10_000,
                            bbox=_HALO, transform=self.stage.transAxes)  # fmt: skip

    def _draw_traces(self, start: float, end: float) -> None:
        """Draw the paths of the compared points between two instants [s]."""
        inner = (self.scene.fine > start) & (self.scene.fine < end)
        for run, fine in self._paths:
            first, last = (self.points(time, run)[self._marked][None] for time in (start, end))
            pen = Pen(PALETTE["soft"], 1.6, 0.8)
            if run is not None:
                pen = Pen(run.colour, 1.2, 0.8, run.dashed)
            for path in np.concatenate([first, fine[inner], last]).T:
                known = path[np.isfinite(path)]
                if len(known) > 1 and np.ptp(known.real) + np.ptp(known.imag) > 0:
                    self.traces.add_artist(_path_of([known], pen))

    # --- Shapes

    def _draw_shape(self, shape: Shape, z: ComplexArray, opacity: float, colour: str = "") -> None:
        """Draw a shape from the positions of its points [m].

        Args:
            shape: of the mechanism.
            z: positions, x + i y.
            opacity: of lines and areas.
            colour: of bodies and ropes that are not the reference's.
        """
        size, kind, role = shape.size * self.scale, shape.kind, shape.role
        palette = {**PALETTE, **dict.fromkeys(_OF_BODIES, colour)} if colour else PALETTE
        if kind == "arrow":
            self._arrow(z[0], z[1], max(size, 7) / self.scale, opacity)
        elif kind == "turn":
            self._turn(z[0], shape.path[0][0], max(size, 10) / self.scale, opacity)
        elif role == "body" and kind != "disc":
            lines, width = polylines(shape, z), max(size, 2)
            self._lines(lines, Pen(palette["edge"], width + 2, opacity))
            if kind == "area":
                self._area(lines[0], palette["body"], opacity)
            self._lines(lines, Pen(palette["body"], width, opacity))
        elif role == "centre" and kind == "disc":
            # The sign of a centre of mass: a disc of which two quarters are filled.
            radius = max(size, 3) / self.scale
            self._disc(z[0], radius, Pen("", 0.0, opacity), palette["surface"])
            for start in (0.0, math.pi):
                arc = radius * np.exp(1j * np.linspace(start, start + math.pi / 2, 9))
                self._area(z[0] + np.append(arc, 0.0), palette["ink"], opacity)
            self._disc(z[0], radius, Pen(palette["ink"], 1.0, opacity))
        else:
            line = "" if role == "marker" else palette[_LINES.get(role, "soft")]
            fill, width = "", max(size, 1.5)
            if kind in ("hatch", "wheel"):
                width = 1.2
            elif kind in ("disc", "area"):
                width, fill = 1.3, palette[_FILLS[role]] if role in _FILLS else ""
            pen = Pen(line, width, opacity)
            if kind == "area":
                self._area(z, fill, opacity, pen)
            else:
                self._lines(polylines(shape, z), pen)
            if kind in ("disc", "wheel"):
                rim = Pen(line, 2.2, opacity) if kind == "wheel" else pen
                self._disc(z[0], shape.size, rim, fill, role)

    def _arrow(self, tail: complex, tip: complex, head: float, opacity: float) -> None:
        length = abs(tip - tail)
        if length * self.scale > 1:
            back = (tip - tail) / length * min(head, 0.6 * length)
            pen = Pen(PALETTE["force"], 2.0, opacity)
            self._lines([np.array([tail, tip - 0.8 * back])], pen)
            corners = np.array([tip, tip - back * (1 + 0.4j), tip - back * (1 - 0.4j)])
            self._area(corners, PALETTE["force"], opacity)

    def _turn(self, centre: complex, sweep: float, radius: float, opacity: float) -> None:
        """Draw an arc with a head, from the top; a positive sweep [rad] is clockwise."""
        pixel, sign = 1 / self.scale, math.copysign(1.0, sweep)
        end = math.pi / 2 - sweep
        back = end + sign * min(9.0 * pixel, 0.6 * radius) / radius
        arc = centre + radius * np.exp(1j * np.linspace(math.pi / 2, back, 33))
        pen = Pen(PALETTE["force"], 2.0, opacity)
        self._lines([np.asarray(arc, dtype=np.complex128)], pen)
        corners = [(radius, end), (radius - 4 * pixel, back), (radius + 4 * pixel, back)]
        head = np.array([centre + r * np.exp(1j * angle) for r, angle in corners])
        self._area(head, PALETTE["force"], opacity)

    # --- Artists

    def _add(self, artist: Artist, name: str = "") -> None:
        """Put an artist on the stage, above those before it."""
        self._zorder += 1
        artist.set_zorder(self._zorder)
        if name:
            artist.set_gid(name)
        self.stage.add_artist(artist)

    def _lines(self, lines: Sequence[ComplexArray], pen: Pen, name: str = "") -> None:
        """Draw polylines [m] of one look as one path."""
        if lines and pen.colour:
            self._add(_path_of(lines, pen), name)

    def _area(
        self, corners: ComplexArray, fill: str, opacity: float, pen: Pen | None = None
    ) -> None:
        from matplotlib.patches import Polygon

        xy = np.column_stack([corners.real, corners.imag])
        style = (pen or Pen("", 0.0, opacity)).style
        self._add(Polygon(xy, facecolor=fill or "none", joinstyle="round", **style))

    def _disc(
        self, centre: complex, radius: float, pen: Pen, fill: str = "", name: str = ""
    ) -> None:
        """Draw a circle, of a radius [m] of 1.5 pixels at least."""
        from matplotlib.patches import Circle

        at, radius = (centre.real, centre.imag), max(radius, 1.5 / self.scale)
        self._add(Circle(at, radius, facecolor=fill or "none", **pen.style), name)


def _path_of(lines: Sequence[ComplexArray], pen: Pen) -> Artist:
    """Polylines [m] as one path."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    curves = [Curve(np.column_stack([line.real, line.imag])) for line in lines]
    path, cap = Curve.make_compound_path(*curves), "butt" if pen.dashed else "round"
    return PathPatch(path, fill=False, joinstyle="round", capstyle=cap, **pen.style)


# --- Files


def _svg_of(stage: Stage) -> bytes:
    """The figure as SVG; the same scene gives the same bytes."""
    import matplotlib as mpl

    style: Any = {"svg.hashsalt": "trebucheck", "svg.fonttype": "none"}
    out = io.BytesIO()
    with mpl.rc_context(style | {"font.sans-serif": ["DejaVu Sans"]}):
        stage.figure.savefig(out, format="svg", dpi=_DPI, metadata={"Date": None})
    return out.getvalue()


def _svg(stage: Stage) -> bytes:
    """Frames in one SVG, of which one is seen at a time (SMIL); the traces' pieces stay.

    A program that plays no SMIL shows one instant with its traces.
    """
    ET.register_namespace("", _SVG_NAMESPACE)
    ET.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    times = play_times(stage.scene, _SVG_RATE)
    end = times[-1]
    late = [event.time for event in stage.scene.events if event.time > 0.4 * end]
    instant = max(late, default=0.75 * end)
    shown_still = min(range(len(times)), key=lambda k: abs(times[k] - instant))
    duration = len(times) / _SVG_RATE + HOLD
    root: ET.Element | None = None
    layers: dict[str, list[ET.Element]] = {"traces": [], "stage": []}
    for k, time in enumerate(times):
        stage.show(time, traced=times[max(k - 1, 0)])
        tree = ET.fromstring(_svg_of(stage))
        begin, finish = k / _SVG_RATE / duration, (k + 1) / _SVG_RATE / duration
        finish = 1.0 if k == len(times) - 1 else finish
        for parent in [*tree.iter()]:
            for layer in [*parent]:
                name = layer.get("id", "")
                if name == "traces":
                    _play(layer, f"path-{k}", k <= shown_still, begin, 1.0, duration)
                elif name == "stage":
                    _play(layer, f"frame-{k}", k == shown_still, begin, finish, duration)
                if name in layers:
                    layers[name].append(layer)
                    parent.remove(layer)
        root = tree if root is None else root
    assert root is not None
    # Of what does not change (background, legend, clip paths) the first frame's is kept.
    group = next(element for element in root.iter() if element.get("id") == "figure_1")
    group.extend([*layers["traces"], *layers["stage"]])
    # Layout between elements says nothing, and hundredths of a point are enough of a path.
    text = re.sub(r">\s+<", "><", ET.tostring(root, encoding="unicode"))
    digits = re.compile(r"(\.\d\d)\d+")
    return re.sub(r' d="[^"]+"', lambda d: digits.sub(r"\1", d.group()), text).encode()


def _play(
    layer: ET.Element, name: str, seen: bool, begin: float, end: float, duration: float
) -> None:
    """Make a layer visible from `begin` to `end`, in parts of the duration [s]."""
    layer.set("id", name)
    layer.set("visibility", "visible" if seen else "hidden")
    changes = [(0.0, "hidden"), (begin, "visible"), (end, "hidden")]
    if begin == 0.0:
        del changes[0]
    if end >= 1.0:
        del changes[-1]
    ET.SubElement(
        layer, f"{{{_SVG_NAMESPACE}}}animate", attributeName="visibility", calcMode="discrete",
        dur=f"{duration:.4g}s", repeatCount="indefinite",
        keyTimes=";".join(f"{time:.5f}" for time, _ in changes),
        values=";".join(value for _, value in changes),
    )  # fmt: skip


def _gif(stage: Stage) -> bytes:
    """Frames in the colours of the last one, which stays for a while."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(stage.figure)
    frames: list[Image.Image] = []
    for time in play_times(stage.scene, _GIF_RATE):
        stage.show(time)
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    palette = frames[-1].quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    images = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1e3 / _GIF_RATE)] * (len(images) - 1) + [round(1e3 * HOLD)]
    out = io.BytesIO()
    images[0].save(out, "gif", save_all=True, append_images=images[1:], duration=durations, loop=0,
                   optimize=True)  # fmt: skip
    return out.getvalue()


def _mp4(stage: Stage) -> bytes:
    """Frames as a film; the last one stays for a while."""
    import matplotlib as mpl
    from matplotlib.animation import FFMpegWriter

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "motion.mp4")
        with mpl.rc_context({"animation.ffmpeg_path": _ffmpeg()}):
            writer = FFMpegWriter(fps=_MP4_RATE, codec="libx264")
            with writer.saving(stage.figure, str(path), _DPI):
                for time in play_times(stage.scene, _MP4_RATE):
                    stage.show(time)
                    writer.grab_frame()
                for _ in range(round(HOLD * _MP4_RATE)):
                    writer.grab_frame()
        return path.read_bytes()


def _ffmpeg() -> str:
    """Path of ffmpeg.

    Raises:
        InputError: the package that brings it is not installed.
    """
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InputError(
            "an .mp4 needs imageio-ffmpeg; `pip install trebucheck[video]` brings it."
        ) from None
    return str(imageio_ffmpeg.get_ffmpeg_exe())


WRITERS: dict[str, Callable[[Stage], bytes]] = {".gif": _gif, ".mp4": _mp4, ".svg": _svg}
"""Writers by the ending of a file's name."""
