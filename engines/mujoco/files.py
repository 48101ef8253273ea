"""Model files that MuJoCo compiles: MJCF and URDF."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...models.controls import ControlRecord
from ...models.errors import InputError, UnsupportedProblemError, shortened
from ...models.files import read_bytes
from ...models.mechanism import Mechanism
from ...models.model_source import ModelSource
from ..given import ModelStepper
from ..study import ModelStart
from .compat import CALLBACK, mujoco
from .planar import MUJOCO, PlanarModel, as_name, planar_model

_LARGEST = 20_000_000  # [B] of a file
_BLANK = "\ufeff \t\r\n"  # before a text: a byte order mark, too
_MIMICS = re.compile(rb"<\s*mimic\b")


def read_model(source: str | Path | Any, start: ModelStart) -> PlanarModel:
    """Read a planar mechanism from a file, its text, or a compiled model.

    Args:
        source: a path, the text of a file, or a `mujoco.MjModel`.
        start: positions, velocities, controls, and what is left out.

    Raises:
        InputError: the file or the start is not valid.
        UnsupportedProblemError: as of :func:`.planar.planar_model`.
    """
    model, name = _compiled(source)
    given = _of_keyframe(model, name, start.keyframe)
    for what, values in (("qpos", start.qpos), ("qvel", start.qvel), ("ctrl", start.ctrl)):
        if values is not None:
            is_record = isinstance(values, ControlRecord)
            given[what] = values if is_record else np.array(values, dtype=np.float64)
    read = planar_model(model, name, without=start.without, **given)
    return replace(read, mechanism=_with_source(read, source, start))


def reread(source: ModelSource, stepper: ModelStepper = MUJOCO) -> PlanarModel:
    """Read a mechanism again from what it was read from.

    Args:
        source: the file or its text, with the start.
        stepper: engine that is to move the file.

    Raises:
        InputError: the file cannot be read, or the start is not one of it.
    """
    record = ControlRecord(np.array(source.control_times), np.array(source.controls))
    start = ModelStart(None, source.qpos, source.qvel, record, source.without)
    given = source.path or source.text
    assert given is not None  # one of the two is there
    return replace(read_model(given, start), stepper=stepper)


def _with_source(read: PlanarModel, source: str | Path | Any, start: ModelStart) -> Mechanism:
    """The mechanism, which remembers a file or its text; a compiled model cannot be kept."""
    if not isinstance(source, str | Path):
        return read.mechanism
    is_text = _is_text(source)
    remembered = ModelSource(
        path=None if is_text else Path(source).absolute(),
        text=str(source) if is_text else None,
        qpos=tuple(read.qpos.tolist()),
        qvel=tuple(read.qvel.tolist()),
        control_times=tuple(read.controls.times.tolist()),
        controls=tuple(map(tuple, read.controls.values.tolist())),
        without=tuple(sorted(start.without)),
    )
    return read.mechanism.model_copy(update={"source": remembered})


def _is_text(source: str | Path) -> bool:
    return isinstance(source, str) and source.lstrip(_BLANK).startswith("<")


def _compiled(source: str | Path | Any) -> tuple[Any, str]:
    """The compiled model, and a name for the mechanism."""
    if isinstance(source, mujoco.MjModel):
        return source, _name(source, "model")
    if not isinstance(source, str | Path):
        raise InputError(
            f"a {type(source).__name__} is no model file; valid are its path, its text and a "
            "compiled mujoco.MjModel."
        )
    is_text = _is_text(source)
    where = "the MJCF text" if is_text else str(source)
    content = str(source).encode() if is_text else read_bytes(Path(source), _LARGEST)
    try:
        with CALLBACK:
            if is_text:
                model = mujoco.MjModel.from_xml_string(str(source).lstrip(_BLANK))
            else:
                model = mujoco.MjModel.from_xml_path(str(source))
    except ValueError as error:
        raise InputError(f"{where}: MuJoCo cannot read it: {shortened(str(error))}.") from None
    if not model.neq and _MIMICS.search(content):
        raise UnsupportedProblemError(
            f"{where} has a joint that follows another one (<mimic>), which MuJoCo "
            f"{mujoco.__version__} passes over; later versions read it."
        )
    return model, _name(model, "model" if is_text else Path(source).stem)


def _name(model: Any, otherwise: str) -> str:
    """Name of a compiled model, as far as it is a name here."""
    given = model.names[: model.names.find(b"\0")].decode(errors="replace")
    wanted = given if given and given != "MuJoCo Model" else otherwise
    return as_name(wanted, "model")


def _of_keyframe(model: Any, name: str, keyframe: str | int | None) -> dict[str, Any]:
    """Positions, velocities and controls of a keyframe."""
    if keyframe is None:
        return {}
    names = [model.key(k).name or str(k) for k in range(model.nkey)]
    wanted = str(keyframe)
    if wanted not in names and wanted.isdigit() and int(wanted) < model.nkey:
        wanted = names[int(wanted)]
    if wanted not in names:
        has = f"has the keyframes {', '.join(names)}" if names else "has no keyframe"
        raise InputError(f"there is no keyframe {keyframe!r}: {name!r} {has}.")
    k = names.index(wanted)
    for body in np.flatnonzero(model.body_mocapid >= 0).tolist():
        mocap = int(model.body_mocapid[body])
        moved = model.key_mpos[k].reshape(-1, 3)[mocap] != model.body_pos[body]
        turned = model.key_mquat[k].reshape(-1, 4)[mocap] != model.body_quat[body]
        if moved.any() or turned.any():
            raise UnsupportedProblemError(
                f"the keyframe {wanted!r} of {name!r} moves the mocap body "
                f"{model.body(body).name!r}, which a mechanism holds where the file has it."
            )
    return {
        "qpos": np.array(model.key_qpos[k]),
        "qvel": np.array(model.key_qvel[k]),
        "ctrl": np.array(model.key_ctrl[k]),
    }
