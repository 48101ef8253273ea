"""The suite rejects engines that are wrong in one way each, by its cheapest check, and names most
of the causes.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import dummy_engines
import jsonschema
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.compare import MachineRuns
from trebucheck.comparisons.runs.process import Worker
from trebucheck.conformance import plugin
from trebucheck.conformance.certificate import badge, certificate, headline, next_steps
from trebucheck.conformance.suite import Session, Suite, Target, _Interface
from trebucheck.conformance.verdicts import CheckState, CheckVerdict, Conformance, Deviations
from trebucheck.engines.registry import ANNOUNCED, announce
from trebucheck.models.spec import schema_text

TESTS = Path(__file__).parents[1]
REFERENCES: dict[str, MachineRuns] = {}
PROBLEMS = ("catapult", "fixed")

REJECTED: dict[str, tuple[str, str]] = {
    "dummy_engines:OwnPreset": ("interface/description", "has none of default"),
    "dummy_engines:Versionless": ("interface/description", "version() gives None"),
    "dummy_engines:Unversioned": ("interface/description", "version() gives ''"),
    "dummy_engines:Forgetful": ("interface/made-again", "its timestep is 0.004 instead of 0.002"),
    "dummy_engines:Growing": ("interface/made-again", "its told is True instead of None"),
    "dummy_engines:Unmade": ("interface/made-again", "step is not a field"),
    "dummy_engines:Raising": ("interface/short-run", "ZeroDivisionError: careless"),
    "dummy_engines:Dummy_decreasing": ("interface/short-run", "t decreases after"),
    "dummy_engines:Dummy_integers": ("interface/short-run", "t is an array of int64"),
    "dummy_engines:Dummy_renamed_joint": (
        "interface/short-run",
        "'fulcrum!', which the mechanism does not have",
    ),
    "dummy_engines:Dummy_other_machine": ("interface/short-run", "of another mechanism"),
    "wrong_engines:Wrong_nan_marker": ("interface/short-run", "is not finite"),
    "wrong_engines:Wrong_no_trajectory": (
        "interface/short-run",
        "NoneType instead of a Trajectory",
    ),
    "dummy_engines:Random": ("interface/same-again", "between two runs of the same problem"),
    "dummy_engines:Remembering": ("interface/same-again", "joint_reactions of 'fulcrum' differs"),
    "dummy_engines:Accepter": ("interface/refuses", "and does not declare that it can"),
    "dummy_engines:Breaker": ("interface/refuses", "IndexError"),
    "wrong_engines:Wrong_nan": ("catapult/runs", "q is not finite at t = 1.001"),
    "wrong_engines:Wrong_milliseconds": ("catapult/runs", "it goes on to 1944.66 s"),
    "dummy_engines:Inspected": ("catapult/model", "mass of the arm (+2 %)"),
    "dummy_engines:Uninspectable": ("catapult/model", "KeyError: 'hinge'"),
    "dummy_engines:Frictional": (
        "catapult/position",
        "friction or damping of the fulcrum (viscous +200 N m s/rad)",
    ),
    "dummy_engines:Dummy_energy_zero": (
        "catapult/potential-energy",
        "zero of the potential energy (+500 J)",
    ),
    "dummy_engines:Dummy_body_axes": (
        "catapult/joint-reaction",
        "joint forces in the frame of the body",
    ),
    "dummy_engines:Dummy_stale_reactions": ("catapult/joint-reaction", "forces shifted in time"),
    "dummy_engines:Dummy_noisy": ("catapult/velocity", "the motion is right"),
    "dummy_engines:Dummy_interpolated": ("catapult/position", "position_max (projectile)"),
    "wrong_engines:Wrong_degrees": ("catapult/angle", "degrees for radians"),
    "wrong_engines:Wrong_anticlockwise": (
        "catapult/angle",
        "scale of the coordinates and their speeds (wrong sign)",
    ),
    "wrong_engines:Wrong_reaction_sign": (
        "catapult/joint-reaction",
        "scale of all joint forces (wrong sign)",
    ),
    "wrong_engines:Wrong_quarter_gravity": ("catapult/position", "gravity (-75 %)"),
    "wrong_engines:Wrong_heavy": ("catapult/position", "mass of the arm (+2 %)"),
    "wrong_engines:Wrong_swapped_markers": (
        "catapult/position",
        "projectile and counterweight exchanged",
    ),
    "wrong_engines:Wrong_late": ("catapult/position", "motion shifted in time"),
    "dummy_engines:Refuser": ("fixed/runs", "it refuses what it declares: refuser has no stops"),
    "wrong_engines:Wrong_no_torques": ("fixed/runs", "stop_torques lacks 'hanger rest'"),
    "wrong_engines:Wrong_torque_sign": (
        "fixed/stop-torque",
        "scale of all stop torques (wrong sign)",
    ),
    "wrong_engines:Wrong_never_releases": (
        "fixed/launch-time",
        "reading of the hanger rest's release (never",
    ),
    "wrong_engines:Bilateral": ("bouncing/position", "stops by the law release-once"),
    "dummy_engines:Dummy_swapped_coordinates": (
        "hanging-chain/angle",
        "a1, a2, a4, a5 are those of",
    ),
}
"""Of each wrong engine the first check that fails, and what it says, or the cause that it names."""


@pytest.fixture(autouse=True)
def _announced(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test announces is forgotten after it."""
    monkeypatch.setenv(ANNOUNCED, "")


def _suite(engine: str, problems: tuple[str, ...] = PROBLEMS) -> Suite:
    return Suite(Target.of(engine), problems, REFERENCES, isolate=False)


@pytest.mark.parametrize("engine", REJECTED)
def test_a_wrong_engine_is_rejected_by_the_cheapest_check(engine: str) -> None:
    check, said = REJECTED[engine]
    problem = check.partition("/")[0]
    problems = PROBLEMS if problem in ("interface", *PROBLEMS) else (problem,)
    failed = next(verdict for verdict in _suite(engine, problems).verdicts() if verdict.failed)
    assert failed.id.split("/", 2)[2] == check
    assert said in f"{failed.text} {failed.cause}"


def test_runs_that_differ_say_by_how_much() -> None:
    """That engine's angles are another billionth off in each run."""
    target = Target.of("dummy_engines:Random")
    said = next(_Interface(target, ("catapult",), Worker(isolate=False)).same_again())
    told = [float(word) for word in said.split() if re.fullmatch(r"[\d.]+e-\d+", word)]
    assert len(told) == 1 and 0.5e-9 < told[0] < 3.5e-9


def test_a_right_engine_keeps_everything_and_what_it_lacks_is_named() -> None:
    found = list(_suite("dummy_engines:Full", (*PROBLEMS, "bead")).verdicts())
    assert not [verdict for verdict in found if verdict.failed]
    states = {verdict.check: verdict.state for verdict in found if verdict.problem == "fixed"}
    assert states.pop("model") is CheckState.SKIPPED
    assert (
        set(states.values()) == {CheckState.KEPT}
        and {"release-time", "joint-reaction", "launch-speed"} <= states.keys()
    )
    assert [(v.check, v.state, v.text) for v in found if v.problem == "bead"] == [
        ("runs", CheckState.SKIPPED, "it has no prismatic joints")
    ]
    judged = [verdict for verdict in found if verdict.tolerance is not None]
    assert len(judged) > 20 and all(v.error is not None and v.source and v.unit for v in judged)


_ENDS = {
    "catapult": "crashed: its process ended by itself (SIGSEGV)",
    "bead": "did not finish within 1 s",
}
"""What is said of a problem with which an engine does this to its process."""


@pytest.mark.slow
def test_what_an_engine_does_to_its_process_fails_its_problem_and_changes_no_other_verdict() -> (
    None
):
    asked = ("incline", *_ENDS, "floating-arm")
    with Suite(Target.of("dummy_engines:Fragile"), asked, REFERENCES) as suite:
        found: list[CheckVerdict] = []
        for id in suite.ids:
            suite._worker.timeout = 1.0 if "/bead/" in id else 60.0
            found.append(suite.verdict(id))
    failed = {verdict.problem: verdict for verdict in found if verdict.failed}
    assert {(verdict.problem, verdict.check) for verdict in found if verdict.failed} == {
        (p, "runs") for p in _ENDS
    }
    for problem, text in _ENDS.items():
        assert text in failed[problem].text
    sane = [
        verdict for verdict in found if verdict.problem in ("interface", "incline", "floating-arm")
    ]
    assert _compared(sane) == _compared(
        _suite("dummy_engines:Everything", ("incline", "floating-arm")).verdicts()
    )


def _compared(verdicts: Iterable[CheckVerdict]) -> dict[str, tuple[CheckState, float | None]]:
    return {
        f"{verdict.problem}/{verdict.check}": (verdict.state, verdict.error) for verdict in verdicts
    }


@pytest.mark.parametrize("tells", [True, False])
def test_an_engine_that_is_absent_is_skipped_unless_it_is_required(
    tells: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An engine that cannot tell whether it is here is absent, too."""
    target = Target.of("dummy_engines:Uninstalled")
    if not tells:
        monkeypatch.setattr(target.engine_type, "is_installed", lambda: 1 / 0)
    for required, state in ((False, CheckState.SKIPPED), (True, CheckState.BROKEN)):
        suite = Suite(target, ("catapult",), REFERENCES, required=required, isolate=False)
        assert {verdict.state for verdict in suite.verdicts()} == {state}
        results = Session([], "quick", Deviations()).results.model_copy(
            update={"verdicts": tuple(suite.verdicts())}
        )
        assert any(
            "engine 'uninstalled' is not installed here." in step for step in next_steps(results)
        )


def test_what_a_preset_takes_away_is_no_declaration_that_it_breaks() -> None:
    """MuJoCo's default preset has no restitution.

    Its suite skips and names it, and the preset that has one is judged.
    """
    default, assisted = (
        _suite(f"mujoco/{preset}", ("falling-rod",)) for preset in ("default", "assisted")
    )
    problem = "falling-rod"
    ids = [[id for id in suite.ids if f"/{problem}/" in id] for suite in (default, assisted)]
    assert [len(each) > 1 for each in ids] == [False, True]
    verdict = default.verdict(ids[0][0])
    assert verdict.state is CheckState.SKIPPED and "restitution" in verdict.text


def test_an_absent_engine_says_itself_what_is_missing() -> None:
    suite = Suite(Target.of("dummy_engines:Bridged"), ("catapult",), REFERENCES, isolate=False)
    assert {verdict.text for verdict in suite.verdicts()} == {
        "bridged runs in node, which is not on the path"
    }
    with pytest.raises(
        tb.EngineNotInstalledError, match=r"^bridged runs in node, which is not on the path\.$"
    ):
        tb.check("dummy_engines:Bridged", "catapult")


def test_what_breaks_at_steps_that_are_not_the_presets_says_at_which() -> None:
    suite = Suite(
        Target.of("wrong_engines:Wrong_quarter_gravity"),
        ("pendulum", "catapult"),
        REFERENCES,
        isolate=False,
    )
    suite._diagnosed = 2  # no cause is looked for
    for problem, told in (("pendulum", True), ("catapult", False)):
        verdict = suite.verdict(f"{suite.target.label}/{problem}/position")
        assert verdict.failed and (" at steps of " in verdict.text) is told


def _session(folder: Path, engine: str, rows: str) -> Session:
    (folder / "known.toml").write_text(rows)
    options = {
        "tier": "quick",
        "problem": ["catapult"],
        "timeout": 60.0,
        "json": None,
        "deviations": "known.toml",
    }
    session = Session.of([engine], options, folder)
    session._suites[0]._worker.isolate, session._suites[0]._references = False, REFERENCES
    return session


ROW = '[[deviation]]\nid = "{}"\nreason = "recorded in degrees"\nowner = "me"\n'


def test_a_known_deviation_is_no_failure_and_a_stale_row_is_one(tmp_path: Path) -> None:
    rows = [
        ROW.format(f"degrees/assisted/catapult/{check}") for check in ("angle", "position", "angel")
    ]
    elsewhere = [
        "reference/assisted/catapult/angle",
        "degrees/default/*",
        "degrees/assisted/rolling/slide",
    ]
    session = _session(
        tmp_path, "wrong_engines:Wrong_degrees", "".join([*rows, *map(ROW.format, elsewhere)])
    )
    found = {id: session.judged(id) for id in session.ids}
    failed = {id.rpartition("/")[2]: verdict for id, verdict in found.items() if verdict.failed}
    assert set(failed) == {"position", "angel"}, failed
    assert "stale" in failed["position"].text and "no check that there is" in failed["angel"].text
    assert [found[f"deviations/file/row/{id}"].state for id in elsewhere] == [
        CheckState.SKIPPED
    ] * 3
    known = found["degrees/assisted/catapult/angle"]
    assert known.state is CheckState.DEVIATES and known.text.startswith(
        "recorded in degrees (owner: me)"
    )
    assert not session.results.passed and "1 known deviation" in headline(session.results)


@pytest.mark.parametrize("field", ["reason", "owner", "id"])
def test_a_row_without_reason_or_owner_is_refused(field: str, tmp_path: Path) -> None:
    row = "\n".join(
        line for line in ROW.format("a/b/c/d").splitlines() if not line.startswith(field)
    )
    (tmp_path / "known.toml").write_text(row)
    with pytest.raises(tb.InputError, match=field):
        Deviations.read(tmp_path / "known.toml")


def test_the_certificate_says_what_to_do_first() -> None:
    verdicts = [
        CheckVerdict(id="e/assisted/interface/same-again", state=CheckState.BROKEN, text="differs"),
        CheckVerdict(
            id="e/assisted/fixed/position",
            state=CheckState.BROKEN,
            text="far",
            error=2.0,
            tolerance=1.0,
            unit="m",
        ),
        CheckVerdict(id="e/assisted/fixed/angle", state=CheckState.NOT_JUDGED, text="unknown"),
    ]
    session = Session([], "quick", Deviations())
    results = session.results.model_copy(update={"verdicts": tuple(verdicts)})
    assert list(next_steps(results)) == [
        "same-again: differs",
        "e, fixed, position (also angle): far.",
    ]
    assert not results.passed and "does not conform" in headline(results)
    assert ElementTree.fromstring(badge(results)).attrib["role"] == "img"
    assert certificate(results).verdict == headline(results)


def test_check_names_quantity_error_tolerance_and_cause() -> None:
    run = tb.check(
        "dummy_engines:Full", "catapult", position=1e-6, launch_speed="0.1%", isolate=False
    )
    assert run.engine == "full" and run.metric("position_max", "projectile") is not None
    what = "degrees/assisted on 'catapult': angle_max (theta): 2.2e2 rad, tolerance 1.0e-6 rad"
    for diagnose in (True, False):
        with pytest.raises(AssertionError, match=re.escape(what)) as error:
            tb.check(
                "wrong_engines:Wrong_degrees",
                "catapult",
                angle=1e-6,
                isolate=False,
                diagnose=diagnose,
            )
        assert ("degrees for radians" in str(error.value)) == diagnose
    assert tb.check(
        "wrong_engines:Wrong_degrees", "catapult", position=1e-6, isolate=False
    )  # what was asked for holds


def test_check_refuses_what_it_does_not_know_and_does_not_pass_what_it_cannot_judge() -> None:
    with pytest.raises(
        tb.InputError, match="quantity 'heat' is not of a judged quantity; there are: position"
    ):
        tb.check("dummy_engines:Full", "catapult", heat=1.0)
    with pytest.raises(tb.EngineNotInstalledError):
        tb.check("dummy_engines:Uninstalled", "catapult")
    with pytest.raises(AssertionError, match="release: not judged: this motion has none"):
        tb.check("dummy_engines:Full", "catapult", release=1e-6, isolate=False)
    with pytest.raises(AssertionError, match="not judged"):
        tb.check("dummy_engines:Full", "catapult", position=1e-18, isolate=False)


@pytest.fixture
def run_pytest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Exit code and output of pytest in a folder, in this process.

    The plug-in is loaded by its entry point where trebucheck is installed.
    """
    announced = importlib.metadata.entry_points(group="pytest11", name="trebucheck")
    load = [] if announced else ["-p", "trebucheck.conformance.plugin"]

    def run(folder: Path, *arguments: str) -> tuple[int, str]:
        paths = [str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))  # of xdist's processes
        monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
        for name in [name for name in os.environ if name.startswith("PYTEST_XDIST")]:
            monkeypatch.delenv(name)
        monkeypatch.chdir(folder)
        own = ["--rootdir", str(folder), "--import-mode", "importlib", "--capture", "no"]
        own += ["--assert", "plain"]  # else each process rewrites all modules of trebucheck
        code = pytest.main([*load, "-p", "no:cacheprovider", *own, *arguments])
        return int(code), "".join(capsys.readouterr())

    return run


@pytest.mark.slow
def test_pytest_runs_the_suite_from_a_strangers_folder_and_none_of_its_tests(
    tmp_path: Path, run_pytest: Callable[..., tuple[int, str]]
) -> None:
    (tmp_path / "test_own.py").write_text("def test_own():\n    raise AssertionError\n")
    (tmp_path / "known.toml").write_text(ROW.format("degrees/*/catapult/angle"))
    asked = ["--trebucheck", "wrong_engines:Wrong_degrees", "--trebucheck-problem", "catapult"]
    files = [
        "--junitxml",
        "j.xml",
        "--trebucheck-json",
        "r.json",
        "--trebucheck-deviations",
        "known.toml",
    ]
    code, output = run_pytest(tmp_path, *asked, *files, "--require-engine", "degrees")
    assert code == 0, output
    assert "1 xfailed" in output and "test_own" not in output
    found = ElementTree.parse(tmp_path / "j.xml").iter("testcase")
    cases = {(case.attrib["classname"], case.attrib["name"]): case for case in found}
    position = cases["degrees.assisted.catapult", "position"]
    properties = {p.attrib["name"]: p.attrib["value"] for p in position.iter("property")}
    assert float(properties["error"]) <= float(properties["tolerance"]) and properties[
        "source"
    ].startswith("default")
    written = json.loads((tmp_path / "r.json").read_text())
    assert written["format"] == "trebucheck-conformance-1" and written["engines"] == {
        "degrees/assisted": "1.0"
    }
    assert len(written["verdicts"]) == len(cases)
    jsonschema.validate(written, json.loads(schema_text(Conformance)))


@pytest.mark.slow
def test_several_processes_of_pytest_find_the_same_and_judge_rows_in_the_end(
    tmp_path: Path, run_pytest: Callable[..., tuple[int, str]]
) -> None:
    rows = [
        ROW.format(f"degrees/*/{check}")
        for check in ("*/angle", "catapult/position", "incline/angel")
    ]
    (tmp_path / "known.toml").write_text("".join(rows))
    asked = ["--trebucheck", "wrong_engines:Wrong_degrees", "-n", "2", "--dist", "load", "-v"]
    problems = ["--trebucheck-problem", "catapult", "--trebucheck-problem", "incline"]
    files = [
        "--junitxml",
        "j.xml",
        "--trebucheck-json",
        "r.json",
        "--trebucheck-deviations",
        "known.toml",
    ]
    code, output = run_pytest(tmp_path, *asked, *problems, *files, "--require-engine", "degrees")
    assert code == 1 and "2 failed" in output and "1 xfailed" in output, output
    assert "catapult/position' is stale" in output
    assert "incline/angel' is about no check" in output
    cases = [
        case.attrib["classname"] for case in ElementTree.parse(tmp_path / "j.xml").iter("testcase")
    ]
    written = json.loads((tmp_path / "r.json").read_text())["verdicts"]
    assert sorted(cases) == sorted(v["id"].rpartition("/")[0].replace("/", ".") for v in written)
    suite = _suite("wrong_engines:Wrong_degrees", ("catapult", "incline"))
    assert [
        verdict["id"] for verdict in written if not verdict["id"].startswith("deviations/")
    ] == list(suite.ids)
    served: dict[str, set[str]] = {}
    for process, problem in re.findall(r"\[gw(\d)\].* degrees/assisted/(\S+)/\S+", output):
        served.setdefault(problem, set()).add(process)
    assert served.keys() == {"interface", "catapult", "incline"} and all(
        len(each) == 1 for each in served.values()
    )


TEST_OF_ONES_OWN = """
import trebucheck as tb

def test_here(trebucheck):
    trebucheck.check("dummy_engines:Full", "catapult", position=1e-6, isolate=False)

def test_absent(trebucheck):
    trebucheck.check("dummy_engines:Uninstalled", "catapult")
"""


@pytest.mark.slow
def test_a_required_engine_may_neither_be_absent_nor_be_skipped(
    tmp_path: Path, run_pytest: Callable[..., tuple[int, str]]
) -> None:
    (tmp_path / "test_own.py").write_text(TEST_OF_ONES_OWN)
    required = [
        "--require-engine",
        "uninstalled",
        "--require-engine",
        "full",
        "--require-engine",
        "nobody",
    ]
    code, output = run_pytest(tmp_path, "-q", *required, "test_own.py")
    assert code == 1 and "1 failed, 1 passed" in output, output
    assert "--require-engine: engine 'uninstalled' is not installed here" in output
    assert "--require-engine nobody: no test of it has run" in output
    assert "--require-engine full: no" not in output


def test_the_fixture_skips_what_is_absent() -> None:
    checker = plugin._Checker(())
    with pytest.raises(pytest.skip.Exception, match="'uninstalled' is not installed here"):
        checker.check("dummy_engines:Uninstalled", "catapult")
    assert checker.asked == {"uninstalled"}


def test_the_plug_in_costs_a_strangers_run_nothing() -> None:
    code = (
        "import sys, pytest, trebucheck.conformance.plugin; print({'numpy', 'pydantic', "
        "'scipy'} "
        "& "
        "set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_the_command_line_writes_the_certificate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(
        [
            "conform",
            "dummy_engines:Uninstalled",
            "--problem",
            "catapult",
            "--out",
            str(tmp_path / "out"),
        ]
    )
    assert code == 1 and "uninstalled/assisted 1.0 does not conform" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "badge.svg", "certificate.html", "conformance.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["no-such-engine"], "there is no engine 'no-such-engine'"),
        (["no_such_package:Engine"], "cannot be loaded"),
        (["dummy_engines:Full/fast"], "full has no preset 'fast'; there are: assisted, default"),
        (
            ["reference", "--tier", "huge"],
            "tier = 'huge' is unknown; there are: quick, standard, full",
        ),
        (["reference", "--problem", "pendulun"], "did you mean 'pendulum'?"),
        (["reference", "--problem", "catapult, pendulun"], "did you mean 'pendulum'?"),
        (["reference", "--problem", "catapult,"], "there is no model ''"),
        (["reference", "--timeout", "0"], "'--timeout': 0.0 must be positive"),
        (["reference", "--deviations", "none.toml"], "none.toml cannot be read"),
    ],
)
def test_wrong_input_is_one_sentence(refused: object, arguments: list[str], said: str) -> None:
    assert said in refused("conform", *arguments)  # type: ignore[operator]


def test_the_skeleton_is_whole_and_red_in_its_first_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "new"
    assert main(["plugin", "new", "my-engine", "--out", str(folder)]) == 0
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(["plugin", "new", "my-engine", "--out", str(folder)]) == 2
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(["plugin", "new", "trebucheck-my-engine", "--out", str(tmp_path / "doubled")]) == 2
    assert not (tmp_path / "doubled").exists()
    monkeypatch.syspath_prepend(str(folder))
    suite = _suite("trebucheck_my_engine:MyEngine", ("catapult", "fixed"))
    found = list(suite.verdicts())
    assert next(verdict.check for verdict in found if verdict.failed) == "short-run"
    assert "step 1 of engine.py" in next(verdict.text for verdict in found if verdict.failed)
    assert {v.text for v in found if v.problem == "fixed"} >= {
        "it has no bodies without inertia about their centre of mass, no stops on angles, no "
        "release-once law of the "
        "stops"
    }


@pytest.mark.parametrize("step", ["test_1", "test_2", "test_3", "test_4", "test_5"])
def test_the_skeletons_steps_need_no_point_masses(step: str, tmp_path: Path) -> None:
    """Each is green for an engine that needs an inertia of every body."""
    assert main(["plugin", "new", "my-engine", "--out", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / "tests" / "test_my_engine.py").read_text()
    announce("dummy_engines:Weighty")
    written: dict[str, Any] = {}
    exec(text.replace("my-engine", "weighty"), written)
    (test,) = (written[name] for name in written if name.startswith(step))
    test(tb)


@pytest.fixture
def own_engine(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The guide's."""
    monkeypatch.syspath_prepend(str(TESTS.parent / "examples"))
    yield "own_engine:ScipyBodies"
    sys.modules.pop("own_engine", None)


def test_the_guides_engine_is_whole_and_right(own_engine: str) -> None:
    assert (TESTS.parent / "examples" / "own_engine.py").read_text().count("\n") <= 190
    found = list(_suite(own_engine).verdicts())
    assert not [verdict for verdict in found if verdict.failed]
    kept = {
        verdict.check
        for verdict in found
        if verdict.problem == "fixed" and verdict.state is CheckState.KEPT
    }
    assert {
        "model",
        "position",
        "stop-torque",
        "release-time",
        "joint-reaction",
        "launch-time",
    } <= kept


def test_every_dummy_is_tried() -> None:
    tried = {name.partition(":")[2] for name in REJECTED}
    assert {cls.__name__ for cls in dummy_engines.SPOILED.values()} - tried == {"Dummy_late_all"}
