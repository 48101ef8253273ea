"""An animation as HTML: the data of its scenes beside one script and one style sheet.

The script moves the points by the rows of :class:`....models.kinematics.Kinematics`: position =
offset + sum of coefficients times exp(-i q) (a slide: q, along a line that turns: q exp(-i q_c)).
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from ....models.arrays import FloatArray
from ....models.errors import InputError
from ....models.files import refuse_unwritable, write_text
from ....models.trajectory import Trajectory
from .files import WRITERS, refuse_missing, save
from .scene import RunLook, RunMotion, Scene, SceneEvent, scene
from .sketch import MOVING, Drawing, Shape

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
        return Markup(
            _template("fragment.html.j2").render(animation=self, identity=identity, data=self._data)
        )

    def to_html(self) -> str:
        """A page of its own."""
        return _template("page.html.j2").render(
            animation=self, fragment=self.fragment(), assets=assets()
        )

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
            raise InputError(
                f"{path} can show one mechanism, not {len(self.scenes)}; a page (.html) shows "
                "several."
            )
        end = float(self.scenes[0].t[-1])
        for time in instants:
            if not 0 <= time <= end:
                raise InputError(f"at = {time!r} s is not within the motion, 0 to {end:.6g} s.")
        save(self.scenes[0], path, width, instants)

    def __repr__(self) -> str:
        names = ", ".join(f"{each.name} ({len(each.runs)} runs)" for each in self.scenes)
        return f"Animation of {names}"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, for a notebook."""
        page = _template("frame.html.j2").render(page=self.to_html(), title=self.title)
        return str(page)

    @property
    def _data(self) -> Markup:
        """The scenes as JSON that may stand in a script element."""
        if "data" not in self._cache:
            text = json.dumps(
                [scene_data(each) for each in self.scenes], separators=(",", ":"), allow_nan=False
            )
            self._cache["data"] = text.replace("<", "\\u003c")
        return Markup(self._cache["data"])


def animation_of(reference: Trajectory, others: Sequence[Trajectory] = ()) -> Animation:
    """A trajectory in motion, with others of the same mechanism over it.

    Raises:
        InputError: another one is of another mechanism.
    """
    looks: dict[str, RunLook] = {}
    for k, other in enumerate(others):
        label = f"{other.provenance.engine} {other.provenance.preset}"
        label = f"{label} ({k + 1})" if label in looks else label
        looks[label] = RunLook(
            other, _COLOURS[k % len(_COLOURS)], other.provenance.preset != "tuned"
        )
    shown = scene(reference, looks)
    return Animation((shown,), f"{shown.mechanism_title}: the motion")


@cache
def assets() -> Markup:
    """Style and script of all animations of a page."""
    folder = files(__package__ or "").joinpath("assets")
    style, script = (
        folder.joinpath(f"animation.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")
    )
    return Markup(f"<style>\n{style}</style>\n<script>\n{script}</script>")


@cache
def _template(name: str) -> Any:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(
        files(__package__ or "").joinpath("assets", name).read_text(encoding="utf-8")
    )


def scene_data(shown: Scene) -> dict[str, Any]:
    """Data from which the script draws a scene; arrays in base64, little-endian, by frame."""
    drawing, reference = shown.drawing, shown.reference
    kinematics = drawing.kinematics
    stops = [name for name in drawing.stops if name in reference.stop_torques]
    joints = [
        j.name
        for j in drawing.mechanism.joints
        if j.held_directions and _shows_force(shown, j.name)
    ]
    torques = [reference.stop_torque(name)[:, None] for name in stops]
    return {
        "name": shown.name,
        "notes": shown.notes,
        "t": _packed(shown.t, "<f8"),
        "q": _packed(reference.q),
        "u": _packed(reference.u),
        "width": len(drawing.mechanism.coordinates),
        "angles": int(kinematics.is_angle.sum()),
        "carried": kinematics.carried,
        "points": _points(drawing),
        "shapes": [_shape(shape) for shape in drawing.shapes],
        "markers": drawing.markers,
        "compared": drawing.compared,
        "box": [_short(edge) for edge in shown.box],
        "size": _short(drawing.size),
        "stops": [_stop(drawing, name) for name in stops],
        "torques": _packed(np.hstack(torques)) if torques else "",
        "joints": [[name, drawing.joints[name]] for name in joints],
        "forces": _packed(np.hstack([reference.joint_reaction(name) for name in joints]))
        if joints
        else "",
        "runs": [_run(run, stops, joints, len(shown.t)) for run in shown.runs],
        "events": [_event(event) for event in shown.events],
        "magnification": math.log10(shown.magnification),
        "down": drawing.mechanism.gravity_direction,
    }


def _shows_force(shown: Scene, joint: str) -> bool:
    forces = shown.reference.joint_reactions.get(joint)
    return forces is not None and bool(np.isfinite(forces).all()) and bool(np.any(forces))


def _stop(drawing: Drawing, name: str) -> list[Any]:
    stop = drawing.mechanism.stop(name)
    return [name, *drawing.stops[name], stop.force_unit, getattr(stop, "sense", 0)]


def _points(drawing: Drawing) -> list[list[Any]]:
    """Offset x, y of each point, and triples of coordinate and coefficient."""
    rows: list[list[Any]] = []
    for row in drawing.rows:
        terms = [
            (k, _short(c.real), _short(c.imag))
            for k, c in enumerate(row.coefficients.tolist())
            if c
        ]
        offset = complex(row.offset)
        rows.append(
            [
                _short(offset.real),
                _short(offset.imag),
                *(number for term in terms for number in term),
            ]
        )
    return rows


def _shape(shape: Shape) -> list[Any]:
    path = [[_short(s), _short(aside)] for s, aside in shape.path]
    return [
        shape.kind,
        shape.role,
        shape.points,
        _short(shape.size),
        path,
        shape.stop,
        int(shape.role in MOVING),
    ]


def _run(
    run: RunMotion, stops: Sequence[str], joints: Sequence[str], frames: int
) -> dict[str, Any]:
    return {
        "name": run.name,
        "colour": run.colour,
        "dashed": run.dashed,
        "d": _packed(run.d),
        "aside": {name: _packed(values) for name, values in run.aside.items()},
        "torques": _told(stops, run.torques, np.full((frames, 1), np.nan)),
        "forces": _told(joints, run.forces, np.full((frames, 2), np.nan)),
    }


def _told(
    names: Sequence[str], told: Mapping[str, FloatArray], nothing: FloatArray
) -> list[Any] | None:
    """Forces in half precision, beside their unit; None if the run tells none of them."""
    if not any(name in told for name in names):
        return None
    values = np.hstack(
        [told[name].reshape(nothing.shape) if name in told else nothing for name in names]
    )
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    unit = _short(float(np.median(sizes))) if len(sizes) else 1.0
    return [unit, _packed(np.clip(values / unit, -_MOST_HALF, _MOST_HALF), "<f2")]


def _event(event: SceneEvent) -> dict[str, Any]:
    return {
        "kind": event.kind,
        "name": event.name,
        "time": event.time,
        "reference": event.reference,
        "runs": event.runs,
        "stop": event.stop,
    }


def _packed(values: FloatArray, kind: str = "<f4") -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _short(number: float) -> float:
    """A number to the digits that are drawn."""
    return float(f"{number:.{_DIGITS}g}") if math.isfinite(number) else 0.0
