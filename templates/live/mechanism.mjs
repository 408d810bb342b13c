// Poses of a robot's links from its coordinates, eq. (3), and coordinates at which its loops are assembled.

import { times } from "#live/poses";

export const NEAR = 1e-9; // m, or sine of an angle: an assembled loop
const STEPS = 40; // of Gauss and Newton
const LONGEST = 0.3; // m or rad, of a step
const PROBE = 1e-6; // m or rad, of differences
const SUBSTEP = 0.1; // m or rad, in which a coordinate goes to a far value

const UNIT = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

/** Rotation about the axis of that number, as a pose. */
function about(axis, angle) {
  const pose = [...UNIT], i = (axis + 1) % 3, j = (axis + 2) % 3, c = Math.cos(angle), s = Math.sin(angle);
  pose[4 * i + i] = pose[4 * j + j] = c;
  pose[4 * j + i] = s;
  pose[4 * i + j] = -s;
  return pose;
}

/** What modes move a place on a beam by, at a distance from its root: series of Chebyshev's polynomials. */
function alongBeam({ by, length, first, second }, at) {
  const x = 2 / length * at(by) - 1;
  const value = (series) => {
    let sum = 0, now = 1, next = x; // polynomials of two degrees
    for (const coefficient of series) {
      sum += coefficient * now;
      [now, next] = [next, 2 * x * next - now];
    }
    return sum;
  };
  const even = first.reduce((sum, [name, series]) => sum + value(series) * at(name), 0);
  return second.reduce((sum, [a, b, series]) => sum + value(series) * at(a) * at(b), even);
}

export class Mechanism {
  /** data: coordinates (names), home, joints, followers, loops, couplings, modes (places), as Python writes them. */
  constructor(data) {
    this.data = data;
    this.index = new Map(data.coordinates.map((name, i) => [name, i]));
    this.modes = new Set(data.modes);
    this.closed = data.loops.length + data.couplings.length > 0;
  }

  /** Values of all coordinates by name, those that follow others among them. */
  named(q) {
    const values = new Map(this.data.coordinates.map((name, i) => [name, q[i]]));
    const at = (name) => values.get(name) ?? 0;
    for (const { name, offset, to, bends, sliding } of this.data.followers) {
      const even = to.reduce((sum, [leader, ratio]) => sum + ratio * at(leader), offset);
      const bent = bends.reduce((sum, [a, b, bend]) => sum + bend * at(a) * at(b), even);
      values.set(name, sliding === null ? bent : bent + alongBeam(sliding, at));
    }
    return values;
  }

  /** Poses of the base and of all links, by name. */
  poses(q) {
    const values = this.named(q), poses = new Map([[this.data.base, UNIT]]);
    for (const { parent, child, before, after, offset, coordinates } of this.data.joints) {
      const s = coordinates.map((name, k) => offset[k] + (name === null ? 0 : values.get(name) ?? 0));
      let moved = [...UNIT];
      [moved[3], moved[7], moved[11]] = s;
      for (let axis = 0; axis < 3; axis++) if (s[3 + axis] !== 0) moved = times(moved, about(axis, s[3 + axis]));
      poses.set(child, times(times(times(poses.get(parent), before), moved), after));
    }
    return poses;
  }

  /** What loops and couplings are off by at q: m, sines of angles, or the coupling's unit; and whose each number is. */
  residual(q) {
    const poses = this.poses(q), values = this.named(q), off = [], owners = [];
    for (const { name, links, frames, turns, components } of this.data.loops) {
      const [a, b] = links.map((link, side) => times(poses.get(link), frames[side]));
      const [A, B] = [a, b].map((pose, side) => times(pose, turns[side]));
      const gap = [3, 7, 11].map((k) => b[k] - a[k]);
      const R = (i, j) => A[i] * B[j] + A[4 + i] * B[4 + j] + A[8 + i] * B[8 + j];
      for (const { axis, products, kept } of components) {
        const along = axis === null ? products.reduce((sum, [factor, i, j]) => sum + factor * R(i, j), 0)
          : a[axis] * gap[0] + a[4 + axis] * gap[1] + a[8 + axis] * gap[2];
        off.push(along - kept);
        owners.push(name);
      }
    }
    for (const { name, of, offset, to } of this.data.couplings) {
      off.push(to.reduce((sum, [leader, ratio]) => sum - ratio * values.get(leader), values.get(of) - offset));
      owners.push(name);
    }
    return { off, owners };
  }

  /**
   * Coordinates near q at which loops and couplings are assembled, those of the indices in `fixed`, and modes, as they are.
   * Returns { q, off, owner }: off is what is left, below 1e-9 where it is assembled, owner the loop with the most of it.
   */
  assemble(q, fixed) {
    const free = this.data.coordinates.map((_, i) => i).filter((i) => !fixed.has(i) && !this.modes.has(i));
    let at = Float64Array.from(q), state = this.residual(at), size = largest(state.off);
    for (let step = 0; step < STEPS && size > 1e-13; step++) {
      const change = leastNorm(this.jacobian(at, free), state.off);
      const longest = change.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
      let share = Math.min(1, LONGEST / Math.max(longest, 1e-300)), next = null;
      for (let halved = 0; halved < 8; halved++, share /= 2) {
        const tried = Float64Array.from(at);
        free.forEach((i, k) => { tried[i] -= share * change[k]; });
        const reached = this.residual(tried);
        if (largest(reached.off) < size) {
          next = [tried, reached];
          break;
        }
      }
      if (next === null) break;
      [at, state] = next;
      size = largest(state.off);
    }
    const worst = state.off.findIndex((x) => Math.abs(x) === size);
    return { q: at, off: size, owner: state.owners[worst] ?? "" };
  }

  /** The home, assembled: with those in `held` as they are, or, where that cannot be, all of them free.  As `assemble`. */
  start(held) {
    const { home } = this.data;
    if (!this.closed) return { q: Float64Array.from(home), off: 0, owner: "" };
    const made = this.assemble(home, new Set(held));
    return made.off > NEAR ? this.assemble(home, new Set()) : made;
  }

  /** Derivatives of the residual by the coordinates of some indices: a row for each of its numbers. */
  jacobian(q, indices) {
    const columns = indices.map((i) => {
      const [more, less] = [PROBE, -PROBE].map((h) => {
        const moved = Float64Array.from(q);
        moved[i] += h;
        return this.residual(moved).off;
      });
      return more.map((x, row) => (x - less[row]) / (2 * PROBE));
    });
    const rows = columns.length ? columns[0].length : 0;
    return Array.from({ length: rows }, (_, row) => columns.map((column) => column[row]));
  }

  /**
   * Move one coordinate to a value, in small steps, so that loops stay on their branch: those in `held` stay where they
   * are, or, where that cannot be assembled, move along.  Returns { q, reached, off, owner }.
   */
  move(q, index, value, held) {
    if (!this.closed) {
      const moved = Float64Array.from(q);
      moved[index] = value;
      return { q: moved, reached: true, off: 0, owner: "" };
    }
    const start = q[index], count = Math.max(1, Math.ceil(Math.abs(value - start) / SUBSTEP));
    const fixed = new Set([...held, index]);
    let at = Float64Array.from(q);
    for (let step = 1; step <= count; step++) {
      const tried = Float64Array.from(at);
      tried[index] = start + ((value - start) * step) / count;
      let made = this.assemble(tried, fixed);
      if (made.off > NEAR) made = this.assemble(tried, new Set([index]));
      if (made.off > NEAR) return { q: at, reached: false, off: made.off, owner: made.owner };
      at = made.q;
    }
    return { q: at, reached: true, off: 0, owner: "" };
  }
}

const largest = (values) => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);

/** The smallest x for which J x is nearest to r: J' (J J' + a little)^-1 r, redundant rows allowed. */
function leastNorm(J, r) {
  const n = J.length, scale = J.reduce((sum, row) => sum + row.reduce((s, x) => s + x * x, 0), 0);
  if (!n || scale === 0) return new Array(n ? J[0].length : 0).fill(0);
  const A = J.map((row, i) => [...J.map((other, j) => row.reduce((s, x, k) => s + x * other[k], 0) + (i === j ? 1e-12 * scale : 0)), r[i]]);
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(A[i][k]) > Math.abs(A[pivot][k])) pivot = i;
    [A[k], A[pivot]] = [A[pivot], A[k]];
    for (let i = k + 1; i < n; i++) {
      const factor = A[i][k] / A[k][k];
      if (factor !== 0) for (let j = k; j <= n; j++) A[i][j] -= factor * A[k][j];
    }
  }
  const y = new Array(n).fill(0);
  for (let k = n - 1; k >= 0; k--) {
    let sum = A[k][n];
    for (let j = k + 1; j < n; j++) sum -= A[k][j] * y[j];
    y[k] = sum / A[k][k];
  }
  return J[0].map((_, k) => J.reduce((s, row, i) => s + row[k] * y[i], 0));
}
