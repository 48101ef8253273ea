"""What the plots that Plotly still draws share."""

from __future__ import annotations

import math
from typing import Any

import plotly.graph_objects as go

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from .plots import engine_colour

LOGARITHMIC: dict[str, Any] = {"type": "log", "exponentformat": "power"}
"""An axis."""
REFERENCE_LINE = {"color": engine_colour("reference"), "width": 4}
"""Below the lines of the engines, which hide it where they agree."""


def run_style(engine: str, preset: str) -> dict[str, Any]:
    """Colour by engine, dashes by preset."""
    return {"color": engine_colour(engine), "dash": "solid" if preset == "tuned" else "dot", "width": 1.6}


def finish(figure: go.Figure, height: int, legend_at: float = -0.16) -> go.Figure:
    """Lay out a figure: height in pixels, legend below at that share of the height."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 20, "t": 50, "b": 50},
        legend={"orientation": "h", "y": legend_at},
        font={"family": "system-ui, sans-serif", "size": 13},
    )
    return figure


def skeleton(mechanism: Mechanism, kinematics: Kinematics, q: FloatArray) -> tuple[list[float], list[float]]:
    """Each body as the polyline of its joints, markers and centre, one after the other with gaps between [m]."""
    xs: list[float] = []
    ys: list[float] = []
    for body in mechanism.bodies:
        points = {body.centre}
        points |= {joint.child_point for joint in mechanism.joints if joint.child == body.name}
        points |= {joint.parent_point for joint in mechanism.joints if joint.parent == body.name}
        points |= {marker.point for marker in mechanism.markers if marker.body == body.name}
        where = [kinematics.position(kinematics.point(body.name, point), q) for point in sorted(points)]
        xs += [*(float(p[0]) for p in where), math.nan]
        ys += [*(float(p[1]) for p in where), math.nan]
    return xs, ys
