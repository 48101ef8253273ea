"""Machines of any size.

The same errors in parts of it, from a thousandth of Table I to a thousand times.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from mechanisms import TABLE_ONE, chain_on_a_slot, everything, pin, position_error, scaled
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.diagnosis.equivalence import EXACT, check_model
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.units import SI, Units, units_of
from trebucheck.models.elements import GROUND, PrismaticJoint, RotationalSpringDamper
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

SIZES = (1e-3, *(pytest.param(size, marks=again) for size in (1e-2, 1e2)), 1e3)
ENGINES = ("mujoco", "pymunk", "exudyn")


def _errors(machine: Mechanism, size: float, engine: str) -> list[float]:
    """Errors of position, angles, reactions and energy at a step in proportion, in parts of the
    machine's own.
    """
    time = math.sqrt(size)
    problem = Problem(scaled(machine, size), 1.3 * time)
    run = tb.engine(engine, timestep=2e-3 * time).simulate(problem)
    solution = solve(problem)
    exact = solution.trajectory(run.t)

    peak = max(float(np.abs(force).max()) for force in exact.joint_reactions.values())
    reactions = [
        np.abs(run.joint_reaction(name) - force).max()
        for name, force in exact.joint_reactions.items()
    ]
    return [
        position_error(run, solution) / size,
        float(np.abs(run.q - exact.q)[:, : len(machine.bodies)].max()),
        float(max(reactions)) / peak,
        float(np.abs(run.total_energy - exact.total_energy).max() / size**4),
    ]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", TABLE_ONE)
def test_errors_are_the_same_part_of_any_size(name: str, engine: str, size: float) -> None:
    machine = TABLE_ONE[name]
    errors, expected = list(_errors(machine, size, engine)), list(_errors(machine, 1.0, engine))
    assert len(errors) > 0
    for here, there in zip(errors, expected, strict=True):
        assert here <= 3 * there


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("build", [tb.rolling, tb.catapult, tb.hinged, tb.floating_arm])
def test_a_machine_of_any_size_is_the_same_machine(build: object, engine: str, size: float) -> None:
    assert callable(build)
    checks = check_model(tb.engine(engine), scaled(build(), size)).checks
    assert checks
    assert [
        (c.name, c.subject, c.value) for c in checks if c.value is None or c.value > EXACT
    ] == []


def test_units_are_powers_of_two_and_the_named_machines_keep_si() -> None:
    for build in (tb.fixed, tb.rolling, tb.catapult, tb.hinged, tb.floating_arm):
        assert units_of(build()) == SI
    small = scaled(tb.rolling(), 1e-3)
    units = units_of(small)
    assert all(math.frexp(unit)[0] == 0.5 for unit in (units.length, units.mass, units.time))
    inner = units.mechanism(small)
    assert inner.gravity == small.gravity
    assert max(abs(x) for joint in inner.joints for x in joint.parent_point) > 1.0


def test_every_recorded_quantity_comes_back_in_si() -> None:
    """A light chain on a slot, with stops, is built in units of its own.

    The reference knows SI only.
    """
    size = 1e-2
    problem = Problem(scaled(chain_on_a_slot(), size), 0.1, stop_law="unilateral")
    assert units_of(problem.mechanism) != SI
    exact = solve(problem)
    for engine in ("mujoco", "exudyn"):
        run = tb.engine(engine, timestep=1e-4).simulate(problem)
        right = exact.trajectory(run.t)
        for name, force in right.joint_reactions.items():
            assert np.abs(run.joint_reactions[name] - force).max() < 1e-3 * np.abs(force).max(), (
                name
            )
        for values, other in (
            (run.q, right.q),
            (run.u, right.u),
            (run.kinetic_energy, right.kinetic_energy),
        ):
            assert np.abs(values - other).max() < 1e-3 * np.abs(other).max()
        assert run.t[-1] == pytest.approx(0.1, rel=1e-12)


def test_every_element_has_the_same_equations_in_any_units() -> None:
    units, mechanism = Units(0.25, 8.0, 0.5), everything()
    here, there = Equations(mechanism), Equations(units.mechanism(mechanism))
    state = State(np.array(mechanism.start) + 0.3, np.array(mechanism.start_speeds), ("deck",))
    (scaled_state,) = units.states(mechanism, [state])
    q = units.coordinates(mechanism)
    (a, force), (scaled_a, scaled_force) = (
        equations.solve(at.q, at.u, at.closed)
        for equations, at in ((here, state), (there, scaled_state))
    )
    assert scaled_a * q / units.time**2 == pytest.approx(a, rel=1e-12)
    assert scaled_force * units.force == pytest.approx(force, rel=1e-12)
    energies = here.potential_energy(state.q), there.potential_energy(scaled_state.q) * units.energy
    assert energies[0] == pytest.approx(energies[1], rel=1e-14)
    gaps = (
        here.kinematics.gap("deck", state.q),
        there.kinematics.gap("deck", scaled_state.q) * units.length,
    )
    assert gaps[0] == pytest.approx(gaps[1], rel=1e-14)


@pytest.mark.parametrize("engine", ["mujoco", "exudyn"])
def test_a_message_names_the_units_of_its_numbers(engine: str) -> None:
    small = scaled(tb.fixed(), 1e-3)
    moving = small.model_copy(update={"start_speeds": (0.0, 0.0, 5.0)})
    with pytest.raises(
        UnsupportedProblemError,
        match=r"at t = 0 \(in units of 0\.00\d+ m, [\d.e-]+ kg and 0\.03125 s\)\.$",
    ):
        tb.engine(engine, timestep=1e-4).simulate(Problem(moving, 0.01))


@pytest.mark.parametrize("seed", [0, 1, 5, 22])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_small_light_mechanism_that_moves_as_slowly_is_the_same_mechanism(
    engine: str, seed: int
) -> None:
    """Its accelerations are small in any unit made of lengths alone, and states half a metre off
    are far away.
    """
    small = Units(1e3, 1e3, 1.0).mechanism(random_mechanism(seed))
    checks = check_model(tb.engine(engine), small).checks
    assert checks
    assert [
        (c.name, c.subject, c.value) for c in checks if c.value is None or c.value > EXACT
    ] == []


def test_a_slow_motion_has_a_unit_of_time_of_its_own() -> None:
    slow = Units(1.0, 1.0, 1 / 1024).mechanism(tb.hinged())
    assert slow.gravity < 1e-5
    assert units_of(slow) == Units(time=1024.0)


@pytest.mark.parametrize(
    ("speeds", "stiffness", "rate"),
    [
        ((2.0**-8, 2.0**-9), 0.0, 2.0**-8),
        ((2.0**-10, 2.0**-7), 0.0, 2.0**-9),
        ((-(2.0**-8), 0.0), 2.0**-15, 2.0**-8),
        ((0.0, -(2.0**-10)), 2.0**-15, 2.0**-10),
    ],
)
def test_the_unit_of_time_is_that_of_the_fastest_rate(
    speeds: tuple[float, float], stiffness: float, rate: float
) -> None:
    """A speed of turning, one of sliding over the length of 4 m, or a spring's frequency.

    The spring's is sqrt(k / (2 kg (4 m)^2)).
    """
    mechanism = tb.Mechanism(
        name="slow",
        bodies=(
            tb.Body(name="rod", angle="a", mass=2.0, centre=(4.0, 0.0), inertia=0.0),
            tb.Body(name="cart", angle=None, mass=1.0, centre=(0.0, 0.0), inertia=1.0),
        ),
        joints=(
            pin("pin", GROUND, "rod"),
            PrismaticJoint(
                name="rail", parent=GROUND, child="cart", parent_point=(0.0, 0.0),
                child_point=(0.0, 0.0), axis=(1.0, 0.0), coordinate="x",
            ),
        ),
        force_elements=(RotationalSpringDamper(name="spring", body="rod", stiffness=stiffness),),
        gravity=0.0,
        start=(0.0, 0.0),
        start_speeds=speeds,
    )  # fmt: skip
    assert units_of(mechanism) == Units(time=1 / rate)


def test_an_inspection_in_other_units_keeps_its_engines_roundoff() -> None:
    seen = Inspection(np.ones(3), np.ones(3), dynamics=(), total_mass=2.0, roundoff=2.0**-24)
    in_si = Units(4.0, 8.0, 2.0).inspection(seen, tb.hinged())
    assert (in_si.roundoff, in_si.total_mass) == (2.0**-24, 16.0)
