"""The committed MJCF in plain MuJoCo: load it, step it, read the sling's limit torque."""

# MuJoCo's bindings carry no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from importlib.resources import files

import mujoco

path = files("trebucheck.models.mjcf") / "fixed" / "scene.xml"
model = mujoco.MjModel.from_xml_path(str(path))
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)  # the start of the throw
while data.time < 1.0:
    mujoco.mj_step(model, data)
mujoco.mj_forward(model, data)  # forces of the state as it stands
for i in range(model.nsensor):
    sensor = model.sensor(i)
    if "torque" in sensor.name:
        print(f"t = {data.time:.3f} s, {sensor.name}: {data.sensordata[sensor.adr[0]]:.1f} N m")
