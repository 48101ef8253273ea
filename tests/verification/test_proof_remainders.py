"""Remainders and derivatives over a step, against functions and motions at its times."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.reference.proof import flow, gradients, remainders, tape
from trebucheck.reference.proof.balls import Ball, arb, arb_mat, exact, precision
from trebucheck.reference.proof.sets import StateSet
from trebucheck.reference.proof.steps import StepMaker, TaylorModel
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


def _wrong_slopes(q: float, u: float) -> list[str]:
    """Functions whose derivatives at a time of the step are outside what is said of them."""
    tape, wrong = _tape(), list[str]()
    with precision(160):
        expansion = tape.expand([], [arb(q)], [arb(u)], _ORDER)
        made = remainders.models(expansion, exact(_LENGTH), [arb(0)] * 2)
        slopes = [part.tolist() for part in gradients.slope_models(tape, made)]
        motion = [TaylorModel(series, arb(0)) for series in expansion.state]
        for part in range(_PARTS + 1):
            t = exact(_LENGTH) * part / _PARTS
            at = [model.at(t) for model in motion]
            known = gradients.gradients(tape, [], at[:1], at[1:])
            for i, (rows, values) in enumerate(zip(slopes, known, strict=True)):
                for (*series, rest), value in zip(rows, values, strict=True):
                    if not TaylorModel(series, rest).at(t).overlaps(value):
                        wrong.append(f"function {i}")
    return wrong


def _moved(tape: Tape, start: list[Ball], length: Fraction) -> list[Ball]:
    """A state after a time."""
    maker, states, begin = StepMaker(tape, [], 24, 100.0), StateSet.of(start), Fraction(0)
    while begin < length:
        step = maker.step(begin, states, length - begin)
        states, begin = step.reached(), step.end
    return states.box()


def _wrong_flow(q: float, u: float, order: int) -> list[str]:
    """Parts of the state by which two motions differ otherwise than the derivative says."""
    tape, wrong = _tape(), list[str]()
    wide = arb(0, 2.0**-10)
    with precision(160):
        states = StateSet.of([arb(q) + wide, arb(u) + wide])
        step = StepMaker(tape, [], 24, 100.0).step(Fraction(0), states, _LENGTH)
        apart = [2 * wide.rad(), -2 * wide.rad()]
        ends: list[list[Ball]] = []
        for sign in (1, -1):
            start = [x + sign * off / 2 for x, off in zip(states.centre, apart, strict=True)]
            ends.append(_moved(tape, start, step.length))
        derivative = step.flow_derivative(order).at(exact(step.length))
        by_derivative = (derivative * arb_mat([[x] for x in apart])).entries()
        for i, (one, other, off) in enumerate(zip(*ends, by_derivative, strict=True)):
            if not off.overlaps(one - other):
                wrong.append(f"state {i}")
    return wrong


numbers = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))


@given(numbers, numbers)
def test_functions_are_within_their_remainders(q: float, u: float) -> None:
    assert not _outside(q, u)


@given(numbers, numbers)
def test_derivatives_of_functions_are_within_their_remainders(q: float, u: float) -> None:
    assert not _wrong_slopes(q, u)


def test_derivatives_are_not_much_wider_than_the_state() -> None:
    """A box of states of 1e-9 gives derivatives of about as much, quotients and roots, too."""
    tape = _tape()
    with precision(160):
        box = [arb(0.5, 1e-9)], [arb(-0.25, 1e-9)]
        expansion = tape.expand([], *box, _ORDER)
        length = exact(Fraction(1, 2**14))
        made = remainders.models(expansion, length, [arb(0)] * 2)
        for part in gradients.slope_models(tape, made):
            for *series, rest in part.tolist():
                assert float(TaylorModel(series, rest).at(length).rad()) < 1e-7


@given(numbers, numbers, st.integers(0, 6))
def test_motions_part_as_the_derivative_of_the_flow_says(q: float, u: float, order: int) -> None:
    """By the mean value theorem, for any two states of the set."""
    assert not _wrong_flow(q, u, order)


def test_the_derivative_of_the_flow_is_as_narrow_as_its_order_promises() -> None:
    r"""Of q'' = -4 q over h: its columns are cos(2 h), ..., and what is left is of h^(p + 2)."""
    algebra = Algebra({})
    q, _ = algebra.make_vars("q", "u")
    tape = Tape(algebra, ["q", "u"], [-(4.0 * q)])
    with precision(160):
        states = StateSet.of([arb(1), arb(0)])
        step = StepMaker(tape, [], 20, 100.0).step(Fraction(0), states, Fraction(1, 128))
        h, radii = exact(step.length), list[float]()
        cosine, sine = (2 * h).cos(), (2 * h).sin()
        for order in range(7):
            known = step.flow_derivative(order).at(h)
            exactly = arb_mat([[cosine, sine / 2], [-2 * sine, cosine]])
            for value, enclosed in zip(exactly.entries(), known.entries(), strict=True):
                assert enclosed.contains(value)
            radii.append(max(float(x.rad()) for x in known.entries()))
        for narrow, wide in zip(radii[1:], radii, strict=False):
            assert narrow < 8 * float(h) * wide


def test_a_remainder_of_derivatives_that_is_left_out_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = remainders.Model.multiplication.func

    def without(self: remainders.Model) -> Any:
        *rows, last = right(self).tolist()
        return arb_mat([*([*row[:-1], 0] for row in rows), last])

    monkeypatch.setattr(remainders.Model, "multiplication", property(without))
    assert _wrong_slopes(0.5, -0.25)


def test_a_remainder_of_the_flow_that_is_left_out_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def at(self: flow.FlowDerivative, t: Ball) -> Any:
        value = 0 * self.remainder
        for c in reversed(self.coefficients):
            value = value * t + c
        return value

    monkeypatch.setattr(flow.FlowDerivative, "at", at)
    assert _wrong_flow(0.5, -0.25, 1)


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


def test_remainders_at_the_start_of_a_step_only_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def at_the_start(_: Ball, last: int) -> list[Ball]:
        return [arb(1), *[arb(0)] * last]

    monkeypatch.setattr(remainders, "powers", at_the_start)
    assert _outside(0.5, -0.25)


@pytest.mark.parametrize("kind", ["product", "quotient", "root", "wave", "system"])
def test_a_remainder_that_is_left_out_is_found(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one kind of operation what is beyond the polynomial is dropped."""
    right = remainders._MODELS[kind]

    def without(step: Any, of: Any, result: Any, models: Any) -> Any:
        found = right(step, of, result, models)
        if kind == "wave":
            return remainders.Wave(
                *(step.model(x.series, arb(0)) for x in (found.sine, found.cosine))
            )
        if kind == "system":
            left = [step.model(x.series, arb(0)) for x in found.unknowns]
            return remainders.Solved(left, found.first, found.whole)
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
    assert gradients._SLOPES.keys() == remainders._MODELS.keys() == tape._EXTEND.keys()
