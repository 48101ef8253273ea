"""The further studies as chapters of the document."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import JsonValue
from trebucheck.api.reports import Block, Figure, Heading, Text, sentence, table

from .design.efficiency import MachineEfficiency, Machines, SlingThrow, WidestThrow
from .design.first_forward_swing import CoincidingDesign, Design, Throwing
from .drag.motion import DragInterval
from .drag.study import DragStudy
from .evidence.claims import EngineValue
from .identification.quantities import Identification
from .plots import best_angles, efficiencies
from .sweep.study import Artefact, Sweep


def chapters(sections: Mapping[str, JsonValue]) -> Iterator[Block]:
    """Chapters of the studies; a failed study states why, one without a chapter is named."""
    for name in dict.fromkeys([*_CHAPTERS, *sections]):
        if name not in sections:
            continue
        title, show = _CHAPTERS.get(name, (name.capitalize(), _as_data))
        yield Heading(title, 2, name)
        data = sections[name]
        if isinstance(data, dict) and "failed" in data:
            yield Text(f"This study failed: {data['failed']}", "warning", medium="page")
            continue
        try:
            yield from [*show(data)]
        except Exception as error:  # an error in one chapter must not prevent the page
            why = f"This study cannot be shown: {type(error).__name__}: {error}"
            yield Text(why, "warning", medium="page")


def _as_data(data: JsonValue) -> Iterator[Block]:
    yield Text("Its values are in paper.json.", medium="page")


Values = dict[str, Callable[[Any], object]]
"""Columns of a table: heading, and value of the object of a row."""


def _section(
    title: str, columns: Values | Sequence[str], rows: Iterable[object], texts: Sequence[str] = ()
) -> Iterator[Block]:
    """A table under its title, with texts; rows are values where the columns are mere headings."""
    yield Heading(title)
    for text in texts:
        yield Text(text, medium="page")
    if isinstance(columns, dict):
        rows = [tuple(value(each) for value in columns.values()) for each in rows]
    yield table(list(columns), rows, medium="page")


def _findings(texts: Sequence[str]) -> Iterator[Block]:
    for text in texts:
        yield Text(sentence(text), medium="page")


def _engines(values: Sequence[EngineValue]) -> list[str]:
    return list(dict.fromkeys(value.engine for value in values))


def _engine_value(
    values: Sequence[EngineValue], engine: str, form: str = ".6g", tolerance: str = ""
) -> str:
    """An engine's value, or why there is none; with its tolerance where it has a format."""
    entry = next((each for each in values if each.engine == engine), None)
    if entry is None or entry.value is None:
        return "–" if entry is None else entry.note or "–"
    beside = (
        "" if not tolerance or entry.tolerance is None else f" (± {entry.tolerance:{tolerance}})"
    )
    return f"{entry.value:{form}}{beside}"


def _by_engine(names: Sequence[str]) -> Values:
    """A column for each engine's value of what has one."""
    return {name: lambda each, name=name: _engine_value(each.engines, name) for name in names}


def _degrees(*angles: float) -> str:
    return ", ".join(f"{math.degrees(angle):.4f}" for angle in angles)


def _identification(data: JsonValue) -> Iterator[Block]:
    """Fits, what determines them, and what singles one start out."""
    identification = Identification.model_validate(data)
    yield from _findings(identification.findings)
    yield from _fits(identification)
    yield from _sensitivities(identification)
    extents = [
        (e.angle, _degrees(e.low), ", ".join(e.ends_low), _degrees(e.high), ", ".join(e.ends_high))
        for e in identification.fit.extents
    ]
    headings = ("angle", "from [deg]", "ended by", "to [deg]", "ended by")
    yield from _section("Start angles compatible with every printed digit", headings, extents)
    search = identification.search
    if search is not None:
        rows = [
            (_degrees(*each.angles), each.worst, each.miss, each.starts)
            for each in search.solutions[:8]
        ]
        headings = ("θ, φ, α [deg]", "misses most", "by [half widths]", "starts that led there")
        text = f"{search.machines} machines looked at, {search.starts} minima refined."
        yield from _section("Search for other starts", headings, rows, [text])


_FITS: Values = {
    "fit": lambda fit: fit.name,
    "θ, φ, α at the start [deg]": lambda fit: _degrees(*fit.angles),
    "free": lambda fit: ", ".join(fit.free),
    "standard errors [deg]": lambda fit: _degrees(*fit.standard_errors),
    "χ²": lambda fit: fit.chi_square,
    "degrees": lambda fit: fit.degrees_of_freedom,
    "p": lambda fit: fit.p_value,
    "all digits met": lambda fit: fit.compatible,
}


def _fits(identification: Identification) -> Iterator[Block]:
    yield from _section("Fits", _FITS, (identification.fit, *identification.nested))
    at = {each.name: (each.computed, each.miss) for each in identification.fit.figures}
    numbers: Values = {
        "number": lambda each: each.name,
        "where": lambda each: each.where,
        "printed": lambda each: f"{each.printed} {each.unit}".strip(),
        "at the fit": lambda each: at[each.name][0],
        "off by [half widths]": lambda each: at[each.name][1],
        "used as": lambda each: "fitted" if each.fitted else "bound",
        "half width": lambda each: each.because,
    }
    yield from _section("Printed numbers", numbers, identification.printed)


def _sensitivities(identification: Identification) -> Iterator[Block]:
    rows = [
        (each.name, *each.per_radian, *(f"{share:.0%}" for share in each.information))
        for each in identification.sensitivities
    ]
    headings = ("number", "by θ [per rad]", "by φ", "by α", "tells θ", "tells φ", "tells α")
    c = identification.conditioning
    text = (
        f"Rank {c.rank} of 3, condition number {c.condition_number:.3g}; the joint 95 % region "
        f"reaches {_degrees(*c.half_lengths)} deg along its axes, the best determined first."
    )
    yield from _section("Which number determines which angle", headings, rows, [text])


def _drag(data: JsonValue) -> Iterator[Block]:
    """Table II under each reading."""
    study = DragStudy.model_validate(data)
    yield from _findings(study.findings)
    yield from _readings(study)
    yield Figure(best_angles(study), "Best angle against drag area")


def _area(interval: DragInterval | None) -> str:
    if interval is None:
        return "none"
    return (
        f"{interval.low:.4g} on"
        if interval.high is None
        else f"{interval.low:.4g} to {interval.high:.4g}"
    )


_READING: Values = {
    "angle printed is": lambda r: r.angle.value,
    "g changed": lambda r: r.gravity.value,
    "best common C_d A [m²]": lambda r: r.common_drag_area,
    "misses by (rms) [deg]": lambda r: math.degrees(r.root_mean_square),
    "C_d A giving all [m²]": lambda r: _area(r.shared),
    "worlds met": lambda r: sum(fit.agrees for fit in r.worlds),
    "worlds met on a grid": lambda r: max((len(grid.agreeing) for grid in r.grids), default=0),
}


def _readings(study: DragStudy) -> Iterator[Block]:
    yield from _section("Readings of Table II", _READING, study.readings)
    printed = {each.world: f"{each.printed}°" for each in study.printed}
    fits: Values = {
        "world": lambda pair: pair[1].world,
        "printed": lambda pair: printed[pair[1].world],
        "angle printed is": lambda pair: pair[0].angle.value,
        "g changed": lambda pair: pair[0].gravity.value,
        "in vacuum [deg]": lambda pair: math.degrees(pair[1].vacuum_angle),
        "C_d A that gives it [m²]": lambda pair: _area(pair[1].drag_areas),
        "with the common one [deg]": lambda pair: math.degrees(pair[1].common_angle),
        "agrees": lambda pair: pair[1].agrees,
    }
    yield from _section(
        "World by world", fits, [(r, fit) for r in study.readings for fit in r.worlds]
    )


_POSITION: Values = {
    "l1 [m]": lambda position: f"{position.l1:.7g}",
    "l1 : l2": lambda position: f"{position.lever_ratio:.4g}",
    "torque on the arm [N m]": lambda position: position.arm_torque,
    "hanger's rest [N m]": lambda position: position.rest_torques.get("hanger rest"),
    "furthest back [rad]": lambda position: position.furthest_back,
    "speed [m/s]": lambda position: position.speed and position.speed.value,
    "rests that may pull [m/s]": lambda position: position.bilateral_speed,
}


def _sweep(data: JsonValue) -> Iterator[Block]:
    """Peak, thresholds, what happens where on the beam."""
    sweep = Sweep.model_validate(data)
    text = f"Swept from l1 = {sweep.start:g} to {sweep.end:g} m, l1 + l2 = {sweep.beam:g} m."
    yield from _section(
        "What the curve shows", ("", ""), [*_curve_facts(sweep), *_regime_facts(sweep)], [text]
    )
    ends = (sweep.regime.below, sweep.regime.above)
    positions = [*sweep.positions, *(position for position in ends if position is not None)]
    names = _engines([each for position in sweep.positions for each in position.engines])
    ordered = sorted(positions, key=lambda position: position.l1)
    yield from _section("Place by place", _POSITION | _by_engine(names), ordered)
    yield from _root_searches(sweep.artefact)


def _curve_facts(s: Sweep) -> Iterator[tuple[str, str]]:
    peak, near, trend = s.peak, s.suspect, s.trend
    speed = f"{peak.speed.value:.8g} m/s at l1 = {peak.l1.value:.8g} m ({peak.lever_ratio:.4g}:1)"
    yield "largest launch speed", speed
    backward = "nowhere" if s.backward.l1 is None else f"l1 = {s.backward.l1:.8g} m"
    yield "gravity turns the arm backward below", backward
    yield "least torque of gravity over the sweep", f"{s.backward.least_torque:.6g} N m, forward"
    yield (
        f"speed at l1 = {near.l1:g} m",
        f"{near.speed:.8g} m/s; by its neighbours {near.from_neighbours:.8g}",
    )
    yield (
        "second difference there",
        f"{near.second_difference:.6g}; of the curve {near.second_derivative:.6g}",
    )
    slope = f"{trend.slope:.5g} m/s per m, R² {trend.determination:.5f}"
    yield f"slope from {trend.start:.4g} to {trend.end:.4g} m", slope


def _regime_facts(s: Sweep) -> Iterator[tuple[str, str]]:
    regime = s.regime
    if regime.l1 is not None:
        change = f"l1 = {regime.l1.value:.9g} m; by root finding {regime.root:.9g} m"
        yield "a rest would have to pull beyond", change
        yield (
            "there the arm asks of the hanger",
            f"{regime.needed:.6g} m/s², gravity gives {regime.available:.6g}",
        )
    if regime.swing is not None:
        zeros = ", ".join(f"{zero:.4g} s" for zero in regime.swing.zeros) or "none"
        yield "just above, both held: torque's zeros in a period", zeros


_SEARCH: Values = {
    "guess [s]": lambda search: search.guess,
    "first zero found from l1 = [m]": lambda search: search.lowest,
    "later zero at (places)": lambda search: search.later_zero,
    "none at (places)": lambda search: search.no_zero,
    "misses at l1 = [m]": lambda search: ", ".join(f"{l1:g}" for l1 in search.fails_at) or "none",
}


def _root_searches(artefact: Artefact) -> Iterator[Block]:
    guess = artefact.matching_guess
    texts = ["Nothing of the paper's program is published: this can only be compatible with it."]
    if guess is not None:
        texts.insert(
            0,
            f"A guess of {guess:.4g} s would begin to fail just at l1 = {artefact.threshold:g} m.",
        )
    yield from _section(
        "Could a root search make the paper's threshold?", _SEARCH, artefact.searches, texts
    )


def _design(data: JsonValue) -> Iterator[Block]:
    """Rolling machines whose peak comes at their best release, beside the paper's."""
    design = Design.model_validate(data)
    yield from _designs(design)
    for each in design.designs:
        if each.engines:
            yield from _confirmed(each)
    notes = [f"{each.name}: {'; '.join(each.warnings)}" for each in design.designs if each.warnings]
    if notes:
        yield Heading("What a builder should know")
        yield from _findings(notes)


_DESIGN: Values = {
    "machine": lambda named: named[0],
    "r, h, l1 [m]": lambda named: "{0.r:.5g}, {0.h:.5g}, {0.l1:.5g}".format(named[1].parameters),
    "l1 : l2": lambda named: f"{named[1].lever_ratio:.4g}",
    "best release [s]": lambda named: named[1].best_time,
    "fastest later by [s]": lambda named: f"{named[1].gap:.3g}",
    "angle [deg]": lambda named: math.degrees(named[1].angle),
    "speed [m/s]": lambda named: named[1].speed,
    "range [m]": lambda named: named[1].range,
    "R": lambda named: named[1].ratio,
    "efficiency": lambda named: named[1].efficiency,
}
"""Columns of the designs' table, computed from a machine's name and its throw."""


def _designs(design: Design) -> Iterator[Block]:
    named: list[tuple[str, Throwing | None]] = [
        ("the paper's, fixed", design.paper_fixed),
        ("the paper's, rolling", design.paper_rolling),
        *((f"{each.name} ({each.reading.value})", each.throwing) for each in design.designs),
        ("largest range of all", design.unconstrained),
    ]
    r, h, l1 = (
        f"{low:g} to {high:g}" for low, high in (design.bounds.r, design.bounds.h, design.bounds.l1)
    )
    text = (
        f"Chosen within r {r}, h {h}, l1 {l1} m, masses and l1 + l2 kept. Asked besides: "
        f"{'; '.join(design.constraints)}."
    )
    active = "; ".join(
        f"{d.name} stands on {', '.join(d.optimality.active) or 'no bound'}" for d in design.designs
    )
    texts = [text, f"{active}."] if active else [text]
    yield from _section(
        "Designs", _DESIGN, [(name, each) for name, each in named if each is not None], texts
    )


def _confirmed(each: CoincidingDesign) -> Iterator[Block]:
    names = _engines([value for values in each.engines.values() for value in values])
    rows = [
        (quantity, *(_engine_value(values, name, ".9g", ".1g") for name in names))
        for quantity, values in each.engines.items()
    ]
    yield from _section(f"{each.name}, by engines", ("quantity (SI units)", *names), rows)


def _machines(data: JsonValue) -> Iterator[Block]:
    """Share of its energy that each machine named by the paper gives to the projectile."""
    machines = Machines.model_validate(data)
    text = (
        "Efficiency: the projectile's kinetic energy at 45 degrees over the energy available, "
        "which is the potential energy at the start less the least there is. All have the paper's "
        "masses and arm; who wins depends on the sling, so each machine also gets its fastest, of "
        f"{machines.slings[0]:g} to {machines.slings[1]:g} m, and each kind its most efficient "
        f"machine with {_bounds(machines)}."
    )
    yield Figure(efficiencies(machines), "Who makes most of its energy", text)
    names = _engines([value for machine in machines.machines for value in machine.engines])
    yield from _throws(machines, names)
    rows = [
        (machine.name, *(_engine_value(machine.distances, name, ".1e", ".0e") for name in names))
        for machine in machines.machines
    ]
    text = (
        "Largest distance of any marked point from the reference up to the launch, each engine "
        "with its assisted preset at its own default step; in brackets the agreement tolerance."
    )
    yield from _section("How well the engines follow [m]", ("machine", *names), rows, [text])


def _bounds(machines: Machines) -> str:
    spans = [
        f"{name} of {low:g} to {high:g} m"
        for name, (low, high) in machines.bounds.items()
        if name != "theta0"
    ]
    low, high = (math.degrees(angle) for angle in machines.bounds["theta0"])
    return (
        f"{', '.join(spans)} and, where the arm begins backward, a start of {low:.0f} to "
        f"{high:.0f} deg"
    )


def _throws(machines: Machines, names: Sequence[str]) -> Iterator[Block]:
    rows: list[tuple[object, ...]] = []
    for machine in machines.machines:
        throws = [
            (machine.table_one, machine.engines),
            (machine.fastest_sling, ()),
            (machine.most_efficient, ()),
        ]
        rows += [
            _throw(machine, throw, values, names) for throw, values in throws if throw is not None
        ]
    chosen = ("l1 [m]", "start [deg]", "sling [m]", "available [kJ]", "launch [s]")
    reached = ("arm there [deg]", "speed [m/s]", "kinetic energy [kJ]", "efficiency")
    legend = "; ".join(f"{machine.name}: {machine.text}" for machine in machines.machines)
    yield from _section(
        "Throws at 45 degrees", ("machine", *chosen, *reached, *names), rows, [f"{legend}."]
    )


def _throw(
    machine: MachineEfficiency,
    throw: SlingThrow,
    values: Sequence[EngineValue],
    names: Sequence[str],
) -> tuple[object, ...]:
    given = ("as given", "as given")
    return (
        machine.name,
        *((throw.l1, math.degrees(throw.theta0)) if isinstance(throw, WidestThrow) else given),
        throw.sling,
        throw.kinetic_energy / throw.efficiency / 1e3,
        throw.launch_time,
        math.degrees(throw.arm_angle),
        throw.speed,
        throw.kinetic_energy / 1e3,
        throw.efficiency,
        *(_engine_value(values, name) for name in names),
    )


_CHAPTERS: dict[str, tuple[str, Callable[[Any], Iterator[Block]]]] = {
    "identification": ("The start angles, identified", _identification),
    "drag": ("The drag area behind Table II", _drag),
    "sweep": ("The fulcrum's position", _sweep),
    "machines": ("The machines the paper names", _machines),
    "design": ("A rolling machine designed as one", _design),
}
"""Title and blocks of each further study, by its name."""
