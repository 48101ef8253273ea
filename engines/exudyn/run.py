"""One run with Exudyn, under either law of the stops."""

from __future__ import annotations

from ...models.errors import InputError
from ...models.problem import Problem, StopLaw
from ..protocol import Recording
from .build import silence
from .options import ExudynOptions
from .step import Motion
from .unilateral import UnilateralMotion


def run(problem: Problem, options: ExudynOptions) -> Recording:
    """Build, move and read out.

    Raises:
        InputError: stops are to be springs under the unilateral law.
        UnsupportedProblemError: the mechanism cannot be built, or not from this start.
        SimulationError: Exudyn's solver gave up before the end.
    """
    once = problem.stop_law is StopLaw.RELEASE_ONCE
    if not once and options.stop_stiffness is not None:
        raise InputError(
            f"stop_stiffness = {options.stop_stiffness:g} must be left out under the unilateral law: exudyn's springs "
            f"are for stops that open once; its impacts are those of rigid stops."
        )
    with silence():
        return (Motion if once else UnilateralMotion)(problem, options).recording()
