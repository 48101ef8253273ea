"""The model check leaves out states in which an engine's solver finds no accelerations, but for the
start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model, random_states
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Mechanism

PENDULUM = tb.model("double-pendulum")
STATES = random_states(PENDULUM)


class GivesUp(ReferenceEngine):
    """The reference, whose solver gives up in some of the states."""

    fails_in: tuple[int, ...] = (0,)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        if any(np.array_equal(state.q, STATES[k].q) for state in states for k in self.fails_in):
            raise SimulationError("the solver gave up.")
        return super().inspect(mechanism, states)


def test_a_state_that_no_motion_need_meet_is_left_out_and_said() -> None:
    equality = check_model(GivesUp(fails_in=(3,)), PENDULUM)
    assert equality.holds
    assert equality.states == len(STATES) - 1
    assert equality.note is not None
    assert "23 of 24 states" in equality.note


@pytest.mark.parametrize("fails_in", [(0,), tuple(range(1, 20))])
def test_without_the_start_or_most_states_there_is_no_check(fails_in: tuple[int, ...]) -> None:
    with pytest.raises(SimulationError, match="gave up"):
        check_model(GivesUp(fails_in=fails_in), PENDULUM)
