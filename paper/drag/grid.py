"""Table II's angles as picked from a grid of release times: which point throws farthest, and with which drag areas."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .motion import Throwing, common, interval
from .results import AngleReading, DragInterval, GridPoint, GridReading, PrintedAngle, WorldOnGrid


def on_grid(
    throwings: Sequence[Throwing], printed: Sequence[PrintedAngle], step: float, reading: AngleReading
) -> GridReading:
    """All worlds against the grid n * step [s]."""
    rows = list(zip(throwings, printed, strict=True))
    worlds = [_OnGrid(throwing, row, step, reading).world() for throwing, row in rows]
    agreeing = [each for each in worlds if each.nearest.agrees]
    misses = np.array([each.nearest.angle - row.value for each, row in zip(worlds, printed, strict=True)])
    return GridReading(
        step=step,
        root_mean_square=float(np.sqrt(np.mean(misses**2))),
        worlds=tuple(worlds),
        shared=common([each.nearest.drag_areas for each in worlds]),
        agreeing=tuple(each.world for each in agreeing),
        shared_by_agreeing=common([each.nearest.drag_areas for each in agreeing]),
        any_phase=common([each.any_phase for each in worlds]),
    )


class _OnGrid:
    """One world against one grid."""

    def __init__(self, throwing: Throwing, row: PrintedAngle, step: float, reading: AngleReading) -> None:
        self.throwing, self.row, self.step, self.reading = throwing, row, step, reading

    def world(self) -> WorldOnGrid:
        at = self.throwing.time_of(self.row.value, self.reading)
        beside = [] if at is None else [math.floor(at / self.step), math.floor(at / self.step) + 1]
        points = {n: self.point(n) for n in {*beside, self.first}}
        # Air moves the best point to later ones only: where there is some, and it is wanted, any later one will do.
        able = [point for point in points.values() if point.drag_areas is not None]
        return WorldOnGrid(
            world=self.row.world,
            nearest=min(able, key=lambda point: abs(point.angle - self.row.value)),
            beside=tuple(points[n] for n in beside),
            any_phase=self.any_phase(),
        )

    @property
    def first(self) -> int:
        """The best point without air: one of the two beside the best release, as the range has a single peak there."""
        below = math.floor(self.throwing.vacuum.time / self.step)
        return below + int(self.throwing.indifferent(below * self.step, (below + 1) * self.step) == 0)

    def point(self, n: int) -> GridPoint:
        at = n * self.step
        angle = math.remainder(float(self.throwing.angle(np.array([at]), self.reading)[0]), 2 * math.pi)
        return GridPoint(
            time=at,
            angle=angle,
            drag_areas=interval(
                self.throwing.indifferent((n - 1) * self.step, at), self.throwing.indifferent(at, (n + 1) * self.step)
            ),
            agrees=abs(angle - self.row.value) <= self.row.half,
        )

    def between(self, early: float, late: float) -> DragInterval | None:
        """Drag areas that make some release between two times [s] better than those a step before and after it."""
        low = self.throwing.indifferent(early - self.step, early)
        return interval(low, self.throwing.indifferent(late, late + self.step))

    def any_phase(self) -> DragInterval | None:
        early = self.throwing.time_of(self.row.value + self.row.half, self.reading)
        late = self.throwing.time_of(self.row.value - self.row.half, self.reading)
        return None if early is None or late is None else self.between(early, late)
