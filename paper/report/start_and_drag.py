"""The page's sections on the start angles and on drag."""

from __future__ import annotations

import math

import plotly.graph_objects as go
from pydantic import JsonValue

from ...comparisons.report.plots import finish
from ..drag.results import DragInterval, DragStudy
from ..identification.quantities import Fit, Identification
from .blocks import Block, drawn, sentences, table

_COLOURS = {"moon": "#777777", "mars": "#c0392b", "earth": "#1f77b4", "venus": "#d9a30d"}


def identification(data: JsonValue) -> list[Block]:
    """The start angles: fits, what determines them, and what singles one start out."""
    found = Identification.model_validate(data)
    blocks = [
        Block(texts=sentences(found.findings)),
        _fits(found),
        _figures(found),
        _sensitivities(found),
        _extents(found.fit),
    ]
    if found.search is not None:
        blocks.append(_solutions(found))
    return blocks


def _degrees(*angles: float) -> str:
    return ", ".join(f"{math.degrees(angle):.4f}" for angle in angles)


def _fits(found: Identification) -> Block:
    rows = [
        [
            fit.name,
            _degrees(*fit.angles),
            ", ".join(fit.free),
            _degrees(*fit.standard_errors),
            fit.chi_square,
            fit.degrees_of_freedom,
            fit.p_value,
            fit.compatible,
        ]
        for fit in (found.fit, *found.nested)
    ]
    headings = (
        "fit",
        "θ, φ, α at the start [deg]",
        "free",
        "standard errors [deg]",
        "χ²",
        "degrees",
        "p",
        "all digits met",
    )
    return table("Fits", headings, rows)


def _figures(found: Identification) -> Block:
    at = {each.name: each for each in found.fit.figures}
    rows = [
        [
            each.name,
            each.where,
            f"{each.printed} {each.unit}".strip(),
            at[each.name].computed if each.name in at else None,
            at[each.name].miss if each.name in at else None,
            "fitted" if each.fitted else "bound",
            each.because,
        ]
        for each in found.printed
    ]
    headings = ("figure", "where", "printed", "at the fit", "off by [half widths]", "used as", "half width")
    return table("Printed figures", headings, rows)


def _sensitivities(found: Identification) -> Block:
    rows = [
        [each.name, *each.per_radian, *(f"{share:.0%}" for share in each.information)] for each in found.sensitivities
    ]
    headings = ("figure", "by θ [per rad]", "by φ", "by α", "tells θ", "tells φ", "tells α")
    c = found.conditioning
    text = (
        f"Rank {c.rank} of 3, condition number {c.condition_number:.3g}; the joint 95 % region reaches "
        f"{_degrees(*c.half_lengths)} deg along its axes, the best determined first."
    )
    return table("Which figure determines which angle", headings, rows, text)


def _extents(fit: Fit) -> Block:
    rows = [
        [each.angle, _degrees(each.low), ", ".join(each.ends_low), _degrees(each.high), ", ".join(each.ends_high)]
        for each in fit.extents
    ]
    headings = ("angle", "from [deg]", "ended by", "to [deg]", "ended by")
    return table("Start angles compatible with every printed digit", headings, rows)


def _solutions(found: Identification) -> Block:
    assert found.search is not None
    rows = [[_degrees(*each.angles), each.worst, each.miss, each.starts] for each in found.search.solutions[:8]]
    headings = ("θ, φ, α [deg]", "misses most", "by [half widths]", "starts that led there")
    text = f"{found.search.machines} machines looked at, {found.search.starts} minima refined."
    return table("Search for other starts", headings, rows, text)


def drag(data: JsonValue) -> list[Block]:
    """The drag area: Table II under each reading."""
    study = DragStudy.model_validate(data)
    return [
        Block(texts=sentences(study.findings)),
        _readings(study),
        _worlds(study),
        drawn("Best angle against drag area", _angles(study)),
    ]


def _area(interval: DragInterval | None) -> str:
    if interval is None:
        return "none"
    return f"{interval.low:.4g} on" if interval.high is None else f"{interval.low:.4g} to {interval.high:.4g}"


def _readings(study: DragStudy) -> Block:
    rows = [
        [
            r.angle.value,
            r.gravity.value,
            r.common_drag_area,
            math.degrees(r.root_mean_square),
            _area(r.shared),
            sum(fit.agrees for fit in r.worlds),
            max((len(grid.agreeing) for grid in r.grids), default=0),
        ]
        for r in study.readings
    ]
    headings = (
        "angle printed is",
        "g changed",
        "best common C_d A [m²]",
        "misses by (rms) [deg]",
        "C_d A giving all [m²]",
        "worlds met",
        "worlds met on a grid",
    )
    return table("Readings of Table II", headings, rows)


def _worlds(study: DragStudy) -> Block:
    printed = {each.world: each for each in study.printed}
    rows = [
        [
            fit.world,
            f"{printed[fit.world].printed}°",
            r.angle.value,
            r.gravity.value,
            math.degrees(fit.vacuum_angle),
            _area(fit.drag_areas),
            math.degrees(fit.common_angle),
            fit.agrees,
        ]
        for r in study.readings
        for fit in r.worlds
    ]
    headings = (
        "world",
        "printed",
        "angle printed is",
        "g changed",
        "in vacuum [deg]",
        "C_d A that gives it [m²]",
        "with the common one [deg]",
        "agrees",
    )
    return table("World by world", headings, rows)


def _angles(study: DragStudy) -> go.Figure:
    figure = go.Figure()
    for curve in study.readings[0].curves:
        line = {"color": _COLOURS.get(curve.world), "width": 2}
        figure.add_scatter(x=curve.drag_areas, y=[math.degrees(a) for a in curve.angles], name=curve.world, line=line)
    for each in study.printed:
        line = {"color": _COLOURS.get(each.world), "width": 1, "dash": "dash"}
        figure.add_hline(
            y=math.degrees(each.value), line=line, annotation_text=f"{each.world}: {each.printed}° in print"
        )
    # Logarithmic: what Venus feels at 0.1 m² takes Mars some hundred. Without drag nothing changes with the area.
    figure.update_xaxes(title="C_d A [m²]", type="log", range=[-3, 1], exponentformat="power")
    figure.update_yaxes(title="best angle of release [deg]")
    return finish(figure, 420)
