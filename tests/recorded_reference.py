"""Cases of `recorded.py` for the reference: how it goes about a motion.

Positions alone do not tell where a window across a singular position begins or how long a step may
be: another choice gives the same motion for other work, or with other digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import recorded_engines
import trebucheck as tb
from mechanisms import bouncing, parallel_cranks, slider_crank
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve
from trebucheck.reference.stiff import longest_step

TOLERANCE = 1e-9
"""Local error: loose enough that rounding decides on no step."""


def problems() -> dict[str, Problem]:
    """Singular positions ahead, at the start and beyond; dampers; stops; rebounds that end."""

    def of(mechanism: Mechanism, duration: float, law: str = "release-once") -> Problem:
        return Problem(mechanism, duration=duration, stop_law=StopLaw(law))

    moving = parallel_cranks(2, start=0.0)
    return {
        "four-bar": of(tb.model("n-four-bar"), 1.5),
        "three cranks": of(parallel_cranks(3, start=-0.4), 1.2),
        "from a singular position": of(
            moving.model_copy(update={"start_speeds": (2.0, 0.0, 2.0)}), 0.6
        ),
        "equal crank and rod": of(tb.model("singular-slider-crank"), 0.5),
        "crank": of(slider_crank(tilt=0.3), 1.0),
        "damped": of(tb.model("damped-oscillator"), 0.5),
        "loaded bob": of(recorded_engines.loaded_bob(), 0.6),
        "between stops": of(recorded_engines.between_stops(), 0.7, "unilateral"),
        "held and met": of(recorded_engines.held_and_met(), 0.8, "unilateral"),
        "bouncing": of(bouncing(1.0, 0.4), 1.5, "unilateral"),
        "braced": of(recorded_engines.braced(), 0.4),
        "leaning on a gate": of(recorded_engines.leaning("gate"), 0.3, "unilateral"),
    }


def steps() -> dict[str, Any]:
    """Evaluations, segments, events and windows across singular positions of each problem."""
    return {name: work(solve(each, TOLERANCE, TOLERANCE)) for name, each in problems().items()}


def work(solution: Solution) -> list[Any]:
    """How a solution was found."""
    found: list[Any] = [solution.evaluations, dict(solution.release_times)]
    for segment in solution.segments:
        state = segment.interpolant(segment.start)
        q = np.asarray(state)[: len(state) // 2]
        longest = longest_step(solution.equations, q, segment.closed)
        found.append([list(segment.closed), segment.start, segment.end, longest])
        for window in segment.windows:
            found.append([window.start, window.end, len(window.motion.a)])
            dense = window.dense_output()
            found += [[p.time, p.lost, *size(dense(p.time))] for p in window.passages]
    found.append([[t, dict(impulses)] for t, impulses in solution.impacts])
    found.append({stop: list(times) for stop, times in solution.rest_times.items()})
    return found


def size(values: Any) -> list[float]:
    """Two sums that tell arrays apart."""
    v = np.asarray(values).ravel()
    return [float(v.sum()), float(v @ np.cos(np.arange(len(v))))]


CASES: dict[str, Callable[[], Any]] = {"reference-steps": steps}
