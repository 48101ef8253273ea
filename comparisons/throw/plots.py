"""Pictures of one throw: the machine as a stroboscope, the flight, and the forces over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ...models.arrays import FloatArray
from ...models.machines.trebuchet import COUNTERWEIGHT
from ...reference.throw.flight import Flight, Surroundings, fly
from ...reference.throw.members import axial_force, carries, members, supports, upward_force
from ...reference.throw.throw import Performance
from ..report.plotly_plots import finish, skeleton

_FRAMES = 13  # positions of the machine, at equal intervals of time
_POINTS = 600
_WOOD, _PROJECTILE, _WEIGHT, _BEST, _SOFT = "#8a6d3b", "#d9730d", "#1f77b4", "#2a9d5c", "#9aa5b1"
_COLOURS = (_PROJECTILE, _WEIGHT, _BEST, "#9467bd", "#8c564b", "#e377c2", "#17becf")


def machine_figure(performance: Performance) -> go.Figure:
    """The machine at equal intervals of time up to the release, the later the darker, and the paths of its ends."""
    solution, release = performance.solution, performance.flight.release
    mechanism, kinematics = solution.problem.mechanism, solution.equations.kinematics
    figure = go.Figure()
    frames = np.linspace(0.0, release.time, _FRAMES)
    q = solution.motion(frames).q
    for i, time in enumerate(frames):
        x, y = skeleton(mechanism, kinematics, q[i])
        last = i == len(frames) - 1
        figure.add_scatter(
            x=x, y=y, mode="lines", opacity=1.0 if last else 0.12 + 0.5 * i / len(frames), showlegend=last,
            line={"color": _WOOD, "width": 4 if last else 2}, name="machine at the release" if last else f"{time:.3f} s"
        )  # fmt: skip
    path = solution.trajectory(np.linspace(0.0, release.time, _POINTS))
    bodies = {member.body.name for member in members(mechanism)}
    ends = (performance.projectile.name, COUNTERWEIGHT)
    markers = [m.name for m in mechanism.markers if m.body in bodies or m.name in ends]
    for name, colour in zip(markers, _COLOURS, strict=False):
        x, y = path.marker(name).position.T
        figure.add_scatter(x=x, y=y, name=name, line={"color": colour, "width": 3})
    _mark_release(figure, performance)
    figure.update_xaxes(title="x [m]", zeroline=False, constrain="domain")
    figure.update_yaxes(title="y [m]", scaleanchor="x", zeroline=False)
    return finish(figure, 720, -0.1)


def _mark_release(figure: go.Figure, performance: Performance) -> None:
    """The point of release and the first stretch of the flight: a little beyond the machine."""
    flight = performance.flight
    x, y = flight.state(np.linspace(0.0, min(flight.time, 0.07 * flight.release.time), 20))[:, :2].T
    figure.add_scatter(x=x, y=y, name="flight", line={"color": _PROJECTILE, "width": 2, "dash": "dot"})
    start = {"color": _PROJECTILE, "size": 10}
    figure.add_scatter(x=x[:1], y=y[:1], mode="markers", marker=start, name="release", showlegend=False)


def flight_figure(performance: Performance) -> go.Figure:
    """From the release to the landing; beside it the best release, and what the air takes."""
    surroundings, flight = performance.surroundings, performance.flight
    figure = go.Figure()
    if surroundings.drag > 0:
        vacuum = Surroundings(**{**dict(surroundings), "drag": 0.0})
        _path(figure, fly(flight.release, vacuum), surroundings, "without drag", {"color": _SOFT, "dash": "dot"})
    if performance.best is not None and performance.best.range - flight.range > 1e-9:
        _path(figure, performance.best, surroundings, "best release", {"color": _BEST, "dash": "dash"})
    _path(figure, flight, surroundings, "flight", {"color": _PROJECTILE, "width": 3})
    figure.add_hline(y=surroundings.ground, line={"color": _SOFT, "width": 1})
    landing = flight.range + surroundings.origin
    figure.add_scatter(
        x=[landing], y=[surroundings.ground], mode="markers+text", text=[f"{flight.range:.2f} m"],
        textposition="top left", marker={"color": _PROJECTILE, "size": 9}, showlegend=False,
    )  # fmt: skip
    figure.update_xaxes(title="x [m]", zeroline=False)
    figure.update_yaxes(title="y [m]", scaleanchor="x", zeroline=False)
    return finish(figure, 430, -0.2)


def _path(figure: go.Figure, flight: Flight, surroundings: Surroundings, name: str, line: dict[str, Any]) -> None:
    x, y = flight.path(300).T
    label = f"{name} ({flight.range:.1f} m)"
    figure.add_scatter(x=x, y=y, name=label, line=line)


Quantity = Callable[[FloatArray], FloatArray]


def force_figure(performance: Performance) -> go.Figure:
    """Axial forces, upward forces of the ground and torques (or forces) of the stops, up to the release."""
    panels = [panel for panel in _panels(performance) if panel[-1]]
    titles = [title for title, *_ in panels]
    figure = make_subplots(rows=len(panels), shared_xaxes=True, vertical_spacing=0.07, subplot_titles=titles)
    times = _force_times(performance)
    colours, colours_of = cycle(_COLOURS), dict[str, str]()
    for row, (_, unit, lines) in enumerate(panels, start=1):
        for name, value in lines.items():
            colour = colours_of[name] = next(colours)
            line = {"color": colour, "width": 2}
            figure.add_scatter(x=times, y=value(times) / 1e3, name=name, line=line, row=row, col=1)
        figure.update_yaxes(title=f"[{unit}]", zerolinecolor=_SOFT, row=row, col=1)
    _shade(figure, performance, colours_of)
    for time in performance.solution.release_times.values():
        if time is not None and 0 < time < times[-1]:
            figure.add_vline(x=time, line={"color": _SOFT, "width": 1, "dash": "dot"})
    figure.update_xaxes(title="t [s]", row=len(panels), col=1)
    return finish(figure, 90 + 250 * len(panels), -0.07)


def _shade(figure: go.Figure, performance: Performance, colours: dict[str, str]) -> None:
    """Colour the intervals in which a member is compressed (first panel) or wheels lift off (second)."""
    throw = performance.throw
    shaded = [(member.name, 1, interval) for member in throw.members for interval in member.compressed]
    row = 2 if throw.members else 1
    shaded += [(support.joint, row, interval) for support in throw.supports for interval in support.pulls_down]
    for name, row, (start, end) in shaded:
        axis = "x" if row == 1 else f"x{row}"
        figure.add_shape(
            type="rect", x0=start, x1=end, y0=0, y1=1, xref=axis, yref=f"y{axis[1:]} domain", layer="below",
            fillcolor=colours[name], opacity=0.13, line_width=0,
        )  # fmt: skip


def _force_times(performance: Performance) -> FloatArray:
    """Even samples, and both sides of the events, where a slope breaks."""
    until = performance.flight.release.time
    events = [segment.end for segment in performance.solution.segments if segment.end < until]
    return np.unique(np.concatenate([np.linspace(0.0, until, _POINTS), events]))


def _panels(performance: Performance) -> Iterator[tuple[str, str, dict[str, Quantity]]]:
    solution = performance.solution
    mechanism = solution.problem.mechanism
    forces = {member.body.name: partial(axial_force, solution, member) for member in members(mechanism)}
    yield "Axial forces: tension above zero, compression below (a rope would be slack)", "kN", forces
    upward = {joint.name: partial(upward_force, solution, joint) for joint in supports(mechanism) if carries(joint)}
    yield "Upward force of the ground on the machine: below zero, it would lift off", "kN", upward
    for title, unit, stops in (
        ("Torques of the stops", "kN m", mechanism.angle_stops),
        ("Forces of the stops", "kN", mechanism.point_stops),
    ):
        closed = [stop.name for stop in stops if stop.closed]
        yield title, unit, {name: (lambda t, name=name: solution.motion(t).stop_torques[name]) for name in closed}
