"""The store of a campaign: a folder with its description and a Parquet file a chunk.

    FOLDER/campaign.json                        description and versions
    FOLDER/rows/part=0000/chunk-0000000.parquet  rows of the first machines
    FOLDER/trajectories/...                     motions, where they were asked for

A chunk's file appears whole or not at all, so that the folder can be read while it grows: by
pandas, polars or DuckDB as one table, `rows/**/*.parquet`. A campaign that was interrupted is taken
up where files are missing. A folder holds one campaign, made by one set of versions.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ...engines.registry import engine_class
from ...models.errors import InputError, UnwritableError
from ...models.files import write_bytes, write_text
from ...models.shown import Reported
from ..runs.results import Outcome, ResultFile
from ..runs.versions import Versions, versions_here
from .design import Design, DesignPart
from .spec import Campaign
from .table import columns_of, schema_of

FORMAT = "trebucheck-campaign-1"
_HEADER = "campaign.json"
_ROWS, _FILES = "rows", "*/chunk-*.parquet"
_IN_A_PART = 1000  # chunks: a folder of many thousand files is slow to list
_MOST_CHUNKS = 10**7  # whose names sort in the order of the machines
_CODE = (
    "models",
    "reference",
    "engines",
    "comparisons/runs",
    "comparisons/diagnosis",
    "comparisons/campaigns",
)
"""Folders of the package whose code decides the rows."""


class CampaignFile(ResultFile):
    """The content of `campaign.json`: what was asked for, and what makes it."""

    format: Literal["trebucheck-campaign-1"] = FORMAT
    campaign: Campaign
    versions: Versions
    machines: int
    """Machines of the design, those that `where` leaves out among them."""
    columns: dict[str, str]
    """Meanings of the columns of the rows; their units stand in the files."""


@dataclass(frozen=True, repr=False)
class CampaignStore(Reported):
    """A campaign's folder."""

    folder: Path
    file: CampaignFile

    def headline(self) -> str:
        """Tell what is there."""
        asked = "launches" if self.campaign.runs is None else "runs"
        return (
            f"Campaign {self.campaign.name!r} in {self.folder}: {len(self)} {asked} of "
            f"{self.file.machines} machines"
        )

    def rows(self) -> Iterator[dict[str, object]]:
        """Rows that are there, in the order of the machines."""
        with self._reading() as dataset:
            for batch in dataset.to_batches():
                yield from batch.to_pylist()

    def to_dataframe(self) -> Any:
        """Read all rows that are there as a pandas data frame."""
        return self.to_pandas()

    @classmethod
    def begin(cls, folder: str | Path, campaign: Campaign, **made: Any) -> CampaignStore:
        """Begin a campaign in an empty folder, or go on with the same one.

        Args:
            folder: made where there is none.
            campaign: checked before anything is written.
            made: further fields of the file, such as `command`.

        Raises:
            InputError: the folder holds another campaign, or was made by other versions, or cannot
                be written to; or the campaign is too large for one folder.
        """
        path, columns = Path(folder), columns_of(campaign)
        found = cls._read(path)
        if found is None:
            machines = Design(campaign).size
            _refuse_too_many(campaign, machines)
            if next((path / _ROWS).glob(_FILES), None) is not None:
                raise InputError(
                    f"{path} holds rows, and no {_HEADER} that says of which campaign; a folder of "
                    "its own is needed for each."
                )
            file = CampaignFile.made_here(
                campaign=campaign,
                versions=_versions(campaign),
                machines=machines,
                columns={column.name: column.text for column in columns},
                **made,
            )
            write_text(path / _HEADER, file.to_json() + "\n")
            found = cls._read(path)  # another one may have begun at the same time
            assert found is not None
        if found.campaign.content_hash != campaign.content_hash:
            raise InputError(
                f"{path} holds another campaign, {found.campaign.name!r}; a folder of its own is "
                "needed for each."
            )
        store = cls(path, found)
        store.refuse_other_versions()
        return store

    @classmethod
    def open(cls, folder: str | Path) -> CampaignStore:
        """Open the store of a campaign that was begun.

        Raises:
            InputError: the folder holds none, or its description is broken.
        """
        found = cls._read(Path(folder))
        if found is None:
            raise InputError(f"{folder} holds no campaign: there is no {_HEADER}.")
        return cls(Path(folder), found)

    @staticmethod
    def _read(folder: Path) -> CampaignFile | None:
        path = folder / _HEADER
        return CampaignFile.load(path) if path.is_file() else None

    @property
    def campaign(self) -> Campaign:
        """The description that was asked for."""
        return self.file.campaign

    def refuse_other_versions(self) -> None:
        """Refuse to go on where its rows were made by other versions than those here.

        Raises:
            InputError: some are others; the sentence names both.
        """
        difference = _versions(self.campaign).difference(self.file.versions)
        if difference is not None:
            raise InputError(
                f"{self.folder} was begun by other versions: {difference}; a campaign's rows are "
                "made by one set of versions. Begin in another folder, and compare the two by "
                "`trebucheck campaign diff`."
            )

    # --- Chunks

    @property
    def chunks(self) -> int:
        """Number of chunks of the whole campaign."""
        return -(-self.file.machines // self.chunk_size)

    @cached_property
    def chunk_size(self) -> int:
        """Machines of a chunk."""
        return self.campaign.chunk_size(self.file.machines)

    def machines(self, chunk: int) -> range:
        """Numbers of the machines of a chunk."""
        size = self.chunk_size
        return range(chunk * size, min((chunk + 1) * size, self.file.machines))

    @cached_property
    def _design(self) -> Design:
        return Design(self.campaign)

    def part(self, chunk: int) -> DesignPart:
        """Machines of a chunk without those that conditions leave out, and their values."""
        machines = self.machines(chunk)
        return self._design.part(machines.start, machines.stop)

    @property
    def row_folder(self) -> Path:
        """Folder of the chunks' files."""
        return self.folder / _ROWS

    @property
    def files(self) -> list[Path]:
        """Files of the chunks that are there, in the order of the machines."""
        return sorted(self.row_folder.glob(_FILES))

    def path(self, chunk: int) -> Path:
        """Path of a chunk's file."""
        part = f"part={chunk // _IN_A_PART:04d}"
        return self.row_folder / part / f"chunk-{chunk:07d}.parquet"

    def write(self, chunk: int, content: bytes) -> None:
        """Write a chunk's file, as :func:`.table.as_parquet` makes it, whole or not at all.

        Raises:
            UnwritableError: the disk is full, or the folder cannot be written to; what is there is
                as it was.
        """
        try:
            write_bytes(self.path(chunk), content)
        except UnwritableError as error:
            raise UnwritableError(
                f"{error} The chunks that are written are intact; `trebucheck campaign resume "
                f"{self.folder}` goes on from there."
            ) from None

    def finished(self) -> set[int]:
        """Chunks with a whole file, without those with rows that are to be made again."""
        numbers = (int(path.stem.rpartition("-")[2]) for path in self.files)
        return {chunk for chunk in numbers if self._is_finished(chunk)}

    def _is_finished(self, chunk: int) -> bool:
        rows = self.read(chunk)
        return rows is not None and not any(map(self.is_to_repeat, self._states(rows)))

    @staticmethod
    def is_to_repeat(row: Mapping[str, Any]) -> bool:
        """Tell whether a row failed for its process's sake, or lacked an engine that is here."""
        if row.get("outcome") == Outcome.ABSENT.value:
            return engine_class(row["engine"]).is_installed()
        return bool(row.get("process_failed"))

    @staticmethod
    def _states(rows: Any) -> list[dict[str, Any]]:
        names = ("process_failed", "outcome", "engine")
        return rows.select([name for name in names if name in rows.column_names]).to_pylist()

    def read(self, chunk: int) -> Any:
        """Rows of a chunk as a `pyarrow.Table`; None where there is no whole file."""
        return _table_of(self.path(chunk))

    # --- The whole

    @cached_property
    def schema(self) -> Any:
        """Schema of the rows."""
        return schema_of(self.campaign)

    def dataset(self) -> Any:
        """Find all rows that are there: a `pyarrow.dataset.Dataset`, read as asked for."""
        import pyarrow.dataset as ds  # with pandas; processes that make rows need neither

        checked = ds.ParquetFragmentScanOptions(page_checksum_verification=True)
        form = ds.ParquetFileFormat(default_fragment_scan_options=checked)
        return ds.dataset(list(map(str, self.files)), schema=self.schema, format=form)

    @contextmanager
    def _reading(self) -> Generator[Any]:
        """Give the dataset; InputError if one of its files is broken."""
        try:
            yield self.dataset()
        except (OSError, pa.ArrowInvalid):
            broken = next((path for path in self.files if _table_of(path) is None), None)
            if broken is None:
                raise
            raise InputError(
                f"{broken} is broken; `trebucheck campaign resume {self.folder}` makes its rows "
                "again."
            ) from None

    def to_pandas(self, columns: list[str] | None = None) -> Any:
        """Read all rows that are there, in the order of the machines: a `pandas.DataFrame`.

        Raises:
            InputError: one of the files is broken.
        """
        with self._reading() as dataset:
            return dataset.to_table(columns=columns).to_pandas()

    @property
    def has_result(self) -> bool:
        """Tell whether a run was judged, or a machine launched."""
        with self._reading() as dataset:
            if self.campaign.runs is None:
                found = dataset.filter(pc.field("launched"))
            else:
                found = dataset.filter(pc.field("share").is_valid())
            return bool(found.count_rows() > 0)

    def __len__(self) -> int:
        """Number of rows that are there."""
        with self._reading() as dataset:
            return int(dataset.count_rows())


def _refuse_too_many(campaign: Campaign, machines: int) -> None:
    """Raise InputError if a campaign has more chunks than a folder may have files."""
    size = campaign.chunk_size(machines)
    if machines > _MOST_CHUNKS * size:
        raise InputError(
            f"{campaign.name!r} has {machines} machines in chunks of {size}: a folder holds "
            f"{_MOST_CHUNKS} chunks; cut it into several campaigns, or choose a larger chunk."
        )


def _table_of(path: Path) -> Any:
    """Rows of a file as a `pyarrow.Table`; None where it is missing or broken."""
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            return file.read()
    except (OSError, pa.ArrowInvalid):
        return None


def _versions(campaign: Campaign) -> Versions:
    names = () if campaign.runs is None else campaign.runs.engines
    return versions_here(names, _CODE)
