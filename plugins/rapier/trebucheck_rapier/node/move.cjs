// Moves a scene of build.py by Rapier 2D; the program that calls it says where node_scene.cjs of trebucheck is.
"use strict";
const R = require("@dimforge/rapier2d-compat");
const { Scene, run, vector } = require(process.argv[2]);

function makeBody(world, given, canSleep) {
  return world.createRigidBody(
    R.RigidBodyDesc.dynamic()
      .setTranslation(...given.position)
      .setLinvel(...given.velocity)
      .setAngvel(given.speed)
      .setCanSleep(canSleep)
      .setAdditionalMassProperties(given.mass, { x: 0, y: 0 }, given.inertia));
}

const JOINTS = {
  pin: (j) => R.JointData.revolute(vector(j.pointA), vector(j.pointB)),
  slide: (j) => R.JointData.prismatic(vector(j.pointA), vector(j.pointB), vector(j.axis)),
  weld: (j) => R.JointData.fixed(vector(j.pointA), 0, vector(j.pointB), 0),
};

// Rapier knows the angle of a pin within half a turn only. The nearest of its stops is put at the angle 0 of the
// joint's frames, and the limit is on while the joint is within a quarter turn of it.
// With `move` false all its stops are set as they are, from the joint's angle at the start.
class Limit {
  constructor(world, joint, stops, move) {
    Object.assign(this, { world, joint, stops, move, set: undefined });
  }

  setAll() {
    const active = this.stops.filter((stop) => stop.active);
    if (active.length === this.set) return;
    this.set = active.length;
    const ends = (side) => active.filter((stop) => stop.side === side).map((stop) => stop.angle);
    this.joint.setLimits(Math.max(-Math.PI, ...ends(1)), Math.min(Math.PI, ...ends(-1)));
  }

  update(angle) {
    if (!this.move) {
      this.setAll();
      return;
    }
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

class RapierScene extends Scene {
  constructor(given) {
    super(given);
    this.world = new R.World(vector(given.gravity));
    this.world.timestep = given.timestep;
    this.world.numSolverIterations = given.substeps;
    this.world.numInternalPgsIterations = given.passes;
    this.ground = this.world.createRigidBody(R.RigidBodyDesc.fixed());
    this.bodies = given.bodies.map((body) => makeBody(this.world, body, given.canSleep));
    this.angles = given.bodies.map(() => 0);
    const joints = given.joints.map((joint) =>
      this.world.createImpulseJoint(JOINTS[joint.kind](joint), this.body(joint.a), this.body(joint.b), true));
    this.limits = [...new Set(this.stops.map((stop) => stop.joint))].map((index) => ({
      joint: given.joints[index],
      limit: new Limit(this.world, joints[index], this.stops.filter((stop) => stop.joint === index), given.moveLimits),
    }));
    this.updateLimits();
  }

  read(body, index) {
    const c = body.translation(), v = body.linvel();
    return [c.x, c.y, this.angles[index], v.x, v.y, body.angvel()];
  }

  // The torque is given beside the force, not by Rapier's addForceAtPoint: before its first step that takes the world's
  // origin for the centre of mass.
  apply(body, force, torque) {
    body.addForce(force, true);
    body.addTorque(torque, true);
  }

  // Under release-once a stop is gone for good once its gap exceeds `opening` [rad].
  updateLimits() {
    for (const stop of this.given.once ? this.stops : []) {
      const gap = stop.side * (this.between(this.given.joints[stop.joint]) - stop.angle);
      if (gap > this.given.opening) stop.active = false;
    }
    for (const { joint, limit } of this.limits) limit.update(this.between(joint));
  }

  advance() {
    this.world.step();
    this.bodies.forEach((body, i) => {
      const turns = (body.rotation() - this.angles[i]) / (2 * Math.PI);
      this.angles[i] += (turns - Math.round(turns)) * 2 * Math.PI;
    });
    for (const body of this.given.loads.length ? this.bodies : []) {
      body.resetForces(true);
      body.resetTorques(true);
    }
    this.updateLimits();
  }
}

run(async (given) => {
  await R.init({});
  return new RapierScene(given);
});
