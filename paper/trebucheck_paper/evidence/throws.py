"""A machine's throw by the reference and by every engine, each read for the same quantities.

The paper's third constraint, the arm's stop, acts under the law by which a stop can close: a second
motion, of which only the launch and the first blow on that stop are read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from trebucheck.api.engines import Engine, engine
from trebucheck.api.mechanics import (
    ARM_STOP,
    BEYOND_LAUNCH,
    FloatArray,
    InputError,
    Key,
    Mechanism,
    MinimalMotion,
    Motion,
    Problem,
    Solution,
    StopLaw,
    Trajectory,
    TrebuchetParameters,
    load_certificate,
    model,
    solve,
    solve_to_launch,
    vacuum_range,
)
from trebucheck.api.studies import Worker

from .engine_runs import Amplification, SampledMotion, allowances, amplification, attempted
from .quantities import (
    ARM_ARRIVAL,
    FIRST_BLOW,
    LAUNCH_SPEED,
    LAUNCH_TIME,
    RANGE,
    Readings,
    certified,
    read,
)

# [s] past the last instant that is read, so that polynomials have samples on both sides.
_TAIL = 0.05
_SAMPLES = 3000  # of the reference, over the whole motion, for what is read along it
_COARSE = 1e-12  # tolerance of the second integration, for quantities that no certificate holds
_SAFETY = 4.0  # on the difference of the two, as where the certificate's own estimate is made
_ROUNDING = 64 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class EngineThrow:
    """One engine's throw of one machine."""

    engine: str
    values: Readings = field(default_factory=Readings)
    tolerances: Readings = field(default_factory=Readings)
    """Tolerance of each value that has an agreement tolerance."""
    trajectory: Trajectory | None = None
    note: str | None = None
    """Why there is no throw."""
    lacking: Mapping[StopLaw, str] = field(default_factory=dict[StopLaw, str])
    """Why there are no values under a law."""


@dataclass(frozen=True)
class MachineThrow:
    """One machine's throw by all of them."""

    mechanism: Mechanism
    solution: Solution
    trajectory: Trajectory
    """The reference's, at its own times."""
    values: Readings
    uncertainties: Readings
    engines: tuple[EngineThrow, ...]

    @property
    def launch_time(self) -> float:
        """[s]."""
        return self.values[LAUNCH_TIME]

    def at(self, times: FloatArray) -> Trajectory:
        """The reference at times [s]."""
        return self.solution.trajectory(times)


def throw_by_all(
    name: str, parameters: TrebuchetParameters, engines: Sequence[str], worker: Worker
) -> MachineThrow:
    """Throw with a named machine under the paper's stop law, and again with an acting arm stop.

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
    values = read(MinimalMotion(solution), trajectory)
    others = [each for each in engines if each != "reference"]
    throws = [_by(engine(each), mechanism, until, worker) for each in others]
    amplified = amplification(mechanism, parameters, until)
    return MachineThrow(
        mechanism=mechanism,
        solution=solution,
        trajectory=trajectory,
        values=values | _with_arm_stop(mechanism, until),
        uncertainties=_uncertainties(mechanism, values, until),
        engines=tuple(
            _finished(each, mechanism, values, amplified, until, worker) for each in throws
        ),
    )


def _reference(mechanism: Mechanism) -> tuple[Solution, float]:
    """Motion up to the last instant read: the fastest release, or the arm's arrival at its stop."""
    launch = solve_to_launch(mechanism).launch
    if launch is None:
        raise InputError(
            f"{mechanism.name!r} does not launch, so the paper's quantities of a throw are not "
            "there."
        )
    end = launch.time + BEYOND_LAUNCH
    longer = solve(Problem(mechanism, duration=end + 1.0))
    arrived = read(MinimalMotion(longer), longer.trajectory(np.linspace(0.0, end + 1.0, _SAMPLES)))
    until = max(end, arrived.get(ARM_ARRIVAL, 0.0)) + _TAIL
    return solve(Problem(mechanism, duration=until)), until


def _uncertainties(mechanism: Mechanism, ours: Readings, until: float) -> Readings:
    """Uncertainties of the certificate, else four times a coarser integration's change.

    The coarser one is read at half as many instants, so that what is fitted to samples is known no
    better than that.
    """
    coarse = solve(Problem(mechanism, duration=until), _COARSE, _COARSE)
    other = read(MinimalMotion(coarse), coarse.trajectory(np.linspace(0.0, until, _SAMPLES // 2)))
    widths = {
        quantity: _SAFETY * abs(value - other[quantity]) + _ROUNDING * abs(value)
        for quantity, value in ours.items()
        if quantity in other
    }
    certificate = load_certificate(mechanism)
    for figure in certificate.figures if certificate else ():
        widths[certified(Key(figure.name, figure.subject, figure.at, figure.unit))] = (
            figure.uncertainty
        )
    return widths | _carried_over(widths)


def _carried_over(widths: Readings, noticed: float = 0.0) -> Readings:
    """Widths of the same quantities where the arm's stop acts.

    Up to the launch both laws of a stop give one motion, and the blow comes when the arm arrives.

    Args:
        widths: under the paper's law.
        noticed: how much later than it happens the blow may be noticed [s].
    """
    unilateral = {quantity.under(StopLaw.UNILATERAL): width for quantity, width in widths.items()}
    return (
        unilateral | {FIRST_BLOW: widths[ARM_ARRIVAL] + noticed}
        if ARM_ARRIVAL in widths
        else unilateral
    )


def _by(runner: Engine, mechanism: Mechanism, until: float, worker: Worker) -> EngineThrow:
    def run() -> EngineThrow:
        trajectory = worker.simulate(runner, Problem(mechanism, duration=until))
        return EngineThrow(
            runner.name, read(SampledMotion(trajectory), trajectory), trajectory=trajectory
        )

    result = attempted(run)
    return EngineThrow(runner.name, note=result) if isinstance(result, str) else result


def _finished(
    throw: EngineThrow,
    mechanism: Mechanism,
    ours: Readings,
    amplified: Amplification,
    until: float,
    worker: Worker,
) -> EngineThrow:
    """Throw with its tolerances and its values where the arm stop acts; failed ones unchanged."""
    if throw.trajectory is None:
        return throw
    runner = engine(throw.engine)
    tolerances = allowances(runner, mechanism, ours, amplified)

    def run() -> tuple[Readings, float]:
        problem = Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL)
        trajectory = worker.simulate(runner, problem)
        return _read_with_arm_stop(SampledMotion(trajectory), trajectory)

    stopped = attempted(run)
    if isinstance(stopped, str):
        return replace(throw, tolerances=tolerances, lacking={StopLaw.UNILATERAL: stopped})
    values, noticed = stopped
    return replace(
        throw,
        values=throw.values | values,
        tolerances=tolerances | _carried_over(tolerances, noticed),
    )


def _with_arm_stop(mechanism: Mechanism, until: float) -> Readings:
    """Reference launch and first blow on the unilateral arm stop, up to a time [s]."""
    solution = solve(Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL))
    return _read_with_arm_stop(
        MinimalMotion(solution), solution.trajectory(np.linspace(0.0, until, _SAMPLES))
    )[0]


def _read_with_arm_stop(motion: Motion, trajectory: Trajectory) -> tuple[Readings, float]:
    """Values, and how much later than it happens a blow may be noticed [s].

    An engine that resolves the blow as an impact gives its instant; one that only shows that the
    stop pushes gives the sample after it.
    """
    readings: Readings = {}
    if motion.launch is not None:
        readings[LAUNCH_TIME] = motion.launch.time
        readings[LAUNCH_SPEED] = motion.launch.speed
        readings[RANGE] = vacuum_range(motion, trajectory.mechanism.gravity, motion.launch.time)
    readings = {quantity.under(StopLaw.UNILATERAL): value for quantity, value in readings.items()}
    blow, noticed = _first_blow(trajectory)
    return readings | ({} if blow is None else {FIRST_BLOW: blow}), noticed


def _first_blow(trajectory: Trajectory) -> tuple[float | None, float]:
    """Time [s] of the first blow and its delay [s]: an impact, else the first pushing sample."""
    blows = [time for time, impulses in trajectory.impacts if ARM_STOP in impulses]
    if blows:
        return blows[0], 0.0
    torque = trajectory.stop_torques.get(ARM_STOP)
    pushing = np.flatnonzero(torque > 0) if torque is not None else []
    if not len(pushing):
        return None, 0.0
    i = int(pushing[0])
    return float(trajectory.t[i]), float(trajectory.t[i] - trajectory.t[max(i - 1, 0)])
