"""Units in which a mechanism is neither small nor large, for engines with absolute tolerances.

MuJoCo has a least inertia (1e-15 kg m^2) and Exudyn a residual that is small enough (1e-9 N). A
mechanism of a few millimetres or grams, or of kilometres, or that hardly moves in a second, is
built in units of its own: powers of two, so that no number is rounded, and of lengths the square of
those of times, so that gravity keeps its number, unless the motion would be slow. What an engine
records is read back in SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol, Self, TypeVar

import numpy as np
from pydantic import Field

from ..models.arrays import FloatArray
from ..models.elements import AnyStop, Coupler, refuse_unknown
from ..models.errors import SimulationError, UnsupportedProblemError
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..models.spec import Spec, number_units
from ..models.trajectory import PointMotion
from .inspection import Dynamics, Inspection, State
from .protocol import EngineOptions, Recording
from .supplied import Assistance, Part

_Dimension = tuple[int, int, int]  # powers of length, mass and time
_LENGTH_UNIT: _Dimension = (1, 0, 0)
_DIMENSIONS: Mapping[str, _Dimension] = {
    "m": _LENGTH_UNIT,
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "N": (1, 1, -2),
    "rad": (0, 0, 0),
}


def dimension(unit: str) -> _Dimension:
    """Dimension of a unit such as "N m/rad^2": powers of length, mass and time.

    Raises:
        KeyError: the unit has a part that is not m, kg, s, N or rad.
    """
    total = np.zeros(3, dtype=int)
    for sign, part in zip((1, -1), unit.partition("/")[::2], strict=True):
        for factor in part.split():
            name, _, power = factor.partition("^")
            total += sign * int(power or 1) * np.array(_DIMENSIONS[name])
    length, mass, time = total.tolist()
    return length, mass, time


@cache
def dimensions_of(kind: type[Spec]) -> Mapping[str, _Dimension]:
    """Dimensions of the numbers of a part of a mechanism by field; those without are left out."""
    dimensions = {name: dimension(unit) for name, unit in number_units(kind).items()}
    return {name: powers for name, powers in dimensions.items() if any(powers)}


_LENGTHS, _MASSES = (0.25, 200.0), (0.05, 1e6)  # [m], [kg] mechanisms between these are built in SI
_LENGTH, _MASS = 16.0, 1024.0  # [m], [kg] what others get: about Table I's
# [1/s] fastest rate of a slow motion: its accelerations fall below what engines resolve.
_SLOW = 0.125


class ScaledOptions(EngineOptions):
    """Options of an engine that may be run in units of the mechanism's size."""

    scaled_units: bool = Field(
        default=True,
        description="build a very small, light, large, heavy or slow mechanism in units of its "
        "own, not in SI",
    )

    def units(self, mechanism: Mechanism) -> Units:
        """The units that a mechanism is built in."""
        return units_of(mechanism) if self.scaled_units else SI


def scaled_units() -> Assistance:
    """The assistance of :class:`ScaledOptions`."""
    return Assistance(
        Part.UNITS,
        "builds the mechanism in units of its size",
        "scaled_units",
        off=False,
        acts_on=lambda mechanism: units_of(mechanism) != SI,
    )


class _Options(Protocol):
    def in_time_unit(self, unit: float) -> Self: ...


_O = TypeVar("_O", bound=_Options)
_S = TypeVar("_S", bound=Spec)
_V = TypeVar("_V", float, FloatArray)


@dataclass(frozen=True)
class Units:
    """Units of length [m], mass [kg] and time [s]."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def inverse(self) -> Self:
        """The units that convert back."""
        return type(self)(1 / self.length, 1 / self.mass, 1 / self.time)

    @property
    def force(self) -> float:
        """Unit of force [N]."""
        return self.mass * self.length / self.time**2

    @property
    def energy(self) -> float:
        """Unit of energy [J] and moment [N m]."""
        return self.force * self.length

    def effort(self, stop: AnyStop) -> float:
        """Unit of a stop's torque or force [N m or N]."""
        return self.force if stop.effort == "force" else self.energy

    def run(
        self, run: Callable[[Problem, _O], Recording], problem: Problem, options: _O
    ) -> Recording:
        """Run an engine in these units; return its recording in SI."""
        if self == SI:
            return run(problem, options)
        with self._in_messages():
            recording = run(self.problem(problem), options.in_time_unit(self.time))
        return self.recording(recording, problem)

    def inspect(
        self,
        inspect: Callable[[Mechanism, Sequence[State], _O], Inspection],
        mechanism: Mechanism,
        states: Sequence[State],
        options: _O,
    ) -> Inspection:
        """Inspect an engine's model in these units; return the inspection in SI."""
        if self == SI:
            return inspect(mechanism, states, options)
        with self._in_messages():
            scaled = self.mechanism(mechanism), self.states(mechanism, states)
            inspection = inspect(*scaled, options.in_time_unit(self.time))
        return self.inspection(inspection, mechanism)

    @contextmanager
    def _in_messages(self) -> Generator[None]:
        """Say in an engine's errors that their numbers are in these units."""
        try:
            yield
        except (SimulationError, UnsupportedProblemError) as error:
            units = f"in units of {self.length:.6g} m, {self.mass:.6g} kg and {self.time:.6g} s"
            raise type(error)(f"{str(error).removesuffix('.')} ({units}).") from error

    def coordinates(self, mechanism: Mechanism) -> FloatArray:
        """Unit of each coordinate, shape (n_q,): 1 of an angle, the length of a slide."""
        angles, slides = len(mechanism.angles), len(mechanism.slides)
        return np.array([1.0] * angles + [self.length] * slides)

    def mechanism(self, mechanism: Mechanism) -> Mechanism:
        """The mechanism in these units.

        It is not validated: its numbers are the same but for their exponents.
        """
        q = self.coordinates(mechanism)
        changes: dict[str, object] = {
            "gravity": mechanism.gravity * self.time**2 / self.length,
            "start": tuple((np.array(mechanism.start) / q).tolist()),
        }
        refuse_unknown("units of engines", mechanism.elements)
        for group in ("bodies", "markers", "joints", "stops", "force_elements"):
            changes[group] = tuple(map(self._scaled, getattr(mechanism, group)))
        unit_of = dict(zip(mechanism.coordinates, q.tolist(), strict=True))
        changes["couplers"] = tuple(_coupler(each, unit_of) for each in mechanism.couplers)
        if mechanism.start_speeds:
            speeds = np.array(mechanism.start_speeds) * self.time / q
            changes["start_speeds"] = tuple(speeds.tolist())
        return mechanism.model_copy(update=changes)

    def _scaled(self, part: _S) -> _S:
        """A part of a mechanism in these units."""
        changes = dict[str, object]()
        for name, (length, mass, time) in dimensions_of(type(part)).items():
            unit = self.length**length * self.mass**mass * self.time**time
            value = getattr(part, name)
            if isinstance(value, tuple):
                changes[name] = tuple(number / unit for number in value)
            elif value is not None:
                changes[name] = value / unit
        return part.model_copy(update=changes)

    def problem(self, problem: Problem) -> Problem:
        """The problem in these units."""
        mechanism = self.mechanism(problem.mechanism)
        return problem.model_copy(
            update={"mechanism": mechanism, "duration": problem.duration / self.time}
        )

    def recording(self, recording: Recording, problem: Problem) -> Recording:
        """A recording in these units, converted to SI."""
        q, speed = self.coordinates(problem.mechanism), self.length / self.time
        efforts = {stop.name: self.effort(stop) for stop in problem.mechanism.stops}
        impulses = {name: effort * self.time for name, effort in efforts.items()}
        markers: dict[str, PointMotion] = {}
        for name, motion in recording.markers.items():
            markers[name] = PointMotion(motion.position * self.length, motion.velocity * speed)
        # The last time is the problem's end to the bit: the units are powers of two.
        return replace(
            recording,
            t=recording.t * self.time,
            q=recording.q * q,
            u=recording.u * q / self.time,
            markers=markers,
            kinetic_energy=recording.kinetic_energy * self.energy,
            potential_energy=recording.potential_energy * self.energy,
            stop_torques=_in_units(recording.stop_torques, efforts),
            release_times={
                name: None if time is None else time * self.time
                for name, time in recording.release_times.items()
            },
            joint_reactions=_in_units(recording.joint_reactions, self.force),
            joint_gaps=_in_units(recording.joint_gaps, self.length),
            impacts=tuple(
                (time * self.time, _in_units(of_stops, impulses))
                for time, of_stops in recording.impacts
            ),
        )

    def states(self, mechanism: Mechanism, states: Sequence[State]) -> list[State]:
        """States in these units."""
        q = self.coordinates(mechanism)
        return [replace(state, q=state.q / q, u=state.u * self.time / q) for state in states]

    def inspection(self, inspection: Inspection, mechanism: Mechanism) -> Inspection:
        """An inspection in these units, converted to SI."""
        q, inertia = self.coordinates(mechanism), self.mass * self.length**2
        efforts = {stop.name: self.effort(stop) for stop in mechanism.stops}
        gaps = {s.name: self.length if s.gap_unit == "m" else 1.0 for s in mechanism.stops}
        dynamics: list[Dynamics] = []
        for seen in inspection.dynamics:
            mass, forces = seen.mass_matrix, seen.forces
            dynamics.append(
                Dynamics(
                    accelerations=seen.accelerations * q / self.time**2,
                    stop_torques=_in_units(seen.stop_torques, efforts),
                    mass_matrix=None if mass is None else mass * inertia / np.outer(q, q),
                    forces=None if forces is None else forces * self.energy / q,
                    centres=_in_units(seen.centres, self.length),
                    stop_gaps=_in_units(seen.stop_gaps, gaps),
                    joint_gaps=_in_units(seen.joint_gaps, self.length),
                )
            )
        total = inspection.total_mass
        return replace(
            inspection,
            start=inspection.start * q,
            start_speeds=inspection.start_speeds * q / self.time,
            dynamics=tuple(dynamics),
            total_mass=None if total is None else total * self.mass,
        )


def _coupler(coupler: Coupler, units: Mapping[str, float]) -> Coupler:
    """A coupler whose coordinates are in units."""
    own = units[coupler.coordinate]
    terms = tuple(
        term.model_copy(update={"ratio": term.ratio * units[term.coordinate] / own})
        for term in coupler.terms
    )
    return coupler.model_copy(update={"terms": terms, "offset": coupler.offset / own})


def _in_units(values: Mapping[str, _V], units: float | Mapping[str, float]) -> dict[str, _V]:
    """Values times a unit, or each times its own."""
    if isinstance(units, Mapping):
        return {name: value * units[name] for name, value in values.items()}
    return {name: value * units for name, value in values.items()}


SI = Units()


def units_of(mechanism: Mechanism) -> Units:
    """SI, but for mechanisms that are very small, light, large, heavy or slow."""
    # The farthest point from its body's origin, or the largest radius of gyration [m].
    mass = max(body.mass for body in mechanism.bodies)
    length = 0.0
    for body in mechanism.bodies:
        length = max(length, math.hypot(*body.centre), math.sqrt(body.inertia / body.mass))
    for element in (*mechanism.joints, *mechanism.force_elements):
        for name, dimension in dimensions_of(type(element)).items():
            value = getattr(element, name)
            if dimension == _LENGTH_UNIT and isinstance(value, tuple):
                length = max(length, math.hypot(*value))
    if length <= 0:
        return SI

    # The fastest rate that speeds, gravity, springs and forces give a body of that size [1/s].
    rates = [math.sqrt(mechanism.gravity / length)]
    for i, u in enumerate(mechanism.start_speeds):
        rates.append(abs(u) if i < len(mechanism.angles) else abs(u) / length)
    for element in mechanism.force_elements:
        for name, (lengths, masses, times) in dimensions_of(type(element)).items():
            if times == -2:
                # Over mass and length, a force, a moment or a stiffness is the square of a rate.
                value = getattr(element, name)
                size = math.hypot(*value) if isinstance(value, tuple) else abs(value)
                rates.append(math.sqrt(size / (mass**masses * length**lengths)))
    rate, units = max(rates), SI
    if not (_LENGTHS[0] <= length <= _LENGTHS[1] and _MASSES[0] <= mass <= _MASSES[1]):
        time = 2.0 ** round(math.log2(length / _LENGTH) / 2)
        units = Units(time**2, 2.0 ** round(math.log2(mass / _MASS)), time)
    if 0 < rate * units.time < _SLOW:
        return replace(units, time=2.0 ** -round(math.log2(rate)))
    return units
