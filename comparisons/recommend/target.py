"""What is asked of an engine: the largest errors up to the launch, in the units of the quantities."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from ...models.errors import InputError
from ...models.mechanism import Mechanism
from ...models.spec import Positive, Spec
from ...reference.certification.certificate import reference_uncertainty, refusal
from ...reference.solution import Solution
from ..runs.trials import Trial

_QUANTITIES = ("position", "torque", "release")
_METRICS = {"position": "position_max", "torque": "stop_torque_max", "release": "release_time"}
_SAMPLES = 2001  # of the reference, in search of the largest torque


class Asked(Spec):
    """Errors that must not be exceeded; None: anything will do.

    Raises:
        InputError: nothing is asked, a value is not positive and finite, or the torque is asked for in two ways.
    """

    position: Positive | None = Field(default=None, description="distance of the projectile at any sample [m]")
    torque: Positive | None = Field(
        default=None, description="of any stop's torque at any sample [N m, or N on points]"
    )
    torque_share: Positive | None = Field(
        default=None, description="the same, as a share of the largest stop torque of each machine's own reference"
    )
    release: Positive | None = Field(default=None, description="of any stop's release [s]")

    @model_validator(mode="after")
    def _asks_for_something(self) -> Self:
        if all(value is None for value in (self.position, self.torque, self.torque_share, self.release)):
            raise ValueError("nothing is asked; at least one of position, torque and release must be given")
        if self.torque is not None and self.torque_share is not None:
            raise ValueError("torque is asked in N m and as a share; only one of them can be given")
        return self

    def on(self, solution: Solution, end: float) -> dict[str, float]:
        """What is asked on one machine, by quantity, in its own unit.

        Args:
            end: of the compared motion [s].
        """
        share = None if self.torque_share is None else self.torque_share * largest_torque(solution, end)
        found = {"position": self.position, "torque": self.torque or share, "release": self.release}
        return {name: value for name, value in found.items() if value is not None}


def unit_of(quantity: str, mechanism: Mechanism) -> str:
    """Of a quantity that can be asked for."""
    return {"position": "m", "torque": mechanism.force_unit, "release": "s"}[quantity]


def largest_torque(solution: Solution, end: float) -> float:
    """The largest torque of any stop up to a time, by the reference [N m, N]."""
    torques = solution.motion(np.linspace(0.0, end, _SAMPLES)).stop_torques.values()
    return max((float(torque.max()) for torque in torques), default=0.0)


def refuse_what_cannot_be_judged(asked: Asked, solution: Solution, end: float) -> None:
    """Say now that the machine has no such quantity, or that its reference is not certain enough.

    Raises:
        InputError: the sentence names the quantity.
    """
    mechanism = solution.problem.mechanism
    allowed = asked.on(solution, end)
    if not any(stop.closed for stop in mechanism.stops) and {"torque", "release"} & set(allowed):
        raise InputError(f"{mechanism.name!r} has no stop that is closed at the start: only a position can be asked.")
    known = reference_uncertainty(solution, end)
    for quantity, value in allowed.items():
        refused = refusal(_METRICS[quantity], None, value, known.of(_METRICS[quantity]))
        if refused is not None:
            raise InputError(f"{quantity} = {value:g} {unit_of(quantity, mechanism)}: {refused}.")


def errors_of(trial: Trial, solution: Solution, end: float) -> dict[str, float]:
    """A trial's errors by quantity; infinite where the run failed or a release did not come."""
    if trial.deviation is None:
        return dict.fromkeys(_QUANTITIES, math.inf)
    position, torque = trial.position, trial.torque
    return {
        "position": math.inf if position is None else position,
        "torque": math.inf if torque is None else torque,
        "release": _release_error(trial, solution, end),
    }


def _release_error(trial: Trial, solution: Solution, end: float) -> float:
    due = [name for name, time in solution.release_times.items() if time is not None and time <= end]
    values = [trial.metric(f"release_time ({name})") for name in due if solution.problem.mechanism.stop(name).closed]
    return max((math.inf if value is None else abs(value) for value in values), default=0.0)


def read_torque(text: str) -> dict[str, float]:
    """'1e-3' as N m (or N), '0.1%' as a share of the largest: the field of :class:`Asked` and its value.

    Raises:
        InputError: it is no number.
    """
    number = text.strip()
    share = number.endswith("%")
    try:
        value = float(number.removesuffix("%"))
    except ValueError:
        raise InputError(
            f"--torque {text!r} is not a number of N m, or N (1e-3), nor a share of the largest stop torque (0.1%)."
        ) from None
    return {"torque_share": value / 100} if share else {"torque": value}
