"""The options that every built-in engine has, and how a preset fills them."""

from __future__ import annotations

from pydantic import Field, JsonValue

from ..models.spec import Positive, Spec


class EngineOptions(Spec):
    """Numerical options of an engine: frozen, validated, recorded with every trajectory.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    preset: str = Field(default="tuned", description="the preset these options were made from")
    timestep: Positive = Field(default=1e-3, le=1.0, description="step size [s]")

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Every numerical option by name, as JSON values; without the preset's name."""
        return self.model_dump(mode="json", exclude={"preset"})
