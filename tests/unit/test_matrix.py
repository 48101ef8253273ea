"""`trebucheck matrix`: runs of several files side by side, grouped by scheme.

Nothing is green that was not judged.
"""

from __future__ import annotations

import ast
import re
import shlex
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
    Breach,
    CostSweep,
    Error,
    Matrix,
    MatrixProblem,
    MatrixRun,
    MeasuredOrder,
    ProblemClass,
    StepCost,
    command_of,
    distilled,
    matrix,
    sentence,
    spreads,
)
from trebucheck.comparisons.report import html, markdown
from trebucheck.comparisons.report.document import GridCell, VerdictGrid
from trebucheck.comparisons.report.pages.matrix import (
    STATES,
    counted_runs,
    document,
    engine_document,
)
from trebucheck.comparisons.runs.quantities import JUDGED, QUANTITIES, SYMBOLS
from trebucheck.comparisons.runs.results import Outcome, Results
from trebucheck.engines.presets import PRESETS
from trebucheck.engines.study import SCHEME_NAMES, EngineStudy, MaintainersNote
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


def _breach(label: str, ratio: float) -> Breach:
    return Breach(label=label, ratio=ratio)


def _matrix(*runs: MatrixRun, **fields: Any) -> Matrix:
    return Matrix.made_here(problems=fields.pop("problems", (_problem(),)), runs=runs, **fields)


def _line(text: str, start: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(f"| {start} |"))


def _grid(matrix: Matrix) -> VerdictGrid:
    return next(block for block in document(matrix).blocks if isinstance(block, VerdictGrid))


def _cell(matrix: Matrix, engine: str, problem: str = "swing") -> GridCell:
    grid = _grid(matrix)
    (row,) = (row for row in grid.rows if row.engine == engine)
    cell = row.cells[[column.name for column in grid.columns].index(problem)]
    assert cell is not None
    return cell


def _facts(cell: GridCell) -> dict[str, str]:
    return dict(cell.card.facts)


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
    groups = [(row.group, row.engine) for row in _grid(matrix).rows]
    assert groups[:3] == [(RK4, "a"), (RK4, "c"), (EULER, "b")]
    assert groups[3][0] not in (RK4, EULER)


def test_presets_stand_in_their_order_and_unknown_ones_last() -> None:
    names = ("mine", "assisted", "default", "settings")
    matrix = _matrix(*(_run("a", 1e-9, preset=preset) for preset in names))
    assert matrix.presets == ("default", "settings", "assisted", "mine")
    assert [row.preset for row in _grid(matrix).rows] == [*matrix.presets]


def test_problems_stand_by_class_and_then_by_the_library_s_order() -> None:
    loop, stop, plain = (
        _problem("loop", loops=True, number="A01"),
        _problem("stop", stops=True),
        _problem("plain", number="B01"),
    )
    met = _problem("met", stops=True, stop_law="unilateral")
    spring = _problem("spring", elements=True)
    file = _matrix(
        *(_run("a", 1e-9, problem=each.name) for each in (met, stop, loop, spring, plain)),
        problems=(met, stop, loop, spring, plain),
    )
    assert [each.group for each in (plain, spring, loop, stop, met)] == [*ProblemClass]
    assert [column.group for column in _grid(file).columns] == [
        each.group for each in file.problems
    ]


@pytest.mark.parametrize("outcome", [*Outcome])
def test_every_verdict_has_a_sign_of_its_own(outcome: Outcome) -> None:
    signs = {state.sign for state in STATES.values()}
    assert len(signs) == len(Outcome) and STATES[outcome].label
    run = _run("a", 1e-9, outcome=outcome, worst=_breach("position_max (tip)", 0.5))
    assert _cell(_matrix(run), "a").state == STATES[outcome].name


def test_a_cell_shows_the_quantity_that_broke_and_not_a_number_that_holds() -> None:
    holds = Error(metric="position_max", subject="tip", value=1e-9, unit="m", part=1e-9,
                  tolerance=1e-3, holds=True, judged=1, held=1)  # fmt: skip
    breaks = Error(metric="joint_reaction_max", subject="pin", value=6.0, unit="N", part=0.2,
                   tolerance=2.0, holds=False, judged=3, held=1)  # fmt: skip
    run = _run("a", outcome=Outcome.DISAGREES, errors=(holds, breaks), judged=4, held=2,
               worst=_breach("joint_reaction_max (pin)", 3.0), settings={})  # fmt: skip
    cell = _cell(_matrix(run), "a")
    assert cell.symbol == QUANTITIES["joint_reaction_max"].symbol
    first, second = cell.card.quantities
    assert (first.subject, first.holds, first.count) == ("pin", False, "1 of 3")
    assert (first.error, first.tolerance, first.unit) == ("6.0e0", "2.0e0", "N")
    assert (second.subject, second.holds) == ("tip", True)


def test_every_judged_quantity_has_a_symbol_and_every_symbol_a_meaning() -> None:
    assert {kind.symbol for kind in JUDGED.values()} <= set(SYMBOLS)
    assert not [kind.name for kind in QUANTITIES.values() if kind.follows and kind.symbol]


def test_a_file_that_kept_less_shows_no_error_that_is_not_the_broken_one() -> None:
    """Files of earlier releases keep the largest error of a quantity, not the broken one's."""
    run = _run("a", 1e-9, False, outcome=Outcome.DISAGREES, worst=_breach("angle_max (q)", 7.0))
    angle, position = _cell(_matrix(run), "a").card.quantities
    assert (angle.quantity, angle.ratio, angle.holds) == ("angle", "7.0e0", False)
    assert position.holds is False and not {angle.error, position.error} & {"1.0e-9"}
    assert position.error == angle.error  # that it is not kept
    kept = _run("a", 2e-3, False, outcome=Outcome.DISAGREES)
    assert _cell(_matrix(kept), "a").card.quantities[0].error == "2.0e-3"


def test_a_refusal_is_the_adapter_s_and_no_run_without_an_end_is_green() -> None:
    runs = (
        _run("welder", outcome=Outcome.UNSUPPORTED, message=_REFUSAL),
        _run("crasher", outcome=Outcome.FAILED, message="it fell over."),
        _run("sloth", outcome=Outcome.TIMED_OUT, time_limit=120.0, message="sloth was stopped."),
        _run("mover", 1e-9, problem="other"),
    )
    matrix = _matrix(*runs, problems=(_problem(), _problem("other")))
    welder = _cell(matrix, "welder")
    assert "adapter" in welder.card.lead and _REFUSAL in _facts(welder).values()
    assert "it fell over." in _facts(_cell(matrix, "crasher")).values()
    assert "120 s" in _cell(matrix, "sloth").card.lead
    lines = markdown.text(document(matrix)).splitlines()
    row = next(line for line in lines if line.startswith("| swing |"))
    assert [cell.strip() for cell in row.split("|")[2:-1]] == ["!", "·", "…", "–"]


def test_first_quantity_cause_and_its_share_are_those_of_the_diagnosis() -> None:
    run = _run("a", 1.0, False, outcome=Outcome.DISAGREES, first_in="angle_max (q)", first_at=0.25,
               causes=("time step",), explained=0.973, settings={"n": 3})  # fmt: skip
    facts = _facts(_cell(_matrix(run), "a"))
    text = " ".join(facts.values())
    assert "0.25 s" in text and "time step" in text and "97.3 %" in text and "n = 3" in text
    unknown = run.model_copy(update={"causes": (), "explained": None})
    assert "time step" not in " ".join(_facts(_cell(_matrix(unknown), "a")).values())


def test_a_measured_order_is_shown_and_a_declared_one_is_said_to_be_so() -> None:
    order = MeasuredOrder(
        engine="a", preset="assisted", problem="swing", exponent=3.98, half_width=0.03
    )
    soft = MeasuredOrder(
        engine="e",
        preset="assisted",
        problem="swing",
        exponent=None,
        floor=3e-4,
        floor_cause="stops",
    )
    runs = (_run("a", 1e-9), _run("b", 1e-9), _run("c", 1e-9, order=None), _run("e", 1e-9))
    rows = {row.engine: row for row in _grid(_matrix(*runs, orders=(order, soft))).rows}
    assert [rows[name].leading[0] for name in "abce"] == ["3.98", "4", "–", "–"]
    told = {name: dict(row.card.facts)["order"] for name, row in rows.items()}
    assert "measured" in told["a"] and "0.03" in told["a"] and "declared" in told["b"]
    assert "3.0e-4 m" in told["e"] and "stops" in told["e"]


def _costs(
    engine: str, preset: str, *points: tuple[float, float, float], **given: Any
) -> CostSweep:
    """A sweep of points (time step [s], cost [s], error in parts of the way)."""
    costs = [
        StepCost(timestep=step, steps=round(2 / step), cost=cost, part=part)
        for step, cost, part in points
    ]
    fields = {"problem": "swing", "engine_version": "1.5", "processor": "fast, 8 cores"}
    return CostSweep(engine=engine, preset=preset, points=tuple(costs), **(fields | given))


_SWEEPS = (
    _costs("a", "default", (4e-3, 1e-4, 2e-3), (2e-3, 2e-4, 1.1e-3)),
    _costs("a", "assisted", (8e-3, 3e-4, 0.9e-3), (4e-3, 3e-4, 2e-4), (2e-3, 9e-4, 1e-5)),
    _costs("b", "assisted", (8e-3, 1e-4, 0.1)),
)


def test_the_cheapest_step_that_holds_a_thousandth_is_found_over_all_presets() -> None:
    runs = _run("a", 1e-9, preset="default"), _run("a", 1e-9), _run("b", 1.0), _run("c", 1.0)
    found = _matrix(*runs, sweeps=_SWEEPS)
    cheapest = found.cheapest("a", "swing")
    assert cheapest is not None
    assert (cheapest[0].preset, cheapest[1].timestep) == ("assisted", 8e-3)  # the longer of equals
    assert found.cheapest("b", "swing") is None and found.cheapest("c", "swing") is None
    rows = {(row.engine, row.preset): row for row in _grid(found).rows}
    shown = {key: row.leading[1] for key, row in rows.items()}
    assert shown[("a", "default")] == "0/1" and shown[("a", "assisted")] == "1/1"
    assert shown[("b", "assisted")] == "0/1" and shown[("c", "assisted")] == "–"
    told = dict(rows["c", "assisted"].card.facts)["cheapest that holds 1e-3"]
    assert told == "not measured"
    text = markdown.text(document(found))
    assert "assisted, 8e-3 s" in text and "fast, 8 cores" in text and "a 1.5" in text


def test_files_without_costs_say_that_they_were_not_measured(tmp_path: Path) -> None:
    old = _matrix(_run("a", 1e-9))
    assert "sweeps" not in old.model_dump(mode="json") and "sweeps" not in old.to_json()
    file = tmp_path / "old.json"
    file.write_text(old.to_json())
    read = matrix([file])
    assert read.sweeps == () and [row.leading[1] for row in _grid(read).rows] == ["–"]
    assert "Cheapest that holds 1e-3: not measured" in markdown.text(document(read))
    page = engine_document(read, "a", EngineStudy(), "Dispute it.")
    assert "not measured" in markdown.text(page)


def test_of_two_sweeps_of_a_run_the_one_with_most_steps_is_kept(tmp_path: Path) -> None:
    short = _costs("a", "assisted", (8e-3, 1e-4, 0.1))
    files = [tmp_path / "runs.json", tmp_path / "orders.json"]
    files[0].write_text(_matrix(_run("a", 1e-9), sweeps=(short,)).to_json())
    files[1].write_text(_matrix(problems=(), sweeps=_SWEEPS[1:2]).to_json())
    for given in (files, files[::-1]):
        assert matrix(given).sweeps == _SWEEPS[1:2]


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
    assert "9e+03 at most (d assisted and a default on swing; 5 pairs, median 1e+03)" in sentence(
        found
    )


def test_agreement_is_counted_by_what_of_the_run_is_the_engines_own() -> None:
    held = {"stop forces": "", "when stops open and are met": ""}
    problems = (_problem(), _problem("stopped", stops=True), _problem("sprung", elements=True))
    runs = [
        _run(engine, 1e-9, problem=each.name, supplied=supplied)
        for engine, supplied in (("a", {}), ("b", held), ("c", {"time steps": "", **held}))
        for each in problems
    ]
    runs += [_run("d", 1e-9), _run("a", 1.0, False, preset="default", outcome=Outcome.DISAGREES)]
    grid = _grid(_matrix(*runs, problems=problems))
    own = {
        (row.engine, column.name): cell.own
        for row in grid.rows
        for column, cell in zip(grid.columns, row.cells, strict=True)
        if cell is not None
    }
    assert {own["a", each.name] for each in problems} == {"all"}
    assert (own["b", "swing"], own["b", "stopped"], own["b", "sprung"]) == ("all", "steps", "all")
    assert own["d", "swing"] == "not stated"
    # What trebucheck's steps move stands apart and is counted nowhere.
    assert [row.engine for row in grid.rows if row.apart] == ["c"]
    assert grid.rows[-1].engine == "c" and {own["c", each.name] for each in problems} == {
        "dynamics"
    }
    counted = counted_runs(_matrix(*runs, problems=problems))
    assert len(counted) == len(runs) - 3 and "c" not in {run.engine for run in counted}


def test_the_reference_is_no_row_and_counted_nowhere(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    path.write_text(_matrix(_run("a", 1e-9), _run("reference", 0.0)).to_json())
    file = matrix(path)
    (run,) = counted_runs(file)
    assert run.engine == "a" and [row.engine for row in _grid(file).rows] == ["a"]


def test_a_run_s_command_is_taken_by_compare(results: Results) -> None:
    file = distilled(results, "2026-01-02")
    (problem,) = file.problems
    words = shlex.split(command_of(file.runs[0], problem))
    assert words[:2] == ["trebucheck", "compare"]
    given = dict(zip(words[2::2], words[3::2], strict=True))
    assert given.pop("--until") == "0.5"  # not the problem's own end
    assert float(given.pop("--timestep")) == file.runs[0].timestep
    assert given == {"--models": "pendulum", "--engines": "pymunk", "--preset": file.runs[0].preset}
    own = _problem("mine", judged_to=2.0)
    assert "--models mine.json --until 2" in command_of(_run("a", problem="mine"), own)


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
        "pymunk default": "semi-implicit Euler, impulses",
        "pymunk settings": "semi-implicit Euler, impulses",
        "pymunk assisted": "leapfrog, impulses",
    }
    assert {run.scheme for run in matrix.runs} <= set(SCHEME_NAMES)
    run, full = (
        next(run for run in runs if run.label == "pymunk assisted")
        for runs in (matrix.runs, results.runs)
    )
    error, metric = run.error("position_max"), full.metric("position_max", "P1")
    assert error is not None and metric is not None and metric.value is not None
    assert (error.value, error.holds) == (metric.value, True)
    machine = results.machines[0]
    scale = QUANTITIES["position_max"].scale_of(machine.scales, "P1", machine.mechanism)
    assert error.part == pytest.approx(abs(metric.value) / scale)
    assert (run.order, run.timestep, run.held) == (2.0, full.settings["timestep"], len(full.judged))
    unjudged = full.model_copy(
        update={"metrics": tuple(m.model_copy(update={"tolerance": None}) for m in full.metrics)}
    )
    bare = distilled(results.model_copy(update={"runs": (unjudged,)}), "2026-01-02").runs[0]
    assert {error.holds for error in bare.errors} == {None} and bare.worst is None
    assert run.settings == full.settings and run.steps == full.steps
    judged = {metric.name for metric in full.judged}
    assert {error.metric for error in run.errors if error.judged} == judged
    assert sum(error.judged or 0 for error in run.errors) == len(full.judged)


def test_of_a_quantity_the_figure_farthest_beyond_its_tolerance_is_kept(results: Results) -> None:
    """The larger error may hold, where the smaller one has the smaller tolerance."""
    full = results.runs[0]
    base = full.metric("angular_speed_max", "phi")
    assert base is not None
    large = base.model_copy(update={"subject": "big", "value": 1.0, "tolerance": 10.0})
    small = base.model_copy(update={"subject": "small", "value": 1e-3, "tolerance": 1e-4})
    changed = full.model_copy(update={"metrics": (large, small)})
    (run,) = distilled(results.model_copy(update={"runs": (changed,)}), "2026-01-02").runs
    (error,) = run.errors
    assert (error.subject, error.value, error.tolerance) == ("small", 1e-3, 1e-4)
    assert (error.judged, error.held, error.holds) == (2, 1, False)
    speed = results.machines[0].scales.angular_speed
    assert error.part == pytest.approx(1.0 / speed)  # the largest, for schemes against each other


def test_a_matrix_is_read_back_as_it_was_written(results: Results) -> None:
    file = distilled(results, "2026-01-02")
    assert Matrix.from_json(file.to_json()) == file
    assert len(file.to_json().splitlines()) < 30  # a line a run, so that versions can be compared


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


def test_the_results_of_the_page_are_of_one_commit_and_of_today_s_presets() -> None:
    runs = matrix(sorted(ROOT.glob("*/results/*.json"))).runs
    assert len({run.commit for run in runs}) == 1
    assert None not in {run.commit for run in runs}
    assert {run.preset for run in runs if not run.is_dynamics} <= set(PRESETS)


# The pages of engines

NOTES = {
    path: next(
        {key.arg: ast.literal_eval(key.value) for key in node.keywords if key.arg}
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("MaintainersNote")
    )
    for path in (
        *sorted((ROOT / "plugins").glob("*/trebucheck_*/study.py")),
        *(ROOT / "engines" / name / "study.py" for name in ("mujoco", "pymunk", "exudyn")),
    )
}


@pytest.mark.parametrize("path", NOTES, ids=lambda path: path.parent.name)
def test_a_maintainers_note_has_no_number_of_its_own_and_is_filled_from_results(path: Path) -> None:
    name = path.parent.name.removeprefix("trebucheck_")
    note = MaintainersNote(**NOTES[path])
    for text in vars(note).values():
        outside = re.sub(r"{{.*?}}", "", text)
        assert not re.search(r"(?<![A-Za-z])\d", outside)  # RK4 and Box2D are names
    runs = tuple(
        _run(name, 1e-9, problem=problem, preset=preset)
        for problem in ("free-swing", "fixed")
        for preset in ("default", "assisted")
    )
    problems = (_problem("free-swing"), _problem("fixed", stops=True))
    file = _matrix(*runs, problems=problems)
    text = markdown.text(engine_document(file, name, EngineStudy(maintainers_note=note), ""))
    assert "{" not in text and "2 of 2" in text


def test_the_page_of_an_engine_has_its_runs_alone_and_its_own_settings() -> None:
    runs = (
        _run("a", 1e-9, preset="default", settings={"step": 1e-3, "rule": "Euler"}),
        _run("a", 1e-9, preset="default", problem="stop", settings={"step": 2e-3, "rule": "Euler"}),
        _run("a", outcome=Outcome.UNSUPPORTED, message=_REFUSAL),
        _run("b", 1e-9, engine_version="b9", settings={"secret": 1}),
    )
    file = _matrix(*runs, problems=(_problem(), _problem("stop", stops=True)))
    study = EngineStudy(title="A!", binding="the wheel `a`")
    text = markdown.text(engine_document(file, "a", study, "Open an issue."))
    assert text.startswith("# A!") and "the wheel `a`" in text and "Open an issue." in text
    assert _line(text, "`step`") == "| `step` | 0.001 to 0.002 |  |"
    assert _line(text, "`rule`") == "| `rule` | Euler |  |"
    assert _REFUSAL in text and "b9" not in text and "secret" not in text
    with pytest.raises(InputError, match="'c'"):
        engine_document(file, "c", study, "")


def test_every_engine_of_the_kept_results_has_a_page_in_the_site_s_contents() -> None:
    engines = {run.engine for run in matrix(sorted(ROOT.glob("*/results/*.json"))).runs}
    assert {path.stem for path in (ROOT / "docs" / "engines").glob("*.md")} == engines
    contents = (ROOT / "mkdocs.yml").read_text()
    assert not [name for name in engines if f": engines/{name}.md\n" not in contents]


def test_a_commit_is_kept_with_the_runs_that_have_none(tmp_path: Path) -> None:
    old = Matrix.made_here(problems=(_problem(),), runs=(_run("a", 0.1),)).of_commit("0ld")
    new = Matrix.made_here(problems=(_problem(),), runs=(_run("b", 0.1),))
    for name, part in (("old", old), ("new", new)):
        (tmp_path / f"{name}.json").write_text(part.to_json())
    files = [tmp_path / "old.json", tmp_path / "new.json"]
    unknown, both = matrix(files), matrix(files, commit="n3w")
    assert {run.engine: run.commit for run in unknown.runs} == {"a": "0ld", "b": None}
    assert {run.engine: run.commit for run in both.runs} == {"a": "0ld", "b": "n3w"}
    text = markdown.text(engine_document(both, "b", EngineStudy(), "dispute"))
    assert "at n3w" in text and "at 0ld" not in text
