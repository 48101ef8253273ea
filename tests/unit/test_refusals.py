"""Inputs and places that no command can work with.

One short sentence, exit code 2, nothing half-written.
"""

from __future__ import annotations

import math
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.runs.process import Worker
from trebucheck.models import files
from trebucheck.models.errors import EngineNotInstalledError, InputError, UnwritableError
from trebucheck.models.trajectory import load, save
from trebucheck.reference.throw.flight import Release, Surroundings, range_rate

LONG = "x" * 300
"""Longer than any file system's names."""
DIGITS = "9" * 5000
RUN = ["run", "--engine", "reference"]
WRITING = {
    "run": RUN,
    "compare": ["compare", "--engines", "reference"],
    "converge": ["converge", "--engines", "mujoco"],
    "explain": ["explain", "--engines", "mujoco"],
    "recommend": ["recommend", "--engines", "mujoco", "--position", "1e-3"],
    "throw": ["throw"],
    "certify": ["certify", "--models", "fixed"],
    "paper": ["paper", "--engines", "reference"],
    "export": ["models", "export", "fixed"],
}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([*RUN, "--option", "preset=default"], "preset = 'default' is no option"),
        ([*RUN, "--option", "name=mujoco"], "name = 'mujoco' is no option"),
        ([*RUN, "--option", "self=1"], "self is not a field"),
        ([*RUN, "--option", "cls=1"], "cls is not a field"),
        ([*RUN, "--option", f"rtol={DIGITS}"], "rtol = '999"),
        ([*RUN, "--option", "rtol=" + "[" * 100_000], "rtol = '[[["),
        (
            [*RUN, "--timestep", "1e-3", "--option", "timestep=2e-3"],
            "--timestep 0.001 and --option timestep",
        ),
        (["models", "show", "fixed", "--set", f"l1={DIGITS}"], "l1 = inf"),
        (["models", "show", "fixed", "--set", "l1=1e200"], "length of 1e+200 m is too large"),
        (["models", "show", "catapult", "--set", "l1=1e200"], "length of 1e+200 m is too large"),
        (
            ["models", "show", "floating-arm", "--set", "l2=1e200"],
            "length of 1e+200 m is too large",
        ),
        (["models", "show", "fixed", "--set", "m_a=1e308"], "inertia = inf"),
        (["models", "show", "fixed", "--beam", "1e308"], "length of 1e+308 m is too large"),
        (["throw", "--release-angle", "120"], "release_angle = 120 deg must be between -90 and 90"),
        (["throw", "--release-angle", "-91"], "release_angle = -91 deg must be between -90 and 90"),
        (["converge", "--knobs", ""], "--knobs is empty"),
        (["compare", "--engines", ""], "--engines is empty"),
        (["paper", "--sections", " "], "--sections is empty"),
    ],
)
def test_values_that_nothing_can_be_made_of(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    assert complaint in refused(*arguments)


@pytest.mark.parametrize("command", WRITING)
@pytest.mark.parametrize("out", ["", " ", LONG, f"deeper/{LONG}", "file/deeper", "file"])
def test_places_that_nothing_can_be_written_to(
    command: str, out: str, refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("kept")
    name = "--out" if not out.strip() else "cannot be written"
    assert name in refused(*WRITING[command], "--out", out)
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize("out", [f"{LONG}.nc", f"deeper/{LONG}.nc", "folder.nc"])
def test_a_trajectory_that_cannot_be_written(
    out: str, refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "folder.nc").mkdir()
    assert "cannot be written" in refused(*RUN, "--out", out)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["models", "show"],
        ["models", "show", "fixed", "--set"],
        [*RUN, "--set"],
        [*RUN, "--option"],
        [*RUN, "--model"],
        [*RUN, "--preset"],
        [*RUN, "--stop-law"],
        ["run", "--engine"],
        ["compare", "--engines"],
        ["compare", "--timestep"],
        ["throw", "--body"],
        ["throw", "--out"],
        ["recommend", "--torque"],
        ["converge", "--engines", "mujoco", "--knobs"],
        ["paper", "--sections"],
        [],
    ],
)
def test_a_message_does_not_repeat_a_long_input(
    arguments: list[str], refused: Callable[..., str]
) -> None:
    for text in ("x" * 3_000, f"l1={'y' * 3_000}", f"{'z' * 30_000}=1"):
        assert len(refused(*arguments, text)) < 1200


def test_messages_of_the_library_are_short_as_well() -> None:
    with pytest.raises(InputError) as raised:
        tb.engine("x" * 1_000_000)
    assert 200 < len(str(raised.value)) <= 1000
    assert str(raised.value).endswith("there are: reference, mujoco, pymunk, exudyn.")
    with pytest.raises(InputError, match="a number of thousands of digits"):
        tb.engine("reference", rtol=10**5000)
    assert str(EngineNotInstalledError("short")) == "short"


def test_control_characters_are_shown_as_escapes(refused: Callable[..., str]) -> None:
    assert r"a\x1b[31m\nb" in refused("throw", "--body", "a\x1b[31m\nb")


@pytest.mark.parametrize(
    "text",
    ['"gravity": 9.81, "gravity": 1.62', '"gravity": 9.81, "gravity": 9.81'],
)
def test_a_field_that_is_there_twice(
    text: str, refused: Callable[..., str], tmp_path: Path
) -> None:
    path = tmp_path / "own.json"
    path.write_text(tb.fixed().to_json().replace('"gravity": 9.81', text))
    assert "the field 'gravity' is there twice" in refused("models", "show", str(path))


@pytest.mark.parametrize("drag", [0.0, 1e-3])
def test_a_flight_that_only_touches_the_ground_has_no_rate(drag: float) -> None:
    """It is met where a sling points forward at the start (phi0 = 0).

    The projectile rests at the landing's height.
    """
    release = Release(0.0, (1.0, 0.0), (2.0, 0.0), (0.0, 1.0))
    assert math.isnan(range_rate(release, Surroundings(gravity=9.81, drag=drag)))


def test_a_wait_without_end() -> None:
    assert 1e6 < Worker(float("inf")).timeout < float("inf")


@pytest.mark.slow
@pytest.mark.parametrize("duration", ["1e-300", "5e-324", "1e-12"])
def test_a_comparison_over_no_time_at_all(
    duration: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        "compare",
        "--models",
        "catapult",
        "--engines",
        "reference",
        "--preset",
        "assisted",
    ]
    assert main([*arguments, "--duration", duration, "--out", str(tmp_path)]) == 1
    assert "must not be longer than the duration" in " ".join(capsys.readouterr().out.split())


# places that fill up


@pytest.fixture
def trajectory() -> tb.Trajectory:
    return tb.engine("reference", timestep=1e-2).simulate(tb.Problem(tb.fixed(), duration=0.5))


def test_a_failed_write_leaves_what_was_there(
    tmp_path: Path, trajectory: tb.Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.nc"
    save(trajectory, path)
    monkeypatch.setattr(files.os, "fdopen", lambda *_: Path("/dev/full").open("wb", buffering=0))  # noqa: SIM115
    with pytest.raises(
        UnwritableError, match=r"run\.nc cannot be written: No space left on device"
    ):
        save(trajectory, path)
    assert load(path).mechanism == trajectory.mechanism
    assert list(tmp_path.iterdir()) == [path]


_LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_{kind}, ({limit}, {limit}))
from trebucheck.cli.app import main
sys.exit(main({arguments!r}))
"""


def _limited(kind: str, limit: int, arguments: list[str]) -> tuple[int, str]:
    script = textwrap.dedent(_LIMITED.format(kind=kind, limit=limit, arguments=arguments))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False
    )
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX's")
def test_a_limit_of_file_sizes_costs_only_what_does_not_fit(tmp_path: Path) -> None:
    arguments = [
        "compare",
        "--models",
        "catapult,fixed",
        "--engines",
        "reference",
        "--preset",
        "assisted",
    ]
    code, said = _limited("FSIZE", 400_000, [*arguments, "--out", str(tmp_path)])
    assert (code, said) == (
        2,
        f"error: {tmp_path / 'trajectories' / 'fixed-reference-assisted.nc'} cannot be written: "
        "File too large.\n",
    )
    assert [path.name for path in (tmp_path / "trajectories").iterdir()] == [
        "catapult-reference-assisted.nc"
    ]
    assert (
        load(tmp_path / "trajectories" / "catapult-reference-assisted.nc").mechanism
        == tb.catapult()
    )
    assert (tmp_path / "runs" / "catapult-reference-assisted.json").is_file()
    assert not (tmp_path / "report.html").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX's")
def test_too_few_file_handles(tmp_path: Path) -> None:
    arguments = [
        "compare",
        "--models",
        "catapult",
        "--engines",
        "reference",
        "--preset",
        "assisted",
    ]
    code, said = _limited("NOFILE", 10, [*arguments, "--out", str(tmp_path)])
    assert code in (1, 2) and "Traceback" not in said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
def test_an_output_that_is_full() -> None:
    command = [sys.executable, "-m", "trebucheck", "models", "show", "fixed"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert (done.returncode, done.stderr) == (2, "error: No space left on device.\n")
