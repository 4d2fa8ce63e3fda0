// A rig: what its servos do, and, once this page has armed it, its modules' bends.

import { slider } from "./controls.js";
import { servoTable } from "./overlays.js";

const get = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** How often the page says that it is there while it holds the rig (ms): it is let go after three seconds of silence. */
const HERE = 500;
const DEGREE = 180 / Math.PI;

export class RigPanel {
  /** @param {(order: import("./link.js").Order) => void} tell */
  constructor(tell) {
    this.tell = tell;
    /** @type {import("./link.js").RigLimits | null} */
    this.limits = null;
    this.armed = false;
    /** @type {{angle: number, direction: number, tension: number}[]} */
    this.modules = [];
    this.heard = -1;
    get("rig-arm").onclick = () => tell({ type: this.armed ? "disarm" : "arm" });
    get("rig-straight").onclick = () => this.straighten();
    setInterval(() => { if (this.armed) tell({ type: "here" }); }, HERE);
  }

  /** @param {import("./link.js").RigLimits | null} limits */
  show(limits) {
    this.limits = limits;
    get("rig-section").hidden = limits === null;
    document.body.classList.toggle("of-rig", limits !== null);
    if (limits === null) return;
    get("rig-name").textContent = limits.name;
    this.sliders = limits.bend.map((most, index) => {
      const change = (/** @type {object} */ part) => {
        Object.assign(this.modules[index], part);
        this.move();
      };
      return {
        angle: slider(`${index + 1}: bend`, { min: 0, max: most, step: most / 200 || 1 }, (angle) => change({ angle })),
        direction: slider("direction", { min: -180, max: 180, step: 1 }, (turn) => change({ direction: turn / DEGREE })),
        tension: slider("tension", { min: Math.min(limits.tension[0], limits.rest[index]), max: limits.tension[1], step: 0.1 },
          (tension) => change({ tension })),
      };
    });
    get("rig-modules").replaceChildren(...this.sliders.flatMap(({ angle, direction, tension }) => [angle.row, direction.row, tension.row]));
    this.rest();
  }

  /** The shape at home, which the rig has when it is armed. */
  rest() {
    this.modules = this.limits.rest.map((tension) => ({ angle: 0, direction: 0, tension }));
    this.label();
  }

  straighten() {
    this.rest();
    this.move();
  }

  move() {
    this.label();
    if (!this.armed) return;
    this.tell({
      type: "shape",
      modules: this.modules.map(({ angle, direction, tension }) => ({
        toward: [angle * Math.cos(direction), angle * Math.sin(direction)], tension,
      })),
    });
  }

  label() {
    this.sliders.forEach(({ angle, direction, tension }, index) => {
      const module = this.modules[index];
      angle.show(module.angle, `${(module.angle * DEGREE).toFixed(0)}°`);
      direction.show(module.direction * DEGREE, `${(module.direction * DEGREE).toFixed(0)}°`);
      tension.show(module.tension, `${module.tension.toFixed(1)} N`);
      for (const { input } of [angle, direction, tension]) input.disabled = !this.armed;
    });
  }

  /** @param {import("./link.js").Rig} rig */
  hear({ armed, moving, servos, said }) {
    const isArmed = armed === "here";
    if (isArmed !== this.armed) {
      this.armed = isArmed;
      this.rest();
    }
    get("rig-arm").textContent = isArmed ? "Release" : "Arm";
    get("rig-arm").classList.toggle("armed", isArmed);
    get("rig-arm").disabled = armed === "elsewhere";
    get("rig-straight").disabled = !isArmed;
    const state = { no: "motors off", here: moving ? "moving" : "armed: holds its shape", elsewhere: "armed by another page" }[armed];
    get("rig-state").textContent = said === null ? state : `${state}. ${said[1]}`;
    servoTable(get("rig-servos"), servos);
    Object.assign(document.body.dataset, { armed, moving: String(moving), said: said?.[1] ?? "" });
  }

  /** @param {import("./link.js").Cloud} cloud */
  look({ points, distance }) {
    const apart = Number.isNaN(distance) ? "" : `; the simulated robot is ${(1e3 * distance).toFixed(2)} mm from it on average`;
    get("rig-apart").textContent = `the cameras see ${points.length / 3} points${apart}`;
    document.body.dataset.measured = String(points.length / 3);
  }
}
