"""Audit the planar models of dm_control, Gymnasium and its classic control, as they are shipped.

`make known-models` writes known-models.json and the tables of known-models.md into docs. Files are
those of the installed packages; `--dm-control` names the folder of a suite that is not installed:

    python -m trebucheck_environments.known_models docs --dm-control suite --version "1.0.44"
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from pydantic import Field
from trebucheck.api.mechanics import (
    FloatArray,
    InputError,
    Real,
    Spec,
    TrebucheckError,
    write_text,
)
from trebucheck.api.reports import Document, Table, Text, markdown, table
from trebucheck.api.studies import Audit, ResultFile, audit

from .classic_control import classic_control

MUJOCO: Any = mujoco  # it has no types
DATA, PAGE = "known-models.json", "known-models.md"
UNTIL, ACCURACY = 10.0, 1e-3  # [s], [m]
TIMES = (1.0, 5.0, 10.0)  # [s]
TURNED, RAISED = 0.1, 5.0  # [rad], [m] from the position of the file
INSIDE = 0.4  # of the range of a limited joint
_ITERATIONS = 10  # of Newton, onto equalities
_UPWARD = 0.5  # part of a slide's axis
HALF = 0.5  # least share of a cause that is named
PART = 0.1  # of the range of a control
FORMAT = "trebucheck-known-models-1"

CLASSIC: tuple[tuple[str, list[float], float], ...] = (
    ("CartPole-v1", [0.0, 0.0, 0.1, 0.0], 10.0),
    ("Acrobot-v1", [0.3, 0.0, 0.0, 0.0], 0.0),
    ("Pendulum-v1", [3.0, 0.0], 1.0),
)


class Share(Spec):
    """A cause's share of the error as given."""

    name: str
    share: Real | None


class KnownModel(Spec):
    """One model: why it was not read, or how far its simulation is from its mechanics."""

    suite: str
    version: str
    model: str
    sha256: str = Field(default="", description="of the file; empty: it has none")
    outcome: Literal["audited", "refused", "failed"]
    message: str = Field(default="", description="why it was refused")
    state: tuple[Real, ...] = Field(default=(), description="qpos, or the environment's state")
    control: tuple[Real, ...] = ()
    integrator: str = ""
    timestep: Real | None = Field(default=None, description="[s]")
    compared_to: Real | None = Field(default=None, description="[s]")
    ended: str = Field(default="", description="why that is earlier than was asked for")
    horizon: Real | None = Field(default=None, description="of predictability [s]; None: later")
    size: Real | None = Field(default=None, description="of the motion [m]")
    errors: tuple[Real | None, ...] = Field(
        default=(), description="largest up to each of the times; None: not compared [m]"
    )
    error: Real | None = Field(default=None, description="up to the end of what is compared [m]")
    leaves: Real | None = Field(
        default=None, description="when it is off by 1 % of the size; None: never [s]"
    )
    causes: tuple[Share, ...] = ()
    cheapest: str = Field(default="", description="options that hold the accuracy; empty: none")
    cost: Real | None = Field(
        default=None, description="processor time of those for a second of motion [s]"
    )
    left_out: tuple[str, ...] = ()


class KnownModels(ResultFile):
    """Results of all models of the suites."""

    format: Literal["trebucheck-known-models-1"] = FORMAT
    until: Real = UNTIL
    accuracy: Real = ACCURACY
    times: tuple[Real, ...] = TIMES
    models: tuple[KnownModel, ...]


def suites(dm_control: Path | None, version: str) -> Iterator[tuple[str, str, Path]]:
    """Name, version and folder of each suite that is here."""
    for name, inside in (("gymnasium", "envs/mujoco/assets"), ("dm_control", "suite")):
        found = importlib.util.find_spec(name)
        if name == "dm_control" and dm_control is not None:
            yield name, version, dm_control
        elif found is not None and found.origin is not None:
            yield name, importlib.metadata.version(name), Path(found.origin).parent / inside


def start_of(model: Any) -> FloatArray:
    """Position of a compiled model: within limits, other hinges turned, free bodies raised."""
    qpos = np.array(model.qpos0)
    for joint in range(model.njnt):
        address, kind = int(model.jnt_qposadr[joint]), int(model.jnt_type[joint])
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
            # Legs that are alike would reach their limits at once.
            part = INSIDE + 0.02 * (joint % 5)
            qpos[address] = low + part * (high - low)
        elif kind == MUJOCO.mjtJoint.mjJNT_HINGE:
            qpos[address] += TURNED
        elif kind == MUJOCO.mjtJoint.mjJNT_SLIDE and abs(model.jnt_axis[joint][2]) > _UPWARD:
            qpos[address] += RAISED * np.sign(model.jnt_axis[joint][2])
    return closed(model, qpos) if model.neq else qpos


def closed(model: Any, qpos: FloatArray) -> FloatArray:
    """The nearest position in which a model's equalities hold, by Newton's iteration."""
    model.opt.jacobian = MUJOCO.mjtJacobian.mjJAC_DENSE
    data, qpos = MUJOCO.MjData(model), np.array(qpos)
    for _ in range(_ITERATIONS):
        data.qpos[:] = qpos
        MUJOCO.mj_forward(model, data)
        of_equality = data.efc_type == int(MUJOCO.mjtConstraint.mjCNSTR_EQUALITY)
        rows = np.reshape(data.efc_J, (data.nefc, model.nv))
        step = -np.linalg.pinv(rows[of_equality]) @ data.efc_pos[of_equality]
        MUJOCO.mj_integratePos(model, qpos, step, 1.0)  # a free joint has a quaternion
    return qpos


def control_of(model: Any) -> FloatArray:
    """A tenth of what each control can be; of 1 where it has no limit."""
    largest = np.where(model.actuator_ctrllimited, model.actuator_ctrlrange[:, 1], 1.0)
    return PART * np.asarray(largest, dtype=np.float64)


def audited_file(suite: str, version: str, path: Path) -> KnownModel:
    """Audit a file of a suite."""
    head: dict[str, Any] = {"suite": suite, "version": version, "model": path.stem}
    head["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    try:
        model: Any = MUJOCO.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return KnownModel(**head, outcome="failed", message=str(error).splitlines()[0])
    qpos, ctrl = start_of(model), control_of(model)
    head |= {"state": tuple(qpos.tolist()), "control": tuple(ctrl.tolist())}
    try:
        found = audit(
            path,
            UNTIL,
            accuracy=ACCURACY,
            qpos=qpos.tolist(),
            ctrl=ctrl.tolist(),
            engines=(),
        )
    except InputError as error:
        return KnownModel(**head, outcome="failed", message=str(error))
    except TrebucheckError as error:
        return KnownModel(**head, outcome="refused", message=str(error))
    return KnownModel(**head, outcome="audited", **facts(found))


def audited_environment(name: str, state: list[float], control: float) -> KnownModel:
    """Audit an environment of classic control."""
    found = audit(classic_control(name, state, control), UNTIL, accuracy=ACCURACY, engines=())
    version = importlib.metadata.version("gymnasium")
    head: dict[str, Any] = {"suite": "classic control", "version": version, "model": name}
    head |= {"state": tuple(state), "control": (control,)}
    return KnownModel(**head, outcome="audited", **facts(found))


def facts(found: Audit) -> dict[str, Any]:
    """Fields of a :class:`KnownModel` that an audit fills."""
    by_time = {each.t: each.error for each in found.errors}
    cost = found.cheapest and found.cheapest.processor_time
    return {
        "integrator": found.given.integrator,
        "timestep": found.given.timestep,
        "compared_to": found.compared_to,
        "ended": found.ended,
        "horizon": found.horizon,
        "size": found.size,
        "errors": tuple(by_time.get(time) for time in TIMES),
        "error": found.given.error,
        "leaves": found.given.leaves,
        "causes": tuple(Share(name=each.name, share=each.share) for each in found.causes),
        "cheapest": found.cheapest_option,
        "cost": None if cost is None else cost / found.compared_to,
        "left_out": found.left_out,
    }


def page(found: KnownModels, text: str) -> str:
    """The page with its generated parts replaced: what was read, how far it is off, what was not.

    Args:
        found: all models.
        text: of the page as it was.
    """
    audited = [each for each in found.models if each.outcome == "audited"]
    others = [each for each in found.models if each.outcome != "audited"]
    heads = (
        "model", "integrator, step", "compared to", "horizon",
        *(f"after {time:g} s" for time in TIMES), "leaves 1 % at", "largest cause",
        f"holds {ACCURACY:g} m", "time of that",
    )  # fmt: skip
    tables: list[Table] = []
    for suite in dict.fromkeys(each.suite for each in audited):
        of_suite = [each for each in audited if each.suite == suite]
        tables.append(table(heads, map(_row, of_suite), f"{suite} {of_suite[0].version}"))
    left_out = [(_named(each), "; ".join(each.left_out)) for each in audited if each.left_out]
    refused = [(_named(each), each.message) for each in others]
    parts = {
        "audited": tuple(tables),
        "left-out": (table(("model", "left out"), left_out),),
        "refused": (table(("model", "why"), refused),),
        "made": (Text(f"Made with {found.machine_text}."),),
    }
    for name, blocks in parts.items():
        text = markdown.with_block(text, name, markdown.text(Document("", blocks)))
    return text


def _named(model: KnownModel) -> str:
    return f"{model.suite} {model.model}"


def _row(model: KnownModel) -> tuple[str, ...]:
    largest = max(
        (each for each in model.causes if each.share is not None),
        key=lambda each: each.share or 0.0,
        default=None,
    )
    compared = f"{_number(model.compared_to)} s"
    if model.ended:
        compared += ": touches" if "touch" in model.ended else ": not known"
    cause = "none above a half"
    if largest is not None and (largest.share or 0.0) >= HALF:
        cause = f"{largest.name}, {100 * (largest.share or 0.0):.0f} %"
    off = [f"{_number(each)} m" if each is not None else "–" for each in model.errors]
    leaves = "never" if model.leaves is None else f"{_number(model.leaves)} s"
    cost = "–" if model.cost is None else f"{1e3 * model.cost:.2g} ms/s"
    holds = model.cheapest.replace("\n", "; ") if model.cheapest else "none tried"
    settings = f"{model.integrator} {_number(model.timestep)} s"
    horizon = "later" if model.horizon is None else f"{_number(model.horizon)} s"
    return (model.model, settings, compared, horizon, *off, leaves, cause, holds, cost)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}" if value < 0.01 else f"{value:.3g}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Audit all, write data and page."""
    parser = argparse.ArgumentParser(description="Audit the planar models of known suites.")
    parser.add_argument("folder", type=Path, help="of the page, which is there, and of its data")
    parser.add_argument("--dm-control", type=Path, help="folder of a suite not installed")
    parser.add_argument("--version", default="", help="of that folder")
    given = parser.parse_args(arguments)
    models: list[KnownModel] = []
    for suite, version, folder in suites(given.dm_control, given.version):
        files = sorted(folder.glob("*.xml"))
        if not files:
            parser.error(f"{suite}: there is no .xml file in {str(folder)!r}.")
        for path in files:
            sys.stderr.write(f"{suite} {path.stem}\n")
            models.append(audited_file(suite, version, path))
    models += [audited_environment(*each) for each in CLASSIC]
    found = KnownModels.made_here(models=tuple(models))
    text = page(found, (given.folder / PAGE).read_text())
    write_text(given.folder / DATA, found.to_json())
    write_text(given.folder / PAGE, text)


if __name__ == "__main__":
    main()
