"""The public names for type checkers; `__init__.py` loads them when they are first asked for."""

from .comparisons.audit import audit
from .comparisons.campaigns.campaign import campaign, open_campaign
from .comparisons.certify import certify
from .comparisons.compare import compare
from .comparisons.converge import converge
from .comparisons.diff import diff
from .comparisons.explain import explain
from .comparisons.horizon import horizon
from .comparisons.judge import judge
from .comparisons.matrix import matrix
from .comparisons.mjcf import mjcf
from .comparisons.prove import prove
from .comparisons.recommend import recommend
from .comparisons.runs.model_files import from_mjcf, rollout
from .comparisons.runs.study import cluster
from .conformance.check import check
from .engines.protocol import Capabilities, Engine
from .engines.registry import engine, engines
from .models.controls import ControlRecord
from .models.elements import (
    ConstantForce,
    ConstantTorque,
    Coupler,
    CouplerTerm,
    CubicTorsionSpring,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    TranslationJoint,
    WeldJoint,
)
from .models.errors import (
    EngineNotInstalledError,
    InputError,
    SimulationError,
    TrebucheckError,
    UnsupportedProblemError,
)
from .models.launch import Launch
from .models.library.registry import model, problem, problems
from .models.library.trebuchet import (
    CatapultParameters,
    FloatingArmParameters,
    HingedParameters,
    TrebuchetParameters,
    catapult,
    fixed,
    floating_arm,
    hinged,
    rolling,
)
from .models.mechanism import Body, Marker, Mechanism
from .models.mjcf import mjcf_path
from .models.mjcf.writer import mjcf_names
from .models.problem import Problem, StopLaw
from .models.trajectory import Trajectory
from .reference.motion import solve
from .reference.sensitivity.sensitivities import sensitivities
from .reference.taylor.batch import launches
from .reference.throw.throw import throw
from .version import __version__

__all__ = [
    "Body",
    "Capabilities",
    "CatapultParameters",
    "ConstantForce",
    "ConstantTorque",
    "ControlRecord",
    "Coupler",
    "CouplerTerm",
    "CubicTorsionSpring",
    "Engine",
    "EngineNotInstalledError",
    "FloatingArmParameters",
    "FreeJoint",
    "HingedParameters",
    "InputError",
    "Launch",
    "Marker",
    "Mechanism",
    "PinJoint",
    "PointStop",
    "PrismaticJoint",
    "Problem",
    "RecordedForce",
    "RecordedTorque",
    "RotationalSpringDamper",
    "RotorInertia",
    "SimulationError",
    "SlideInertia",
    "SlideSpringDamper",
    "SlotJoint",
    "SpringDamper",
    "Stop",
    "StopLaw",
    "Trajectory",
    "TranslationJoint",
    "TrebucheckError",
    "TrebuchetParameters",
    "UnsupportedProblemError",
    "WeldJoint",
    "__version__",
    "audit",
    "campaign",
    "catapult",
    "certify",
    "check",
    "cluster",
    "compare",
    "converge",
    "diff",
    "engine",
    "engines",
    "explain",
    "fixed",
    "floating_arm",
    "from_mjcf",
    "hinged",
    "horizon",
    "judge",
    "launches",
    "matrix",
    "mjcf",
    "mjcf_names",
    "mjcf_path",
    "model",
    "open_campaign",
    "paper",
    "problem",
    "problems",
    "prove",
    "recommend",
    "rolling",
    "rollout",
    "sensitivities",
    "solve",
    "throw",
]

def paper(*args: object, **options: object) -> object:
    """Audit of the paper, from the distribution trebucheck-paper."""
    ...
