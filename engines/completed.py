"""Engines of plug-ins that tell no more than they must, completed by what everything else asks for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from pydantic import JsonValue
from pydantic_core import to_jsonable_python

from ..models.features import Basic, Feature, refuse_features
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..models.spec import Spec
from ..models.trajectory import Trajectory
from .inspection import Inspectable, Inspection, State
from .protocol import Capabilities, Simulator, refuse_no_problem
from .supplied import Supplied


def able(engine: Simulator) -> Capabilities:
    """What an engine declares, less what its options take away."""
    return engine.capabilities.without(getattr(engine, "lacking", ()))


@dataclass(frozen=True)
class CompletedEngine:
    """A plug-in's engine that does not tell its preset, its settings or its time step, completed by the registry."""

    simulator: Simulator
    preset: str
    settings: dict[str, JsonValue]
    timestep: float | None

    @property
    def name(self) -> str:
        """Of the plug-in's engine."""
        return self.simulator.name

    @property
    def capabilities(self) -> Capabilities:
        """Of the plug-in's engine."""
        return self.simulator.capabilities

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Of the plug-in's engine, if it tells."""
        return getattr(self.simulator, "lacking", frozenset())

    @property
    def supplied(self) -> Supplied | None:
        """Of the plug-in's engine, if it tells; else None."""
        return getattr(self.simulator, "supplied", None)

    def simulate(self, problem: Problem) -> Trajectory:
        """As the plug-in's engine does."""
        refuse_no_problem(problem)
        left = able(self)
        refuse_features(
            problem.mechanism,
            left.features,
            self.name,
            left.lacking,
            problem.stop_law,
            left.elements,
        )
        return self.simulator.simulate(problem)


@dataclass(frozen=True)
class CompletedInspectable(CompletedEngine):
    """The same for an engine that shows its built model."""

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """As the plug-in's engine does."""
        return cast("Inspectable", self.simulator).inspect(mechanism, states)


def completed(simulator: Simulator, preset: str, options: Mapping[str, Any]) -> CompletedEngine:
    """An engine with its preset, its settings and its time step.

    Args:
        simulator: as the plug-in makes it.
        preset: that it was made from.
        options: that it was given.
    """
    settings = _settings_of(simulator, options)
    step = getattr(simulator, "timestep", settings.get("timestep"))
    cls = CompletedInspectable if isinstance(simulator, Inspectable) else CompletedEngine
    return cls(simulator, preset, settings, float(step) if isinstance(step, int | float) else None)


def _settings_of(simulator: Simulator, options: Mapping[str, Any]) -> dict[str, JsonValue]:
    """The fields of a Spec or a dataclass; of anything else, the options that it was given."""
    if isinstance(simulator, Spec):
        return simulator.model_dump(mode="json", exclude={"preset"})
    if dataclasses.is_dataclass(simulator):
        options = {
            field.name: getattr(simulator, field.name)
            for field in dataclasses.fields(simulator)
            if field.init
        }
    return {
        name: to_jsonable_python(value, fallback=repr)
        for name, value in options.items()
        if name != "preset"
    }
