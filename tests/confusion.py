"""Seeded faults against the causes that a diagnosis names: the confusion table.

Each fault is built without the code that suspects it: mechanisms are changed by their data, forces
by equations of their own, readings by arithmetic on the arrays. Sizes are in parts of the
mechanism's, so that every fault can be built into every mechanism. Run as a script, it prints the
table:

    python tests/confusion.py [MODEL ...] [--scale FACTOR]
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trebucheck as tb
from trebucheck.comparisons.diagnosis.diagnose import diagnose_motion
from trebucheck.comparisons.diagnosis.rerun import Rerun
from trebucheck.comparisons.runs.results import Diagnosis, Metric
from trebucheck.models.library.registry import model
from trebucheck.models.trajectory import PointMotion
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve, solve_to_launch

HONEST = 1e-10  # tolerances of the engine that moves the faulty mechanisms
UNKNOWN = ()


@dataclass(frozen=True)
class Seed:
    """A fault, and words of the causes that are right for it; none.

    It is no suspect, and must be called unknown.
    """

    name: str
    causes: tuple[str, ...]
    make: Callable[[Bench], tb.Trajectory]


@dataclass(frozen=True)
class Bench:
    """A mechanism with its reference, and how an honest engine would move and read others."""

    mechanism: tb.Mechanism
    solution: Solution
    end: float
    t: np.ndarray

    @classmethod
    def of(cls, mechanism: tb.Mechanism, steps: int = 2000) -> Bench:
        solution = solve_to_launch(mechanism)
        # Trajectories go on a little after the end, as engines' do.
        end = solution.launch.time if solution.launch else solution.problem.duration / 1.04
        return cls(mechanism, solution, end, np.linspace(0.0, 1.02 * end, steps + 1))

    @property
    def length(self) -> float:
        """Of the longest link [m]."""
        return max(math.hypot(*m.point) for m in self.mechanism.markers)

    @property
    def torque(self) -> float:
        """The weight of all bodies on that arm [N m]."""
        return sum(b.mass for b in self.mechanism.bodies) * self.mechanism.gravity * self.length

    def right(self) -> tb.Trajectory:
        return self.moved(self.mechanism)

    def moved(self, mechanism: tb.Mechanism, equations: Equations | None = None) -> tb.Trajectory:
        """The motion of another mechanism, or under other equations, to 1e-10."""
        problem = tb.Problem(mechanism, duration=1.03 * self.end)
        return self.read(solve(problem, HONEST, HONEST, equations))

    def read(self, solution: Solution) -> tb.Trajectory:
        return replace(solution.trajectory(self.t), mechanism=self.mechanism)

    def stopped(self, forces: Callable[..., Any]) -> tb.Trajectory:
        """Under further forces Q(q, u), whatever they depend on."""
        return self.moved(self.mechanism, Forced(self.mechanism, forces))

    def pulsed(self, since: float, forces: Callable[..., Any]) -> tb.Trajectory:
        """Under further forces from a time [s] on.

        The motion up to there, and another one from its state.
        """
        before = self.moved(self.mechanism)
        start = self.solution.motion(np.array([since]))
        open_by_then = [
            n for n, t in self.solution.release_times.items() if t is not None and t <= since
        ]
        stops = [s.model_dump() for s in self.mechanism.stops if s.name not in open_by_then]
        later = tb.Mechanism(
            **{
                **self.mechanism.model_dump(),
                "stops": stops,
                "start": tuple(start.q[0]),
                "start_speeds": tuple(start.u[0]),
            }
        )
        n = int(np.searchsorted(self.t, since))
        solution = solve(
            tb.Problem(later, duration=1.03 * self.end - since),
            HONEST,
            HONEST,
            Forced(later, forces),
        )
        after = solution.trajectory(self.t[n:] - since)
        zero = np.zeros(len(after.t))

        def joined(a: Any, b: Any) -> Any:
            return np.concatenate([a[:n], b])

        return replace(
            before,
            q=joined(before.q, after.q),
            u=joined(before.u, after.u),
            markers={
                k: PointMotion(
                    joined(m.position, after.markers[k].position),
                    joined(m.velocity, after.markers[k].velocity),
                )
                for k, m in before.markers.items()
            },
            kinetic_energy=joined(before.kinetic_energy, after.kinetic_energy),
            potential_energy=joined(before.potential_energy, after.potential_energy),
            stop_torques={
                k: joined(v, after.stop_torques.get(k, zero))
                for k, v in before.stop_torques.items()
            },
            joint_reactions={
                k: joined(v, after.joint_reactions[k]) for k, v in before.joint_reactions.items()
            },
            release_times={
                **before.release_times,
                **{k: t and t + since for k, t in after.release_times.items()},
            },
        )


class Forced(Equations):
    """The equations with further forces Q(q, u) [N m or N]."""

    def __init__(self, mechanism: tb.Mechanism, forces: Callable[..., Any]) -> None:
        super().__init__(mechanism)
        self._further = forces

    def _forces(self, q: Any, u: Any, rates: Any, quadratic: Any) -> Any:
        return super()._forces(q, u, rates, quadratic) + self._further(self, q, u)


# --- other mechanisms ---


def data(**changes: Any) -> Callable[[Bench], tb.Trajectory]:
    """The mechanism with other fields."""
    return lambda b: b.moved(b.mechanism.model_copy(update={k: v(b) for k, v in changes.items()}))


def part(
    parts: str, index: int, field: str, change: Callable[[Any, Bench], Any]
) -> Callable[[Bench], tb.Trajectory]:
    """The mechanism with another value of one part."""

    def make(b: Bench) -> tb.Trajectory:
        old = getattr(b.mechanism, parts)
        new = old[index].model_copy(update={field: change(getattr(old[index], field), b)})
        every = [*old]
        every[index] = new
        return b.moved(b.mechanism.model_copy(update={parts: tuple(every)}))

    return make


def turned_gravity(b: Bench, angle: float) -> tb.Trajectory:
    """Gravity turned anticlockwise, and with it weights.

    What joints bear and the potential energy follow it.
    """
    direction = complex(*b.mechanism.gravity_direction) * np.exp(1j * angle)
    return b.moved(
        b.mechanism.model_copy(
            update={"gravity_direction": (float(direction.real), float(direction.imag))}
        )
    )


def third_body(b: Bench) -> tb.Trajectory:
    """The pull of a heavy body that stands beside the mechanism, on the centres of mass."""
    at = 3 * b.length * (1 + 0.3j)

    def pull(e: Equations, q: Any, u: Any) -> Any:
        k, total = e.kinematics, 0.0
        for body, row in zip(b.mechanism.bodies, k.centres, strict=True):
            z = k.phasors(q) @ row - at
            field = 0.02 * b.mechanism.gravity * body.mass * (b.length / np.abs(z)) ** 2
            rates = k.rates(q) * row
            total = total - field[..., None] * ((z / np.abs(z))[..., None].conj() * rates).real
        return total

    return b.stopped(pull)


def on_relative(b: Bench, i: int, law: Callable[[Any, Any], Any]) -> tb.Trajectory:
    """A torque on a body against the one before it, from the relative angle since the start and its
    speed.
    """
    start = np.array(b.mechanism.start)
    row = np.zeros(len(start))
    row[i] = 1.0
    parent = b.mechanism.tree_joints[i].parent
    if parent != "ground":
        row[[body.name for body in b.mechanism.bodies].index(parent)] = -1.0
    return b.stopped(lambda e, q, u: law((q - start) @ row, u @ row)[..., None] * row)


def drag(b: Bench) -> tb.Trajectory:
    """Drag on the last marker, with the square of its speed."""
    marker = b.mechanism.markers[-1]

    def force(e: Equations, q: Any, u: Any) -> Any:
        row = e.kinematics.point(marker.body, marker.point).coefficients
        rates = e.kinematics.rates(q) * row
        v = (rates * u).sum(axis=-1)
        size = 2e-4 * b.torque / b.length / (b.mechanism.gravity * b.length)
        return (
            -size * (np.abs(v) * v)[..., None].real * rates.real
            - size * (np.abs(v) * v)[..., None].imag * rates.imag
        )

    return b.stopped(force)


# --- readings ---


def read(change: Callable[[tb.Trajectory], dict[str, Any]]) -> Callable[[Bench], tb.Trajectory]:
    def make(b: Bench) -> tb.Trajectory:
        found = b.right()
        return replace(found, **change(found))

    return make


def markers(
    change: Callable[[PointMotion], PointMotion], last: bool = False
) -> Callable[[Bench], tb.Trajectory]:
    def make(b: Bench) -> tb.Trajectory:
        found = b.right()
        chosen = [b.mechanism.markers[-1].name] if last else list(found.markers)
        return replace(
            found, markers={n: change(m) if n in chosen else m for n, m in found.markers.items()}
        )

    return make


def at_times(change: Callable[[np.ndarray, Bench], np.ndarray]) -> Callable[[Bench], tb.Trajectory]:
    """The right motion at other times than it says."""

    def make(b: Bench) -> tb.Trajectory:
        solution = solve(tb.Problem(b.mechanism, duration=1.06 * b.end), HONEST, HONEST)
        return replace(solution.trajectory(change(b.t, b)), t=b.t)

    return make


def cut(b: Bench, share: float) -> tb.Trajectory:
    found = b.right()
    n = int(share * len(b.t))
    return replace(b.solution.trajectory(found.t[:n]), mechanism=b.mechanism)


def moved_marker(b: Bench) -> tb.Trajectory:
    found, marker = b.right(), b.mechanism.markers[-1]
    k = b.solution.equations.kinematics
    row = k.point(
        marker.body, (marker.point[0] + 0.001 * b.length, marker.point[1] + 0.002 * b.length)
    )
    return replace(
        found,
        markers={
            **found.markers,
            marker.name: PointMotion(k.position(row, found.q), k.velocity(row, found.q, found.u)),
        },
    )


def noisy(values: Any, seed: int, size: float = 1e-4) -> Any:
    return values + size * np.abs(values).max(axis=0) * np.random.default_rng(seed).standard_normal(
        values.shape
    )


def noisy_everything(f: tb.Trajectory) -> dict[str, Any]:
    return {
        "q": noisy(f.q, 1),
        "u": noisy(f.u, 2),
        "kinetic_energy": noisy(f.kinetic_energy, 3),
        "markers": {
            n: PointMotion(noisy(m.position, 4), noisy(m.velocity, 5)) for n, m in f.markers.items()
        },
        "potential_energy": noisy(f.potential_energy, 6),
    }


def outlier(f: tb.Trajectory) -> dict[str, Any]:
    """A wave on all coordinates and speeds that no mechanics makes."""
    wave = 1e-3 * np.sin(40 * np.pi * f.t / f.t[-1])[:, None]
    return {
        "q": f.q + wave,
        "u": f.u + wave,
        "kinetic_energy": f.kinetic_energy * (1 + wave[:, 0]),
        "markers": {
            n: PointMotion(m.position * (1 + wave), m.velocity * (1 + wave))
            for n, m in f.markers.items()
        },
    }


def single_steps(b: Bench) -> tb.Trajectory:
    """Semi-implicit steps of its own, a wrong scheme of first order: the error of a method."""
    e, (q, u) = (
        b.solution.equations,
        (b.solution.motion(b.t[:1]).q[0], b.solution.motion(b.t[:1]).u[0]),
    )
    opened = b.solution.release_times
    states = [(q, u)]
    for t0, t1 in zip(b.t[:-1], b.t[1:], strict=True):
        closed = [n for n, t in opened.items() if t is None or t > t0]
        closed = [n for n in closed if b.mechanism.stop(n).closed]
        u = u + (t1 - t0) * e.solve(q, u, closed)[0]
        q = q + (t1 - t0) * u
        states.append((q, u))
    motion = b.solution.motion_of(
        b.t, np.array([s[0] for s in states]), np.array([s[1] for s in states])
    )
    return b.solution.reading(b.t, motion)


def _start(shift: float, index: int) -> Callable[[Bench], Any]:
    return lambda b: tuple(v + shift * (i == index) for i, v in enumerate(b.mechanism.start))


def _started(index: int, shift: float) -> Callable[[Bench], tb.Trajectory]:
    """Another start; the stops stand where it touches them."""
    from trebucheck.comparisons.diagnosis.faults import consistent_mechanism

    def make(b: Bench) -> tb.Trajectory:
        wrong = consistent_mechanism({**b.mechanism.model_dump(), "start": _start(shift, index)(b)})
        assert wrong is not None
        return b.moved(wrong)

    return make


def _twice(
    first: Callable[[tb.Mechanism, Bench], tb.Mechanism], *more: Any
) -> Callable[[Bench], tb.Trajectory]:
    def make(b: Bench) -> tb.Trajectory:
        wrong = first(b.mechanism, b)
        for change in more:
            wrong = change(wrong, b)
        return b.moved(wrong)

    return make


def _with(
    parts: str, index: int, **values: Callable[[Any, Bench], Any]
) -> Callable[[tb.Mechanism, Bench], tb.Mechanism]:
    def change(m: tb.Mechanism, b: Bench) -> tb.Mechanism:
        every = [*getattr(m, parts)]
        every[index] = every[index].model_copy(
            update={k: v(getattr(every[index], k), b) for k, v in values.items()}
        )
        return m.model_copy(update={parts: tuple(every)})

    return change


def _aside(x: float, y: float) -> Callable[[Any, Bench], Any]:
    return lambda p, b: (p[0] + x * b.length, p[1] + y * b.length)


def _scaled(factor: float) -> Callable[[Any, Bench], Any]:
    return lambda value, b: value * factor


def seeds(mechanism: tb.Mechanism) -> Iterator[Seed]:
    """All faults of a mechanism whose last body is a sling, and whose second one hangs on a pin."""
    for some in (_of_data, _of_forces, _of_readings, _unknown):
        yield from some(mechanism)


def unit(b: Bench) -> float:
    """Of damping [N m s/rad]."""
    return b.torque * math.sqrt(b.length / b.mechanism.gravity)


def _of_data(mechanism: tb.Mechanism) -> Iterator[Seed]:
    names = [body.name for body in mechanism.bodies]
    joints = mechanism.tree_joints
    last = len(joints) - 1
    sling, pin = names[last], joints[last].name

    yield Seed(
        "gravity 0.1 % strong", ("gravity",), data(gravity=lambda b: 1.001 * b.mechanism.gravity)
    )
    yield Seed(
        "a quarter of gravity", ("gravity",), data(gravity=lambda b: 0.25 * b.mechanism.gravity)
    )
    yield Seed(
        "gravity tilted 0.05 deg",
        ("direction of gravity",),
        lambda b: turned_gravity(b, math.radians(0.05)),
    )
    yield Seed(
        "gravity tilted 3 deg",
        ("direction of gravity",),
        lambda b: turned_gravity(b, math.radians(-3)),
    )
    for i, name in enumerate(names):
        named = (f"mass of the {name}", "m_b (", "m_cw (", "m_a (", f"inertia of the {name}")
        yield Seed(f"mass of the {name} +0.2 %", named, part("bodies", i, "mass", _scaled(1.002)))
    yield Seed(
        "arm's inertia -1 %",
        (f"inertia of the {names[0]}", "armature"),
        part("bodies", 0, "inertia", _scaled(0.99)),
    )
    yield Seed(
        "arm's mass +30 %",
        ("m_a (", f"mass of the {names[0]}", f"mass and inertia of the {names[0]}"),
        _twice(_with("bodies", 0, mass=_scaled(1.3), inertia=_scaled(1.3))),
    )
    where = (f"place of the {pin}", "r (", "l1 (", f"centre of mass of the {sling}")
    yield Seed(
        "a pin aside, across",
        where,
        part("joints", mechanism.joints.index(joints[last]), "parent_point", _aside(0, 1e-4)),
    )
    yield Seed(
        "a pin aside, aslant",
        where,
        part("joints", mechanism.joints.index(joints[last]), "parent_point", _aside(7e-5, -7e-5)),
    )
    middle = joints[1]
    other = (f"place of the {middle.name}", "h (", "l2 (", f"centre of mass of the {names[1]}")
    yield Seed(
        "the other pin aside on its parent",
        other,
        part("joints", mechanism.joints.index(middle), "parent_point", _aside(1e-4, 2e-4)),
    )
    centre = (f"centre of mass of the {names[0]}",)
    yield Seed("arm's centre aside", centre, part("bodies", 0, "centre", _aside(0, 2e-4)))
    yield Seed("arm's centre aslant, far", centre, part("bodies", 0, "centre", _aside(0.03, 0.02)))
    yield Seed(
        "another start",
        ("start of", "theta0", "phi0", "alpha0", "place of the"),
        _started(last, 1e-3),
    )
    yield Seed(
        "a start 10 deg off",
        ("start of", "theta0", "phi0", "alpha0"),
        _started(0, math.radians(10)),
    )


def _of_forces(mechanism: tb.Mechanism) -> Iterator[Seed]:
    joints = mechanism.tree_joints
    middle, pin, last = joints[1], joints[-1].name, len(joints) - 1
    spring = lambda b, i, k: on_relative(b, i, lambda x, v: -k * b.torque * x)  # noqa: E731
    yield Seed("a spring on a pin", (f"spring on the {middle.name}",), lambda b: spring(b, 1, 1e-4))
    yield Seed(
        "a strong spring on a pin", (f"spring on the {middle.name}",), lambda b: spring(b, 1, 0.05)
    )
    yield Seed(
        "a spring relaxed elsewhere",
        (f"spring on the {middle.name}", f"torque on the {middle.name}"),
        lambda b: on_relative(b, 1, lambda x, v: -1e-3 * b.torque * (x - 0.7)),
    )
    yield Seed(
        "friction in the first joint",
        (f"friction or damping of the {joints[0].name}",),
        lambda b: on_relative(b, 0, lambda x, v: -1e-4 * unit(b) * v),
    )
    yield Seed(
        "friction in the last pin",
        (f"friction or damping of the {pin}",),
        lambda b: on_relative(b, last, lambda x, v: -1e-5 * unit(b) * v),
    )


def _of_readings(mechanism: tb.Mechanism) -> Iterator[Seed]:
    pin, marker = mechanism.tree_joints[-1].name, mechanism.markers[-1].name
    stop = next((s.name for s in mechanism.stops if s.closed), None)
    yield Seed("time times 1.001", ("rate of time",), at_times(lambda t, b: t / 1.001))
    yield Seed(
        "a late state", ("time shifted",), at_times(lambda t, b: np.maximum(t - 7e-4 * b.end, 0.0))
    )
    yield Seed(
        "kinetic energy 0.1 % low",
        ("kinetic energy",),
        read(lambda f: {"kinetic_energy": 0.999 * f.kinetic_energy}),
    )
    yield Seed(
        "half the kinetic energy",
        ("kinetic energy",),
        read(lambda f: {"kinetic_energy": 0.5 * f.kinetic_energy}),
    )
    yield Seed(
        "potential energy zero at the start",
        ("potential energy",),
        read(lambda f: {"potential_energy": f.potential_energy - f.potential_energy[0]}),
    )
    yield Seed(
        "energies moved",
        ("energy",),
        read(
            lambda f: {
                "kinetic_energy": 0.9 * f.kinetic_energy,
                "potential_energy": f.potential_energy + 0.1 * f.kinetic_energy,
            }
        ),
    )
    yield Seed("a run cut in half", ("run ends early",), lambda b: cut(b, 0.5))
    yield Seed("a run cut at 90 %", ("run ends early",), lambda b: cut(b, 0.9))
    yield Seed("speeds with the wrong sign", ("speeds",), read(lambda f: {"u": -f.u}))
    yield Seed(
        "angles wrapped",
        ("wrapped", "sign of", "coordinates"),
        read(lambda f: {"q": np.angle(np.exp(1j * f.q))}),
    )
    yield Seed("degrees", ("degrees",), read(lambda f: {"q": np.degrees(f.q)}))
    yield Seed(
        "all in degrees", ("degrees",), read(lambda f: {"q": np.degrees(f.q), "u": np.degrees(f.u)})
    )
    yield Seed(
        "markers mirrored",
        ("mirrored",),
        markers(lambda m: PointMotion(m.position * [-1, 1], m.velocity * [-1, 1])),
    )
    yield Seed(
        "velocities with the wrong sign",
        ("velocity", "velocities"),
        markers(lambda m: replace(m, velocity=-m.velocity)),
    )
    yield Seed(
        "one marker in feet",
        (f"scale of the {marker}", "markers"),
        markers(lambda m: PointMotion(m.position / 0.3048, m.velocity / 0.3048), True),
    )
    yield Seed("a marker aside", (f"point of the {marker}",), moved_marker)
    yield Seed(
        "single precision",
        ("single precision",),
        read(
            lambda f: {
                "q": f.q.astype(np.float32).astype(float),
                "u": f.u.astype(np.float32).astype(float),
                "markers": {
                    n: PointMotion(
                        m.position.astype(np.float32).astype(float),
                        m.velocity.astype(np.float32).astype(float),
                    )
                    for n, m in f.markers.items()
                },
            }
        ),
    )
    if len(mechanism.markers) > 1:
        yield Seed(
            "markers exchanged",
            ("exchanged",),
            read(
                lambda f: {
                    "markers": dict(zip(f.markers, list(f.markers.values())[::-1], strict=True))
                }
            ),
        )
    yield Seed(
        "reactions with the wrong sign",
        ("force",),
        read(lambda f: {"joint_reactions": {n: -v for n, v in f.joint_reactions.items()}}),
    )
    yield Seed(
        "one reaction doubled",
        (f"{pin}'s force",),
        read(lambda f: {"joint_reactions": {**f.joint_reactions, pin: 2 * f.joint_reactions[pin]}}),
    )
    yield Seed(
        "nothing moves",
        ("no motion",),
        read(
            lambda f: {
                "q": 0 * f.q + f.q[0],
                "u": 0 * f.u,
                "kinetic_energy": 0 * f.kinetic_energy,
                "potential_energy": 0 * f.potential_energy + f.potential_energy[0],
                "markers": {
                    n: PointMotion(0 * m.position + m.position[0], 0 * m.velocity)
                    for n, m in f.markers.items()
                },
            }
        ),
    )
    yield Seed(
        "not a number",
        ("not a finite number",),
        read(lambda f: {"q": np.where(f.t[:, None] > 0.5 * f.t[-1], np.nan, f.q)}),
    )
    if stop is not None:
        yield Seed(
            "stop torques with the wrong sign",
            ("torque", "force"),
            read(lambda f: {"stop_torques": {n: -v for n, v in f.stop_torques.items()}}),
        )
        yield Seed(
            "releases not told",
            ("release",),
            read(lambda f: {"release_times": dict.fromkeys(f.release_times)}),
        )
        yield Seed(
            "releases told early",
            ("release",),
            read(
                lambda f: {"release_times": {n: t and 0.99 * t for n, t in f.release_times.items()}}
            ),
        )


def _unknown(mechanism: tb.Mechanism) -> Iterator[Seed]:
    last = len(mechanism.bodies) - 1
    yield Seed("drag on the projectile", UNKNOWN, drag)
    yield Seed("a third body", UNKNOWN, third_body)
    yield Seed(
        "a spring that stiffens",
        UNKNOWN,
        lambda b: on_relative(b, 1, lambda x, v: -2e-3 * b.torque * x**3),
    )
    yield Seed(
        "a spring that stiffens, last pin",
        UNKNOWN,
        lambda b: on_relative(b, last, lambda x, v: -1e-5 * b.torque * x**3),
    )
    yield Seed(
        "friction of the square",
        UNKNOWN,
        lambda b: on_relative(
            b, 0, lambda x, v: -1e-4 * b.torque * v * np.abs(v) * b.length / b.mechanism.gravity
        ),
    )
    yield Seed(
        "dry friction",
        UNKNOWN,
        lambda b: on_relative(
            b,
            0,
            lambda x, v: (
                -1e-3 * b.torque * np.tanh(50 * v * math.sqrt(b.length / b.mechanism.gravity))
            ),
        ),
    )
    yield Seed("noise on everything", UNKNOWN, read(noisy_everything))
    yield Seed("a wave on everything", UNKNOWN, read(outlier))
    for since in (0.3, 0.7):
        yield Seed(
            f"a torque from {since:g} of the time on",
            UNKNOWN,
            lambda b, since=since: b.pulsed(
                since * b.end,
                lambda e, q, u: 1e-3 * b.torque * np.broadcast_to(np.eye(q.shape[-1])[0], q.shape),
            ),
        )
    yield Seed("steps of first order", UNKNOWN, single_steps)
    yield Seed(
        "two masses wrong",
        UNKNOWN,
        _twice(
            _with("bodies", 0, mass=_scaled(1.003), inertia=_scaled(1.003)),
            _with("bodies", last, mass=_scaled(0.998)),
        ),
    )
    yield Seed(
        "friction and tilt",
        UNKNOWN,
        lambda b: b.stopped(
            lambda e, q, u: (
                -2e-5 * unit(b) * u
                + ((e.kinematics.rates(q).conj() * e._weights) * (np.exp(1e-3j) - 1)).real
            )
        ),
    )


@dataclass(frozen=True)
class Entry:
    """A row of the table."""

    seed: Seed
    diagnosis: Diagnosis
    cpu: float

    @property
    def named(self) -> bool:
        """Whether a right cause is first or second."""
        first = [f"{c.name} {c.amount}" for c in self.diagnosis.causes[:2]]
        return any(right in text for right in self.seed.causes for text in first)

    @property
    def verdict(self) -> str:
        """In a word."""
        said = bool(self.diagnosis.likeliest)
        if not self.seed.causes:
            return "FALSE" if said else "unknown"
        return ("named" if said else "listed") if self.named else ("WRONG" if said else "missed")


def diagnosed(bench: Bench, seed: Seed) -> Entry:
    """What is said of a fault."""
    metric = Metric(name="seeded", value=1.0, unit="1", tolerance=0.5)
    trajectory = seed.make(bench)
    started = time.process_time()
    rerun = Rerun(tb.engine("reference"), lambda *_: trajectory)
    found = diagnose_motion((metric,), trajectory, bench.solution, bench.end, rerun)
    assert found is not None
    return Entry(seed, found, time.process_time() - started)


def scaled(mechanism: tb.Mechanism, factor: float) -> tb.Mechanism:
    """The mechanism with all lengths times a factor, masses by its cube.

    Its time is longer by the root.
    """

    def grown(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {k: grown(v, k) for k, v in value.items()}
        if key in ("centre", "parent_point", "child_point", "point"):
            return tuple(factor * v for v in value)
        if isinstance(value, tuple | list) and key != "start":
            return tuple(grown(v, key) for v in value)
        return (
            value * {"mass": factor**3, "inertia": factor**5, "offset": factor}.get(key, 1.0)
            if isinstance(value, float)
            else value
        )

    fields = grown(mechanism.model_dump())
    n = len(mechanism.bodies)
    fields["start"] = mechanism.start[:n] + tuple(factor * v for v in mechanism.start[n:])
    return tb.Mechanism(**fields)


def _show(entry: Entry) -> Entry:
    first = "; ".join(f"{c.name} {c.amount} {c.explained:.4f}" for c in entry.diagnosis.causes[:3])
    print(f"{entry.verdict:8} {entry.seed.name:36} {entry.cpu:5.2f} s  {first}", flush=True)
    return entry


def counted(entries: Sequence[Entry]) -> str:
    """The table in a sentence."""
    right = [e for e in entries if e.seed.causes]
    rest = [e for e in entries if not e.named]
    return (
        f"{len(entries)} faults: of {len(right)} with a suspect {sum(e.named for e in right)} "
        f"first or second, "
        f"{sum(e.named and bool(e.diagnosis.likeliest) for e in right)} of them as likeliest; "
        f"'unknown' in {sum(not e.diagnosis.likeliest for e in rest)} of the other {len(rest)}; "
        f"{np.mean([e.cpu for e in entries]):.2f} s of processor time each"
    )


if __name__ == "__main__":
    arguments = sys.argv[1:]
    factor = float(arguments.pop(arguments.index("--scale") + 1)) if "--scale" in arguments else 1.0
    only = [a[1:] for a in arguments if a.startswith("+")]
    chosen = [a for a in arguments if not a.startswith(("-", "+"))] or ["fixed", "rolling"]
    for name in chosen:
        bench = Bench.of(scaled(model(name), factor))
        seeded = [
            seed for seed in seeds(bench.mechanism) if not only or any(o in seed.name for o in only)
        ]
        print(name)
        print(counted([_show(diagnosed(bench, seed)) for seed in seeded]))
