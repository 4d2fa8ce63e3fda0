// The robot in 3-D, and the hand that drags its discs.

import * as THREE from "three";
import { OrbitControls } from "./three/OrbitControls.js";
import { dispose, mesh, put } from "./solids.js";

/** Push of the hand per distance from the disc (N/m). */
const PUSH = 20;
/** Length of an arrow per force (m/N). */
const ARROW = 0.05;
const STEEL = 7850;

export class Stage {
  /**
   * @param {HTMLElement} place
   * @param {{drag: (disc: number, to: number[]) => void, push: (disc: number, force: number[]) => void,
   *   grab: () => void, release: (disc: number, pushed: boolean) => void}} hand what the hand does
   */
  constructor(place, hand) {
    this.place = place;
    this.hand = hand;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    place.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.001, 100);
    this.camera.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.camera, this.renderer.domElement);
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(1, -1.5, 3);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 1.6), sun);
    this.robot = new THREE.Group();
    this.obstacles = new THREE.Group();
    this.marks = new THREE.Group();
    this.targets = new THREE.Group();
    /** @type {Map<string, THREE.Points<THREE.BufferGeometry, THREE.PointsMaterial>>} */
    this.clouds = new Map();
    this.scene.add(this.robot, this.obstacles, this.marks, this.targets);
    /** @type {THREE.Mesh[]} */
    this.solids = [];
    /** @type {THREE.Line<THREE.BufferGeometry, THREE.LineBasicMaterial>[]} */
    this.tendons = [];
    /** @type {{disc: number, pushed: boolean, plane: THREE.Plane, to?: THREE.Vector3} | null} */
    this.held = null;
    /** Whether discs can be dragged. */
    this.isFree = true;
    this.follow();
    const resize = () => this.resize();
    new ResizeObserver(resize).observe(place);
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    const paint = () => {
      this.scene.background = new THREE.Color(getComputedStyle(document.body).getPropertyValue("--ground").trim());
      this.dirty = true;
    };
    scheme.addEventListener("change", paint);
    paint();
    this.orbit.addEventListener("change", () => { this.dirty = true; });
    this.renderer.setAnimationLoop(() => this.draw());
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.place;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  draw() {
    this.orbit.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    const isFirst = this.layout === undefined;
    this.layout = layout;
    for (const group of [this.robot, this.obstacles, this.marks]) {
      dispose(group);
      group.clear();
    }
    this.solids = layout.solids.map((solid) => {
      const made = mesh(solid);
      made.userData.disc = solid.disc;
      return made;
    });
    this.tendons = layout.tendons.map((tendon) => {
      const line = new THREE.BufferGeometry();
      line.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * tendon.holes), 3));
      const made = new THREE.Line(line, new THREE.LineBasicMaterial());
      made.frustumCulled = false;
      return made;
    });
    this.ball = mesh({ shape: { kind: "sphere", radius: 1 }, color: [150, 155, 165], disc: null });
    this.robot.add(...this.solids, ...this.tendons, this.ball);
    this.fade();
    for (const obstacle of layout.obstacles) {
      const made = mesh(obstacle, { opacity: 0.45 });
      put(made, obstacle.pose);
      this.obstacles.add(made);
    }
    if (this.grid === undefined || isFirst) {
      this.grid = new THREE.GridHelper(1, 20, 0x8893a5, 0xb7bfcc).rotateX(Math.PI / 2);
      this.scene.add(this.grid);
    }
    this.isNew = isFirst;
  }

  /** @param {import("./link.js").Frame} frame */
  move(frame) {
    this.solids.forEach((solid, index) => put(solid, frame.solids, 7 * index));
    const most = Math.max(1, ...frame.tensions);
    let at = 0;
    this.tendons.forEach((line, index) => {
      const { holes } = this.layout.tendons[index];
      const position = line.geometry.getAttribute("position");
      position.array.set(frame.holes.subarray(at, at + 3 * holes));
      position.needsUpdate = true;
      at += 3 * holes;
      // Slack tendons are grey, the tightest red.
      const share = Math.max(0, frame.tensions[index] / most);
      line.material.color.setRGB(0.45 + 0.45 * share, 0.45 * (1 - share) + 0.05, 0.5 * (1 - share) + 0.05);
    });
    this.hang(frame);
    this.mark(frame);
    if (this.isNew) {
      this.isNew = false;
      this.look(frame);
    }
    this.last = frame;
    this.dirty = true;
    // In motion a disc moves under a hand that is still.
    if (frame.physics === "in_motion") this.push();
  }

  /** Pushes the disc that is held with Shift, by the hand's distance from it. */
  push() {
    if (this.held === null || !this.held.pushed || this.held.to === undefined) return;
    const { disc, to } = this.held;
    const solid = this.solids.find((one) => one.userData.disc === disc);
    if (solid !== undefined) this.hand.push(disc, to.clone().sub(solid.position).multiplyScalar(PUSH).toArray());
  }

  /** Shows a cloud in place of the one before of its role. @param {import("./link.js").Cloud} cloud */
  cloud({ role, points, colors }) {
    this.hide(role);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
    if (role !== "prediction") geometry.setAttribute("color", new THREE.BufferAttribute(colors, 3, true));
    // Predicted points are told from those that cameras saw.
    const paint = role === "prediction" ? { color: 0xd6336c } : { vertexColors: true };
    const made = new THREE.Points(geometry, new THREE.PointsMaterial({ size: 3, sizeAttenuation: false, ...paint }));
    made.frustumCulled = false;
    this.clouds.set(role, made);
    this.scene.add(made);
    this.fade();
  }

  /** Balls at places that the program marks. @param {Float32Array} places @param {number} radius */
  target(places, radius) {
    dispose(this.targets);
    this.targets.clear();
    const paint = new THREE.MeshLambertMaterial({ color: 0xdc1e1e });
    const balls = new THREE.InstancedMesh(new THREE.SphereGeometry(radius, 24, 16), paint, places.length / 3);
    for (let ball = 0; ball < balls.count; ball++) {
      const [x, y, z] = places.subarray(3 * ball);
      balls.setMatrixAt(ball, new THREE.Matrix4().makeTranslation(x, y, z));
    }
    balls.frustumCulled = false;
    this.targets.add(balls);
    this.dirty = true;
    document.body.dataset.targets = String(balls.count);
  }

  /** @param {import("./link.js").Role} role */
  hide(role) {
    const before = this.clouds.get(role);
    if (before === undefined) return;
    dispose(before);
    this.scene.remove(before);
    this.clouds.delete(role);
    this.fade();
  }

  /** The robot lets its clouds be seen through it. */
  fade() {
    const opacity = this.clouds.size > 0 ? 0.3 : 1;
    for (const { material } of this.solids) {
      Object.assign(/** @type {THREE.Material} */ (material), {
        opacity, transparent: opacity < 1, depthWrite: opacity === 1, needsUpdate: true,
      });
    }
    this.dirty = true;
  }

  /** A payload is a ball of steel on the distal disc. @param {import("./link.js").Frame} frame */
  hang(frame) {
    const radius = Math.cbrt((3 * frame.payload) / (4 * Math.PI * STEEL));
    const tip = this.solids.filter((solid) => solid.userData.disc !== null).at(-1);
    this.ball.visible = radius > 0 && tip !== undefined;
    if (!this.ball.visible) return;
    const { half_height: half } = this.layout.solids[this.solids.indexOf(tip)].shape;
    this.ball.scale.setScalar(radius);
    this.ball.position.set(0, 0, (half ?? 0) + radius).applyQuaternion(tip.quaternion).add(tip.position);
  }

  /** Forces of contacts as arrows. @param {import("./link.js").Frame} frame */
  mark(frame) {
    dispose(this.marks);
    this.marks.clear();
    for (const contact of frame.contacts) {
      const force = new THREE.Vector3(...contact.force);
      const size = force.length();
      if (size < 1e-4) continue;
      const from = new THREE.Vector3(...contact.point);
      const length = Math.min(0.02 + ARROW * size, 0.5 * this.layout.length);
      this.marks.add(new THREE.ArrowHelper(force.divideScalar(size), from, length, 0xd9480f, 0.25 * length, 0.12 * length));
    }
  }

  /** Puts the camera where all is seen. @param {import("./link.js").Frame} frame */
  look(frame) {
    const box = new THREE.Box3();
    for (const solid of this.solids) box.expandByObject(solid);
    box.expandByPoint(new THREE.Vector3(...frame.tip));
    const middle = box.getCenter(new THREE.Vector3());
    const size = Math.max(box.getSize(new THREE.Vector3()).length(), this.layout.length);
    this.orbit.target.copy(middle);
    this.camera.position.copy(middle).add(new THREE.Vector3(1, -1.2, 0.45).normalize().multiplyScalar(1.7 * size));
    this.camera.near = 0.002 * size;
    this.camera.far = 60 * size;
    this.camera.updateProjectionMatrix();
  }

  /** Follows pointers: a disc under one is dragged, with Shift pushed. */
  follow() {
    const canvas = this.renderer.domElement;
    const ray = new THREE.Raycaster();
    const aim = (/** @type {PointerEvent} */ event) => {
      const box = canvas.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width) * 2 - 1;
      const y = 1 - ((event.clientY - box.top) / box.height) * 2;
      ray.setFromCamera(new THREE.Vector2(x, y), this.camera);
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.isFree) return;
      aim(event);
      const discs = this.solids.filter((solid) => solid.userData.disc !== null);
      const [hit] = ray.intersectObjects(discs, false);
      if (hit === undefined || event.button !== 0) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(event.pointerId);
      const facing = this.camera.getWorldDirection(new THREE.Vector3());
      const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, hit.object.position);
      this.held = { disc: hit.object.userData.disc, pushed: event.shiftKey, plane };
      this.orbit.enabled = false;
      this.hand.grab();
    }, { capture: true });
    canvas.addEventListener("pointermove", (event) => {
      if (this.held === null) return;
      aim(event);
      const to = ray.ray.intersectPlane(this.held.plane, new THREE.Vector3());
      if (to === null) return;
      this.held.to = to;
      if (this.held.pushed) this.push();
      else this.hand.drag(this.held.disc, to.toArray());
    });
    const release = () => {
      if (this.held === null) return;
      const { disc, pushed } = this.held;
      this.held = null;
      this.orbit.enabled = true;
      this.hand.release(disc, pushed);
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
  }

  /** The picture as a PNG. @returns {Promise<Blob | null>} */
  picture() {
    this.renderer.render(this.scene, this.camera);
    return new Promise((resolve) => this.renderer.domElement.toBlob(resolve));
  }
}
