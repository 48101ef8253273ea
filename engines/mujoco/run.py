"""A run of MuJoCo: which stepper moves a problem, and what becomes of MuJoCo's warnings."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from ...models.errors import SimulationError
from ...models.problem import Problem, StopLaw
from ..events import refuse_moving_gaps
from ..protocol import Recording
from .options import MujocoOptions
from .step import Stepper
from .unilateral import UnilateralStepper
from .versions import CALLBACK, mujoco


def run(problem: Problem, options: MujocoOptions) -> Recording:
    """Simulate a problem.

    Raises:
        SimulationError: MuJoCo refused the model, or warned that it diverged; or impacts follow
        each other without end.
        UnsupportedProblemError: the mechanism cannot be built, or starts with a closed stop whose
            gap changes where impacts are not resolved.
    """
    stepper = _stepper(problem, options)
    with _warnings_raised():
        stepper.begin()
        with stepper.correction.applied():
            stepper.integrate()
    return stepper.recording()


def _stepper(problem: Problem, options: MujocoOptions) -> Stepper:
    if problem.stop_law is StopLaw.UNILATERAL and not options.keep_limits:
        return UnilateralStepper(problem, options)
    refuse_moving_gaps(problem.mechanism, "mujoco")
    return Stepper(problem, options)


@contextmanager
def _warnings_raised() -> Generator[None]:
    """Turn MuJoCo's warnings into an error; otherwise it fills the missing states and writes a log file."""
    messages: list[str] = []
    with (
        CALLBACK
    ):  # MuJoCo has one handler of warnings for all threads of a process, as it has one callback
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(messages.append)
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(before)
    if messages:
        raise SimulationError(f"MuJoCo gave up: {messages[0]}")
