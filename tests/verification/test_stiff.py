"""Stiff motions: closed forms, the method's order, and Radau's method against DOP853."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import chain, pin
from scipy.integrate import DenseOutput, solve_ivp
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import initial_state
from trebucheck.reference import TOLERANCE, compiled, stiff
from trebucheck.reference.equations import Equations
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve
from trebucheck.reference.stiff import RadauIntegrator, longest_step, tableau

INERTIA, DAMPING, STIFFNESS = 1e-4, 30.0, 20.0  # kg m^2, N m s/rad, N m/rad: rates 3e5 and 0.67 /s


def wheel(inertia: float, damping: float, stiffness: float, name: str = "wheel") -> dict[str, Any]:
    """A balanced wheel on a pin with a spring and a damper: body, joint, element."""
    spring = tb.RotationalSpringDamper(
        name=f"spring of {name}", body=name, damping=damping, stiffness=stiffness
    )
    return {
        "bodies": (
            tb.Body(name=name, angle=f"q {name}", mass=1.0, centre=(0, 0), inertia=inertia),
        ),
        "joints": (pin(f"pin of {name}", "ground", name, (0, 0), (0, 0)),),
        "force_elements": (spring,),
    }


def wheels(*each: dict[str, Any], start: tuple[float, ...], speeds: Any) -> tb.Mechanism:
    """Wheels beside each other."""
    parts = {key: tuple(part for one in each for part in one[key]) for key in each[0]}
    return tb.Mechanism(name="wheels", gravity=9.81, start=start, start_speeds=speeds, **parts)


def finger(*stops: tb.Stop) -> tb.Mechanism:
    """A chain with a light rod, whose damper is stiff, at its end."""
    plain = chain(*stops)
    tip = tb.Body(name="tip", angle="c", mass=1e-3, centre=(0.02, 0.0), inertia=1e-7)
    damper = tb.RotationalSpringDamper(
        name="knuckle", body="tip", relative_to="lower", damping=0.01, stiffness=0.05
    )
    return chain(
        *stops,
        bodies=(*plain.bodies, tip),
        joints=(*plain.joints, pin("knuckle pin", "lower", "tip", (0.1, -1.5), (0, 0))),
        force_elements=(damper,),
        start=(0.3, 0.2, 0.4),
        start_speeds=(1.0, -2.0, 3.0),
    )


def by_dop853_alone(monkeypatch: pytest.MonkeyPatch, problem: tb.Problem) -> Solution:
    """The motion by the explicit method."""
    with monkeypatch.context() as patch:
        patch.setattr(stiff, "_SHORT", -1)
        return solve(problem)


def explicit_evaluations(mechanism: tb.Mechanism, duration: float) -> float:
    """Evaluations of DOP853 with the longest steps it may take."""
    q, _ = initial_state(mechanism)
    return 12 * duration / longest_step(Equations(mechanism), q, ())


def test_a_damped_wheel_follows_its_closed_form() -> None:
    """Two exponentials: the fast one is gone in 10 us, the slow one takes seconds."""
    speed = 3.0
    one = wheels(wheel(INERTIA, DAMPING, STIFFNESS), start=(1.0,), speeds=(speed,))
    solution = solve(tb.Problem(one, duration=4.0))
    times = np.linspace(0.0, 4.0, 401)
    half, root = DAMPING / 2, np.sqrt(DAMPING**2 / 4 - STIFFNESS * INERTIA)
    slow, fast = -STIFFNESS / (half + root), -(half + root) / INERTIA
    of_fast = (speed - slow) / (fast - slow)
    exact = (1 - of_fast) * np.exp(slow * times) + of_fast * np.exp(fast * times)
    # The damper's torque, 30 N m s/rad at 1 rad/s, is rounded to some 1e-15 N m at each step.
    assert solution.motion(times).q[:, 0] == pytest.approx(exact, abs=1e-12)
    assert solution.evaluations < explicit_evaluations(one, 4.0) / 100


def pendulum(q: FloatArray, _: FloatArray) -> FloatArray:
    """Its accelerations, with a length and a gravity of one."""
    return -np.sin(q)


def moved(step: float, end: float) -> list[DenseOutput]:
    """A pendulum moved with steps of one length, whatever their errors: their dense outputs."""
    stepper = RadauIntegrator(pendulum, 0.0, np.array([2.0, 0.5]), end, (TOLERANCE, TOLERANCE))
    stepper._error = lambda *_, **__: 0.0  # type: ignore[method-assign]
    pieces: list[DenseOutput] = []
    while stepper.t < end * (1 - 1e-12):
        stepper.h_abs = step
        stepper.step()
        pieces.append(stepper.dense_output())
    return pieces


def test_ends_of_steps_are_of_thirteenth_order_and_what_lies_between_of_eighth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stiff, "_ITERATIONS", 100)  # long steps need more
    end = 12.0
    start = np.array([2.0, 0.5])
    exact = solve_ivp(
        lambda t, y: [y[1], -np.sin(y[0])], (0, end), start, "DOP853",
        rtol=3e-14, atol=3e-14, dense_output=True,
    ).sol  # fmt: skip
    ends, between = list[float](), list[float]()
    for steps in (12, 18):
        pieces = moved(end / steps, end)
        assert len(pieces) == steps
        ends.append(float(np.abs(pieces[-1](end) - exact(end)).max()))
        times = [np.linspace(piece.t_old, piece.t, 11) for piece in pieces]
        errors = (np.abs(piece(t) - exact(t)).max() for piece, t in zip(pieces, times, strict=True))
        between.append(max(map(float, errors)))
    orders = [np.log(first / last) / np.log(1.5) for first, last in (ends, between)]
    # They approach the order from above.
    assert orders[0] > 12.5
    assert orders[1] > 7.5


def test_the_coefficients_fulfil_their_conditions() -> None:
    """Stages integrate polynomials of degree 6 exactly, and ends those of degree 12."""
    nodes, matrix = tableau().nodes, tableau().matrix
    for power in range(7):
        integrals = nodes ** (power + 1) / (power + 1)
        assert matrix @ nodes**power == pytest.approx(integrals, abs=4e-15)
    for power in range(13):
        assert matrix[-1] @ nodes**power == pytest.approx(1 / (power + 1), abs=4e-15)
    # The embedded formula is of seventh order: of f = t^k it leaves gamma 0^k + e . changes.
    for power in range(7):
        changes = nodes ** (power + 1) / (power + 1)
        of_start = tableau().at_start * (power == 0)
        assert of_start + tableau().of_error @ changes == pytest.approx(0.0, abs=4e-14)


@pytest.mark.parametrize("restitution", [None, 0.5, 0.0], ids=["free", "rebounds", "rests"])
def test_both_methods_find_one_motion(
    monkeypatch: pytest.MonkeyPatch, restitution: float | None
) -> None:
    stop = tb.Stop(
        name="limit", body="lower", sense=1, limit=-0.4, closed=False, restitution=restitution or 0
    )
    free = restitution is None
    law = tb.StopLaw.RELEASE_ONCE if free else tb.StopLaw.UNILATERAL
    problem = tb.Problem(finger(*(() if free else (stop,))), duration=0.6, stop_law=law)
    explicit, implicit = by_dop853_alone(monkeypatch, problem), solve(problem)
    assert implicit.evaluations < explicit.evaluations / 5
    times = np.linspace(0.0, 0.6, 61)
    # DOP853's thousands of steps are rounded each: by 1e-15 times their number.
    rounding = 1e-15 * explicit.evaluations
    assert implicit.motion(times).q == pytest.approx(explicit.motion(times).q, abs=rounding)
    ends = [[segment.end for segment in one.segments] for one in (implicit, explicit)]
    assert ends[0] == pytest.approx(ends[1], abs=rounding)
    assert len(ends[0]) > 1 - free


def test_what_changes_at_instants_goes_on_with_the_implicit_method(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each of its segments ends before DOP853 has made many steps, and all of them are stiff."""
    plain, instants = finger(), tuple(0.05 * k for k in range(10))
    torques = tuple(0.02 * (-1) ** k for k in range(10))
    push = tb.RecordedTorque(name="push", body="tip", times=instants, torques=torques)
    elements = (*plain.force_elements, push)
    problem = tb.Problem(plain.model_copy(update={"force_elements": elements}), duration=0.5)
    explicit, implicit = by_dop853_alone(monkeypatch, problem), solve(problem)
    assert len(implicit.segments) == len(instants)
    assert implicit.evaluations < explicit.evaluations / 5
    times = np.linspace(0.0, 0.5, 51)
    rounding = 1e-15 * explicit.evaluations
    assert implicit.motion(times).q == pytest.approx(explicit.motion(times).q, abs=rounding)


def test_a_stiff_motion_needs_no_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, times = tb.Problem(finger(), duration=0.1), np.linspace(0.0, 0.1, 41)
    quick = solve(problem)
    expected = quick.motion(times).q
    monkeypatch.setattr(compiled, "is_available", lambda: False)
    monkeypatch.setitem(sys.modules, "trebucheck.reference.kernel", None)  # as without Numba
    compiled.kernel.cache_clear()
    slow = solve(problem)
    assert slow.evaluations < explicit_evaluations(problem.mechanism, 0.1) / 2
    assert slow.motion(times).q == pytest.approx(expected, abs=1e-15 * slow.evaluations)
    # Positions of what was moved by Numba can be read without it.
    assert quick.segments[-1].interpolant(0.05)[:3] == pytest.approx(expected[20], abs=1e-14)


def test_where_another_part_needs_steps_as_short_the_explicit_method_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One wheel is held back by stability, the other swings so fast that accuracy asks for it."""
    longest = 3.0 * INERTIA / DAMPING
    fast = 0.03 / longest  # rad/s
    both = wheels(
        wheel(INERTIA, DAMPING, STIFFNESS),
        wheel(1.0, 0.0, fast**2, name="fast"),
        start=(1.0, 0.1),
        speeds=(0.0, 0.0),
    )
    problem = tb.Problem(both, duration=0.02)
    explicit, chosen = by_dop853_alone(monkeypatch, problem), solve(problem)
    assert chosen.evaluations < 2 * explicit.evaluations
    times = np.linspace(0.0, 0.02, 201)
    exact = 0.1 * np.cos(fast * times)
    assert chosen.motion(times).q[:, 1] == pytest.approx(exact, abs=1e-12)


def test_without_accelerations_the_stages_do_not_converge() -> None:
    """A sentence tells that the step collapsed, and no step is accepted."""

    def accelerations(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.where(np.abs(q) > 1.5, np.nan, 0.0 * u)

    start = np.array([0.0, 1.0])
    stepper = RadauIntegrator(accelerations, 0.0, start, 9.0, (1e-9, 1e-9))

    def to_the_end() -> None:
        while stepper.t < 9.0:
            stepper.step()

    with pytest.raises(tb.SimulationError, match=r"t = 1\.(49999|5) s"):
        to_the_end()
    # Steps are halved until the central differences of the accelerations reach beyond 1.5.
    assert 1.5 / (1 + np.cbrt(np.finfo(float).eps)) < stepper.t <= 1.5
