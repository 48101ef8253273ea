"""Observed order of convergence of an engine: errors of the projectile's position by step."""

from __future__ import annotations

import math
from itertools import pairwise

import trebucheck as tb

steps = (2e-3, 1e-3, 5e-4)
errors: list[float] = []
for step in steps:
    run = tb.compare(
        ["fixed"], ["pymunk"], ["assisted"], timestep=step, isolate=False
    ).results.runs[0]
    position = run.metric("position_max", "projectile")
    if position is None or position.value is None:
        raise SystemExit(run.message)
    errors.append(position.value)
    print(f"step {step:.0e} s: largest error {position.value:.2e} m")
for coarse, fine in pairwise(errors):
    print(f"observed order {math.log2(coarse / fine):.2f}")
