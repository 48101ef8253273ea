r"""Motion through singular positions, in which loop constraints lose rank.

In such a position (a parallelogram with all its pins on one line) branches of the configuration
space meet, the equations of motion read 0/0, and rounding decides on which branch an integrator
leaves. The motion itself is smooth where its speed tells the branch: if the vanishing singular
values of the constraint Jacobian change sign along it, no other branch has its tangent (Golubitsky
and Guillemin, Stable Mappings and Their Singularities, 1973, on transversal crossings). A singular
value that only touches zero tells of branches that touch, or of a mechanism at rest.

Across such a position the motion is taken as one polynomial over a short window that fulfils the
equations of motion at Gauss's points, which lie beside the position (collocation). Whatever
leaves the branch has a pole in the window and is near no polynomial: then polynomials of different
degrees differ, or the loops do not close between the points. Their difference tells how far the
passage is known. Multipliers have simple poles there in general: see
:meth:`Window.multipliers`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import DenseOutput
from scipy.linalg import lu_factor, lu_solve

from ..models.arrays import FloatArray
from ..models.errors import SimulationError
from .equations import Equations, least_step, scales_of

# Singular value below which a window is tried; of a crank and a coupler about their angle [rad].
_NEAR = 0.15
# A window is kept if it comes this close, though it turns before: rounding grows as 1/square of it.
_CLOSE = 0.05
_DEGREES = (10, 14, 18, 24, 32)  # numbers of Gauss's points
_FIRST = 8  # of the points with which the window is placed
_AGREE = 3e-13  # of the largest arm: two polynomials this near each other need no higher degree
_WORST = 1e-9  # of the largest arm: beyond this the passage is not known
_VANISHES = 1e-7  # a singular value this small at its minimum is zero within the coordinates' error
# Of the largest arm: how well loops with a singular position close between the points; loops that
# close no better than the second are integrated as ones without a singular position.
_CLOSES = 2e-13
_DRIFT = 3e-12
_SAMPLES = 200  # of a window, in search of singular positions
_ITERATIONS, _PLACINGS = 20, 8
_EPSILON = 4 * float(np.finfo(np.float64).eps)
_PROBES = np.linspace(0.0, 1.0, 5)  # of a step
_SAFETY = 2.0  # times what a step may change, as speeds inside it are others
_POSITIONS = 32  # random ones, for the largest arms


class RankWatch:
    """Watches one segment's constraints for a loss of rank, and finds the motion across it."""

    def __init__(self, equations: Equations, closed: Sequence[str], q: FloatArray) -> None:
        self.equations, self.closed, self.n_q = equations, tuple(closed), len(q)
        self.level = _NEAR if equations.n_loops else 0.0
        if equations.n_loops:
            basis = equations.basis(q, closed)
            self.rank = equations.n_loops + len(closed) if basis is None else basis.rows.shape[-2]
            # Joints that say again what the tree says lose no rank.
            self.level = _NEAR if self.rank else 0.0
            positions = q + np.random.default_rng(1).uniform(-np.pi, np.pi, (_POSITIONS, len(q)))
            arms = np.abs(equations.constraint_jacobian(positions, closed)).max(axis=0)
            self.arms = arms.max(axis=0)
            self.reach = float(self.arms.max(initial=0.0)) or 1.0
            self.scales = scales_of(np.sum(arms**2, axis=0), arms)
            rows = np.linalg.norm(self.scales.rows[:, None] * arms, axis=0)
            self._slopes = rows * self.scales.columns
        self._slack, self._speeds = -np.inf, np.zeros(len(q))

    def window(
        self, dense: DenseOutput, start: float, end: float, speeds: FloatArray
    ) -> Window | None:
        """The motion across a singular position near a step, from some time in it on.

        Args:
            dense: output of the step from `start` to `end` [s].
            start, end: [s]
            speeds: at the end, shape (n_q,).

        Raises:
            SimulationError: the speed does not tell the branch.
        """
        if not self.level:
            return None
        # Each singular value changes at most as its matrix does: none can be near zero for a while.
        fastest = np.maximum(np.abs(self._speeds), np.abs(speeds))
        self._speeds = speeds
        self._slack -= _SAFETY * (end - start) * float(fastest @ self._slopes)
        if self._slack > 0:
            return None
        times = start + _PROBES * (end - start)
        states = np.asarray(dense(times)).T
        values = self._values(states[:, : self.n_q])[:, -1]
        near = np.flatnonzero(values < self.level)
        if not len(near):
            self.level = _NEAR if values[-1] > _NEAR else self.level
            self._slack = float(values[-1]) - self.level
            return None
        self._slack = -np.inf
        k = max(int(near[0]) - 1, 0)
        return self.window_from(float(times[k]), *np.split(states[k], 2), least=float(values.min()))

    def nears(self, q: FloatArray, change: FloatArray) -> bool:
        """Tell whether another change of the coordinates leads near a singular position."""
        if not self.level:
            return False
        values = self._values(q + _PROBES[:, None] * change)[:, -1]
        if values[0] > _NEAR:
            self.level = _NEAR
        return bool(values.min() < self.level)

    def window_from(
        self, start: float, q: FloatArray, u: FloatArray, least: float = np.inf
    ) -> Window | None:
        """The motion across the singular position ahead of a state, as :meth:`window`.

        Args:
            start: [s].
            q, u: the state.
            least: singular value to which an integrator has come by itself, of which it may come
                closer without one.
        """
        given = Given(start, *self.projected(q, u))
        placed = self._placed(given)
        window = None if placed is None else self._refined(placed, given)
        if window is None:
            self.level = 0.5 * min(least, self.level, self._least(q))
            if self.level < _VANISHES:
                raise SimulationError(
                    f"the reference gave up at t = {start:.6g} s near a singular position: no "
                    "smooth motion through it was found."
                )
        return window

    def begin(self, start: float, q: FloatArray, u: FloatArray) -> Window | None:
        """The motion out of a singular position at a segment's start; None in another one.

        Raises:
            SimulationError: the speed does not tell the branch.
        """
        if not self.level or self._least(q) > _VANISHES:
            return None
        if u.any():
            step = 1e-3 / float(np.abs(u).max())
            half = _NEAR * step / max(self._least(q + u * step), 1e-6)
            given, motion = Given(start, q, u), None
            for part in (0.25, 0.5, 1.0):
                motion = self._collocated(given, start - part * half, part * half, _FIRST, motion)
                if motion is None:
                    break
            window = None if motion is None else self._refined(motion, given)
            if window is not None and window.passages:
                later = [p for p in window.passages if p.time > start - half * BESIDE]
                passages = tuple(replace(p, time=max(p.time, start)) for p in later)
                return replace(window, start=start, passages=passages)
        raise SimulationError(
            f"the reference cannot start at t = {start:.6g} s in a singular position, in which "
            "constraints that are independent beside it depend on each other, at rest or with a "
            "speed that tells no branch of its motion."
        )

    def projected(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest coordinates and speeds that fulfil the constraints."""
        for _ in range(3):
            jacobian = self.equations.constraint_jacobian(q, self.closed)
            q = q - least_step(jacobian, self._residual(q), self.rank)
        jacobian = self.equations.constraint_jacobian(q, self.closed)
        return q, u - least_step(jacobian, jacobian @ u, self.rank)

    def _values(self, q: FloatArray) -> FloatArray:
        """Singular values of the independent constraints, the least last; shape (..., rank)."""
        values = np.linalg.svd(self._scaled(q), compute_uv=False)
        return np.asarray(values[..., : self.rank], dtype=np.float64)

    def _scaled(self, q: FloatArray) -> FloatArray:
        """The constraints' Jacobian without units, shape (..., n_constraints, n_q)."""
        jacobian = self.equations.constraint_jacobian(q, self.closed)
        return self.scales.rows[:, None] * jacobian * self.scales.columns

    def _least(self, q: FloatArray) -> float:
        return float(self._values(q)[-1])

    def _residual(self, q: FloatArray) -> FloatArray:
        gaps = [self.equations.kinematics.gap(name, q)[..., None] for name in self.closed]
        return np.concatenate([self.equations.loop_residual(q), *gaps], axis=-1)

    def _placed(self, given: Given) -> Polynomial | None:
        """A first polynomial on a window with the singular position ahead about its middle."""
        # The time until the motion is nearest to the position, as it looks now [s].
        q, u, a = given.q, given.u, self._accelerations(given.q, given.u)
        value, step = self._least(q), 1e-4 / max(float(np.abs(u).max()), 1e-300)
        rate = (self._least(q + u * step) - value) / step
        if rate >= 0:
            return None
        t = np.linspace(0.0, -3 * value / rate, 61)
        values = self._values(q + u * t[:, None] + 0.5 * a * t[:, None] ** 2)[:, -1]
        k = int(np.argmax(np.diff(values) > 0))
        if k == 0:
            return None
        half, motion = float(t[k]), None
        for _ in range(_PLACINGS):
            if (motion := self._collocated(given, given.time, half, _FIRST, motion)) is None:
                return None
            ahead = half * np.linspace(0.0, 2.5, 101)
            values = self._values(motion.values(motion.q, given.time + ahead))[:, -1]
            k = int(np.argmax(np.diff(values) > 0))
            if k == 0:
                return None
            if abs(ahead[k] - half) < 0.05 * half:
                # The window ends clear of the next singular position, if there is one.
                clear = ahead[k:][values[k:] > 0.5 * values[0]]
                end = clear[np.argmin(np.abs(clear - 2 * half))] if len(clear) else 2 * half
                return self._collocated(given, given.time, 0.5 * float(end), _FIRST, motion)
            half = float(ahead[k])
        return None

    def _refined(self, placed: Polynomial, given: Given) -> Window | None:
        """The window with as many points as it needs, if there is a smooth motion in it."""
        motion, difference = placed, np.inf
        t = placed.start + placed.half * np.linspace(0.0, 2.0, _SAMPLES + 1)
        for n in _DEGREES:
            before, motion = motion, self._collocated(given, placed.start, placed.half, n, motion)
            if motion is None:
                return None
            change = np.abs(motion.values(motion.q, t) - before.values(before.q, t))
            difference = float((change * self.arms).max()) / self.reach
            if difference <= _AGREE:
                break
        passages = tuple(self._passages(motion, difference, t)) if difference <= _WORST else ()
        if not self._is_branch(motion, passages, difference, t):
            return None
        poles = np.array([passage.time for passage in passages])
        x, to_series, _, _ = gauss(len(motion.a), -1.0)
        at = motion.start + motion.half * (x + 1)
        states = motion.values(motion.q, at), motion.values(motion.u, at)
        forces = self.equations.solve(*states, self.closed)[1]
        distances = np.prod((at[:, None] - poles) / motion.half, axis=1)[:, None]
        series = to_series @ (forces * distances)
        return Window(float(t[0]), float(t[-1]), passages, motion, series, poles)

    def _is_branch(
        self,
        motion: Polynomial,
        passages: Sequence[SingularPassage],
        difference: float,
        t: FloatArray,
    ) -> bool:
        """Tell whether a polynomial closes the loops between its points, and beats the integrator.

        Raises:
            SimulationError: it does so within the drift of an integration, but not within rounding.
        """
        open_by = float(np.abs(self._residual(motion.values(motion.q, t))).max()) / self.reach
        if not passages:
            values = self._values(motion.values(motion.q, t))[:, -1]
            closes = open_by < _CLOSES and difference <= _AGREE
            return bool(closes and values.min() < _CLOSE < values[0])
        if _CLOSES < open_by < _DRIFT:
            raise SimulationError(
                f"the reference gave up at t = {passages[0].time:.6g} s near a singular position: "
                f"the loops fail to have one there by {open_by:.1g} of their size, so that "
                "rounding decides on the branch; lengths that are meant to be equal need all their "
                "digits."
            )
        return open_by < _CLOSES

    def _passages(
        self, motion: Polynomial, difference: float, t: FloatArray
    ) -> Iterator[SingularPassage]:
        """Find where singular values vanish, each of them changing its sign."""
        for rough in self._minima(motion, t):
            for bracket in self._minima(motion, rough):
                time, value, rate = self._zero(motion, bracket)
                if value > _VANISHES:
                    continue
                values = self._values(motion.values(motion.q, np.array(time)))
                lost = int((values < 10 * _VANISHES).sum())
                self._refuse_touching(motion, time, lost)
                uncertain = (difference + _EPSILON) / abs(rate) + _EPSILON * abs(time)
                yield SingularPassage(time, uncertain, difference, lost)

    def _minima(self, motion: Polynomial, t: FloatArray) -> Iterator[FloatArray]:
        """Times around each minimum of the least singular value at times t [s]: `_SAMPLES`."""
        values = self._values(motion.values(motion.q, t))[:, -1]
        for i in np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] < values[2:])) + 1:
            yield np.linspace(t[i - 1], t[i + 1], _SAMPLES)

    def _zero(self, motion: Polynomial, t: FloatArray) -> tuple[float, float, float]:
        """Newton's zero of the least singular value in t [s]; its value and rate [1/s] there."""
        time, step, rate, value = float(t[len(t) // 2]), 0.1 * float(t[-1] - t[0]), 0.0, np.inf
        for _ in range(_ITERATIONS):
            beside = time + step * np.array([-1.0, 0.0, 1.0])
            before, here, after = self._scaled(motion.values(motion.q, beside))
            left, values, right = np.linalg.svd(here)
            value = float(values[self.rank - 1])
            change = float(left[:, self.rank - 1] @ (after - before) @ right[self.rank - 1])
            rate = change / (2 * step)
            newton = time - value / rate if rate else time
            if abs(newton - time) <= _EPSILON * abs(time):
                break
            time = float(np.clip(newton, t[0], t[-1]))
        return time, value, rate

    def _refuse_touching(self, motion: Polynomial, time: float, lost: int) -> None:
        """Refuse a position in which a vanishing singular value does not change its sign.

        Raises:
            SimulationError: it doubles less than twice with the distance.
        """
        beside = time + BESIDE * motion.half * np.array([-2.0, -1.0, 1.0, 2.0])
        values = self._values(motion.values(motion.q, beside))[:, -lost:]
        if np.all(values[[0, 3]].sum(axis=0) < 3 * values[[1, 2]].sum(axis=0)):
            return
        raise SimulationError(
            f"the reference gave up at t = {time:.6g} s in a singular position: constraints that "
            "are independent beside it depend on each other there, and the mechanism comes to it "
            "at rest or where branches of its motion touch, so its speed does not tell how it "
            "moves on."
        )

    def _collocated(
        self, given: Given, start: float, half: float, n: int, guess: Polynomial | None
    ) -> Polynomial | None:
        """The polynomial motion that fulfils the equations at n points of a window and a state.

        Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, 1993, II.7. Where the
        motion is analytic the error falls as fast as its Legendre series does. What happens between
        the points, at which the equations may be singular, is never evaluated.

        Args:
            given: the state, at the window's start or in its middle.
            start, half: the window's start and half its length [s].
            n: number of points.
            guess: another polynomial near it; None: constant accelerations, those of the given
                state, or zero where that is in the middle, so singular.

        Returns:
            None if Newton's iteration does not converge.
        """
        base = (given.time - start) / half - 1.0
        x, to_series, once, twice = gauss(n, base)
        once, twice = half * once, half**2 * twice
        start_q = given.q + half * np.outer(x - base, given.u)
        start_u = np.broadcast_to(given.u, (n, len(given.u)))
        if guess is not None:
            a = guess.values(guess.a, start + half * (x + 1))
        elif base < 0:
            a = np.broadcast_to(self._accelerations(given.q, given.u), start_u.shape)
        else:
            a = np.zeros(start_u.shape)
        last, factors = np.inf, None
        for _ in range(_ITERATIONS):
            q, u = start_q + twice @ a, start_u + once @ a
            if factors is None:
                factors = lu_factor(self._newton(q, u, once, twice), check_finite=False)
            residual = (self._accelerations(q, u) - a).ravel()
            change = lu_solve(factors, residual, check_finite=False).reshape(a.shape)
            a = a + change
            size = float((np.abs(twice @ change) * (self.arms / self.reach)).max())
            if not size < 10:
                return None
            if size < _ROUNDING or (size < _STALLED and size > 0.3 * last):
                series = to_series @ a
                u = np.asarray(half * legendre.legint(series, lbnd=base), dtype=np.float64)
                u[0] += given.u
                q = np.asarray(half * legendre.legint(u, lbnd=base), dtype=np.float64)
                q[0] += given.q
                return Polynomial(start, half, q, u, series)
            factors = None if size > 0.1 * last else factors
            last = size
        return None

    def _newton(
        self, q: FloatArray, u: FloatArray, once: FloatArray, twice: FloatArray
    ) -> FloatArray:
        """Derivative of a - f(q, u) by the accelerations at all points, f's own by differences."""
        (n, n_q), f = q.shape, self._accelerations
        matrix = np.zeros((n, n_q, n, n_q))
        for j in range(n_q):
            dq, du = np.zeros(n_q), np.zeros(n_q)
            dq[j], du[j] = 1e-7, 1e-6 * max(1.0, float(np.abs(u).max()))
            by_q = (f(q + dq, u) - f(q - dq, u)) / (2 * dq[j])
            by_u = (f(q, u + du) - f(q, u - du)) / (2 * du[j])
            through_q = by_q[:, :, None] * twice[:, None, :]
            matrix[:, :, :, j] = -(through_q + by_u[:, :, None] * once[:, None, :])
        return matrix.reshape(n * n_q, n * n_q) + np.eye(n * n_q)

    def _accelerations(self, q: FloatArray, u: FloatArray) -> FloatArray:
        return self.equations.solve(q, u, self.closed)[0]


def note_singular_start(equations: Equations, q: FloatArray, u: FloatArray) -> None:
    """Let a motion with speeds start in a singular position (:meth:`RankWatch.begin`)."""
    if not equations.n_loops or not u.any() or equations.rank(q, ()) == equations.n_loops:
        return
    beside = q + 1e-2 * u / np.abs(u).max()
    for rank in range(equations.n_loops, equations.rank(q, ()), -1):
        place = beside
        for _ in range(_ITERATIONS):
            jacobian = equations.constraint_jacobian(place, ())
            place = place - least_step(jacobian, equations.loop_residual(place), rank)
            # Where the rank is less, steps have no bound.
            if not np.abs(place - beside).max() < 1.0:
                break
        moved, left = np.abs(place - beside).max(), np.abs(equations.loop_residual(place)).max()
        if moved < 1e-2 and left < 1e-12 and equations.rank(place, ()) == rank:
            equations.note_rank((), rank)
            return


BESIDE = 1e-3  # of a window's half: as near to a singular position counts as in it
_POLE = 1e-5  # of a window's half


@dataclass(frozen=True)
class SingularPassage:
    """A singular position that the motion went through on its smooth branch."""

    time: float
    """[s]"""
    time_uncertainty: float
    """[s]"""
    uncertainty: float
    """Difference of two polynomials behind it [rad, m of the largest arm's part]."""
    lost: int
    """How many of the independent constraints depend on the others there."""


@dataclass(frozen=True)
class Window:
    """The motion from beside a singular position to beside it again, and the passages in it."""

    start: float
    end: float
    passages: tuple[SingularPassage, ...]
    motion: Polynomial
    forces: FloatArray
    """Legendre series of the multipliers times the distances from all poles."""
    poles: FloatArray
    """Times of all passages, also of those after `end` [s]."""

    def until(self, end: float, releases: bool) -> Window:
        """The part up to `end` [s], where a stop opens or not.

        Raises:
            SimulationError: a stop's torque passes a pole there instead of zero.
        """
        if releases and np.any(np.abs(self.poles - end) < BESIDE * self.motion.half):
            raise SimulationError(
                f"the reference gave up at t = {end:.6g} s: a stop opens in a singular position, "
                "in which its torque grows beyond all bounds."
            )
        passages = tuple(passage for passage in self.passages if passage.time <= end)
        return replace(self, end=end, passages=passages)

    def dense_output(self) -> DenseOutput:
        """Dense output, as that of an integrator's step."""
        return _WindowOutput(self)

    def accelerations(self, t: FloatArray) -> FloatArray:
        """Accelerations of the branch at times t [s], shape (n, n_q)."""
        return self.motion.values(self.motion.a, t)

    def multipliers(self, t: FloatArray) -> FloatArray:
        """Multipliers, shape (n, n_constraints), which grow as 1/(t - time) beside a passage.

        Within a hundred-thousandth of the window the mean of both sides is given: the finite part.
        """
        if not len(self.poles):
            return self.motion.values(self.forces, t)
        near = _POLE * self.motion.half
        pole = self.poles[np.argmin(np.abs(t[:, None] - self.poles), axis=1)]
        inside = np.abs(t - pole) < near
        total = np.zeros((len(t), self.forces.shape[-1]))
        for side in (-1.0, 1.0):
            at = np.where(inside, pole + side * near, t)
            distances = np.prod((at[:, None] - self.poles) / self.motion.half, axis=1)
            total += self.motion.values(self.forces, at) / distances[:, None]
        return 0.5 * total


class _WindowOutput(DenseOutput):
    def __init__(self, window: Window) -> None:
        super().__init__(window.start, window.end)
        self._motion = window.motion

    def _call_impl(self, t: FloatArray) -> FloatArray:
        m = self._motion
        return np.concatenate([m.values(m.q, t), m.values(m.u, t)], axis=-1).T


# Of the largest arm: a change this small ends Newton's iteration; and one where none is smaller.
_ROUNDING, _STALLED = 1e-15, 1e-12


@dataclass(frozen=True)
class Given:
    """The state that a motion has at one time [s]."""

    time: float
    q: FloatArray
    u: FloatArray


@dataclass(frozen=True)
class Polynomial:
    """A motion over a window, twice `half` [s] long: Legendre series on -1 to 1, (n, ...)."""

    start: float
    half: float
    q: FloatArray
    u: FloatArray
    a: FloatArray

    def values(self, series: FloatArray, t: FloatArray) -> FloatArray:
        """A series at times t [s]: shape (*t.shape, ...)."""
        values = legendre.legval((np.asarray(t) - self.start) / self.half - 1.0, series)
        return np.asarray(np.moveaxis(values, 0, -1), dtype=np.float64)


@lru_cache(16)
def gauss(n: int, base: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Gauss's n points, the matrix to Legendre series, and the integrals from `base`, both."""
    points, weights = legendre.leggauss(n)
    x = np.asarray(points, dtype=np.float64)
    to_series = (np.arange(n) + 0.5)[:, None] * legendre.legvander(x, n - 1).T * weights
    integrals = (legendre.legval(x, legendre.legint(to_series, m, lbnd=base)).T for m in (1, 2))
    once, twice = (np.asarray(values, dtype=np.float64) for values in integrals)
    return x, to_series, once, twice
