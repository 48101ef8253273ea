"""Pictures of one throw: the machine in motion, the flight, and the forces over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle

import numpy as np

from ...models.arrays import FloatArray
from ...models.drawing.scene import Scene, scene
from ...reference.throw.figures import Performance
from ...reference.throw.flight import Flight, Surroundings, fly
from ...reference.throw.members import axial_force, carries, members, supports, upward_force
from ..report.plots import Axis, Band, Panels, Plot, Rule, Series, Style

_POINTS = 600
_PROJECTILE, _BEST, _SOFT = "#D55E00", "#009E73", "#8a97a5"
_COLOURS = (_PROJECTILE, "#0072B2", _BEST, "#CC79A7", "#8C6BB1", "#56B4E9", "#E69F00")


def motion(performance: Performance) -> Scene:
    """The machine up to the release."""
    release, projectile = performance.flight.release, performance.projectile.name
    return scene(
        performance.solution.trajectory, end=release.time, thrown=projectile, launch=release.time
    )


def flight(performance: Performance) -> Panels:
    """From the release to the landing; beside it the best release, and what the air takes."""
    surroundings, flown = performance.surroundings, performance.flight
    series = [_path(flown, "flight", Style(_PROJECTILE, width=2.5))]
    if surroundings.drag > 0:
        vacuum = Surroundings(**{**dict(surroundings), "drag": 0.0})
        series.append(_path(fly(flown.release, vacuum), "without drag", Style(_SOFT, dashed=True)))
    if performance.best is not None and performance.best.range - flown.range > 1e-9:
        series.append(_path(performance.best, "best release", Style(_BEST, dashed=True)))
    ground = Rule(surroundings.ground, across="y")
    return (Plot(Axis("x", "m"), Axis("y", "m"), tuple(series), rules=(ground,), equal=True),)


def _path(flown: Flight, name: str, style: Style) -> Series:
    x, y = flown.path(300).T
    return Series(f"{name} ({flown.range:.1f} m)", x, y, style)


Quantity = Callable[[FloatArray], FloatArray]


def forces(performance: Performance) -> Panels:
    """Axial forces, upward forces of the ground and torques (or forces) of the stops, up to the release."""
    times, colours = _force_times(performance), cycle(_COLOURS)
    rules = tuple(
        Rule(time, f"{name} opens")
        for name, time in performance.solution.release_times.items()
        if time is not None and 0 < time < times[-1]
    )
    drawn: list[Plot] = []
    for title, unit, lines in _panels(performance):
        styles = {name: Style(next(colours), width=2) for name in lines}
        series = tuple(
            Series(name, times, value(times) / 1e3, styles[name]) for name, value in lines.items()
        )
        bands = tuple(
            Band(*interval, styles[name].colour)
            for name, interval in _shaded(performance)
            if name in lines
        )
        if series:
            drawn.append(
                Plot(Axis("t", "s"), Axis("", unit), series, title, rules=rules, bands=bands)
            )
    return tuple(drawn)


def _shaded(performance: Performance) -> Iterator[tuple[str, tuple[float, float]]]:
    """Intervals in which a member is compressed or wheels would lift off."""
    throw = performance.throw
    for member in throw.members:
        yield from ((member.name, interval) for interval in member.compressed)
    for support in throw.supports:
        yield from ((support.joint, interval) for interval in support.pulls_down)


def _force_times(performance: Performance) -> FloatArray:
    """Even samples, and both sides of the events, where a slope breaks."""
    until = performance.flight.release.time
    events = [segment.end for segment in performance.solution.segments if segment.end < until]
    return np.unique(np.concatenate([np.linspace(0.0, until, _POINTS), events]))


def _panels(performance: Performance) -> Iterator[tuple[str, str, dict[str, Quantity]]]:
    solution = performance.solution
    mechanism = solution.problem.mechanism
    forces = {
        member.body.name: partial(axial_force, solution, member) for member in members(mechanism)
    }
    yield "Axial forces: tension above zero, compression below", "kN", forces
    upward = {
        joint.name: partial(upward_force, solution, joint)
        for joint in supports(mechanism)
        if carries(joint)
    }
    yield "Upward force of the ground: below zero, it would lift off", "kN", upward
    for title, unit, stops in (
        ("Torques of the stops", "kN m", mechanism.angle_stops),
        ("Forces of the stops", "kN", mechanism.point_stops),
    ):
        closed = [stop.name for stop in stops if stop.closed]
        yield (
            title,
            unit,
            {name: (lambda t, name=name: solution.motion(t).stop_torques[name]) for name in closed},
        )
