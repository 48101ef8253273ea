"""Answers to what the users of an engine ask first, measured on a pendulum and a rod.

Does a pendulum keep its period and its energy at the step that the engine has where nothing is set,
and at which step to a percent? How far do its pins come apart? Is the force that a joint tells
right, and what does its own program look like?

Called by `plugins/run.py` in the environment of a plug-in: python plugins/answers.py NAME OUT. The
page of an engine (`python docs/generate.py engine-pages`) shows what it writes.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trebucheck as tb
from scipy.special import ellipk
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.protocol import BuiltinEngine

MASS, LENGTH, GRAVITY = 1.0, 1.0, 9.81
AMPLITUDE = math.pi / 3  # [rad] from hanging
DURATION = 10.0  # [s]
PERCENT = 0.01
HALVINGS = 12
LONGEST = 200_000  # steps of a run: a percent that needs more is not looked for
_PRESETS = (DEFAULT, SETTINGS, ASSISTED)


def rod(from_hanging: float, duration: float) -> tb.Problem:
    """A uniform rod, let go at rest at an angle from hanging [rad]."""
    body = tb.Body(
        name="rod",
        angle="a",
        mass=MASS,
        centre=(LENGTH / 2, 0.0),
        inertia=MASS * LENGTH**2 / 12,
    )
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0.0, 0.0), child_point=(0.0, 0.0)
    )
    made = tb.Mechanism(
        name="rod",
        bodies=(body,),
        joints=(pin,),
        stops=(),
        gravity=GRAVITY,
        start=(math.pi / 2 - from_hanging,),
        start_speeds=(0.0,),
        markers=(tb.Marker(name="tip", body="rod", point=(LENGTH, 0.0)),),
    )
    return tb.Problem(made, duration=duration)


def exact_period(amplitude: float) -> float:
    """Period of the rod [s], by the complete elliptic integral of the first kind."""
    rate = math.sqrt(1.5 * GRAVITY / LENGTH)
    return 4 / rate * float(ellipk(math.sin(amplitude / 2) ** 2))


def period(found: tb.Trajectory) -> float | None:
    """Mean period by the passages through hanging [s]; None: fewer than two of one direction."""
    angle = found.q[:, 0] - math.pi / 2
    at = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    if len(at) < 2:
        return None
    share = -angle[at] / (angle[at + 1] - angle[at])
    times = found.t[at] + share * np.diff(found.t)[at]
    return float((times[-1] - times[0]) / (len(times) - 1))


def swing(engine: BuiltinEngine) -> dict[str, Any]:
    """Errors of period and energy, and the largest gap, of ten seconds of the pendulum."""
    found = engine.simulate(rod(AMPLITUDE, DURATION))
    energy = found.kinetic_energy + found.potential_energy
    size = MASS * GRAVITY * LENGTH / 2 * (1 - math.cos(AMPLITUDE))
    mean, right = period(found), exact_period(AMPLITUDE)
    gaps = [float(np.abs(gap).max()) for gap in found.joint_gaps.values()]
    return {
        "timestep": engine.timestep,
        "period": None if mean is None else mean / right - 1,
        "energy": float(energy[-1] - energy[0]) / size,
        "gap": max(gaps, default=None),
    }


def to_a_percent(name: str, preset: str, step: float, what: str) -> float | None:
    """The longest of a step and its halves that keeps period or energy to a percent [s]."""
    for _ in range(HALVINGS):
        if DURATION / step > LONGEST:
            return None
        try:
            error = swing(made(name, preset, timestep=step))[what]
        except tb.SimulationError:  # it flies apart
            error = None
        if error is not None and abs(error) <= PERCENT:
            return step
        step /= 2
    return None


def forces(engine: BuiltinEngine) -> dict[str, Any]:
    """Errors of the pin's force on the rod, in parts of its weight: hanging, and as it swings.

    A rod that is let go level and has fallen by the angle a is pulled with 5/2 m g sin a towards
    the pin and with 1/4 m g cos a across.
    """
    weight = MASS * GRAVITY
    hanging = engine.simulate(rod(0.0, 1.0)).joint_reactions["pin"][-1]
    found = engine.simulate(rod(math.pi / 2, 0.5))
    a = found.q[:, 0]
    towards, across = 2.5 * weight * np.sin(a), 0.25 * weight * np.cos(a)
    right = np.stack(
        [
            -towards * np.cos(a) + across * np.sin(a),
            towards * np.sin(a) + across * np.cos(a),
        ],
        axis=1,
    )
    error = found.joint_reactions["pin"] - right
    return {
        "hanging": float(np.abs(hanging - [0.0, weight]).max()) / weight,
        "swinging": float(np.abs(error).max()) / weight,
    }


def made(name: str, preset: str, **options: Any) -> BuiltinEngine:
    """An engine of the plug-ins."""
    engine = tb.engine(name, preset, **options)
    assert isinstance(engine, BuiltinEngine)
    return engine


def tried(measure: Any, *arguments: Any) -> dict[str, Any]:
    """What is measured, or the sentence of why it is not."""
    try:
        return measure(*arguments)
    except tb.TrebucheckError as error:
        return {"failed": str(error)}


def own_program(name: str) -> dict[str, Any]:
    """The program of the pendulum with nothing but the engine's interface, at its settings."""
    return {"text": made(name, SETTINGS).script(rod(AMPLITUDE, 1.0))}


def answers(name: str) -> dict[str, Any]:
    """All answers of an engine."""
    presets: dict[str, Any] = {}
    for preset in type(made(name, ASSISTED)).presets():
        engine = made(name, preset)
        told: dict[str, Any] = {"swing": tried(swing, engine)}
        if preset == DEFAULT:
            told["to_a_percent"] = {
                what: to_a_percent(name, preset, engine.timestep, what)
                for what in ("period", "energy")
            }
        if engine.capabilities.joint_reactions:
            told["forces"] = tried(forces, engine)
        presets[preset] = told
    engine = made(name, ASSISTED)
    program = tried(own_program, name).get("text", "")
    return {
        "engine": name,
        "version": engine.version(),
        "presets": {preset: presets[preset] for preset in _PRESETS if preset in presets},
        "reactions": engine.capabilities.joint_reactions,
        "stop_torques": engine.capabilities.stop_torques,
        "language": "js" if "const " in program else "python",
        "program": program,
    }


def main() -> None:
    """Write the answers of an engine."""
    name, out = sys.argv[1:]
    Path(out).parent.mkdir(parents=True, exist_ok=True)
    Path(out).write_text(json.dumps(answers(name), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
