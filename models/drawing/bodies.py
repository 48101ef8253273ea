"""Bodies: beams, links, plates and masses, from their points, mass and inertia alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull

from ..mechanism import Body
from .shapes import Role
from .sketch import Sketch, distinct, on_a_line

_LEAST_SHARE = 0.01  # of a body's mass, below which a point mass in it is not drawn
_UNIFORM = 0.02  # by which the inertia of a rod may differ from a uniform one's


def add_bodies(sketch: Sketch) -> None:
    """All bodies, with sizes that compare their masses: widths and radii grow as the cube root."""
    parts = _Parts(sketch)
    for body in sketch.mechanism.bodies:
        parts.add(body)
    parts.draw()


@dataclass
class _Parts:
    """Beams, plates and point masses that bodies are drawn as."""

    sketch: Sketch
    beams: list[tuple[tuple[int, ...], float, bool]] = field(
        default_factory=list[tuple[tuple[int, ...], float, bool]]
    )
    """Points, mass [kg], and whether it is a plate."""
    masses: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])
    """Point and mass [kg]."""

    def add(self, body: Body) -> None:
        """A body, by what is known of it."""
        centre = complex(*body.centre)
        points = distinct(self.sketch.outlines[body.name], centre, self.sketch.size)
        if body.inertia == 0 or (not points and self._shows_no_turn(body, centre)):
            self._point_mass(body, points, centre)
        elif not points:
            self._wheel(body, centre)
        elif len(points) == 1:
            self._rod(body, points[0], centre)
        elif on_a_line(np.array([*points, centre])):
            self._loaded_rod(body, points, centre)
        else:
            self._plate(body, points, centre)

    def _shows_no_turn(self, body: Body, centre: complex) -> bool:
        """Whether a disc would say little: its joint holds its angle, or a stop its centre, and a wall crosses it."""
        mechanism = self.sketch.mechanism
        stops = (stop for stop in mechanism.point_stops if stop.body == body.name)
        return mechanism.joint_of(body.name).holds_angle or any(
            complex(*stop.point) == centre for stop in stops
        )

    def _point_mass(self, body: Body, points: list[complex], centre: complex) -> None:
        """A mass on ropes or light links."""
        end = self.sketch.point(body.name, centre)
        for point in points:
            self.sketch.add(
                "line", "rope", (self.sketch.point(body.name, point), end), 0.004 * self.sketch.size
            )
        self.masses.append((end, body.mass))

    def _wheel(self, body: Body, centre: complex) -> None:
        """A uniform disc of the body's inertia, with a spoke that shows how it turns."""
        sketch = self.sketch
        radius = min(math.sqrt(2 * body.inertia / body.mass), sketch.size)
        middle, rim = sketch.point(body.name, centre), sketch.point(body.name, centre + radius)
        sketch.add("disc", "body", (middle,), radius)
        sketch.add("line", "centre", (middle, rim), 0.004 * sketch.size)
        self.centre(middle)

    def _rod(self, body: Body, point: complex, centre: complex) -> None:
        """A uniform rod of the body's inertia through its one point; a bob on a link where that is too long."""
        half = math.sqrt(3 * body.inertia / body.mass)
        arm = centre - point
        if half >= abs(arm) * (1 - _UNIFORM):
            half = abs(arm) if half < abs(arm) * (1 + _UNIFORM) else half
            along = arm / abs(arm) * half
            ends = tuple(self.sketch.point(body.name, centre + sign * along) for sign in (-1, 1))
            self.beams.append((ends, body.mass, False))
            self.centre(self.sketch.point(body.name, centre))
            return
        ends = tuple(self.sketch.point(body.name, at) for at in (point, centre))
        self.sketch.add("line", "rope", ends, 0.006 * self.sketch.size)
        self.masses.append((ends[1], body.mass))

    def _loaded_rod(self, body: Body, points: list[complex], centre: complex) -> None:
        """A uniform rod with a point mass at each end, if the body is one; else a beam with its centre of mass."""
        ends = _extremes([*points, centre])
        indices = tuple(self.sketch.point(body.name, end) for end in ends)
        shares = loaded_rod(body, *ends)
        if shares is None:
            self.beams.append((indices, body.mass, False))
            self.centre(self.sketch.point(body.name, centre))
            return
        self.beams.append((indices, shares[0] * body.mass, False))
        if shares[0] > 1 - _LEAST_SHARE:
            self.centre(self.sketch.point(body.name, centre))
        heavy = [
            (index, share)
            for index, share in zip(indices, shares[1:], strict=True)
            if share > _LEAST_SHARE
        ]
        self.masses += [(index, share * body.mass) for index, share in heavy]

    def _plate(self, body: Body, points: list[complex], centre: complex) -> None:
        corners = [*points, centre]
        hull = ConvexHull([(corner.real, corner.imag) for corner in corners]).vertices
        self.beams.append(
            (tuple(self.sketch.point(body.name, corners[k]) for k in hull), body.mass, True)
        )
        self.centre(self.sketch.point(body.name, centre))

    def centre(self, index: int) -> None:
        """The sign of a centre of mass."""
        self.sketch.add("disc", "centre", (index,), 0.005 * self.sketch.size * self._crowd)

    @property
    def _crowd(self) -> float:
        """Less than 1 where many bodies must find room."""
        return min(1.0, 9.0 / len(self.sketch.mechanism.bodies))

    def draw(self) -> None:
        """Add them as shapes, their sizes in proportion."""
        size, add = self.sketch.size * self._crowd, self.sketch.add
        widest = max((mass for _, mass, _ in self.beams), default=1.0)
        for points, mass, plate in self.beams:
            share = max(mass / widest, 0.0) ** (1 / 3) if widest > 0 else 0.0
            role: Role = "body" if share > 0.05 else "rope"
            add("area" if plate else "line", role, points, size * (0.006 + 0.012 * share))
        heaviest = max((mass for _, mass in self.masses), default=1.0)
        for index, mass in self.masses:
            add("disc", "mass", (index,), size * max(0.01, 0.04 * (mass / heaviest) ** (1 / 3)))


def loaded_rod(body: Body, a: complex, b: complex) -> tuple[float, float, float] | None:
    """Parts of the mass of a body that are a uniform rod from a to b, and point masses at a and at b.

    Mass, centre and inertia of the three are the body's; None where that needs a negative mass.
    """
    length = abs(b - a)
    middle = ((complex(*body.centre) - a) / (b - a)).real
    inertia = body.inertia / (body.mass * length**2) + middle**2
    # mass, first and second moment about a, all in parts of the body's mass and the length
    moments = np.array([[1.0, 1.0, 1.0], [0.5, 0.0, 1.0], [1 / 3, 0.0, 1.0]])
    rod, at_a, at_b = np.linalg.solve(moments, [1.0, middle, inertia])
    return None if min(rod, at_a, at_b) < -1e-6 else (float(rod), float(at_a), float(at_b))


def _extremes(points: list[complex]) -> tuple[complex, complex]:
    """The two ends of points on a line."""
    far = max(points, key=lambda point: abs(point - points[0]))
    return max(points, key=lambda point: abs(point - far)), far
