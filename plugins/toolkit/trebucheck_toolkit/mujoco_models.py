"""Engines that compute on MuJoCo's compiled model, as MJX and MuJoCo Warp do.

By themselves they step the model that MuJoCo by itself has: soft limits and contacts for stops,
which stay in it whatever the law, equalities and contacts for loops, tendons for springs.

Assisted they move the tree of joints by their RK4 while nothing is held. Stops, loops and springs
are multipliers and generalized forces from their mass matrix and accelerations, integrated by RK4
as well; releases and impacts are located by trebucheck's driver.

The file that a mechanism was read from they move as it is (:class:`GivenCompiledModel`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, JsonValue, model_validator
from trebucheck.engines.events import Contacts, whole_steps
from trebucheck.engines.given import GivenModel, SteppedModel
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.mujoco.options import MujocoOptions, scaled_solref
from trebucheck.engines.mujoco.study import STUDY as MUJOCO_STUDY
from trebucheck.engines.mujoco.study import causes_of_file
from trebucheck.engines.presets import ASSISTED, DEFAULT, GIVEN, SETTINGS
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    Intervention,
    ModelFile,
    OptionSet,
    StepOrder,
    filled_template,
    time_step_cause,
    with_readout,
)
from trebucheck.engines.supplied import Assistance, Part, all_by
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import RotorInertia, SlideSpringDamper, TranslationJoint
from trebucheck.models.errors import InputError, UnsupportedProblemError
from trebucheck.models.features import COVERED_BY_FEATURES, Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import (
    KINETIC_ENERGY,
    POTENTIAL_ENERGY,
    mjcf_names,
    position_sensor,
    velocity_sensor,
)
from trebucheck.models.model_source import ModelSource
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Real

from .constrained import ConstrainedDynamics, Solved, subtree_sums
from .event_driver import EventDriver, Observation
from .scheme_tables import RK4_LOCATED

# --- Options


_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]
OWN = ("integrator", "solver", "tolerance", "iterations", "solref", "solimp", "margin")
"""Options of the engine itself beside the time step, which do nothing with multipliers."""
DEFAULTS: dict[str, object] = {
    "limits": "soft",
    "timestep": 2e-3,
    "integrator": "Euler",
    "tolerance": 1e-8,
    "solref": (0.02, 1.0),
    "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
    "margin": 0.0,
}
"""Options of an empty MuJoCo model."""
_HARDEST: Mapping[str, JsonValue] = {"solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0], "margin": 1e-12}
"""The hardest limits, contacts and equalities beside their `solref`."""
_MULTIPLIERS: Mapping[str, JsonValue] = {
    **_HARDEST,
    "limits": "multipliers",
    "integrator": "RK4",
    "solver": "Newton",
    "tolerance": 1e-30,
    "iterations": 100,
    "solref": None,
}
"""Options of the assisted preset."""


def capabilities_of(precision: str) -> Capabilities:
    """Capabilities of such an engine, which has all elements but restitution by itself."""
    return Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation=f"minimal relative joints, RK4, {precision} precision; stops, loops and "
        "springs by multipliers (by itself: soft limits, contacts, equalities and tendons)",
        features=frozenset(Feature),
        elements=COVERED_BY_FEATURES | {RotorInertia, SlideSpringDamper, TranslationJoint},
    )


def held_by_multipliers(title: str) -> tuple[Assistance, ...]:
    """Work that trebucheck does in the place of an engine with multipliers, by its title."""
    does = {
        Part.STEPS: "begins each step from the mechanism's coordinates; integrates "
        f"{title}'s accelerations by RK4 where something is held or a spring acts",
        Part.STOPS: "holds stops by multipliers",
        Part.LOOPS: "closes loops by multipliers",
        Part.ELEMENTS: "computes the forces of springs, dampers and motors",
        Part.EVENTS: "locates releases and impacts inside a step",
        Part.IMPACTS: f"resolves impacts with {title}'s mass matrix",
    }
    return all_by("limits", "soft", does)


class MujocoModelEngine(BuiltinEngine):
    """An engine on MuJoCo's compiled model; the defaults are the assisted preset.

    Raises:
        InputError: an option is unknown or outside its range, or one of the engine's own is changed
            where multipliers hold what it is about.
    """

    settings_options: ClassVar[Mapping[str, object] | None] = {"limits": "soft"}
    own: ClassVar[tuple[str, ...]] = OWN

    limits: Literal["multipliers", "soft"] = Field(
        default="multipliers",
        description="what holds stops and loops: multipliers, or the engine's soft limits, "
        "contacts and equalities",
    )
    integrator: Literal["RK4", "Euler", "implicitfast"] = Field(
        default="RK4", description="the engine's integrator; all but RK4 are of first order"
    )
    solver: Literal["Newton", "CG"] = Field(
        default="Newton", description="the engine's constraint solver"
    )
    tolerance: NonNegative = Field(default=1e-30, description="gain at which the solver stops")
    iterations: int = Field(default=100, ge=1, le=10_000, description="of the solver, at most")
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="reference of limits, contacts and equalities: time constant [s] and damping "
        "ratio if positive, -stiffness [1/s^2] and -damping [1/s] if negative; None: scaled with "
        "the time step",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        description="impedance of limits, contacts and equalities: d0, d_width, width, midpoint, "
        "power",
    )
    margin: NonNegative = Field(
        default=1e-12,
        le=1e-2,
        description="nearer than this to its limit, a joint feels it [rad]; of a point times the "
        "machine's size [m]",
    )

    @model_validator(mode="after")
    def _refuse_idle_options(self) -> Self:
        """Refuse options of the engine that do nothing beside multipliers."""
        if self.limits == "multipliers":
            for name in self.own:
                value, default = getattr(self, name), type(self).model_fields[name].default
                if value != default:
                    raise InputError(
                        f"{name} = {value!r} does nothing with limits = 'multipliers', which asks "
                        f"for {default!r}; limits = 'soft' takes it."
                    )
        return self

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Restitution, where limits are soft: they give back what their springs do."""
        return frozenset() if self.limits == "multipliers" else frozenset({Basic.REBOUND})

    @property
    def of_mujoco(self) -> MujocoOptions:
        """Options of MuJoCo for the model that the engine steps by itself."""
        return MujocoOptions(**{name: getattr(self, name) for name in ("timestep", *OWN)})

    def _run(self, problem: Problem) -> Recording:
        with unbuildable(self.name, problem.mechanism):
            if self.limits == "soft":
                return self._run_alone(problem)
            motion = Motion(problem.mechanism, self._built(tree_of(problem.mechanism)))
        return EventDriver(problem, motion, self.name, self.timestep).run()

    @abstractmethod
    def _run_alone(self, problem: Problem) -> Recording:
        """Step the engine by itself from the start to a problem's end or just beyond.

        Raises:
            NotImplementedError: the engine has not what the model needs; its own words.
            SimulationError: MuJoCo refused the model, or the engine gave up.
        """

    @abstractmethod
    def _built(self, mechanism: Mechanism) -> CompiledModel:
        """Build a tree of joints, which the engine's RK4 steps.

        Raises:
            NotImplementedError: the engine has not what the model needs; its own words.
        """

    def _script(self, problem: Problem) -> str:
        return program(type(self).__module__, problem, self.of_mujoco)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        with unbuildable(self.name, mechanism):
            motion = Motion(mechanism, self._built(tree_of(mechanism)))
        start, start_speeds = motion.built.start
        return Inspection(
            start=start,
            start_speeds=start_speeds,
            dynamics=tuple(motion.dynamics(state) for state in states),
            total_mass=motion.built.total_mass,
            roundoff=motion.built.roundoff,
        )


def tree_of(mechanism: Mechanism) -> Mechanism:
    """A mechanism without stops, loops and forces; rotors are a part of its joints."""
    rotors = tuple(each for each in mechanism.force_elements if isinstance(each, RotorInertia))
    alone = {"stops": (), "force_elements": rotors, "joints": mechanism.tree_joints}
    return mechanism.model_copy(update=alone)


@contextmanager
def unbuildable(engine: str, mechanism: Mechanism) -> Generator[None]:
    """Refuse what an engine has not, in its own words.

    Raises:
        UnsupportedProblemError: the engine has not what the model needs.
    """
    try:
        yield
    except NotImplementedError as error:
        raise UnsupportedProblemError(
            f"{engine} cannot build {mechanism.name!r}: {error}"
        ) from error


# --- Model files as they are


class GivenCompiledModel(GivenModel):
    """A file that MuJoCo compiles, moved by an engine that takes MuJoCo's models.

    MuJoCo reads it, and tells the energies of the engine's states. The engine's number format is no
    option of a file: it is an option here.
    """

    ignored: ClassVar[tuple[str, ...]] = ("disableactuator",)
    """Options of MuJoCo that the engine passes over in silence, and that are refused here."""

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.name

    @property
    def engine_version(self) -> str:
        """Version of the engine here."""
        return self.version()

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators of MuJoCo that the engine has, too, beside that of a file."""
        return "Euler", "implicitfast", "RK4"

    def read(self, source: ModelSource) -> ModelFile:
        """Read a mechanism again from its file, which is moved with these options."""
        from trebucheck.engines.mujoco.files import reread  # loads MuJoCo

        return reread(source, self)

    def stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        """Step a model, as of :class:`trebucheck.engines.given.ModelStepper`."""
        for option in self.ignored:
            value = getattr(model.opt, option)
            if value:
                raise NotImplementedError(f"the option {option} = {value}")
        return self._stepped(model, start, controls)

    @abstractmethod
    def _stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        """Step a model of whose options none is ignored."""


# --- The model in single states


@dataclass(frozen=True)
class Seen:
    """Readings of a model in a state."""

    mass: FloatArray
    """Full mass matrix, shape (n_v, n_v)."""
    sensors: FloatArray
    centres: FloatArray
    """World positions of the bodies' centres of mass [m], shape (n_body, 3)."""
    internal: FloatArray
    """Force of each body's parent on it, world frame [N], shape (n_body, 3)."""
    accelerations: FloatArray
    """Accelerations of MuJoCo's joints, nothing held, shape (n_v,)."""


class CompiledModel(ABC):
    """MuJoCo's compiled model of a mechanism, and an engine's functions of it."""

    roundoff: ClassVar[float] = 2.0**-53
    """Unit roundoff of the engine's numbers."""
    first: tuple[Any, Any]
    """Positions and speeds of MuJoCo's joints at the start, as built."""

    def __init__(self, mechanism: Mechanism, model: Any) -> None:
        # Imported here so that classes of engines and their options need no MuJoCo.
        from trebucheck.engines.mujoco.read import IN_PLANE, absolute_from_relative

        self.mechanism, self.model, self.in_plane = mechanism, model, IN_PLANE
        self.names = mjcf_names(mechanism)
        self.sums = absolute_from_relative(mechanism, model)
        """C with q = start + C qpos and u = C qvel, shape (n_q, n_v)."""
        self.differences = np.linalg.inv(self.sums)
        self.bodies = {each.name: self._body(each.name) for each in mechanism.bodies}
        sensors = {model.sensor(k).name: int(model.sensor(k).adr[0]) for k in range(model.nsensor)}
        self.sensors = {
            name: sensors[written] for name, written in self.names.items() if written in sensors
        }
        """Index of each sensor's first number, by the writer's name."""

    @property
    def start(self) -> tuple[FloatArray, FloatArray]:
        """The mechanism's coordinates and speeds at the start, as built."""
        return self.coordinates_of(*self.first)

    @property
    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self.model.body_mass.sum())

    def dynamics(
        self, q: FloatArray, u: FloatArray, generalized: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations of MuJoCo's joints and mass matrix in a state, under forces."""
        seen = self.forward(q, u, generalized)
        return seen.accelerations, seen.mass

    @abstractmethod
    def forward(self, q: FloatArray, u: FloatArray, generalized: FloatArray) -> Seen:
        """Readings in a state, under generalized forces on mechanism coordinates [N m, N]."""

    @abstractmethod
    def stepped(self, q: FloatArray, u: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """The state a step [s] later by the engine's RK4."""

    def joint_state(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and speeds of MuJoCo's joints in a state of the mechanism."""
        return self.differences @ (q - np.array(self.mechanism.start)), self.differences @ u

    def coordinates_of(self, positions: Any, speeds: Any) -> tuple[FloatArray, FloatArray]:
        """The mechanism's coordinates and speeds of those of MuJoCo's joints."""
        j, v = np.asarray(positions, dtype=np.float64), np.asarray(speeds, dtype=np.float64)
        return np.array(self.mechanism.start) + self.sums @ j, self.sums @ v

    def observe(self, seen: Seen, q: FloatArray, u: FloatArray) -> Observation:
        """Readings of the model; reactions without what acts on the bodies beyond their joints."""
        _, v = self.joint_state(q, u)
        kinetic = float(0.5 * v @ seen.mass @ v)
        weights = self.model.body_mass[:, None] * self.model.opt.gravity
        potential = -float(np.sum(weights * seen.centres))
        return Observation(
            points={
                m.name: (
                    self._vector(seen, position_sensor(m.name)),
                    self._vector(seen, velocity_sensor(m.name)),
                )
                for m in self.mechanism.markers
            },
            kinetic_energy=self._own(seen, KINETIC_ENERGY, kinetic),
            potential_energy=self._own(seen, POTENTIAL_ENERGY, potential),
            reactions={
                joint.name: seen.internal[self.bodies[joint.child]][self.in_plane]
                for joint in self.mechanism.tree_joints
                if joint.held_directions
            },
        )

    def centre(self, seen: Seen, body: str) -> FloatArray:
        """World position of a body's centre of mass [m]."""
        return seen.centres[self.bodies[body]][self.in_plane]

    def _vector(self, seen: Seen, sensor: str) -> FloatArray:
        return seen.sensors[self.sensors[sensor] :][:3][self.in_plane]

    def _own(self, seen: Seen, sensor: str, otherwise: float) -> float:
        """A sensor's number, or another one where the engine has no such sensor."""
        at = self.sensors.get(sensor)
        return float(otherwise if at is None else seen.sensors[at])

    def _body(self, name: str) -> int:
        return int(self.model.body(self.names[name]).id)


# --- Motion


class _Tree:
    """Forward dynamics of a model's tree, in mechanism coordinates."""

    def __init__(self, built: CompiledModel) -> None:
        self.built = built
        self._place: FloatArray | None = None
        """Where the mass matrix was last found; arrays of states are not written into."""
        self._mass = np.zeros((0, 0))

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """The engine's, nothing held."""
        a, mass = self.built.dynamics(q, u, applied)
        self._place, self._mass = q, mass
        return self.built.sums @ a

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """The engine's."""
        if self._place is not q:
            self.accelerations(q, np.zeros_like(q), np.zeros_like(q))
        return self.built.differences.T @ self._mass @ self.built.differences


class Motion(ConstrainedDynamics):
    """The tree moved by the engine's RK4 while nothing is held, else by RK4 on accelerations."""

    def __init__(self, mechanism: Mechanism, built: CompiledModel) -> None:
        self.built = built
        super().__init__(mechanism, _Tree(built))
        rotors = tree_of(mechanism).force_elements
        self.plain = not (mechanism.loop_joints or set(mechanism.force_elements) - set(rotors))

    def advance(
        self, state: tuple[FloatArray, FloatArray], step: float, held: Contacts
    ) -> tuple[FloatArray, FloatArray]:
        """The state a step [s] later, contacts and loops held."""
        if held or not self.plain:
            return self.stepped(state, step, held, "RK4")
        return self.built.stepped(*state, step)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and joint forces, as the engine has them."""
        shown = self.built.observe(self.built.forward(q, u, solved.generalized), q, u)
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return Observation(
            points=shown.points,
            kinetic_energy=shown.kinetic_energy,
            potential_energy=shown.potential_energy + float(self.applied.potential_energy(q)),
            reactions={name: force - others[name] for name, force in shown.reactions.items()}
            | dict(solved.loops),
        )

    def dynamics(self, state: State) -> Dynamics:
        """The built model in a state of the model check."""
        solved = self.solve(state.q, state.u, state.closed)
        built, back = self.built, self.built.differences
        applied = self.applied.generalized(state.q, state.u)
        seen, (a, mass) = (
            built.forward(state.q, state.u, applied),
            built.dynamics(state.q, state.u, applied),
        )
        return Dynamics(
            accelerations=solved.accelerations,
            stop_torques=solved.contacts,
            mass_matrix=back.T @ mass @ back,
            # The engine tells accelerations: what makes them is its mass matrix times these.
            forces=back.T @ mass @ a,
            centres={
                body.name: np.array(built.centre(seen, body.name)) for body in self.mechanism.bodies
            },
            stop_gaps={name: float(self.kinematics.gap(name, state.q)) for name in state.closed},
        )


# --- Entries for studies


ORDERS: Mapping[str, StepOrder] = {
    DEFAULT: StepOrder(
        None,
        "Euler's rule is of first order, and the limits' softness is fixed: it does not fall "
        "with the step",
        "semi-implicit Euler, joint coordinates",
    ),
    SETTINGS: StepOrder(
        None,
        "the limits' softness falls with the step's square, but a step goes over the kink at "
        "a release, wherever that is in it",
        RK4_LOCATED.scheme,
    ),
    GIVEN: MUJOCO_STUDY.step_orders[GIVEN],
    ASSISTED: RK4_LOCATED,
}
"""Orders of the time step, by preset."""
OPTION_SETS: tuple[OptionSet, ...] = (
    DEFAULT_SET,
    OptionSet("RK4", "default, with the integrator RK4", DEFAULT, {"integrator": "RK4"}),
    SETTINGS_SET,
    ASSISTED_SET,
)


def causes_by(
    assisted: Mapping[str, JsonValue], *others: Cause
) -> Callable[[Any, ConstraintKinds], tuple[Cause, ...]]:
    """Causes of errors by an engine's settings and what is constrained.

    Args:
        assisted: options of the assisted preset where they are not those of every such engine.
        others: causes with soft constraints, and of files as they are, beside these, the integrator
            and the time step.
    """

    def causes(settings: Any, constraints: ConstraintKinds) -> tuple[Cause, ...]:
        if "limits" not in settings:
            return (*others, *causes_of_file(settings, constraints))
        finer: dict[str, JsonValue] = {"timestep": float(settings["timestep"]) / REFINEMENT}
        if settings["limits"] == "multipliers":
            return with_readout(time_step_cause(finer))
        stiffest: list[JsonValue] = [
            *scaled_solref(float(settings["timestep"]), settings["integrator"])
        ]
        if settings["solref"] is None:  # it would follow the step
            finer["solref"] = stiffest
        constrained = (
            Cause(
                "soft constraints",
                "stops and loops are springs with dampers: they give way, begin without force, and "
                "a step goes over a release",
                Intervention({**_MULTIPLIERS, **assisted}),
            ),
            Cause(
                "constraint softness",
                "limits, contacts and equalities are softer than the step can bear",
                Intervention({**_HARDEST, "solref": stiffest}),
            ),
        )
        return with_readout(
            *(constrained if constraints.angles or constraints.points else ()),
            *others,
            Cause(
                "integrator",
                "the rule of a step, of first order but for RK4",
                Intervention({"integrator": "RK4"}),
            ),
            time_step_cause(finer),
        )

    return causes


def program(module: str, problem: Problem, options: MujocoOptions, **values: JsonValue) -> str:
    """The run of an engine by itself, by the template `alone.py.j2` beside a module of its own.

    Args:
        module: the name of that module.
        problem, options: of the run.
        values: further ones of the template, beside the model and what its joints stand for.
    """
    from trebucheck.engines.mujoco.alone import model_text
    from trebucheck.engines.mujoco.build import compiled
    from trebucheck.engines.mujoco.read import absolute_from_relative

    mechanism = problem.mechanism
    text = model_text(mechanism, options, sensors=False)
    return filled_template(
        module,
        "alone.py.j2",
        mjcf=text,
        steps=whole_steps(problem.duration, options.timestep),
        start=mechanism.start,
        sums=absolute_from_relative(mechanism, compiled(mechanism, text)).tolist(),
        **values,
    )
