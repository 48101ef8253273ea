"""Plots of the studies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..report.plots import Axis, Label, Panels, Plot, Series, Style, run_style
from .results import Curve, PowerLaw, Study

_WHOLE = Style("#8a8f96")


def convergence(studies: Sequence[Study]) -> Panels:
    """Error against the time step, position and torque, with the fitted lines and their slopes."""
    return tuple(
        Plot(
            Axis("time step", "s", logarithmic=True),
            _error(curve),
            tuple(
                each
                for study in studies
                for each in (*_points(study, column, study.label), *_line(study, column))
            ),
            # Lines may all but cover each other; their slopes, each at another place, do not.
            labels=tuple(
                label
                for k, study in enumerate(studies, 1)
                for label in _slope(study, column, k / (len(studies) + 1))
            ),
            height=430,
        )
        for column, curve in enumerate(studies[0].curves)
    )


def swept_parameter(study: Study) -> Panels:
    """Error against one parameter, and where it can be isolated, the part of it that the parameter makes."""
    name = "part of the parameter" if study.own else "error"
    return tuple(
        Plot(
            Axis(study.title, study.unit, logarithmic=True),
            _error(curve),
            (
                *(_points(study, column, "whole error", whole=True) if study.own else ()),
                *_points(study, column, name),
                *_line(study, column),
            ),
            labels=tuple(_slope(study, column, 0.5)),
        )
        for column, curve in enumerate(study.curves)
    )


def work_precision(studies: Sequence[Study]) -> Panels:
    """Error against the median wall time; bars from the quickest to the slowest repeat."""
    return tuple(
        Plot(
            Axis("wall time, warm", "s", logarithmic=True),
            _error(curve),
            tuple(_timed(study, study.curves[column]) for study in studies),
            height=400,
        )
        for column, curve in enumerate(studies[0].curves)
    )


def _timed(study: Study, curve: Curve) -> Series:
    timed = [point for point in study.points if point.wall_times]
    times = [sorted(point.wall_times) for point in timed]
    x = np.array([np.median(each) for each in times], dtype=float)
    y = np.array([point.error(curve.quantity) or np.nan for point in timed], dtype=float)
    spread = (
        np.array([each[0] for each in times], dtype=float),
        np.array([each[-1] for each in times], dtype=float),
    )
    hints = tuple(f"{study.title} = {point.value:.3g}" for point in timed)
    return Series(study.label, x, y, run_style(study.engine, study.preset), "both", hints, spread)


def exponent(law: PowerLaw | None) -> str:
    """Exponent and half width of its confidence interval."""
    return "none" if law is None else f"{law.exponent:.3f} ± {law.half_width:.3f}"


def _error(curve: Curve) -> Axis:
    name = (
        "position"
        if curve.quantity == "position"
        else f"stop {'force' if curve.unit == 'N' else 'torque'}"
    )
    return Axis(f"largest error, {name}", curve.unit, logarithmic=True)


def _points(study: Study, column: int, name: str, *, whole: bool = False) -> Iterator[Series]:
    """The errors, or where it can be isolated and unless the whole is asked for, the parameter's part of them."""
    own, quantity = study.own and not whole, study.curves[column].quantity
    found = [(point.value, point.error(quantity, own)) for point in study.points]
    ran = np.array([(value, error) for value, error in found if error is not None], dtype=float)
    if len(ran):
        style = _WHOLE if whole else run_style(study.engine, study.preset)
        yield Series(name, ran[:, 0], ran[:, 1], style, "points")


def _line(study: Study, column: int) -> Iterator[Series]:
    """The law."""
    law = study.curves[column].law
    if law is not None:
        ends = np.array([law.high, law.low]), np.array([law.at(law.high), law.at(law.low)])
        style = replace(run_style(study.engine, study.preset), width=1.2)
        yield Series(f"slope {law.exponent:.3f}", *ends, style, listed=False)


def _slope(study: Study, column: int, at: float) -> Iterator[Label]:
    """The law's exponent, at that share of its range."""
    law = study.curves[column].law
    if law is not None:
        x = law.low ** (1 - at) * law.high**at
        yield Label(x, law.at(x), exponent(law), run_style(study.engine, study.preset).colour)
