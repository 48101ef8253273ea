"""Expected results of importing a file of one's own, from the mechanism that is read from it.

What the mechanism is, and that it is the file's, `trebucheck audit` shows; here the same file is
given to another program.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco as untyped
import numpy as np
from trebucheck.api.engines import ModelOptions, ModelStart
from trebucheck.api.mechanics import (
    Equations,
    FloatArray,
    InputError,
    Problem,
    StopLaw,
    UnsupportedProblemError,
    shortened,
    solve,
)
from trebucheck.api.studies import read_model_file

from .expected import Expected, Motion, rounding
from .zoo.model import Needs

mujoco: Any = untyped  # it has no types
STATES = 3
DURATION, SAMPLES = 1.0, 20  # [s] of the motion at most, and intervals in it
SHORTEST = 0.05  # [s] of a motion that tells anything
_STEP = 2.5e-4  # [s] longest of MuJoCo's in search of a contact
_SPREAD, _SPEEDS = 0.5, 1.0  # of random states about the file's own [rad or m] and [rad/s or m/s]
_TRIES = 1000
_INSIDE = 0.1  # of a range, from its ends
_COARSE = 1e-11  # tolerance of the second solution, whose difference bounds the first one's error


def expected_of_file(name: str) -> Expected:
    """Expected results of importing a file.

    Args:
        name: path of an MJCF or URDF file.

    Raises:
        TrebucheckError: no mechanism can be read from it, or it does not move freely for a while.
    """
    return _OwnFile(name).expected()


@dataclass(frozen=True)
class _OwnFile:
    """A file, its mechanism, and states of its joints."""

    name: str

    @cached_property
    def read(self) -> Any:
        """The file, as MuJoCo's reader has it: with coordinates of positions.

        It starts as the file does, or inside the ranges of joints that start beyond theirs.

        Raises:
            UnsupportedProblemError: it has a feature that no mechanism has.
        """
        try:
            qpos = np.array(self.compiled.qpos0)
            if len(qpos) != len(self.joints):  # a ball or a free joint, which the reader refuses
                return read_model_file(Path(self.name))
            low, high = self._ends
            start = np.where((qpos < low) | (qpos > high), self._inside(qpos), qpos)
            return read_model_file(Path(self.name), ModelStart(qpos=start.tolist()))
        except UnsupportedProblemError as error:
            what = str(error).partition("; --without")[0].rstrip(".")
            raise UnsupportedProblemError(
                f"{what}; another program would move it, and nothing here could judge that."
            ) from None

    @cached_property
    def compiled(self) -> Any:
        """The file, for the names, ranges and masses of what it has.

        Raises:
            InputError: MuJoCo does not compile it.
        """
        try:
            return mujoco.MjModel.from_xml_path(self.name)
        except ValueError as error:
            raise InputError(f"{self.name}: {shortened(str(error))}.") from None

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the positions.

        Raises:
            UnsupportedProblemError: one has no name.
        """
        names = [self.compiled.joint(j).name for j in range(self.compiled.njnt)]
        if "" in names:
            raise UnsupportedProblemError(
                f"{self.name}: joint {names.index('')} has no name, by which another program's "
                "joints could be found; each joint needs one."
            )
        return tuple(names)

    @cached_property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        """Ranges by joint [rad or m]."""
        ranges = zip(self.joints, self.compiled.jnt_range, self.compiled.jnt_limited, strict=True)
        return {name: (float(low), float(high)) for name, (low, high), limited in ranges if limited}

    @cached_property
    def rows(self) -> FloatArray:
        """C in u = C qvel, shape (n_q, n_joints)."""
        return self.read.speeds(np.eye(len(self.joints))).T

    @cached_property
    def weights(self) -> FloatArray:
        """W of joint speeds = W u."""
        return np.asarray(np.linalg.inv(self.rows), dtype=np.float64)

    @cached_property
    def offset(self) -> FloatArray:
        """Coordinates at joint positions of zero, shape (n_q,)."""
        return self.read.coordinates(np.zeros(len(self.joints)))

    def states(self) -> list[tuple[FloatArray, FloatArray]]:
        """Random positions and velocities of the joints; where loops or couplers are, the start.

        Positions are inside the ranges, and nothing touches.

        Raises:
            UnsupportedProblemError: something touches wherever the joints are.
        """
        start, random = np.array(self.compiled.qpos0), np.random.default_rng(1)
        if self.read.mechanism.bound_by:
            return [(start, np.zeros_like(start))]
        states, data = list[tuple[FloatArray, FloatArray]](), mujoco.MjData(self.compiled)
        for _ in range(_TRIES):
            qpos = start + random.uniform(-_SPREAD, _SPREAD, len(start))
            data.qpos[:] = self._inside(qpos)
            mujoco.mj_fwdPosition(self.compiled, data)
            if not data.ncon:
                states.append((np.array(data.qpos), random.uniform(-_SPEEDS, _SPEEDS, len(start))))
            if len(states) == STATES:
                return states
        raise UnsupportedProblemError(
            f"{self.name}: something touches in {_TRIES - len(states)} of {_TRIES} positions about "
            "the file's own, and accelerations are compared where nothing does."
        )

    @property
    def _ends(self) -> FloatArray:
        """Lower and upper ends of the ranges, infinite without one, shape (2, n_joints)."""
        ends = [self.limits.get(joint, (-math.inf, math.inf)) for joint in self.joints]
        return np.array(ends).T

    def _inside(self, qpos: FloatArray) -> FloatArray:
        """Positions brought into the ranges, away from their ends."""
        low, high = self._ends
        margin = np.where(np.isfinite(high - low), _INSIDE * (high - low), 0.0)
        return np.clip(qpos, low + margin, high - margin)

    def motion(self, qpos: FloatArray, qvel: FloatArray) -> Motion:
        """Motion from a state until a limit or a contact acts.

        Raises:
            UnsupportedProblemError: one does at once.
        """
        start = ModelStart(qpos=qpos.tolist(), qvel=qvel.tolist())
        read = read_model_file(Path(self.name), start)
        problem = Problem(read.mechanism, duration=DURATION, stop_law=StopLaw.UNILATERAL)
        fine, coarse = solve(problem), solve(problem, _COARSE, _COARSE)
        options = ModelOptions(read.options.integrator, min(_STEP, read.options.timestep))
        contact = read.moved(DURATION, options).contact
        # The first piece of the motion ends at its first event.
        end = min(fine.segments[0].end, DURATION if contact is None else contact)
        end -= 0.0 if end == DURATION else options.timestep
        if end < SHORTEST:
            raise UnsupportedProblemError(
                f"{self.name}: a limit or a contact acts after {max(end, 0.0):g} s, and motions "
                f"are compared without; one of {SHORTEST:g} s is needed."
            )
        t = np.linspace(0.0, end, SAMPLES + 1)
        first, second = (solution.motion(t) for solution in (fine, coarse))
        return Motion(
            end / SAMPLES,
            (first.q - self.offset) @ self.weights.T,
            first.u @ self.weights.T,
            np.abs(first.q - second.q) @ np.abs(self.weights).T,
        )

    def expected(self) -> Expected:
        """Masses, accelerations and a motion of the mechanism, by the file's joints."""
        if not Path(self.name).is_file():
            raise InputError(f"--models: there is no file {self.name!r}.")
        mechanism, equations = self.read.mechanism, Equations(self.read.mechanism)
        states = self.states()
        of_mechanism = [(self.offset + self.rows @ q, self.rows @ u) for q, u in states]
        needs: tuple[Needs, ...] = ("loops",) if mechanism.bound_by else ()
        model = self.compiled
        motion, at_zero = self.motion(*states[0]), self.weights @ self.offset
        masses, moving = np.array(model.body_mass), np.array(model.body_weldid) != 0
        return Expected(
            name=self.name,
            feature="your own file",
            xml=Path(self.name).read_text(),
            joints=self.joints,
            needs=needs,
            total_mass=None if masses[~moving].any() else float(masses.sum()),
            limits=self.limits,
            start=None,
            states=states,
            mass_matrices=np.array(
                [self.rows.T @ equations.mass_matrix(q) @ self.rows for q, _ in of_mechanism]
            ),
            accelerations=np.array(
                [self.weights @ equations.solve(q, u, ())[0] for q, u in of_mechanism]
            ),
            rounding=np.array([rounding(mechanism, self.weights, q + at_zero) for q, _ in states]),
            whole=motion,
            free=motion,
            has_events=False,
            resting_force=np.zeros(len(self.joints)),
            pressing=0.0,
            variants={},
            path=Path(self.name).resolve(),
        )
