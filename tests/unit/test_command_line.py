"""The command line: every wrong input gets one sentence and exit code 2, and nothing
half-written."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.comparisons.runs.results import Results
from trebucheck.models.trajectory import load

FIELDS = list(tb.TrebuchetParameters.model_fields)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400", "abc", "-100", ""])
def test_every_parameter_is_checked(name: str, value: str, refused: Callable[..., str]) -> None:
    assert name in refused("models", "show", "fixed", "--set", f"{name}={value}")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["compare", "--set", "l1"], "NAME=VALUE"),
        (["compare", "--set", "l9=3"], "there is no such parameter; there are: l1, l2"),
        (["compare", "--set", "l1=3", "--set", "l1=4"], "names 'l1' twice"),
        (["compare", "--models", "floating"], "no model 'floating'"),
        (["compare", "--models", ","], "--models is empty"),
        (["compare", "--engines", "mujoko"], "did you mean 'mujoco'"),
        (["compare", "--preset", "best", "--engines", "reference"], "no preset 'best'"),
        (["compare", "--timestep", "0"], "timestep = 0.0"),
        (["compare", "--timestep", "nan"], "timestep = nan"),
        (["compare", "--timestep", "soon"], "--timestep"),
        (["compare", "--duration", "-1"], "duration = -1.0"),
        (["compare", "--stop-law", "sticky"], "stop_law = 'sticky'"),
        (["compare", "--beam", "5"], "l1 = 10.0 must be shorter than the beam"),
        (["compare", "--beam", "14", "--set", "l2=4"], "--beam chooses l2"),
        (["compare", "--colour"], "--colour"),
        (["run", "--engine", "reference", "--option", "rtol=1"], "rtol = 1"),
        (["run", "--engine", "reference", "--option", "colour=red"], "colour is not a field"),
        (["run", "--engine", "reference", "--model", "fixed,rolling"], "names 2 machines"),
        (
            ["run", "--engine", "reference", "--timestep", "0.5", "--duration", "0.1"],
            "must not be longer",
        ),
        (["run"], "--engine"),
        (["models", "show", "absent.json"], "absent.json cannot be read"),
        (["models", "show"], "Missing argument"),
        (["launch"], "launch"),
    ],
)
def test_wrong_input_gets_a_sentence(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    assert complaint in refused(*arguments)


def test_files_that_are_no_mechanism(tmp_path: Path, refused: Callable[..., str]) -> None:
    path = tmp_path / "machine.json"
    path.write_text(tb.fixed().to_json().replace('"mass": 60.0', '"mass": -60.0'))
    assert "bodies.1.mass = -60.0" in refused("models", "show", str(path))
    path.write_bytes(b"\xff\xfe")
    assert str(path) in refused("models", "show", str(path))
    assert "--set and --beam are for named machines" in refused(
        "models", "show", str(path), "--set", "r=5"
    )


@pytest.mark.parametrize(
    "command", [["compare", "--engines", "reference"], ["run", "--engine", "reference"]]
)
def test_a_folder_that_cannot_be_written(
    command: list[str], refused: Callable[..., str], tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    assert str(blocked) in refused(*command, "--out", str(blocked / "deeper"))
    assert blocked.read_text() == "kept"


def test_show_round_trips(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["models", "show", "rolling", "--set", "l1=9.1", "--set", "theta0=0.1"]) == 0
    text = capsys.readouterr().out
    assert tb.Mechanism.from_json(text) == tb.rolling(tb.TrebuchetParameters(l1=9.1, theta0=0.1))
    path = tmp_path / "own.json"
    path.write_text(text)
    assert main(["models", "show", str(path)]) == 0
    assert capsys.readouterr().out == text


def test_beam(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "show", "fixed", "--set", "l1=9", "--beam", "14"]) == 0
    assert tb.Mechanism.from_json(capsys.readouterr().out) == tb.fixed(
        tb.TrebuchetParameters(l1=9, l2=5)
    )


def test_list_engines_schema_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "list"]) == 0
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines()} == {
        "fixed",
        "rolling",
        "catapult",
        "hinged",
        "floating-arm",
    }
    assert main(["engines"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in ("reference", "mujoco", "pymunk", "exudyn"))
    assert main(["models", "schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Mechanism"
    assert main(["--version"]) == 0
    assert tb.__version__ in capsys.readouterr().out


@pytest.mark.parametrize(
    "command", [[], ["compare"], ["run"], ["engines"], ["models"], ["models", "export"]]
)
def test_help_shows_options(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command, "--help"]) == 0
    shown = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "Usage: trebucheck" in shown
    for option in {"compare": ("--models", "--set", "--out", "--resume"), "run": ("--option",)}.get(
        "".join(command), ()
    ):
        assert option in shown


@pytest.mark.slow
def test_compare_writes_all_and_ends_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "report"
    assert main(["compare", "--engine", "reference", "--model", "fixed", "--out", str(out)]) == 0
    assert "Agreement holds" in capsys.readouterr().out
    results = Results.load(out / "results.json")
    assert [run.label for run in results.runs] == ["reference default", "reference assisted"]
    page = (out / "report.html").read_text()
    assert "Fixed machine" in page
    assert results.command == f"trebucheck compare --engine reference --model fixed --out {out}"
    assert (out / "summary.md").read_text().startswith("✓ Agreement holds.")
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.(https?:)?//", page), (
        "the report must need nothing else"
    )
    assert sorted(p.name for p in (out / "trajectories").iterdir()) == [
        "fixed-reference-assisted.nc",
        "fixed-reference-default.nc",
    ]
    assert not list(out.rglob("*.part"))


@pytest.mark.slow
def test_resuming_a_finished_comparison_writes_nothing_but_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["compare", "--engine", "reference", "--model", "fixed", "--out", str(tmp_path)]
    assert main(arguments) == 0
    shown, page = capsys.readouterr().out, (tmp_path / "report.html").read_text()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.*")}
    assert main([*arguments, "--resume"]) == 0
    again = capsys.readouterr().out
    tally = "Runs: 2 taken from the folder, 0 made now.\n"
    assert tally in again and "taken" not in shown
    assert again.replace(tally, "").split() == shown.split()
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.*")} == before
    (tmp_path / "report.html").unlink()
    assert main([*arguments, "--resume"]) == 0
    again = (
        (tmp_path / "report.html").read_text().replace(f'<p class="plain">{tally[:-1]}</p>\n', "")
    )
    assert len(again) == len(page)  # but for the random names of its plots


@pytest.mark.slow
def test_a_broken_tolerance_is_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.comparisons.runs import tolerances
    from trebucheck.engines.study import EngineStudy, Tolerance

    strict = Tolerance("assisted", "launch_speed", 1e-9, 1.0, 0, "a test")
    monkeypatch.setattr(tolerances, "engine_study", lambda _: EngineStudy(tolerances=(strict,)))
    coarse = ["--preset", "assisted", "--option", "rtol=1e-8", "--option", "atol=1e-8"]
    words = ["compare", "--engine", "reference", "--model", "fixed", *coarse]
    assert main([*words, "--out", str(tmp_path)]) == 1
    shown = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "Agreement does not hold" in shown
    assert "fixed, reference assisted: launch_speed" in shown
    assert "disagrees" in (tmp_path / "report.html").read_text()


def test_a_run_is_written_as_a_program_of_the_engine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    path, program = tmp_path / "own.nc", tmp_path / "own.py"
    words = ["run", "--engine", "mujoco", "--model", "fixed", "--duration", "0.1", "--no-reference"]
    assert main([*words, "--preset", "default", "--script", str(program), "--out", str(path)]) == 0
    found: dict[str, Any] = {}
    exec(program.read_text(), found)
    assert np.array_equal(found["q"], load(path).q)
    capsys.readouterr()
    assert main([*words, "--script", str(tmp_path / "other.py"), "--out", str(path)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "takes part in the run" in said and not (tmp_path / "other.py").exists()


def test_run_writes_a_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "own.nc"
    arguments = [
        "run",
        "--engine",
        "reference",
        "--model",
        "rolling",
        "--set",
        "l1=9.5",
        "--duration",
        "2.6",
    ]
    assert (
        main([*arguments, "--timestep", "2e-3", "--option", "rtol=1e-11", "--out", str(path)]) == 0
    )
    trajectory = load(path)
    assert trajectory.mechanism == tb.rolling(tb.TrebuchetParameters(l1=9.5))
    assert trajectory.provenance.settings["rtol"] == 1e-11
    assert math.isclose(trajectory.t[1], 2e-3)
    assert "launch speed" in capsys.readouterr().out


def test_an_interrupt_is_exit_code_130(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from trebucheck.comparisons import compare as campaign
    from trebucheck.engines import registry

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "compare", interrupted)
    assert main(["compare", "--out", str(tmp_path / "out")]) == 130
    assert "--resume" in capsys.readouterr().err
    assert not (tmp_path / "out" / "report.html").exists()
    monkeypatch.setattr(registry, "engines", interrupted)
    assert main(["engines"]) == 130
    said = capsys.readouterr().err
    assert "interrupted" in said and "resume" not in said  # there is nothing to go on from


LOADED = """
import threading, time
threading.Thread(target=time.sleep, args=(600,), name="beside").start()
raise ImportError("no licence")
"""
ENDED = "interrupted"


@contextmanager
def _started(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A command in a process of its own, which does not outlive the test."""
    process = subprocess.Popen(
        [sys.executable, "-m", "trebucheck", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.skipif(sys.platform != "linux", reason="its processes are looked for in /proc")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_signals_that_end_a_process_end_a_command_as_an_interrupt_does(
    name: str, tmp_path: Path
) -> None:
    """While a run is under way that would take minutes; its process ends, too."""
    if signal.getsignal(getattr(signal, name)) is signal.SIG_IGN:
        pytest.skip(f"{name} is ignored here, as by nohup, and so it is by what is started here")
    out, step = str(tmp_path / "out"), "--timestep=2e-6"
    with _started("compare", "--engines=pymunk", "--models=fixed", step, "--out", out) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        deadline = time.monotonic() + 60.0
        while not children.read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(getattr(signal, name))
        said = process.communicate(timeout=20.0)[1]
    assert process.returncode == 130 and ENDED in said
    assert "Traceback" not in said


def test_a_thread_of_a_plug_in_does_not_keep_a_command_from_ending(tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text(LOADED)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    plug_in = {"TREBUCHECK_ENGINES": "beside=beside:Engine", "PYTHONPATH": path}
    with _started("engines", **plug_in) as process:
        listed, said = process.communicate(timeout=60.0)
    assert process.returncode == 0 and "no licence" in listed
    assert "threads that still run: beside" in said


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX closes a stream")
def test_closed_standard_output_is_a_sentence() -> None:
    command = shlex.join([sys.executable, "-m", "trebucheck", "--help"])
    done = subprocess.run(
        ["/bin/sh", "-c", f"{command} >&-"], stderr=subprocess.PIPE, text=True, check=False
    )
    assert done.returncode == 2 and "standard output is closed" in done.stderr
    assert "Traceback" not in done.stderr
