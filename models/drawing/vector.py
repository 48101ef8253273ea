"""Pictures of a scene as SVG: still ones of chosen instants, and one that plays by itself, without a script."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape

import numpy as np

from ..arrays import FloatArray
from .picture import PALETTE, Label, Mark, Picture, Stroke
from .scene import HOLD, play_times

_RATE = 15.0  # [1/s] of frames, between which points move along straight lines
_HIDDEN = "0"


def still(picture: Picture, times: Sequence[float]) -> str:
    """One instant [s]; of several the mechanism in all of them, the earlier the fainter, with its markers' traces."""
    marks = picture.frame(times[0]) if len(times) == 1 else _strobe(picture, sorted(times))
    return _file(picture, "\n".join(map(_element, marks)))


def _strobe(picture: Picture, times: Sequence[float]) -> list[Mark]:
    *before, last = times
    marks: list[Mark] = list(picture.traces(last))
    for k, time in enumerate(before):
        marks += picture.reference(time, 0.25 + 0.2 * k / len(before))
    marks += [*picture.reference(last)]
    marks += [stroke for run in picture.scene.runs for stroke in picture.run(run, last)]
    return [*marks, *picture.names(last), *picture.legend(f"{before[0]:.4g} to {last:.4g} s")]


def moving(picture: Picture) -> str:
    """The motion as SMIL animations of the marks' points; a program that plays none shows an instant with traces."""
    scene = picture.scene
    times = play_times(scene, _RATE)
    times += [times[-1]] * round(HOLD * _RATE)
    end = float(scene.t[-1])
    wanted = max(
        (event.time for event in scene.events if event.time > 0.4 * end), default=0.75 * end
    )
    film = _Film(times, min(range(len(times)), key=lambda k: abs(times[k] - wanted)))
    elements = [film.trace(stroke, scene.fine) for stroke in picture.traces(end)]
    frames = [_layers(picture, time) for time in times]
    for layer in zip(*frames, strict=True):
        for k in range(max(map(len, layer))):
            elements.append(film.mark([marks[k] if k < len(marks) else None for marks in layer]))
    legends = [[*picture.legend(picture.clock(time))] for time in times]
    elements += [*film.clock([marks[0] for marks in legends]), *map(_element, legends[0][1:])]
    return _file(picture, "\n".join(elements))


def _layers(picture: Picture, time: float) -> list[Sequence[Mark]]:
    """Marks of an instant, of the reference, of each run (none after its end), and the names."""
    runs = (
        tuple(picture.run(run, time, picture.thinner(k)))
        for k, run in enumerate(picture.scene.runs)
    )
    return [tuple(picture.reference(time)), *runs, tuple(picture.names(time))]


class _Film:
    """Elements whose attributes go through a value a frame, again and again."""

    def __init__(self, times: Sequence[float], poster: int) -> None:
        self.times, self.poster = times, poster
        self.duration = len(times) / _RATE

    def mark(self, marks: Sequence[Mark | None]) -> str:
        """A mark in all frames; hidden where it is None."""
        base = marks[self.poster] or next(mark for mark in marks if mark is not None)
        shapes = [_geometry(mark or base) for mark in marks]
        animations = [
            self._animation(name, [shape[name] for shape in shapes]) for name in shapes[0]
        ]
        seen = [_HIDDEN if mark is None else _opacity(mark) for mark in marks]
        return _element(base, "".join([*animations, self._animation("opacity", seen, jumps=True)]))

    def trace(self, stroke: Stroke, instants: FloatArray) -> str:
        """A path that grows: one dash of its whole length comes in from its beginning."""
        z = stroke.points[: len(instants)]
        along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z)))])
        left = [
            f"{along[-1] - length:.1f}"
            for length in np.interp(self.times, instants[: len(z)], along)
        ]
        look = f'fill="none" stroke="{stroke.line}" stroke-width="{stroke.width:.3g}" opacity="{stroke.opacity:.2g}"'
        dash = f'stroke-dasharray="{along[-1]:.1f}" stroke-dashoffset="{left[self.poster]}"'
        return f'<polyline points="{_points(z)}" {look} {dash}>{self._animation("stroke-dashoffset", left)}</polyline>'

    def clock(self, labels: Sequence[Mark]) -> Iterator[str]:
        """A label a frame, of which one is seen."""
        for label in dict.fromkeys(labels):
            seen = ["1" if other == label else _HIDDEN for other in labels]
            yield _element(label, self._switch(seen), opacity=seen[self.poster])

    def _switch(self, seen: Sequence[str]) -> str:
        """Opacity that changes a few times, by the times of its changes."""
        changes = [k for k in range(len(seen)) if k == 0 or seen[k] != seen[k - 1]]
        at = ";".join(f"{k / len(seen):.4f}" for k in changes)
        values = ";".join(seen[k] for k in changes)
        return self._element("opacity", values, f' calcMode="discrete" keyTimes="{at}"')

    def _animation(self, name: str, values: Sequence[str], *, jumps: bool = False) -> str:
        if len(set(values)) == 1:
            return ""
        if jumps:
            return self._switch(values)
        # Between lists of several lengths nothing can be interpolated.
        lengths = {value.count(" ") for value in values}
        return self._element(
            name, ";".join(values), ' calcMode="discrete"' if len(lengths) > 1 else ""
        )

    def _element(self, name: str, values: str, how: str) -> str:
        time = f'dur="{self.duration:.4g}s" repeatCount="indefinite"'
        return f'<animate attributeName="{name}" {time}{how} values="{values}"/>'


# --- Elements
# ---------------------------------------------------------------------------------------------------------


def _file(picture: Picture, body: str) -> str:
    width, height, title = picture.width, picture.height, escape(picture.scene.mechanism_title)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" font-family="system-ui, sans-serif"><title>{title}</title>\n'
        f'<rect width="{width}" height="{height}" fill="{PALETTE["surface"]}"/>\n{body}\n</svg>\n'
    )


def _element(mark: Mark, inner: str = "", opacity: str = "") -> str:
    """A mark, with its animations inside."""
    place = " ".join(f'{name}="{value}"' for name, value in _geometry(mark).items())
    seen = opacity or _opacity(mark)
    place += f' opacity="{seen}"' if seen != "1" else ""
    if isinstance(mark, Label):
        look = f'font-size="{mark.size:g}" fill="{mark.colour}" stroke="{PALETTE["surface"]}" stroke-width="3"'
        return f'<text {place} {look} paint-order="stroke">{escape(mark.text)}{inner}</text>'
    name = "circle" if mark.radius else "polyline"
    return (
        f"<{name} {place} {_look(mark)}>{inner}</{name}>"
        if inner
        else f"<{name} {place} {_look(mark)}/>"
    )


def _geometry(mark: Mark) -> dict[str, str]:
    if isinstance(mark, Label):
        return {"x": f"{mark.x:.1f}", "y": f"{mark.y:.1f}"}
    if mark.radius:
        at = complex(mark.points[0])
        return {"cx": f"{at.real:.2f}", "cy": f"{at.imag:.2f}", "r": f"{mark.radius:.2f}"}
    return {"points": _points(mark.points)}


def _points(points: Iterable[complex]) -> str:
    return " ".join(f"{z.real:.1f},{z.imag:.1f}" for z in points)


def _opacity(mark: Mark) -> str:
    return "1" if isinstance(mark, Label) else f"{mark.opacity:.2g}"


def _look(stroke: Stroke) -> str:
    look = f'fill="{stroke.fill or "none"}"'
    if stroke.line:
        look += f' stroke="{stroke.line}" stroke-width="{stroke.width:.3g}" stroke-linejoin="round"'
        look += ' stroke-dasharray="7 5"' if stroke.dashed else ' stroke-linecap="round"'
    return look
