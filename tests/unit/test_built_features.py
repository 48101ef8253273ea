"""Features and dimensions follow from tables: no engine claims what it does not build."""

from __future__ import annotations

import importlib
from typing import Any

import pytest
import trebucheck as tb
from pydantic import Field
from trebucheck.engines.protocol import built_features
from trebucheck.engines.units import Units, dimension, dimensions_of
from trebucheck.models.elements import (
    COUPLERS,
    ELEMENTS,
    FORCE_ELEMENTS,
    ElementTable,
    Feature,
    FreeJoint,
)
from trebucheck.reference.certification import redundant

# Fields of elements that are names, choices, or numbers without dimension.
PLAIN = {
    *("name", "kind", "body", "relative_to", "parent", "child", "coordinate", "coordinates"),
    *("axis", "normal", "angle", "rest_angle", "limit", "sense", "closed", "restitution"),
}


def test_every_feature_is_built_by_a_class_of_elements() -> None:
    assert built_features(ELEMENTS) == frozenset(Feature)


def test_a_class_that_is_not_built_is_not_claimed() -> None:
    without = [element for element in ELEMENTS if element is not FreeJoint]
    assert frozenset(Feature) - built_features(without) == {Feature.FREE_JOINT}
    without = [element for element in ELEMENTS if element not in FORCE_ELEMENTS]
    assert Feature.SPRING not in built_features(without)


@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
def test_built_in_engines_claim_the_features_of_what_they_build(name: str) -> None:
    capabilities = tb.engines()[name].capabilities
    assert capabilities.features == built_features(capabilities.elements)


def test_the_reference_claims_what_both_of_its_formulations_have() -> None:
    claimed = tb.engines()["reference"].capabilities.elements
    assert claimed == redundant.BUILT == frozenset(ELEMENTS)


# Units of a coupler follow from its coordinates.
@pytest.mark.parametrize("element", [each for each in ELEMENTS if each not in COUPLERS])
def test_every_field_has_a_dimension_or_is_known_to_have_none(element: Any) -> None:
    assert set(element.model_fields) - PLAIN == set(dimensions_of(element))


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("m", (1, 0, 0)),
        ("kg m^2", (2, 1, 0)),
        ("N/m", (0, 1, -2)),
        ("N s/m", (0, 1, -1)),
        ("N m/rad^3", (2, 1, -2)),
        ("rad", (0, 0, 0)),
        ("", (0, 0, 0)),
    ],
)
def test_dimensions_follow_from_units(unit: str, powers: tuple[int, int, int]) -> None:
    assert dimension(unit) == powers


def test_a_number_of_a_force_element_without_a_unit_cannot_be_defined() -> None:
    with pytest.raises(TypeError, match=r"Coil.*quintic"):

        class Coil(tb.CubicTorsionSpring):
            quintic: float = Field(default=1.0, description="k5")


def test_an_unknown_element_has_no_units() -> None:
    class Rubber(tb.PinJoint):
        pass

    mechanism = tb.model("pendulum")
    (pin,) = mechanism.joints
    rubber = Rubber(**pin.model_dump() | {"name": "odd one"})
    mechanism = mechanism.model_copy(update={"joints": (rubber,)})
    with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
        Units(2.0, 2.0, 2.0).mechanism(mechanism)


@pytest.mark.parametrize("name", ["exudyn", "pymunk"])
def test_classes_that_an_engine_claims_are_those_of_its_builders(name: str) -> None:
    pytest.importorskip(name)
    build = importlib.import_module(f"trebucheck.engines.{name}.build")
    handled = set[type]()
    for table in vars(build).values():
        if isinstance(table, ElementTable):
            handled |= table.handlers.keys()
    assert handled == tb.engines()[name].capabilities.elements
