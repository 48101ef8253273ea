"""A row of the file of deviations: about a check that fails, or broken, or not to be told."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from trebucheck.conformance.verdicts import CheckState, CheckVerdict, Deviation

IDS = ("mujoco/assisted/fixed/angle", "mujoco/assisted/fixed/position")


def _row(id: str, states: Sequence[CheckState], labels: Sequence[str]) -> CheckState:
    verdicts = [CheckVerdict(id=i, state=s, text="") for i, s in zip(IDS, states, strict=False)]
    row = Deviation(id=id, reason="known", owner="me")
    return row.row_verdict(IDS, verdicts, labels).state


@pytest.mark.parametrize(
    ("id", "states", "labels", "expected"),
    [
        (IDS[0], [CheckState.DEVIATES], ["mujoco/assisted"], CheckState.KEPT),
        ("mujoco/*/angle", [CheckState.DEVIATES], ["mujoco/assisted"], CheckState.KEPT),
        ("*/fixed/*", [CheckState.KEPT, CheckState.DEVIATES], ["mujoco/assisted"], CheckState.KEPT),
        (IDS[0], [CheckState.KEPT], ["mujoco/assisted"], CheckState.BROKEN),
        (IDS[1], [CheckState.DEVIATES], ["mujoco/assisted"], CheckState.SKIPPED),
        (IDS[0] + "s", [CheckState.DEVIATES], ["mujoco/assisted"], CheckState.BROKEN),
        ("pymunk/assisted/fixed/angle", [CheckState.KEPT], ["mujoco/assisted"], CheckState.SKIPPED),
    ],
)
def test_the_state_of_a_row(
    id: str, states: Sequence[CheckState], labels: Sequence[str], expected: CheckState
) -> None:
    assert _row(id, states, labels) is expected
