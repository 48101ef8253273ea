"""What the paper's printed figures say about its start angles, as data; SI units and radians throughout."""

from __future__ import annotations

from pydantic import Field

from ...models.machines.parameters import TrebuchetParameters
from ...models.spec import NonNegative, Positive, Real, Spec

Angles = tuple[Real, Real, Real]
"""theta0, phi0, alpha0 [rad]."""


class PrintedFigure(Spec):
    """A number of the paper that depends on the start angles."""

    name: str
    where: str = Field(description="section of the paper")
    printed: str
    unit: str = Field(description="of the printed number; '' where there is none")
    value: Real = Field(description="[unit]")
    half: Positive = Field(description="half width of what the print allows [unit]")
    because: str = Field(description="what the half width comes from")
    fitted: bool = Field(description="False: it follows from others in print, and is only a bound of the set")


class FigureAt(Spec):
    """A printed figure, computed at some start angles."""

    name: str
    computed: Real = Field(description="[its unit]")
    miss: Real = Field(description="(computed - printed) in half widths: beyond 1 it does not round to the print")


class Sensitivity(Spec):
    """How a figure moves with the start angles."""

    name: str
    per_radian: Angles = Field(description="[its unit per rad]")
    information: Angles = Field(description="share of each angle's information, the other angles known, in [0, 1]")


class Extent(Spec):
    """How far the compatible set reaches along one angle."""

    angle: str
    low: Real
    high: Real
    ends_low: tuple[str, ...] = Field(description="figures that end it there")
    ends_high: tuple[str, ...]


class Fit(Spec):
    """Least squares with some angles free and the others held."""

    name: str
    held_because: str = Field(default="", description="why the others are held")
    free: tuple[str, ...]
    angles: Angles
    standard_errors: tuple[NonNegative, ...] = Field(description="of the free angles")
    covariance: tuple[tuple[Real, ...], ...] = Field(description="of the free angles [rad^2]")
    confidence: tuple[tuple[Real, Real], ...] = Field(description="95 % intervals of the free angles, each by itself")
    chi_square: NonNegative
    degrees_of_freedom: int
    p_value: Real = Field(description="chance of a larger chi square, were the print's rounding all there is")
    figures: tuple[FigureAt, ...]
    least_worst: NonNegative = Field(description="least that the worst miss can be made, in half widths")
    compatible: bool = Field(description="whether some angles give every printed figure: least_worst <= 1")
    extents: tuple[Extent, ...] = Field(description="of the set of those angles; none where it is empty")


class Conditioning(Spec):
    """Singular values of the Jacobian of the fitted figures, in standard deviations per radian."""

    singular_values: tuple[Real, ...]
    directions: tuple[Angles, ...] = Field(description="unit vectors, best determined first")
    decided_by: tuple[str, ...] = Field(description="the figure that says most about each direction")
    rank: int = Field(description="number of directions that the print determines at all")
    condition_number: Positive
    half_lengths: tuple[NonNegative, ...] = Field(description="of the joint 95 % region along the directions [rad]")


class Left(Spec):
    """The compatible set without one figure."""

    name: str
    growth: tuple[Real | None, ...] = Field(
        description="of its extent along each angle, as a factor, to first order about the fit; None: without end"
    )


class Round(Spec):
    """How many start angles on a round grid are compatible with every printed figure."""

    divisions: int = Field(description="n of the grid of multiples of pi / n")
    compatible: tuple[Angles, ...]
    tried: int = Field(description="points of the grid inside the compatible set's extents")


class Solution(Spec):
    """A minimum of the misfit, from one of the starts of the global search."""

    angles: Angles
    worst: str = Field(description="the figure that misses most")
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
    solutions: tuple[Solution, ...] = Field(description="distinct minima, best first; phi0 within a turn")


class Identification(Spec):
    """The start angles from the paper's printed figures."""

    parameters: TrebuchetParameters = Field(description="all but the start angles")
    printed: tuple[PrintedFigure, ...]
    fit: Fit = Field(description="of all three angles")
    nested: tuple[Fit, ...] = Field(description="with what the paper's equations fix; none where nothing fits")
    sensitivities: tuple[Sensitivity, ...]
    conditioning: Conditioning
    left_out: tuple[Left, ...] = Field(description="none where nothing fits")
    round_angles: tuple[Round, ...] = Field(description="coarse grids first")
    singled_out: Angles | None = Field(description="the one round start that is compatible; None: none or several")
    search: Search | None = Field(description="None: it needs heyoka, which is not installed here")
    findings: tuple[str, ...] = Field(description="in sentences")
    seconds: NonNegative = Field(description="processor time [s]")
