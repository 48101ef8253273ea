"""Which problems an engine is tried on, and which checks each of them has."""

from __future__ import annotations

from ..comparisons.runs.balance import keeps_horizontal_momentum
from ..comparisons.runs.comparison import THROWN
from ..comparisons.runs.quantities import JUDGED
from ..engines.protocol import Capabilities
from ..models.errors import InputError
from ..models.features import missing_elements
from ..models.machines.registry import library_problem, model, models
from ..models.mechanism import Mechanism
from ..models.problem import StopLaw
from ..models.problems.registry import benchmarks

QUICK = ("catapult", "double-pendulum", "fixed", "stopped-pendulum")
STANDARD = (
    *QUICK, "pendulum", "rolling", "hinged", "floating-arm", "hanging-chain", "slider-crank", "bouncing", "bead",
    "incline", "welded-rods", "oscillator", "motor", "falling-rod", "thrown-plate", "spring-pendulum", "quick-return",
)  # fmt: skip
"""From the simplest on, so that what is wrong everywhere is found first and at little cost; every feature is in one."""
TIERS = ("quick", "standard", "full")


def problems_of(tier: str) -> tuple[str, ...]:
    """Names of the problems of a tier, in the order in which they are tried.

    Raises:
        InputError: there is no such tier.
    """
    if tier not in TIERS:
        raise InputError(f"tier = {tier!r} is unknown; there are: {', '.join(TIERS)}.")
    if tier == "full":
        return (
            *STANDARD,
            *(
                name
                for name in (*models(), *(b.name for b in benchmarks()))
                if name not in STANDARD
            ),
        )
    return QUICK if tier == "quick" else STANDARD


def given(name: str) -> tuple[Mechanism, StopLaw]:
    """The mechanism of a named machine or problem, and the law of its stops.

    Raises:
        InputError: nothing has that name; the sentence lists the names there are.
    """
    problem = library_problem(name)
    return (
        (model(name), StopLaw.RELEASE_ONCE)
        if problem is None
        else (problem.mechanism, problem.stop_law)
    )


def missing(mechanism: Mechanism, law: StopLaw, capabilities: Capabilities) -> tuple[str, ...]:
    """Names of what a problem needs and an engine does not declare."""
    names = missing_elements(
        mechanism, capabilities.features, capabilities.lacking, law, capabilities.elements
    )
    followed = not mechanism.stops or law in capabilities.stop_laws
    return (*names, *([] if followed else [f"{law.value} law of the stops"]))


def check_name(metric: str) -> str:
    """Of the check that judges a metric: 'release-time' of release_time, 'position' of position_max."""
    return metric.removesuffix("_max").replace("_", "-")


def quantities(mechanism: Mechanism, law: StopLaw, capabilities: Capabilities) -> tuple[str, ...]:
    """Metrics that a run of a problem may have, of those that are judged."""
    names = (q.name for q in JUDGED.values() if not q.of or q.subjects(mechanism))
    unilateral = law is StopLaw.UNILATERAL
    left_out = {
        "launch_time": mechanism.marker(THROWN) is None,
        "launch_speed": mechanism.marker(THROWN) is None,
        "impact_time": not unilateral,
        "stop_penetration": not unilateral,
        "impact_impulse": True,  # of files only, as the next
        "impact_speed": True,
        "horizontal_momentum": not keeps_horizontal_momentum(mechanism),
        "joint_gap_max": not capabilities.joint_gaps,
        "base_error": True,  # of motions beyond their horizon only; then it is judged with the run
    }
    return tuple(name for name in names if not left_out.get(name, False))
