"""PhysX's articulations as a program with nothing but ovphysx's interface, which a run executes.

Bodies that pins, slides and welds connect to the ground are links of one articulation, with a base
that is held there; a free body that carries others is the first link of one of its own, and one
without joints a rigid body. A stop is the limit of a revolute joint. Springs, dampers and motors
are forces given to the bodies before each step.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, ClassVar

import numpy as np
from trebucheck.engines.study import filled_template
from trebucheck.models.problem import Problem
from trebucheck_toolkit.body_plan import BodyPlan
from trebucheck_toolkit.body_program import upright
from trebucheck_toolkit.node_scene import Json

MACHINE = "machine"
BASE: Json = {"name": "base", "kind": "Fixed", "parent": None, "mass": 1.0, "inertia": 1.0}
BASE |= dict.fromkeys(("position", "velocity", "at", "point"), (0.0, 0.0)) | {"speed": 0.0}
"""Link that is held on the ground: without it PhysX takes the first one for the base."""
_KINDS = {"pin": "Revolute", "slide": "Prismatic", "weld": "Fixed"}


class Plan(BodyPlan):
    """A problem's program for ovphysx."""

    engine: ClassVar[str] = "ovphysx"
    widest: ClassVar[float] = 2000.0 * math.pi
    """PhysX takes no infinite end of a limit on one side."""
    survives_forks: ClassVar[bool] = False

    def __init__(self, problem: Problem, options: Any) -> None:
        super().__init__(problem, options)
        self.carriers = {joint["b"]: index for index, joint in enumerate(self.joints)}
        """Joint that carries a body, one at most: the joints are those of a tree."""
        self.links = [self._link(k, body) for k, body in enumerate(self.scene.bodies)]
        self.trees: dict[str, list[Json]] = {}
        for link in self.links:
            base = [BASE] if link["tree"] == MACHINE else []
            self.trees.setdefault(link["tree"], base).append(link)
        self.rigid = [tree for tree, links in self.trees.items() if len(links) == 1]

    def _tree(self, k: int) -> str:
        if k not in self.carriers:
            return f"free{k}"
        parent = self.joints[self.carriers[k]]["a"]
        return MACHINE if parent < 0 else self._tree(parent)

    def _link(self, k: int, body: Json) -> Json:
        """A body and the joint that carries it, which reads zero at the start."""
        name, index = self.scene.names[k], self.carriers.get(k)
        link = {**body, "name": f"link{k}", "body": name, "tree": self._tree(k), "kind": None}
        if index is None:
            return link
        joint, mechanism = self.joints[index], self.scene.mechanism
        parent = self.scene.bodies[joint["a"]] if joint["a"] >= 0 else BASE
        axis, rate = 0.0, parent["speed"] - body["speed"]
        if joint["kind"] == "slide":
            axis = cmath.phase(complex(*upright(joint["axis"])))
            slide = mechanism.joint_of(name).slides[0]
            rate = float(self.scene.u[mechanism.coordinates.index(slide)])
        return link | {
            "kind": _KINDS[joint["kind"]],
            "parent": f"link{joint['a']}" if joint["a"] >= 0 else BASE["name"],
            "at": np.add(body["position"], joint["pointB"]) - parent["position"],
            "point": joint["pointB"],
            "axis": axis,
            "rate": rate,
            "ends": self.ranges.get(index),
        }

    def values(self) -> dict[str, Any]:
        """Further values of the template."""
        gravity = complex(*self.scene.mechanism.gravity_vector)
        usd = filled_template(
            __name__,
            "scene.usda.j2",
            plan=self,
            options=self.options,
            gravity=(abs(gravity), gravity / (abs(gravity) or 1.0)),
            rate=max(1, round(1 / self.options.timestep)),
            vector=lambda xy: f"({', '.join(map(repr, upright(xy)))}, 0)",
            math=math,
        )
        bodies = [self.scene.names[joint["b"]] for joint in self.joints]
        return {
            "usd": usd,
            "places": {link["body"]: (link["tree"], link["name"]) for link in self.links},
            "limits": [(bodies[index], *ends) for index, ends in self.ranges.items()],
        }
