"""MJCF written from a mechanism.

The committed files, exact floats, stops as limits, nothing half-written.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from mechanisms import chain, everything
from trebucheck.models.elements import GROUND, PinJoint, PointStop, SlotJoint, Stop
from trebucheck.models.errors import InputError, UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import model, models
from trebucheck.models.library.trebuchet import TrebuchetParameters, fixed, rolling
from trebucheck.models.mechanism import Body, Marker, Mechanism
from trebucheck.models.mjcf import writer as mjcf_writer
from trebucheck.models.mjcf.scene import SCENE_FILE, scene, stored_motion
from trebucheck.models.mjcf.writer import FAR, mjcf, mjcf_names, write_model_folder

MACHINES = {"fixed": fixed, "rolling": rolling}
machines = pytest.mark.parametrize("name", MACHINES)
every_model = pytest.mark.parametrize("name", models())


def committed(name: str) -> Path:
    return Path(str(files("trebucheck.models"))) / "mjcf" / name


def chain_of(stops: tuple[Stop | PointStop, ...], **changes: object) -> Mechanism:
    """The chain, at rest at 0.3 and 0.5 rad."""
    return chain(*stops, hook=(0.1, 0), **({"start": (0.3, 0.5), "start_speeds": ()} | changes))


def parsed(mechanism: Mechanism) -> ET.Element:
    return ET.fromstring(mjcf(mechanism))


def limit_of(root: ET.Element, tag: str, name: str) -> tuple[float, float]:
    found = next(element for element in root.iter(tag) if element.get("name") == name)
    low, high = (float(word) for word in found.attrib["range"].split())
    return low, high


@every_model
def test_the_committed_files_are_what_the_writer_writes(name: str, tmp_path: Path) -> None:
    written = list(write_model_folder(model(name), tmp_path, motion=stored_motion(model(name))))
    assert len(written) > 1
    for path in written:
        assert path.read_bytes() == (committed(name) / path.name).read_bytes()


@every_model
def test_a_folder_is_complete(name: str) -> None:
    present = {path.name for path in committed(name).iterdir()}
    assert {"README.md", "LICENSE", "CHANGELOG.md", f"{name}.xml", SCENE_FILE} <= present
    assert (committed(name) / "LICENSE").read_text().startswith("MIT License")
    assert (committed(name) / f"{name}.png").stat().st_size < 100_000


def test_floats_read_back_to_the_same_bits() -> None:
    p = TrebuchetParameters(
        l1=9.1 + 1 / 3, m_b=math.pi * 20, r=math.sqrt(30), theta0=0.1, alpha0=-0.7
    )
    numbers = {
        float(word)
        for e in parsed(fixed(p)).iter()
        for v in e.attrib.values()
        for word in v.split()
        if _real(word)
    }
    assert {
        p.l1,
        -p.l2,
        p.m_b,
        p.r,
        p.h,
        p.theta0,
        p.phi0 - p.theta0,
        p.alpha0 - p.theta0,
        -p.g,
    } <= numbers


def _real(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


@machines
def test_a_closed_stop_starts_exactly_at_its_limit(name: str) -> None:
    # 0.1 + 0.2 style angles: the differences of the angles are rounded, the limits must not be.
    root = parsed(MACHINES[name](TrebuchetParameters(theta0=0.1, phi0=math.pi + 0.3, alpha0=-0.7)))
    assert limit_of(root, "joint", "hanger_pin") == (-FAR, 0.0)
    assert limit_of(root, "joint", "sling_pin") == (0.0, FAR)
    assert limit_of(root, "joint", "fulcrum") == (-FAR, 3 * math.pi / 2 - 0.1)


def test_two_stops_share_the_two_ends_of_a_joint() -> None:
    low = Stop(name="low", body="lower", relative_to="upper", sense=1, limit=0.5 - 0.3, closed=True)
    high = Stop(name="high", body="lower", relative_to="upper", sense=-1, limit=-1.2, closed=False)
    root = parsed(chain_of((low, high)))
    assert limit_of(root, "joint", "pin") == (0.0, pytest.approx(1.0, abs=1e-15))
    assert root.find("tendon") is None


def test_stops_that_no_joint_can_hold_become_tendons() -> None:
    on_ground = Stop(name="level", body="lower", sense=1, limit=0.4, closed=False)
    first = Stop(name="first", body="upper", sense=1, limit=0.3, closed=True)
    second = Stop(name="second", body="upper", sense=1, limit=0.2, closed=False)
    clamp = Stop(name="clamp", body="upper", sense=-1, limit=-0.3, closed=True)
    root = parsed(chain_of((on_ground, first, second, clamp)))
    assert {e.get("name") for e in root.iter("fixed")} == {"level", "second", "clamp"}
    assert limit_of(root, "fixed", "level") == (pytest.approx(-0.1, abs=1e-15), FAR)
    level = next(e for e in root.iter("fixed") if e.get("name") == "level")
    assert {(e.get("joint"), e.get("coef")) for e in level} == {("hook", "1"), ("pin", "1")}
    assert limit_of(root, "joint", "hook") == (0.0, FAR)
    assert limit_of(root, "fixed", "clamp") == (-FAR, 0.0)


def test_a_stop_between_branches_counts_both_ways() -> None:
    twin = Body(name="twin", angle="c", mass=1, centre=(1, 0), inertia=0.1)
    joint = PinJoint(
        name="twin pin", parent="upper", child="twin", parent_point=(1, 0), child_point=(0, 0)
    )
    stop = Stop(name="between", body="lower", relative_to="twin", sense=1, limit=0.0, closed=False)
    base = chain_of(())
    root = parsed(
        chain_of(
            (stop,),
            bodies=(*base.bodies, twin),
            joints=(*base.joints, joint),
            start=(0.3, 0.5, 0.4),
        )
    )
    assert {(e.get("joint"), e.get("coef")) for e in root.iter("fixed").__next__()} == {
        ("pin", "1"),
        ("twin_pin", "-1"),
    }


def test_start_speeds_are_relative_and_slides_come_first() -> None:
    slot = SlotJoint(
        name="hook",
        child="upper",
        parent_point=(0.3, 2),
        child_point=(0.1, 0),
        axis=(0.8, 0.6),
        coordinate="s",
    )
    root = parsed(
        chain_of(
            (),
            joints=(slot, chain_of(()).joints[1]),
            start=(0.3, 0.5, 0.7),
            start_speeds=(1.0, 3.0, 0.25),
        )
    )
    key = next(root.iter("key"))
    assert key.get("qvel") == "0.25 1 2"
    axis = next(e for e in root.iter("joint") if e.get("name") == "hook_slide").attrib["axis"]
    # The axis in the frame of a body turned clockwise by 0.3 rad, where MuJoCo wants it.
    assert [float(x) for x in axis.split()] == pytest.approx(
        [0.8 * math.cos(0.3) - 0.6 * math.sin(0.3), 0.0, 0.8 * math.sin(0.3) + 0.6 * math.cos(0.3)],
        abs=1e-15,
    )


@pytest.mark.parametrize(
    "mechanism", [*(model(name) for name in models()), everything()], ids=lambda m: m.name
)
def test_names_have_no_character_that_an_importer_refuses(mechanism: Mechanism) -> None:
    root, names = parsed(mechanism), mjcf_names(mechanism)
    present = {name for e in root.iter() if e.tag != "key" and (name := e.get("name")) is not None}
    assert all(re.fullmatch(r"[\w.-]+", name) for name in present)
    assert present == set(names.values()) and len(set(names.values())) == len(names)
    # Every reference is to one of them, of the kind that its attribute names.
    for element in root.iter():
        for attribute, name in element.attrib.items():
            if attribute.rstrip("12") in (
                "joint",
                "site",
                "geom",
                "tendon",
                "refsite",
                "objname",
                "body",
            ):
                assert name in present, (element.tag, attribute, name)


def test_names_that_differ_stay_different() -> None:
    base = chain_of(())
    markers = [
        Marker(name=name, body="upper", point=(0, 0))
        for name in ("a b", "a_b", "a_b_2", "hook_force")
    ]
    mechanism = base.model_copy(update={"markers": tuple(markers)})
    names = mjcf_names(mechanism)
    assert [names[marker.name] for marker in markers] == ["a_b_3", "a_b", "a_b_2", "hook_force"]
    assert names["hook/force"] == "hook_force_2"
    sites = [element.get("name") for element in parsed(mechanism).iter("site")]
    assert {"a_b", "a_b_2", "a_b_3"} <= set(sites)


@every_model
def test_every_joint_has_an_axis_of_its_own(name: str) -> None:
    root = parsed(model(name))
    assert all("axis" in joint.attrib for joint in root.find("worldbody").iter("joint"))  # type: ignore[union-attr]
    assert all("axis" not in joint.attrib for joint in root.find("default").iter("joint"))  # type: ignore[union-attr]
    assert root.find(".//frame") is None and root.get("model") == name


@every_model
def test_nothing_drawn_has_mass_or_touches(name: str) -> None:
    root = parsed(model(name))
    default = root.find("default/geom")
    assert default is not None
    assert (default.get("mass"), default.get("contype"), default.get("conaffinity")) == (
        "0",
        "0",
        "0",
    )
    geoms = list(root.find("worldbody").iter("geom"))  # type: ignore[union-attr]
    assert all(not {"mass", "contype", "conaffinity"} & set(geom.attrib) for geom in geoms)
    floor = next(ET.fromstring(scene(model(name), f"{name}.xml")).iter("geom"))
    assert (floor.get("contype"), floor.get("conaffinity")) == ("0", "0")
    # What is drawn has no name, and only what has one can be in a pair that touches.
    named = {geom.get("name") for geom in geoms} - {None}
    assert named == {pair.get(end) for pair in root.iter("pair") for end in ("geom1", "geom2")} - {
        None
    }


def floats(text: str | None) -> list[float]:
    return [float(word) for word in (text or "").split()]


def by_name(root: ET.Element, tag: str, name: str) -> ET.Element:
    return next(element for element in root.iter(tag) if element.get("name") == name)


def test_a_stop_on_a_point_is_a_ball_that_rests_on_a_plane() -> None:
    tip = _place(chain_of(()), "lower", (0.1, -1.5))
    normal = (0.6, 0.8)
    offset = normal[0] * tip[0] + normal[1] * tip[1]
    stop = PointStop(
        name="wall", body="lower", point=(0.1, -1.5), normal=normal, offset=offset, closed=True
    )
    root = parsed(chain_of((stop,)))
    radius = floats(by_name(root, "geom", "wall_ball").get("size"))[0]
    plane = by_name(root, "geom", "wall_wall")
    assert floats(plane.get("zaxis")) == [0.6, 0.0, 0.8]
    behind = floats(plane.get("pos"))
    assert behind[0] * 0.6 + behind[2] * 0.8 == pytest.approx(offset - radius, abs=1e-15)
    # In the frame of its body, whose origin is the joint at (0, 0.1).
    assert floats(by_name(root, "body", "wall_point").get("pos")) == pytest.approx(
        [0.1, 0.0, -1.6], abs=1e-15
    )
    default = root.find("default/pair")
    assert default is not None and default.get("condim") == "1"
    assert {sensor.get("name") for sensor in root.iter("contact")} >= {"wall_torque"}
    assert root.find("option/flag") is None and root.find("equality") is None


def _place(mechanism: Mechanism, body: str, point: tuple[float, float]) -> tuple[float, float]:
    kinematics = Kinematics(mechanism)
    x, y = kinematics.position(kinematics.point(body, point), np.array(mechanism.start))
    return float(x), float(y)


def test_a_slot_that_closes_a_loop_is_a_ball_between_two_planes() -> None:
    at = _place(chain_of(()), "lower", (0.5, 0.2))
    slot = SlotJoint(
        name="rail", child="lower", parent_point=at, child_point=(0.5, 0.2), axis=(0.8, -0.6)
    )
    root = ET.fromstring(mjcf(chain_of((), joints=(*chain_of(()).joints, slot)), 1e-3))
    left, right = (by_name(root, "geom", f"rail_{side}_wall") for side in ("left", "right"))
    assert floats(left.get("zaxis")) == [-0.6, 0.0, -0.8] and floats(right.get("zaxis")) == [
        0.6,
        0.0,
        0.8,
    ]
    # The ball fills the room between them.
    apart = np.subtract(floats(left.get("pos")), floats(right.get("pos"))) @ [0.6, 0.0, 0.8]
    assert apart == pytest.approx(
        2 * floats(by_name(root, "geom", "rail_ball").get("size"))[0], abs=1e-15
    )
    margins = {float(pair.attrib["margin"]) for pair in root.iter("pair") if pair.get("name")}
    # Both are pressed in by the same, and by a hundredth of it at a tenth of the step.
    finer = ET.fromstring(mjcf(chain_of((), joints=(*chain_of(()).joints, slot)), 1e-4))
    assert len(margins) == 1
    assert float(by_name(finer, "pair", "rail_left").attrib["margin"]) == pytest.approx(
        0.01 * margins.pop()
    )
    assert by_name(root, "force", "rail_force").get("site") == "rail_joint"


def test_a_pin_that_closes_a_loop_ties_two_sites() -> None:
    closing = PinJoint(
        name="loop pin", parent=GROUND, child="lower", parent_point=(1, 1), child_point=(0.2, 0.3)
    )
    root = parsed(chain_of((), joints=(*chain_of(()).joints, closing)))
    tie = by_name(root, "connect", "loop_pin")
    assert (tie.get("site1"), tie.get("site2")) == ("loop_pin_joint", "loop_pin_anchor")
    assert floats(by_name(root, "site", "loop_pin_anchor").get("pos")) == [1.0, 0.0, 1.0]
    assert floats(by_name(root, "body", "loop_pin_point").get("pos")) == pytest.approx(
        [0.2, 0.0, 0.2], abs=1e-15
    )
    assert root.find("option/flag").get("contact") == "disable"  # type: ignore[union-attr]


def test_what_cannot_be_written_says_so() -> None:
    itself = Stop(
        name="itself", body="upper", relative_to="upper", sense=1, limit=-1.0, closed=False
    )
    with pytest.raises(UnsupportedProblemError, match="itself"):
        mjcf(chain_of((itself,)))
    still = PointStop(
        name="still", body=GROUND, point=(0, 1), normal=(0, 1), offset=0.0, closed=False
    )
    with pytest.raises(UnsupportedProblemError, match="still"):
        mjcf(chain_of((still,)))


@pytest.mark.parametrize("timestep", [0.0, -1e-3, math.nan, math.inf])
def test_a_time_step_must_be_one(timestep: float) -> None:
    with pytest.raises(InputError, match="timestep"):
        mjcf(fixed(), timestep)


def test_the_softness_follows_the_time_step() -> None:
    default = ET.fromstring(mjcf(fixed(), 0.25)).find("default/joint")
    assert default is not None and default.get("solreflimit") == "0.5 1"


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="taken"):
        write_model_folder(fixed(), tmp_path / "taken")


def test_an_interrupted_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_model_folder(fixed(), tmp_path)
    before = (tmp_path / "fixed.xml").read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mjcf_writer.Path, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        write_model_folder(fixed(TrebuchetParameters(l1=9)), tmp_path)
    assert (tmp_path / "fixed.xml").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"fixed.xml", SCENE_FILE}
