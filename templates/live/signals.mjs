// Motions and forces over time as data: polynomials between knots, and waves.

/** Place of the piece of a signal at a time; pieces are looked for by halves. */
function pieceAt(knots, t) {
  let low = 0, high = knots.length - 2;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (knots[middle] <= t) low = middle;
    else high = middle - 1;
  }
  return low;
}

/**
 * Values, rates and accelerations of a signal's columns at a time, s.
 *
 * signal: knots (pieces + 1, increasing), coefficients (pieces, degree + 1, columns), flat, of powers of t - knots[piece];
 * outside of its knots it rests.  Where it has a profile, that one's only column stands in the place of time.
 */
export function signalAt(signal, t) {
  if (signal.profile) {
    const [[s], [rate], [slope]] = signalAt(signal.profile, t);
    const [q, by, twice] = polynomialAt(signal, s);
    return [q, by.map((x) => x * rate), twice.map((x, i) => x * rate * rate + by[i] * slope)];
  }
  return polynomialAt(signal, t);
}

function polynomialAt({ knots, coefficients, degree, columns }, t) {
  const first = knots[0], last = knots[knots.length - 1];
  const rests = t < first || t > last;
  const at = Math.min(Math.max(t, first), last);
  const piece = pieceAt(knots, at), x = at - knots[piece];
  const q = new Array(columns).fill(0), v = q.slice(), a = q.slice();
  for (let power = degree; power >= 0; power--) {
    const row = (piece * (degree + 1) + power) * columns;
    for (let i = 0; i < columns; i++) {
      a[i] = a[i] * x + 2 * v[i];
      v[i] = v[i] * x + q[i];
      q[i] = q[i] * x + coefficients[row + i];
    }
  }
  return rests ? [q, v.fill(0), a.fill(0)] : [q, v, a];
}

/** Prescribed motions at a time: waves (amplitude, angular frequency, phase, offset, ...), and signals in some places. */
export function wavesAt({ waves, tracks = [] }, t) {
  const q = [], v = [], a = [];
  for (let i = 0; i < waves.length; i += 4) {
    const [amplitude, rate, phase, offset] = waves.slice(i, i + 4), angle = rate * t + phase;
    q.push(offset + amplitude * Math.sin(angle));
    v.push(amplitude * rate * Math.cos(angle));
    a.push(-amplitude * rate * rate * Math.sin(angle));
  }
  for (const { signal, place } of tracks) {
    const found = signalAt(signal, t);
    place.forEach((to, i) => { [q[to], v[to], a[to]] = [found[0][i], found[1][i], found[2][i]]; });
  }
  return [q, v, a];
}

/** To and fro between two points, each way in `duration` s with the quintic profile and a `pause` after it. */
export function cycleAt({ start, goal, duration, pause }, t) {
  const way = duration + pause, k = Math.floor(t / way), r = Math.min((t - k * way) / duration, 1);
  const moves = r < 1;
  const s = r * r * r * (10 - 15 * r + 6 * r * r);
  const rate = moves ? (30 * r * r * (1 - 2 * r + r * r)) / duration : 0;
  const slope = moves ? (60 * r * (1 - 3 * r + 2 * r * r)) / (duration * duration) : 0;
  const [from, to] = k % 2 === 0 ? [start, goal] : [goal, start];
  return [
    from.map((x, i) => x + s * (to[i] - x)),
    from.map((x, i) => rate * (to[i] - x)),
    from.map((x, i) => slope * (to[i] - x)),
  ];
}

/** Rows of a table (increasing times) around a time: the place of the row before it, and how far it is to the next. */
export function between(times, t) {
  const last = times.length - 1;
  if (last < 1 || t <= times[0]) return [0, 0];
  if (t >= times[last]) return [last, 0];
  const k = pieceAt(times, t);
  return [k, (t - times[k]) / (times[k + 1] - times[k])];
}
