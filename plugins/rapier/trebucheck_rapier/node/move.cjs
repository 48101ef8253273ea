// Reads one scene as JSON from standard input, moves it by Rapier 2D, and writes its samples to standard output:
// little-endian float64, [sample][body][x, y, angle, vx, vy, speed]. Scenes are made by build.py: every body stands
// at the angle 0 at the start and has its origin at its centre of mass; y points downwards.
"use strict";
const R = require("@dimforge/rapier2d-compat");

const vector = ([x, y]) => ({ x, y });

function makeBody(world, given) {
  return world.createRigidBody(
    R.RigidBodyDesc.dynamic()
      .setTranslation(...given.position)
      .setLinvel(...given.velocity)
      .setAngvel(given.speed)
      .setCanSleep(false)
      .setAdditionalMassProperties(given.mass, { x: 0, y: 0 }, given.inertia));
}

const JOINTS = {
  pin: (j) => R.JointData.revolute(vector(j.pointA), vector(j.pointB)),
  slide: (j) => R.JointData.prismatic(vector(j.pointA), vector(j.pointB), vector(j.axis)),
  weld: (j) => R.JointData.fixed(vector(j.pointA), 0, vector(j.pointB), 0),
};

// Rapier knows the angle of a pin within half a turn only. The nearest of its stops is put at the angle 0 of the
// joint's frames, and the limit is on while the joint is within a quarter turn of it.
class Limit {
  constructor(world, joint, stops) {
    Object.assign(this, { world, joint, stops, set: undefined });
  }

  update(angle) {
    const away = (stop) => Math.abs(angle - stop.angle);
    const near = this.stops.filter((stop) => stop.active && away(stop) < Math.PI / 2);
    const [nearest] = near.sort((a, b) => away(a) - away(b));
    if (nearest === this.set) return;
    this.set = nearest;
    if (!nearest) {
      this.joint.setLimits(-Math.PI, Math.PI);
      return;
    }
    const frame = R.RotationOps.intoRaw(-nearest.angle);
    this.world.impulseJoints.raw.jointSetFrameX2(this.joint.handle, frame);
    frame.free();
    this.joint.setLimits(nearest.side > 0 ? 0 : -Math.PI, nearest.side > 0 ? Math.PI : 0);
  }
}

class Scene {
  constructor(given) {
    this.given = given;
    this.world = new R.World(vector(given.gravity));
    this.world.timestep = given.timestep;
    this.world.numSolverIterations = given.substeps;
    this.world.numInternalPgsIterations = given.passes;
    this.ground = this.world.createRigidBody(R.RigidBodyDesc.fixed());
    this.bodies = given.bodies.map((body) => makeBody(this.world, body));
    this.angles = given.bodies.map(() => 0);
    const joints = given.joints.map((joint) =>
      this.world.createImpulseJoint(JOINTS[joint.kind](joint), this.body(joint.a), this.body(joint.b), true));
    this.stops = given.stops.map((stop) => ({ ...stop, active: true }));
    this.limits = [...new Set(this.stops.map((stop) => stop.joint))].map((index) => ({
      joint: given.joints[index],
      limit: new Limit(this.world, joints[index], this.stops.filter((stop) => stop.joint === index)),
    }));
    this.updateLimits();
  }

  body(index) { return index < 0 ? this.ground : this.bodies[index]; }

  angle(index) { return index < 0 ? 0 : this.angles[index]; }

  between({ a, b }) { return this.angle(b) - this.angle(a); }

  // Under release-once a stop is gone for good once its gap exceeds `opening` [rad].
  updateLimits() {
    for (const stop of this.given.once ? this.stops : []) {
      const gap = stop.side * (this.between(this.given.joints[stop.joint]) - stop.angle);
      if (gap > this.given.opening) stop.active = false;
    }
    for (const { joint, limit } of this.limits) limit.update(this.between(joint));
  }

  // A point of a body: its arm from the centre of mass, its place and its velocity.
  point(index, offset) {
    if (index < 0) return { arm: [0, 0], at: offset, velocity: [0, 0] };
    const own = this.bodies[index], c = own.translation(), v = own.linvel(), w = own.angvel();
    const cos = Math.cos(this.angles[index]), sin = Math.sin(this.angles[index]);
    const arm = [cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1]];
    return { arm, at: [c.x + arm[0], c.y + arm[1]], velocity: [v.x - w * arm[1], v.y + w * arm[0]] };
  }

  // The torque is the arm's, not Rapier's addForceAtPoint: before its first step that takes the world's origin for the
  // centre of mass.
  push(index, arm, force, sign) {
    if (index < 0) return;
    this.bodies[index].addForce({ x: sign * force[0], y: sign * force[1] }, true);
    this.bodies[index].addTorque(sign * (arm[0] * force[1] - arm[1] * force[0]), true);
  }

  turn(index, torque) { if (index >= 0) this.bodies[index].addTorque(torque, true); }

  speed(index) { return index < 0 ? 0 : this.bodies[index].angvel(); }

  load(e) {
    if (e.kind === "constant-force") this.push(e.body, this.point(e.body, e.point).arm, e.force, 1);
    else if (e.kind === "spring-damper") this.pull(e, this.point(e.body, e.point), this.point(e.other, e.otherPoint));
    else {
      const angle = this.angle(e.body) - this.angle(e.other), speed = this.speed(e.body) - this.speed(e.other);
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

  step() {
    for (const body of this.given.loads.length ? this.bodies : []) {
      body.resetForces(true);
      body.resetTorques(true);
    }
    for (const element of this.given.loads) this.load(element);
    this.world.step();
    this.bodies.forEach((body, i) => {
      const turns = (body.rotation() - this.angles[i]) / (2 * Math.PI);
      this.angles[i] += (turns - Math.round(turns)) * 2 * Math.PI;
    });
    this.updateLimits();
  }

  write(out, at) {
    this.bodies.forEach((body, i) => {
      const c = body.translation(), v = body.linvel();
      out.set([c.x, c.y, this.angles[i], v.x, v.y, body.angvel()], at + 6 * i);
    });
  }
}

async function main() {
  await R.init({});
  const given = JSON.parse(require("fs").readFileSync(0, "utf8"));
  const scene = new Scene(given), width = 6 * given.bodies.length;
  const out = new Float64Array(width * (given.steps + 1));
  scene.write(out, 0);
  for (let k = 1; k <= given.steps; k++) {
    scene.step();
    scene.write(out, k * width);
  }
  process.stdout.write(Buffer.from(out.buffer));
}

main().catch((error) => {
  console.error(String(error));
  process.exitCode = 1;
});
