"""PyDy's defaults, its equations against the reference, and what it refuses."""

import ast
import importlib.metadata
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trebucheck as tb
from scipy.integrate import odeint
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.registry import engine_class
from trebucheck.engines.supplied import Own, own, stated
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
ROUNDING = 1e-11  # [m]: 2e4 additions of 2^-53 on a way of 20 m, and what a swing makes of them


def _short(name: str, seconds: float = 0.5) -> tb.Problem:
    problem = benchmark(name).problem()
    return problem.model_copy(update={"duration": min(seconds, problem.duration)})


def _errors(found: tb.Trajectory) -> tuple[float, float]:
    """Greatest error of a marker [m], and of a joint's or stop's force [N, N m]."""
    problem = tb.Problem(found.mechanism, duration=float(found.t[-1]))
    law = tb.StopLaw(found.provenance.stop_law)
    truth = solve(problem.model_copy(update={"stop_law": law})).trajectory(found.t)
    points = [np.abs(m.position - truth.markers[k].position) for k, m in found.markers.items()]
    forces = [np.abs(f - truth.joint_reactions[k]) for k, f in found.joint_reactions.items()]
    forces += [np.abs(f - truth.stop_torques[k]) for k, f in found.stop_torques.items()]
    return float(np.max(points)), max((float(np.max(each)) for each in forces), default=0.0)


def _rod(start: float) -> tb.Mechanism:
    """A rod of 2 kg on a pin, its centre 0.5 m away."""
    return tb.Mechanism(
        name="rod",
        bodies=(tb.Body(name="rod", angle="a", mass=2.0, centre=(0.5, 0.0), inertia=0.1),),
        joints=(
            tb.PinJoint(
                name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
            ),
        ),
        stops=(),
        gravity=9.81,
        start=(start,),
        markers=(tb.Marker(name="tip", body="rod", point=(1, 0)),),
    )


def test_the_defaults_are_pydys_own() -> None:
    """The times of the README's example, and `System.integrate` without arguments: odeint's."""
    engine, readme = tb.engine("pydy", "default"), importlib.metadata.metadata("pydy").get_payload()
    (times,) = re.findall(r"times=linspace\(([^)]*)\)", str(readme))
    start, end, n = ast.literal_eval(f"({times})")
    assert engine.timestep == (end - start) / (n - 1)
    (own_tolerance,) = set(re.findall(r"1\.49012e-8", odeint.__doc__ or ""))
    assert engine.tolerance == float(own_tolerance)
    program = engine.script(FREE_SWING)
    for text in ("rtol=1.49012e-08, atol=1.49012e-08", "ode_solver=odeint, "):
        assert text in program
        program = program.replace(text, "")
    assert "integrate()" in program
    found: dict[str, np.ndarray] = {}
    exec(program, found)
    assert np.array_equal(found["q"], engine.simulate(FREE_SWING).q)


def test_the_program_gives_the_same_in_another_process() -> None:
    """The order of SymPy's terms does not depend on the hashes of a process."""
    engine, problem = tb.engine("pydy", "settings", timestep=1e-4), _short("squeezer", 0.003)
    text = engine.script(problem) + "\nprint(q.tobytes().hex())\n"
    for seed in ("1", "2"):
        made = subprocess.run(
            [sys.executable, "-c", text], capture_output=True, text=True, check=True,
            env={"PYTHONHASHSEED": seed},
        )  # fmt: skip
        assert made.stdout.strip() == engine.simulate(problem).q.tobytes().hex()


def test_dop853_is_of_order_eight_down_to_rounding() -> None:
    """Error control is off: a tolerance that every step keeps."""
    problem = FREE_SWING.model_copy(update={"duration": 1.6})
    steps = (0.16, 0.08)
    errors = [
        _errors(tb.engine("pydy", timestep=h, tolerance=0.1).simulate(problem))[0] for h in steps
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=1.0)
    assert _errors(tb.engine("pydy", "settings").simulate(problem))[0] < ROUNDING


def test_odeint_follows_its_tolerance() -> None:
    """LSODA's error is its tolerance times a factor of the problem's; each is a hundredth."""
    errors = [
        _errors(tb.engine("pydy", "default", tolerance=tolerance).simulate(FREE_SWING))[0]
        for tolerance in (1e-6, 1e-8, 1e-10)
    ]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
def test_the_force_of_a_hanging_rod_is_its_weight_upwards(preset: str) -> None:
    found = tb.engine("pydy", preset).simulate(tb.Problem(_rod(np.pi / 2), duration=0.1))
    assert found.joint_reactions["pin"][0] == pytest.approx([0.0, 2.0 * 9.81], abs=1e-12)


@pytest.mark.parametrize(
    ("preset", "relative"), [("default", 1e-5), ("settings", 1e-11), ("assisted", 1e-11)]
)
def test_the_force_of_a_swinging_rod_is_that_of_the_closed_form(
    preset: str, relative: float
) -> None:
    """The rod starts level: weight along the rod and centripetal force, 3 terms of energy."""
    found = tb.engine("pydy", preset).simulate(tb.Problem(_rod(0.0), duration=1.0))
    a, m, d, g = found.q[:, 0], 2.0, 0.5, 9.81
    moment = 0.1 + m * d**2
    speed2, turning = 2 * m * g * d * np.sin(a) / moment, m * g * d * np.cos(a) / moment
    acceleration = -d * speed2 * np.array([np.cos(a), -np.sin(a)])
    acceleration += d * turning * np.array([-np.sin(a), -np.cos(a)])
    force = m * (acceleration + np.array([[0.0], [g]])).T
    # The angle's own error, of the order of the tolerance, changes the speed that it stands for.
    assert np.abs(found.joint_reactions["pin"] - force).max() < relative * np.abs(force).max()


@pytest.mark.parametrize(
    "name",
    [
        *("chain", "slider-crank", "quick-return", "trammel", "n-four-bar", "squeezer", "bead"),
        *("oscillator", "damped-oscillator", "torsion-pendulum", "motor", "welded-rods", "incline"),
        *("thrown-plate", "spring-pendulum", "bouncing", "stopped-pendulum", "falling-rod"),
    ],
)
def test_it_builds_every_element(name: str) -> None:
    """The reference is known to 1e-9; at an impact a force has two values."""
    problem = _short(name)
    position, force = _errors(tb.engine("pydy", timestep=problem.duration / 250).simulate(problem))
    assert position < 1e-9
    assert problem.mechanism.stops or force < 1e-4


def test_the_machines_releases_and_torques() -> None:
    for model in (tb.fixed(), tb.rolling()):
        found = tb.engine("pydy").simulate(tb.Problem(model, duration=1.6))
        truth = solve(tb.Problem(model, duration=1.6)).trajectory(found.t)
        assert _errors(found)[0] < ROUNDING
        for name, time in truth.release_times.items():
            assert found.release_times[name] == (time and pytest.approx(time, abs=1e-11))


@pytest.mark.parametrize("name", ["squeezer", "slider-crank", "quick-return"])
def test_loops_by_dependent_speeds_drift_with_the_tolerance(name: str) -> None:
    for preset, error in (("default", 1e-4), ("settings", 1e-9)):
        assert _errors(tb.engine("pydy", preset).simulate(_short(name)))[0] < error


@pytest.mark.parametrize("name", ["chain", "squeezer", "bead", "thrown-plate", "welded-rods"])
def test_the_equations_are_the_references_and_a_fault_in_them_is_found(name: str) -> None:
    engine, mechanism = tb.engine("pydy"), benchmark(name).problem().mechanism
    checked = check_model(engine, mechanism)
    assert checked.holds
    first = mechanism.bodies[-1]
    heavy = first.model_copy(update={"mass": (1 + 1e-9) * first.mass})
    wrong = mechanism.model_copy(update={"bodies": (*mechanism.bodies[:-1], heavy)})
    fault = SimpleNamespace(
        name="pydy",
        capabilities=engine.capabilities,
        inspect=lambda _, states: engine.inspect(wrong, states),
    )
    assert not check_model(fault, mechanism).holds


def test_what_it_has_not_is_refused() -> None:
    for preset in ("default", "settings"):
        with pytest.raises(tb.UnsupportedProblemError, match="stops on angles"):
            tb.engine("pydy", preset).simulate(tb.Problem(tb.fixed(), duration=0.1))
    rod = _rod(0.0)
    rotor = tb.RotorInertia(name="rotor", body="rod", inertia=0.1)
    driven = rod.model_copy(update={"force_elements": (rotor,)})
    with pytest.raises(tb.UnsupportedProblemError, match="rotor"):
        tb.engine("pydy").simulate(tb.Problem(driven, duration=0.1))
    with pytest.raises(tb.UnsupportedProblemError, match="rotor"):
        tb.engine("pydy").inspect(driven, ())


def test_what_is_trebuchecks_is_stated() -> None:
    supplied = stated(tb.engine("pydy"), tb.fixed())
    assert supplied is not None and own(supplied) is Own.DYNAMICS
    assert stated(tb.engine("pydy", "settings"), tb.fixed()) is not None


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    cls = engine_class("pydy")
    monkeypatch.setattr(cls, "version", classmethod(lambda _: "not installed"))
    with pytest.raises(tb.EngineNotInstalledError, match=r"`pip install pydy` brings it\.$"):
        tb.engine("pydy").simulate(FREE_SWING)
