"""Claims that hang on the start angles, which the paper does not print."""

from __future__ import annotations

from ..evidence import made
from ..identification.results import Identification
from ..results import Claim, Quantity
from ..verdicts import Cause, occurs, vanishes


def claims(found: Identification) -> list[Claim]:
    """All of them."""
    fit = found.fit
    worst = Quantity(value=fit.least_worst, unit="half digits")
    cause = Cause(not fit.compatible, f"the best of all starts still misses one by {fit.least_worst:.3g} half digits")
    return [
        made(
            "printed figures are of one start",
            "Secs. IV to VI",
            f"{len(found.printed)} figures",
            "least that the worst miss of all printed figures can be made by the start angles",
            worst,
            occurs(fit.compatible, "start angles that give every printed figure to its digits", [cause]),
            machine="both",
        ),
        _constraint(found),
    ]


def _constraint(found: Identification) -> Claim:
    """G1 and G2 at t = 0 are theta(0): the fit decides whether that can be zero."""
    fit = found.fit
    i = fit.free.index("theta0")
    low, high = fit.confidence[i]
    ours = Quantity(value=fit.angles[0], uncertainty=(high - low) / 2, unit="rad")
    return made(
        "Eqs. (6), (7) hold at the start",
        "Eqs. (6), (7)",
        "G1 = G2 = 0",
        "theta(0), fitted to the printed figures",
        ours,
        vanishes(ours, 0.0, "a constraint that is met"),
        machine="both",
    )
