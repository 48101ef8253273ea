"""What one drag area can and cannot match of Table II, in sentences with the computed numbers in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from .results import DragInterval, GridReading, PrintedAngle, Reading, WorldFit


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


def _named(reading: Reading) -> str:
    return f"angle {reading.angle}, g {reading.gravity}"


def _without_grid(reading: Reading, rows: dict[str, PrintedAngle]) -> str:
    parts = [f"{fit.world} {_asked(fit, rows[fit.world])}" for fit in reading.worlds]
    angles = ", ".join(f"{fit.world} {_degrees(fit.common_angle)}" for fit in reading.worlds)
    together = f"all hold with {_area(reading.shared)}" if reading.shared else "no one drag area gives all"
    return (
        f"{_named(reading)}: {'; '.join(parts)}; {together}; least squares, {reading.common_drag_area:.3g} m^2, gives "
        f"{angles} (deg; {math.degrees(reading.root_mean_square):.2g} deg root mean square)"
    )


def _asked(fit: WorldFit, row: PrintedAngle) -> str:
    if fit.drag_areas is not None:
        return f"{row.printed} takes {_area(fit.drag_areas)}"
    if row.value > fit.vacuum_angle:
        return f"{row.printed} lies above {_degrees(fit.vacuum_angle)}, the best without air, which drag only lowers"
    return f"{row.printed} is not reached: without air the best is {_degrees(fit.vacuum_angle)}"


def _of_the_best_grid(reading: Reading, grid: GridReading, rows: dict[str, PrintedAngle]) -> str:
    parts: list[str] = []
    for each in grid.worlds:
        point = each.nearest
        parts.append(
            f"{each.world} {_degrees(point.angle)} at {point.time:g} s with {_area(point.drag_areas)} "
            f"({rows[each.world].printed} printed)"
        )
    one = f"one drag area, {_area(grid.shared)}, gives all these" if grid.shared else "no one drag area gives all these"
    some = f", {_area(grid.shared_by_agreeing)} those that agree" if grid.shared_by_agreeing and not grid.shared else ""
    return (
        f"of grids from t = 0, that of {grid.step:g} s agrees with most ({_named(reading)}; "
        f"{' and '.join(grid.agreeing) or 'none'} to the printed digits): {'; '.join(parts)}; {one}{some}"
    )


def _where_g_acts(best: Reading, grid: GridReading, pairs: Sequence[tuple[Reading, GridReading]]) -> str:
    """The same angle and step with g read the other way."""
    other, worse = next(
        (r, g) for r, g in pairs if r.angle == best.angle and r.gravity != best.gravity and g.step == grid.step
    )
    apart = [math.degrees(each.root_mean_square) for each in (grid, worse)]
    return (
        f"g {best.gravity} fits better than g {other.gravity}: {len(grid.agreeing)} against {len(worse.agreeing)} "
        f"printed angles, {apart[0]:.2g} against {apart[1]:.2g} deg root mean square of the nearest points"
    )


def _one_digit_off(grid: GridReading, rows: dict[str, PrintedAngle]) -> Iterator[str]:
    """Where the grid's angle, rounded as the print is, is not the printed one but for a single digit."""
    for each in grid.worlds:
        printed = rows[each.world].printed
        decimals = len(printed.partition(".")[2])
        ours = f"{math.degrees(each.nearest.angle):.{decimals}f}"
        if len(ours) == len(printed) and sum(a != b for a, b in zip(ours, printed, strict=True)) == 1:
            yield f"{each.world}'s printed {printed} and the {ours} of that grid differ in a single digit"


def _out_of_reach(row: PrintedAngle, readings: Sequence[Reading]) -> Iterator[str]:
    """A world that no reading gives, on no grid from t = 0."""
    fits = [fit for reading in readings for fit in reading.worlds if fit.world == row.world]
    points = [(r, g, w) for r in readings for g in r.grids for w in g.worlds if w.world == row.world]
    if any(fit.drag_areas for fit in fits) or any(w.nearest.agrees for _, _, w in points):
        return
    shifted = [f"{_named(r)}, {g.step:g} s, {_area(w.any_phase)}" for r, g, w in points if w.any_phase]
    where = f"only if the grid starts elsewhere: {'; '.join(shifted)}" if shifted else "wherever the grid starts: never"
    yield f"{row.world}'s {row.printed} deg is the best release of no reading and no grid from t = 0; {where}"


def _any_one(readings: Sequence[Reading]) -> str:
    given = [_named(r) for r in readings if r.shared]
    given += [
        f"{_named(r)} on the grid of {g.step:g} s" for r in readings for g in r.grids
        if g.shared and len(g.agreeing) == len(g.worlds)
    ]  # fmt: skip
    if given:
        return f"one drag area gives all printed angles: {'; '.join(given)}"
    loose = [f"{_named(r)}, {g.step:g} s, {_area(g.any_phase)}" for r in readings for g in r.grids if g.any_phase]
    if loose:
        return (
            "one drag area gives all printed angles only if each world's grid may start where it likes: "
            + "; ".join(loose)
        )
    return "no one drag area gives all printed angles under any reading, wherever a grid starts"


def _area(found: DragInterval | None) -> str:
    if found is None:
        return "no drag area"
    if found.high is None:
        return "any drag area" if found.low == 0 else f"{found.low:.4g} m^2 and more"
    return f"{found.low:.4g} to {found.high:.4g} m^2"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}"
