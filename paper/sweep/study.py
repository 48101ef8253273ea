"""The sweep over the fulcrum's place on a beam of fixed length: the paper's Sec. V and Fig. 5."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from ...comparisons.runs.worker import Worker
from ...models.errors import InputError
from ...models.machines.parameters import TrebuchetParameters
from .beam import Beam
from .results import Artefact, Regime, Sweep
from .search import Places, early_crossings, wrong_zero

__all__ = ["Sweep", "fulcrum_sweep"]

ENGINES = ("mujoco", "pymunk", "exudyn")
WITH_ENGINES = (8.6, 9.0, 9.5, 9.89, 10.3, 12.6, 12.72, 12.73, 12.9)
"""Places [m] the engines are asked about: where the paper's machine falls backward, where its plot is zero, and both
sides of the regime change."""
PAPER_PEAK, PAPER_L1, SUSPECT, THRESHOLD = 9.91, 10.0, 10.3, 9.9
"""Printed in Sec. V [m]."""
DENNY = (3.0, 5.0)
"""Lever ratios the paper quotes as the best for a similar system."""
PAPER_GRID = 0.01
"""[m]: its l1 are printed to two digits."""

_GUESSES = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # [s] guesses somebody might type
_EARLY = (9.0, 9.5, 9.89, 10.0, 11.0)  # [m] either side of the paper's threshold
_LATE = (8.6, 9.0, 9.4, 9.8)  # [m] below it


def fulcrum_sweep(
    parameters: TrebuchetParameters | None = None,
    beam: float = 14.0,
    start: float = 8.5,
    end: float = 13.0,
    engines: Sequence[str] = ENGINES,
    worker: Worker | None = None,
    with_engines: Sequence[float] = WITH_ENGINES,
) -> Sweep:
    """Launch speed of the fixed machine against l1, on a beam of fixed length, and what is to be said of it.

    Args:
        parameters: all but l1 and l2; Table I where left out.
        beam: l1 + l2 [m].
        start, end: of l1 [m].
        engines: names; one that fails or is absent becomes a note.
        worker: the process engines run in; None: this one.
        with_engines: places they are asked about [m]; those outside the sweep are left out.

    Raises:
        InputError: the range is empty or not on the beam, or the machine launches nowhere in it.
        SimulationError: an integrator of the reference gave up.
    """
    if not 0 < start < end < beam:
        raise InputError(f"start = {start!r} m and end = {end!r} m must satisfy 0 < start < end < beam = {beam!r} m.")
    began = time.perf_counter()
    line = Beam(parameters or TrebuchetParameters(), beam, start, end)
    curve = line.curve()
    peak = line.peak(curve)
    regime = line.regime()
    asked = {x for x in with_engines if start <= x <= end}
    others = {PAPER_PEAK, PAPER_L1, SUSPECT, *(beam * ratio / (1 + ratio) for ratio in DENNY)}
    places = sorted(asked | {x for x in others if start <= x <= end} | {peak.l1.value})
    positions = tuple(line.position(x, engines if x in asked else (), worker) for x in places)
    return Sweep(
        beam=beam,
        start=start,
        end=end,
        curve=curve,
        peak=peak,
        positions=positions,
        backward=line.backward(positions),
        suspect=line.neighbourhood(SUSPECT, PAPER_GRID),
        regime=regime,
        trend=line.trend(curve, PAPER_PEAK, end if regime.l1 is None else regime.l1.value),
        artefact=_artefact(line, regime),
        seconds=time.perf_counter() - began,
    )


def _artefact(line: Beam, regime: Regime) -> Artefact:
    end = line.end if regime.l1 is None else regime.l1.value
    l1 = np.round(np.arange(line.start, end, PAPER_GRID), 9)
    places = Places(l1, tuple(line.whole(float(x)) for x in l1))
    guess = places.matching_guess(THRESHOLD)
    late = [wrong_zero(line.whole(x)) for x in _LATE if line.start <= x <= end]
    early = [found for x in _EARLY if line.start <= x <= line.end for found in early_crossings(x, line.solution(x))]
    return Artefact(
        threshold=THRESHOLD,
        step=PAPER_GRID,
        searches=tuple(places.search(each, (SUSPECT,)) for each in _GUESSES),
        matching_guess=guess,
        matching_search=None if guess is None else places.search(guess, (SUSPECT,)),
        wrong_zeros=tuple(found for found in late if found is not None),
        early_crossings=tuple(early),
    )
