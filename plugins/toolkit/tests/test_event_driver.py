"""The driver of engines without stops of their own, on an engine made of the mechanism's
kinematics.
"""

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything
from trebucheck.engines.events import Contacts
from trebucheck.engines.protocol import Recording
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import EventDriver, Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.schemes import State


class Lagrange:
    """Forward dynamics from the kinematics, M a = Q - b."""

    def __init__(self, mechanism: tb.Mechanism) -> None:
        self.kinematics = Kinematics(mechanism)
        self.gravity = complex(*mechanism.gravity_vector)

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        k = self.kinematics
        jacobian = k.gradient(k.centres, q, k.rates(q))
        return ((jacobian.conj().T * k.masses) @ jacobian).real + np.diag(k.inertias)

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        k = self.kinematics
        jacobian = k.gradient(k.centres, q, k.rates(q))
        felt = self.gravity - k.curvature(q, u) @ k.centres.T
        return np.linalg.solve(
            self.mass_matrix(q), applied + (jacobian.conj().T @ (k.masses * felt)).real
        )


class Motion(ConstrainedDynamics):
    scheme = "RK4"

    def advance(self, state: State, step: float, held: Contacts) -> State:
        return self.stepped(state, step, held, self.scheme)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        k = self.kinematics
        rows = {m.name: k.point(m.body, m.point) for m in self.mechanism.markers}
        points = {name: (k.position(row, q), k.velocity(row, q, u)) for name, row in rows.items()}
        needed = {
            body.name: body.mass
            * (k.acceleration(k.point(body.name, body.centre), q, u, solved.accelerations) - g)
            for body in self.mechanism.bodies
            for g in [np.array(self.mechanism.gravity_vector)]
        }
        others = self.forces_on_bodies(q, u, solved)
        left = {name: force - others.get(name, 0.0) for name, force in needed.items()}
        reactions = subtree_sums(self.mechanism, left) | dict(solved.loops)
        return Observation(points, float(k.kinetic_energy(q, u)), 0.0, reactions)


def _run(problem: tb.Problem, step: float, locate: bool = True) -> Recording:
    motion = Motion(problem.mechanism, Lagrange(problem.mechanism))
    return EventDriver(problem, motion, "lagrange", step, locate).run()


def _errors(problem: tb.Problem, step: float) -> tuple[Recording, float, float]:
    """The run, and its greatest errors of positions and of forces, relative to the greatest of
    each.
    """
    found = _run(problem, step)
    truth = solve(problem).trajectory(found.t)
    forces = [found.stop_torques[name] - truth.stop_torques[name] for name in found.stop_torques]
    forces += [
        found.joint_reactions[name] - truth.joint_reactions[name] for name in truth.joint_reactions
    ]
    peak = max(
        (float(np.abs(force).max()) for force in truth.joint_reactions.values() if force.any()),
        default=1.0,
    )
    return (
        found,
        float(np.abs(found.q - truth.q).max()),
        max(float(np.abs(e).max()) for e in forces) / peak,
    )


FALL = 2**3.5  # of an error of fourth order from one step to half of it, at least
ROUNDING = 1e-12


@pytest.mark.parametrize(("model", "duration"), [("fixed", 1.5), ("rolling", 1.8)])
def test_releases_forces_and_their_order(model: str, duration: float) -> None:
    problem = tb.Problem(getattr(tb, model)(), duration=duration)
    coarse, fine = (_errors(problem, step) for step in (2e-2, 1e-2))
    truth, late = solve(problem).release_times, list[list[float]]()
    for run in (coarse[0], fine[0]):
        late.append(
            [
                abs((run.release_times[name] or 0.0) - (truth[name] or 1.0))
                for name in list(truth)[:2]
            ]
        )
        assert run.release_times["arm stop"] is None
    assert (
        all(b < max(a / FALL, ROUNDING) for a, b in zip(*late, strict=True)) and max(late[0]) < 1e-2
    )
    assert fine[1] < coarse[1] / FALL and fine[2] < coarse[2] / FALL and coarse[1] < 2e-2


def test_a_release_at_a_steps_end_is_late_by_part_of_a_step() -> None:
    problem = tb.Problem(tb.fixed(), duration=1.3)
    late = _run(problem, 1e-2, locate=False).release_times["hanger rest"]
    truth = solve(problem).release_times["hanger rest"]
    assert late is not None and truth is not None and 0 < late - truth < 1e-2
    assert late == pytest.approx(1.20, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "step"), [("bouncing", 1e-2), ("stopped-pendulum", 2e-2), ("falling-rod", 1e-2)]
)
def test_impacts(name: str, step: float) -> None:
    problem = benchmark(name).problem()
    truth = solve(problem).impacts
    errors = list[tuple[float, float]]()
    for h in (step, step / 2):
        found, positions, _ = _errors(problem, h)
        assert len(found.impacts) == len(truth)
        late = [
            abs(time - expected)
            for (time, _), (expected, _) in zip(found.impacts, truth, strict=True)
        ]
        errors.append((positions, max(late)))
    assert all(fine < max(coarse / FALL, ROUNDING) for coarse, fine in zip(*errors, strict=True))
    for (_, impulses), (_, others) in zip(found.impacts, truth, strict=True):
        assert impulses == pytest.approx(others, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("name", ["slider-crank", "n-four-bar", "welded-rods"])
def test_loops_and_joints_that_hold_angles(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.4})
    coarse, fine = (_errors(problem, step) for step in (2e-2, 1e-2))
    assert fine[1] < max(coarse[1] / FALL, ROUNDING) and fine[2] < max(coarse[2] / FALL, ROUNDING)


def test_joint_coordinates_invert() -> None:
    mechanism = everything()
    to, (q, u) = JointCoordinates(mechanism), initial_state(mechanism)
    q, u = q + np.arange(1.0, len(q) + 1), u + np.arange(2.0, len(q) + 2)
    assert to.mechanism_positions(to.positions(q)) == pytest.approx(q, abs=1e-13)
    assert to.mechanism_speeds(to.speeds(u)) == pytest.approx(u, abs=1e-13)
    force = np.arange(len(q)) - 1.5
    assert to.forces(force) @ to.speeds(u) == pytest.approx(force @ u, abs=1e-12)
    for freedom, turn in zip(to.freedoms, to.positions(q), strict=True):
        if freedom.direction is None:
            k = Kinematics(mechanism)
            assert turn == pytest.approx(
                k.angle(freedom.joint.child, freedom.joint.parent).value(q), abs=1e-13
            )


def test_bodies_stand_depth_first() -> None:
    links = JointCoordinates(benchmark("n-four-bar").problem().mechanism).links
    assert [body.name for body, _ in links] == ["crank 0", "coupler 1", "crank 1"]
