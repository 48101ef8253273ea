"""The start angles the paper does not print, identified from the numbers it does.

Whether other starts would give the paper's numbers, too, is searched over all that the energy
allows: launch speed and R in print give the total energy, E = m_b v^2 / (2 R) (Eq. 11), and that is
a function of the start angles alone (Eqs. 3, 4): it leaves two values of alpha0 for any theta0 and
phi0. So a grid in two angles covers all three. Its lowest minima are refined by least squares in
all three.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares
from trebucheck.api.mechanics import (
    EngineNotInstalledError,
    FloatArray,
    InputError,
    Mechanism,
    TrebuchetParameters,
    fixed,
)

from ..evidence.claims import TIME_STEP
from .fit import conditioning, fit, left_out
from .quantities import (
    ANGLES,
    NEEDED,
    PHI,
    PRINTED,
    R_FIXED,
    RELEASE,
    SPEED,
    Angles,
    Conditioning,
    Fit,
    Headlines,
    Identification,
    Left,
    Minimum,
    PrintedQuantity,
    Round,
    Search,
    Sensitivity,
    machines,
)

THETA = (-math.pi / 2, math.pi / 2)
"""The arm points in the direction of the launch (Sec. I)."""

_CELLS = 30  # of half a turn: 6 deg, which change a launch's values by some tenths
_STARTS = 8
_BEYOND = 0.3  # [s] past the printed release time; later releases miss by over 40 half widths
_PATIENCE = 2.0  # times as long for the machines whose time of launch is not printed
_LOST = 1e4  # half widths: the miss of a machine that does not launch
_NEAR = 0.4  # [rad] radius of a start's refinement, some four cells of the grid
_SAME = 1e-3  # [rad] minima closer than this are one


def search(headlines: Headlines) -> Search | None:
    """Look everywhere; None where heyoka, which makes it fast enough, is not installed.

    Raises:
        InputError: no start angles have the energy in print, or none of those launches.
    """
    try:
        return _Search(headlines).run()
    except EngineNotInstalledError:
        return None


class _Search:
    def __init__(self, headlines: Headlines) -> None:
        self.headlines = headlines
        self.parameters = headlines.parameters
        self.printed = {quantity.name: quantity for quantity in headlines.printed}
        self.machines = 0

    def run(self) -> Search:
        step = math.pi / _CELLS
        thetas = np.linspace(*THETA, _CELLS + 1)
        # At 0 and 2 pi the sling would lie on the arm's far side.
        slings = step * np.arange(1.0, 2 * _CELLS)
        starts = np.stack([self._branch(thetas, slings, lower) for lower in (False, True)])
        costs = self._costs(starts)
        # Neighbours in theta0 and the sling's angle; the two values of alpha0 are branches of their
        # own.
        lowest = (costs <= minimum_filter(costs, size=(1, 3, 3), mode="nearest")) & (costs < _LOST)
        chosen = starts[lowest][np.argsort(costs[lowest], kind="stable")][:_STARTS]
        if not len(chosen):
            raise InputError(
                "no start angles that have the printed energy launch in the printed time."
            )
        return Search(
            theta=THETA,
            sling=(float(slings[0]), float(slings[-1])),
            spacing=step,
            energy=self._energies(),
            machines=self.machines,
            starts=len(chosen),
            solutions=self._distinct([self._refined(start) for start in chosen]),
        )

    def _energies(self) -> tuple[float, float]:
        v, ratio, half_mass = self.printed[SPEED], self.printed[R_FIXED], 0.5 * self.parameters.m_b
        least = half_mass * (v.value - v.half) ** 2 / (ratio.value + ratio.half)
        return least, half_mass * (v.value + v.half) ** 2 / (ratio.value - ratio.half)

    def _branch(self, thetas: FloatArray, slings: FloatArray, lower: bool) -> FloatArray:
        """Starts of the printed energy, shape (n_theta, n_sling, 3); NaN in alpha0 if none."""
        p = self.parameters
        theta, sling = np.meshgrid(thetas, slings, indexing="ij")
        phi = theta + sling
        energy = 0.5 * p.m_b * self.printed[SPEED].value ** 2 / self.printed[R_FIXED].value
        # Eqs. (3), (4): E / g = m_cw (l2 sin theta - h sin alpha) - m_b (l1 sin theta + r sin phi)
        # - m_a d sin theta.
        rest = p.m_b * (p.l1 * np.sin(theta) + p.r * np.sin(phi)) + p.m_a * (
            p.l1 - p.l2
        ) / 2 * np.sin(theta)
        sine = (p.m_cw * p.l2 * np.sin(theta) - rest - energy / p.g) / (p.m_cw * p.h)
        alpha = np.arcsin(np.where(np.abs(sine) <= 1, sine, np.nan))
        return np.stack([theta, phi, -math.pi - alpha if lower else alpha], axis=-1)

    def _costs(self, starts: FloatArray) -> FloatArray:
        """Root mean square misses of the fixed machine alone, at every start that has an alpha0."""
        costs = np.full(starts.shape[:-1], np.inf)
        feasible = np.isfinite(starts[..., 2])
        misses = self._fixed_misses(starts[feasible])
        costs[feasible] = np.sqrt(np.mean(misses**2, axis=1))
        return costs

    def _fixed_misses(self, starts: FloatArray) -> FloatArray:
        """Misses of time, phi, speed and R, shape (n, 4)."""
        builds = [fixed(self._started(start)) for start in starts.tolist()]
        time, phi, speed = self._launches(builds, self.printed[RELEASE].value + _BEYOND)
        values = {RELEASE: time, PHI: phi, SPEED: speed, R_FIXED: self._ratio(starts, speed)}
        return np.stack(
            [self._miss(self.printed[name], value) for name, value in values.items()], axis=1
        )

    def _started(self, angles: Sequence[float]) -> TrebuchetParameters:
        return self.parameters.model_copy(update=dict(zip(ANGLES, angles, strict=True)))

    def _launches(
        self, builds: Sequence[Mechanism], until: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time [s], phi at the printed release [deg] and speed [m/s] at 45 deg, each (n,)."""
        from trebucheck.api.mechanics import launch_batch

        self.machines += len(builds)
        batch = launch_batch(builds, duration=until)
        # A step or two: there phi is a straight line.
        late = np.clip(self.printed[RELEASE].value - batch.time, -TIME_STEP, TIME_STEP)
        return batch.time, np.degrees(batch.q[:, 1] + batch.u[:, 1] * late), batch.speed

    def _ratio(self, starts: FloatArray, speed: FloatArray) -> FloatArray:
        p, (theta, phi, alpha) = self.parameters, starts.T
        energy = p.g * (
            p.m_cw * (p.l2 * np.sin(theta) - p.h * np.sin(alpha))
            - p.m_b * (p.l1 * np.sin(theta) + p.r * np.sin(phi))
            - p.m_a * (p.l1 - p.l2) / 2 * np.sin(theta)
        )
        return 0.5 * p.m_b * speed**2 / energy

    def _miss(self, quantity: PrintedQuantity, value: FloatArray) -> FloatArray:
        """Misses in half widths; phi within a turn, as the paper chooses how phi0 counts turns."""
        error = value - quantity.value
        if quantity.name == PHI:
            error = np.remainder(error + 180.0, 360.0) - 180.0
        # The launch at 45 deg stands for the best release, one grid step from it at most.
        half = quantity.half + (TIME_STEP if quantity.name == RELEASE else 0.0)
        return np.nan_to_num(error / half, nan=_LOST)

    def _quick(self, starts: FloatArray) -> FloatArray:
        """Misses of all numbers of a launch at 45 deg, of all three machines, shape (n, 6)."""
        trios = [machines(self.parameters, start) for start in starts]
        alike = [trio[0] for trio in trios] + [trio[2] for trio in trios]
        n, until = len(starts), _PATIENCE * self.printed[RELEASE].value
        time, phi, speed = self._launches(alike, until)
        _, _, rolling_speed = self._launches([trio[1] for trio in trios], until)
        values = (
            time[:n],
            phi[:n],
            speed[:n],
            self._ratio(starts, speed[:n]),
            self._ratio(starts, rolling_speed),
            speed[n:],
        )
        return np.stack(
            [self._miss(self.printed[k], v) for k, v in zip(NEEDED, values, strict=True)], axis=1
        )

    def _refined(self, start: FloatArray) -> FloatArray:
        def misses(x: FloatArray) -> FloatArray:
            return self._quick(x[None])[0]

        def jacobian(x: FloatArray) -> FloatArray:
            h = 1e-5
            both = self._quick(np.concatenate([x + h * np.eye(3), x - h * np.eye(3)]))
            return (both[:3] - both[3:]).T / (2 * h)

        # Soft, so that a start far off is not led by the one figure that is printed with most
        # digits.
        solver: Callable[..., Any] = least_squares
        near = (start - _NEAR, start + _NEAR)
        fitted = solver(
            misses,
            start,
            jacobian,
            near,
            x_scale="jac",
            loss="soft_l1",
            max_nfev=25,
            xtol=1e-6,
            ftol=1e-6,
        )
        return np.asarray(fitted.x, dtype=np.float64)

    def _distinct(self, minima: Sequence[FloatArray]) -> tuple[Minimum, ...]:
        kept: list[tuple[FloatArray, int]] = []
        for angles in minima:
            same = [i for i, (other, _) in enumerate(kept) if np.abs(angles - other).max() < _SAME]
            if same:
                kept[same[0]] = (kept[same[0]][0], kept[same[0]][1] + 1)
            else:
                kept.append((angles, 1))
        solutions = [self._solution(angles, n) for angles, n in kept]
        # Where one of the three machines does not launch, there is no minimum, only an end of the
        # search.
        return tuple(
            sorted((s for s in solutions if s.miss < _LOST), key=lambda solution: solution.miss)
        )

    def _solution(self, angles: FloatArray, starts: int) -> Minimum:
        misses = np.abs(self._quick(angles[None])[0])
        worst = int(np.argmax(misses))
        theta, phi, alpha = angles.tolist()
        return Minimum(
            angles=(theta, phi, alpha),
            worst=NEEDED[worst],
            miss=float(misses[worst]),
            starts=starts,
        )


_DIVISIONS = (1, 2, 3, 4, 6, 12, 36, 180, 360, 720)  # of pi: down to quarters of a degree
_AT_MOST = 30  # round starts tried; a set wide enough to hold more singles out nothing
_GROWS = 1.05  # a set that grows by less than this without a figure does not hang on it


def identify(
    parameters: TrebuchetParameters | None = None,
    printed: Sequence[PrintedQuantity] = PRINTED,
    globally: bool = True,
) -> Identification:
    """Fit (theta0, phi0, alpha0) to printed figures, and say what they leave open.

    The rests stand where the machine starts (the paper's Eqs. 6, 7), and a rest that would have to
    pull at the start is gone then. With `globally`, and heyoka installed, the fit starts from the
    best point of a search over all starts of the printed energy, and no use is made of the angles
    in `parameters`; else it starts from those.

    Args:
        parameters: lengths, masses and gravity; Table I where left out.
        printed: what is fitted; the names are those of :data:`.quantities.PRINTED`.
        globally: whether to search.

    Raises:
        InputError: the figures are too few or too vague to bound the angles, or no machine with
        them launches.
        SimulationError: an integrator failed.
    """
    started = time.process_time()
    headlines = Headlines(parameters or TrebuchetParameters(), tuple(printed))
    searched = search(headlines) if globally else None
    free = fit(headlines, _start(headlines, searched), name="all three angles")
    slopes = headlines.jacobian(free.angles)
    of_fitted = conditioning(
        slopes[headlines.fitted], [f.name for f in headlines.printed if f.fitted]
    )
    nested = tuple(_nested(headlines, free)) if free.compatible else ()
    rounds = tuple(_rounds(headlines, free))
    single = _single(rounds)
    left = left_out(headlines, np.array(free.angles)) if free.compatible else ()
    return Identification(
        parameters=headlines.parameters,
        printed=headlines.printed,
        fit=free,
        nested=nested,
        sensitivities=_sensitivities(headlines, slopes),
        conditioning=of_fitted,
        left_out=left,
        round_angles=rounds,
        singled_out=single,
        search=searched,
        findings=tuple(_findings(free, of_fitted, left, rounds, single, nested, searched)),
        seconds=time.process_time() - started,
    )


def _start(headlines: Headlines, searched: Search | None) -> Angles:
    if searched is None or not searched.solutions:
        p = headlines.parameters
        return (p.theta0, p.phi0, p.alpha0)
    theta, phi, alpha = searched.solutions[0].angles
    # The search compares phi within a turn; the print says how many turns phi0 is counted with.
    at = next(i for i, quantity in enumerate(headlines.printed) if quantity.name == PHI)
    off = float(headlines.misses((theta, phi, alpha))[at]) * headlines.printed[at].half
    return (theta, phi - math.radians(360.0 * round(off / 360.0)), alpha)


def _nested(headlines: Headlines, free: Fit) -> Iterator[Fit]:
    """Nested fits: with the paper's Eq. (6) at t = 0, then with its sling rest on the arm."""
    _, phi, alpha = free.angles
    level = "Eq. (6) at t = 0, theta - phi + phi[0] = 0 with phi = phi[0], leaves theta0 = 0"
    yield fit(headlines, (0.0, phi, alpha), ("phi0", "alpha0"), name="theta0 = 0", because=level)
    along = math.pi + 2 * math.pi * round((phi - math.pi) / (2 * math.pi))
    on_arm = f"{level}; and the sling rests on the arm itself, phi0 - theta0 = pi (Sec. II)"
    yield fit(
        headlines, (0.0, along, alpha), ("alpha0",), name="theta0 = 0, phi0 = pi", because=on_arm
    )


def _sensitivities(headlines: Headlines, slopes: FloatArray) -> tuple[Sensitivity, ...]:
    shares = np.zeros_like(slopes)
    shares[headlines.fitted] = slopes[headlines.fitted] ** 2
    shares /= shares.sum(axis=0)
    halves = np.array([quantity.half for quantity in headlines.printed])
    per_radian = (slopes * halves[:, None]).tolist()
    rows = zip(headlines.printed, per_radian, shares.tolist(), strict=True)
    return tuple(
        Sensitivity(name=f.name, per_radian=tuple(row), information=tuple(share))
        for f, row, share in rows
    )


def _rounds(headlines: Headlines, free: Fit) -> Iterator[Round]:
    """Multiples of pi / n inside the compatible set's extents, computed, up to too many."""
    if not free.compatible:
        return
    for n in _DIVISIONS:
        unit = math.pi / n
        spans = [
            range(math.ceil(e.low / unit), math.floor(e.high / unit) + 1) for e in free.extents
        ]
        if math.prod(len(span) for span in spans) > _AT_MOST:
            return
        tried: list[Angles] = [
            (i * unit, j * unit, k * unit) for i in spans[0] for j in spans[1] for k in spans[2]
        ]
        fitting = tuple(angles for angles in tried if _compatible(headlines, angles))
        yield Round(divisions=n, compatible=fitting, tried=len(tried))


def _compatible(headlines: Headlines, angles: Angles) -> bool:
    try:
        return bool(np.abs(headlines.misses(angles)).max() <= 1.0)
    except InputError:  # it does not launch
        return False


def _single(rounds: Sequence[Round]) -> Angles | None:
    """The one compatible start of the coarsest grid that has any."""
    first = next((r for r in rounds if r.compatible), None)
    return first.compatible[0] if first and len(first.compatible) == 1 else None


def _findings(
    free: Fit,
    of_fitted: Conditioning,
    left: Sequence[Left],
    rounds: Sequence[Round],
    single: Angles | None,
    nested: Sequence[Fit],
    searched: Search | None,
) -> Iterator[str]:
    if not free.compatible:
        yield (
            "no start angles give every printed figure: at best one of them is "
            f"{free.least_worst:.3g} half widths off"
        )
        return
    widths = [math.degrees(e.high - e.low) for e in free.extents]
    yield (
        f"every printed figure comes out for start angles in a set {_listed(ANGLES, widths)} wide: "
        "a thin valley, as the worst determined combination "
        f"({_direction(of_fitted.directions[-1])}) is known {of_fitted.condition_number:.3g} times "
        f"less well than the best ({_direction(of_fitted.directions[0])})"
    )
    decided = zip(of_fitted.directions, of_fitted.decided_by, strict=True)
    yield "; ".join(
        f"{_direction(direction)} is decided above all by the {name}" for direction, name in decided
    )
    yield from _bearing(left)
    yield from _round_findings(rounds, single)
    for each in nested:
        ends = [
            f"{e.angle} from {math.degrees(e.low):.6g} to {math.degrees(e.high):.6g} deg"
            for e in each.extents
        ]
        what = "; ".join(ends) if each.compatible else "nothing: a figure is then off"
        yield f"with {each.name} ({each.held_because}) there is left: {what}"
    if searched is not None:
        others = searched.solutions[1:]
        following = (
            f"; the next minimum misses {others[0].worst} by {others[0].miss:.3g} half widths"
            if others
            else ""
        )
        yield (
            f"{searched.machines} launches over all starts of the printed energy, theta0 within "
            f"{math.degrees(searched.theta[1]):.3g} deg of level, show no second set{following}"
            if not any(s.miss <= 1 for s in others)
            else f"the search finds {1 + sum(s.miss <= 1 for s in others)} separate sets of start "
            "angles"
        )


def _bearing(left: Sequence[Left]) -> Iterator[str]:
    """Figures that the set's ends hang on."""
    growths = {each.name: max(math.inf if g is None else g for g in each.growth) for each in left}
    bearing = sorted(
        (name for name, growth in growths.items() if growth >= _GROWS),
        key=lambda name: -growths[name],
    )
    if bearing:
        parts = ", ".join(
            f"{name} ({growths[name]:.3g} times as wide without it)" for name in bearing
        )
        yield f"the set is bounded by: {parts}; the other figures only agree"


def _round_findings(rounds: Sequence[Round], single: Angles | None) -> Iterator[str]:
    if single is None:
        yield "no one round start is singled out"
        return
    alone = [r for r in rounds if len(r.compatible) == 1]
    coarse, fine = alone[0].divisions, max(r.divisions for r in alone)
    degrees = ", ".join(f"{math.degrees(angle):g}" for angle in single)
    yield (
        f"among multiples of pi / {coarse} it holds one point, ({degrees}) deg, and no other among "
        f"multiples of {180 / fine:g} deg"
    )


def _listed(names: Sequence[str], degrees: Sequence[float]) -> str:
    return ", ".join(
        f"{value:.3g} deg in {name}" for name, value in zip(names, degrees, strict=True)
    )


def _direction(vector: Angles) -> str:
    terms = [
        f"{'+' if value >= 0 else '-'} {abs(value):.2f} {name}"
        for name, value in zip(ANGLES, vector, strict=True)
    ]
    return " ".join(terms).removeprefix("+ ")
