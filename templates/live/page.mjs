// The page: kernels are loaded, time goes on, and what is set, drawn and plotted follows.

import { description, load } from "#live/kernel";
import { drawChart } from "#live/chart";
import { by, choice, element, group, slider, toggle } from "#live/controls";
import { Shell } from "#live/head";
import { bytesOf, doublesOf, shown } from "#live/numbers";
import { plotsOf } from "#live/plots";
import { moved } from "#live/poses";
import { between } from "#live/signals";
import { Simulation, exaggerated } from "#live/simulation";

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2];
const BUDGET = 12; // ms of a frame that steps may take; then time goes slower
const KEPT = 1200; // rows of plots
const SPAN = 10; // s that plots show of what goes on
const PLOT_PAUSE = 60; // ms between plots
const SAMPLED = 600; // rows of a recording's plots

async function main() {
  const data = JSON.parse(by("data").textContent);
  const kernel = await load(bytesOf(data.kernel));
  const rigid = data.rigid ? await (await import("#live/rigid")).load(bytesOf(data.rigid)) : null;
  const simulation = new Simulation(kernel, rigid, data);
  const page = new Page(simulation, data);
  window.live = page; // for tests, and who is curious
  page.begin();
}

class Page extends Shell {
  constructor(simulation, data) {
    super(data);
    this.simulation = simulation;
    this.description = description;
    this.playing = true;
    this.replays = Boolean(data.recorded);
    this.rows = [];
    this.costs = []; // ms of each frame: steps, scene, plots
    this.goal = simulation.t;
    this.sees = true;
    if (data.recorded) {
      this.recorded = Object.fromEntries(Object.entries(data.recorded).map(([name, numbers]) => [name, doublesOf(numbers)]));
      this.at = 0;
    }
    this.plots = plotsOf(data);
    this.bends = data.deviations.length > 0 && !data.closed; // with loops there is no pose without deviations at hand
    this.defineSettings();
    this.buildPanel();
    this.buildPlots();
    this.listen();
  }

  begin() {
    const refused = this.settings.read(window.location.hash);
    this.reset();
    this.refuse(refused);
    this.last = performance.now();
    this.draw();
    this.ready();
  }

  // Settings

  defineSettings() {
    const { settings, simulation, data } = this, { kernel } = simulation;
    // the way in which drives go comes behind their targets: to set one of these changes it
    const above = (least) => (value) => value >= least;
    const one = (...values) => (value) => values.includes(value);
    settings.define("speed", 1, () => {}, (value) => value > 0 && value <= 10);
    settings.define("exaggeration", data.exaggeration, () => { this.scene.stale = true; }, above(1));
    settings.define("beside", data.closed || !data.drives.length ? "none" : "program", () => { this.scene.stale = true; }, one("program", "rigid", "none"));
    settings.define("paths", true, (on) => Object.values(this.scene.paths).forEach((path) => { path.visible = on; }));
    this.addTheme();
    settings.define("compact", false, (on) => {
      document.documentElement.classList.toggle("compact", on);
      by("whole").hidden = !on;
      this.scene.orbit.enableZoom = !on; // what is around it scrolls
      by("view").style.touchAction = on ? "pan-y" : "none";
    });
    if (data.model) settings.define("compensates", data.compensates, (on) => { simulation.compensates = on; });
    data.drives.forEach((drive, i) => {
      settings.define(`target.${drive.label}`, drive.start, (value) => {
        simulation.targets[i] = value;
        if (simulation.drive !== "target" && !this.driving) {
          const target = value;
          simulation.hold();
          simulation.targets[i] = target;
          this.showTargets(i); // the others stay where they are
        }
      });
      if (data.control !== "pd") return;
      for (const gain of ["kp", "kd"]) settings.define(`${gain}.${drive.label}`, drive[gain], (value) => { simulation.gains[i][gain] = value; }, above(0));
    });
    data.inputs.forEach(({ label, start }, i) => settings.define(`input.${label}`, start, (value) => { simulation.inputs[i] = value; }));
    for (const { name } of data.parameters) {
      settings.define(`p.${name}`, kernel.parameters[name], () => this.setParameter(name), (value) => this.allowed(name, value));
    }
    for (const { key } of data.scales) settings.define(`times.${key}`, 1, () => this.setScaled(key), (value) => value > 0);
    if (data.payload) settings.define("payload", 0, (value) => { simulation.payload = value; simulation.apply(); }, above(0));
    if (data.push) for (const axis of ["x", "y", "z"]) settings.define(`push.${axis}`, 0, () => this.pushTool());
    settings.define("drive", data.drive, (value) => this.driveBy(value), one(...this.driveModes().map(([mode]) => mode)));
    if (simulation.waves) {
      data.prescribed.names.forEach((name, i) => {
        if (data.prescribed.tracked.includes(i)) return;
        const { waves } = simulation.waves;
        settings.define(`shake.${name}.amplitude`, waves[4 * i], (value) => { waves[4 * i] = value; });
        settings.define(`shake.${name}.frequency`, waves[4 * i + 1] / (2 * Math.PI), (value) => { waves[4 * i + 1] = 2 * Math.PI * value; }, above(0));
      });
    }
    settings.define("plot1", this.plots.has("tool") ? "tool" : "energy", () => this.drawPlots(), (key) => this.plots.has(key));
    settings.define("plot2", this.plots.has(data.plot) ? data.plot : "energy", () => this.drawPlots(), (key) => this.plots.has(key));
    let waiting = 0;
    settings.listeners.push(() => {
      window.clearTimeout(waiting);
      waiting = window.setTimeout(() => this.keep(), 250);
    });
  }

  /** The settings into the address. */
  keep() {
    const fragment = this.settings.fragment();
    try {
      window.history.replaceState(null, "", fragment || window.location.pathname);
    } catch {
      window.location.hash = fragment; // where a document may not replace its address
    }
  }

  allowed(name, value) {
    const { least } = this.data.parameters.find((p) => p.name === name);
    return least === null || value >= least;
  }

  driveModes() {
    const { data } = this, modes = [];
    if (data.program || data.torque) modes.push(["program", "the scenario's program"]);
    if (data.cycle && data.control !== "none") modes.push(["cycle", "to and fro"]);
    if (data.drives.length && data.control !== "none") modes.push(["target", "to targets"]);
    if (data.control !== "reference") modes.push(["none", data.inputs.length ? "by their inputs" : "off"]);
    return modes;
  }

  driveBy(mode) {
    const { simulation } = this;
    if (this.driving || mode === simulation.drive) { simulation.drive = mode; return; }
    if (mode === "cycle") simulation.tour();
    else if (mode === "target") {
      simulation.hold();
      this.showTargets();
    } else simulation.drive = mode;
  }

  /** Drives go to targets: sliders of these, but that of the one that was moved, to where they are. */
  showTargets(own = -1) {
    this.driving = true;
    this.settings.put("drive", "target");
    this.data.drives.forEach(({ label }, k) => { if (k !== own) this.settings.put(`target.${label}`, Number(shown(this.simulation.targets[k], 5))); });
    this.driving = false;
  }

  setParameter(name) {
    const { group: kind } = this.data.parameters.find((p) => p.name === name);
    const times = this.settings.known.has(`times.${kind}`) ? this.settings.get(`times.${kind}`) : 1;
    this.simulation.set(name, this.settings.get(`p.${name}`) * times);
    this.restart();
  }

  setScaled(kind) {
    const times = this.settings.get(`times.${kind}`);
    for (const { name, group: own } of this.data.parameters) {
      if (own === kind) this.simulation.known[name] = this.settings.get(`p.${name}`) * times;
    }
    this.simulation.apply();
    this.restart();
  }

  /** What is conserved begins anew where the robot is another one. */
  restart() {
    this.simulation.energy0 = this.simulation.total();
    this.scene.stale = true;
  }

  pushTool() {
    const force = ["x", "y", "z"].map((axis) => this.settings.get(`push.${axis}`));
    this.simulation.push = force.some((x) => x) ? { ...this.data.push, force } : null;
    this.scene.stale = true;
  }

  // Panel

  buildPanel() {
    const { data, settings } = this, panel = by("panel");
    const view = [];
    if (this.bends) view.push(slider(settings, "exaggeration", "deviations times", { low: 1, high: data.most, log: true }));
    const beside = [["program", "its program"], ["rigid", "itself, rigid"], ["none", "nothing"]];
    const others = beside.filter(([kind]) => kind === "none" || (kind === "rigid" ? this.bends : data.drives.length && !data.closed));
    if (others.length > 1) view.push(choice(settings, "beside", "beside it", others));
    view.push(toggle(settings, "paths", "paths of the tool"));
    view.push(element("div", { class: "row" }, element("button", { type: "button", onclick: () => this.scene.look() }, "First view")));
    panel.append(group("View", true, ...view));
    const drives = [choice(settings, "drive", "drives", this.driveModes())];
    if (data.model) drives.push(toggle(settings, "compensates", data.model.bandwidth > 0 ? "computed torque" : "a rigid model helps (gravity, inertia)"));
    for (const drive of data.drives) drives.push(slider(settings, `target.${drive.label}`, drive.label, drive));
    for (const input of data.inputs) drives.push(slider(settings, `input.${input.label}`, input.label, input));
    if (data.control === "pd" && data.drives.length) {
      const gains = data.drives.flatMap(({ label, kp, kd, unit }) => [
        slider(settings, `kp.${label}`, `${label}: kp`, { ...around(kp), unit: unit === "m" ? "N/m" : "N m/rad" }),
        slider(settings, `kd.${label}`, `${label}: kd`, { ...around(kd), unit: unit === "m" ? "N s/m" : "N m s" }),
      ]);
      drives.push(group("Gains", false, ...gains));
    }
    panel.append(group("Drives", data.drives.length < 9, ...drives));
    const loads = [];
    if (data.payload) loads.push(slider(settings, "payload", `payload at ${data.tool}`, { low: 0.01, high: data.payload.most, log: true, zero: true, unit: "kg" }));
    if (data.push) for (const axis of ["x", "y", "z"]) loads.push(slider(settings, `push.${axis}`, `force on ${data.tool}, ${axis}`, { low: -data.force, high: data.force, unit: "N" }));
    if (loads.length) panel.append(group("Loads", true, ...loads));
    if (this.simulation.waves) {
      const shakes = data.prescribed.names.flatMap((name, i) => (data.prescribed.tracked.includes(i) ? [] : [
        slider(settings, `shake.${name}.amplitude`, `${name}: amplitude`, { low: -data.prescribed.most[i], high: data.prescribed.most[i], unit: data.prescribed.units[i] }),
        slider(settings, `shake.${name}.frequency`, `${name}: frequency`, { low: 0, high: 20, unit: "Hz" }),
      ]));
      panel.append(group("Motion that is given", true, ...shakes));
    }
    panel.append(this.parameterPanel());
    panel.append(group("Energy", false, element("p", { id: "energy" }, ""), element("p", {}, "With drives off and no damping the total stays; what it drifts by is the error of the steps.")));
    if (data.notes.length) panel.append(group("Notes", data.notes.length < 4, element("ul", {}, ...data.notes.map((note) => element("li", {}, note)))));
    panel.append(group("About", false,
      element("p", {}, `${data.about} The equations of motion are compiled to WebAssembly and integrated in this page; nothing is fetched. Keys: space plays and pauses, . steps, r resets.`),
      element("pre", {}, by("licence").textContent)));
  }

  parameterPanel() {
    const { data, settings } = this, groups = [];
    const basic = data.parameters.filter(({ group: kind }) => kind === "gravity");
    if (basic.length) groups.push(...basic.map((p) => slider(settings, `p.${p.name}`, p.label, p)));
    for (const { key, label } of data.scales) groups.push(slider(settings, `times.${key}`, label, { low: 0.01, high: 100, log: true, unit: "times" }));
    const owners = new Map();
    for (const p of data.parameters) {
      if (p.group === "gravity") continue;
      if (!owners.has(p.owner)) owners.set(p.owner, []);
      owners.get(p.owner).push(p);
    }
    const search = element("input", { type: "search", placeholder: "find a parameter", "aria-label": "find a parameter" });
    const rows = [], boxes = [];
    for (const [owner, list] of owners) {
      const box = element("details", {}, element("summary", {}, owner));
      let filled = false;
      const fillBox = () => { // sliders of many parameters arise where they are looked at
        if (filled) return;
        filled = true;
        for (const p of list) {
          const row = slider(settings, `p.${p.name}`, p.label, p);
          rows.push([p.name, row]);
          box.append(row);
        }
      };
      box.addEventListener("toggle", () => box.open && fillBox());
      boxes.push([box, list, fillBox]);
    }
    search.addEventListener("input", () => {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const fits = (name) => words.every((word) => name.toLowerCase().includes(word));
      for (const [box, list, fillBox] of boxes) {
        const any = list.some(({ name }) => fits(name));
        box.hidden = !any;
        if (any && words.length) fillBox();
        box.open = any && words.length > 0;
      }
      for (const [name, row] of rows) row.hidden = !fits(name);
    });
    if (boxes.length) groups.push(search, ...boxes.map(([box]) => box));
    groups.push(element("div", { class: "row" }, element("button", { type: "button", onclick: () => settings.restore() }, "All settings as they were")));
    return group("Parameters", true, ...groups);
  }

  buildPlots() {
    for (const key of ["plot1", "plot2"]) {
      const list = element("select", { "aria-label": "what is plotted" }, ...[...this.plots].map(([value, { label }]) => element("option", { value }, label)));
      list.addEventListener("change", () => this.settings.put(key, list.value));
      this.settings.watch(key, (value) => { list.value = value; });
      by("plots").append(element("figure", {}, list, element("canvas", { id: key, role: "img", "aria-label": "plot over time" })));
    }
  }

  // Time

  listen() {
    by("play").addEventListener("click", () => this.play(!this.playing));
    by("step").addEventListener("click", () => this.step());
    by("reset").addEventListener("click", () => this.reset());
    by("speed").append(...SPEEDS.map((speed) => element("option", { value: speed }, `${speed}`)));
    by("speed").addEventListener("change", () => this.settings.put("speed", by("speed").value));
    this.settings.watch("speed", (value) => { by("speed").value = value; });
    by("whole").addEventListener("click", () => {
      if (window.self === window.top) this.settings.put("compact", false);
      else window.open(window.location.href.replace(/([#&])compact=true&?/, "$1"), "_blank", "noopener");
    });
    by("alive").addEventListener("click", () => this.live(this.replays));
    by("scrub").addEventListener("input", () => {
      this.play(false);
      const { t } = this.recorded;
      this.live(false);
      this.at = t[0] + Number(by("scrub").value) * (t[t.length - 1] - t[0]);
      this.changed();
    });
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, button, summary")) return;
      const done = { " ": () => this.play(!this.playing), ".": () => this.step(), r: () => this.reset() }[event.key];
      if (done) {
        event.preventDefault();
        done();
      }
    });
    new IntersectionObserver(([entry]) => { this.sees = entry.isIntersecting; }).observe(by("stage"));
    this.listenToPushes(by("view"));
  }

  listenToPushes(canvas) {
    let held = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || this.replays || !this.data.moving.length) return;
      const found = this.scene.pick(event);
      if (!found || !this.data.moving.includes(found.link)) return;
      held = found;
      canvas.setPointerCapture(event.pointerId);
      this.scene.orbit.enabled = false;
      event.stopImmediatePropagation();
    }, { capture: true });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      this.pulled = this.scene.pointAt(event);
      this.held = held;
    });
    const release = () => {
      if (!held) return;
      held = this.held = this.pulled = null;
      this.scene.orbit.enabled = true;
      this.pushTool();
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
  }

  /** The force of who pulls at a link: that of a spring between the point and the pointer. */
  pull() {
    if (!this.held || !this.pulled) return;
    const { link, point } = this.held, place = moved(this.poseOf(this.simulation.q, link), point);
    const force = this.pulled.map((x, i) => (this.data.force / (0.4 * this.data.size)) * (x - place[i]));
    this.simulation.push = { link, point, force };
  }

  play(on) {
    this.playing = on;
    by("play").textContent = on ? "Pause" : "Play";
    this.goal = this.simulation.t;
  }

  /** One period, or one sample of a recording. */
  step() {
    this.play(false);
    if (this.replays) {
      const { t } = this.recorded, [k] = between(t, this.at + 1e-12);
      this.at = t[Math.min(k + 1, t.length - 1)];
    } else this.advance(this.simulation.t + this.simulation.period);
    this.changed();
  }

  reset() {
    this.say("");
    this.rows = [];
    if (this.recorded) {
      this.live(false);
      this.at = this.recorded.t[0];
    } else {
      const { drive } = this.simulation;
      this.simulation.reset();
      if (drive === "target" || drive === "none") this.simulation.targets = this.data.drives.map(({ label }) => this.settings.get(`target.${label}`));
    }
    this.goal = this.simulation.t;
    this.changed();
  }

  /** From a recording to what would come of it, and back. */
  live(on) {
    if (!this.recorded || on === !this.replays) return;
    const { simulation } = this;
    this.replays = !on;
    this.rows = [];
    if (on) {
      simulation.reset(simulation);
      if (simulation.drive === "target") simulation.hold();
      this.goal = simulation.t;
      this.play(true);
    }
    by("alive").textContent = on ? "Back to the recording" : "Go on from here";
  }

  /** Time of the robot goes on until then; a motion that stops is said, and time stands. */
  advance(until, budget) {
    try {
      return this.simulation.advance(until, budget);
    } catch (error) {
      this.play(false);
      this.say(`The motion cannot go on: ${error.message}. Reset, or change what was set.`);
      return true;
    }
  }

  /** The recording's state at a time is that of the simulation. */
  showRecorded() {
    const { t, q, v, z, program } = this.recorded, { simulation } = this;
    const [k, share] = between(t, this.at), next = Math.min(k + 1, t.length - 1);
    for (const [to, rows] of [[simulation.q, q], [simulation.v, v], [simulation.z, z], [simulation.reference[0], program]]) {
      const n = to.length;
      for (let i = 0; i < n; i++) to[i] = rows[n * k + i] + share * (rows[n * next + i] - rows[n * k + i]);
    }
    simulation.t = this.at;
  }

  frame(now) {
    requestAnimationFrame(this.frame);
    const passed = Math.min((now - this.last) / 1000, 0.1);
    this.last = now;
    if (!this.sees) return;
    const begin = performance.now();
    this.cost = { steps: 0, scene: 0, plots: 0 };
    if (this.playing) {
      const ahead = passed * this.settings.get("speed");
      if (this.replays) {
        const { t } = this.recorded, end = t[t.length - 1];
        this.at = this.at >= end ? t[0] : Math.min(this.at + ahead, end);
      } else {
        this.pull();
        this.goal += ahead;
        const from = this.simulation.t;
        if (!this.advance(this.goal, BUDGET)) this.goal = this.simulation.t;
        this.measure(ahead, this.simulation.t - from);
      }
      this.cost.steps = performance.now() - begin;
      this.changed();
    }
    this.draw();
    this.cost.scene = performance.now() - begin - this.cost.steps - this.cost.plots;
    this.costs.push(this.cost);
    if (this.costs.length > KEPT) this.costs.shift();
  }

  /** Median ms of steps and of the scene over so many frames of a display of 60 Hz. */
  profile(frames) {
    this.play(false);
    const costs = { steps: [], scene: [], plots: [] }, middle = (list) => list.sort((a, b) => a - b)[list.length >> 1];
    for (let i = 0; i < frames; i++) {
      const begin = performance.now();
      this.goal = this.simulation.t + 1 / 60;
      this.advance(this.goal);
      const stepped = performance.now();
      this.changed();
      this.cost = { plots: 0 };
      this.draw();
      costs.steps.push(stepped - begin);
      costs.plots.push(this.cost.plots);
      costs.scene.push(performance.now() - stepped - this.cost.plots);
    }
    return { steps: middle(costs.steps), scene: middle(costs.scene), plots: middle(costs.plots) };
  }

  /** How fast time goes, over about a second. */
  measure(wanted, done) {
    this.pace = this.pace ?? { wanted: 0, done: 0 };
    this.pace.wanted += wanted;
    this.pace.done += done;
    if (this.pace.wanted < this.settings.get("speed")) return;
    const share = this.pace.done / this.pace.wanted;
    by("pace").textContent = share < 0.93 ? `slower than asked for: ${Math.round(100 * share)} %` : "";
    this.pace = { wanted: 0, done: 0 };
  }

  /** The state is another one. */
  changed() {
    if (this.replays) this.showRecorded();
    else this.note();
    this.scene.stale = true;
  }

  /** A row of plots of the state of now. */
  note() {
    const last = this.rows[this.rows.length - 1];
    if (last && last.t > this.simulation.t) this.rows = [];
    if (last && last.t === this.simulation.t) this.rows.pop();
    this.rows.push(this.row());
    if (this.rows.length > KEPT) this.rows.splice(0, this.rows.length - KEPT);
  }

  row() {
    const { simulation, data } = this, { q, z, t } = simulation;
    const stiff = simulation.stiff(false), programmed = data.closed ? stiff : simulation.stiff(true);
    const [real, rigid, program] = [q, stiff, programmed].map((x) => this.placeOf(x, data.tool));
    const off = (a) => Math.hypot(...real.map((x, i) => x - a[i]));
    const energy = simulation.energies();
    return { t, q: Float64Array.from(q), states: z.slice(), stiff, reference: simulation.reference[0].slice(), real, program, tool: [off(program), off(rigid)], energy };
  }

  poseOf(q, link) {
    return this.simulation.kernel.framePose(q, link);
  }

  placeOf(q, frame) {
    const pose = this.poseOf(q, frame);
    return [pose[3], pose[7], pose[11]];
  }

  // What is shown

  draw() {
    if (this.scene.stale) {
      this.drawRobot();
      const begin = performance.now();
      if (!this.playing || begin - (this.plotted ?? -Infinity) > PLOT_PAUSE) {
        this.plotted = begin;
        this.drawReadout();
        this.drawPlots();
        if (this.cost) this.cost.plots = performance.now() - begin;
      }
    }
    this.scene.draw();
  }

  drawRobot() {
    const { simulation, scene, settings, data } = this;
    const stiff = simulation.stiff(false), factor = settings.get("exaggeration");
    const q = exaggerated(simulation.q, stiff, factor);
    const poseOf = (link) => this.poseOf(q, link);
    scene.pose(scene.reality, poseOf, q);
    scene.moveSprings(poseOf);
    const beside = settings.get("beside");
    scene.ghost.root.visible = beside !== "none";
    if (beside !== "none") {
      const other = beside === "rigid" ? stiff : simulation.stiff(true);
      scene.pose(scene.ghost, (link) => this.poseOf(other, link), other);
    }
    const rows = this.replays ? this.whole().filter(({ t }) => t <= this.at) : this.rows;
    if (settings.get("paths")) {
      scene.drawPath("real", rows.map(({ q: own, stiff: base }) => this.pathPoint(own, base, factor)));
      scene.drawPath("program", data.closed ? [] : rows.map(({ program }) => program));
    }
    const { push } = simulation;
    scene.showPush(push && moved(poseOf(push.link), push.point), push && push.force, data.force);
    scene.stale = true;
  }

  /** The tool's place with deviations as they are exaggerated; computed once for each row and factor. */
  pathPoint(q, stiff, factor) {
    if (q.drawn !== factor) {
      q.drawn = factor;
      q.point = this.placeOf(exaggerated(q, stiff, factor), this.data.tool);
    }
    return q.point;
  }

  drawReadout() {
    const row = this.replays ? this.row() : this.rows[this.rows.length - 1];
    if (!row) return;
    by("clock").textContent = `${row.t.toFixed(2)} s`;
    if (this.recorded) {
      const { t } = this.recorded;
      by("scrub").hidden = by("alive").hidden = false;
      if (this.replays) by("scrub").value = (this.at - t[0]) / (t[t.length - 1] - t[0]);
    }
    const { kinetic, potential } = row.energy, total = kinetic + potential;
    const lines = [["energy", `${shown(total, 4)} J`]];
    if (this.bends) lines.unshift(["off the rigid robot", `${shown(1e3 * row.tool[1], 3)} mm`]);
    if (this.data.drives.length && !this.data.closed) lines.unshift(["off its program", `${shown(1e3 * row.tool[0], 3)} mm`]);
    if (this.bends) lines.push(["deviations drawn", `x ${shown(this.settings.get("exaggeration"), 3)}`]);
    const box = by("readout");
    if (box.childElementCount !== 2 * lines.length) box.replaceChildren(...lines.flatMap(() => [element("dt"), element("dd")]));
    lines.forEach(([name, value], i) => {
      box.children[2 * i].textContent = name;
      box.children[2 * i + 1].textContent = value;
    });
    const drift = total - this.simulation.energy0;
    by("energy").textContent = `kinetic ${shown(kinetic, 5)} J, potential ${shown(potential, 5)} J, total ${shown(total, 6)} J; since the start or the last change ${shown(drift, 3)} J`;
  }

  /** Rows of all of a recording, computed when they are first asked for. */
  whole() {
    if (!this.all) {
      const { t } = this.recorded, now = this.at, stride = Math.max(1, Math.ceil(t.length / SAMPLED));
      this.all = [];
      for (let k = 0; k < t.length; k += stride) {
        this.at = t[k];
        this.showRecorded();
        this.all.push(this.row());
      }
      this.at = now;
      this.showRecorded();
    }
    return this.all;
  }

  drawPlots() {
    if (document.documentElement.classList.contains("compact")) return;
    const rows = this.replays ? this.whole() : this.rows, end = this.simulation.t;
    const first = this.replays ? rows[0].t : Math.max(end - SPAN, this.rows[0]?.t ?? 0);
    const seen = rows.filter(({ t }) => t >= first);
    for (const key of ["plot1", "plot2"]) {
      const canvas = by(key), plot = this.plots.get(this.settings.get(key));
      if (!canvas || !plot) continue;
      const span = this.replays ? [first, rows[rows.length - 1].t] : [first, Math.max(end, first + 0.5)];
      drawChart(canvas, { times: seen.map(({ t }) => t), rows: seen.map(plot.value), names: plot.names, unit: plot.unit, span, cursor: this.replays ? this.at : null });
    }
  }
}

function around(value) {
  return value > 0 ? { low: value / 100, high: value * 100, log: true } : { low: 0, high: 1 };
}

main().catch((error) => {
  by("message").textContent = `This page could not begin: ${error.message}`;
  by("message").hidden = false;
  throw error;
});
