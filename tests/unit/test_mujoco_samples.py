"""MuJoCo's samples: of an instant that is recorded again the earlier sample goes, and no other."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from trebucheck.engines.mujoco.read import Samples


def _add(samples: Samples, *times: float) -> None:
    rows = np.array(times)[:, None]
    samples.add(np.array(times), rows, -rows)


def test_only_the_last_sample_is_dropped_and_of_every_array() -> None:
    samples = Samples()
    _add(samples, 0.0)
    _add(samples, 0.1, 0.2, 0.3)
    _add(samples)  # a chunk with an event in its first step
    assert samples.last_time() == 0.3
    samples.drop_last()
    assert samples.last_time() == 0.2
    _add(samples, 0.3)
    assert np.concatenate(samples.times).tolist() == [0.0, 0.1, 0.2, 0.3]
    assert np.concatenate(samples.states)[:, 0].tolist() == [0.0, 0.1, 0.2, 0.3]
    assert np.concatenate(samples.sensors)[:, 0].tolist() == [0.0, -0.1, -0.2, -0.3]
