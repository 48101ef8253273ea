"""Exudyn and pymunk declare exactly the classes of elements that their builders handle."""

from __future__ import annotations

import importlib

import pytest
import trebucheck as tb
from trebucheck.models.elements import CubicTorsionSpring, RotationalSpringDamper
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.mechanism import Mechanism

TABLES = {
    "exudyn": ("BUILDERS",),
    "pymunk": ("TREE_JOINT_BUILDERS", "STOP_BUILDERS", "COUPLER_BUILDERS", "FORCE_BUILDERS"),
}


class UnknownSpring(RotationalSpringDamper):
    """A force element that no engine knows."""


@pytest.mark.parametrize("engine", sorted(TABLES))
def test_declared_classes_are_those_with_a_builder(engine: str) -> None:
    pytest.importorskip(engine)
    module = importlib.import_module(f"trebucheck.engines.{engine}.build")
    handled = {c for name in TABLES[engine] for c in getattr(module, name).handlers}
    assert handled == tb.engine(engine).capabilities.elements


@pytest.mark.parametrize("engine", sorted(TABLES))
def test_a_class_without_a_builder_is_refused_by_name(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(engine)
    module = importlib.import_module(f"trebucheck.engines.{engine}.build")
    pendulum = tb.model("pendulum")
    spring = CubicTorsionSpring(name="duffing", body=pendulum.bodies[0].name, cubic_stiffness=1.0)
    mechanism = pendulum.model_copy(update={"force_elements": (spring,)})
    _build(engine, mechanism)
    handlers = getattr(module, TABLES[engine][-1]).handlers
    monkeypatch.delitem(handlers, CubicTorsionSpring)
    with pytest.raises(UnsupportedProblemError, match="'duffing'"):
        _build(engine, mechanism)


@pytest.mark.parametrize("engine", sorted(TABLES))
def test_a_subclass_is_not_taken_for_its_base(engine: str) -> None:
    pytest.importorskip(engine)
    pendulum = tb.model("pendulum")
    spring = UnknownSpring(name="odd", body=pendulum.bodies[0].name, stiffness=1.0)
    with pytest.raises(UnsupportedProblemError, match="'odd'"):
        _build(engine, pendulum.model_copy(update={"force_elements": (spring,)}))


def _build(engine: str, mechanism: Mechanism) -> None:
    module = importlib.import_module(f"trebucheck.engines.{engine}.build")
    module.build(mechanism, *(((), 0.0, 1e4) if engine == "pymunk" else ()))
