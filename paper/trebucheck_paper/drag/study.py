"""Drag area behind the paper's Table II: those that give its angles, one by one and together.

Two things the paper leaves open are tried both ways: whether a planet's g acts in the throw or in
the flight only, and whether an angle of release is that of the velocity or, as it computes it in
Sec. IV, 90 deg from the sling's. If g acts in both, time scales with 1 / sqrt(g) and every length
of throw and flight stays as it is: the best angle then depends on rho C_d A alone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from enum import StrEnum

import numpy as np
from pydantic import Field
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from trebucheck.api.mechanics import (
    InputError,
    Mechanism,
    NonNegative,
    Positive,
    Projectile,
    Real,
    Spec,
    World,
    fixed,
    solve_to_launch,
    world,
)

from ..evidence.claims import CAPTION_STEP, TIME_STEP, parse
from .motion import (
    AngleReading,
    DragInterval,
    GridReading,
    PrintedAngle,
    Throwing,
    common,
    interval,
    on_grid,
)

STEPS = (TIME_STEP, CAPTION_STEP)
"""Between release times [s]: the text's, and that of the caption of Fig. 4."""

_NODES = 8  # of a smooth curve of best angles; reported fits are not interpolated
_BEYOND = math.radians(5.0)  # a curve goes this far below the lowest printed angle


class GravityReading(StrEnum):
    """Place where the planet's own g is taken."""

    THROW_AND_FLIGHT = "in the throw and the flight"
    FLIGHT_ONLY = "in the flight only"


class WorldFit(Spec):
    """One world's printed angle against the best release, found without a grid."""

    world: str
    vacuum_time: Real = Field(description="of the best release without air [s]")
    vacuum_angle: Real = Field(description="[rad]")
    drag_area: NonNegative | None = Field(
        description="that gives the printed angle [m^2]; None where none does, or any drag area "
        "gives the same"
    )
    drag_areas: DragInterval | None = Field(
        description="that give the printed digits; None where none does"
    )
    common_angle: Real = Field(description="with the reading's common drag area [rad]")
    agrees: bool = Field(description="whether that is the printed angle, to the printed digits")


class AngleCurve(Spec):
    """Best angle of release against drag area."""

    world: str
    drag_areas: tuple[Real, ...] = Field(description="[m^2]")
    angles: tuple[Real, ...] = Field(description="[rad]")
    times: tuple[Real, ...] = Field(description="of release [s]")


class Reading(Spec):
    """Table II under one reading of what its angles are and where g was changed."""

    angle: AngleReading
    gravity: GravityReading
    worlds: tuple[WorldFit, ...]
    shared: DragInterval | None = Field(
        description="drag areas that give every printed angle; None: no one does"
    )
    common_drag_area: NonNegative = Field(description="least squares over the printed angles [m^2]")
    root_mean_square: NonNegative = Field(description="of the misses with it [rad]")
    curves: tuple[AngleCurve, ...]
    grids: tuple[GridReading, ...]


class DragStudy(Spec):
    """Table II under all readings."""

    mechanism: Mechanism
    projectile_mass: Positive = Field(description="[kg]")
    printed: tuple[PrintedAngle, ...]
    readings: tuple[Reading, ...]
    findings: tuple[str, ...] = Field(
        description="what one drag area can and cannot match, in sentences"
    )
    seconds: NonNegative = Field(description="processor time [s]")


def _row(name: str, printed: str) -> PrintedAngle:
    conditions, number = world(name), parse(printed)
    return PrintedAngle(
        world=name,
        gravity=conditions.gravity,
        density=conditions.density,
        printed=printed,
        value=math.radians(number.value),
        half=math.radians(number.half),
    )


PRINTED = (_row("moon", "45"), _row("mars", "46.9"), _row("earth", "41.5"), _row("venus", "14.9"))
"""Table II."""


def drag_study(
    mechanism: Mechanism | None = None,
    printed: Sequence[PrintedAngle] = PRINTED,
    steps: Sequence[float] = STEPS,
) -> DragStudy:
    """Fit the drag area to printed release angles, by world and in common, under each reading.

    Args:
        mechanism: what throws; the paper's fixed machine where left out.
        printed: worlds and their angles.
        steps: of the grids of release times n * step [s] that the angles may have been picked from.

    Raises:
        InputError: nothing is printed, the machine does not launch, its projectile has no mass of
            its own, or its flight does not land.
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
        readings += [
            _reading(throwings, curves, printed, steps, gravity, angle) for angle in AngleReading
        ]
    return DragStudy(
        mechanism=machine,
        projectile_mass=throwings[0].mass,
        printed=tuple(printed),
        readings=tuple(readings),
        findings=tuple(findings(printed, readings)),
        seconds=time.process_time() - started,
    )


def _throwing(mechanism: Mechanism, row: PrintedAngle, gravity: GravityReading) -> Throwing:
    if gravity is GravityReading.THROW_AND_FLIGHT:
        mechanism = mechanism.model_copy(update={"gravity": row.gravity})
    conditions = World(name=row.world, gravity=row.gravity, density=row.density)
    return Throwing(Projectile(solve_to_launch(mechanism)), conditions)


_Curve = tuple[list[float], list[float]]
"""Drag areas [m^2] and times of the best release with them [s]."""


def _curve(throwing: Throwing, lowest: float) -> _Curve:
    """Curve from the best release without air to `lowest` [rad], or to the limit of drag."""
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
    # The drag area as a function of the time is smooth; the time as one of the drag area bends
    # sharply near none.
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
    fits = [
        _fit(*row, exact_area, area, angle) for row, exact_area in zip(rows, exact, strict=True)
    ]
    misses = np.array(
        [fit.common_angle - row.value for fit, row in zip(fits, printed, strict=True)]
    )
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
    area = math.inf if at is None else throwing.optimal_with(at)
    return area if 0 < area < math.inf else None


def _least_squares(
    rows: Sequence[tuple[Throwing, _Curve, PrintedAngle]], most: float, reading: AngleReading
) -> float:
    """Least squares over all worlds' angles, equally weighted: the grid scatters more than digits.

    Between no drag and the largest drag area any one world asks for.
    """

    def loss(area: float) -> float:
        angles = [_angle(throwing, _time_with(curve, area), reading) for throwing, curve, _ in rows]
        return sum(
            (angle - row.value) ** 2 for angle, (_, _, row) in zip(angles, rows, strict=True)
        )

    if most == 0:
        return 0.0
    return float(
        minimize_scalar(
            loss, bounds=(0.0, most), method="bounded", options={"xatol": 1e-6 * most}
        ).x
    )


def _angle(throwing: Throwing, at: float, reading: AngleReading) -> float:
    """Angle of a release [rad], in (-pi, pi]."""
    return math.remainder(float(throwing.angle(np.array([at]), reading)[0]), 2 * math.pi)


def _fit(
    throwing: Throwing,
    curve: _Curve,
    row: PrintedAngle,
    exact: float | None,
    area: float,
    reading: AngleReading,
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
        world=throwing.world.name,
        drag_areas=tuple(curve[0]),
        angles=tuple(angles),
        times=tuple(curve[1]),
    )


def findings(printed: Sequence[PrintedAngle], readings: Sequence[Reading]) -> Iterator[str]:
    """One sentence for each reading without a grid, then what grids add."""
    rows = {row.world: row for row in printed}
    for reading in readings:
        yield _without_grid(reading, rows)
    pairs = [(reading, grid) for reading in readings for grid in reading.grids]
    if pairs:
        best, grid = max(pairs, key=lambda pair: (len(pair[1].agreeing), -pair[1].root_mean_square))
        yield _of_the_best_grid(best, grid, rows)
        yield _where_g_acts(best, grid, pairs)
        yield from _one_digit_off(grid, rows)
    for row in printed:
        yield from _out_of_reach(row, readings)
    yield _any_one(readings)


def _label(reading: Reading) -> str:
    return f"angle {reading.angle}, g {reading.gravity}"


def _without_grid(reading: Reading, rows: dict[str, PrintedAngle]) -> str:
    parts = [f"{fit.world} {_format_fit(fit, rows[fit.world])}" for fit in reading.worlds]
    angles = ", ".join(f"{fit.world} {_degrees(fit.common_angle)}" for fit in reading.worlds)
    together = (
        f"all hold with {_areas(reading.shared)}"
        if reading.shared
        else "no one drag area gives all"
    )
    return (
        f"{_label(reading)}: {'; '.join(parts)}; {together}; least squares, "
        f"{reading.common_drag_area:.3g} m^2, gives {angles} (deg; "
        f"{math.degrees(reading.root_mean_square):.2g} deg root mean square)"
    )


def _format_fit(fit: WorldFit, row: PrintedAngle) -> str:
    if fit.drag_areas is not None:
        return f"{row.printed} takes {_areas(fit.drag_areas)}"
    if row.value > fit.vacuum_angle:
        return (
            f"{row.printed} lies above {_degrees(fit.vacuum_angle)}, the best without air, which "
            "drag only lowers"
        )
    return f"{row.printed} is not reached: without air the best is {_degrees(fit.vacuum_angle)}"


def _of_the_best_grid(reading: Reading, grid: GridReading, rows: dict[str, PrintedAngle]) -> str:
    parts: list[str] = []
    for each in grid.worlds:
        point = each.nearest
        parts.append(
            f"{each.world} {_degrees(point.angle)} at {point.time:g} s with "
            f"{_areas(point.drag_areas)} ({rows[each.world].printed} printed)"
        )
    one = (
        f"one drag area, {_areas(grid.shared)}, gives all these"
        if grid.shared
        else "no one drag area gives all these"
    )
    some = (
        f", {_areas(grid.shared_by_agreeing)} those that agree"
        if grid.shared_by_agreeing and not grid.shared
        else ""
    )
    return (
        f"of grids from t = 0, that of {grid.step:g} s agrees with most ({_label(reading)}; "
        f"{' and '.join(grid.agreeing) or 'none'} to the printed digits): {'; '.join(parts)}; "
        f"{one}{some}"
    )


def _where_g_acts(
    best: Reading, grid: GridReading, pairs: Sequence[tuple[Reading, GridReading]]
) -> str:
    """The same angle and step with g read the other way."""
    other, worse = next(
        (r, g)
        for r, g in pairs
        if r.angle == best.angle and r.gravity != best.gravity and g.step == grid.step
    )
    errors = [math.degrees(each.root_mean_square) for each in (grid, worse)]
    return (
        f"g {best.gravity} fits better than g {other.gravity}: {len(grid.agreeing)} against "
        f"{len(worse.agreeing)} printed angles, {errors[0]:.2g} against {errors[1]:.2g} deg root "
        "mean square of the nearest points"
    )


def _one_digit_off(grid: GridReading, rows: dict[str, PrintedAngle]) -> Iterator[str]:
    """Grid angles that, rounded as the print, differ from the printed one in a single digit."""
    for each in grid.worlds:
        printed = rows[each.world].printed
        decimals = len(printed.partition(".")[2])
        ours = f"{math.degrees(each.nearest.angle):.{decimals}f}"
        if (
            len(ours) == len(printed)
            and sum(a != b for a, b in zip(ours, printed, strict=True)) == 1
        ):
            yield (
                f"{each.world}'s printed {printed} and the {ours} of that grid differ in a single "
                "digit"
            )


def _out_of_reach(row: PrintedAngle, readings: Sequence[Reading]) -> Iterator[str]:
    """A world that no reading gives, on no grid from t = 0."""
    fits = [fit for reading in readings for fit in reading.worlds if fit.world == row.world]
    points = [
        (r, g, w) for r in readings for g in r.grids for w in g.worlds if w.world == row.world
    ]
    if any(fit.drag_areas for fit in fits) or any(w.nearest.agrees for _, _, w in points):
        return
    shifted = [
        f"{_label(r)}, {g.step:g} s, {_areas(w.any_phase)}" for r, g, w in points if w.any_phase
    ]
    where = (
        f"only if the grid starts elsewhere: {'; '.join(shifted)}"
        if shifted
        else "wherever the grid starts: never"
    )
    yield (
        f"{row.world}'s {row.printed} deg is the best release of no reading and no grid from t = "
        f"0; {where}"
    )


def _any_one(readings: Sequence[Reading]) -> str:
    given = [_label(r) for r in readings if r.shared]
    given += [
        f"{_label(r)} on the grid of {g.step:g} s"
        for r in readings
        for g in r.grids
        if g.shared and len(g.agreeing) == len(g.worlds)
    ]
    if given:
        return f"one drag area gives all printed angles: {'; '.join(given)}"
    loose = [
        f"{_label(r)}, {g.step:g} s, {_areas(g.any_phase)}"
        for r in readings
        for g in r.grids
        if g.any_phase
    ]
    if loose:
        return (
            "one drag area gives all printed angles only if each world's grid may start where it "
            "likes: " + "; ".join(loose)
        )
    return "no one drag area gives all printed angles under any reading, wherever a grid starts"


def _areas(areas: DragInterval | None) -> str:
    if areas is None:
        return "no drag area"
    if areas.high is None:
        return "any drag area" if areas.low == 0 else f"{areas.low:.4g} m^2 and more"
    return f"{areas.low:.4g} to {areas.high:.4g} m^2"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}"
