"""Engines with a fault built in, for the tests that the checks catch it and name it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from conftest import fewer
from scipy.optimize import brentq
from trebucheck.comparisons import compare as comparing
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.results import Outcome, Run
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Until
from trebucheck.engines import registry
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.kinematics import Kinematics
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import solve_scheduled, without_centrifugal
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

P = tb.TrebuchetParameters
TABLE_ONE = P()
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")


JUDGED_TO = {"fixed": 2.0, "rolling": 2.0} | fewer({}, {"hinged": 1.3, "floating-arm": 1.4})
"""[s] Every stop is open by then; no fault needs the launch to be seen."""


def _same(x: Any) -> Any:
    return x


@dataclass(frozen=True)
class Faulty:
    """An engine that is given a wrong machine, moves it by its own law, or is read wrongly."""

    inner: Any
    machine: Callable[[tb.Mechanism], tb.Mechanism] = _same
    state: Callable[[State], State] = _same
    law: Callable[[tb.Problem], Solution] | None = None
    reading: Callable[[tb.Trajectory], tb.Trajectory] = _same

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def capabilities(self) -> tb.Capabilities:
        return self.inner.capabilities

    @property
    def preset(self) -> str:
        return self.inner.preset

    @property
    def settings(self) -> dict[str, Any]:
        return self.inner.settings

    @property
    def timestep(self) -> float | None:
        return self.inner.timestep

    def inspect(self, mechanism: tb.Mechanism, states: Sequence[State]) -> Inspection:
        return self.inner.inspect(self.machine(mechanism), [self.state(state) for state in states])

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        wrong = tb.Problem(self.machine(problem.mechanism), duration=problem.duration)
        moved = self.inner.simulate(wrong)
        if self.law is not None:
            moved = self.law(wrong).trajectory(moved.t, moved.provenance)
        stops = {stop.name: None for stop in problem.mechanism.stops}
        nothing = dict.fromkeys(stops, np.zeros(len(moved.t)))
        whole = replace(
            moved,
            mechanism=problem.mechanism,
            stop_torques=nothing | dict(moved.stop_torques),
            release_times=stops | dict(moved.release_times),
        )
        return self.reading(whole)


@dataclass(frozen=True)
class Fault:
    """A fault, the tier that catches it, and words of its cause."""

    name: str
    tier: Outcome
    cause: str
    """Must stand in the name (or amount) of one of the first two causes; ''.

    The cause need not be named.
    """
    parts: dict[str, Any]
    engine: str = "mujoco"
    options: dict[str, Any] | None = None
    text: Callable[[str], str] | None = None
    """How MuJoCo's model text is spoilt."""
    patch: Callable[[pytest.MonkeyPatch], None] | None = None
    """How an engine's code is spoilt."""


@cache
def _runner(mechanism: tb.Mechanism, until: Until, law: tb.StopLaw) -> Runner:
    """Of the right mechanism.

    No fault is in its reference, which is solved once for all of them.
    """
    return Runner(mechanism, Worker(isolate=False), until, law)


def run_with(fault: Fault, model: str, monkeypatch: pytest.MonkeyPatch) -> Run:
    """As `compare` runs it: the fault's own engine, spoilt on the way in."""
    if fault.text:
        rounded_text(monkeypatch, fault.text)
    if fault.patch:
        fault.patch(monkeypatch)
    make = registry.engine

    def spoilt(name: str, preset: str, **options: Any) -> Any:
        inner = make(name, preset, **options)
        return Faulty(inner, **fault.parts) if fault.parts else inner

    def runner(mechanism: tb.Mechanism, _: Worker, until: Until, law: tb.StopLaw) -> Runner:
        if "machine" in fault.parts:
            refuse_idle(fault.parts["machine"](mechanism) != mechanism, fault.name)
        return _runner(mechanism, until, law)

    monkeypatch.setattr(comparing, "Runner", runner)
    monkeypatch.setattr(registry, "engine", spoilt)  # with other options it is as faulty
    results = tb.compare(
        [model],
        [fault.engine],
        ["assisted"],
        until=JUDGED_TO.get(model),
        isolate=False,
        **(fault.options or {}),
    ).results
    return results.runs[0]


def refuse_idle(changed: bool, what: str) -> None:
    """Fail a test whose fault changes nothing: it looks for a name that has gone, say."""
    if not changed:
        pytest.fail(
            f"the fault changes nothing: {what}"
        )  # no Exception, which a comparison would take for the engine's


def parameters(**changes: float) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine with other parameters."""
    build = {"fixed": tb.fixed, "rolling": tb.rolling}
    return lambda mechanism: build[mechanism.name](P(**changes))


def body(
    name: str, **changes: float | Callable[[Any], float]
) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine with another body."""

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        old = mechanism.body(name)
        new = {key: value(old) if callable(value) else value for key, value in changes.items()}
        bodies = [b.model_dump() | (new if b.name == name else {}) for b in mechanism.bodies]
        return tb.Mechanism(**{**mechanism.model_dump(), "bodies": bodies})

    return wrong


def without(stop: str) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine without a stop."""

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        stops = [s.model_dump() for s in mechanism.stops if s.name != stop]
        return tb.Mechanism(**{**mechanism.model_dump(), "stops": stops})

    return wrong


def without_joint(joint: str) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine without a joint that closes a loop."""

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        joints = [j.model_dump() for j in mechanism.joints if j.name != joint]
        return tb.Mechanism(**{**mechanism.model_dump(), "joints": joints})

    return wrong


def tilted_slot(name: str, angle: float) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine with a level slot turned by an angle [rad] about where its point starts."""

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        slot = next(joint for joint in mechanism.joints if joint.name == name)
        about = _start_place(mechanism, slot.child, slot.child_point)
        turned = {"axis": (np.cos(angle), np.sin(angle)), "parent_point": about}
        joints = [j.model_dump() | (turned if j.name == name else {}) for j in mechanism.joints]
        return tb.Mechanism(**{**mechanism.model_dump(), "joints": joints})

    return wrong


def tilted_wall(name: str, angle: float) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """The machine with the level wall of a stop turned by an angle [rad] about where its point
    starts.
    """

    def wrong(mechanism: tb.Mechanism) -> tb.Mechanism:
        stop = mechanism.stop(name)
        normal = (-np.sin(angle), np.cos(angle))
        turned = {
            "normal": normal,
            "offset": np.dot(normal, _start_place(mechanism, stop.body, stop.point)),
        }
        stops = [s.model_dump() | (turned if s.name == name else {}) for s in mechanism.stops]
        return tb.Mechanism(**{**mechanism.model_dump(), "stops": stops})

    return wrong


def _start_place(
    mechanism: tb.Mechanism, body: str, point: tuple[float, float]
) -> tuple[float, float]:
    kinematics = Kinematics(mechanism)
    x, y = kinematics.position(kinematics.point(body, point), np.array(mechanism.start))
    return float(x), float(y)


def at_rest(state: State) -> State:
    """The state as an engine sees it that leaves velocity-dependent forces out."""
    return State(state.q, np.zeros_like(state.u), state.closed)


def no_centrifugal(problem: tb.Problem) -> Solution:
    right = solve(problem)
    return solve_scheduled(problem, right.release_times, without_centrifugal(problem.mechanism))


def never(stop: str) -> Callable[[tb.Problem], Solution]:
    """A law by which a stop never opens."""

    def law(problem: tb.Problem) -> Solution:
        right = solve(problem).release_times
        refuse_idle(stop in right, f"{stop} never opens")
        return solve_scheduled(problem, {**right, stop: None})

    return law


def released_as_if_alone(problem: tb.Problem) -> Solution:
    """The hanger's release by the torque it would carry were the sling free.

    Another active set than the actual one.
    """
    right, equations = solve(problem), Equations(problem.mechanism)
    time = right.release_times["hanger rest"]
    if time is None:
        return right
    held = solve_scheduled(problem, {**right.release_times, "hanger rest": None})

    def alone(t: float) -> float:
        motion = held.motion(np.array([t]))
        return float(equations.solve(motion.q[0], motion.u[0], ("hanger rest",))[1][0])

    wrong = brentq(alone, time - 0.05, time + 0.1, xtol=1e-14)
    return solve_scheduled(problem, {**right.release_times, "hanger rest": wrong})


def rounded_text(monkeypatch: pytest.MonkeyPatch, change: Callable[[str], str]) -> None:
    """MuJoCo is given another text of its model."""
    from trebucheck.engines.mujoco import build as _mujoco_model

    right = _mujoco_model.mjcf

    def spoilt(*arguments: Any) -> str:
        text = right(*arguments)
        refuse_idle(
            (wrong := change(text)) != text, f"{change.__name__} of {len(text)} characters of MJCF"
        )
        return wrong

    monkeypatch.setattr(_mujoco_model, "mjcf", spoilt)


def six_digits(text: str) -> str:
    return NUMBER.sub(lambda number: f"{float(number[0]):.6g}", text)


def damped(text: str) -> str:
    """One joint of the model with viscous damping."""
    return re.sub(r'<joint ([^>]*name="hanger_pin")', r'<joint damping="1" \1', text)


def scaled_torques(trajectory: tb.Trajectory) -> tb.Trajectory:
    return replace(
        trajectory, stop_torques={n: 1.001 * v for n, v in trajectory.stop_torques.items()}
    )


def flipped_torque(trajectory: tb.Trajectory) -> tb.Trajectory:
    torques = {**trajectory.stop_torques, "sling rest": -trajectory.stop_torques["sling rest"]}
    return replace(trajectory, stop_torques=torques)


def flipped_force(trajectory: tb.Trajectory) -> tb.Trajectory:
    """The force of the trough with the wrong sign."""
    return replace(trajectory, stop_torques={"trough": -trajectory.stop_torques["trough"]})


def half_a_step_late(trajectory: tb.Trajectory) -> tb.Trajectory:
    half = 0.5 * float(np.median(np.diff(trajectory.t)))
    return replace(trajectory, t=np.concatenate([[0.0], trajectory.t[1:] - half]))


def energy_of_the_step_before(trajectory: tb.Trajectory) -> tb.Trajectory:
    energy = trajectory.kinetic_energy
    return replace(trajectory, kinetic_energy=np.concatenate([energy[:1], energy[:-1]]))


def releases_at_steps_ends(trajectory: tb.Trajectory) -> tb.Trajectory:
    times = {n: v and float(np.ceil(v * 1e3) / 1e3) for n, v in trajectory.release_times.items()}
    return replace(trajectory, release_times=times)
