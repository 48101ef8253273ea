"""The model check finds a stop on the wrong side by either sign, and small scales stay relative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import four_bar
from trebucheck.comparisons.diagnosis.equivalence import _by_name, check_model
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.mechanism import Mechanism

OFF = 0.01  # [rad]


@dataclass(frozen=True)
class Shifted(ReferenceEngine):
    """The reference, with one stop's limit elsewhere."""

    by: float = 0.0
    """[rad] Of the gap of the sling's rest."""

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        right = super().inspect(mechanism, states)
        wrong = tuple(
            replace(
                each,
                stop_gaps={
                    name: gap + self.by * (name == "sling rest")
                    for name, gap in each.stop_gaps.items()
                },
            )
            for each in right.dynamics
        )
        return replace(right, dynamics=wrong)


@pytest.mark.parametrize("by", [OFF, -OFF])
def test_a_stop_that_is_off_to_either_side_is_another_machine(by: float) -> None:
    equality = check_model(Shifted(by=by), tb.fixed())
    assert not equality.holds
    (check,) = equality.broken
    assert (check.name, check.subject, check.unit) == ("stop position", "sling rest", "rad")
    assert check.value == pytest.approx(OFF, abs=1e-12)


def test_a_stop_at_its_place_is_not_flagged() -> None:
    equality = check_model(Shifted(by=0.0), tb.fixed())
    assert equality.holds
    assert any(check.name == "stop position" for check in equality.checks)


@dataclass(frozen=True)
class Apart(ReferenceEngine):
    """The reference, with the joint that closes a loop apart."""

    by: float = 0.0
    """[m]"""
    shown: int = 24
    """States in which it is told."""

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        right = super().inspect(mechanism, states)
        gaps = {joint.name: self.by for joint in mechanism.loop_joints}
        wrong = tuple(
            replace(each, joint_gaps=gaps if k < self.shown else {})
            for k, each in enumerate(right.dynamics)
        )
        return replace(right, dynamics=wrong)


def test_a_loop_that_is_apart_is_another_mechanism() -> None:
    """A pin of the ground that is elsewhere changes no acceleration."""
    mechanism = four_bar()
    assert check_model(Apart(by=0.0, shown=24), mechanism).holds
    (check,) = check_model(Apart(by=1e-3, shown=24), mechanism).broken
    (closing,) = mechanism.loop_joints
    assert (check.name, check.subject) == ("joint position", closing.name)


def test_a_gap_that_is_told_in_some_states_alone_is_missing_in_the_others() -> None:
    (check,) = check_model(Apart(by=0.0, shown=3), four_bar()).broken
    assert (check.name, check.value) == ("joint position", None)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_differences_are_parts_of_their_scale_however_small_it_is(scale: float) -> None:
    """The second of two coordinates is off by a thousandth of its size in one of three states."""
    difference = np.zeros((3, 2))
    difference[1] = 1e-5 * scale, 1e-3 * scale
    check = _by_name("force", ("a", "b"), difference, np.array([scale, scale]))
    assert check.subject == "b" and check.value == pytest.approx(1e-3, rel=1e-12)
    assert not check.holds


def test_a_difference_that_is_no_number_is_a_missing_value() -> None:
    check = _by_name("force", ("a", "b"), np.array([[0.0, np.nan]]), np.ones(2))
    assert check.subject == "b" and check.value is None and not check.holds
