"""Duration of one `simulate` to the launch, warm: `make benchmark`. No test reads this."""

from __future__ import annotations

import statistics
import time

import trebucheck as tb

RUNS = 7
STEPS = {"reference": 1e-3, "mujoco": 1e-3, "pymunk": 1e-3, "exudyn": 1e-4}
LAUNCH = {"fixed": (tb.fixed, 2.7428), "rolling": (tb.rolling, 2.5096)}


def seconds(engine: tb.Engine, problem: tb.Problem) -> list[float]:
    """Wall times of several runs after one that does not count [s]."""
    engine.simulate(problem)
    times: list[float] = []
    for _ in range(RUNS):
        started = time.perf_counter()
        engine.simulate(problem)
        times.append(time.perf_counter() - started)
    return times


def main() -> None:
    """Print the least, the median and the largest of the runs for each engine and machine."""
    print(
        f"{'engine':<12}{'step [s]':>10}{'machine':>10}{'least':>9}{'median':>9}{'most':>9}   [s], "
        f"{RUNS} runs"
    )
    for name, status in tb.engines().items():
        if not status.installed or name not in STEPS:
            continue
        for model, (build, duration) in LAUNCH.items():
            times = seconds(
                tb.engine(name, timestep=STEPS[name]), tb.Problem(build(), duration=duration)
            )
            figures = (min(times), statistics.median(times), max(times))
            print(
                f"{name:<12}{STEPS[name]:>10g}{model:>10}"
                + "".join(f"{value:>9.3f}" for value in figures)
            )


if __name__ == "__main__":
    main()
