"""Andrews' squeezing mechanism: seven bodies, three loops, a spring and a motor, for 30 ms.

Published angles count counterclockwise, and some from another body: beta of the crank K1; Theta of
K2 from K1; gamma of K3, the triangle with the spring; delta of K5 and Phi of K4 from K5; epsilon of
K7 and Omega of K6 from K7.

The published end state is late by some 1e-12 s: minimal and redundant coordinates agree with each
other at any tolerance below 1e-11, and with it in the angles to a few parts in 1e10, in their rates
(not taken here) to some 5e-8.
"""

from __future__ import annotations

from pydantic import Field

from ..elements import GROUND, ConstantTorque, SpringDamper
from ..mechanism import Body, Marker, Mechanism
from ..spec import NonNegative, Positive, Real, Vector
from .benchmark import BenchmarkParameters, KnownValue, Quantity, at, coordinate, pin

_END = 0.03  # [s]
_START = {
    "beta": -0.0617138900142764496358948458001,
    "Theta": 0.0,
    "gamma": 0.455279819163070380255912382449,
    "Phi": 0.222668390165885884674473185609,
    "delta": 0.487364979543842550225598953530,
    "Omega": -0.222668390165885884674473185609,
    "epsilon": 1.23054744454982119249735015568,
}
_END_ANGLES = {
    "beta": 15.81077119629904,
    "Theta": -15.75637105984298,
    "gamma": 0.04082224013073101,
    "Phi": -0.5347301163226948,
    "delta": 0.5244099658805304,
    "Omega": 0.5347301163226948,
    "epsilon": 1.048080741042263,
}
_OTHER = {"Theta": "k1", "Phi": "k5", "Omega": "k7"}
_OWN = {
    "beta": "k1",
    "Theta": "k2",
    "gamma": "k3",
    "Phi": "k4",
    "delta": "k5",
    "Omega": "k6",
    "epsilon": "k7",
}
"""Our coordinate of the body that an angle belongs to, and of the one it counts from."""
_DIGITS = 1e-9  # relative


class SqueezerParameters(BenchmarkParameters):
    """Motor and spring of the mechanism; its geometry and masses are the published ones."""

    number = "A03"
    name = "squeezer"
    tags = ("loop", "spring", "motor", "published", "IFToMM")
    text = "Andrews' squeezing mechanism: seven bodies, driven by a motor against a spring"
    source = (
        "W. Schiehlen, Multibody Systems Handbook (1990); "
        "E. Hairer, G. Wanner, Solving ODEs II (1996), Sec. VII.7; "
        "end state: F. Mazzia, C. Magherini, Test Set for IVP Solvers 2.4 (2008); "
        "problem A03 in the IFToMM library"
    )

    torque: Real = Field(
        default=0.033, description="of the motor on the crank, counterclockwise [N m]"
    )
    stiffness: NonNegative = Field(default=4530.0, description="of the spring [N/m]")
    rest_length: Positive = Field(default=0.07785, description="of the spring [m]")

    @property
    def duration(self) -> float:
        return _END

    def mechanism(self) -> Mechanism:
        start = {own: -_START[angle] for angle, own in _OWN.items()}
        for angle, other in _OTHER.items():
            start[_OWN[angle]] += start[other]
        a, b, c, d = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072), (0.02, -0.018)
        spring = SpringDamper(
            name="spring",
            body="K3",
            point=d,
            relative_point=c,
            stiffness=self.stiffness,
            rest_length=self.rest_length,
        )
        return Mechanism(
            name=self.name,
            bodies=_BODIES,
            joints=(
                pin("O", GROUND, "K1", (0, 0)),
                pin("F", "K1", "K2", (0.007, 0)),
                pin("B", GROUND, "K3", b),
                pin("A5", GROUND, "K5", a),
                pin("G", "K5", "K4", (0.04, 0)),
                pin("A7", GROUND, "K7", a),
                pin("H", "K7", "K6", (0, -0.04)),
                pin("E3", "K2", "K3", _E, (0, -0.035)),
                pin("E4", "K2", "K4", _E, (0, -0.02)),
                pin("E6", "K2", "K6", _E, (0.02, 0)),
            ),
            force_elements=(spring, ConstantTorque(name="motor", body="K1", torque=-self.torque)),
            markers=(Marker(name="E", body="K2", point=_E), Marker(name="D", body="K3", point=d)),
            gravity=0,
            start=tuple(start[f"k{i}"] for i in (1, 2, 3, 5, 4, 7, 6)),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        """The published end state; of other parameters nothing is published."""
        if self != SqueezerParameters():
            return ()
        return tuple(
            KnownValue(
                f"{angle} at 0.03 s",
                value,
                "rad",
                _DIGITS * abs(value),
                at(published(angle), _END),
                "published",
            )
            for angle, value in _END_ANGLES.items()
        )


def published(angle: str) -> Quantity:
    """A published angle [rad] from our absolute clockwise angles."""
    own = coordinate(_OWN[angle])
    if angle not in _OTHER:
        return lambda trajectory: -own(trajectory)
    other = coordinate(_OTHER[angle])
    return lambda trajectory: other(trajectory) - own(trajectory)


_E = (-0.028, 0.0)


def _body(number: int, mass: float, inertia: float, centre: Vector) -> Body:
    return Body(name=f"K{number}", angle=f"k{number}", mass=mass, centre=centre, inertia=inertia)


_BODIES = (
    _body(1, 0.04325, 2.194e-6, (0.00092, 0)),
    _body(2, 0.00365, 4.410e-7, (-0.0115, 0)),
    _body(3, 0.02373, 5.255e-6, (0.01043, -0.01874)),
    _body(5, 0.07050, 1.169e-5, (0.02308, 0.00916)),
    _body(4, 0.00706, 5.667e-7, (0, -(0.02 - 0.01421))),
    _body(7, 0.05498, 1.912e-5, (-0.00449, -0.01228)),
    _body(6, 0.00706, 5.667e-7, (0.02 - 0.01421, 0)),
)
