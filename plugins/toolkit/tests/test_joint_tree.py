"""What plug-ins of trees of joints share, on a tree whose step is known."""

from collections.abc import Mapping

import numpy as np
import pytest
import trebucheck as tb
from elements import tied
from mechanisms import G, body_of, pin
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import Stop
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import StopLaw
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits, LimitedMotion
from trebucheck_toolkit.plain_run import plain_run

STEP = 1e-3
BAR = Mechanism(
    name="bar",
    bodies=(body_of("bar", "a", 1.0, (1.0, 0.0), 1.0),),
    joints=(pin("pin", "ground", "bar"),),
    stops=(Stop(name="rest", body="bar", sense=1, limit=0.25, closed=True),),
    gravity=G,
    start=(0.25,),
)


class Pressed:
    """A tree of one joint: its bias pushes it onto its lower limit, less so from step to step, at
    last away from it.
    """

    def __init__(self) -> None:
        self.coordinates, self.range, self.steps = JointCoordinates(BAR), (-np.inf, np.inf), 0
        self.now = np.zeros(1), np.zeros(1)

    def place(self, j: FloatArray, v: FloatArray) -> None:
        self.now = j, v

    def limit(self, index: int, low: float, high: float) -> None:
        self.range = low, high

    def state(self) -> tuple[FloatArray, FloatArray]:
        return self.now

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        return np.array([[2.0]])

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        return np.array([10.5 - self.steps])

    def step(self, forces: FloatArray) -> Mapping[str, FloatArray]:
        j, v = self.now
        v = np.maximum(v + STEP * (forces - self.bias(j, v)) / 2.0, (self.range[0] - j) / STEP)
        self.now, self.steps = (j + STEP * v, v), self.steps + 1
        return {"pin": np.array([1.0, 2.0])}

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        return Observation({}, float(v[0]) ** 2, 0.0)


@pytest.mark.parametrize("law", list(StopLaw))
def test_a_limit_pushes_with_what_the_change_of_speed_leaves_over(law: StopLaw) -> None:
    problem, tree = tb.Problem(BAR, duration=0.02, stop_law=law), Pressed()
    motion = LimitedMotion(problem, tree, STEP, "pressed")
    found = plain_run(problem, motion, "pressed", STEP)  # type: ignore[arg-type]
    assert found.stop_torques["rest"][:11] == pytest.approx(
        10.5 - np.arange(11)
    )  # shown where its step begins
    assert found.stop_torques["rest"][11:] == pytest.approx(0.0, abs=1e-9)
    assert found.release_times == {"rest": pytest.approx(11 * STEP)}
    assert found.q[11, 0] == 0.25 and found.q[12, 0] > 0.25
    assert (tree.range[0] == -np.inf) == (law is StopLaw.RELEASE_ONCE)


@pytest.mark.parametrize(
    ("body", "other", "sense", "limits"),
    [
        ("bob", "hull", 1, (0.5, np.inf)),
        ("bob", "hull", -1, (-np.inf, -0.5)),
        ("hull", "bob", 1, (-np.inf, -0.5)),
    ],
)
def test_stops_are_ranges_of_joints(
    body: str, other: str, sense: int, limits: tuple[float, float]
) -> None:
    where = {"body": body, "relative_to": other}
    stop = Stop(name="stop", sense=sense, limit=0.5, closed=False, **where)
    start = {1: (0.1, 0.8), -1: (0.8, 0.1)}[sense if body == "bob" else -sense]
    coordinates = JointCoordinates(tied().model_copy(update={"stops": (stop,), "start": start}))
    found = JointLimits(coordinates, "x")
    place = found.places["stop"][0]
    assert coordinates.freedoms[place].joint.child == "bob"
    assert found.ranges(["stop"]) == {place: limits}
    assert found.ranges([]) == {place: (-np.inf, np.inf)}


def test_a_stop_on_no_joint_is_refused() -> None:
    stop = Stop(name="far", body="bob", sense=1, limit=-9.0, closed=False)
    with pytest.raises(tb.UnsupportedProblemError, match="'far' is on none"):
        JointLimits(JointCoordinates(tied().model_copy(update={"stops": (stop,)})), "x")
