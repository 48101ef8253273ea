"""Random planar models as MJCF: bodies, joints and all that the reader reads, in any plane."""

from __future__ import annotations

import numpy as np
from trebucheck.models.arrays import FloatArray

_ACROSS = np.array([0.0, 1.0, 0.0])


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)


class RandomModel:
    """A model of 1 to 8 bodies; two of the same seed are the same.

    Args:
        seed: of its numbers.
        plane: "xz", "xy", "yz" or "any".
        loop: whether two bodies are connected.
        coupled: whether joints follow others.
    """

    def __init__(
        self, seed: int, plane: str = "any", loop: bool = False, *, coupled: bool = False
    ) -> None:
        self.random, self.loop, self.coupled = np.random.default_rng(seed), loop, coupled
        self.turn = self._plane(plane)
        self.joints: list[tuple[str, str]] = []
        self.bodies: list[str] = []
        self.qpos: list[float] = []
        self.n = 0

    def _plane(self, plane: str) -> FloatArray:
        """The rotation (3, 3) that takes MuJoCo's x, y, z to the plane's x, its normal, its y."""
        if plane == "xz":
            return np.eye(3)
        if plane == "xy":
            return np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]).T
        if plane == "yz":
            return np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]]).T
        matrix, _ = np.linalg.qr(self.random.normal(size=(3, 3)))
        return np.asarray(matrix * np.sign(np.linalg.det(matrix)))

    def _number(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def _some(self, share: float = 0.5) -> bool:
        return bool(self.random.uniform() < share)

    def _in_plane(self, size: float) -> str:
        x, z = self.random.uniform(-size, size, 2)
        off = self._number(-0.2, 0.2)  # along the normal, which changes nothing
        return _text(*(self.turn @ np.array([x, off, z])))

    def text(self, n_bodies: int | None = None) -> str:
        """The file."""
        n_bodies = n_bodies or int(self.random.integers(1, 9))
        world, left = "", n_bodies
        while left:
            size = int(self.random.integers(1, left + 1))
            world += self._body(size, in_world=True)
            left -= size
        gravity = _text(*(self.turn @ self.random.uniform(-10, 10, 3)))
        return (
            f'<mujoco model="random"><compiler autolimits="true" angle="radian"/>'
            f'<option gravity="{gravity}"/><worldbody>'
            f'<site name="post" pos="{self._in_plane(1.0)}"/>{world}</worldbody>'
            f"{self._tendons()}{self._actuators()}{self._equalities()}</mujoco>"
        )

    def _body(self, n: int, in_world: bool = False) -> str:
        self.n += 1
        name = f"body{self.n}"
        self.bodies.append(name)
        kinds = [("hinge",), ("slide",), ("slide", "hinge")]
        if in_world:
            kinds += [("slide", "slide", "hinge"), ("slide", "slide")]
        chosen = kinds[int(self.random.integers(len(kinds)))]
        angle = self._number(-3, 3)
        # Two slides in the world are along its x and y here, as springs on them need it.
        free = chosen[:2] == ("slide", "slide")
        joints, first = "", 0.0 if free else self._number(0, 2 * np.pi)
        for k, kind in enumerate(chosen):
            joints += self._joint(kind, angle, first + k * np.pi / 2)
        inside = ""
        if self._some(0.3):  # a body without joints
            inside += (
                f'<body pos="{self._in_plane(0.5)}" euler="0 0 0">{self._inertial()}'
                f'<site name="on{self.n}" pos="{self._in_plane(0.3)}"/></body>'
            )
        left = n - 1
        while left:
            size = int(self.random.integers(1, left + 1))
            inside += self._body(size)
            left -= size
        normal = self.turn @ _ACROSS
        quaternion = _text(np.cos(angle / 2), *(np.sin(angle / 2) * normal))
        return (
            f'<body name="{name}" pos="{self._in_plane(1.0)}"'
            + (f' quat="{quaternion}"' if in_world and not free else "")
            + f">{self._inertial()}{joints}"
            f'<site name="{name} tip" pos="{self._in_plane(0.5)}"/>{inside}</body>'
        )

    def _inertial(self) -> str:
        moments = np.sort(self.random.uniform(0.02, 0.4, 3))
        moments[2] = min(moments[2], 0.95 * (moments[0] + moments[1]))
        quaternion = self.random.normal(size=4)
        return (
            f'<inertial pos="{self._in_plane(0.4)}" mass="{self._number(0.2, 3)!r}" '
            f'diaginertia="{_text(*moments)}" quat="{_text(*quaternion)}"/>'
        )

    def _joint(self, kind: str, turned: float, along: float) -> str:
        name = f"joint{len(self.joints)}"
        self.joints.append((name, kind))
        sense = 1.0 if self._some() else -1.0
        if kind == "hinge":
            axis, place = sense * (self.turn @ _ACROSS), f' pos="{self._in_plane(0.3)}"'
        else:
            axis = sense * (self.turn @ np.array([np.cos(along), 0.0, np.sin(along)]))
            place = ""
        text = f'<joint name="{name}" type="{kind}" axis="{_text(*axis)}"{place}'
        ref = self._number(-0.5, 0.5) if self._some(0.3) else 0.0
        if ref:
            text += f' ref="{ref!r}"'
        if self._some():
            text += f' damping="{self._number(0.05, 1)!r}"'
        if self._some(0.4):
            text += f' stiffness="{self._number(0.5, 9)!r}"'
            text += f' springref="{self._number(-0.4, 0.4)!r}"'
        if self._some(0.4):
            text += f' armature="{self._number(0.01, 0.5)!r}"'
        if self._some(0.3):
            text += f' range="{_text(ref - self._number(0.2, 2), ref + self._number(0.2, 2))}"'
        return text + "/>"

    def _tendons(self) -> str:
        if len(self.joints) < 2 or not self._some(0.3):
            self.tendon = False
            return ""
        self.tendon = True
        parts = "".join(
            f'<joint joint="{name}" coef="{self._number(-2, 2)!r}"/>' for name, _ in self.joints[:2]
        )
        return f'<tendon><fixed name="rope">{parts}</fixed></tendon>'

    def _actuators(self) -> str:
        texts: list[str] = []
        for name, _ in self.joints:
            if not self._some():
                continue
            gear = f'joint="{name}" gear="{self._number(-3, 3)!r}"'
            which = int(self.random.integers(4))
            if which == 0:
                texts.append(f"<motor {gear}/>")
            elif which == 1:
                texts.append(f'<position {gear} kp="{self._number(1, 9)!r}"/>')
            elif which == 2:
                texts.append(f'<velocity {gear} kv="{self._number(0.1, 2)!r}"/>')
            else:
                texts.append(f'<motor {gear} ctrlrange="-0.4 0.4"/>')
        if self.tendon:
            texts.append(f'<motor tendon="rope" gear="{self._number(1, 3)!r}"/>')
        self.n_actuators = len(texts)
        return f"<actuator>{''.join(texts)}</actuator>" if texts else ""

    def _equalities(self) -> str:
        texts = self._loops() + self._couplings()
        return f"<equality>{''.join(texts)}</equality>" if texts else ""

    def _loops(self) -> list[str]:
        if not self.loop or len(self.bodies) < 2:
            return []
        one, other = self.random.choice(self.bodies, 2, replace=False)
        if self._some():
            return [f'<connect body1="{one}" body2="{other}" anchor="{self._in_plane(0.4)}"/>']
        return [f'<weld body1="{one}" body2="{other}"/>']

    def _couplings(self) -> list[str]:
        """Equalities of joints and of a tendon, which hold at the start."""
        if not self.coupled or len(self.joints) < 3:
            return []
        names = [name for name, _ in self.joints]
        one, other = self.random.choice(names[2:], 1)[0], self.random.choice(names[:2], 1)[0]
        texts = [
            f'<joint joint1="{one}" joint2="{other}" polycoef="0 {self._number(-2, 2)!r} 0 0 0"/>'
        ]
        if self.tendon:
            texts.append('<tendon tendon1="rope"/>')
        return texts

    def controls(self) -> list[float]:
        """Random controls."""
        return [self._number(-1, 1) for _ in range(self.n_actuators)]
