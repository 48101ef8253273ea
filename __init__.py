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
import sys
from types import ModuleType
from typing import Any

from .models.shown import Renderer, show_with
from .renamed import install
from .version import __version__ as __version__

# Module: its public names. They are loaded when first asked for (PEP 562): `import trebucheck`
# stays quick and free of engines. `__init__.pyi` has the same for type checkers; a test holds the
# two equal.
_PUBLIC = {
    "comparisons.audit": "audit",
    "comparisons.campaigns.campaign": "campaign open_campaign",
    "comparisons.certify": "certify",
    "comparisons.compare": "compare",
    "comparisons.converge": "converge",
    "comparisons.diff": "diff",
    "comparisons.explain": "explain",
    "comparisons.horizon": "horizon",
    "comparisons.judge": "judge",
    "comparisons.matrix": "matrix",
    "comparisons.mjcf": "mjcf",
    "comparisons.prove": "prove",
    "comparisons.recommend": "recommend",
    "comparisons.runs.model_files": "from_mjcf rollout",
    "comparisons.runs.study": "cluster",
    "conformance.check": "check",
    "engines.protocol": "Capabilities Engine",
    "engines.registry": "engine engines",
    "models.errors": "EngineNotInstalledError InputError SimulationError TrebucheckError "
    "UnsupportedProblemError",
    "models.controls": "ControlRecord",
    "models.elements": "ConstantForce ConstantTorque Coupler CouplerTerm CubicTorsionSpring "
    "FreeJoint PinJoint PointStop PrismaticJoint RecordedForce RecordedTorque "
    "RotationalSpringDamper RotorInertia SlideInertia SlideSpringDamper SlotJoint SpringDamper "
    "Stop TranslationJoint WeldJoint",
    "models.library.registry": "model problem problems",
    "models.launch": "Launch",
    "models.library.trebuchet": """
        CatapultParameters FloatingArmParameters HingedParameters TrebuchetParameters catapult fixed
        floating_arm hinged rolling
    """,
    "models.mechanism": "Body Marker Mechanism",
    "models.mjcf": "mjcf_path",
    "models.mjcf.writer": "mjcf_names",
    "models.problem": "Problem StopLaw",
    "models.trajectory": "Trajectory",
    "reference.motion": "solve",
    "reference.sensitivity.sensitivities": "sensitivities",
    "reference.taylor.batch": "launches",
    "reference.throw.throw": "throw",
}
_HOMES = {name: module for module, names in _PUBLIC.items() for name in names.split()}
# The audit of the paper is a distribution of its own: imported by name, where it is installed.
_SATELLITES = {"paper": "trebucheck_paper"}

# From the table above, not a literal list: type checkers read __init__.pyi instead.
_NAMES = sorted([*_HOMES, *_SATELLITES, "__version__"])
__all__ = _NAMES  # noqa: PLE0605  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _SATELLITES:
        return _of_satellite(name)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # By name: `import trebucheck` imports no library; each public name brings its own.
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def _of_satellite(name: str) -> Any:
    try:
        return getattr(importlib.import_module(_SATELLITES[name]), name)  # may be absent
    except ImportError as error:
        package = _SATELLITES[name].replace("_", "-")
        raise AttributeError(
            f"trebucheck.{name} is in the distribution {package}: pip install ./{name}"
        ) from error


def _renderer() -> Renderer:
    from .comparisons.report import pages  # when something is shown, not before

    return pages


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """The package; its public names stay what they are, whatever is imported below it.

    The import of `trebucheck.engines.registry` would bind the name `engines` to the subpackage,
    which hides the function of that name. (The function has the subpackage's attributes, so that
    `trebucheck.engines.registry` is found through it.)
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
install()
show_with(_renderer)
