"""The drag area that the paper's Table II hides: which one gives its angles, and whether any one gives them all.

Two things the paper leaves open are tried both ways: whether a planet's g acts in the throw or in the flight only, and
whether an angle of release is that of the velocity or, as it computes it in Sec. IV, 90 deg from the sling's. If g acts
in both, time scales with 1 / sqrt(g) and every length of throw and flight stays as it is: the best angle then depends
on rho C_d A alone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from ...models.errors import InputError
from ...models.machines.trebuchet import fixed
from ...models.mechanism import Mechanism
from ...reference.solver import solve_to_launch
from ...reference.throw.flight import World, world
from ...reference.throw.release import Projectile
from ..printed import parse
from .findings import findings
from .grid import on_grid
from .motion import Throwing, common, interval
from .results import AngleCurve, AngleReading, DragStudy, GravityReading, PrintedAngle, Reading, WorldFit

STEPS = (0.005, 0.01)
"""Between release times [s]: the text's, and that of the caption of Fig. 4."""

_NODES = 8  # of a curve of best angles, which is smooth; what is reported as fitted does not come from between them
_BEYOND = math.radians(5.0)  # a curve goes this far below the lowest printed angle


def _row(name: str, printed: str) -> PrintedAngle:
    place, number = world(name), parse(printed)
    return PrintedAngle(
        world=name,
        gravity=place.gravity,
        density=place.density,
        printed=printed,
        value=math.radians(number.value),
        half=math.radians(number.half),
    )


PRINTED = (_row("moon", "45"), _row("mars", "46.9"), _row("earth", "41.5"), _row("venus", "14.9"))
"""Table II."""


def drag_study(
    mechanism: Mechanism | None = None, printed: Sequence[PrintedAngle] = PRINTED, steps: Sequence[float] = STEPS
) -> DragStudy:
    """Fit the drag area to printed angles of release, world by world and in common, under every reading.

    Args:
        mechanism: what throws; the paper's fixed machine where left out.
        printed: worlds and their angles.
        steps: of the grids of release times n * step [s] that the angles may have been picked from.

    Raises:
        InputError: nothing is printed, the machine does not launch, its projectile has no mass of its own, or its
            flight does not land.
        SimulationError: an integrator failed.
    """
    started = time.process_time()
    machine = mechanism or fixed()
    if not printed:
        raise InputError("printed is empty; at least one world's angle is needed.")
    readings: list[Reading] = []
    throwings: list[Throwing] = []
    for gravity in GravityReading:
        throwings = [_throwing(machine, row, gravity) for row in printed]
        lowest = min(row.value for row in printed) - _BEYOND
        curves = [_curve(each, lowest) for each in throwings]
        readings += [_reading(throwings, curves, printed, steps, gravity, angle) for angle in AngleReading]
    return DragStudy(
        mechanism=machine,
        projectile_mass=throwings[0].mass,
        printed=tuple(printed),
        readings=tuple(readings),
        findings=tuple(findings(printed, readings)),
        seconds=time.process_time() - started,
    )


def _throwing(mechanism: Mechanism, row: PrintedAngle, gravity: GravityReading) -> Throwing:
    there = mechanism
    if gravity is GravityReading.THROW_AND_FLIGHT:
        there = mechanism.model_copy(update={"gravity": row.gravity})
    place = World(name=row.world, gravity=row.gravity, density=row.density)
    return Throwing(Projectile(solve_to_launch(there)), place)


_Curve = tuple[list[float], list[float]]
"""Drag areas [m^2] and times of the best release with them [s]."""


def _curve(throwing: Throwing, lowest: float) -> _Curve:
    """From the best release without air to where the velocity is down at `lowest` [rad], or as far as drag takes it."""
    start = throwing.vacuum.time
    end = throwing.time_of(lowest, AngleReading.VELOCITY) or throwing.projectile.sweep()[1]
    areas, times = [0.0], [start]
    if throwing.world.density > 0:
        for t in np.linspace(start, end, _NODES).tolist()[1:]:
            area = throwing.optimal_with(t)
            if not areas[-1] < area < math.inf:
                break
            areas.append(area)
            times.append(t)
    return areas, times


def _time_with(curve: _Curve, area: float) -> float:
    areas, times = curve
    if area <= 0 or len(areas) == 1:
        return times[0]
    # The drag area as a function of the time is smooth; the time as one of the drag area bends sharply near none.
    met = CubicSpline(times, areas).solve(area, extrapolate=False)
    return float(met[0]) if len(met) else times[-1]


def _reading(
    throwings: Sequence[Throwing],
    curves: Sequence[_Curve],
    printed: Sequence[PrintedAngle],
    steps: Sequence[float],
    gravity: GravityReading,
    angle: AngleReading,
) -> Reading:
    rows = list(zip(throwings, curves, printed, strict=True))
    exact = [_area(throwing, row.value, angle) for throwing, _, row in rows]
    area = _least_squares(rows, max((a for a in exact if a is not None), default=0.0), angle)
    fits = [_fit(*row, exact_area, area, angle) for row, exact_area in zip(rows, exact, strict=True)]
    misses = np.array([fit.common_angle - row.value for fit, row in zip(fits, printed, strict=True)])
    return Reading(
        angle=angle,
        gravity=gravity,
        worlds=tuple(fits),
        shared=common([fit.drag_areas for fit in fits]),
        common_drag_area=area,
        root_mean_square=float(np.sqrt(np.mean(misses**2))),
        curves=tuple(_as_curve(throwing, curve, angle) for throwing, curve, _ in rows),
        grids=tuple(on_grid(throwings, printed, step, angle) for step in steps),
    )


def _area(throwing: Throwing, angle: float, reading: AngleReading) -> float | None:
    """The drag area whose best release has an angle [rad]; None where there is none, or no air."""
    at = throwing.time_of(angle, reading)
    found = math.inf if at is None else throwing.optimal_with(at)
    return found if 0 < found < math.inf else None


def _least_squares(rows: Sequence[tuple[Throwing, _Curve, PrintedAngle]], most: float, reading: AngleReading) -> float:
    """Over all worlds' angles, each counting alike: a grid's coarseness, not the printed digits, is what scatters them.

    Between no drag and the largest drag area any one world asks for.
    """

    def loss(area: float) -> float:
        angles = [_angle(throwing, _time_with(curve, area), reading) for throwing, curve, _ in rows]
        return sum((angle - row.value) ** 2 for angle, (_, _, row) in zip(angles, rows, strict=True))

    if most == 0:
        return 0.0
    return float(minimize_scalar(loss, bounds=(0.0, most), method="bounded", options={"xatol": 1e-6 * most}).x)


def _angle(throwing: Throwing, at: float, reading: AngleReading) -> float:
    """Of a release [rad], in (-pi, pi]."""
    return math.remainder(float(throwing.angle(np.array([at]), reading)[0]), 2 * math.pi)


def _fit(
    throwing: Throwing, curve: _Curve, row: PrintedAngle, exact: float | None, area: float, reading: AngleReading
) -> WorldFit:
    early = throwing.time_of(row.value + row.half, reading)
    late = throwing.time_of(row.value - row.half, reading)
    allowed = None
    if early is not None and late is not None:
        allowed = interval(throwing.optimal_with(early), throwing.optimal_with(late))
    spacing = (curve[1][-1] - curve[1][0]) / max(len(curve[1]) - 1, 1)
    release = throwing.best(area, _time_with(curve, area), spacing)
    angle = _angle(throwing, release.time, reading)
    return WorldFit(
        world=row.world,
        vacuum_time=throwing.vacuum.time,
        vacuum_angle=_angle(throwing, throwing.vacuum.time, reading),
        drag_area=exact,
        drag_areas=allowed,
        common_angle=angle,
        agrees=abs(angle - row.value) <= row.half,
    )


def _as_curve(throwing: Throwing, curve: _Curve, reading: AngleReading) -> AngleCurve:
    angles = [_angle(throwing, t, reading) for t in curve[1]]
    return AngleCurve(
        world=throwing.world.name, drag_areas=tuple(curve[0]), angles=tuple(angles), times=tuple(curve[1])
    )
