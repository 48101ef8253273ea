"""One throw by the reference: opening times of the stops, launch speed and range."""

from __future__ import annotations

import math

import trebucheck as tb

# SI units; the paper's Table I where nothing is given.
machine = tb.rolling(tb.TrebuchetParameters(l1=9.5))
throw = tb.throw(machine, best=True)

print(f"{machine.name} machine, l1 = 9.5 m")
for stop in throw.rests:
    opens = "stays closed" if stop.release_time is None else f"opens at {stop.release_time:.6f} s"
    print(f"  {stop.name} {opens}")
print(
    f"  launch at {throw.launch.time:.6f} s, {throw.launch.speed:.3f} m/s, "
    f"{math.degrees(throw.launch.angle):.2f} deg"
)
print(f"  range {throw.flight.range:.2f} m")
