// The page that shows a robot: a slider for each joint, loops assembled wherever a slider is.

import { by, element, group, slider } from "#live/controls";
import { Shell } from "#live/head";
import { Mechanism, NEAR } from "#live/mechanism";
import { shown } from "#live/numbers";
import { moved } from "#live/poses";

const key = (name) => `q.${name}`;

class View extends Shell {
  constructor(data) {
    super(data);
    this.mechanism = new Mechanism(data);
    this.held = new Set(data.held);
    this.first = this.mechanism.start(this.held);
    this.q = this.first.q;
    this.scene.ghost.root.visible = false;
    this.following = false;
    data.sliders.forEach(({ name, index, low, high }) => {
      const allowed = (value) => value >= low && value <= high;
      this.settings.define(key(name), this.q[index], (value) => this.move(index, value), this.mechanism.closed ? () => true : allowed);
    });
    this.addTheme();
    this.build();
  }

  /** Sliders: of joints that are driven, and of those that follow them through loops. */
  build() {
    const made = this.data.sliders.map(({ name, index, low, high, unit }) =>
      [index, slider(this.settings, key(name), name, { low, high, unit })]);
    const { modes, closed } = this.mechanism, bars = (fits) => made.filter(([index]) => fits(index)).map(([, bar]) => bar);
    const [first, others] = [true, false].map((held) => bars((i) => !modes.has(i) && (this.held.has(i) || !closed) === held));
    const bends = bars((i) => modes.has(i));
    const reset = element("button", { type: "button", onclick: () => this.reset() }, "Home");
    const look = element("button", { type: "button", onclick: () => this.scene.look() }, "First view");
    by("panel").append(element("div", { class: "row" }, reset, look));
    if (first.length) by("panel").append(group("Joints", true, ...first));
    if (others.length) by("panel").append(group("Joints that loops move", !first.length, ...others));
    if (bends.length) by("panel").append(group("Modes of links that bend", true, ...bends));
    if (!made.length) by("panel").append(element("p", {}, "No joint moves."));
    for (const note of this.data.notes) by("panel").append(element("p", {}, note));
  }

  begin() {
    this.reset();
    this.read();
    this.ready();
  }

  frame() {
    this.scene.draw();
    requestAnimationFrame(this.frame);
  }

  reset() {
    this.q = this.first.q;
    this.follow();
    this.show();
    const { off, owner } = this.first;
    this.say(off > NEAR ? `${owner} cannot be assembled at home: ${shown(off, 2)} is left` : "");
  }

  /** Put a joint where its slider is; where loops cannot follow, it stays, and the page says which. */
  move(index, value) {
    if (this.following) return;
    const { q, reached, off, owner } = this.mechanism.move(this.q, index, value, this.held);
    this.q = q;
    const { name, unit } = this.data.sliders.find((one) => one.index === index);
    this.say(reached ? "" : `${owner} cannot be assembled with ${name} at ${shown(value)} ${unit}: ${shown(off, 2)} is left`);
    if (this.mechanism.closed) this.follow();
    this.show();
  }

  /** Set all sliders to where the joints are. */
  follow() {
    this.following = true;
    this.data.sliders.forEach(({ name, index }) => this.settings.put(key(name), this.q[index]));
    this.following = false;
  }

  show() {
    const poses = this.mechanism.poses(this.q), poseOf = (link) => poses.get(link);
    this.scene.pose(this.scene.reality, poseOf, this.q);
    this.scene.moveSprings(poseOf);
    const { frames } = this.data;
    by("readout").replaceChildren(...frames.flatMap(({ name, link, point }) => [
      element("dt", {}, name),
      element("dd", {}, `${moved(poseOf(link), point).map((x) => x.toFixed(4)).join(", ")} m`),
    ]));
  }
}

const view = new View(JSON.parse(by("data").textContent));
window.view3d = view; // for tests, and who is curious
view.begin();
