"""The tables of a campaign: their columns with units, the row of a run, and a chunk's file.

A row of `runs` is one engine at one preset and step on one machine; a row of `launches` is one
machine that the reference has thrown. Every row has the values of its machine's parameters beside
what was measured, so that one table answers a question without another.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ...models.errors import InputError
from ...models.library.registry import model, parameters_type
from ...models.spec import number_units
from ...models.trajectory import Trajectory
from ...version import __version__
from ..runs.quantities import JUDGED, MetricKind, judged_quantity
from ..runs.results import Machine, Metric, Run
from .spec import Campaign

_TEXT, _REAL, _WHOLE, _TRUTH = pa.string(), pa.float64(), pa.int64(), pa.bool_()
_NAMES = pa.dictionary(pa.int32(), pa.string())
DIGITS = 32
"""Hexadecimal digits of a hash that a row keeps: two of 10^12 rows share one in 10^-14 of cases."""


@dataclass(frozen=True)
class RowColumn:
    """A column of the rows: its type, unit and meaning."""

    name: str
    type: Any
    text: str
    unit: str = ""

    def field(self) -> Any:
        """The column in a schema of Arrow, with its unit as metadata.

        Its meaning would be half of a chunk's file: `campaign.json` has those of all columns.
        """
        return pa.field(self.name, self.type, metadata={"unit": self.unit} if self.unit else None)


_NUMBER = RowColumn("machine", _WHOLE, "number of the machine in the design")
_BUILT = RowColumn("mechanism", _TEXT, "first digits of the SHA-256 of the mechanism")
_VARIED = RowColumn("mechanism", _TEXT, "first digits of the SHA-256 of the model and the values")
_RUN = (
    RowColumn("run", _TEXT, "the same of all that makes the run, versions among it"),
    RowColumn("model", _NAMES, "name of the mechanism"),
    RowColumn("engine", _NAMES, "engine"),
    RowColumn("preset", _NAMES, "preset of the engine"),
    RowColumn("engine_version", _NAMES, "version of the engine"),
    RowColumn("timestep", _REAL, "step of the engine; null: it has none", "s"),
    RowColumn("steps", _WHOLE, "steps of the run"),
    RowColumn("outcome", _NAMES, "verdict, or how the run failed"),
    RowColumn("message", _TEXT, "why it failed or was not judged"),
    RowColumn("process_failed", _TRUTH, "its process failed, and not the run: it is made again"),
    RowColumn("compared_to", _REAL, "end of the motion", "s"),
    RowColumn("judged_to", _REAL, "that, or the predictability horizon if earlier", "s"),
    RowColumn("stretching", _REAL, "displacement up to there per change of inertia"),
    RowColumn("launch_time", _REAL, "of the reference", "s"),
    RowColumn("launch_speed", _REAL, "of the reference", "m/s"),
    RowColumn("worst", _NAMES, "quantity with the largest error in parts of its tolerance"),
    RowColumn("share", _REAL, "that error / tolerance; infinite where the value is missing"),
    RowColumn("cause", _TEXT, "likeliest causes, where asked for; null: unknown"),
)
_QUANTITY = ("error", "tolerance", "subject")
_COST = (
    RowColumn("processor_time", _REAL, "of the run", "s"),
    RowColumn("reading_time", _REAL, "the adapter's part of it", "s"),
    RowColumn("wall_time", _REAL, "of the run", "s"),
    RowColumn("host", _NAMES, "computer that made it"),
    RowColumn("repeat", _TEXT, "commands that make it again"),
)
COSTS = tuple(column.name for column in _COST)
"""Columns that tell how a run was made; all others are the same whenever it is made again."""
_LAUNCH = (
    RowColumn("launched", _TRUTH, "whether there was a launch within the duration"),
    RowColumn("launch_time", _REAL, "time of the launch", "s"),
    RowColumn("launch_speed", _REAL, "speed of the projectile at the launch", "m/s"),
    RowColumn("launch_vx", _REAL, "its horizontal part", "m/s"),
    RowColumn("launch_vy", _REAL, "its vertical part", "m/s"),
)
_MESSAGE = RowColumn("message", _TEXT, "why the machine could not be built or launched")


@dataclass(frozen=True)
class Chunk:
    """Rows of some machines, and their motions where they are kept."""

    content: bytes
    """A Parquet file."""
    motions: Mapping[str, Trajectory] = field(default_factory=dict[str, Trajectory])
    """Motions by name of their file."""


def as_parquet(table: Any) -> bytes:
    """A table as the content of a Parquet file, compressed, with checksums of its pages."""
    target = io.BytesIO()
    pq.write_table(table, target, compression="zstd", write_page_checksum=True)
    return target.getvalue()


def from_parquet(content: bytes) -> Any:
    """The table of such a content."""
    return pq.read_table(io.BytesIO(content))


def schema_of(campaign: Campaign) -> Any:
    """Schema of a campaign's table: a `pyarrow.Schema` with units, and the campaign it is of.

    Raises:
        InputError: a parameter has the name of a column.
    """
    made_by = {"trebucheck": __version__, "campaign": f"{campaign.name} {campaign.content_hash}"}
    return pa.schema([column.field() for column in columns_of(campaign)], metadata=made_by)


def columns_of(campaign: Campaign) -> list[RowColumn]:
    """Columns of a campaign's table, in their order.

    Raises:
        InputError: a parameter has the name of a column.
    """
    hashed = _VARIED if campaign.runs is None else _BUILT
    columns = [_NUMBER, hashed, *parameter_columns(campaign)]
    if campaign.runs is None:
        columns += [*_LAUNCH, *(_release(name) for name in stop_names(campaign)), _MESSAGE]
    else:
        columns += _RUN
        for quantity in kept_quantities(campaign):
            columns += _quantity_columns(quantity)
        columns += _COST
    names = [column.name for column in columns]
    for name in campaign.machines.values:
        if names.count(name) > 1:
            raise InputError(f"machines.values.{name}: a column of the table has that name.")
    return columns


def parameter_columns(campaign: Campaign) -> list[RowColumn]:
    """Columns of the values that the machines differ in."""
    units, given = dict[str, str](), campaign.machines.model
    if isinstance(given, str):
        units |= number_units(parameters_type(given))
    return [
        RowColumn(name, _REAL, "parameter of the machine", units.get(name, ""))
        for name in campaign.machines.values
    ]


def kept_quantities(campaign: Campaign) -> list[MetricKind]:
    """Quantities of the table's columns: those asked for, else all that engines are judged by."""
    asked = () if campaign.runs is None else campaign.runs.quantities
    if asked:
        return [judged_quantity(title) for title in asked]
    return [quantity for quantity in JUDGED.values() if not quantity.of_files]


def column_name(quantity: MetricKind, what: str) -> str:
    """Name of a quantity's column, such as 'position_error'."""
    return f"{quantity.title.replace('-', '_')}_{what}"


def _quantity_columns(quantity: MetricKind) -> list[RowColumn]:
    texts = {
        "error": f"largest error of the {quantity.words}, in parts of its tolerance",
        "tolerance": "tolerance that it is held against; null: not judged",
        "subject": "marker, coordinate, stop or joint that it is of",
    }
    types = {"error": _REAL, "tolerance": _REAL, "subject": _NAMES}
    return [RowColumn(column_name(quantity, what), types[what], texts[what]) for what in _QUANTITY]


def stop_names(campaign: Campaign) -> tuple[str, ...]:
    """Names of the stops of the machines that a campaign throws."""
    given = campaign.machines.model
    assert given is not None
    return tuple(stop.name for stop in model(given).stops)


def _release(stop: str) -> RowColumn:
    return RowColumn(f"release {stop}", _REAL, f"time at which {stop} opens", "s")


# --- Rows


def run_row(
    row: Mapping[str, float], machine: Machine | None, run: Run, kept: Iterable[MetricKind]
) -> dict[str, Any]:
    """Row of a run, but for what tells where it was made.

    Args:
        row: number and values of the machine.
        machine: as the reference moved it; None: it could not.
        run: judged.
        kept: quantities.
    """
    fields: dict[str, Any] = {
        **row,
        "model": run.model,
        "engine": run.engine,
        "preset": run.preset,
        "engine_version": run.engine_version,
        "timestep": run.settings.get("timestep"),
        "steps": run.steps,
        "outcome": run.outcome.value,
        "message": run.message,
        "processor_time": run.processor_time,
        "reading_time": run.reading_time,
        "wall_time": run.wall_time,
    }
    if machine is not None:
        fields |= {
            "mechanism": machine.mechanism_hash[:DIGITS],
            "compared_to": machine.compared_to,
            "judged_to": machine.judged_to,
            "stretching": machine.stretching,
            "launch_time": machine.launch_time,
            "launch_speed": machine.launch_speed,
        }
    worst = _worst(run.judged)
    if worst is not None:
        fields |= {"worst": worst.label, "share": worst.share}
    if run.diagnosis is not None and run.diagnosis.named:
        fields["cause"] = "; ".join(cause.name for cause in run.diagnosis.named)
    for quantity in kept:
        of_it = [metric for metric in run.metrics if metric.name == quantity.name]
        metric = _worst(of_it)
        if metric is None:
            continue
        values = (metric.value, metric.tolerance, metric.subject)
        for what, value in zip(_QUANTITY, values, strict=True):
            fields[column_name(quantity, what)] = value
    return fields


def _worst(metrics: Sequence[Metric]) -> Metric | None:
    """The metric farthest beyond its tolerance; of those without one the largest."""
    judged = [metric for metric in metrics if metric.share is not None]
    if judged:
        return max(judged, key=lambda metric: metric.share or 0.0)
    valued = [metric for metric in metrics if metric.value is not None]
    return max(valued, key=lambda metric: abs(metric.value or 0.0), default=None)
