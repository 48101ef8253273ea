"""Worlds of plug-ins that are read back: what was built is the mechanism, and a fault is found.

An engine has an environment of its own: where it is not installed, its cases are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.presets import PRESETS
from trebucheck.models.library.registry import benchmark

SLIDES = ("slider-crank", "chain", "thrown-plate", "incline", "bead")
SPRINGS = ("slider-crank", "chain", "thrown-plate", "spring-pendulum")
PINS = ("n-four-bar", "chain", "thrown-plate", "welded-rods", "pendulum")
CASES: Mapping[str, tuple[str, ...]] = {
    "box2d": SPRINGS,
    "pyb2d3": (*SPRINGS, "bead"),
    "planck": SLIDES,
    "rapier": SLIDES,
    "jolt": SLIDES,
    "havok": ("slider-crank", "chain", "bead"),
    "physx": SLIDES,
    "p2": ("slider-crank", "thrown-plate", "incline", "bead"),
    "cannon": ("n-four-bar", "thrown-plate", "welded-rods"),
    "matter": PINS,
    "ovphysx": ("chain", "welded-rods", "incline", "bead", "thrown-plate"),
}
SEEN: Mapping[str, float] = {"havok": 0.1}
"""Part of a mass, or of a metre, that is seen. Havok's masses have eight bits: a tenth of one of
five is a fiftieth of all, beyond the 2^-7 of their rounding."""


@pytest.mark.parametrize("fault", ["mass", "anchor"])
@pytest.mark.parametrize(("name", "problem"), [(n, each) for n in CASES for each in CASES[n]])
def test_the_world_is_read_back_and_a_fault_in_it_is_found(
    name: str, problem: str, fault: str
) -> None:
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed here")
    engine, mechanism = tb.engine(name), benchmark(problem).problem().mechanism
    checked = check_model(engine, mechanism)
    assert checked.exposed and checked.holds, checked
    seen = SEEN.get(name, 1e-3)
    first, last = mechanism.bodies[0], mechanism.joints[-1]
    heavy = first.model_copy(update={"mass": (1 + seen) * first.mass})
    x, y = last.child_point
    aside = last.model_copy(update={"child_point": (x + seen, y - seen)})
    changes = {
        "mass": {"bodies": (heavy, *mechanism.bodies[1:])},
        "anchor": {"joints": (*mechanism.joints[:-1], aside)},
    }
    wrong = mechanism.model_copy(update=changes[fault])
    other = SimpleNamespace(
        name=name,
        capabilities=engine.capabilities,
        inspect=lambda _, states: engine.inspect(wrong, states),  # type: ignore[attr-defined]
    )
    assert not check_model(other, mechanism).holds  # type: ignore[arg-type]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", CASES)
def test_a_point_mass_and_numbers_of_each_preset_are_read_back(name: str, preset: str) -> None:
    """A body without inertia, and single precision where a preset has it."""
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed here")
    checked = check_model(tb.engine(name, preset), benchmark("pendulum").problem().mechanism)
    assert checked.exposed and checked.holds, checked
