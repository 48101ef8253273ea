"""What is taken from a store.

Only what was made under the same conditions and has not been changed since.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import plugin_engines
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.compare import (
    Comparison,
    compare_study,
    read_results,
    stored,
)
from trebucheck.comparisons.report.html import page
from trebucheck.comparisons.report.pages.compare import document
from trebucheck.comparisons.runs import runner as running
from trebucheck.comparisons.runs import store as store_module
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.record import EngineRuns
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.store import Store, conditions, engine_digest
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.registry import engine_class
from trebucheck.models.errors import UnwritableError

ANOTHER: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "engine": lambda patch: patch.setattr(
        engine_class("reference"), "version", classmethod(lambda cls: "another")
    ),
    "NumPy": lambda patch: patch.setattr(store_module.numpy, "__version__", "9.9.9"),
    "SciPy": lambda patch: patch.setattr(store_module.scipy, "__version__", "9.9.9"),
    "trebucheck": lambda patch: patch.setattr(store_module, "__version__", "another"),
    "code": lambda patch: patch.setattr(store_module, "code_digest", lambda *_: "another"),
    "Python": lambda patch: patch.setattr(
        store_module.platform, "python_version", lambda: "another"
    ),
    "computer": lambda patch: patch.setattr(store_module.platform, "machine", lambda: "another"),
}


def _study(folder: Path, until: float | None = 0.5) -> Study:
    store = Store(folder / "trajectories", True, folder / "runs")
    return Study(["fixed"], ["reference"], ["assisted"], until=until, store=store, isolate=False)


def _again(folder: Path) -> tuple[Comparison, tuple[int, int]]:
    """A comparison from the store, and how many of its runs were taken and made."""
    study = _study(folder)
    comparison = compare_study(study)
    assert study.store is not None
    return comparison, (len(study.store.taken), len(study.store.made))


@pytest.mark.parametrize("what", ANOTHER)
def test_another_version_of_anything_makes_the_run_anew(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _again(tmp_path)[1] == (0, 1)
    assert _again(tmp_path)[1] == (1, 0)
    ANOTHER[what](monkeypatch)
    comparison, counts = _again(tmp_path)
    assert counts == (0, 1) and not comparison.repeated
    assert _again(tmp_path)[1] == (1, 0)


def _changed_figure(path: Path) -> None:
    """A valid record that says something else."""
    kept = json.loads(path.read_text())
    kept["content"]["steps"] += 1
    path.write_text(json.dumps(kept))


def _changed_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))


DAMAGE: dict[str, Callable[[Path], object]] = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "empty": lambda path: path.write_bytes(b""),
    "a bit": _changed_bit,
    "list": lambda path: path.write_text("[1, 2]"),
    "number": lambda path: path.write_text("1e400"),
    "long number": lambda path: path.write_text("1" * 5000),
    "deep": lambda path: path.write_text("[" * 100_000),
    "other types": lambda path: path.write_text(
        '{"conditions": 3, "checksum": [], "content": null}'
    ),
    "no text": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "folder": lambda path: (path.unlink(), path.mkdir()),
}
FILES = (
    "trajectories/fixed-reference-assisted.nc",
    "runs/fixed-reference-assisted.nc.json",
    "runs/fixed-reference-assisted.json",
    "runs/fixed.json",
)


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_made_anew(name: str, tmp_path: Path) -> None:
    first = compare_study(_study(tmp_path))
    for how in ("cut", "other types"):
        DAMAGE[how](tmp_path / name)
        again, _ = _again(tmp_path)
        # The trajectory's own record is not asked for where the measured run is whole.
        assert again.repeated == (name == FILES[1])
        assert [run.metrics for run in again.results.runs] == [
            run.metrics for run in first.results.runs
        ]
        again, counts = _again(tmp_path)
        assert again.repeated and counts == (1, 0)


@pytest.mark.parametrize("how", [how for how in DAMAGE if how != "folder"])
def test_all_files_damaged_make_it_anew(how: str, tmp_path: Path) -> None:
    compare_study(_study(tmp_path))
    for name in FILES:
        DAMAGE[how](tmp_path / name)
    assert _again(tmp_path)[1] == (0, 1)
    assert _again(tmp_path)[1] == (1, 0)


def test_a_changed_figure_is_not_believed(tmp_path: Path) -> None:
    first = compare_study(_study(tmp_path)).results.runs[0].steps
    _changed_figure(tmp_path / "runs" / "fixed-reference-assisted.json")
    again, counts = _again(tmp_path)
    assert again.results.runs[0].steps == first
    assert counts == (1, 0), "its trajectory is whole: only the measuring is done again"


def test_a_file_that_cannot_be_kept_ends_the_comparison(tmp_path: Path) -> None:
    """It is no failure of the engine: no row says so, and what was finished before it stays."""
    compare_study(_study(tmp_path))
    DAMAGE["folder"](tmp_path / FILES[0])
    with pytest.raises(UnwritableError, match="it is a folder"):
        compare_study(_study(tmp_path))


def test_trials_with_and_without_curves_are_not_mixed_up(tmp_path: Path) -> None:
    store, engine = Store(tmp_path, True, tmp_path), tb.engine("reference")
    short = EngineRuns(Runner(tb.fixed()), store, curves=False).record(engine)
    assert short.ran and short.metrics and short.curves is None
    record = EngineRuns(Runner(tb.fixed()), replace(store)).record(engine)
    assert record.metrics == short.metrics
    assert record.curves is not None and len(record.curves.energy) > 1


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def _forget() -> None:
    for cached in (store_module.code_digest, store_module.engine_digest):
        cached.cache_clear()


SOURCES = {
    # file: whether it decides a run, and whether it decides what compare keeps of it
    "models/mechanism.py": (True, True),
    "reference/certification/certificates/fixed.json": (True, True),
    "engines/impact.py": (True, True),
    "engines/reference/engine.py": (True, True),
    "engines/pymunk/engine.py": (False, False),
    "comparisons/runs/metrics.py": (True, True),
    "comparisons/diagnosis/fit.py": (False, True),
    "comparisons/report/html.py": (False, False),
    "cli/app.py": (False, False),
}


@pytest.mark.parametrize("changed", SOURCES)
def test_a_run_is_made_anew_if_a_file_changes_that_it_depends_on(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comment in a report's module discards nothing."""
    monkeypatch.setattr(store_module, "_ROOT", tmp_path)
    for file in SOURCES:
        _write(tmp_path / file, "1")

    def both() -> tuple[str, str]:
        _forget()
        engine = tb.engine("reference")
        return conditions(engine=engine), conditions(engine=engine, code="comparisons/diagnosis")

    before = both()
    assert both() == before
    _write(tmp_path / changed, "2")
    after = both()
    _forget()
    assert tuple(old != new for old, new in zip(before, after, strict=True)) == SOURCES[changed]


@pytest.mark.parametrize("changed", ["written_today/deeper/engine.py", "trebucheck_tools/kit.py"])
def test_a_plug_in_that_is_being_written_is_run_again(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a package of the family changes that it imports."""
    _write(tmp_path / "written_today" / "__init__.py", "")
    _write(tmp_path / "written_today" / "deeper" / "engine.py", "import trebucheck_tools.kit\n")
    _write(tmp_path / "trebucheck_tools" / "__init__.py", "")
    _write(tmp_path / "trebucheck_tools" / "kit.py", "STEP = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("written_today", "trebucheck_tools"):
        importlib.import_module(name)
    before = engine_digest("written_today.deeper.engine")
    _write(tmp_path / changed, "import trebucheck_tools.kit\nSTEP = 2\n")
    _forget()
    assert engine_digest("written_today.deeper.engine") != before
    _forget()
    for name in ("written_today", "trebucheck_tools"):
        del sys.modules[name]


def test_other_tolerances_judge_the_kept_runs_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No engine runs and nothing is measured again; what is broken now is diagnosed now."""
    engine, options = ["pymunk"], {"timestep": 5e-3}
    study = replace(
        _study(tmp_path), engines=engine, options=options, tolerances={"default": "90%"}
    )
    first = compare_study(study)
    assert first.passed and first.results.runs[0].diagnosis is None
    store = _study(tmp_path).store
    fine = replace(study, tolerances={"default": "0.0001%"}, store=store)
    fresh = compare_study(replace(fine, store=None)).results
    monkeypatch.setattr(running, "measure", None)
    again = compare_study(fine)
    assert store is not None and (len(store.taken), len(store.made)) == (1, 0)
    assert not again.repeated and not again.passed
    (run,), (expected,) = again.results.runs, fresh.runs
    assert run.metrics == expected.metrics
    assert run.diagnosis == expected.diagnosis and run.diagnosis is not None
    assert again.results.machines == fresh.machines
    assert compare_study(replace(fine, store=_study(tmp_path).store)).repeated


def test_causes_that_were_not_looked_for_are_found_when_they_are_asked_for(tmp_path: Path) -> None:
    """The store keeps runs without a diagnosis, and verdicts do not depend on it."""
    study = replace(
        _study(tmp_path),
        engines=["pymunk"],
        options={"timestep": 5e-3},
        tolerances={"default": "0.0001%"},
    )
    (without,) = compare_study(replace(study, diagnose=False)).results.runs
    (found,) = compare_study(replace(study, store=_study(tmp_path).store)).results.runs
    assert without.outcome is found.outcome is Outcome.DISAGREES
    assert without.metrics == found.metrics
    assert without.diagnosis is None and found.diagnosis is not None
    again = compare_study(replace(study, diagnose=False, store=_study(tmp_path).store))
    assert again.results.runs[0].diagnosis is None


def test_a_comparison_read_again_has_the_reference_that_it_was_made_with(tmp_path: Path) -> None:
    """With its impacts, and as far as an engine may end later than the reference."""
    store = Store(tmp_path / "trajectories")
    made = compare_study(
        Study(["bouncing"], ["reference"], ["assisted"], until=1.0, store=store, isolate=False)
    )
    (tmp_path / "results.json").write_text(made.results.to_json())
    again = stored(tmp_path)
    (machine,), name = again.results.machines, made.results.machines[0].model
    assert machine.stop_law is tb.StopLaw.UNILATERAL
    assert machine.impacts > 0
    assert again.solutions[name].impacts == made.solutions[name].impacts
    assert "unilateral" in page(document(again))


def test_the_settings_of_an_engine_are_among_the_conditions() -> None:
    engines = [
        tb.engine("reference"),
        tb.engine("reference", timestep=2e-3),
        tb.engine("reference", rtol=1e-11),
    ]
    all_conditions = {conditions(engine=engine) for engine in engines} | {
        conditions("1", "2"),
        conditions("12"),
    }
    assert len(all_conditions) == 5


def test_a_preset_is_a_condition_where_it_may_decide_more_than_the_settings_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a plug-in; settings of a built-in engine are all of it."""
    plugin_engines.announce(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assisted, default = (plugin_engines.Echo(preset=preset) for preset in ("assisted", "default"))
    assert assisted.settings == default.settings
    assert conditions(engine=assisted) != conditions(engine=default)
    own, same = (
        tb.engine("reference"),
        tb.engine("reference", "default", **tb.engine("reference").settings),
    )
    assert own.preset != same.preset and own.settings == same.settings
    assert conditions(engine=own) == conditions(engine=same)


@pytest.mark.parametrize("lost", [None, "runs/fixed-reference-assisted.json"])
def test_times_taken_from_a_store_are_still_of_as_many_runs_at_once(
    lost: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the whole run is taken, or its trajectory alone.

    What is made anew is disturbed by nothing.
    """
    monkeypatch.setattr(Study, "worker", lambda study: Worker(isolate=False, jobs=study.at_once))
    out = [
        "compare",
        "--models",
        "fixed",
        "--engines",
        "reference",
        "--preset",
        "assisted",
        "--until",
        "0.5",
    ]
    found: list[int] = []
    for more in (["--jobs", "2"], ["--resume"], ["--resume"], []):
        assert main([*out, "--out", str(tmp_path), *more]) == 0
        found.append(read_results(tmp_path).jobs)
        assert ("2 runs at once" in (tmp_path / "report.html").read_text()) == (found[-1] == 2)
        if lost:
            (tmp_path / lost).unlink()
    assert found == [2, 2, 2, 1]


@pytest.mark.slow
def test_trials_taken_from_a_store_are_still_of_as_many_runs_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Study, "worker", lambda study: Worker(isolate=False, jobs=study.at_once))
    machine = ["--model", "pendulum", "--engines", "pymunk", "--out", str(tmp_path)]
    commands = {
        "explain": ["--preset", "assisted", "--until", "0.1", "--timestep", "5e-3"],
        "recommend": ["--position", "1e-2", "--until", "0.1", "--neighbours", "0"],
    }
    assert len(commands) > 0
    for command, more in commands.items():
        for run in (["--jobs", "2"], ["--resume"]):
            assert main([command, *machine, *more, *run]) == 0
            assert json.loads((tmp_path / f"{command}.json").read_text())["jobs"] == 2
