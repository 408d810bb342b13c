// The robot in space: reality, what it is compared with, springs, paths of the tool, and who pushes.

import * as THREE from "three";
import { OrbitControls } from "#live/three/OrbitControls";
import { BentAxis } from "#live/bent";
import { bytesOf } from "#live/numbers";
import { moved } from "#live/poses";

const COLORS = {
  light: { back: 0xf4f6f8, grid: 0xd5dae0, section: 0xb8c0c8, real: 0x4678aa, ghost: 0x8b939b, ground: 0x9aa4ae },
  dark: { back: 0x15191e, grid: 0x2b323a, section: 0x3d464f, real: 0x6fa3d8, ghost: 0x9aa3ab, ground: 0x59636d },
};
const PATH = 0xcc3311, SPRING = 0x009e73, PUSH = 0x882255, DRUM = 0x39424c;
const TRAIL = 600; // points of a path

export class Scene {
  /** canvas: an element; data: of the page. */
  constructor(canvas, data) {
    this.data = data;
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.world = new THREE.Scene();
    const { camera, up, size, floor } = data;
    this.camera = new THREE.PerspectiveCamera((camera.fov * 180) / Math.PI, 1, 1e-3 * camera.away, 1e2 * camera.away);
    this.camera.up.set(...up);
    this.home = { position: camera.position, target: camera.look_at };
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.listenToKeyEvents?.(canvas);
    this.orbit.addEventListener("change", () => { this.stale = true; });
    this.look();
    this.sun = new THREE.DirectionalLight(0xffffff, 2.0);
    const side = new THREE.Vector3(...up).multiplyScalar(2).add(new THREE.Vector3(...camera.position).normalize());
    this.sun.position.copy(side);
    this.world.add(this.sun, new THREE.HemisphereLight(0xffffff, 0x8899aa, 1.6));
    this.up = new THREE.Vector3(...up);
    this.place = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), this.up);
    this.floor = floor;
    const cell = 10 ** Math.floor(Math.log10(size));
    this.cells = Math.max(8, Math.ceil((4 * size) / cell));
    this.extent = this.cells * cell;
    this.materials = {
      real: new THREE.MeshStandardMaterial({ roughness: 0.55, metalness: 0.15 }),
      drum: new THREE.MeshStandardMaterial({ color: DRUM, roughness: 0.5, metalness: 0.3 }),
      ground: new THREE.MeshStandardMaterial({ roughness: 0.8, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }),
      // behind what is where it is, so that the two do not flicker
      ghost: new THREE.MeshStandardMaterial({ transparent: true, opacity: 0.42, depthWrite: false, roughness: 1, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 }),
    };
    const geometries = this.bodies();
    this.reality = this.robot(geometries, false);
    this.ghost = this.robot(geometries, true);
    this.world.add(this.reality.root, this.ghost.root);
    this.paths = { real: this.trail(PATH), program: this.trail(0x888888) };
    this.rods = data.rods.map(({ radius }) => {
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, 20), this.materials.drum);
      this.world.add(rod);
      return rod;
    });
    this.springs = this.segments(data.springs.length, SPRING);
    this.arrow = new THREE.ArrowHelper(new THREE.Vector3(0, 0, 1), new THREE.Vector3(), 1, PUSH);
    this.arrow.visible = false;
    this.world.add(this.arrow);
    this.frame = new THREE.AxesHelper(0.15 * size);
    this.world.add(this.frame);
    this.theme(false);
    this.stale = true;
  }

  /** From where it was seen first. */
  look() {
    this.camera.position.set(...this.home.position);
    this.orbit.target.set(...this.home.target);
    this.orbit.update();
    this.stale = true;
  }

  theme(dark) {
    const colors = COLORS[dark ? "dark" : "light"];
    this.world.background = new THREE.Color(colors.back);
    this.materials.real.color.set(colors.real);
    this.materials.ghost.color.set(colors.ghost);
    this.materials.ground.color.set(colors.ground);
    if (this.grid) this.world.remove(this.grid);
    this.grid = new THREE.GridHelper(this.extent, this.cells, colors.section, colors.grid);
    this.grid.quaternion.copy(this.place);
    this.grid.position.copy(this.up).multiplyScalar(this.floor);
    this.world.add(this.grid);
    this.stale = true;
  }

  /** Geometries of links: meshes, capsules, and a drum on the axis of each joint where there are no meshes. */
  bodies() {
    const found = [];
    for (const { link, vertices, faces } of this.data.meshes) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytesOf(vertices).buffer), 3));
      geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytesOf(faces).buffer), 1));
      const sharp = geometry.toNonIndexed();
      sharp.computeVertexNormals();
      found.push({ link, geometry: sharp, material: "real" });
    }
    for (const { link, begin, end, radius } of this.data.capsules) {
      const [a, b] = [new THREE.Vector3(...begin), new THREE.Vector3(...end)];
      const length = a.distanceTo(b);
      const geometry = new THREE.CapsuleGeometry(radius, length, 6, 20);
      if (length > 1e-9) geometry.applyQuaternion(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.clone().sub(a).normalize()));
      geometry.translate(...a.add(b).multiplyScalar(0.5).toArray());
      found.push({ link, geometry, material: link === this.data.base ? "ground" : "real" });
    }
    for (const { link, axis, slides, radius } of this.data.drums) {
      const geometry = slides
        ? new THREE.BoxGeometry(1.5 * radius, 3 * radius, 1.5 * radius)
        : new THREE.CylinderGeometry(radius, radius, 2.4 * radius, 32);
      geometry.applyQuaternion(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...axis)));
      found.push({ link, geometry, material: "drum" });
    }
    return found;
  }

  robot(bodies, ghost) {
    const root = new THREE.Group(), links = new Map();
    const add = (link, mesh) => {
      if (!links.has(link)) {
        const group = new THREE.Group();
        group.matrixAutoUpdate = false;
        links.set(link, group);
        root.add(group);
      }
      mesh.name = link;
      links.get(link).add(mesh);
    };
    for (const { link, geometry, material } of bodies) add(link, new THREE.Mesh(geometry, this.materials[ghost ? "ghost" : material]));
    const axes = this.data.bent.map((packed) => {
      const axis = new BentAxis(packed), geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(axis.vertices, 3));
      geometry.setIndex(axis.faces());
      const mesh = new THREE.Mesh(geometry, this.materials[ghost ? "ghost" : "real"]);
      mesh.frustumCulled = false; // its bounds are those of how it was bent first
      mesh.axis = axis;
      add(axis.link, mesh);
      return mesh;
    });
    return { root, links, axes };
  }

  trail(color) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL), 3));
    geometry.setDrawRange(0, 0);
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.8 }));
    line.frustumCulled = false;
    this.world.add(line);
    return line;
  }

  segments(count, color) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * count), 3));
    const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color }));
    lines.frustumCulled = false;
    this.world.add(lines);
    return lines;
  }

  /** Put a robot's links where their poses are, 16 numbers each, row by row, and bend them as they bend at q. */
  pose(robot, poseOf, q) {
    for (const { axis, geometry } of robot.axes) {
      axis.bend(q);
      geometry.attributes.position.needsUpdate = true;
      geometry.computeVertexNormals();
      geometry.boundingSphere = geometry.boundingBox = null;
    }
    for (const [link, group] of robot.links) {
      group.matrix.set(...poseOf(link));
      group.matrixWorldNeedsUpdate = true;
    }
    this.stale = true;
  }

  moveSprings(poseOf) {
    this.data.rods.forEach(({ links, points }, i) => {
      const [a, b] = links.map((link, side) => new THREE.Vector3(...moved(poseOf(link), points[side])));
      const rod = this.rods[i], length = a.distanceTo(b);
      rod.visible = length > 1e-9;
      if (!rod.visible) return;
      rod.scale.set(1, length, 1);
      rod.position.copy(a).add(b).multiplyScalar(0.5);
      rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.sub(a).divideScalar(length));
    });
    if (!this.data.springs.length) return;
    const places = this.springs.geometry.attributes.position;
    this.data.springs.forEach(({ links, points }, i) => {
      links.forEach((link, side) => places.setXYZ(2 * i + side, ...moved(poseOf(link), points[side])));
    });
    places.needsUpdate = true;
  }

  /** A path through points, (3,) each: the last TRAIL of them. */
  drawPath(kind, points) {
    const { geometry } = this.paths[kind], places = geometry.attributes.position;
    const first = Math.max(points.length - TRAIL, 0);
    for (let i = first; i < points.length; i++) places.setXYZ(i - first, ...points[i]);
    places.needsUpdate = true;
    geometry.setDrawRange(0, points.length - first);
    this.stale = true;
  }

  /** Show a force at a point; null hides it.  unit: newtons that are drawn as a third of the robot. */
  showPush(point, force, unit) {
    const size = force ? Math.hypot(...force) : 0;
    this.arrow.visible = size > 0;
    if (size > 0) {
      const length = 0.34 * this.data.size * Math.min(size / unit, 2);
      this.arrow.position.set(...point);
      this.arrow.setDirection(new THREE.Vector3(...force).divideScalar(size));
      this.arrow.setLength(length, Math.min(0.07 * this.data.size, 0.5 * length), 0.035 * this.data.size);
    }
    this.stale = true;
  }

  /** The ray of a pointer event from the camera. */
  ray(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new THREE.Vector2(
      ((event.clientX - box.left) / box.width) * 2 - 1,
      1 - ((event.clientY - box.top) / box.height) * 2,
    );
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.camera);
    return caster;
  }

  /** Link and point (link's frame) of reality that a pointer is on, of links that bend the nearest node; null: none. */
  pick(event) {
    const [hit] = this.ray(event).intersectObject(this.reality.root, true);
    if (!hit || hit.object.name === this.data.base) return null;
    const { name, axis } = hit.object, nearest = axis ? axis.nearest(hit.face.a) : name;
    const link = this.reality.links.has(nearest) ? nearest : name, group = this.reality.links.get(link);
    const point = hit.point.clone().applyMatrix4(group.matrix.clone().invert());
    const facing = this.camera.getWorldDirection(new THREE.Vector3());
    this.pulled = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, hit.point);
    return { link, point: point.toArray() };
  }

  /** Where a pointer is in the plane through the point that was picked. */
  pointAt(event) {
    return this.ray(event).ray.intersectPlane(this.pulled, new THREE.Vector3())?.toArray() ?? null;
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width !== this.width || height !== this.height) {
      [this.width, this.height] = [width, height];
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / Math.max(height, 1);
      this.camera.zoom = 1.15 * Math.min(1, this.camera.aspect); // all of it is seen in a narrow window, too
      this.camera.updateProjectionMatrix();
      this.stale = true;
    }
    if (!this.stale) return;
    this.renderer.render(this.world, this.camera);
    this.stale = false;
  }
}
