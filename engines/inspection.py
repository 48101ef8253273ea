"""The model that an engine has built, read before any motion for the equivalence check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from ..models.arrays import FloatArray
from ..models.mechanism import Mechanism


@dataclass(frozen=True)
class State:
    """A state to look at the built model in: coordinates and speeds, each of shape (n_q,).

    `closed` are stops whose gap and gap speed are zero there and that push; every other stop is
    open (its gap is positive). They are stops that are closed at the mechanism's start: an engine
    may know no others.
    """

    q: FloatArray
    u: FloatArray
    closed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Dynamics:
    """The built model at one state, in the mechanism's coordinates; None: not exposed.

    With M a = f + G^T torques (and the loop joints' own forces): M the mass matrix, f all applied
    and centrifugal forces, f = Q - b.
    """

    accelerations: FloatArray
    """a, shape (n_q,) [rad/s^2 or m/s^2], the closed stops (and loops) held."""
    stop_torques: Mapping[str, float]
    """Of the closed stops [N m, or N of one on a point], positive where they push."""
    mass_matrix: FloatArray | None = None  # M, shape (n_q, n_q)
    forces: FloatArray | None = None  # f = Q - b, shape (n_q,)
    centres: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Centre of mass of each body in the world [m], shape (2,)."""
    stop_gaps: Mapping[str, float] = field(default_factory=dict[str, float])
    """The engine's own measure of its stops' gaps [rad, m]: zero for a closed one in its place."""
    joint_gaps: Mapping[str, float] = field(default_factory=dict[str, float])
    """How far its joints that close loops are apart along what they hold [m]: zero in each state;
    those that are not here are not exposed."""


@dataclass(frozen=True)
class Inspection:
    """The model that an engine has built, at the start and in each state asked for."""

    start: FloatArray
    start_speeds: FloatArray  # q and u as the built model starts, each of shape (n_q,)
    dynamics: tuple[Dynamics, ...]  # one a state asked for, in the same order
    total_mass: float | None = None
    """[kg]; None where the engine's bodies carry other masses by construction."""
    roundoff: float = 2.0**-53
    """Unit roundoff of the engine's numbers, from which the check's tolerances follow."""


@runtime_checkable
class Inspectable(Protocol):
    """An engine that shows its built model; others are compared as well, and reports say so."""

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Build the mechanism as `simulate` would, and read it in each state.

        Softness, start-up and step size are numerical options and not the model's: a soft stop is
        asked for its torque at rest.

        Raises:
            TrebucheckError: the mechanism cannot be built.
        """
        ...
