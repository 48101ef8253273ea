"""Chipmunk's impulses of an impact are those of the impact law, solved by a mass matrix.

The two share no arithmetic: one moves bodies through joints with displaced targets, the other
solves the complementarity problem in the mechanism's coordinates.
"""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import chain, chain_on_a_slot, slider_crank
from recorded_engines import braced
from trebucheck.engines import impact as law
from trebucheck.models.elements import PointStop, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.reference.equations import Equations, consistent_speeds

pymunk = pytest.importorskip("pymunk")

from trebucheck.engines.pymunk.motion import resolve_impact  # noqa: E402

EXACT = 1e-7
"""Impulses are settled to ten digits, in a step of 1 s."""

STOPS = (
    Stop(name="angle", body="upper", sense=1, limit=0.0, closed=True),
    Stop(name="between", body="lower", relative_to="upper", sense=-1, limit=0.0, closed=True),
    PointStop(
        name="wall", body="lower", point=(0.3, -0.8), normal=(0.6, 0.8), offset=0.0, closed=True
    ),
)
CRANK = (
    Stop(name="angle", body="crank", sense=1, limit=0.0, closed=True),
    PointStop(
        name="wall", body="rod", point=(0.7, 0.2), normal=(-0.8, 0.6), offset=0.0, closed=True
    ),
)
BRACE = (Stop(name="brace", body="bob", relative_to="arm", sense=-1, limit=0.0, closed=True),)
BUILT = {
    "bob": (braced(), BRACE),
    "chain": (chain(), STOPS),
    "on a slot": (chain_on_a_slot(), STOPS),
    "loop": (slider_crank(tilt=0.2), CRANK),
}


def _touching(name: str, chosen: tuple[int, ...], seed: int, apart: float = 0.0) -> Mechanism:
    """The mechanism in a state in which these stops touch, but for a gap, and some close."""
    mechanism, every = BUILT[name]
    random = np.random.default_rng(seed)
    q = np.array(mechanism.start)
    if not mechanism.loop_joints:
        q = q + random.uniform(-0.4, 0.4, len(q))
    placed = mechanism.model_copy(
        update={"stops": tuple(every[k] for k in chosen), "start": tuple(q.tolist())}
    )
    stops: list[Stop | PointStop] = []
    for stop in placed.stops:
        field = "limit" if isinstance(stop, Stop) else "offset"
        gap = float(Kinematics(placed).gap(stop.name, q))
        moved = getattr(stop, field) + gap - apart
        stops.append(stop.model_copy(update={field: moved}))
    placed = placed.model_copy(update={"stops": tuple(stops)})
    kinematics = Kinematics(placed)
    assert all(abs(float(kinematics.gap(stop.name, q)) - apart) < 1e-12 for stop in placed.stops)
    u = consistent_speeds(Equations(placed), q, random.uniform(-2.0, 2.0, len(q)), ())
    speeds = [float(kinematics.gap_jacobian(stop.name, q) @ u) for stop in placed.stops]
    if min(speeds) > 0:
        u = -u
    return placed.model_copy(update={"start_speeds": tuple(u.tolist())})


def _by_law(placed: Mechanism, restitution: dict[str, float]) -> law.Impact:
    kinematics, q = Kinematics(placed), np.array(placed.start)
    inertia = law.Inertia(law.mass_matrix(kinematics, q[None])[0], kinematics.loop_jacobian(q))
    gaps = {name: kinematics.gap_jacobian(name, q) for name in restitution}
    return law.resolve_impact(inertia, np.array(placed.start_speeds), gaps, restitution, "law")


CASES = [
    *(("chain", chosen) for chosen in ((0,), (1,), (2,), (0, 1), (0, 2), (1, 2))),
    *(("on a slot", chosen) for chosen in ((0,), (1, 2), (0, 1, 2))),
    ("bob", (0,)),
    *(("loop", chosen) for chosen in ((0,), (1,))),
]


@pytest.mark.parametrize(("name", "chosen"), CASES)
@pytest.mark.parametrize("apart", [0.0, 1e-6, -1e-6])
def test_impulses_and_speeds_are_those_of_the_law(
    name: str, chosen: tuple[int, ...], apart: float
) -> None:
    """A gap that an event leaves is closed by the step at most, and is none of the impact's."""
    for seed in range(3):
        placed = _touching(name, chosen, seed, apart)
        restitution = {stop.name: 0.3 + 0.2 * k for k, stop in enumerate(placed.stops)}
        found, right = resolve_impact(placed, restitution, 1e4), _by_law(placed, restitution)
        tolerance = EXACT + 10 * abs(apart)
        assert found.u == pytest.approx(right.speeds, abs=tolerance)
        assert dict(found.impulses) == pytest.approx(dict(right.impulses), abs=10 * tolerance)
        assert any(impulse > 0.01 for impulse in found.impulses.values())
        resting = {n for n, speed in right.left.items() if abs(speed) < 1e-8}
        assert apart or set(found.resting) == resting


def test_plastic_contacts_rest_and_others_part() -> None:
    placed = _touching("chain", (0,), 1)
    (stop,) = placed.stops
    plastic, elastic = (resolve_impact(placed, {stop.name: e}, 1e4) for e in (0.0, 1.0))
    assert plastic.resting == (stop.name,) and elastic.resting == ()
    came = float(np.dot(Kinematics(placed).gap_jacobian(stop.name, np.array(placed.start)),
                        placed.start_speeds))  # fmt: skip
    left = float(np.dot(Kinematics(placed).gap_jacobian(stop.name, np.array(placed.start)),
                        elastic.u))  # fmt: skip
    assert left == pytest.approx(-came, rel=1e-9)
    kinetic = Kinematics(placed).kinetic_energy
    before, after = (
        float(kinetic(np.array(placed.start), np.array(u)))
        for u in (placed.start_speeds, elastic.u)
    )
    assert after == pytest.approx(before, rel=1e-9)


def test_a_contact_that_is_kept_rests_even_if_it_has_to_pull() -> None:
    """Its pull is not told."""
    placed = _touching("chain", (0,), 1)
    (stop,) = placed.stops
    u = -np.array(placed.start_speeds)  # now it parts
    parting = placed.model_copy(update={"start_speeds": tuple(u.tolist())})
    free = resolve_impact(parting, {stop.name: 0.5}, 1e4)
    assert free.u == pytest.approx(u, abs=EXACT) and free.impulses[stop.name] == 0.0
    kept = resolve_impact(parting, {stop.name: 0.0}, 1e4, (stop.name,))
    row = Kinematics(parting).gap_jacobian(stop.name, np.array(parting.start))
    assert float(row @ kept.u) == pytest.approx(0.0, abs=EXACT)
    assert kept.impulses[stop.name] == 0.0 and kept.resting == (stop.name,)
