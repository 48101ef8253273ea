"""The pytest plug-in: `pytest --trebucheck NAME` runs the suite on one engine.

A fixture `trebucheck` serves tests of one's own. The plug-in is loaded by every pytest run of
whoever has trebucheck installed. It therefore imports nothing of trebucheck before one of its
options or its fixture is used.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .suite import Session
    from .verdicts import CheckVerdict


ROWS = "trebucheck_rows"
"""Key under which a process of pytest-xdist returns the rows of deviations that were chosen."""
_SLASHES = 3  # engine/preset/problem/check
_KEY: pytest.StashKey[Session] = pytest.StashKey()
_REQUIRED: pytest.StashKey[tuple[str, ...]] = pytest.StashKey()
"""Engines of --require-engine."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options."""
    group = parser.getgroup("trebucheck", "conformance of multibody engines")
    repeatable: dict[str, Any] = {"action": "append", "default": []}
    group.addoption(
        "--trebucheck", metavar="ENGINE", **repeatable,
        help="run trebucheck's suite on this engine and collect nothing else: NAME, NAME/PRESET, "
             "or package.module:Class; repeatable. Tests are collected as well only from paths "
             "that are named.",
    )  # fmt: skip
    group.addoption(
        "--trebucheck-problem", metavar="NAME", **repeatable,
        help="only these problems, comma-separated; repeatable",
    )  # fmt: skip
    group.addoption(
        "--trebucheck-tier", choices=("quick", "standard", "full"), default="standard",
        help="how many problems",
    )  # fmt: skip
    group.addoption(
        "--trebucheck-timeout", type=float, default=120.0, metavar="S",
        help="longest wait for one run (default: 120 s)",
    )  # fmt: skip
    group.addoption(
        "--trebucheck-deviations", metavar="FILE",
        help="TOML or JSON: known failures, each with id, reason and owner",
    )  # fmt: skip
    group.addoption("--trebucheck-json", metavar="FILE", help="write the verdicts as JSON")
    group.addoption(
        "--require-engine", metavar="NAME", **repeatable,
        help="fail if this engine is absent, or if every test of it is skipped; repeatable",
    )  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    """Start a session of the suite where one was asked for."""
    required: list[str] = config.getoption("--require-engine") or []
    engines: list[str] = config.getoption("--trebucheck") or []
    config.stash[_REQUIRED] = tuple(dict.fromkeys(name.partition("/")[0] for name in required))
    _HEARD.clear()
    names = ("tier", "problem", "timeout", "deviations", "json")
    options: dict[str, Any] = {name: config.getoption(f"--trebucheck-{name}") for name in names}
    if not engines:
        for name in ("problem", "deviations", "json"):
            if options[name]:
                raise pytest.UsageError(f"--trebucheck-{name} needs --trebucheck ENGINE")
        return
    from ..models.errors import TrebucheckError
    from .suite import Session

    folder = config.invocation_params.dir
    try:
        session = Session.of(engines, options, folder, config.stash[_REQUIRED])
    except TrebucheckError as error:
        raise pytest.UsageError(str(error)) from None
    config.stash[_KEY] = session
    config.add_cleanup(session.close)
    if _reports(config):
        config.pluginmanager.register(Reports(config, session), "trebucheck-reports")
    if config.args_source is not pytest.Config.ArgsSource.ARGS:
        config.args = []


def _reports(config: pytest.Config) -> bool:
    """Tell whether this process reports, and is not one that pytest-xdist has started for tests."""
    return not hasattr(config, "workerinput")


@pytest.hookimpl(tryfirst=True, optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """The checks of one problem go to one process: it is run once for all of them.

    Other tests are distributed as `--dist` says.
    """
    dist = str(config.getoption("dist"))
    if _KEY not in config.stash or dist == "each":
        return None
    from xdist.scheduler import LoadFileScheduling, LoadGroupScheduling, LoadScopeScheduling

    by_dist: dict[str, type[LoadScopeScheduling]] = {
        "loadfile": LoadFileScheduling,
        "loadgroup": LoadGroupScheduling,
    }
    known = by_dist.get(dist, LoadScopeScheduling)

    class ByProblem(known):  # type: ignore[misc,valid-type]
        def _split_scope(self, nodeid: str) -> str:
            if "::" not in nodeid and nodeid.count("/") == _SLASHES:
                return nodeid.rpartition("/")[0]
            return nodeid if dist in ("load", "worksteal") else str(super()._split_scope(nodeid))

    return ByProblem(config, log)


class ConformanceItem(pytest.Item):
    """One check of one engine."""

    verdict: CheckVerdict | None = None

    def runtest(self) -> None:
        """Judge it; the first check of a problem runs it."""
        verdict = self.verdict = self.config.stash[_KEY].judged(self.name)
        self.user_properties += verdict.properties
        if verdict.failed:
            raise CheckFailedError(verdict.complaint)
        if verdict.state.value == "known deviation":
            pytest.xfail(verdict.text)
        if verdict.state.value == "skipped":
            pytest.skip(verdict.text)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """The sentence alone, where the check failed."""
        if isinstance(excinfo.value, CheckFailedError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """A check is at no line of any file."""
        return self.path, None, self.name


class CheckFailedError(Exception):
    """A check's sentence."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> Iterator[None]:
    """Add the suite; -k and --last-failed then choose from it as from any tests.

    One process of several does not know what the others find: rows of the file of deviations are
    judged in the end.
    """
    if _KEY not in config.stash:
        return (yield)
    suite = ConformanceSuite.from_parent(session, name="trebucheck", nodeid="trebucheck")
    items.extend(suite.collect())
    session.testscollected = len(items)
    yield
    if not _reports(config):
        ids = config.stash[_KEY].rows
        rows = [item for item in items if item.name in ids and isinstance(item, ConformanceItem)]
        items[:] = [item for item in items if item not in rows]
        config.workeroutput[ROWS] = [item.name for item in rows]  # type: ignore
    return None


class ConformanceSuite(pytest.Collector):
    """The checks of all engines asked for."""

    def collect(self) -> Iterator[ConformanceItem]:
        """One item a check."""
        for name in self.config.stash[_KEY].ids:
            yield ConformanceItem.from_parent(self, name=name, nodeid=name)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Note on a report which engines its test asked for; other processes send reports, too."""
    outcome: Any = yield
    checker = getattr(item, "funcargs", {}).get("trebucheck")
    asked: list[str] = [item.name.partition("/")[0]] if isinstance(item, ConformanceItem) else []
    report = outcome.get_result()
    report.trebucheck_engines = sorted(checker.asked) if isinstance(checker, _Checker) else asked
    if isinstance(item, ConformanceItem) and item.verdict is not None:
        report.trebucheck_verdict = item.verdict.to_json()


def pytest_runtest_logreport(report: Any) -> None:
    """Note of which engines a test has said something."""
    if report.when == "call" and not report.skipped:
        _HEARD.update(getattr(report, "trebucheck_engines", ()))


_HEARD: set[str] = set()
"""Engines of which a test that was not skipped has said something, in this session."""


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Write the JSON; an engine that was required and said nothing fails the session."""
    if not _reports(session.config):
        return
    if _KEY in session.config.stash:
        session.config.stash[_KEY].write()
    if _silent(session.config) and exitstatus in (0, pytest.ExitCode.NO_TESTS_COLLECTED):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say which required engines said nothing."""
    for name in _silent(config):
        terminalreporter.write_line(
            f"--require-engine {name}: no test of it has run: absent, or all skipped", red=True
        )


def _silent(config: pytest.Config) -> list[str]:
    if config.getoption("collectonly", False):
        return []
    return [name for name in config.stash[_REQUIRED] if name not in _HEARD]


class _Checker:
    """Value of the fixture `trebucheck`."""

    def __init__(self, required: Container[str]) -> None:
        self._required, self.asked = required, set[str]()

    def check(self, engine: str, model: Any = "fixed", **given: Any) -> Any:
        """Call `trebucheck.check`; an absent engine skips the test, unless it is required."""
        __tracebackhide__ = True
        from ..models.errors import EngineNotInstalledError
        from .check import check
        from .suite import Target

        name = Target.of(engine).engine
        self.asked.add(name)
        try:
            return check(engine, model, **given)
        except EngineNotInstalledError as error:
            if name in self._required:
                pytest.fail(f"--require-engine: {error}", pytrace=False)
            pytest.skip(str(error))


@pytest.fixture
def trebucheck(request: pytest.FixtureRequest) -> _Checker:
    """Fixture: `trebucheck.check("mujoco", "fixed", position=1e-6)` asserts with reasons."""
    return _Checker(request.config.stash[_REQUIRED])


class Reports:
    """Plug-in of the process that reports: verdicts of any process, JUnit, deviations."""

    def __init__(self, config: pytest.Config, session: Session) -> None:
        self._config, self._session = config, session
        self._rows: set[str] = set()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: Any) -> None:
        """Take over a verdict; in a JUnit file the problem is the class, the check the name."""
        from .verdicts import CheckVerdict

        given = getattr(report, "trebucheck_verdict", None)
        if given is None or report.when != "call":
            return
        self._session.take(CheckVerdict.from_json(given))
        from _pytest.junitxml import xml_key

        xml = self._config.stash.get(xml_key, None)
        if xml is not None:
            where, _, check = report.nodeid.rpartition("/")
            reporter = xml.node_reporter(report)
            reporter.add_attribute("classname", where.replace("/", "."))
            reporter.add_attribute("name", check)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Note the rows that a process of pytest-xdist leaves to this one."""
        self._rows.update(getattr(node, "workeroutput", {}).get(ROWS, ()))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Iterator[None]:
        """Judge the rows that no process could judge alone."""
        done = yield
        session.testscollected += len(self._rows)
        for id in self._session.rows:
            if id in self._rows:
                verdict = self._session.judged(id)
                outcome, text = "passed", None
                if verdict.failed:
                    outcome, text = "failed", verdict.complaint
                elif verdict.state.value == "skipped":
                    outcome, text = "skipped", (str(Path.cwd()), 0, f"Skipped: {verdict.text}")
                make_report: Any = pytest.TestReport
                report = make_report(id, (id, None, id), {}, outcome, text, "call")
                report.user_properties = verdict.properties
                report.trebucheck_verdict = verdict.to_json()
                self._config.hook.pytest_runtest_logreport(report=report)
        return done
