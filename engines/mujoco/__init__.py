"""The MuJoCo adapter. Absolute imports of `mujoco` inside this package mean the library."""
