// What is no finite number, at every place that numbers of a kernel's module come in at; run under node by test_wasm.py.
import { load } from "./one_link.mjs";

const kernel = await load();
const ODD = [NaN, Infinity, -Infinity, null, "1", "1234", true, [1], {}];
const [q, v, u] = [[1e-3, 0.1], [0, 0.2], [1, 2]];
const track = (more) => ({ signal: { knots: [0, 1], coefficients: [0.1], degree: 0, columns: 1, ...more }, place: [1] });
const roll = (more, at = [q, v, u]) => kernel.adaptiveRollout(...at, { duration: 1e-3, ...more });
const loaded = (loads) => roll({ loads });
const moved = { knots: [0, 1], coefficients: [1, 0, 0, 0, 0, 0], degree: 0, columns: 6 };
const push = (more) => loaded({ wrenches: [{ signal: moved, link: "link1", ...more }] });
const simulator = (more) => kernel.simulator(q, v, { kp: 3, kd: 1, target: [0, 0], ...more });
const written = (change) => {
  const motion = simulator();
  change(motion);
  motion.advance(1e-3);
};
const unbounded = (x) => (x === null || Math.abs(x) === Infinity ? NaN : x); // where these say that there is no bound
const calls = {
  q: (x) => kernel.forwardDynamics([0, x], v, u),
  text: (x) => kernel.energy("12", [0, x]),
  u: (x) => roll({}, [q, v, [x, 0]]),
  set: (x) => kernel.set({ "gravity.x": x }),
  duration: (x) => roll({ duration: x }),
  start: (x) => roll({ start: x }),
  rtol: (x) => roll({ rtol: x }),
  atol: (x) => roll({ atol: [1e-6, 1e-6, 1e-6, x === true ? "1" : x] }),
  samples: (x) => roll({ samples: x }),
  dt: (x) => kernel.rollout(q, v, u, { dt: x, steps: 1 }),
  steps: (x) => kernel.rollout(q, v, u, { dt: 1e-4, steps: x }),
  kp: (x) => roll({ kp: [0, x], target: [0, 0] }),
  gain: (x) => roll({ kp: x, target: [0, 0] }),
  target: (x) => roll({ kp: 1, target: [0, x] }),
  t: (x) => simulator({ t: x }),
  reset: (x) => simulator().reset(q, v, x),
  advance: (x) => simulator().advance(x),
  time: (x) => written((motion) => { motion.t = x; }),
  wanted: () => written((motion) => { motion.target[1] = NaN; }),
  drives: (x) => written((motion) => { motion.u = [x, 0]; }),
  knots: (x) => loaded({ torque: track({ knots: [0, x] }) }),
  coefficients: (x) => loaded({ torque: track({ coefficients: [x] }) }),
  columns: (x) => loaded({ torque: track({ columns: x }) }),
  degree: (x) => loaded({ torque: track({ degree: x }) }),
  programmed: (x) => loaded({ program: track({ columns: x }) }),
  ratio: (x) => loaded({ program: { ...track(), ratio: [x] } }),
  stops: (x) => loaded({ stops: [x] }),
  effort: (x) => loaded({ effort: [1, x === Infinity ? NaN : x] }),
  place: (x) => loaded({ torque: { ...track(), place: [x] } }),
  arm: (x) => push({ arm: [0, x, 0] }),
  first: (x) => loaded({ torque: track(), first: unbounded(x) }),
  until: (x) => push({ t1: unbounded(x) }),
};

const taken = []; // or refused by another error than that of the check
for (const [name, call] of Object.entries(calls)) {
  for (const x of ODD) {
    try {
      call(x);
      taken.push([name, String(x)]);
    } catch (error) {
      const checked = error instanceof RangeError || error instanceof TypeError;
      if (!checked || !/ is not |expected|unknown/.test(error.message)) taken.push([name, String(x), error.message]);
    }
  }
}

const motion = simulator().advance(1e-3);
const state = () => [...motion.q, ...motion.v, motion.t];
const before = state();
let refused = 0;
for (const given of [[q, v, NaN], [q, [0, NaN]], [[NaN, 0], v]]) {
  try {
    motion.reset(...given);
  } catch {
    refused += 1;
  }
}
const other = simulator().advance(1e-3).advance(1e-3);
const stays = state().every((x, i) => x === before[i]) && motion.advance(1e-3).q.every((x, i) => x === other.q[i]);
roll({ start: 3, loads: { torque: track(), effort: [Infinity, 2] } });
push({ arm: [0, 1, 0], t1: 1 });
console.log(JSON.stringify({ taken, refused, stays }));
