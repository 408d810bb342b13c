// Links that bend: tubes about their axes, which follow modal coordinates.

import { floatsOf } from "#live/numbers";

export class BentAxis {
  /** data: of the page, as Python packs it; f4 numbers of S stations and K points of a section's outline. */
  constructor({ link, modes, places, Phi, Psi, outline, nodes }) {
    const rows = (packed) => packed.map((text) => (text === null ? null : floatsOf(text)));
    Object.assign(this, { link, modes, nodes });
    [this.places, this.outline, this.Phi, this.Psi] = [floatsOf(places), floatsOf(outline), rows(Phi), rows(Psi)];
    this.rings = this.places.length / 3;
    this.around = this.outline.length / 3;
    this.vertices = new Float32Array(3 * (this.rings + 2) * this.around);
  }

  /** x, y, z, alpha, beta, gamma of a section, by modal coordinates: Phi e + 1/2 e Psi e. */
  coordinates(station, e) {
    const m = e.length, found = [0, 0, 0, 0, 0, 0];
    this.Phi.forEach((row, i) => {
      if (row !== null) for (let k = 0; k < m; k++) found[i] += row[station * m + k] * e[k];
    });
    this.Psi.forEach((row, i) => {
      if (row === null) return;
      for (let k = 0; k < m; k++) for (let l = 0; l < m; l++) found[i] += 0.5 * row[(station * m + k) * m + l] * e[k] * e[l];
    });
    return found;
  }

  /** Put the vertices, link's frame, m, where the link is at q: rings from the root to the tip, and both ends again. */
  bend(q) {
    const e = this.modes.map((place) => q[place]), { rings, around, outline, vertices } = this;
    for (let ring = 0; ring < rings; ring++) {
      const [x, y, z, ...angles] = this.coordinates(ring, e);
      const [[ca, sa], [cb, sb], [cg, sg]] = angles.map((angle) => [Math.cos(angle), Math.sin(angle)]);
      const R = [
        cb * cg, -cb * sg, sb,
        ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb,
        sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb,
      ];
      [x, y, z].forEach((way, i) => {
        const middle = this.places[3 * ring + i] + way;
        for (let k = 0; k < around; k++) {
          const at = 3 * k, turned = R[3 * i] * outline[at] + R[3 * i + 1] * outline[at + 1] + R[3 * i + 2] * outline[at + 2];
          vertices[3 * (ring * around + k) + i] = middle + turned;
        }
      });
    }
    const size = 3 * around;
    vertices.copyWithin(rings * size, 0, size);
    vertices.copyWithin((rings + 1) * size, (rings - 1) * size, rings * size);
    return vertices;
  }

  /** Triangles between the vertices, anticlockwise seen from outside. */
  faces() {
    const { rings, around } = this, found = [];
    for (let ring = 0; ring + 1 < rings; ring++) {
      for (let k = 0; k < around; k++) {
        const low = ring * around, high = low + around, ahead = (k + 1) % around;
        found.push(low + k, low + ahead, high + ahead, low + k, high + ahead, high + k);
      }
    }
    const first = rings * around, last = first + around;
    for (let k = 1; k + 1 < around; k++) found.push(first, first + k + 1, first + k, last, last + k, last + k + 1);
    return found;
  }

  /** The link that a vertex moves with most nearly, of its own link and its nodes, and where that stands in its link. */
  nearest(vertex) {
    const ring = Math.floor(vertex / this.around), station = ring < this.rings ? ring : ring === this.rings ? 0 : this.rings - 1;
    const away = (place) => Math.hypot(...[0, 1, 2].map((i) => place[i] - this.places[3 * station + i]));
    return this.nodes.reduce((best, node) => (away(node.place) < away(best.place) ? node : best), { link: this.link, place: [0, 0, 0] }).link;
  }
}
