"""PhysX's articulations as a program with nothing but ovphysx's interface, which a run executes.

Bodies that pins, slides and welds connect are links of one articulation, with a base where one of
these joints is on the ground; a body without joints is a rigid body. A stop is the limit of a
revolute joint. Springs, dampers and motors are forces given to the links before each step.
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
from trebucheck_toolkit.body_program import UprightScene, body_program, scene_states, upright
from trebucheck_toolkit.gap_releases import OPENING
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene, joint_limits, lawful_stops

AT_LIMIT = 1e-6  # [rad] of rounding, within which a joint is at its limit
FAR = 2000.0 * math.pi  # [rad] PhysX takes no infinite end of a limit on one side
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
        self.frames, joints = UprightScene(self.scene), self.scene.joints
        self.stops = {stop.name: self.scene.stop(stop) for stop in lawful_stops(problem)}
        limits = joint_limits(problem, self.scene, within_half_a_turn=False)
        self.ranges = {
            joint: (-FAR if high is None else -high, FAR if low is None else -low)
            for joint, (low, high) in limits.items()
        }
        """Least and greatest angle of each joint with stops, by its index, anticlockwise [rad]."""
        carried = {joint["b"]: index for index, joint in enumerate(joints)}
        self.links = [self._link(k, carried.get(k)) for k in range(len(self.scene.bodies))]
        """Of each body; joints are those of a tree, so that each body is carried by one at most."""
        for k, link in enumerate(self.links):
            root = k
            while root in carried and joints[carried[root]]["a"] >= 0:
                root = joints[carried[root]]["a"]
            link["tree"], link["root"] = f"tree{root}", root
        self.trees = {
            self.links[root]["tree"]: {
                "links": [link for link in self.links if link["root"] == root],
                "grounded": root in carried,
            }
            for root in dict.fromkeys(link["root"] for link in self.links)
        }
        self.rigid = [
            name
            for name, tree in self.trees.items()
            if not tree["grounded"] and len(tree["links"]) == 1
        ]
        """Names of those that are one rigid body."""

    def _link(self, k: int, index: int | None) -> Json:
        """A body and the joint that carries it, which reads zero at the start."""
        body, name = self.scene.bodies[k], self.scene.names[k]
        link: Json = {"name": f"link{k}", "body": name, **body, "kind": None, "ends": None}
        if index is None:
            return link
        joint, coordinates = self.scene.joints[index], self.scene.mechanism.coordinates
        parent = {"position": (0.0, 0.0), "speed": 0.0}
        parent = self.scene.bodies[joint["a"]] if joint["a"] >= 0 else parent
        axis, speed = 0.0, parent["speed"] - body["speed"]
        if joint["kind"] == "slide":
            axis = cmath.phase(complex(*upright(joint["axis"])))
            slide = self.scene.mechanism.joint_of(name).slides[0]
            speed = float(self.scene.u[coordinates.index(slide)])
        return link | {
            "joint": index,
            "kind": _KINDS[joint["kind"]],
            "parent": f"link{joint['a']}" if joint["a"] >= 0 else "base",
            "at": np.add(body["position"], joint["pointB"]) - parent["position"],
            "point": joint["pointB"],
            "turned": (math.cos(axis / 2), math.sin(axis / 2)),
            "axis": axis,
            "speed": None if joint["kind"] == "weld" else speed,
            "ends": self.ranges.get(index),
        }

    def program(self) -> str:
        """The program of the run."""
        gravity, options = complex(*self.scene.mechanism.gravity_vector), self.options
        shared = {
            "plan": self,
            "drops": self.problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits,
            "far": FAR,
        }
        scene = filled_template(
            __name__,
            "scene.usda.j2",
            options=options,
            own=options.default_options,
            gravity=(abs(gravity), gravity / (abs(gravity) or 1.0)),
            rate=max(1, round(1 / options.timestep)),
            degrees=math.degrees,
            vector=lambda xy: f"({', '.join(map(repr, upright(xy)))}, 0)",
            **shared,
            **options.of_usd(),
        )
        return body_program(
            __name__,
            self.frames,
            self.problem,
            options.timestep,
            usd=scene,
            at_limit=AT_LIMIT,
            **shared,
        )

    def executed(self) -> dict[str, Any]:
        """Names of the program, after it."""
        found = dict[str, Any]()
        exec(self.program(), found)
        return found

    def run(self) -> Recording:
        """Step PhysX from the start to the problem's end or just beyond, and read its links."""
        found, joints = self.executed(), len(self.scene.joints)
        forces, limits = np.split(found["told"], [2 * joints], axis=1)
        limited = [link["joint"] for link in self.links if link["ends"]]
        torques = dict(zip(limited, limits.T, strict=True))
        taken = BodySteps(
            self.problem,
            self.scene,
            self.spread,
            found["t"],
            scene_states(self.frames, self.scene, found["states"]),
            forces=forces.reshape(len(forces), joints, 2) * MIRROR,
            torques={
                name: np.maximum(0.0, -stop["side"] * torques[stop["joint"]])
                for name, stop in self.stops.items()
            },
            slop=OPENING,
        )
        return taken.recording(found["q"], found["u"])
