"""The file of an engine's own that a mechanism was read from."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from .spec import Real, Spec


class ModelSource(Spec):
    """A model file, the start that it was given, and what was left out of it."""

    path: Path | None = Field(
        default=None,
        exclude_if=lambda path: path is None,
        description="of the file, from the root of the file system; none of a text",
    )
    text: str | None = Field(
        default=None,
        exclude_if=lambda text: text is None,
        description="of the file, where it was given as a text",
    )
    qpos: tuple[Real, ...] = Field(description="positions at the start, in the file's order")
    qvel: tuple[Real, ...] = Field(description="velocities at the start")
    control_times: tuple[Real, ...] = Field(
        description="[s], ascending from 0: controls are held from each to the next"
    )
    controls: tuple[tuple[Real, ...], ...] = Field(
        description="values of all actuators from each time on"
    )
    without: tuple[str, ...] = Field(default=(), description="features that were left out")
