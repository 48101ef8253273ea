"""Figures of sources beside proofs: intervals of printed numbers, and published verdicts."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import pytest
import trebucheck as tb
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.comparisons.problems import check
from trebucheck.comparisons.published import PublishedFigures, published_figures
from trebucheck.models.library.benchmark import swing_period
from trebucheck.models.library.registry import benchmark, benchmarks
from trebucheck.reference.proof.balls import precision
from trebucheck.reference.proof.passages import passages
from trebucheck.reference.proof.printed import ClosedInterval, Standing
from trebucheck.reference.proof.proof import Enclosure

PUBLISHED = Path(__file__).parents[2] / "docs" / "published.json"


@given(st.integers(-(10**9), 10**9), st.integers(0, 8), st.fractions(-3, 3))
def test_a_printed_number_stands_for_what_rounds_to_it(
    mantissa: int, places: int, units: Fraction
) -> None:
    printed = Decimal(mantissa).scaleb(-places)
    interval = ClosedInterval.rounding_to(f"{printed:f}")
    value = Decimal(units.numerator) / Decimal(units.denominator)
    moved = Enclosure(printed + value.scaleb(-places), Decimal(0))
    if abs(abs(units) - Fraction(1, 2)) > Fraction(1, 10**6):  # a decimal may round the fraction
        expected = Standing.INSIDE if abs(units) < Fraction(1, 2) else Standing.OUTSIDE
        assert interval.standing(moved) is expected


def test_an_enclosure_across_an_end_decides_nothing() -> None:
    interval = ClosedInterval.rounding_to("99.4")
    assert interval == (Fraction("99.35"), Fraction("99.45"))
    across = Enclosure(Decimal("99.45"), Decimal("1e-9"))
    assert interval.standing(across) is Standing.OPEN
    assert interval.standing(Enclosure(Decimal("99.4"), Decimal("0.2"))) is Standing.OPEN
    outside = Enclosure(Decimal("99.6"), Decimal("0.1"))
    assert interval.standing(outside) is Standing.OUTSIDE
    assert interval.distance(outside) == Fraction("0.1")
    positive = ClosedInterval(Fraction(0), None)
    assert positive.standing(outside) is Standing.INSIDE
    assert positive.distance(Enclosure(Decimal(-2), Decimal(1))) == 1
    for text in ("x", "nan", ""):
        with pytest.raises(tb.InputError, match="printed"):
            ClosedInterval.rounding_to(text)


def test_passages_of_a_pendulum_are_those_of_its_closed_form() -> None:
    entry = benchmark("pendulum")
    parameters = entry.parameters()
    proof = tb.prove(entry.problem(), digits=20, until=3.0)
    swing = parameters.swing  # pyright: ignore[reportAttributeAccessIssue]
    with precision(proof.bits):
        found = passages(proof.motion, [1.0], swing.lowest, 2)
        times = [Enclosure.of(t) for t in found]
        with pytest.raises(IndexError):
            passages(proof.motion, [1.0], swing.lowest, 4)
    period = swing_period(swing.omega, swing.amplitude)
    # The level is the double next to pi/2, and the closed form is computed in doubles.
    assert [float(t.value) for t in times] == pytest.approx([period / 4, 3 * period / 4], rel=1e-14)
    assert all(t.radius < Decimal("1e-19") for t in times)


def _wrong(digits: str) -> Iterator[Standing | None]:
    entry = benchmark("incline")
    for figure in published_figures([entry], digits=12):
        interval = ClosedInterval.rounding_to(digits)
        yield interval.standing(Enclosure(Decimal(figure.value or "nan"), Decimal(0)))


def test_a_wrong_digit_is_outside() -> None:
    (right,) = _wrong("7.04573952306")
    (wrong,) = _wrong("7.04573952307")
    assert (right, wrong) == (Standing.INSIDE, Standing.OUTSIDE)


def test_what_the_library_publishes_is_of_its_figures() -> None:
    """Every figure is there with its expected value; outside are the squeezer's alone."""
    published = PublishedFigures.from_json(PUBLISHED.read_text())
    listed = {(each.problem, each.figure): each for each in published.figures}
    for entry in benchmarks():
        for figure in entry.parameters().figures():
            if figure.value:
                listed_one = listed.pop((entry.name, figure.name))
                if figure.printed:
                    assert listed_one.expected == figure.printed
                # Closed forms are computed by the machine's own elementary functions.
                assert float(listed_one.expected) == pytest.approx(figure.value, rel=1e-15)
                assert bool(figure.printed) == (figure.basis == "published")
    assert not listed
    for each in published.figures:
        assert (each.value is None) == bool(each.why)
        if each.standing is not None:
            assert (each.standing is Standing.OUTSIDE) == (each.problem == "squeezer")
            assert (each.off is not None) == (each.standing is Standing.OUTSIDE)


@pytest.mark.parametrize("name", ["squeezer", "bead", "quick-return"])
def test_the_reference_has_the_proved_figures(name: str) -> None:
    published = PublishedFigures.from_json(PUBLISHED.read_text())
    proved = {each.figure: each.value for each in published.figures if each.problem == name}
    for measured in check(benchmark(name)).figures:
        value = proved.get(measured.figure.name)
        if value is not None:
            # What the tests of the problems hold the reference to, but against a truth.
            assert abs(measured.measured - float(value)) <= measured.figure.tolerance
