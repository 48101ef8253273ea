"""The page of one throw: the machine in motion, its figures, the flight, forces over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ....models.elements import PinJoint
from ....models.library.trebuchet import FULCRUM
from ....models.mechanism import Mechanism
from ....reference.throw.flight import Surroundings, fly
from ....reference.throw.members import axial_force, carries, members, supports, upward_force
from ....reference.throw.throw import Performance, Sensitivity, Throw, origin, spoken
from ....version import __version__
from .. import document as doc
from ..document import sentence
from ..drawing.scene import scene
from ..plots import Axis, Band, Panels, Plot, Rule, Series, Style, distinct_colours
from .tables import mechanism_as_data

_POINTS = 600
_PROJECTILE, _BEST, _SOFT = "#D55E00", "#009E73", "#8a97a5"


def flight_plot(performance: Performance) -> Panels:
    """Plot the flight, that of the best release, and what the air takes."""
    surroundings, flown = performance.surroundings, performance.flight
    flights = [(flown, "flight", Style(_PROJECTILE, width=2.5))]
    if surroundings.drag > 0:
        vacuum = Surroundings(**{**dict(surroundings), "drag": 0.0})
        flights.append((fly(flown.release, vacuum), "without drag", Style(_SOFT, dashed=True)))
    if performance.best is not None and performance.best.range - flown.range > 1e-9:
        flights.append((performance.best, "best release", Style(_BEST, dashed=True)))
    series: list[Series] = []
    for flight, name, style in flights:
        x, y = flight.path(300).T
        series.append(Series(f"{name} ({flight.range:.1f} m)", x, y, style))
    ground = Rule(surroundings.ground, across="y")
    return (Plot(Axis("x", "m"), Axis("y", "m"), tuple(series), rules=(ground,), equal=True),)


def force_plots(performance: Performance) -> Panels:
    """Axial forces, upward forces of the ground and loads of the stops, up to the release."""
    solution, throw, colours = performance.solution, performance.throw, distinct_colours()
    mechanism, until = solution.problem.mechanism, performance.flight.release.time
    # Even samples, and both sides of the events, where a slope breaks.
    events = [segment.end for segment in solution.segments if segment.end < until]
    times = np.unique(np.concatenate([np.linspace(0.0, until, _POINTS), events]))
    axial = {each.body.name: axial_force(solution, each, times) for each in members(mechanism)}
    carrying = (joint for joint in supports(mechanism) if carries(joint))
    upward = {joint.name: upward_force(solution, joint, times) for joint in carrying}
    loads = solution.motion(times).stop_torques
    torques = {stop.name: loads[stop.name] for stop in mechanism.angle_stops if stop.closed}
    forces = {stop.name: loads[stop.name] for stop in mechanism.point_stops if stop.closed}
    panels = (
        ("Axial forces: tension above zero, compression below", "kN", axial),
        ("Upward force of the ground: below zero, it would lift off", "kN", upward),
        ("Torques of the stops", "kN m", torques),
        ("Forces of the stops", "kN", forces),
    )
    # Shaded are intervals in which a member is compressed or wheels would lift off.
    shaded = [(member.name, interval) for member in throw.members for interval in member.compressed]
    shaded += [(part.joint, interval) for part in throw.supports for interval in part.pulls_down]
    rules = tuple(
        Rule(time, f"{name} opens")
        for name, time in solution.release_times.items()
        if time is not None and 0 < time < times[-1]
    )
    drawn: list[Plot] = []
    for title, unit, lines in panels:
        series: dict[str, Series] = {}
        for name, values in lines.items():
            series[name] = Series(name, times, values / 1e3, Style(next(colours), width=2))
        bands: list[Band] = []
        for name, interval in shaded:
            if name in series:
                bands.append(Band(*interval, series[name].style.colour))
        if series:
            axes = Axis("t", "s"), Axis("", unit)
            curves, shown = tuple(series.values()), tuple(bands)
            drawn.append(Plot(*axes, curves, title, rules=rules, bands=shown))
    return tuple(drawn)


_FORCES = (
    "Up to the release; shaded where a member is in compression (a rope would be slack) or wheels "
    "would lift off."
)
_DERIVATIVES = (
    "Sensitivities of the release, flight without drag: exact derivatives, event times included. "
    "What chose the release is held, its angle or its time; with a number the start changes by the "
    "least that keeps loops and rests closed"
)


def document(performance: Performance, throw: Throw) -> doc.Document:
    """Values, warnings and pictures; `throw` may have sensitivities."""
    name, start = throw.mechanism.name, _origin_name(throw.mechanism)
    launch, flight, longest = throw.launch, throw.flight, throw.best_flight
    at = f"released at {launch.time:.6g} s with {launch.speed:.6g} m/s"
    verdict = f"{name}: {flight.range:.6g} m, {at}"
    conditions = f"g = {throw.gravity:g} m/s²"
    if throw.height != 0:
        conditions += f", landing {throw.height:g} m above the {start}"
    tiles = [
        doc.Tile(f"{flight.range:.2f} m", "range", detail=f"{flight.time:.2f} s of flight"),
        doc.Tile(f"{launch.speed:.3f} m/s", "launch speed", detail=f"at {_deg(launch.angle, 2)}"),
        doc.Tile(f"{launch.time:.5f} s", "release"),
    ]
    if longest is not None and longest.range > flight.range:
        tiles.append(doc.Tile(f"{longest.range:.2f} m", "longest range"))
    trajectory, projectile = performance.solution.trajectory, performance.projectile.name
    until = performance.flight.release.time
    shown = partial(scene, trajectory, end=until, thrown=projectile, launch=until)
    blocks: list[doc.Block] = [
        doc.Text(f"{verdict}; {conditions}.", "strong", medium="page"),
        doc.Tiles(tuple(tiles)),
        doc.AnimationBlock(lambda: (shown(),)),
        doc.Figure(flight_plot(performance), "The flight", anchor="flight"),
        doc.Note(
            f"Computed by the Lagrangian reference. Positions are measured from where the {start} "
            "stands at the start; SI units."
        ),
    ]
    for warning in throw.warnings:
        blocks.append(doc.Text(sentence(warning), "warning", medium="page"))
    rows: list[doc.Row] = []
    for title, values in _groups(throw):
        group = [doc.row(f"  {quantity}", value) for quantity, value in values]
        if group:
            rows += [doc.row(doc.Cell(title, "strong"), ""), *group]
    blocks.append(doc.table("|", rows, f"{name}: one throw, {conditions}"))
    plots = force_plots(performance)
    if plots:
        blocks.append(doc.Figure(plots, "Forces", _FORCES, "forces", columns=2))
    blocks += [
        doc.table(_sensitivity_columns(throw), throw.sensitivities, _DERIVATIVES),
        doc.Note(f"trebucheck {__version__}."),
        mechanism_as_data(name, throw.mechanism),
    ]
    for warning in throw.warnings:
        blocks.append(doc.Text(f"{warning}.", "warning", lead="warning:", medium="terminal"))
    question = f"How far does {name} throw, and what must its members bear?"
    return doc.Document(question, tuple(blocks), f"trebucheck throw: {name}", verdict=verdict)


def _origin_name(mechanism: Mechanism) -> str:
    """Origin of positions: the pin, or what a slot of another name guides."""
    joint = origin(mechanism)
    if not isinstance(joint, PinJoint) and joint.name != FULCRUM:
        for marker in mechanism.markers:
            if (marker.body, marker.point) == (joint.child, joint.child_point):
                return marker.name
    return joint.name


# --- Values


def _deg(angle: float, digits: int = 4) -> str:
    return f"{math.degrees(angle):.{digits}f} deg"


def _force(force: float, time: float) -> str:
    return f"{force / 1e3 + 0.0:.3f} kN at {time:.4f} s"  # no -0.000


def _groups(throw: Throw) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Values in groups, each with its title."""
    launch, flight, start = throw.launch, throw.flight, _origin_name(throw.mechanism)
    rows = [
        ("time", f"{launch.time:.9f} s"),
        ("speed", f"{launch.speed:.6f} m/s"),
        ("angle of the velocity", _deg(launch.angle)),
        ("position x, y", f"{launch.x:.4f}, {launch.y:.4f} m"),
    ]
    if launch.sling_angle is not None:
        rows.append(("sling to arm", _deg(launch.sling_angle)))
    if launch.kinetic_energy is not None:
        rows.append(("projectile's kinetic energy", f"{launch.kinetic_energy / 1e3:.4f} kJ"))
    if launch.energy_ratio is not None:
        rows.append(("R = kinetic / total energy", f"{launch.energy_ratio:.6f}"))
    yield f"Release ({throw.released})", rows
    rows = []
    for rest in throw.rests:
        time, stop = rest.release_time, throw.mechanism.stop(rest.name)
        opens = "not before the release" if time is None else f"{time:.9f} s"
        torque = f"{rest.start_torque:.4f} {stop.force_unit}"
        rows += [(f"{rest.name} opens", opens), (f"{rest.name}, {stop.effort} at start", torque)]
    yield "Stops", rows
    density, area = throw.air.density, throw.air.drag_area
    drag = f"density {density:g} kg/m³, drag area {area:g} m²" if density * area else "no drag"
    rows = [
        (f"range from the {start}", f"{flight.range:.4f} m"),
        (f"apex above the {start}", f"{flight.apex_height:.4f} m"),
        ("time of flight", f"{flight.time:.4f} s"),
        ("impact speed", f"{flight.impact_speed:.4f} m/s"),
        ("impact angle below level", _deg(flight.impact_angle)),
    ]
    yield f"Flight ({drag})", rows
    launch, flight = throw.best_launch, throw.best_flight
    rows = [("best release", "none reaches the landing height")]
    if launch is not None and flight is not None:
        velocity = f"{_deg(launch.angle)}, {launch.speed:.4f} m/s"
        rows = [("release at", f"{launch.time:.9f} s"), ("angle, speed", velocity)]
        if launch.sling_angle is not None:
            rows.append(("sling to arm", _deg(launch.sling_angle)))
        rows.append(("range", f"{flight.range:.4f} m"))
        rows.append(("gain over this release", f"{throw.gain:.4f} m"))
    yield "Longest range", rows
    rows = []
    for member in throw.members:
        name = member.name if member.two_force else f"{member.name} (at {member.joint})"
        tension = _force(member.peak_tension, member.peak_tension_time)
        rows.append((f"{name}, largest tension", tension))
        if member.compressed:
            peak = _force(member.peak_compression, member.peak_compression_time)
            rows.append((f"{name}, largest compression", peak))
            rows.append((f"{name}, in compression", spoken(member.compressed)))
    for support in throw.supports:
        name = support.joint
        direction = f"{round(math.degrees(support.peak_direction), 2) + 0.0:.2f} deg"  # no -0.00
        peak = _force(support.peak, support.peak_time)
        rows.append((f"{name}, largest force", f"{peak}, towards {direction}"))
        if support.least is not None and support.least_time is not None:
            part = "least force on the wheels" if support.rolls else "least upward force"
            rows.append((f"{name}, {part}", _force(support.least, support.least_time)))
        if support.pulls_down:
            what = "wheels would lift off" if support.rolls else "pulled down by the ground"
            rows.append((f"{name}, {what}", spoken(support.pulls_down)))
    yield "Forces up to the release", rows


def _sensitivity_columns(throw: Throw) -> tuple[doc.Column, ...]:
    """Per unit and per cent; without what the release holds.

    What a narrow terminal leaves out first has the highest rank.
    """

    def change(by: Sensitivity, derivative: _Derivative, per: str) -> str:
        """Change by one unit of the parameter, or by one per cent; a dash for 1 % of zero."""
        slope, step = derivative(by), 1.0 if per == "unit" else by.value / 100
        if slope is None or not step:
            return "–"
        rounding = abs(slope) * max(1.0, abs(by.value)) < 1e-8  # of a derivative that is zero
        return "0" if rounding else f"{slope * step:+.4g}"

    figures: tuple[tuple[str, str, int, _Derivative], ...] = (
        ("time", "s", 3, lambda by: by.launch_time),
        ("speed", "m/s", 2, lambda by: by.launch_speed),
        ("angle", "deg", 4, lambda by: math.degrees(by.launch_angle)),
        ("range", "m", 1, lambda by: by.range),
    )
    heads = [
        doc.Column("by", of=lambda each: each.name),
        doc.Column("value", of=lambda each: f"{each.value:.6g} {each.unit}"),
    ]
    for per in ("unit", "%"):
        for name, unit, rank, derivative in figures:
            changes = (change(by, derivative, "unit") for by in throw.sensitivities)
            if not set(changes) <= {"0", "–"}:
                of = partial(change, derivative=derivative, per=per)
                heads.append(doc.Column(name, f"{unit} per {per}", rank=rank, of=of))
    return tuple(heads)


_Derivative = Callable[[Sensitivity], float | None]
