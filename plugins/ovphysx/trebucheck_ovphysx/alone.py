"""PhysX's articulations as a program with nothing but ovphysx's interface, which a run executes.

Bodies that pins, slides and welds connect to the ground are links of one articulation, with a base
that is held there; a free body that carries others is the first link of one of its own, and one
without joints a rigid body. A stop is the limit of a revolute joint. Springs, dampers and motors
are forces given to the bodies before each step.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.engines.study import filled_template
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import (
    UprightScene,
    apart,
    body_program,
    run_program,
    scene_states,
    upright,
)
from trebucheck_toolkit.gap_releases import OPENING
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene, joint_limits, lawful_stops

FAR = 2000.0 * math.pi  # [rad] PhysX takes no infinite end of a range
MACHINE = "machine"
BASE: Json = {"name": "base", "kind": "Fixed", "parent": None, "mass": 1.0, "inertia": 1.0}
BASE |= dict.fromkeys(("position", "velocity", "at", "point"), (0.0, 0.0)) | {"speed": 0.0}
"""Link that is held on the ground: without it PhysX takes the first one for the base."""
_KINDS = {"pin": "Revolute", "slide": "Prismatic", "weld": "Fixed"}


class Plan:
    """A problem's program for ovphysx.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """

    def __init__(self, problem: Problem, options: Any) -> None:
        self.problem, self.options = problem, options
        self.spread = spread_masses(problem.mechanism, None, "ovphysx")
        self.scene = NodeScene(self.spread.mechanism, "ovphysx")
        self.frames, self.joints = UprightScene(self.scene), self.scene.joints
        self.stops = {stop.name: self.scene.stop(stop) for stop in lawful_stops(problem)}
        self.limits = joint_limits(problem, self.scene, within_half_a_turn=False)
        self.drops = problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits
        self.carriers = {joint["b"]: index for index, joint in enumerate(self.joints)}
        """Joint that carries a body, one at most: the joints are those of a tree."""
        self.links = [self._link(k, body) for k, body in enumerate(self.scene.bodies)]
        self.trees = {each["tree"]: [BASE] * (each["tree"] == MACHINE) for each in self.links}
        for link in self.links:
            self.trees[link["tree"]].append(link)
        self.rigid = [tree for tree, links in self.trees.items() if len(links) == 1]

    def _tree(self, k: int) -> str:
        if k not in self.carriers:
            return f"free{k}"
        parent = self.joints[self.carriers[k]]["a"]
        return MACHINE if parent < 0 else self._tree(parent)

    def _link(self, k: int, body: Json) -> Json:
        """A body and the joint that carries it, which reads zero at the start."""
        name, index = self.scene.names[k], self.carriers.get(k)
        link = {**body, "name": f"link{k}", "body": name, "tree": self._tree(k), "joint": index}
        if index is None:
            return link | {"kind": None, "ends": None}
        joint, mechanism = self.joints[index], self.scene.mechanism
        parent = self.scene.bodies[joint["a"]] if joint["a"] >= 0 else BASE
        axis, rate = 0.0, parent["speed"] - body["speed"]
        if joint["kind"] == "slide":
            axis = cmath.phase(complex(*upright(joint["axis"])))
            slide = mechanism.joint_of(name).slides[0]
            rate = float(self.scene.u[mechanism.coordinates.index(slide)])
        low, high = self.limits.get(index, (None, None))  # clockwise
        return link | {
            "kind": _KINDS[joint["kind"]],
            "parent": f"link{joint['a']}" if joint["a"] >= 0 else BASE["name"],
            "at": np.add(body["position"], joint["pointB"]) - parent["position"],
            "point": joint["pointB"],
            "axis": axis,
            "rate": rate,
            "ends": (-FAR if high is None else -high, FAR if low is None else -low)
            if index in self.limits
            else None,
        }

    def program(self) -> str:
        """The program of the run."""
        gravity, step = complex(*self.scene.mechanism.gravity_vector), self.options.timestep
        usd = filled_template(
            __name__,
            "scene.usda.j2",
            plan=self,
            options=self.options,
            gravity=(abs(gravity), gravity / (abs(gravity) or 1.0)),
            rate=max(1, round(1 / step)),
            vector=lambda xy: f"({', '.join(map(repr, upright(xy)))}, 0)",
            math=math,
            far=FAR,
        )
        places = {link["body"]: (link["tree"], link["name"]) for link in self.links}
        ranges = [(link["body"], *link["ends"]) for link in self.links if link["ends"]]
        own = {"plan": self, "usd": usd, "places": places, "ranges": ranges, "far": FAR}
        return body_program(__name__, self.frames, self.problem, step, **own)

    def run(self) -> Recording:
        """Step PhysX from the start to the problem's end or just beyond, and read its bodies."""
        found = apart(run_program, self.program())
        forces, limits = np.split(found["told"], [2 * len(self.joints)], axis=1)
        limited = [link["joint"] for link in self.links if link["ends"]]
        torques = dict(zip(limited, limits.T, strict=True))
        taken = BodySteps(
            self.problem,
            self.scene,
            self.spread,
            found["t"],
            scene_states(self.frames, self.scene, found["states"]),
            forces=forces.reshape(len(forces), -1, 2) * MIRROR,
            torques={
                name: np.maximum(0.0, -stop["side"] * torques[stop["joint"]])
                for name, stop in self.stops.items()
            },
            slop=OPENING,
        )
        return taken.recording(found["q"], found["u"])
