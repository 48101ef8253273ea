"""MuJoCo's own viewer, on the model and the scene that `models export` writes."""

from __future__ import annotations

from ...models.errors import SimulationError
from ...models.mechanism import Mechanism
from ...models.mjcf.scene import scene
from ...models.mjcf.writer import mjcf, model_file
from .build import start_data
from .versions import CALLBACK, mujoco


def view(mechanism: Mechanism, timestep: float) -> None:
    """Open the viewer at the start of the motion, and return when it is closed.

    Args:
        mechanism: any that can be written as MJCF.
        timestep: of the simulation in the viewer [s].

    Raises:
        SimulationError: MuJoCo refuses the model, or cannot open a window.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    from mujoco import viewer

    try:
        with CALLBACK:
            name = model_file(mechanism)
            files = {name: mjcf(mechanism, timestep).encode()}
            model = mujoco.MjModel.from_xml_string(scene(mechanism, name), files)
        viewer.launch(model, start_data(model))
    except (ValueError, RuntimeError) as error:
        raise SimulationError(f"the viewer cannot show {mechanism.name!r}: {error}") from error
