"""What pytest reports of the suite, where it reports: verdicts from whatever process, JUnit, and rows of deviations."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .distributed import ROWS
from .session import Session
from .verdicts import State, Verdict


class Reports:
    """A plug-in of the process that reports."""

    def __init__(self, config: pytest.Config, session: Session) -> None:
        self._config, self._session = config, session
        self._rows: set[str] = set()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: Any) -> None:
        """Take over a verdict, and give it its place in a JUnit file: the problem is the class, the check the name."""
        given = getattr(report, "trebucheck_verdict", None)
        if given is None or report.when != "call":
            return
        self._session.take(Verdict.from_json(given))
        from _pytest.junitxml import xml_key

        xml = self._config.stash.get(xml_key, None)
        if xml is not None:
            where, _, check = report.nodeid.rpartition("/")
            reporter = xml.node_reporter(report)
            reporter.add_attribute("classname", where.replace("/", "."))
            reporter.add_attribute("name", check)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Which rows the processes of pytest-xdist leave to this one."""
        self._rows.update(getattr(node, "workeroutput", {}).get(ROWS, ()))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Iterator[None]:
        """Judge the rows that no process could judge alone."""
        done = yield
        session.testscollected += len(self._rows)
        for id in self._session.rows:
            if id in self._rows:
                self._config.hook.pytest_runtest_logreport(report=_report(self._session.judged(id)))
        return done


def _report(verdict: Verdict) -> pytest.TestReport:
    skipped = str(Path.cwd()), 0, f"Skipped: {verdict.text}"
    outcome: Any = (
        "failed" if verdict.failed else "skipped" if verdict.state is State.SKIPPED else "passed"
    )
    said: Any = {"failed": verdict.complaint, "skipped": skipped, "passed": None}[outcome]
    report = pytest.TestReport(
        verdict.id,
        (verdict.id, None, verdict.id),
        {},
        outcome,
        said,
        "call",
        user_properties=verdict.properties,
    )
    report.trebucheck_verdict = verdict.to_json()  # type: ignore[attr-defined]
    return report
