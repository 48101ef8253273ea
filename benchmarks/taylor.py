"""Cost of a launch by the Taylor integrator, single and in batches: `python benchmarks/taylor.py`.

No test reads this. Times are warm, on one core; the first run of each kind, compilation included,
is shown apart.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import trebucheck as tb
from trebucheck.models.arrays import FloatArray
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import taylor_quantities

RUNS, BATCH, TOLERANCE, DURATION = 15, 4000, 1e-12, 4.0
BUILDS = {"fixed": tb.fixed, "rolling": tb.rolling}


def seconds(function: Callable[[], object], runs: int) -> tuple[float, float]:
    """Wall time of the first run, and the median of more [s]."""
    times: list[float] = []
    for _ in range(runs + 1):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return times[0], statistics.median(times[1:])


def dop853_launch(problem: tb.Problem) -> tb.Launch | None:
    """The same launch by the other integrator."""
    return solve(problem, TOLERANCE, TOLERANCE).launch


def random_parameters() -> dict[str, FloatArray]:
    """Parameters that a builder might think of, the same in every run."""
    random = np.random.default_rng(1)
    ranges = {"l1": (7, 12.5), "l2": (2.5, 5), "r": (4, 8), "h": (6, 12)}
    ranges |= {"m_b": (30, 150), "m_cw": (1500, 5000)}
    return {name: random.uniform(*limits, BATCH) for name, limits in ranges.items()}


def main() -> None:
    """Print first and warm times of single launches, and launches per second in a batch."""
    print(f"{'machine':<10}{'what':<34}{'first [s]':>10}{'warm [ms]':>11}")
    for name, build in BUILDS.items():
        problem = tb.Problem(build(), duration=DURATION)
        launches: dict[str, Callable[[], object]] = {
            "DOP853, 1e-12": partial(dop853_launch, problem),
            "Taylor, 1e-12": partial(taylor_quantities, problem, "double", TOLERANCE),
            "Taylor, extended precision": partial(taylor_quantities, problem, "extended"),
        }
        for what, launch in launches.items():
            first, warm = seconds(launch, RUNS)
            print(f"{name:<10}{what:<34}{first:>10.3f}{warm * 1e3:>11.3f}")
        parameters = random_parameters()
        for tolerance in (TOLERANCE, 1e-10):
            batch = partial(tb.launches, name, parameters, duration=DURATION, tolerance=tolerance)
            first, warm = seconds(batch, 5)
            print(
                f"{name:<10}{f'{BATCH} from arrays, {tolerance:g}':<34}{first:>10.3f}"
                f"{warm * 1e3:>11.3f}   {BATCH / warm:.0f} per second"
            )


if __name__ == "__main__":
    main()
