"""The motion of a mechanism with engines' runs over the reference, each in its engine's colour."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...models.drawing.scene import RunLook, Scene, States, scene
from ...models.trajectory import Trajectory
from .plots import run_style

REFERENCE = "reference tuned"
"""Label of the run that is the reference itself."""


def motion_scene(states: States, runs: Mapping[str, Trajectory], **how: Any) -> Scene:
    """The data of an animation; a run of the reference's own is left out.

    Args:
        states: the reference motion at any times.
        runs: by label, such as 'mujoco tuned'.
        how: as :func:`...models.drawing.scene.scene` takes it.
    """
    looks: dict[str, RunLook] = {}
    for label, run in runs.items():
        if label != REFERENCE:
            style = run_style(run.provenance.engine, run.provenance.preset)
            looks[label] = RunLook(run, style.colour, style.dashed)
    return scene(states, looks, **how)
