"""Tests that each engine's adapter tells its reading apart, and that it is a part of the run."""

import pytest
import trebucheck as tb

ENGINES = ("mujoco", "pymunk", "exudyn")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("preset", ["default", "settings", "assisted"])
def test_reading_is_a_part_of_the_run(engine: str, preset: str) -> None:
    problem = tb.Problem(tb.fixed(), duration=1.0)
    origin = tb.engine(engine, preset, timestep=5e-3).simulate(problem).provenance
    assert origin.processor_time is not None and origin.reading_time is not None
    assert 0.0 < origin.reading_time < origin.processor_time
