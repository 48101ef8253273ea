"""Faults of the prover itself: each is caught where enclosures are held against each other.

Enclosures of one motion by other orders, steps and bits must intersect, and contain what is known
in closed form. A prover that drops a remainder or rounds inward gives balls that do not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.reference.proof import events, flow, motion, sets, steps
from trebucheck.reference.proof.balls import arb, between, exact, identity, precision
from trebucheck.reference.proof.motion import Limits, ProvedMotion
from trebucheck.reference.taylor.expressions import TaylorSystem

_SETTINGS = ((7, 6, 80), (12, 12, 100), (18, 20, 140))
"""Order, digits of the remainder and bits, from coarse to fine."""


def _wheel() -> tb.Problem:
    """A wheel on a torsion spring that strikes a stop: q = cos(2 t) until it does."""
    body = tb.Body(name="wheel", angle="q", mass=1.0, centre=(0, 0), inertia=0.25)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="wheel", parent_point=(0, 0), child_point=(0, 0)
    )
    spring = tb.RotationalSpringDamper(name="spring", body="wheel", stiffness=1.0)
    stop = tb.Stop(name="stop", body="wheel", limit=0.25, sense=1, restitution=0.5, closed=False)
    wheel = tb.Mechanism(
        name="wheel",
        bodies=(body,),
        joints=(pin,),
        force_elements=(spring,),
        stops=(stop,),
        gravity=0.0,
        start=(1.0,),
    )
    return tb.Problem(wheel, duration=1.25, stop_law=tb.StopLaw.UNILATERAL)


def _enclosed(problem: tb.Problem, order: int, digits: int, bits: int) -> list[Any]:
    """Times of events and the state at the end."""
    with precision(bits):
        moved = ProvedMotion(problem, order, digits * math.log2(10), Limits(seconds=30.0))
        moved.run(Fraction(problem.duration))
        q, u = moved.phases[-1].at(exact(Fraction(problem.duration)))
        return [*(event.time for event in moved.events), *q, *u]


def _contradictions() -> Iterator[str]:
    """What does not hold of enclosures that are held against each other and closed forms."""
    wheel, machine = _wheel(), tb.Problem(tb.fixed(), duration=1.5)
    upright = tb.Problem(tb.problem("high-pendulum").mechanism, duration=6.0)
    of_wheel = [_enclosed(wheel, *setting) for setting in _SETTINGS]
    of_upright = [_enclosed(upright, *setting) for setting in _SETTINGS]
    for found in of_wheel:
        with precision(200):
            struck = arb(0.25).acos() / 2
        if not found[0].overlaps(struck):
            yield "the time of the impact excludes the closed form"
    of_machine = [_enclosed(machine, *setting) for setting in _SETTINGS[1:]]
    for runs in (of_wheel, of_upright, of_machine):
        for first, second in pairwise(runs):
            if len(first) != len(second):
                yield "one has other events"
            elif not all(a.overlaps(b) for a, b in zip(first, second, strict=True)):
                yield "two enclosures exclude each other"


def _without_remainder(self: Any, t: Any) -> Any:
    value = arb(0)
    for c in reversed(self.coefficients):
        value = value * t + c
    return value


def _to_the_middle(at: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self, t: at(self, t).mid()


def _without_spread(moved: Callable[..., Any]) -> Callable[..., Any]:
    """A set that forgets how far its states were apart before the step."""

    def forgetting(self: Any, reached: Any, derivative: Any, sizes: Any) -> Any:
        still = dataclasses.replace(self, generators=0 * self.generators)
        return moved(still, reached, derivative, sizes)

    return forgetting


def _standing(self: Any, t: Any) -> Any:
    """States that keep their distances."""
    return identity(self.remainder.nrows())


def _in_doubles(value: Fraction) -> Any:
    return arb(float(value) * (1 + 2**-50))


def _first_middle(function: Any, slope: Any, interval: Any) -> Any:
    """A zero by one step of Newton's from the middle, taken for exact."""
    middle = interval.mid()
    return (middle - function.at(middle) / slope.at(middle)).mid()


def _wrong_side(self: TaylorSystem) -> Any:
    first = self.structure.n_q + self.structure.n_loops
    return list(self.solved[first:])


FAULTS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "the remainder is dropped": lambda patch: patch.setattr(
        steps.TaylorModel, "at", _without_remainder
    ),
    "radii are dropped": lambda patch: patch.setattr(
        steps.TaylorModel, "at", _to_the_middle(steps.TaylorModel.at)
    ),
    "sets forget their spread": lambda patch: patch.setattr(
        sets.StateSet, "moved", _without_spread(sets.StateSet.moved)
    ),
    "states keep their distances": lambda patch: patch.setattr(
        flow.FlowDerivative, "at", _standing
    ),
    "sets have no width": lambda patch: patch.setattr(
        sets.StateSet, "box", lambda self: list(self.centre)
    ),
    "times are doubles": lambda patch: patch.setattr(motion, "exact", _in_doubles),
    "a zero is its first approximation": lambda patch: patch.setattr(
        events, "_located", _first_middle
    ),
    "torques have the other sign": lambda patch: patch.setattr(
        TaylorSystem, "torques", property(_wrong_side)
    ),
}


def test_a_right_prover_contradicts_nothing() -> None:
    assert not list(_contradictions())


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_caught(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a contradiction, or by the prover itself, which decides nothing then."""
    FAULTS[fault](monkeypatch)
    try:
        found = list(_contradictions())
    except (tb.SimulationError, ValueError) as error:
        found = [str(error)]
    assert found


def test_a_step_that_is_too_long_has_no_tube() -> None:
    """A remainder so large that motions may leave the tube: none is given."""
    with precision(100):
        moved = ProvedMotion(_wheel(), 12, 40.0, Limits())
        tape = moved._system((), (), launches=False).tape
        maker = steps.StepMaker(tape, moved.numbers, 12, 40.0)
        start = sets.StateSet.of([arb(1), arb(0)])
        expansion = tape.expand(moved.numbers, [arb(1)], [arb(0)], 12)
        assert maker._tube(start, expansion, arb(8)) is None
        tube = maker._tube(start, expansion, arb(1) / 8)
        assert tube is not None
        for k in range(9):
            t = Fraction(k, 64)
            with precision(200):
                q, u = (2 * exact(t)).cos(), -2 * (2 * exact(t)).sin()
            assert tube.box[0].contains(q) and tube.box[1].contains(u)


def test_a_double_zero_is_undecided() -> None:
    with precision(100):
        touching = steps.TaylorModel([arb(1) / 16, arb(-1) / 2, arb(1), arb(0)], arb(0))
        with pytest.raises(events.UndecidedZeroError):
            list(events.zeros(touching, touching.derivative(), Fraction(1)))
        crossing = steps.TaylorModel([arb(1) / 3, arb(-1), arb(0)], arb(0))
        (zero,) = events.zeros(crossing, crossing.derivative(), Fraction(1))
        assert zero.falls and zero.time.overlaps(arb(1) / 3)
        assert math.isclose(float(zero.time.rad()), 0.0, abs_tol=1e-25)
        assert between(arb(0), arb(1)).contains(zero.time)
