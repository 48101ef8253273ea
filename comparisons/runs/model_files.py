"""Mechanisms from model files of engines, held against the engine before they are used."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...engines.study import Episode, ModelFile, ModelStart, Policy
from ...models.arrays import FloatArray
from ...models.controls import ControlRecord
from ...models.errors import EngineNotInstalledError, InputError, SimulationError
from ...models.library.registry import is_file, read_file, read_files_by
from ...models.mechanism import Mechanism

__all__ = [
    "SUFFIXES",
    "from_mjcf",
    "is_file",
    "largest_difference",
    "read_file",
    "read_model_file",
]

SUFFIXES = (".xml", ".mjcf", ".urdf")
"""Endings of the names of files that are read here."""
_OWN_START = ModelStart()
_STATES = 16  # at which a reading is held against the engine
_SAME = 1e-9  # by which values may differ, in parts of the largest
_SMALL = 1e-3  # of the largest acceleration: of smaller ones rounding is that of this


def from_mjcf(
    source: str | Path | Any,
    *,
    keyframe: str | int | None = None,
    qpos: Sequence[float] | None = None,
    qvel: Sequence[float] | None = None,
    ctrl: Sequence[float] | ControlRecord | str | Path | None = None,
    without: Collection[str] = (),
) -> Mechanism:
    """Read a planar mechanism from an MJCF or URDF file, as its engine compiles it.

        >>> import trebucheck as tb
        >>> tb.from_mjcf("cartpole.xml", qpos=[0.0, 0.1])  # doctest: +SKIP

    Angles count clockwise from the model's `qpos0`; slides are the model's own numbers. Contacts
    are left out. What was read is held against the engine's accelerations at random states.

    Args:
        source: a path, the text of a file, or a compiled model.
        keyframe: name or number of the model's keyframe to start from.
        qpos, qvel: start, in place of the keyframe's or of `qpos0` at rest.
        ctrl: controls, in place of the keyframe's or of zeros: constant ones, or recorded ones that
            are held from each time to the next (a record, or the path of a .csv or .npz file).
        without: features to leave out: "contacts" of the file's own motion, too, "limits",
            "friction-loss", "fluid", "actuators", "equalities", "tendons".

    Raises:
        InputError: the file or the start is not valid.
        UnsupportedProblemError: the model does not move in a plane, or has a feature that
            mechanisms have not; the sentence names it.
        EngineNotInstalledError: the engine that compiles such files is not installed.
    """
    return read_model_file(source, start_of(keyframe, qpos, qvel, ctrl, without)).mechanism


def start_of(
    keyframe: str | int | None = None,
    qpos: Sequence[float] | None = None,
    qvel: Sequence[float] | None = None,
    ctrl: Sequence[float] | ControlRecord | str | Path | None = None,
    without: Collection[str] = (),
) -> ModelStart:
    """Start of a model file as a user gives it; controls are read from a file that is named.

    Raises:
        InputError: one of them is no list of numbers, or of words, or the file cannot be read.
    """
    if isinstance(without, str):
        raise InputError(f"without = {without!r} must be a list of words, as ['limits'].")
    if isinstance(ctrl, str | Path):
        ctrl = ControlRecord.read(ctrl)
    elif not isinstance(ctrl, ControlRecord):
        ctrl = _numbers("ctrl", ctrl)
    return ModelStart(keyframe, _numbers("qpos", qpos), _numbers("qvel", qvel), ctrl, without or ())


def _numbers(name: str, value: Sequence[float] | None) -> list[float] | None:
    if value is None:
        return None
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros((0, 0))
    if isinstance(value, str) or numbers.ndim != 1:
        raise InputError(f"{name} = {value!r} must be a list of numbers.")
    return list(map(float, numbers))


def rollout(
    environment: str | Any, duration: float = 5.0, seed: int = 0, policy: Policy | None = None
) -> Episode:
    """Run an episode of an environment and record the controls that it sets.

        >>> import trebucheck as tb
        >>> episode = tb.rollout("gymnasium:InvertedPendulum-v5", 1.0)  # doctest: +SKIP
        >>> tb.audit(episode)  # doctest: +SKIP

    Args:
        environment: `gymnasium:ID` or `dm_control:DOMAIN-TASK`, or such an environment; it moves a
            model that an engine here compiles.
        duration: of the episode [s]; it may end before.
        seed: of the start and of random actions.
        policy: chooses actions; random ones of the environment's actions if left out.

    Raises:
        InputError: there is no such environment, or it moves no such model, or the duration is not
            positive.
        EngineNotInstalledError: its package, or the engine, is not installed.
    """
    from ...engines.registry import engine_names, engine_study

    studies = map(engine_study, engine_names())
    record = next((each.record_episode for each in studies if each.record_episode), None)
    if record is None:
        raise EngineNotInstalledError("no engine here records episodes.")
    return record(environment, duration, seed, policy)


def read_model_file(source: str | Path | Any, start: ModelStart = _OWN_START) -> ModelFile:
    """Read a mechanism together with how its coordinates follow from the file's; see `from_mjcf`.

    Args:
        source: as of :func:`from_mjcf`.
        start: the file's own, with nothing left out but contacts, if left out.

    Raises:
        EngineNotInstalledError: no engine here compiles such files.
    """
    # Engines are looked for when a file is read: to name a machine needs none.
    from ...engines.registry import engine_names, engine_study

    studies = map(engine_study, engine_names())
    reader = next((each.read_model for each in studies if each.read_model is not None), None)
    if reader is None:
        raise EngineNotInstalledError("no engine here reads model files.")
    try:
        read = reader(source, start)
    except ImportError as error:
        raise EngineNotInstalledError(f"a model file cannot be read: {error}.") from None
    largest_difference(read)
    return read


def largest_difference(read: ModelFile) -> tuple[float, str]:
    """Hold a mechanism against the engine's own values at random states, without stops and loops.

    Returns:
        The largest difference in parts of the quantity's size, and of what it is: mass matrix,
        accelerations, gaps, markers or loops.

    Raises:
        SimulationError: one differs: the model has something that the reader does not know.
    """
    from ...models.kinematics import Kinematics
    from ...reference.equations import Equations

    mechanism, states = read.mechanism, read.random_states(_STATES)
    bare: dict[str, Any] = {"joints": mechanism.tree_joints, "stops": (), "couplers": ()}
    free = mechanism.model_copy(update=bare)
    kinematics = Kinematics(mechanism)
    equations = Equations(free)
    accelerations = np.empty_like(states.q)
    for i, acting in free.at_times(states.t):
        accelerations[i] = Equations(acting).solve(states.q[i], states.u[i], ())[0]
    for kind, names, known in (
        ("stops", {stop.name for stop in mechanism.stops}, states.gaps),
        ("loop joints", {joint.name for joint in mechanism.loop_joints}, states.loops),
        ("couplers", {coupler.name for coupler in mechanism.couplers}, states.couplers),
    ):
        if names != set(known):
            raise SimulationError(
                f"{mechanism.name!r} was not read rightly: it has the {kind} "
                f"{', '.join(sorted(names)) or 'none'}, the engine's model "
                f"{', '.join(sorted(known)) or 'none'}."
            )
    pairs = list[tuple[str, FloatArray, FloatArray]]()
    if states.mass is not None:
        pairs.append(("the mass matrix", equations.mass_matrix(states.q), states.mass))
    pairs += [
        (f"the acceleration of {name!r}", accelerations[:, k], states.a[:, k])
        for k, name in enumerate(mechanism.coordinates)
    ]
    for stop in mechanism.stops:
        gap = kinematics.gap(stop.name, states.q)
        pairs.append((f"the gap of {stop.name!r}", gap, states.gaps[stop.name]))
    for marker in mechanism.markers:
        row = kinematics.point(marker.body, marker.point)
        place, expected = kinematics.position(row, states.q), states.markers[marker.name]
        pairs += [(f"the place of {marker.name!r}", place[:, k], expected[:, k]) for k in (0, 1)]
    for joint in mechanism.loop_joints:
        distance, angle = states.loops[joint.name]
        vector = kinematics.between(
            joint.child, joint.child_point, joint.parent, joint.parent_point
        )
        apart = np.abs(kinematics.vector(vector, states.q))
        pairs.append((f"the distance that {joint.name!r} closes", apart, distance))
        if joint.turned_by is not None:
            turned = kinematics.angle(joint.child, joint.parent).value(states.q) - joint.turned_by
            pairs.append((f"the angle of {joint.name!r}", np.abs(np.sin(turned / 2)), angle))
    for name, coupling in kinematics.couplings.items():
        pairs.append((f"what {name!r} holds", coupling.value(states.q), states.couplers[name]))
    largest, worst = float(np.abs(states.a).max()), (0.0, "")
    for what, ours, expected in pairs:
        # Rounding is that of the largest acceleration, or of lengths of 1 m.
        least = 0.0 if expected is states.mass else max(_SMALL * largest, 1.0)
        size = max(float(np.abs(expected).max()), least)
        off = float(np.abs(ours - expected).max())
        worst = max(worst, (off / size, what))
        if not off <= _SAME * size:
            raise SimulationError(
                f"{mechanism.name!r} was not read rightly: at random states {what} differs from "
                f"the engine's by {off:.3g} of {size:.3g}; the model has something that the reader "
                "does not know."
            )
    return worst


for suffix in SUFFIXES:
    read_files_by(suffix, from_mjcf)
