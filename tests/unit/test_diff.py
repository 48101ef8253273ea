"""`trebucheck diff`: changes seeded into a comparison are found and judged, and what is no change
is none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.cli import agree as command
from trebucheck.comparisons.diff import (
    FACTOR,
    Difference,
    DifferenceData,
    Fate,
    QuantityChange,
    data,
    diff,
)
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.pages.diff import document
from trebucheck.comparisons.runs.results import (
    Diagnosis,
    Metric,
    Outcome,
    RankedCause,
    Results,
    Run,
)
from trebucheck.models.spec import schema_text

pytest.importorskip("pymunk")

Change = Callable[[Run], Run]
_QUESTION = "What moved from one comparison to the other, and what broke?"


@pytest.fixture(scope="module")
def results() -> Results:
    """A pendulum in two engines, all of whose runs agree."""
    return tb.compare(
        ["pendulum"], ["pymunk", "reference"], until=0.5, isolate=False, diagnose=False
    ).results


def _changed(
    results: Results, change: Change, engine: str = "pymunk", preset: str = "assisted"
) -> Results:
    runs = [
        change(run) if (run.engine, run.preset) == (engine, preset) else run for run in results.runs
    ]
    return results.model_copy(update={"runs": tuple(runs)})


def _with(name: str, **fields: Any) -> Change:
    """A run whose metrics of one name have other fields; numbers of values are factors."""

    def metric(each: Metric) -> Metric:
        return each.model_copy(update=fields) if each.name == name else each

    return lambda run: run.model_copy(update={"metrics": tuple(map(metric, run.metrics))})


def _one(changes: tuple[QuantityChange, ...]) -> QuantityChange:
    assert len(changes) == 1
    return changes[0]


def _metric(results: Results, name: str, engine: str = "pymunk") -> Metric:
    run = next(run for run in results.runs if run.engine == engine and run.preset == "assisted")
    return next(metric for metric in run.metrics if metric.name == name)


def _shown(difference: Difference) -> str:
    return markdown.text(document(difference), signs=True)


def test_nothing_changes_from_a_comparison_to_itself(results: Results) -> None:
    same = diff(results, results)
    assert same.passed and not same.moved and not same.versions and same.compared == 5
    assert {each.fate for each in same.runs} == {Fate.SAME}
    assert "Nothing broke: 0 of" in same.summary and "are the same" in _shown(same)


def test_a_verdict_that_breaks_is_found_and_explained(results: Results) -> None:
    tolerance = _metric(results, "position_max").tolerance
    assert tolerance
    causes = (
        RankedCause(name="another mass", kind="machine", amount="1 kg -> 2 kg", explained=1.0),
    )
    diagnosis = Diagnosis(leads="position_max (tip)", parts_at=0.1, causes=causes, likeliest=1)

    def broken(run: Run) -> Run:
        worse = _with("position_max", value=3 * tolerance)(_with("energy_balance", value=None)(run))
        return worse.model_copy(update={"outcome": Outcome.DISAGREES, "diagnosis": diagnosis})

    found = diff(results, _changed(results, broken))
    assert [change.either.name for change in found.broken] == ["energy_balance", "position_max"]
    assert found.broken[1].distance == pytest.approx(3) and found.worse
    assert [(each.run.label, each.fate) for each in found.runs if each.fate is not Fate.SAME] == [
        ("pymunk assisted", Fate.WORSE)
    ]
    text = _shown(found)
    assert (
        "2 verdicts broke" in text
        and "another mass (1 kg -> 2 kg)" in text
        and "✗ holds → breaks" in text
    )
    back = diff(_changed(results, broken), results)
    assert (
        back.passed
        and len(back.mended) == 2
        and "2 verdicts mended, 1 run is better" in back.summary
    )


def test_a_verdict_that_is_another_by_its_tolerance_alone_is_said_to_be(results: Results) -> None:
    value = _metric(results, "position_max").value
    assert value
    broken = _changed(results, _with("position_max", tolerance=value / 2))
    looser, better = (
        _changed(results, _with("position_max", **f)) for f in ({}, {"value": value / 4})
    )
    assert (
        _one(diff(broken, looser).mended).by_tolerance
        and not _one(diff(broken, better).mended).by_tolerance
    )
    assert "✓ breaks → holds, by its tolerance" in _shown(diff(broken, looser))
    assert _one(diff(results, broken).broken).by_tolerance
    assert not _one(
        diff(results, _changed(results, _with("position_max", value=1e3))).broken
    ).by_tolerance


@pytest.mark.parametrize(
    "fields", [{"tolerance": None}, {"observed": False, "tolerance": None, "value": None}]
)
def test_a_verdict_that_is_no_longer_given_got_worse(
    results: Results, fields: dict[str, Any]
) -> None:
    found = diff(results, _changed(results, _with("position_max", **fields)))
    assert _one(found.broken).either.name == "position_max" and not found.passed
    assert "holds → not judged" in _shown(found)


def test_a_broken_tolerance_that_is_no_longer_judged_is_not_mended(results: Results) -> None:
    broken = _changed(results, _with("position_max", value=1e3))
    found = diff(broken, _changed(results, _with("position_max", value=1.0, tolerance=None)))
    assert not found.mended and not found.broken and "breaks → not judged" in _shown(found)
    unjudged = _changed(results, _with("position_max", tolerance=None))
    assert "not judged → holds" in _shown(diff(unjudged, results)) and _one(
        diff(unjudged, results).mended
    )


def test_a_quantity_that_is_gone_or_new(results: Results) -> None:
    def without(run: Run) -> Run:
        return run.model_copy(
            update={"metrics": tuple(m for m in run.metrics if m.name != "position_max")}
        )

    fewer = _changed(results, without)
    assert _one(diff(results, fewer).broken).new is None
    back = diff(fewer, results)
    assert back.passed and not back.mended  # what holds and was not there before was not broken
    assert _one(diff(fewer, _changed(results, _with("position_max", value=1e3))).broken).old is None


def test_a_model_check_that_is_no_longer_made_got_worse(results: Results) -> None:
    def unchecked(run: Run) -> Run:
        assert run.equality and run.equality.checks
        return run.model_copy(
            update={"equality": run.equality.model_copy(update={"exposed": False, "checks": ()})}
        )

    assert (
        _one(diff(results, _changed(results, unchecked)).broken).either.name == "model equivalence"
    )


def test_runs_that_vanish_appear_or_fail(results: Results) -> None:
    fewer = results.model_copy(update={"runs": results.runs[1:]})
    absent = _changed(
        results, lambda run: run.model_copy(update={"outcome": Outcome.ABSENT, "metrics": ()})
    )
    failed = _changed(
        results,
        lambda run: run.model_copy(
            update={"outcome": Outcome.FAILED, "message": "it <b>blew</b> | up", "metrics": ()}
        ),
    )
    for new in (fewer, absent):
        assert diff(results, new).of_fate(Fate.VANISHED) and not diff(results, new).passed
        assert diff(new, results).of_fate(Fate.APPEARED) and diff(new, results).passed
    found = diff(results, failed)
    assert len(found.of_fate(Fate.FAILS)) == 1 and not found.broken and not found.passed
    assert "it &lt;b>blew&lt;/b> \\| up" in _shown(found)
    assert diff(fewer, failed).of_fate(Fate.FAILS) and diff(failed, results).of_fate(Fate.BETTER)
    assert diff(failed, failed).passed


def test_versions_and_settings_that_changed_are_named(results: Results) -> None:
    new = _changed(
        results,
        lambda run: run.model_copy(
            update={
                "engine_version": "99.1",
                "settings": {**run.settings, "timestep": 5e-4, "extra": True},
            }
        ),
    ).model_copy(update={"python_version": "4.0"})
    found = diff(
        results,
        new.model_copy(update={"runs": tuple(r for r in new.runs if r.preset == "assisted")}),
    )
    assert (
        found.versions["Python"] == (results.python_version, "4.0")
        and found.versions["pymunk"][1] == "99.1"
    )
    assert "extra none → True: pendulum, pymunk assisted." in _shown(found)


@pytest.mark.parametrize(("share", "moved"), [(0.9, False), (1.2, True)])
@pytest.mark.parametrize("name", ["position_max", "energy_balance", "velocity_max"])
def test_less_than_what_is_unknown_is_no_movement(
    results: Results, name: str, share: float, moved: bool
) -> None:
    """Whatever the factor: from nothing, and from what both results leave unknown of it, by a part
    of that.
    """
    for known in (results.machines[0].reference_uncertainty, {}):  # without it, rounding is left
        machine = results.machines[0].model_copy(update={"reference_uncertainty": known})
        _check_unknown(results.model_copy(update={"machines": (machine,)}), name, share, moved)


def _check_unknown(results: Results, name: str, share: float, moved: bool) -> None:
    metric, machine = _metric(results, name), results.machines[0]
    run = next(run for run in results.runs if run.engine == "pymunk" and run.preset == "assisted")
    scale = {"position_max": machine.scales.length, "velocity_max": machine.scales.speed}
    rounding = 2.0**-52 * math.sqrt(run.steps) * max(1.0, machine.stretching)
    rounding *= scale.get(name, machine.scales.largest_energy)
    known = machine.reference_uncertainty
    unknown = 2 * (known.get(metric.label, known.get(name, 0.0)) + rounding)
    for least in (0.0, unknown):
        old, new = (
            _changed(results, _with(name, value=v)) for v in (least, -least - share * unknown)
        )
        assert bool(diff(old, new).moved) is moved
        assert bool(diff(new, old).moved) is moved


def test_samples_that_leave_an_error_unknown_hide_its_movement(results: Results) -> None:
    most = _metric(results, "position_max").tolerance
    assert most

    def with_error(part: float, unknown: float | None) -> Results:
        fields = {"value": part * most, "sampling_error": unknown and unknown * most}
        return _changed(results, _with("position_max", **fields))

    assert not diff(with_error(0.1, 0.5), with_error(0.9, 0.5)).moved
    assert diff(with_error(0.1, 0.3), with_error(0.9, 0.3)).moved


@pytest.mark.parametrize(
    ("ratio", "factor", "moved"), [(1.2, 1.1, True), (1.2, 1.5, False), (0.5, 1.5, True)]
)
def test_movement_counts_from_the_factor_on(
    results: Results, ratio: float, factor: float, moved: bool
) -> None:
    value = _metric(results, "position_max").value
    assert value
    found = diff(results, _changed(results, _with("position_max", value=ratio * value)), factor)
    assert bool(found.moved) is moved and found.passed
    if moved:
        assert _one(found.moved).factor == pytest.approx(ratio)


def test_another_mechanism_or_motion_is_not_compared(results: Results) -> None:
    machine = results.machines[0]
    broken = _changed(results, _with("position_max", value=1e3))
    for other in ({"mechanism_hash": "0" * 64}, {"compared_to": 0.25}, {"thrown": "somebody"}):
        new = broken.model_copy(update={"machines": (machine.model_copy(update=other),)})
        found = diff(results, new)
        assert len(found.of_fate(Fate.NOT_COMPARED)) == 5 and not found.quantities
        assert (
            "Nothing could be compared" in found.summary
            and not found.passed
            and "another" in _shown(found)
        )


def test_a_reference_that_moved_is_something_that_broke(results: Results) -> None:
    machine = results.machines[0].model_copy(
        update={"launch_time": 0.3, "launch_speed": 4.0, "release_times": {"rest": 0.2}}
    )
    known = {
        **machine.reference_uncertainty,
        "launch_time": 1e-9,
        "launch_speed": 1e-9,
        "release_time": 1e-9,
    }

    def with_figures(**figures: Any) -> Results:
        own = machine.model_copy(update={"reference_uncertainty": known} | figures)
        return results.model_copy(update={"machines": (own,)})

    old = with_figures()
    assert diff(old, with_figures(launch_time=0.3 + 1.9e-9)).passed
    assert not diff(old, with_figures(launch_time=0.3 + 2.1e-9)).passed
    assert diff(old, with_figures(launch_time=None)).references
    assert [
        each.figure for each in diff(old, with_figures(release_times={"rest": 0.21})).references
    ] == ["release_time (rest)"]
    assert not diff(old, with_figures(release_times={"rest": None})).passed
    gone = {name: size for name, size in known.items() if not name.startswith("launch")}
    unlaunched = with_figures(launch_time=None, launch_speed=None, reference_uncertainty=gone)
    moved = data(diff(old, unlaunched)).references
    assert [(each.figure, each.new, each.unknown < 2e-9) for each in moved] == [
        ("launch_time", None, True),
        ("launch_speed", None, True),
    ]
    found = diff(old, with_figures(impacts=2))
    assert (
        _shown(found).count("The reference moved") == 1
        and "1 figure of the reference moved" in found.summary
    )


def test_what_was_asked_for_and_where_nothing_is_predictable_are_conditions(
    results: Results,
) -> None:
    machine = results.machines[0].model_copy(
        update={"needs": {"position": "1e-3"}, "judged_to": 0.4}
    )
    text = _shown(diff(results, results.model_copy(update={"machines": (machine,)})))
    assert (
        "tolerances asked for: none, now position 1e-3." in text
        and "to 0.5 s, now to 0.4 s" in text
    )
    looser = _changed(results, _with("position_max", tolerance=10.0))
    assert "Tolerances of 1 of" in _shown(diff(results, looser))


def test_a_diagnosis_that_changed_is_said(results: Results) -> None:
    first, second = Diagnosis(leads="position_max (tip)"), Diagnosis(leads="angle_max (q)")
    bad = _with("position_max", value=1e3)
    old, new = (
        _changed(results, lambda run, d=d: bad(run).model_copy(update={"diagnosis": d}))
        for d in (first, second)
    )
    text = (
        "was first in position_max (tip), cause unknown; is first in angle_max (q), cause unknown."
    )
    assert text in _shown(diff(old, new)) and "Diagnoses" not in _shown(diff(old, old))


def test_many_movements_are_shown_in_part_and_folded(results: Results) -> None:
    value = _metric(results, "position_max").value
    assert value
    extra = tuple(
        Metric(name="position_max", subject=f"p{i}", value=value * i, unit="m", tolerance=1.0)
        for i in range(1, 31)
    )
    grown = tuple(m.model_copy(update={"value": 2 * (m.value or 0)}) for m in extra)
    old, new = (
        _changed(results, lambda run, e=e: run.model_copy(update={"metrics": (*run.metrics, *e)}))
        for e in (extra, grown)
    )
    found = diff(old, new)
    assert len(found.moved) == 30 and "<details><summary>10 more</summary>" in _shown(found)


def test_half_the_step_is_a_quarter_of_a_second_order_error() -> None:
    """Two comparisons as they are: nothing is seeded."""
    old, new = (
        tb.compare(
            ["pendulum"],
            ["pymunk"],
            ["assisted"],
            until=0.5,
            timestep=step,
            isolate=False,
            diagnose=False,
        )
        for step in (2e-3, 1e-3)
    )
    found = diff(old, new)
    factors = {change.either.name: change.factor for change in found.moved}
    assert found.passed and factors["position_max"] == pytest.approx(0.25, rel=0.1)
    assert "timestep 2e-3 → 1e-3: pendulum, pymunk assisted." in _shown(found)


@pytest.mark.parametrize("factor", [1.0, 0.5, -2.0, math.nan, math.inf])
def test_a_factor_is_above_one(results: Results, factor: float) -> None:
    with pytest.raises(tb.InputError, match=r"factor = .* above 1"):
        diff(results, results, factor)


@pytest.fixture
def files(results: Results, tmp_path: Path) -> tuple[Path, Path]:
    """The results, and some with a broken verdict, in folders of their own."""
    broken = _changed(results, _with("position_max", value=1e3))
    for name, content in {"old": results, "new": broken}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(content.to_json())
    return tmp_path / "old", tmp_path / "new"


def test_the_command_shows_writes_and_ends_with_a_code(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = map(str, files)
    assert main(["diff", old, f"{old}/results.json"]) == 0
    assert "Nothing broke" in capsys.readouterr().out
    assert main(["diff", old, new]) == 1
    assert "Verdicts that broke" in capsys.readouterr().out
    assert main(["diff", old, new, "--format", "markdown"]) == 1
    shown = capsys.readouterr().out
    assert shown.startswith(
        "# What moved from one comparison to the other, and what broke?\n\n✗ Something broke: 1 "
        "verdict broke"
    )
    starts = {
        "d.html": "<!doctype html>",
        "d.md": "# What moved from one",
        "d.txt": "The versions of engines",
    }
    for name, start in starts.items():
        assert main(["diff", old, new, "--out", str(tmp_path / name)]) == 1
        said = capsys.readouterr().out
        assert said.startswith("Something broke") and name in said
        assert (tmp_path / name).read_text().startswith(start)
    assert main(["diff", old, new, "--format", "html", "--out", str(tmp_path / "d.page")]) == 1
    assert (tmp_path / "d.page").read_text().startswith("<!doctype html>")
    assert command.FACTOR == FACTOR


def test_json_is_the_difference_and_nothing_else(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = map(str, files)
    assert main(["diff", old, new, "--json"]) == 1
    said = capsys.readouterr().out
    found = json.loads(said)
    published = (
        resources.files("trebucheck.comparisons").joinpath("schemas/diff.schema.json").read_text()
    )
    assert published == schema_text(DifferenceData), "`make generated` writes the schemas anew"
    jsonschema.validate(found, json.loads(published))
    known = diff(old, new)
    assert found["summary"] == known.summary and not found["passed"]
    (broken,) = (each for each in found["quantities"] if each["broke"])
    (change,) = known.broken
    assert (broken["run"], broken["quantity"], broken["factor"]) == (
        change.run,
        change.either.label,
        change.factor,
    )
    assert broken["old"]["holds"] and broken["new"] == {
        **broken["old"],
        "value": 1e3,
        "holds": False,
    }
    assert [each["fate"] for each in found["runs"]] == [each.fate.value for each in known.runs]
    assert main(["diff", old, new, "--out", str(tmp_path / "d.json")]) == 1
    assert (tmp_path / "d.json").read_text() == said
    capsys.readouterr()
    assert main(["diff", old, new, "--json", "--out", str(tmp_path / "d2.md")]) == 1
    assert capsys.readouterr().out == said
    assert (tmp_path / "d2.md").read_text().startswith("# ")


def test_an_error_from_nothing_has_no_factor_in_json(results: Results) -> None:
    none = _changed(results, _with("position_max", value=0.0, sampling_error=None))
    for pair in ((none, results), (results, none)):
        found = json.loads(data(diff(*pair)).to_json(), parse_constant=pytest.fail)
        assert found["format"] == "trebucheck-diff-1"


def _other_format(data: dict[str, Any]) -> Any:
    return {**data, "format": "trebucheck-results-1"}


def _twice(data: dict[str, Any]) -> Any:
    return {**data, "runs": [*data["runs"], data["runs"][0]]}


def _no_outcome(data: dict[str, Any]) -> Any:
    return {**data, "runs": [{**data["runs"][0], "outcome": "splendid"}]}


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (_other_format, "format 'trebucheck-results-1'"),
        (lambda _: {"format": "trebucheck-converge-1"}, "format 'trebucheck-converge-1'"),
        (lambda _: [1, 2], "no format"),
        (lambda _: {"a": 1}, "no format"),
        (
            _twice,
            "pendulum, pymunk, default is there twice",
        ),
        (lambda data: {**data, "machines": []}, "'pendulum', which is not among the machines"),
        (_no_outcome, r"runs.0.outcome = 'splendid'"),
        (lambda data: {k: v for k, v in data.items() if k != "runs"}, "runs is missing"),
        (None, "is not JSON"),
    ],
)
def test_wrong_files_are_refused_in_one_sentence(
    broken: Callable[[dict[str, Any]], Any] | None,
    said: str,
    files: tuple[Path, Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = files[1] / "results.json"
    path.write_text("{" if broken is None else json.dumps(broken(json.loads(path.read_text()))))
    for order in ([str(files[0]), str(path)], [str(path), str(files[0])]):
        assert main(["diff", *order, "--out", str(files[0] / "nothing.md")]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ") and error.count("\n") == 1 and "results.json" in error
        assert any(part in error for part in said.split("|"))
    assert not (files[0] / "nothing.md").exists()


def test_files_that_are_not_there_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", str(tmp_path), str(tmp_path)]) == 2
    assert "results.json cannot be read" in capsys.readouterr().err
    assert main(["diff", "a.json", "b.json", "--factor", "fast"]) == 2
    assert main(["diff", "a.json"]) == 2
