"""What studies need to know of the reference as an engine."""

from __future__ import annotations

from ..study import EngineStudy, Tolerance

# The others are measured against the reference, so only an invariant can judge it here; its figures are held to
# independent ones in tests/verification.
STUDY = EngineStudy(
    tolerances=(Tolerance("tuned", "energy_drift", 1e-12, 1.0, 0, "certified integrator, tolerance 3e-14 per step"),),
    colour="#444444",
)
