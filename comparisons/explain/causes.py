"""What an engine's error may come from, and how each cause is taken out alone: one table an engine.

A cause is measured by an intervention, never assigned. Most are taken out by other options; one that cannot be is
made larger by a known factor instead. The tables hold options only: reading them runs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pydantic import JsonValue

from ...engines.protocol import Engine
from ...models.mechanism import Mechanism
from ...models.mjcf.writer import POINT_INERTIA

Options = Mapping[str, JsonValue]

_MOVING = "moving points"

REFINEMENT = 8
"""Steps to one of the base: leaves 1/64 of an error of second order, so that no order need be assumed."""
_COSTLY_REFINEMENT = 4
"""The same for an engine whose steps are dear; what it leaves (1/16 at second order) is then accounted for."""
_SEEN_INERTIA = 1e-6  # [kg m^2] shifts the projectile by some 1e-8 m: far above rounding, and still in proportion
_SOFTEST_LIMIT = 0.9999  # MuJoCo clamps the impedance there
_MANY_PASSES, _MANY_START_PASSES, _HEAVY_PIVOT = 400, 5_000, 1e4


@dataclass(frozen=True)
class Intervention:
    """What is done to a run."""

    options: Options = field(default_factory=dict[str, JsonValue])
    """Options of the engine that are set otherwise."""
    point_inertia: float | None = None
    """Inertia given to bodies that have none [kg m^2]."""
    own_kinematics: bool = False
    """Places, speeds and energies are taken from the engine's coordinates by the machine's kinematics."""
    filtered_torques: bool = False
    """Torques are rid of what changes sign with every step."""
    leaves: float = 0.0
    """What is left of the cause's error: 0 if it is taken out, 2 if it is doubled."""


@dataclass(frozen=True)
class Cause:
    """A named cause of an engine's error."""

    name: str
    explanation: str
    """One line."""
    removal: Intervention | None = None
    """Takes it out; several removals can be made together."""
    scaling: Intervention | None = None
    """Makes it larger by itself: the only measure of it, or a second one."""
    after: tuple[str, ...] = ()
    """Causes that must have been taken out first: with them, this removal would bring in an error of its own."""

    @property
    def options(self) -> Options:
        """The changes of options that measure it; empty where it is not an option's."""
        chosen = self.removal or self.scaling
        return {} if chosen is None else chosen.options


def causes_of(engine: Engine, mechanism: Mechanism | None = None) -> tuple[Cause, ...]:
    """Causes that an engine with these options may have, in the order in which they are best taken out.

    Nothing is run. A cause whose options are already set as its removal would set them is left out. Of an engine
    without a table (a plug-in) only the time step is known, if it has one.

    Args:
        mechanism: that it moves: some causes are there only where points are held, by stops or by loops of joints.
    """
    settings = engine.settings
    table = _TABLES.get(engine.name, _steps_only)
    found = [cause for cause in table(settings, Held.by(mechanism)) if _does_anything(cause, settings)]
    names = {cause.name for cause in found}
    return tuple(replace(cause, after=tuple(name for name in cause.after if name in names)) for cause in found)


@dataclass(frozen=True)
class Held:
    """What the constraints of a machine hold, of which engines' options may make a difference."""

    angles: bool = True
    points: bool = False

    @classmethod
    def by(cls, mechanism: Mechanism | None) -> Held:
        """Of a machine; with none given, of the paper's, whose stops are on angles."""
        if mechanism is None:
            return cls()
        return cls(bool(mechanism.angle_stops), bool(mechanism.point_stops or mechanism.loop_joints))


def described(intervention: Intervention, settings: Options) -> str:
    """What is done, in one line."""
    parts = [
        f"{name} {_shown(settings.get(name))} → {_shown(value)}"
        for name, value in intervention.options.items()
        if not _same(settings.get(name), value)
    ]
    if intervention.point_inertia is not None:
        parts.append(f"point masses given an inertia of {intervention.point_inertia:g} kg m²")
    if intervention.own_kinematics:
        parts.append("read from the coordinates instead")
    if intervention.filtered_torques:
        parts.append("torques passed through a filter that stops what alternates from step to step")
    if 0 < intervention.leaves < 1:
        parts.append(f"which leaves {intervention.leaves:.3g} of it")
    elif intervention.leaves:
        parts.append(f"which makes it {intervention.leaves:g} times as large")
    return ", ".join(parts)


def _does_anything(cause: Cause, settings: Options) -> bool:
    chosen = [c for c in (cause.removal, cause.scaling) if c is not None]
    return any(
        c.own_kinematics
        or c.filtered_torques
        or c.point_inertia is not None
        or any(not _same(settings.get(name), value) for name, value in c.options.items())
        for c in chosen
    )


def _same(a: JsonValue, b: JsonValue) -> bool:
    return a == b or (isinstance(a, list | tuple) and isinstance(b, list | tuple) and list(a) == list(b))


def _shown(value: JsonValue) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_shown(part) for part in value) + ")"
    return "unset" if value is None else str(value)


def _time_step(finer: Options, leaves: float = 0.0, after: tuple[str, ...] = ()) -> Cause:
    text = "what a step leaves out; taken out by shorter steps, all else as it is"
    return Cause("time step", text, Intervention(finer, leaves=leaves), after=after)


def _with_readout(*causes: Cause) -> tuple[Cause, ...]:
    # Last in every order: where joints have parted, coordinates stand for another machine than the markers show.
    text = "the engine's markers and energies, against its own coordinates through the machine's kinematics"
    removed_before = tuple(cause.name for cause in causes if cause.removal is not None)
    return (*causes, Cause("readout", text, Intervention(own_kinematics=True), after=removed_before))


def _steps_only(settings: Any, _: Held) -> tuple[Cause, ...]:
    h = settings.get("timestep")
    return (_time_step({"timestep": h / REFINEMENT}),) if isinstance(h, float) else ()


def _stiffest(h: float, integrator: str, held: Held) -> list[JsonValue]:
    """MuJoCo's stiffest limits at a step of h [s]: what its `solref = None` stands for, written out.

    Points held through all stages of RK4 take less damping than angles; where there are both, it is the angles'.
    """
    damping = 1.0 if integrator != "RK4" else 2.0 if held.angles else 1.5
    return [-1.0 / h**2, -damping / h]


def _mujoco(settings: Any, held: Held) -> tuple[Cause, ...]:
    # Stiff points that are not held as they move are unstable: no other cause can be taken out before.
    causes = [replace(cause, after=(*cause.after, _MOVING)) for cause in _mujoco_anywhere(settings, held)]
    text = "MuJoCo leaves out of contacts the acceleration that a held point has from the speeds alone"
    moving = [Cause(_MOVING, text, Intervention({"moving_points": True}))] if held.points else []
    return _with_readout(*moving, *causes)


def _mujoco_anywhere(settings: Any, held: Held) -> tuple[Cause, ...]:
    h = float(settings["timestep"])
    finer: dict[str, JsonValue] = {"timestep": h / REFINEMENT}
    if settings["solref"] is None:  # it would follow the step
        finer["solref"] = _stiffest(h, settings["integrator"], held)
    return (
        *_mujoco_softness(settings, held),
        # Points are pressed in by an acceleration: with softer ones than the step can bear they would jump.
        Cause("start transient", "soft limits start without the give that carries their torque",
              Intervention({"preload": True}), after=("constraint softness",) if held.points else ()),
        Cause("solver tolerance", "where MuJoCo's constraint solver stops",
              Intervention({"solver": "Newton", "tolerance": min(1e-30, float(settings["tolerance"]))})),
        Cause("limits kept", "stops stay in the model after they have released, and may be met again",
              Intervention({"keep_limits": False})),
        Cause("event location", "a release is noticed at the end of its step, and the step goes over its kink",
              Intervention({"locate_releases": True})),
        Cause("integrator", "the rule of a step, of first order but for RK4", Intervention({"integrator": "RK4"})),
        _time_step(finer),
        Cause("point inertia", f"MuJoCo wants an inertia of every body: point masses have {POINT_INERTIA:g} kg m²",
              scaling=Intervention(point_inertia=_SEEN_INERTIA, leaves=_SEEN_INERTIA / POINT_INERTIA)),
    )  # fmt: skip


def _mujoco_softness(settings: Any, held: Held) -> tuple[Cause, ...]:
    """Softness as two causes at most: an error of (1 - d) tc^2, d the impedance, tc the limits' time constant."""
    h, integrator = float(settings["timestep"]), settings["integrator"]
    stiffest, given, shape = _stiffest(h, integrator, held), settings["solref"], list(settings["solimp"])
    text = "limits give way: MuJoCo's stops are springs and dampers, and let through 1 - d of what they should stop"
    hardest = [_SOFTEST_LIMIT, _SOFTEST_LIMIT, *shape[2:]]
    if (given is not None and not _same(given, stiffest)) or min(shape[:2]) < _SOFTEST_LIMIT:
        removal = Intervention({"solref": stiffest, "solimp": hardest})
        return (Cause("constraint softness", text, removal),)
    # As stiff as this step can bear: stiffer limits need the shorter step. 1 - d, doubled, is the second measure.
    removal = Intervention({"solref": _stiffest(h / REFINEMENT, integrator, held)})
    twice = [1.0 - 2.0 * (1.0 - d) for d in shape[:2]]
    scaling = Intervention({"solimp": [*twice, *shape[2:]]}, leaves=2.0)
    return (Cause("constraint softness", text, removal, scaling, after=("time step",)),)


def _pymunk(settings: Any, _: Held) -> tuple[Cause, ...]:
    # Twice the passes square what they leave. Mass on a fixed pivot moves nothing: it only helps them converge.
    passes = {
        "iterations": max(_MANY_PASSES, 2 * settings["iterations"]),
        "start_iterations": max(_MANY_START_PASSES, 2 * settings["start_iterations"]),
        "pivot_mass": max(_HEAVY_PIVOT, settings["pivot_mass"]),
    }
    return _with_readout(
        Cause("solver passes", "impulses that have not converged in a step's passes, above all in the first step",
              Intervention(passes)),
        Cause("error bias", "joints are let drift: only a share of their error is undone in a step",
              Intervention({"error_bias": 0.0})),
        Cause("start and labels", "velocities belong half a step later than positions; started and read as if not",
              Intervention({"leapfrog": True})),
        Cause("rod lengths", "a rod's ends move on arcs: it gets longer in a step than its rate of change says",
              Intervention({"hold_lengths": True})),
        Cause("event location", "a stop is let go a step after its torque has vanished",
              Intervention({"locate_releases": True})),
        _time_step({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


def _exudyn(settings: Any, _: Held) -> tuple[Cause, ...]:
    # Constraints on positions (index 3) have noise in their multipliers that grows as 1/h^2, and ring after each
    # restart: a shorter step and a located release would bring in errors that the run itself does not have.
    first, then = ("integrator",), ("integrator", "event location", "alternating torques")
    finer = {"timestep": float(settings["timestep"]) / _COSTLY_REFINEMENT}
    tighter: Options = {
        "newton_relative": min(1e-12, settings["newton_relative"]),
        "newton_absolute": min(1e-9, settings["newton_absolute"]),
        "modified_newton": False,
    }
    return _with_readout(
        Cause("integrator", "generalized-alpha's damping, and joints held in their positions (index 3)",
              Intervention({"integrator": "trapezoidal-index-2"})),
        Cause("Newton iteration", "where the iteration of a step stops, with a Jacobian kept over several steps",
              Intervention(tighter)),
        Cause("adaptive step", "a step whose iteration fails is shortened", Intervention({"adaptive_step": False})),
        Cause("event location", "a stop is switched off at the end of the step in which its torque has vanished",
              Intervention({"located_releases": True}), after=first),
        Cause("alternating torques", "the trapezoidal rule never damps an error of the multipliers that changes sign "
              "with every step", Intervention(filtered_torques=True), after=first),
        # The trapezoidal rule is of second order; with a release at a step's end the run as a whole is not.
        _time_step(finer, leaves=math.pow(_COSTLY_REFINEMENT, -2), after=then),
    )  # fmt: skip


_TABLES: dict[str, Callable[[Any, Held], tuple[Cause, ...]]] = {"mujoco": _mujoco, "pymunk": _pymunk, "exudyn": _exudyn}
