"""Cases of `recorded.py` for the models: MJCF and scenes, and what the library is made of.

The committed MJCF is of upright machines at round places; here are joints, walls and rails that
lean, bodies without room for a rod, loops, variants. Of each attribute of each kind of element
the count and two sums are recorded, not the text.
"""

from __future__ import annotations

import importlib
import json
import math
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import recorded_engines
import trebucheck as tb
from mechanisms import (
    OBLIQUE_SLOT,
    body_of,
    chain,
    everything,
    floor,
    four_bar,
    hanging_bob,
    parallel_cranks,
    pin,
    rods_on_a_slot,
    slider_crank,
)
from trebucheck.models.elements import GROUND, PointStop, SlotJoint
from trebucheck.models.kinematics import initial_state
from trebucheck.models.library.registry import benchmark, benchmarks, models, parameters_type
from trebucheck.models.mechanism import Marker, Mechanism
from trebucheck.models.mjcf.scene import Keyframe, RecordedMotion, scene, stored_motion
from trebucheck.models.mjcf.variants import Variant, released, throw
from trebucheck.models.mjcf.writer import mjcf


def rods_and_weights() -> Mechanism:
    """A rod with weights at its ends on a steep rail, a light bob on a rope, a disc, a board."""
    bodies = (
        body_of("beam", "a", 9.0, (0.2, 0.1), 12.0),
        body_of("bob", "b", 0.4, (0.0, -0.7), 0.0),
        body_of("wheel", "c", 1.5, (0.05, 0.02), 0.03),
    )
    rail = SlotJoint(name="rail", parent=GROUND, child="beam", parent_point=(0.4, 1.0),
                     child_point=(-1.0, 0.1), axis=(0.28, 0.96), coordinate="s")  # fmt: skip
    joints = (
        rail,
        pin("rope", "beam", "bob", (1.6, 0.1), (0.0, 0.1)),
        pin("axle", GROUND, "wheel", (-1.2, 3.0), (0.01, -0.03)),
    )
    board = PointStop(name="board", body="bob", point=(0.0, -0.7), normal=(-0.28, 0.96),
                      offset=-9.0, closed=False)  # fmt: skip
    return Mechanism(
        name="rods and weights",
        bodies=bodies,
        joints=joints,
        stops=(board,),
        markers=(Marker(name="projectile", body="bob", point=(0.0, -0.7)),),
        gravity=9.81,
        start=(0.3, 0.9, 0.2, 0.7),
        start_speeds=(0.1, -0.2, 0.4, 0.3),
    )


def standing_bob() -> Mechanism:
    """A bob over a level floor that its path comes near to."""
    return hanging_bob(floor(1.9), start=0.2)


WRITTEN: dict[str, Callable[[], Mechanism]] = {
    "rods and weights": rods_and_weights,
    "bob over a floor": standing_bob,
    "everything": everything,
    "rods on a slot": lambda: rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2)),
    "chain on a slot": lambda: chain(
        joints=(OBLIQUE_SLOT, chain().joints[1]), start=(0.3, 0.2, 0.4), start_speeds=()
    ),
    "loop": four_bar,
    "redundant": lambda: parallel_cranks(3, hung=True),
    "crank": lambda: slider_crank(tilt=0.3, centres=((0.5, 0.1), (0.9, -0.2))),
    "leaning": recorded_engines.leaning,
    "leaning on a gate": lambda: recorded_engines.leaning("gate"),
    "loaded bob": recorded_engines.loaded_bob,
    "weld": lambda: recorded_engines.framed("weld"),
    "rail": lambda: recorded_engines.framed("rail"),
    **{
        name: partial(tb.model, name)
        for name in ("motor", "thrown-plate", "incline", "quick-return", "trammel", "falling-rod")
    },
}


def moved(mechanism: Mechanism) -> RecordedMotion:
    """A made-up path that goes on from the start with its speeds, and turns what stands still."""
    q, u = initial_state(mechanism)
    rates = u + np.linspace(0.4, 0.9, len(u))
    states = [tuple((q + rates * t).tolist()) for t in np.linspace(0.0, 0.8, 9)]
    key = Keyframe(name="launch", time=0.7, q=states[7], u=tuple(rates.tolist()))
    return RecordedMotion(mechanism_hash=mechanism.content_hash, keyframes=(key,),
                          path=tuple(states))  # fmt: skip


def shown(text: str) -> dict[str, list[float]]:
    """Numbers of each attribute of each tag of a file, by :func:`size`."""
    numbers: defaultdict[str, list[float]] = defaultdict(list)
    for element in ET.fromstring(text).iter():
        tag = str(element.tag) if isinstance(element.tag, str) else "comment"
        numbers[tag].append(1.0)
        for attribute, value in element.attrib.items():
            words = [word for word in value.split() if word[-1].isdigit()]
            numbers[f"{tag} {attribute}"] += map(float, filter(_is_number, words))
    return {key: size(values) for key, values in numbers.items() if values}


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def size(values: list[float]) -> list[float]:
    """How many numbers there are, and two sums of them that tell lists apart."""
    v = np.array(values)
    return [len(v), float(v.sum()), float(v @ np.cos(np.arange(len(v))))]


def texts() -> dict[str, Any]:
    """Files of each mechanism with and without a motion."""
    found: dict[str, Any] = {}
    for name, build in WRITTEN.items():
        mechanism = build()
        path = moved(mechanism)
        files = (mjcf(mechanism, motion=path), scene(mechanism, "model.xml"),
                 scene(mechanism, "model.xml", path))  # fmt: skip
        found[name] = [shown(file) for file in files]
    return found


def variants() -> dict[str, Any]:
    """Files with finite inertias and with the throw, of machines and of a bob on a beam."""
    found: dict[str, Any] = {}
    machines = [tb.model(name) for name in models()]
    for mechanism in (*machines, rods_and_weights(), chain(inertias=(0.0, 0.0))):
        kinds = {"inertias": Variant(sensors=False, finite_inertia=True)}
        if any(marker.name == "projectile" for marker in mechanism.markers):
            kinds["throw"] = Variant(throw=True)
        for kind, variant in kinds.items():
            found[f"{mechanism.name} {kind}"] = shown(mjcf(mechanism, 2e-3, variant=variant))
    return found


def thrown() -> list[Any]:
    """Masses after the release in MuJoCo, and where a catapult's projectile lands."""
    mujoco: Any = importlib.import_module("mujoco")  # it has no types
    found: list[Any] = []
    for mechanism in (tb.fixed(), rods_and_weights(), tb.catapult()):
        motion = stored_motion(mechanism)
        text = mjcf(mechanism, 5e-3, motion, Variant(throw=True))
        machine = mujoco.MjModel.from_xml_string(text)
        after = released(machine, mujoco.MjData(machine))
        masses = [after.body_mass, after.body_ipos, after.body_inertia, after.body_subtreemass]
        found.append([mechanism.name, [values.ravel().tolist() for values in masses]])
    data = mujoco.MjData(machine)
    found.append([throw(machine, data), data.time])
    mujoco.mj_resetData(machine, data)
    with pytest.raises(tb.InputError, match="landed"):
        throw(machine, data, longest=5.0)
    return found


BRANCHES: list[tuple[str, dict[str, float]]] = [
    ("n-four-bar", {"speed": 1e-4}),
    ("n-four-bar", {"N": 3, "speed": 5.0}),
    ("slider-crank", {"rod": 1.3, "speed": 1.0}),
    ("damped-oscillator", {"damping": 60.0}),
    ("stopped-pendulum", {"opening": 0.2, "swing": 2.0, "restitution": 1.0}),
    ("bouncing", {"restitution": 1.0}),
    ("falling-rod", {"slope": 1.2, "restitution": 0.0}),
    ("hanging-chain", {"N": 12}),
    ("bead", {"turning": -9.0}),
]
"""Parameters with which a problem's motion or duration is of another kind."""


def library() -> dict[str, Any]:
    """Machines and problems with parameters that are all different, and how strict figures are."""
    found: dict[str, Any] = {}
    for name in models():
        mechanism = tb.model(name, parameters=_others(parameters_type(name)))
        found[name] = json.loads(mechanism.to_json())
    others = [(entry.name, _others(entry.parameters)) for entry in benchmarks()]
    others += [(name, benchmark(name).parameters(**changes)) for name, changes in BRANCHES]
    for k, (name, parameters) in enumerate(others):
        made = parameters.problem()
        figures = [[each.value, math.log10(each.tolerance)] for each in parameters.figures()]
        limits = [condition.limit for condition in parameters.conditions()]
        numbers = json.loads(made.mechanism.to_json())
        found[f"{name} {k}"] = [numbers, made.duration, figures, limits]
    return found


def _others(parameters: Any) -> Any:
    """Each parameter by another factor, and none of them zero."""
    values = dict(parameters())
    other = {
        name: value * (0.97 + 0.01 * k) or 0.02 * (k + 1) if isinstance(value, float) else value
        for k, (name, value) in enumerate(values.items())
    }
    return parameters(**other)


CASES: dict[str, Callable[[], Any]] = {
    "models-mjcf": texts,
    "models-variants": variants,
    "models-library": library,
    "runs-mujoco-throw": thrown,
}
