"""Proofs of models' motions, and the file that holds their figures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import Field

from ..models.errors import InputError
from ..models.library.registry import Model, model_of
from ..models.problem import Problem, StopLaw
from ..models.spec import Real, Spec
from ..reference.proof.motion import Limits
from ..reference.proof.proof import Proof, Time
from ..reference.proof.proof import prove as prove_problem
from ..reference.taylor.numbers import PROJECTILE
from .runs.results import ResultFile

FORMAT = "trebucheck-proof-1"
_TO_A_LAUNCH = 60.0  # [s] longest motion that is enclosed in search of a launch


class ProvedValue(Spec):
    """A figure: its exact value is within the radius of the value."""

    name: str
    unit: str
    value: str = Field(description="decimal digits")
    radius: str = Field(description="decimal digits, rounded upwards")
    status: Literal["proved"] = "proved"


class ProofFile(ResultFile):
    """Figures of a proved motion."""

    format: Literal["trebucheck-proof-1"] = FORMAT
    model: str
    mechanism_hash: str
    stop_law: StopLaw
    until: Real | None = Field(description="end of the motion [s]; null: the launch")
    digits: int = Field(description="that were asked for")
    bits: int = Field(description="precision of the last trial")
    steps: int = Field(description="of the last trial")
    processor_time: Real = Field(description="of all trials [s]")
    figures: tuple[ProvedValue, ...]

    @classmethod
    def of(cls, proof: Proof) -> ProofFile:
        """The file of a proof."""
        mechanism = proof.problem.mechanism
        figures = [
            ProvedValue(name=name, unit=unit, value=str(known.value), radius=str(known.radius))
            for name, unit, known in proof.figures
        ]
        return cls.made_here(
            model=mechanism.name,
            mechanism_hash=mechanism.content_hash,
            stop_law=proof.problem.stop_law,
            until=None if proof.until is None else float(proof.until),
            digits=proof.digits,
            bits=proof.bits,
            steps=proof.steps,
            processor_time=proof.processor_time,
            figures=tuple(figures),
        )


def prove(
    model: Model = "fixed",
    digits: int = 12,
    until: Time | None = None,
    *,
    stop_law: StopLaw | str | None = None,
    most_steps: int = Limits.steps,
    timeout: float = Limits.seconds,
    progress: Callable[[int, float], None] | None = None,
) -> Proof:
    """Enclose a motion in ball arithmetic: every figure with a proved radius.

        >>> import trebucheck as tb
        >>> proof = tb.prove("fixed", digits=15)
        >>> round(proof.launch_time.value, 15)
        Decimal('2.742817755771455')

    Proved is the motion of the equations of :mod:`..reference.equations` with the mechanism's
    doubles taken exactly: 9.81 is the double next to 981/100.

    Args:
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        digits: of every figure, 1 to 200.
        until: end [s], a text as the decimal it says; a problem's own, else the launch, if left
            out.
        stop_law: a problem's own, else 'release-once', if left out.
        most_steps: limit of the steps of a trial.
        timeout: limit of processor time [s].
        progress: called with the trial's number and the time that it has proved so far [s].

    Raises:
        InputError: a name or value is not valid, or there is neither an end nor a launch.
        UndecidedError: an inequality stays undecided; the sentence names it.
        SimulationError: a limit is reached.
    """
    problem, until = problem_to_prove(model, until, stop_law)
    limits = Limits(steps=most_steps, seconds=timeout)
    return prove_problem(problem, digits, until, limits=limits, progress=progress)


def problem_to_prove(
    model: Model, until: Time | None, stop_law: StopLaw | str | None
) -> tuple[Problem, Time | None]:
    """The problem of a model, and the end of its motion [s]; None: the launch.

    Raises:
        InputError: a name or value is not valid, or there is neither an end nor a launch.
    """
    given = model_of(model)
    if isinstance(given, Problem):
        problem, until = given, given.duration if until is None else until
    else:
        problem = Problem(given, duration=_TO_A_LAUNCH)
    if stop_law is not None:
        problem = Problem(problem.mechanism, duration=problem.duration, stop_law=stop_law)
    mechanism = problem.mechanism
    if until is None and mechanism.marker(PROJECTILE) is None:
        raise InputError(
            f"{mechanism.name!r} has no marker {PROJECTILE!r} whose launch ends its motion: an "
            "end is needed, such as until=1.0."
        )
    return problem, until
