"""What a file of a motion says: every unit, every kind of comment, and where its limits are."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import G, angle_stop, bouncing, everything, floor, hanging_bob
from trebucheck.comparisons.judge import GivenImpact, _netcdf_impacts, judge_file, jumps, read
from trebucheck.comparisons.runs.study import Study
from trebucheck.models.kinematics import Kinematics

UNITS = {
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "length": {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0},
    "force": {"N": 1.0, "kN": 1000.0},
    "torque": {"N m": 1.0, "kN m": 1000.0},
    "energy": {"J": 1.0, "kJ": 1000.0},
}
UNITS |= {
    f"{kind} a second": {f"{unit}/s": value for unit, value in UNITS[kind].items()}
    for kind in ("angle", "length")
}


def _mechanism() -> tb.Mechanism:
    """Angles and slides, a stop of either kind, points and joints."""
    tip = tb.Marker(name="tip", body="bob", point=(0.2, 0.1))
    rest = angle_stop(2.0, name="rest")
    return everything().model_copy(update={"markers": (tip,), "stops": (*everything().stops, rest)})


def _kinds(mechanism: tb.Mechanism) -> dict[str, str]:
    """Kind of each column that a file of the mechanism may have."""
    kinds = {"kinetic energy": "energy", "potential energy": "energy"}
    for name in mechanism.coordinates:
        kind = "angle" if name in mechanism.angles else "length"
        kinds |= {f"q {name}": kind, f"u {name}": f"{kind} a second"}
    for marker in mechanism.markers:
        for axis in "xy":
            kinds |= {f"{marker.name} {axis}": "length"}
            kinds |= {f"{marker.name} v{axis}": "length a second"}
    kinds |= {"stop deck": "force", "stop rest": "torque"}
    for joint in mechanism.joints:
        if joint.name != "sea":  # a free joint holds nothing
            kinds |= {f"joint {joint.name} {axis}": "force" for axis in "xy"}
    return kinds


@pytest.mark.parametrize("turn", range(4))
def test_a_column_is_read_alike_in_each_of_its_units(turn: int, tmp_path: Path) -> None:
    mechanism = _mechanism()
    kinds = _kinds(mechanism)
    right = {name: np.array([0.3, -1.7, 2.5]) + k for k, name in enumerate(kinds)}
    t, path = np.array([0.0, 0.2, 0.7]), tmp_path / "m.csv"
    heads, columns = ["t [ms]" if turn % 2 else "t [s]"], [t * (1e3 if turn % 2 else 1.0)]
    for k, (name, kind) in enumerate(kinds.items()):
        units = UNITS[kind]
        unit = list(units)[(turn + k) % len(units)]
        heads.append(f"{name} [{unit}]")
        columns.append(right[name] / units[unit])
    rows = [",".join(map(repr, row)) for row in np.array(columns).T.tolist()]
    path.write_text("\n".join([",".join(heads), *rows]))
    found = read(path, mechanism)
    assert found.t == pytest.approx(t, rel=1e-14)
    assert set(found.values) == {"t", *kinds}
    for name, values in right.items():
        assert found.values[name] == pytest.approx(values, rel=1e-12), name


def test_a_unit_of_another_kind_is_refused(tmp_path: Path) -> None:
    mechanism, path = _mechanism(), tmp_path / "m.csv"
    for name, kind in _kinds(mechanism).items():
        for other, units in UNITS.items():
            if other != kind:
                unit = next(iter(units))
                path.write_text(f"t [s],{name} [{unit}]\n0,1\n1,2")
                with pytest.raises(tb.InputError, match="has the unit"):
                    read(path, mechanism)


BOB = hanging_bob(angle_stop(1.0, 0.5), floor(1.9, 0.3))
MOTION = "t [s],beta [rad]\n0,0.1\n0.5,0.2"


def _read(path: Path, text: str) -> object:
    path.write_text(text)
    return read(path, BOB)


def test_comments_tell_events_in_their_units(tmp_path: Path) -> None:
    heads = (
        "# release stop [ms] = 250",
        "#release floor [s] = never",
        "# impact stop [ms] = 450, impulse [N m s] = 13.5",
        "# impact floor [s] = 0.75, impulse [N s] = 2.5",
        "# impact floor [s] = 0",
    )
    path = tmp_path / "m.csv"
    path.write_text("\n".join([*heads, "# measured = on a Tuesday", MOTION]))
    found = read(path, BOB)
    assert found.releases == {"stop": 0.25, "floor": None}
    stop, floored, unknown = found.impacts
    assert stop == GivenImpact("stop", pytest.approx(0.45), 13.5)
    assert floored == GivenImpact("floor", 0.75, 2.5)
    assert (unknown.stop, unknown.time) == ("floor", 0.0) and math.isnan(unknown.impulse)


@pytest.mark.parametrize(
    "head",
    [
        "# impact floor [s] = 0.75, impulse [N m s] = 2.5",
        "# impact stop [s] = 0.75, impulse [N s] = 2.5",
        "# impact floor [s] = never",
        "# release floor [s] = -0.1",
        "# release ceiling [s] = 0.1",
        "# impact floor [m] = 0.1",
    ],
)
def test_events_that_cannot_be_are_refused(head: str, tmp_path: Path) -> None:
    with pytest.raises(tb.InputError, match="line 1"):
        _read(tmp_path / "m.csv", f"{head}\n{MOTION}")


RIGHT = {
    "the least number of samples": MOTION,
    "two samples at one time": f"{MOTION}\n0.5,0.3",
    "the largest number": "t [s],beta [rad]\n0,1e100\n0.5,-1e100",
    "lines that are empty": "\nt [s],beta [rad]\n\n0,1\n\n0.5,1\n",
}
WRONG = {
    "one sample": "t [s],beta [rad]\n0,0.1",
    "a number beyond the largest": "t [s],beta [rad]\n0,1\n0.5,1.1e100",
    "one beyond it downwards": "t [s],beta [rad]\n0,1\n0.5,-1.1e100",
    "no number": "t [s],beta [rad]\n0,1\n0.5,nan",
    "a late start": "t [s],beta [rad]\n0.01,1\n0.5,1",
    "an early start": "t [s],beta [rad]\n-0.01,1\n0.5,1",
    "times that go back": "t [s],beta [rad]\n0,1\n0.5,1\n0.4,1",
    "times that do not go on": "t [s],beta [rad]\n0,1\n0,1",
    "a value too many": "t [s],beta [rad]\n0,1,2\n0.5,1",
    "a value too few": "t [s],beta [rad]\n0,1\n0.5",
    "a column twice": "t [s],beta [rad],q beta [rad]\n0,1,1\n0.5,1,1",
    "no times": "beta [rad]\n1\n2",
    "one component": "t [s],bob x [m]\n0,1\n0.5,1",
    "no position": "t [s],kinetic energy [J]\n0,1\n0.5,1",
    "speeds alone": "t [s],u beta [rad/s],bob x [m],bob y [m]\n0,1,1,1\n0.5,1,1,1",
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_is_just_within_the_limits_is_read(name: str, tmp_path: Path) -> None:
    assert _read(tmp_path / "m.csv", RIGHT[name])


@pytest.mark.parametrize("name", WRONG)
def test_what_is_beyond_them_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(tb.InputError):
        _read(tmp_path / "m.csv", WRONG[name])


# --- Impacts that speeds show


def _jumps(q: float, before: float, after: float, times: tuple[float, float]) -> list[str]:
    """Stops of the impacts between the last two of four samples of the bob."""
    t = np.array([0.0, 0.1, *times])
    u = np.array([[before], [before], [before], [after]])
    found = list(jumps(t, np.full((4, 1), q), u, Kinematics(BOB), 2.0))
    assert {impact.time for impact in found} <= {times[0]}
    return [impact.stop for impact in found]


AT_STOP = 1.0
"""[rad] Angle of the stop, which a clockwise turn meets: positive speeds."""
ON_FLOOR = math.asin(1.9 / 2.0)
"""[rad] Angle at which the bob, 2 m from its pivot, is on the floor, 1.9 m below that."""


@pytest.mark.parametrize(
    ("q", "before", "after", "times", "stops"),
    [
        (AT_STOP, 2.0, -1.0, (0.2, 0.2), ["stop"]),
        (AT_STOP, 2.0, 0.0, (0.2, 0.2), ["stop"]),
        (AT_STOP, 2.0, 1.0, (0.2, 0.2), ["stop"]),  # it slows down, as where others take part
        (AT_STOP, 2.0, 3.0, (0.2, 0.2), []),  # into the stop
        (AT_STOP, 2.0, 2.0, (0.2, 0.2), []),
        (AT_STOP, -2.0, -3.0, (0.2, 0.2), []),  # away from it already
        (AT_STOP, 2.0, -1.0, (0.2, 0.2001), []),  # at two times
        (AT_STOP + 0.009, 2.0, -1.0, (0.2, 0.2), ["stop"]),
        (AT_STOP - 0.009, 2.0, -1.0, (0.2, 0.2), ["stop"]),
        (AT_STOP + 0.011, 2.0, -1.0, (0.2, 0.2), []),
        (AT_STOP - 0.011, 2.0, -1.0, (0.2, 0.2), []),
        (ON_FLOOR, 2.0, -1.0, (0.2, 0.2), ["floor"]),
        (ON_FLOOR - 0.025, 2.0, -1.0, (0.2, 0.2), ["floor"]),  # 16 mm above it, of 20
        (ON_FLOOR - 0.035, 2.0, -1.0, (0.2, 0.2), []),  # 23 mm
    ],
)
def test_impacts_are_where_a_speed_jumps_at_a_stop(
    q: float, before: float, after: float, times: tuple[float, float], stops: list[str]
) -> None:
    assert _jumps(q, before, after, times) == stops


@pytest.mark.parametrize("factor", [1.0, 0.98])
def test_speeds_at_an_impact_are_those_of_the_first_and_the_last_sample_there(
    factor: float, tmp_path: Path
) -> None:
    """A ball falls 0.3 m and rebounds with 0.6 of its speed; its file repeats the sample before."""
    height, e = 0.3, 0.6
    ball = bouncing(height, e)
    fall, speed = math.sqrt(2 * height / G), math.sqrt(2 * height * G)
    before, after = np.linspace(0.0, fall, 40), np.linspace(fall, fall + 0.1, 20)
    t = np.concatenate([before, before[-1:], after])
    flown = after - fall
    up = factor * e * speed
    q = np.concatenate([height - G * before**2 / 2, [0.0], e * speed * flown - G * flown**2 / 2])
    u = np.concatenate([-G * before, [-speed], up - G * flown])
    rows = [",".join(map(repr, row)) for row in np.stack([t, q, u], axis=1).tolist()]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(["t [s],height [m],u height [m/s]", *rows]))
    study = Study([tb.Problem(ball, duration=float(t[-1]), stop_law="unilateral")], [], ())
    found = judge_file(path, study, diagnosed=False)
    errors = {m.name: m.value for m in found.metrics if m.subject in ("height", "floor")}
    assert errors["impact_time"] == pytest.approx(0.0, abs=1e-9)
    assert errors["impact_speed"] == pytest.approx((1 - factor) * e * speed, abs=1e-9)


class _Dataset(dict[str, object]):
    """Without variables, with an attribute."""

    def __init__(self, impacts: object) -> None:
        self.attrs = {"impacts": json.dumps(impacts)}


def test_impacts_in_an_attribute_are_those_that_push() -> None:
    floored = hanging_bob(floor(1.9, 0.3))
    (name,) = (stop.name for stop in floored.stops)
    stated = [[0.5, {name: 3.0}], [0.75, {name: 0.0}], [1.0, {name: -2.0}]]
    found = _netcdf_impacts(_Dataset(stated), floored)
    assert [(i.stop, i.time, i.impulse) for i in found] == [(name, 0.5, 3.0), (name, 1.0, -2.0)]


@pytest.mark.parametrize(
    ("stop", "time", "impulse"),
    [
        (None, -0.1, 1.0),
        (None, math.inf, 1.0),
        (None, math.nan, 1.0),
        (None, 0.5, math.inf),
        (None, 0.5, -math.inf),
        (None, 0.5, math.nan),
        ("nobody", 0.5, 1.0),
    ],
)
def test_impacts_of_no_stop_or_no_number_are_refused(
    stop: str | None, time: float, impulse: float
) -> None:
    floored = hanging_bob(floor(1.9, 0.3))
    stated = [[time, {stop or floored.stops[0].name: impulse}]]
    with pytest.raises(tb.InputError):
        _netcdf_impacts(_Dataset(stated), floored)
