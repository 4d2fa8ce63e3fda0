// The socket to this page's session: letters as JSON, answers as JSON or as frames of little-endian doubles.

/**
 * @typedef {{low: number, high: number, unit: string, group: string, angle: number, holes: number}} Tendon
 * @typedef {{kind: string, radius?: number, half_height?: number, half_length?: number, half_sides?: number[],
 *   vertices?: number[][], triangles?: number[][]}} Shape
 * @typedef {{shape: Shape, color: number[], disc: number | null}} Solid
 * @typedef {Solid & {name: string, pose: number[]}} Obstacle
 * @typedef {{name: string, toml: string | null, length: number, solids: Solid[], obstacles: Obstacle[], tendons: Tendon[],
 *   discs: number, stabilities: string[], recorded: number[][], friction: number | null, cameras: number}} Layout
 * @typedef {{disc: number, partner: number, point: number[], normal: number[], force: number[], gap: number}} Contact
 * @typedef {"at_rest" | "with_friction" | "in_motion" | "given"} Physics
 * @typedef {{stamp: number, solve: number, residual: number, iterations: number, converged: boolean, stability: string,
 *   payload: number, physics: Physics, time: number, load: number, tip: number[], command: number[], tensions: number[], lengths: number[], solids: Float64Array,
 *   holes: Float64Array, contacts: Contact[]}} Frame
 * @typedef {{type: "command" | "settle", command: number[]} | {type: "drag", disc: number, to: number[]} |
 *   {type: "push", disc: number, force: number[]} | {type: "payload", mass: number} | {type: "robot", toml: string} |
 *   {type: "physics", physics: Physics, coefficient: number} | {type: "pictures"} |
 *   {type: "sample", split: string, index: number} | {type: "predict", on: boolean} | {type: "moment", time: number} |
 *   {type: "row", row: number}} Request
 * @typedef {"sample" | "prediction" | "recorded" | "measured" | "marked"} Role
 * @typedef {{role: Role, distance: number, seconds: number, points: Float32Array, colors: Uint8Array}} Cloud
 * @typedef {{id: number, position: number, current: number, temperature: number | null}} Servo
 * @typedef {{time: number, command: number[] | null, servos: Servo[]}} Moment
 * @typedef {{time: number, level: string, text: string}} Happened
 * @typedef {{end: number, clouds: number[], omitted: number, events: Happened[]}} Log
 * @typedef {{title: string, columns: string[], rows: number[], values: (number | null)[][]}} Study
 * @typedef {{data: {split: string, samples: number}[] | null, model: {robot: string | null} | null, log: Log | null,
 *   study: Study | null, rig: RigLimits | null}} Overlays
 * @typedef {{name: string, bend: number[], tension: number[], rest: number[], cameras: number}} RigLimits
 * @typedef {{armed: "no" | "here" | "elsewhere", moving: boolean, servos: Servo[], said: [number, string] | null}} Rig
 * @typedef {{type: "arm" | "disarm" | "here"} | {type: "shape", modules: {toward: number[], tension: number}[]}} Order
 * @typedef {{index: number, count: number, width: number, height: number, pixels: Uint8Array}} Picture
 */

/** What a message of numbers holds, by its first number: `Kind` in `src/view/frame.rs`. */
const KIND = { frame: 0, cloud: 1, picture: 2, taken: 3 };
/** @type {Physics[]} */
const PHYSICS = ["at_rest", "with_friction", "in_motion", "given"];
/** @type {Role[]} */
const ROLES = ["sample", "prediction", "recorded", "measured", "marked"];

/** Numbers of a contact in a frame. */
const CONTACT = 12;

/**
 * What a message of numbers says: the order is that of `Frame::bytes` in `src/view/frame.rs`.
 * @param {ArrayBuffer} buffer
 * @param {string[]} stabilities
 * @returns {Frame}
 */
export function decode(buffer, stabilities) {
  const numbers = new Float64Array(buffer);
  let at = 1;
  const next = (/** @type {number} */ count) => numbers.subarray(at, (at += count));
  const [stamp, solve, residual, iterations, converged, stability, payload, physics, time, load] = next(10);
  const tip = [...next(3)];
  const [tendons, solids, holes, contacts] = next(4);
  const frame = {
    stamp, solve, residual, iterations, converged: converged === 1, stability: stabilities[stability] ?? "not settled", payload,
    physics: PHYSICS[physics], time, load, tip,
    command: [...next(tendons)], tensions: [...next(tendons)], lengths: [...next(tendons)],
    solids: next(7 * solids), holes: next(3 * holes), contacts: /** @type {Contact[]} */ ([]),
  };
  for (let contact = 0; contact < contacts; contact++) {
    const [disc, partner, ...rest] = next(CONTACT);
    frame.contacts.push({
      disc, partner, point: rest.slice(0, 3), normal: rest.slice(3, 6), force: rest.slice(6, 9), gap: rest[9],
    });
  }
  return frame;
}

/**
 * @param {ArrayBuffer} buffer
 * @returns {Picture}
 */
function picture(buffer) {
  const [, index, count, width, height] = new Float64Array(buffer, 0, 5);
  return { index, count, width, height, pixels: new Uint8Array(buffer, 40) };
}

/**
 * What a message of a cloud says: the order is that of `bytes` in `src/view/cloud.rs`.
 * @param {ArrayBuffer} buffer
 * @returns {Cloud}
 */
function cloud(buffer) {
  const [, role, count, distance, seconds] = new Float64Array(buffer, 0, 5);
  return {
    role: ROLES[role], distance, seconds,
    points: new Float32Array(buffer, 40, 3 * count), colors: new Uint8Array(buffer, 40 + 12 * count, 3 * count),
  };
}

/** A socket that is asked one thing after another: while an answer is awaited, only the newest of a kind waits. */
export class Link {
  /**
   * @param {{robot: (layout: Layout) => void, frame: (frame: Frame, trip: number) => void,
   *   picture: (picture: Picture) => void, taken: (picture: Picture) => void, cloud: (cloud: Cloud) => void, overlays: (overlays: Overlays) => void,
   *   moment: (moment: Moment) => void, rig: (rig: Rig) => void, refused: (of: string, reason: string) => void, lost: () => void}} heard
   */
  constructor(heard) {
    this.heard = heard;
    this.stamp = 0;
    /** @type {Map<number, number>} */
    this.sent = new Map();
    /** @type {Map<string, Request>} */
    this.waiting = new Map();
    /** @type {string[]} */
    this.stabilities = [];
    this.socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = (event) => this.hear(event.data);
    this.socket.onclose = () => heard.lost();
  }

  /** @param {Request} request */
  ask(request) {
    if (this.sent.size > 1 || this.socket.readyState !== WebSocket.OPEN) {
      this.waiting.delete(request.type);
      this.waiting.set(request.type, request);
      return;
    }
    this.stamp += 1;
    this.sent.set(this.stamp, performance.now());
    this.socket.send(JSON.stringify({ stamp: this.stamp, ...request }));
  }

  /** Orders to the rig, which are not answered by frames. @param {Order} order */
  tell(order) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ stamp: 0, ...order }));
  }

  /** @param {string | ArrayBuffer} data */
  hear(data) {
    if (typeof data === "string") {
      const { type, ...words } = JSON.parse(data);
      if (type === "robot") {
        this.stabilities = words.stabilities;
        this.heard.robot(words);
      } else if (type === "overlays") {
        this.heard.overlays(words);
        return;
      } else if (type === "moment") {
        this.heard.moment(words);
        return;
      } else if (type === "rig") {
        this.heard.rig(words);
        return;
      } else {
        this.sent.clear();
        this.heard.refused(words.of, words.reason);
      }
    } else if (new Float64Array(data, 0, 1)[0] === KIND.cloud) {
      this.heard.cloud(cloud(data));
      return;
    } else if (new Float64Array(data, 0, 1)[0] === KIND.taken) {
      this.heard.taken(picture(data));
      return;
    } else if (new Float64Array(data, 0, 1)[0] === KIND.picture) {
      const seen = picture(data);
      this.heard.picture(seen);
      if (seen.index < seen.count - 1) return;
      // Pictures have no stamp: the last of them is the answer.
      const [oldest] = this.sent.keys();
      this.sent.delete(oldest);
    } else {
      const frame = decode(data, this.stabilities);
      const begun = this.sent.get(frame.stamp);
      for (const stamp of [...this.sent.keys()]) {
        if (stamp <= frame.stamp) this.sent.delete(stamp);
      }
      this.heard.frame(frame, begun === undefined ? NaN : performance.now() - begun);
    }
    const [first] = this.waiting;
    if (first !== undefined) {
      this.waiting.delete(first[0]);
      this.ask(first[1]);
    }
  }
}
