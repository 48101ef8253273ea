"""One run as a document."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...models.trajectory import Trajectory
from .document import Document, table


def document(trajectory: Trajectory) -> Document:
    """What one run found."""
    provenance = trajectory.provenance
    title = f"{trajectory.mechanism.name}, {provenance.engine} {provenance.preset} ({provenance.engine_version})"
    return Document(title, (table("|", _quantities(trajectory), title),))


def _quantities(trajectory: Trajectory) -> Iterator[tuple[str, str]]:
    yield "simulated", f"{trajectory.t[-1]:.6g} s in {trajectory.provenance.steps} steps"
    yield "wall time", f"{trajectory.provenance.wall_time:.3f} s"
    for name, time in trajectory.release_times.items():
        if trajectory.mechanism.stop(name).closed:
            yield f"{name} opens", "not" if time is None else f"{time:.9f} s"
    for name, torque in trajectory.stop_torques.items():
        stop = trajectory.mechanism.stop(name)
        yield f"{name}, largest {stop.effort}", f"{torque.max():.6g} {stop.force_unit}"
    launch = trajectory.launch() if "projectile" in trajectory.markers else None
    if launch is not None:
        yield "launch (velocity at 45 deg)", f"{launch.time:.9f} s"
        yield "launch speed", f"{launch.speed:.8f} m/s"
    drift = np.abs(trajectory.total_energy - trajectory.total_energy[0]).max()
    yield "energy drift", f"{drift:.3g} J of {trajectory.total_energy[0]:.6g} J"
