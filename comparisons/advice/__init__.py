"""Which settings reach a wanted accuracy: measured, on the machine and on others of its kind."""

from .asked import Asked
from .recommending import recommend
from .results import Advice, EngineAdvice

__all__ = ["Advice", "Asked", "EngineAdvice", "recommend"]
