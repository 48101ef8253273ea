"""Mistakes that strangers make in the adapter of an engine, against what a comparison says of them:
the table.

Each engine is the reference at a tolerance of 1e-10, given another mechanism, moved by another law
or read wrongly. Nothing here uses the code that suspects such mistakes. Run as a script, it prints
the table:

    python tests/adapter_mistakes.py [PROBLEM | random:SEED ...] [+MISTAKE ...]
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import plugin_engines
import trebucheck as tb
import wrong_engines
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.runs.results import Outcome, Run
from trebucheck.models.elements import GROUND
from trebucheck.models.features import Feature
from trebucheck.models.library.registry import library_problem, model
from trebucheck.models.trajectory import PointMotion, Trajectory
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import solve_scheduled, without_centrifugal
from trebucheck.reference.solver import solve
from wrong_engines import Build, Honest, Spoil

Move = Callable[[tb.Problem, float], Trajectory]
"""The motion of a problem by a law of its own, with a step [s]."""


@dataclass(frozen=True)
class Mistake:
    """What is done wrong, and words of the causes that are right for it; none: it is no suspect."""

    causes: tuple[str, ...]
    read: Spoil | None = None
    built: Build | None = None
    moved: Move | None = None


# --- reading: arrays of a right motion ---


def _points(
    f: Trajectory, change: Callable[[str, PointMotion], PointMotion]
) -> dict[str, PointMotion]:
    return {name: change(name, motion) for name, motion in f.markers.items()}


def _each(values: Mapping[str, Any], change: Callable[[str, Any], Any]) -> dict[str, Any]:
    return {name: change(name, value) for name, value in values.items()}


def _is_angle(f: Trajectory) -> Any:
    return np.arange(f.q.shape[1]) < len(f.mechanism.angles)


def _turned(vectors: Any, angle: Any) -> Any:
    """Vectors of the world in a frame that has turned clockwise by an angle."""
    z = (vectors[:, 0] + 1j * vectors[:, 1]) * np.exp(1j * angle)
    return np.stack([z.real, z.imag], axis=1)


def _angle(f: Trajectory, body: str) -> Any:
    return f.kinematics.angle(body).value(f.q)


def _on_parent(f: Trajectory) -> Trajectory:
    """The reaction of the last joint on its parent."""
    last = f.mechanism.joints[-1].name
    return replace(f, joint_reactions=_each(f.joint_reactions, lambda n, v: -v if n == last else v))


def _swapped_pair(f: Trajectory) -> Trajectory:
    """The first two joints' reactions, each under the other's name."""
    names = list(f.joint_reactions)[:2]
    if len(names) < 2:
        return f
    one, two = names
    taken = {one: f.joint_reactions[two], two: f.joint_reactions[one]}
    return replace(f, joint_reactions={**f.joint_reactions, **taken})


def _shifted_names(f: Trajectory) -> Trajectory:
    """All reactions under the name of the joint before: an index off by one."""
    names = list(f.joint_reactions)
    return replace(
        f,
        joint_reactions={
            n: f.joint_reactions[m] for n, m in zip(names, names[1:] + names[:1], strict=True)
        },
    )


def _frame(end: str) -> Spoil:
    def read(f: Trajectory) -> Trajectory:
        ends = {joint.name: getattr(joint, end) for joint in f.mechanism.joints}
        turned = _each(
            f.joint_reactions,
            lambda n, v: v if ends[n] == GROUND else _turned(v, _angle(f, ends[n])),
        )
        return replace(f, joint_reactions=turned)

    return read


def _weightless(f: Trajectory) -> Trajectory:
    """Reactions less the weight of the child: what carries it at rest is left out."""
    down = f.mechanism.gravity * np.array(f.mechanism.gravity_direction)
    weights = {
        joint.name: f.mechanism.body(joint.child).mass * down for joint in f.mechanism.joints
    }
    return replace(f, joint_reactions=_each(f.joint_reactions, lambda n, v: v + weights[n]))


def _at(f: Trajectory, shift: float) -> Trajectory:
    """The motion at other times, by straight lines between its samples.

    Cubic where it is smooth enough.
    """
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline

    times = np.clip(f.t + shift, f.t[0], f.t[-1])
    unique = np.concatenate([[True], np.diff(f.t) > 0])
    t = f.t[unique]

    def at(values: Any) -> Any:
        return make_interp_spline(t, np.asarray(values)[unique], k=1)(times)

    def smooth(values: Any, rates: Any) -> Any:
        return CubicHermiteSpline(t, values[unique], rates[unique])(times)

    return replace(
        f,
        q=smooth(f.q, f.u),
        u=at(f.u),
        markers=_points(
            f, lambda _, m: PointMotion(smooth(m.position, m.velocity), at(m.velocity))
        ),
        kinetic_energy=at(f.kinetic_energy),
        potential_energy=at(f.potential_energy),
        stop_torques=_each(f.stop_torques, lambda _, v: at(v)),
        joint_reactions=_each(f.joint_reactions, lambda _, v: at(v)),
    )


def _step(f: Trajectory) -> float:
    return float(np.median(np.diff(f.t)))


def _speeds_at(shift: float) -> Spoil:
    """Speeds a part of a step off, as a leapfrog has them."""

    def read(f: Trajectory) -> Trajectory:
        other = _at(f, shift * _step(f))
        points = _points(f, lambda n, m: replace(m, velocity=other.markers[n].velocity))
        return replace(f, u=other.u, markers=points, kinetic_energy=other.kinetic_energy)

    return read


def _leapfrog(f: Trajectory) -> Trajectory:
    """Speeds of half a step before, and all that is computed from them and the positions of now."""
    early = replace(f, u=_at(f, -0.5 * _step(f)).u)
    rows = {m.name: f.kinematics.point(m.body, m.point) for m in f.mechanism.markers}
    points = _points(
        f, lambda n, m: replace(m, velocity=f.kinematics.velocity(rows[n], f.q, early.u))
    )
    return replace(early, markers=points, kinetic_energy=_kinetic(f.mechanism, early))


def _marker_at(point: Callable[[tb.Mechanism, Any], Any]) -> Spoil:
    """Markers at another point of their bodies."""

    def read(f: Trajectory) -> Trajectory:
        rows = {
            m.name: f.kinematics.point(m.body, point(f.mechanism, m)) for m in f.mechanism.markers
        }
        return replace(
            f,
            markers={
                n: PointMotion(f.kinematics.position(r, f.q), f.kinematics.velocity(r, f.q, f.u))
                for n, r in rows.items()
            },
        )

    return read


def _centre(m: tb.Mechanism, marker: Any) -> Any:
    return marker.point if marker.body == GROUND else m.body(marker.body).centre


def _velocity_of_centre(f: Trajectory) -> Trajectory:
    centred = _marker_at(_centre)(f)
    return replace(
        f, markers=_points(f, lambda n, m: replace(m, velocity=centred.markers[n].velocity))
    )


def _local(f: Trajectory) -> Trajectory:
    """Markers' velocities in the frames of their bodies."""
    bodies = {m.name: m.body for m in f.mechanism.markers}
    local = lambda n, m: replace(m, velocity=_turned(m.velocity, _angle(f, bodies[n])))  # noqa: E731
    return replace(f, markers=_points(f, local))


def _relative(q: bool, u: bool) -> Spoil:
    """Angles of the joints in place of the bodies'."""

    def read(f: Trajectory) -> Trajectory:
        rows = [
            f.kinematics.angle(j.child, j.parent)
            for j in f.mechanism.tree_joints
            if not j.holds_angle
        ]
        n = len(rows)
        angles, speeds = f.q.copy(), f.u.copy()
        for i, row in enumerate(rows):
            angles[:, i], speeds[:, i] = row.value(f.q), f.u @ row.coefficients
        assert n == len(f.mechanism.angles)
        return replace(f, q=angles if q else f.q, u=speeds if u else f.u)

    return read


def _energy(
    kinetic: Callable[..., Any] | None = None, potential: Callable[..., Any] | None = None
) -> Spoil:
    """Energies of a mechanism with other fields, in the right motion."""

    def read(f: Trajectory) -> Trajectory:
        own = {}
        if kinetic:
            own["kinetic_energy"] = _kinetic(kinetic(f.mechanism), f)
        if potential:
            own["potential_energy"] = Equations(potential(f.mechanism)).potential_energy(f.q)
        return replace(f, **own)

    return read


def _kinetic(m: tb.Mechanism, f: Trajectory) -> Any:
    equations = Equations(m)
    return 0.5 * np.einsum("ni,nij,nj->n", f.u, equations.mass_matrix(f.q), f.u)


def _without_springs(m: tb.Mechanism) -> tb.Mechanism:
    return m.model_copy(update={"force_elements": ()})


def _at_origins(m: tb.Mechanism) -> tb.Mechanism:
    """Bodies whose mass is at their frames' origins."""
    return _bodies(m, lambda b: {"centre": (0.0, 0.0)})


def _potential_of_origins(f: Trajectory) -> Trajectory:
    other = Equations(_at_origins(f.mechanism)).potential_energy(f.q)
    return replace(f, potential_energy=other)


def _releases(change: Callable[[Trajectory, float], float]) -> Spoil:
    def read(f: Trajectory) -> Trajectory:
        return replace(
            f,
            release_times=_each(f.release_times, lambda _, t: None if t is None else change(f, t)),
        )

    return read


def _swapped_torques(f: Trajectory) -> Trajectory:
    names = [s.name for s in f.mechanism.stops if s.closed and s.name in f.stop_torques]
    swapped = dict(zip(names, [f.stop_torques[n] for n in names[1:] + names[:1]], strict=True))
    return replace(f, stop_torques={**f.stop_torques, **swapped})


def _later(values: Any) -> Any:
    """Each sample is that of a step before."""
    return np.concatenate([values[:1], values[:-1]])


def _earlier(f: Trajectory) -> Trajectory:
    """States after the step under the times before it."""
    ahead = lambda v: np.concatenate([v[1:], v[-1:]])  # noqa: E731
    return replace(
        f,
        q=ahead(f.q),
        u=ahead(f.u),
        kinetic_energy=ahead(f.kinetic_energy),
        markers=_points(f, lambda _, m: PointMotion(ahead(m.position), ahead(m.velocity))),
        potential_energy=ahead(f.potential_energy),
        stop_torques=_each(f.stop_torques, lambda _, v: ahead(v)),
        joint_reactions=_each(f.joint_reactions, lambda _, v: ahead(v)),
    )


def _backward_differences(f: Trajectory) -> Trajectory:
    """Speeds by differences of positions."""
    step = np.where(np.diff(f.t) > 0, np.diff(f.t), np.inf)[:, None]

    def differences(values: Any, rates: Any) -> Any:
        return np.concatenate([rates[:1], np.diff(values, axis=0) / step])

    points = _points(f, lambda _, m: replace(m, velocity=differences(m.position, m.velocity)))
    return replace(f, u=differences(f.q, f.u), markers=points)


def _first_zero(f: Trajectory) -> Trajectory:
    def zero(_: str, v: Any) -> Any:
        return np.concatenate([0 * v[:1], v[1:]])

    return replace(
        f, joint_reactions=_each(f.joint_reactions, zero), stop_torques=_each(f.stop_torques, zero)
    )


def _only(f: Trajectory, name: str, values: Any) -> Trajectory:
    return replace(f, **{name: values})


def _moved_angles(shift: Callable[[Trajectory], Any]) -> Spoil:
    return lambda f: replace(f, q=f.q + shift(f) * _is_angle(f))


# --- building: other mechanisms ---


def _bodies(m: tb.Mechanism, change: Callable[[Any], dict[str, Any]]) -> tb.Mechanism:
    return m.model_copy(update={"bodies": tuple(b.model_copy(update=change(b)) for b in m.bodies)})


def _elements(change: Callable[[Any], dict[str, Any]]) -> Build:
    def built(m: tb.Mechanism) -> tb.Mechanism:
        every = tuple(e.model_copy(update=change(e)) for e in m.force_elements)
        return m.model_copy(update={"force_elements": every})

    return built


def _with(e: Any, **fields: Callable[[Any], Any]) -> dict[str, Any]:
    return {n: change(getattr(e, n)) for n, change in fields.items() if hasattr(e, n)}


def _about_joint(m: tb.Mechanism) -> tb.Mechanism:
    """Inertias about the joints taken for those about the centres."""

    def change(b: Any) -> dict[str, Any]:
        arm = np.subtract(b.centre, m.joint_of(b.name).child_point)
        return {"inertia": b.inertia + b.mass * float(arm @ arm)}

    return _bodies(m, change)


def _stops(change: Callable[[Any], dict[str, Any]]) -> Build:
    def built(m: tb.Mechanism) -> tb.Mechanism:
        return m.model_copy(
            update={"stops": tuple(s.model_copy(update=change(s)) for s in m.stops)}
        )

    return built


def _rubbing(kind: str) -> Build:
    """Damping in the joints: of angles, or along slots."""
    from trebucheck.models.elements import RotationalSpringDamper

    def built(m: tb.Mechanism) -> tb.Mechanism:
        size = sum(b.mass for b in m.bodies) * (m.gravity or 9.81)
        brakes = [
            RotationalSpringDamper(
                name=f"rubbing {j.name}",
                body=j.child,
                relative_to=j.parent,
                damping=1e-3 * size,
                stiffness=0.0,
            )
            for j in m.joints
            if j.kind == kind
        ]
        return m.model_copy(update={"force_elements": (*m.force_elements, *brakes)})

    return built


# --- moving: another law ---


def _by(equations: Callable[[tb.Mechanism], Equations]) -> Move:
    def moved(problem: tb.Problem, step: float) -> Trajectory:
        solution = solve(problem, 1e-10, 1e-10, equations(problem.mechanism))
        return _sampled(solution, problem, step)

    return moved


def _sampled(solution: Any, problem: tb.Problem, step: float) -> Trajectory:
    right = tb.engine("reference", timestep=step)
    t = np.arange(0.0, problem.duration + 0.5 * step, step)
    found = solution.trajectory(np.minimum(t, problem.duration))
    return replace(
        found, provenance=replace(found.provenance, engine=right.name, settings={"timestep": step})
    )


class _RubbingSlots(Equations):
    """Damping of all slides."""

    def _forces(self, q: Any, u: Any, rates: Any, quadratic: Any) -> Any:
        slides = np.arange(u.shape[-1]) >= len(self.kinematics.mechanism.angles)
        total = sum(b.mass for b in self.kinematics.mechanism.bodies)
        return super()._forces(q, u, rates, quadratic) - 0.01 * total * u * slides


def _held(problem: tb.Problem, step: float) -> Trajectory:
    """Closed stops hold in both directions."""
    return _sampled(
        solve_scheduled(problem, dict.fromkeys(s.name for s in problem.mechanism.stops)),
        problem,
        step,
    )


def _opened(change: Callable[[float, float], float]) -> Move:
    """Stops open at other times."""

    def moved(problem: tb.Problem, step: float) -> Trajectory:
        right = solve(problem).release_times
        times = {n: None if t is None else change(t, step) for n, t in right.items()}
        return _sampled(solve_scheduled(problem, times), problem, step)

    return moved


def _turned_ground(m: tb.Mechanism) -> tb.Mechanism:
    c, s = math.cos(math.radians(3)), math.sin(math.radians(3))
    x, y = m.gravity_direction
    return m.model_copy(update={"gravity_direction": (c * x - s * y, s * x + c * y)})


def _first_element(m: tb.Mechanism) -> tb.Mechanism:
    return m.model_copy(update={"force_elements": m.force_elements[1:]})


_REACTION = ("force", "reaction")
_DAMPING = ("damping", "friction", "missing")
_START_SPEED = ("start speed",)

MISTAKES: dict[str, Mistake] = {
    # reactions
    "reaction on the parent, last joint": Mistake(("'s force wrong sign",), _on_parent),
    "reactions of two joints swapped": Mistake(("exchanged",), _swapped_pair),
    "reactions one name off": Mistake(("exchanged", "are those of"), _shifted_names),
    "reactions in the child's frame": Mistake(("frame of",), _frame("child")),
    "reactions in the parent's frame": Mistake(("frame of",), _frame("parent")),
    "reactions without weight": Mistake(("weight",), _weightless),
    "reactions halved": Mistake(
        ("all joint forces times 0.5", "'s force times 0.5"),
        lambda f: replace(f, joint_reactions=_each(f.joint_reactions, lambda _, v: 0.5 * v)),
    ),
    "reactions one step old": Mistake(
        ("forces shifted",),
        lambda f: replace(f, joint_reactions=_each(f.joint_reactions, lambda _, v: _later(v))),
    ),
    "forces zero in the first sample": Mistake(("first sample", "at the start"), _first_zero),
    # time
    "speeds half a step early": Mistake(
        ("velocities shifted", "speeds of the coordinates, velocities", "speeds, and"),
        _speeds_at(-0.5),
    ),
    "speeds one step late": Mistake(
        ("velocities shifted", "speeds of the coordinates, velocities", "speeds, and"),
        _speeds_at(1.0),
    ),
    "all one step ahead": Mistake(("time shifted",), _earlier),
    "clock in single precision": Mistake(
        ("single", "time"), lambda f: replace(f, t=f.t.astype(np.float32).astype(float))
    ),
    "clock 0.1 % fast": Mistake(("rate of time",), lambda f: replace(f, t=1.001 * f.t)),
    "leapfrog: speeds and their energy of half a step before": Mistake(
        ("velocities shifted", "speeds, and"), _leapfrog
    ),
    "speeds by backward differences": Mistake(("velocities shifted",), _backward_differences),
    # markers
    "markers at the centres of mass": Mistake(
        ("centre of mass", "point of the", "taken for"), _marker_at(_centre)
    ),
    "markers at the bodies' origins": Mistake(
        ("taken for", "origin", "point of the"),
        _marker_at(lambda m, p: p.point if p.body == GROUND else (0.0, 0.0)),
    ),
    "velocities of the centres of mass": Mistake(
        ("velocity of", "velocities of", "taken for"), _velocity_of_centre
    ),
    "velocities in the bodies' frames": Mistake(("frame",), _local),
    "y of the markers down": Mistake(
        ("mirrored, y", "mirrored"),
        lambda f: replace(
            f,
            markers=_points(
                f, lambda _, m: PointMotion(m.position * [1, -1], m.velocity * [1, -1])
            ),
        ),
    ),
    "origin of the positions elsewhere": Mistake(
        ("origin of",),
        lambda f: replace(
            f,
            markers=_points(
                f, lambda _, m: replace(m, position=m.position + np.array([0.3, -0.2]))
            ),
        ),
    ),
    # coordinates
    "angles in degrees": Mistake(
        ("degrees",), lambda f: replace(f, q=np.where(_is_angle(f), np.degrees(f.q), f.q))
    ),
    "angles and speeds in degrees": Mistake(
        ("degrees",),
        lambda f: replace(
            f,
            q=np.where(_is_angle(f), np.degrees(f.q), f.q),
            u=np.where(_is_angle(f), np.degrees(f.u), f.u),
        ),
    ),
    "angles anticlockwise, slides right": Mistake(
        ("sign of", "wrong sign", "anticlockwise"),
        lambda f: replace(
            f, q=np.where(_is_angle(f), -f.q, f.q), u=np.where(_is_angle(f), -f.u, f.u)
        ),
    ),
    "angles from another zero": Mistake(("zero", "start"), _moved_angles(lambda f: 0.5 * math.pi)),
    "last angle from another zero": Mistake(
        ("another zero", "relative to the start"),
        lambda f: replace(
            f, q=f.q + 0.5 * math.pi * (np.arange(f.q.shape[1]) == len(f.mechanism.angles) - 1)
        ),
    ),
    "angles a turn off": Mistake(("another zero", "wrapped"), _moved_angles(lambda f: 2 * math.pi)),
    "angles relative": Mistake(("relative to the parent",), _relative(True, True)),
    "angles relative, speeds not": Mistake(
        ("relative to the parent", "angles"), _relative(True, False)
    ),
    "speeds relative, angles not": Mistake(
        ("relative to the parent", "speeds"), _relative(False, True)
    ),
    "coordinates in reverse order": Mistake(
        ("are those of", "exchanged"),
        lambda f: replace(f, q=f.q[:, ::-1].copy(), u=f.u[:, ::-1].copy()),
    ),
    # stops
    "torque as impulse": Mistake(
        ("torque", "'s force"),
        lambda f: replace(f, stop_torques=_each(f.stop_torques, lambda _, v: v * _step(f))),
    ),
    "torque with the wrong sign": Mistake(
        ("wrong sign",), lambda f: replace(f, stop_torques=_each(f.stop_torques, lambda _, v: -v))
    ),
    "torques of two stops swapped": Mistake(("exchanged",), _swapped_torques),
    "release one step late": Mistake(("release",), _releases(lambda f, t: t + _step(f))),
    "release at the next sample": Mistake(
        ("release",), _releases(lambda f, t: float(f.t[np.searchsorted(f.t, t)]))
    ),
    "release 0.1 s late": Mistake(("release",), _releases(lambda f, t: t + 0.1)),
    "never released is 0": Mistake(
        ("release",),
        lambda f: replace(
            f, release_times=_each(f.release_times, lambda _, t: 0.0 if t is None else t)
        ),
    ),
    # energies
    "potential energy without springs": Mistake(
        ("potential energy",), _energy(potential=_without_springs)
    ),
    "potential energy of the origins": Mistake(("potential energy",), _potential_of_origins),
    "potential energy with the wrong sign": Mistake(
        ("potential energy",), lambda f: replace(f, potential_energy=-f.potential_energy)
    ),
    "potential energy zero at the start": Mistake(
        ("zero of the potential energy",),
        lambda f: replace(f, potential_energy=f.potential_energy - f.potential_energy[0]),
    ),
    "kinetic energy without rotation": Mistake(
        ("kinetic energy",), _energy(kinetic=lambda m: _bodies(m, lambda b: {"inertia": 0.0}))
    ),
    "kinetic energy of inertias about the joints": Mistake(
        ("kinetic energy",), _energy(kinetic=_about_joint)
    ),
    "kinetic energy of the first body alone": Mistake(
        ("kinetic energy",),
        _energy(
            kinetic=lambda m: _bodies(
                m, lambda b: {} if b == m.bodies[0] else {"mass": 0.0, "inertia": 0.0}
            )
        ),
    ),
    "kinetic energy from half a step before": Mistake(
        ("kinetic energy",),
        lambda f: replace(f, kinetic_energy=_at(f, -0.5 * _step(f)).kinetic_energy),
    ),
    # built wrongly
    "gravity 9.8": Mistake(
        ("gravity", "g ("), built=lambda m: m.model_copy(update={"gravity": m.gravity * 9.8 / 9.81})
    ),
    "gravity 10": Mistake(
        ("gravity", "g ("), built=lambda m: m.model_copy(update={"gravity": m.gravity * 10 / 9.81})
    ),
    "gravity tilted 3 deg": Mistake(("direction of gravity",), built=_turned_ground),
    "no gravity": Mistake(("gravity",), built=lambda m: m.model_copy(update={"gravity": 0.0})),
    "gravity along -y whatever is asked": Mistake(
        ("gravity",), built=lambda m: m.model_copy(update={"gravity_direction": (0.0, -1.0)})
    ),
    "inertias about the joints": Mistake(("inertia",), built=_about_joint),
    "no inertias": Mistake(
        ("inertia",), built=lambda m: _bodies(m, lambda b: {"inertia": 1e-3 * b.inertia})
    ),
    "centres at the origins": Mistake(("centre of mass", "centres"), built=_at_origins),
    "rest length ignored": Mistake(
        ("rest length", "rest angle"),
        built=_elements(lambda e: _with(e, rest_length=lambda _: 0.0)),
    ),
    "rest angle ignored": Mistake(
        ("rest angle",), built=_elements(lambda e: _with(e, rest_angle=lambda _: 0.0))
    ),
    "damping ignored": Mistake(
        _DAMPING, built=_elements(lambda e: _with(e, damping=lambda _: 0.0))
    ),
    "damping doubled": Mistake(
        _DAMPING, built=_elements(lambda e: _with(e, damping=lambda c: 2 * c))
    ),
    "stiffness in N/mm": Mistake(
        ("stiffness",), built=_elements(lambda e: _with(e, stiffness=lambda k: 1e-3 * k))
    ),
    "motor with the wrong sign": Mistake(
        ("torque",), built=_elements(lambda e: _with(e, torque=lambda v: -v))
    ),
    "motor against the ground": Mistake(
        ("relative", "torque", "reaction"),
        built=_elements(lambda e: {"relative_to": GROUND} if e.kind.endswith("torque") else {}),
    ),
    "first force element forgotten": Mistake(("missing",), built=_first_element),
    "all force elements forgotten": Mistake(
        ("missing", "force element", "spring"), built=_without_springs
    ),
    "start speeds ignored": Mistake(
        _START_SPEED,
        built=lambda m: m.model_copy(update={"start_speeds": (0.0,) * len(m.coordinates)}),
    ),
    "stops open at the start forgotten": Mistake(
        ("missing",),
        built=lambda m: m.model_copy(update={"stops": tuple(s for s in m.stops if s.closed)}),
    ),
    "all stops forgotten": Mistake(
        ("missing",), built=lambda m: m.model_copy(update={"stops": ()})
    ),
    "restitution ignored": Mistake(("restitution",), built=_stops(lambda s: {"restitution": 0.0})),
    "restitution 1": Mistake(("restitution",), built=_stops(lambda s: {"restitution": 1.0})),
    "pins rub": Mistake(_DAMPING, built=_rubbing("pin")),
    # moved wrongly
    "slides rub": Mistake(_DAMPING, moved=_by(_RubbingSlots)),
    "no velocity-dependent forces": Mistake(
        ("velocity-dependent",), moved=_by(without_centrifugal)
    ),
    "stops hold in both directions": Mistake(("never",), moved=_held),
    "stops open one step late": Mistake(("release",), moved=_opened(lambda t, h: t + h)),
    "stops open 0.05 s late": Mistake(("release",), moved=_opened(lambda t, h: t + 0.05)),
}
"""By what an adapter does."""


@dataclass(frozen=True)
class Stranger(Honest):
    """An engine with one mistake."""

    name = "stranger"
    capabilities = replace(Honest.capabilities, features=frozenset(Feature))

    def simulate(self, problem: tb.Problem) -> Trajectory:
        mistake = MISTAKES[_CURRENT[-1]]
        wrong = mistake.built(problem.mechanism) if mistake.built else problem.mechanism
        if mistake.moved:
            own = tb.Problem(wrong, duration=problem.duration, stop_law=problem.stop_law)
            found = mistake.moved(own, self.timestep)
        else:
            found = _moved(
                wrong.to_json(), problem.duration, tb.StopLaw(problem.stop_law), self.timestep
            )
        found = replace(found, mechanism=problem.mechanism)
        stops = {stop.name: None for stop in problem.mechanism.stops}
        nothing = {s.name: np.zeros(len(found.t)) for s in problem.mechanism.stops if s.closed}
        found = replace(
            found,
            stop_torques=nothing | dict(found.stop_torques),
            release_times=stops | dict(found.release_times),
        )
        return mistake.read(found) if mistake.read else found


_moved = wrong_engines._moved
_CURRENT: list[str] = []


def announce(folder: Path) -> None:
    """Write the metadata of an installed distribution that brings the engine."""
    plugin_engines.announce(
        folder,
        "trebucheck-strangers",
        "[trebucheck.engines]\nstranger = adapter_mistakes:Stranger\n",
    )


def problem(name: str) -> tuple[tb.Mechanism, dict[str, Any]]:
    """A problem and how it is compared."""
    kind, _, seed = name.partition(":")
    if kind == "random":
        return random_mechanism(int(seed)), {"duration": 2.0, "stop_law": "unilateral"}
    found = library_problem(name)
    if found is None:
        return model(name), {}
    return found.mechanism, {"duration": found.duration, "stop_law": str(found.stop_law)}


def applies(mistake: Mistake, mechanism: tb.Mechanism) -> bool:
    """Whether it builds anything else."""
    return mistake.built is None or mistake.built(mechanism) != mechanism


def compared(name: str, mechanism: tb.Mechanism, options: Mapping[str, Any]) -> Run:
    """What a comparison says of an engine with the mistake."""
    _CURRENT.append(name)
    comparison = tb.compare([mechanism], ["stranger"], ["assisted"], isolate=False, **options)
    (run,) = comparison.results.runs
    return run


def verdict(mistake: Mistake, run: Run) -> str:
    """In a word; what is green has no effect on this mechanism, or one within the tolerances."""
    if run.outcome is Outcome.AGREES:
        return "GREEN"
    if run.outcome not in (Outcome.DISAGREES, Outcome.NOT_EQUIVALENT):
        return run.outcome.value
    named = run.diagnosis.named if run.diagnosis else ()
    if not named:
        return "none"
    right = any(word in f"{c.name} {c.amount}" for word in mistake.causes for c in named)
    return "named" if right else "WRONG"


def _show(name: str, mistake: str, run: Run) -> str:
    """A row of the table."""
    found = run.diagnosis
    causes = (found.named or found.causes[:3]) if found else ()
    said = "; ".join(f"{c.name} {c.amount} {c.explained:.4f}" for c in causes)
    share, broken = max(((m.share or 0.0, m.label) for m in run.metrics), default=(0.0, ""))
    word = verdict(MISTAKES[mistake], run)
    print(
        f"{name:16} {word:8} {mistake:44} [{broken} {share:.3g}] {run.message or said}", flush=True
    )
    return word


def _table(problems: Sequence[str], chosen: Sequence[str]) -> dict[str, int]:
    """Print it; how often there is which verdict."""
    counted: dict[str, int] = {}
    for name in problems:
        mechanism, options = problem(name)
        for mistake, what in MISTAKES.items():
            if applies(what, mechanism) and (not chosen or any(part in mistake for part in chosen)):
                word = _show(name, mistake, compared(mistake, mechanism, options))
                counted[word] = counted.get(word, 0) + 1
    return counted


if __name__ == "__main__":
    # The engine is found by the name of its module, which must be this one.
    sys.modules["adapter_mistakes"] = sys.modules["__main__"]
    with tempfile.TemporaryDirectory() as folder:
        announce(Path(folder))
        sys.path.insert(0, folder)
        names = [a for a in sys.argv[1:] if not a.startswith("+")]
        print(
            _table(
                names or ["fixed", "rolling"], [a[1:] for a in sys.argv[1:] if a.startswith("+")]
            )
        )
