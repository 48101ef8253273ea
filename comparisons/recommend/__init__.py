"""Which settings reach a wanted accuracy: measured, on the machine and on others of its kind."""

from .results import Advice, EngineAdvice
from .study import recommend
from .target import Asked

__all__ = ["Advice", "Asked", "EngineAdvice", "recommend"]
