"""Mechanisms, equations of motion and the reference, for distributions built on trebucheck."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

from __future__ import annotations

from ..comparisons.prove import prove
from ..models.arrays import BoolArray, ComplexArray, FloatArray
from ..models.elements import (
    GROUND,
    AnyForceElement,
    AnyJoint,
    AnyStop,
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from ..models.errors import (
    EngineNotInstalledError,
    InputError,
    SimulationError,
    TrebucheckError,
    UnsupportedProblemError,
    shortened,
)
from ..models.files import refuse_unwritable, write_text
from ..models.kinematics import Kinematics
from ..models.launch import Launch, launch_interval, lead
from ..models.library.registry import model, models, parameters_type
from ..models.library.trebuchet import (
    ARM_STOP,
    COUNTERWEIGHT,
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    TrebuchetParameters,
    fixed,
    parameters_of,
    rolling,
)
from ..models.mechanism import Body, Mechanism
from ..models.problem import Problem, StopLaw
from ..models.shown import Reported, report_with
from ..models.spec import NonNegative, Positive, Real, Spec, Vector, schema_text
from ..models.trajectory import Trajectory, write_dataset
from ..reference.certification.certificate import load_certificate, reference_uncertainty
from ..reference.certification.certify import (
    BEYOND_LAUNCH,
    Key,
    MinimalMotion,
    Motion,
    Plan,
    read_quantities,
    vacuum_range,
)
from ..reference.certification.constrained import PointState
from ..reference.equations import Equations
from ..reference.perturbed import solve_scheduled
from ..reference.proof.balls import Ball, acb, arb, precision
from ..reference.proof.extrema import Extrema
from ..reference.proof.mechanics import (
    half_square,
    kinetic_energy,
    potential_energy,
    range_without_drag,
)
from ..reference.proof.numbers import as_coordinates
from ..reference.proof.printed import ClosedInterval, Standing
from ..reference.proof.proof import Enclosure, Proof
from ..reference.solution import Solution
from ..reference.solver import characteristic_time, solve, solve_to_launch
from ..reference.taylor.batch import launch_batch
from ..reference.taylor.solve import solve_taylor
from ..reference.throw.flight import (
    Air,
    Flight,
    Projectile,
    Release,
    Surroundings,
    World,
    drag_flight,
    fall_time,
    fly,
    range_rate,
    swing,
    world,
)
from ..reference.throw.throw import surroundings_of, throw
