"""An own mechanism: a double pendulum in the reference and MuJoCo, compared at MuJoCo's times."""

from __future__ import annotations

import numpy as np
import trebucheck as tb

pendulum = tb.Mechanism(
    name="double-pendulum",
    bodies=(
        # Angles are absolute, from +x, positive clockwise: pi/2 hangs straight down.
        tb.Body(name="upper", angle="a", mass=2.0, centre=(0.5, 0.0), inertia=0.2),
        tb.Body(name="lower", angle="b", mass=1.0, centre=(0.4, 0.0), inertia=0.1),
    ),
    joints=(
        tb.PinJoint(
            name="shoulder", parent="ground", child="upper", parent_point=(0, 0), child_point=(0, 0)
        ),
        tb.PinJoint(
            name="elbow", parent="upper", child="lower", parent_point=(1, 0), child_point=(0, 0)
        ),
    ),
    markers=(tb.Marker(name="tip", body="lower", point=(0.8, 0)),),
    gravity=9.81,
    start=(0.3, 0.2),
)
problem = tb.Problem(pendulum, duration=2.0)
motion = tb.engine("mujoco", timestep=1e-3).simulate(problem)
reference = tb.engine("reference", timestep=1e-3).simulate(problem)

at = np.searchsorted(reference.t, motion.t - 1e-12)  # both sample every millisecond
error = np.linalg.norm(
    motion.marker("tip").position - reference.marker("tip").position[at], axis=1
).max()
print(f"{len(motion.t)} samples, largest error of the tip's position {error:.1e} m")
# `trebucheck compare --model pendulum.json` takes this text as a file.
print(pendulum.to_json()[:60], "...")
