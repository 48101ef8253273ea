"""The small MJCF models.

Each file is the machine that its mechanism is, as MuJoCo's compiler reads it.
"""

from __future__ import annotations

import hashlib
import importlib
import math
from typing import Any

import numpy as np
import pytest
import xarray as xr
from trebucheck.comparisons.data.certified import certified_dataset
from trebucheck.models.kinematics import initial_state
from trebucheck.models.library.registry import models
from trebucheck.models.mechanism import Mechanism
from trebucheck.reference.equations import Equations
from trebucheck_importers.expected import read_dataset, with_joint_values
from trebucheck_importers.files import checksums, expected
from trebucheck_importers.zoo.machines import machine_model
from trebucheck_importers.zoo.model import ZooModel, zoo_file
from trebucheck_importers.zoo.registry import zoo, zoo_model

mujoco: Any = pytest.importorskip("mujoco")
mass_matrix: Any = importlib.import_module("trebucheck.engines.mujoco.compat").mass_matrix

every_model = pytest.mark.parametrize("model", zoo(), ids=lambda model: model.name)
IDEAL = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def _largest_difference(zoo_model: ZooModel, mechanism: Mechanism) -> float:
    """Of masses, accelerations without constraints, the start and ranges, relative to their
    sizes."""
    model = mujoco.MjModel.from_xml_string(zoo_model.xml)
    data = mujoco.MjData(model)
    model.opt.disableflags |= IDEAL
    equations, weights = Equations(mechanism), zoo_model.weights
    inverse = np.linalg.inv(weights)
    q, u = initial_state(mechanism)
    home = model.key("home")
    errors = [
        abs(home.qpos - weights @ q - zoo_model.zeros).max(),
        abs(home.qvel - weights @ u).max(),
    ]
    errors.append(abs(model.body_mass.sum() - zoo_model.total_mass))
    random = np.random.default_rng(5)
    for _ in range(3):
        data.qpos[:], data.qvel[:] = weights @ q + zoo_model.zeros, weights @ u
        mujoco.mj_forward(model, data)
        free = np.linalg.solve(equations.mass_matrix(q), equations.forces(q, u))
        mass = inverse.T @ equations.mass_matrix(q) @ inverse
        errors.append(abs(mass_matrix(model, data) - mass).max() / abs(mass).max())
        errors.append(abs(data.qacc - weights @ free).max() / max(1.0, abs(weights @ free).max()))
        q, u = q + random.uniform(-0.3, 0.3, len(q)), random.uniform(-2, 2, len(q))
    for joint, ends in zoo_model.limits.items():
        found = model.joint(joint)
        errors.append(
            abs(found.range - ends).max() / max(1.0, *map(abs, ends))
            if found.limited[0]
            else math.inf
        )
    return float(max(errors))


@every_model
def test_a_file_is_its_mechanism(model: ZooModel) -> None:
    assert tuple(
        mujoco.MjModel.from_xml_string(model.xml).joint(i).name for i in range(len(model.joints))
    ) == (model.joint_names)
    # Up to MuJoCo 3.7 at least, its compiler finds the principal axes of a full tensor to 1e-8
    # only.
    old = model.name == "full-inertia" and tuple(map(int, mujoco.__version__.split(".")[:2])) < (
        3,
        17,
    )
    assert _largest_difference(model, model.mechanism) < (1e-7 if old else 1e-12)


@pytest.mark.parametrize("name", ["hinge", "spatial-spring", "nested-frames"])
def test_another_mechanism_is_not_the_file(name: str) -> None:
    model = zoo_model(name)
    first, *others = model.mechanism.bodies
    heavier = model.mechanism.model_copy(
        update={
            "bodies": (first.model_copy(update={"inertia": first.inertia * (1 + 1e-9)}), *others)
        }
    )
    assert _largest_difference(model, heavier) > 1e-12


@pytest.mark.parametrize("name", models())
def test_machines_are_models_of_the_same_kind(name: str) -> None:
    model = machine_model(name)
    assert _largest_difference(model, model.mechanism) < 1e-12


def test_every_file_has_its_checksum() -> None:
    known = checksums()
    assert set(known) == {f"{model.name}.{kind}" for model in zoo() for kind in ("xml", "nc")}
    assert {
        hashlib.sha256(zoo_file(name)).hexdigest() == digest for name, digest in known.items()
    } == {True}


@every_model
def test_stored_data_are_those_of_the_mechanism(model: ZooModel) -> None:
    data = read_dataset(zoo_file(f"{model.name}.nc"))
    assert data.attrs["mechanism_hash"] == model.mechanism.content_hash
    assert data.attrs["predictability_horizon"] == pytest.approx(model.duration)
    assert float(data["joint_position_uncertainty"].max()) < 1e-8
    again = with_joint_values(model, data.drop_dims(["file_joint", "state"]))
    for name in ("mass_matrix", "acceleration", "constraint_force", "joint_position"):
        xr.testing.assert_allclose(again[name], data[name], rtol=1e-13, atol=1e-13)


@pytest.mark.slow
def test_stored_motions_are_computed_again_the_same() -> None:
    model = zoo_model("hinge-limit")
    stored, again = read_dataset(zoo_file("hinge-limit.nc")), certified_dataset(model.problem)
    assert (abs(stored["q"] - again["q"]) <= stored["q_uncertainty"] + again["q_uncertainty"]).all()


def test_figures_that_are_known_in_closed_form() -> None:
    assert expected("joint-equality").accelerations[0] == pytest.approx(
        [2 * 9.81 / 7, 4 * 9.81 / 7], rel=1e-13
    )
    assert expected("armature-slide").accelerations[0] == pytest.approx(
        [-9.81 * 2 / 2.5], rel=1e-13
    )
    rest = expected("hinge-limit").resting_force  # the limit carries the rod's weight
    assert rest == pytest.approx([-2 * 9.81 * 0.3 * math.cos(0.8)], rel=1e-9)
    contact = expected("contact")
    angle = math.asin(0.35 / 0.6)
    assert contact.whole.positions[-1] == pytest.approx([angle], abs=1e-9)
    assert contact.resting_force == pytest.approx([-2 * 9.81 * 0.3 * math.cos(angle)], rel=1e-9)
