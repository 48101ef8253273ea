"""Bases of joints, stops and force elements, features that solvers declare, tables of elements.

Bases of stops hold methods only: the order of a class's fields is the order in its JSON.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Protocol, Self, TypeVar

from pydantic import Field, model_validator

from ..errors import UnsupportedProblemError
from ..spec import Name, Spec, Vector, as_complex, number_units

if TYPE_CHECKING:
    from ..arrays import ComplexArray, FloatArray
    from ..functions import (
        AngleFunction,
        LineFunction,
        PointCoefficients,
        PointFunction,
        ScalarFunction,
    )


GROUND = "ground"


_UNIT_TOLERANCE = 1e-12  # by which the square of a direction's length may differ from 1


class Basic(StrEnum):
    """An element that solvers have unless they declare that they lack it; in the plural."""

    SLOT = "slots in the ground"
    LOOP = "loops of joints"
    POINT_MASS = "bodies without inertia about their centre of mass"
    STOP = "stops on angles"
    POINT_STOP = "stops on points"
    REBOUND = "stops with a restitution"


class Feature(StrEnum):
    """An element beside pins, slots in the ground and stops against it; in the plural."""

    FREE_JOINT = "free joints"
    MOVING_SLOT = "slots in moving bodies"
    PRISMATIC = "prismatic joints"
    WELD = "welds"
    MOVING_WALL = "stops against moving bodies"
    SPRING = "springs and dampers between points"
    ROTATIONAL_SPRING = "springs and dampers between angles"
    FORCE = "constant forces"
    TORQUE = "constant torques"
    GRAVITY_DIRECTION = "gravity in another direction than downwards"
    CUBIC_SPRING = "torsion springs with a cubic term"
    ROTOR_INERTIA = "rotor inertias"
    SLIDE_INERTIA = "inertias along slides"
    SLIDE_SPRING = "springs and dampers along slides"
    TRANSLATION = "translation joints"
    RECORDED_TORQUE = "recorded torques"
    RECORDED_FORCE = "recorded forces along slides"
    COUPLER = "couplers of coordinates"


class Geometry(Protocol):
    """Points and angles of bodies as functions of q (:class:`..kinematics.Kinematics`)."""

    def point(self, body: str, point: Vector) -> PointCoefficients:
        """Coefficients of a body's point."""
        ...

    def between(
        self, body: str, point: Vector, other: str, other_point: Vector
    ) -> PointCoefficients:
        """Coefficients of the vector from a point of another body to a body's point."""
        ...

    def angle(self, body: str, other: str = GROUND) -> AngleFunction:
        """A body's angle less that of another one."""
        ...

    def slide(self, coordinate: str) -> AngleFunction:
        """A slide coordinate [m]."""
        ...

    def slide_axis(self, coordinate: str, q: FloatArray) -> ComplexArray:
        """Direction of a slide in the world, x + i y of length 1, shape (...,)."""
        ...

    def component(
        self, direction: complex, of: str, vector: PointCoefficients, constant: float = 0.0
    ) -> PointFunction | LineFunction:
        """A vector's component along a direction of a body's frame, plus a constant [m]."""
        ...

    def vector(self, row: PointCoefficients, q: FloatArray) -> ComplexArray:
        """A point, or the vector between two, x + i y [m]."""
        ...

    def rate(self, row: PointCoefficients, q: FloatArray, u: FloatArray) -> ComplexArray:
        """Its derivative with respect to time [m/s]."""
        ...

    def gradient(
        self, coefficients: ComplexArray, q: FloatArray, rates: ComplexArray
    ) -> ComplexArray:
        """Its derivatives with respect to q, shape (..., n_q)."""
        ...


Direction = Any


"""Direction of a force element: :class:`PointCoefficients` or an :class:`AngleFunction`."""
DIRECTIONS = ("vector", "angle", "point")
"""Kinds of directions, in the order in which forces are summed, which fixes their rounding."""


UNIT_VECTORS = ("axis", "normal", "gravity_direction")
"""Fields that hold a direction of length 1."""


def refuse_other_lengths(what: str, direction: Vector) -> None:
    """Raise ValueError if a direction has not length 1; `what` begins the sentence."""
    if abs(direction[0] ** 2 + direction[1] ** 2 - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"{what} must have length 1")


class BaseJoint(Spec):
    """Base of joints. Directions are complex, x + i y, in the parent's frame."""

    holds_angle: ClassVar[bool] = False
    """Whether the child turns with the parent."""
    name: Name
    parent: Name = Field(description="a body, or 'ground'")
    child: Name
    parent_point: Vector = Field(description="in the parent's frame [m]")
    child_point: Vector = Field(description="in the child's frame [m]")

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it joins."""
        return (self.parent, self.child)

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        """Features that a solver needs for it."""
        return ()

    @property
    def free_directions(self) -> tuple[complex, ...]:
        """Directions in which the child's point slides."""
        return ()

    @property
    def held_directions(self) -> tuple[complex, ...]:
        """Directions in which the child's point is held."""
        return (1.0, 1j)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of its slide coordinates, one a free direction; none where it closes a loop."""
        return ()

    @property
    def turned_by(self) -> float | None:
        """The child's angle less the parent's [rad]; None where it is free."""
        return None


class SlidingJoint(BaseJoint):
    """Base of joints that let a point of the child slide along a straight line of the parent."""

    parent: Name = Field(default=GROUND, description="the body with the line, or 'ground'")
    parent_point: Vector = Field(
        description="a point of the line, where its coordinate is zero [m]"
    )
    axis: Vector = Field(description="direction of the line in the parent's frame, length 1")
    coordinate: Name | None = Field(
        default=None, description="name of its slide coordinate; none where it closes a loop"
    )

    @model_validator(mode="after")
    def _axis_has_length_one(self) -> Self:
        refuse_other_lengths(f"axis of {self.name!r}", self.axis)
        return self

    @property
    def free_directions(self) -> tuple[complex, ...]:
        return (as_complex(self.axis),)

    @property
    def held_directions(self) -> tuple[complex, ...]:
        return (1j * as_complex(self.axis),)

    @property
    def slides(self) -> tuple[str, ...]:
        return () if self.coordinate is None else (self.coordinate,)


class BaseStop(Spec):
    """Base of stops: unilateral constraints gap >= 0 with a force >= 0 that is 0 when open."""

    gap_unit: ClassVar[str]
    speed_unit: ClassVar[str]
    force_unit: ClassVar[str]
    effort: ClassVar[Literal["torque", "force"]]
    """Quantity that it pushes with."""
    position_field: ClassVar[Literal["limit", "offset"]]
    """Name of the field that holds its position."""

    @property
    def position(self) -> float:
        """Its limit [rad] or offset [m]."""
        return getattr(self, self.position_field)

    def component(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> float:
        """The component of a motion along the gap.

        Of angles and places it is gap + position. Where the gap is linear in the motion of the
        bodies, velocities give the gap's speed and accelerations its acceleration. So the gap of
        any stop follows from how bodies turn and points move, in whatever coordinates.

        Args:
            angle: of a body other than the ground, positive clockwise [rad], or its derivative.
            point: of a body and a point in its frame: where it is in the world, x + i y [m], or its
                derivative.
        """
        raise NotImplementedError(type(self).__name__)

    def gap(self, geometry: Geometry) -> ScalarFunction:
        """Its gap as a function of the coordinates [gap_unit]."""
        raise NotImplementedError(type(self).__name__)


class BaseForceElement(Spec):
    """Base of force elements.

    Along its direction g (the gradient of a vector, an angle or a point) an element has an effort f
    and the generalized force f g. Numbers and states may be arrays (:mod:`..stacked`) or carry
    derivatives, so the formulas use array operations only.

    Raises:
        TypeError: a class with a `kind` states no `feature` that solvers need for it, acts along
            none of the three directions, or states a number without a unit, which engines in other
            units could not convert.
    """

    feature: ClassVar[Feature]
    """Feature that a solver needs for it."""
    acts_along: ClassVar[Literal["vector", "angle", "point"]]
    """Kind of its direction, one of :data:`DIRECTIONS`."""
    name: Name
    body: Name

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if "kind" in cls.model_fields and not hasattr(cls, "feature"):
            raise TypeError(f"{cls.__name__} states no feature: solvers could not refuse it")
        if "kind" in cls.model_fields and getattr(cls, "acts_along", None) not in DIRECTIONS:
            raise TypeError(f"{cls.__name__} acts along none of {DIRECTIONS}: no sum would have it")
        for number, unit in number_units(cls).items():
            if not unit:
                raise TypeError(f"{cls.__name__}.{number} states no unit in its description")

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it acts between; 'ground' may be one."""
        return (self.body,)

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        """Features that a solver needs for it."""
        return (self.feature,)

    @property
    def ends(self) -> tuple[tuple[str, Vector], ...]:
        """Bodies and points at the two ends of a spring; none of other elements."""
        return ()

    @property
    def attachments(self) -> tuple[tuple[str, Vector], ...]:
        """Bodies and points that it acts on, in the order of `points`."""
        points = self.points()
        return tuple(zip(self.bodies, (getattr(self, name) for name in points), strict=False))

    @classmethod
    def points(cls) -> tuple[str, ...]:
        """Names of the fields that are points of its bodies, in the order of the bodies."""
        return tuple(name for name in number_units(cls) if name.endswith("point"))

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """Names of the numbers of its law, in the order of the fields: all but its points."""
        return tuple(name for name in number_units(cls) if not name.endswith("point"))

    @property
    def dissipates(self) -> bool:
        """Tell whether it takes energy out of the motion."""
        return False

    @property
    def works(self) -> bool:
        """Tell whether it may change the sum of kinetic and potential energy."""
        return type(self).power is not BaseForceElement.power

    @property
    def instants(self) -> tuple[float, ...]:
        """Times at which its law changes [s]; none of an element whose law is always the same."""
        return ()

    def at(self, t: float) -> Self:
        """The element with the law that acts from a time [s] to its next instant."""
        return self

    @property
    def pushes_along_x(self) -> bool:
        """Tell whether it acts on the mechanism from outside along x."""
        raise NotImplementedError(type(self).__name__)

    def refuse_start(
        self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]
    ) -> None:
        """Raise ValueError if its force is undefined at the start; arguments as in `component`."""

    def refuse_joint(self, joint: BaseJoint) -> None:
        """Raise ValueError if it does not fit the joint of its body in the tree."""

    def direction(self, geometry: Geometry) -> Direction:
        """Vector, angle (or slide) or point that it acts along."""
        raise NotImplementedError(type(self).__name__)

    def generalized(
        self,
        geometry: Geometry,
        direction: Direction,
        q: FloatArray,
        u: FloatArray,
        rates: ComplexArray,
    ) -> FloatArray:
        """Its generalized forces [N m or N], shape (..., n_q)."""
        raise NotImplementedError(type(self).__name__)

    def body_forces(
        self, geometry: Geometry, direction: Direction, q: FloatArray, u: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        """Forces on points of bodies, x + i y in the world [N]; none of a pure torque."""
        return iter(())

    def inertial_forces(
        self, geometry: Geometry, direction: Direction, q: FloatArray, a: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        """Forces on bodies by accelerations (..., n_q), x + i y in the world [N]; none of most."""
        return iter(())

    def potential_energy(
        self, geometry: Geometry, direction: Direction, q: FloatArray
    ) -> FloatArray | float:
        """Energy that it stores [J], shape (...,)."""
        return 0.0

    def mass_matrix(self, geometry: Geometry) -> FloatArray | None:
        """Its part of the mass matrix, the same in every state, shape (..., n_q, n_q); or None."""
        return None

    def stiffness_at(self, geometry: Geometry, q: FloatArray) -> float:
        """Stiffness along its direction in one state, shape (n_q,) [N/m or N m/rad]; 0 of none."""
        return 0.0

    def power(
        self, geometry: Geometry, direction: Direction, q: FloatArray, u: FloatArray
    ) -> FloatArray | float:
        """Power on the mechanism of what is no change of its stored energy [W], shape (...,)."""
        return 0.0


class TwoBodyForceElement(BaseForceElement):
    """A force element between a body and another one, or the ground."""

    relative_to: Name = Field(default=GROUND, description="the other body, or 'ground'")

    @property
    def bodies(self) -> tuple[str, ...]:
        return (self.body, self.relative_to)

    @model_validator(mode="after")
    def _acts_between_two(self) -> Self:
        if self.body == self.relative_to:
            raise ValueError(
                f"{self.name!r} acts between {self.body!r} and itself; two bodies are needed"
            )
        return self


class LinearElement(TwoBodyForceElement):
    """Base of elements along a linear function of the coordinates: a relative angle, or a slide."""

    acts_along: ClassVar[Literal["vector", "angle", "point"]] = "angle"

    @property
    def slide(self) -> str | None:
        """Name of the slide of the body's joint that it acts along; None: the relative angle."""
        return None

    @property
    def pushes_along_x(self) -> bool:
        """Tell whether it acts on the mechanism from outside: whether it slides on the ground."""
        return self.slide is not None and GROUND in self.bodies

    def refuse_joint(self, joint: BaseJoint) -> None:
        if self.slide is None or (self.slide in joint.slides and self.relative_to == joint.parent):
            return
        slides = [f"{name!r} on {joint.parent!r}" for name in joint.slides]
        raise ValueError(
            f"{self.name!r} acts along {self.slide!r} of {self.body!r} on {self.relative_to!r}; "
            f"the joint {joint.name!r} has the slides {', '.join(slides) or 'none'}"
        )

    def direction(self, geometry: Geometry) -> AngleFunction:
        if self.slide is None:
            return geometry.angle(self.body, self.relative_to)
        return geometry.slide(self.slide)

    @property
    def linear_law(self) -> tuple[float, float] | None:
        """Stiffness and damping along its direction, if nothing else changes its effort."""
        return None

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """Torque [N m] or force [N] on the body, the opposite on the other one, shape (...,)."""
        raise NotImplementedError(type(self).__name__)

    def generalized(
        self,
        geometry: Geometry,
        direction: AngleFunction,
        q: FloatArray,
        u: FloatArray,
        rates: ComplexArray,
    ) -> FloatArray:
        return self.effort(direction, q, u)[..., None] * direction.coefficients

    def body_forces(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        return self.along_slide(geometry, q, self.effort(direction, q, u))

    def along_slide(
        self, geometry: Geometry, q: FloatArray, effort: FloatArray
    ) -> Iterator[tuple[str, ComplexArray]]:
        """A force along the slide on the body, the opposite on the other one; none of an angle."""
        if self.slide is not None:
            force = effort * geometry.slide_axis(self.slide, q)
            yield self.body, force
            yield self.relative_to, -force


class TorqueElement(LinearElement):
    """Base of elements with a torque between two bodies; clockwise positive, as angles are."""

    def torque_on_body(self, angle: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """Torque on the body, the opposite of that on the other one [N m], shape (...,)."""
        raise NotImplementedError(type(self).__name__)

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        return self.torque_on_body(along, q, u)


T = TypeVar("T")


CONSUMERS: list[ElementTable[object]] = []


"""Every table that has been made, for the test that holds each against the elements that exist."""


class ElementTable(Generic[T]):
    """Handlers of one consumer by class of element; a class that it does not know is refused.

    A table states for every class of its group either what it does (`handlers`) or why it does not
    (`refused`); `tests/unit/test_elements.py` finds the classes that are in neither.

    >>> from trebucheck.models.elements import FORCE_ELEMENTS, ConstantTorque
    >>> table = ElementTable("a printer", FORCE_ELEMENTS, {ConstantTorque: "torque"}, others="no")
    >>> table[ConstantTorque(name="motor", body="arm", torque=2.0)]
    'torque'

    Args:
        consumer: noun with which the sentence of a refusal begins, such as "MuJoCo's builder".
        group: the classes that it must know: `JOINTS`, `STOPS`, `FORCE_ELEMENTS` or `ELEMENTS`.
        handlers: what it does, by class.
        refused: why it does not, by class, as a part of a sentence.
        others: the reason for which every further class of the group is refused; None: there is
            none, and each class must be in one of the two tables.
    """

    def __init__(
        self,
        consumer: str,
        group: tuple[type, ...],
        handlers: Mapping[type, T],
        refused: Mapping[type, str] | None = None,
        *,
        others: str | None = None,
    ) -> None:
        self.consumer = consumer
        self.group = group
        self.handlers = dict(handlers)
        self.refused = dict(refused or {})
        self.others = others
        CONSUMERS.append(self)  # type: ignore[arg-type]

    def missing(self) -> tuple[type, ...]:
        """Classes of the group that are neither handled nor refused."""
        if self.others is not None:
            return ()
        return tuple(c for c in self.group if c not in self.handlers and c not in self.refused)

    def handles(self, element_class: type) -> bool:
        """Tell whether elements of a class are handled."""
        return element_class in self.handlers

    def __getitem__(self, element: object) -> T:
        """The handler of an element.

        Raises:
            UnsupportedProblemError: the consumer refuses elements of this class or does not know
                them; the sentence names consumer, element and class.
        """
        handler = self.handlers.get(type(element))
        if handler is None:
            reason = self.refused.get(type(element), self.others)
            raise UnsupportedProblemError(refusal(self.consumer, element, reason))
        return handler


def refusal(consumer: str, element: object, reason: str | None) -> str:
    """Sentence that a consumer refuses an element; without a reason it does not know the class."""
    kind = getattr(element, "kind", type(element).__name__)
    name = getattr(element, "name", "?")
    because = "it does not know this element" if reason is None else reason
    return f"{consumer} cannot use {name!r} ({kind}): {because}."
