"""Compare the installed engines with the reference on the fixed machine, tolerance by tolerance."""

from __future__ import annotations

import trebucheck as tb

comparison = tb.compare(["fixed"], presets=["assisted"])
for run in comparison.results.runs:
    position = run.metric("position_max", "projectile")
    error = (
        f"{position.value:.1e} m"
        if position is not None and position.value is not None
        else "no position"
    )
    print(f"{run.label:<16} {run.outcome.value:<18} {error}")
    for metric in run.broken:
        print(f"    {metric.label}: {metric.value} {metric.unit}, tolerance {metric.tolerance}")
print("agreement holds" if comparison.passed else "agreement does not hold")
