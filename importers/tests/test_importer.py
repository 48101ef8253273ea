"""`trebucheck importer`.

A right importer is right in all it offers, and every seeded fault is found where it is.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from trebucheck.cli.app import main
from trebucheck.comparisons.report import markdown
from trebucheck.models.errors import InputError, SimulationError
from trebucheck_importers import report
from trebucheck_importers.process import ImporterProcess
from trebucheck_importers.results import ImporterResults, Verdict
from trebucheck_importers.study import check_importer

pytest.importorskip("mujoco")

IMPORTERS = Path(__file__).parents[2] / "importers"
LOADERS = f'''
import os, sys, time
sys.path.insert(0, {str(IMPORTERS)!r})
import mujoco
import numpy as np
from compiled import Compiled


def of(path, **changes):
    spec = mujoco.MjSpec.from_file(path)
    for joint in spec.joints:
        for name, value in changes.items():
            setattr(joint, name, value)
    return Compiled(spec.compile())


def right(path):
    return of(path)


def no_inertia(path):
    loaded = of(path)
    loaded.model.body_inertia[:] *= 0.99
    return loaded


def other_sense(path):
    return of(path, axis=[0, 1, 0])


def no_limit(path):
    return of(path, limited=mujoco.mjtLimited.mjLIMITED_FALSE)


def soft_limit(path):
    return of(path, solref_limit=[0.1, 1], solimp_limit=[0.9, 0.95, 0.001, 0.5, 2])


def no_damping(path):
    loaded = of(path)
    loaded.model.dof_damping[:] = 0.0
    return loaded


def more_gravity(path):
    loaded = of(path)
    loaded.model.opt.gravity[:] *= 1.001
    return loaded


class Late(Compiled):
    """One step too late at every sample."""

    def simulate(self, q, u, interval, count, steps):
        long = super().simulate(q, u, interval / steps, count * steps, 1)["q"]
        return np.array([q, *long[steps - 1 :: steps][:count]])


def late(path):
    return Late(mujoco.MjModel.from_xml_path(path))


class Rough(Compiled):
    """Ahead by ten steps: an error of first order, which at large steps decides nothing."""

    def simulate(self, q, u, interval, count, steps):
        right = super().simulate(q, u, interval, count, steps)["q"]
        return right + 10 * interval / steps * np.gradient(right, interval, axis=0)


def rough(path):
    return Rough(mujoco.MjModel.from_xml_path(path))


class Still(Compiled):
    """Without motion, which takes time."""

    simulate = None


def no_sensors(path):
    model = mujoco.MjModel.from_xml_path(path)
    if model.nsensor:
        raise NotImplementedError("sensors are not supported")
    return Still(model)


def large_inertias(path):
    loaded = Still(mujoco.MjModel.from_xml_path(path))
    loaded.model.body_inertia[1:] = np.maximum(loaded.model.body_inertia[1:], 1e-3)
    return loaded


def rounded(path, precision="float32", off=1e-7):
    loaded = Still(mujoco.MjModel.from_xml_path(path))
    right = loaded.acceleration
    loaded.acceleration = lambda q, u: right(q + off * np.array([1, -1, 1]), u)
    loaded.precision = precision
    return loaded


def rounded_in_double(path):
    return rounded(path, "float64")


def coarse(path):
    return rounded(path, off=1e-4)


def counted(path):
    with open(__file__ + ".loaded", "a") as file:
        print(path, file=file)
    return Still(mujoco.MjModel.from_xml_path(path))


def renamed(path):
    loaded = of(path)
    loaded.joints = ["something else"]
    return loaded


class Broken:
    joints = ("pivot",)

    def total_mass(self):
        raise ValueError("no mass today")

    def mass_matrix(self, q):
        os.abort()

    def acceleration(self, q, u):
        return [float("nan")]

    def start(self):
        time.sleep(100)

    def simulate(self, q, u, interval, count, steps):
        return [[0.0]]


def broken(path):
    print("a word on standard output")
    return Broken()


def nothing(path):
    class Nothing:
        joints = ["pivot"]

    return Nothing()


constant = 5
'''


@pytest.fixture
def loaders(tmp_path: Path) -> Path:
    path = tmp_path / "loaders.py"
    path.write_text(LOADERS)
    return path


def _checked(loaders: Path, function: str, *models: str, timeout: float = 60.0) -> ImporterResults:
    return check_importer(
        f"{loaders}:{function}", python=Path(sys.executable), models=models, timeout=timeout
    )


def _wrong(results: ImporterResults) -> set[str]:
    return {
        check.quantity
        for model in results.models
        for check in model.checks
        if check.verdict == Verdict.WRONG
    }


def test_a_right_importer_is_right(loaders: Path) -> None:
    models = ("negative-axis", "hinge-limit", "damper", "weld", "contact", "fixed")
    results = _checked(loaders, "right", *models)
    assert {check.verdict for model in results.models for check in model.checks} == {Verdict.RIGHT}
    assert results.holds and results.versions and results.integrator == "mjINT_RK4"
    assert len(results.models[1].checks) == 11


@pytest.mark.parametrize(
    ("function", "model", "wrong"),
    [
        ("no_inertia", "hinge", {"mass matrix", "accelerations", "free motion"}),
        ("other_sense", "negative-axis", {"accelerations", "free motion"}),
        (
            "no_limit",
            "hinge-limit",
            {"ranges", "limits kept", "motion with events", "force at rest"},
        ),
        ("soft_limit", "hinge-limit", {"limits kept", "motion with events", "force at rest"}),
        ("no_damping", "damper", {"accelerations", "free motion"}),
        ("more_gravity", "chain", {"accelerations", "free motion"}),
        ("renamed", "hinge", {"joints"}),
    ],
)
def test_a_wrong_importer_is_wrong_where_it_is(
    loaders: Path, function: str, model: str, wrong: set[str]
) -> None:
    assert _wrong(_checked(loaders, function, model)) == wrong


def test_a_motion_that_is_read_a_step_late_converges_and_says_so(loaders: Path) -> None:
    """An error that falls with the step is not called a fault, but never right if it is large."""
    check = _checked(loaders, "late", "hinge").models[0].check("free motion")
    assert check is not None and check.verdict != Verdict.WRONG


def test_an_importer_that_breaks_costs_its_own_cells(loaders: Path) -> None:
    results = _checked(loaders, "broken", "hinge", timeout=5.0)
    verdicts = {check.quantity: (check.verdict, check.text) for check in results.models[0].checks}
    assert verdicts["total mass"] == (Verdict.FAILED, "ValueError: no mass today")
    assert verdicts["mass matrix"][0] == Verdict.FAILED and "SIGABRT" in verdicts["mass matrix"][1]
    # After a crash, the file is loaded again.
    assert verdicts["accelerations"] == (Verdict.WRONG, "it is not finite")
    assert verdicts["start"][0] == Verdict.FAILED and "no answer" in verdicts["start"][1]
    assert verdicts["free motion"][0] == Verdict.FAILED and "samples" in verdicts["free motion"][1]
    assert "a word on standard output" in results.models[0].printed


def test_what_is_not_offered_is_never_right(loaders: Path) -> None:
    results = _checked(loaders, "nothing", "hinge")
    assert {check.verdict for check in results.models[0].checks[2:]} == {Verdict.NOT_OFFERED}


def test_a_verdict_that_the_step_leaves_open_is_sought_with_smaller_ones(loaders: Path) -> None:
    check = _checked(loaders, "rough", "hinge").models[0].check("free motion")
    assert check is not None and check.verdict == Verdict.RIGHT and check.error is not None
    # Ten steps at the speed of the fall: at half a millisecond an error of more than a hundredth of
    # the motion.
    assert (
        check.error > 1e-3
        and "step 0.0005 s" not in check.text
        and "step 0.001 s" not in check.text
    )


@pytest.mark.parametrize(
    ("function", "machine", "quantity", "tried"),
    [
        ("no_sensors", "catapult", "loads", ["without sensors"]),
        ("large_inertias", "fixed", "mass matrix", ["without sensors", "finite inertia"]),
    ],
)
def test_who_cannot_read_a_machine_gets_its_variants(
    loaders: Path, function: str, machine: str, quantity: str, tried: list[str]
) -> None:
    results = _checked(loaders, function, machine)
    model = results.models[0]
    assert model.fault is not None and model.fault.quantity == quantity and not results.holds
    assert [each.variant for each in model.variants] == tried
    assert [each.fault is None for each in model.variants] == [False] * (len(tried) - 1) + [True]
    assert report.whole(results, machine).text.endswith(f"; {tried[-1]}: right")
    assert ImporterResults.from_json(results.to_json()) == results


@pytest.mark.parametrize(
    ("function", "verdict"),
    [
        ("rounded", Verdict.UNDECIDED),
        ("rounded_in_double", Verdict.WRONG),
        ("coarse", Verdict.WRONG),
    ],
)
def test_a_stiff_loop_magnifies_what_single_precision_rounds(
    loaders: Path, function: str, verdict: Verdict
) -> None:
    """A last digit of a position in single precision opens a loop, which its file closes within 2
    ms.
    """
    check = _checked(loaders, function, "connect").models[0].check("accelerations")
    assert check is not None and check.verdict == verdict


def test_who_reads_the_file_gets_no_variant_and_the_zoo_has_none(loaders: Path) -> None:
    results = _checked(loaders, "counted", "catapult", "hinge")
    assert not any(model.variants for model in results.models)
    assert not _checked(loaders, "renamed", "hinge").models[0].variants


def test_finished_models_are_taken_from_the_folder(loaders: Path, tmp_path: Path) -> None:
    out, loaded = str(tmp_path / "out"), Path(f"{loaders}.loaded")
    assert (
        main(["importer", f"{loaders}:counted", "--models", "hinge,chain", "--out", out, "-q"]) == 0
    )
    first = (tmp_path / "out" / "importer.json").read_text()
    assert (
        main(
            [
                "importer",
                f"{loaders}:counted",
                "--models",
                "hinge,slide,chain",
                "--out",
                out,
                "-q",
                "--resume",
            ]
        )
        == 0
    )
    assert [Path(line).stem for line in loaded.read_text().splitlines()] == [
        "hinge",
        "chain",
        "slide",
    ]
    again = ImporterResults.from_json((tmp_path / "out" / "importer.json").read_text())
    assert again.versions and [model.model for model in again.models] == ["hinge", "slide", "chain"]
    assert [again.models[0], again.models[2]] == [*ImporterResults.from_json(first).models]
    loaders.write_text(f"{LOADERS}\n# changed\n")
    assert (
        main(
            ["importer", f"{loaders}:counted", "--models", "hinge", "--out", out, "-q", "--resume"]
        )
        == 0
    )
    assert len(loaded.read_text().splitlines()) == 4


def test_on_the_command_line(
    loaders: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["importer", f"{loaders}:right", "--models", "hinge", "-q"]) == 0
    assert (
        main(["importer", f"{loaders}:no_inertia", "--models", "hinge,chain", "--out", str(out)])
        == 1
    )
    assert "mass matrix" in capsys.readouterr().out
    results = ImporterResults.from_json((out / "importer.json").read_text())
    text = (out / "importer.md").read_text()
    assert text == markdown.text(report.page(results, f"{loaders}:no_inertia"))
    # One report of one cause, with the smallest file.
    assert (
        text.count("### ") == 1
        and '<mujoco model="hinge">' in text
        and "chain" in text.partition("### ")[2]
    )
    assert main(["importer", f"{loaders}:right", "--models", "hinge", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["format"] == "trebucheck-importer-1"


OWN = """
<mujoco model="own"><compiler angle="radian" autolimits="true"/>
  <default><geom density="700"/><joint damping="0.05"/></default>
  <worldbody><geom type="plane" size="3 3 .1" pos="0 0 -4"/>
    <body name="cart"><joint name="track" type="slide" axis="1 0 0" range="-3 3"/>
      <geom type="box" size=".2 .1 .1"/>
      <body name="pole" pos="0 0 .1"><joint name="hinge" axis="0 1 0"{armature}/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size=".05"/></body></body>{more}
  </worldbody></mujoco>
"""


@pytest.mark.parametrize("loader", ["right", "no_damping", "more_gravity"])
def test_a_file_of_ones_own_is_judged(loaders: Path, tmp_path: Path, loader: str) -> None:
    path = tmp_path / "own.xml"
    path.write_text(OWN.format(armature=' armature="0.1"', more=""))
    results = _checked(loaders, loader, str(path))
    (model,) = results.models
    verdicts = {check.quantity: check.verdict for check in model.checks}
    asked = ["loads", "joints", "total mass", "mass matrix", "accelerations", "ranges"]
    assert list(verdicts) == [*asked, "free motion"]
    wrong = {"accelerations", "free motion"} if loader != "right" else set()
    assert {quantity for quantity, verdict in verdicts.items() if verdict != "right"} == wrong


@pytest.mark.parametrize(
    ("more", "armature", "sentence"),
    [
        (None, "", "there is no file"),
        ("<body><joint/><geom size='1'/></body>", "", "has no name"),
        ("", ' frictionloss="1"', "nothing here could judge"),
        ('<geom type="sphere" size="2"/>', "", "something touches"),
        ("<nonsense/>", "", "nonsense"),
        ("</body>", "", "own.xml"),
        ('<body pos="0 0 .7"><joint name="j" type="ball"/><geom size=".1"/></body>', "", "ball"),
    ],
)
def test_a_file_that_cannot_be_judged_is_refused(
    loaders: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: str | None,
    armature: str,
    sentence: str,
) -> None:
    path = tmp_path / "own.xml"
    if more is not None:
        path.write_text(OWN.format(armature=armature, more=more))
    assert main(["importer", f"{loaders}:right", "--models", str(path)]) == 2
    told = capsys.readouterr().err
    assert sentence in told and "Traceback" not in told and told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["{file}"], "must be a module and a function"),
        (["none.py:load"], "there is no file"),
        (["{file}:absent"], "cannot be imported: AttributeError"),
        (["{file}:constant"], "not a function"),
        (["no_such_module:load"], "No module named 'no_such_module'"),
        (["{file}:right", "--models", "griffin"], "no model 'griffin' in the zoo"),
        (["{file}:right", "--python", "nowhere/python"], "cannot be run"),
        (["{file}:right", "--python", "/bin/false"], "ended with exit code 1"),
        (["{file}:right", "--timestep", "0"], "must be positive"),
        (["{file}:right", "--timeout", "nan"], "must be positive"),
        (["{file}:right", "--resume"], "needs --out"),
    ],
)
def test_bad_input_gets_one_sentence(
    loaders: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    given = [text.format(file=loaders) for text in arguments]
    assert main(["importer", *given, *([] if "--models" in given else ["--models", "hinge"])]) == 2
    told = capsys.readouterr().err
    assert sentence in told and "Traceback" not in told and told.count("\n") == 1


def test_a_process_that_ended_is_started_again(loaders: Path) -> None:
    with ImporterProcess(f"{loaders}:broken", Path(sys.executable), 30.0) as process:
        process.call("load", "any")
        with pytest.raises(SimulationError, match="SIGABRT"):
            process.call("mass_matrix", [0.0])
        assert process.call("load", "any")["joints"] == ["pivot"]
    with (
        pytest.raises(InputError, match="must be a module"),
        ImporterProcess("load", Path(sys.executable)),
    ):
        pass
