"""The paper's parameters, Table I as defaults."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field

from ..errors import InputError
from ..spec import Positive, Real, Spec

Angle = Annotated[Real, Field(ge=-4 * math.pi, le=4 * math.pi)]
"""[rad] up to two turns either way: more are degrees more often than not."""


class TrebuchetParameters(Spec):
    """Lengths [m], masses [kg], gravity [m/s^2] and start angles [rad] of the whipper trebuchet.

    Defaults are Table I of the paper. Angles are absolute, from +x, positive clockwise. The paper
    does not print its start angles; (0, pi, -pi/4) is what its headline figures single out. Angles
    beyond two turns (4 pi) are refused: they are degrees more often than not.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or an angle is not in
            range.
    """

    l1: Positive = Field(default=10.0, description="arm, fulcrum to sling pin [m]")
    l2: Positive = Field(default=4.0, description="arm, fulcrum to hanger pin [m]")
    m_b: Positive = Field(default=60.0, description="projectile ('barrel') [kg]")
    m_cw: Positive = Field(default=3000.0, description="counterweight [kg]")
    m_a: Positive = Field(default=1000.0, description="throwing arm, a uniform rod [kg]")
    h: Positive = Field(default=10.0, description="hanger ('counterweight arm') length [m]")
    r: Positive = Field(default=6.0, description="sling length [m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    theta0: Angle = Field(default=0.0, description="start angle of the throwing arm [rad]")
    phi0: Angle = Field(default=math.pi, description="start angle of the sling [rad]")
    alpha0: Angle = Field(default=-math.pi / 4, description="start angle of the hanger [rad]")

    @classmethod
    def with_beam(cls, l1: float, beam: float = 14.0, **others: float) -> Self:
        """Parameters on a beam of fixed length, as the paper's fulcrum sweep has it: l2 = beam - l1.

        Args:
            l1: arm from the fulcrum to the sling pin [m].
            beam: whole length of the arm, l1 + l2 [m].
            others: any other parameter but l2.

        Raises:
            InputError: l1 is not shorter than the beam, or a value is not valid.
        """
        return cls(l1=l1, l2=short_end(l1, beam), **others)


def short_end(l1: float, beam: float) -> float:
    """The arm's other side on a beam of fixed length, l2 = beam - l1 [m].

    Raises:
        InputError: l1 is not shorter than the beam.
    """
    if not l1 < beam:
        raise InputError(
            f"l1 = {l1!r} must be shorter than the beam of {beam!r} m, so that l2 = beam - l1 > 0."
        )
    return beam - l1
