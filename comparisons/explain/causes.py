"""What an engine's error may come from, and how each cause is taken out alone.

A cause is measured by an intervention, never assigned. Most are taken out by other options; one that cannot be is
made larger by a known factor instead. Each engine has its own table of causes (`engines/<name>/study.py`).
"""

from __future__ import annotations

from dataclasses import replace

from pydantic import JsonValue

from ...engines.protocol import Engine
from ...engines.registry import engine_study
from ...engines.study import Cause, ConstraintKinds, Intervention, Options, same_value
from ...models.mechanism import Mechanism


def causes_of(engine: Engine, mechanism: Mechanism | None = None) -> tuple[Cause, ...]:
    """Causes that an engine with these options may have, in the order in which they are best taken out.

    Nothing is run. A cause whose options are already set as its removal would set them is left out. Of an engine
    without a table (a plug-in) only the time step is known, if it has one.

    Args:
        mechanism: that it moves: some causes are there only where points are held, by stops or by loops of joints.
    """
    settings = engine.settings
    of_engine = engine_study(engine.name).causes(settings, ConstraintKinds.of(mechanism))
    found = [cause for cause in of_engine if _does_anything(cause, settings)]
    names = {cause.name for cause in found}
    return tuple(replace(cause, after=tuple(name for name in cause.after if name in names)) for cause in found)


def described(intervention: Intervention, settings: Options) -> str:
    """What is done, in one line."""
    parts = [
        f"{name} {_shown(settings.get(name))} → {_shown(value)}"
        for name, value in intervention.options.items()
        if not same_value(settings.get(name), value)
    ]
    if intervention.point_inertia is not None:
        parts.append(f"point masses given an inertia of {intervention.point_inertia:g} kg m²")
    if intervention.own_kinematics:
        parts.append("read from the coordinates instead")
    if intervention.filtered_torques:
        parts.append("torques passed through a filter that stops what alternates from step to step")
    if 0 < intervention.leaves < 1:
        parts.append(f"which leaves {intervention.leaves:.3g} of it")
    elif intervention.leaves:
        parts.append(f"which makes it {intervention.leaves:g} times as large")
    return ", ".join(parts)


def _does_anything(cause: Cause, settings: Options) -> bool:
    chosen = [c for c in (cause.removal, cause.scaling) if c is not None]
    return any(
        c.own_kinematics
        or c.filtered_torques
        or c.point_inertia is not None
        or any(not same_value(settings.get(name), value) for name, value in c.options.items())
        for c in chosen
    )


def _shown(value: JsonValue) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_shown(part) for part in value) + ")"
    return "unset" if value is None else str(value)
