"""Error budgets: what each cause contributes to an engine's error, and what each option buys."""

from __future__ import annotations

from ...engines.registry import causes_of
from ...engines.study import Cause, Intervention

__all__ = ["Cause", "Intervention", "causes_of"]
