"""Singular positions: passed on the smooth branch where the speed tells it, and refused with a
sentence elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from mechanisms import G, parallel_cranks, pin
from scipy.integrate import quad
from scipy.special import ellipj, ellipk
from trebucheck.comparisons.report.pages.tables import predictable
from trebucheck.comparisons.runs.results import Machine, SingularPosition
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import SlotJoint
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import GROUND, Body, Marker, Mechanism
from trebucheck.models.problem import Problem
from trebucheck.reference.equations import Equations, consistent_coordinates
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor


def _rod(name: str, length: float) -> Body:
    return Body(
        name=name, angle=f"{name} angle", mass=1.0, centre=(length / 2, 0), inertia=length**2 / 12
    )


def _windows(
    n: int, start: float, speed: float, length: float = 1.0, width: float = 1.0
) -> Mechanism:
    """Four-bars in a row (A02 of the IFToMM benchmarks): slender rods of 1 kg, n + 1 cranks and n
    couplers.

    Args:
        n: number of four-bars.
        start: angle of the cranks, clockwise from the horizontal [rad].
        speed: of the cranks [rad/s].
        length: of the cranks [m].
        width: of the couplers [m].
    """
    cranks, couplers = range(n + 1), range(n)
    return Mechanism(
        name="four-bars",
        bodies=(
            *(_rod(f"crank {k}", length) for k in cranks),
            *(_rod(f"coupler {k}", width) for k in couplers),
        ),
        joints=(
            *(pin(f"foot {k}", GROUND, f"crank {k}", (k * width, 0)) for k in cranks),
            *(pin(f"head {k}", f"crank {k}", f"coupler {k}", (length, 0)) for k in couplers),
            *(
                pin(f"loop {k}", f"coupler {k}", f"crank {k + 1}", (width, 0), (length, 0))
                for k in couplers
            ),
        ),
        markers=(Marker(name="B0", body="crank 0", point=(length, 0)),),
        gravity=G,
        start=(start,) * (n + 1) + (0.0,) * n,
        start_speeds=(speed,) * (n + 1) + (0.0,) * n,
    )


def _by_taylor(problem: Problem) -> Solution:
    pytest.importorskip("heyoka")
    return solve_taylor(problem)


@pytest.mark.parametrize(
    ("by", "n", "speed"),
    [(solve, 1, 1.0), (solve, 3, -0.7), pytest.param(_by_taylor, 1, 0.9, marks=pytest.mark.slow)],
)
def test_four_bars_pass_their_singular_positions_for_ten_seconds(
    by: Callable[[Problem], Solution], n: int, speed: float
) -> None:
    solution, t = by(Problem(_windows(n, -math.pi / 2, speed), 10.0)), np.linspace(0.0, 10.0, 101)
    # Together they are a pendulum that goes round: half its angle from the lowest position is
    # Jacobi's am.
    omega = math.sqrt(G * ((n + 1) / 2 + n) / ((n + 1) / 3 + n))
    half_speed = math.sqrt(speed**2 + 4 * omega**2) / 2
    modulus = (omega / half_speed) ** 2
    turned = math.copysign(2.0, speed) * ellipj(half_speed * t - ellipk(modulus), modulus)[3]
    motion = solution.motion(t)
    assert (
        np.abs(motion.q[:, : n + 1] - (motion.q[0, 0] + turned - turned[0])[:, None]).max() < 1e-9
    )
    assert np.abs(motion.q[:, n + 1 :]).max() < 1e-12
    flat = np.flatnonzero(np.diff(np.floor(motion.q[:, 0] / math.pi)))
    assert len(solution.singular_passages) == len(flat) > 5
    for passage, before in zip(solution.singular_passages, flat, strict=True):
        assert t[before] < passage.time < t[before + 1]
        assert passage.lost == n
        angle = solution.motion(np.array([passage.time])).q[0, 0]
        assert abs(math.remainder(angle, math.pi)) < 20 * passage.time_uncertainty + 1e-13


@pytest.mark.parametrize("by", [solve, pytest.param(_by_taylor, marks=pytest.mark.slow)])
def test_a_motion_may_end_in_the_middle_of_a_passage(by: Callable[[Problem], Solution]) -> None:
    mechanism = _windows(1, -math.pi / 2, 1.0)
    whole = solve(Problem(mechanism, 1.0))
    ((window,),) = (segment.windows for segment in whole.segments)
    end = 0.3 * window.start + 0.7 * window.end
    cut = by(Problem(mechanism, end))
    assert cut.segments[-1].end == end == cut.segments[-1].windows[-1].end
    assert cut.motion(np.array([end])).q == pytest.approx(whole.motion(np.array([end])).q, abs=1e-9)


def test_redundant_cranks_pass_theirs_as_one_pendulum() -> None:
    t = np.linspace(0.0, 2.0, 41)
    solutions = [solve(Problem(parallel_cranks(n, start=-1.0), 2.0)) for n in (2, 3)]
    for n, solution in zip((2, 3), solutions, strict=True):
        mass, moment = n * 1.0 + 3.0, n * 0.25 + 3.0 * 0.5
        inertia = n * (0.02 + 0.25**2) + 3.0 * 0.5**2 - moment**2 / mass
        body = Body(name="all", angle="a", mass=mass, centre=(moment / mass, 0), inertia=inertia)
        one = Mechanism(
            name="one",
            bodies=(body,),
            joints=(pin("foot", GROUND, "all"),),
            gravity=G,
            start=(-1.0,),
        )
        assert (
            np.abs(solution.motion(t).q[:, 0] - solve(Problem(one, 2.0)).motion(t).q[:, 0]).max()
            < 1e-11
        )
        assert (
            len(solution.singular_passages)
            == np.abs(np.diff(np.floor(solution.motion(t).q[:, 0] / np.pi))).sum()
        )


def test_loops_pass_their_own_positions_shortly_one_after_the_other() -> None:
    level, tilt = _windows(2, -1.0, 2.0), 0.05
    foot = pin("foot 2", GROUND, "crank 2", (1 + math.cos(tilt), -math.sin(tilt)))
    joints = tuple(foot if joint.name == "foot 2" else joint for joint in level.joints)
    solution = solve(
        Problem(
            level.model_copy(update={"joints": joints, "start": (-1.0,) * 3 + (0.0, tilt)}), 3.0
        )
    )
    t = np.linspace(0.0, 3.0, 301)
    assert (
        np.abs(
            solution.motion(t).q
            - solution.motion(t).q[:, :1] * [1, 1, 1, 0, 0]
            - [0, 0, 0, 0, tilt]
        ).max()
        < 1e-12
    )
    turned = solution.motion(t).q[:, 0] / math.pi
    counted = [np.abs(np.diff(np.floor(turned - aside / math.pi))).sum() for aside in (0.0, tilt)]
    passed = [
        solution.motion(np.array([passage.time])).q[0, 0] for passage in solution.singular_passages
    ]
    for count, aside in zip(counted, (0.0, tilt), strict=True):
        assert (
            count
            == sum(abs(math.remainder(angle - aside, math.pi)) < 1e-12 for angle in passed)
            > 2
        )


class _ChangePoint:
    """A four-bar whose shortest and longest links are together as long as the others: ground +
    coupler = the rest.

    With all links on one line two branches cross. With r the distance from the crank's tip to the
    rocker's foot, 16 area^2 = (r^2 - (b - c)^2) ((b + c)^2 - r^2) has a double zero there, whose
    root changes its sign on the branch.
    """

    a, b, c, d = 1.0, 3.0, 2.5, 1.5

    def points(self, crank: complex) -> tuple[FloatArray, FloatArray]:
        """Tips of the crank and of the coupler, analytic in the crank's angle; shapes (2,)."""
        a, b, c, d = self.a, self.b, self.c, self.d
        tip = np.array([a * np.cos(crank), -a * np.sin(crank)])
        across = np.array([d - tip[0], -tip[1]])
        r2 = across[0] ** 2 + across[1] ** 2
        # r^2 - (b - c)^2 = 4 a d sin^2(crank / 2), as (d - a)^2 = (b - c)^2
        area = -2 * np.sqrt(a * d) * np.sin(crank / 2) * np.sqrt((b + c) ** 2 - r2) / 4
        along, up = (b**2 - c**2 + r2) / (2 * r2), 2 * area / r2
        return tip, tip + along * across + up * np.array([-across[1], across[0]])

    def inertia(self, crank: float) -> float:
        """Reduced to the crank's angle, slender rods of 1 kg; derivatives by a complex step."""
        tip, end = (point.imag / 1e-20 for point in self.points(crank + 1e-20j))
        rods = ((np.zeros(2), tip), (tip, end), (end, np.zeros(2)))
        return sum(float(v @ v + v @ w + w @ w) / 3 for v, w in rods)

    def potential(self, crank: float) -> float:
        """[J]"""
        tip, end = self.points(crank)
        return G * float(tip[1].real + end[1].real)

    def mechanism(self, crank: float, speed: float) -> Mechanism:
        """At a crank's angle [rad] and speed [rad/s]."""
        tip, end = (point.real for point in self.points(crank))
        angles = (crank, -math.atan2(*(end - tip)[::-1]), -math.atan2(end[1], end[0] - self.d))
        v, w = (speed * point.imag / 1e-20 for point in self.points(crank + 1e-20j))
        arms = ((w - v, end - tip), (w, end - np.array([self.d, 0])))
        turns = [(u[0] * arm[1] - u[1] * arm[0]) / (arm @ arm) for u, arm in arms]
        return Mechanism(
            name="change point",
            bodies=(_rod("crank", self.a), _rod("coupler", self.b), _rod("rocker", self.c)),
            joints=(
                pin("foot", GROUND, "crank"),
                pin("head", "crank", "coupler", (self.a, 0)),
                pin("rock", GROUND, "rocker", (self.d, 0)),
                pin("loop", "coupler", "rocker", (self.b, 0), (self.c, 0)),
            ),
            gravity=G,
            start=angles,
            start_speeds=(speed, *map(float, turns)),
        )


def test_branches_that_cross_are_passed_straight_on() -> None:
    linkage, start, speed = _ChangePoint(), -1.3, 6.0
    solution = solve(Problem(linkage.mechanism(start, speed), 2.0))
    energy = 0.5 * linkage.inertia(start) * speed**2 + linkage.potential(start)
    assert len(solution.singular_passages) == 2

    def slowness(crank: float) -> float:
        return math.sqrt(linkage.inertia(crank) / (2 * (energy - linkage.potential(crank))))

    for crank in (-0.3, 0.3, 2.0, 6.0, 6.6):
        t = quad(slowness, start, crank, epsabs=1e-13, epsrel=1e-13, limit=200)[0]
        assert solution.motion(np.array([t])).q[0, 0] == pytest.approx(crank, abs=1e-10)


def _slider_crank(crank: float, speed: float, mirrored: bool = True) -> Mechanism:
    """A crank and a rod as long as it.

    Its tip runs in a slot through the pivot, at which all constraints vanish.
    """
    slot = SlotJoint(name="slot", child="rod", parent_point=(0, 0), child_point=(1, 0), axis=(1, 0))
    return Mechanism(
        name="slider crank",
        bodies=(_rod("crank", 1.0), _rod("rod", 1.0)),
        joints=(pin("pivot", GROUND, "crank"), pin("elbow", "crank", "rod", (1, 0)), slot),
        gravity=G,
        start=(crank, -crank),
        start_speeds=(speed, -speed if mirrored else speed),
    )


@pytest.mark.parametrize("start", [0.3, math.pi / 2], ids=["beside it", "in it"])
def test_a_slider_crank_with_equal_links_keeps_to_its_branch(start: float) -> None:
    """The rod mirrors the crank.

    From the position over the pivot on, both could also turn as one.
    """
    solution = solve(Problem(_slider_crank(start, 3.0), 3.0))
    motion = solution.motion(np.linspace(0.0, 3.0, 61))
    a, u = motion.q[:, 0], motion.u[:, 0]
    assert np.abs(motion.q[:, 1] + a).max() < 1e-12
    inertia = (
        1 / 3 + 1 / 12 + 0.25 + 2 * np.sin(a) ** 2
    )  # the rod's centre: 1.5 cos a to the side, sin a / 2 down
    energy = 0.5 * inertia * u**2 - G * np.sin(a)
    assert np.ptp(energy) < 1e-11
    assert len(solution.singular_passages) >= 2


def test_both_ways_out_of_a_singular_position_are_told_apart_by_the_speed() -> None:
    """Crank and rod that turn as one are a pendulum of a third of the inertia, and the slot does
    not hold them.
    """
    solution, t = (
        solve(Problem(_slider_crank(math.pi / 2, 3.0, mirrored=False), 1.0)),
        np.linspace(0.0, 1.0, 21),
    )
    motion = solution.motion(t)
    assert np.abs(motion.q[:, 1] - motion.q[:, 0] - (motion.q[0, 1] - motion.q[0, 0])).max() < 1e-11


def test_where_the_speed_tells_no_branch_the_reference_says_so() -> None:
    rate = 1.2 * G
    turns_in_it = _windows(1, 1.0, -math.sqrt(2 * rate * math.sin(1.0)))
    with pytest.raises(SimulationError, match=r"gave up at t = 0\.419\d+ s in a singular position"):
        solve(Problem(turns_in_it, 2.0))
    with pytest.raises(SimulationError, match="in a singular position"):
        solve(Problem(_windows(1, 0.0, 0.0), 2.0))
    with pytest.raises(SimulationError, match="cannot start at t = 0 s in a singular position"):
        solve(Problem(_slider_crank(math.pi / 2, 0.0), 2.0))


@pytest.mark.parametrize("part", [1e-2, 1e-6])
def test_a_motion_that_turns_just_before_or_behind_it(part: float) -> None:
    speed = -math.sqrt(2 * 1.2 * G * math.sin(1.0))
    before, behind = (solve(Problem(_windows(1, 1.0, speed * (1 + d)), 0.8)) for d in (-part, part))
    assert len(before.singular_passages) == 0
    assert len(behind.singular_passages) == 2
    t = np.linspace(0.0, 0.8, 41)
    for solution in (before, behind):
        motion = solution.motion(t)
        energy = 5 / 6 * motion.u[:, 0] ** 2 - 2 * G * np.sin(motion.q[:, 0])
        assert np.abs(motion.q[:, 2]).max() < 1e-11
        assert np.ptp(energy) < 1e-11


def test_loops_that_all_but_have_a_singular_position_are_no_passage() -> None:
    """A coupler a part longer turns the mechanism round there; one longer by a rounding does not.

    Between is told.
    """

    def solved(longer: float) -> Solution:
        nearly = _windows(1, -1.3, 0.0, width=2.0)
        bodies = tuple(
            body if body.name != "coupler 0" else _rod("coupler 0", 2.0 + longer)
            for body in nearly.bodies
        )
        joints = tuple(
            joint
            if joint.name != "loop 0"
            else joint.model_copy(
                update={"child_point": (1.0, 0.0), "parent_point": (2.0 + longer, 0.0)}
            )
            for joint in nearly.joints
        )
        equal = nearly.model_copy(update={"bodies": bodies, "joints": joints})
        start = consistent_coordinates(Equations(equal), np.array(equal.start), ())
        assert start is not None
        return solve(Problem(equal.model_copy(update={"start": tuple(start)}), 0.8))

    assert len(solved(4e-16).singular_passages) == 1
    regular = solved(1e-3)
    assert not regular.singular_passages
    assert np.abs(regular.motion(np.array([0.8])).q[0, 0]) < 3
    with pytest.raises(SimulationError, match="rounding decides on the branch"):
        solved(1e-12)


class _TouchingBranches(Equations):
    """Of two coordinates, held to y (y - x^2) = 0 instead of by their slot.

    Branches with one tangent where x = 0.
    """

    @staticmethod
    def _plane(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        return q[..., 0] - 0.8, q[..., 1] + 0.3

    def loop_residual(self, q: FloatArray) -> FloatArray:
        x, y = self._plane(q)
        return (y * (y - x**2))[..., None]

    def constraint_jacobian(self, q: FloatArray, closed: Sequence[str]) -> FloatArray:
        x, y = self._plane(q)
        return np.stack([-2 * x * y, 2 * y - x**2], axis=-1)[..., None, :]

    def constraint_bias(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> FloatArray:
        (x, y), v, w = self._plane(q), u[..., 0], u[..., 1]
        return (-2 * y * v**2 - 4 * x * v * w + 2 * w**2)[..., None]


def test_branches_with_one_tangent_are_not_told_apart() -> None:
    moving = _slider_crank(0.3, 1.0).model_copy(update={"start_speeds": (1.0, 0.0)})
    with pytest.raises(
        SimulationError,
        match=r"gave up at t = 0\.\d+ s in a singular position.* branches of its motion",
    ):
        solve(Problem(moving, 1.0), equations=_TouchingBranches(moving))


def test_the_report_states_the_singular_positions_that_were_passed() -> None:
    passed = SingularPosition(time=0.5, time_uncertainty=2e-14, uncertainty=3e-15, lost=1)
    fields = {"compared_to": 1.0, "judged_to": 1.0, "predictability": None}
    assert "singular" not in predictable(Machine.model_construct(**fields, singular_positions=()))
    text = predictable(Machine.model_construct(**fields, singular_positions=(passed,) * 6))
    assert "at 0.5, 0.5, 0.5, 0.5, 0.5 s and 1 times more (uncertain by 2e-14 s)" in text
