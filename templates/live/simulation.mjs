// A robot over time: drives, loads and what carries it, held over a period each; the kernel does the steps between.

import { turned } from "#live/poses";
import { cycleAt, signalAt, wavesAt } from "#live/signals";

const FILTER = 8; // rad/s with which the reference follows a target that was set

/** Copy as many numbers as the first array has. */
const fill = (to, from) => { for (let i = 0; i < to.length; i++) to[i] = from[i]; };

export class Simulation {
  /**
   * kernel: of the robot, as its module loads it; rigid: of the rigid robot that drives know, or null.
   * data: see `export/live/contents.py`, which writes it.
   */
  constructor(kernel, rigid, data) {
    this.kernel = kernel;
    this.rigid = rigid;
    this.data = data;
    this.n = data.coordinates.length;
    this.forces = data.beside.filter((place) => place >= this.n).length; // beside drives with states, behind u
    this.index = new Map(data.coordinates.map((name, i) => [name, i]));
    this.period = data.period;
    this.method = data.method;
    this.rtol = data.rtol;
    this.gains = data.drives.map(({ kp, kd }) => ({ kp, kd }));
    this.targets = data.drives.map((drive) => drive.start);
    this.inputs = (data.inputs ?? []).map((input) => input.start); // of servo drives that nothing else gives: V, A, rad, ...
    this.waves = data.prescribed ? structuredClone(data.prescribed) : null;
    this.drive = data.drive; // "program", "cycle", "target" or "none"
    this.compensates = data.compensates; // whether a model is asked for what the motion takes
    this.known = { ...kernel.parameters };
    this.payload = 0;
    this.push = null; // { link, point (link's frame), force (base frame) }
    this.events = data.events ?? [];
    this.work = 0;
    this.reset();
  }

  /** Begin anew: at the start, or in a state, which may be the simulation's own. */
  reset(state = this.data.start) {
    this.t = state.t ?? 0;
    this.q = Float64Array.from(state.q);
    this.v = Float64Array.from(state.v);
    this.z = Float64Array.from(state.z); // internal states
    this.work = 0;
    this.cycleFrom = this.t;
    this.approach = null;
    const { drives } = this.data;
    this.reference = [drives.map((d) => this.q[d.place] / d.ratio), drives.map(() => 0), drives.map(() => 0)];
    if (this.waves) this.carry();
    this.carried = -1;
    this.apply();
    this.energy0 = this.total();
  }

  /** Set a run-time parameter, N, m, kg, rad; gravity is known to the drives' model, too. */
  set(name, value) {
    this.known[name] = value;
    this.apply();
  }

  /** All parameters to the kernels: those that were set, with what is carried. */
  apply() {
    const values = { ...this.known };
    this.carried = this.events.filter(({ t }) => t <= this.t + 1e-12).length;
    if (this.carried) Object.assign(values, this.events[this.carried - 1].parameters);
    if (this.data.payload && this.payload > 0) Object.assign(values, this.loaded(values));
    this.kernel.set(values);
    this.current = values;
    if (this.rigid) {
      const shared = Object.keys(this.rigid.parameters).filter((name) => name in this.known);
      this.rigid.set(Object.fromEntries(shared.map((name) => [name, this.known[name]])));
    }
  }

  /** Mass, centre of mass and inertia of the link with a point mass at the tool, by parameters. */
  loaded(values) {
    const { link, point } = this.data.payload, key = (part) => `links.${link}.${part}`;
    const m = values[key("mass")], M = this.payload, sum = m + M;
    const com = ["x", "y", "z"].map((axis) => values[key(`com.${axis}`)]);
    const d = point.map((x, i) => x - com[i]), part = (m * M) / sum, dd = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    const found = { [key("mass")]: sum };
    ["x", "y", "z"].forEach((axis, i) => {
      found[key(`com.${axis}`)] = com[i] + (M / sum) * d[i];
      found[key(`inertia.${axis}${axis}`)] = values[key(`inertia.${axis}${axis}`)] + part * (dd - d[i] * d[i]);
    });
    for (const [pair, i, j] of [["xy", 0, 1], ["xz", 0, 2], ["yz", 1, 2]]) {
      found[key(`inertia.${pair}`)] = values[key(`inertia.${pair}`)] - part * d[i] * d[j];
    }
    return found;
  }

  /** Coordinates, rates and accelerations that the drives are to follow at a time; of joints, in the drives' order. */
  program(t) {
    if (this.drive === "program" && this.data.program) return signalAt(this.data.program, t);
    if (this.drive === "cycle") {
      const { cycle } = this.data, since = t - this.cycleFrom;
      if (since >= 0 || !this.approach) return cycleAt(cycle, since);
      return cycleAt({ ...cycle, start: this.approach, goal: cycle.start, pause: 0 }, Math.max(since + cycle.duration, 0));
    }
    return this.reference;
  }

  /** The reference goes on by a period: it follows targets smoothly, and what programs say exactly. */
  lead(h) {
    if (this.drive !== "target" && this.drive !== "none") {
      this.reference = this.program(this.t + h).map((x) => x.slice());
      return;
    }
    const [q, v, a] = this.reference, decay = Math.exp(-FILTER * h);
    this.targets.forEach((target, i) => { // critically damped, exactly for a target that stays
      const e = q[i] - target, b = v[i] + FILTER * e;
      q[i] = target + (e + b * h) * decay;
      v[i] = (b - FILTER * (e + b * h)) * decay;
      a[i] = FILTER * FILTER * (target - q[i]) - 2 * FILTER * v[i];
    });
  }

  /** From now on the drives hold what they are at. */
  hold() {
    const [q] = this.program(this.t);
    this.reference = [q.slice(), q.map(() => 0), q.map(() => 0)];
    this.targets = q.slice();
    this.drive = "target";
  }

  /** From now on they go to and fro, once they are where that begins. */
  tour() {
    const { cycle } = this.data;
    this.approach = this.program(this.t)[0].slice();
    const far = this.approach.some((x, i) => Math.abs(x - cycle.start[i]) > 1e-9);
    this.drive = "cycle";
    this.cycleFrom = this.t + (far ? cycle.duration : 0);
  }

  /** Prescribed coordinates to where their motions are. */
  carry() {
    const [q, v] = wavesAt(this.waves, this.t);
    this.waves.place.forEach((to, i) => { [this.q[to], this.v[to]] = [q[i], v[i]]; });
  }

  /** Forces of drives and loads in the state of now, for a time; with the kernel's gains and target. */
  drives(t) {
    const { n, data } = this, u = new Float64Array(n + this.forces);
    let kp, kd, target;
    const [qd, vd, ad] = this.program(t);
    if (this.drive === "program" && data.torque) {
      const [forces] = signalAt(data.torque.signal, t);
      data.torque.place.forEach((to, i) => { u[to] += forces[i]; });
    }
    (data.inputs ?? []).forEach(({ place }, i) => { u[place] += this.inputs[i]; });
    if (this.drive !== "none" && data.control !== "none") {
      if (data.control === "reference") { // servo drives control by themselves, at the shaft
        data.drives.forEach(({ place, ratio, rate }, i) => { u[place] += (rate ? vd[i] : qd[i]) * ratio; });
      }
      if (data.control === "pd") {
        [kp, kd, target] = [new Float64Array(n), new Float64Array(n), new Float64Array(n)];
        data.drives.forEach(({ place, ratio }, i) => {
          kp[place] = this.gains[i].kp / (ratio * ratio);
          kd[place] = this.gains[i].kd / (ratio * ratio);
          target[place] = qd[i] * ratio;
          u[place] += (this.gains[i].kd * vd[i]) / ratio;
        });
        (data.holding ?? []).forEach((force, i) => { u[i] += force; });
      }
      if (data.model && this.compensates) this.model(u, t, qd, vd, ad);
    }
    if (this.waves) {
      const accelerations = wavesAt(this.waves, t)[2];
      this.waves.place.forEach((to, i) => { u[to] = accelerations[i]; });
    }
    this.loads(u, t);
    return { u: u.subarray(0, n), forces: u.subarray(n), kp, kd, target };
  }

  /** Add what the model of the rigid robot says: computed torque, or what gravity (and the programmed motion) takes. */
  model(u, t, qd, vd, ad) {
    const { place, ratio, column, given, bandwidth, driven } = this.data.model, size = place.length;
    const q = new Float64Array(size), v = new Float64Array(size), a = new Float64Array(size);
    const carried = this.waves ? wavesAt(this.waves, t) : null;
    for (let i = 0; i < size; i++) {
      const c = column[i] >= 0 ? column[i] : driven.indexOf(i), ahead = t - this.t;
      v[i] = this.v[place[i]] / ratio[i];
      q[i] = this.q[place[i]] / ratio[i] + ahead * v[i]; // in the middle of the period, as the program is
      if (c >= 0) v[i] += ahead * ad[c];
      if (column[i] >= 0 && bandwidth > 0) a[i] = ad[c] + bandwidth * (bandwidth * (qd[c] - q[i]) + 2 * (vd[c] - v[i]));
      else if (given[i] >= 0 && carried) a[i] = carried[2][given[i]] / ratio[i];
    }
    if (!(bandwidth > 0)) {
      v.fill(0);
      if (this.drive !== "program") {
        driven.forEach((i, c) => { [v[i], a[i]] = [vd[c], ad[c]]; });
      }
    }
    const forces = this.rigid.inverseDynamics(q, v, a);
    for (let i = 0; i < size; i++) if (column[i] >= 0 || (!(bandwidth > 0) && given[i] < 0)) u[place[i]] += forces[i] / ratio[i];
  }

  /** Add the forces of wrenches, and of who pushes. */
  loads(u, t) {
    const wrenches = (this.data.wrenches ?? []).filter(({ t0 = -Infinity, t1 = Infinity }) => t0 <= t && t < t1);
    if (this.drive === "target" || this.drive === "cycle") wrenches.length = 0;
    if (!wrenches.length && !this.push) return;
    const links = this.data.moving, wrench = new Float64Array(6 * links.length);
    for (const { link, signal, arm, turns } of wrenches) {
      const row = signalAt(signal, t)[0], pose = this.kernel.framePose(this.q, link);
      this.put(wrench, links.indexOf(link), turns ? turned(pose, row.slice(0, 3)) : row.slice(0, 3), turned(pose, arm),
        turns ? turned(pose, row.slice(3)) : row.slice(3));
    }
    if (this.push) {
      const { link, point, force } = this.push, k = links.indexOf(link);
      if (k >= 0) {
        const com = this.data.com[link].map((x, i) => this.current[`links.${link}.com.${"xyz"[i]}`] ?? x);
        const pose = this.kernel.framePose(this.q, link);
        this.put(wrench, k, force, turned(pose, point.map((x, i) => x - com[i])), [0, 0, 0]);
      }
    }
    const forces = this.kernel.externalForce(this.q, wrench);
    for (let i = 0; i < forces.length; i++) u[this.data.beside[i]] += forces[i];
  }

  /** Add a force at an arm (base frame) and a moment to a link's row of wrenches. */
  put(wrench, k, force, arm, moment) {
    const turning = [
      arm[1] * force[2] - arm[2] * force[1],
      arm[2] * force[0] - arm[0] * force[2],
      arm[0] * force[1] - arm[1] * force[0],
    ];
    for (let i = 0; i < 3; i++) {
      wrench[6 * k + i] += force[i];
      wrench[6 * k + 3 + i] += moment[i] + turning[i];
    }
  }

  /** One period, s, with drives and loads of its middle; throws where the kernel finds no step that leads on. */
  tick() {
    const h = this.period;
    if (this.events.filter(({ t }) => t <= this.t + 1e-12).length !== this.carried) this.apply();
    if (this.drive === "target" || this.drive === "none") this.lead(h);
    const { u, forces, kp, kd, target } = this.drives(this.t + 0.5 * h), { z } = this;
    const controlled = target ? { kp, kd, target } : {}; // joints that turn freely do so without gains alone
    const how = { duration: h, samples: 1, rtol: this.rtol, method: this.method, z, forces, ...controlled };
    const found = this.kernel.adaptiveRollout(this.q, this.v, u, how);
    for (const name of ["q", "v", "z"]) fill(this[name], found[name].subarray(this[name].length));
    this.t += h;
    if (this.drive !== "target" && this.drive !== "none") this.lead(0);
    if (this.waves) this.carry();
  }

  /** Whole periods up to a time, s, but for no longer than `budget` ms of the clock; returns whether it got there. */
  advance(until, budget = Infinity, clock = () => performance.now()) {
    const begin = clock();
    while (this.t + this.period <= until + 1e-9) {
      if (clock() - begin > budget) return false;
      this.tick();
    }
    return true;
  }

  /** The rigid robot's coordinates: deviations are zero; on the program, or at what the principal ones are. */
  stiff(onProgram) {
    const q = Float64Array.from(this.q);
    for (const i of this.data.deviations) q[i] = 0;
    if (onProgram) {
      const [reference] = this.reference;
      this.data.drives.forEach(({ joint, place, ratio }, i) => {
        q[joint] = reference[i];
        if (place !== joint) q[place] = reference[i] * ratio;
      });
    }
    return q;
  }

  /** Kinetic and potential energy, J. */
  energies() {
    const [kinetic, potential] = this.kernel.energy(this.q, this.v, ...(this.z.length ? [this.z] : []));
    return { kinetic, potential };
  }

  total() {
    const { kinetic, potential } = this.energies();
    return kinetic + potential;
  }
}

/** Deviations times a factor about where they are none: what is drawn. */
export function exaggerated(q, stiff, factor) {
  const found = Float64Array.from(q);
  for (let i = 0; i < found.length; i++) found[i] = stiff[i] + factor * (q[i] - stiff[i]);
  return found;
}
