"""The reference under watch.

A motion that gets nowhere, a process that hangs, a machine that fails among others.
"""

from __future__ import annotations

import json
import math
import pickle
import re
import time
import tracemalloc
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from conftest import again
from mechanisms import hanging_bob, pin
from trebucheck.cli.app import main
from trebucheck.comparisons.runs import process as runs
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.results import Outcome, Results
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.engines import protocol
from trebucheck.engines.protocol import available_memory
from trebucheck.models.elements import GROUND
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.reference.certification import certify as certification
from trebucheck.reference.integrator import MOST_STEPS
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow


def parallel_cranks(start: float = 1.0) -> Mechanism:
    """Two parallelograms in a row, every link 1 m, that swing up and come to rest with all links on
    one line.

    There the loops' constraints are singular, and at rest nothing tells how the mechanism moves on.

    Args:
        start: angle of the cranks [rad].
    """
    # Three cranks and two translating rods are a pendulum of 3 kg m^2 and a moment of 3.5 kg m.
    speed = -math.sqrt(2 * 3.5 / 3 * 9.81 * math.sin(start))
    cranks = [
        Body(name=f"crank {k}", angle=f"a{k}", mass=1, centre=(0.5, 0), inertia=1 / 12)
        for k in range(3)
    ]
    rods = [
        Body(name=f"rod {k}", angle=f"b{k}", mass=1, centre=(0.5, 0), inertia=1 / 12)
        for k in range(2)
    ]
    joints = [pin(f"foot {k}", GROUND, f"crank {k}", (k, 0)) for k in range(3)]
    joints += [pin(f"head {k}", f"crank {k}", f"rod {k}", (1, 0)) for k in range(2)]
    joints += [pin(f"loop {k}", f"rod {k}", f"crank {k + 1}", (1, 0), (1, 0)) for k in range(2)]
    return Mechanism(
        name="cranks",
        bodies=(*cranks, *rods),
        joints=tuple(joints),
        markers=(Marker(name="projectile", body="crank 0", point=(1, 0)),),
        gravity=9.81,
        start=(start,) * 3 + (0.0,) * 2,
        start_speeds=(speed,) * 3 + (0.0,) * 2,
    )


def fast_pendulum(length: float) -> Mechanism:
    """A long pendulum that carries a short one."""
    return Mechanism(
        name="fast",
        bodies=(
            Body(name="long", angle="a", mass=1, centre=(1, 0), inertia=0.0),
            Body(name="short", angle="b", mass=1, centre=(length, 0), inertia=0.0),
        ),
        joints=(pin("hook", GROUND, "long"), pin("knee", "long", "short", (1, 0))),
        gravity=9.81,
        start=(0.3, 0.5),
    )


# the integration itself


def test_a_motion_that_stalls_at_a_singular_position_ends_with_a_sentence() -> None:
    began = time.perf_counter()
    with pytest.raises(SimulationError, match=r"gave up at t = 0\.42\d+ s") as caught:
        solve(tb.Problem(parallel_cranks(), duration=10.0))
    assert "singular position" in str(caught.value)
    assert time.perf_counter() - began < 20


@pytest.mark.parametrize("length", [1e-9, 1e-12])
def test_a_part_that_is_too_fast_for_the_duration_ends_with_a_sentence(length: float) -> None:
    with pytest.raises(SimulationError, match=r"gave up at t = .* a part moves too fast"):
        solve(tb.Problem(fast_pendulum(length), duration=1000.0))


def test_a_long_motion_is_within_the_limit() -> None:
    """Its steps are counted over all its segments, and so is what Table I's machine needs for a
    third of a minute.
    """
    solution = solve(tb.Problem(tb.fixed(), duration=20.0))
    steps = sum(len(np.asarray(segment.interpolant.ts)) for segment in solution.segments)
    assert 1000 < steps < MOST_STEPS / 100


@pytest.mark.parametrize(
    "changes",
    [
        {"m_cw": 1e300},
        {"h": 1e-160},
        {"m_a": 1e308, "l1": 1e9},
        pytest.param({"m_b": 1e300}, marks=again),
        pytest.param({"g": 1e300}, marks=again),
    ],
)
def test_numbers_beyond_doubles_end_with_a_sentence_and_without_a_warning(
    changes: dict[str, float],
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(tb.TrebucheckError) as caught:
            solve(tb.Problem(tb.fixed(tb.TrebuchetParameters(**changes)), duration=3.0))
    assert len(str(caught.value)) < 400


def test_energies_beyond_doubles_are_a_sentence_without_a_warning() -> None:
    heavy = hanging_bob(
        bodies=(Body(name="bob", angle="beta", mass=1e300, centre=(2, 0), inertia=0.0),),
        start_speeds=(1e10,),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(SimulationError, match="energies are not finite"):
            solve(tb.Problem(heavy, duration=1e-9)).trajectory(np.linspace(0.0, 1e-9, 5))


def test_a_body_without_inertia_is_a_sentence() -> None:
    still = hanging_bob(
        bodies=(Body(name="bob", angle="beta", mass=3.0, centre=(0, 0), inertia=0.0),)
    )
    with pytest.raises(SimulationError, match="a body without inertia"):
        solve(tb.Problem(still, duration=1.0))


# the process it runs in


def _hang(*_: object) -> None:
    time.sleep(60)


def _die(*_: object) -> None:
    import os

    os._exit(3)


def _fill_memory(*_: object) -> None:
    np.ones(1 << 50)


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (_hang, "the reference did not finish within 0.5 s and was stopped."),
        (_die, "the reference crashed: its process ended by itself."),
        (_fill_memory, "the reference ran out of memory: "),
    ],
)
def test_a_reference_that_fails_in_its_process_is_a_sentence(
    fault: object, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "_computed", fault)
    with (
        Worker(timeout=0.5 if fault is _hang else 60.0) as worker,
        pytest.raises(SimulationError) as caught,
    ):
        _ = Runner(tb.fixed(), worker).solution
    assert str(caught.value).startswith(sentence)


def test_a_solution_from_another_process_is_the_same_to_the_last_bit() -> None:
    with Worker() as worker:
        there, here = Runner(tb.rolling(), worker), Runner(tb.rolling())
        assert there.solution.launch == here.solution.launch
        times = np.linspace(0.0, here.end, 100)
        assert np.array_equal(there.reference(times).q, here.reference(times).q)
        assert there.uncertainties == here.uncertainties


@pytest.mark.own_processes
def test_a_worker_that_was_closed_leaves_no_process_behind() -> None:
    with Worker() as worker:
        pass
    runner = Runner(tb.fixed(), worker)
    assert runner.solution.launch is not None
    assert not worker._started


# the commands


def test_one_machine_whose_reference_fails_costs_only_its_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    file = tmp_path / "cranks.json"
    file.write_text(parallel_cranks().to_json())
    options = [
        "--engine",
        "reference",
        "--preset",
        "assisted,default",
        "--duration",
        "1",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(["compare", "--models", f"{file},fixed", *options]) == 1
    results = Results.load(tmp_path / "out" / "results.json")
    assert [machine.model for machine in results.machines] == ["fixed"]
    failed = [run for run in results.runs if run.model == "cranks"]
    assert [run.outcome for run in failed] == [Outcome.FAILED] * 2
    assert all("the reference gave up at t = 0.42" in (run.message or "") for run in failed)
    assert all(run.metrics for run in results.runs if run.model == "fixed")
    said = capsys.readouterr()
    assert "the reference gave up" in said.out.replace("\n", " ")
    assert "Traceback" not in said.err
    assert "Warning" not in said.err


@pytest.mark.parametrize(
    "command",
    [
        ["throw"],
        ["run", "--engine", "reference"],
        ["certify"],
        ["recommend", "--engine", "pymunk", "--position", "1e-3"],
    ],
)
def test_every_command_stops_the_reference_in_time(
    command: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runs, "_computed", _hang)
    began = time.perf_counter()
    assert main([*command, "--model", "fixed", "--timeout", "0.3", "--out", str(tmp_path)]) == 1
    assert time.perf_counter() - began < 20
    said = capsys.readouterr()
    assert "the reference did not finish within 0.3 s and was stopped." in " ".join(
        (said.out + said.err).split()
    )
    assert "Traceback" not in said.err


@pytest.mark.parametrize(
    ("command", "knobs"), [("converge", ["--knob", "iterations"]), ("explain", [])]
)
def test_a_study_goes_on_after_a_machine_whose_reference_fails(
    command: str, knobs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    files = [tmp_path / "one.json", tmp_path / "two.json"]
    for file in files:
        file.write_text(parallel_cranks().model_copy(update={"name": file.stem}).to_json())
    options = ["--engine", "pymunk", "--models", ",".join(map(str, files)), "--out", str(tmp_path)]
    assert main([command, *knobs, *options]) == 1
    failures = json.loads((tmp_path / f"{command}.json").read_text())["failures"]
    page, said = (
        (tmp_path / f"{command}.html").read_text(),
        " ".join(capsys.readouterr().out.split()),
    )
    for name in ("one", "two"):
        assert failures[name].startswith("the reference gave up at t = 0.42")
        assert f"{name}: the reference gave up" in said
    assert page.count("the reference gave up") == 2


def test_certificates_go_on_after_a_machine_that_cannot_be_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "cranks.json"
    file.write_text(parallel_cranks().to_json())
    certify = partial(certification.certify, ladder=(1e-10, 1e-11))
    monkeypatch.setattr(certification, "certify", certify)
    assert main(["certify", "--models", f"{file},catapult", "--out", str(tmp_path / "out")]) == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "catapult.json",
        "catapult.html",
    }
    assert "error: cranks: the reference gave up at t = 0.42" in capsys.readouterr().err


# memory


@pytest.mark.parametrize("engine", ["reference", "pymunk", "mujoco", "exudyn"])
def test_a_run_that_does_not_fit_into_memory_is_refused_before_it_starts(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(protocol, "available_memory", lambda: 1e9)
    kind = tb.engine(engine)
    monkeypatch.setattr(type(kind), "is_installed", classmethod(lambda _: True))
    sentence = (
        r"1e-06 s makes 2e\+06 steps of 2\.0 s, for which some .* GB of memory are needed "
        r"and "
        r"1 "
        r"GB "
        r"are available"
    )
    with pytest.raises(tb.InputError, match=sentence) as caught:
        tb.engine(engine, timestep=1e-6).simulate(tb.Problem(tb.fixed(), duration=2.0))
    valid = re.search(r"at least (\S+) s is needed", str(caught.value))
    assert valid is not None
    assert 1e-6 < float(valid[1]) < 1e-4


@pytest.mark.own_motions
def test_the_memory_that_is_estimated_is_at_least_what_a_run_takes() -> None:
    """Peak of what Python and NumPy allocate in a reference run, and of its copy from another
    process.
    """
    problem = tb.Problem(tb.fixed(), duration=2.0)
    engine = tb.engine("reference", timestep=1e-4)
    engine.simulate(problem)
    tracemalloc.start()
    trajectory = pickle.loads(pickle.dumps(engine.simulate(problem)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    estimate = len(trajectory.t) * protocol._sample_size(problem.mechanism)
    assert 0.1 * estimate < peak < estimate


def test_the_available_memory_is_a_number_of_bytes() -> None:
    assert 1e7 < available_memory() < 1e15


def test_a_step_of_a_nanosecond_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The short run before the one that is timed has at most a hundred steps."""
    options = [
        "--engine",
        "pymunk,reference",
        "--preset",
        "assisted",
        "--timeout",
        "20",
        "--out",
        str(tmp_path),
    ]
    assert main(["compare", "--models", "fixed", "--timestep", "1e-9", *options]) == 1
    assert "did not finish" not in (text := " ".join(capsys.readouterr().out.split()))
    assert text.count("timestep = 1e-09 s makes more than 20000000 steps of") == 2
