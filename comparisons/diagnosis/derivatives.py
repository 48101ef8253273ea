"""Speeds that are not the derivatives of the places beside them, by a trajectory's own samples.

A trajectory's deviations from the reference, dq of a place and du of its speed, belong to one
motion if du = d(dq)/dt, whatever that motion is. The derivative is that of a cubic spline through
the samples; what they leave unknown of it is its change where every second one is left out. Of a
right place dq is zero, so that no interval between samples is too long for it.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ...models.arrays import BoolArray, FloatArray
from ...models.trajectory import PointMotion, Trajectory
from ..runs.quantities import Kind, Quantity
from .case import factor_of, fit, share_of
from .rank import SUFFICIENT
from .readings import scale_text

_DEGREE = 3
_FEWEST = 2 * (_DEGREE + 1)  # samples between two jumps: every second one has a spline, too
_CLEARLY = 3.0  # times what the samples leave unknown
_ROUNDING = 1e-9  # of the values themselves
_SHIFTS = 4  # corrections of a shift in time, whose effect is not linear


@dataclass(frozen=True)
class Mismatch:
    """Speeds that places do not have, or places that speeds do not lead to."""

    name: str
    amount: str
    mended: Trajectory
    """The trajectory with those that follow from the others in their place."""


class _Track(NamedTuple):
    """A coordinate, or a point along an axis."""

    name: str
    unit: str


class _Tracks:
    """Places and speeds that a trajectory tells both, shape (n, n_tracks)."""

    def __init__(self, f: Trajectory, told: Container[str] | None) -> None:
        def are_told(*quantities: Quantity) -> bool:
            return told is None or all(quantity.text in told for quantity in quantities)

        self._trajectory, mechanism = f, f.mechanism
        state_is_told = are_told(Quantity(Kind.COORDINATES), Quantity(Kind.SPEEDS))
        self._of_coordinates = f.q.shape[1] if state_is_told else 0
        self._points: list[str] = []
        self.tracks: list[_Track] = []
        places, speeds = [np.empty((len(f.t), 0))], [np.empty((len(f.t), 0))]
        if state_is_told:
            for name in mechanism.coordinates:
                self.tracks.append(_Track(name, "rad" if name in mechanism.angles else "m"))
            places.append(f.q)
            speeds.append(f.u)
        for name, point in f.markers.items():
            if are_told(Quantity(Kind.POSITION, name), Quantity(Kind.VELOCITY, name)):
                self._points.append(name)
                self.tracks += [_Track(f"{axis} of the {name}", "m") for axis in "xy"]
                places.append(point.position)
                speeds.append(point.velocity)
        self.places, self.speeds = np.hstack(places), np.hstack(speeds)

    def words(self, chosen: BoolArray) -> str:
        """Kind of what the places of some tracks are."""
        return "coordinates" if chosen[: self._of_coordinates].any() else "positions"

    def amounts(
        self, t: FloatArray, wrong: BoolArray, given: FloatArray, right: FloatArray, per: str
    ) -> Iterator[str]:
        """Each wrong track and, where a simple mistake makes it so, that."""
        for i in np.flatnonzero(wrong).tolist():
            track = self.tracks[i]
            yield track.name + _how(t, given[:, i], right[:, i], track.unit + per)

    def changed(self, places: FloatArray, speeds: FloatArray) -> Trajectory:
        """The trajectory with others in their place."""
        f, first = self._trajectory, self._of_coordinates
        if first:
            f = replace(f, q=places[:, :first], u=speeds[:, :first])
        points = dict(f.markers)
        for name in self._points:
            own = slice(first, first + 2)
            points[name] = PointMotion(places[:, own], speeds[:, own])
            first += 2
        return replace(f, markers=points)


def mismatches(
    recorded: Trajectory, right: Trajectory, told: Container[str] | None
) -> Iterator[Mismatch]:
    """Speeds that are not those of their places, and places that are not those of their speeds.

    Args:
        recorded: the trajectory.
        right: the reference's at the first of its times; the others do not count.
        told: quantities that it tells, by their texts; None: all of them.
    """
    own, known, t = _Tracks(recorded, told), _Tracks(right, told), right.t
    places, speeds = own.places[: len(t)], own.speeds[: len(t)]
    off = places - known.places, speeds - known.speeds
    derived, unknown = _derivatives(t, *off)
    derived += known.speeds
    wrong = _differ(speeds, derived, unknown)
    if wrong.any():
        mended = own.speeds.copy()
        mended[: len(t), wrong] = derived[:, wrong]
        name = f"speeds that are not the derivatives of the {own.words(wrong)}"
        amount = ", ".join(own.amounts(t, wrong, speeds, derived, "/s"))
        yield Mismatch(name, amount, own.changed(own.places, mended))
    integrated, unknown = _integrals(t, *off)
    integrated += known.places
    wrong = _differ(places, integrated, unknown)
    if wrong.any():
        mended = own.places.copy()
        mended[: len(t), wrong] = integrated[:, wrong]
        name = f"{own.words(wrong)} that are not the integrals of the speeds"
        amount = ", ".join(own.amounts(t, wrong, places, integrated, ""))
        yield Mismatch(name, amount, own.changed(mended, own.speeds))


def _differ(given: FloatArray, others: FloatArray, unknown: FloatArray) -> BoolArray:
    """Tell which columns differ by more than is unknown of them."""
    apart, size = np.linalg.norm(given - others, axis=0), np.linalg.norm(given, axis=0)
    return apart > _CLEARLY * unknown + _ROUNDING * size


# Each of these two gives values (n, n_tracks), and norms of what is unknown of them (n_tracks,).


def _derivatives(
    t: FloatArray, places: FloatArray, speeds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of places; the speeds themselves between two jumps with too few samples."""
    values, unknown = speeds.copy(), np.zeros_like(speeds)
    for piece in _between_jumps(t):
        if len(t[piece]) >= _FEWEST:
            fine, coarse = _splines(t[piece], places[piece])
            values[piece] = fine.derivative()(t[piece])
            unknown[piece] = coarse.derivative()(t[piece]) - values[piece]
    return values, np.linalg.norm(unknown, axis=0)


def _integrals(
    t: FloatArray, places: FloatArray, speeds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Integrals of speeds from the first places on; speeds jump where places do not."""
    values, unknown = places.copy(), np.zeros_like(places)
    start = places[0]
    for piece in _between_jumps(t):
        if len(t[piece]) >= _FEWEST:
            ways = (way.antiderivative() for way in _splines(t[piece], speeds[piece]))
            fine, coarse = (way(t[piece]) - way(t[piece][0]) for way in ways)
            values[piece] = start + fine
            unknown[piece] = coarse - fine
        start = values[piece][-1]
    return values, np.linalg.norm(unknown, axis=0)


def _between_jumps(t: FloatArray) -> list[slice]:
    """Samples between two times that stand twice, as before and after an impact."""
    ends = [0, *(np.flatnonzero(np.diff(t) <= 0) + 1).tolist(), len(t)]
    return [slice(first, last) for first, last in pairwise(ends)]


def _splines(t: FloatArray, values: FloatArray) -> tuple[BSpline, BSpline]:
    """Splines through all samples, and through every second one and the last."""
    every_second = np.unique(np.append(np.arange(0, len(t), 2), len(t) - 1))
    fine = make_interp_spline(t, values, k=_DEGREE)
    return fine, make_interp_spline(t[every_second], values[every_second], k=_DEGREE)


def _how(t: FloatArray, given: FloatArray, right: FloatArray, unit: str) -> str:
    """The simplest mistake that makes most of the difference of two series; '' if there is none."""
    off, ones = given - right, np.ones_like(t)
    (zero,), from_zero = fit(off, ones[None])
    (factor,), scaled = fit(off, right[None])
    # Integrals are known but for a constant.
    (other, _), scaled_from_zero = fit(off, np.stack([right, ones]))
    late, shifted = _shift(t, given, right)
    steps = late / float(np.median(np.diff(t)))
    for how, share in (
        (f" {zero:+.3g} {unit}", from_zero),
        (f" {scale_text(float(factor))}", scaled),
        (f" by {late:+.3g} s, {steps:+.3g} steps", shifted),
        (f" {scale_text(float(other))}", scaled_from_zero),
    ):
        if share >= SUFFICIENT:
            return how
    return ""


def _shift(t: FloatArray, given: FloatArray, right: FloatArray) -> tuple[float, float]:
    """The time by which a series is later [s], and the share of its error that this explains."""
    once = np.append(True, np.diff(t) > 0)
    at = make_interp_spline(t[once], right[once], k=_DEGREE)
    off, late = given - right, factor_of(given - right, at.derivative()(t))
    best = late, 0.0
    for _ in range(_SHIFTS):
        signature = at(np.clip(t + late, t[0], t[-1])) - right
        share = share_of(off, signature)
        if share > best[1]:
            best = late, share
        late *= factor_of(off, signature)
    return best
