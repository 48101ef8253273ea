"""Forces of joints and their signs, of each plug-in that is installed and tells them.

By the closed forms of a hanging and of a swinging rod. A uniform rod of mass m and length l that is
let go in the horizontal and has fallen by the angle a is pulled by its pin with 5/2 m g sin a
towards the pin and with 1/4 m g cos a across, by the momentum theorem and the energy of the rod.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.presets import ASSISTED, SETTINGS
from trebucheck.engines.protocol import BuiltinEngine

_MASS, _LENGTH, _GRAVITY = 2.0, 1.5, 9.81
_WEIGHT = _MASS * _GRAVITY
_STEP = 2e-3  # [s] and half of it
_UNTIL = 0.6  # [s] the rod has then turned by a little more than a quarter turn
_FASTEST = np.sqrt(3 * _GRAVITY / _LENGTH) * _LENGTH  # [m/s] of the tip, as it hangs


@cache
def _engines() -> tuple[str, ...]:
    """The plug-ins that are installed here."""
    found = {each.name for each in entry_points(group="trebucheck.engines")}
    return tuple(sorted(found.intersection(tb.engines())))


def _engine(name: str, preset: str, step: float) -> BuiltinEngine:
    made = tb.engine(name, preset, timestep=step)
    assert isinstance(made, BuiltinEngine)
    if not made.capabilities.joint_reactions:
        pytest.skip(f"{name} tells no forces of joints")
    return made


def _rod(start: float) -> tb.Problem:
    """A rod at a clockwise angle from the horizontal [rad], at rest."""
    rod = tb.Body(
        name="rod",
        angle="a",
        mass=_MASS,
        centre=(_LENGTH / 2, 0.0),
        inertia=_MASS * _LENGTH**2 / 12,
    )
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0.0, 0.0), child_point=(0.0, 0.0)
    )
    made = tb.Mechanism(
        name="rod",
        bodies=(rod,),
        joints=(pin,),
        stops=(),
        gravity=_GRAVITY,
        start=(start,),
        start_speeds=(0.0,),
        markers=(tb.Marker(name="tip", body="rod", point=(_LENGTH, 0.0)),),
    )
    return tb.Problem(made, duration=_UNTIL)


def _rounding(engine: BuiltinEngine, step: float) -> float:
    """Rounding of a force that is made of a step's change of speed [N].

    A hundred times the last digit of the greatest speed: a solver adds as many numbers.
    """
    single = engine.study().single_precision
    digit = np.finfo(np.float32 if single and single(engine.settings) else np.float64).eps
    return 100 * float(digit) * _FASTEST * _MASS / step


@pytest.mark.parametrize("preset", [SETTINGS, ASSISTED])
@pytest.mark.parametrize("name", _engines())
def test_a_hanging_rod_is_pulled_upwards_by_its_weight(name: str, preset: str) -> None:
    engine = _engine(name, preset, _STEP)
    force = engine.simulate(_rod(np.pi / 2)).joint_reactions["pin"]
    assert np.abs(force[-1] - [0.0, _WEIGHT]).max() <= _rounding(engine, _STEP)


@pytest.mark.parametrize("preset", [SETTINGS, ASSISTED])
@pytest.mark.parametrize("name", _engines())
def test_the_force_on_a_swinging_rod_is_that_of_the_closed_form(name: str, preset: str) -> None:
    errors: list[float] = []
    for step in (_STEP, _STEP / 2):
        found = _engine(name, preset, step).simulate(_rod(0.0))
        angle = found.q[:, 0]
        towards, across = 2.5 * _WEIGHT * np.sin(angle), 0.25 * _WEIGHT * np.cos(angle)
        right = np.stack(
            [
                -towards * np.cos(angle) + across * np.sin(angle),
                towards * np.sin(angle) + across * np.cos(angle),
            ],
            axis=1,
        )
        errors.append(float(np.abs(found.joint_reactions["pin"] - right).max()))
    engine = _engine(name, preset, _STEP / 2)
    order = engine.study().step_orders[preset].order
    assert errors[0] < 0.1 * _WEIGHT  # a sign that is wrong makes twice a force
    least = _rounding(engine, _STEP / 2)
    assert errors[1] <= max(least, errors[0] / 2 ** ((order or 0.5) - 0.5))
