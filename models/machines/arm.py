"""The throwing arm: a uniform rod, and what is fixed to it."""

from __future__ import annotations

from collections.abc import Mapping

from ..mechanism import Body


def loaded_arm(l1: float, l2: float, mass: float, loads: Mapping[float, float]) -> Body:
    """A uniform rod from -l2 to l1 along its own x axis, with point masses fixed to it.

    Args:
        l1, l2: from the fulcrum to the sling's and to the counterweight's end [m].
        mass: of the rod alone [kg].
        loads: mass [kg] at each place along the arm [m].
    """
    middle, whole = (l1 - l2) / 2, mass + sum(loads.values())
    centre = (mass * middle + sum(load * place for place, load in loads.items())) / whole
    rod = mass * ((l1 + l2) ** 2 / 12 + (middle - centre) ** 2)
    points = sum(load * (place - centre) ** 2 for place, load in loads.items())
    return Body(name="arm", angle="theta", mass=whole, centre=(centre, 0), inertia=rod + points)
