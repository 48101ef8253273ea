"""Models of springs, dampers and gravity."""

from __future__ import annotations

from trebucheck.api.mechanics import GROUND, ConstantForce, RotationalSpringDamper, SpringDamper

from .joints import chain
from .model import ZooModel
from .parts import ALONG_X, GRAVITY, block, of, rod

_PIVOT = (of("pivot", a=1),)


def _hinge_spring(
    name: str,
    on: str = "rod",
    to: str = GROUND,
    stiffness: float = 0.0,
    damping: float = 0.0,
    rest: float = 0.0,
) -> RotationalSpringDamper:
    return RotationalSpringDamper(
        name=name, body=on, relative_to=to, stiffness=stiffness, damping=damping, rest_angle=rest
    )


def force_models() -> tuple[ZooModel, ...]:
    """Models of stiffness, damping, tendons, gravity and its compensation, default classes."""
    tendon = SpringDamper(
        name="spring",
        body="rod",
        point=(0.6, 0.02),
        relative_to=GROUND,
        relative_point=(0.5, 0.8),
        stiffness=60.0,
        damping=0.8,
        rest_length=0.5,
    )
    along = SpringDamper(
        name="spring",
        body="block",
        point=(0, 0),
        relative_to=GROUND,
        relative_point=(0, -2.0),
        stiffness=150.0,
        damping=0.0,
        rest_length=2.2,
    )
    carried = ConstantForce(
        name="carried", body="rod", point=ALONG_X, force=(0.0, 0.5 * 2.0 * GRAVITY)
    )
    dampers = (
        _hinge_spring("slow", "upper", damping=0.1),
        _hinge_spring("slower", "lower", "upper", damping=0.3),
    )
    spring = rod("spring", start=-0.3, forces=(_hinge_spring("spring", stiffness=12.0, rest=0.4),))
    classes = chain("defaults", 0.9, -0.5, forces=dampers)
    return (
        ZooModel("spring", "stiffness and springref of a hinge", spring, _PIVOT),
        ZooModel(
            "slide-spring",
            "the same of a slide",
            block("slide-spring", start=0.3, forces=(along,)),
            (of("rail", s=1),),
        ),
        ZooModel(
            "damper",
            "damping",
            rod("damper", forces=(_hinge_spring("damper", damping=0.7),)),
            _PIVOT,
        ),
        ZooModel(
            "spatial-spring",
            "a tendon between sites",
            rod("spatial-spring", forces=(tendon,)),
            _PIVOT,
        ),
        ZooModel("gravcomp", "gravity compensation", rod("gravcomp", forces=(carried,)), _PIVOT),
        ZooModel(
            "gravity", "oblique gravity", rod("gravity", gravity_direction=(0.6, -0.8)), _PIVOT
        ),
        ZooModel(
            "defaults",
            "nested default classes",
            classes,
            (of("shoulder", a=1), of("elbow", b=1, a=-1)),
        ),
    )
