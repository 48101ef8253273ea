"""How far can you trust a multibody engine, and why does it differ?

A trebuchet, described once, is solved by a Lagrangian reference and built again in MuJoCo, pymunk
and Exudyn; `compare` says how well they agree. No engine is imported before it is asked for.

    >>> import trebucheck as tb
    >>> machine = tb.rolling(tb.TrebuchetParameters(l1=9.5))
    >>> motion = tb.engine("reference").simulate(tb.Problem(machine, duration=2.6))
    >>> round(motion.launch().speed, 3)  # [m/s]
    110.401
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .models.shown import Renderer, show_with
from .renamed import install
from .version import __version__

if TYPE_CHECKING:
    from .comparisons.compare.study import compare
    from .comparisons.diff.study import diff
    from .comparisons.front.studies import certify, converge, explain, recommend
    from .comparisons.mjcf.model import mjcf
    from .conformance.check import check
    from .engines.protocol import Capabilities, Engine
    from .engines.registry import engine, engines
    from .models.elements import (
        ConstantForce,
        ConstantTorque,
        CubicTorsionSpring,
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
    from .models.errors import (
        EngineNotInstalledError,
        InputError,
        SimulationError,
        TrebucheckError,
        UnsupportedProblemError,
    )
    from .models.launch import Launch
    from .models.library.catapult import CatapultParameters, catapult
    from .models.library.floating_arm import FloatingArmParameters, floating_arm
    from .models.library.registry import model
    from .models.library.trebuchet import (
        HingedParameters,
        TrebuchetParameters,
        fixed,
        hinged,
        rolling,
    )
    from .models.mechanism import Body, Marker, Mechanism
    from .models.mjcf.paths import mjcf_path
    from .models.mjcf.writer import mjcf_names
    from .models.problem import Problem, StopLaw
    from .models.trajectory import Trajectory
    from .reference.throw.throw import throw

__all__ = [
    "Body",
    "Capabilities",
    "CatapultParameters",
    "ConstantForce",
    "ConstantTorque",
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
    "RotationalSpringDamper",
    "SimulationError",
    "SlotJoint",
    "SpringDamper",
    "Stop",
    "StopLaw",
    "Trajectory",
    "TrebucheckError",
    "TrebuchetParameters",
    "UnsupportedProblemError",
    "WeldJoint",
    "__version__",
    "catapult",
    "certify",
    "check",
    "compare",
    "converge",
    "diff",
    "engine",
    "engines",
    "explain",
    "fixed",
    "floating_arm",
    "hinged",
    "mjcf",
    "mjcf_names",
    "mjcf_path",
    "model",
    "paper",
    "recommend",
    "rolling",
    "throw",
]

install()

_ERRORS = (
    "EngineNotInstalledError",
    "InputError",
    "SimulationError",
    "TrebucheckError",
    "UnsupportedProblemError",
)
_JOINTS = ("FreeJoint", "PinJoint", "PrismaticJoint", "SlotJoint", "WeldJoint")
_FORCE_ELEMENTS = (
    "ConstantForce",
    "ConstantTorque",
    "CubicTorsionSpring",
    "RotationalSpringDamper",
    "SpringDamper",
)
# Loaded when first asked for (PEP 562): `import trebucheck` stays quick and free of engines.
_HOMES = {
    "compare": "comparisons.compare.study",
    "diff": "comparisons.diff.study",
    **dict.fromkeys(("certify", "converge", "explain", "recommend"), "comparisons.front.studies"),
    "mjcf": "comparisons.mjcf.model",
    "mjcf_names": "models.mjcf.writer",
    "mjcf_path": "models.mjcf.paths",
    "check": "conformance.check",
    "Capabilities": "engines.protocol",
    "Engine": "engines.protocol",
    "engine": "engines.registry",
    "Launch": "models.launch",
    "TrebuchetParameters": "models.library.trebuchet",
    "model": "models.library.registry",
    "Problem": "models.problem",
    "StopLaw": "models.problem",
    "Trajectory": "models.trajectory",
    "throw": "reference.throw.throw",
    "fixed": "models.library.trebuchet",
    "rolling": "models.library.trebuchet",
    **dict.fromkeys(("CatapultParameters", "catapult"), "models.library.catapult"),
    **dict.fromkeys(("HingedParameters", "hinged"), "models.library.trebuchet"),
    **dict.fromkeys(("FloatingArmParameters", "floating_arm"), "models.library.floating_arm"),
    **dict.fromkeys(_ERRORS, "models.errors"),
    **dict.fromkeys(("Body", "Marker", "Mechanism"), "models.mechanism"),
    **dict.fromkeys((*_JOINTS, "PointStop", "Stop", *_FORCE_ELEMENTS), "models.elements"),
}


def __getattr__(name: str) -> Any:
    if name == "engines":  # a subpackage that can be called: see its docstring
        return importlib.import_module(f".{name}", __name__)
    if name == "paper":
        return _paper()
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def _renderer() -> Renderer:
    from .comparisons.report.pages import session  # when something is shown, not before

    return session


show_with(_renderer)


def _paper() -> Any:
    """The audit of the paper, which is a distribution of its own."""
    try:
        return importlib.import_module("trebucheck_paper").paper
    except ImportError as error:
        raise AttributeError(
            "trebucheck.paper is in the distribution trebucheck-paper: pip install ./paper"
        ) from error


def __dir__() -> list[str]:
    return sorted(__all__)
