"""The page's section on the machines the paper names: what each makes of the energy it has."""

from __future__ import annotations

import math

import plotly.graph_objects as go
from pydantic import JsonValue

from ...comparisons.report.plots import finish
from ..machines.study import MachineEfficiency, Machines, SlingThrow, WidestThrow
from ..results import EngineValue
from .blocks import Block, drawn, table


def machines(data: JsonValue) -> list[Block]:
    """Efficiencies as bars and numbers, then how well each engine follows each machine."""
    found = Machines.model_validate(data)
    text = (
        "Efficiency: the projectile's kinetic energy at 45 degrees over the energy available, which is the potential "
        "energy at the start less the least there is. All have the paper's masses and arm; who wins depends on the "
        f"sling, so each machine also gets its fastest, of {found.slings[0]:g} to {found.slings[1]:g} m, and each kind "
        f"its most efficient machine with {_bounds(found)}."
    )
    return [drawn("Who makes most of its energy", _bars(found), text), _throws(found), _distances(found)]


def _bounds(found: Machines) -> str:
    spans = {name: bounds for name, bounds in found.bounds.items() if name != "theta0"}
    said = ", ".join(f"{name} of {low:g} to {high:g} m" for name, (low, high) in spans.items())
    low, high = (math.degrees(angle) for angle in found.bounds["theta0"])
    return f"{said} and, where the arm begins backward, a start of {low:.0f} to {high:.0f} deg"


def _bars(found: Machines) -> go.Figure:
    names = [machine.name for machine in found.machines]
    best = [(machine.fastest_sling or machine.table_one).efficiency for machine in found.machines]
    figure = go.Figure()
    figure.add_bar(x=names, y=[m.table_one.efficiency for m in found.machines], name="the paper's sling")
    figure.add_bar(x=names, y=best, name="its fastest sling")
    widest = [None if m.most_efficient is None else m.most_efficient.efficiency for m in found.machines]
    figure.add_bar(x=names, y=widest, name="most efficient within bounds")
    figure.update_yaxes(title="efficiency", range=[0, 1], tickformat=".0%")
    return finish(figure, 420)


def _throws(found: Machines) -> Block:
    names = _engines(found)
    rows: list[list[object]] = []
    for machine in found.machines:
        throws = [(machine.table_one, machine.engines), (machine.fastest_sling, ()), (machine.most_efficient, ())]
        rows += [_row(machine, throw, values, names) for throw, values in throws if throw is not None]
    headings = (
        "machine",
        "l1 [m]",
        "start [deg]",
        "sling [m]",
        "available [kJ]",
        "launch [s]",
        "arm there [deg]",
        "speed [m/s]",
        "kinetic energy [kJ]",
        "efficiency",
        *names,
    )
    legend = "; ".join(f"{machine.name}: {machine.text}" for machine in found.machines)
    return table("Throws at 45 degrees", headings, rows, f"{legend}.")


def _row(
    machine: MachineEfficiency, throw: SlingThrow, values: tuple[EngineValue, ...], names: list[str]
) -> list[object]:
    return [
        machine.name,
        *_chosen(throw),
        throw.sling,
        throw.kinetic_energy / throw.efficiency / 1e3,
        throw.launch_time,
        math.degrees(throw.arm_angle),
        throw.speed,
        throw.kinetic_energy / 1e3,
        throw.efficiency,
        *(_value(values, name) for name in names),
    ]


def _chosen(throw: SlingThrow) -> tuple[object, object]:
    """Arm and start, where they are not as given."""
    return (throw.l1, math.degrees(throw.theta0)) if isinstance(throw, WidestThrow) else ("as given", "as given")


def _distances(found: Machines) -> Block:
    names = _engines(found)
    rows = [[machine.name, *(_distance(machine.distances, name) for name in names)] for machine in found.machines]
    text = (
        "Largest distance of any marked point from the reference up to the launch, each engine with its tuned preset "
        "at its own default step; in brackets the agreement bar."
    )
    return table("How well the engines follow [m]", ("machine", *names), rows, text)


def _engines(found: Machines) -> list[str]:
    return list(dict.fromkeys(value.engine for machine in found.machines for value in machine.engines))


def _value(values: tuple[EngineValue, ...], engine: str) -> object:
    found = next((each for each in values if each.engine == engine), None)
    return None if found is None else (found.note if found.value is None else found.value)


def _distance(values: tuple[EngineValue, ...], engine: str) -> str:
    found = next((each for each in values if each.engine == engine), None)
    if found is None or found.value is None:
        return "–" if found is None else found.note or "–"
    return f"{found.value:.1e}" + ("" if found.tolerance is None else f" ({found.tolerance:.0e})")
