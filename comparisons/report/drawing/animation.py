"""An animation as HTML: the data of its scenes beside one script and one style sheet.

The script moves the points by the rows of :class:`....models.kinematics.Kinematics`: position =
offset + sum of coefficients times exp(-i q) (a slide: q, along a line that turns: q exp(-i q_c)).
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from ....models.arrays import FloatArray
from ....models.errors import InputError
from ....models.files import refuse_unwritable, write_text
from ....models.trajectory import Trajectory
from .files import WRITERS, refuse_missing, save
from .scene import RunLook, Scene, scene
from .sketch import MOVING

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # Okabe and Ito's
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
    refuse_missing(ending)
    refuse_unwritable(path.parent, path.name)


@dataclass(frozen=True, repr=False)
class Animation:
    """One or several mechanisms in motion, of which one is shown at a time."""

    scenes: Sequence[Scene]
    title: str = "animation"
    _cache: dict[str, str] = field(default_factory=dict[str, str], repr=False, compare=False)

    def fragment(self, identity: str = "animation") -> Markup:
        """HTML to be placed into a page that has :func:`assets`; `identity` is unique there."""
        if "data" not in self._cache:
            data = [scene_data(shown) for shown in self.scenes]
            text = json.dumps(data, separators=(",", ":"), allow_nan=False)
            self._cache["data"] = text.replace("<", "\\u003c")  # safe inside a script element
        data = Markup(self._cache["data"])
        fragment = template(__package__ or "", "assets/fragment.html.j2")
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
        save(self.scenes[0], path, width, instants)

    def __repr__(self) -> str:
        names = ", ".join(f"{shown.name} ({len(shown.runs)} runs)" for shown in self.scenes)
        return f"Animation of {names}"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, for a notebook."""
        frame = template(__package__ or "", "assets/frame.html.j2")
        return frame.render(page=self.to_html(), title=self.title)


def animation_of(reference: Trajectory, others: Sequence[Trajectory] = ()) -> Animation:
    """A trajectory in motion, with others of the same mechanism over it.

    Raises:
        InputError: another one is of another mechanism.
    """
    looks: dict[str, RunLook] = {}
    for k, other in enumerate(others):
        run = other.provenance
        label = f"{run.engine} {run.preset}"
        label = f"{label} ({k + 1})" if label in looks else label
        looks[label] = RunLook(other, _COLOURS[k % len(_COLOURS)], run.preset != "tuned")
    shown = scene(reference, looks)
    return Animation((shown,), f"{shown.mechanism_title}: the motion")


@cache
def assets() -> Markup:
    """Style and script of all animations of a page."""
    folder = files(__package__ or "").joinpath("assets")
    style = folder.joinpath("animation.css").read_text(encoding="utf-8")
    script = folder.joinpath("animation.js").read_text(encoding="utf-8")
    return Markup(f"<style>\n{style}</style>\n<script>\n{script}</script>")


@cache
def template(package: str, path: str) -> Template:
    """A template of HTML among the files of a package."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = files(package).joinpath(path).read_text(encoding="utf-8")
    return environment.from_string(text)


def scene_data(shown: Scene) -> dict[str, Any]:
    """Data from which the script draws a scene; arrays in base64, little-endian, by frame."""
    drawing, reference = shown.drawing, shown.reference
    mechanism = drawing.mechanism
    stops = [name for name in drawing.stops if name in reference.stop_torques]
    stop_rows: list[list[Any]] = []
    for name in stops:
        stop = mechanism.stop(name)
        sense = getattr(stop, "sense", 0)
        stop_rows.append([name, *drawing.stops[name], stop.force_unit, sense])
    torques = [reference.stop_torque(name)[:, None] for name in stops]
    joints: list[str] = []
    for joint in mechanism.joints:
        force = reference.joint_reactions.get(joint.name)
        told = force is not None and np.isfinite(force).all() and np.any(force)
        if joint.held_directions and told:
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
        aside = {name: _packed(values) for name, values in run.aside.items()}
        runs.append({
            "name": run.name, "colour": run.colour, "dashed": run.dashed, "d": _packed(run.d),
            "aside": aside, "torques": _forces(stops, run.torques, (len(shown.t), 1)),
            "forces": _forces(joints, run.forces, (len(shown.t), 2)),
        })  # fmt: skip
    return {
        "name": shown.name,
        "notes": shown.notes,
        "t": _packed(shown.t, "<f8"),
        "q": _packed(reference.q),
        "u": _packed(reference.u),
        "width": len(mechanism.coordinates),
        "angles": int(drawing.kinematics.is_angle.sum()),
        "carried": drawing.kinematics.carried,
        "points": points,
        "shapes": shapes,
        "markers": drawing.markers,
        "compared": drawing.compared,
        "box": [_short(edge) for edge in shown.box],
        "size": _short(drawing.size),
        "stops": stop_rows,
        "torques": _packed(np.hstack(torques)) if torques else "",
        "joints": [[name, drawing.joints[name]] for name in joints],
        "forces": _packed(np.hstack(forces)) if forces else "",
        "runs": runs,
        "events": [asdict(event) for event in shown.events],
        "magnification": math.log10(shown.magnification),
        "down": mechanism.gravity_direction,
    }


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
    return [unit, _packed(np.clip(values / unit, -_MOST_HALF, _MOST_HALF), "<f2")]


def _packed(values: FloatArray, kind: str = "<f4") -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _short(number: float) -> float:
    """A number to the digits that are drawn."""
    return float(f"{number:.{_DIGITS}g}") if math.isfinite(number) else 0.0
