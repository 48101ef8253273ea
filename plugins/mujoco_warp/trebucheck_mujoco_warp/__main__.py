"""Compiles what runs of the library need into Warp's cache: some minutes at the first time.

A kernel is compiled for a number of joints: the first run with it takes up to two minutes more.
"""

from __future__ import annotations

import trebucheck as tb
from trebucheck.models.library.registry import benchmarks

from .engine import MujocoWarpEngine

machines = (tb.Problem(machine, duration=1.0) for machine in (tb.fixed(), tb.rolling()))
for problem in (*machines, *(each.problem() for each in benchmarks())):
    for name, made in MujocoWarpEngine.presets().items():
        engine = made(timestep=1e-5 * problem.duration)
        try:
            engine.simulate(problem.model_copy(update={"duration": engine.timestep}))
        except tb.UnsupportedProblemError as refusal:
            print(f"{name}: {refusal}")
