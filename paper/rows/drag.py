"""Claims on drag: Table II and the end of Sec. IV."""

from __future__ import annotations

import math
from itertools import pairwise

from ..drag.results import (
    AngleReading,
    DragInterval,
    DragStudy,
    GravityReading,
    GridPoint,
    PrintedAngle,
    Reading,
    WorldFit,
)
from ..evidence import Evidence, Row, made
from ..results import Claim, Quantity, Verdict
from ..throws.grids import TIME_STEP
from ..throws.headline import FASTEST_ANGLE
from ..verdicts import Cause, Grid, Judgement, as_printed, not_told, occurs, positive, told_apart, vanishes

_TABLE, _SEC = "Table II", "Sec. IV, Table II"
_CLOSE = 5.0  # [deg]: 'close to 45' asks for five


def claims(study: DragStudy, evidence: Evidence) -> list[Claim]:
    """All of them."""
    plain = _reading(study)
    rows = [_world(plain, fit, _printed(study, fit.world)) for fit in plain.worlds]
    return [*rows, _one_area(study), *_trend(study, plain), *_fastest(study, plain, evidence)]


def _reading(study: DragStudy) -> Reading:
    """As the table's words have it: the velocity's angle, g changed throughout; the first one if there is no such."""
    wanted = (AngleReading.VELOCITY, GravityReading.THROW_AND_FLIGHT)
    return next((r for r in study.readings if (r.angle, r.gravity) == wanted), study.readings[0])


def _printed(study: DragStudy, world: str) -> PrintedAngle:
    return next(each for each in study.printed if each.world == world)


def _world(reading: Reading, fit: WorldFit, printed: PrintedAngle) -> Claim:
    airless = printed.density == 0
    ours = Quantity(value=math.degrees(fit.vacuum_angle if airless else fit.common_angle), unit="deg")
    what = "no drag" if airless else f"C_d A = {reading.common_drag_area:.3g} m², the best common one"
    quantity = f"velocity's angle at the release of the longest range ({what})"
    name = f"best angle of release, {fit.world}"
    return made(name, _TABLE, f"{printed.printed}°", quantity, ours, _judged(reading, fit, printed), machine="fixed")


def _judged(reading: Reading, fit: WorldFit, printed: PrintedAngle) -> Judgement:
    """A drag area that gives the angle leaves the claim open; without one, vacuum comes nearest to it."""
    if printed.density > 0 and fit.drag_areas is not None:
        return not_told(
            f"the drag area is not printed: C_d A from {_said(fit.drag_areas)} gives {printed.printed}°; that "
            f"which suits it best, {reading.common_drag_area:.3g} m², gives {math.degrees(fit.common_angle):.1f}°"
        )
    vacuum = Quantity(value=math.degrees(fit.vacuum_angle), unit="deg")
    causes = [Cause(printed.density > 0, "no drag area gives it: drag only ever lowers the best angle")]
    return as_printed(vacuum, printed.printed, _grid(reading, fit), causes)


def _said(areas: DragInterval) -> str:
    return f"{areas.low:.3g} m² on" if areas.high is None else f"{areas.low:.3g} to {areas.high:.3g} m²"


def _grid(reading: Reading, fit: WorldFit) -> Grid | None:
    """Points of the finest grid within one step of the best release in vacuum."""
    if not reading.grids:
        return None
    grid = min(reading.grids, key=lambda each: each.step)
    found = next((each for each in grid.worlds if each.world == fit.world), None)
    points: list[GridPoint] = [] if found is None else [found.nearest, *found.beside]
    near = {p.time: math.degrees(p.angle) for p in points if abs(p.time - fit.vacuum_time) <= grid.step * (1 + 1e-9)}
    return Grid(f"{grid.step:g} s", tuple(sorted(near.items()))) if near else None


def _one_area(study: DragStudy) -> Claim:
    """The four angles are of one projectile: some one drag area gives them all, or gives them on the grid."""
    name, quantity = "one projectile gives the whole table", "a drag area common to all four worlds"
    printed = ", ".join(f"{each.printed}°" for each in study.printed)
    best = min(study.readings, key=lambda reading: reading.root_mean_square)
    rule = "some one drag area gives every printed angle; or makes each the best point of one grid of times from t = 0"
    whole = [r for r in study.readings if r.shared is not None]
    grids = [(r, g) for r in study.readings for g in r.grids if g.shared and len(g.agreeing) == len(study.printed)]
    ours = Quantity(value=best.common_drag_area, unit="m²")
    if whole:
        judgement = Judgement(Verdict.HOLDS, rule)
    elif grids:
        reading, grid = grids[0]
        why = f"on a grid of {grid.step:g} s, angles read as {reading.angle.value}, g changed {reading.gravity.value}"
        judgement = Judgement(Verdict.WITHIN_GRID, rule, why)
    else:
        miss = math.degrees(best.root_mean_square)
        most = max((len(grid.agreeing) for r in study.readings for grid in r.grids), default=0)
        why = (
            f"with the best common area, {best.common_drag_area:.3g} m², the angles miss by {miss:.2g} deg (root mean "
            f"square) under the reading that fits best; a grid gives at most {most} of the {len(study.printed)}"
        )
        judgement = Judgement(Verdict.FAILS, rule, why, best.root_mean_square / (math.pi / 4))
    return made(name, _TABLE, printed, quantity, ours, judgement, machine="fixed")


def _trend(study: DragStudy, reading: Reading) -> list[Claim]:
    angles = {fit.world: math.degrees(fit.common_angle) for fit in reading.worlds}
    dense = max(study.printed, key=lambda each: each.density).world
    others = [name for name in angles if name != dense]
    rises = max(math.degrees(b - a) for curve in reading.curves for a, b in pairwise(curve.angles))
    least = min(angles[name] for name in others) - angles[dense]
    farthest = max((abs(angles[name] - 45) for name in others), default=0.0)
    falls = Quantity(value=least, unit="deg")
    off = Quantity(value=farthest, unit="deg")
    rise = Quantity(value=rises, unit="deg")
    return [
        made(
            "best angle falls as drag grows",
            _SEC,
            "falling",
            "largest rise of the best angle with the drag area",
            rise,
            vanishes(Quantity(value=max(rises, 0.0), unit="deg"), 1e-4, "what a best angle is found to"),
            machine="fixed",
        ),
        _exception(study, angles),
        made(
            "thin air leaves the angle near 45",
            _SEC,
            "45°",
            f"largest distance from 45 deg but on {dense.capitalize()}",
            off,
            vanishes(off, _CLOSE, "'close' asks for five degrees"),
            machine="fixed",
        ),
        made(
            f"much smaller on {dense.capitalize()}",
            _SEC,
            "14.9°",
            "best angle of any other world less its own",
            falls,
            positive(Quantity(value=least - _CLOSE, unit="deg"), "the difference, beyond five degrees,"),
            machine="fixed",
        ),
    ]


def _exception(study: DragStudy, angles: dict[str, float]) -> Claim:
    """The table has one world with air above the airless one."""
    airless = next(each for each in study.printed if each.density == 0)
    above = max((each for each in study.printed if each.density > 0), key=lambda each: each.value)
    excess = Quantity(value=angles[above.world] - angles[airless.world], unit="deg")
    gives = any(fit.drag_areas is not None for r in study.readings for fit in r.worlds if fit.world == above.world)
    never = Cause(
        not gives, "drag only ever lowers the best angle, and no reading and no drag area gives the printed one"
    )
    some = Cause(gives, "another reading of the table gives it: see the section on drag")
    return made(
        f"{above.world.capitalize()} is the exception",
        _SEC,
        f"{above.printed}° > {airless.printed}°",
        f"best angle on {above.world.capitalize()} less that on the {airless.world.capitalize()}",
        excess,
        occurs(excess.value > 0, "a larger best angle in thin air than in none", [never, some]),
        machine="fixed",
    )


def _fastest(study: DragStudy, reading: Reading, evidence: Evidence) -> list[Claim]:
    """On other worlds with air, the largest speed comes at another angle than the best one, as printed.

    Gravity only scales the time of a throw from rest: the angle of the largest speed is the same everywhere.
    """
    home = evidence.parameters.g
    worlds = [each for each in study.printed if each.density > 0 and each.gravity != home]
    return [_elsewhere(each, _angle_per_step(reading, each.world), evidence) for each in worlds]


def _elsewhere(printed: PrintedAngle, step: float, evidence: Evidence) -> Claim:
    return Row(
        f"largest speed at another angle, {printed.world}",
        _SEC,
        f"not {printed.printed}°",
        "angle of the velocity where the projectile is fastest",
        "deg",
        lambda f: math.degrees(f[f"fixed: {FASTEST_ANGLE}"]),
        lambda q: told_apart(q, printed.printed, step, f"what the angle turns in a step of {TIME_STEP:g} s there"),
        "fixed",
    ).claim(evidence)


def _angle_per_step(reading: Reading, world: str) -> float:
    """How much the velocity turns in one step of the paper's release times, about the best release in vacuum [deg]."""
    fit = next(each for each in reading.worlds if each.world == world)
    curve = next(each for each in reading.curves if each.world == world)
    # The curve of best releases runs along the one throw: its next point is another instant of the same motion.
    turned = abs(curve.angles[1] - fit.vacuum_angle) / abs(curve.times[1] - fit.vacuum_time)
    return math.degrees(turned) * TIME_STEP
