"""The start angles the paper does not print, identified from the figures it does."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.machines.parameters import TrebuchetParameters
from .fit import conditioning, fit, left_out
from .quantities import ANGLES, PHI, PRINTED, Headlines
from .results import Angles, Conditioning, Fit, Identification, Left, PrintedFigure, Round, Search, Sensitivity
from .search import search

_DIVISIONS = (1, 2, 3, 4, 6, 12, 36, 180, 360, 720)  # of pi: down to quarters of a degree
_AT_MOST = 30  # round starts tried; a set wide enough to hold more singles out nothing
_GROWS = 1.05  # a set that grows by less than this without a figure does not hang on it


def identify(
    parameters: TrebuchetParameters | None = None, printed: Sequence[PrintedFigure] = PRINTED, globally: bool = True
) -> Identification:
    """Fit (theta0, phi0, alpha0) to printed figures, and say what they leave open.

    The rests stand where the machine starts (the paper's Eqs. 6, 7), and a rest that would have to pull at the start
    is gone then. With `globally`, and heyoka installed, the fit starts from the best point of a search over all starts
    of the printed energy, and no use is made of the angles in `parameters`; else it starts from those.

    Args:
        parameters: lengths, masses and gravity; Table I where left out.
        printed: what is fitted; the names are those of :data:`.identification_figures.PRINTED`.
        globally: whether to search.

    Raises:
        InputError: the figures are too few or too vague to bound the angles, or no machine with them launches.
        SimulationError: an integrator failed.
    """
    started = time.process_time()
    headlines = Headlines(parameters or TrebuchetParameters(), tuple(printed))
    searched = search(headlines) if globally else None
    free = fit(headlines, _start(headlines, searched), name="all three angles")
    slopes = headlines.jacobian(free.angles)
    of_fitted = conditioning(slopes[headlines.fitted], [f.name for f in headlines.printed if f.fitted])
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
    at = next(i for i, figure in enumerate(headlines.printed) if figure.name == PHI)
    off = float(headlines.misses((theta, phi, alpha))[at]) * headlines.printed[at].half
    return (theta, phi - math.radians(360.0 * round(off / 360.0)), alpha)


def _nested(headlines: Headlines, free: Fit) -> Iterator[Fit]:
    """With what the paper gives away: its Eq. (6) at t = 0, then its sling rest, which is the arm itself."""
    _, phi, alpha = free.angles
    level = "Eq. (6) at t = 0, theta - phi + phi[0] = 0 with phi = phi[0], leaves theta0 = 0"
    yield fit(headlines, (0.0, phi, alpha), ("phi0", "alpha0"), name="theta0 = 0", because=level)
    along = math.pi + 2 * math.pi * round((phi - math.pi) / (2 * math.pi))
    on_arm = f"{level}; and the sling rests on the arm itself, phi0 - theta0 = pi (Sec. II)"
    yield fit(headlines, (0.0, along, alpha), ("alpha0",), name="theta0 = 0, phi0 = pi", because=on_arm)


def _sensitivities(headlines: Headlines, slopes: FloatArray) -> tuple[Sensitivity, ...]:
    shares = np.zeros_like(slopes)
    shares[headlines.fitted] = slopes[headlines.fitted] ** 2
    shares /= shares.sum(axis=0)
    halves = np.array([figure.half for figure in headlines.printed])
    per_radian = (slopes * halves[:, None]).tolist()
    rows = zip(headlines.printed, per_radian, shares.tolist(), strict=True)
    return tuple(Sensitivity(name=f.name, per_radian=tuple(row), information=tuple(share)) for f, row, share in rows)


def _rounds(headlines: Headlines, free: Fit) -> Iterator[Round]:
    """Multiples of pi / n inside the compatible set's extents, each computed; until there are too many to mean much."""
    if not free.compatible:
        return
    for n in _DIVISIONS:
        unit = math.pi / n
        spans = [range(math.ceil(e.low / unit), math.floor(e.high / unit) + 1) for e in free.extents]
        if math.prod(len(span) for span in spans) > _AT_MOST:
            return
        tried: list[Angles] = [(i * unit, j * unit, k * unit) for i in spans[0] for j in spans[1] for k in spans[2]]
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
            f"no start angles give every printed figure: at best one of them is {free.least_worst:.3g} half widths off"
        )
        return
    widths = [math.degrees(e.high - e.low) for e in free.extents]
    yield (
        f"every printed figure comes out for start angles in a set {_listed(ANGLES, widths)} wide: a thin valley, as "
        f"the worst determined combination ({_direction(of_fitted.directions[-1])}) is known "
        f"{of_fitted.condition_number:.3g} times less well than the best ({_direction(of_fitted.directions[0])})"
    )
    decided = zip(of_fitted.directions, of_fitted.decided_by, strict=True)
    yield "; ".join(f"{_direction(direction)} is decided above all by the {name}" for direction, name in decided)
    yield from _bearing(left)
    yield from _round_findings(rounds, single)
    for each in nested:
        ends = [f"{e.angle} from {math.degrees(e.low):.6g} to {math.degrees(e.high):.6g} deg" for e in each.extents]
        what = "; ".join(ends) if each.compatible else "nothing: a figure is then off"
        yield f"with {each.name} ({each.held_because}) there is left: {what}"
    if searched is not None:
        others = searched.solutions[1:]
        apart = f"; the next minimum misses {others[0].worst} by {others[0].miss:.3g} half widths" if others else ""
        yield (
            f"{searched.machines} launches over all starts of the printed energy, theta0 within "
            f"{math.degrees(searched.theta[1]):.3g} deg of level, show no second set{apart}"
            if not any(s.miss <= 1 for s in others)
            else f"the search finds {1 + sum(s.miss <= 1 for s in others)} separate sets of start angles"
        )


def _bearing(left: Sequence[Left]) -> Iterator[str]:
    """Which figures the set's ends hang on."""
    growths = {each.name: max(math.inf if g is None else g for g in each.growth) for each in left}
    bearing = sorted((name for name, growth in growths.items() if growth >= _GROWS), key=lambda name: -growths[name])
    if bearing:
        said = ", ".join(f"{name} ({growths[name]:.3g} times as wide without it)" for name in bearing)
        yield f"the set is bounded by: {said}; the other figures only agree"


def _round_findings(rounds: Sequence[Round], single: Angles | None) -> Iterator[str]:
    if single is None:
        yield "no one round start is singled out"
        return
    alone = [r for r in rounds if len(r.compatible) == 1]
    coarse, fine = alone[0].divisions, max(r.divisions for r in alone)
    shown = ", ".join(f"{math.degrees(angle):g}" for angle in single)
    yield (
        f"among multiples of pi / {coarse} it holds one point, ({shown}) deg, and no other among multiples of "
        f"{180 / fine:g} deg"
    )


def _listed(names: Sequence[str], degrees: Sequence[float]) -> str:
    return ", ".join(f"{value:.3g} deg in {name}" for name, value in zip(names, degrees, strict=True))


def _direction(vector: Angles) -> str:
    terms = [
        f"{'+' if value >= 0 else '-'} {abs(value):.2f} {name}" for name, value in zip(ANGLES, vector, strict=True)
    ]
    return " ".join(terms).removeprefix("+ ")
