"""One throw as a person reads it: a table in the terminal, and a page with pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.machines.trebuchet import FULCRUM
from ...models.mechanism import Mechanism, PinJoint
from ...reference.throw.throw import FlightFigures, LaunchFigures, Performance, Sensitivity, Throw, origin, spoken

if TYPE_CHECKING:
    from ...reference.throw.members import MemberForce, SupportForce

Row = tuple[str, str]


@dataclass(frozen=True)
class Group:
    """Figures that belong together."""

    title: str
    rows: list[Row]


def groups(throw: Throw) -> list[Group]:
    """All figures of a throw, as the terminal and the page show them."""
    found = [
        Group(f"Release ({throw.released})", list(_launch_rows(throw.launch))),
        Group("Stops", list(_rest_rows(throw))),
        Group(f"Flight ({_air(throw)})", list(_flight_rows(throw.flight, origin_name(throw.mechanism)))),
        Group("Longest range", list(_best_rows(throw))),
        Group("Forces up to the release", list(_force_rows(throw))),
    ]
    return [group for group in found if group.rows]


def origin_name(mechanism: Mechanism) -> str:
    """What places are measured from: the pin, or what a slot of another name guides."""
    joint = origin(mechanism)
    if isinstance(joint, PinJoint) or joint.name == FULCRUM:
        return joint.name
    there = (m.name for m in mechanism.markers if (m.body, m.point) == (joint.child, joint.child_point))
    return next(there, joint.name)


def _air(throw: Throw) -> str:
    if throw.air.density * throw.air.drag_area == 0:
        return "no drag"
    return f"density {throw.air.density:g} kg/m³, drag area {throw.air.drag_area:g} m²"


def _launch_rows(launch: LaunchFigures) -> Iterator[Row]:
    yield "time", f"{launch.time:.9f} s"
    yield "speed", f"{launch.speed:.6f} m/s"
    yield "angle of the velocity", f"{math.degrees(launch.angle):.4f} deg"
    yield "position x, y", f"{launch.x:.4f}, {launch.y:.4f} m"
    yield from _sling_rows(launch)
    if launch.kinetic_energy is not None:
        yield "projectile's kinetic energy", f"{launch.kinetic_energy / 1e3:.4f} kJ"
    if launch.energy_ratio is not None:
        yield "R = kinetic / total energy", f"{launch.energy_ratio:.6f}"


def _sling_rows(launch: LaunchFigures) -> Iterator[Row]:
    if launch.sling_angle is not None:
        yield "sling to arm", f"{math.degrees(launch.sling_angle):.4f} deg"


def _rest_rows(throw: Throw) -> Iterator[Row]:
    for rest in throw.rests:
        opens = "not before the release" if rest.release_time is None else f"{rest.release_time:.9f} s"
        yield f"{rest.name} opens", opens
        stop = throw.mechanism.stop(rest.name)
        yield f"{rest.name}, {stop.effort} at start", f"{rest.start_torque:.4f} {stop.force_unit}"


def _flight_rows(flight: FlightFigures, measured_from: str) -> Iterator[Row]:
    yield f"range from the {measured_from}", f"{flight.range:.4f} m"
    yield f"apex above the {measured_from}", f"{flight.apex_height:.4f} m"
    yield "time of flight", f"{flight.time:.4f} s"
    yield "impact speed", f"{flight.impact_speed:.4f} m/s"
    yield "impact angle below level", f"{math.degrees(flight.impact_angle):.4f} deg"


def _best_rows(throw: Throw) -> Iterator[Row]:
    if throw.best_launch is None or throw.best_flight is None:
        yield "best release", "none reaches the landing height"
        return
    yield "release at", f"{throw.best_launch.time:.9f} s"
    yield "angle, speed", f"{math.degrees(throw.best_launch.angle):.4f} deg, {throw.best_launch.speed:.4f} m/s"
    yield from _sling_rows(throw.best_launch)
    yield "range", f"{throw.best_flight.range:.4f} m"
    yield "gain over this release", f"{throw.gain:.4f} m"


def _force_rows(throw: Throw) -> Iterator[Row]:
    for member in throw.members:
        yield from _member_rows(member)
    for support in throw.supports:
        yield from _support_rows(support)


def _member_rows(member: MemberForce) -> Iterator[Row]:
    name = member.name if member.two_force else f"{member.name} (at {member.joint})"
    yield f"{name}, largest tension", _force_at(member.peak_tension, member.peak_tension_time)
    if member.compressed:
        yield f"{name}, largest compression", _force_at(member.peak_compression, member.peak_compression_time)
        yield f"{name}, in compression", spoken(member.compressed)


def _support_rows(support: SupportForce) -> Iterator[Row]:
    direction = f"{round(math.degrees(support.peak_direction), 2) + 0.0:.2f} deg"  # no -0.00
    yield f"{support.joint}, largest force", f"{_force_at(support.peak, support.peak_time)}, towards {direction}"
    if support.least is not None and support.least_time is not None:
        part = "least force on the wheels" if support.rolls else "least upward force"
        yield f"{support.joint}, {part}", _force_at(support.least, support.least_time)
    if support.pulls_down:
        what = "wheels would lift off" if support.rolls else "pulled down by the ground"
        yield f"{support.joint}, {what}", spoken(support.pulls_down)


def _force_at(force: float, time: float) -> str:
    return f"{force / 1e3 + 0.0:.3f} kN at {time:.4f} s"


def sensitivities_of(name: str, parameters: TrebuchetParameters) -> tuple[Sensitivity, ...]:
    """Derivatives of a named machine's launch at 45 degrees, in vacuum, by all it is made of.

    Raises:
        InputError: there is no such machine, or it does not launch.
    """
    from ...reference.throw.sensitivity import sensitivities

    model(name, parameters)  # refuses an unknown name before long work
    found = sensitivities(lambda p: model(name, p), parameters)
    return tuple(
        Sensitivity(
            name=each,
            value=float(found.values[i]),
            unit=_unit(each),
            launch_time=float(found.d_launch_time[i]),
            launch_speed=float(found.d_launch_speed[i]),
            range=None if math.isnan(found.d_range[i]) else float(found.d_range[i]),
        )
        for i, each in enumerate(found.names)
    )


def _unit(name: str) -> str:
    """Of a parameter, from its own description; of a start speed or start slide, by its name."""
    if name in TrebuchetParameters.model_fields:
        said = re.search(r"\[(.+)\]", TrebuchetParameters.model_fields[name].description or "")
        return said.group(1) if said else ""
    slide = "x_p" in name
    return ("m/s" if slide else "rad/s") if name.startswith("u_") else "m" if slide else "rad"


def sensitivity_rows(throw: Throw) -> list[list[str]]:
    """Name, value, then speed and range per unit and per percent; no percent of a value that is zero."""
    rows: list[list[str]] = []
    for each in throw.sensitivities:
        percent = each.value / 100
        rows.append(
            [
                each.name,
                f"{each.value:.6g} {each.unit}",
                _signed(each.launch_speed),
                _signed(each.range),
                _signed(each.launch_speed * percent) if percent else "–",
                _signed(None if each.range is None else each.range * percent) if percent else "–",
            ]
        )
    return rows


def _signed(value: float | None) -> str:
    if value is None:
        return "–"
    return "0" if abs(value) < 1e-8 else f"{value:+.4g}"  # rounding of a derivative that is zero


SENSITIVITY_HEADINGS = (
    "by",
    "value",
    "speed\n[m/s per unit]",
    "range\n[m per unit]",
    "speed\n[m/s per %]",
    "range\n[m per %]",
)
SENSITIVITY_TITLE = "Sensitivities of the launch at 45 deg, flight without drag"


def print_throw(throw: Throw, to: Console) -> None:
    """The figures, the warnings, and the sensitivities if there are any."""
    table = Table(title=_title(throw), title_justify="left", show_header=False, box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("what", no_wrap=True)
    table.add_column("value", justify="right")
    for group in groups(throw):
        table.add_row(f"[bold]{group.title}[/]", "")
        for what, value in group.rows:
            table.add_row(f"  {what}", value)
    to.print(table)
    if throw.sensitivities:
        to.print(_sensitivity_table(throw))
    for warning in throw.warnings:
        to.print(f"[yellow]warning[/]: {warning}.", soft_wrap=True)


def _title(throw: Throw) -> str:
    where = "" if throw.height == 0 else f", landing {throw.height:g} m above the {origin_name(throw.mechanism)}"
    return f"{throw.mechanism.name}: one throw, g = {throw.gravity:g} m/s²{where}"


def _sensitivity_table(throw: Throw) -> Table:
    table = Table(title=SENSITIVITY_TITLE, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for i, heading in enumerate(SENSITIVITY_HEADINGS):
        table.add_column(heading.replace("[", "\\["), justify="right" if i else "left", no_wrap=True)
    for row in sensitivity_rows(throw):
        table.add_row(*row)
    return table


def throw_html(performance: Performance, throw: Throw) -> str:
    """The page as HTML text, scripts and all; `throw` as the performance's own, with sensitivities if wanted."""
    from jinja2 import Environment, StrictUndefined
    from plotly.offline import get_plotlyjs

    from ...version import __version__
    from ..report.plots import embedded
    from .plots import flight_figure, force_figure, machine_figure

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("trebucheck.comparisons").joinpath("templates/throw.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        throw=throw,
        origin=origin_name(throw.mechanism),
        title=_title(throw),
        groups=groups(throw),
        headings=SENSITIVITY_HEADINGS,
        sensitivity_title=SENSITIVITY_TITLE,
        sensitivities=sensitivity_rows(throw),
        machine=embedded(machine_figure(performance)),
        flight=embedded(flight_figure(performance)),
        forces=embedded(force_figure(performance)),
        plotly=get_plotlyjs(),
        version=__version__,
    )
