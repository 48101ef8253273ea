"""What is tried: for each engine a few sets of options from plain to tuned, and a ladder of time steps.

A set adds to the one before it what changes most. How much each change buys is measured, not assumed: the order here
only decides which of two equally quick sets is recommended, the plainer one.
"""

from __future__ import annotations

import math

from ...engines.protocol import Engine
from ...engines.registry import engine, engine_class, engine_study
from ...engines.study import OptionSet

RUNGS = 8
# Of the machine's characteristic time. At twice this step even the best sets are not yet in the range where their
# errors follow the order, and one machine says little of another.
_LONGEST = 1 / 150


def option_sets(name: str) -> tuple[OptionSet, ...]:
    """Of an engine, from plain to tuned; its presets where its study has none."""
    presets = engine_class(name).presets()
    return engine_study(name).option_sets or tuple(
        OptionSet(preset, f"its preset {preset!r}", preset) for preset in sorted(presets)
    )


def configured(name: str, options: OptionSet, step: float) -> Engine:
    """An engine with the options of a set at a time step [s]."""
    return engine(name, options.preset, **options.all_options(step))


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
