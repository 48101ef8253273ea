"""Horizons: until when a start that is given with so many bits determines a motion, proved."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from ..models.arrays import FloatArray
from ..models.errors import InputError, TrebucheckError
from ..models.kinematics import initial_state
from ..models.library.registry import Model
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.shown import Reported
from ..models.spec import Real, Spec
from ..reference.proof.horizon import Parting, parting, spread
from ..reference.proof.motion import Limits
from ..reference.proof.proof import Time, end_of
from ..reference.sensitivity.sensitivities import physical_numbers
from ..reference.sensitivity.tangent import state_tangent
from ..reference.sensitivity.variational import VariationalEquations
from ..reference.solution import Solution
from ..reference.solver import solve, solve_to_launch
from .prove import problem_to_prove
from .runs.results import ResultFile
from .runs.scales import scales_until

FORMAT = "trebucheck-horizon-1"
LEAST_BITS, MOST_BITS = 8, 600
_LINES = 8  # times at which the linear estimate is made
_TOLERANCE = 1e-10  # of the estimate's integration
_KNOWN = 1e10  # growth beyond which the reference's own motion has no digits to be estimated on
_POINTS = 200  # of the growth that are kept, at most

Progress = Callable[[str, float], None]


class KnownDigits(Spec):
    """Until when so many digits of every coordinate are known."""

    digits: int = Field(
        description="all motions are within half a unit of this decimal place of one value, "
        "angles in rad, slides in parts of `length`"
    )
    until: Real = Field(description="proved: they are known until then [s]")
    lost: Real | None = Field(
        description="proved: they are not known at this time, when motions from two of the starts "
        "are more than a unit apart [s]; null: no such time was found by the end"
    )


class Growth(Spec):
    """Distance of motions from the starts from one of them."""

    t: Real = Field(description="[s]")
    radius: Real = Field(description="of all coordinates, in the same parts")


class Horizon(Reported, ResultFile):
    """Digits that a start of so many bits determines, and until when."""

    format: Literal["trebucheck-horizon-1"] = FORMAT
    model: str
    mechanism_hash: str
    stop_law: StopLaw
    start_bits: int = Field(description="each value x of the start is within |x| / 2^bits")
    until: Real | None = Field(description="end that was asked for [s]; null: the launch")
    length: Real = Field(description="part of which a slide's digits are counted [m]")
    end: Real = Field(description="to which all motions are enclosed [s]")
    ended: str = Field(
        description="why they are no further; empty: the end has come, or no digit is left"
    )
    known: tuple[KnownDigits, ...] = Field(description="by digits, from one on")
    growth: tuple[Growth, ...] = Field(description="proved bound: none is farther up to then")
    parted: tuple[Growth, ...] = Field(
        description="proved: so far are two of them then from what is between them; empty where "
        "none were enclosed"
    )
    linear: tuple[Growth, ...] = Field(
        description="estimate: the derivative by the start, times the start's radius"
    )
    unlinear: str = Field(description="why there is none")
    processor_time: Real = Field(description="[s]")

    def known_until(self, digits: int) -> float:
        """Time until which so many digits are proved to be known [s]; 0: not even at the start."""
        return next((each.until for each in self.known if each.digits == digits), 0.0)

    def headline(self) -> str:
        """Tell how long the last digits are known."""
        parts = [f"{each.digits} digits until {each.until:.4g} s" for each in self.known]
        told = ", ".join(reversed(parts)) or "no digit"
        return f"{self.model}, start known to {self.start_bits} bits: {told}"


def horizon(
    model: Model = "double-pendulum",
    bits: int = 24,
    until: Time | None = None,
    *,
    digits: int = 1,
    stop_law: StopLaw | str | None = None,
    most_steps: int = Limits.steps,
    timeout: float = Limits.seconds,
    progress: Progress | None = None,
) -> Horizon:
    """Prove until when a start that is given with so many bits determines the motion.

        >>> import trebucheck as tb
        >>> known = tb.horizon("pendulum", bits=24, until=1.0)
        >>> known.known_until(3) >= 1.0
        True

    All motions from the box of starts are enclosed at once, which proves how long digits are known;
    two motions from its corners, enclosed one by one, prove when they are not. What no engine knows
    that stores the start with so many bits: 24 in single precision, 53 in double.

    Args:
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        bits: of each value of the start, 8 to 600.
        until: end [s], a text as the decimal it says; a problem's own, else the launch, if left
            out.
        digits: the motions are enclosed until fewer than these are known.
        stop_law: a problem's own, else 'release-once', if left out.
        most_steps: limit of the steps of one enclosure.
        timeout: limit of processor time of one enclosure [s].
        progress: called with what is enclosed and the time that is proved so far [s].

    Raises:
        InputError: a name or value is not valid, or the start has nothing but zeros.
        SimulationError: the reference cannot move it.
    """
    began = time.process_time()
    problem, until = problem_to_prove(model, until, stop_law)
    mechanism, end = problem.mechanism, None if until is None else end_of(until)
    _refuse(mechanism, bits, digits)
    limits = Limits(steps=most_steps, seconds=timeout)
    last = _launch(mechanism) if end is None else float(end)
    moved = Problem(mechanism, duration=last, stop_law=problem.stop_law)
    solution = solve(moved)

    def shown(what: str) -> Callable[[float], None]:
        return lambda t: None if progress is None else progress(what, t)

    length = scales_until(solution, last).length
    sizes = np.where(solution.equations.kinematics.is_angle > 0, 1.0, length)
    all_of_them = spread(
        problem, bits, end, sizes, 0.5 * 10.0**-digits, limits, shown("all motions")
    )
    linear = _linear(solution, last, bits, sizes)
    apart: Parting | None = None
    if linear.signs is not None:
        apart = parting(
            moved, bits, linear.signs, Fraction(last), sizes, limits, shown("two motions")
        )
    known = _known(all_of_them.times, all_of_them.radii, apart)
    return Horizon.made_here(
        model=mechanism.name,
        mechanism_hash=mechanism.content_hash,
        stop_law=problem.stop_law,
        start_bits=bits,
        until=None if end is None else float(end),
        length=length,
        end=float(all_of_them.times[-1]) if len(all_of_them.times) else 0.0,
        ended=all_of_them.ended,
        known=tuple(known),
        growth=_growth(all_of_them.times, np.maximum.accumulate(all_of_them.radii)),
        parted=() if apart is None else _growth(apart.times, apart.distances / 2),
        linear=linear.estimates,
        unlinear=linear.why,
        processor_time=time.process_time() - began,
    )


def _refuse(mechanism: Mechanism, bits: int, digits: int) -> None:
    if not LEAST_BITS <= bits <= MOST_BITS:
        raise InputError(f"start bits = {bits} must be between {LEAST_BITS} and {MOST_BITS}.")
    most = math.floor(bits * math.log10(2))
    if not 1 <= digits <= most:
        raise InputError(
            f"digits = {digits} must be between 1 and {most}: a start of {bits} bits has no more."
        )
    if not np.concatenate(initial_state(mechanism)).any():
        raise InputError(
            f"every value of the start of {mechanism.name!r} is zero, which any number of bits "
            "holds exactly; a start that is not zero is needed."
        )


def _launch(mechanism: Mechanism) -> float:
    """Time of the launch by the reference [s]."""
    launch = solve_to_launch(mechanism).launch
    if launch is None:
        raise InputError(f"{mechanism.name!r} does not launch: an end of its motion is needed.")
    return launch.time


def _known(times: FloatArray, radii: FloatArray, apart: Parting | None) -> Sequence[KnownDigits]:
    """Times by digits, as long as there are some that are known for a while."""
    known: list[KnownDigits] = []
    while True:
        digits = len(known) + 1
        beyond = np.flatnonzero(~(radii <= 0.5 * 10.0**-digits))
        n_steps = int(beyond[0]) if len(beyond) else len(times)
        if not n_steps:
            return known
        lost = None
        if apart is not None:
            parted = np.flatnonzero(apart.distances > 10.0**-digits)
            lost = float(apart.times[parted[0]]) if len(parted) else None
        known.append(KnownDigits(digits=digits, until=float(times[n_steps - 1]), lost=lost))


def _growth(times: FloatArray, radii: FloatArray) -> tuple[Growth, ...]:
    """Points of a curve, no more than a picture needs."""
    if not len(times):
        return ()
    chosen = np.unique(np.linspace(0, len(times) - 1, _POINTS).astype(int))
    return tuple(Growth(t=float(times[i]), radius=float(radii[i])) for i in chosen)


class _Linear(NamedTuple):
    """First-order growth, and the corner of the box that grows most."""

    estimates: tuple[Growth, ...]
    signs: tuple[float, ...] | None
    """None: corners of the box are no starts of the mechanism."""
    why: str
    """Why there are no estimates."""


def _linear(solution: Solution, end: float, bits: int, sizes: FloatArray) -> _Linear:
    """Growth by the variational equations (:mod:`..reference.sensitivity.tangent`)."""
    mechanism = solution.problem.mechanism
    values, n_q = np.concatenate(initial_state(mechanism)), len(sizes)
    if mechanism.bound_by:
        return _Linear((), None, "loops or couplers bind the values of the start to each other")
    signs = tuple(1.0 for _ in values)
    described = {number.name: number.direction for number in physical_numbers(mechanism)[0]}
    names = [f"start angle {name}" for name in mechanism.angles]
    names += [f"start position {name}" for name in mechanism.slides]
    names += [f"start speed of {name}" for name in mechanism.coordinates]
    chosen = [i for i, name in enumerate(names) if values[i] and name in described]
    estimates: list[Growth] = []
    try:
        equations = VariationalEquations(mechanism, [described[names[i]] for i in chosen])
        for k in range(1, _LINES + 1):
            tangent = state_tangent(solution, equations, end * k / _LINES, _TOLERANCE)
            moved = np.zeros((len(values), n_q))
            for i, row in zip(chosen, tangent.dq, strict=True):
                moved[i] = row * values[i] / sizes
            growth = np.abs(moved).sum(axis=0)
            most = int(np.argmax(growth))
            if growth[most] > _KNOWN:
                why = f"not beyond {estimates[-1].t:.4g} s, as the reference knows no more there"
                return _Linear(tuple(estimates), signs, why)
            signs = tuple(np.where(moved[:, most] < 0, -1.0, 1.0).tolist())
            radius = float(growth[most]) * 2.0**-bits
            estimates.append(Growth(t=tangent.t, radius=radius))
    except TrebucheckError as error:
        return _Linear(tuple(estimates), signs, str(error))
    return _Linear(tuple(estimates), signs, "")
