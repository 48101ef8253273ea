"""Of the plug-ins that are installed: orders of their steps, and their own limits. Agreement is
`trebucheck conform`'s.

Each plug-in has an environment of its own, so that mostly one of the cases runs; where none is
installed, all are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

FREE_SWING = tb.Problem(tb.fixed().model_copy(update={"stops": ()}), duration=2.0)
FREE_SWING_BAR = 1e-8  # [m] at a preset's working settings


@dataclass(frozen=True)
class Limits:
    """How well limits of its own hold both machines at steps of 1 ms."""

    options: Mapping[str, object] = field(default_factory=dict[str, object])
    """With which they hold."""
    release: float = 2e-3
    """[s] A step late by the scheme, and one by its end."""
    torque: float | None = 1e-2
    """Of the greatest; None: it tells none. First order: where one ends in some tenths of a second,
    a step is that."""
    position: float = np.inf
    """Of a marker [m]."""
    slots: bool = True
    """Whether the engine has the slot of the rolling machine, which is skipped else."""


@dataclass(frozen=True)
class Steps:
    """Facts about the steps of a preset."""

    engine: str
    preset: str
    step: float
    """[s] from which the order shows, to its half."""
    limits: Limits | None = None
    """Of its own; None: it has none, or those of another preset are tried."""
    forces: bool = True
    """Whether its reactions are of its order."""
    options: Mapping[str, object] = field(default_factory=dict[str, object])
    order: float | None = None
    """Where the options change it from the preset's."""

    def __str__(self) -> str:
        return f"{self.engine}-{self.preset}"

    def run(
        self, problem: tb.Problem, step: float | None = None, **options: object
    ) -> tb.Trajectory:
        """The engine's motion."""
        if self.engine not in tb.engines():
            pytest.skip(f"{self.engine} is not installed")
        fields = {"timestep": step or self.step, **self.options, **options}
        return tb.engine(self.engine, self.preset, **fields).simulate(problem)


OWN = (
    Steps("dart", "default", 4e-3, limits=Limits()),
    # Its joint sensors are wrong in motion; see its README.
    Steps("pybullet", "settings", 4e-3, limits=Limits(), forces=False),
    Steps("drake", "default", 2e-3),
    # It tells no forces of joints; its limits begin without force, see its own tests.
    Steps("brax", "settings", 4e-3, forces=False),
)
"""Those of first order."""
SINGLE = (
    # Releases: two steps by the scheme and its end, and three in which the torque falls through
    # what rounding leaves of it. Torques: a step's change of speed in single precision, 1e3 times
    # by the matrix of pin and limit. Positions: first order, 1e-2 m at this step.
    Steps("box2d", "assisted", 8e-3, limits=Limits(release=5e-3, torque=2e-2, position=1e-2)),
    # From 4 ms on joints of 60 Hz give way by what leaves 8e-3 m, until the world's time runs
    # faster. Positions: first order, 40 m/s times a sub-step. Torques: joints begin without
    # impulses, and a stop's first torques are none; forces are of the joints' softness and not of
    # the step.
    Steps(
        "pyb2d3",
        "assisted",
        16e-3,
        limits=Limits(release=2e-3, torque=None, position=1e-2),
        forces=False,
    ),
    # Releases: speeds of some 5e-3 rad/s are the rounding of a limit; the opening gap has that
    # speed after 1e-2 s. Positions: 6e-3 m at 8 ms are 7e-4 m at 1 ms; and a thousandth of a mass
    # in the slot, on 20 m of way.
    Steps(
        "rapier",
        "assisted",
        16e-3,
        limits=Limits(release=1e-2, torque=None, position=5e-3),
        forces=False,
    ),
    Steps("rapier", "default", 16e-3, forces=False),
    # Releases and positions as with Box2D; torques: its rounding, and a step of the tenth of a
    # second in which one ends.
    Steps("jolt", "assisted", 8e-3, limits=Limits(release=5e-3, torque=3e-2, position=1e-2)),
    # Positions: first order, 1e-2 m at this step.
    Steps("physx", "assisted", 8e-3, limits=Limits(position=1e-2)),
    Steps("physx", "settings", 8e-3, limits=Limits(position=1e-2)),
    # A limit's torque below the moment of its joint's force on a step's way is none, which ends it
    # a step before.
    Steps("ovphysx", "assisted", 4e-3, limits=Limits(release=3e-3, position=1e-2, slots=False)),
    Steps("ovphysx", "settings", 4e-3, limits=Limits(release=3e-3, position=1e-2, slots=False)),
)
"""Those of first order and single precision."""
IMPULSES = (
    # Positions: up to 100 m/s times a step.
    Steps("planck", "assisted", 4e-3, limits=Limits(position=1e-1)),
    # A step begins without impulses of the one before: its last iterations leave a hundredth.
    Steps("cannon", "assisted", 4e-3, limits=Limits(position=1e-1, slots=False)),
    # The forces of its first step, which begins without impulses of one before, are not there after
    # 8 iterations.
    Steps("planck", "default", 4e-3, forces=False),
    # A limit acts in the steps that begin beyond it: its first one has no torque, the second twice.
    # Positions: up to 100 m/s times a step.
    Steps("p2", "assisted", 4e-3, limits=Limits(position=1e-1, torque=None)),
    # It tells no forces; its pins hold bodies of little inertia at steps below 4e-3 s.
    Steps("matter", "assisted", 2e-3, forces=False),
    Steps("matter", "settings", 2e-3, forces=False),
)
"""Those of first order by impulses in double precision."""
# Its limits are critically damped springs with a time constant of two steps, which hold from the
# second step on: a release and a torque may be late by some steps more. It tells no joint forces.
# Positions: up to 100 m/s times a step.
SOFT = (
    Steps(
        "genesis",
        "settings",
        4e-3,
        limits=Limits(release=1e-2, torque=None, position=1e-1),
        forces=False,
    ),
)
"""Those of first order whose limits are soft."""
LOOP_OF_ITS_EXAMPLES = Steps(
    "pinocchio",
    "assisted",
    2e-3,
    options={"scheme": "semi-implicit Euler", "locate_releases": False},
    order=1.0,
)
MOVED = tuple(Steps(name, "assisted", 8e-3) for name in ("pinocchio", "dart", "pybullet", "mjx"))
"""Those that RK4 moves."""
EXACT = (*MOVED, *(Steps(name, "assisted", 1e-3) for name in ("drake", "opensim", "pydy")))


def _errors(found: tb.Trajectory, problem: tb.Problem) -> tuple[float, float]:
    """Greatest distance of a marker from where it should be [m]; greatest error of a reaction
    [N]."""
    truth = solve(problem).trajectory(found.t)
    points = [
        np.abs(m.position - truth.markers[name].position).max() for name, m in found.markers.items()
    ]
    forces = [
        np.abs(force - truth.joint_reactions[name]).max()
        for name, force in found.joint_reactions.items()
    ]
    return float(max(points)), float(max(forces, default=0.0))


@pytest.mark.parametrize(
    "steps", [*OWN, *SINGLE, *IMPULSES, *SOFT, *MOVED, LOOP_OF_ITS_EXAMPLES], ids=str
)
def test_the_order_is_the_one_that_is_claimed(steps: Steps) -> None:
    coarse, fine = (
        _errors(steps.run(FREE_SWING, h), FREE_SWING) for h in (steps.step, steps.step / 2)
    )
    study = tb.engine(steps.engine, steps.preset).study()  # type: ignore[attr-defined]
    claimed = steps.order or study.step_orders[steps.preset].order
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(claimed, abs=0.3)
    # Forces of an RK4 are those of its states; some of them are better than they at the longer
    # step.
    assert not steps.forces or np.log2(coarse[1] / fine[1]) > claimed - 0.5


@pytest.mark.parametrize("steps", EXACT, ids=str)
def test_the_free_swing_is_within_its_bar(steps: Steps) -> None:
    assert _errors(steps.run(FREE_SWING, 1e-3), FREE_SWING)[0] < FREE_SWING_BAR


@pytest.mark.parametrize("steps", [*OWN, *IMPULSES, *SOFT, LOOP_OF_ITS_EXAMPLES], ids=str)
def test_the_limit_of_its_steps_is_the_reference(steps: Steps) -> None:
    """Richardson's extrapolation of steps h, h / 2 and h / 4 at the end, of the first order."""
    (q0, q1, q2) = (steps.run(FREE_SWING, h).q[-1] for h in (1e-3, 5e-4, 2.5e-4))
    a, b = 2 * q1 - q0, 2 * q2 - q1
    truth = solve(FREE_SWING).trajectory(np.array([2.0])).q[-1]
    # 16 m from the axis; what is left of the second extrapolate's error is of the third order.
    assert 16 * np.abs((4 * b - a) / 3 - truth).max() < 1e-5


@pytest.mark.parametrize("model", ["fixed", "rolling"])
@pytest.mark.parametrize(
    "steps",
    [each for each in (*OWN, *SINGLE, *IMPULSES, *SOFT) if each.limits is not None],
    ids=str,
)
def test_its_own_limits_hold(steps: Steps, model: str) -> None:
    problem, h, limits = tb.Problem(tb.model(model), duration=1.4), 1e-3, steps.limits or Limits()
    if model == "rolling" and not limits.slots:
        pytest.skip(f"{steps.engine} has no slots")
    found = steps.run(problem, h, **limits.options)
    truth = solve(tb.Problem(problem.mechanism, duration=1.4 + h)).trajectory(found.t)
    for name, motion in found.markers.items():
        assert np.abs(motion.position - truth.markers[name].position).max() < limits.position
    for name, time in truth.release_times.items():
        released, torques = found.release_times.get(name), truth.stop_torques[name]
        assert (released is None) == (time is None)
        assert released is None or time is None or abs(released - time) <= limits.release
        if limits.torque is not None:
            assert np.abs(found.stop_torques[name] - torques).max() <= limits.torque * max(
                torques.max(), 1.0
            )


@pytest.mark.parametrize(
    ("problem", "word"), [("slider-crank", "loop|slot"), ("bouncing", "restitution")]
)
@pytest.mark.parametrize("steps", OWN, ids=str)
def test_its_own_step_refuses_what_it_cannot(steps: Steps, problem: str, word: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=word):
        steps.run(benchmark(problem).problem(), 1e-3)
