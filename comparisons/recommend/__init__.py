"""Which settings reach a wanted accuracy: measured, on the machine and on others of its kind."""

from .results import Advice, Asked, EngineAdvice
from .study import recommend

__all__ = ["Advice", "Asked", "EngineAdvice", "recommend"]
