"""What the author of a plug-in is told about a class that is not finished, and about an error of
first order.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import Barrier, Thread
from typing import Any, ClassVar

import numpy as np
import pytest
import trebucheck as tb
from plugin_engines import Echo
from trebucheck.comparisons.diagnosis.rank import SUFFICIENT
from trebucheck.conformance.verdicts import Deviations
from trebucheck.engines import registry
from trebucheck.engines.protocol import BuiltinEngine, Recording
from trebucheck.engines.registry import ANNOUNCED, announce, engine_class
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.trajectory import PointMotion


class _Named(BuiltinEngine):
    name: ClassVar[str] = "named"

    def _run(self, problem: tb.Problem) -> Recording:
        raise NotImplementedError


class NoCapabilities(_Named):
    package: ClassVar[str] = "numpy"


class WrongCapabilities(_Named):
    package: ClassVar[str] = "numpy"
    capabilities: ClassVar[Any] = {}


class NoPackage(_Named):
    capabilities: ClassVar[tb.Capabilities] = replace(
        Echo.capabilities, joint_reactions=False, stop_torques=False
    )


class OwnVersion(NoPackage):
    name: ClassVar[str] = "own-version"

    @classmethod
    def version(cls) -> str:
        return "1"


class NoPresets:
    name = "no-presets"
    capabilities = Echo.capabilities


class Returning(OwnVersion):
    """Gives whatever it is told to."""

    name: ClassVar[str] = "returning"
    given: ClassVar[Any] = None

    @classmethod
    def is_installed(cls) -> bool:
        return True

    def _run(self, problem: tb.Problem) -> Recording:
        return self.given


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    """What a test announces is known to no other one."""
    monkeypatch.setenv(ANNOUNCED, os.environ.get(ANNOUNCED, ""))


@pytest.mark.parametrize(
    ("cls", "told"),
    [
        ("NoCapabilities", "its class has no `capabilities`; a trebucheck.Capabilities is needed"),
        (
            "WrongCapabilities",
            "its class has capabilities of type dict; a trebucheck.Capabilities is needed",
        ),
        ("NoPackage", "its class has no `package`, the distribution whose version is reported"),
        ("NoPresets", r"its class has no `presets\(\)`"),
    ],
)
def test_a_class_that_lacks_a_member_is_refused_by_its_name(cls: str, told: str) -> None:
    with pytest.raises(tb.InputError, match=told):
        announce(f"{__name__}:{cls}")


class RaisingPresets(OwnVersion):
    @classmethod
    def presets(cls) -> Any:
        raise RuntimeError("no licence")


class NumberOfPresets(OwnVersion):
    @classmethod
    def presets(cls) -> Any:
        return 3


class ExitingVersion(OwnVersion):
    @classmethod
    def version(cls) -> str:
        os._exit(0)


class NoTables(OwnVersion):
    tables: ClassVar[Any] = 3


class PackageOfNone(_Named):
    package: ClassVar[Any] = None
    capabilities: ClassVar[tb.Capabilities] = NoPackage.capabilities


class RaisingOnceMade(OwnVersion):
    name: ClassVar[str] = "raising-once-made"

    def __init__(self, **_: object) -> None:
        raise LookupError("no such device")


@pytest.mark.parametrize(
    ("cls", "told"),
    [
        ("RaisingPresets", r"presets\(\) of its class raises RuntimeError: no licence"),
        ("NumberOfPresets", r"presets\(\) of its class gives 3; makers by name is needed"),
        ("ExitingVersion", r"version\(\) of its class raises SystemExit: 0"),
        ("NoTables", r"study\(\) of its class gives 3"),
        ("PackageOfNone", r"version\(\) of its class raises"),
    ],
)
def test_a_member_that_raises_or_gives_something_else_is_named(cls: str, told: str) -> None:
    with pytest.raises(tb.InputError, match=told):
        announce(f"{__name__}:{cls}")


def test_an_engine_that_cannot_be_made_is_named_with_its_preset() -> None:
    name = announce(f"{__name__}:RaisingOnceMade")
    with pytest.raises(tb.InputError, match=f"{name}.*'assisted': LookupError: no such device"):
        tb.engine(name)


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("import sys; sys.exit(0)", "on import it ends the process, with exit code 0"),
        ("import os; os._exit(0)", "on import it ends the process, with exit code 0"),
        ("raise BaseException('odd')", "BaseException: odd"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("Engine = {}", r"leads to \{\}; a class is needed"),
    ],
)
def test_a_module_that_cannot_be_imported_ends_nothing_and_leaves_the_list(
    source: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The list of engines has it, with its reason, beside all others."""
    (tmp_path / "odd_plug_in.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(ANNOUNCED, "odd=odd_plug_in:Engine")
    with pytest.raises(tb.InputError, match=told):
        engine_class("odd")
    listed = tb.engines()
    assert re.search(told, listed["odd"].broken) and not listed["odd"].installed
    assert not any(status.broken for name, status in listed.items() if name != "odd")


def test_a_path_of_another_form_is_named() -> None:
    with pytest.raises(tb.InputError, match=r"'a b:E' is no path of a class"):
        announce("a b:E")


def test_ending_a_process_is_as_ever_once_all_threads_have_loaded_their_plug_ins() -> None:
    own, inside = os._exit, Barrier(2, timeout=30)

    def load(first: bool) -> None:
        with registry._exit_raised():
            inside.wait()
            assert os._exit is not own
            if not first:
                inside.wait()  # the first has left
        if first:
            assert os._exit is not own
            inside.wait()

    threads = [Thread(target=load, args=(first,)) for first in (True, False)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert os._exit is own and not inside.broken


def test_a_class_with_a_version_of_its_own_needs_no_package() -> None:
    assert announce(f"{__name__}:OwnVersion") == "own-version"


def test_a_class_that_is_not_installed_is_told_where_it_can_be_used() -> None:
    with pytest.raises(tb.InputError, match="is taken by `conform` and `pytest --trebucheck`"):
        engine_class("my_package:MyEngine")


_WHOLE = Recording(
    t=np.linspace(0, 1, 5),
    q=np.zeros((5, 1)),
    u=np.zeros((5, 1)),
    markers={},
    kinetic_energy=np.zeros(5),
    potential_energy=np.zeros(5),
    stop_torques={},
    release_times={},
)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (None, "_run returned NoneType; a Recording is needed"),
        (
            replace(_WHOLE, q=np.zeros(5)),
            r"q has shape \(5,\); \(5, 1\), \(samples, coordinates\), is needed",
        ),
        (replace(_WHOLE, u=np.zeros((1, 5))), r"u has shape \(1, 5\); \(5, 1\)"),
    ],
)
def test_what_a_run_returns_is_refused_with_its_shape(
    given: object, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Returning, "given", given)
    with pytest.raises(tb.SimulationError, match=told):
        Returning().simulate(tb.Problem(mechanism=tb.catapult(), duration=1.0))


def test_one_table_of_a_deviation_is_told_from_a_list_of_them(tmp_path: Any) -> None:
    path = tmp_path / "known.toml"
    path.write_text('[deviation]\nid = "a"\nreason = "b"\nowner = "c"\n')
    with pytest.raises(
        tb.InputError, match=r"deviation is one table; a list of them is needed: \[\[deviation\]\]"
    ):
        Deviations.read(path)


@cache
def _catapult_by_euler(h: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and angle and speed of the catapult at each, by Euler's explicit method at equal steps
    of h [s].
    """
    body, steps = tb.catapult().bodies[0], round(duration / h)
    lever = body.centre[0]
    strength = 9.81 * body.mass * lever / (body.inertia + body.mass * lever**2)
    state = [(tb.catapult().start[0], 0.0)]
    for _ in range(steps):
        q, u = state[-1]
        state.append((q + h * u, u + h * strength * math.cos(q)))
    return h * np.arange(steps + 1), np.array(state)


class Euler(OwnVersion):
    """Of first order, and perhaps with a part of that error which no step takes out.

    The catapult alone.
    """

    name: ClassVar[str] = "euler"
    rest: ClassVar[float] = 0.0

    @classmethod
    def is_installed(cls) -> bool:
        return True

    def _run(self, problem: tb.Problem) -> Recording:
        t, state = _catapult_by_euler(self.timestep, problem.duration)
        coarse_t, coarse = _catapult_by_euler(1e-3, problem.duration)
        fine_t, fine = _catapult_by_euler(1.25e-4, problem.duration)
        state = state.copy()
        for k in range(2):
            state[:, k] += self.rest * (
                np.interp(t, coarse_t, coarse[:, k]) - np.interp(t, fine_t, fine[:, k])
            )
        return self._recording(problem, t, state)

    def _recording(self, problem: tb.Problem, t: np.ndarray, state: np.ndarray) -> Recording:
        q, u, kinematics = state[:, :1], state[:, 1:], Kinematics(problem.mechanism)
        rows = {m.name: kinematics.point(m.body, m.point) for m in problem.mechanism.markers}
        markers = {
            n: PointMotion(kinematics.position(r, q), kinematics.velocity(r, q, u))
            for n, r in rows.items()
        }
        energies = kinematics.kinetic_energy(q, u), kinematics.potential_energy(q)
        return Recording(t, q, u, markers, *energies, stop_torques={}, release_times={})


class EulerAndRest(Euler):
    name: ClassVar[str] = "euler-and-rest"
    rest: ClassVar[float] = 0.07


class TwoOrders(Euler):
    """An error of which 0.6 are of first order in the step and 0.4 of second, as of a soft contact
    and of a rule.
    """

    name: ClassVar[str] = "two-orders"

    def _run(self, problem: tb.Problem) -> Recording:
        t, _ = _catapult_by_euler(self.timestep, problem.duration)
        coarse, fine = (
            np.stack([np.interp(t, times, column) for column in states.T], axis=1)
            for times, states in (_catapult_by_euler(h, problem.duration) for h in (1e-3, 1.25e-4))
        )
        # The shape of both is Euler's own error, c h: what an eighth of the step takes out of it is
        # 7/8.
        error, part = (coarse - fine) * 8 / 7, self.timestep / 1e-3
        return self._recording(problem, t, coarse - error + (0.6 * part + 0.4 * part**2) * error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cls", "all_of_it"), [("Euler", True), ("EulerAndRest", False), ("TwoOrders", True)]
)
def test_an_error_of_first_order_is_that_of_the_step_and_a_part_that_stays_is_not(
    cls: str, all_of_it: bool
) -> None:
    """A step that leaves a part is named with what it takes out."""
    with pytest.raises(AssertionError) as told:
        tb.check(f"{__name__}:{cls}", "catapult", duration=1.0, isolate=False, angle=1e-5)
    share = re.search(r"time step \(.*?\): ([0-9.]+) % of it", str(told.value))
    assert share is not None
    assert (float(share[1]) >= 100 * SUFFICIENT) is all_of_it
