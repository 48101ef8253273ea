"""Animations as files: GIF, MP4 and SVG, of the same drawing as in pages."""

from __future__ import annotations

import cmath
import io
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from ..arrays import ComplexArray
from ..errors import InputError
from ..files import write_bytes
from . import vector
from .picture import PALETTE, Label, Mark, Picture, Stroke
from .scene import HOLD, Scene, play_times

_SAMPLES = 2  # pixels that are drawn in each direction for one of the picture
_COLOURS = 96  # of a GIF, beside its background
_DASH = (7.0, 5.0)  # [px]


def refuse_missing(ending: str) -> None:
    """Raise InputError if what writes files of an ending is not installed."""
    if ending == ".mp4":
        _ffmpeg()


def save(scene: Scene, path: Path, width: int, at: Sequence[float] = ()) -> None:
    """Write an animation by the ending of the file's name, with deviations as the scene says.

    Args:
        scene: what is shown.
        path: ends in one of :data:`WRITERS`.
        width: of the picture [px].
        at: instants [s] of a still picture (SVG); none: the motion.

    Raises:
        UnwritableError: the folder cannot be written to.
    """
    picture = Picture(scene, 2 * (width // 2), scene.magnification)
    content = vector.still(picture, at).encode() if at else WRITERS[path.suffix.lower()](picture)
    write_bytes(path, content)


def _frames(picture: Picture, rate: float) -> Iterator[Image.Image]:
    for time in play_times(picture.scene, rate):
        yield raster(picture.frame(time), picture.width, picture.height)


# --- Files
# ------------------------------------------------------------------------------------------------------------


def _gif(picture: Picture, rate: float = 18.0) -> bytes:
    frames = list(_frames(picture, rate))
    palette = frames[-1].quantize(_COLOURS, dither=Image.Dither.NONE)
    images = [_indexed(frame, palette) for frame in frames]
    durations = [round(1e3 / rate)] * (len(images) - 1) + [round(1e3 * HOLD)]
    buffer = io.BytesIO()
    images[0].save(
        buffer,
        "gif",
        save_all=True,
        append_images=images[1:],
        duration=durations,
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def _indexed(frame: Image.Image, palette: Image.Image) -> Image.Image:
    """A frame in a palette's colours; the background as it is, which the search for a near colour would tint."""
    white = ImageColor.getrgb(PALETTE["surface"])
    colours = [*(palette.getpalette() or [])[: 3 * _COLOURS], *white]
    values = np.array(frame.quantize(palette=palette, dither=Image.Dither.NONE))
    values[np.all(np.asarray(frame) == white, axis=-1)] = len(colours) // 3 - 1
    indexed = Image.fromarray(values)
    indexed.putpalette(colours)
    return indexed


def _mp4(picture: Picture, rate: float = 30.0) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "video.mp4")
        writer = _ffmpeg().write_frames(
            str(path), (picture.width, picture.height), fps=rate, macro_block_size=2
        )
        writer.send(None)
        frame = b""
        for image in _frames(picture, rate):
            frame = image.tobytes()
            writer.send(frame)
        for _ in range(round(HOLD * rate)):
            writer.send(frame)
        writer.close()
        return path.read_bytes()


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InputError(
            "an .mp4 needs imageio-ffmpeg; `pip install trebucheck[video]` brings it."
        ) from None
    return imageio_ffmpeg


def _svg(picture: Picture) -> bytes:
    return vector.moving(picture).encode()


WRITERS: dict[str, Callable[[Picture], bytes]] = {".gif": _gif, ".mp4": _mp4, ".svg": _svg}
"""By the ending of a file's name."""


# --- Pixels
# -----------------------------------------------------------------------------------------------------------


def raster(marks: list[Mark], width: int, height: int) -> Image.Image:
    """Marks as pixels, smoothed."""
    brush = _Brush(width, height)
    for mark in marks:
        if isinstance(mark, Stroke):
            brush.stroke(mark)
    image = brush.image.reduce(_SAMPLES)
    draw = ImageDraw.Draw(image)
    for mark in marks:
        if isinstance(mark, Label):
            at, font = (mark.x, mark.y), _font(mark.size)
            draw.text(
                at,
                mark.text,
                mark.colour,
                font,
                "ls",
                stroke_width=2,
                stroke_fill=PALETTE["surface"],
            )
    return image


@cache
def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


@dataclass
class _Brush:
    """Draws strokes onto an image of several pixels for each."""

    width: int
    height: int

    def __post_init__(self) -> None:
        self.image = Image.new(
            "RGB", (self.width * _SAMPLES, self.height * _SAMPLES), PALETTE["surface"]
        )
        self.draw = ImageDraw.Draw(self.image)

    def stroke(self, stroke: Stroke) -> None:
        """A polyline, an area or a circle; colours of faint ones are mixed with the background's."""
        line, fill = (
            _mixed(colour, stroke.opacity) if colour else None
            for colour in (stroke.line, stroke.fill)
        )
        width = max(round(stroke.width * _SAMPLES), 1)
        if stroke.radius:
            self._circle(stroke, line, fill, width)
            return
        points = _within(stroke.points, self.width, self.height)
        if fill and len(points) > 2:
            self.draw.polygon(_flat(points), fill)
        if line:
            for part in _dashes(points) if stroke.dashed else [points]:
                self._line(part, line, width, round_ends=not stroke.dashed)

    def _circle(self, stroke: Stroke, line: str | None, fill: str | None, width: int) -> None:
        centre = complex(stroke.points[0])
        if stroke.dashed:
            rim = np.array(
                [centre + cmath.rect(stroke.radius, k * math.pi / 24) for k in range(49)]
            )
            for part in _dashes(rim):
                self._line(part, line or "", width, round_ends=False)
        elif abs(centre) < 20 * (self.width + self.height):
            outer = stroke.radius + (stroke.width / 2 if line else 0.0)
            box = [(centre.real - outer) * _SAMPLES, (centre.imag - outer) * _SAMPLES]
            box += [(centre.real + outer) * _SAMPLES, (centre.imag + outer) * _SAMPLES]
            self.draw.ellipse(box, fill, line, width if line else 0)

    def _line(self, points: ComplexArray, colour: str, width: int, *, round_ends: bool) -> None:
        flat = _flat(points)
        self.draw.line(flat, colour, width, joint="curve")
        if round_ends and width > 3:
            for x, y in (flat[0], flat[-1]):
                self.draw.ellipse(
                    [x - width / 2, y - width / 2, x + width / 2, y + width / 2], colour
                )


def _flat(points: ComplexArray) -> list[tuple[float, float]]:
    return [(float(z.real) * _SAMPLES, float(z.imag) * _SAMPLES) for z in points]


def _within(points: ComplexArray, width: int, height: int) -> ComplexArray:
    """Far points, of a much magnified deviation, nearer: a raster's coordinates are limited."""
    most = 20.0 * (width + height)
    return np.clip(points.real, -most, most) + 1j * np.clip(points.imag, -most, most)


def _dashes(points: ComplexArray) -> Iterator[ComplexArray]:
    """Pieces of a polyline."""
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    period, length = sum(_DASH), float(along[-1])
    for k in range(min(int(length / period) + 1, 500)):
        start, stop = k * period, min(k * period + _DASH[0], length)
        inner = along[(along > start) & (along < stop)]
        at = np.array([start, *inner, stop])
        if stop > start:
            yield np.interp(at, along, points.real) + 1j * np.interp(at, along, points.imag)


def _mixed(colour: str, opacity: float) -> str:
    parts = [
        (int(colour[i : i + 2], 16), int(PALETTE["surface"][i : i + 2], 16)) for i in (1, 3, 5)
    ]
    return "#" + "".join(f"{round(a * opacity + b * (1 - opacity)):02x}" for a, b in parts)
