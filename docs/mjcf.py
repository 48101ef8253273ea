"""Pictures of the committed MJCF, rendered by MuJoCo off screen: `python docs/generate.py mjcf`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.scene import SCENE_FILE, RecordedMotion
from trebucheck.models.mjcf.tree import joint_values

os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is loaded

_STILL, _MOVING = (640, 480), (320, 240)
_COLOURS = 64
_LAST = 8  # frames for which the last picture stays


def draw(mechanism: Mechanism, motion: RecordedMotion, folder: Path) -> None:
    """A picture at the end of the motion, `NAME.png`, and a moving one in real time, `NAME.gif`."""
    path = folder / SCENE_FILE
    still = Image.fromarray(next(_rendered(mechanism, motion.path[-1:], path, _STILL)))
    still.save(folder / f"{mechanism.name}.png", optimize=True)
    small = [Image.fromarray(pixels) for pixels in _rendered(mechanism, motion.path, path, _MOVING)]
    palette = _beside(small[0], small[-1]).quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in small)
    wait = round(1000 * motion.keyframes[-1].time / (len(small) - 1))
    first.save(
        folder / f"{mechanism.name}.gif",
        save_all=True,
        append_images=[*others, *[others[-1]] * _LAST],
        duration=wait,
        loop=0,
        optimize=False,
    )


def _beside(one: Image.Image, other: Image.Image) -> Image.Image:
    both = Image.new("RGB", (one.width + other.width, one.height))
    both.paste(one, (0, 0))
    both.paste(other, (one.width, 0))
    return both


def _rendered(
    mechanism: Mechanism, states: Sequence[Sequence[float]], path: Path, size: tuple[int, int]
) -> Iterator[Any]:
    """The scene in each state of a motion."""
    import mujoco

    library: Any = mujoco
    model = library.MjModel.from_xml_path(str(path))
    data = library.MjData(model)
    with library.Renderer(model, size[1], size[0]) as renderer:
        for q in states:
            data.qpos[:] = joint_values(mechanism, list(np.subtract(q, mechanism.start)))
            library.mj_forward(model, data)
            renderer.update_scene(data, "side")
            yield renderer.render().copy()
