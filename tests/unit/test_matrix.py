"""`trebucheck matrix`: runs of several files side by side, grouped by scheme.

Nothing is green that was not judged.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.comparisons.converge import (
    Curve,
    MachineStudies,
    Point,
    PowerLaw,
    Studies,
    SweepStudy,
)
from trebucheck.comparisons.matrix import (
    Error,
    Matrix,
    MatrixProblem,
    MatrixRun,
    MeasuredOrder,
    distilled,
    matrix,
    spreads,
)
from trebucheck.comparisons.report import html, markdown
from trebucheck.comparisons.report.pages.matrix import document
from trebucheck.comparisons.runs.results import Outcome, Results
from trebucheck.engines.study import SCHEME_NAMES
from trebucheck.models.errors import InputError

ROOT = Path(__file__).parents[2]
RK4, EULER = "RK4, joint coordinates", "semi-implicit Euler, joint coordinates"
_REFUSAL = "welder cannot build loops: it has no constraints."


def _problem(name: str = "swing", **fields: Any) -> MatrixProblem:
    given = {
        "mechanism_hash": name,
        "stop_law": "release-once",
        "judged_to": 2.0,
        "stops": False,
        "loops": False,
    }
    return MatrixProblem(name=name, **(given | fields))


def _run(
    engine: str, part: float | None = None, holds: bool | None = True, **fields: Any
) -> MatrixRun:
    error = Error(
        metric="position_max",
        subject="tip",
        value=part,
        unit="m",
        part=part,
        tolerance=1e-3,
        holds=holds,
    )
    given = {
        "problem": "swing",
        "preset": "assisted",
        "engine_version": "1",
        "scheme": RK4,
        "order": 4.0,
        "timestep": 1e-3,
        "outcome": Outcome.AGREES,
        "date": "2026-01-02",
        "made_by": "0.1.0",
        "errors": () if part is None else (error,),
    }
    return MatrixRun(engine=engine, **(given | fields))


def _matrix(*runs: MatrixRun, **fields: Any) -> Matrix:
    return Matrix.made_here(problems=fields.pop("problems", (_problem(),)), runs=runs, **fields)


def _text(matrix: Matrix) -> str:
    return markdown.text(document(matrix), signs=True)


def _line(text: str, start: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(f"| {start} |"))


def test_engines_of_one_scheme_stand_together_and_those_that_state_none_come_last() -> None:
    runs = (
        _run("a", 1e-9),
        _run("b", 1e-4, scheme=EULER),
        _run("c", 2e-9),
        _run("d", 1.0, scheme=""),
    )
    matrix = _matrix(*runs)
    assert matrix.schemes() == {
        RK4: ["a assisted", "c assisted"],
        EULER: ["b assisted"],
        "": ["d assisted"],
    }
    lines = [line.split(" | ")[0].strip("| *") for line in _text(matrix).splitlines()]
    heads = [
        line
        for line in lines
        if line in (RK4, EULER, "scheme not stated", "a assisted", "b assisted", "c assisted")
    ]
    assert heads[:6] == [RK4, "a assisted", "c assisted", EULER, "b assisted", "scheme not stated"]


@pytest.mark.parametrize(
    ("outcome", "holds", "sign"),
    [
        (Outcome.AGREES, True, "✓ "),
        (Outcome.DISAGREES, False, "✗ "),
        (Outcome.NOT_JUDGED, None, "○ "),
    ],
)
def test_a_cell_has_the_sign_of_its_verdict_and_its_error(
    outcome: Outcome, holds: bool | None, sign: str
) -> None:
    matrix = _matrix(_run("a", 1.5e-7, holds, outcome=outcome))
    verdict, quantity = (
        line for line in _text(matrix).splitlines() if line.startswith("| a assisted |")
    )
    assert verdict.endswith(f"| {sign}1.5e-7 |") and quantity.endswith(f"| {sign}1.5e-7 |")


def test_what_did_not_run_is_said_in_its_own_words_and_is_never_green() -> None:
    runs = (
        _run("welder", outcome=Outcome.UNSUPPORTED, message=_REFUSAL),
        _run("crasher", outcome=Outcome.FAILED, message="it fell over."),
        _run(
            "sloth",
            outcome=Outcome.TIMED_OUT,
            time_limit=120.0,
            message="sloth did not finish within 120 s and was stopped.",
        ),
        _run("stranger", outcome=Outcome.NOT_EQUIVALENT, message="total mass off by 1."),
        _run("gone", outcome=Outcome.ABSENT, message="gone is not installed."),
        _run("mover", 1e-9, problem="other"),
    )
    text = _text(_matrix(*runs, problems=(_problem(), _problem("other"))))
    said = {
        "welder": "! refused",
        "crasher": "✗ failed",
        "sloth": "✗ not finished in 120 s",
        "stranger": "✗ another model",
        "gone": "! not installed",
    }
    for engine, cell in said.items():
        assert f"| {cell} |" in _line(text, f"{engine} assisted") and "✓" not in _line(
            text, f"{engine} assisted"
        )
    assert "not run" in _line(text, "mover assisted") and _REFUSAL in _line(text, "welder")
    assert "it fell over." in text and "total mass off by 1." in text


def test_a_measured_order_is_shown_and_a_declared_one_is_said_to_be_so() -> None:
    order = MeasuredOrder(
        engine="a", preset="assisted", problem="swing", exponent=3.98, half_width=0.03
    )
    flat = MeasuredOrder(engine="d", preset="assisted", problem="swing", exponent=None)
    soft = MeasuredOrder(
        engine="e",
        preset="assisted",
        problem="swing",
        exponent=None,
        floor=3e-4,
        floor_cause="stops",
    )
    runs = (
        _run("a", 1e-9),
        _run("b", 1e-9),
        _run("c", 1e-9, order=None),
        _run("d", 1e-9),
        _run("e", 1e-9),
    )
    text = _text(_matrix(*runs, orders=(order, flat, soft)))
    assert "| none: floor 3.0e-4 m (swing) |" in _line(text, "e assisted")
    assert "| none (swing) |" in _line(text, "d assisted")
    assert "3.980 ± 0.030 (swing)" in _line(text, "a assisted")
    assert "4 (declared)" in _line(text, "b assisted") and "none (declared)" in _line(
        text, "c assisted"
    )


def test_ratios_within_a_scheme_and_between_schemes_are_of_different_engines_at_equal_steps() -> (
    None
):
    runs = (
        _run("a", 1e-9), _run("b", 3e-9), _run("c", 1e-4, scheme=EULER), _run("d", 1e-13),
        _run("a", 9e-9, preset="default"), _run("e", 1.0, timestep=2e-3),
    )  # fmt: skip
    (found,) = spreads(_matrix(*runs))
    assert (found.scheme, found.constrained, found.engines) == (RK4, False, ("a", "b", "d", "e"))
    # a-b 3, a-d 1e3 (rounding counts as 1e-12), b-d 3e3, b-a default 3, d-a default 9e3; c against
    # each of the four
    assert sorted(each.value for each in found.within) == pytest.approx([3, 3, 1e3, 3e3, 9e3])
    assert sorted(each.value for each in found.between) == pytest.approx(
        [1e-4 / 9e-9, 1e-4 / 3e-9, 1e5, 1e8]
    )
    assert "9e+03 at most (d assisted and a default on swing; 5 pairs, median 1e+03)" in _text(
        _matrix(*runs)
    )


def test_agreement_is_counted_by_what_of_the_run_is_the_engines_own() -> None:
    held = {"stop forces": "", "when stops open and are met": ""}
    problems = (_problem(), _problem("stopped", stops=True), _problem("sprung", elements=True))
    runs = (
        *(_run("a", 1e-9, problem=each.name, supplied={}) for each in problems),
        *(_run("b", 1e-9, problem=each.name, supplied=held) for each in problems),
        *(
            _run("c", 1e-9, problem=each.name, supplied={"time steps": "", **held})
            for each in problems
        ),
        _run("d", 1e-9),
        _run("a", 1.0, False, preset="default", outcome=Outcome.DISAGREES, supplied={}),
    )
    text = _text(_matrix(*runs, problems=problems))
    assert (
        "Of 10 agreements the engine's own is: all in 5, steps in 1, dynamics in 3, not stated in "
        "1."
    ) in text
    own = {
        (where, line.split(" | ")[0].strip("| ")): line.split(" | ")[1]
        for where, line in _leading(text)
    }
    assert (
        own["Without stops and loops", "b assisted"] == "all"
        and own["With stops", "b assisted"] == "steps"
    )
    assert (
        own["With stops", "c assisted"]
        == own["Without stops and loops", "c assisted"]
        == "dynamics"
    )
    assert own["Without stops and loops", "d assisted"] == "not stated"
    assert (
        "| a default | nothing |" in text
        and "| b assisted | stop forces; when stops open and are met |" in text
    )


def _leading(text: str) -> Iterator[tuple[str, str]]:
    """Rows of engines of the tables of verdicts, each with its table's title."""
    title = ""
    for line in text.partition("## What is the engine's own")[0].splitlines():
        title = line.strip("*") if line.startswith("**") else title
        if re.match(r"\| \w+ (assisted|default) \|", line):
            yield title, line


@pytest.fixture(scope="module")
def results() -> Results:
    """A pendulum in an engine and the reference."""
    return tb.compare(
        ["pendulum"], ["pymunk", "reference"], until=0.5, isolate=False, diagnose=False
    ).results


def test_results_of_a_comparison_are_distilled_with_schemes_scales_and_verdicts(
    results: Results,
) -> None:
    pytest.importorskip("pymunk")
    matrix = distilled(results, "2026-01-02")
    assert {run.label: run.scheme for run in matrix.runs} == {
        "pymunk default": "semi-implicit Euler, impulses", "pymunk assisted": "leapfrog, impulses"
    }  # fmt: skip
    assert {run.scheme for run in matrix.runs} <= set(SCHEME_NAMES)
    run, full = (
        matrix.runs[0],
        next(run for run in results.runs if run.label == matrix.runs[0].label),
    )
    error, metric = run.error("position_max"), full.metric("position_max", "P1")
    assert error is not None and metric is not None and metric.value is not None
    assert (error.value, error.holds) == (metric.value, True)
    assert error.part == pytest.approx(abs(metric.value) / results.machines[0].scales.length)
    assert (run.order, run.timestep, run.held) == (2.0, full.settings["timestep"], len(full.judged))
    unjudged = full.model_copy(
        update={"metrics": tuple(m.model_copy(update={"tolerance": None}) for m in full.metrics)}
    )
    bare = distilled(results.model_copy(update={"runs": (unjudged,)}), "2026-01-02").runs[0]
    assert {error.holds for error in bare.errors} == {None} and bare.worst is None


def test_files_are_put_together_once_and_read_again(results: Results, tmp_path: Path) -> None:
    whole, first, second = (
        tmp_path / name for name in ("results.json", "first.json", "second.json")
    )
    whole.write_text(results.to_json())
    assert main(["matrix", str(whole), "--quiet", "--out", str(first)]) == 0
    second.write_text(_matrix(_run("a", 1e-9)).to_json())
    assert {run.engine for run in matrix([first, second]).runs} == {"a", "pymunk"}
    for suffix in ("html", "md"):
        assert (
            main(
                [
                    "matrix",
                    str(first),
                    str(second),
                    "--quiet",
                    "--out",
                    str(tmp_path / f"m.{suffix}"),
                ]
            )
            == 0
        )
    assert (tmp_path / "m.html").read_text() == html.page(
        document(
            matrix([first, second]).made_by(
                f"trebucheck matrix {first} {second} --out {tmp_path / 'm.html'}"
            )
        )
    )
    with pytest.raises(
        InputError,
        match=r"the run pymunk default on pendulum is in .*results.json and in .*first.json",
    ):
        matrix([whole, first])


def _sweep(
    engine: str, knob: str, law: PowerLaw | None, position: float | None = 1e-6
) -> SweepStudy:
    curve = Curve(quantity="position", law=law, floor=None)
    return SweepStudy(
        engine=engine,
        engine_version="1",
        preset="assisted",
        knob=knob,
        title="",
        unit="s",
        base={},
        settings={},
        expected=None,
        why="",
        own=False,
        points=(Point(value=1e-3, options={}, position=position),),
        curves=(curve,),
    )


def test_orders_are_those_of_sweeps_of_the_time_step_that_moved(tmp_path: Path) -> None:
    law = PowerLaw(exponent=3.99, half_width=0.02, factor=1.0, low=1e-4, high=1e-2, points=5)
    sweeps = (
        _sweep("a", "timestep", law), _sweep("a", "iterations", law), _sweep("b", "timestep", None),
        _sweep("c", "timestep", None, position=None),
    )  # fmt: skip
    mechanism = tb.model("pendulum")
    machine = MachineStudies(
        model="swing",
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        launch_time=None,
        uncertainty={},
        uncertainty_source="estimate",
        studies=sweeps,
        limits=(),
        pairs=(),
    )
    converge, runs = tmp_path / "converge.json", tmp_path / "runs.json"
    converge.write_text(Studies.made_here(machines=(machine,)).to_json())
    runs.write_text(_matrix(_run("a", 1e-9)).to_json())
    found = {order.engine: order.exponent for order in matrix([runs, converge]).orders}
    assert found == {"a": 3.99, "b": None}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{", "is not JSON"),
        (
            '{"format": "trebucheck-explain-1"}',
            "has format 'trebucheck-explain-1'; needed is one of",
        ),
        ("[]", "has no format"),
        (
            _matrix(_run("b"), problems=(_problem(mechanism_hash="other"),)).to_json(),
            "'swing' is another mechanism",
        ),
        (Matrix.made_here(problems=(), runs=()).to_json(), None),
    ],
)
def test_bad_files_get_one_sentence(
    content: str, sentence: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    good.write_text(_matrix(_run("a", 1e-9)).to_json())
    bad.write_text(content)
    code = main(["matrix", str(good), str(bad), "--quiet"])
    said = capsys.readouterr().err
    assert (code, said.count("\n")) == ((0, 0) if sentence is None else (2, 1)) and (
        sentence or ""
    ) in said
    assert main(["matrix", str(good), "--out", str(tmp_path / "m.txt")]) == 2
    assert "must end in .html, .md or .json" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_said_to_be_unreadable_and_not_to_be_of_another_kind(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match=r"none\.json cannot be read: No such file"):
        tb.matrix(tmp_path / "none.json")


def test_a_table_is_no_wider_than_a_screen_and_every_problem_is_in_one() -> None:
    problems = tuple(_problem(f"p{k:02}", number=f"P{k:02}") for k in range(17))
    text = _text(
        _matrix(*(_run("a", 1e-9, problem=each.name) for each in problems), problems=problems)
    )
    heads = [
        line.split(" | ")[4:]
        for line in text.splitlines()
        if line.startswith("| engine | own | order")
    ]
    assert [len(each) for each in heads] == [6, 5, 6]
    assert [name.strip(" |") for each in heads for name in each] == [
        each.number for each in problems
    ]
    assert "Without stops and loops: P00 to P05" in text


@pytest.mark.parametrize(
    "path",
    [
        *sorted((ROOT / "plugins" / "results").glob("*.json")),
        *sorted((ROOT / "docs" / "results").glob("*.json")),
    ],
    ids=lambda path: f"{path.parent.parent.name}-{path.stem}",
)
def test_the_results_of_the_page_name_no_place_on_a_machine(path: Path) -> None:
    assert not re.search(r"/(?:tmp|home|root|work|Users|var)/", path.read_text())
