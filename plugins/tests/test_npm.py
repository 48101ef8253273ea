"""Engines of npm where Node.js is missing: a sentence, and no version."""

from __future__ import annotations

import pytest
import trebucheck as tb


@pytest.mark.parametrize(
    "name", ["planck", "rapier", "jolt", "havok", "physx", "p2", "cannon", "matter"]
)
def test_what_is_missing_is_said(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name not in tb.engines():
        pytest.skip(f"{name} is not installed here")
    body = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    rod = tb.Mechanism(name="rod", bodies=(body,), joints=(pin,), gravity=9.81, start=(0.0,))
    engine = tb.engine(name)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(tb.EngineNotInstalledError, match=r"no program `node` is on the path\.$"):
        engine.simulate(tb.Problem(rod, duration=0.1))
    assert type(engine).version() == "not installed"  # type: ignore[attr-defined]
