r"""The fixed machine with both rests held: one rigid body about its fulcrum, in closed form.

Turned by d from its start the body's points are z e^{-i d}. With S the first moment and I the
inertia about the fulcrum, gravity gives

    I d'' = g Re(S e^{-i d}),        I d'^2 / 2 = g (Im S - Im(S e^{-i d}))        from rest,

so that the torque of a rest, which is affine in d'', d'^2 and the weight, is a + Re(w e^{-i d}): a
function of the angle alone. From rest the motion is a pendulum's, in Jacobi's elliptic functions
(Whittaker, Analytical Dynamics, Art. 44).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Field
from scipy.special import ellipj, ellipk, ellipkinc
from trebucheck.api.mechanics import (
    FloatArray,
    Kinematics,
    Mechanism,
    Real,
    Spec,
    TrebuchetParameters,
    fixed,
)

_ROUNDING = 256 * float(np.finfo(np.float64).eps)


class Swing(Spec):
    """Swing of the machine with both rests held on both sides: one rigid body on the fulcrum."""

    l1: Real = Field(description="[m]")
    largest_angle: Real = Field(description="of theta [rad]")
    period: Real = Field(description="of its swing [s]")
    largest_torque: Real = Field(description="of the hanger's rest, over the whole swing [N m]")
    zeros: tuple[Real, ...] = Field(
        description="of that torque, within one period [s]; empty: it never comes to zero"
    )


@dataclass(frozen=True)
class RigidSwing:
    """The fixed machine of some parameters, its rests held whichever way they would have to act."""

    parameters: TrebuchetParameters

    @cached_property
    def mechanism(self) -> Mechanism:
        """The machine."""
        return fixed(self.parameters)

    @cached_property
    def _centres(self) -> list[complex]:
        q, kinematics = np.array(self.mechanism.start), Kinematics(self.mechanism)
        rows = [kinematics.point(body.name, body.centre) for body in self.mechanism.bodies]
        return [complex(*kinematics.position(row, q)) for row in rows]

    @cached_property
    def moment(self) -> complex:
        """S, sum of mass times place at the start [kg m]."""
        return sum(
            body.mass * z for body, z in zip(self.mechanism.bodies, self._centres, strict=True)
        )

    @cached_property
    def inertia(self) -> float:
        """I, about the fulcrum [kg m^2]."""
        bodies = zip(self.mechanism.bodies, self._centres, strict=True)
        return sum(body.inertia + body.mass * abs(z) ** 2 for body, z in bodies)

    @property
    def torque(self) -> float:
        """Torque of gravity about the fulcrum at the start [N m]; positive throws (clockwise)."""
        return self.parameters.g * self.moment.real

    @property
    def acceleration(self) -> float:
        """Acceleration of theta at the start [rad/s^2]."""
        return self.torque / self.inertia

    def point_acceleration(self, body: str) -> tuple[float, float]:
        """Acceleration of a body's centre at the start, x and y [m/s^2]."""
        z = self._centres[[b.name for b in self.mechanism.bodies].index(body)]
        acceleration = -1j * self.acceleration * z
        return acceleration.real, acceleration.imag

    def rest_torque(self, stop: str) -> tuple[float, complex]:
        """Terms a and w of a rest's torque a + Re(w e^{-i d}) [N m]; its body carries none."""
        rest, g = (
            next(each for each in self.mechanism.angle_stops if each.name == stop),
            self.parameters.g,
        )
        index = [body.name for body in self.mechanism.bodies].index(rest.body)
        body, z = self.mechanism.bodies[index], self._centres[index]
        # d z / d angle of the body alone, its own pin at rest; Newton's law along it: sense *
        # torque = m Re(conj(along) (z'' + i g)) + inertia * d'', with z'' = (-i d'' - d'^2) z.
        along = -1j * complex(*body.centre) * cmath.exp(-1j * self.mechanism.start[index])
        product = along.conjugate() * z
        tangential = body.mass * product.imag + body.inertia
        radial = 2 * body.mass * product.real
        pull = g / self.inertia
        constant = -radial * pull * self.moment.imag
        wave = (
            tangential * pull * self.moment
            - 1j * radial * pull * self.moment
            - 1j * body.mass * g * along
        )
        return rest.sense * constant, rest.sense * wave

    def start_torque(self, stop: str) -> float:
        """Torque of a rest at the start [N m]."""
        constant, wave = self.rest_torque(stop)
        return constant + wave.real

    @property
    def amplitude(self) -> float:
        """Angle between the start and the lowest place, by which it swings to either side [rad]."""
        return abs(math.remainder(cmath.phase(self.moment) + math.pi / 2, 2 * math.pi))

    @property
    def period(self) -> float:
        """Period of the swing [s]."""
        return float(4 * ellipk(math.sin(self.amplitude / 2) ** 2) / self.frequency)

    @property
    def frequency(self) -> float:
        """Circular frequency of small swings [rad/s]."""
        return math.sqrt(self.parameters.g * abs(self.moment) / self.inertia)

    @property
    def sense(self) -> float:
        """+1 where gravity turns it clockwise at first."""
        return math.copysign(
            1.0, math.remainder(cmath.phase(self.moment) + math.pi / 2, 2 * math.pi)
        )

    def turned(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """D [rad] and its rate [rad/s] at times t [s], also before the start."""
        angle, rate = pendulum(np.array(self.amplitude), np.array(self.frequency), t)
        return self.sense * angle, self.sense * rate

    def largest_torque(self, stop: str) -> float:
        """Largest torque of a rest over the swing [N m]: at an end, or with e^{-i d} along w."""
        constant, wave = self.rest_torque(stop)
        end = 2 * self.sense * self.amplitude
        best = cmath.phase(wave)
        turns = (best + 2 * math.pi * n for n in range(-2, 3))
        angles = [0.0, end, *(angle for angle in turns if min(0.0, end) <= angle <= max(0.0, end))]
        return max(constant + (wave * cmath.exp(-1j * angle)).real for angle in angles)

    def zeros(self, stop: str) -> tuple[float, ...]:
        """Times within one period at which a rest's torque is zero [s]."""
        constant, wave = self.rest_torque(stop)
        if abs(constant) > abs(wave):
            return ()
        # Re(w e^{-i d}) = -a at d = arg w +- acos(-a/|w|).
        offset = math.acos(-constant / abs(wave))
        end = 2 * self.sense * self.amplitude
        angles = {
            cmath.phase(wave) + sign * offset + 2 * math.pi * n
            for sign in (1, -1)
            for n in range(-2, 3)
        }
        within = [angle for angle in angles if min(0.0, end) <= angle <= max(0.0, end)]
        first = [self._time_of(angle) for angle in within]
        return tuple(sorted([*first, *(self.period - t for t in first)]))

    def _time_of(self, angle: float) -> float:
        """Time when it has first turned by an angle [s]: the inverse of :meth:`turned`."""
        k = math.sin(self.amplitude / 2)
        from_lowest = self.amplitude - self.sense * angle
        # cd(u) = sin(psi / 2) / k, and cd(u) = sn(K - u).
        ratio = min(1.0, max(-1.0, math.sin(from_lowest / 2) / k))
        return float((ellipk(k * k) - ellipkinc(math.asin(ratio), k * k)) / self.frequency)


def pendulum(
    amplitude: FloatArray, frequency: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angle from the start [rad] and its rate [rad/s] of pendulums let go at rest, one shape.

    Args:
        amplitude: from the start to the lowest place [rad].
        frequency: circular, of small swings [rad/s].
        t: times [s].
    """
    k = np.sin(amplitude / 2)
    sn, cn, dn, _ = ellipj(frequency * t, k * k)
    sine = k * cn / dn  # of half the angle from the lowest place
    rate = 2 * k * frequency * (1 - k * k) * sn / dn**2 / np.sqrt(1 - sine**2)
    return amplitude - 2 * np.arcsin(sine), rate


def hanger_torque_on_beam(parameters: TrebuchetParameters, beam: float) -> Polynomial:
    """Initial hanger-rest torque times the fulcrum inertia, both rests held, against l1.

    From the paper's Eqs. (1)-(7), from rest, with t = theta(0), a = alpha(0), l2 = beam - l1, and T
    and I of :func:`gravity_and_inertia`:

        torque * I = m_cw h [g cos a I - T (h - l2 cos(t - a))],

    of degree two in l1 at most (one, where t = 0), so that its zero is a closed form.
    """
    p = parameters
    torque, inertia = gravity_and_inertia(p, beam)
    imposed = p.h - math.cos(p.theta0 - p.alpha0) * Polynomial([beam, -1.0])
    product = p.m_cw * p.h * (p.g * math.cos(p.alpha0) * inertia - torque * imposed)
    # Terms that cancel but for rounding would bring a zero of their own, far outside.
    sizes = np.abs(product.coef) * beam ** np.arange(len(product.coef))
    return Polynomial(np.where(sizes > _ROUNDING * sizes.max(), product.coef, 0.0)).trim()


def gravity_and_inertia(
    parameters: TrebuchetParameters, beam: float
) -> tuple[Polynomial, Polynomial]:
    """Gravity torque [N m] and inertia [kg m^2] about the fulcrum at the start, of l1: exact.

    T = g [m_a (l1 - l2)/2 cos t + m_b (l1 cos t + r cos p) + m_cw (h cos a - l2 cos t)],   p =
    phi(0) I = m_a (l1^3 + l2^3) / (3 beam) + m_b |sling's end|^2 + m_cw |hanger's end|^2
    """
    p = parameters
    l1, l2 = Polynomial([0.0, 1.0]), Polynomial([beam, -1.0])
    torque = p.g * (
        p.m_a * math.cos(p.theta0) / 2 * (l1 - l2)
        + p.m_b * (math.cos(p.theta0) * l1 + p.r * math.cos(p.phi0))
        + p.m_cw * (p.h * math.cos(p.alpha0) - math.cos(p.theta0) * l2)
    )
    inertia = (
        p.m_a / 3 * (l1**2 - l1 * l2 + l2**2)  # l1^3 + l2^3 = beam (l1^2 - l1 l2 + l2^2)
        + p.m_b * (l1**2 + 2 * p.r * math.cos(p.theta0 - p.phi0) * l1 + p.r**2)
        + p.m_cw * (l2**2 - 2 * p.h * math.cos(p.theta0 - p.alpha0) * l2 + p.h**2)
    )
    return torque, inertia


def zeros_within(polynomial: Polynomial, low: float, high: float) -> list[float]:
    """Real zeros between two values."""
    roots = polynomial.roots()
    real = roots.real[np.abs(roots.imag) <= _ROUNDING * np.abs(roots)]
    return sorted(float(root) for root in real if low <= root <= high)


def on_beam(parameters: TrebuchetParameters, beam: float, l1: float) -> TrebuchetParameters:
    """The same machine with its fulcrum elsewhere on the beam.

    Raises:
        InputError: l1 is not between 0 and the beam's length.
    """
    others = parameters.model_dump(exclude={"l1", "l2"})
    return TrebuchetParameters.with_beam(l1, beam, **others)
