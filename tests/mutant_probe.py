"""Every value of a few comparisons, as JSON without times: whether a mutant changes anything."""

from __future__ import annotations

import json
import warnings
from typing import Any

import trebucheck as tb

warnings.simplefilter("ignore")
MODELS = ("fixed", "slider-crank", "stopped-pendulum", "oscillator")


def without_times(value: Any) -> Any:
    """The same JSON value without what differs from run to run."""
    if isinstance(value, dict):
        return {
            k: without_times(v) for k, v in value.items() if "wall" not in k and "time" not in k
        }
    return [without_times(v) for v in value] if isinstance(value, list) else value


if __name__ == "__main__":
    for models in MODELS:
        comparison = tb.compare([models])
        print(json.dumps(without_times(json.loads(comparison.to_json())), sort_keys=True))
