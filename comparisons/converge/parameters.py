"""What is swept: the time step of every engine, and the parameters that its study names."""

from __future__ import annotations

from ...engines.registry import engine as make
from ...engines.registry import engine_class, engine_names, engine_study
from ...engines.study import StepOrder, SweptParameter
from ...models.errors import InputError

_STEPS = tuple(1e-2 / 2**k for k in range(8))  # 1e-2 to 7.8e-5 s: two decades and a little
_STOCK_STEPS = _STEPS[:6]  # down to 3e-4 s: finer ones are no newcomer's, and cost the most
_UNKNOWN = StepOrder(None, "the order of a plug-in is not known beforehand")


def _timestep(engine: str, preset: str) -> SweptParameter:
    expected = engine_study(engine).step_orders.get(preset, _UNKNOWN)
    return SweptParameter(
        name="timestep", title="time step h", unit="s", options=lambda h: {"timestep": h},
        values=_STEPS if preset == "tuned" else _STOCK_STEPS, expected=expected.order, why=expected.reason,
        preset=preset, repeats=3,
    )  # fmt: skip


def parameter_names() -> tuple[str, ...]:
    """What `--knobs` can ask for."""
    own = [parameter.name for name in engine_names() for parameter in engine_study(name).swept_parameters]
    return tuple(dict.fromkeys(["timestep", *own]))


def swept_parameters(engine: str, names: list[str] | None = None) -> list[SweptParameter]:
    """Every swept parameter of an engine, or those asked for, without those whose options its version does not have.

    Raises:
        InputError: there is no such engine or parameter.
    """
    for name in names or ():
        if name not in parameter_names():
            raise InputError(f"there is no knob {name!r}; there are: {', '.join(parameter_names())}.")
    presets = [preset for preset in ("tuned", "stock") if preset in engine_class(engine).presets()]
    options = set(make(engine, "tuned").settings)
    own = [parameter for parameter in engine_study(engine).swept_parameters if parameter.requires <= options]
    every = [*(_timestep(engine, preset) for preset in presets), *own]
    return [parameter for parameter in every if names is None or parameter.name in names]
