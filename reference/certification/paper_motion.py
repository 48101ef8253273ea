"""The paper's own equations, integrated: a third formulation of its two machines, by its own formulas alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray
from ...models.launch import LAUNCH_ANGLE, Launch
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.trebuchet import ARM_STOP, HANGER_REST, SLING_REST
from .held import HeldMotion, march
from .paper import PaperEquations
from .quantities import COUNTERWEIGHT, PROJECTILE, PointState

# Signs by which the paper's multipliers become torques, and its constraints gaps: G1 is minus the sling's gap.
_SIGNS = {SLING_REST: -1.0, HANGER_REST: 1.0}
_GAPS = {SLING_REST: (-1.0, 1.0, 0.0), HANGER_REST: (1.0, 0.0, -1.0)}


@dataclass(frozen=True)
class PaperSystem:
    """States y = (q, u) of the paper's machine; q = (theta, phi, alpha) and, rolling, x_p."""

    parameters: TrebuchetParameters
    equations: PaperEquations

    @property
    def stops(self) -> tuple[str, ...]:
        """The two rests, as the paper numbers their constraints."""
        return (SLING_REST, HANGER_REST)

    @property
    def start(self) -> FloatArray:
        """At rest at the start angles."""
        p = self.parameters
        q = [p.theta0, p.phi0, p.alpha0] + [0.0] * self.equations.rolling
        return np.array(q + [0.0] * len(q))

    def rates(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """dy/dt."""
        return np.concatenate([y[len(y) // 2 :], self._solve(y, held)[0]])

    def torques(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """Torques of the held stops [N m], in their order."""
        in_order = [name for name in self.stops if name in held]
        torques = dict(zip(in_order, self._solve(y, held)[1], strict=True))
        return np.array([_SIGNS[name] * torques[name] for name in held])

    def gap_accelerations(self, y: FloatArray, held: tuple[str, ...], of: tuple[str, ...]) -> FloatArray:
        """Second derivatives of gaps [rad/s^2]."""
        return np.array([_GAPS[name] for name in of]).reshape(len(of), 3) @ self._solve(y, held)[0][:3]

    def projected(self, y: FloatArray, held: tuple[str, ...]) -> FloatArray:
        """The state itself: its constraints are linear, and the integrator keeps them to rounding."""
        return y

    def _solve(self, y: FloatArray, held: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        q, u = np.split(y, 2)
        return self.equations.solve(self.parameters, q, u, SLING_REST in held, HANGER_REST in held)


@dataclass(frozen=True)
class PaperMotion:
    """A motion by the paper's equations (:class:`.quantities.Motion`)."""

    system: PaperSystem
    held: HeldMotion

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """When each stop opened [s]."""
        return {**self.held.release_times, ARM_STOP: None}

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        q, u = np.split(self.held.state(t), 2)
        return q, u

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        active = self.held.active(t)
        torques = self.system.torques(self.held.state(t), active)
        return dict.fromkeys(self.release_times, 0.0) | dict(zip(active, torques.tolist(), strict=True))

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration by Eq. (4) or (10), each (2,)."""
        rates = self.system.rates(self.held.state(t), self.held.active(t))
        return self._point(name, self.held.state(t), rates[len(rates) // 2 :])

    def energy(self, t: float) -> float:
        """T + U, Eqs. (2), (3), (8) [J], summed over the three masses."""
        p, y = self.system.parameters, self.held.state(t)
        none, speeds = np.zeros(len(y) // 2), y[len(y) // 2 :]
        total = p.m_a * (p.l1 + p.l2) ** 2 / 24 * speeds[0] ** 2  # (9), half of it
        for name, mass in ((PROJECTILE, p.m_b), (COUNTERWEIGHT, p.m_cw), ("arm centre", p.m_a)):
            position, velocity, _ = self._point(name, y, none)
            total += mass * (velocity @ velocity / 2 + p.g * position[1])
        return float(total)

    @property
    def launch(self) -> Launch | None:
        """Velocity of the projectile at 45 degrees, after its rest has opened."""
        return self._launch

    @cached_property
    def _launch(self) -> Launch | None:
        none = np.zeros(len(self.system.start) // 2)

        def velocity(y: FloatArray) -> FloatArray:
            return self._point(PROJECTILE, y, none)[1]

        def across(y: FloatArray) -> float:
            vx, vy = velocity(y)
            return float(vy * np.cos(LAUNCH_ANGLE) - vx * np.sin(LAUNCH_ANGLE))

        after = self.release_times[SLING_REST] or 0.0
        time = self.held.first_fall(across, lambda y: velocity(y).sum() > 0, after)
        if time is None:
            return None
        vx, vy = velocity(self.held.state(time)).tolist()
        return Launch(time, float(np.hypot(vx, vy)), (vx, vy))

    def _point(self, name: str, y: FloatArray, a: FloatArray) -> PointState:
        """Eq. (4), (10): a length along the arm, and one along sling or hanger, differentiated twice."""
        p, (q, u) = self.system.parameters, np.split(y, 2)
        lengths = {
            PROJECTILE: (p.l1, p.r, 0.0),
            COUNTERWEIGHT: (-p.l2, 0.0, p.h),
            "arm centre": ((p.l1 - p.l2) / 2, 0.0, 0.0),
        }[name]
        position, velocity, acceleration = np.zeros(2), np.zeros(2), np.zeros(2)
        if self.system.equations.rolling:
            position[0], velocity[0], acceleration[0] = q[3], u[3], a[3]
        for i, length in enumerate(lengths):
            along = length * np.array([np.cos(q[i]), -np.sin(q[i])])
            across = length * np.array([-np.sin(q[i]), -np.cos(q[i])])
            position += along
            velocity += u[i] * across
            acceleration += a[i] * across - u[i] ** 2 * along
        return position, velocity, acceleration


def solve_paper(parameters: TrebuchetParameters, rolling: bool, duration: float, tolerance: float) -> PaperMotion:
    """Integrate the paper's equations with DOP853, release-once.

    Raises:
        SimulationError: the integrator's step size collapsed.
    """
    system = PaperSystem(parameters, PaperEquations(rolling))
    return PaperMotion(system, march(system, duration, tolerance))
