"""Error budgets: what each cause contributes to an engine's error, and what each option buys."""

from __future__ import annotations

from ...engines.study import Cause, Intervention
from .causes import causes_of

__all__ = ["Cause", "Intervention", "causes_of"]
