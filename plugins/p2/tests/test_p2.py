"""p2-es's defaults, and p2-es against the reference; the rest is in `plugins/tests`."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_p2.engine import P2Engine

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)


def _error(problem: tb.Problem, step: float, **options: object) -> float:
    """Greatest distance of a marker from where it should be [m]."""
    found = tb.engine("p2", timestep=step, **options).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    return max(
        float(np.abs(m.position - truth.markers[name].position).max())
        for name, m in found.markers.items()
    )


def test_the_defaults_are_p2s_own() -> None:
    """Those of a world and a body that set nothing; `step` has no step but that of the README."""
    own = P2Engine.npm.run(
        """
        import * as p2 from "p2-es";
        const { solver } = new p2.World(), body = new p2.Body({ mass: 1 });
        console.log(JSON.stringify({
          iterations: solver.iterations, tolerance: solver.tolerance,
          stiffness: p2.Equation.DEFAULT_STIFFNESS, relaxation: p2.Equation.DEFAULT_RELAXATION,
          damping: body.damping, turning: body.angularDamping,
          single: body.position instanceof Float32Array,
        }));
        """
    )
    default = tb.engine("p2", "default")
    assert own == {
        "iterations": default.iterations,
        "tolerance": default.tolerance,
        "stiffness": default.stiffness,
        "relaxation": default.relaxation,
        "damping": default.damping,
        "turning": default.damping,
        "single": default.single_precision,
    }
    readme = P2Engine.npm.folder / "node_modules" / "p2-es" / "README.md"
    assert "fixedTimeStep = 1 / 60" in readme.read_text("utf-8")
    assert default.timestep == 1 / 60
    # The program sets none of them.
    program = default.script(tb.Problem(tb.fixed(), duration=0.1))
    assert not any(word in program for word in ("P2_ARRAY_TYPE", "DEFAULT_", "GSSolver", "damping"))


def test_single_precision_has_its_floor() -> None:
    """Coordinates of 16 m have a last digit of 1e-6 m, and a run some thousands of steps."""
    double, single = (_error(FREE_SWING, 5e-4, single_precision=each) for each in (False, True))
    assert abs(single - double) < 4000 * 1e-6
    assert single != double


@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        "oscillator",
        "motor",
        "thrown-plate",
        "spring-pendulum",
        "welded-rods",
        "bead",
    ],
)
def test_it_builds_every_element(name: str) -> None:
    problem = benchmark(name).problem().model_copy(update={"duration": 0.5})
    coarse, fine = (_error(problem, step) for step in (2e-3, 1e-3))
    # Of first order; where that part is small, gaps of second order are what is left.
    assert np.log2(coarse / fine) > 0.8


def test_a_weld_of_bodies_with_one_centre_holds() -> None:
    """Angles that p2-es's LockConstraint does not hold."""
    rods = [
        tb.Body(
            name=name,
            angle="a" if name == "one" else None,
            mass=1.0,
            centre=(0.5, 0.0),
            inertia=0.1,
        )
        for name in ("one", "other")
    ]
    pin = tb.PinJoint(
        name="pin", parent="ground", child="one", parent_point=(0, 0), child_point=(0, 0)
    )
    weld = tb.WeldJoint(
        name="weld", parent="one", child="other", parent_point=(0, 0), child_point=(0, 0)
    )
    made = tb.Mechanism(
        name="pair",
        bodies=tuple(rods),
        joints=(pin, weld),
        stops=(),
        gravity=9.81,
        start=(0.0,),
        markers=(tb.Marker(name="tip", body="other", point=(1, 0)),),
    )
    problem = tb.Problem(made, duration=1.0)
    coarse, fine = (_error(problem, step) for step in (2e-3, 1e-3))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.2)


def test_what_it_has_not_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="stops on points"):
        tb.engine("p2").simulate(benchmark("bouncing").problem())
