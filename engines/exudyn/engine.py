"""Exudyn: redundant coordinates, algebraic constraints with multipliers, implicit steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...models.elements import CubicTorsionSpring
from ...models.features import COVERED_BY_FEATURES
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Part, Supplied
from ..units import SI, Units, units_of
from .options import ExudynOptions
from .study import STUDY

BUILT: frozenset[type] = COVERED_BY_FEATURES | {CubicTorsionSpring}
"""Classes that the tables of :mod:`.build` have a handler for; these need the library."""


class ExudynEngine(ExudynOptions, BuiltinEngine):
    """Exudyn's implicit solvers on a tree (or loops) of 2D rigid bodies.

    The step is shortened a little, so that a whole number of equal steps fits between the start or
    a release and the end: a short last step would be a source of noise in the multipliers.

    A tuned run with loops begins anew beside positions in which their constraints depend on each
    other (:mod:`.solver`); steps that fail there are replaced by a longer one over the position.

    Under the unilateral law an open stop's gap is looked at after every step; where it fell below
    zero the run steps onto the zero, in either preset, and the speeds jump by Newton's law. A touch
    within one step is not seen.
    """

    name: ClassVar[str] = "exudyn"
    package: ClassVar[str] = "exudyn"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="redundant Cartesian coordinates, joints and stops by Lagrange multipliers, "
        "implicit integrator; impacts located inside a step and solved in the metric of its mass "
        "matrix",
        features=built_features(BUILT),
        elements=BUILT,
    )
    # Exudyn's own defaults: generalized-alpha on the positions' constraints, modified Newton,
    # adaptive step. Its default step is 0.01 s, its tutorials take 1e-3 s. A newcomer switches a
    # connector off after a step.
    default_options: ClassVar[Mapping[str, object] | None] = {
        "timestep": 1e-3,
        "integrator": "generalized-alpha-index-3",
        "newton_relative": 1e-8,
        "newton_absolute": 1e-10,
        "modified_newton": True,
        "adaptive_step": True,
        "locate_releases": False,
    }

    @property
    def supplied(self) -> Supplied:
        """Switched constraints for stops; impulses found with Exudyn's mass matrix."""
        return {Part.EVENTS: "", Part.IMPACTS: ""}

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Show the built system by its own matrices and outputs."""
        self.refuse_absence()
        from .inspect import inspect  # loads Exudyn

        return self._units(mechanism).inspect(inspect, mechanism, states, self)

    def _run(self, problem: Problem) -> Recording:
        from .motion import run  # loads Exudyn

        return self._units(problem.mechanism).run(run, problem, self)

    def _units(self, mechanism: Mechanism) -> Units:
        """SI where a stiffness is given, which is in SI units."""
        return units_of(mechanism) if self.stop_stiffness is None else SI
