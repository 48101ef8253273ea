"""Exudyn by itself: one call of its dynamic solver from start to end, and what its sensors stored.

A setting that is Exudyn's default is not set. :func:`script` gives the same run as a program that
needs Exudyn and NumPy alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from functools import reduce
from typing import Any

import numpy as np

from ...models.elements import GROUND
from ...models.errors import SimulationError
from ...models.problem import Problem
from .. import study
from ..events import whole_steps
from ..protocol import Recording
from .build import kind_of, silence
from .limits import build_with_limits, recording_with_limits
from .options import ExudynOptions
from .read import RelativePoint, SensorKey, System, exu, on_joint
from .solver import changed_settings, is_at, numerics


def run_alone(problem: Problem, options: ExudynOptions) -> Recording:
    """Run Exudyn from the start to a problem's end or just beyond, and read its sensors.

    Where it adapts its steps there is a sample at the end of each of them.

    Raises:
        SimulationError: Exudyn's solver gave up before the end.
        UnsupportedProblemError: the mechanism cannot be built.
    """
    settings = changed_settings(settings_of(problem, options))
    end = settings.timeIntegration.endTime
    with silence():
        system = build_with_limits(
            problem.mechanism, problem.stop_law, options.limit_period * options.timestep
        )
        columns = system.columns()
        try:
            finished = bool(system.main.SolveDynamic(settings))
        except RuntimeError:  # of Exudyn's own; its text is a page
            finished = False
        reached = float(system.main.systemData.GetTime())
    if not (finished and is_at(reached, end)):
        raise SimulationError(
            f"exudyn's {options.rule(problem.mechanism)} solver gave up after t = {reached:.6g} s "
            f"of {end:.6g} s; a shorter timestep may help."
        )
    table = system.stored()
    table[-1, 0] = end  # Exudyn adds up its steps
    return recording_with_limits(system, columns, table, len(table) - 1)


def settings_of(problem: Problem, options: ExudynOptions) -> dict[str, object]:
    """Those of Exudyn's settings by path that a run sets otherwise than Exudyn does."""
    steps = whole_steps(problem.duration, options.timestep)
    fields: dict[str, object] = {
        "timeIntegration.numberOfSteps": steps,
        "timeIntegration.endTime": steps * options.timestep,
    }
    # Constraints of loops may depend on each other; stops are none here.
    dependent = options.ignore_singular and bool(problem.mechanism.loop_joints)
    fields |= numerics(options, problem.mechanism, dependent=dependent)
    unchanged = exu.SimulationSettings()
    return {
        path: value
        for path, value in fields.items()
        if reduce(getattr, path.split("."), unchanged) != value
    }


# --- The run as a program


def script(problem: Problem, options: ExudynOptions) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    with silence():
        system = build_with_limits(
            problem.mechanism, problem.stop_law, options.limit_period * options.timestep
        )
    reader = _Reader(system)
    q, u = reader.coordinates(), reader.coordinates(speeds=True)
    built = [item for item in system.items if kind_of(item) != "Sensor"]
    settings = settings_of(problem, options)
    return study.filled_template(
        __name__,
        "alone.py.j2",
        classes=sorted({type(item).__name__ for item in (*built, *reader.sensors.values())}),
        items=_added(built),
        sensors=_added(reader.sensors.values()),
        settings={path: _text(value) for path, value in settings.items()},
        slides=bool(system.mechanism.slides),
        q=q,
        u=u,
    )


def _added(items: Iterable[Any]) -> list[str]:
    """Statements that add items, each with its number among those of its kind."""
    numbers, statements = Counter[str](), list[str]()
    for item in items:
        kind, default = kind_of(item), vars(type(item)())
        fields = {name: _text(value) for name, value in vars(item).items()}
        changed = [
            f"{name}={text}" for name, text in fields.items() if text != _text(default[name])
        ]
        statement = f"mbs.Add{kind}({type(item).__name__}({', '.join(changed)}))"
        statements.append(f"{statement}  # {kind.lower()} {numbers[kind]}")
        numbers[kind] += 1
    return statements


def _text(value: Any) -> str:
    """A value as Python's text."""
    if isinstance(value, np.ndarray | np.generic):
        return repr(value.tolist())
    if isinstance(value, exu.Vector3DList):
        rows = [row.tolist() for row in value.GetPythonObject()]
        return f"exu.Vector3DList({rows!r})"
    # One of Exudyn's enumerations.
    return f"exu.{value}" if type(value).__module__.startswith("exudyn") else repr(value)


class _Reader:
    """Writes coordinates and speeds as :func:`.read.coordinates` reads them, and notes sensors."""

    def __init__(self, system: System) -> None:
        self.system, self.mechanism = system, system.mechanism
        self.sensors: dict[SensorKey, Any] = {}
        """Those that are read, in the order of their numbers in the program."""

    def coordinates(self, *, speeds: bool = False) -> list[str]:
        """A column for each coordinate, or speed."""
        turning = [body.name for body in self.mechanism.bodies if body.angle is not None]
        quantity = "Coordinates_t" if speeds else "CoordinatesTotal"
        columns = [f"-{self._rotation(name, quantity)}" for name in turning]
        for slide in self.mechanism.slides:
            motion = self._slide(on_joint(slide.joint), speeds=speeds)
            columns.append(f"({motion} * {slide.direction.conjugate()!r}).real")
        return columns

    def _slide(self, point: RelativePoint, *, speeds: bool) -> str:
        """A point's place from the anchor in the other body's frame, or its speed there."""
        motion = self._difference(point, "Velocity" if speeds else "Position")
        if point.frame == GROUND:
            return motion
        if speeds:
            spin = self._rotation(point.frame, "Coordinates_t")
            motion = f"({motion} - 1j * {spin} * {self._difference(point, 'Position')})"
        return f"{motion} * np.exp(-1j * {self._rotation(point.frame, 'CoordinatesTotal')})"

    def _difference(self, point: RelativePoint, quantity: str) -> str:
        ends = list[str]()
        for kind, marker in point.ends:
            if marker.body == GROUND:
                ends.append(repr(complex(*marker.point)) if quantity == "Position" else "0.0")
            else:
                ends.append(f"plane({self._number((kind, marker.name, quantity))})")
        return f"({ends[0]} - {ends[1]})"

    def _rotation(self, body: str, quantity: str) -> str:
        return f"stored({self._number(('body', body, quantity))})[:, 2]"

    def _number(self, key: SensorKey) -> int:
        if key not in self.sensors:
            sensors = [item for item in self.system.items if kind_of(item) == "Sensor"]
            self.sensors[key] = sensors[self.system.sensors[key]]
        return list(self.sensors).index(key)
