"""Printed numbers that depend on the start angles, computed at any start, and their statements.

SI units and radians throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field
from scipy.optimize import brentq
from trebucheck.api.engines import ReferenceEngine
from trebucheck.api.mechanics import (
    COUNTERWEIGHT,
    PROJECTILE,
    FloatArray,
    InputError,
    Mechanism,
    NonNegative,
    Positive,
    Problem,
    Projectile,
    Real,
    Solution,
    Spec,
    Surroundings,
    TrebuchetParameters,
    fixed,
    rolling,
)

from ..evidence.claims import (
    BEST_L1,
    BEST_SPEED,
    ENERGY_GAIN,
    LAUNCH_SPEED,
    RATIOS,
    RELEASE_TIME,
    SLING_ANGLE,
    SLING_RADIANS,
    SPEED_GAIN,
    TIME_STEP,
    WAY,
    Printed,
)
from ..evidence.claims import SWING as PRINTED_SWING

Angles = tuple[Real, Real, Real]
"""theta0, phi0, alpha0 [rad]."""


class PrintedQuantity(Spec):
    """A number of the paper that depends on the start angles."""

    name: str
    where: str = Field(description="section of the paper")
    printed: str
    unit: str = Field(description="of the printed number; '' where there is none")
    value: Real = Field(description="[unit]")
    half: Positive = Field(description="half width of what the print allows [unit]")
    because: str = Field(description="what the half width comes from")
    fitted: bool = Field(
        description="False: it follows from others in print, and is only a bound of the set"
    )


class QuantityAt(Spec):
    """A printed number, computed at some start angles."""

    name: str
    computed: Real = Field(description="[its unit]")
    miss: Real = Field(
        description="(computed - printed) in half widths: beyond 1 it does not round to the print"
    )


class Sensitivity(Spec):
    """Derivatives of a number with respect to the start angles."""

    name: str
    per_radian: Angles = Field(description="[its unit per rad]")
    information: Angles = Field(
        description="share of each angle's information, the other angles known, in [0, 1]"
    )


class Extent(Spec):
    """Extent of the compatible set along one angle."""

    angle: str
    low: Real
    high: Real
    ends_low: tuple[str, ...] = Field(description="numbers that end it there")
    ends_high: tuple[str, ...]


class Fit(Spec):
    """Least squares with some angles free and the others held."""

    name: str
    held_because: str = Field(default="", description="why the others are held")
    free: tuple[str, ...]
    angles: Angles
    standard_errors: tuple[NonNegative, ...] = Field(description="of the free angles")
    covariance: tuple[tuple[Real, ...], ...] = Field(description="of the free angles [rad^2]")
    confidence: tuple[tuple[Real, Real], ...] = Field(
        description="95 % intervals of the free angles, each by itself"
    )
    chi_square: NonNegative
    degrees_of_freedom: int
    p_value: Real = Field(
        description="chance of a larger chi square, were the print's rounding all there is"
    )
    figures: tuple[QuantityAt, ...]
    least_worst: NonNegative = Field(
        description="least that the worst miss can be made, in half widths"
    )
    compatible: bool = Field(
        description="whether some angles give every printed figure: least_worst <= 1"
    )
    extents: tuple[Extent, ...] = Field(
        description="of the set of those angles; none where it is empty"
    )


class Conditioning(Spec):
    """Singular values of the Jacobian of the fitted numbers, in standard deviations per radian."""

    singular_values: tuple[Real, ...]
    directions: tuple[Angles, ...] = Field(description="unit vectors, best determined first")
    decided_by: tuple[str, ...] = Field(
        description="the number that says most about each direction"
    )
    rank: int = Field(description="number of directions that the print determines at all")
    condition_number: Positive
    half_lengths: tuple[NonNegative, ...] = Field(
        description="of the joint 95 % region along the directions [rad]"
    )


class Left(Spec):
    """The compatible set without one number."""

    name: str
    growth: tuple[Real | None, ...] = Field(
        description="of its extent along each angle, as a factor, to first order about the fit; "
        "None: without end"
    )


class Round(Spec):
    """Count the start angles on a round grid that are compatible with every printed number."""

    divisions: int = Field(description="n of the grid of multiples of pi / n")
    compatible: tuple[Angles, ...]
    tried: int = Field(description="points of the grid inside the compatible set's extents")


class Minimum(Spec):
    """A minimum of the misfit, from one of the starts of the global search."""

    angles: Angles
    worst: str = Field(description="the number that misses most")
    miss: NonNegative = Field(description="by how many half widths")
    starts: int = Field(description="of the search that led there")


class Search(Spec):
    """The search for other start angles."""

    theta: tuple[Real, Real]
    sling: tuple[Real, Real] = Field(description="range of phi0 - theta0")
    spacing: Positive = Field(description="of the grid of theta0 and phi0 - theta0")
    energy: tuple[Real, Real] = Field(
        description="total energy that speed and R in print allow, which gives alpha0 [J]"
    )
    machines: int = Field(description="launches looked at on the grid")
    starts: int = Field(description="lowest minima of the grid, refined by least squares")
    solutions: tuple[Minimum, ...] = Field(
        description="distinct minima, best first; phi0 within a turn"
    )


class Identification(Spec):
    """The start angles from the paper's printed numbers."""

    parameters: TrebuchetParameters = Field(description="all but the start angles")
    printed: tuple[PrintedQuantity, ...]
    fit: Fit = Field(description="of all three angles")
    nested: tuple[Fit, ...] = Field(
        description="with what the paper's equations fix; none where nothing fits"
    )
    sensitivities: tuple[Sensitivity, ...]
    conditioning: Conditioning
    left_out: tuple[Left, ...] = Field(description="none where nothing fits")
    round_angles: tuple[Round, ...] = Field(description="coarse grids first")
    singled_out: Angles | None = Field(
        description="the one round start that is compatible; None: none or several"
    )
    search: Search | None = Field(description="None: it needs heyoka, which is not installed here")
    findings: tuple[str, ...] = Field(description="in sentences")
    seconds: NonNegative = Field(description="processor time [s]")


Start = Sequence[float] | FloatArray
"""(theta0, phi0, alpha0) [rad]."""

ANGLES = ("theta0", "phi0", "alpha0")
RELEASE, PHI, SPEED, R_FIXED, R_ROLLING = (
    "release time",
    "phi at release",
    "launch speed",
    "R fixed",
    "R rolling",
)
PHI_RADIANS, ENERGY, FASTER = (
    "phi at release, in radians",
    "kinetic energy, rolling / fixed",
    "rolling faster by",
)
SWING, TWICE_SWING = "counterweight swings out further by", "there and back"
SHORTER = "launch speed with the shorter arm"
"""At the l1 of the largest launch speed, the whole arm's length unchanged (Sec. V)."""

# [s] solved past the printed release, and once more as long where a machine launches later.
_BEYOND = 0.3
_SAMPLES = 200  # of the counterweight's swing, between which its turning point is found
_ROUNDED = "half a unit of the last printed digit"


def _fitted(
    name: str,
    where: str,
    number: Printed,
    unit: str = "",
    fitted: bool = True,
    grid: float = 0.0,
    because: str = _ROUNDED,
) -> PrintedQuantity:
    return PrintedQuantity(
        name=name,
        where=where,
        printed=number.digits,
        unit=unit,
        value=number.value,
        half=max(number.half, grid / 2),
        because=because,
        fitted=fitted,
    )


def _implied(name: str, where: str, number: Printed, unit: str = "") -> PrintedQuantity:
    return _fitted(name, where, number, unit, fitted=False)


_SWEPT = f"{_ROUNDED}; l1 = {BEST_L1} is a point of its sweep"
PRINTED = (
    _fitted(
        RELEASE,
        "Sec. IV",
        RELEASE_TIME,
        "s",
        grid=TIME_STEP,
        because=f"half the paper's grid of {TIME_STEP} s",
    ),
    _fitted(PHI, "Sec. IV", SLING_ANGLE, "deg"),
    _implied(PHI_RADIANS, "Sec. IV", SLING_RADIANS, "rad"),
    _fitted(SPEED, "Sec. V", LAUNCH_SPEED, "m/s"),
    _fitted(SHORTER, "Sec. V", BEST_SPEED, "m/s", because=_SWEPT),
    _fitted(R_FIXED, "Sec. VI", RATIOS["fixed"]),
    _fitted(R_ROLLING, "Sec. VI", RATIOS["rolling"]),
    _implied(ENERGY, "Sec. VI", ENERGY_GAIN),
    _implied(FASTER, "Sec. VI", SPEED_GAIN, "m/s"),
    _fitted(SWING, "Sec. VI", PRINTED_SWING, "m"),
    _implied(TWICE_SWING, "Sec. VI", WAY, "m"),
)
"""Printed numbers to fit; none repeats, doubles or follows from another one."""

NEEDED = (RELEASE, PHI, SPEED, R_FIXED, R_ROLLING, SHORTER)
"""Without these there is no search and no bounded fit."""


def machines(
    parameters: TrebuchetParameters, angles: Start
) -> tuple[Mechanism, Mechanism, Mechanism]:
    """Fixed, rolling, and fixed with the shorter arm, started at (theta0, phi0, alpha0) [rad].

    Raises:
        InputError: an angle is not in range, or the whole arm is not longer than the shorter arm's
            l1.
    """
    fields = parameters.model_dump() | dict(
        zip(ANGLES, (float(angle) for angle in angles), strict=True)
    )
    beam = fields["l1"] + fields.pop("l2")
    shorter = TrebuchetParameters.with_beam(**fields | {"l1": BEST_L1.value, "beam": beam})
    started = TrebuchetParameters(**fields, l2=parameters.l2)
    return fixed(started), rolling(started), fixed(shorter)


@dataclass
class Headlines:
    """Misses of the printed numbers as functions of the start angles, each start computed once."""

    parameters: TrebuchetParameters
    printed: tuple[PrintedQuantity, ...] = PRINTED
    _known: dict[Angles, FloatArray] = field(default_factory=dict[Angles, FloatArray])

    def __post_init__(self) -> None:
        names, known = (
            [quantity.name for quantity in self.printed],
            [quantity.name for quantity in PRINTED],
        )
        wrong = sorted(name for name in set(names) if name not in known or names.count(name) > 1)
        missing = [name for name in NEEDED if name not in names]
        if wrong or missing:
            raise InputError(
                f"printed holds {names!r}; each of {NEEDED} must be there, and others of "
                f"{tuple(known)}, all but once."
            )

    def misses(self, angles: Start) -> FloatArray:
        """(computed - printed) in half widths, shape (n,).

        Raises:
            InputError: a machine does not launch from there.
        """
        key = (float(angles[0]), float(angles[1]), float(angles[2]))
        if key not in self._known:
            values = computed(self.parameters, key, self.release_time)
            self._known[key] = np.array([(values[f.name] - f.value) / f.half for f in self.printed])
        return self._known[key]

    def jacobian(self, angles: Start, step: float = 1e-5) -> FloatArray:
        """Jacobian of the misses [1/rad], shape (n, 3), by central differences."""
        at = np.asarray(angles, dtype=np.float64)
        columns = [
            (self.misses(at + d) - self.misses(at - d)) / (2 * step) for d in np.eye(3) * step
        ]
        return np.stack(columns, axis=1)

    @property
    def release_time(self) -> float:
        """Release time as printed [s]: phi is given for that instant."""
        return next(quantity.value for quantity in self.printed if quantity.name == RELEASE)

    @property
    def fitted(self) -> list[int]:
        """Indices of the numbers that count in a least squares fit."""
        return [i for i, quantity in enumerate(self.printed) if quantity.fitted]


def computed(
    parameters: TrebuchetParameters, angles: Start, release_time: float
) -> dict[str, float]:
    """Numbers of :data:`PRINTED` at a start, in their printed units.

    Raises:
        InputError: a machine does not launch within about twice the printed release time.
    """
    still, rolls, shorter = (
        _moved(m, release_time + _BEYOND) for m in machines(parameters, angles)
    )
    speeds = [_speed(solution) for solution in (still, rolls, shorter)]
    mass = parameters.m_b
    energy = float(still.trajectory(np.zeros(1)).total_energy[0])
    phi = float(
        still.motion(np.array([release_time])).q[
            0, still.problem.mechanism.coordinates.index("phi")
        ]
    )
    swing = _rightmost(still) - _rightmost(rolls)
    return {
        RELEASE: _best_release(still),
        PHI: math.degrees(phi),
        PHI_RADIANS: phi,
        SPEED: speeds[0],
        SHORTER: speeds[2],
        R_FIXED: 0.5 * mass * speeds[0] ** 2 / energy,  # Eq. (11)
        R_ROLLING: 0.5 * mass * speeds[1] ** 2 / energy,
        ENERGY: (speeds[1] / speeds[0]) ** 2,
        FASTER: speeds[1] - speeds[0],
        SWING: swing,
        TWICE_SWING: 2 * swing,
    }


def _moved(mechanism: Mechanism, duration: float) -> Solution:
    # Taylor series where heyoka is: several times as fast.
    reference = ReferenceEngine(integrator="auto")
    solution = reference.solve(Problem(mechanism, duration))
    return solution if solution.launch else reference.solve(Problem(mechanism, 2 * duration))


def _speed(solution: Solution) -> float:
    if solution.launch is None:
        mechanism = solution.problem.mechanism
        raise InputError(
            f"the {mechanism.name!r} machine started at {mechanism.start!r} does not launch within "
            f"{solution.problem.duration:.6g} s, so the paper's numbers of a launch are not there."
        )
    return solution.launch.speed


def _best_release(solution: Solution) -> float:
    """Range-optimal, in vacuum [s]."""
    projectile = Projectile(solution, PROJECTILE)
    until = min(projectile.sweep()[1], solution.problem.duration)
    best = projectile.best_release(Surroundings(gravity=solution.problem.mechanism.gravity), until)
    if best is None:
        raise InputError(
            f"the {solution.problem.mechanism.name!r} machine's throw never comes back to y = 0."
        )
    return best.time


def _rightmost(solution: Solution) -> float:
    """Largest x of the counterweight up to the launch [m]: where it turns back."""
    kinematics, launch = solution.equations.kinematics, solution.launch
    assert launch is not None  # the launch speed has been read before
    marker = next(m for m in solution.problem.mechanism.markers if m.name == COUNTERWEIGHT)
    row = kinematics.point(marker.body, marker.point)

    def x(t: FloatArray) -> FloatArray:
        return kinematics.position(row, solution.motion(t).q)[:, 0]

    def rate(t: float) -> float:
        motion = solution.motion(np.array([t]))
        return float(kinematics.velocity(row, motion.q, motion.u)[0, 0])

    times = np.linspace(0.0, launch.time, _SAMPLES)
    positions = x(times)
    i = int(np.argmax(positions))
    if not 0 < i < _SAMPLES - 1:
        return float(positions[i])
    turn = brentq(rate, float(times[i - 1]), float(times[i + 1]), xtol=1e-12)
    return float(x(np.array([turn]))[0])
