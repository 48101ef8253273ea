"""The page's sections on the fulcrum's place and on a rolling machine designed as one."""

from __future__ import annotations

import math

from pydantic import JsonValue

from ..design.first_forward_swing import CoincidingDesign, Design, Throwing
from ..results import EngineValue
from ..sweep.results import Artefact, Position, Sweep
from .blocks import Block, sentences, table


def sweep(data: JsonValue) -> list[Block]:
    """The fulcrum's place: peak, thresholds, what happens where."""
    found = Sweep.model_validate(data)
    return [_facts(found), _positions(found), _artefact(found.artefact)]


def _facts(s: Sweep) -> Block:
    peak, regime, trend = s.peak, s.regime, s.trend
    rows: list[list[object]] = [
        [
            "largest launch speed",
            f"{peak.speed.value:.8g} m/s at l1 = {peak.l1.value:.8g} m ({peak.lever_ratio:.4g}:1)",
        ],
        ["gravity turns the arm backward below", "nowhere" if s.backward.l1 is None else f"l1 = {s.backward.l1:.8g} m"],
        ["least torque of gravity over the sweep", f"{s.backward.least_torque:.6g} N m, forward"],
        [
            f"speed at l1 = {s.suspect.l1:g} m",
            f"{s.suspect.speed:.8g} m/s; by its neighbours {s.suspect.from_neighbours:.8g}",
        ],
        [
            "second difference there",
            f"{s.suspect.second_difference:.6g}; of the curve {s.suspect.second_derivative:.6g}",
        ],
        [
            f"slope from {trend.start:.4g} to {trend.end:.4g} m",
            f"{trend.slope:.5g} m/s per m, R² {trend.determination:.5f}",
        ],
    ]
    if regime.l1 is not None:
        rows.append(
            ["a rest would have to pull beyond", f"l1 = {regime.l1.value:.9g} m; by root finding {regime.root:.9g} m"]
        )
        rows.append(
            ["there the arm asks of the hanger", f"{regime.needed:.6g} m/s², gravity gives {regime.available:.6g}"]
        )
    if regime.swing is not None:
        zeros = ", ".join(f"{zero:.4g} s" for zero in regime.swing.zeros) or "none"
        rows.append(["just above, both held: torque's zeros in a period", zeros])
    return table(
        "What the curve shows", ("", ""), rows, f"Swept from l1 = {s.start:g} to {s.end:g} m, l1 + l2 = {s.beam:g} m."
    )


def _positions(s: Sweep) -> Block:
    names = list(dict.fromkeys(each.engine for place in s.positions for each in place.engines))
    looked_at = [*s.positions, *(place for place in (s.regime.below, s.regime.above) if place is not None)]
    rows = [_position(place, names) for place in sorted(looked_at, key=lambda place: place.l1)]
    headings = (
        "l1 [m]",
        "l1 : l2",
        "torque on the arm [N m]",
        "hanger's rest [N m]",
        "furthest back [rad]",
        "speed [m/s]",
        "rests that may pull [m/s]",
        *names,
    )
    return table("Place by place", headings, rows)


def _position(place: Position, names: list[str]) -> list[object]:
    return [
        f"{place.l1:.7g}",
        f"{place.lever_ratio:.4g}",
        place.arm_torque,
        place.rest_torques.get("hanger rest"),
        place.furthest_back,
        None if place.speed is None else place.speed.value,
        place.bilateral_speed,
        *(_of(place.engines, name) for name in names),
    ]


def _of(values: tuple[EngineValue, ...], engine: str) -> object:
    found = next((each for each in values if each.engine == engine), None)
    return None if found is None else (found.note if found.value is None else found.value)


def _artefact(artefact: Artefact) -> Block:
    rows = [
        [
            search.guess,
            search.lowest,
            search.later_zero,
            search.no_zero,
            ", ".join(f"{l1:g}" for l1 in search.fails_at) or "none",
        ]
        for search in artefact.searches
    ]
    headings = (
        "guess [s]",
        "first zero found from l1 = [m]",
        "later zero at (places)",
        "none at (places)",
        "misses at l1 = [m]",
    )
    guess = artefact.matching_guess
    text = (
        "" if guess is None else f"A guess of {guess:.4g} s would begin to fail just at l1 = {artefact.threshold:g} m. "
    )
    return table(
        "Could a root search make the paper's threshold?",
        headings,
        rows,
        f"{text}Nothing of the paper's program is published: this can only be compatible with it.",
    )


def design(data: JsonValue) -> list[Block]:
    """Rolling machines whose peak comes at their best release, beside the paper's."""
    found = Design.model_validate(data)
    blocks = [_machines(found), *(_confirmed(each) for each in found.designs if each.engines)]
    notes = [f"{each.name}: {'; '.join(each.warnings)}" for each in found.designs if each.warnings]
    return [*blocks, Block("What a builder should know", sentences(notes))] if notes else blocks


def _machines(found: Design) -> Block:
    named: list[tuple[str, Throwing | None]] = [
        ("the paper's, fixed", found.paper_fixed),
        ("the paper's, rolling", found.paper_rolling),
    ]
    named += [(f"{each.name} ({each.reading.value})", each.throwing) for each in found.designs]
    named.append(("largest range of all", found.unconstrained))
    rows = [_throwing(name, each) for name, each in named if each is not None]
    headings = (
        "machine",
        "r, h, l1 [m]",
        "l1 : l2",
        "best release [s]",
        "fastest later by [s]",
        "angle [deg]",
        "speed [m/s]",
        "range [m]",
        "R",
        "efficiency",
    )
    bounds = found.bounds
    text = (
        f"Chosen within r {_span(bounds.r)}, h {_span(bounds.h)}, l1 {_span(bounds.l1)} m, masses and l1 + l2 kept. "
        f"Asked besides: {'; '.join(found.constraints)}."
    )
    active = [f"{d.name} stands on {', '.join(d.optimality.active) or 'no bound'}" for d in found.designs]
    return table("Designs", headings, rows, text, "; ".join(active) + "." if active else "")


def _span(bounds: tuple[float, float]) -> str:
    return f"{bounds[0]:g} to {bounds[1]:g}"


def _throwing(name: str, t: Throwing) -> list[object]:
    p = t.parameters
    return [
        name,
        f"{p.r:.5g}, {p.h:.5g}, {p.l1:.5g}",
        f"{t.lever_ratio:.4g}",
        t.best_time,
        f"{t.gap:.3g}",
        math.degrees(t.angle),
        t.speed,
        t.range,
        t.ratio,
        t.efficiency,
    ]


def _confirmed(each: CoincidingDesign) -> Block:
    names = list(dict.fromkeys(v.engine for values in each.engines.values() for v in values))
    rows = [[figure, *(_with_tolerance(values, name) for name in names)] for figure, values in each.engines.items()]
    return table(f"{each.name}, by engines", ("figure (SI units)", *names), rows)


def _with_tolerance(values: tuple[EngineValue, ...], engine: str) -> str:
    found = next((each for each in values if each.engine == engine), None)
    if found is None or found.value is None:
        return "–" if found is None else found.note or "–"
    return f"{found.value:.9g}" + ("" if found.tolerance is None else f" (± {found.tolerance:.1g})")
