// What is shown over the robot: a sample of a data set, a network's cloud, a moment of a recording.

const get = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const millimetres = (/** @type {number} */ metres) => `${(1e3 * metres).toFixed(2)} mm`;

/** The samples of a data set. */
export class Samples {
  /**
   * @param {(split: string, index: number) => void} ask
   * @param {() => void} hide
   */
  constructor(ask, hide) {
    this.ask = ask;
    get("sample").addEventListener("change", () => this.choose(get("sample").valueAsNumber));
    get("split").addEventListener("change", () => this.choose(0));
    get("sample-before").onclick = () => this.choose(get("sample").valueAsNumber - 1);
    get("sample-after").onclick = () => this.choose(get("sample").valueAsNumber + 1);
    get("sample-hide").onclick = () => { hide(); get("sample-said").textContent = ""; };
  }

  /** @param {import("./link.js").Overlays["data"]} splits */
  show(splits) {
    this.splits = splits ?? [];
    get("data-section").hidden = splits === null;
    get("split").replaceChildren(...this.splits.filter(({ samples }) => samples > 0).map(({ split, samples }) => {
      const option = document.createElement("option");
      Object.assign(option, { value: split, textContent: `${split} (${samples})` });
      return option;
    }));
  }

  /** @param {number} index */
  choose(index) {
    const { samples } = this.splits.find(({ split }) => split === get("split").value);
    const chosen = Math.max(0, Math.min(samples - 1, index || 0));
    get("sample").value = String(chosen);
    this.ask(get("split").value, chosen);
  }

  /** @param {import("./link.js").Cloud} cloud */
  tell({ points, distance }) {
    const apart = Number.isNaN(distance) ? "" : `; the simulated robot is ${millimetres(distance)} from it on average`;
    get("sample-said").textContent = `${points.length / 3} points${apart}`;
    document.body.dataset.sample = String(distance);
  }
}

/** A network that predicts the robot's cloud. */
export class Network {
  /**
   * @param {(on: boolean) => void} ask
   * @param {() => void} hide
   */
  constructor(ask, hide) {
    get("predict").onchange = () => {
      const on = get("predict").checked;
      ask(on);
      if (!on) {
        hide();
        get("predict-said").textContent = "";
      }
    };
  }

  /** @param {import("./link.js").Overlays["model"]} model */
  show(model) {
    get("model-section").hidden = model === null;
    if (model !== null) get("predict").click();
  }

  get on() {
    return get("predict").checked;
  }

  off() {
    get("predict").checked = false;
  }

  /** @param {import("./link.js").Cloud} cloud */
  tell({ points, distance, seconds }) {
    get("predict-said").textContent =
      `${points.length / 3} points in ${(1e3 * seconds).toFixed(0)} ms; mean distance to what cameras see of the robot: ${millimetres(distance)}`;
    document.body.dataset.predicted = String(distance);
  }
}

/** A log that is scrubbed through. */
export class Log {
  /** @param {(time: number) => void} ask */
  constructor(ask) {
    this.ask = ask;
    /** @type {number | undefined} */
    this.playing = undefined;
    get("time").addEventListener("input", () => { this.stop(); this.go(get("time").valueAsNumber); });
    get("log-play").onclick = () => this.play();
    get("log-before").onclick = () => this.go(this.log.clouds.filter((time) => time < this.time - 1e-6).at(-1) ?? 0);
    get("log-after").onclick = () => this.go(this.log.clouds.find((time) => time > this.time + 1e-6) ?? this.log.end);
    this.time = 0;
  }

  /** @param {import("./link.js").Log | null} log */
  show(log) {
    this.log = log;
    get("log-section").hidden = log === null;
    if (log === null) return;
    get("time").max = String(log.end);
    this.go(log.clouds[0] ?? 0);
  }

  /** @param {number} time */
  go(time) {
    this.time = time;
    get("time").value = String(time);
    get("time-value").textContent = `${time.toFixed(2)} s`;
    const event = this.log.events.filter((one) => one.time <= time).at(-1);
    const left = this.log.omitted > 0 ? `${this.log.omitted} clouds are left out, for memory; ` : "";
    get("log-said").textContent = `${left}${this.log.clouds.length} clouds; ${event === undefined ? "" : `${event.time.toFixed(1)} s: ${event.text}`}`;
    this.ask(time);
  }

  stop() {
    clearInterval(this.playing);
    this.playing = undefined;
    get("log-play").textContent = "Play";
  }

  play() {
    if (this.playing !== undefined) return this.stop();
    get("log-play").textContent = "Stop";
    let last = performance.now();
    this.playing = setInterval(() => {
      const now = performance.now();
      const time = this.time + (now - last) / 1e3;
      last = now;
      if (time >= this.log.end) this.stop();
      this.go(Math.min(time, this.log.end));
    }, 50);
  }

  /** @param {import("./link.js").Moment} moment */
  tell({ time, servos }) {
    servoTable(get("servos"), servos);
    document.body.dataset.moment = String(time);
  }
}

/**
 * What servos do, as rows of a table.
 * @param {HTMLTableElement} table
 * @param {import("./link.js").Servo[]} servos
 */
export function servoTable(table, servos) {
  table.tBodies[0].replaceChildren(...servos.map(({ id, position, current, temperature }) => {
    const row = document.createElement("tr");
    const warm = temperature === null ? "-" : temperature.toFixed(0);
    for (const text of [String(id), String(position), current.toFixed(3), warm]) row.insertCell().textContent = text;
    return row;
  }));
}
