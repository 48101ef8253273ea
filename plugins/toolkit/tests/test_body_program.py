"""Programs of bodies in Python, with an engine of five lines that moves free bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.point_masses import spread_masses
from trebucheck.reference.solver import solve
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import UprightScene, body_program, run_program, scene_states
from trebucheck_toolkit.node_scene import NodeScene

ENGINE = """
bodies = {
{% for name, body in zip(names, scene.bodies) %}
    {{ text(name) }}: {{ text(
        (body.position[0], -body.position[1], 0.0, body.velocity[0], -body.velocity[1], -body.speed)
    ) }},
{% endfor %}
}
masses = {
{% for name, body in zip(names, scene.bodies) %}
    {{ text(name) }}: ({{ text(body.mass) }}, {{ text(body.mass) }}, {{ text(body.inertia) }}),
{% endfor %}
}
gravity = {{ text(frames.mechanism.gravity_vector) }}
given = {name: np.zeros(3) for name in bodies}


def state(name):
    return bodies[name]


def push(name, at, force):
    x, y, *_ = bodies[name]
    arm = at - complex(x, y)
    given[name] += force.real, force.imag, (arm.conjugate() * force).imag


def twist(name, torque):
    given[name] += 0.0, 0.0, torque


def step():
    for name, now in bodies.items():
        speed = now[3:] + STEP * (given[name] / masses[name] + np.append(gravity, 0.0))
        bodies[name] = (*(now[:3] + STEP * speed), *speed)
        given[name][:] = 0.0
    return [0.0]
"""


def _loose_bodies() -> tb.Mechanism:
    """Two free bodies with one element of each kind, and springs to the ground."""
    plates = [
        tb.Body(name=name, angle=name, mass=mass, centre=(0.1, -0.2), inertia=0.3)
        for name, mass in (("a", 1.0), ("b", 2.0))
    ]
    joints = [
        tb.FreeJoint(name=f"air {name}", child=name, coordinates=(f"x {name}", f"y {name}"))
        for name in "ab"
    ]
    to_ground = {"relative_to": "ground", "stiffness": 20.0, "damping": 1.0}
    between = {"body": "a", "relative_to": "b", "stiffness": 30.0, "damping": 0.5}
    return tb.Mechanism(
        name="loose bodies",
        bodies=tuple(plates),
        joints=tuple(joints),
        stops=(),
        gravity=9.81,
        start=(0.4, -1.1, 0.0, 1.0, 2.0, 1.5),
        start_speeds=(0.3, -0.2, 0.5, 0.0, 0.1, 0.2),
        force_elements=(
            tb.SpringDamper(
                name="rope", point=(0.2, 0.1), relative_point=(0, 0), rest_length=0.7, **between
            ),
            tb.RotationalSpringDamper(name="coil", rest_angle=0.2, **between),
            tb.SpringDamper(
                name="wire",
                body="b",
                point=(0, 0),
                relative_point=(1, 3),
                rest_length=1,
                **to_ground,
            ),
            tb.RotationalSpringDamper(name="bar", body="b", rest_angle=-0.4, **to_ground),
            tb.ConstantForce(name="wind", body="a", point=(0.3, 0.0), force=(2.0, 1.0)),
            tb.ConstantTorque(name="motor", body="a", relative_to="b", torque=0.4),
        ),
        markers=(tb.Marker(name="tip", body="a", point=(0.5, 0.5)),),
    )


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """An engine's module, whose package has its template."""
    package = tmp_path / "five_lines"
    (package / "templates").mkdir(parents=True)
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "templates" / "alone.py.j2").write_text(ENGINE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return "five_lines.engine"


def test_every_element_acts_as_the_reference_has_it_and_samples_are_the_programs(
    module: str,
) -> None:
    problem, errors = tb.Problem(_loose_bodies(), duration=0.5), list[float]()
    truth = solve(problem)
    for step in (1e-3, 5e-4):
        spread = spread_masses(problem.mechanism, None, "five lines")
        scene = NodeScene(problem.mechanism, "five lines")
        frames = UprightScene(scene)
        text = body_program(module, frames, problem, step, scene=scene, zip=zip)
        assert "trebucheck" not in text
        found = run_program(text)
        states = scene_states(frames, scene, found["states"])
        steps = BodySteps(problem, scene, spread, found["t"], states)
        made = steps.recording(found["q"], found["u"])
        # Read by the program and from its states: the same but for rounding.
        read = steps.samples.recording()
        assert made.q == pytest.approx(read.q, abs=1e-12)
        assert made.u == pytest.approx(read.u, abs=1e-12)
        right = truth.trajectory(found["t"])
        errors.append(float(np.abs(made.q - right.q).max()))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


def test_a_program_ends_with_the_first_state_that_is_not_finite(module: str) -> None:
    problem = tb.Problem(_loose_bodies(), duration=0.5)
    scene = NodeScene(problem.mechanism, "five lines")
    text = body_program(module, UprightScene(scene), problem, 0.01, scene=scene, zip=zip)
    lost = "    if len(told) == 2:\n        bodies[BODIES[1]] = (np.nan,) * 6\n    return [0.0]"
    found = run_program(text.replace("    return [0.0]", lost))
    assert np.isfinite(found["states"][:3]).all() and np.isnan(found["states"][3, 1]).all()
    assert [len(found[name]) for name in ("t", "q", "u", "states", "told")] == [4, 4, 4, 4, 3]
