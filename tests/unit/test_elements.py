"""Nothing is ignored: an element that a consumer does not know is refused by its name."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything
from pydantic import Field
from trebucheck.comparisons.diagnosis.equivalence import check_model, random_states
from trebucheck.comparisons.report.drawing.sketch import draw
from trebucheck.models import kinematics
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.elements import (
    CONSUMERS,
    COUPLERS,
    ELEMENTS,
    FORCE_ELEMENTS,
    JOINTS,
    STOPS,
    ElementTable,
    Feature,
)
from trebucheck.models.elements.base import BaseForceElement, TorqueElement
from trebucheck.models.features import missing_elements, refuse_features
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

CORE = ("models", "reference", "engines", "comparisons", "conformance", "cli")


class Rocket(TorqueElement):
    """A motor of a class that nobody knows, with a feature that every engine declares."""

    feature: ClassVar[Feature] = Feature.TORQUE
    kind: Literal["rocket"] = "rocket"
    torque: float = Field(default=1.0, description="[N m]")

    def torque_on_body(self, angle: Any, q: Any, u: Any) -> Any:
        return self.torque + np.zeros(q.shape[:-1])


class Rubber(tb.PinJoint):
    """A joint of a class that nobody knows."""


class Sponge(tb.Stop):
    """A stop of a class that nobody knows."""


def machine(**changes: Any) -> tb.Mechanism:
    """A rod on a pin with a stop and a spring; its elements may be replaced without validation."""
    pin = tb.PinJoint(
        name="odd one", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    known = tb.Mechanism(
        name="rod",
        bodies=(tb.Body(name="rod", angle="q", mass=2.0, centre=(0.5, 0), inertia=0.2),),
        joints=(pin if "joints" not in changes else pin.model_copy(update={"name": "pin"}),),
        stops=(),
        gravity=9.81,
        start=(0.3,),
    )
    return known.model_copy(update=changes)


def with_rocket() -> tb.Mechanism:
    """With an unknown force element."""
    return machine(force_elements=(Rocket(name="odd one", body="rod"),))


def with_rubber() -> tb.Mechanism:
    """With an unknown joint."""
    rubber = Rubber(
        name="odd one", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    return machine(joints=(rubber,))


def with_sponge() -> tb.Mechanism:
    """With an unknown stop."""
    return machine(
        stops=(Sponge(name="odd one", body="rod", sense=1, limit=-1.0, closed=False),),
    )


def import_everything() -> None:
    """Import every module of the core, so that every table is made."""
    for room in CORE:
        package = importlib.import_module(f"trebucheck.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)


USES: dict[str, Callable[[tb.Mechanism], object]] = {
    "reference": lambda m: solve(tb.Problem(m, duration=0.1)),
    "equations": Equations,
    "kinematics": Kinematics,
    "applied forces": lambda m: AppliedForces(Kinematics(m)),
    "second formulation": RedundantSystem,
    "MJCF writer": mjcf,
    "drawing": draw,
    "states of the model check": random_states,
    "model check": lambda m: check_model(tb.engine("reference"), m),
}
UNKNOWN = {"force element": with_rocket, "joint": with_rubber, "stop": with_sponge}


@pytest.mark.parametrize("element", UNKNOWN)
@pytest.mark.parametrize("use", sorted(USES))
def test_an_unknown_element_is_refused_by_name(use: str, element: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
        USES[use](UNKNOWN[element]())


@pytest.mark.parametrize("element", UNKNOWN)
@pytest.mark.parametrize("engine", ["reference", "mujoco", "pymunk", "exudyn"])
def test_every_engine_refuses_an_unknown_element_by_name(engine: str, element: str) -> None:
    simulator = tb.engine(engine)
    with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
        simulator.simulate(tb.Problem(UNKNOWN[element](), duration=0.1))


@pytest.mark.filterwarnings("ignore:Pydantic serializer warnings")
@pytest.mark.parametrize("engine", ["reference", "mujoco"])
@pytest.mark.parametrize("element", UNKNOWN)
def test_a_check_of_an_unknown_element_never_agrees(element: str, engine: str) -> None:
    with pytest.raises((tb.TrebucheckError, AssertionError), match="odd one"):
        tb.check(engine, UNKNOWN[element](), duration=0.1, isolate=False)


def test_the_known_machine_is_served() -> None:
    """So that the refusals above are of the element and of nothing else."""
    known = machine(
        force_elements=(tb.ConstantTorque(name="odd one", body="rod", torque=1.0),),
        stops=(tb.Stop(name="stop", body="rod", sense=1, limit=-1.0, closed=False),),
    )
    for use in sorted(USES):
        USES[use](known)


def test_every_consumer_states_what_it_does_with_every_element() -> None:
    """Lists the lines that are missing when an element is added to the table of elements."""
    import_everything()
    assert len(CONSUMERS) > 3
    missing = {
        f"{table.consumer} ({len(table.group)} classes)": [c.__name__ for c in table.missing()]
        for table in CONSUMERS
        if table.missing()
    }
    assert not missing


def test_tables_are_over_the_groups_of_elements() -> None:
    import_everything()
    for table in CONSUMERS:
        stated = table.handlers.keys() | table.refused.keys()
        groups = (JOINTS, STOPS, FORCE_ELEMENTS, COUPLERS, ELEMENTS)
        assert table.group in groups, table.consumer
        assert stated <= set(table.group), table.consumer


def test_every_table_refuses_an_unknown_element_by_name() -> None:
    import_everything()
    rocket = Rocket(name="odd one", body="rod")
    assert CONSUMERS
    for table in CONSUMERS:
        with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
            table[rocket]


@pytest.mark.parametrize("use", ["MJCF writer", "second formulation"])
def test_an_element_in_the_table_alone_is_refused(
    use: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Consumers with a table of their own refuse what is in the table of elements alone."""
    monkeypatch.setattr(kinematics, "ELEMENTS", (*ELEMENTS, Rocket))
    with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
        USES[use](with_rocket())


def test_an_element_in_the_table_alone_is_served_by_its_own_formulas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sums over elements take force, energy and power from the element: its file is enough."""
    monkeypatch.setattr(kinematics, "ELEMENTS", (*ELEMENTS, Rocket))
    applied = AppliedForces(Kinematics(with_rocket()))
    q = np.array([[0.3], [0.4]])
    assert applied.generalized(q, np.zeros_like(q)).tolist() == [[1.0], [1.0]]


@pytest.mark.parametrize("engine", ["reference", "mujoco", "pymunk", "exudyn"])
def test_an_element_in_the_table_alone_is_refused_by_every_engine(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kinematics, "ELEMENTS", (*ELEMENTS, Rocket))
    with pytest.raises(tb.UnsupportedProblemError, match="odd one"):
        tb.engine(engine).simulate(tb.Problem(with_rocket(), duration=0.1))


def test_a_table_tells_what_it_lacks() -> None:
    table: ElementTable[str] = ElementTable("a printer", STOPS, {tb.Stop: "stop"})
    try:
        assert table.missing() == (tb.PointStop,)
    finally:
        CONSUMERS.remove(table)  # type: ignore[arg-type]


def test_declared_features_do_not_claim_elements_of_later_releases() -> None:
    """Engines of plug-ins declare `frozenset(Feature)`: that must not claim a new element."""
    spring = tb.CubicTorsionSpring(name="cubic", body="rod", cubic_stiffness=1.0)
    mechanism = machine(force_elements=(spring,))
    with pytest.raises(tb.UnsupportedProblemError, match="cubic"):
        refuse_features(mechanism, frozenset(Feature), "an engine")
    refuse_features(mechanism, frozenset(Feature), "an engine", classes=ELEMENTS)
    (names,) = missing_elements(mechanism, set(Feature) - {Feature.CUBIC_SPRING}).values()
    assert names == ("cubic",)


def test_an_element_that_lacks_a_feature_is_not_missing_once_more_by_its_class() -> None:
    """A wall on a moving body has a feature of walls and one of moving walls."""
    mechanism, walls = everything(), [kind for kind in ELEMENTS if kind is not tb.PointStop]
    known = set(Feature) - {Feature.MOVING_WALL}
    assert missing_elements(mechanism, known, classes=walls) == {Feature.MOVING_WALL: ("deck",)}
    (names,) = missing_elements(mechanism, set(Feature), classes=walls).values()
    assert names == ("deck",)
    by_class = missing_elements(mechanism, set(Feature), classes=()).values()
    found = sorted(name for names in by_class for name in names)
    assert found == sorted(element.name for element in mechanism.elements)


def test_a_force_element_that_no_sum_would_have_cannot_be_defined() -> None:
    with pytest.raises(TypeError, match="Crooked acts along none"):

        class Crooked(BaseForceElement):
            feature = Feature.FORCE
            acts_along = "surface"
            kind: Literal["crooked"] = "crooked"


def test_a_force_element_without_a_feature_cannot_be_defined() -> None:
    with pytest.raises(TypeError, match="Nameless"):

        class Nameless(BaseForceElement):
            kind: Literal["nameless"] = "nameless"


def test_every_class_of_elements_has_a_feature_that_can_be_refused() -> None:
    features = [element.feature for element in FORCE_ELEMENTS]  # type: ignore[attr-defined]
    assert len(set(features)) == len(FORCE_ELEMENTS)


@pytest.mark.parametrize("element", [*JOINTS, *FORCE_ELEMENTS])
def test_complaints_leave_out_the_kind_of_an_element(element: Any) -> None:
    group = "joints" if element in JOINTS else "force_elements"
    kind = element.model_fields["kind"].default
    with pytest.raises(tb.InputError) as error:
        tb.Mechanism(**machine().model_dump(mode="json") | {group: [{"kind": kind, "name": 7}]})
    assert f"{group}.0.name" in str(error.value)
    assert f".{kind}." not in str(error.value)
