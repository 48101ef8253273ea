"""A verdict on one quantity, from its metrics alone."""

from __future__ import annotations

from typing import Any, cast

import pytest
from trebucheck.comparisons.runs.results import Metric, Run
from trebucheck.conformance.suite import judgement
from trebucheck.conformance.verdicts import CheckState

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
