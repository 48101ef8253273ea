"""A model of the zoo: a file, its mechanism, and how the joints of both correspond."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Literal

import numpy as np
from trebucheck.api.mechanics import FloatArray, Mechanism, Problem, StopLaw

Needs = Literal["limits", "loops", "contact"]
TIME_CONSTANT = 2e-3
"""Time constant of every limit, contact and equality of the files [s], by their `solref`."""


@dataclass(frozen=True)
class JointCoordinate:
    """A joint of a file: weighted sum of the mechanism's coordinates, plus its value at zero."""

    joint: str
    weights: Mapping[str, float]
    zero: float = 0.0
    """[rad or m]"""


@dataclass(frozen=True)
class FileVariant:
    """Another file of the same motion."""

    text: str
    total_mass: float
    """Total mass of its bodies [kg]."""


@dataclass(frozen=True)
class ZooModel:
    """A file of one feature.

    Raises:
        KeyError: a joint names a coordinate that the mechanism does not have.
    """

    name: str
    feature: str
    """Feature of the file that an importer must read, in some words."""
    mechanism: Mechanism
    joints: tuple[JointCoordinate, ...]
    """Joints in the order of the file, depth first, as in `qpos`; one coordinate each."""
    limits: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    """Ranges by joint [rad or m]."""
    needs: tuple[Needs, ...] = ()
    """Abilities that an importer needs to move it, beside a tree's equations of motion."""
    duration: float = 2.0
    """[s]"""
    stop_law: StopLaw = StopLaw.UNILATERAL
    text: str = ""
    """Text of the file, where it is not in the zoo's folder."""
    inertia_without_mass: float = 0.0
    """Mass of the mechanism that the file has as armature [kg]."""
    variants: Mapping[str, FileVariant] = field(default_factory=dict[str, FileVariant])
    """Variants by name, for importers that refuse or misread the file."""

    @property
    def problem(self) -> Problem:
        """The motion that is certified."""
        return Problem(self.mechanism, duration=self.duration, stop_law=self.stop_law)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the file."""
        return tuple(each.joint for each in self.joints)

    @property
    def weights(self) -> FloatArray:
        """W of joint values = W q + zeros, shape (n_q, n_q); joint speeds are W u."""
        columns = {name: i for i, name in enumerate(self.mechanism.coordinates)}
        weights = np.zeros((len(self.joints), len(columns)))
        for row, joint in zip(weights, self.joints, strict=True):
            for name, weight in joint.weights.items():
                row[columns[name]] = weight
        return weights

    @property
    def zeros(self) -> FloatArray:
        """Values of the joints where the mechanism's coordinates are zero, shape (n_q,)."""
        return np.array([joint.zero for joint in self.joints])

    @property
    def total_mass(self) -> float:
        """Total mass of the file's bodies [kg]."""
        return sum(body.mass for body in self.mechanism.bodies) - self.inertia_without_mass

    @property
    def xml(self) -> str:
        """The file's text."""
        return self.text or zoo_file(f"{self.name}.xml").decode()


def zoo_file(name: str) -> bytes:
    """A file of the zoo's folder.

    Raises:
        FileNotFoundError: there is none of that name.
    """
    return (files(__package__ or "") / "files" / name).read_bytes()
