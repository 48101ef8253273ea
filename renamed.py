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

# Old module: the modules that hold its names now; `trebucheck_*` are distributions of their own.
RENAMED: dict[str, tuple[str, ...]] = {
    "cli.animate": ("cli.motion",),
    "cli.certify": ("cli.truth",),
    "cli.completion": ("cli.options",),
    "cli.conform": ("cli.agree",),
    "cli.data": ("cli.truth",),
    "cli.diff": ("cli.agree",),
    "cli.figures": ("cli.agree",),
    "cli.importer": ("trebucheck_importers.command",),
    "cli.judge": ("cli.agree",),
    "cli.matrix": ("cli.agree",),
    "cli.plugin": ("cli.catalogue",),
    "cli.problems": ("cli.truth",),
    "cli.run": ("cli.motion",),
    "cli.studies": ("cli.agree", "cli.why"),
    "cli.throw": ("cli.motion",),
    "comparisons.compare.agreement": ("comparisons.report.pages.compare",),
    "comparisons.compare.machine": ("comparisons.runs.record", "comparisons.compare"),
    "comparisons.compare.plots": ("comparisons.report.pages.compare",),
    "comparisons.compare.report": ("comparisons.report.pages.compare",),
    "comparisons.compare.sentences": (
        "comparisons.report.pages.tables",
        "comparisons.report.pages.compare",
    ),
    "comparisons.compare.stored": ("comparisons.compare",),
    "comparisons.compare.study": ("comparisons.compare",),
    "comparisons.compare.summary": ("comparisons.report.pages.compare",),
    "comparisons.converge.floor": ("comparisons.converge",),
    "comparisons.converge.orders": ("comparisons.converge",),
    "comparisons.converge.plots": ("comparisons.report.pages.converge",),
    "comparisons.converge.report": ("comparisons.report.pages.converge",),
    "comparisons.converge.results": ("comparisons.converge",),
    "comparisons.converge.study": ("comparisons.converge",),
    "comparisons.data.files": ("comparisons.data.certified",),
    "comparisons.diagnosis.consistent": ("comparisons.diagnosis.faults",),
    "comparisons.diagnosis.energies": ("comparisons.diagnosis.readings",),
    "comparisons.diagnosis.hypotheses": ("comparisons.diagnosis.faults",),
    "comparisons.diagnosis.late": ("comparisons.diagnosis.readings",),
    "comparisons.diagnosis.mistaken": ("comparisons.diagnosis.readings",),
    "comparisons.diagnosis.model": ("comparisons.diagnosis.diagnose",),
    "comparisons.diagnosis.motion": ("comparisons.diagnosis.diagnose",),
    "comparisons.diagnosis.onset": ("comparisons.diagnosis.diagnose",),
    "comparisons.diagnosis.ranking": ("comparisons.diagnosis.rank",),
    "comparisons.diagnosis.response": ("comparisons.diagnosis.fit",),
    "comparisons.diagnosis.search": ("comparisons.diagnosis.fit",),
    "comparisons.diagnosis.settings": ("comparisons.diagnosis.rerun",),
    "comparisons.diagnosis.signatures": ("comparisons.diagnosis.case",),
    "comparisons.diagnosis.suspects": ("comparisons.diagnosis.faults",),
    "comparisons.diagnosis.systematic": ("comparisons.diagnosis.faults",),
    "comparisons.diff.changes": ("comparisons.diff",),
    "comparisons.diff.data": ("comparisons.diff",),
    "comparisons.diff.report": ("comparisons.report.pages.diff",),
    "comparisons.diff.study": ("comparisons.diff",),
    "comparisons.equivalence": ("comparisons.diagnosis.equivalence",),
    "comparisons.equivalence.checks": ("comparisons.diagnosis.equivalence",),
    "comparisons.equivalence.states": ("comparisons.diagnosis.equivalence",),
    "comparisons.explain.budget": ("comparisons.explain",),
    "comparisons.explain.report": ("comparisons.report.pages.explain",),
    "comparisons.explain.results": ("comparisons.explain",),
    "comparisons.explain.study": ("comparisons.explain",),
    "comparisons.explain.variants": ("comparisons.explain",),
    "comparisons.front": ("comparisons.certify",),
    "comparisons.front.studies": (
        "comparisons.converge.study",
        "comparisons.explain.study",
        "comparisons.recommend",
        "comparisons.converge",
        "comparisons.explain",
        "comparisons.recommend.study",
        "comparisons.certify",
    ),
    "comparisons.importer": ("trebucheck_importers",),
    "comparisons.importer.checks": ("trebucheck_importers.checks",),
    "comparisons.importer.expected": ("trebucheck_importers.expected",),
    "comparisons.importer.files": ("trebucheck_importers.files",),
    "comparisons.importer.process": ("trebucheck_importers.process",),
    "comparisons.importer.report": ("trebucheck_importers.report",),
    "comparisons.importer.results": ("trebucheck_importers.results",),
    "comparisons.importer.study": ("trebucheck_importers.study",),
    "comparisons.importer.tolerances": ("trebucheck_importers.tolerances",),
    "comparisons.importer.worker": ("trebucheck_importers.worker",),
    "comparisons.judge.columns": ("comparisons.judge",),
    "comparisons.judge.impacts": ("comparisons.judge",),
    "comparisons.judge.read": ("comparisons.judge",),
    "comparisons.judge.report": ("comparisons.report.pages.judge",),
    "comparisons.judge.study": ("comparisons.judge",),
    "comparisons.matrix.own": ("comparisons.report.pages.matrix",),
    "comparisons.matrix.read": ("comparisons.matrix",),
    "comparisons.matrix.report": ("comparisons.report.pages.matrix",),
    "comparisons.matrix.results": ("comparisons.matrix",),
    "comparisons.matrix.spread": ("comparisons.matrix",),
    "comparisons.matrix.study": ("comparisons.matrix",),
    "comparisons.mjcf.events": ("comparisons.mjcf",),
    "comparisons.mjcf.model": ("comparisons.mjcf",),
    "comparisons.problems.check": ("comparisons.problems",),
    "comparisons.problems.report": ("comparisons.report.pages.problems",),
    "comparisons.problems.study": ("comparisons.problems",),
    "comparisons.recommend.cases": ("comparisons.recommend",),
    "comparisons.recommend.obstacles": ("comparisons.recommend",),
    "comparisons.recommend.report": ("comparisons.report.pages.recommend",),
    "comparisons.recommend.results": ("comparisons.recommend",),
    "comparisons.recommend.search": ("comparisons.recommend",),
    "comparisons.recommend.study": ("comparisons.recommend",),
    "comparisons.report.drawing.files": ("comparisons.report.drawing.animation",),
    "comparisons.report.drawing.symbols": ("comparisons.report.drawing.sketch",),
    "comparisons.report.figures": ("comparisons.report.plots", "comparisons.report.document"),
    "comparisons.report.layout": ("comparisons.report.terminal",),
    "comparisons.report.motion": ("comparisons.report.plots",),
    "comparisons.report.notebook": ("comparisons.report.pages",),
    "comparisons.report.numbers": ("comparisons.report.document",),
    "comparisons.report.pages.session": ("comparisons.report.pages",),
    "comparisons.report.run": ("comparisons.report.pages.run",),
    "comparisons.report.sections": (
        "comparisons.report.pages.tables",
        "comparisons.report.pages.run",
    ),
    "comparisons.report.tables": ("comparisons.report.pages.tables",),
    "comparisons.runs.comparison": ("comparisons.runs.metrics",),
    "comparisons.runs.distance": ("comparisons.runs.runner",),
    "comparisons.runs.forked": ("comparisons.runs.process",),
    "comparisons.runs.pairs": ("comparisons.runs.record",),
    "comparisons.runs.parting": ("comparisons.runs.stretching",),
    "comparisons.runs.trials": ("comparisons.runs.record",),
    "comparisons.runs.uncertainty": ("comparisons.runs.runner",),
    "comparisons.runs.until": ("comparisons.runs.study",),
    "comparisons.runs.validity": ("comparisons.runs.runner",),
    "comparisons.runs.worker": ("comparisons.runs.process",),
    "comparisons.throw": ("comparisons.report.pages.throw",),
    "comparisons.throw.plots": ("comparisons.report.pages.throw",),
    "comparisons.throw.report": ("comparisons.report.pages.throw",),
    "conformance.deviations": ("conformance.suite", "conformance.verdicts"),
    "conformance.distributed": ("conformance.plugin",),
    "conformance.interface": ("conformance.suite",),
    "conformance.problems": ("conformance.suite",),
    "conformance.reports": ("conformance.plugin",),
    "conformance.session": ("conformance.suite", "conformance.verdicts"),
    "engines.completed": ("engines.registry",),
    "engines.constrained": ("trebucheck_toolkit.constrained",),
    "engines.contact_events": ("engines.events",),
    "engines.event_driver": ("trebucheck_toolkit.event_driver",),
    "engines.event_location": ("engines.events",),
    "engines.exudyn.body_coordinates": ("engines.exudyn.read",),
    "engines.exudyn.conditioning": ("engines.exudyn.solver", "engines.exudyn.build"),
    "engines.exudyn.constraints": ("engines.exudyn.read",),
    "engines.exudyn.forces": ("engines.exudyn.build", "engines.exudyn.read"),
    "engines.exudyn.lines": ("engines.exudyn.read",),
    "engines.exudyn.loops": ("engines.exudyn.solver", "engines.exudyn.build"),
    "engines.exudyn.rigid_loops": ("engines.exudyn.solver", "engines.exudyn.build"),
    "engines.exudyn.sensors": ("engines.exudyn.read",),
    "engines.exudyn.step": ("engines.exudyn.motion",),
    "engines.impact_law": ("engines.impact",),
    "engines.joint_coordinates": ("trebucheck_toolkit.joint_coordinates",),
    "engines.joint_tree": ("trebucheck_toolkit.joint_tree",),
    "engines.given": ("engines.registry",),
    "engines.mujoco.constraints": ("engines.mujoco.build",),
    "engines.mujoco.matrices": ("engines.mujoco.compat",),
    "engines.mujoco.run": ("engines.mujoco.motion",),
    "engines.mujoco.step": ("engines.mujoco.motion",),
    "engines.mujoco.unilateral": ("engines.mujoco.motion",),
    "engines.mujoco.versions": ("engines.mujoco.compat",),
    "engines.mujoco.view": ("engines.mujoco.build",),
    "engines.mujoco.warm_start": ("engines.mujoco.reference_acceleration",),
    "engines.node_samples": ("trebucheck_toolkit.node_samples",),
    "engines.node_scene": ("trebucheck_toolkit.node_scene",),
    "engines.option_table": ("engines.registry", "engines.options"),
    "engines.plain_run": ("trebucheck_toolkit.plain_run",),
    "engines.pymunk.assembly": ("engines.pymunk.bodies",),
    "engines.pymunk.force_elements": ("engines.pymunk.build",),
    "engines.pymunk.impact": ("engines.pymunk.motion",),
    "engines.pymunk.parts": ("engines.pymunk.bodies",),
    "engines.pymunk.reactions": ("engines.pymunk.read",),
    "engines.pymunk.rods": ("engines.pymunk.leapfrog",),
    "engines.pymunk.segment": ("engines.pymunk.motion",),
    "engines.pymunk.step": ("engines.pymunk.motion",),
    "engines.pymunk.welds": ("engines.pymunk.bodies",),
    "engines.scheme_tables": ("trebucheck_toolkit.scheme_tables",),
    "engines.schemes": ("trebucheck_toolkit.schemes",),
    "engines.viewer": ("engines.registry",),
    "environments": ("trebucheck_environments",),
    "environments.best_throw": ("trebucheck_environments.best_throw",),
    "environments.machines": ("trebucheck_environments.machines",),
    "environments.motion": ("trebucheck_environments.motion",),
    "environments.pictures": ("trebucheck_environments.pictures",),
    "environments.throw": ("trebucheck_environments.throw",),
    "models.drawing": ("comparisons.report.drawing",),
    "models.drawing.animation": ("comparisons.report.drawing.animation",),
    "models.drawing.bodies": ("comparisons.report.drawing.sketch", "models.sketch"),
    "models.drawing.draw": ("comparisons.report.drawing.sketch",),
    "models.drawing.events": ("comparisons.report.drawing.scene",),
    "models.drawing.paths": ("comparisons.report.drawing.sketch",),
    "models.drawing.picture": ("comparisons.report.drawing.animation",),
    "models.drawing.scene": ("comparisons.report.drawing.scene",),
    "models.drawing.shapes": ("comparisons.report.drawing.sketch",),
    "models.drawing.sketch": ("comparisons.report.drawing.sketch", "models.sketch"),
    "models.drawing.symbols": ("comparisons.report.drawing.sketch",),
    "models.drawing.vector": ("comparisons.report.drawing.animation",),
    "models.drawing.video": ("comparisons.report.drawing.animation",),
    "models.elements.table": ("models.elements.base",),
    "models.force_elements": ("models.elements", "models.elements.base"),
    "models.given": ("models.library.registry",),
    "models.joints": ("models.elements", "models.elements.base"),
    "models.library.catapult": ("models.library.trebuchet",),
    "models.library.closed_forms": ("models.library.benchmark",),
    "models.library.floating_arm": ("models.library.trebuchet",),
    "models.library.given": ("models.library.registry",),
    "models.library.joints": ("models.library.single_elements", "models.library.linkages"),
    "models.library.oscillators": ("models.library.single_elements",),
    "models.library.parts": ("models.library.benchmark",),
    "models.library.squeezer": ("models.library.linkages",),
    "models.machines": ("models.library",),
    "models.machines.catapult": ("models.library.trebuchet",),
    "models.machines.floating_arm": ("models.library.trebuchet",),
    "models.machines.parameters": ("models.library.trebuchet",),
    "models.machines.registry": ("models.library.registry",),
    "models.machines.trebuchet": ("models.library.trebuchet",),
    "models.memory": ("engines.protocol",),
    "models.mjcf.forces": ("models.mjcf.elements",),
    "models.mjcf.names": ("models.mjcf.tree",),
    "models.mjcf.paths": ("models.mjcf",),
    "models.mjcf.points": ("models.mjcf.elements",),
    "models.mjcf.recorded": ("models.mjcf.scene",),
    "models.mjcf.text": ("models.mjcf.tree",),
    "models.mjcf.throw": ("models.mjcf.variants",),
    "models.phasors": ("models.functions",),
    "models.problems": ("models.library",),
    "models.problems.benchmark": ("models.library.benchmark",),
    "models.problems.contacts": ("models.library.contacts",),
    "models.problems.elements": ("models.library.single_elements", "models.library.linkages"),
    "models.problems.free_bodies": ("models.library.single_elements",),
    "models.problems.linkages": ("models.library.linkages",),
    "models.problems.oscillators": ("models.library.single_elements",),
    "models.problems.parts": ("models.library.benchmark",),
    "models.problems.pendulum_motion": ("models.library.benchmark",),
    "models.problems.pendulums": ("models.library.pendulums",),
    "models.problems.readings": ("models.library.benchmark",),
    "models.problems.registry": ("models.library.registry",),
    "models.problems.single_freedom": ("models.library.benchmark",),
    "models.problems.squeezer": ("models.library.linkages",),
    "models.rebound": ("models.problem", "engines.impact"),
    "models.scalar_functions": ("models.functions",),
    "models.sketch": ("models.mjcf.appearance",),
    "models.stacked": ("reference.taylor.batch",),
    "models.stops": ("models.elements", "models.elements.base"),
    "models.tree": ("models.mechanism",),
    "models.zoo": ("trebucheck_importers.zoo",),
    "models.zoo.constraints": ("trebucheck_importers.zoo.constraints",),
    "models.zoo.forces": ("trebucheck_importers.zoo.forces",),
    "models.zoo.inertias": ("trebucheck_importers.zoo.inertias",),
    "models.zoo.joints": ("trebucheck_importers.zoo.joints",),
    "models.zoo.machines": ("trebucheck_importers.zoo.machines",),
    "models.zoo.model": ("trebucheck_importers.zoo.model",),
    "models.zoo.parts": ("trebucheck_importers.zoo.parts",),
    "models.zoo.registry": ("trebucheck_importers.zoo.registry",),
    "paper": ("trebucheck_paper",),
    "paper.chapters": ("trebucheck_paper.chapters",),
    "paper.curves": ("trebucheck_paper.curves",),
    "paper.design": ("trebucheck_paper.design",),
    "paper.design.efficiency": ("trebucheck_paper.design.efficiency",),
    "paper.design.first_forward_swing": ("trebucheck_paper.design.first_forward_swing",),
    "paper.design.search": ("trebucheck_paper.design.search",),
    "paper.design.study": ("trebucheck_paper.design.study",),
    "paper.drag": ("trebucheck_paper.drag",),
    "paper.drag.motion": ("trebucheck_paper.drag.motion",),
    "paper.drag.study": ("trebucheck_paper.drag.study",),
    "paper.evidence": ("trebucheck_paper.evidence",),
    "paper.evidence.claims": ("trebucheck_paper.evidence.claims",),
    "paper.evidence.engine_runs": ("trebucheck_paper.evidence.engine_runs",),
    "paper.evidence.quantities": ("trebucheck_paper.evidence.quantities",),
    "paper.evidence.throws": ("trebucheck_paper.evidence.throws",),
    "paper.evidence.verdicts": ("trebucheck_paper.evidence.verdicts",),
    "paper.identification": ("trebucheck_paper.identification",),
    "paper.identification.fit": ("trebucheck_paper.identification.fit",),
    "paper.identification.quantities": ("trebucheck_paper.identification.quantities",),
    "paper.identification.study": ("trebucheck_paper.identification.study",),
    "paper.plots": ("trebucheck_paper.plots",),
    "paper.report": ("trebucheck_paper.report",),
    "paper.rows": ("trebucheck_paper.rows",),
    "paper.rows.fitted": ("trebucheck_paper.rows.fitted",),
    "paper.rows.machine": ("trebucheck_paper.rows.machine",),
    "paper.rows.machines": ("trebucheck_paper.rows.machines",),
    "paper.rows.rolling": ("trebucheck_paper.rows.rolling",),
    "paper.rows.sweep": ("trebucheck_paper.rows.sweep",),
    "paper.rows.throw": ("trebucheck_paper.rows.throw",),
    "paper.study": ("trebucheck_paper.study",),
    "paper.sweep": ("trebucheck_paper.sweep",),
    "paper.sweep.laws": ("trebucheck_paper.sweep.laws",),
    "paper.sweep.rigid_swing": ("trebucheck_paper.sweep.rigid_swing",),
    "paper.sweep.study": ("trebucheck_paper.sweep.study",),
    "reference.bouncing": ("reference.contact",),
    "reference.certification.cartesian": ("reference.certification.redundant",),
    "reference.certification.quantities": (
        "reference.certification.certify",
        "reference.certification.constrained",
    ),
    "reference.collocation": ("reference.singular",),
    "reference.compiled_integrator": ("reference.integrator",),
    "reference.damping": ("reference.solver",),
    "reference.dependence": ("reference.equations",),
    "reference.dual": ("reference.sensitivity.variational",),
    "reference.sensitivity.dual": ("reference.sensitivity.variational",),
    "reference.sensitivity.kinks": ("reference.sensitivity.tangent",),
    "reference.sensitivity.numbers": ("reference.sensitivity.release",),
    "reference.taylor.choice": ("reference.taylor.expressions",),
    "reference.taylor.compiled": ("reference.taylor.expressions",),
    "reference.taylor.crossing": ("reference.taylor.solve",),
    "reference.taylor.dense_output": ("reference.taylor.solve",),
    "reference.taylor.machine": ("reference.taylor.numbers",),
    "reference.taylor.precision": ("reference.taylor.solve",),
    "reference.taylor.rank": ("reference.taylor.batch",),
    "reference.taylor.sparse": ("reference.taylor.expressions",),
    "reference.taylor.system": ("reference.taylor.expressions",),
    "reference.throw.figures": ("reference.throw.throw",),
    "reference.throw.kinks": ("reference.sensitivity.tangent",),
    "reference.throw.physical": ("reference.sensitivity.release",),
    "reference.throw.release": ("reference.throw.flight",),
    "reference.throw.sensitivity": ("reference.sensitivity.release",),
    "reference.throw.tangent": ("reference.sensitivity.tangent",),
    "reference.throw.variational": ("reference.sensitivity.variational",),
    "reference.window": ("reference.singular",),
}


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
