"""Engines that are wrong in one way each, and one that is right: what every verdict is tried on.

Each takes the reference's motion of the mechanism, or of another one; some spoil it. Nothing here
declares a tolerance, a study or a built model: a comparison knows of these engines no more than of
any stranger's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import plugin_engines
import trebucheck as tb
from plugin_engines import Plain
from trebucheck.models.trajectory import PointMotion

Spoil = Callable[[tb.Trajectory], tb.Trajectory]
Build = Callable[[tb.Mechanism], tb.Mechanism]


@dataclass(frozen=True)
class Honest(Plain):
    """The reference with tolerances of 1e-10, under another name."""

    name = "honest"
    timestep: float = 1e-3

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        wrong = self.built(problem.mechanism)
        law = self.law or problem.stop_law
        moved = _moved(wrong.to_json(), problem.duration, law, self.timestep)
        return self.read(replace(moved, mechanism=problem.mechanism))

    law: ClassVar[tb.StopLaw | None] = None
    """Which it follows whatever is asked for."""

    def built(self, mechanism: tb.Mechanism) -> tb.Mechanism:
        """What this engine makes of the mechanism."""
        return mechanism

    def read(self, found: tb.Trajectory) -> tb.Trajectory:
        """What this engine makes of the motion."""
        return found


@cache
def _moved(mechanism: str, duration: float, law: tb.StopLaw, timestep: float) -> tb.Trajectory:
    """By the reference at a tolerance that sounds tight.

    Computed once for all engines that spoil it afterwards.
    """
    problem = tb.Problem(tb.Mechanism.from_json(mechanism), duration=duration, stop_law=law)
    return tb.engine("reference", timestep=timestep, rtol=1e-10, atol=1e-10).simulate(problem)


def _markers(found: tb.Trajectory, change: Callable[[PointMotion], PointMotion]) -> tb.Trajectory:
    return replace(found, markers={name: change(motion) for name, motion in found.markers.items()})


def _mapped(values: Mapping[str, Any], change: Callable[[Any], Any]) -> dict[str, Any]:
    return {name: change(value) for name, value in values.items()}


def late(found: tb.Trajectory) -> tb.Trajectory:
    """Every state is that of a millisecond ago."""
    shifted = np.maximum(found.t - 1e-3, 0.0)

    def moved(values: Any) -> Any:
        values = np.asarray(values)
        flat = values.reshape(len(found.t), -1)
        return np.stack([np.interp(shifted, found.t, column) for column in flat.T], axis=1).reshape(
            values.shape
        )

    return replace(
        _markers(found, lambda m: PointMotion(moved(m.position), moved(m.velocity))),
        q=moved(found.q), u=moved(found.u), kinetic_energy=moved(found.kinetic_energy),
        potential_energy=moved(found.potential_energy),
    )  # fmt: skip


def truncated(found: tb.Trajectory) -> tb.Trajectory:
    """Ends after half the time."""
    n = len(found.t) // 2
    cut = lambda values: values[:n]  # noqa: E731
    return replace(
        _markers(found, lambda m: PointMotion(cut(m.position), cut(m.velocity))),
        t=found.t[:n],
        q=found.q[:n],
        u=found.u[:n],
        kinetic_energy=found.kinetic_energy[:n],
        potential_energy=found.potential_energy[:n],
        stop_torques=_mapped(found.stop_torques, cut),
        joint_reactions=_mapped(found.joint_reactions, cut),
        joint_gaps=_mapped(found.joint_gaps, cut),
    )


def frozen(found: tb.Trajectory) -> tb.Trajectory:
    """Stays where it starts."""
    still = lambda values: np.broadcast_to(values[:1], values.shape).copy()  # noqa: E731
    return replace(
        _markers(found, lambda m: PointMotion(still(m.position), 0.0 * m.velocity)),
        q=still(found.q),
        u=0.0 * found.u,
        kinetic_energy=0.0 * found.kinetic_energy,
        potential_energy=still(found.potential_energy),
        release_times=_mapped(found.release_times, lambda _: None),
    )


SPOILS: dict[str, Spoil] = {
    "late": late,
    "truncated": truncated,
    "frozen": frozen,
    "mirrored": lambda f: _markers(
        f, lambda m: PointMotion(m.position * [-1, 1], m.velocity * [-1, 1])
    ),
    "speed_sign": lambda f: replace(f, u=-f.u),
    "marker_speed_sign": lambda f: _markers(f, lambda m: replace(m, velocity=-m.velocity)),
    "half_speed": lambda f: _markers(f, lambda m: replace(m, velocity=0.5 * m.velocity)),
    "reaction_sign": lambda f: replace(f, joint_reactions=_mapped(f.joint_reactions, lambda v: -v)),
    "torque_sign": lambda f: replace(f, stop_torques=_mapped(f.stop_torques, lambda v: -v)),
    "double_torque": lambda f: replace(f, stop_torques=_mapped(f.stop_torques, lambda v: 2 * v)),
    "wrapped": lambda f: replace(f, q=np.angle(np.exp(1j * f.q))),
    "degrees": lambda f: replace(f, q=np.degrees(f.q)),
    "half_energy": lambda f: replace(f, kinetic_energy=0.5 * f.kinetic_energy),
    "potential_zero": lambda f: replace(f, potential_energy=0.0 * f.potential_energy),
    "balanced_energies": lambda f: replace(
        f,
        kinetic_energy=f.kinetic_energy * 0.9,
        potential_energy=f.potential_energy + 0.1 * f.kinetic_energy,
    ),
    "never_releases": lambda f: replace(f, release_times=_mapped(f.release_times, lambda _: None)),
    "releases_early": lambda f: replace(
        f, release_times=_mapped(f.release_times, lambda t: None if t is None else 0.99 * t)
    ),
    "nan": lambda f: replace(f, q=np.where(f.t[:, None] > 1.0, np.nan, f.q)),
    "nan_marker": lambda f: _markers(f, lambda m: replace(m, position=m.position * np.nan)),
    "empty": lambda f: truncated(replace(f, t=f.t[:0])),
    "wrong_shape": lambda f: replace(f, q=f.q[:, :1]),
    "transposed": lambda f: replace(f, q=f.q.T.copy()),
    "no_markers": lambda f: replace(f, markers={}),
    "no_torques": lambda f: replace(f, stop_torques={}),
    "no_reactions": lambda f: replace(f, joint_reactions={}),
    "releases_what_is_open": lambda f: replace(
        f, release_times=_mapped(f.release_times, lambda t: 1.0 if t is None else t)
    ),
    "swapped_releases": lambda f: replace(
        f,
        release_times=dict(zip(f.release_times, list(f.release_times.values())[::-1], strict=True)),
    ),
    "swapped_reactions": lambda f: replace(
        f,
        joint_reactions=dict(
            zip(f.joint_reactions, list(f.joint_reactions.values())[::-1], strict=True)
        ),
    ),
    "milliseconds": lambda f: replace(f, t=1000 * f.t),
    "slow_time": lambda f: replace(f, t=1.001 * f.t),
    "kilojoules": lambda f: replace(
        f, kinetic_energy=f.kinetic_energy / 1e3, potential_energy=f.potential_energy / 1e3
    ),
    "anticlockwise": lambda f: replace(f, q=-f.q, u=-f.u),
    "no_trajectory": lambda f: None,  # type: ignore[dict-item,return-value]
    "swapped_markers": lambda f: replace(
        f, markers=dict(zip(f.markers, list(f.markers.values())[::-1], strict=True))
    ),
}
"""Ways to spoil a motion after it has been computed, by name."""


def _bodies(mechanism: tb.Mechanism, **factors: float) -> tb.Mechanism:
    """With fields of the bodies multiplied."""
    bodies = [
        b.model_copy(update={key: getattr(b, key) * factor for key, factor in factors.items()})
        for b in mechanism.bodies
    ]
    return mechanism.model_copy(update={"bodies": tuple(bodies)})


def _first(mechanism: tb.Mechanism, **factors: float) -> tb.Mechanism:
    """With fields of the last body multiplied: a factor of all masses alone changes no motion."""
    return mechanism.model_copy(
        update={"bodies": (*mechanism.bodies[:-1], *_bodies(mechanism, **factors).bodies[-1:])}
    )


BUILDS: dict[str, Build] = {
    "quarter_gravity": lambda m: m.model_copy(update={"gravity": 0.25 * m.gravity}),
    "earth_gravity": lambda m: m.model_copy(update={"gravity": 1.01 * m.gravity}),
    "heavy": lambda m: _first(m, mass=1.02),
    "heavy_everywhere": lambda m: _bodies(m, mass=1.01, inertia=1.01),
    "round_arm": lambda m: _bodies(m, inertia=1.05),
    "no_stops": lambda m: m.model_copy(update={"stops": ()}),
    "other_start": lambda m: m.model_copy(
        update={"start_speeds": (0.01,) * len(m.coordinates), "stops": ()}
    ),
}
"""Ways to build another mechanism, by name."""


def _wrong(name: str, fault: Spoil | Build) -> type[Honest]:
    what = "read" if name in SPOILS else "built"
    own = {"name": name.replace("_", "-"), what: lambda self, given: fault(given)}
    return type(f"Wrong_{name}", (Honest,), own)


class Bilateral(Honest):
    """Follows one law of the stops whatever it is asked for."""

    name = "bilateral"
    law = tb.StopLaw.RELEASE_ONCE


WRONG: dict[str, type[Honest]] = {
    name: _wrong(name, fault) for name, fault in (SPOILS | BUILDS).items()
}
"""By the name of the fault."""
globals().update({cls.__name__: cls for cls in WRONG.values()})


def announce(folder: Path) -> None:
    """Write the metadata of an installed distribution that brings these engines."""
    points = [
        f"{cls.name} = wrong_engines:{cls.__name__}" for cls in (Honest, Bilateral, *WRONG.values())
    ]
    plugin_engines.announce(
        folder, "trebucheck-wrong-engines", "\n".join(["[trebucheck.engines]", *points, ""])
    )
