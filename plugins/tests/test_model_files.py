"""The preset `given` of engines that take MuJoCo's models, against MuJoCo's own on the same file.

An engine has an environment of its own: where it is not installed, its cases are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.presets import GIVEN
from trebucheck.engines.registry import causes_of
from trebucheck.models.controls import ControlRecord
from trebucheck.models.trajectory import Trajectory

# A slide and a hinge, both damped, a limit that is met, a motor, a step and a softness of its own.
# Its solver goes on to rounding: two solvers stop at other gains.
CART_POLE = """
<mujoco model="cart-pole">
  <compiler angle="radian"/>
  <option timestep="0.002" tolerance="1e-20" {options}>{flags}</option>
  <default><joint solreflimit="0.03 0.8"/></default>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="0.3" limited="true" range="-0.1 2"/>
      <geom type="box" size="0.2 0.1 0.05" mass="1" contype="0" conaffinity="0"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.3" contype="{contype}"/>
        <site name="tip" pos="0 0 0.6"/>
      </body>
    </body>
    <geom type="plane" pos="0 0 -0.3" size="2 2 1" contype="{contype}"/>
  </worldbody>
  <actuator><motor name="push" joint="slide" gear="5"/></actuator>
</mujoco>
"""
UNTIL = 0.5  # [s] the cart meets its limit at 0.3 s
RECORD = ControlRecord(np.array([0.0, 0.1, 0.2]), np.array([[-1.0], [0.5], [-0.8]]))
# Rounding grows as the pole falls from the vertical, as exp(t sqrt(3 g / 2 l)).
GROWTH = np.exp(UNTIL * np.sqrt(1.5 * 9.81 / 0.6))


@dataclass(frozen=True)
class Case:
    """An engine with its number formats by name, and options of files that it has not."""

    roundoffs: Mapping[str, float]
    integrators: Mapping[str, str]
    """Number format with each integrator; more of both would be compiled for minutes."""
    refused: Mapping[str, str]
    """Options or flags of a file, with the word by which they are refused."""


CASES = {
    "mjx": Case(
        {"single": 2.0**-24, "double": 2.0**-53},
        {"Euler": "single", "RK4": "double"},
        {
            'integrator="implicit"': "mjINT_IMPLICIT",
            'solver="PGS"': "mjSOL_PGS",
            'noslip_iterations="3"': "noslip_iterations",
            'actuatorgroupdisable="0"': "disableactuator",
            '<flag sleep="enable"/>': "sleep",
            '<flag energy="enable"/>': "mjENBL_ENERGY",
        },
    ),
    "mujoco_warp": Case(
        {"single": 2.0**-24},
        {"Euler": "single", "implicitfast": "single", "RK4": "single"},
        {
            'solver="PGS"': "mjSOL_PGS",
            'actuatorgroupdisable="0"': "disableactuator",
            '<flag fwdinv="enable"/>': "mjENBL_FWDINV",
        },
    ),
}
ENGINES = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name not in tb.engines() or not tb.engines()[name].installed,
            reason=f"{name} is not installed here",
        ),
    )
    for name in CASES
]
each_engine = pytest.mark.parametrize("name", ENGINES)


def _read(options: str = "", flags: str = "", contype: int = 0, **start: Any) -> tb.Mechanism:
    text = CART_POLE.format(options=options, flags=flags, contype=contype)
    start = {"qpos": [0.0, 0.3], "qvel": [0.0, 0.1], "ctrl": RECORD} | start
    return tb.from_mjcf(text, **start)


def _moved(
    name: str, mechanism: tb.Mechanism, duration: float = UNTIL, **options: Any
) -> Trajectory:
    problem = tb.Problem(mechanism, duration=duration, stop_law=tb.StopLaw.UNILATERAL)
    return tb.engine(name, GIVEN, **options).simulate(problem)


def _apart(one: Trajectory, other: Trajectory) -> tuple[float, float]:
    """Greatest difference of coordinates, and what rounding to a part of 1 makes of it.

    A step rounds coordinates, and speeds that stand for UNTIL of way: at random, so that n steps
    are sqrt(n) times as far off, and grow with the motion.
    """
    size = np.abs(other.q).max() + UNTIL * np.abs(other.u).max()
    return float(np.abs(one.q - other.q).max()), float(np.sqrt(len(one.t)) * size * GROWTH)


@each_engine
def test_a_file_is_moved_with_its_own_options(name: str) -> None:
    case, moved = CASES[name], dict[str, Trajectory]()
    for integrator, precision in case.integrators.items():
        mechanism = _read(f'integrator="{integrator}"')
        moved[integrator] = right = _moved("mujoco", mechanism)
        found = _moved(name, mechanism, precision=precision)
        assert found.provenance.settings == {
            "timestep": 0.002,
            "integrator": integrator,
            "explicit_damping": False,
            "stiff": False,
            "precision": precision,
        }
        assert found.provenance.engine == name
        difference, rounding = _apart(found, right)
        assert difference < case.roundoffs[precision] * rounding, integrator
        total = right.kinetic_energy + right.potential_energy
        apart = np.abs(found.kinetic_energy + found.potential_energy - total).max()
        # Energies of 10 J, in proportion to speeds that are as far off as coordinates per UNTIL
        assert apart < 20.0 * case.roundoffs[precision] * rounding / UNTIL
        slide = found.q[:, mechanism.coordinates.index("slide")]
        # A slide's number is the file's own.
        assert np.array_equal(slide.astype(np.float32), slide) == (precision == "single")
        assert slide.min() < -0.1  # its limit is met, and gives way
        # At another step, with what is compiled by now.
        fine = _moved("mujoco", mechanism, timestep=1e-3)
        difference, rounding = _apart(
            _moved(name, mechanism, precision=precision, timestep=1e-3), fine
        )
        assert difference < case.roundoffs[precision] * rounding, integrator
        # Stiff limits multiply the rounding of places: a hundredth of what they change is asked.
        option = {"timestep": 1e-3, "stiff": True}
        stiff = _moved("mujoco", mechanism, **option)
        difference, _ = _apart(_moved(name, mechanism, precision=precision, **option), stiff)
        assert difference < 0.01 * _apart(stiff, fine)[0], integrator
    # Of another integrator it would not be.
    difference, rounding = _apart(moved["Euler"], moved["RK4"])
    assert difference > 2.0**-24 * rounding


@each_engine
def test_a_contact_ends_what_can_be_compared(name: str) -> None:
    mechanism, times = _read(contype=1), list[float]()
    for engine in (name, "mujoco"):
        with pytest.raises(tb.SimulationError, match="a contact acts") as raised:
            _moved(engine, mechanism, 1.0)
        times.append(float(re.findall(r"from ([\d.]+) s on", str(raised.value))[0]))
    assert times[0] == pytest.approx(times[1], abs=0.0021)  # a step, by rounding
    assert 0.1 < times[0] < 1.0
    _moved(name, mechanism, times[0] - 0.0021)


@each_engine
def test_options_that_it_has_not_are_refused_by_name(name: str) -> None:
    for option, word in CASES[name].refused.items():
        flag = option.startswith("<")
        mechanism = _read("" if flag else option, option if flag else "", ctrl=[0.0])
        # Of what it refuses MuJoCo itself moves all.
        assert len(_moved("mujoco", mechanism, 0.02).t) == 11
        with pytest.raises(tb.UnsupportedProblemError, match=word) as raised:
            _moved(name, mechanism, 0.02)
        assert name in str(raised.value) and "\n" not in str(raised.value)
    with pytest.raises(tb.InputError, match=r"integrator = 'leapfrog'.*Euler, implicitfast, RK4"):
        _moved(name, _read(), integrator="leapfrog")
    with pytest.raises(tb.UnsupportedProblemError, match="was read from none"):
        _moved(name, tb.fixed())


@each_engine
def test_its_causes_are_those_of_a_file(name: str) -> None:
    mechanism = _read()
    made = tb.engine(name, GIVEN, timestep=0.002, integrator="Euler")
    causes = {cause.name for cause in causes_of(made, mechanism)}
    assert causes >= {"integrator", "implicit damping", "constraint softness", "time step"}
    assert ("precision" in causes) == (len(CASES[name].roundoffs) > 1)


@each_engine
def test_it_is_compared_like_any_engine(name: str) -> None:
    found = tb.compare(
        _read(), name, [GIVEN], until=UNTIL, isolate=False, diagnose=False, timeout=600.0
    )
    (row,) = found.results.runs
    assert row.settings["timestep"] == 0.002 and row.settings["precision"] == "single"
    assert row.outcome in ("agrees", "disagrees")  # of first order, in steps of 2 ms
