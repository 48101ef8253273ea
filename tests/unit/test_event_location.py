"""Where in a step a stop is met: gaps that are parabolas in time, whose zeros are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from trebucheck.engines.events import may_be_met, onto_zero_gap, root_in

CASES = [
    # gap, speed and acceleration at the start of a step of 1 s; least closing speed; when it is met
    ((1.0, -2.0, 0.0), 0.0, 0.5),
    ((0.1, 1.0, -4.0), 0.0, (1 + math.sqrt(1.8)) / 4),  # up, then down
    ((0.1, -1.0, 4.0), 0.0, (1 - math.sqrt(0.2)) / 4),  # down, and up again within the step
    ((0.2, -1.0, 4.0), 0.0, None),  # comes near only
    ((1.5, -1.0, 0.0), 0.0, None),  # has not come yet
    ((-1e-3, -1.0, 0.0), 0.0, 0.0),
    ((0.0, -1.0, 0.0), 0.0, 0.0),
    ((0.5, -1.0, 0.0), 2.0, None),  # too slowly
    ((0.01, -0.1, -1.0), 0.5, 0.4),  # from where it is fast enough, behind the zero
    ((-0.01, 0.1, -1.0), 0.0, 0.1),  # out of a penetration that never ends, back from its top
]


@pytest.mark.parametrize(("parabola", "least", "met"), CASES)
def test_a_stop_is_met_where_its_gap_falls_through_zero(
    parabola: tuple[float, float, float], least: float, met: float | None
) -> None:
    gap, speed, acceleration = parabola

    def motion(t: float) -> tuple[float, float]:
        return gap + speed * t + acceleration * t * t / 2, speed + acceleration * t

    found = onto_zero_gap(motion, gap, (speed, motion(1.0)[1]), 1.0, least)
    if met is None:
        assert found is None
    else:
        assert found == pytest.approx(met, abs=1e-9)
    ends = [np.array(values) for values in zip(motion(0.0), motion(1.0), strict=True)]
    assert bool(may_be_met(*ends, least, 1.0)[0]) == (met is not None)


def test_a_zero_that_rounding_hides_is_at_the_end_with_the_smaller_value() -> None:
    assert root_in(lambda t: t + 0.1, 0.0, 1.0) == 0.0
    assert root_in(lambda t: t - 1.1, 0.0, 1.0) == 1.0
    assert root_in(lambda t: t - 0.25, 0.0, 1.0) == pytest.approx(0.25, abs=1e-12)
