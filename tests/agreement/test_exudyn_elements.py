"""Exudyn's joints, walls and force elements of every kind.

The built system, closed forms, order, faults.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from elements import ELEMENTS, HINGE, SEA, UP, WALLS, lever
from mechanisms import body_of, everything
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.exudyn.engine import ExudynEngine
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import PointStop, RotationalSpringDamper, SpringDamper
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.library.registry import benchmark
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solver import characteristic_time, solve

pytest.importorskip("exudyn")


@pytest.mark.parametrize("name", ELEMENTS)
def test_the_built_system_is_the_described_one(name: str) -> None:
    found = check_model(ExudynEngine(), ELEMENTS[name])
    assert found.exposed
    assert {check.name for check in found.checks} >= {
        "mass matrix",
        "force",
        "acceleration",
        "centre of mass",
    }
    assert found.holds


def off(
    mechanism: Mechanism, step: float, duration: float, law: StopLaw = StopLaw.RELEASE_ONCE
) -> list[float]:
    """Largest errors of coordinates, speeds, energy, forces of joints and stops, times and impulses
    of events.
    """
    exact = solve(Problem(mechanism, duration, stop_law=law))
    run = ExudynEngine(timestep=step).simulate(exact.problem)
    there, events = (
        exact.trajectory(run.t),
        np.array([*exact.release_times.values()], dtype=np.float64),
    )
    events = np.append(events[np.isfinite(events)], [time for time, _ in exact.impacts])
    smooth = np.all(
        np.abs(run.t[:, None] - events) > 2 * step, axis=1
    )  # there forces and speeds jump
    pairs = [(run.q, there.q), (run.u, there.u), (run.potential_energy, there.potential_energy)]
    assert set(run.joint_reactions) == set(run.joint_gaps) == set(there.joint_reactions)
    pairs += [(force, there.joint_reactions[joint]) for joint, force in run.joint_reactions.items()]
    pairs += [(force, there.stop_torques[stop]) for stop, force in run.stop_torques.items()]
    errors = [float(np.abs(mine - theirs)[smooth].max()) for mine, theirs in pairs]
    assert set(run.release_times) == set(exact.release_times)
    for stop, time in exact.release_times.items():
        found = run.release_time(stop)
        assert (found is None) == (time is None)
        errors.append(0.0 if found is None or time is None else abs(found - time))
    for (mine, impulses), (theirs, exact_impulses) in zip(run.impacts, exact.impacts, strict=True):
        errors += [
            abs(mine - theirs),
            *(abs(impulses[stop] - exact_impulses[stop]) for stop in exact_impulses),
        ]
    return errors


def assert_order_two(
    mechanism: Mechanism, step: float, duration: float, law: StopLaw = StopLaw.RELEASE_ONCE
) -> None:
    """A half of the step leaves a quarter of each error that is more than rounding."""
    pairs = zip(*(off(mechanism, h, duration, law) for h in (step, step / 2)), strict=True)
    for coarse, fine in pairs:
        assert fine <= 1e-8 or coarse / fine == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize("name", ELEMENTS)
def test_motion_forces_and_energies_are_of_order_two(name: str) -> None:
    assert_order_two(ELEMENTS[name], 1.6e-3, 0.3)


@pytest.mark.parametrize("name", WALLS)
def test_walls_of_moving_bodies(name: str) -> None:
    mechanism, duration, law = WALLS[name]
    assert check_model(ExudynEngine(), mechanism).holds
    exact = solve(Problem(mechanism, duration, stop_law=law))
    assert exact.impacts or exact.release_times["wall"]
    assert_order_two(mechanism, 1e-3, duration, law)


def test_tuned_stays_within_its_bar() -> None:
    """1e-5 (metre or radian) at 1e-4 of the characteristic time.

    At order two, 1e-3 at ten times the step.
    """
    time = characteristic_time(everything())
    exact = solve(Problem(everything(), time / 2))
    run = ExudynEngine(timestep=1e-3 * time).simulate(exact.problem)
    assert np.abs(run.q - exact.trajectory(run.t).q).max() <= 1e-3


def test_a_spring_turns_many_times_and_its_points_pass_each_other() -> None:
    """A torsion pendulum of several turns, and a mass on a spring of no length that passes through
    its end.

    The trapezoidal rule moves a harmonic oscillator exactly, but with the frequency (2 / h) atan(w
    h / 2).
    """
    k, turns, step = 3.0, 20.0, 2e-3
    disc = body_of("hull", "a", 2.0, (0.0, 0.0), 0.4)
    twist = RotationalSpringDamper(name="twist", body="hull", stiffness=k, rest_angle=1.0)
    tie = SpringDamper(name="tie", body="hull", point=(0, 0), relative_point=(0, 0), stiffness=k)
    fields: dict[str, Any] = {"name": "disc", "bodies": (disc,), "gravity": 0.0}
    wheel = Mechanism(**fields, joints=(HINGE,), force_elements=(twist,), start=(1.0 + turns,))
    mass = Mechanism(**fields, joints=(SEA,), force_elements=(tie,), start=(0.0, 0.5, 0.0))

    def oscillation(inertia: float, t: FloatArray) -> FloatArray:
        return np.cos(2 / step * np.arctan(np.sqrt(k / inertia) * step / 2) * t)

    run = ExudynEngine(timestep=step).simulate(Problem(wheel, 2.0))
    assert run.q[:, 0] - 1.0 == pytest.approx(
        turns * oscillation(disc.inertia, run.t), abs=1e-9 * turns
    )
    assert run.total_energy == pytest.approx(np.full(len(run.t), 0.5 * k * turns**2), rel=1e-9)
    run = ExudynEngine(timestep=step).simulate(Problem(mass, 2.0))
    expected = np.stack(
        [np.zeros(len(run.t)), 0.5 * oscillation(disc.mass, run.t), np.zeros(len(run.t))], axis=1
    )
    assert run.q == pytest.approx(expected, abs=1e-9)


def test_what_exudyn_has_no_item_for_is_refused() -> None:
    problem = Problem(lever(UP, True, 0.0), 0.1)
    with pytest.raises(
        UnsupportedProblemError,
        match=r"'wall' as a spring: .* this wall stands on 'hull'; leave stop_",
    ):
        ExudynEngine(stop_stiffness=1e6).simulate(problem)
    with pytest.raises(UnsupportedProblemError, match=r"'wall' as a spring"):
        ExudynEngine(stop_stiffness=1e6).inspect(problem.mechanism, ())
    itself = PointStop(
        name="wall", body="bob", point=(1, 0), relative_to="bob", normal=UP, offset=-1, closed=False
    )
    alone = Mechanism(**(dict(problem.mechanism) | {"stops": (itself,)}))
    with pytest.raises(
        UnsupportedProblemError, match="a point of 'bob', on which its wall stands as well"
    ):
        ExudynEngine().simulate(Problem(alone, 0.1))


def _object(kind: str, name: str, quantity: str, **values: object) -> Callable[[Any], None]:
    """Change parameters of the item that a sensor looks at."""

    def change(system: Any) -> None:
        number = system.main.GetSensor(system.sensors[kind, name, quantity])["objectNumber"]
        for parameter, value in values.items():
            system.main.SetObjectParameter(number, parameter, value)

    return change


def _load(vector: list[float], kind: str) -> Callable[[Any], None]:
    """Change the first load of a kind."""

    def change(system: Any) -> None:
        loads = range(system.main.systemData.NumberOfLoads())
        first = next(n for n in loads if system.main.GetLoad(n)["loadType"] == kind)
        system.main.SetLoadParameter(first, "loadVector", vector)

    return change


def _swapped(system: Any) -> None:
    """The slot's line turns with the body that slides."""
    number = system.main.GetSensor(system.sensors["joint", "slot", "ForceLocal"])["objectNumber"]
    point, line = system.main.GetObject(number)["markerNumbers"]
    system.main.SetObjectParameter(number, "markerNumbers", [line, point])


def _weld(system: Any) -> None:
    """The weld lets its bodies turn."""
    numbers = range(system.main.systemData.NumberOfObjects())
    weld = next(
        n for n in numbers if system.main.GetObject(n)["objectType"] == "ConnectorCoordinate"
    )
    system.main.SetObjectParameter(weld, "activeConnector", False)


FAULTS: dict[str, Callable[[Any], None]] = {
    "a stiffness": _object("spring", "tie", "Distance", stiffness=40.04),
    "a damping": _object("spring", "tie", "Distance", damping=1.501),
    "a rest length": _object("spring", "tie", "Distance", referenceLength=0.301),
    "a spring's sense": _object("spring", "twist", "Displacement", offset=-0.7),
    "a slot's line": _object("joint", "slot", "ForceLocal", normalMarker1=[-0.8001, 0.5999, 0.0]),
    "a slot on the wrong body": _swapped,
    "a rail that lets turn": _object("joint", "rail", "ForceLocal", constrainRotation=False),
    "a weld": _weld,
    "a force": _load([2.0, -1.001, 0.0], "ForceVector"),
    "a motor's sense": _load([0.0, 0.0, 0.9], "TorqueVector"),
    "gravity": _load([0.0, -9.81, 0.0], "MassProportional"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_an_element_shows(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.engines.exudyn import inspect as module

    rightly = module.build

    def wrongly(*arguments: Any) -> object:
        system = rightly(*arguments)
        FAULTS[fault](system)
        return system

    monkeypatch.setattr(module, "build", wrongly)
    assert not check_model(ExudynEngine(), everything()).holds


@pytest.mark.parametrize("steps", [1000, 566])
def test_loops_pass_singular_positions(steps: int) -> None:
    """The four-bar mechanism of equal links lies flat twice a turn: another branch is off by a
    radian within 0.2 s.

    Of 566 steps one ends so near to the second flat position that Newton's iteration does not
    converge.
    """
    problem = Problem(benchmark("n-four-bar").problem().mechanism, 2.0)
    run = ExudynEngine(timestep=2.0 / steps).simulate(problem)
    assert np.abs(run.q - solve(problem).trajectory(run.t).q).max() <= 1e-2
