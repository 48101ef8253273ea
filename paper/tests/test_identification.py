"""The identification against machines whose start angles are known, and against derivatives found
in another way.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from trebucheck.models.errors import InputError
from trebucheck.models.library.trebuchet import TrebuchetParameters, fixed
from trebucheck.reference.sensitivity.release import whipper_sensitivities
from trebucheck_paper.identification.fit import fit
from trebucheck_paper.identification.quantities import (
    ANGLES,
    PRINTED,
    R_ROLLING,
    SPEED,
    Headlines,
    Identification,
    PrintedQuantity,
    computed,
)
from trebucheck_paper.identification.study import identify

TABLE = TrebuchetParameters()
PAPER = (0.0, math.pi, -math.pi / 4)


def _printed_of(
    parameters: TrebuchetParameters, angles: tuple[float, float, float]
) -> tuple[PrintedQuantity, ...]:
    """What the paper would have printed of another machine, with as many digits."""
    release = computed(parameters, angles, PRINTED[0].value)[PRINTED[0].name]
    step = 2 * PRINTED[0].half
    on_grid = round(release / step) * step
    values = computed(parameters, angles, on_grid) | {PRINTED[0].name: release}
    rounded = {f.name: round(values[f.name] / (2 * f.half)) * 2 * f.half for f in PRINTED}
    return tuple(
        quantity.model_copy(update={"value": rounded[quantity.name]}) for quantity in PRINTED
    )


def test_slopes_are_the_exact_derivatives() -> None:
    exact = whipper_sensitivities(fixed, TABLE)
    expected = [exact.d_launch_speed[exact.names.index(angle)] for angle in ANGLES]
    headlines = Headlines(TABLE)
    row = [quantity.name for quantity in PRINTED].index(SPEED)
    # Central differences over 1e-5 rad of speeds good to 1e-11: 1e-6 m/s per rad, of some ten.
    assert headlines.jacobian(PAPER)[row] * PRINTED[row].half == pytest.approx(
        expected, rel=1e-6, abs=2e-6
    )


@pytest.mark.slow
def test_a_known_start_is_found_from_its_rounded_figures() -> None:
    truth = (0.03, math.pi + 0.02, -0.75)
    there = TABLE.model_copy(update={"r": 6.2, "m_cw": 3200.0})
    guess = (truth[0] + 0.004, truth[1] - 0.004, truth[2] + 0.004)
    found = fit(Headlines(there, _printed_of(there, truth)), guess, name="all")
    assert found.compatible
    for value, extent in zip(truth, found.extents, strict=True):
        assert extent.low <= value <= extent.high
    # No figure of the truth is off by more than its half width, sqrt(3) standard deviations.
    error = np.array(found.angles) - truth
    distance = error @ np.linalg.inv(np.array(found.covariance)) @ error
    assert distance <= 3 * sum(quantity.fitted for quantity in PRINTED)


@pytest.mark.slow
def test_ends_of_the_compatible_set_are_where_a_figure_leaves_its_digits() -> None:
    headlines = Headlines(TABLE)
    found = fit(headlines, PAPER, ("alpha0",), name="alpha0 alone")

    def beyond(alpha: float) -> float:
        return float(np.abs(headlines.misses((PAPER[0], PAPER[1], alpha))).max()) - 1.0

    inside = found.angles[2]
    (extent,) = found.extents
    # The set's ends are settled to 1e-9 rad.
    assert extent.low == pytest.approx(brentq(beyond, inside - 0.01, inside, xtol=1e-12), abs=2e-9)
    assert extent.high == pytest.approx(brentq(beyond, inside, inside + 0.01, xtol=1e-12), abs=2e-9)


@pytest.mark.slow
def test_figures_that_contradict_each_other_leave_nothing() -> None:
    printed = tuple(
        quantity.model_copy(update={"value": 1.93}) if quantity.name == R_ROLLING else quantity
        for quantity in PRINTED
    )
    found = identify(TABLE, printed, globally=False)
    assert not found.fit.compatible
    assert found.fit.least_worst > 1
    assert not found.fit.extents
    assert not found.nested
    assert found.singled_out is None
    assert found.search is None
    assert Identification.from_json(found.to_json()) == found
    assert "no start angles give every printed figure" in found.findings[0]


def test_a_figure_that_is_needed_must_be_there() -> None:
    with pytest.raises(InputError, match=r"printed holds .* must be there"):
        identify(TABLE, PRINTED[1:])


def test_a_start_that_does_not_launch_is_refused() -> None:
    with pytest.raises(InputError, match="does not launch"):
        Headlines(TABLE).misses((1.5, math.pi + 1.5, math.pi / 2))
