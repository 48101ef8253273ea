r"""One step of a proved motion: a polynomial with a remainder, and a tube that holds it.

Of the motion x(t) of a set's centre the first coefficients c_0 ... c_p are enclosed, and with them
the polynomial x~(t) = sum c_k t^k. What it lacks to be a motion begins with t^p:

    f(x~) - x~' = f_p t^p + r t^(p+1),    |...| <= D t^p    over the step,

as f(x~) and x~' have the coefficients before t^p in common; r is that of :mod:`.remainders`. Around
x~ lies a tube, a box; as long as a motion is in it,

    |x - x~| <= P (|x_0 - c_0| + D t^(p+1) / (p + 1)),

with P = |d phi / d y| from the tube's Jacobian. Where that is less than the tube is wide, no motion
leaves it (the comparison is that of Neher,
Jackson and Nedialkov, *On Taylor model based integration of ODEs*, SIAM J. Numer. Anal. 45 (2007)
236, with a defect in place of a Picard operator). A remainder from the coefficients of motions
from anywhere in a box (Moore, *Methods and Applications of Interval Analysis*, 1979, ch. 8) would
be larger, as each of its coefficients is computed from the widths of those before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from ...models.arrays import FloatArray
from .balls import Ball, Matrix, arb, arb_mat, between, exact, polynomial, precision
from .flow import FlowDerivative, flow_bound, flow_derivative
from .gradients import gradients, slope_models
from .remainders import models, powers, remainders
from .sets import BITS, StateSet, alike, widths
from .tape import Expansion, Series, Tape

_DERIVATIVE_ORDER = 6  # of the flow's derivative, whose error widens a set by its part only
_WIDER = 0.01  # a tube about a polynomial's values, in parts of their radius
_LEAST_ROOM = 1e-9  # and in parts of the values
_MORE = 4  # and in radii of the start
_LEAST_FACTOR = 0.25  # of steps
_LEAST = 1e-30  # [rad, m and per s] and at least
_LONGEST = 10  # logarithm of the longest step [s]
_LEAST_BITS = 60.0  # of the shortest step, 2^-60 s
_OF_BITS = 0.75  # in parts of those of a remainder
_CLOSER = 0.95  # of the step that a remainder promises: the box grows with it
_MANTISSA = 8  # parts of a power of two that steps are whole numbers of


@dataclass(frozen=True)
class TaylorModel:
    """A function of time over a step, sum c_k t^k + r t^(p+1), which encloses it."""

    coefficients: Series
    remainder: Ball

    def at(self, t: Ball) -> Ball:
        """Enclose its values at the times of a ball, which are within the step."""
        return polynomial(self.coefficients, self.remainder, t)

    def derivative(self) -> TaylorModel:
        """Its derivative, if the remainder is its next coefficient over the step (Lagrange)."""
        kept = [k * c for k, c in enumerate(self.coefficients)][1:]
        return TaylorModel(kept, len(self.coefficients) * self.remainder)


class Tube(NamedTuple):
    """A box that no motion leaves over a step, and what follows."""

    box: list[Ball]
    sizes: FloatArray
    """Sizes of the state's parts that are alike there."""
    remainders: list[Ball]
    """Remainders of q and u, in parts of t^(p+1)."""
    of_functions: list[Ball]
    """Those of the functions."""
    flow: Matrix
    """Derivatives of the flow between any two times of the step."""
    apart: list[Ball]
    """Bounds of how far other motions are from that of the set's centre."""
    off: list[Ball]
    """Bounds of how far functions of other motions are from those of the centre's."""


@dataclass(frozen=True)
class Step:
    """A step of the motions of a set of states, and of functions of them."""

    start: Fraction
    """Since the last event [s]."""
    length: Fraction
    states: StateSet
    """At the start."""
    tube: Tube
    system: Tape
    numbers: Sequence[Ball]
    motion: Sequence[TaylorModel]
    """Models of q, then of u, of the motion of the set's centre."""
    functions: Sequence[TaylorModel]
    """Models of the functions, which enclose those of all motions."""

    @property
    def end(self) -> Fraction:
        """Since the last event [s]."""
        return self.start + self.length

    @cached_property
    def span(self) -> tuple[Ball, Ball]:
        """Its start and its end, exact, since the last event [s]."""
        return exact(self.start), exact(self.end)

    def at(self, t: Ball) -> tuple[list[Ball], list[Ball]]:
        """Coordinates and speeds at a time since the step's start [s]."""
        with precision(BITS):
            off = self.states.apart(self._derivative.at(t))
        values = [model.at(t) + arb(0, w) for model, w in zip(self.motion, off, strict=True)]
        return values[: len(values) // 2], values[len(values) // 2 :]

    def crossing(self, i: int, t: Ball) -> tuple[Ball, tuple[list[Ball], list[Ball]]]:
        """Enclose the time and the state of a function's only zero in a ball of times.

        With x = c + D s at the ball's middle, n the function's derivative by the state, and f its
        value at c, the zero is later by -(f + n D s) / (n x'); the state there has moved by x'
        times that, so that only (I - x' n / (n x')) D is left of D: what makes a motion late makes
        none pass zero elsewhere.

        Args:
            i: place of the function.
            t: since the step's start [s].
        """
        narrower, _ = self._crossing(i, t)
        return self._crossing(i, narrower)

    def _crossing(self, i: int, t: Ball) -> tuple[Ball, tuple[list[Ball], list[Ball]]]:
        q, u = self.at(t)
        n_q, middle = self.system.n_q, t.mid()
        centre = [model.at(middle) for model in self.motion]
        value = self.system.values(self.numbers, centre[:n_q], centre[n_q:])[n_q + i]
        with precision(BITS):
            by_state = gradients(self.system, self.numbers, q, u)[n_q + i]
            rates = [*u, *self.system.values(self.numbers, q, u)[:n_q]]
            along = sum((n * x for n, x in zip(by_state, rates, strict=True)), arb(0))
            late = [x / along for x in rates]
            if not all(x.is_finite() for x in late):
                return t, (q, u)
            derivative = self._derivative.at(middle)
            change = arb_mat([by_state]) * derivative
            off = self.states.apart(derivative - arb_mat([[x] for x in late]) * change)
            (wide,) = self.states.apart(change)
        time = (middle - (value + arb(0, wide)) / along).intersection(t)
        state: list[Ball] = []
        for c, rate, w, before in zip(centre, late, off, [*q, *u], strict=True):
            state.append((c - rate * value + arb(0, w)).intersection(before))
        return time, (state[:n_q], state[n_q:])

    def reached(self) -> StateSet:
        """The states at its end."""
        end = exact(self.length)
        with precision(BITS):
            derivative = self._derivative.at(end)
        reached = [model.at(end) for model in self.motion]
        return self.states.moved(reached, derivative, self.tube.sizes)

    @cached_property
    def _derivative(self) -> FlowDerivative:
        return self.flow_derivative(min(_DERIVATIVE_ORDER, len(self.motion[0].coefficients) - 1))

    def flow_derivative(self, order: int) -> FlowDerivative:
        """Enclose the flow's derivative at all states of the set, by models of an order."""
        n_q, length, around = self.system.n_q, exact(self.length), self.states.box()
        with precision(BITS):
            expansion = self.system.expand(self.numbers, around[:n_q], around[n_q:], order)
            over = remainders(expansion, length)
            if not all(b.contains(x) for b, x in zip(self.tube.box, over.state, strict=True)):
                return FlowDerivative([], self.tube.flow)  # the polynomials may leave the tube
            grown = _left_out(expansion, over.outputs, self.tube.flow, length)
            along = models(expansion, length, grown)
            slopes = [part.tolist() for part in slope_models(self.system, along)[:n_q]]
            jacobian: list[Matrix] = []
            for k in range(order + 2):
                rows = [[x[k] for x in row] for row in slopes]
                jacobian.append(state_jacobian(rows, unit=k == 0))
            return flow_derivative(jacobian, powers(length, order + 1), self.tube.flow)

    @cached_property
    def of_all(self) -> list[TaylorModel]:
        """Models of the functions, whose every coefficient holds for all motions.

        Their remainders are the next coefficients anywhere in the box (Lagrange), as those of
        derivatives follow from them, and not from bounds of the functions' own values.
        """
        order, n_q = len(self.motion[0].coefficients) - 1, self.system.n_q
        around, box = self.states.box(), self.tube.box
        expansion = self.system.expand(self.numbers, around[:n_q], around[n_q:], order)
        with precision(BITS):
            on_box = self.system.expand(self.numbers, box[:n_q], box[n_q:], order + 1)
        places = range(n_q, len(expansion.outputs))
        return [TaylorModel(expansion.output(i), on_box.output(i)[-1]) for i in places]


class NoTubeError(Exception):
    """No tube was found that the motion does not leave, however short the step."""


@dataclass
class StepMaker:
    """Makes steps of a motion under one set of closed stops.

    Args:
        tape: accelerations and functions.
        numbers: of the mechanism.
        order: of the polynomials.
        bits: the remainder of a step is at most 2^-bits [rad, m and per s].
    """

    tape: Tape
    numbers: Sequence[Ball]
    order: int
    bits: float
    longest: float = 2.0**-7
    """The next step is no longer than this [s]."""

    def step(self, start: Fraction, states: StateSet, left: Fraction) -> Step:
        """Make a step from a set of states.

        Args:
            start: since the last event [s].
            states: at the step's start.
            left: longest that the step may be [s].

        Raises:
            NoTubeError: no step is short enough.
        """
        order, n_q = self.order, self.tape.n_q
        centre = list(states.centre)
        expansion = self.tape.expand(self.numbers, centre[:n_q], centre[n_q:], order)
        functions = [expansion.output(i) for i in range(n_q, len(expansion.outputs))]
        self.longest = min(self.longest, self._promised(expansion.state))
        shortest = 2.0 ** -max(_LEAST_BITS, _OF_BITS * self.bits)
        while self.longest >= shortest:
            length = min(_dyadic(self.longest), left)
            with precision(BITS):
                tube = self._tube(states, expansion, exact(length))
            if tube is None:
                self.longest = float(length) / 2
                continue
            sizes = [_log_size(r) for r in tube.remainders]
            for series, r in zip(functions, tube.of_functions, strict=True):
                sizes.append(_log_size(r) - max(0.0, _log_size(series[0])))
            # The logarithm of the remainder in parts of that allowed, which goes at least as
            # h^(order + 1).
            excess = max(sizes) + (order + 1) * math.log2(length) + self.bits
            self.longest = float(length) * _factor(excess / (order + 1))
            if not excess <= 0.0:
                continue
            return Step(
                start=start,
                length=length,
                states=states,
                tube=tube,
                system=self.tape,
                numbers=self.numbers,
                motion=list(map(TaylorModel, expansion.state, tube.remainders)),
                functions=[
                    TaylorModel([c[0] + arb(0, w), *c[1:]], r)
                    for c, w, r in zip(functions, tube.off, tube.of_functions, strict=True)
                ],
            )
        raise NoTubeError

    def _promised(self, state: Sequence[Series]) -> float:
        """Step at which the last coefficients are as small as the remainder [s]."""
        longest = math.inf
        for k, order in ((-1, self.order), (-2, self.order - 1)):
            size = max(_log_size(series[k]) for series in state)
            if abs(size) < math.inf:
                longest = min(longest, -(self.bits + size) / order)
        return 2.0 ** min(longest, _LONGEST)

    def _tube(self, states: StateSet, expansion: Expansion, length: Ball) -> Tube | None:
        """A tube that no motion leaves over a step; None: this one is not shown to be one.

        Args:
            states: at the step's start.
            expansion: of the motion of their centre.
            length: of the step [s].
        """
        n_q = self.tape.n_q
        over = remainders(expansion, length)
        room = [_room(c, x) for c, x in zip(over.state, states.box(), strict=True)]
        box = [c + arb(0, w) for c, w in zip(over.state, room, strict=True)]
        slopes = gradients(self.tape, self.numbers, box[:n_q], box[n_q:])
        known = (*over.outputs, *(x for row in slopes for x in row))
        if not all(x.is_finite() for x in known):
            return None
        jacobian = state_jacobian(slopes)
        sizes = alike(jacobian)
        flow = flow_bound(jacobian, between(arb(0), length), sizes)
        grown = _left_out(expansion, over.outputs, flow, length)
        of_functions: list[Ball] = []
        for row, along in zip(slopes[n_q:], over.outputs[n_q:], strict=True):
            beside = (slope * r for slope, r in zip(row, grown, strict=True))
            of_functions.append(sum(beside, along))
        apart = states.apart(flow)
        power = length ** (self.order + 1)
        for w, r, off in zip(room, grown, apart, strict=True):
            if not off + r.abs_upper() * power < w:
                return None
        off = list[Ball]()
        if of_functions:
            off = states.apart(arb_mat(slopes[n_q:]) * flow)
        return Tube(box, sizes, grown, of_functions, flow, apart, off)


def _left_out(
    expansion: Expansion, outputs: Sequence[Ball], flow: Matrix, length: Ball
) -> list[Ball]:
    """Enclose what motions have beside their polynomials, in parts of t^(p+1).

    Args:
        expansion: of the motions.
        outputs: remainders of the accelerations along the polynomials.
        flow: its derivatives over a tube with the motions and their polynomials.
        length: of the step [s].
    """
    n_q = len(expansion.state) // 2
    order = len(expansion.state[0]) - 1
    # q~' has not the last coefficient of u~, nor u~' that of the accelerations.
    defect = [series[order].abs_upper() for series in expansion.state[n_q:]]
    for i, r in enumerate(outputs[:n_q]):
        last = expansion.output(i)[order].abs_upper()
        defect.append((last + length * r.abs_upper()).upper())
    return [arb(0, (x / (order + 1)).upper()) for x in widths(flow, defect)]


def _room(over: Ball, start: Ball) -> Ball:
    """Half the width of a tube around a polynomial's values over a step, and those at its start."""
    wider = over.rad() * _WIDER + over.abs_upper() * _LEAST_ROOM + start.rad() * _MORE + _LEAST
    return wider.upper()


def _factor(excess: float) -> float:
    """Change of the step for a remainder of 2^excess in parts of that allowed, an order each."""
    if not excess < math.inf:
        return _LEAST_FACTOR
    return min(max(_CLOSER * 2.0 ** min(-excess, 2.0), _LEAST_FACTOR), 2.0)


def state_jacobian(slopes: Sequence[Sequence[Ball]], unit: bool = True) -> Matrix:
    """Jacobian of the rates of q and u by the state, from the derivatives of the accelerations.

    Args:
        slopes: of the accelerations, or a coefficient of theirs.
        unit: whether the coordinates' rates are in it.
    """
    n = len(slopes[0])
    rates = [[int(unit and j == i + n // 2) for j in range(n)] for i in range(n // 2)]
    return arb_mat([*rates, *slopes[: n // 2]])


def _dyadic(value: float) -> Fraction:
    """The next number below one that is exact in few bits."""
    mantissa, exponent = math.frexp(value)
    return Fraction(math.floor(mantissa * _MANTISSA), _MANTISSA) * Fraction(2) ** exponent


def _log_size(ball: Ball) -> float:
    """Logarithm to base 2 of an upper bound of the absolute values in a ball."""
    if not ball.is_finite():
        return math.inf
    mantissa, exponent = ball.abs_upper().man_exp()
    return math.log2(int(mantissa)) + int(exponent) if mantissa else -math.inf
