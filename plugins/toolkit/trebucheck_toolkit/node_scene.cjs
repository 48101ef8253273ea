// What programs share that move a scene of node_scene.py: they read it as JSON from standard input and write samples to
// standard output, [sample][6 of each body: x, y, angle, vx, vy, speed; then what is told of the step that begins
// there]. Every body stands at the angle 0 at the start and has its origin at its centre of mass; y points downwards.
"use strict";
const fs = require("fs");

const vector = ([x, y]) => ({ x, y });

// A subclass makes this.ground and this.bodies, and has
//   read(body, index) -> [x, y, angle, vx, vy, speed], the angle counted on through full turns
//   apply(body, force, torque), for one step
//   advance(), one step of the engine
//   told() -> numbers, of the step that was taken; may be left out
class Scene {
  constructor(given) {
    this.given = given;
    this.stops = given.stops.map((stop) => ({ ...stop, active: true }));
  }

  body(index) { return index < 0 ? this.ground : this.bodies[index]; }

  state(index) { return index < 0 ? [0, 0, 0, 0, 0, 0] : this.read(this.bodies[index], index); }

  angle(index) { return this.state(index)[2]; }

  between({ a, b }) { return this.angle(b) - this.angle(a); }

  // A point of a body: its arm from the centre of mass, its place and its velocity.
  point(index, offset) {
    const [x, y, angle, vx, vy, speed] = this.state(index);
    const cos = Math.cos(angle), sin = Math.sin(angle);
    const arm = [cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1]];
    return { arm, at: [x + arm[0], y + arm[1]], velocity: [vx - speed * arm[1], vy + speed * arm[0]] };
  }

  push(index, arm, force, sign) {
    if (index < 0) return;
    const torque = sign * (arm[0] * force[1] - arm[1] * force[0]);
    this.apply(this.bodies[index], { x: sign * force[0], y: sign * force[1] }, torque);
  }

  turn(index, torque) { if (index >= 0) this.apply(this.bodies[index], { x: 0, y: 0 }, torque); }

  load(e) {
    if (e.kind === "constant-force") this.push(e.body, this.point(e.body, e.point).arm, e.force, 1);
    else if (e.kind === "spring-damper") this.pull(e, this.point(e.body, e.point), this.point(e.other, e.otherPoint));
    else {
      const angle = this.angle(e.body) - this.angle(e.other);
      const speed = this.state(e.body)[5] - this.state(e.other)[5];
      const torque = e.torque - e.stiffness * (angle - e.rest) - e.damping * speed;
      this.turn(e.body, torque);
      this.turn(e.other, -torque);
    }
  }

  pull(e, own, other) {
    const away = own.at.map((x, i) => x - other.at[i]), length = Math.hypot(...away) || Infinity;
    const along = away.map((x) => x / length);
    const rate = along.reduce((sum, x, i) => sum + x * (own.velocity[i] - other.velocity[i]), 0);
    const force = along.map((x) => -x * (e.stiffness * (Math.hypot(...away) - e.rest) + e.damping * rate));
    this.push(e.body, own.arm, force, 1);
    this.push(e.other, other.arm, force, -1);
  }

  told() { return []; }

  // A step; what it tells belongs to the sample at which it begins.
  step() {
    for (const element of this.given.loads) this.load(element);
    this.advance();
    return this.told();
  }

  sample() { return this.bodies.flatMap((body, i) => this.read(body, i)); }

  // One step more than there are samples to come, for the forces of the last one.
  samples() {
    const { steps } = this.given, first = this.sample().concat(this.step());
    const width = first.length, out = new Float64Array(width * (steps + 1));
    out.set(first);
    for (let k = 1, at = width; k <= steps; k++) {
      for (let i = 0; i < this.bodies.length; i++, at += 6) out.set(this.read(this.bodies[i], i), at);
      const told = this.step();
      out.set(told, at);
      at += told.length;
    }
    return out;
  }
}

// At once: what process.stdout is given may wait for what V8 compiles.
function writeBytes(bytes) {
  for (let at = 0; at < bytes.length;) at += fs.writeSync(1, bytes, at);
}

// Arrays by name, each with its shape and numbers: a line of JSON with the shapes, then the numbers, little-endian
// float64.
function write(arrays) {
  const shapes = Object.entries(arrays).map(([name, { shape }]) => [name, shape]);
  writeBytes(Buffer.from(JSON.stringify(Object.fromEntries(shapes)) + "\n"));
  for (const { numbers } of Object.values(arrays)) writeBytes(Buffer.from(numbers.buffer));
}

// Nested arrays, all those of a depth of one length, as `write` takes them.
function flat(nested) {
  const shape = (values) => Array.isArray(values) ? [values.length, ...shape(values[0] ?? 0)] : [];
  return { shape: shape(nested), numbers: new Float64Array(nested.flat(Infinity)) };
}

async function run(make) {
  try {
    const scene = await make(JSON.parse(fs.readFileSync(0, "utf8")));
    const numbers = scene.samples(), rows = scene.given.steps + 1;
    write({ samples: { shape: [rows, numbers.length / rows], numbers } });
  } catch (error) {
    console.error(String(error));
    process.exitCode = 1;
  }
}

module.exports = { Scene, flat, run, vector, write };
