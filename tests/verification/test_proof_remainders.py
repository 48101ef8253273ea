"""Remainders over a step, against the same functions of the polynomial motion at its times."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.reference.proof import gradients, remainders, tape
from trebucheck.reference.proof.balls import arb, exact, precision
from trebucheck.reference.proof.steps import TaylorModel
from trebucheck.reference.proof.tape import Algebra, Tape

_ORDER = 5
_LENGTH = Fraction(1, 8)
_PARTS = 5  # times of a step at which functions are held against each other


def _tape() -> Tape:
    """A motion q'' = -q u, and functions in which every kind of operation is."""
    algebra = Algebra({})
    q, u, _ = algebra.make_vars("q", "u", "_")
    angle = q * u + q
    matrix = {(0, 0): 3.0 + q, (0, 1): u, (1, 0): u, (1, 1): algebra.cos(q) + 2.0}
    x, y = algebra.solve(matrix, [u - q, q * q])
    functions = [
        q - u,
        algebra.product(algebra.expression(0.75), u * u),
        q / (2.0 + u * q),
        algebra.sqrt(4.0 + q + u),
        algebra.sin(angle),
        algebra.cos(angle) * u,
        x,
        y,
    ]
    return Tape(algebra, ["q", "u"], [-(q * u), *functions])


def _outside(q: float, u: float) -> list[str]:
    """Functions whose values at a time of the step are outside what is said of them."""
    tape, wrong = _tape(), list[str]()
    with precision(160):
        expansion = tape.expand([], [arb(q)], [arb(u)], _ORDER)
        known = remainders.remainders(expansion, exact(_LENGTH))
        motion = [TaylorModel(series, arb(0)) for series in expansion.state]
        models: list[Any] = []
        for i, r in enumerate(known.outputs):
            assert r.is_finite()
            models.append(TaylorModel(expansion.output(i), r))
        for part in range(_PARTS + 1):
            t = exact(_LENGTH) * part / _PARTS
            at = [model.at(t) for model in motion]
            for x, whole in zip(at, known.state, strict=True):
                if not whole.contains(x):
                    wrong.append("the state")
            for i, value in enumerate(tape.values([], at[:1], at[1:])):
                if not models[i].at(t).overlaps(value):
                    wrong.append(f"function {i}")
    return wrong


numbers = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))


@given(numbers, numbers)
def test_functions_are_within_their_remainders(q: float, u: float) -> None:
    assert not _outside(q, u)


def test_remainders_are_not_much_larger_than_the_next_coefficient() -> None:
    tape = _tape()
    with precision(160):
        expansion = tape.expand([], [arb(0.5)], [arb(-0.25)], _ORDER)
        longer = tape.expand([], [arb(0.5)], [arb(-0.25)], _ORDER + 1)
        known = remainders.remainders(expansion, exact(Fraction(1, 1024)))
        for i, r in enumerate(known.outputs):
            # The next coefficient with the polynomial's own next coefficients left out.
            size = 1 + sum(abs(float(c)) for c in longer.output(i))
            assert float(r.abs_upper()) < 20 * size


@pytest.mark.parametrize("kind", ["product", "quotient", "root", "wave", "system"])
def test_a_remainder_that_is_left_out_is_found(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one kind of operation what is beyond the polynomial is dropped."""
    right = remainders._MODELS[kind]

    def without(step: Any, of: Any, result: Any, models: Any) -> Any:
        found = right(step, of, result, models)
        if kind == "wave":
            return remainders._Wave(
                *(step.model(x.series, arb(0)) for x in (found.sine, found.cosine))
            )
        if kind == "system":
            return remainders._Solved([step.model(x.series, arb(0)) for x in found.unknowns])
        return step.model(found.series, arb(0))

    monkeypatch.setitem(remainders._MODELS, kind, without)
    assert _outside(0.5, -0.25)


def test_what_may_not_exist_is_not_finite() -> None:
    """A divisor, a radicand or a determinant that may be zero within the step."""
    algebra = Algebra({})
    q, u, _ = algebra.make_vars("q", "u", "_")
    singular = algebra.solve({(0, 0): q, (0, 1): u, (1, 0): u, (1, 1): q}, [u, q])
    tape = Tape(algebra, ["q", "u"], [-q, u / q, algebra.sqrt(q), *singular])
    with precision(80):
        expansion = tape.expand([], [arb(1) / 16], [arb(-1)], _ORDER)
        known = remainders.remainders(expansion, arb(2))
        assert not any(r.is_finite() for r in known.outputs[1:])
        assert known.outputs[0].is_finite()


def test_every_operation_has_its_derivatives_and_its_remainder() -> None:
    assert gradients._ROWS.keys() == remainders._MODELS.keys() == tape._EXTEND.keys()
