"""Claims on fitted values: the start angles, and the drag area behind Table II (Sec. IV)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..drag.motion import AngleReading, DragInterval, PrintedAngle, common
from ..drag.study import DragStudy, GravityReading, Reading, WorldFit
from ..evidence import quantities as of
from ..evidence.claims import BEST_ANGLE, TIME_STEP, Quantity, Verdict
from ..evidence.verdicts import (
    FIXED,
    Cause,
    Evidence,
    Grid,
    Judgement,
    Row,
    as_printed,
    differs,
    occurs,
    positive,
    undecided,
    vanishes,
)
from ..identification.quantities import Identification
from .throw import velocity_angles

_TABLE, _SEC = "Table II", "Sec. IV, Table II"
_CLOSE = 5.0  # [deg]: 'close to 45' is taken as within five


def start_rows(identification: Identification) -> Iterator[Row]:
    """Rows on the start angles, which the paper does not print."""
    fit = identification.fit
    miss = f"the best of all starts still misses one by {fit.least_worst:.3g} half digits"
    yield Row(
        "printed figures are of one start",
        "Secs. IV to VI",
        f"{len(identification.printed)} figures",
        "least that the worst miss of all printed figures can be made by the start angles",
        Quantity(value=fit.least_worst, unit="half digits"),
        occurs(
            fit.compatible,
            "start angles that give every printed figure to its digits",
            [Cause(not fit.compatible, miss)],
        ),
        "both",
    )
    # G1 and G2 at t = 0 are theta(0): the fit decides whether that can be zero.
    low, high = fit.confidence[fit.free.index("theta0")]
    yield Row(
        "Eqs. (6), (7) hold at the start",
        "Eqs. (6), (7)",
        "G1 = G2 = 0",
        "theta(0), fitted to the printed figures",
        Quantity(value=fit.angles[0], uncertainty=(high - low) / 2, unit="rad"),
        lambda q, _: vanishes(q, 0.0, "a constraint that is met"),
        "both",
    )


def drag_rows(study: DragStudy, evidence: Evidence) -> Iterator[Row]:
    """Rows on drag: Table II and the end of Sec. IV."""
    plain = _reading(study)
    for fit in plain.worlds:
        yield _world(study, plain, fit)
    yield _one_area(study)
    yield from _trend(study, plain)
    yield from _elsewhere(study, plain, evidence)


def _reading(study: DragStudy) -> Reading:
    """Reading of the table: the velocity's angle with g changed throughout; else the first."""
    printed_reading = (AngleReading.VELOCITY, GravityReading.THROW_AND_FLIGHT)
    return next(
        (r for r in study.readings if (r.angle, r.gravity) == printed_reading), study.readings[0]
    )


def _printed(study: DragStudy, world: str) -> PrintedAngle:
    return next(each for each in study.printed if each.world == world)


def _world(study: DragStudy, reading: Reading, fit: WorldFit) -> Row:
    printed = _printed(study, fit.world)
    nearest = printed.density > 0 and fit.drag_areas is None
    airless = printed.density == 0 or nearest
    what = (
        f"no drag{', which comes nearest to the print' if nearest else ''}"
        if airless
        else _area(reading)
    )
    return Row(
        f"best angle of release, {fit.world}",
        _TABLE,
        f"{printed.printed}°",
        f"velocity's angle at the release of the longest range ({what})",
        _degrees(fit.vacuum_angle if airless else fit.common_angle),
        _judged(study, reading, fit, printed),
        FIXED,
    )


def _area(reading: Reading) -> str:
    return f"C_d A = {reading.common_drag_area:.3g} m², which suits the table best"


def _degrees(angle: float) -> Quantity:
    return Quantity(value=math.degrees(angle), unit="deg")


def _judged(study: DragStudy, reading: Reading, fit: WorldFit, printed: PrintedAngle) -> Judgement:
    """Judgement: open if a drag area or another reading gives the angle; else vacuum is nearest."""
    if printed.density > 0 and fit.drag_areas is not None:
        return undecided(
            f"the drag area is not printed: C_d A from {_format(fit.drag_areas)} gives "
            f"{printed.printed}°; that which suits it best, {reading.common_drag_area:.3g} m², "
            f"gives {math.degrees(fit.common_angle):.1f}°"
        )
    pairs = [
        (r, f)
        for r in study.readings
        for f in r.worlds
        if f.world == fit.world and f.drag_areas is not None
    ]
    if pairs:
        others = "; ".join(
            f"{math.degrees(f.vacuum_angle):.4g} deg {r.angle.value} with g changed "
            f"{r.gravity.value}"
            for r, f in pairs
        )
        plain = (
            f"{math.degrees(fit.vacuum_angle):.4g} deg {reading.angle.value} with g changed "
            f"{reading.gravity.value}"
        )
        return undecided(
            "the table does not say whether its angle is that of the velocity or, as Sec. IV "
            f"computes it, across the sling, nor where g was changed: it is {plain}, which does "
            f"not give the print; but {others}"
        )
    causes = [
        Cause(printed.density > 0, "no drag area gives it: drag only ever lowers the best angle")
    ]
    return as_printed(_degrees(fit.vacuum_angle), printed.printed, _grid(reading, fit), causes)


def _format(areas: DragInterval) -> str:
    return (
        f"{areas.low:.3g} m² on"
        if areas.high is None
        else f"{areas.low:.3g} to {areas.high:.3g} m²"
    )


def _grid(reading: Reading, fit: WorldFit) -> Grid | None:
    """Point of the finest grid, best for some drag area, nearest to the printed angle."""
    if not reading.grids:
        return None
    grid = min(reading.grids, key=lambda each: each.step)
    nearest = next((each.nearest for each in grid.worlds if each.world == fit.world), None)
    return Grid(f"{grid.step:g} s", nearest.time, math.degrees(nearest.angle)) if nearest else None


def _one_area(study: DragStudy) -> Row:
    """One projectile for four angles: one drag area gives them all, or gives them on the grid."""
    best = min(study.readings, key=lambda reading: reading.root_mean_square)
    return Row(
        "one projectile gives the whole table",
        _TABLE,
        ", ".join(f"{each.printed}°" for each in study.printed),
        "a drag area common to all four worlds",
        Quantity(value=best.common_drag_area, unit="m²"),
        _one_area_judged(study, best),
        FIXED,
    )


def _one_area_judged(study: DragStudy, best: Reading) -> Judgement:
    rule = (
        "some one drag area gives every printed angle; or makes each the best point of one grid of "
        "times from t = 0"
    )
    if any(reading.shared is not None for reading in study.readings):
        return Judgement(Verdict.HOLDS, rule)
    grids = [(r, g) for r in study.readings for g in r.grids]
    for reading, grid in grids:
        if grid.shared and len(grid.agreeing) == len(study.printed):
            why = (
                f"on a grid of {grid.step:g} s, angles read as {reading.angle.value}, g changed "
                f"{reading.gravity.value}"
            )
            return Judgement(Verdict.WITHIN_GRID, rule, why)
    miss, most = (
        math.degrees(best.root_mean_square),
        max((len(grid.agreeing) for _, grid in grids), default=0),
    )
    why = (
        f"with the best common area, {best.common_drag_area:.3g} m², the angles miss by {miss:.2g} "
        f"deg (root mean square) under the reading that fits best; a grid gives at most {most} of "
        f"the {len(study.printed)}"
    )
    apart = all(
        common([f.drag_areas for f in r.worlds if f.drag_areas is not None]) is None
        for r in study.readings
    )
    if apart:
        why += "; even without the worlds that no area suits, the others ask for different ones"
    return Judgement(Verdict.FAILS, rule, why, best.root_mean_square / (math.pi / 4))


def _trend(study: DragStudy, reading: Reading) -> Iterator[Row]:
    angles = {fit.world: math.degrees(fit.common_angle) for fit in reading.worlds}
    densest = max(study.printed, key=lambda each: each.density)
    dense, others = densest.world, [name for name in angles if name != densest.world]
    rises = max(math.degrees(b - a) for curve in reading.curves for a, b in pairwise(curve.angles))
    least = min(angles[name] for name in others) - angles[dense]
    area = f"with {_area(reading)}"
    yield Row(
        "best angle falls as drag grows",
        _SEC,
        "falling",
        "largest rise of the best angle with the drag area",
        Quantity(value=rises, unit="deg"),
        vanishes(
            Quantity(value=max(rises, 0.0), unit="deg"), 1e-4, "what a best angle is found to"
        ),
        FIXED,
    )
    yield _exception(study, angles)
    yield Row(
        "thin air leaves the angle near 45",
        _SEC,
        BEST_ANGLE,
        f"largest distance from 45 deg but on {dense.capitalize()}, {area}",
        Quantity(
            value=max((abs(angles[name] - BEST_ANGLE.value) for name in others), default=0.0),
            unit="deg",
        ),
        lambda q, _: vanishes(q, _CLOSE, "'close' asks for five degrees"),
        FIXED,
    )
    yield Row(
        f"much smaller on {dense.capitalize()}",
        _SEC,
        f"{densest.printed}°",
        f"best angle of any other world less its own, {area}",
        Quantity(value=least, unit="deg"),
        positive(
            Quantity(value=least - _CLOSE, unit="deg"), "the difference, beyond five degrees,"
        ),
        FIXED,
    )


def _exception(study: DragStudy, angles: dict[str, float]) -> Row:
    """The table has one world with air above the airless one."""
    airless = next(each for each in study.printed if each.density == 0)
    above = max((each for each in study.printed if each.density > 0), key=lambda each: each.value)
    excess = Quantity(value=angles[above.world] - angles[airless.world], unit="deg")
    gives = any(
        fit.drag_areas is not None
        for r in study.readings
        for fit in r.worlds
        if fit.world == above.world
    )
    never = Cause(
        not gives,
        "drag only ever lowers the best angle, and no reading and no drag area gives the printed "
        "one",
    )
    some = Cause(gives, "another reading of the table gives it: see the section on drag")
    return Row(
        f"{above.world.capitalize()} is the exception",
        _SEC,
        f"{above.printed}° > {airless.printed}°",
        f"best angle on {above.world.capitalize()} less that on the {airless.world.capitalize()}",
        excess,
        occurs(excess.value > 0, "a larger best angle in thin air than in none", [never, some]),
        FIXED,
        fact=f"best angle of release, {above.world}",
    )


def _elsewhere(study: DragStudy, reading: Reading, evidence: Evidence) -> Iterator[Row]:
    """Largest speed at another angle than the best one, on every world of the table but ours.

    Gravity only scales the time of a throw from rest: the angle of the largest speed is the same
    everywhere. In Sec. IV the two angles pass as one on the Earth without air, where they are as
    far apart as on the Moon: the claim is true, and what it says of the Earth is not.
    """
    turned, values = _angle_per_step(evidence), evidence.throws[FIXED].values
    fastest = math.degrees(values[of.FASTEST_ANGLE])
    gap = math.degrees(values[of.BEST_ANGLE]) - fastest
    said = (
        f"on the Earth without air, where Sec. IV finds the two at one angle, they are {gap:.3g} "
        f"deg apart as well: the velocity turns {turned:.3g} deg in a step of {TIME_STEP:g} s, and "
        "gravity alone changes nothing in that"
    )
    for printed in study.printed:
        if printed.gravity == evidence.parameters.g:
            continue
        fit = next(each for each in reading.worlds if each.world == printed.world)
        best, drag = (
            (fit.vacuum_angle, "no drag")
            if printed.density == 0
            else (fit.common_angle, _area(reading))
        )
        angle = math.degrees(best)
        at_home = Cause(abs(angle - fastest) <= turned, said)
        yield Row(
            f"largest speed at another angle, {printed.world}",
            _SEC,
            f"not {printed.printed}°",
            "angle of the velocity where the projectile is fastest; that of the best release is "
            f"{angle:.4f} deg ({drag})",
            of.FASTEST_ANGLE.of(FIXED).times(180 / math.pi, "deg"),
            lambda q, _, best=f"{angle:.4f}", note=at_home: differs(q, best, [note]),
            FIXED,
            fact="largest speed at another angle, moon",
        )


def _angle_per_step(evidence: Evidence) -> float:
    """Turn of the velocity in one step of the paper's release times, at the best release [deg]."""
    throw = evidence.throws[FIXED]
    times = throw.values[of.BEST_TIME] + TIME_STEP / 2 * np.array([-1.0, 1.0])
    early, late = velocity_angles(throw.at(times))
    return abs(float(late - early))
