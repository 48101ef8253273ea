"""One run of the suite: engines, problems, deviations, and what is written in the end."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..models.errors import InputError
from ..models.files import refuse_unwritable, write_text
from .deviations import Deviations
from .problems import given, problems_of
from .suite import References, Suite, Target
from .verdicts import Conformance, Verdict


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
        self._suites, self._tier, self._deviations, self._path = (
            tuple(suites),
            tier,
            deviations,
            path,
        )
        self._by_id = {id: suite for suite in self._suites for id in suite.ids}
        self._found: dict[str, Verdict] = {}
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
            sys.path.append(
                str(folder)
            )  # behind all that is installed: a file `rich.py` there is not meant for us
        if not options["timeout"] > 0:
            raise InputError(f"timeout = {options['timeout']!r} s must be positive.")
        asked = [name.strip() for text in options["problem"] for name in text.split(",")]
        names = tuple(dict.fromkeys(asked or problems_of(options["tier"])))
        for name in names:
            given(name)
        targets = dict.fromkeys(map(Target.of, engines))
        deviations = (
            Deviations.read(folder / options["deviations"])
            if options["deviations"]
            else Deviations()
        )
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

    def judged(self, id: str) -> Verdict:
        """The verdict on a check, or on a row of the file of deviations."""
        if id not in self._found:
            found = (
                self._row(id)
                if id in self.rows
                else self._deviations.applied(self._by_id[id].verdict(id))
            )
            self._found[id] = found
        return self._found[id]

    def take(self, verdict: Verdict) -> None:
        """Take over what another process has judged."""
        self._found.setdefault(verdict.id, verdict)

    def _row(self, id: str) -> Verdict:
        known = [*self._by_id, *(id for s in self._suites for id in _every_id(s))]
        rows = self._deviations.of_rows(
            known, self._found.values(), [suite.target.label for suite in self._suites]
        )
        return dict(zip(self.rows, rows, strict=True))[id]

    @property
    def results(self) -> Conformance:
        """What has been judged so far."""
        versions = {suite.target.label: suite.version for suite in self._suites}
        supplied = {suite.target.label: suite.supplied for suite in self._suites}
        verdicts = tuple(self._found[id] for id in self.ids if id in self._found)
        return Conformance.made_here(
            engines=versions, supplied=supplied, tier=self._tier, verdicts=verdicts
        )

    def write(self) -> None:
        """The verdicts, where a file was named and there are any; raises InputError if it cannot be written."""
        if self._path is not None and self._found:
            write_text(self._path, self.results.to_json())

    def close(self) -> None:
        """End the engines' processes."""
        for suite in self._suites:
            suite.close()


def _every_id(suite: Suite) -> tuple[str, ...]:
    """Of the engine's checks on all problems."""
    return Suite(suite.target, problems_of("full")).ids
