"""Parameters, mechanisms and problems.

Validated at birth, exact in JSON, clear in their complaints.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path

import jsonschema
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.models.mechanism import mechanism_schema
from trebucheck.models.trajectory import load

FIELDS = list(tb.TrebuchetParameters.model_fields)
POSITIVE = [name for name in FIELDS if not name.endswith("0")]


def test_table_one_is_the_default() -> None:
    p = tb.TrebuchetParameters()
    values = (p.l1, p.l2, p.r, p.h, p.m_b, p.m_cw, p.m_a, p.g, p.theta0, p.phi0, p.alpha0)
    assert values == (10, 4, 6, 10, 60, 3000, 1000, 9.81, 0, math.pi, -math.pi / 4)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "long", None, True, [1.0]])
def test_no_parameter_takes_what_is_no_finite_number(name: str, value: object) -> None:
    with pytest.raises(
        tb.InputError, match=rf"^TrebuchetParameters cannot be built: {name} = .*\.$"
    ) as caught:
        tb.TrebuchetParameters(**{name: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", POSITIVE)
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_lengths_masses_and_gravity_are_positive(name: str, value: float) -> None:
    with pytest.raises(tb.InputError, match=f"{name} = {value}: input should be greater than 0"):
        tb.TrebuchetParameters(**{name: value})


def test_degrees_are_refused() -> None:
    with pytest.raises(tb.InputError, match="alpha0 = -45"):
        tb.TrebuchetParameters(alpha0=-45)


def test_unknown_parameters_are_named() -> None:
    with pytest.raises(tb.InputError, match="l3 is not a field it has"):
        tb.TrebuchetParameters(l3=1.0)


def test_beam_keeps_its_length() -> None:
    p = tb.TrebuchetParameters.with_beam(9.25, r=7.0)
    assert (p.l1, p.l2, p.r) == (9.25, 4.75, 7.0)
    with pytest.raises(tb.InputError, match="shorter than the beam"):
        tb.TrebuchetParameters.with_beam(14.0)


def test_descriptions_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        tb.TrebuchetParameters().l1 = 3.0  # type: ignore[misc]


@given(parameters=machine_parameters())
def test_json_keeps_every_bit(build: object, parameters: tb.TrebuchetParameters) -> None:
    mechanism = build(parameters)  # type: ignore[operator]
    assert tb.TrebuchetParameters.from_json(parameters.to_json()) == parameters
    again = tb.Mechanism.from_json(mechanism.to_json())
    assert again == mechanism
    assert again.content_hash == mechanism.content_hash


@given(value=st.floats(min_value=5e-324, max_value=1.7e308))
def test_any_float_survives(value: float) -> None:
    assert (
        tb.TrebuchetParameters.from_json(tb.TrebuchetParameters(m_b=value).to_json()).m_b == value
    )


def test_hash_tells_machines_apart() -> None:
    p = tb.TrebuchetParameters(l1=math.nextafter(10.0, 11.0))
    hashes = {m.content_hash for m in (tb.fixed(), tb.rolling(), tb.fixed(p))}
    assert len(hashes) == 3
    assert tb.fixed().content_hash == tb.fixed(tb.TrebuchetParameters()).content_hash


def test_published_schema_is_the_one_in_force(build: object) -> None:
    schema = mechanism_schema()
    published = Path(__file__).parents[2] / "models" / "schemas" / "mechanism.schema.json"
    assert published.read_text() == schema
    jsonschema.validate(json.loads(build().to_json()), json.loads(schema))  # type: ignore[operator]


def test_rests_stand_where_the_machine_starts() -> None:
    p = tb.TrebuchetParameters(theta0=0.1, phi0=3.0, alpha0=-0.5)
    machine = tb.fixed(p)
    assert machine.stop("hanger rest").limit == pytest.approx(0.6)
    assert machine.stop("sling rest").limit == pytest.approx(2.9)
    assert all(machine.stop(name).closed for name in ("hanger rest", "sling rest"))
    assert not machine.stop("arm stop").closed


def test_coordinates_are_in_the_papers_order() -> None:
    assert tb.fixed().coordinates == ("theta", "phi", "alpha")
    assert tb.rolling().coordinates == ("theta", "phi", "alpha", "x_p")


def _changed(**changes: object) -> dict[str, object]:
    return {**tb.fixed().model_dump(), **changes}


def _row(field: str, index: int, **changes: object) -> dict[str, object]:
    rows = [dict(row) for row in tb.fixed().model_dump()[field]]
    rows[index].update(changes)
    return _changed(**{field: rows})


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        (_changed(start=(0.0, 1.0)), "start has 2 values for 3 coordinates"),
        (_changed(start_speeds=(0.0,)), "start_speeds has 1 values"),
        (_row("bodies", 1, mass=-1.0), r"bodies\.1\.mass = -1\.0"),
        (_row("bodies", 1, name="arm"), "body name 'arm' is used twice"),
        (_row("bodies", 1, name="ground"), "reserved"),
        (_row("joints", 1, parent="nothing"), "names the body 'nothing'"),
        (_row("joints", 0, parent="sling"), "must be listed before it"),
        (_row("joints", 0, child="ground", parent="arm"), "has the ground as its child"),
        (_row("stops", 0, limit=0.5), "is closed, but its gap"),
        (_row("stops", 2, limit=0.0), "is open, but its gap"),
        (_row("stops", 0, sense=2), r"stops\.0\.sense = 2"),
        (_row("markers", 0, body="nothing"), "names the body 'nothing'"),
        (_row("markers", 0, name="a/b"), r"markers\.0\.name = 'a/b'"),
        (_changed(gravity=math.nan), "gravity = nan"),
        (_changed(colour="red"), "colour is not a field"),
    ],
)
def test_a_broken_mechanism_is_refused_in_one_sentence(
    fields: dict[str, object], complaint: str
) -> None:
    with pytest.raises(tb.InputError, match=complaint) as caught:
        tb.Mechanism(**fields)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("part", ["bodies", "joints"])
def test_one_fault_in_the_only_item_of_a_list_is_one_complaint(part: str) -> None:
    content = tb.fixed().model_dump(mode="json")
    content[part] = content[part][:1]
    del content[part][0]["name"]
    with pytest.raises(
        tb.InputError, match=rf"^Mechanism cannot be built: {part}\.0\.name is missing\.$"
    ):
        tb.Mechanism.from_json(json.dumps(content))
    content[part] = []
    with pytest.raises(
        tb.InputError, match=rf"^Mechanism cannot be built: {part} = \[\]: .* at least 1 item"
    ):
        tb.Mechanism.from_json(json.dumps(content))


def test_a_body_without_a_joint_is_refused() -> None:
    joints = tb.fixed().model_dump()["joints"][:2]
    with pytest.raises(tb.InputError, match="body 'hanger' hangs on no joint"):
        tb.Mechanism(**_changed(joints=joints))


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf, "long"])
def test_a_duration_is_positive(duration: object) -> None:
    with pytest.raises(tb.InputError, match="duration = "):
        tb.Problem(tb.fixed(), duration=duration)  # type: ignore[arg-type]


def test_an_unknown_stop_law_is_refused() -> None:
    with pytest.raises(tb.InputError, match=r"stop_law = 'sticky'.*release-once"):
        tb.Problem(tb.fixed(), stop_law="sticky")


def test_files_that_are_no_mechanism_are_named(tmp_path: Path) -> None:
    broken, other = tmp_path / "broken.json", tmp_path / "other.json"
    broken.write_text("{")
    other.write_text("[1, 2]")
    for path in (broken, other, tmp_path / "absent.json", tmp_path):
        with pytest.raises(tb.InputError, match=str(path)):
            tb.Mechanism.load(path)


def _pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def _large(path: Path) -> Path:
    with path.open("wb") as file:
        file.truncate(30_000_000)
    return path


@pytest.mark.parametrize("read", [tb.Mechanism.load, tb.TrebuchetParameters.load, load])
@pytest.mark.parametrize(
    "make", [_pipe, lambda _: Path("/dev/zero"), lambda _: Path("/dev/random")]
)
def test_what_may_have_no_end_is_not_read(
    make: Callable[[Path], Path], read: Callable[[Path], object], tmp_path: Path
) -> None:
    path = make(tmp_path / "x.json")
    with pytest.raises(
        tb.InputError, match=f"{path} cannot be read: it is a pipe, a device or a socket"
    ):
        read(path)


def test_a_mechanism_of_30_megabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with pytest.raises(
        tb.InputError, match=r"x\.json cannot be read: it has 30 MB; at most 1 MB are taken\.$"
    ):
        tb.Mechanism.load(_large(tmp_path / "x.json"))


def test_a_chain_of_any_length_is_followed_to_its_end(tmp_path: Path) -> None:
    n = 1500  # more than Python's calls may be nested
    floor = -(n - 1) * math.sin(0.1)  # [m] height of the last link's pin
    text = json.dumps(
        {
            "name": "chain",
            "bodies": [
                {"name": f"b{i}", "angle": f"a{i}", "mass": 1, "centre": [1, 0], "inertia": 0}
                for i in range(n)
            ],
            "joints": [
                {
                    "kind": "pin",
                    "name": f"j{i}",
                    "parent": f"b{i - 1}" if i else "ground",
                    "child": f"b{i}",
                    "parent_point": [min(i, 1), 0],
                    "child_point": [0, 0],
                }
                for i in range(n)
            ],
            "stops": [
                {
                    "name": "s",
                    "body": f"b{n - 1}",
                    "point": [0, 0],
                    "normal": [0, 1],
                    "offset": floor,
                    "closed": True,
                }
            ],
            "gravity": 9.81,
            "start": [0.1] * n,
        }
    )
    (tmp_path / "chain.json").write_text(text)
    mechanism = tb.Mechanism.load(tmp_path / "chain.json")
    assert mechanism.content_hash == tb.Mechanism.from_json(text).content_hash
    (tmp_path / "chain.json").write_text(text, encoding="utf-8-sig")  # as Windows' editors write it
    assert tb.Mechanism.load(tmp_path / "chain.json") == mechanism
    with pytest.raises(
        tb.InputError, match=r"stop 's' is closed, but its gap at the start is 1 m, not 0"
    ):
        tb.Mechanism.from_json(text.replace(f'"offset": {floor}', f'"offset": {floor - 1}'))


def test_a_changed_copy_has_a_tree_of_its_own() -> None:
    whole = tb.fixed()
    assert whole.coordinates == ("theta", "phi", "alpha") and whole.tree is whole.tree
    part = whole.model_copy(
        update={"bodies": whole.bodies[:1], "joints": whole.joints[:1], "stops": ()}
    )
    assert part.coordinates == ("theta",) and [joint.name for joint in part.tree_joints] == [
        "fulcrum"
    ]
    assert (
        whole == tb.fixed()
        and dict(whole) == dict(tb.fixed())
        and whole.content_hash == tb.fixed().content_hash
    )
