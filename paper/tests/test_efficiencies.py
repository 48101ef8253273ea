"""What energy is available, and how much of it each machine's projectile gets."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import model, parameters_type
from trebucheck.reference.solver import solve_to_launch
from trebucheck_paper.design.efficiency import (
    BOUNDS,
    SLINGS,
    available_energy,
    fastest_sling,
    kinetic_energy,
    most_efficient,
)


@given(parameters=machine_parameters())
def test_a_tree_hangs_down_with_every_angle_for_itself(parameters: tb.TrebuchetParameters) -> None:
    """U is a sum of one wave per angle, so its least value is minus the sum of their amplitudes."""
    machine = tb.rolling(parameters)
    kinematics = Kinematics(machine)
    amplitudes = np.abs(kinematics.masses @ kinematics.centres)[: len(machine.bodies)]
    start = float(kinematics.potential_energy(np.array(machine.start)))
    assert available_energy(machine) == pytest.approx(
        start + machine.gravity * amplitudes.sum(), rel=1e-9
    )


def test_a_linkage_goes_as_low_as_its_tracks_let_it() -> None:
    """Arm upright with the counterweight below, sling hanging from its top."""
    p = tb.FloatingArmParameters()
    machine = tb.floating_arm(p)
    arm = machine.bodies[0]
    start = float(Kinematics(machine).potential_energy(np.array(machine.start)))
    along = -arm.centre[0]  # wheel to centre of mass, towards the counterweight
    lowest = -machine.gravity * (arm.mass * along + p.m_b * (p.r - p.l1))
    assert available_energy(machine) == pytest.approx(start - lowest, rel=1e-9)


def test_no_machine_gives_more_than_there_is() -> None:
    for name in ("fixed", "rolling", "catapult", "hinged", "floating-arm"):
        machine = model(name)
        launch = solve_to_launch(machine).launch
        assert launch is not None
        mass = next(
            machine.thrown_mass(marker) for marker in machine.markers if marker.name == "projectile"
        )
        assert mass == 60.0
        assert 0 < 0.5 * mass * launch.speed**2 < available_energy(machine)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fixed", "hinged"])
def test_no_other_sling_is_faster(name: str) -> None:
    """Inside the lengths looked at, on a grid that shares no point with the search's."""
    found = fastest_sling(name)
    assert found is not None
    for r in np.linspace(SLINGS[0] + 0.1, SLINGS[1] - 0.1, 23):
        machine = model(name, parameters_type(name)(r=float(r)))
        solution = solve_to_launch(machine)
        if solution.launch is None:
            continue
        arm = float(solution.motion(np.array([solution.launch.time])).q[0, 0])
        if name == "hinged" or arm < 3 * math.pi / 2:
            assert solution.launch.speed <= found[2].speed * (1 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fixed", "floating-arm"])
def test_no_machine_within_the_bounds_is_more_efficient(name: str) -> None:
    """Neighbours of the best one, by the other integrator, to what the last look can miss."""
    best = most_efficient(name)
    if best is None:
        pytest.skip("heyoka, which makes the search fast enough, is not installed")
    assert best.efficiency == pytest.approx(_efficiency_of(name, best.chosen), rel=1e-8)
    assert all(
        low <= best.chosen[key] <= high for key, (low, high) in BOUNDS.items() if key in best.chosen
    )
    for key, value in best.chosen.items():
        for aside in (-0.1, 0.1):
            beside = best.chosen | {key: float(np.clip(value + aside, *BOUNDS[key]))}
            # The last places stand 4 cm apart: between them the efficiency can be a thousandth
            # larger, not more.
            assert _efficiency_of(name, beside) <= best.efficiency * 1.001


def _efficiency_of(name: str, chosen: dict[str, float]) -> float:
    machine = model(name, parameters_type(name)(**chosen, l2=14.0 - chosen["l1"]))
    launch = solve_to_launch(machine).launch
    return (
        0.0 if launch is None else kinetic_energy(machine, launch.speed) / available_energy(machine)
    )


def test_a_catapult_has_no_sling() -> None:
    assert fastest_sling("catapult") is None
