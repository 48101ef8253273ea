"""The page of known models: its tables are its data's, and a model is audited again as it says."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="environments need Gymnasium")

import gymnasium
from trebucheck_environments import known_models
from trebucheck_environments.known_models import KnownModel, KnownModels

DOCS = Path(__file__).parents[2] / "docs"
FOUND = KnownModels.load(DOCS / known_models.DATA)
ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
MUJOCO: Any = mujoco  # it has no types


def known(suite: str, model: str) -> KnownModel:
    """The row of a model."""
    return next(each for each in FOUND.models if (each.suite, each.model) == (suite, model))


def test_the_page_shows_its_data() -> None:
    text = (DOCS / known_models.PAGE).read_text()
    assert known_models.page(FOUND, text) == text


def test_no_model_is_left_out() -> None:
    """Every file of the suite has a row, and each that was not audited a reason."""
    files = {path.stem for path in ASSETS.glob("*.xml")}
    assert files == {each.model for each in FOUND.models if each.suite == "gymnasium"}
    assert all((each.outcome == "audited") == (not each.message) for each in FOUND.models)
    audited = [each for each in FOUND.models if each.outcome == "audited"]
    assert len([each for each in audited if each.suite != "classic control"]) >= 15


@pytest.mark.parametrize("name", ["inverted_pendulum", "half_cheetah"])
def test_a_model_is_audited_again_as_the_page_says(name: str) -> None:
    row = known("gymnasium", name)
    if importlib.metadata.version("gymnasium") != row.version:
        pytest.skip(f"the page is of Gymnasium {row.version}")
    again = known_models.audited_file(row.suite, row.version, ASSETS / f"{name}.xml")
    assert (again.sha256, again.state, again.control) == (row.sha256, row.state, row.control)
    assert again.compared_to == pytest.approx(row.compared_to, rel=1e-6)
    # The page's figures have three digits.
    assert again.error == pytest.approx(row.error, rel=1e-3)
    assert again.leaves == pytest.approx(row.leaves)


def test_a_start_is_within_the_limits() -> None:
    for path in sorted(ASSETS.glob("*.xml")):
        model: Any = MUJOCO.MjModel.from_xml_path(str(path))
        qpos = known_models.start_of(model)
        for joint in np.flatnonzero(model.jnt_limited):
            low, high = model.jnt_range[joint]
            assert low < qpos[model.jnt_qposadr[joint]] < high
