// Poses of frames in the base, 16 numbers each, row by row.

/** Product of two poses. */
export function times(a, b) {
  const made = new Array(16);
  for (let i = 0; i < 4; i++) {
    for (let j = 0; j < 4; j++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * i + k] * b[4 * k + j];
      made[4 * i + j] = sum;
    }
  }
  return made;
}

/** A vector of a frame in the axes of the base. */
export function turned(pose, [x, y, z]) {
  return [0, 4, 8].map((row) => pose[row] * x + pose[row + 1] * y + pose[row + 2] * z);
}

/** A point of a frame in the base. */
export function moved(pose, point) {
  const place = turned(pose, point);
  return [place[0] + pose[3], place[1] + pose[7], place[2] + pose[11]];
}
