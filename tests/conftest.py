"""Shared fixtures: which engines, which machines, and one fixed profile for random ones."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import plugin_engines
import pytest
import shared
import trebucheck as tb
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from trebucheck.cli.app import main
from trebucheck.engines.registry import engine_class, engine_names

# Derandomised: a red run is red again on the next machine. `HYPOTHESIS_PROFILE=search` looks
# further.
_COMMON = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
}
_NO_SHRINKING = (
    Phase.explicit,
    Phase.generate,
)  # a failing machine is shown as found: shrinking takes minutes
_FIXED = {"derandomize": True, "database": None, "phases": _NO_SHRINKING, **_COMMON}
settings.register_profile("ci", max_examples=20, **_FIXED)
settings.register_profile("few", max_examples=6, **_FIXED)  # of `make test`
settings.register_profile("search", max_examples=200, **_COMMON)
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "ci")
settings.load_profile(PROFILE)


def fewer(number: Any, few: Any) -> Any:
    """What a test takes of something: the second with `make test`, else the first."""
    return few if PROFILE == "few" else number


def machines(number: int, few: int | None = None) -> settings:
    """Settings of a test of so many random machines; of fewer with `make test`, by default of a
    third.
    """
    return settings(max_examples=fewer(number, max(1, number // 3) if few is None else few))


shared.share_motions()
again = pytest.mark.again
"""The same evidence on a further machine: left to `make test-all`."""


BUILT_IN = ("mujoco", "pymunk", "exudyn")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--engines", default="", help="comma-separated engines to test; all known ones by default"
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "engine_name" in metafunc.fixturenames:
        asked = metafunc.config.getoption("--engines", default="")
        names = asked.split(",") if asked else list(engine_names())
        metafunc.parametrize("engine_name", [_param(name) for name in names])


def _param(name: str) -> object:
    absent = not engine_class(name).is_installed()
    return pytest.param(
        name, marks=pytest.mark.skipif(absent, reason=f"{name} is not installed here"), id=name
    )


def pytest_configure(config: pytest.Config) -> None:
    gc.disable()  # while thousands of tests are collected, none of which is garbage
    config.addinivalue_line("markers", "needs(*names): engines without which the test is skipped")


def pytest_collection_finish() -> None:
    """The garbage collector need not go through all tests, neither now nor again and again."""
    gc.enable()
    gc.freeze()
    gc.set_threshold(20_000, 25, 25)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests whose engine is absent, before they run; a test that fails is always a failure.

    A test needs the engines that its mark `needs` names, and those that are its parameters.
    """
    for item in items:
        marked = {name for mark in item.iter_markers("needs") for name in mark.args}
        parameters = getattr(item, "callspec", None)
        values = parameters.params.values() if parameters else ()
        marked |= {value for value in values if isinstance(value, str) and value in BUILT_IN}
        for name in sorted(marked):
            if not engine_class(name).is_installed():
                item.add_marker(pytest.mark.skip(reason=f"{name} is not installed here"))


@pytest.fixture(params=[tb.fixed, tb.rolling], ids=["fixed", "rolling"])
def build(request: pytest.FixtureRequest) -> object:
    """Builder of a machine from its parameters."""
    return request.param


@pytest.fixture(scope="session")
def _plug_ins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all tests, so that processes that have it on their path serve them all."""
    folder = tmp_path_factory.mktemp("site")
    plugin_engines.announce(folder)
    return folder


@pytest.fixture
def third_party(_plug_ins: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Engines announced by entry points, as an installed distribution announces them."""
    monkeypatch.syspath_prepend(str(_plug_ins))


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """The sentence by which the command line refuses its arguments.

    Exit code 2, nothing printed, nothing written.
    """

    def run(*arguments: str) -> str:
        monkeypatch.chdir(tmp_path)
        before = sorted(tmp_path.iterdir())
        assert main(list(arguments)) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("error: ")
        assert captured.err.count("\n") == 1, captured.err
        assert "Traceback" not in captured.err
        assert sorted(tmp_path.iterdir()) == before
        return captured.err

    return run


@pytest.fixture(scope="session")
def _idle_processes() -> Iterator[shared.Idle]:
    """Of commands that have ended."""
    idle: shared.Idle = []
    yield idle
    for _, process in idle:
        process.shutdown(wait=True, kill_workers=True)


@pytest.fixture(autouse=True)
def _shared(request: pytest.FixtureRequest, _idle_processes: shared.Idle) -> Iterator[None]:
    """Motions of the reference, and processes, that tests of other things have had."""
    marks = {mark.name for mark in request.node.iter_markers()}
    of_the_reference = "verification" in request.path.parts
    shared.switch_motions(not of_the_reference and "own_motions" not in marks)
    if "own_processes" in marks:
        yield
        return
    with shared.shared_processes(_idle_processes):
        yield


def machine_parameters() -> st.SearchStrategy[tb.TrebuchetParameters]:
    """Machines a builder might think of, away from Table I in every length, mass and start
    angle."""
    return st.builds(
        tb.TrebuchetParameters,
        l1=st.floats(7.0, 12.0),
        l2=st.floats(2.5, 5.0),
        r=st.floats(4.0, 8.0),
        h=st.floats(6.0, 12.0),
        m_b=st.floats(30.0, 150.0),
        m_cw=st.floats(1500.0, 5000.0),
        m_a=st.floats(300.0, 2000.0),
        theta0=st.floats(-0.2, 0.3),
        phi0=st.floats(math.pi - 0.2, math.pi + 0.3),
        alpha0=st.floats(-math.pi / 4 - 0.3, -math.pi / 4 + 0.3),
    )
