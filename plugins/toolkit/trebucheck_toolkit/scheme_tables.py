"""Orders and tolerances of schemes that several engines are moved by, for their studies.

What an engine is moved by decides its order; so engines of one scheme state one order and ask for
one agreement.
"""

from __future__ import annotations

from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.engines.study import StepOrder, Tolerance

RK4_LOCATED = StepOrder(
    4.0, "RK4 in joint coordinates, events located to rounding", "RK4, joint coordinates"
)
"""Order of :mod:`.event_driver` with `rk4` of :mod:`.schemes`."""
EULER_STEPS = StepOrder(
    1.0,
    "semi-implicit Euler in joint coordinates, releases at a step's end",
    "semi-implicit Euler, joint coordinates",
)
"""Order of engines that step joint coordinates themselves, or by `semi_implicit_euler`."""


def error_controlled(method: str) -> StepOrder:
    """Order of an integrator with error control, whose step is only an upper bound."""
    return StepOrder(
        None, f"error-controlled {method}", "error-controlled Runge-Kutta, joint coordinates"
    )


def located_tolerances(
    order: int = 4,
    reason: str = "fourth order: RK4 with located releases",
    step: float = 1e-3,
    position: float = 1e-8,
) -> tuple[Tolerance, ...]:
    """Tolerances of assisted presets of high order that locate events.

    Args:
        order: of the steps.
        reason: for these tolerances.
        step: for which they are [s].
        position: greatest error of a marker [m].
    """
    return (
        Tolerance(ASSISTED, "position_max", position, step, order, reason),
        Tolerance(ASSISTED, "release_time", 1e-9, step, order, reason),
        Tolerance(ASSISTED, "stop_torque_max", 1e-9, step, order, reason, per="peak"),
    )


_FIRST = "first order: the projectile, at up to 40 m/s, is a step's time off"


def euler_tolerances(preset: str) -> tuple[Tolerance, ...]:
    """Tolerances of a preset of semi-implicit Euler with joint limits of the engine's own."""
    late = "first order: a step late by the scheme, one by its end"
    return (
        Tolerance(preset, "position_max", 4e-2, 1e-3, 1, _FIRST),
        Tolerance(preset, "release_time", 2e-3, 1e-3, 1, late),
    )


EULER_TOLERANCES = euler_tolerances(DEFAULT)
"""The same of default presets."""
