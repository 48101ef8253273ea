"""A verdict on one quantity, from its metrics alone."""

from __future__ import annotations

from typing import Any, cast

import pytest
from trebucheck.comparisons.runs.results import Metric, Run
from trebucheck.conformance.certificate import _check_row, _problem_rows
from trebucheck.conformance.suite import Target, judgement
from trebucheck.conformance.verdicts import CheckState, CheckVerdict
from trebucheck.engines.registry import engine_class
from trebucheck.models.errors import InputError

NO_RUN = cast(Run, None)  # only a broken check asks it for a cause


def _metric(**changes: Any) -> Metric:
    return Metric(
        **({"name": "position_max", "subject": "tip", "value": 1e-3, "unit": "m"} | changes)
    )


@pytest.mark.parametrize(
    ("metrics", "state"),
    [
        ([_metric()], CheckState.NOT_JUDGED),
        ([_metric(note="its error grows beyond all measure")], CheckState.NOT_JUDGED),
        ([_metric(), _metric(subject="end", value=None, observed=False)], CheckState.NOT_JUDGED),
        ([_metric(value=None, observed=False)], CheckState.SKIPPED),
        ([_metric(follows="release_time")], CheckState.SKIPPED),
        ([], CheckState.SKIPPED),
    ],
)
def test_a_quantity_without_tolerance_is_not_judged_and_only_an_absent_one_is_skipped(
    metrics: list[Metric], state: CheckState
) -> None:
    verdict = judgement(metrics, NO_RUN)
    assert verdict.state is state and verdict.text
    assert verdict.failed is (state is CheckState.NOT_JUDGED)


def test_one_metric_without_tolerance_among_others_that_hold_is_no_success() -> None:
    claim = {"tolerance": 1e-2, "source": "claim", "reason": "its order"}
    held, bare = _metric(**claim), _metric(subject="end")
    assert judgement([held], NO_RUN).state is CheckState.KEPT
    verdict = judgement([held, bare], NO_RUN)
    assert verdict.state is CheckState.NOT_JUDGED and "end" in verdict.text


# rows of the certificate


def _verdict(check: str, state: CheckState, **more: Any) -> CheckVerdict:
    return CheckVerdict(id=f"own/assisted/fixed/{check}", state=state, **more)


POSITION = {"error": 2e-4, "tolerance": 5e-4, "unit": "m", "source": "default: of 3 m"}


def test_a_row_shows_error_and_tolerance_where_there_are_any_and_why() -> None:
    def cells(check: str, state: CheckState, **more: Any) -> list[str]:
        row = _check_row(_verdict(check, state, **more))
        return [cell.text for cell in row.cells]

    found = cells("position", CheckState.KEPT, **POSITION)
    assert found[:2] == ["own/assisted/fixed/position", "kept"]
    assert [float(text) for text in found[2:4]] == [2e-4, 5e-4]
    assert found[4:] == ["m", "default: of 3 m"]
    assert cells("runs", CheckState.BROKEN, text="it fails") == [
        "own/assisted/fixed/runs", "broken", "", "", "", "it fails",
    ]  # fmt: skip


def test_a_row_of_a_problem_counts_what_was_judged_and_shows_the_worst() -> None:
    verdicts = (
        _verdict("runs", CheckState.KEPT, wall_time=1.5),
        _verdict("position", CheckState.KEPT, **POSITION),
        _verdict("velocity", CheckState.BROKEN, **POSITION | {"error": 1e-3}),
        _verdict("energy", CheckState.SKIPPED, text="no such event"),
    )
    (row,) = _problem_rows(verdicts)
    found = [cell.text for cell in row.cells]
    assert found == ["own/assisted", "fixed", "2/3", "velocity", "2", "1.50", "broken"]
    (row,) = _problem_rows(verdicts[3:])
    found = [cell.text for cell in row.cells]
    assert found == ["own/assisted", "fixed", "", "", "", "", "skipped: no such event"]


# the preset that is judged


@pytest.mark.parametrize(
    ("presets", "chosen"),
    [
        (("default", "assisted"), "assisted"),
        (("assisted", "default"), "assisted"),
        (("fast", "slow"), "slow"),
    ],
)
def test_the_assisted_preset_is_judged_or_the_last_one(
    presets: tuple[str, ...], chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = engine_class("reference")
    monkeypatch.setattr(engine, "presets", classmethod(lambda _: dict.fromkeys(presets)))
    assert Target.of("reference") == Target("reference", chosen)
    assert [Target.of(f"reference/{name}").preset for name in presets] == list(presets)
    with pytest.raises(InputError):
        Target.of("reference/another")
