"""The paper's Figs. 2 to 7, redrawn: our curves, samples of engines, and printed numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from trebucheck.api.mechanics import (
    COUNTERWEIGHT,
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    FloatArray,
    Trajectory,
)

from .evidence.claims import (
    BEST_L1,
    BEST_SPEED,
    END_L1,
    LAUNCH_SPEED,
    NO_SPEED,
    RATIOS,
    RELEASE_TIME,
    TABLE_L1,
    TIME_STEP,
    ZERO_L1,
    Series,
)
from .evidence.quantities import BEST_TIME, ENERGY_RATIO, FASTEST_TIME, TOTAL_ENERGY, vacuum_ranges
from .evidence.throws import MachineThrow
from .evidence.verdicts import FIXED, Evidence
from .sweep.study import Sweep

_POINTS = 400
_SAMPLED = 14  # points of each engine along a curve: enough to see that they lie on it
_ABOUT = 0.06  # [s] before and after the best release in Fig. 4
_AHEAD, _AFTER = 0.35, 0.06  # [s] before and after the fastest instant in Fig. 7
_T, _TORQUE, _R = "t [s]", "multiplier [N m]", "R"

Kind = Literal["line", "points", "printed"]
Values = Callable[[Trajectory], tuple[FloatArray, FloatArray]]
"""x and y of a curve, from a trajectory."""


def series(evidence: Evidence) -> tuple[Series, ...]:
    """Rows of this section."""
    fixed, panels = evidence.throws[FIXED], list(zip("ab", evidence.throws.items(), strict=False))
    curves = [
        *_torque(fixed, "Fig. 2", HANGER_REST, 1.0),
        *_torque(fixed, "Fig. 3", SLING_REST, -1.0),
        *_range(fixed),
        *_speed(evidence),
    ]
    for panel, (_, throw) in panels:
        curves += _path(throw, f"Fig. 6{panel}")
    for panel, (name, throw) in panels:
        curves += _ratio(throw, name, f"Fig. 7{panel}")
    return tuple(curves)


def _curve(
    throw: MachineThrow, figure: str, labels: tuple[str, str], start: float, end: float, of: Values
) -> list[Series]:
    """Ours as a line from start to end [s], each engine's as samples of its own."""
    ours = of(throw.at(np.linspace(start, end, _POINTS)))
    curves = [_series(figure, "reference", "line", None, labels, ours)]
    for each in throw.engines:
        if each.trajectory is None:
            continue
        try:
            x, y = of(each.trajectory)
        except ValueError:
            continue  # the engine does not show it
        t = each.trajectory.t
        indices = np.searchsorted(t, np.linspace(start, end, _SAMPLED))
        inside = np.unique(
            indices[(indices < len(t)) & (t[np.minimum(indices, len(t) - 1)] <= end)]
        )
        curves.append(
            _series(figure, each.engine, "points", each.engine, labels, (x[inside], y[inside]))
        )
    return curves


def _series(
    figure: str,
    name: str,
    kind: Kind,
    engine: str | None,
    labels: tuple[str, str],
    values: tuple[FloatArray, FloatArray],
) -> Series:
    x, y = values
    fine, (x_label, y_label) = np.isfinite(x) & np.isfinite(y), labels
    points = {"x": tuple(x[fine].tolist()), "y": tuple(y[fine].tolist())}
    return Series(
        figure=figure,
        name=name,
        kind=kind,
        engine=engine,
        x_label=x_label,
        y_label=y_label,
        **points,
    )


def _printed(
    figure: str, name: str, labels: tuple[str, str], x: list[float], y: list[float]
) -> Series:
    return _series(figure, name, "printed", None, labels, (np.array(x), np.array(y)))


def _torque(throw: MachineThrow, figure: str, stop: str, sign: float) -> list[Series]:
    end = throw.solution.release_times[stop]
    until = throw.launch_time if end is None else min(1.1 * end, throw.launch_time)
    return _curve(
        throw, figure, (_T, _TORQUE), 0.0, until, lambda t: (t.t, sign * t.stop_torque(stop))
    )


def _range(throw: MachineThrow) -> Iterator[Series]:
    labels, best = ("release time [s]", "range [m]"), throw.values[BEST_TIME]
    curve = _curve(
        throw, "Fig. 4", labels, best - _ABOUT, best + _ABOUT, lambda t: (t.t, vacuum_ranges(t))
    )
    yield from curve
    times = np.arange(np.ceil((best - _ABOUT) / TIME_STEP), (best + _ABOUT) / TIME_STEP) * TIME_STEP
    sampled = (times, vacuum_ranges(throw.at(times)))
    yield _series("Fig. 4", "the paper's grid of times", "points", None, labels, sampled)
    ends = [min(curve[0].y), max(curve[0].y)]
    yield _printed("Fig. 4", str(RELEASE_TIME), labels, [RELEASE_TIME.value] * 2, ends)


def _speed(evidence: Evidence) -> Iterator[Series]:
    labels, sweep = ("l1 [m]", "launch speed [m/s]"), evidence.sections.get("sweep")
    if not isinstance(sweep, Sweep):
        return
    curve, l1 = sweep.curve, np.array(sweep.curve.l1)
    laws = (
        ("rests that can only push", curve.release_once),
        ("rests that hold as the paper's", curve.bilateral),
    )
    for name, speeds in laws:
        y = np.array([np.nan if v is None else v for v in speeds])
        yield _series("Fig. 5", name, "line", None, labels, (l1, y))
    values = [(p.l1, each) for p in sweep.positions for each in p.engines]
    for name in dict.fromkeys(each.engine for _, each in values):
        points = [
            (x, each.value) for x, each in values if each.engine == name and each.value is not None
        ]
        if points:
            x, y = np.array(points).T
            yield _series("Fig. 5", name, "points", name, labels, (x, y))
    x = [each.value for each in (BEST_L1, TABLE_L1, ZERO_L1, END_L1)]
    y = [each.value for each in (BEST_SPEED, LAUNCH_SPEED, NO_SPEED, NO_SPEED)]
    yield _printed("Fig. 5", "the paper's numbers", labels, x, y)


def _path(throw: MachineThrow, figure: str) -> list[Series]:
    def path(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
        x, y = trajectory.marker(COUNTERWEIGHT).position.T
        return x, y

    return _curve(throw, figure, ("x [m]", "y [m]"), 0.0, throw.launch_time, path)


def _ratio(throw: MachineThrow, name: str, figure: str) -> Iterator[Series]:
    labels, mechanism, energy = ("launch time [s]", _R), throw.mechanism, throw.values[TOTAL_ENERGY]
    mass = mechanism.body(next(m.body for m in mechanism.markers if m.name == PROJECTILE)).mass
    fastest = throw.values[FASTEST_TIME]

    def ratio(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
        speed = np.linalg.norm(trajectory.marker(PROJECTILE).velocity, axis=1)
        return trajectory.t, 0.5 * mass * speed**2 / energy

    start = max(0.0, fastest - _AHEAD)
    yield from _curve(throw, figure, labels, start, fastest + _AFTER, ratio)
    time, value = throw.launch_time, throw.values[ENERGY_RATIO]
    edges = (np.array([time, time, start]), np.array([0.0, value, value]))
    yield _series(figure, "45 deg", "line", None, labels, edges)
    printed = RATIOS.get(name)
    if printed is not None:
        yield _printed(figure, f"R = {printed}", labels, [time], [printed.value])
