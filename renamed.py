"""Module names of earlier releases: they can be imported for one more release, with a warning."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import Any

_PACKAGE = __name__.rpartition(".")[0]

# New module: the old ones whose names it holds; `trebucheck_*` are distributions of their own.
# fmt: off
_OLD_NAMES: dict[str, tuple[str, ...]] = {
    "cli.agree": (
        "cli.conform", "cli.diff", "cli.figures", "cli.judge", "cli.matrix", "cli.studies",
    ),
    "cli.catalogue": ("cli.plugin",),
    "cli.motion": ("cli.animate", "cli.run", "cli.throw"),
    "cli.options": ("cli.completion",),
    "cli.truth": ("cli.certify", "cli.data", "cli.problems"),
    "cli.why": ("cli.studies",),
    "comparisons.certify": ("comparisons.front", "comparisons.front.studies"),
    "comparisons.compare": (
        "comparisons.compare.machine", "comparisons.compare.stored", "comparisons.compare.study",
    ),
    "comparisons.converge": (
        "comparisons.converge.floor", "comparisons.converge.orders", "comparisons.converge.results",
        "comparisons.converge.study", "comparisons.front.studies",
    ),
    "comparisons.data.certified": ("comparisons.data.files",),
    "comparisons.diagnosis.case": ("comparisons.diagnosis.signatures",),
    "comparisons.diagnosis.diagnose": (
        "comparisons.diagnosis.model", "comparisons.diagnosis.motion",
        "comparisons.diagnosis.onset",
    ),
    "comparisons.diagnosis.equivalence": (
        "comparisons.equivalence", "comparisons.equivalence.checks",
        "comparisons.equivalence.states",
    ),
    "comparisons.diagnosis.faults": (
        "comparisons.diagnosis.consistent", "comparisons.diagnosis.hypotheses",
        "comparisons.diagnosis.suspects", "comparisons.diagnosis.systematic",
    ),
    "comparisons.diagnosis.fit": ("comparisons.diagnosis.response", "comparisons.diagnosis.search"),
    "comparisons.diagnosis.rank": ("comparisons.diagnosis.ranking",),
    "comparisons.diagnosis.readings": (
        "comparisons.diagnosis.energies", "comparisons.diagnosis.late",
        "comparisons.diagnosis.mistaken",
    ),
    "comparisons.diagnosis.rerun": ("comparisons.diagnosis.settings",),
    "comparisons.diff": (
        "comparisons.diff.changes", "comparisons.diff.data", "comparisons.diff.study",
    ),
    "comparisons.explain": (
        "comparisons.explain.budget", "comparisons.explain.results", "comparisons.explain.study",
        "comparisons.explain.variants", "comparisons.front.studies",
    ),
    "comparisons.judge": (
        "comparisons.judge.columns", "comparisons.judge.impacts", "comparisons.judge.read",
        "comparisons.judge.study",
    ),
    "comparisons.matrix": (
        "comparisons.matrix.read", "comparisons.matrix.results", "comparisons.matrix.spread",
        "comparisons.matrix.study",
    ),
    "comparisons.mjcf": ("comparisons.mjcf.events", "comparisons.mjcf.model"),
    "comparisons.problems": ("comparisons.problems.check", "comparisons.problems.study"),
    "comparisons.recommend": (
        "comparisons.front.studies", "comparisons.recommend.cases",
        "comparisons.recommend.obstacles", "comparisons.recommend.results",
        "comparisons.recommend.search", "comparisons.recommend.study",
    ),
    "comparisons.report.document": ("comparisons.report.figures", "comparisons.report.numbers"),
    "comparisons.report.drawing": ("models.drawing",),
    "comparisons.report.drawing.animation": (
        "comparisons.report.drawing.files", "models.drawing.animation", "models.drawing.picture",
        "models.drawing.vector", "models.drawing.video",
    ),
    "comparisons.report.drawing.scene": ("models.drawing.events", "models.drawing.scene"),
    "comparisons.report.drawing.sketch": (
        "comparisons.report.drawing.symbols", "models.drawing.bodies", "models.drawing.draw",
        "models.drawing.paths", "models.drawing.shapes", "models.drawing.sketch",
        "models.drawing.symbols",
    ),
    "comparisons.report.pages": ("comparisons.report.notebook", "comparisons.report.pages.session"),
    "comparisons.report.pages.compare": (
        "comparisons.compare.agreement", "comparisons.compare.plots", "comparisons.compare.report",
        "comparisons.compare.sentences", "comparisons.compare.summary",
    ),
    "comparisons.report.pages.converge": (
        "comparisons.converge.plots", "comparisons.converge.report",
    ),
    "comparisons.report.pages.diff": ("comparisons.diff.report",),
    "comparisons.report.pages.explain": ("comparisons.explain.report",),
    "comparisons.report.pages.judge": ("comparisons.judge.report",),
    "comparisons.report.pages.matrix": ("comparisons.matrix.own", "comparisons.matrix.report"),
    "comparisons.report.pages.problems": ("comparisons.problems.report",),
    "comparisons.report.pages.recommend": ("comparisons.recommend.report",),
    "comparisons.report.pages.run": ("comparisons.report.run", "comparisons.report.sections"),
    "comparisons.report.pages.tables": (
        "comparisons.compare.sentences", "comparisons.report.sections", "comparisons.report.tables",
    ),
    "comparisons.report.pages.throw": (
        "comparisons.throw", "comparisons.throw.plots", "comparisons.throw.report",
    ),
    "comparisons.report.plots": ("comparisons.report.figures", "comparisons.report.motion"),
    "comparisons.report.terminal": ("comparisons.report.layout",),
    "comparisons.runs.metrics": ("comparisons.runs.comparison",),
    "comparisons.runs.process": ("comparisons.runs.forked", "comparisons.runs.worker"),
    "comparisons.runs.record": (
        "comparisons.compare.machine", "comparisons.runs.pairs", "comparisons.runs.trials",
    ),
    "comparisons.runs.runner": (
        "comparisons.runs.distance", "comparisons.runs.uncertainty", "comparisons.runs.validity",
    ),
    "comparisons.runs.stretching": ("comparisons.runs.parting",),
    "comparisons.runs.study": ("comparisons.runs.until",),
    "conformance.plugin": ("conformance.distributed", "conformance.reports"),
    "conformance.suite": (
        "conformance.deviations", "conformance.interface", "conformance.problems",
        "conformance.session",
    ),
    "conformance.verdicts": ("conformance.deviations", "conformance.session"),
    "engines.events": ("engines.contact_events", "engines.event_location"),
    "engines.exudyn.build": (
        "engines.exudyn.conditioning", "engines.exudyn.forces", "engines.exudyn.loops",
        "engines.exudyn.rigid_loops",
    ),
    "engines.exudyn.motion": ("engines.exudyn.step",),
    "engines.exudyn.read": (
        "engines.exudyn.body_coordinates", "engines.exudyn.constraints", "engines.exudyn.forces",
        "engines.exudyn.lines", "engines.exudyn.sensors",
    ),
    "engines.exudyn.solver": (
        "engines.exudyn.conditioning", "engines.exudyn.loops", "engines.exudyn.rigid_loops",
    ),
    "engines.impact": ("engines.impact_law", "models.rebound"),
    "engines.mujoco.build": ("engines.mujoco.constraints", "engines.mujoco.view"),
    "engines.mujoco.compat": ("engines.mujoco.matrices", "engines.mujoco.versions"),
    "engines.mujoco.motion": (
        "engines.mujoco.run", "engines.mujoco.step", "engines.mujoco.unilateral",
    ),
    "engines.mujoco.reference_acceleration": ("engines.mujoco.warm_start",),
    "engines.options": ("engines.option_table",),
    "engines.protocol": ("models.memory",),
    "engines.pymunk.bodies": (
        "engines.pymunk.assembly", "engines.pymunk.parts", "engines.pymunk.welds",
    ),
    "engines.pymunk.build": ("engines.pymunk.force_elements",),
    "engines.pymunk.leapfrog": ("engines.pymunk.rods",),
    "engines.pymunk.motion": (
        "engines.pymunk.impact", "engines.pymunk.segment", "engines.pymunk.step",
    ),
    "engines.pymunk.read": ("engines.pymunk.reactions",),
    "engines.registry": (
        "engines.completed", "engines.given", "engines.option_table", "engines.viewer",
    ),
    "models.elements": ("models.force_elements", "models.joints", "models.stops"),
    "models.elements.base": (
        "models.elements.table", "models.force_elements", "models.joints", "models.stops",
    ),
    "models.functions": ("models.phasors", "models.scalar_functions"),
    "models.library": ("models.machines", "models.problems"),
    "models.library.benchmark": (
        "models.library.closed_forms", "models.library.parts", "models.problems.benchmark",
        "models.problems.parts", "models.problems.pendulum_motion", "models.problems.readings",
        "models.problems.single_freedom",
    ),
    "models.library.contacts": ("models.problems.contacts",),
    "models.library.linkages": (
        "models.library.joints", "models.library.squeezer", "models.problems.elements",
        "models.problems.linkages", "models.problems.squeezer",
    ),
    "models.library.pendulums": ("models.problems.pendulums",),
    "models.library.registry": (
        "models.given", "models.library.given", "models.machines.registry",
        "models.problems.registry",
    ),
    "models.library.single_elements": (
        "models.library.joints", "models.library.oscillators", "models.problems.elements",
        "models.problems.free_bodies", "models.problems.oscillators",
    ),
    "models.library.trebuchet": (
        "models.library.catapult", "models.library.floating_arm", "models.machines.catapult",
        "models.machines.floating_arm", "models.machines.parameters", "models.machines.trebuchet",
    ),
    "models.mechanism": ("models.tree",),
    "models.mjcf": ("models.mjcf.paths",),
    "models.mjcf.appearance": ("models.drawing.bodies", "models.drawing.sketch", "models.sketch"),
    "models.mjcf.elements": ("models.mjcf.forces", "models.mjcf.points"),
    "models.mjcf.scene": ("models.mjcf.recorded",),
    "models.mjcf.tree": ("models.mjcf.names", "models.mjcf.text"),
    "models.mjcf.variants": ("models.mjcf.throw",),
    "models.problem": ("models.rebound",),
    "reference.certification.certify": ("reference.certification.quantities",),
    "reference.certification.constrained": ("reference.certification.quantities",),
    "reference.certification.redundant": ("reference.certification.cartesian",),
    "reference.contact": ("reference.bouncing",),
    "reference.equations": ("reference.dependence",),
    "reference.integrator": ("reference.compiled_integrator",),
    "reference.sensitivity.release": (
        "reference.sensitivity.numbers", "reference.throw.physical", "reference.throw.sensitivity",
    ),
    "reference.sensitivity.tangent": (
        "reference.sensitivity.kinks", "reference.throw.kinks", "reference.throw.tangent",
    ),
    "reference.sensitivity.variational": (
        "reference.dual", "reference.sensitivity.dual", "reference.throw.variational",
    ),
    "reference.singular": ("reference.collocation", "reference.window"),
    "reference.solver": ("reference.damping",),
    "reference.taylor.batch": ("reference.taylor.rank",),
    "reference.taylor.expressions": (
        "reference.taylor.choice", "reference.taylor.compiled", "reference.taylor.sparse",
        "reference.taylor.system",
    ),
    "reference.taylor.numbers": ("reference.taylor.machine",),
    "reference.taylor.solve": (
        "reference.taylor.crossing", "reference.taylor.dense_output", "reference.taylor.precision",
    ),
    "reference.throw.flight": ("reference.throw.release",),
    "reference.throw.throw": ("reference.throw.figures",),
    "trebucheck_environments": ("environments",),
    "trebucheck_environments.best_throw": ("environments.best_throw",),
    "trebucheck_environments.machines": ("environments.machines",),
    "trebucheck_environments.motion": ("environments.motion",),
    "trebucheck_environments.pictures": ("environments.pictures",),
    "trebucheck_environments.throw": ("environments.throw",),
    "trebucheck_importers": ("comparisons.importer",),
    "trebucheck_importers.checks": ("comparisons.importer.checks",),
    "trebucheck_importers.command": ("cli.importer",),
    "trebucheck_importers.expected": ("comparisons.importer.expected",),
    "trebucheck_importers.files": ("comparisons.importer.files",),
    "trebucheck_importers.process": ("comparisons.importer.process",),
    "trebucheck_importers.report": ("comparisons.importer.report",),
    "trebucheck_importers.results": ("comparisons.importer.results",),
    "trebucheck_importers.study": ("comparisons.importer.study",),
    "trebucheck_importers.tolerances": ("comparisons.importer.tolerances",),
    "trebucheck_importers.worker": ("comparisons.importer.worker",),
    "trebucheck_importers.zoo": ("models.zoo",),
    "trebucheck_importers.zoo.constraints": ("models.zoo.constraints",),
    "trebucheck_importers.zoo.forces": ("models.zoo.forces",),
    "trebucheck_importers.zoo.inertias": ("models.zoo.inertias",),
    "trebucheck_importers.zoo.joints": ("models.zoo.joints",),
    "trebucheck_importers.zoo.machines": ("models.zoo.machines",),
    "trebucheck_importers.zoo.model": ("models.zoo.model",),
    "trebucheck_importers.zoo.parts": ("models.zoo.parts",),
    "trebucheck_importers.zoo.registry": ("models.zoo.registry",),
    "trebucheck_paper": ("paper",),
    "trebucheck_paper.chapters": ("paper.chapters",),
    "trebucheck_paper.curves": ("paper.curves",),
    "trebucheck_paper.design": ("paper.design",),
    "trebucheck_paper.design.efficiency": ("paper.design.efficiency",),
    "trebucheck_paper.design.first_forward_swing": ("paper.design.first_forward_swing",),
    "trebucheck_paper.design.search": ("paper.design.search",),
    "trebucheck_paper.design.study": ("paper.design.study",),
    "trebucheck_paper.drag": ("paper.drag",),
    "trebucheck_paper.drag.motion": ("paper.drag.motion",),
    "trebucheck_paper.drag.study": ("paper.drag.study",),
    "trebucheck_paper.evidence": ("paper.evidence",),
    "trebucheck_paper.evidence.claims": ("paper.evidence.claims",),
    "trebucheck_paper.evidence.engine_runs": ("paper.evidence.engine_runs",),
    "trebucheck_paper.evidence.quantities": ("paper.evidence.quantities",),
    "trebucheck_paper.evidence.throws": ("paper.evidence.throws",),
    "trebucheck_paper.evidence.verdicts": ("paper.evidence.verdicts",),
    "trebucheck_paper.identification": ("paper.identification",),
    "trebucheck_paper.identification.fit": ("paper.identification.fit",),
    "trebucheck_paper.identification.quantities": ("paper.identification.quantities",),
    "trebucheck_paper.identification.study": ("paper.identification.study",),
    "trebucheck_paper.plots": ("paper.plots",),
    "trebucheck_paper.report": ("paper.report",),
    "trebucheck_paper.rows": ("paper.rows",),
    "trebucheck_paper.rows.fitted": ("paper.rows.fitted",),
    "trebucheck_paper.rows.machine": ("paper.rows.machine",),
    "trebucheck_paper.rows.machines": ("paper.rows.machines",),
    "trebucheck_paper.rows.rolling": ("paper.rows.rolling",),
    "trebucheck_paper.rows.sweep": ("paper.rows.sweep",),
    "trebucheck_paper.rows.throw": ("paper.rows.throw",),
    "trebucheck_paper.study": ("paper.study",),
    "trebucheck_paper.sweep": ("paper.sweep",),
    "trebucheck_paper.sweep.laws": ("paper.sweep.laws",),
    "trebucheck_paper.sweep.rigid_swing": ("paper.sweep.rigid_swing",),
    "trebucheck_paper.sweep.study": ("paper.sweep.study",),
    "trebucheck_toolkit.constrained": ("engines.constrained",),
    "trebucheck_toolkit.event_driver": ("engines.event_driver",),
    "trebucheck_toolkit.joint_coordinates": ("engines.joint_coordinates",),
    "trebucheck_toolkit.joint_tree": ("engines.joint_tree",),
    "trebucheck_toolkit.node_package": ("engines.node_package",),
    "trebucheck_toolkit.node_samples": ("engines.node_samples",),
    "trebucheck_toolkit.node_scene": ("engines.node_scene",),
    "trebucheck_toolkit.plain_run": ("engines.plain_run",),
    "trebucheck_toolkit.scheme_tables": ("engines.scheme_tables",),
    "trebucheck_toolkit.schemes": ("engines.schemes",),
}
# fmt: on
RENAMED: dict[str, list[str]] = {}
"""Modules that hold the names of an old module now."""
for _new, _old_modules in _OLD_NAMES.items():
    for _old in _old_modules:
        RENAMED.setdefault(_old, []).append(_new)


def _full_name(module: str) -> str:
    """Full name of a module: of another distribution where it says so, else of this package."""
    return module if module.startswith(f"{_PACKAGE}_") else f"{_PACKAGE}.{module}"


class _RenamedModule(ModuleType):
    """A module under its old name; it looks its names up in the new ones."""

    replaced: Any = None
    """What the parent has by the module's name, such as a function of a package become a module."""

    def __getattr__(self, name: str) -> Any:
        # The import system binds the module in its parent, over what is there: it comes back here.
        parent, _, child = self.__name__.rpartition(".")
        if self.replaced is not None and vars(sys.modules[parent]).get(child) is self:
            setattr(sys.modules[parent], child, self.replaced)
        for module in RENAMED[self.__name__.removeprefix(f"{_PACKAGE}.")]:
            new = importlib.import_module(_full_name(module))
            if hasattr(new, name):
                return getattr(new, name)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call what the module replaced in its parent, until that is back."""
        return self.replaced(*args, **kwargs)


class RenamedModules(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds modules by the names that they had in an earlier release."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Returns a specification where the name is an old one, else None."""
        package, _, module = fullname.partition(".")
        if package != _PACKAGE or module not in RENAMED:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        """Makes the module that stands for the new ones, and warns."""
        modules = RENAMED[spec.name.removeprefix(f"{_PACKAGE}.")]
        new = " or ".join(_full_name(module) for module in modules)
        message = f"{spec.name} is now {new}; the old name goes with the next release"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        module = _RenamedModule(spec.name)
        module.__path__ = []  # an old package: its modules are found by the same finder
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Import the new modules for their side effects; names are looked up when asked for."""
        for name in RENAMED[module.__name__.removeprefix(f"{_PACKAGE}.")]:
            importlib.import_module(_full_name(name))
        parent, _, child = module.__name__.rpartition(".")
        vars(module)["replaced"] = vars(sys.modules[parent]).get(child)


def install() -> None:
    """Makes the old names importable; behind all other finders, so that a real module wins."""
    if not any(isinstance(finder, RenamedModules) for finder in sys.meta_path):
        sys.meta_path.append(RenamedModules())
