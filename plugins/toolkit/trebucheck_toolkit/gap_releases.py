"""Releases of stops of engines that tell no forces of limits, from how their gaps grow."""

from __future__ import annotations

import numpy as np
from trebucheck.models.elements import Stop

from .node_samples import NodeSamples

OPENING = 1e-3
"""[rad] where no option says it: steps of 1/60 s let a held stop of the paper's machines give way
by half of it."""
_GROWN = 27.0  # a release is looked back for from a gap of `opening` to this many times that


def releases(samples: NodeSamples, opening: float) -> dict[str, float | None]:
    """Releases of the stops closed at the start [s]: the gap exceeds `opening` [rad]."""
    stops = samples.scene.mechanism.stops
    return {
        each.name: _release(samples, each, opening)
        for each in stops
        if each.closed and isinstance(each, Stop)
    }


def _release(samples: NodeSamples, stop: Stop, opening: float) -> float | None:
    """Time when a gap opened: the torque has fallen through zero, so it grows by t^3."""
    gap, t = samples.gap(stop), samples.t
    if not np.any(gap > opening):
        return None
    first = int(np.argmax(gap > opening))
    beyond = gap[first:] > _GROWN * opening
    last = first + max(int(np.argmax(beyond)) if beyond.any() else len(beyond), 2)
    if last > len(gap):
        return float(t[first - 1])
    start = np.polyfit(np.cbrt(gap[first:last]), t[first:last], 1)[1]
    return float(np.clip(start, 0.0, t[first]))
