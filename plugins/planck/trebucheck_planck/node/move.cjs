// Moves a scene of build.py by planck.js; the program that calls it says where node_scene.cjs of trebucheck is.
// Of each step it tells the force of each joint on its child and the torque of each stop, >= 0; with `readBack` it moves
// nothing, and tells what the world holds.
"use strict";
const P = require("planck");
const { Scene, run, vector } = require(process.argv[2]);

const WIDE = 1e6; // [rad] a limit that is never met

function makeBody(world, given) {
  const body = world.createDynamicBody({
    position: vector(given.position), linearVelocity: vector(given.velocity), angularVelocity: given.speed,
  });
  body.setMassData({ mass: given.mass, center: { x: 0, y: 0 }, I: given.inertia });
  return body;
}

// A wheel joint slides along its axis and turns. Without a spring planck.js 1.4.2 multiplies by numbers that it has not
// set, and all is NaN: the spring has a frequency whose force is far below rounding.
const NO_SPRING = 1e-9; // [Hz]

const JOINTS = {
  pin: (ends) => new P.RevoluteJoint(ends),
  slide: (ends) => new P.PrismaticJoint(ends),
  slot: (ends) => new P.WheelJoint({ ...ends, frequencyHz: NO_SPRING, dampingRatio: 0 }),
  weld: (ends) => new P.WeldJoint(ends),
};

function makeJoint(bodyA, bodyB, given) {
  const ends = { bodyA, bodyB, localAnchorA: vector(given.pointA), localAnchorB: vector(given.pointB) };
  const axis = given.axis ? { localAxisA: vector(given.axis) } : {};
  return JOINTS[given.kind]({ ...ends, ...axis, referenceAngle: 0 });
}

// The stops of one pin: its limit has one end on each side, at the nearest stop there is. With `hold` a stop that pushes
// is both ends until it would pull, and so are at first those that are closed at the start.
class Limit {
  constructor(joint, stops, hold) {
    Object.assign(this, { joint, stops, hold });
    this.set(hold ? stops.find((stop) => stop.closed) : undefined);
  }

  nearest(side) {
    const own = this.stops.filter((stop) => stop.active && stop.side === side);
    return own.sort((one, other) => side * (other.angle - one.angle))[0];
  }

  set(held) {
    const [low, high] = held ? [held, held] : [1, -1].map((side) => this.nearest(side));
    this.joint.enableLimit(Boolean(low || high));
    this.joint.setLimits(low ? low.angle : -WIDE, high ? high.angle : WIDE);
    this.held = held;
    for (const stop of this.stops) stop.met = held ? stop.angle === held.angle : stop === low || stop === high;
  }

  // Torques of its stops in the step that was taken; under release-once one without is gone for good.
  tell(rate, once) {
    const torque = this.joint.getReactionTorque(rate);
    for (const stop of this.stops) stop.torque = stop.active && stop.met ? Math.max(0, stop.side * torque) : 0;
    const gone = this.stops.filter((stop) => once && stop.active && !stop.torque);
    for (const stop of gone) stop.active = false;
    const held = this.hold ? this.stops.find((stop) => stop.torque) : undefined;
    if (gone.length || held !== this.held) this.set(held);
  }
}

class PlanckScene extends Scene {
  constructor(given) {
    super(given);
    P.Settings.linearSlop = given.linearSlop;
    P.Settings.angularSlop = given.angularSlop;
    this.world = new P.World({ gravity: vector(given.gravity), allowSleep: given.allowSleep, continuousPhysics: false });
    this.ground = this.world.createBody();
    this.bodies = given.bodies.map((body) => makeBody(this.world, body));
    this.joints = given.joints.map((joint) =>
      this.world.createJoint(makeJoint(this.body(joint.a), this.body(joint.b), joint)));
    this.limits = [...new Set(this.stops.map((stop) => stop.joint))].map((index) =>
      new Limit(this.joints[index], this.stops.filter((stop) => stop.joint === index), given.hold));
    this.velocityIterations = given.firstIterations;
  }

  read(body) {
    const c = body.getWorldCenter(), v = body.getLinearVelocity();
    return [c.x, c.y, body.getAngle(), v.x, v.y, body.getAngularVelocity()];
  }

  apply(body, force, torque) {
    body.applyForceToCenter(force, true);
    body.applyTorque(torque, true);
  }

  // Impulses begin with those of the step before, which the first one has not.
  advance() {
    this.world.step(this.given.timestep, this.velocityIterations, this.given.positionIterations);
    this.velocityIterations = this.given.velocityIterations;
  }

  told() {
    const rate = 1 / this.given.timestep;
    for (const limit of this.limits) limit.tell(rate, this.given.once);
    const told = [];
    for (const joint of this.joints) {
      const force = joint.getReactionForce(rate);
      told.push(force.x, force.y);
    }
    for (const stop of this.stops) told.push(stop.torque);
    return told;
  }

  samples() { return this.given.readBack ? Float64Array.from(this.sample().concat(this.readBack())) : super.samples(); }

  // What the world holds: mass, inertia and centre of each body, anchors and axis of each joint, gravity.
  readBack() {
    const pair = ({ x, y }) => [x, y];
    const bodies = this.bodies.flatMap((body) => [body.getMass(), body.getInertia(), ...pair(body.getLocalCenter())]);
    const joints = this.joints.flatMap((joint) => [joint.getLocalAnchorA(), joint.getLocalAnchorB(),
      joint.getLocalAxisA ? joint.getLocalAxisA() : { x: 0, y: 0 }].flatMap(pair));
    return [...bodies, ...joints, ...pair(this.world.getGravity())];
  }
}

run((given) => new PlanckScene(given));
