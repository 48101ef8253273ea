"""Engines of a third party, for tests of the extension point: one honest, some not."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import trebucheck as tb
from pydantic import JsonValue

ENTRY_POINTS = """[trebucheck.engines]
echo = plugin_engines:Echo
liar = plugin_engines:Liar
raiser = plugin_engines:Raiser
crasher = plugin_engines:Crasher
plain = plugin_engines:Plain
strange = plugin_engines:Strange
sleeper = plugin_engines:Sleeper
second = plugin_engines:Second
"""


def announce(
    folder: Path, name: str = "trebucheck-test-plugins", entry_points: str = ENTRY_POINTS
) -> None:
    """Write the metadata of an installed distribution that brings engines, by default these."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)


@dataclass(frozen=True)
class Echo:
    """Gives the reference back under another name."""

    name = "echo"
    capabilities = tb.Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(tb.StopLaw),
        formulation="borrowed",
    )
    timestep: float = 1e-3
    preset: str = "assisted"

    @property
    def settings(self) -> dict[str, JsonValue]:
        return {"timestep": self.timestep}

    @classmethod
    def presets(cls) -> dict[str, Callable[..., tb.Engine]]:
        return {"assisted": cls, "default": partial(cls, preset="default")}

    @classmethod
    def is_installed(cls) -> bool:
        return True

    @classmethod
    def version(cls) -> str:
        return "1.0"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        return tb.engine("reference", timestep=self.timestep).simulate(problem)


class Liar(Echo):
    """Moves a heavier projectile."""

    name = "liar"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        other = tb.fixed(tb.TrebuchetParameters(m_b=60.06))
        found = super().simulate(tb.Problem(other, duration=problem.duration))
        return replace(found, mechanism=problem.mechanism)


class Second(Echo):
    """Its error is of second order.

    Everything that moves the mechanism is larger by the square of the step.
    """

    name = "second"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        given, factor = problem.mechanism, 1.0 + self.timestep**2
        speeds = tuple(speed * factor for speed in given.start_speeds)
        stronger = given.model_copy(
            update={"gravity": given.gravity * factor, "start_speeds": speeds}
        )
        found = super().simulate(
            tb.Problem(stronger, duration=problem.duration, stop_law=problem.stop_law)
        )
        return replace(found, mechanism=given)


class Stiff(Echo):
    """Takes springs for twice as stiff."""

    name = "stiff"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        given = problem.mechanism
        stiff = tuple(
            element.model_copy(update={"stiffness": 2 * element.stiffness})
            if isinstance(element, tb.SpringDamper)
            else element
            for element in given.force_elements
        )
        other = given.model_copy(update={"force_elements": stiff})
        found = super().simulate(problem.model_copy(update={"mechanism": other}))
        return replace(found, mechanism=given)


class Raiser(Echo):
    """Fails as a careless library does."""

    name = "raiser"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        raise ZeroDivisionError("careless")


class Crasher(Echo):
    """Takes its process down, as a fault in compiled code does."""

    name = "crasher"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        os.abort()


class Mended(Echo):
    """Takes its process down unless the file is there that the environment names."""

    name = "mended"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        if not Path(os.environ["MENDED"]).exists():
            os.abort()
        return super().simulate(problem)


class Sleeper(Echo):
    """Never comes to an end."""

    name = "sleeper"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        time.sleep(3600)
        raise AssertionError("unreachable")


@dataclass(frozen=True)
class Plain:
    """As plug-ins were before the protocol had `preset`, `settings` and `timestep`.

    A dataclass of its options.
    """

    name = "plain"
    capabilities = Echo.capabilities
    timestep: float = 1e-2

    @classmethod
    def presets(cls) -> dict[str, Callable[..., Any]]:
        return {"assisted": cls, "default": cls}

    @classmethod
    def is_installed(cls) -> bool:
        return True

    @classmethod
    def version(cls) -> str:
        return "1.0"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        return tb.engine("reference", timestep=self.timestep).simulate(problem)


class Strange(Plain):
    """The same, but that it takes no option."""

    name = "strange"

    def __init__(self) -> None:
        super().__init__()
