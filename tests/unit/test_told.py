"""How much a command says, its progress, what a shell completes, and several processes at once."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
import trebucheck as tb
from conftest import again
from rich.console import Console
from trebucheck.__main__ import main
from trebucheck.cli import output
from trebucheck.comparisons.report import terminal
from trebucheck.comparisons.runs.process import in_order
from trebucheck.comparisons.runs.runner import Runner, farthest
from trebucheck.reference.certification import certify as certification
from trebucheck.reference.certification.certificate import load_certificate

COMPARE = [
    "compare",
    "--model",
    "fixed",
    "--engines",
    "reference",
    "--duration",
    "0.3",
    "--timestep",
    "5e-3",
]


def _said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    main(arguments)
    return capsys.readouterr().out


@pytest.mark.slow
def test_json_is_the_results_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(
        "COLUMNS", raising=False
    )  # which workers of the tests have, and pipes have not
    said = _said([*COMPARE, "--json", "--out", str(tmp_path)], capsys)
    assert json.loads(said) == json.loads((tmp_path / "results.json").read_text())
    quiet = _said([*COMPARE, "--resume", "--quiet", "--out", str(tmp_path)], capsys).splitlines()
    assert (
        len(quiet) == 2 and re.match(r"Agreement|Nothing", quiet[0]) and "results.json" in quiet[1]
    )


def test_quiet_and_json_of_a_throw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        json.loads(_said(["throw", "--json", "--out", str(tmp_path)], capsys))["mechanism"]["name"]
        == "fixed"
    )
    first, second = _said(["throw", "-q", "--out", str(tmp_path)], capsys).splitlines()
    assert first.startswith("fixed: 1007.7 m, released at 2.74282 s") and "throw.json" in second


def test_quiet_and_json_of_certificates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(
        certification, "certify", lambda mechanism, *_, **__: load_certificate(mechanism)
    )
    asked = ["certify", "--out", str(tmp_path)]
    found = json.loads(_said([*asked, "--json"], capsys))
    assert found == [
        json.loads((tmp_path / f"{name}.json").read_text()) for name in ("fixed", "rolling")
    ]
    assert all((tmp_path / f"{each['model']}.html").is_file() for each in found)
    lines = _said([*asked, "--quiet"], capsys).splitlines()
    assert len(lines) == 4 and lines[0].startswith("fixed: ") and "fixed.json" in lines[1]


def test_progress_has_the_time_left_on_standard_error(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = StringIO()
    shown = Console(file=screen, force_terminal=True, width=100, color_system=None)
    monkeypatch.setattr(terminal, "progress_console", lambda: shown)
    clock = iter(range(0, 100_000, 10))
    with output.progress("reference", 20) as show:
        bar = show.__closure__  # the bar itself is the context's own
        assert bar is not None
        rich_bar = next(
            cell.cell_contents for cell in bar if hasattr(cell.cell_contents, "get_time")
        )
        rich_bar.get_time = lambda: float(next(clock))
        for done in range(4):
            show(f"part {done}", done, 8)
        rich_bar.refresh()
        (task,) = rich_bar.tasks
        assert task.time_remaining is not None
        assert task.completed == 3 and task.total == 8
    said = screen.getvalue()
    assert "part 3" in said and "3/8" in said and "left" in said


def test_progress_without_a_terminal_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log of CI tells that the work goes on; what is soon done prints nothing."""
    clock = iter(range(0, 1000, 10))
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    with output.progress("reference") as show:
        for done in range(8):
            show(f"part {done}", done, 8)
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.splitlines() == ["2 of 8: part 2", "5 of 8: part 5"]


def test_quiet_has_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = StringIO()
    monkeypatch.setattr(
        terminal, "progress_console", lambda: Console(file=screen, force_terminal=True)
    )
    with output.progress(told=output.Told(quiet=True)) as show:
        show("part", 1, 2)
    assert not screen.getvalue()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("trebucheck compare --engines mu", {"mujoco"}),
        (
            "trebucheck compare --engines mujoco,",
            {"mujoco,reference", "mujoco,pymunk", "mujoco,exudyn"},
        ),
        ("trebucheck compare --models sque", {"squeezer"}),
        ("trebucheck run --preset ", {"default", "settings", "assisted", "given"}),
        ("trebucheck run --option mujoco.solr", {"mujoco.solref="}),
        ("trebucheck engines py", {"pymunk"}),
        ("trebucheck models show roll", {"rolling"}),
    ],
)
def test_a_shell_completes(words: str, expected: set[str]) -> None:
    from trebucheck.cli.app import app
    from typer._completion_classes import BashComplete
    from typer.main import get_command

    *before, last = words.split(" ")
    found = BashComplete(get_command(app), {}, "trebucheck", "_X").get_completions(before[1:], last)
    assert {each.value for each in found} >= expected
    assert {each.value for each in found} - expected <= (set() if last != "" else {"reference"})


@pytest.mark.slow
def test_completion_of_the_installed_command() -> None:
    asked = {
        "_TREBUCHECK_COMPLETE": "complete_bash",
        "COMP_WORDS": "trebucheck compare --engines mu",
        "COMP_CWORD": "3",
    }
    run = [sys.executable, "-m", "trebucheck"]
    done = subprocess.run(
        run, check=False, env=os.environ | asked, capture_output=True, text=True, timeout=120
    )
    assert done.stdout.split() == ["mujoco"]


def test_values_come_in_order_and_not_further_ahead_than_asked() -> None:
    started: list[int] = []

    def square(n: int) -> int:
        started.append(n)
        return n * n

    assert list(in_order(square, range(20), 3)) == [n * n for n in range(20)]
    started.clear()
    endless = in_order(square, iter(range(10**9)), 2, ahead=4)
    assert [next(endless) for _ in range(3)] == [0, 1, 4]
    endless.close()
    assert max(started) <= 7


@again
@pytest.mark.slow
def test_several_processes_give_the_same_study(tmp_path: Path) -> None:
    arguments = [
        "explain",
        "--model",
        "fixed",
        "--engines",
        "pymunk",
        "--preset",
        "assisted",
        "--until",
        "0.3",
    ]
    found: list[object] = []
    for jobs in ("1", "2"):
        assert (
            main([*arguments, "--timestep", "5e-3", "--jobs", jobs, "--out", str(tmp_path / jobs)])
            == 0
        )
        found.append(_without_times(json.loads((tmp_path / jobs / "explain.json").read_text())))
    assert found[0] == found[1]


_DIFFERING = (
    *("wall_time", "wall_times", "processor_time", "processor_times"),
    *("reading_time", "reading_times", "jobs", "command"),
)


def _without_times(value: object) -> object:
    if isinstance(value, dict):
        return {k: _without_times(v) for k, v in value.items() if k not in _DIFFERING}
    return [_without_times(each) for each in value] if isinstance(value, list) else value


def test_results_say_how_many_were_made_at_once() -> None:
    found = tb.compare(
        ["fixed"], ["reference"], ["assisted"], duration=0.1, timestep=5e-3, isolate=False
    ).results
    assert "jobs" not in json.loads(found.made_by("x").to_json())
    assert json.loads(found.made_by("x", 2).to_json())["jobs"] == 2


# the distance of one run


@pytest.mark.parametrize("until", [0.5, 1.0])
def test_the_distance_is_the_largest_up_to_the_end(until: float) -> None:
    from trebucheck.comparisons.runs.study import Until

    runner = Runner(tb.fixed(), until=Until.of(until))
    run = tb.engine("pymunk", timestep=5e-3).simulate(tb.Problem(tb.fixed(), duration=until + 0.1))
    found = farthest(run, runner)
    assert found.until == until and found.time <= until
    (metric,) = [m for m in runner.measured(run) if m.label == f"position_max ({found.point})"]
    assert found.distance == pytest.approx(metric.value, rel=1e-12)


def test_run_says_how_far_it_is_from_the_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pymunk")
    arguments = [
        "run",
        "--engine",
        "pymunk",
        "--duration",
        "0.3",
        "--out",
        str(tmp_path / "own.nc"),
    ]
    said = " ".join(_said(arguments, capsys).split())
    assert re.search(
        r"from the reference \d\.\de-\d+ m \(\w+ at [\d.]+ s; compared to 0\.3 s\)", said
    )
    assert "from the reference" not in _said([*arguments, "--no-reference"], capsys)
