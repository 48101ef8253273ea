"""An own engine: rigid bodies in Cartesian coordinates and SciPy (docs/plugins.md builds it up)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import trebucheck as tb
from scipy.integrate import solve_ivp
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.models.features import Basic
from trebucheck.models.trajectory import PointMotion


# Step 1: what it can do. Everything that is not declared is refused with one sentence before `_run`
# is called.
class ScipyBodies(BuiltinEngine):
    """Bodies pinned to each other in a tree; active stops are rows of the same equations."""

    name: ClassVar[str] = "scipy-bodies"
    package: ClassVar[str] = "scipy"  # its version is recorded
    # The preset 'default' beside 'assisted', whose options are the defaults of the fields.
    default_options: ClassVar[Mapping[str, object] | None] = {"rtol": 1e-6}
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset({tb.StopLaw.RELEASE_ONCE}),
        lacking=frozenset({Basic.SLOT, Basic.LOOP, Basic.POINT_STOP}),
        formulation="Cartesian coordinates, pins and closed stops as multipliers, DOP853",
    )
    # An option: validated, recorded with each trajectory, set by --option rtol=1e-9.
    rtol: float = 1e-11

    def _run(self, problem: tb.Problem) -> Recording:
        model, grid = Bodies(problem.mechanism), np.arange(0.0, problem.duration, self.timestep)
        y, t, times, states, forces = model.start(), 0.0, [], [], []
        closed = [stop.name for stop in problem.mechanism.stops if stop.closed]
        held = model.pushing(closed, y)
        released: dict[str, float | None] = {name: None if name in held else 0.0 for name in closed}
        rtol = self.rtol
        options: Any = {"dense_output": True, "rtol": rtol, "atol": rtol, "max_step": 0.05}
        while t < problem.duration:
            span, events = (t, problem.duration), [*map(model.opening, held)]
            solved: Any = solve_ivp(
                model.rates, span, y, "DOP853", args=(held,), events=events, **options
            )
            t, y = float(solved.t[-1]), solved.y[:, -1]
            own = [*grid[(grid >= solved.t[0]) & (grid < t)], t]
            times, states = [*times, *own], [*states, *map(solved.sol, own)]
            forces += [model.solved(state, held)[1] for state in states[-len(own) :]]
            opened = [name for name, found in zip(held, solved.t_events, strict=True) if len(found)]
            released |= dict.fromkeys(opened, t)
            held = model.pushing([name for name in held if name not in opened], y)
        return model.recording(np.array(times), np.array(states), forces, released)

    def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
        """Step 5: the model check, before any motion, on bodies built as for a run."""
        model = Bodies(mechanism)
        seen = tuple(model.dynamics(state) for state in states)
        return Inspection(
            np.array(mechanism.start), np.array(model.speeds), seen, float(model.mass[::3].sum())
        )


def _turn(angle: float, v: Any) -> np.ndarray:
    """Step 2: a vector of a body's frame in the world; angles are clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] + s * v[1], -s * v[0] + c * v[1]])


class Bodies:
    """Centre (x, y) and clockwise angle of each body; the state y is these and their rates."""

    def __init__(self, mechanism: tb.Mechanism) -> None:
        self.m, self.index = mechanism, {b.name: 3 * i for i, b in enumerate(mechanism.bodies)}
        self.mass = np.array(
            [value for b in mechanism.bodies for value in (b.mass, b.mass, b.inertia)]
        )
        self.weight = self.mass * np.tile([*mechanism.gravity_vector, 0.0], len(mechanism.bodies))
        self.speeds = mechanism.start_speeds or (0.0,) * len(mechanism.bodies)  # left out: at rest

    def at(self, body: str, point: Any, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Step 2: a body point's place, velocity, Jacobian and acceleration for x'' = 0."""
        J = np.zeros((2, len(x)))
        if body == "ground":
            return np.array(point), np.zeros(2), J, np.zeros(2)
        i, arm = self.index[body], np.subtract(point, self.m.body(body).centre)
        r = _turn(x[i + 2], arm)
        J[0, i], J[1, i + 1], J[:, i + 2] = 1.0, 1.0, _turn(x[i + 2] + np.pi / 2, arm)
        return x[i : i + 2] + r, J @ v, J, -r * v[i + 2] ** 2

    def start(self, q: Any = None, u: Any = None) -> np.ndarray:
        """The state with these angles and speeds: each body hangs on its joint."""
        x, v = np.zeros(len(self.mass)), np.zeros(len(self.mass))
        x[2::3], v[2::3] = self.m.start if q is None else q, self.speeds if u is None else u
        for joint in self.m.joints:
            i = self.index[joint.child]
            there = self.at(joint.parent, joint.parent_point, x, v)
            here = self.at(joint.child, joint.child_point, x, v)
            x[i : i + 2], v[i : i + 2] = there[0] - here[0], there[1] - here[1]
        return np.concatenate([x, v])

    def solved(self, y: np.ndarray, held: Sequence[str]) -> tuple[np.ndarray, dict[str, Any]]:
        """Step 3: accelerations, forces of pins (on the child, in the world) and stops (>= 0)."""
        x, v = np.split(y, 2)
        ends = [
            (self.at(j.child, j.child_point, x, v), self.at(j.parent, j.parent_point, x, v))
            for j in self.m.joints
        ]
        stops = [stop for stop in map(self.m.stop, held) if isinstance(stop, tb.Stop)]
        turns = np.zeros((len(stops), len(x) + 3))  # its three columns come last, and are cut off
        for row, stop in zip(turns, stops, strict=True):
            row[self.index.get(stop.relative_to, -3) + 2] = -stop.sense
            row[self.index[stop.body] + 2] = stop.sense
        J = np.vstack([*(child[2] - parent[2] for child, parent in ends), turns[:, :-3]])
        bias = np.concatenate(
            [*(child[3] - parent[3] for child, parent in ends), np.zeros(len(stops))]
        )
        n, k = len(x), len(J)  # unknown: n accelerations, k forces
        matrix = np.block([[np.diag(self.mass), -J.T], [J, np.zeros((k, k))]])
        found = np.linalg.solve(matrix, np.concatenate([self.weight, -bias]))
        pins = {j.name: found[n + 2 * i : n + 2 * i + 2] for i, j in enumerate(self.m.joints)}
        return found[:n], pins | {
            f"stop {name}": found[k + n - len(held) + i] for i, name in enumerate(held)
        }

    def pushing(self, held: list[str], y: np.ndarray) -> list[str]:
        """Select the closed stops that push; one that would have to pull has opened."""
        while held:
            forces = self.solved(y, held)[1]
            least = min(held, key=lambda name: forces[f"stop {name}"])
            if forces[f"stop {least}"] >= 0:
                break
            held = [name for name in held if name != least]
        return held

    def rates(self, _: float, y: np.ndarray, held: Sequence[str]) -> np.ndarray:
        """Time derivative of the state."""
        return np.concatenate([np.split(y, 2)[1], self.solved(y, held)[0]])

    def opening(self, name: str) -> Any:
        """Event: the torque of a stop falls through zero; solve_ivp locates it inside its step."""

        def torque(_: float, y: np.ndarray, held: Sequence[str]) -> float:
            return float(self.solved(y, held)[1][f"stop {name}"])

        event: Any = torque
        event.terminal, event.direction = True, -1
        return event

    def recording(
        self, t: np.ndarray, y: np.ndarray, forces: list[dict[str, Any]], released: Any
    ) -> Recording:
        """Step 4: recorded quantities, with units, signs, frames and zeros of docs/plugins.md."""
        x, v = np.split(y, 2, axis=1)
        places = {
            p.name: [self.at(p.body, p.point, *xv)[:2] for xv in zip(x, v, strict=True)]
            for p in self.m.markers
        }
        return Recording(
            t=t,
            q=x[:, 2::3],
            u=v[:, 2::3],
            steps=len(t),
            release_times=released,
            markers={
                name: PointMotion(*np.array(own).swapaxes(0, 1)) for name, own in places.items()
            },
            kinetic_energy=0.5 * v**2 @ self.mass,
            potential_energy=-x @ self.weight,  # zero at the world's origin
            stop_torques={
                s.name: np.array([f.get(f"stop {s.name}", 0.0) for f in forces])
                for s in self.m.stops
            },
            joint_reactions={j.name: np.array([f[j.name] for f in forces]) for j in self.m.joints},
        )

    def dynamics(self, state: State) -> Dynamics:
        """Dynamics in a state."""
        accelerations, forces = self.solved(self.start(state.q, state.u), state.closed)
        return Dynamics(
            accelerations[2::3], {name: float(forces[f"stop {name}"]) for name in state.closed}
        )


if __name__ == "__main__":
    print(ScipyBodies().simulate(tb.Problem(tb.fixed(), duration=3.0)).launch())
