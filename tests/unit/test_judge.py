"""Files that somebody else made.

What they give is judged, the rest is not, and broken ones are refused.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import trebucheck as tb
from pydantic import BaseModel
from trebucheck.cli.app import main
from trebucheck.comparisons import judge as judge_study
from trebucheck.comparisons.data.certified import content
from trebucheck.comparisons.judge import FAR_APART, NOT_GIVEN, Judgement, judge_file, read
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.pages.judge import document, headline
from trebucheck.comparisons.runs.results import Metric, Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Study
from trebucheck.conformance.verdicts import Conformance
from trebucheck.models.library.registry import library_problem
from trebucheck.models.spec import schema_text
from trebucheck.models.trajectory import save, write_dataset
from trebucheck.reference.solver import solve

MODEL = "catapult"
STATE = ("q theta", "u theta")
MOVING = ("q a1", "q a2", "u a1", "u a2")


@pytest.fixture(scope="module")
def motion() -> tb.Trajectory:
    return tb.engine("reference", timestep=5e-3).simulate(tb.Problem(tb.model(MODEL), duration=2.0))


def _unit(column: str, mechanism: tb.Mechanism) -> str:
    if column[:2] in ("q ", "u "):
        unit = "rad" if column[2:] in mechanism.angles else "m"
        return {"q": unit, "u": f"{unit}/s"}[column[0]]
    if "energy" in column:
        return "J"
    return "N" if column.startswith("joint") else "m/s" if " v" in column else "m"


def _csv(
    path: Path, motion: tb.Trajectory, *columns: str, head: str = "", scale: float = 1.0
) -> Path:
    frame = motion.to_dataframe()
    chosen = frame[list(columns)] * scale if columns else frame
    names = ",".join(
        ["t [s]", *(f"{name} [{_unit(name, motion.mechanism)}]" for name in chosen.columns)]
    )
    path.write_text(f"{head}{names}\n{chosen.to_csv(header=False)}")
    return path


def _judged(path: Path) -> Judgement:
    return judge_file(path, Study([MODEL], [], ()))


def _by_state(found: Judgement) -> tuple[set[str], set[str]]:
    """Names of the metrics that are judged, and of those that are not given."""
    judged = {metric.name for metric in found.metrics if metric.holds is not None}
    return judged, {
        metric.name for metric in found.metrics if metric.note == NOT_GIVEN and not metric.observed
    }


def test_a_whole_file_is_judged_in_everything(motion: tb.Trajectory, tmp_path: Path) -> None:
    save(motion, tmp_path / "m.nc")
    for path in (_csv(tmp_path / "m.csv", motion), tmp_path / "m.nc"):
        found = _judged(path)
        judged, missing = _by_state(found)
        assert found.outcome is Outcome.AGREES and not missing
        assert {
            "position_max",
            "launch_time",
            "joint_reaction_max",
            "energy_balance",
            "angle_max",
        } <= judged
        assert all(
            abs(metric.value or 0.0) <= 1e-3 * (metric.tolerance or 0.0) for metric in found.judged
        )


def test_a_broken_file_gets_its_cause_from_what_it_gives(
    motion: tb.Trajectory, tmp_path: Path
) -> None:
    """Signs are a mistake of the file's coordinates, whatever points follow from them; without
    speeds and forces a
    weaker gravity looks like a slower clock, and both are named."""
    weak = tb.model(MODEL).model_copy(update={"gravity": 9.75})
    slow = tb.engine("reference", timestep=5e-3).simulate(tb.Problem(weak, duration=2.0))
    files = (
        _csv(tmp_path / "sign.csv", motion, *STATE, scale=-1.0),
        _csv(tmp_path / "qu.csv", slow, *STATE),
        _csv(tmp_path / "q.csv", slow, "q theta"),
    )
    found = [_judged(path) for path in files]
    named = [
        [cause.name for cause in each.diagnosis.named] if each.diagnosis else [] for each in found
    ]
    clock, gravity = "rate of time", "gravity"
    assert "scale of the coordinates and their speeds" in named[0]
    said = [markdown.text(document(each)) for each in found]
    assert gravity in said[1] and clock not in named[1]
    assert gravity in said[2] and clock in named[2]
    assert "**Why:** Differs from the reference" in said[0]
    assert _judged(_csv(tmp_path / "right.csv", motion)).diagnosis is None


PENDULUM = library_problem("double-pendulum")
assert PENDULUM is not None
ZERO = np.array([0.0, 0.3])
WEAK = PENDULUM.mechanism.model_copy(update={"gravity": 9.7})
SPEEDS: dict[str, tuple[tb.Mechanism, Callable[[Any, Any], Any], set[str]]] = {
    "right": (PENDULUM.mechanism, lambda u, _: u, set()),
    "one by a factor": (PENDULUM.mechanism, lambda u, _: u * [1.05, 1], {"a1 times 1.05"}),
    "one in degrees": (PENDULUM.mechanism, lambda u, _: u * [1, 180 / np.pi], {"a2 degrees"}),
    "one half a step early": (
        PENDULUM.mechanism,
        lambda u, early: np.stack([early[:, 0], u[:, 1]], axis=1),
        {"a1 by -0.005 s, -0.5 steps"},
    ),
    "one from another zero": (
        PENDULUM.mechanism,
        lambda u, _: u + np.array([0, 0.3]),
        {"a2 +0.3 rad/s"},
    ),
    "one of another course": (
        PENDULUM.mechanism,
        lambda u, _: u + np.outer(np.sin(np.arange(len(u))), [0.5, 0]),
        {"a1"},
    ),
    "in a wrong motion": (
        WEAK,
        lambda u, _: u * [1.05, 1],
        {"a1 times 1.05", "gravity", "-1.12 %"},
    ),
}


@pytest.mark.parametrize("wrong", SPEEDS)
def test_speeds_that_are_not_the_derivatives_are_named(wrong: str, tmp_path: Path) -> None:
    """By what is wrong with them, in right motions and in wrong ones."""
    mechanism, mistake, words = SPEEDS[wrong]
    solution = solve(tb.Problem(mechanism, duration=1.1))
    t = np.linspace(0.0, 1.1, 111)
    early = solution.trajectory(np.maximum(t - 0.005, 0.0)).u
    moved = solution.trajectory(t)
    path = _csv(tmp_path / "s.csv", replace(moved, u=mistake(moved.u, early)), *MOVING)
    found = judge_file(path, Study(["double-pendulum"], [], (), until=1.0))
    if not words:
        assert found.outcome is Outcome.AGREES
        return
    assert found.diagnosis is not None
    (cause,) = found.diagnosis.named
    said = f"{cause.name} {cause.amount}"
    assert all(word in said for word in {"speeds that are not the derivatives", *words})
    assert ("a1" in cause.amount, "a2" in cause.amount) == tuple(
        any(name in word for word in words) for name in ("a1", "a2")
    )


def test_coordinates_that_are_not_the_integrals_of_right_speeds_are_named(tmp_path: Path) -> None:
    solution = solve(tb.Problem(WEAK.model_copy(update={"gravity": 9.81}), duration=1.1))
    moved = solution.trajectory(np.linspace(0.0, 1.1, 111))
    path = _csv(tmp_path / "s.csv", replace(moved, q=moved.q * [1.05, 1]), *MOVING)
    found = judge_file(path, Study(["double-pendulum"], [], (), until=1.0))
    assert found.diagnosis is not None
    (cause,) = found.diagnosis.named
    assert "coordinates that are not the integrals" in cause.name
    assert cause.amount == "a1 times 1.05"


def test_a_diagnosis_that_fails_says_so(
    motion: tb.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_long(*_: object, **__: object) -> None:
        raise tb.SimulationError("the diagnosis did not finish within 1 s and was stopped.")

    monkeypatch.setattr(judge_study, "diagnose_motion", too_long)
    found = _judged(_csv(tmp_path / "sign.csv", motion, *STATE, scale=-1.0))
    assert "**Why:** No cause is known: the diagnosis did not finish within 1 s" in markdown.text(
        document(found)
    )
    assert Judgement.from_json(found.to_json()).diagnosis == found.diagnosis


def test_what_is_not_given_is_not_judged_and_nothing_is_believed(
    motion: tb.Trajectory, tmp_path: Path
) -> None:
    judged, missing = _by_state(_judged(_csv(tmp_path / "q.csv", motion, "q theta")))
    assert judged == {"missing_time", "position_max", "angle_max", "potential_energy_max"}
    assert {
        "velocity_max",
        "angular_speed_max",
        "launch_time",
        "kinetic_energy_max",
        "energy_balance",
    } <= missing
    judged, _ = _by_state(_judged(_csv(tmp_path / "qu.csv", motion, *STATE)))
    assert {"velocity_max", "launch_speed", "energy_balance", "kinetic_energy_max"} <= judged
    found = _judged(_csv(tmp_path / "p.csv", motion, "projectile x", "projectile y"))
    judged = {metric.label for metric in found.judged}
    assert judged == {
        "missing_time",
        "position_max (projectile)",
    } and "not given, and not judged" in headline(found)


@pytest.mark.parametrize(
    ("columns", "broken"),
    [
        (("q theta",), {"angle_max", "position_max"}),
        (("projectile x", "projectile y"), {"position_max"}),
        ((*STATE,), {"angular_speed_max", "energy_balance"}),
        (("q theta", "joint fulcrum x", "joint fulcrum y"), {"joint_reaction_max"}),
        (("q theta", "kinetic energy"), {"kinetic_energy_max"}),
    ],
)
def test_what_is_wrong_disagrees(
    columns: tuple[str, ...], broken: set[str], motion: tb.Trajectory, tmp_path: Path
) -> None:
    found = _judged(_csv(tmp_path / "w.csv", motion, *columns, scale=1.01))
    assert found.outcome is Outcome.DISAGREES
    assert broken <= {metric.name for metric in found.broken}


_SI = {
    "time": ("ms", 1e3),
    "q": ("deg (slides: mm)", 180 / np.pi),
    "u": ("deg/s (slides: mm/s)", 180 / np.pi),
    "position": ("mm", 1e3),
    "velocity": ("cm/s", 1e2),
    "joint_reaction": ("kN", 1e-3),
    "kinetic_energy": ("kJ", 1e-3),
    "potential_energy": ("kJ", 1e-3),
    "release_time": ("ms", 1e3),
}


def test_units_of_netcdf_are_converted(motion: tb.Trajectory, tmp_path: Path) -> None:
    """Degrees and millimetres are not read as rad and m."""
    dataset = motion.to_dataset()
    for name, (unit, factor) in _SI.items():
        dataset[name] = dataset[name] * factor
        dataset[name].attrs["units"] = unit
    write_dataset(dataset, tmp_path / "m.nc")
    found = read(tmp_path / "m.nc", motion.mechanism)
    save(motion, tmp_path / "si.nc")
    expected = read(tmp_path / "si.nc", motion.mechanism)
    assert found.values.keys() == expected.values.keys()
    assert found.releases == pytest.approx(expected.releases, rel=1e-12)
    for name, values in expected.values.items():
        assert found.values[name] == pytest.approx(values, rel=1e-12), name


@pytest.mark.parametrize(
    ("variable", "unit"),
    [
        ("time", "days"),
        ("time", None),
        ("q", "turns"),
        ("q", "m"),
        ("u", "rad"),
        ("position", "mil"),
        ("position", "rad"),
        ("velocity", None),
        ("kinetic_energy", "mJ"),
        ("joint_reaction", "N m"),
        ("release_time", "min"),
    ],
)
def test_unknown_units_of_netcdf_are_refused_by_name(
    variable: str, unit: str | None, motion: tb.Trajectory, tmp_path: Path
) -> None:
    dataset = motion.to_dataset()
    dataset[variable].attrs = {} if unit is None else {"units": unit}
    write_dataset(dataset, tmp_path / "m.nc")
    given = "no unit" if unit is None else re.escape(f"[{unit}]")
    with pytest.raises(tb.InputError, match=f"variable '{variable}'.*{given}; there are: "):
        read(tmp_path / "m.nc", motion.mechanism)


def test_speeds_without_coordinates_are_refused(motion: tb.Trajectory, tmp_path: Path) -> None:
    """They would be judged with the reference's coordinates."""
    path = _csv(tmp_path / "u.csv", motion, "u theta", "projectile x", "projectile y")
    with pytest.raises(tb.InputError, match="'u theta' is there without 'q theta'"):
        read(path, motion.mechanism)


def test_units_are_converted(motion: tb.Trajectory, tmp_path: Path) -> None:
    degrees = np.degrees(motion.q[:, 0])
    lines = [f"{1e3 * t!r},{q!r}" for t, q in zip(motion.t.tolist(), degrees.tolist(), strict=True)]
    path = tmp_path / "d.csv"
    path.write_text("\n".join(["# measured on a Tuesday", "t [ms], theta [deg]", *lines]))
    assert _judged(path).outcome is Outcome.AGREES
    path.write_text("\n".join(["t [ms], theta [rad]", *lines]))
    assert _judged(path).outcome is Outcome.DISAGREES


@pytest.mark.parametrize("separator", [",", " ", "\t"])
@pytest.mark.parametrize("before", ["", 'made on a "Tuesday, or so\n'])
def test_tables_as_numpy_writes_them_are_read(
    separator: str, before: str, motion: tb.Trajectory, tmp_path: Path
) -> None:
    table, path = np.column_stack([motion.t, motion.q, motion.u]), tmp_path / "n.csv"
    header = before + separator.join(["t [s]", "q theta [rad]", "u theta [rad/s]"])
    np.savetxt(path, table, delimiter=separator, header=header, footer="the end")
    found = read(path, motion.mechanism)
    assert found.values["q theta"] == pytest.approx(motion.q[:, 0], rel=1e-15)
    assert found.values["u theta"] == pytest.approx(motion.u[:, 0], rel=1e-15)


def test_a_file_that_ends_early_disagrees_whether_its_samples_are_close_or_far_apart(
    motion: tb.Trajectory, tmp_path: Path
) -> None:
    text = _csv(tmp_path / "all.csv", motion, *STATE).read_text().splitlines()
    for kept in (text[:200], [text[0], *text[1:242:60]]):
        (tmp_path / "early.csv").write_text("\n".join(kept))
        found = _judged(tmp_path / "early.csv")
        assert "missing_time" in {metric.name for metric in found.broken}
        assert found.diagnosis
        assert [cause.name for cause in found.diagnosis.named] == ["run ends early"]


@pytest.mark.parametrize("model", [MODEL, "damped-oscillator", "bouncing"])
def test_a_file_is_judged_where_it_has_samples_however_far_apart(
    model: str, tmp_path: Path
) -> None:
    """Two characteristic times apart; then what lies between samples is said not to be seen."""
    study = Study([model], [], ())
    (mechanism,) = study.mechanisms
    runner = Runner(mechanism, None, study.end_of(mechanism), study.law_of(mechanism))
    problem = tb.Problem(mechanism, duration=runner.end, stop_law=study.law_of(mechanism))
    t = np.linspace(0.0, runner.end, max(5, round(runner.end / (2 * runner.scales.time))))
    sparse = solve(problem).trajectory(t)
    names = [f"{kind} {name}" for kind in "qu" for name in mechanism.coordinates]
    found = judge_file(_csv(tmp_path / "s.csv", sparse, *names), study)
    assert found.outcome is Outcome.AGREES
    (unseen,) = _of(found, "unseen_time")
    assert unseen.value == pytest.approx(runner.end) and not unseen.observed
    assert FAR_APART in markdown.text(document(found))
    wrong = judge_file(_csv(tmp_path / "w.csv", sparse, *names, scale=1.01), study, False)
    assert wrong.outcome is Outcome.DISAGREES
    assert "missing_time" not in {metric.name for metric in wrong.broken}


def test_releases_are_judged(tmp_path: Path) -> None:
    motion = tb.engine("reference", timestep=1e-2).simulate(tb.Problem(tb.fixed(), duration=2.8))
    angles = [f"q {name}" for name in ("theta", "phi", "alpha")]
    times = dict(motion.release_times)
    for late, outcome in ((0.0, Outcome.AGREES), (0.01, Outcome.DISAGREES)):
        head = "".join(
            f"# release {name} [s] = {times[name] + late!r}\n"
            for name in ("hanger rest", "sling rest")
        )
        found = judge_file(
            _csv(tmp_path / "r.csv", motion, *angles, head=head), Study(["fixed"], [], ())
        )
        assert found.outcome is outcome
        assert {m.subject for m in found.judged if m.name == "release_time"} == {
            "hanger rest",
            "sling rest",
        }


BROKEN = [
    ("", "it is empty"),
    ("0,1\n1,2\n", "line 1 has numbers; a line of headings"),
    ("# made on a Tuesday\n0 1\n1 2\n", "line 2 has numbers; a line of headings"),
    ("# t [s],q thata [rad]\n0,1\n1,2\n", "line 1: there is no column 'q thata'"),
    ("t [s];q theta [rad]\n0;1\n1;2\n", "line 1: columns are separated by ';'"),
    ("t [s],q theta [rad]\n", "line 1: 0 lines of numbers follow; at least two are needed"),
    (
        "t [s],q thata [rad]\n0,1\n1,2\n",
        "line 1: there is no column 'q thata' (did you mean 'q theta'?)",
    ),
    ("t [s],q theta\n0,1\n1,2\n", "line 1: column 'q theta' has no unit; there are: [rad], [deg]"),
    (
        "t [s],q theta [m]\n0,1\n1,2\n",
        "line 1: column 'q theta' has the unit [m]; there are: [rad], [deg]",
    ),
    ("t [s],q theta [rad],theta [deg]\n0,1,1\n1,2,1\n", "line 1: column 'q theta' is there twice"),
    ("q theta [rad]\n0\n1\n", "line 1: there is no column 't [s]'"),
    ("t [s],u theta [rad/s]\n0,1\n1,2\n", "neither the coordinates nor the position of a marker"),
    ("t [s],projectile x [m]\n0,1\n1,2\n", "column 'projectile x' is there without 'projectile y'"),
    ("# a\n\nt [s],q theta [rad]\n0,1\n1\n", "line 5 has 1 values; the headings are 2"),
    ("t [s],q theta [rad]\n0,1\n1,one\n", "line 3: q theta is 'one', which is no number"),
    ("t [s],q theta [rad]\n0,1\n1,nan\n", "line 3: q theta is nan; a finite number is needed"),
    ("t [s],q theta [rad]\n0.5,1\n1,1\n", "line 2: t begins at 0.5 s instead of 0"),
    ("t [s],q theta [rad]\n0,1\n2,1\n1,1\n", "line 4: t decreases from 2 s to 1 s"),
    ("t [s],q theta [rad]\n0,1\n0,1\n", "line 3: t is 0 to the end"),
    (
        "# release trigger [s] = 1\nt [s],q theta [rad]\n0,1\n1,1\n",
        "line 1: there is no stop 'trigger'",
    ),
    ('t [s],q theta [rad]\n0,"1\n1,1\n', "line 2: "),
    ("t [s],q theta [rad]\n0,1\n1,\udcff\n", "line 3 is not UTF-8 text"),
]


@pytest.mark.parametrize(("text", "said"), BROKEN)
def test_a_broken_file_gets_one_sentence_with_its_line(
    text: str, said: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    (tmp_path / "my.csv").write_bytes(text.encode(errors="surrogateescape"))
    sentence = refused("judge", "my.csv", "--model", MODEL)
    assert "my.csv: " in sentence and said in sentence


# impacts, on the library's problem "bouncing"


def _bounces(path: Path, head: str = "", late: float = 0.0, factor: float = 1.0) -> Path:
    """Two samples at each impact.

    All of it late by so many seconds, speeds after impacts by a factor wrong.
    """
    problem = library_problem("bouncing")
    assert problem is not None
    solution = solve(problem)
    times = [0.0, *(t for t, _ in solution.impacts), problem.duration]
    rows: list[list[float]] = []
    for k, (first, last) in enumerate(itertools.pairwise(times)):
        t = np.linspace(first, last, 40)
        segment = next(each for each in solution.segments if each.end >= last - 1e-12)
        y = np.asarray(segment.interpolant(t)).T
        y[0, y.shape[1] // 2 :] *= factor if k else 1.0
        rows += np.column_stack([t + late * (t > 0), y]).tolist()
    names = problem.mechanism.coordinates
    angles = problem.mechanism.angles
    units = ["rad" if name in angles else "m" for name in names]
    columns = [f"q {n} [{u}]" for n, u in zip(names, units, strict=True)]
    columns += [f"u {n} [{u}/s]" for n, u in zip(names, units, strict=True)]
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text(
        "\n".join([*filter(None, [head]), ",".join(["t [s]", *columns]), *lines]) + "\n"
    )
    return path


def _of(found: Judgement, name: str) -> list[Metric]:
    return [metric for metric in found.metrics if metric.name == name]


IMPACT = "# impact floor [s] = {}, impulse [N s] = {}"


def test_impacts_are_judged_by_what_the_file_shows_or_names(tmp_path: Path) -> None:
    study = Study([library_problem("bouncing") or ""], [], ())
    found = judge_file(_bounces(tmp_path / "m.csv"), study)
    assert [metric.holds for metric in _of(found, "impact_time")] == [True]
    assert {m.subject for m in _of(found, "impact_speed") if m.holds} >= {
        "ball"
    } and found.outcome is Outcome.AGREES
    assert _of(found, "impact_impulse")[0].note == NOT_GIVEN
    late = judge_file(_bounces(tmp_path / "m.csv", late=0.01), study, diagnosed=False)
    assert "impact_time" in {metric.name for metric in late.broken}
    assert abs((_of(late, "impact_time")[0].value or 0.0) - 0.01) < 1e-6
    slow = judge_file(_bounces(tmp_path / "m.csv", factor=0.99), study, diagnosed=False)
    assert "impact_speed" in {m.name for m in slow.broken} and "impact_time" not in {
        m.name for m in slow.broken
    }


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.01, False)])
def test_impulses_that_a_file_names_are_judged(factor: float, holds: bool, tmp_path: Path) -> None:
    problem = library_problem("bouncing")
    assert problem is not None
    impacts = solve(problem).impacts
    head = "\n".join(IMPACT.format(t, factor * p["floor"]) for t, p in impacts)
    (metric,) = _of(
        judge_file(_bounces(tmp_path / "m.csv", head), Study([problem], [], ()), diagnosed=False),
        "impact_impulse",
    )
    assert metric.holds is holds and metric.unit == "N s"
    expected = (factor - 1) * max(p["floor"] for _, p in impacts)
    assert metric.value == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_stored_motion_and_a_published_one_give_their_impacts(tmp_path: Path) -> None:
    problem = library_problem("bouncing")
    assert problem is not None
    save(tb.engine("reference", timestep=5e-3).simulate(problem), tmp_path / "m.nc")
    (tmp_path / "p.nc").write_bytes(content("bouncing"))
    for name in ("m.nc", "p.nc"):
        found = judge_file(tmp_path / name, Study([problem], [], ()))
        assert [
            m.holds for kind in ("impact_time", "impact_impulse") for m in _of(found, kind)
        ] == [True, True]


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("# impact wall [s] = 1", "line 1: there is no stop 'wall'; there are: floor"),
        ("# impact floor [s] = soon", "line 1: impact floor is 'soon', which is no number"),
        ("# impact floor = 1", "line 1: column 'impact floor' has no unit; there are: [s], [ms]"),
        ("# impact floor [s] = -1", "line 1: impact floor is -1 s; a time from 0 on is needed"),
        (
            "# impact floor [s] = 1, impulse [N m s] = 2",
            "line 1: column 'impulse' has the unit [N m s]; there are: [N s]",
        ),
        (
            "# impact floor [s] = 1, force [N] = 2",
            "line 1: 'force [N] = 2' follows the time of an impact",
        ),
    ],
)
def test_a_broken_impact_is_one_sentence_with_its_line(
    head: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "m.csv").write_text(f"{head}\nt [s],q x [m]\n0,1\n1,1\n")
    with pytest.raises(tb.InputError, match=re.escape(said)):
        judge_file(tmp_path / "m.csv", Study([library_problem("bouncing") or ""], [], ()))


@pytest.mark.parametrize("name", ["my.csv", "my.nc"])
def test_a_release_before_the_start_is_one_sentence(
    name: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    motion = tb.engine("reference", timestep=1e-2).simulate(tb.Problem(tb.fixed(), duration=0.1))
    wrong = replace(motion, release_times={**motion.release_times, "hanger rest": -0.8})
    if name == "my.nc":
        save(wrong, tmp_path / name)
    else:
        _csv(
            tmp_path / name,
            wrong,
            *(f"q {q}" for q in wrong.mechanism.coordinates),
            head="# release hanger rest [s] = -0.8\n",
        )
    assert "hanger rest" in (sentence := refused("judge", name, "--model", "fixed"))
    assert "is -0.8 s; a time from 0 on is needed" in sentence


def test_no_netcdf_is_one_sentence(tmp_path: Path, refused: Callable[..., str]) -> None:
    (tmp_path / "my.nc").write_bytes(b"\x89HDF\r\n\x1a\nabc")
    assert "it is no NetCDF file" in refused("judge", "my.nc", "--model", MODEL)
    assert "cannot be read" in refused("judge", "none.csv", "--model", MODEL)


def test_the_command_says_it_in_its_exit_code(
    motion: tb.Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scale, code, verdict in ((1.0, 0, "agrees in what it gives"), (1.01, 1, "disagrees")):
        path = _csv(tmp_path / "my.csv", motion, "q theta", scale=scale)
        assert main(["judge", str(path), "--model", MODEL, "--out", str(tmp_path / "out")]) == code
        assert f"my.csv {verdict} on 'catapult'" in capsys.readouterr().out
    assert Judgement.load(tmp_path / "out" / "judgement.json").broken


@pytest.mark.parametrize(("name", "kind"), [("judgement", Judgement), ("conformance", Conformance)])
def test_published_schemas_are_those_of_the_types(name: str, kind: type[BaseModel]) -> None:
    published = (
        files("trebucheck.comparisons")
        .joinpath(f"schemas/{name}.schema.json")
        .read_text(encoding="utf-8")
    )
    assert published == schema_text(kind), "`make generated` writes the schemas anew"


def test_a_judgement_is_valid_by_its_schema(motion: tb.Trajectory, tmp_path: Path) -> None:
    found = _judged(_csv(tmp_path / "q.csv", motion, "q theta"))
    jsonschema.validate(json.loads(found.to_json()), json.loads(schema_text(Judgement)))
