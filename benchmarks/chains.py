"""Cost of a step against the number of bodies, chains of 2 to 200: `python benchmarks/chains.py`.

No test reads this. A step of the reference is one of DOP853 (twelve evaluations, and its dense
output); an engine's is one of its own. Processor time without building the model, the least of
several runs; none where an engine gives up. The last line is the growth between the two largest
chains, as an exponent of their number of bodies.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

import trebucheck as tb
from trebucheck.models.library.registry import model, parameters_type
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

SIZES = (2, 5, 10, 20, 50, 100, 200)
RUNS, FEW, MANY = 3, 5, 200  # steps of the engines
DURATION = 0.3  # [s] of the reference
STEP = 1e-3  # [s] of the engines


def chain(n: int) -> tb.Mechanism:
    """The problem library's chain of n rods."""
    return model("chain", parameters_type("chain")(N=n))


def spent(run: Callable[[], int]) -> tuple[float, int]:
    """Least processor time of several runs [s], and the number of steps."""
    times: list[float] = []
    steps = 0
    for _ in range(RUNS):
        started = time.process_time()
        steps = run()
        times.append(time.process_time() - started)
    return min(times), steps


def of_the_reference(mechanism: tb.Mechanism) -> float:
    """Processor time of a step at 1e-9 [s]."""
    equations = Equations(mechanism)

    def run() -> int:
        solution = solve(tb.Problem(mechanism, duration=DURATION), 1e-9, 1e-9, equations)
        return sum(len(segment.interpolant.ts) - 1 for segment in solution.segments)

    run()  # compiles
    whole, steps = spent(run)
    return whole / steps


def of_an_engine(name: str, mechanism: tb.Mechanism) -> float:
    """Processor time of a step [s], without building the model."""
    engine = tb.engine(name, timestep=STEP)

    def steps(number: int) -> int:
        return engine.simulate(tb.Problem(mechanism, duration=number * STEP)).provenance.steps

    try:
        (few, _), (many, _) = spent(lambda: steps(FEW)), spent(lambda: steps(MANY))
    except tb.SimulationError:
        return math.nan
    return (many - few) / (MANY - FEW)


def main() -> None:
    """Print milliseconds a step for each size and solver."""
    names = [
        name for name, status in tb.engines().items() if status.installed and name != "reference"
    ]
    costs: dict[str, Callable[[tb.Mechanism], float]] = {"reference": of_the_reference}
    costs |= {name: partial(of_an_engine, name) for name in names}
    print(f"{'bodies':>6}" + "".join(f"{name:>12}" for name in costs) + "   [ms a step]")
    table: list[list[float]] = []
    for n in SIZES:
        mechanism = chain(n)
        table.append([cost(mechanism) for cost in costs.values()])
        print(f"{n:>6}" + "".join(f"{1e3 * value:>12.4f}" for value in table[-1]), flush=True)
    ratio = math.log(SIZES[-1] / SIZES[-2])
    growth = [
        math.log(last / before) / ratio for before, last in zip(table[-2], table[-1], strict=True)
    ]
    print("growth" + "".join(f"{value:>12.2f}" for value in growth))


if __name__ == "__main__":
    main()
