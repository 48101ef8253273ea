"""Bad inputs for every option and argument of every command, drawn by a seed.

The commands and their parameters are read from the command line itself: one that is added has to be
given values here, or the tests fail.
"""

from __future__ import annotations

import csv
import io
import json
import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import trebucheck as tb
import typer
from trebucheck.cli.app import app, main

Values = tuple[str, ...]

LONG = "n" * 3000
# What is no name of anything
WORDS: Values = (
    "nosuch",
    ",",
    " , ",
    "Fixed?",
    "fix\u00e9d",
    LONG,
    "a\nb",
    "\x1b[31m",
    "null",
    "{}",
    "[1]",
    "../x",
    "'",
    "%s",
    "\u202ename",
    "x" * 400 + ".json",
)
NUMBERS: Values = (
    "nan",
    "-1",
    "0",
    "abc",
    "1e400",
    "-inf",
    "1,5",
    "1/2",
    "0x10",
    "1 s",
    "1e-400",
    "None",
    "--",
    "[1]",
    "9" * 400,
    "1e",
    "\u221e",
)
# Some users mean them: they may be taken, but must end with a word
ODD_NUMBERS: Values = ("1e308", "inf", "5e-324", "1e18", "1_000", "\uff11", " 1 ", "+1", "1e-12")
WHOLE: Values = ("-1", "0", "1.5", "abc", "1e3", "nan", "9" * 30, "1,2", "0b1", "")
ENDS: Values = (
    "launch:nosuch",
    "release:nosuch",
    "launch:",
    ":",
    "release",
    "release:a:b",
    "Launch",
    *NUMBERS,
)
ASSIGNED: Values = (
    "length",
    "=3",
    "length=",
    "length=abc",
    "length=nan",
    "length=-1",
    "length=1,2",
    "nosuch=1",
    "length=1e400",
    "length==1",
    "length=0",
    "length=1;gravity=2",
    "=",
    "length=null",
    "length=" + "9" * 400,
    "Length=1",
)
TOLERANCES: Values = (
    "position",
    "position=",
    "position=-1",
    "position=nan",
    "position=0",
    "position=abc",
    "position=1%%",
    "nosuch=1",
    "position=1e400",
    "position=inf",
    "release:nosuch=1",
    "=1%",
    "position=%",
    "position=1 %m",
)
OPTIONS: Values = (
    "timestep",
    "timestep=",
    "timestep=abc",
    "timestep=-1",
    "timestep=nan",
    "timestep=0",
    "nosuch=1",
    "mujoco.nosuch=1",
    "nosuch.timestep=1",
    "timestep=[1]",
    'timestep={"a":1}',
    "timestep=true",
    "timestep=null",
    "timestep=" + "[" * 3000,
    "mujoco.=1",
    ".timestep=1",
    "timestep=1e400",
)
OUT: Values = ("", " ", "a-file", "a-file/x", "/dev/null/x", "/proc/x", "d" * 300, "x/" + "d" * 300)
CLUSTERS: Values = (
    "tcp://",
    "nowhere",
    "absent.json",
    "broken.json",
    "tcp://127.0.0.1:99999",
    "http://127.0.0.1:9",
    "tcp://127.0.0.1:abc",
    "a-folder",
    "",
)
BROKEN: Values = ("empty.json", "broken.json", "bytes.json")
FILES: Values = (*BROKEN, "absent.json", "a-folder", "", "/proc/x")
EMPTY: Values = ("", " ")

_MACHINE: Values = (*WORDS, *FILES, "null.json", "list.json", "deep.json", "pendulum,pendulum")
_NAME: Values = (*WORDS, *EMPTY)

# Bad values by the parameter's name, where a command has no own ones
_BY_NAME: Mapping[str, Values] = {
    "models": _MACHINE,
    "model": _MACHINE,
    "engines": _NAME,
    "engine": _NAME,
    "preset": _NAME,
    "timestep": (*NUMBERS, ""),
    "duration": (*NUMBERS, ""),
    "until": (*ENDS, ""),
    "tolerance": TOLERANCES,
    "tolerances": FILES,
    "set": ASSIGNED,
    "beam": (*NUMBERS, "5"),
    "option": OPTIONS,
    "stop_law": _NAME,
    "jobs": WHOLE,
    "cluster": CLUSTERS,
    "timeout": (*NUMBERS, ""),
    "out": OUT,
    "knobs": _NAME,
    "position": NUMBERS,
    "torque": NUMBERS,
    "release": NUMBERS,
    "digits": (*WHOLE, "201"),
    "most_steps": WHOLE,
    "start_bits": (*WHOLE, "7", "601"),
    "neighbours": WHOLE,
    "tier": _NAME,
    "problem": _NAME,
    "deviations": FILES,
    "commit": EMPTY,
    "factor": (*NUMBERS, "0.5"),
    "format": _NAME,
    "formats": _NAME,
    "only": _NAME,
    "files": FILES,
    "file": FILES,
    "old": FILES,
    "new": FILES,
    "folder": FILES,
    "release_angle": ("nan", "abc", "1e400", "-inf", "1,5", ""),
    "release_time": ("nan", "abc", "1e400", "-inf", "1,5", "", "-1", "1e9"),
    "sling_angle": ("nan", "abc", "1e400", "-inf", "1,5", ""),
    "density": ("nan", "abc", "1e400", "-inf", "-1", ""),
    "drag_area": ("nan", "abc", "1e400", "-inf", "-1", ""),
    "height": ("nan", "abc", "1e400", "-inf", "1,5", ""),
    "body": _NAME,
    "trajectories": FILES,
    "script": ("", "a-folder", "a-file/x", "/proc/x", "d" * 300),
    "from": FILES,
    "magnify": NUMBERS,
    "width": WHOLE,
    "at": ("nan", "abc", "-1", "1e400", "1,,2", "", "1;2"),
    "name": _NAME,
    "package": (*_NAME, "@", "a@", "@1", "@a/@1", "A@1", "a b@1", "a@1 2", 'a@"', "a@b@1", "a@\n1"),
    "tag": _NAME,
    "sections": _NAME,
    "loader": (*WORDS, "", "nosuch:load", "json:nosuch", "json:loads:x", ":", "a b:E", "os:sep"),
    "python": ("", "absent", "a-folder", "a-file", "/dev/null"),
    "x": _NAME,
    "y": _NAME,
    "campaign": FILES,
    "number": (*WHOLE, "1000000"),
    "accuracy": NUMBERS,
    "keyframe": (*WORDS, "7", "-1"),
    "qpos": ("nan", "1,2,3", "abc", "1,,2", "", "1e400", "1;2", "9" * 400),
    "qvel": ("nan", "1,2,3", "abc", "1,,2", "", "1e400", "1;2", "9" * 400),
    "ctrl": ("nan", "1,2,3", "abc", "1,,2", "", "1e400", "1;2", "9" * 400, "no.csv", "no.npz"),
    "without": (*_NAME, "gravity", "limits,gravity"),
    "rollout": (*_NAME, "gymnasium:", "gymnasium:nosuch-v0", "gymnasium:CartPole-v1", "a:b"),
}

# Parameters that switch something: they have no values
_SWITCHES = """
sweep diagnose resume quiet json best sensitivities reference check keyframes sensors
finite_inertia scene node
"""
_NO_VALUES = frozenset(_SWITCHES.split())

_OF_ENGINES = {
    "models": "pendulum",
    "engines": "mujoco",
    "preset": "settings",
    "until": "0.05",
    "timeout": "20",
    "out": "out",
}
# Flags and values of a call of each command that takes little time
_CALLS: Mapping[str, tuple[tuple[str, ...], Mapping[str, str]]] = {
    "compare": (("--no-diagnose", "--quiet"), _OF_ENGINES | {"preset": "default"}),
    "judge": (("--quiet",), {"file": "motion.csv", "model": "pendulum", "out": "out"}),
    "conform": (
        ("--quiet",),
        {"engine": "mujoco/default", "problem": "pendulum", "tier": "quick", "out": "out"},
    ),
    "matrix": (("--quiet",), {"files": "results.json", "out": "out.html"}),
    "diff": ((), {"old": "results.json", "new": "results.json", "out": "out"}),
    "figures": ((), {"folder": "report", "formats": "svg", "out": "out"}),
    "explain": (("--quiet",), _OF_ENGINES),
    "converge": (("--quiet",), _OF_ENGINES),
    "recommend": (
        ("--quiet",),
        {
            "model": "pendulum",
            "engines": "mujoco",
            "until": "0.05",
            "position": "0.01",
            "neighbours": "0",
            "timeout": "20",
            "out": "out",
        },
    ),
    "throw": (("--quiet",), {"model": "fixed", "out": "out"}),
    "run": (
        ("--quiet",),
        {"engine": "mujoco", "model": "pendulum", "until": "0.05", "timeout": "20", "out": "out"},
    ),
    "animate": (
        (),
        {
            "model": "pendulum",
            "engines": "mujoco",
            "preset": "default",
            "until": "0.05",
            "timeout": "20",
            "out": "out.html",
        },
    ),
    "view": ((), {"model": "pendulum"}),
    "certify": (("--quiet",), {"models": "pendulum", "duration": "0.1", "out": "out"}),
    "prove": (
        ("--quiet",),
        {"model": "pendulum", "digits": "3", "until": "0.05", "timeout": "20", "out": "out"},
    ),
    "data": ((), {"name": "pendulum", "out": "out"}),
    "problems": ((), {"name": "pendulum"}),
    "engines": ((), {"name": "mujoco"}),
    "paper": (("--quiet",), {"sections": "drag", "engines": "mujoco", "out": "out"}),
    "importer": (
        ("--quiet",),
        {"loader": "json:loads", "models": "hinge", "timeout": "20", "out": "out"},
    ),
    "campaign run": (("--quiet",), {"file": "campaign.toml", "out": "out"}),
    "campaign resume": (("--quiet",), {"campaign": "store"}),
    "campaign show": (("--quiet",), {"campaign": "store"}),
    "campaign diff": (("--quiet",), {"old": "store", "new": "store", "out": "out"}),
    "campaign machine": ((), {"campaign": "store", "number": "0"}),
    "campaign shrink": (
        ("--quiet",),
        {"campaign": "store", "number": "0", "engine": "mujoco", "out": "out"},
    ),
    "models show": ((), {"name": "pendulum"}),
    "models read": ((), {"file": "model.xml", "out": "out"}),
    "audit": (("--quiet",), {"file": "model.xml", "until": "0.05", "out": "out"}),
    "models export": ((), {"name": "pendulum", "out": "out"}),
    "models path": ((), {"name": "pendulum"}),
    "plugin new": ((), {"name": "anengine", "out": "out"}),
}
_MODEL = """
<mujoco><worldbody><body name="arm">
  <joint name="hinge" type="hinge" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/>
</body></worldbody><actuator><motor joint="hinge"/></actuator></mujoco>
"""
_WITHOUT_PARAMETERS = frozenset({"models list", "models schema"})
# Values that are right for one command
_RIGHT: Mapping[tuple[str, str], Values] = {
    ("recommend", "neighbours"): ("0",),
    ("prove", "most_steps"): ("999999999999999999999999999999",),  # it is a limit
    ("", "timeout"): ("1e400", "9" * 400),  # none
    ("campaign machine", "number"): ("0",),
    ("campaign shrink", "number"): ("0",),
    ("", "models"): ("pendulum,pendulum",),
    ("", "model"): ("pendulum,pendulum",),
    ("diff", "out"): ("a-file",),
    ("matrix", "out"): ("a-file",),
    ("data", "out"): ("a-file",),
    ("campaign diff", "out"): ("a-file",),
    ("animate", "out"): ("a-file",),
    ("models read", "out"): ("a-file",),
    ("plugin new", "name"): ("null", "nosuch"),
}
# What else a parameter needs to be looked at
_BESIDE: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("animate", "at"): {"out": "out.svg"},
    ("recommend", "torque"): {"model": "fixed"},
    ("recommend", "release"): {"model": "fixed", "until": "launch"},
    ("run", "script"): {"preset": "default"},
}


@dataclass(frozen=True)
class Case:
    """A call with one bad value."""

    command: str
    parameter: str
    value: str
    words: tuple[str, ...]
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """Files that are written for it, name to content."""
    told: tuple[str, ...] = ()
    """What the sentence has to have one of; empty: the value."""
    may_be_right: bool = False

    def names_the_value(self, text: str) -> bool:
        """Whether a sentence has the value, as it was given, as a number or as a quoted text."""
        return any(form in text for form in self.told or _forms(self.value))


def _forms(value: str) -> Iterator[str]:
    name, _, assigned = value.rpartition("=")
    parts = {value, assigned, name, name.rpartition(".")[2]} - {""} if name else {value}
    for text in parts:
        yield text
        yield repr(text)[1:-1]
        if "/" in text:
            yield repr(text.partition("/")[0])  # an engine, before its preset
        yield text.strip() or "empty"
        if len(text) > 60:
            yield text[:50]
        try:
            number = float(text)
        except ValueError:
            continue
        yield f"{number:g}"
        yield repr(number)
        if math.isfinite(number):
            yield str(int(number))
    if not value.strip(" ,"):
        yield "empty"


@cache
def parameters() -> dict[str, dict[str, Any]]:
    """Parameters of each command by name, as the command line declares them."""
    found: dict[str, dict[str, Any]] = {}

    def visit(command: Any, path: tuple[str, ...]) -> None:
        if hasattr(command, "commands"):
            for name, below in command.commands.items():
                visit(below, (*path, name))
        else:
            found[" ".join(path)] = {p.name.rstrip("_"): p for p in command.params}

    visit(typer.main.get_command(app), ())
    return found


def cases(number: int, seed: int) -> Iterator[Case]:
    """Draw cases: three in four a parameter of a command, one in four a changed file."""
    chosen = random.Random(seed)
    declared = parameters()
    pairs = [
        (command, parameter)
        for command in _CALLS
        if command in declared
        for parameter in declared[command]
        if parameter not in _NO_VALUES
    ]
    for k in range(number):
        if k % 4 == 3:
            yield chosen.choice((_changed_mechanism, _changed_campaign, _changed_motion))(chosen)
        else:
            yield _of_parameter(*chosen.choice(pairs), declared, chosen)


def _of_parameter(
    command: str, parameter: str, declared: Mapping[str, Any], chosen: random.Random
) -> Case:
    bad = _BY_NAME[parameter]
    # The paper's studies take minutes: none is begun
    odd = bad[:2] == NUMBERS[:2] and chosen.random() < 0.2 and command != "paper"
    value = chosen.choice(ODD_NUMBERS if odd else bad)
    right = value in (*_RIGHT.get((command, parameter), ()), *_RIGHT.get(("", parameter), ()))
    words = _words(command, {parameter: value}, declared)
    # A machine with an odd beam may never launch: the sentence says so, and not of which beam
    told = (*_forms(value), "projectile") if (command, parameter) == ("throw", "beam") else ()
    if (parameter, value) == ("without", "limits,gravity"):
        told = ("'gravity'",)  # the one that is not known
    return Case(command, parameter, value, words, told=told, may_be_right=odd or right)


def _words(command: str, given: Mapping[str, str], declared: Mapping[str, Any]) -> tuple[str, ...]:
    flags, cheap = _CALLS[command]
    values = {**cheap, **given}
    for name in given:
        values |= _BESIDE.get((command, name), {})
    if "until" in values and "duration" in given:
        del values["until"]
    options: list[str] = []
    arguments: list[str] = []
    for name, each in declared[command].items():
        if name not in values:
            continue
        if each.param_type_name == "argument":
            arguments.append(values[name])
        else:
            options += [f"{each.opts[0]}={values[name]}"]
    return (*command.split(), *flags, *options, "--", *arguments)


# --- Changed files

_LEAVES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    "text",
    "",
    [],
    {},
    [1],
    {"a": 1},
    math.nan,
    math.inf,
    -1e308,
    "1/2",
    [[]],
    LONG,
    2**70,
)


def _changed(tree: Any, chosen: random.Random) -> tuple[str, Any, bool]:
    """Change a field somewhere in a tree of lists and tables.

    Returns:
        The field's name, its value, and whether the change may be a right one.
    """
    places: list[tuple[str, Any, Any]] = []

    def visit(node: Any, name: str) -> None:
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in list(items):
            label = key if isinstance(key, str) else name
            places.append((label, node, key))
            if isinstance(value, (dict, list)):
                visit(value, label)

    visit(tree, "")
    label, node, key = chosen.choice(places)
    how = chosen.random()
    if how < 0.1 and isinstance(node, dict):
        del node[key]
        return label, "", True
    if how < 0.2 and isinstance(node, dict):
        node["unheard_of"] = 1
        return "unheard_of", 1, False
    value = chosen.choice(_LEAVES)
    node[key] = value
    return label, value, True


def _changed_mechanism(chosen: random.Random) -> Case:
    command = chosen.choice(("models show", "run", "compare", "throw", "models export"))
    named = ("pendulum", "fixed", "quick-return", "falling-rod", "three-cranks")
    name = "fixed" if command == "throw" else chosen.choice(named)
    tree = json.loads(tb.model(name).to_json())
    label, value, may_be_right = _changed(tree, chosen)
    text = json.dumps(tree)
    if chosen.random() < 0.1:
        text, label, may_be_right = text[: chosen.randrange(len(text))], "changed.json", False
    parameter = {"models show": "name", "models export": "name", "compare": "models"}.get(
        command, "model"
    )
    words = _words(command, {parameter: "changed.json"}, parameters())
    # Of a start that does not fit, the joint is named.
    joints = (repr(joint.name) for joint in tb.model(name).joints)
    told = (label, "changed.json", *joints, *_forms(str(value)))
    told = (*told, "projectile") if command == "throw" else told  # which may never be launched
    return Case(command, label, repr(value)[:60], words, {"changed.json": text}, told, may_be_right)


_CAMPAIGN: Mapping[str, Any] = {
    "name": "lengths",
    "seed": 1,
    "chunk": 1,
    "machines": {"model": "pendulum", "values": {"length": [0.5, 1.0]}},
    "runs": {
        "engines": ["mujoco"],
        "presets": ["default"],
        "until": 0.05,
        "timeout": 20.0,
        "quantities": ["angle"],
    },
}


def _changed_campaign(chosen: random.Random) -> Case:
    tree = json.loads(json.dumps(_CAMPAIGN))
    label, value, may_be_right = _changed(tree, chosen)
    text = _toml(tree)
    if chosen.random() < 0.1:
        text, label, may_be_right = text[: chosen.randrange(len(text))], "changed.toml", True
    words = _words("campaign run", {"file": "changed.toml"}, parameters())
    told = (label, "changed.toml", *_forms(str(value)))
    told += ("a",) if value == {"a": 1} else ()
    return Case(
        "campaign run", label, repr(value)[:60], words, {"changed.toml": text}, told, may_be_right
    )


def _toml(tree: Mapping[str, Any]) -> str:
    def inline(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{json.dumps(k)} = {inline(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(inline, value)) + "]"
        if value is None:
            return "null"
        if isinstance(value, float) and not math.isfinite(value):
            return str(value)
        return json.dumps(value)

    return "\n".join(f"{json.dumps(name)} = {inline(value)}" for name, value in tree.items())


@cache
def _motion_rows() -> list[list[str]]:
    """Rows of a motion of the pendulum that `judge` reads."""
    problem = tb.Problem(tb.model("pendulum"), duration=0.2)
    frame = tb.engine("reference", timestep=5e-3).simulate(problem).to_dataframe()[["q phi"]]
    text = frame.rename(columns={"q phi": "q phi [rad]"}).to_csv(index_label="t [s]")
    return list(csv.reader(io.StringIO(text)))


def _changed_motion(chosen: random.Random) -> Case:
    rows = [list(row) for row in _motion_rows()]
    kind: Callable[[], tuple[str, bool]] = chosen.choice(
        (
            lambda: _cell(rows, chosen),
            lambda: _header(rows, chosen),
            lambda: _cut(rows, chosen),
            lambda: _turned(rows),
        )
    )
    told, may_be_right = kind()
    target = io.StringIO()
    csv.writer(target).writerows(rows)
    words = _words("judge", {"file": "changed.csv"}, parameters())
    return Case(
        "judge",
        "file",
        told,
        words,
        {"changed.csv": target.getvalue()},
        (told, "changed.csv"),
        may_be_right,
    )


def _cell(rows: list[list[str]], chosen: random.Random) -> tuple[str, bool]:
    row, column = chosen.randrange(1, len(rows)), chosen.randrange(2)
    rows[row][column] = value = chosen.choice(("nan", "abc", "", "inf", "1e400", "-1", "1e308"))
    return value or "changed.csv", True


_HEADERS = ("", "t [s]", "q phi [rad]", "t", "q phi [s]", "x", "\u03c6", LONG, "1")


def _header(rows: list[list[str]], chosen: random.Random) -> tuple[str, bool]:
    column = chosen.randrange(2)
    rows[0][column] = value = chosen.choice(_HEADERS)
    return value or "changed.csv", True


def _cut(rows: list[list[str]], chosen: random.Random) -> tuple[str, bool]:
    del rows[chosen.randrange(0, 4) :]
    return "changed.csv", False


def _turned(rows: list[list[str]]) -> tuple[str, bool]:
    rows[1:] = rows[:0:-1]
    return "changed.csv", False


def write_files(folder: Path) -> None:
    """Write the files that calls name, in the folder that they are made in."""
    (folder / "a-folder").mkdir()
    contents: dict[str, str | bytes] = {
        "a-file": "text\n",
        "empty.json": "",
        "broken.json": '{"name": ',
        "bytes.json": b"\xff\xfe\x00\x01",
        "null.json": "null",
        "list.json": "[1, 2]",
        "deep.json": "[" * 20_000,
        "campaign.toml": _toml(_CAMPAIGN),
        "model.xml": _MODEL,
    }
    for name, content in contents.items():
        data = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(data)
    with (folder / "motion.csv").open("w", newline="") as file:
        csv.writer(file).writerows(_motion_rows())
    words = _words("compare", {"out": str(folder / "report")}, parameters())
    assert main([*words]) in (0, 1)
    (folder / "results.json").write_bytes((folder / "report" / "results.json").read_bytes())
    tb.campaign(json.loads(json.dumps(_CAMPAIGN)), folder / "store", jobs=1)


def without_values() -> list[str]:
    """Parameters and commands that these tables do not know."""
    found: list[str] = []
    for command, declared in parameters().items():
        if command not in _CALLS and command not in _WITHOUT_PARAMETERS:
            found.append(command)
        found += [
            f"{command} {name}"
            for name in declared
            if name not in _BY_NAME and name not in _NO_VALUES
        ]
    return found
