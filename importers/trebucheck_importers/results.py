"""Results of a check of an importer, as data."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal, get_args

from pydantic import Field
from trebucheck.api.mechanics import Positive, Real, Spec
from trebucheck.api.studies import ResultFile

Quantity = Literal[
    "loads",
    "joints",
    "total mass",
    "mass matrix",
    "accelerations",
    "ranges",
    "start",
    "free motion",
    "limits kept",
    "motion with events",
    "force at rest",
]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Quantities that are checked of each model, in this order."""


class Verdict(StrEnum):
    """Verdict on one quantity of one model."""

    RIGHT = "right"
    WRONG = "wrong"
    UNDECIDED = "undecided"
    """The importer's own discretisation error, estimated from two steps, is too large to tell."""
    NOT_OFFERED = "not offered"
    FAILED = "failed"
    """It raised an error, crashed or gave no answer."""


class Check(Spec):
    """One quantity of one model."""

    quantity: Quantity
    verdict: Verdict
    error: Real | None = Field(
        default=None, description="in the quantity's own unit, of the worst element"
    )
    tolerance: Real | None = Field(default=None, description="of that element")
    text: str = Field(default="", description="expected and found, or why there is no verdict")


class FileResult(Spec):
    """One file."""

    checks: tuple[Check, ...]
    printed: str = Field(default="", description="what the importer printed meanwhile")

    def check(self, quantity: str) -> Check | None:
        """The one of a quantity; None where the file has none."""
        return next((check for check in self.checks if check.quantity == quantity), None)

    @property
    def fault(self) -> Check | None:
        """First quantity that is wrong or in which the importer failed; None if there is none."""
        return next(
            (check for check in self.checks if check.verdict in (Verdict.WRONG, Verdict.FAILED)),
            None,
        )


class VariantResult(FileResult):
    """A file of the same motion, for importers that refuse or misread the first one."""

    variant: str


class ModelResult(FileResult):
    """One model: its file and, where that is refused or misread, variants until one is right."""

    model: str
    feature: str
    variants: tuple[VariantResult, ...] = Field(default=(), exclude_if=lambda value: not value)


class ImporterResults(ResultFile):
    """An importer on all models."""

    format: Literal["trebucheck-importer-1"] = "trebucheck-importer-1"
    loader: str
    versions: dict[str, str] = Field(description="of the importer's packages, as it states them")
    integrator: str = Field(description="as the importer states it")
    precision: Literal["float64", "float32"]
    timestep: Positive = Field(
        description="longest step of the coarser of the two runs of each motion [s]"
    )
    models: tuple[ModelResult, ...]

    @property
    def holds(self) -> bool:
        """Tell whether nothing is wrong and nothing failed; of variants nothing is asked."""
        return all(model.fault is None for model in self.models)

    def count(self, verdict: Verdict, quantity: str | None = None) -> int:
        """Count of checks, of all quantities or of one."""
        checks = (check for model in self.models for check in model.checks)
        return sum(
            check.verdict == verdict and quantity in (None, check.quantity) for check in checks
        )
