"""Whether other start angles would give the paper's figures, too: a search over all that the energy allows.

Launch speed and R in print give the total energy, E = m_b v^2 / (2 R) (Eq. 11), and that is a function of the start
angles alone (Eqs. 3, 4): it leaves two values of alpha0 for any theta0 and phi0. So a grid in two angles covers all
three. Its lowest minima are refined by least squares in all three.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares

from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError, InputError
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.trebuchet import fixed
from ...models.mechanism import Mechanism
from .quantities import ANGLES, GRID, NEEDED, PHI, R_FIXED, RELEASE, SPEED, Headlines, machines
from .results import PrintedFigure, Search, Solution

THETA = (-math.pi / 2, math.pi / 2)
"""The arm points in the direction of the launch (Sec. I)."""

_DIVISIONS = 30  # of half a turn: 6 deg, over which the figures of a launch change by some tenths of themselves
_STARTS = 8
_BEYOND = 0.3  # [s] past the printed release time; a fixed machine that takes longer misses by 40 half widths and more
_PATIENCE = 2.0  # times as long for the machines whose time of launch is not printed
_LOST = 1e4  # half widths: the miss of a machine that does not launch
_NEAR = 0.4  # [rad] a start is refined within this, some four cells of the grid: what lies beyond has its own starts
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
        self.printed = {figure.name: figure for figure in headlines.printed}
        self.machines = 0

    def run(self) -> Search:
        step = math.pi / _DIVISIONS
        thetas = np.linspace(*THETA, _DIVISIONS + 1)
        slings = step * np.arange(1.0, 2 * _DIVISIONS)  # at 0 and 2 pi the sling would lie on the arm's far side
        starts = np.stack([self._branch(thetas, slings, lower) for lower in (False, True)])
        costs = self._costs(starts)
        # Neighbours in theta0 and the sling's angle; the two values of alpha0 are branches of their own.
        lowest = (costs <= minimum_filter(costs, size=(1, 3, 3), mode="nearest")) & (costs < _LOST)
        chosen = starts[lowest][np.argsort(costs[lowest], kind="stable")][:_STARTS]
        if not len(chosen):
            raise InputError("no start angles that have the printed energy launch in the printed time.")
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
        """Starts of the printed energy, shape (n_theta, n_sling, 3); NaN in alpha0 where there is none."""
        p = self.parameters
        theta, sling = np.meshgrid(thetas, slings, indexing="ij")
        phi = theta + sling
        energy = 0.5 * p.m_b * self.printed[SPEED].value ** 2 / self.printed[R_FIXED].value
        # Eqs. (3), (4): E / g = m_cw (l2 sin theta - h sin alpha) - m_b (l1 sin theta + r sin phi) - m_a d sin theta.
        rest = p.m_b * (p.l1 * np.sin(theta) + p.r * np.sin(phi)) + p.m_a * (p.l1 - p.l2) / 2 * np.sin(theta)
        sine = (p.m_cw * p.l2 * np.sin(theta) - rest - energy / p.g) / (p.m_cw * p.h)
        alpha = np.arcsin(np.where(np.abs(sine) <= 1, sine, np.nan))
        return np.stack([theta, phi, -math.pi - alpha if lower else alpha], axis=-1)

    def _costs(self, starts: FloatArray) -> FloatArray:
        """Root mean square misses of the fixed machine alone, at every start that has an alpha0."""
        costs = np.full(starts.shape[:-1], np.inf)
        there = np.isfinite(starts[..., 2])
        misses = self._fixed_misses(starts[there])
        costs[there] = np.sqrt(np.mean(misses**2, axis=1))
        return costs

    def _fixed_misses(self, starts: FloatArray) -> FloatArray:
        """Of time, phi, speed and R, shape (n, 4)."""
        builds = [fixed(self._started(start)) for start in starts.tolist()]
        time, phi, speed = self._launches(builds, self.printed[RELEASE].value + _BEYOND)
        found = {RELEASE: time, PHI: phi, SPEED: speed, R_FIXED: self._ratio(starts, speed)}
        return np.stack([self._miss(self.printed[name], value) for name, value in found.items()], axis=1)

    def _started(self, angles: Sequence[float]) -> TrebuchetParameters:
        return self.parameters.model_copy(update=dict(zip(ANGLES, angles, strict=True)))

    def _launches(self, builds: Sequence[Mechanism], until: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time [s], phi at the printed release time [deg] and speed [m/s] of launches at 45 deg, each (n,)."""
        from ...reference.taylor.solve import launch_batch  # heyoka takes a second to import

        self.machines += len(builds)
        found = launch_batch(builds, duration=until)
        late = np.clip(
            self.printed[RELEASE].value - found.time, -GRID, GRID
        )  # a step or two: there phi is a straight line
        return found.time, np.degrees(found.q[:, 1] + found.u[:, 1] * late), found.speed

    def _ratio(self, starts: FloatArray, speed: FloatArray) -> FloatArray:
        p, (theta, phi, alpha) = self.parameters, starts.T
        energy = p.g * (
            p.m_cw * (p.l2 * np.sin(theta) - p.h * np.sin(alpha))
            - p.m_b * (p.l1 * np.sin(theta) + p.r * np.sin(phi))
            - p.m_a * (p.l1 - p.l2) / 2 * np.sin(theta)
        )
        return 0.5 * p.m_b * speed**2 / energy

    def _miss(self, figure: PrintedFigure, value: FloatArray) -> FloatArray:
        """In half widths. Phi is compared within a turn: how many turns phi0 is counted with is the paper's choice."""
        apart = value - figure.value
        if figure.name == PHI:
            apart = np.remainder(apart + 180.0, 360.0) - 180.0
        # The launch at 45 deg stands for the best release, one grid step from it at most.
        half = figure.half + (GRID if figure.name == RELEASE else 0.0)
        return np.nan_to_num(apart / half, nan=_LOST)

    def _quick(self, starts: FloatArray) -> FloatArray:
        """Misses of all figures that a launch at 45 deg gives, of all three machines, shape (n, 6)."""
        trios = [machines(self.parameters, start) for start in starts]
        alike = [trio[0] for trio in trios] + [trio[2] for trio in trios]
        n, until = len(starts), _PATIENCE * self.printed[RELEASE].value
        time, phi, speed = self._launches(alike, until)
        _, _, rolling_speed = self._launches([trio[1] for trio in trios], until)
        found = (
            time[:n], phi[:n], speed[:n], self._ratio(starts, speed[:n]), self._ratio(starts, rolling_speed), speed[n:],
        )  # fmt: skip
        return np.stack([self._miss(self.printed[k], v) for k, v in zip(NEEDED, found, strict=True)], axis=1)

    def _refined(self, start: FloatArray) -> FloatArray:
        def misses(x: FloatArray) -> FloatArray:
            return self._quick(x[None])[0]

        def jacobian(x: FloatArray) -> FloatArray:
            h = 1e-5
            both = self._quick(np.concatenate([x + h * np.eye(3), x - h * np.eye(3)]))
            return (both[:3] - both[3:]).T / (2 * h)

        # Soft, so that a start far off is not led by the one figure that is printed with most digits.
        solver: Callable[..., Any] = least_squares
        near = (start - _NEAR, start + _NEAR)
        found = solver(misses, start, jacobian, near, x_scale="jac", loss="soft_l1", max_nfev=25, xtol=1e-6, ftol=1e-6)
        return np.asarray(found.x, dtype=np.float64)

    def _distinct(self, found: Sequence[FloatArray]) -> tuple[Solution, ...]:
        kept: list[tuple[FloatArray, int]] = []
        for angles in found:
            same = [i for i, (other, _) in enumerate(kept) if np.abs(angles - other).max() < _SAME]
            if same:
                kept[same[0]] = (kept[same[0]][0], kept[same[0]][1] + 1)
            else:
                kept.append((angles, 1))
        solutions = [self._solution(angles, n) for angles, n in kept]
        # Where one of the three machines does not launch, there is no minimum, only an end of the search.
        return tuple(sorted((s for s in solutions if s.miss < _LOST), key=lambda solution: solution.miss))

    def _solution(self, angles: FloatArray, starts: int) -> Solution:
        misses = np.abs(self._quick(angles[None])[0])
        worst = int(np.argmax(misses))
        theta, phi, alpha = angles.tolist()
        return Solution(angles=(theta, phi, alpha), worst=NEEDED[worst], miss=float(misses[worst]), starts=starts)
