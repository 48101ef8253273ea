"""Pages of campaigns: maps of agreement over two parameters, rankings; and two campaigns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ....models.arrays import FloatArray
from ....models.mechanism import Mechanism
from ....models.problem import Problem, mechanism_of
from ....models.stacked import numbers
from ...campaigns.agreement import (
    ALL,
    FAILED,
    HOLDING,
    HORIZON,
    LEVELS,
    NOT_JUDGED,
    Layer,
    layers,
)
from ...campaigns.changes import CampaignDifference
from ...campaigns.machines import EngineCase, again
from ...campaigns.ranking import LEAST, ranking
from ...campaigns.shrink import Shrunk
from ...campaigns.spec import Runs
from ...campaigns.store import CampaignStore
from ...campaigns.table import parameter_columns
from ...runs.results import Outcome
from .. import document as doc
from ..document import format_number
from ..plots import Axis, Panels, Plot, Rule, Series, Style, Symbol

_COLOURS = ("#2166ac", "#4393c3", "#92c5de", "#f4a582", "#d6604d", "#b2182b")
"""Colours of the levels: blue within, red beyond (ColorBrewer's RdBu)."""
_SYMBOLS: tuple[Symbol, ...] = ("circle", "circle", "circle", "square", "diamond", "star")
_GREY = "#888888"
_PARTS = 6  # of values that have no tolerance: a launch's speed, the horizon
_SHOWN = 12  # rows of a table of reasons or changes
_MOST = 20_000  # points of a figure
_CLEARLY = 1.5  # times the index of a random number
_HOW = (
    "Each point is a machine. Its colour tells the error in parts of its tolerance, of the "
    "quantity that is chosen; of all quantities it is the worst. Circles hold their tolerance; "
    "other symbols do not. Where several stand at one place, the worst is seen."
)
_RANKED = (
    "The PAWN index of a parameter (Pianosi and Wagener) is how far, on average, the distribution "
    "of the error shifts when the parameter is known: 0 not at all, 1 wholly. An index that is not "
    "clearly larger than that of a random number says nothing."
)

_ONE_EACH = (
    "Of each engine the quantity with the largest index (0: no effect, 1: all; one not clearly "
    "larger than a random number's says nothing). The map and all quantities are on the page."
)


def document(store: CampaignStore, along: str | None = None, up: str | None = None) -> doc.Document:
    """Map, counts and ranking of a campaign.

    Args:
        store: of the campaign, which may still be growing.
        along: parameter along the map, as :meth:`.Campaign.axes` takes it.
        up: parameter up the map; of a campaign of one parameter that is the error in parts of its
            tolerance, or the launch's speed.

    Raises:
        InputError: as there.
    """
    x, y = store.campaign.axes(along, up)
    if store.campaign.runs is None:
        return _of_launches(store, x, y)
    found = list(layers(store))
    blocks: list[doc.Block] = [doc.Heading("Verdicts", 2, medium="any"), _counts(found)]
    blocks.append(doc.Heading("Where engines agree and where they part", 2))
    blocks.append(doc.Note(_HOW))
    for _, group in groupby(found, key=_name):
        of_engine = list(group)
        blocks.append(_map(store, of_engine, x, y))
    blocks += _ranking(found)
    blocks += _reasons(found)
    return _page(store, _verdict(store, found), blocks)


def _page(store: CampaignStore, verdict: str, blocks: Sequence[doc.Block]) -> doc.Document:
    """Page of a campaign: the verdict, what is there, and then the blocks."""
    return doc.Document(
        f"Campaign {store.campaign.name}",
        (doc.Text(verdict, "strong"), _progress(store), *blocks),
        f"trebucheck: {store.campaign.name}",
        command=store.file.command or "",
        verdict=verdict,
        wide=True,
    )


def _verdict(store: CampaignStore, found: list[Layer]) -> str:
    counts = Counter[str]()
    for layer in found:
        if layer.quantity == ALL:
            counts.update(layer.rows["outcome"])
    if not counts:
        whole = len(store.files) == store.chunks
        why = "`where` leaves no machine" if whole else "no chunk is finished yet"
        return f"There is no run of {store.campaign.name}: {why}."
    outcomes = ", ".join(f"{number} {_PLURAL[text]}" for text, number in counts.most_common())
    return f"{sum(counts.values())} runs of {store.campaign.name}: {outcomes}."


_PLURAL = {outcome.value: outcome.value for outcome in Outcome} | {
    Outcome.AGREES.value: "agree",
    Outcome.DISAGREES.value: "disagree",
}


def _progress(store: CampaignStore) -> doc.Text:
    made = f"{len(store.files)} of {store.chunks} chunks are there."
    return doc.Text(f"{made} Made by {store.file.machine_text}.")


def _name(layer: Layer) -> str:
    step = "" if layer.timestep is None else f" at {layer.timestep:g} s"
    return f"{layer.engine} {layer.preset}{step}"


def _counts(found: list[Layer]) -> doc.Table:
    """Verdicts of each engine, and the median and largest share of its tolerance."""
    rows: list[tuple[object, ...]] = []
    for layer in found:
        if layer.quantity != ALL:
            continue
        counts = Counter(layer.rows["outcome"])
        agree, disagree = counts[Outcome.AGREES.value], counts[Outcome.DISAGREES.value]
        others = len(layer.rows) - agree - disagree
        shares = layer.share[~np.isnan(layer.share)]
        middle = format_number(float(np.median(shares))) if len(shares) else "–"
        largest = format_number(float(shares.max())) if len(shares) else "–"
        worst = Counter(layer.rows["worst"].dropna()).most_common(1)
        named = worst[0][0] if worst else "–"
        rows.append((_name(layer), agree, disagree, others, middle, largest, named))
    heads = doc.columns(
        "engine | agree | disagree | others | median error / tolerance | largest | most often worst"
    )
    return doc.table(heads, rows)


# --- Maps


def _map(store: CampaignStore, found: list[Layer], x: str, y: str | None) -> doc.Figure:
    """Map of one engine, with a choice of its quantities and of the horizon."""

    def draw() -> Panels:
        *each, every = sorted(found, key=lambda layer: layer.quantity == ALL)
        plots = [_plot(store, layer, x, y) for layer in (*each, every)]
        rows = found[0].rows
        if (rows["judged_to"] < rows["compared_to"]).any():
            values = (rows["judged_to"] / rows["compared_to"]).to_numpy(dtype=float)
            series = _parts(rows, values, x, y, "of the motion")
            axes = _axes(store, x, y, Axis("horizon / end"))
            plots.append(Plot(*axes, series, choice=HORIZON))
        return tuple(plots)

    return doc.Figure(draw, _name(found[0]), columns=1, chosen="quantity", group="map")


def _axes(store: CampaignStore, x: str, y: str | None, other: Axis) -> tuple[Axis, Axis]:
    """Axes of a map; `other` is the second one where no parameter is."""
    units = {column.name: column.unit for column in parameter_columns(store.campaign)}
    values = store.campaign.machines.values

    def axis(name: str) -> Axis:
        scale = getattr(values.get(name), "scale", "linear")
        return Axis(name, units.get(name, ""), scale == "log")

    return axis(x), other if y is None else axis(y)


def _plot(store: CampaignStore, layer: Layer, x: str, y: str | None) -> Plot:
    """Points of each level, those within first, and those without a verdict."""
    levels, series = layer.levels, list[Series]()
    thin = slice(None, None, max(1, len(levels) // _MOST))
    rows, levels = layer.rows[thin], levels[thin]
    shares = layer.share[thin]
    # The worst last, above others at the same place
    looks = [(-1, NOT_JUDGED, Style(_GREY, symbol="triangle"))]
    looks += [
        (level, name, Style(_COLOURS[level], symbol=_SYMBOLS[level]))
        for level, name in enumerate(LEVELS)
    ]
    looks += [(-2, FAILED, Style(_GREY, symbol="times"))]
    for level, name, style in looks:
        at = levels == level
        if at.any():
            each = zip(rows["machine"][at], rows["outcome"][at], shares[at], strict=True)
            hints = tuple(_hint(*of_row) for of_row in each)
            up = shares[at] if y is None else y
            series.append(_points(name, rows[at], x, up, style, hints))
    held = int(np.sum((levels >= 0) & (levels < HOLDING)))
    title = f"{layer.quantity}: {held} of {int(np.sum(levels >= 0))} hold"
    axes = _axes(store, x, y, Axis("error / tolerance", logarithmic=True))
    rules = (Rule(1.0, "tolerance", across="y"),) if y is None else ()
    return Plot(*axes, tuple(series), title, rules=rules, choice=layer.quantity)


def _hint(machine: int, outcome: str, share: float) -> str:
    ratio = "" if np.isnan(share) else f", {format_number(float(share))} of the tolerance"
    return f"machine {machine}: {outcome}{ratio}"


def _points(
    name: str, rows: Any, x: str, y: str | FloatArray, style: Style, hints: tuple[str, ...]
) -> Series:
    up = rows[y].to_numpy(dtype=float) if isinstance(y, str) else y
    return Series(name, rows[x].to_numpy(dtype=float), up, style, "points", hints)


def _parts(rows: Any, values: FloatArray, x: str, y: str | None, unit: str) -> tuple[Series, ...]:
    """Points by the part of the values' range that they are in, the least first."""
    edges = np.linspace(np.nanmin(values), np.nanmax(values), _PARTS + 1)
    series: list[Series] = []
    for k in range(_PARTS):
        low, high = edges[k], edges[k + 1]
        at = (values >= low) & ((values < high) if k + 1 < _PARTS else (values <= high))
        if at.any():
            name = f"{low:.3g} to {high:.3g} {unit}"
            hints = tuple(f"{value:.6g} {unit}" for value in values[at])
            up = values[at] if y is None else y
            series.append(_points(name, rows[at], x, up, Style(_COLOURS[k]), hints))
    return tuple(series)


def _of_launches(store: CampaignStore, x: str, y: str | None) -> doc.Document:
    """Speed at the launch over two parameters."""
    table = store.to_pandas()
    launched = table[table["launched"]]
    verdict = f"{len(launched)} of {len(table)} machines launched."
    messages = Counter(table["message"].dropna().map(_without_values))
    blocks: list[doc.Block] = []
    if len(launched):
        thinned = launched[:: max(1, len(launched) // _MOST)]

        def draw() -> Panels:
            speeds = thinned["launch_speed"].to_numpy(dtype=float)
            axes = _axes(store, x, y, Axis("launch speed", "m/s"))
            return (Plot(*axes, _parts(thinned, speeds, x, y, "m/s")),)

        blocks.append(doc.Figure(draw, "Speed at the launch", columns=1))
        best = launched.nlargest(_SHOWN, "launch_speed")
        names = list(store.campaign.machines.values)
        heads = " | ".join(["machine", *names, "launch speed [m/s]", "launch time [s]"])
        columns = ["machine", *names, "launch_speed", "launch_time"]
        rows = [tuple(row) for row in best[columns].itertuples(index=False)]
        blocks.append(doc.table(heads, rows, "The fastest launches"))
    blocks += _listing("Not launched", messages)
    return _page(store, verdict, blocks)


# --- Ranking and reasons


def _ranking(found: list[Layer]) -> Iterator[doc.Block]:
    """Indices of the parameters for each engine and quantity; a terminal shows one of an engine."""
    names = list(found[0].parameters) if found else []
    rows: list[doc.Row] = []
    for _, group in groupby(found, key=_name):
        ranked = [each for each in map(ranking, group) if each is not None]
        if not ranked:
            continue
        first = max(ranked, key=lambda each: max(each.indices.values()))
        for each in ranked:
            cells = [_index_cell(each.indices.get(name), each.chance) for name in names]
            place = _name(each.layer), each.layer.quantity
            medium: doc.Medium = "any" if each is first else "page"
            rows.append(doc.row(*place, *cells, f"{each.chance:.2f}", medium=medium))
    yield doc.Heading("Parameters by their effect on the error", 2, medium="any")
    if not rows:
        yield doc.Text(
            f"There is no ranking: it needs {LEAST} judged machines that differ in their errors."
        )
        return
    yield doc.Note(_RANKED)
    yield doc.table(" | ".join(["engine", "quantity", *names, "a random number"]), rows)
    yield doc.Text(_ONE_EACH, medium="terminal")


def _index_cell(index: float | None, chance: float) -> doc.Cell:
    """An index, strong where it is clearly larger than a random number's."""
    if index is None:
        return doc.Cell("–")
    return doc.Cell(f"{index:.2f}", "strong" if index > _CLEARLY * chance else "muted")


def _reasons(found: list[Layer]) -> list[doc.Block]:
    """Causes of disagreements, and why runs failed, by how often."""
    causes, messages = Counter[str](), Counter[str]()
    for layer in found:
        if layer.quantity == ALL:
            causes.update(f"{_name(layer)}: {text}" for text in layer.rows["cause"].dropna())
            told = layer.rows["message"].dropna().map(_without_values)
            messages.update(f"{_name(layer)}: {text}" for text in told)
    return [*_listing("Causes", causes), *_listing("Not run to the end", messages)]


def _without_values(message: str) -> str:
    """A message without the values of a machine, so that it counts with its like."""
    head, separator, rest = message.partition("): ")
    return rest if separator and head.startswith("machine ") else message


def _listing(title: str, counts: Counter[str]) -> list[doc.Block]:
    if not counts:
        return []
    items = [doc.Text(text, lead=f"{number}:") for text, number in counts.most_common(_SHOWN)]
    if len(counts) > _SHOWN:
        items.append(doc.Text(f"and {len(counts) - _SHOWN} more"))
    return [doc.Heading(title, 2, medium="any"), doc.Listing(tuple(items))]


# --- Two campaigns


def difference_document(found: CampaignDifference) -> doc.Document:
    """Report of two campaigns: verdicts that changed, and errors that moved."""
    worse, better = found.worse, found.better
    verdict = f"{found.headline()}."
    mark: doc.Mark = "good" if found.passed else "bad"
    blocks: list[doc.Block] = [doc.Text(verdict, mark)]
    for title, rows in (("Verdicts that are worse", worse), ("Verdicts that are better", better)):
        if len(rows):
            shown = [
                (row.mechanism, row.engine, row.preset, row.outcome_old, row.outcome_new)
                for row in rows.head(_SHOWN).itertuples()
            ]
            caption = f"the first {len(shown)} of {len(rows)}" if len(rows) > len(shown) else ""
            blocks.append(doc.Heading(title, 2, medium="any"))
            blocks.append(doc.table("mechanism | engine | preset | old | new", shown, caption))
    counts: list[tuple[object, ...]] = []
    for kind in found.quantities:
        grown, fallen = found.moved(kind)
        if grown or fallen:
            factors = found.runs[kind.title].to_numpy(dtype=float)
            finite = factors[np.isfinite(factors)]
            counts.append(
                (
                    kind.words,
                    grown,
                    fallen,
                    format_number(float(finite.max())) if len(finite) else "–",
                )
            )
    blocks.append(
        doc.Heading(f"Errors that moved by more than a factor {found.factor:g}", 2, medium="any")
    )
    if counts:
        blocks.append(doc.table("quantity | grew | fell | largest factor", counts))
    else:
        blocks.append(doc.Text("None did."))
    return doc.Document(
        "What moved from one campaign to the other?",
        tuple(blocks),
        "trebucheck campaign diff",
        verdict=verdict,
    )


# --- The least machine that disagrees


def shrunk_document(
    given: Mechanism | Problem, found: Shrunk, runs: Runs, case: EngineCase, file: Path
) -> doc.Document:
    """Report of the least machine that still shows a disagreement, which is in a file."""
    before, after = mechanism_of(given), found.mechanism
    rows: list[tuple[object, ...]] = [
        (what, len(getattr(before, name)), len(getattr(after, name)))
        for what, name in (
            ("bodies", "bodies"),
            ("joints", "joints"),
            ("stops", "stops"),
            ("force elements", "force_elements"),
            ("couplers", "couplers"),
        )
    ]
    rows.append(("digits of numbers", _digits(before), _digits(after)))
    of_it = [metric for metric in found.run.broken if metric.name == found.worst]
    worst = max(of_it, key=lambda metric: metric.share or 0.0)
    verdict = (
        f"{case.engine} {case.preset} still breaks {found.worst} on a machine with "
        f"{len(after.bodies)} of {len(before.bodies)} bodies: {worst.label} is off by "
        f"{format_number(worst.value)} {worst.unit}, {format_number(worst.share)} of its tolerance."
    )
    command = again(["--model", str(file)], runs, case, found.given)
    blocks = (
        doc.Text(verdict, "strong"),
        doc.table("what | before | after", rows),
        doc.Text(f"{found.trials} machines were tried. Again: {command}"),
    )
    return doc.Document("The least machine that disagrees", blocks, verdict=verdict)


def _digits(mechanism: Mechanism) -> int:
    """Digits that it takes to write the numbers of a mechanism down."""
    written = (f"{value!r}" for value in numbers(mechanism).values())
    return sum(sum(c.isdigit() for c in text) for text in written)
