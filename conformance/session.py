"""One run of the suite: engines, problems, known deviations, and the file of verdicts."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

from pydantic import StringConstraints

from ..engines.registry import engine_class, engine_names
from ..models.errors import InputError
from ..models.files import read_bytes, refuse_unwritable, write_text
from ..models.spec import Spec
from .suite import References, Suite, Target, given, problems_of
from .verdicts import CheckState, CheckVerdict, Conformance

_Told = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
_LARGEST = 1_000_000


class Deviation(Spec):
    """A row: checks that are known to fail."""

    id: _Told
    """Of a check, or a pattern of several: `*`, `?` and `[...]` stand for parts of it."""
    reason: _Told
    owner: _Told

    def covers(self, id: str) -> bool:
        """Whether a check is among its own."""
        return id == self.id or fnmatchcase(id, self.id)

    def of_another_engine(self, labels: Collection[str]) -> str:
        """Reason for not being about these engines (engine/preset), if it is about another one."""
        engine, _, rest = self.id.partition("/")
        preset = rest.partition("/")[0]
        own = any(fnmatchcase(label, f"{engine}/{preset}") for label in labels)
        if own or engine not in engine_names():
            return ""
        try:
            presets = engine_class(engine).presets()
        except Exception:  # of a plug-in that cannot be loaded
            return "of an engine that is not run"
        known = any(fnmatchcase(each, preset) for each in presets)
        return "of an engine that is not run" if known else ""

    @property
    def text(self) -> str:
        """Reason and owner."""
        return f"{self.reason} (owner: {self.owner})"


class Deviations(Spec):
    """The whole of a file."""

    deviation: tuple[Deviation, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Deviations:
        """From TOML (tables [[deviation]]) or JSON ({"deviation": [...]}), by the file's name.

        Raises:
            InputError: it cannot be read, or a row lacks its id, reason or owner.
        """
        content = read_bytes(path, _LARGEST).decode(errors="replace")
        try:
            parsed: Any = json.loads(content) if path.suffix == ".json" else tomllib.loads(content)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} cannot be read: {error}.") from None
        if not isinstance(parsed, dict):
            raise InputError(f"{path} must hold rows 'deviation', each with id, reason and owner.")
        if isinstance(parsed.get("deviation"), dict):
            raise InputError(
                f"{path}: deviation is one table; a list of them is needed: [[deviation]] in TOML."
            )
        try:
            return cls(**parsed)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def applied(self, verdict: CheckVerdict) -> CheckVerdict:
        """The verdict; of a failure that a row covers, that it is a known deviation."""
        row = next((row for row in self.deviation if row.covers(verdict.id)), None)
        if row is None or not verdict.failed:
            return verdict
        update = {"state": CheckState.DEVIATES, "text": f"{row.text}: {verdict.text}"}
        return verdict.model_copy(update=update)

    def of_rows(
        self, ids: Iterable[str], verdicts: Iterable[CheckVerdict], labels: Collection[str]
    ) -> Iterator[CheckVerdict]:
        """A verdict on each row: broken if it is about no check, or about none that fails.

        Args:
            ids: of all checks there are of these engines, run or not.
            verdicts: of those that were run, rows applied.
            labels: engine/preset of these engines; rows of others that there are say nothing here.
        """
        every, found = tuple(ids), tuple(verdicts)
        for row in self.deviation:
            other = row.of_another_engine(labels)
            skipped = {"state": CheckState.SKIPPED, "text": f"row {row.id!r}: {other}"}
            state: dict[str, Any] = skipped if other else _of_row(row, every, found)
            yield CheckVerdict(id=f"deviations/file/row/{row.id}", **state)


def _of_row(
    row: Deviation, ids: tuple[str, ...], verdicts: tuple[CheckVerdict, ...]
) -> dict[str, Any]:
    if not any(map(row.covers, ids)):
        text = f"row {row.id!r} is about no check that there is"
        return {"state": CheckState.BROKEN, "text": text}
    own = [verdict for verdict in verdicts if row.covers(verdict.id)]
    if not own:
        return {"state": CheckState.SKIPPED, "text": f"row {row.id!r}: none of its checks was run"}
    if all(verdict.state is not CheckState.DEVIATES for verdict in own):
        text = f"row {row.id!r} is stale: none of its checks fails; take it out"
        return {"state": CheckState.BROKEN, "text": text}
    return {"state": CheckState.KEPT}


class Session:
    """Suites of one or several engines on the same problems.

    Args:
        suites: one an engine.
        tier: of the problems.
        deviations: known ones.
        path: where the verdicts are written; None: nowhere.
    """

    def __init__(
        self, suites: Sequence[Suite], tier: str, deviations: Deviations, path: Path | None = None
    ) -> None:
        self._suites, self._tier = tuple(suites), tier
        self._deviations, self._path = deviations, path
        self._by_id = {id: suite for suite in self._suites for id in suite.ids}
        self._found: dict[str, CheckVerdict] = {}
        self.rows = tuple(f"deviations/file/row/{row.id}" for row in deviations.deviation)
        """Ids of the rows of the file of deviations, among all ids the last."""
        self.ids = (*self._by_id, *self.rows)
        """Of all checks; those of the rows of the file of deviations come last."""

    @classmethod
    def of(
        cls,
        engines: Sequence[str],
        options: Mapping[str, Any],
        folder: Path,
        required: Sequence[str] = (),
    ) -> Session:
        """From the texts of a command line.

        Args:
            engines: as :meth:`.suite.Target.of` reads them.
            options: 'tier', 'problem' (names, comma-separated; those of the tier where empty),
                'timeout' [s], 'deviations' and 'json' (paths, or None).
            folder: in which packages of engines that are not installed, and files, are looked for.
            required: engines that fail if they are not installed.

        Raises:
            InputError: a name, a value or a file is not valid.
        """
        if str(folder) not in sys.path:
            # Behind all that is installed: a file `rich.py` there is not meant for us
            sys.path.append(str(folder))
        if not options["timeout"] > 0:
            raise InputError(f"timeout = {options['timeout']!r} s must be positive.")
        asked = [name.strip() for text in options["problem"] for name in text.split(",")]
        names = tuple(dict.fromkeys(asked or problems_of(options["tier"])))
        for name in names:
            given(name)
        targets = dict.fromkeys(map(Target.of, engines))
        known = options["deviations"]
        deviations = Deviations.read(folder / known) if known else Deviations()
        path = folder / options["json"] if options["json"] else None
        if path:
            refuse_unwritable(path.parent, path.name)
        references = References()
        suites = [
            Suite(t, names, references, options["timeout"], t.engine in required) for t in targets
        ]
        return cls(suites, "chosen" if options["problem"] else options["tier"], deviations, path)

    @property
    def suites(self) -> tuple[Suite, ...]:
        """One an engine."""
        return self._suites

    def judged(self, id: str) -> CheckVerdict:
        """The verdict on a check, or on a row of the file of deviations."""
        if id not in self._found:
            if id in self.rows:
                self._found[id] = self._row(id)
            else:
                self._found[id] = self._deviations.applied(self._by_id[id].verdict(id))
        return self._found[id]

    def take(self, verdict: CheckVerdict) -> None:
        """Take over what another process has judged."""
        self._found.setdefault(verdict.id, verdict)

    def _row(self, id: str) -> CheckVerdict:
        known = [*self._by_id, *(id for s in self._suites for id in _every_id(s))]
        rows = self._deviations.of_rows(
            known, self._found.values(), [suite.target.label for suite in self._suites]
        )
        return dict(zip(self.rows, rows, strict=True))[id]

    @property
    def results(self) -> Conformance:
        """The verdicts so far."""
        versions = {suite.target.label: suite.version for suite in self._suites}
        supplied = {suite.target.label: suite.supplied for suite in self._suites}
        verdicts = tuple(self._found[id] for id in self.ids if id in self._found)
        return Conformance.made_here(
            engines=versions, supplied=supplied, tier=self._tier, verdicts=verdicts
        )

    def write(self) -> None:
        """Write the verdicts, if a file was named and there are any; may raise InputError."""
        if self._path is not None and self._found:
            write_text(self._path, self.results.to_json())

    def close(self) -> None:
        """End the engines' processes."""
        for suite in self._suites:
            suite.close()


def _every_id(suite: Suite) -> tuple[str, ...]:
    """Ids of the engine's checks on all problems."""
    return Suite(suite.target, problems_of("full")).ids
