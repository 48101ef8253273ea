"""The MuJoCo Warp model of a mechanism on the processor: by itself, and in single states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from trebucheck.engines.events import ContactEvents, note_own_releases, whole_steps
from trebucheck.engines.mujoco.alone import model_text
from trebucheck.engines.mujoco.build import compiled, start_data, stop_constraints
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.mujoco.read import Samples, recording
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import read_each_step, timed_reading
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.models.problem import Problem
from trebucheck_toolkit.mujoco_models import CompiledModel, Seen, unbuildable

wp.config.log_level = wp.LOG_WARNING  # else it prints a line for each kernel that it loads


class World:
    """A model with the data of one world, and the functions that move it as Warp's graphs.

    A graph replays the kernels that a function launches: launched one by one from Python they take
    a hundred times as long. The states are the same to the last bit.

    Raises:
        UnsupportedProblemError: MuJoCo Warp has not what the model needs; its own words.
    """

    def __init__(self, model: Any, mechanism: Mechanism) -> None:
        start = start_data(model)
        with unbuildable("mujoco_warp", mechanism), wp.ScopedDevice("cpu"):
            self.model: Any = mjw.put_model(model)
            self.model.opt.warn_overflow = 0  # lines in each step, of what `overflow` has
            self.data: Any = mjw.put_data(model, start)
            self.forward, self.step = (
                self._graph(function, mjw.put_data(model, start))
                for function in (mjw.forward, mjw.step)
            )
        self._views: dict[str, Any] = {}

    def _graph(self, function: Callable[[Any, Any], None], other: Any) -> Callable[[], None]:
        """A function of the model and the data as a call without arguments."""
        function(self.model, other)  # kernels are compiled where they are launched
        with wp.ScopedCapture(device="cpu") as capture:
            function(self.model, self.data)
        return lambda: wp.capture_launch(capture.graph)

    def view(self, name: str) -> Any:
        """An array of the data, which on the processor is the data's own memory."""
        if name not in self._views:
            self._views[name] = getattr(self.data, name).numpy()[0]
        return self._views[name]

    def numbers(self, name: str) -> FloatArray:
        """A copy of an array of the data, in double precision."""
        return self.view(name).astype(np.float64)

    def refuse_overflow(self) -> None:
        """Raise SimulationError if contacts or constraints did not find room, and were left out."""
        kinds = mjw.OverflowType
        left_out = kinds(self.data.overflow.numpy()[0]) & ~(kinds.ITERATIONS | kinds.LS_ITERATIONS)
        if left_out:  # beside a solver that stops at its last iteration, and goes on
            raise SimulationError(f"mujoco_warp left constraints out: {left_out!r}.")


# --- By itself


def run_alone(problem: Problem, options: MujocoOptions) -> Recording:
    """Step MuJoCo Warp from the start to a problem's end or just beyond, and read it.

    Raises:
        SimulationError: MuJoCo refused the model, or constraints were left out.
        UnsupportedProblemError: MuJoCo Warp has not what the model needs.
    """
    mechanism, steps = problem.mechanism, whole_steps(problem.duration, options.timestep)
    model = compiled(mechanism, model_text(mechanism, options))
    world = World(model, mechanism)
    states, sensors = list[FloatArray](), list[FloatArray]()

    @read_each_step
    def read_state() -> None:
        states.append(np.concatenate([world.numbers("qpos"), world.numbers("qvel")]))

    @read_each_step
    def read_sensors() -> None:
        sensors.append(world.numbers("sensordata"))

    read_state()
    for _ in range(steps):
        world.step()
        read_sensors()  # those of the state in which the step began
        read_state()
    with timed_reading():
        world.forward()
        read_sensors()
        world.refuse_overflow()
        samples, events = Samples(steps=steps), ContactEvents(mechanism, "mujoco_warp")
        times: FloatArray = options.timestep * np.arange(steps + 1, dtype=np.float64)
        samples.add(times, np.pad(states, ((0, 0), (1, 0))), np.array(sensors))  # times apart
        recorded = recording(mechanism, model, stop_constraints(mechanism, model), samples, events)
        note_own_releases(events, times, recorded.stop_torques)
        return recorded


# --- Assisted


class Built(CompiledModel):
    """A mechanism's model with MuJoCo's bookkeeping, and MuJoCo Warp's functions of it."""

    roundoff: ClassVar[float] = 2.0**-24

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        """Build it.

        Raises:
            UnsupportedProblemError: MuJoCo Warp has not what the model needs; its own words.
        """
        model = compiled(mechanism, mjcf(mechanism, timestep))
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        super().__init__(mechanism, model)
        self._world = World(model, mechanism)
        self._first = self._world.numbers("qpos"), self._world.numbers("qvel")

    @property
    def start(self) -> tuple[FloatArray, FloatArray]:
        """The mechanism's coordinates and speeds at the start, as built."""
        return self.coordinates_of(*self._first)

    @property
    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self._world.model.body_mass.numpy().sum())

    def dynamics(
        self, q: FloatArray, u: FloatArray, generalized: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations of MuJoCo's joints and mass matrix in a state, under forces."""
        self._place(q, u, generalized)
        self._world.forward()
        return self._world.numbers("qacc_smooth"), self._mass()

    def forward(self, q: FloatArray, u: FloatArray, generalized: FloatArray) -> Seen:
        """Readings in a state, under generalized forces on mechanism coordinates [N m, N]."""
        self._place(q, u, generalized)
        self._world.forward()
        sensors, centres, internal = (
            self._world.numbers(name) for name in ("sensordata", "xipos", "cfrc_int")
        )
        return Seen(self._mass(), sensors, centres, internal[:, 3:])

    def stepped(self, q: FloatArray, u: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """The state a step [s] later by MuJoCo Warp's RK4."""
        self._place(q, u, np.zeros_like(q))
        self._world.model.opt.timestep.fill_(step)
        self._world.step()
        return self.coordinates_of(self._world.numbers("qpos"), self._world.numbers("qvel"))

    def _place(self, q: FloatArray, u: FloatArray, generalized: FloatArray) -> None:
        j, v = self.joint_state(q, u)
        forces = self.sums.T @ generalized
        for name, values in (("qpos", j), ("qvel", v), ("qfrc_applied", forces)):
            self._world.view(name)[:] = values

    def _mass(self) -> FloatArray:
        n, model = int(self.model.nv), self.model
        full, packed = np.zeros((n, n)), np.ravel(self._world.numbers("M"))[: model.nC]
        mujoco.mju_sym2dense(full, packed, model.M_rownnz, model.M_rowadr, model.M_colind)
        return full
