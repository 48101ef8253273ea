"""The page of one throw: the machine in motion, its figures, the flight, forces over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain, cycle

import numpy as np

from ....models.arrays import FloatArray
from ....models.elements import PinJoint, PointStop, Stop
from ....models.library.trebuchet import FULCRUM
from ....models.mechanism import Mechanism
from ....reference.solution import Solution
from ....reference.throw.flight import Flight, Surroundings, fly
from ....reference.throw.members import (
    MemberForce,
    SupportForce,
    axial_force,
    carries,
    members,
    supports,
    upward_force,
)
from ....reference.throw.throw import (
    FlightFigures,
    LaunchFigures,
    Performance,
    Sensitivity,
    Throw,
    origin,
    spoken,
)
from ....version import __version__
from .. import document as doc
from ..document import sentence
from ..drawing.scene import Scene, scene
from ..plots import Axis, Band, Panels, Plot, Rule, Series, Style
from .tables import mechanism_as_data

_POINTS = 600
_PROJECTILE, _BEST, _SOFT = "#D55E00", "#009E73", "#8a97a5"
_COLOURS = (_PROJECTILE, "#0072B2", _BEST, "#CC79A7", "#8C6BB1", "#56B4E9", "#E69F00")


def motion(performance: Performance) -> Scene:
    """The machine up to the release."""
    release, projectile = performance.flight.release, performance.projectile.name
    return scene(
        performance.solution.trajectory, end=release.time, thrown=projectile, launch=release.time
    )


def flight_plot(performance: Performance) -> Panels:
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


def force_plots(performance: Performance) -> Panels:
    """Axial forces, upward forces of the ground and loads of the stops, up to the release."""
    times, colours = _force_times(performance), cycle(_COLOURS)
    rules = tuple(
        Rule(time, f"{name} opens")
        for name, time in performance.solution.release_times.items()
        if time is not None and 0 < time < times[-1]
    )
    drawn: list[Plot] = []
    for title, unit, lines in _panels(performance):
        styles = {name: Style(next(colours), width=2) for name in lines}
        series = [Series(name, times, of(times) / 1e3, styles[name]) for name, of in lines.items()]
        shaded = [each for each in _shaded(performance) if each[0] in lines]
        bands = tuple(Band(*interval, styles[name].colour) for name, interval in shaded)
        axes = Axis("t", "s"), Axis("", unit)
        if series:
            drawn.append(Plot(*axes, tuple(series), title, rules=rules, bands=bands))
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
    """Title, unit and lines of each plot of forces."""
    solution = performance.solution
    mechanism = solution.problem.mechanism
    forces: dict[str, Quantity] = {
        member.body.name: partial(axial_force, solution, member) for member in members(mechanism)
    }
    yield "Axial forces: tension above zero, compression below", "kN", forces
    carriers = filter(carries, supports(mechanism))
    upward: dict[str, Quantity] = {
        joint.name: partial(upward_force, solution, joint) for joint in carriers
    }
    yield "Upward force of the ground: below zero, it would lift off", "kN", upward
    yield "Torques of the stops", "kN m", _loads(solution, mechanism.angle_stops)
    yield "Forces of the stops", "kN", _loads(solution, mechanism.point_stops)


def _loads(solution: Solution, stops: Iterable[Stop | PointStop]) -> dict[str, Quantity]:
    """Torque or force of each stop that is closed at the start."""

    def load(name: str) -> Quantity:
        return lambda t: solution.motion(t).stop_torques[name]

    return {stop.name: load(stop.name) for stop in stops if stop.closed}


_Row = tuple[str, str]
_FORCES = (
    "Up to the release; shaded where a member is in compression (a rope would be slack) or wheels "
    "would lift off."
)


def document(performance: Performance, throw: Throw) -> doc.Document:
    """All values, warnings and pictures; `throw` may have sensitivities."""
    name, start = throw.mechanism.name, origin_name(throw.mechanism)
    blocks: list[doc.Block] = [
        *_first_screen(performance, throw),
        doc.Note(
            f"Computed by the Lagrangian reference. Positions are measured from where the {start} "
            "stands at the start; SI units."
        ),
    ]
    for warning in throw.warnings:
        blocks.append(doc.Text(sentence(warning), "warning", medium="page"))
    blocks.append(doc.table("|", _rows(throw), f"{name}: one throw, {_conditions(throw)}"))
    plots = force_plots(performance)
    if plots:
        blocks.append(doc.Figure(plots, "Forces", _FORCES, "forces", columns=2))
    blocks += [
        doc.table(_columns(throw), throw.sensitivities, _DERIVATIVES),
        doc.Note(f"trebucheck {__version__}."),
        mechanism_as_data(name, throw.mechanism),
    ]
    for warning in throw.warnings:
        blocks.append(doc.Text(f"{warning}.", "warning", lead="warning:", medium="terminal"))
    question = f"How far does {name} throw, and what must its members bear?"
    window = f"trebucheck throw: {name}"
    return doc.Document(question, tuple(blocks), window, verdict=_verdict(throw))


def _verdict(throw: Throw) -> str:
    at = f"released at {throw.launch.time:.6g} s with {throw.launch.speed:.6g} m/s"
    return f"{throw.mechanism.name}: {throw.flight.range:.6g} m, {at}"


def _first_screen(performance: Performance, throw: Throw) -> Iterator[doc.Block]:
    """How far it throws, the machine in motion, and the flight."""
    launch, flight, longest = throw.launch, throw.flight, throw.best_flight
    angle = f"at {math.degrees(launch.angle):.2f} deg"
    tiles = [
        doc.Tile(f"{flight.range:.2f} m", "range", detail=f"{flight.time:.2f} s of flight"),
        doc.Tile(f"{launch.speed:.3f} m/s", "launch speed", detail=angle),
        doc.Tile(f"{launch.time:.5f} s", "release"),
    ]
    if longest is not None and longest.range > flight.range:
        tiles.append(doc.Tile(f"{longest.range:.2f} m", "longest range"))
    yield doc.Text(f"{_verdict(throw)}; {_conditions(throw)}.", "strong", medium="page")
    yield doc.Tiles(tuple(tiles))
    yield doc.AnimationBlock(lambda: (motion(performance),))
    yield doc.Figure(flight_plot(performance), "The flight", anchor="flight")


def _conditions(throw: Throw) -> str:
    gravity = f"g = {throw.gravity:g} m/s²"
    if throw.height == 0:
        return gravity
    return f"{gravity}, landing {throw.height:g} m above the {origin_name(throw.mechanism)}"


def origin_name(mechanism: Mechanism) -> str:
    """Origin of positions: the pin, or what a slot of another name guides."""
    joint = origin(mechanism)
    if not isinstance(joint, PinJoint) and joint.name != FULCRUM:
        for marker in mechanism.markers:
            if (marker.body, marker.point) == (joint.child, joint.child_point):
                return marker.name
    return joint.name


def _rows(throw: Throw) -> Iterator[doc.Row]:
    """All values in groups, each under its title."""
    density, area = throw.air.density, throw.air.drag_area
    drag = f"density {density:g} kg/m³, drag area {area:g} m²" if density * area else "no drag"
    forces = chain(*map(_member_rows, throw.members), *map(_support_rows, throw.supports))
    groups = (
        (f"Release ({throw.released})", _launch_rows(throw.launch)),
        ("Stops", _stop_rows(throw)),
        (f"Flight ({drag})", _flight_rows(throw.flight, origin_name(throw.mechanism))),
        ("Longest range", _best_rows(throw)),
        ("Forces up to the release", forces),
    )
    for title, values in groups:
        rows = [doc.row(f"  {name}", value) for name, value in values]
        if rows:
            yield doc.row(doc.Cell(title, "strong"), "")
            yield from rows


def _launch_rows(launch: LaunchFigures) -> Iterator[_Row]:
    yield "time", f"{launch.time:.9f} s"
    yield "speed", f"{launch.speed:.6f} m/s"
    yield "angle of the velocity", f"{math.degrees(launch.angle):.4f} deg"
    yield "position x, y", f"{launch.x:.4f}, {launch.y:.4f} m"
    yield from _sling_rows(launch)
    if launch.kinetic_energy is not None:
        yield "projectile's kinetic energy", f"{launch.kinetic_energy / 1e3:.4f} kJ"
    if launch.energy_ratio is not None:
        yield "R = kinetic / total energy", f"{launch.energy_ratio:.6f}"


def _sling_rows(launch: LaunchFigures) -> Iterator[_Row]:
    if launch.sling_angle is not None:
        yield "sling to arm", f"{math.degrees(launch.sling_angle):.4f} deg"


def _stop_rows(throw: Throw) -> Iterator[_Row]:
    for rest in throw.rests:
        time, stop = rest.release_time, throw.mechanism.stop(rest.name)
        yield f"{rest.name} opens", "not before the release" if time is None else f"{time:.9f} s"
        yield f"{rest.name}, {stop.effort} at start", f"{rest.start_torque:.4f} {stop.force_unit}"


def _flight_rows(flight: FlightFigures, measured_from: str) -> Iterator[_Row]:
    yield f"range from the {measured_from}", f"{flight.range:.4f} m"
    yield f"apex above the {measured_from}", f"{flight.apex_height:.4f} m"
    yield "time of flight", f"{flight.time:.4f} s"
    yield "impact speed", f"{flight.impact_speed:.4f} m/s"
    yield "impact angle below level", f"{math.degrees(flight.impact_angle):.4f} deg"


def _best_rows(throw: Throw) -> Iterator[_Row]:
    launch, flight = throw.best_launch, throw.best_flight
    if launch is None or flight is None:
        yield "best release", "none reaches the landing height"
        return
    yield "release at", f"{launch.time:.9f} s"
    yield "angle, speed", f"{math.degrees(launch.angle):.4f} deg, {launch.speed:.4f} m/s"
    yield from _sling_rows(launch)
    yield "range", f"{flight.range:.4f} m"
    yield "gain over this release", f"{throw.gain:.4f} m"


def _member_rows(member: MemberForce) -> Iterator[_Row]:
    name = member.name if member.two_force else f"{member.name} (at {member.joint})"
    yield f"{name}, largest tension", _force_at(member.peak_tension, member.peak_tension_time)
    if member.compressed:
        peak = _force_at(member.peak_compression, member.peak_compression_time)
        yield f"{name}, largest compression", peak
        yield f"{name}, in compression", spoken(member.compressed)


def _support_rows(support: SupportForce) -> Iterator[_Row]:
    direction = f"{round(math.degrees(support.peak_direction), 2) + 0.0:.2f} deg"  # no -0.00
    peak = _force_at(support.peak, support.peak_time)
    yield f"{support.joint}, largest force", f"{peak}, towards {direction}"
    if support.least is not None and support.least_time is not None:
        part = "least force on the wheels" if support.rolls else "least upward force"
        yield f"{support.joint}, {part}", _force_at(support.least, support.least_time)
    if support.pulls_down:
        what = "wheels would lift off" if support.rolls else "pulled down by the ground"
        yield f"{support.joint}, {what}", spoken(support.pulls_down)


def _force_at(force: float, time: float) -> str:
    return f"{force / 1e3 + 0.0:.3f} kN at {time:.4f} s"


def _signed(derivative: float | None, by: float | None, value: float) -> str:
    if derivative is None or by is None:
        return "–"
    rounding = abs(derivative) * max(1.0, abs(value)) < 1e-8  # of a derivative that is zero
    return "0" if rounding else f"{derivative * by:+.4g}"


_DERIVATIVES = (
    "Sensitivities of the release, flight without drag: exact derivatives, event times included. "
    "What chose the release is held, its angle or its time; with a number the start changes by the "
    "least that keeps loops and rests closed"
)


def _columns(throw: Throw) -> tuple[doc.Column, ...]:
    """Per unit and per cent; without what the release holds.

    What a narrow terminal leaves out first has the highest rank.
    """
    figures: tuple[tuple[str, str, int, Callable[[Sensitivity], float | None]], ...] = (
        ("time", "s", 3, lambda each: each.launch_time),
        ("speed", "m/s", 2, lambda each: each.launch_speed),
        ("angle", "deg", 4, lambda each: math.degrees(each.launch_angle)),
        ("range", "m", 1, lambda each: each.range),
    )
    per_unit: list[doc.Column] = []
    per_cent: list[doc.Column] = []
    for name, unit, rank, derivative in figures:
        unit_change, percent_change = partial(_effect, derivative), partial(_percent, derivative)
        if any(unit_change(each) not in ("0", "–") for each in throw.sensitivities):
            per_unit.append(doc.Column(name, f"{unit} per unit", rank=rank, of=unit_change))
            per_cent.append(doc.Column(name, f"{unit} per %", rank=rank, of=percent_change))
    return (
        doc.Column("by", of=lambda each: each.name),
        doc.Column("value", of=lambda each: f"{each.value:.6g} {each.unit}"),
        *per_unit,
        *per_cent,
    )


def _effect(derivative: Callable[[Sensitivity], float | None], each: Sensitivity) -> str:
    """Change by one unit of the parameter."""
    return _signed(derivative(each), 1.0, each.value)


def _percent(derivative: Callable[[Sensitivity], float | None], each: Sensitivity) -> str:
    """Change by one per cent of the parameter; a dash where its value is zero."""
    return _signed(derivative(each), each.value / 100 or None, each.value)
