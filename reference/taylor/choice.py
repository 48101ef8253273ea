"""Which integrator "auto" takes: Taylor series, unless a rule stated here speaks against them."""

from __future__ import annotations

import importlib.util

import numpy as np

from ...models.kinematics import Kinematics
from ...models.problem import Problem
from ..equations import Equations
from .machine import numbers_of, structure_of
from .system import TaylorSystem

MOST_PRODUCTS = 3000
"""Of one evaluation. Compilation and steps take time in proportion to them, which grow with the cube of the length of
a chain; DOP853's evaluations are one call of LAPACK. A chain of 20 rods has 2550."""


def why_not_taylor(problem: Problem) -> str | None:
    """Why "auto" integrates a problem with DOP853, half a sentence; None where it takes Taylor series."""
    if importlib.util.find_spec("heyoka") is None:
        return "heyoka is not installed"
    mechanism, closed = (
        problem.mechanism,
        [stop.name for stop in problem.mechanism.stops if stop.closed],
    )
    if Equations(mechanism).basis(np.array(mechanism.start), closed) is not None:
        return "its constraints depend on each other"
    kinematics = Kinematics(mechanism)
    structure = structure_of(problem, kinematics, numbers_of(problem, kinematics, np.float64) != 0)
    products = TaylorSystem(structure).operations
    if products > MOST_PRODUCTS:
        return f"one evaluation would take {products} products, which are {MOST_PRODUCTS} at most"
    return None
