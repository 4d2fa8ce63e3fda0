// The socket to this page's session: letters as JSON, answers as JSON or as frames of little-endian doubles.

/**
 * @typedef {{low: number, high: number, unit: string, group: string, angle: number, holes: number}} Tendon
 * @typedef {{kind: string, radius?: number, half_height?: number, half_length?: number, half_sides?: number[],
 *   vertices?: number[][], triangles?: number[][]}} Shape
 * @typedef {{shape: Shape, color: number[], disc: number | null}} Solid
 * @typedef {Solid & {name: string, pose: number[]}} Obstacle
 * @typedef {{name: string, toml: string | null, length: number, solids: Solid[], obstacles: Obstacle[], tendons: Tendon[],
 *   discs: number, stabilities: string[], recorded: number[][]}} Layout
 * @typedef {{disc: number, partner: number, point: number[], normal: number[], force: number[], gap: number}} Contact
 * @typedef {{stamp: number, solve: number, residual: number, iterations: number, converged: boolean, stability: string,
 *   payload: number, tip: number[], command: number[], tensions: number[], lengths: number[], solids: Float64Array,
 *   holes: Float64Array, contacts: Contact[]}} Frame
 * @typedef {{type: "command" | "settle", command: number[]} | {type: "drag", disc: number, to: number[]} |
 *   {type: "push", disc: number, force: number[]} | {type: "payload", mass: number} | {type: "robot", toml: string}} Request
 */

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
  let at = 0;
  const next = (/** @type {number} */ count) => numbers.subarray(at, (at += count));
  const [stamp, solve, residual, iterations, converged, stability, payload] = next(7);
  const tip = [...next(3)];
  const [tendons, solids, holes, contacts] = next(4);
  const frame = {
    stamp, solve, residual, iterations, converged: converged === 1, stability: stabilities[stability] ?? "not settled", payload, tip,
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

/** A socket that is asked one thing after another: while an answer is awaited, only the newest of a kind waits. */
export class Link {
  /**
   * @param {{robot: (layout: Layout) => void, frame: (frame: Frame, trip: number) => void,
   *   refused: (of: string, reason: string) => void, lost: () => void}} heard
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

  /** @param {string | ArrayBuffer} data */
  hear(data) {
    if (typeof data === "string") {
      const { type, ...words } = JSON.parse(data);
      if (type === "robot") {
        this.stabilities = words.stabilities;
        this.heard.robot(words);
      } else {
        this.sent.clear();
        this.heard.refused(words.of, words.reason);
      }
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
