"""Values of comparisons, judgements, diagnoses and engines' runs are the recorded ones.

`tests/recorded.py` tells which, and records them anew.
"""

from __future__ import annotations

import pytest
import recorded
from trebucheck.engines.registry import engine_class

MEASURED = 3e-4
"""Five digits are recorded; the last may be another on another machine."""


@pytest.mark.parametrize("name", recorded.CASES)
def test_values_are_the_recorded_ones(name: str) -> None:
    engine = name.split("-")[1]
    if name.startswith("runs") and not engine_class(engine).is_installed():
        pytest.skip(f"{engine} is not installed here")
    found, expected = recorded.values(name), recorded.recorded(name)
    assert len(expected) > 20
    assert len(found) == len(expected), "record them anew if that is meant: tests/recorded.py"
    for k, (new, old) in enumerate(zip(found, expected, strict=True)):
        if isinstance(new, float) and isinstance(old, float):
            assert new == pytest.approx(old, rel=MEASURED, abs=10 * recorded.LEAST), (k, name)
        else:
            assert new == old, (k, name)


def test_every_record_is_of_a_case() -> None:
    assert {path.stem for path in recorded.FOLDER.iterdir()} == set(recorded.CASES)
