"""What a trajectory must be before it can be compared: whole, finite, in shape, and of the right mechanism."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...engines.protocol import Capabilities
from ...models.errors import SimulationError
from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory

_SAME_TIME = 1e-9  # of the duration: how late the first sample may be
_LARGEST = 1e100  # in SI units: its square is still a number


def refuse_invalid(
    engine: str, trajectory: object, mechanism: Mechanism, capabilities: Capabilities
) -> Trajectory:
    """The trajectory, if it is a valid one.

    Args:
        engine: for messages.
        trajectory: what the engine gave.
        mechanism: what it was to move.
        capabilities: what it says it observes.

    Raises:
        SimulationError: the sentence says what is wrong with it.
    """
    if not isinstance(trajectory, Trajectory):
        raise SimulationError(
            f"{engine} gave a {type(trajectory).__name__} instead of a Trajectory."
        )
    fault = next(_faults(trajectory, mechanism, capabilities), None)
    if fault is not None:
        raise SimulationError(f"{engine} gave an invalid trajectory: {fault}.")
    return trajectory


def _faults(
    trajectory: Trajectory, mechanism: Mechanism, capabilities: Capabilities
) -> Iterator[str]:
    if trajectory.mechanism != mechanism:
        yield f"it is of another mechanism, {trajectory.mechanism.name!r}"
    yield from _time_faults(trajectory.t)
    yield from _name_faults(trajectory, mechanism, capabilities)
    n = len(trajectory.t)
    for label, values, shape in _arrays(trajectory, n, len(mechanism.coordinates)):
        yield from _array_faults(label, values, shape, trajectory.t)
    for name, time in trajectory.release_times.items():
        if time is not None and not (np.isfinite(time) and time >= 0):
            yield f"the release time of {name!r} is {time!r} s"
    for time, impulses in trajectory.impacts:
        if not (np.isfinite(time) and time >= 0):
            yield f"an impact's time is {time!r} s"
        yield from _names("impacts", impulses, {stop.name for stop in mechanism.stops}, set())
        yield from (
            f"the impulse of {name!r} is {p!r}"
            for name, p in impulses.items()
            if not np.isfinite(p)
        )


def _time_faults(t: Any) -> Iterator[str]:
    if not isinstance(t, np.ndarray) or t.dtype != np.float64:
        yield f"t is {_kind(t)}; an array of float64 is needed"
    elif t.ndim != 1 or len(t) < 2:
        yield f"t has the shape {t.shape}; at least two times are needed"
    elif not np.isfinite(t).all():
        yield f"t[{int(np.argmin(np.isfinite(t)))}] is not finite"
    elif (np.diff(t) < 0).any():
        yield f"t decreases after {t[int(np.argmax(np.diff(t) < 0))]:.6g} s"
    elif not 0.0 <= t[0] <= _SAME_TIME * t[-1]:
        yield f"it begins at t = {t[0]:.6g} s instead of 0"


def _name_faults(
    trajectory: Trajectory, mechanism: Mechanism, capabilities: Capabilities
) -> Iterator[str]:
    markers = {marker.name for marker in mechanism.markers}
    stops, joints = (
        {stop.name for stop in mechanism.stops},
        {joint.name for joint in mechanism.joints},
    )
    closed = {stop.name for stop in mechanism.stops if stop.closed}
    yield from _names("markers", trajectory.markers, markers, markers)
    torques = closed if capabilities.stop_torques else set[str]()
    yield from _names("stop_torques", trajectory.stop_torques, stops, torques)
    yield from _names("release_times", trajectory.release_times, stops, closed)
    yield from _names("joint_gaps", trajectory.joint_gaps, joints, set())
    held = {joint.name for joint in mechanism.joints if joint.held_directions}
    promised = held if capabilities.joint_reactions else set[str]()
    yield from _names("joint_reactions", trajectory.joint_reactions, joints, promised)


def _names(
    field: str, values: Mapping[str, object], known: set[str], needed: set[str]
) -> Iterator[str]:
    unknown, missing = sorted(values.keys() - known), sorted(needed - values.keys())
    if unknown:
        yield f"{field} has {unknown[0]!r}, which the mechanism does not have"
    if missing:
        yield f"{field} lacks {missing[0]!r}"


def _arrays(trajectory: Trajectory, n: int, n_q: int) -> Iterator[tuple[str, Any, tuple[int, ...]]]:
    """Label, values and shape of everything sampled."""
    yield "q", trajectory.q, (n, n_q)
    yield "u", trajectory.u, (n, n_q)
    yield "kinetic_energy", trajectory.kinetic_energy, (n,)
    yield "potential_energy", trajectory.potential_energy, (n,)
    for name, motion in trajectory.markers.items():
        yield f"position of {name!r}", motion.position, (n, 2)
        yield f"velocity of {name!r}", motion.velocity, (n, 2)
    yield from (
        (f"torque of {name!r}", torque, (n,)) for name, torque in trajectory.stop_torques.items()
    )
    yield from (
        (f"reaction of {name!r}", force, (n, 2))
        for name, force in trajectory.joint_reactions.items()
    )
    yield from ((f"gap of {name!r}", gap, (n,)) for name, gap in trajectory.joint_gaps.items())


def _array_faults(label: str, given: Any, shape: tuple[int, ...], t: Any) -> Iterator[str]:
    if not isinstance(given, np.ndarray):
        yield f"{label} is {_kind(given)}; an array is needed"
        return
    values: Any = given
    if values.shape != shape:
        yield f"{label} has the shape {values.shape}, not {shape}"
    elif not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        yield f"{label} holds no real numbers"
    elif not np.isfinite(values).all():
        first = int(np.argmin(np.isfinite(values.reshape(len(t), -1)).all(axis=1)))
        yield f"{label} is not finite at t = {t[first]:.6g} s"
    elif np.abs(values).max() > _LARGEST:
        yield f"{label} reaches {np.abs(values).max():.3g}, which is too large to compare"


def _kind(given: object) -> str:
    return (
        f"an array of {given.dtype}"
        if isinstance(given, np.ndarray)
        else f"a {type(given).__name__}"
    )
