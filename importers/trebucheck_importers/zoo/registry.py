"""Models of the zoo."""

from __future__ import annotations

from functools import cache

from trebucheck.api.mechanics import InputError

from .constraints import constraint_models
from .forces import force_models
from .inertias import inertia_models
from .joints import joint_models
from .model import ZooModel


@cache
def zoo() -> tuple[ZooModel, ...]:
    """Models of the zoo, each after those it builds on."""
    return (*joint_models(), *inertia_models(), *force_models(), *constraint_models())


def zoo_model(name: str) -> ZooModel:
    """The model of that name.

    Raises:
        InputError: there is none.
    """
    found = next((model for model in zoo() if model.name == name), None)
    if found is None:
        raise InputError(
            f"there is no model {name[:60]!r} in the zoo; there are: "
            f"{', '.join(m.name for m in zoo())}."
        )
    return found
