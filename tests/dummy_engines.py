"""Engines that break one part of the interface each.

What an engine can do wrong beside moving wrongly.
"""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, ClassVar

import numpy as np
import trebucheck as tb
from plugin_engines import Echo
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.elements import GROUND, RotationalSpringDamper
from trebucheck.models.features import Basic, Feature, refuse_features
from wrong_engines import Honest, _markers, late

_RUNS = count()


@dataclass(frozen=True)
class Full(Echo):
    """The whole protocol, so that the registry adds nothing.

    What it does not declare it has to refuse itself.
    """

    name = "full"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        refuse_features(problem.mechanism, self.capabilities.features, self.name)
        return super().simulate(problem)


@dataclass(frozen=True)
class Everything(Full):
    """Declares all elements."""

    capabilities = replace(Echo.capabilities, features=frozenset(Feature))

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        return Echo.simulate(self, problem)


@dataclass(frozen=True)
class Weighty(Full):
    """An engine that needs an inertia of every body."""

    name = "weighty"
    capabilities = replace(Echo.capabilities, lacking=frozenset({Basic.POINT_MASS}))

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        if not all(body.inertia for body in problem.mechanism.bodies):
            raise tb.UnsupportedProblemError("weighty moves no point masses.")
        return super().simulate(problem)


class Accepter(Full):
    """Moves what it does not declare."""

    name = "accepter"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        return Echo.simulate(self, problem)


class Refuser(Everything):
    """Refuses what it declares."""

    name = "refuser"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        if problem.mechanism.stops:
            raise tb.UnsupportedProblemError("refuser has no stops.")
        return super().simulate(problem)


class Breaker(Full):
    """Fails instead of refusing."""

    name = "breaker"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        try:
            return super().simulate(problem)
        except tb.UnsupportedProblemError:
            raise IndexError("list index out of range") from None


class Random(Everything):
    """Another motion each time, by little."""

    name = "random"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        found = super().simulate(problem)
        return replace(found, q=found.q + 1e-9 * next(_RUNS))


class Remembering(Everything):
    """The first run is right.

    Later ones have the reactions of the run before, stretched to their length.
    """

    name = "remembering"
    kept: ClassVar[dict[str, Any]] = {}

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        found = super().simulate(problem)
        own = next(iter(found.joint_reactions.values()), np.zeros((1, 2)))
        last = self.kept.get("last")
        self.kept["last"] = own
        return (
            found
            if last is None
            else replace(
                found,
                joint_reactions={
                    n: np.resize(last, v.shape) for n, v in found.joint_reactions.items()
                },
            )
        )


def _corrupt() -> None:
    """Change whatever a process has one of."""
    os.chdir("/")
    os.environ.clear()
    sys.path.clear()
    sys.setrecursionlimit(150)
    warnings.simplefilter("error")
    np.seterr(all="raise")
    np.random.seed(1)
    np.interp = math.sqrt = None  # type: ignore[assignment]
    np.linalg.solve = lambda *_: np.zeros(1)  # type: ignore[assignment]
    Everything.simulate = Echo.simulate = None  # type: ignore[assignment,method-assign]
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


FAULTS: dict[str, Callable[[], object]] = {
    "incline": _corrupt,
    "catapult": lambda: ctypes.string_at(0),
    "bead": lambda: time.sleep(3600),
}
"""What is done after a motion, by its problem."""


class Fragile(Everything):
    """Moves rightly, and does something terrible to its process after some motions, but short
    ones."""

    name = "fragile"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        found = super().simulate(problem)
        fault = FAULTS.get(problem.mechanism.name)
        if fault is not None and problem.duration > 0.25:
            fault()
        return found


class Forgetful(Everything):
    """Is not made again from its settings."""

    name = "forgetful"

    @property
    def settings(self) -> dict[str, Any]:
        return {"timestep": 2 * self.timestep}


@dataclass(frozen=True)
class Growing(Everything):
    """Made with options, it has a setting more."""

    name = "growing"
    told: bool = False

    @classmethod
    def presets(cls) -> dict[str, Callable[..., tb.Engine]]:
        def make(**options: Any) -> tb.Engine:
            return cls(told=bool(options), **options)

        return {"assisted": make, "default": make}

    @property
    def settings(self) -> dict[str, Any]:
        return {"timestep": self.timestep} | ({"told": True} if self.told else {})


class Unmade(Everything):
    """Its settings are no options."""

    name = "unmade"

    @property
    def settings(self) -> dict[str, Any]:
        return {"step": self.timestep}


class OwnPreset(Everything):
    """Has a preset of a name of its own alone."""

    name = "own-preset"

    @classmethod
    def presets(cls) -> dict[str, Callable[..., tb.Engine]]:
        return {"best": cls}


class Versionless(Everything):
    """Fails when asked for its version."""

    name = "versionless"

    @classmethod
    def version(cls) -> str:
        return None  # type: ignore[return-value]


class Unversioned(Everything):
    """Its version is no text, in another way."""

    name = "unversioned"

    @classmethod
    def version(cls) -> str:
        return ""


class Uninstalled(Everything):
    """Is not here."""

    name = "uninstalled"

    @classmethod
    def is_installed(cls) -> bool:
        return False


class Bridged(Uninstalled):
    """Is no Python distribution, and says so."""

    name = "bridged"

    @classmethod
    def absence(cls) -> str:
        return "bridged runs in node, which is not on the path."


class Raising(Everything):
    """Fails as a careless library does."""

    name = "raising"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        raise ZeroDivisionError("careless")


@dataclass(frozen=True)
class Inspected(Everything):
    """Shows a model whose last body is two per cent too heavy; its motion is right."""

    name = "inspected"

    def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
        last = mechanism.bodies[-1]
        heavy = last.model_copy(update={"mass": 1.02 * last.mass})
        other = mechanism.model_copy(update={"bodies": (*mechanism.bodies[:-1], heavy)})
        return tb.engine("reference").inspect(other, states)  # type: ignore[attr-defined]


class Uninspectable(Inspected):
    """Fails when it is looked into."""

    name = "uninspectable"

    def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
        raise KeyError("hinge")


class Spoiled(Everything):
    """Spoils what it reads."""

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        return self.read(super().simulate(problem))

    def read(self, found: tb.Trajectory) -> tb.Trajectory:
        raise NotImplementedError


def _in_body(found: tb.Trajectory) -> tb.Trajectory:
    """Reactions in the child's axes."""
    turned = {}
    for joint in found.mechanism.joints:
        if joint.name in found.joint_reactions:
            angle = found.q[
                :, found.mechanism.coordinates.index(found.mechanism.body(joint.child).angle)
            ]
            z = np.array([1, 1j]) @ found.joint_reactions[joint.name].T * np.exp(1j * angle)
            turned[joint.name] = np.stack([z.real, z.imag], axis=1)
    return replace(found, joint_reactions=turned)


def _noisy(found: tb.Trajectory) -> tb.Trajectory:
    """Half a per cent of noise, the same each time."""
    noise = 1 + 5e-3 * np.sin(1e4 * np.arange(len(found.t)))
    return _markers(found, lambda m: replace(m, velocity=m.velocity * noise[:, None]))


def _interpolated(found: tb.Trajectory) -> tb.Trajectory:
    """Every hundredth sample, and straight lines between them."""
    few = np.unique([*range(0, len(found.t), 100), len(found.t) - 1])

    def drawn(values: Any) -> Any:
        return np.stack(
            [np.interp(found.t, found.t[few], c[few]) for c in values.reshape(len(found.t), -1).T],
            axis=1,
        )

    moved = _markers(
        found, lambda m: replace(m, position=drawn(m.position), velocity=drawn(m.velocity))
    )
    return replace(moved, q=drawn(found.q), u=drawn(found.u))


SPOILS: dict[str, Callable[[tb.Trajectory], tb.Trajectory]] = {
    "energy-zero": lambda f: replace(f, potential_energy=f.potential_energy + 500.0),
    "body-axes": _in_body,
    "stale-reactions": lambda f: replace(
        f, joint_reactions={n: np.vstack([v[:1], v[:-1]]) for n, v in f.joint_reactions.items()}
    ),
    "noisy": _noisy,
    "interpolated": _interpolated,
    "decreasing": lambda f: replace(f, t=np.concatenate([f.t[:-2], f.t[-2:][::-1]])),
    "integers": lambda f: replace(f, t=np.arange(len(f.t))),
    "late-all": late,
    "renamed-joint": lambda f: replace(
        f, joint_reactions={f"{n}!": v for n, v in f.joint_reactions.items()}
    ),
    "other-machine": lambda f: replace(
        f, mechanism=f.mechanism.model_copy(update={"gravity": 1.0})
    ),
    "swapped-coordinates": lambda f: replace(f, q=f.q[:, ::-1], u=f.u[:, ::-1]),
}


def _frictional(mechanism: tb.Mechanism) -> tb.Mechanism:
    """A damper in the first hinge."""
    brake = RotationalSpringDamper(
        name="friction",
        body=mechanism.bodies[0].name,
        relative_to=GROUND,
        stiffness=0.0,
        damping=200.0,
        rest_angle=0.0,
    )
    return mechanism.model_copy(update={"force_elements": (*mechanism.force_elements, brake)})


class Frictional(Honest):
    """Rubs in its first hinge."""

    name = "frictional"

    def built(self, mechanism: tb.Mechanism) -> tb.Mechanism:
        return _frictional(mechanism)


def _spoiled(name: str, spoil: Callable[[tb.Trajectory], tb.Trajectory]) -> type[Spoiled]:
    own = {"name": name, "read": lambda self, found: spoil(found), "__module__": __name__}
    return type(f"Dummy_{name.replace('-', '_')}", (Spoiled,), own)


SPOILED = {name: _spoiled(name, spoil) for name, spoil in SPOILS.items()}
globals().update({cls.__name__: cls for cls in SPOILED.values()})
