"""Tests for the processor time of a run and the part of it that is reading."""

import json
import time
from collections.abc import Callable

import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.record import EngineRuns, RunRecord
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.engines.reading import clocked, read_each_step, timed_reading
from trebucheck.models.trajectory import Trajectory, from_dataset


def _work(seconds: float) -> None:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_reading_is_counted_once_where_its_blocks_are_nested() -> None:
    with clocked() as clock:
        _work(0.02)
        with timed_reading():
            with timed_reading():
                _work(0.02)
            _work(0.01)
        assert clock.reading is not None
        assert 0.03 <= clock.reading <= clock.elapsed() - 0.02


def test_a_run_that_tells_no_reading_apart_has_none() -> None:
    with clocked() as clock:
        _work(0.001)
    assert clock.reading is None and clock.elapsed() >= 0.001


def test_reading_outside_of_a_run_is_not_counted_to_the_last_one() -> None:
    with clocked() as clock:
        pass
    with timed_reading():
        _work(0.001)
    assert clock.reading is None


def _read_in_steps(steps: int, read: Callable[[], None]) -> float | None:
    with clocked() as clock:
        each = read_each_step(read)
        for _ in range(steps):
            each()
    return clock.reading


def test_readings_of_single_steps_are_all_made_and_a_part_of_them_stands_for_all() -> None:
    made: list[int] = []

    def read() -> None:
        made.append(0)
        _work(50e-6)

    counted = _read_in_steps(640, read)
    assert len(made) == 640
    # A step's reading may be interrupted, and takes a call of the clock longer than is asked for.
    assert counted is not None and 640 * 50e-6 <= counted < 640 * 200e-6


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return tb.engine("reference").simulate(tb.Problem(tb.model("pendulum"), duration=0.5))


def test_the_times_of_a_run_are_kept_in_its_file(run: Trajectory) -> None:
    origin = run.provenance
    assert origin.processor_time is not None and origin.reading_time is not None
    assert 0.0 < origin.reading_time < origin.processor_time
    assert origin.cost == origin.processor_time - origin.reading_time
    assert from_dataset(run.to_dataset()).provenance == origin


def test_a_file_without_processor_times_is_read(run: Trajectory) -> None:
    dataset = run.to_dataset()
    origin = json.loads(dataset.attrs["provenance"])
    del origin["processor_time"], origin["reading_time"]
    dataset.attrs["provenance"] = json.dumps(origin)
    old = from_dataset(dataset).provenance
    assert (old.processor_time, old.reading_time, old.cost) == (None, None, None)
    # What was not measured is not written either: files without it stay as they are.
    assert json.loads(from_dataset(dataset).to_dataset().attrs["provenance"]) == origin


def test_each_repeat_has_its_processor_times() -> None:
    runs = EngineRuns(Runner(tb.model("pendulum")))
    record = runs.record(tb.engine("reference", timestep=0.01), repeats=3)
    assert len(record.processor_times) == len(record.reading_times) == len(record.wall_times) == 3
    for cost, whole in zip(record.costs, record.processor_times, strict=True):
        assert 0.0 < cost < whole
    old = record.model_dump(mode="json", exclude={"processor_times", "reading_times"})
    assert RunRecord.model_validate(old).costs == ()
