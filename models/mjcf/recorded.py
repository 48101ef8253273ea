"""Certified motion that a model file keeps: events as keyframes, and the path for pictures.

A motion is data here, made by whoever has a solver; those of the named machines are stored beside
their MJCF.
"""

from __future__ import annotations

from importlib.resources import files

from pydantic import Field

from ..mechanism import Mechanism
from ..spec import Real, Spec
from .tree import valid_names

HOME = "home"
"""The keyframe of the start, speeds included."""
RECORDED_FILE = "motion.json"


class Keyframe(Spec):
    """A state of a motion, in the mechanism's coordinates."""

    name: str
    time: Real = Field(description="[s]")
    q: tuple[Real, ...] = Field(description="[rad or m]")
    u: tuple[Real, ...] = Field(description="[rad/s or m/s]")


class RecordedMotion(Spec):
    """Events of a motion, and where it goes between them."""

    mechanism_hash: str
    keyframes: tuple[Keyframe, ...]
    path: tuple[tuple[Real, ...], ...] = Field(
        description="q at evenly spaced times, rounded: for pictures only"
    )


def stored_motion(mechanism: Mechanism) -> RecordedMotion | None:
    """The stored motion of exactly this mechanism; None if there is none."""
    file = files(__package__ or "") / mechanism.name / RECORDED_FILE
    if not file.is_file():
        return None
    motion = RecordedMotion.from_json(file.read_bytes())
    return motion if motion.mechanism_hash == mechanism.content_hash else None


def event_names(events: list[tuple[str, str]]) -> list[str]:
    """Unique names of keyframes for stops and their events ("release", "impact", "rest").

    "hanger rest" and "release" give "hanger_release"; a second event of that name is
    "hanger_release_2".
    """
    taken, names = {HOME}, list[str]()
    for stop, what in events:
        short = stop.removesuffix(" rest").removesuffix(" stop")
        (name,) = valid_names([f"{short}_{what}" if short else what], taken).values()
        names.append(name)
        taken.add(name)
    return names
