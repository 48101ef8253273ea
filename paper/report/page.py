"""The page of the study: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from plotly.offline import get_plotlyjs
from pydantic import JsonValue

from ...comparisons.report.numbers import format_number as figure
from ...comparisons.report.plots import embedded
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.trebuchet import parameters_of
from ..results import Study, Verdict
from . import machines as section_machines
from . import start_and_drag as section_start
from . import sweep_and_design as section_design
from . import text as shown
from .blocks import Block
from .plots import pictures

Render = Callable[[JsonValue], list[Block]]

RENDERED: dict[str, tuple[str, Render]] = {
    "identification": ("The start angles, identified", section_start.identification),
    "drag": ("The drag area behind Table II", section_start.drag),
    "sweep": ("The fulcrum's place", section_design.sweep),
    "machines": ("The machines the paper names", section_machines.machines),
    "design": ("A rolling machine designed as one", section_design.design),
}
"""Title and blocks of each further study, by its name; one that is not here is shown as its data."""

MARKS = {Verdict.HOLDS: "holds", Verdict.WITHIN_GRID: "grid", Verdict.FAILS: "fails", Verdict.OPEN: "open"}


@dataclass(frozen=True)
class Chapter:
    """A further study on the page."""

    name: str
    title: str
    blocks: list[Block]
    failed: str = ""


def page(study: Study) -> str:
    """The whole page as HTML text, scripts and all."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = files("trebucheck.paper.report").joinpath("templates/paper.html.j2").read_text(encoding="utf-8")
    return environment.from_string(text).render(
        study=study,
        shown=shown,
        marks=MARKS,
        figure=figure,
        engines=shown.engines(study),
        pictures=[(each.name, each.caption, embedded(each.plot)) for each in pictures(study.series)],
        constants=_constants(study),
        chapters=[
            _chapter(name, study.sections[name]) for name in (*RENDERED, *_others(study)) if name in study.sections
        ],
        plotly=get_plotlyjs(),
    )


def _others(study: Study) -> list[str]:
    return [name for name in study.sections if name not in RENDERED]


def _chapter(name: str, data: JsonValue) -> Chapter:
    title, render = RENDERED.get(name, (name.capitalize(), _as_data))
    if isinstance(data, dict) and "failed" in data:
        return Chapter(name, title, [], str(data["failed"]))
    try:
        return Chapter(name, title, render(data))
    except Exception as error:  # one section that cannot be shown must not cost the page
        return Chapter(name, title, [], f"it cannot be shown: {type(error).__name__}: {error}")


def _as_data(data: JsonValue) -> list[Block]:
    return [Block(texts=("Its figures are in paper.json.",))]


def _constants(study: Study) -> list[tuple[str, str, str]]:
    """Table I, and the start: name, value, what it is."""
    found = next((p for machine in study.machines if (p := parameters_of(machine)) is not None), None)
    if found is None:
        return []
    fields = TrebuchetParameters.model_fields
    return [(name, f"{value:.9g}", fields[name].description or "") for name, value in found]
