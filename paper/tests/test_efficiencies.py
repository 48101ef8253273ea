"""What energy is available, and how much of it each machine's projectile gets."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import model
from trebucheck.reference.solver import solve_to_launch
from trebucheck_paper.design.efficiency import (
    available_energy,
    fastest_sling,
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


def test_a_catapult_has_no_sling() -> None:
    assert fastest_sling("catapult") is None
