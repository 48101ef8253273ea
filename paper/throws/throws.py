"""A machine's throw by the reference and by every engine, each read for the same figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...comparisons.runs.worker import Worker
from ...engines.protocol import Engine
from ...engines.registry import engine
from ...models.arrays import FloatArray
from ...models.errors import InputError, TrebucheckError
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import load_certificate
from ...reference.certification.certify import MinimalMotion
from ...reference.certification.quantities import BEYOND_LAUNCH
from ...reference.solution import Solution
from ...reference.solver import solve, solve_to_launch
from .allowances import Amplification, allowances, amplification
from .headline import Figures, read
from .sampled import SampledMotion
from .third_constraint import PREFIX, stopped_arm, stopped_by

_TAIL = 0.05  # [s] past the last instant that is read, so that polynomials have samples on both sides
_SAMPLES = 3000  # of the reference, over the whole motion, for what is read along it
_COARSE = 1e-12  # tolerance of the second integration, for figures that no certificate holds
_SAFETY = 4.0  # on the difference of the two, as where the certificate's own estimate is made
_ROUNDING = 64 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class EngineThrow:
    """One engine's throw of one machine."""

    engine: str
    figures: Figures = field(default_factory=dict[str, float])
    allowed: Figures = field(default_factory=dict[str, float])
    """Tolerance of each figure, where there is a bar behind it."""
    trajectory: Trajectory | None = None
    note: str | None = None
    """Why there is no throw."""
    lacking: Mapping[str, str] = field(default_factory=dict[str, str])
    """Why figures are missing whose names start like this."""


@dataclass(frozen=True)
class MachineThrow:
    """One machine's throw by all of them."""

    mechanism: Mechanism
    solution: Solution
    trajectory: Trajectory
    """The reference's, at its own times."""
    figures: Figures
    uncertainties: Figures
    engines: tuple[EngineThrow, ...]

    @property
    def launch_time(self) -> float:
        """[s]."""
        return self.figures["launch_time"]

    def at(self, times: FloatArray) -> Trajectory:
        """The reference at times [s]."""
        return self.solution.trajectory(times)


def throw_by_all(name: str, parameters: TrebuchetParameters, engines: Sequence[str], worker: Worker) -> MachineThrow:
    """Throw with a named machine under the paper's law of its stops, and once more with an arm stop that acts.

    Args:
        name: of the machine.
        parameters: of it.
        engines: names; one that is absent or fails becomes a throw with a note.
        worker: the process the engines run in.

    Raises:
        InputError: the machine does not launch.
    """
    mechanism = model(name, parameters)
    solution, until = _reference(mechanism)
    trajectory = solution.trajectory(np.linspace(0.0, until, _SAMPLES))
    figures = read(MinimalMotion(solution), trajectory)
    others = [each for each in engines if each != "reference"]
    throws = [_by(engine(each), mechanism, until, worker) for each in others]
    amplified = amplification(mechanism, parameters, until)
    return MachineThrow(
        mechanism=mechanism,
        solution=solution,
        trajectory=trajectory,
        figures=figures | stopped_arm(mechanism, until),
        uncertainties=_uncertainties(mechanism, figures, until),
        engines=tuple(_finished(each, mechanism, figures, amplified, until, worker) for each in throws),
    )


def _reference(mechanism: Mechanism) -> tuple[Solution, float]:
    """The motion up to the last instant that is read: the fastest release, or the arm's arrival at its stop."""
    launch = solve_to_launch(mechanism).launch
    if launch is None:
        raise InputError(f"{mechanism.name!r} does not launch, so the paper's figures of a throw are not there.")
    end = launch.time + BEYOND_LAUNCH
    looked_at = solve(Problem(mechanism, duration=end + 1.0))
    arrived = read(MinimalMotion(looked_at), looked_at.trajectory(np.linspace(0.0, end + 1.0, _SAMPLES)))
    until = max(end, arrived.get("arm at its stop", 0.0)) + _TAIL
    return solve(Problem(mechanism, duration=until)), until


def _uncertainties(mechanism: Mechanism, ours: Figures, until: float) -> Figures:
    """Of the certificate where it has the figure; else four times what a coarser integration changes, and rounding."""
    coarse = solve(Problem(mechanism, duration=until), _COARSE, _COARSE)
    other = read(MinimalMotion(coarse), coarse.trajectory(np.linspace(0.0, until, _SAMPLES)))
    found = {
        name: _SAFETY * abs(value - other[name]) + _ROUNDING * abs(value)
        for name, value in ours.items()
        if name in other
    }
    certificate = load_certificate(mechanism)
    found |= {figure.label: figure.uncertainty for figure in certificate.figures} if certificate else {}
    # Up to the launch both laws of a stop give one motion, and the blow follows from where the arm arrives.
    found |= {f"{PREFIX} {name}": width for name, width in found.items()}
    return found | {f"{PREFIX} arm stop acts": found["arm at its stop"]} if "arm at its stop" in found else found


def _by(runner: Engine, mechanism: Mechanism, until: float, worker: Worker) -> EngineThrow:
    try:
        trajectory = worker.simulate(runner, Problem(mechanism, duration=until))
        return EngineThrow(runner.name, read(SampledMotion(trajectory), trajectory), trajectory=trajectory)
    except TrebucheckError as error:
        return EngineThrow(runner.name, note=str(error))
    except Exception as error:  # a plug-in may raise anything; the study must survive it
        return EngineThrow(runner.name, note=f"{type(error).__name__}: {error}")


def _finished(
    throw: EngineThrow, mechanism: Mechanism, ours: Figures, amplified: Amplification, until: float, worker: Worker
) -> EngineThrow:
    """With its tolerances, and with what it finds where the arm's stop acts; one that failed is not asked again."""
    if throw.trajectory is None:
        return throw
    runner = engine(throw.engine)
    allowed = allowances(runner, mechanism, ours, amplified)
    stopped = stopped_by(runner, mechanism, until, worker)
    if stopped.note is not None:
        return replace(throw, allowed=allowed, lacking={PREFIX: stopped.note})
    # Up to the launch both laws give one motion, and the blow comes when the arm arrives.
    allowed |= {f"{PREFIX} {name}": width for name, width in allowed.items()}
    if "arm at its stop" in allowed:
        allowed[f"{PREFIX} arm stop acts"] = allowed["arm at its stop"] + stopped.noticed
    return replace(throw, figures=throw.figures | stopped.figures, allowed=allowed)
