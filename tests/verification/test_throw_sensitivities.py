"""Derivatives of any mechanism's throw by all its physical numbers, against differences of the
throws themselves.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import again
from directions import stepped
from mechanisms import parallel_cranks
from trebucheck.models.elements import RotationalSpringDamper, SpringDamper
from trebucheck.models.library.registry import benchmark, model
from trebucheck.models.mechanism import Marker, Mechanism
from trebucheck.reference.sensitivity.release import _landing, physical_numbers, sensitivities_of
from trebucheck.reference.throw.throw import Performance, Sensitivity, perform

STEP = 1e-3
SOLVER = 1e-11  # of a figure: what the solver may err by
RELEASES = {"release_angle": None, "release_time": None, "sling_angle": None}


def performed(mechanism: Mechanism, release: dict[str, float], height: float = 0.0) -> Performance:
    return perform(mechanism, RELEASES | release, height=height)


def figures(performance: Performance) -> np.ndarray:
    release = performance.flight.release
    return np.array([release.time, release.speed, release.angle, performance.throw.flight.range])


def derivatives(each: Sensitivity) -> list[float]:
    assert each.range is not None
    return [each.launch_time, each.launch_speed, each.launch_angle, each.range]


def sprung_catapult() -> Mechanism:
    ends = {"point": (2.0, 0.1), "relative_point": (1.0, -5.0)}
    elements = (
        SpringDamper(name="strut", body="arm", **ends, stiffness=3e3, damping=50, rest_length=2),
        RotationalSpringDamper(
            name="coil spring", body="arm", stiffness=2e3, damping=50, rest_angle=0.3
        ),
    )
    return model("catapult").model_copy(update={"force_elements": elements})


def with_projectile(mechanism: Mechanism) -> Mechanism:
    thrown = Marker(name="projectile", body=mechanism.bodies[-1].name, point=(0.3, 0.1))
    return mechanism.model_copy(update={"markers": (*mechanism.markers, thrown)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mechanism", "release"),
    [
        (model("hinged"), {}),
        # A track out of the upright would carry, and ranges would be measured from it.
        pytest.param(model("floating-arm"), {"sling_angle": math.radians(-7)}, marks=again),
        (sprung_catapult(), {"release_angle": 0.6}),
        (model("catapult"), {"release_time": 1.9}),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_all_numbers_against_differences(mechanism: Mechanism, release: dict[str, float]) -> None:
    """Along one random direction of all numbers but start speeds, which a closed rest takes in
    part.
    """
    performance = performed(mechanism, release)
    found, sentences = sensitivities_of(performance)
    assert not sentences
    known = {
        number.name: number.direction for number in physical_numbers(mechanism, "projectile")[0]
    }
    assert sorted(known) == sorted(each.name for each in found)
    random, direction, exact = np.random.default_rng(1), dict[str, float](), np.zeros(4)
    for each in found:
        part = float(random.uniform(-1, 1)) * max(0.01, abs(each.value) / 10)
        if each.name.startswith(("inertia", "restitution")) and not each.value:
            continue
        if each.name.startswith("start speed") or each.name == "direction of drop":
            continue
        exact += part * np.array(derivatives(each))
        for name, slope in known[each.name].items():
            direction[name] = direction.get(name, 0.0) + part * slope
    active = performance.solution.segments[0].closed

    def at(step: float) -> np.ndarray:
        return figures(performed(stepped(mechanism, direction, step, active), release))

    first, second, third = ((at(k * STEP) - at(-k * STEP)) / (2 * k * STEP) for k in (1, 2, 4))
    fine, coarse = (4 * first - second) / 3, (4 * second - third) / 3
    expected = (16 * fine - coarse) / 15  # Richardson: O(step^6)
    own = np.abs(expected - fine) + SOLVER / STEP * np.maximum(1.0, np.abs(figures(performance)))
    assert np.abs(expected[1:]).max() > 1e3 * own.max()
    assert (np.abs(exact - expected) <= own).all(), (exact, expected, own)


def test_numbers_have_names_and_units_and_stand_in_order_of_their_effect() -> None:
    found, _ = sensitivities_of(performed(sprung_catapult(), {}))
    units = {each.name: each.unit for each in found}
    assert units["stiffness of strut spring"] == "N/m"
    assert units["stiffness of coil spring"] == "N m/rad"
    assert units["place of strut spring on ground, y"] == "m"
    assert units["mass of arm"] == "kg"
    effects = [abs((each.range or 0.0) * each.value) for each in found]
    assert effects == sorted(effects, reverse=True)


def test_a_singular_position_is_a_sentence() -> None:
    found, sentences = sensitivities_of(
        performed(
            with_projectile(benchmark("n-four-bar").problem().mechanism),
            {"release_time": 0.9},
            height=-30.0,
        )
    )
    assert found == ()
    assert "passes a singular position at t = 0.7" in sentences[0]


def test_numbers_that_would_tear_redundant_loops_are_sentences() -> None:
    found, sentences = sensitivities_of(
        performed(with_projectile(parallel_cranks(3)), {"release_time": 0.4}, height=-30.0)
    )
    assert "mass of beam" in {each.name for each in found}
    assert any(
        "place of head 1 on" in sentence and "lock the mechanism" in sentence
        for sentence in sentences
    )


def _landed(values: np.ndarray) -> float:
    """Landing place of a parabola from x, y, vx, vy, g on the level -1 m, by the school formula."""
    x, y, vx, vy, g = values
    return float(x + vx * (vy + math.sqrt(vy * vy + 2 * g * (y + 1.0))) / g)


@pytest.mark.parametrize(
    "values",
    [(0.3, 4.0, 7.0, 5.0, 9.81), (-2.0, 0.5, -3.0, -4.0, 1.0), (1.0, -0.99, 2.0, 0.3, 1.62)],
)
def test_landing_and_its_derivatives(values: tuple[float, ...]) -> None:
    numbers, step = np.array(values), 1e-6
    point: Any = SimpleNamespace(position=numbers[:2], velocity=numbers[2:4])
    along = np.random.default_rng(3).normal(size=(4, 5))
    parts = along[:, :2], along[:, 2:4], float(numbers[4]), along[:, 4]
    landing, slopes = _landing(point, *parts, -1.0)
    assert landing == pytest.approx(_landed(numbers), rel=1e-14)
    differences = [(_landed(numbers + step * d) - _landed(numbers - step * d)) / (2 * step)
                   for d in along]  # fmt: skip
    assert slopes == pytest.approx(differences, rel=1e-7)


def test_what_never_comes_down_to_the_ground_has_no_landing() -> None:
    along, none = np.ones((2, 2)), np.zeros(2)
    for height, gravity in ((-3.0, 9.81), (2.0, 0.0)):
        point: Any = SimpleNamespace(position=(0.0, height), velocity=(1.0, 2.0))
        landing, slopes = _landing(point, along, along, gravity, none, 0.0)
        assert math.isnan(landing) and np.isnan(slopes).all()
