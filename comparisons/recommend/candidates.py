"""What is tried: for each engine a few sets of options from plain to tuned, and a ladder of time steps.

A set adds to the one before it what changes most. How much each change buys is measured, not assumed: the order here
only decides which of two equally quick sets is recommended, the plainer one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class

RUNGS = 8
# Of the machine's characteristic time. At twice this step even the best sets are not yet in the range where their
# errors follow the order, and one machine says little of another.
_LONGEST = 1 / 150


def _nothing(_: float) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class OptionSet:
    """Options of an engine, all but the time step."""

    name: str
    words: str
    """What sets it apart, in a few words."""
    preset: str
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Where they differ from the preset's."""
    scaled: Callable[[float], Mapping[str, Any]] = _nothing
    """Options that follow from the step [s]."""

    def all_options(self, step: float) -> dict[str, Any]:
        """What to set over the preset at a step [s]."""
        return {"timestep": step, **self.options, **self.scaled(step)}

    def engine(self, name: str, step: float) -> Engine:
        """The engine so set."""
        return engine(name, self.preset, **self.all_options(step))


_STOCK = OptionSet("stock", "as its documentation leads to", "stock")
_TUNED = OptionSet("tuned", "every measure trebucheck knows", "tuned")

_MUJOCO_ALONE = {"free_substeps": 1, "locate_releases": False, "preload": False}
_MUJOCO = (
    _STOCK,
    OptionSet(
        "stiffer limits",
        "stock, with a time constant of the limits of two steps, the shortest MuJoCo takes",
        "stock",
        scaled=lambda h: {"solref": (2 * h, 1.0)},
    ),
    OptionSet(
        "stiff limits",
        "limits as stiff as the step bears, solver to the last digit; all of it in the MJCF",
        "tuned",
        _MUJOCO_ALONE | {"keep_limits": True},
    ),
    OptionSet("limits removed", "the same, and a limit is taken out after its release", "tuned", _MUJOCO_ALONE),
    OptionSet(
        "releases located",
        "the same, with releases found inside the step and limits preloaded",
        "tuned",
        {"free_substeps": 1},
    ),
    _TUNED,
)
_PYMUNK = (
    _STOCK,
    OptionSet(
        "leapfrog",
        "stock, without error_bias, started and read as a leapfrog",
        "stock",
        {"error_bias": 0.0, "leapfrog": True},
    ),
    OptionSet(
        "converged leapfrog",
        "the same, with 50 iterations, a heavy pivot and releases foreseen",
        "tuned",
        {"iterations": 50, "hold_lengths": False},
    ),
    OptionSet("held lengths", "the same, with rods held to their lengths", "tuned", {"iterations": 50}),
    _TUNED,
)
_EXUDYN = (
    _STOCK,
    OptionSet("index 2", "stock, with the trapezoidal rule of index 2", "stock", {"integrator": "trapezoidal-index-2"}),
    OptionSet("tight Newton", "the same, with a full Newton iteration to 1e-12", "tuned", {"located_releases": False}),
    _TUNED,
)
_SETS = {"mujoco": _MUJOCO, "pymunk": _PYMUNK, "exudyn": _EXUDYN}


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Of an engine, from plain to tuned; for a plug-in its presets."""
    if name in _SETS:
        return _SETS[name]
    presets = engine_class(name).presets()
    return tuple(OptionSet(preset, f"its preset {preset!r}", preset) for preset in sorted(presets))


def ladder(characteristic_time: float) -> tuple[float, ...]:
    """Time steps of 1, 2 and 5 times a power of ten, downwards [s].

    Args:
        characteristic_time: of the machine [s]; a small machine moves quickly.
    """
    longest = characteristic_time * _LONGEST
    exponent = math.floor(math.log10(longest))
    first = max(factor for factor in (1, 2, 5) if factor * 10.0**exponent <= longest * (1 + 1e-12))
    steps: list[float] = []
    for rung in range(RUNGS):
        place = (1, 2, 5).index(first) - rung
        steps.append(float(f"{(1, 2, 5)[place % 3]}e{exponent + place // 3}"))
    return tuple(steps)
