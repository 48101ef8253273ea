"""A frame of a scene as strokes and labels in pixels, from which SVG and raster pictures are made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import ComplexArray
from .paths import polylines
from .scene import RunMotion, Scene
from .shapes import MOVING, Role, Shape

PALETTE = {
    "ink": "#1d2733",
    "soft": "#5d6b7a",
    "line": "#dde3ea",
    "surface": "#ffffff",
    "body": "#c9a46a",
    "edge": "#7b5c2e",
    "mass": "#4b5967",
    "rope": "#7b6a4c",
    "ground": "#8593a1",
    "stop": "#a3542c",
    "force": "#b3261e",
}
"""The colours in which the script prints."""
_FILLS: dict[Role, str] = {
    "mass": "mass", "body": "body", "joint": "surface", "ground": "line", "stop": "stop", "marker": "ink"
}  # fmt: skip
_LINES: dict[Role, str] = {
    "rope": "rope", "mass": "surface", "body": "edge", "joint": "edge", "ground": "ground", "guide": "ground",
    "stop": "stop", "centre": "edge",
}  # fmt: skip


@dataclass(frozen=True)
class Stroke:
    """A polyline, or a circle about its one point where it has a radius; in pixels, y down."""

    points: ComplexArray
    line: str = ""
    """Colour; '' for none."""
    width: float = 1.0
    fill: str = ""
    radius: float = 0.0
    dashed: bool = False
    opacity: float = 1.0


@dataclass(frozen=True)
class Label:
    """A text whose baseline begins at a point."""

    x: float
    y: float
    text: str
    colour: str = PALETTE["soft"]
    size: float = 12.0


Mark = Stroke | Label


@dataclass(frozen=True)
class Picture:
    """A scene within a frame of so many pixels; a band below the picture has the legend."""

    scene: Scene
    width: int = 720
    magnification: float = 1.0
    least: float = 0.5
    most: float = 1.0
    """Height of the picture in parts of its width, at least and at most."""

    @cached_property
    def stage(self) -> int:
        """Height of the picture itself [px], even."""
        x0, y0, x1, y1 = self.scene.box
        return 2 * round(self.width * min(max((y1 - y0) / (x1 - x0), self.least), self.most) / 2)

    @property
    def height(self) -> int:
        """With the legend [px], even."""
        return self.stage + 2 * math.ceil((self._legend_rows * 20 + 12) / 2)

    @cached_property
    def _scale(self) -> float:
        x0, y0, x1, y1 = self.scene.box
        return min(self.width / (x1 - x0), self.stage / (y1 - y0))

    def _px(self, z: ComplexArray) -> ComplexArray:
        x0, y0, x1, y1 = self.scene.box
        middle = complex(x0 + x1, y0 + y1) / 2
        return _array(complex(self.width, self.stage) / 2 + self._scale * np.conj(z - middle))

    # --- Frames
    # -----------------------------------------------------------------------------------------------------

    def frame(self, time: float, *, names: bool = True, traces: bool = True) -> list[Mark]:
        """All marks of an instant [s]."""
        marks: list[Mark] = [*(self.traces(time) if traces else ()), *self.reference(time)]
        for k, run in enumerate(self.scene.runs):
            marks += self.run(run, time, self.thinner(k))
        marks += self.names(time) if names else ()
        return [*marks, *self.legend(self.clock(time))]

    def clock(self, time: float) -> str:
        """An instant [s], in words."""
        places = min(max(3 - math.floor(math.log10(self.scene.t[-1])), 0), 6)
        return f"t = {time:.{places}f} s"

    def points(self, time: float, run: RunMotion | None = None) -> ComplexArray:
        """Positions of all points [m], of a run with its deviations magnified."""
        xy = self.scene.at(np.array([time]), run, self.magnification)[0]
        return xy[:, 0] + 1j * xy[:, 1]

    def reference(self, time: float, opacity: float = 1.0) -> Iterator[Mark]:
        """The mechanism; stops that have opened are faint."""
        z = self.points(time)
        opened = {
            event.stop
            for event in self.scene.events
            if event.kind == "release" and event.time < time
        }
        for shape in self.scene.drawing.shapes:
            for stroke in self._shape(shape, z[list(shape.points)]):
                yield replace(
                    stroke, opacity=opacity * (0.3 if shape.stop in opened and shape.stop else 1.0)
                )

    def run(self, run: RunMotion, time: float, width: float = 2.0) -> Iterator[Stroke]:
        """A run's lines over it; none after the run's end."""
        z = self.points(time, run)
        if not np.isfinite(z).all():
            return
        for shape in self.scene.drawing.shapes:
            if shape.role in MOVING:
                own = z[list(shape.points)]
                lines = [self._px(each) for each in polylines(shape, own)]
                fine = 0.6 * width if shape.kind in ("between", "spiral") else width
                yield from (Stroke(line, run.colour, fine, dashed=run.dashed) for line in lines)
                if shape.kind == "disc":
                    radius = max(shape.size * self._scale, 1.5)
                    if shape.role == "marker":
                        yield Stroke(self._px(own), fill=run.colour, radius=radius)
                    else:
                        yield Stroke(
                            self._px(own), run.colour, width, radius=radius, dashed=run.dashed
                        )

    def thinner(self, k: int) -> float:
        """Lines of later runs are thinner, so that of lines that coincide each is seen."""
        return 1.6 + 1.1 * min(len(self.scene.runs) - 1 - k, 7)

    def traces(self, time: float) -> Iterator[Stroke]:
        """Paths of the markers up to an instant."""
        for run in (None, *self.scene.runs):
            paths = self._paths[run.name if run else None][self.scene.fine <= time]
            here = self.points(time, run)[self._marked]
            for whole in np.vstack([paths, here[None]]).T:
                path = whole[np.isfinite(whole)]
                if len(path) > 1 and np.ptp(path.real) + np.ptp(path.imag) > 0:
                    colour, width = (run.colour, 1.2) if run else (PALETTE["soft"], 1.6)
                    yield Stroke(
                        self._px(path), colour, width, dashed=bool(run and run.dashed), opacity=0.8
                    )

    @cached_property
    def _marked(self) -> list[int]:
        return list(self.scene.drawing.compared)

    @cached_property
    def _paths(self) -> dict[str | None, ComplexArray]:
        """Positions of the marked points in all frames [m], by run; of the reference by None."""
        paths = {
            run.name if run else None: self.scene.at(self.scene.fine, run, self.magnification)[
                :, self._marked
            ]
            for run in (None, *self.scene.runs)
        }
        return {name: path[..., 0] + 1j * path[..., 1] for name, path in paths.items()}

    def names(self, time: float) -> Iterator[Label]:
        """Of the markers, beside them and below each other."""
        z = self._px(self.points(time))
        taken: list[complex] = []
        for name, index in self.scene.drawing.markers.items():
            at = complex(
                min(float(z[index].real) + 9, self.width - 7.0 * len(name)),
                float(z[index].imag) - 8,
            )
            while any(
                abs((at - other).real) < 90 and abs((at - other).imag) < 13 for other in taken
            ):
                at += 14j
            taken.append(at)
            yield Label(at.real, at.imag, name)

    # --- Legend
    # -----------------------------------------------------------------------------------------------------

    @cached_property
    def _places_of_runs(self) -> list[tuple[RunMotion | None, float, int]]:
        """Where each entry of the legend begins: x [px] and row; rows are as wide as the picture."""
        places: list[tuple[RunMotion | None, float, int]] = []
        x, row = 110.0, 0
        for run in (None, *self.scene.runs) if self.scene.runs else ():
            width = 52 + 7.2 * len(run.name if run else "reference")
            if x + width > self.width and x > 110:
                x, row = 110.0, row + 1
            places.append((run, x, row))
            x += width
        return places

    @property
    def _legend_rows(self) -> int:
        return (
            1
            + max((row for *_, row in self._places_of_runs), default=0)
            + (self.magnification != 1)
        )

    def legend(self, clock: str) -> Iterator[Mark]:
        """The clock, the runs' lines and names, and by what deviations are magnified."""
        top = self.stage + 20.0
        yield Label(10, top, clock, PALETTE["ink"])
        for run, x, row in self._places_of_runs:
            y = top + 20 * row
            line = np.array([complex(x, y - 4), complex(x + 28, y - 4)])
            colour, width = (run.colour, 2.5) if run else (PALETTE["body"], 7.0)
            yield Stroke(line, colour, width, dashed=bool(run and run.dashed))
            yield Label(x + 34, y, run.name if run else "reference")
        if self.magnification != 1:
            y = top + 20 * (self._legend_rows - 1)
            yield Label(
                110,
                y,
                f"deviations from the reference magnified {_times(self.magnification)} times",
            )

    # --- Shapes
    # -----------------------------------------------------------------------------------------------------

    def _shape(self, shape: Shape, z: ComplexArray) -> Iterator[Stroke]:
        """A shape of the reference, from the positions of its points [m]."""
        lines, at, size = (
            [self._px(each) for each in polylines(shape, z)],
            self._px(z),
            shape.size * self._scale,
        )
        if shape.kind in ("arrow", "turn"):
            tail, tip = (
                (at[0], at[1]) if shape.kind == "arrow" else (at[0], complex(shape.path[0][0]))
            )
            yield from (
                _arrow(tail, tip, max(size, 7))
                if shape.kind == "arrow"
                else _turn(tail, tip.real, size)
            )
        elif shape.role == "body" and shape.kind != "disc":
            fill = PALETTE["body"] if shape.kind == "area" else ""
            yield Stroke(lines[0], PALETTE["edge"], max(size, 2) + 2)
            yield Stroke(lines[0], PALETTE["body"], max(size, 2), fill)
        elif shape.role == "centre" and shape.kind == "disc":
            yield from _centre(at, max(size, 3))
        else:
            yield from self._plain(shape, lines, at, size)

    def _plain(
        self, shape: Shape, lines: Sequence[ComplexArray], at: ComplexArray, size: float
    ) -> Iterator[Stroke]:
        filled = shape.kind in ("disc", "area")
        fill = PALETTE[_FILLS[shape.role]] if filled and shape.role in _FILLS else ""
        colour = "" if shape.role == "marker" else PALETTE[_LINES.get(shape.role, "soft")]
        width = 1.3 if filled else 1.2 if shape.kind in ("hatch", "wheel") else max(size, 1.5)
        yield from (Stroke(line, colour, width, fill) for line in lines)
        if shape.kind in ("disc", "wheel"):
            yield Stroke(
                at[:1], colour, 2.2 if shape.kind == "wheel" else width, fill, radius=max(size, 1.5)
            )


def _centre(at: ComplexArray, radius: float) -> Iterator[Stroke]:
    """The sign of a centre of mass."""
    yield Stroke(at, fill=PALETTE["surface"], radius=radius)
    for start in (0.0, math.pi):
        arc = at[0] + radius * np.exp(1j * np.linspace(start, start + math.pi / 2, 9))
        yield Stroke(np.array([at[0], *arc, at[0]]), fill=PALETTE["ink"])
    yield Stroke(at, PALETTE["ink"], 1.0, radius=radius)


def _arrow(tail: complex, tip: complex, head: float) -> Iterator[Stroke]:
    length = abs(tip - tail)
    if length > 1:
        back = (tip - tail) / length * min(head, 0.6 * length)
        yield Stroke(np.array([tail, tip - 0.8 * back]), PALETTE["force"], 2.0)
        corners = [tip, tip - back * (1 + 0.4j), tip - back * (1 - 0.4j), tip]
        yield Stroke(np.array(corners), fill=PALETTE["force"])


def _turn(centre: complex, sweep: float, size: float) -> Iterator[Stroke]:
    """An arc with a head; clockwise as seen, y down."""
    radius, sign = max(size, 10.0), math.copysign(1.0, sweep)
    end = sweep - math.pi / 2
    back = end - sign * min(9.0, 0.6 * radius) / radius
    arc = centre + radius * np.exp(1j * np.linspace(-math.pi / 2, back, 33))
    yield Stroke(_array(arc), PALETTE["force"], 2.0)
    head = [
        centre + r * np.exp(1j * a)
        for r, a in ((radius, end), (radius - 4, back), (radius + 4, back))
    ]
    yield Stroke(np.array([*head, head[0]]), fill=PALETTE["force"])


def _array(z: object) -> ComplexArray:
    return np.asarray(z, dtype=np.complex128)


def _times(factor: float) -> str:
    return f"{factor:,.0f}" if factor < 1e6 else f"{factor:.0e}"
