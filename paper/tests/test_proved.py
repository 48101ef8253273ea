"""What is proved of the paper's claims: enclosures against the reference, and wrong prints."""

from __future__ import annotations

import math
from decimal import Decimal
from functools import cache

import pytest
import trebucheck as tb
from trebucheck.api.mechanics import ClosedInterval, Enclosure
from trebucheck_paper.evidence import quantities as of
from trebucheck_paper.evidence.claims import Quantity
from trebucheck_paper.evidence.proved import Enclosures, proved
from trebucheck_paper.evidence.verdicts import (
    Verdict,
    as_printed,
    at_least,
    at_most,
    coincides,
    negative,
    positive,
    vanishes,
)


@cache
def enclosures() -> Enclosures:
    """Enclosures of the fixed machine, to its arm's blow."""
    launch = tb.prove("fixed", digits=5).launch_time
    assert launch is not None
    return Enclosures({"fixed": tb.fixed()}, {"fixed": float(launch.value)}, {"fixed": 2.97})


@pytest.mark.parametrize(
    ("printed", "holds"), [("99.4 m/s", True), ("99.5 m/s", False), ("99.40 m/s", True)]
)
def test_a_launch_speed_is_proved_or_refuted_to_its_last_digit(printed: str, holds: bool) -> None:
    interval = ClosedInterval.rounding_to(printed.split(maxsplit=1)[0])
    known = enclosures().proof_of(of.LAUNCH_SPEED.of("fixed"), interval)
    assert known.holds is holds
    assert (known.off is None) is holds
    assert "proved" in known.sentence("m/s")


def test_enclosures_are_of_what_the_certificate_holds() -> None:
    """Its figures were computed in doubles by ways that share nothing with the proof."""
    from trebucheck.api.mechanics import Key, load_certificate

    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    held = 0
    for figure in certificate.figures:
        quantity = of.certified(Key(figure.name, figure.subject, figure.at, figure.unit))
        ball = enclosures().balls.get(("fixed", quantity))
        if ball is not None:
            off = abs(float(ball.mid()) - figure.value)
            assert off <= figure.uncertainty + float(ball.rad()), quantity
            held += 1
    assert held >= 15


def test_a_quantity_without_an_enclosure_says_so() -> None:
    known = enclosures().proof_of(of.ENERGY_DRIFT.of("fixed"), ClosedInterval.around(0.0, 1.0))
    assert known.holds is None
    assert "energy drift" in known.why
    other = enclosures().proof_of(of.LAUNCH_TIME.of("rolling"), None)
    assert other.holds is None
    assert other.value is None


@pytest.mark.parametrize("value", [-0.3, 0.0, 0.04, 0.06, 0.3])
def test_intervals_say_what_the_rules_say(value: float) -> None:
    """A number without uncertainty: the rule's verdict is where its interval has the number."""
    ours = Quantity(value=value, uncertainty=0.0, unit="m")
    known = Enclosure(Decimal(value), Decimal(0))
    for judged in (
        as_printed(ours, "0.1"),
        positive(ours, "it"),
        negative(ours, "it"),
        vanishes(ours, 0.05, "a reason"),
        coincides(ours, 0.0, "a reason"),
        at_least(ours, 0.05, "a reason"),
        at_most(ours, 0.05, "a reason"),
    ):
        assert judged.interval is not None
        assert proved(known, judged.interval).holds is (judged.verdict is Verdict.HOLDS)


def test_an_enclosure_across_an_end_proves_nothing() -> None:
    known = Enclosure(Decimal("0.05"), Decimal("1e-6"))
    assert proved(known, ClosedInterval.rounding_to("0.0")).holds is None
    assert proved(known, None, "no interval").why == "no interval"
    assert math.isclose(
        proved(known, ClosedInterval.rounding_to("0.2")).off or 0.0, 0.15, rel_tol=1e-4
    )
