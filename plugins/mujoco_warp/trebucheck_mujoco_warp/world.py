"""Models in MuJoCo Warp, on the processor: by themselves, as a file has them, in single states."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from time import process_time
from typing import Any, ClassVar

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from trebucheck.engines.events import whole_steps
from trebucheck.engines.given import SteppedModel
from trebucheck.engines.mujoco.alone import model_text, recorded
from trebucheck.engines.mujoco.build import compiled, start_data
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import read_each_step, timed_reading
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.models.problem import Problem
from trebucheck_toolkit.mujoco_models import CompiledModel, Seen

wp.config.log_level = wp.LOG_WARNING  # else it prints a line for each kernel that it loads
_PUSHES = 1  # in a contact's type; others are sensors'


class World:
    """A model with the data of one world, and the functions that move it as Warp's graphs.

    A graph replays a function's kernels: launched one by one from Python they take a hundred times
    as long, to the same bits. What MuJoCo Warp has not is a NotImplementedError of `put_model`.
    """

    def __init__(self, model: Any, start: Any) -> None:
        with wp.ScopedDevice("cpu"):
            self.model: Any = mjw.put_model(model)
            self.model.opt.warn_overflow = 0  # lines in each step, of what `overflow` has
            self.data, self._other = (mjw.put_data(model, start) for _ in range(2))
        self._views: dict[str, Any] = {}

    forward = cached_property(lambda self: self._graph(mjw.forward))
    step = cached_property(lambda self: self._graph(mjw.step))

    def _graph(self, function: Callable[[Any, Any], None]) -> Callable[[], None]:
        """A function of the model and the data as a call without arguments."""
        with wp.ScopedDevice("cpu"):
            function(self.model, self._other)  # kernels are compiled where they are launched
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


def run_alone(problem: Problem, options: MujocoOptions) -> Recording:
    """Step MuJoCo Warp from the start to a problem's end or just beyond, and read it."""
    mechanism, rows = problem.mechanism, list[list[FloatArray]]()
    model = compiled(mechanism, model_text(mechanism, options))
    world = World(model, start_data(model))

    @read_each_step
    def read() -> None:
        rows.append([world.numbers(name) for name in ("qpos", "qvel", "sensordata")])

    read()
    for _ in range(whole_steps(problem.duration, options.timestep)):
        world.step()
        read()
    with timed_reading():
        world.forward()
        read()
        world.refuse_overflow()
        qpos, qvel, sensors = (np.array(each) for each in zip(*rows, strict=True))
        states = np.pad(np.hstack([qpos, qvel])[:-1], ((0, 0), (1, 0)))  # times apart
        # A step leaves the sensors of the state in which it began.
        return recorded("mujoco_warp", mechanism, model, states, sensors[1:])


def stepped(model: Any, start: Any, controls: FloatArray) -> SteppedModel:
    """Step a model as a file has it."""
    world, contact, spent = World(model, start), None, 0.0
    states = [(world.numbers("qpos"), world.numbers("qvel"))]
    kinds, count = world.data.contact.type.numpy(), world.data.nacon.numpy()
    advance = world.step  # captured before it is timed
    for k, control in enumerate(controls):
        world.view("ctrl")[:] = control
        began = process_time()
        advance()
        spent += process_time() - began
        states.append((world.numbers("qpos"), world.numbers("qvel")))
        if contact is None and (kinds[: count[0]] & _PUSHES).any():
            contact = k
    if contact is None:
        world.refuse_overflow()
    qpos, qvel = (np.array(each) for each in zip(*states, strict=True))
    return SteppedModel(qpos, qvel, contact, spent)


class Built(CompiledModel):
    """A mechanism's model with MuJoCo's bookkeeping, and MuJoCo Warp's functions of it."""

    roundoff: ClassVar[float] = 2.0**-24

    def __init__(self, mechanism: Mechanism, timestep: float) -> None:
        model = compiled(mechanism, mjcf(mechanism, timestep))
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        super().__init__(mechanism, model)
        self._world = World(model, start_data(model))
        self.first = self._world.numbers("qpos"), self._world.numbers("qvel")

    @property
    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self._world.model.body_mass.numpy().sum())

    def forward(self, q: FloatArray, u: FloatArray, generalized: FloatArray) -> Seen:
        """Readings in a state, under generalized forces on mechanism coordinates [N m, N]."""
        self._place(q, u, generalized)
        self._world.forward()
        sensors, centres, internal, a = (
            self._world.numbers(name) for name in ("sensordata", "xipos", "cfrc_int", "qacc_smooth")
        )
        return Seen(self._mass(), sensors, centres, internal[:, 3:], a)

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
