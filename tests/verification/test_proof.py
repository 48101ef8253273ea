"""Proved motions against closed forms, against the reference, and against each other."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from typing import Any

import flint
import numpy as np
import pytest
import trebucheck as tb
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.comparisons.prove import ProofFile
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.reference.certification import certificate as certificates
from trebucheck.reference.certification.certificate import Certificate
from trebucheck.reference.certification.certify import BEYOND_LAUNCH
from trebucheck.reference.certification.proved import ProvedMotionOfFigures, with_proof
from trebucheck.reference.equations import Equations
from trebucheck.reference.proof.balls import arb, as_decimals, exact, precision
from trebucheck.reference.proof.motion import Limits, ProvedMotion
from trebucheck.reference.proof.numbers import exact_numbers
from trebucheck.reference.proof.proof import Enclosure, Proof
from trebucheck.reference.proof.proof import prove as prove_problem
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.numbers import numbers_of
from trebucheck.reference.taylor.solve import taylor_quantities

acb: Any = flint.acb
CERTIFICATES = Path(certificates.__file__).parent / "certificates"


def rod(angle: float, **more: Any) -> tb.Mechanism:
    """A uniform rod of 1 m and 2 kg on a pin, let go at an angle (clockwise from +x)."""
    body = tb.Body(name="rod", angle="q", mass=2.0, centre=(0.5, 0.0), inertia=0.125)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    fields = {"gravity": 9.75, "start": (angle,)} | more
    return tb.Mechanism(name="rod", bodies=(body,), joints=(pin,), **fields)


def closed_form(angle: float, t: Fraction) -> Any:
    """The rod's angle in balls: sin(x/2) = k sn(K - w t), x from the vertical, k = sin(x_0/2)."""
    # Inertia about the pin 0.125 + 2 * 0.25; moment of the weight 2 * 9.75 * 0.5: all exact.
    rate = (arb(2 * 9.75 * 0.5) / arb(0.625)).sqrt()
    k = ((arb(angle) - arb.pi() / 2) / 2).sin()
    m = k * k
    # sn(z | m) by theta functions: sn = (t3 / t2) * theta1(v) / theta4(v), v = z / (2 K) of Arb's.
    quarter = acb(m).elliptic_k().real
    other = acb(1 - m).elliptic_k().real
    tau = acb(0, 1) * acb(other) / acb(quarter)
    z = quarter - rate * arb(flint.fmpq(t.numerator, t.denominator))
    v = acb(z / (2 * quarter))
    theta1, _, _, theta4 = v.modular_theta(tau)
    _, theta2, theta3, _ = acb(0).modular_theta(tau)
    sn = ((theta3 / theta2) * theta1 / theta4).real
    return arb.pi() / 2 + 2 * (k * sn).asin()


@pytest.mark.parametrize("angle", [0.0, -1.25])
def test_a_pendulum_is_enclosed_to_forty_digits(angle: float) -> None:
    proof = tb.prove(rod(angle), digits=40, until=1.25)
    known = proof.q(1.25)["q"]
    assert known.radius < Decimal("1e-40")
    with precision(400):
        value, radius = as_decimals(closed_form(angle, Fraction(5, 4)))
    assert radius < Decimal("1e-60")
    assert known.contains(value)
    assert not Enclosure(known.value + 3 * known.radius, known.radius).contains(value)


def test_energy_is_kept_within_its_radius() -> None:
    proof = tb.prove(rod(0.5), digits=25, until=2.0)
    (kinetic, first), (moving, last) = proof.energy(0.0), proof.energy(2.0)
    assert kinetic.value == 0
    off = abs(Fraction(first.value) - Fraction(moving.value) - Fraction(last.value))
    assert off <= sum(map(Fraction, (first.radius, moving.radius, last.radius)))
    assert last.radius < Decimal("1e-20")


def test_the_fixed_machine_is_proved_and_the_reference_is_within_its_uncertainty() -> None:
    proof, solution = tb.prove("fixed", digits=15), solve(tb.Problem(tb.fixed(), duration=3.0))
    assert proof.launch_time is not None and proof.launch_speed is not None
    launch = solution.launch
    assert launch is not None
    assert float(proof.launch_time.value) == pytest.approx(launch.time, abs=1e-11)
    assert float(proof.launch_speed.value) == pytest.approx(launch.speed, rel=1e-11)
    assert proof.launch_time.radius < Decimal("3e-15")
    for stop, time in solution.release_times.items():
        known = proof.release_time(stop)
        assert (known is None) == (time is None)
        if known is not None:
            assert float(known.value) == pytest.approx(time, abs=1e-11)
    t = 1.3
    samples = solution.motion(np.array([t]))
    for found, expected in (
        (proof.q(t), samples.q),
        (proof.u(t), samples.u),
        (proof.a(t), samples.a),
    ):
        values = [float(each.value) for each in found.values()]
        assert values == pytest.approx(expected[0].tolist(), rel=1e-9)
    stop = "sling rest"
    torque = float(proof.stop_torque(stop, t).value)
    assert torque == pytest.approx(samples.stop_torques[stop][0], rel=1e-9)
    position, velocity = proof.marker("projectile", t)
    trajectory = solution.trajectory(np.array([t]))
    marker = trajectory.markers["projectile"]
    assert [float(x.value) for x in position] == pytest.approx(marker.position[0].tolist())
    assert [float(x.value) for x in velocity] == pytest.approx(marker.velocity[0].tolist())


def _moved(problem: tb.Problem, order: int, digits: int, bits: int, until: Fraction) -> Any:
    with precision(bits):
        motion = ProvedMotion(problem, order, 10.0**-digits, Limits(seconds=60.0))
        motion.run(until)
        q, u = motion.phases[-1].at(exact(until))
        return [*(event.time for event in motion.events), *q, *u]


@given(
    st.floats(7.0, 12.0), st.floats(1e3, 4e3), st.floats(-0.2, 0.2), st.floats(0.3, 1.6),
)  # fmt: skip
def test_enclosures_of_any_two_settings_intersect(
    l1: float, mass: float, phi: float, until: float
) -> None:
    parameters = tb.TrebuchetParameters(l1=l1, m_cw=mass)
    machine = tb.fixed(parameters.model_copy(update={"phi0": parameters.phi0 + phi}))
    problem, end = tb.Problem(machine, duration=5.0), Fraction(until)
    first = _moved(problem, 12, 12, 90, end)
    second = _moved(problem, 17, 20, 130, end)
    assert len(first) == len(second)
    assert all(a.overlaps(b) for a, b in zip(first, second, strict=True))
    assert max(float(b.rad()) for b in second) < max(float(a.rad()) for a in first)


@pytest.mark.parametrize(
    "name", ["fixed", "rolling", "squeezer", "slider-crank", "hanging-chain", "catapult"]
)
def test_accelerations_enclose_those_of_the_equations(name: str) -> None:
    """The numbers contain the doubles of the reference; accelerations agree to its rounding."""
    given_model = tb.model(name) if name in ("fixed", "rolling", "catapult") else tb.problem(name)
    problem = given_model if isinstance(given_model, tb.Problem) else tb.Problem(given_model)
    with precision(160):
        motion = ProvedMotion(problem, 10, 66.0, Limits())
        exactly = exact_numbers(problem, motion.kinematics)
        doubles = numbers_of(problem, Kinematics(problem.mechanism), np.float64)
        scale = max(1.0, float(np.abs(doubles).max()))
        for ball, number in zip(exactly, doubles, strict=True):
            assert float(ball) == pytest.approx(number, abs=1e-15 * scale)
        q, u = initial_state(problem.mechanism)
        closed = tuple(s.name for s in problem.mechanism.stops if s.closed)
        tape = motion._system(closed, (), launches=False).tape
        u = u + 0.0
        found = tape.values(motion.numbers, [arb(float(x)) for x in q], [arb(float(x)) for x in u])
        expected = Equations(problem.mechanism).solve(q, u, closed)[0]
        largest = max(1.0, float(np.abs(expected).max()))
        accelerations = [float(x) for x in found[: len(q)]]
        assert accelerations == pytest.approx(expected.tolist(), abs=1e-11 * largest)


@pytest.mark.parametrize(
    ("name", "until"),
    [("slider-crank", 0.125), ("squeezer", 2.0**-14), ("stopped-pendulum", 0.25), ("bead", 0.25)],
)
def test_forces_of_joints_are_those_of_the_reference(name: str, until: float) -> None:
    problem = tb.problem(name)
    proof, solution = tb.prove(problem, digits=10, until=until), solve(problem)
    reactions = solution.trajectory(np.array([until])).joint_reactions
    largest = max(float(np.abs(force).max()) for force in reactions.values())
    for joint, force in reactions.items():
        found = [float(part.value) for part in proof.joint_reaction(joint, until)]
        assert found == pytest.approx(force[0].tolist(), abs=1e-9 * largest)


def test_dependent_constraints_are_named() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="not unique"):
        tb.prove("three-cranks", digits=5)


@pytest.mark.parametrize("name", ["fixed", "catapult", "hinged", "floating-arm"])
def test_certificates_contain_what_is_proved(name: str) -> None:
    text = (CERTIFICATES / f"{name}.json").read_text(encoding="utf-8")
    certificate, proof = Certificate.model_validate_json(text), tb.prove(name, digits=14)
    known = ProvedMotionOfFigures(proof, BEYOND_LAUNCH)
    held = [with_proof(figure, known) for figure in certificate.figures]
    assert sum(figure.proved_value is not None for figure in held) > 35
    assert all(figure.proved_value or figure.not_proved for figure in held)


def wall(restitution: float) -> tb.Mechanism:
    """The rod falls from level onto a wall below, straight down, where it is vertical."""
    stop = tb.Stop(
        name="wall", body="rod", limit=-math.pi / 2, sense=-1, restitution=restitution, closed=False
    )
    return rod(0.0, stops=(stop,))


def test_an_impact_leaves_with_its_part_of_the_speed() -> None:
    problem = tb.Problem(wall(0.5), duration=2.0, stop_law=tb.StopLaw.UNILATERAL)
    proof = tb.prove(problem, digits=15, until=0.75)
    ((name, time),) = proof.impacts
    assert name == "wall"
    motion = proof.motion
    (event,) = motion.events
    with precision(proof.bits):
        before, after = event.u[0], motion.phases[1].steps[0].at(arb(0))[1][0]
        assert (2 * after + before).contains(0)
        assert float((2 * after + before).rad()) < 1e-14
        free = motion.phases[0].at(event.time)[0][0]
    assert float(free) == pytest.approx(math.pi / 2, abs=1e-15)
    solution = solve(problem)
    assert float(time.value) == pytest.approx(solution.impacts[0][0], abs=1e-11)
    assert float(proof.q(0.75)["q"].value) == pytest.approx(
        float(solution.motion(np.array([0.75])).q[0, 0]), abs=1e-9
    )


def test_a_plastic_impact_stays_closed_and_pushes() -> None:
    problem = tb.Problem(wall(0.0), duration=2.0, stop_law=tb.StopLaw.UNILATERAL)
    proof = tb.prove(problem, digits=10, until=1.0)
    # The double of pi/2 is 6e-17 less than pi/2: so far from straight down the weight has a moment.
    torque = proof.stop_torque("wall", 0.9)
    assert float(torque.value) == pytest.approx(9.75 * math.cos(math.pi / 2), rel=1e-6)
    tilted = tb.Stop(name="wall", body="rod", limit=-1.0, sense=-1, restitution=0.0, closed=False)
    problem = tb.Problem(rod(0.0, stops=(tilted,)), duration=2.0, stop_law=tb.StopLaw.UNILATERAL)
    proof = tb.prove(problem, digits=10, until=1.0)
    assert proof.motion.phases[-1].closed == ("wall",)
    torque = proof.stop_torque("wall", 0.9)
    weight = 2 * 9.75 * 0.5 * math.cos(1.0)
    assert float(torque.value) == pytest.approx(weight, rel=1e-9)


def test_infinitely_many_impacts_end_when_the_closed_form_says() -> None:
    proof = tb.prove("bouncing", digits=25)
    rest = proof.motion.events[-1]
    assert rest.kind == "rest"
    with precision(300):
        exactly = 3 * (arb(2) / arb(9.81)).sqrt()
        assert rest.time.overlaps(exactly) and float(rest.time.rad()) < 1e-25


@pytest.mark.parametrize("restitution", [0.3, 0.7])
def test_a_rod_comes_to_rest_on_a_stop(restitution: float) -> None:
    """The gap's acceleration changes with the angle, as it does not of a ball on a floor."""
    limit = -math.pi / 4
    stop = tb.Stop(
        name="wall", body="rod", limit=limit, sense=-1, restitution=restitution, closed=False
    )
    problem = tb.Problem(rod(0.0, stops=(stop,)), duration=3.0, stop_law=tb.StopLaw.UNILATERAL)
    coarse, fine = (tb.prove(problem, digits) for digits in (8, 20))
    (first, *_), times = solve(problem).rest_times["wall"], list[Any]()
    for proof in (coarse, fine):
        (rest,) = (event for event in proof.motion.events if event.kind == "rest")
        assert rest.q[0].contains(arb(-limit)) and rest.u[0].contains(0)
        assert float(rest.time.mid()) == pytest.approx(first, abs=1e-9)
        assert float(proof.stop_torque("wall", 3.0).value) == pytest.approx(
            2.0 * 9.75 * 0.5 * math.cos(limit), rel=1e-8
        )
        times.append(rest.time)
    assert times[0].overlaps(times[1]) and times[1].rad() < times[0].rad() < 1e-8


def test_what_cannot_be_proved_is_named() -> None:
    bouncing = tb.Problem(wall(0.5), duration=60.0, stop_law=tb.StopLaw.UNILATERAL)
    with pytest.raises(tb.SimulationError):
        tb.prove(bouncing, digits=5, until=60.0, timeout=2.0)
    with pytest.raises(tb.InputError, match="digits"):
        tb.prove("fixed", digits=0)
    with pytest.raises(tb.InputError, match="until"):
        tb.prove("fixed", until=-1.0)
    with pytest.raises(tb.InputError, match="until"):
        tb.prove(rod(0.0))
    proof = tb.prove(rod(0.0), digits=5, until=0.1)
    for end in ("x", "1e999999999", "-1e-999999999", "nan", "inf", math.inf, "1/0"):
        with pytest.raises(tb.InputError, match="until"):
            tb.prove(rod(0.0), digits=5, until=end)
    with pytest.raises(tb.InputError):
        proof.q("1e400")
    for asked in (lambda: proof.q(3.0), lambda: proof.q(-1.0), lambda: proof.marker("x", 0.1)):
        with pytest.raises(tb.InputError):
            asked()
    with pytest.raises(tb.InputError):
        proof.release_time("none")


@given(st.integers(-(10**12), 10**12), st.integers(-80, 20), st.integers(-80, -40))
def test_decimals_enclose_their_ball(mantissa: int, exponent: int, spread: int) -> None:
    assume(mantissa)
    with precision(200):
        middle = Fraction(mantissa) * Fraction(2) ** exponent
        ball = exact(middle) + arb(0, 2.0**spread)
        known = Enclosure(*as_decimals(ball))
        for end in (ball.lower(), ball.upper(), ball.mid()):
            numerator, power = end.man_exp()
            value = Fraction(int(numerator)) * Fraction(2) ** int(power)
            assert abs(value - Fraction(known.value)) <= Fraction(known.radius) * (
                1 + Fraction(1, 10**9)
            )


def test_a_text_is_the_decimal_that_it_says() -> None:
    """0.3 as a text is 3/10, which no double is: the motion differs by the speed times 1e-17."""
    proof = tb.prove(rod(0.0), digits=30, until="0.3")
    speed = proof.u("0.3")["q"].value
    by_text, by_double = proof.q("0.3")["q"], proof.q(0.299999999999999988897769753748)["q"]
    off = (by_text.value - by_double.value) / speed
    assert float(off) == pytest.approx(float(Fraction("0.3") - Fraction(0.3)), rel=1e-6)


def test_the_figures_of_a_proof_are_its_own() -> None:
    proof = tb.prove("fixed", digits=10)
    assert isinstance(proof, Proof)
    names = [figure.name for figure in proof.figures]
    assert names[:3] == ["release of hanger rest", "release of sling rest", "launch of projectile"]
    assert not proof.lacking
    assert repr(proof)


STRUCK = tb.TrebuchetParameters(
    l1=8.15, l2=4.49, m_b=54.11, m_cw=2906.32, m_a=903.51, h=12.47, r=5.69, g=11.18, phi0=3.01,
    alpha0=-0.71,
)  # fmt: skip
"""A machine whose arm's stop turns the projectile through the launch direction."""
STANDING = tb.TrebuchetParameters(
    l1=12.07, l2=3.28, m_b=73.01, m_cw=3281.43, m_a=1136.38, h=9.27, r=5.38, g=10.65, phi0=2.73,
    alpha0=-0.93,
)  # fmt: skip
"""A machine that stands still for an instant with both its stops closed, and never launches."""


def test_a_launch_in_an_impact_is_that_of_the_reference() -> None:
    problem = tb.Problem(tb.fixed(STRUCK), duration=6.0, stop_law=tb.StopLaw.UNILATERAL)
    proof = prove_problem(problem, 12)
    known = taylor_quantities(problem).launch
    assert known is not None and proof.launch_time is not None and proof.launch_speed is not None
    assert proof.motion.events[-1].kind == "launch"
    (_, struck) = proof.impacts[-1]
    assert struck == proof.launch_time
    assert abs(float(proof.launch_time.value) - known.time) < 1e-13 * known.time
    assert abs(float(proof.launch_speed.value) - known.speed) < 1e-12 * known.speed


def test_what_starts_from_rest_is_not_launched() -> None:
    """Where one degree of freedom is left, all velocities are zero at once where it turns."""
    problem = tb.Problem(tb.fixed(STANDING), duration=6.0, stop_law=tb.StopLaw.UNILATERAL)
    assert prove_problem(problem, 8).launch_time is None
    assert taylor_quantities(problem).launch is None


@settings(max_examples=6)
@given(st.integers(0, 10**6))
def test_enclosures_of_random_mechanisms_intersect(seed: int) -> None:
    """Of random mechanisms with stops, by orders, steps and bits that are drawn, too."""
    chosen = np.random.default_rng(seed)
    problem = tb.Problem(random_mechanism(seed), duration=0.25, stop_law=tb.StopLaw.UNILATERAL)
    runs: list[tuple[list[tuple[str, str]], list[Any]]] = []
    for _ in range(3):
        order, digits = int(chosen.integers(8, 24)), int(chosen.integers(4, 20))
        bits = math.ceil(digits * math.log2(10)) + int(chosen.integers(10, 60))
        with precision(bits):
            motion = ProvedMotion(problem, order, digits * math.log2(10), Limits(seconds=2.0))
            try:
                motion.run(Fraction(1, 4))
            except (tb.SimulationError, tb.UnsupportedProblemError):
                continue  # undecided, or dear: nothing is said
            q, u = motion.phases[-1].at(exact(Fraction(1, 4)))
        kinds = [(event.kind, event.name) for event in motion.events]
        runs.append((kinds, [*(event.time for event in motion.events), *q, *u]))
    for (kinds, found), (others, other) in combinations(runs, 2):
        assert kinds == others
        assert all(a.overlaps(b) for a, b in zip(found, other, strict=True))


PROOFS = Path(__file__).parents[2] / "docs" / "proofs"
NAMED = sorted(path.stem for path in PROOFS.glob("*.json") if path.stem in tb.problems())


@pytest.mark.parametrize("name", NAMED)
def test_the_proofs_that_are_published_are_those_of_the_reference(name: str) -> None:
    known = ProofFile.from_json((PROOFS / f"{name}.json").read_text())
    problem = tb.problem(name)
    assert known.mechanism_hash == problem.mechanism.content_hash
    assert known.digits == 30 and known.until == problem.duration
    end = solve(problem).trajectory(np.array([problem.duration]))
    for k, coordinate in enumerate(problem.mechanism.coordinates):
        (figure,) = (each for each in known.figures if each.name == f"{coordinate} at the end")
        # The reference's tolerance is 1e-12; motions part by less than 1e4 times meanwhile.
        assert abs(float(figure.value) - end.q[0, k]) < 1e-8 * max(1.0, abs(end.q[0, k]))


def test_the_published_end_of_the_squeezer_is_late() -> None:
    """As the page says: 1.14e-9 rad of 15.8 rad."""
    known = ProofFile.from_json((PROOFS / "squeezer.json").read_text())
    (figure,) = (each for each in known.figures if each.name == "k1 at the end")
    off = Decimal("15.81077119629904") + Decimal(figure.value)  # k1 counts clockwise
    assert abs(off - Decimal("1.145e-9")) < Decimal("1e-11")


def test_what_two_stops_bring_to_rest_has_a_speed_of_zero() -> None:
    """The sling is still in its rest when the arm meets its stop: both stop, and fall back.

    Their speeds are zero, not nearly so: no ball about zero tells whether the projectile, which
    moves against the launch direction then, is launched.
    """
    parameters = tb.TrebuchetParameters(
        l1=8.073, l2=4.739, m_b=69.83, m_cw=3644.0, m_a=875.5, h=9.631, r=5.708, g=8.46,
        theta0=0.0, phi0=2.6, alpha0=-0.8323,
    )  # fmt: skip
    problem = tb.Problem(tb.fixed(parameters), duration=6.0, stop_law=tb.StopLaw.UNILATERAL)
    proof = tb.prove(problem, digits=10, until=3.5)
    assert [event.name for event in proof.motion.events] == ["hanger rest", "arm stop"]
    states = proof.motion.phases[-1].steps[0].states
    speeds = [ball.is_zero() for ball in states.box()[3:]]
    assert speeds == [True, True, False]
    exact = solve(problem).motion(np.array([3.5])).q[0]
    found = [float(each.value) for each in proof.q(3.5).values()]
    assert exact == pytest.approx(found, abs=1e-8)
