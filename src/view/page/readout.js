// What the solver says, in numbers and over time.

/** Time that the plot shows (s). */
const SPAN = 10;

const millimetres = (/** @type {number} */ value) => (1e3 * value).toFixed(2);

export class Readout {
  /**
   * @param {{title: HTMLElement, readings: HTMLElement, plot: HTMLCanvasElement, plotted: HTMLSelectElement, legend: HTMLElement,
   *   contacts: HTMLTableElement, section: HTMLElement}} places
   */
  constructor(places) {
    this.places = places;
    /** @type {{time: number, tip: number[], tensions: number[]}[]} */
    this.past = [];
    places.plotted.onchange = () => this.name();
    requestAnimationFrame(() => this.plot());
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    this.layout = layout;
    this.past = [];
    this.name();
  }

  /** The lines of the plot: their names and colours. */
  lines() {
    if (this.places.plotted.value === "tip") return [["x", "var(--x)"], ["y", "var(--y)"], ["z", "var(--z)"]];
    const count = this.layout.tendons.length;
    return this.layout.tendons.map((_, index) => [String(index + 1), `hsl(${Math.round((360 * index) / count)} 65% 50%)`]);
  }

  /** Writes the legend. */
  name() {
    this.places.legend.replaceChildren(...this.lines().flatMap(([name, color]) => {
      const word = document.createElement("span");
      word.textContent = name;
      word.style.color = color;
      return [word, " "];
    }));
  }

  /**
   * @param {import("./link.js").Frame} frame
   * @param {number} trip time from a request to its frame (ms), NaN where the frame answers none
   */
  move(frame, trip) {
    this.past.push({ time: performance.now() / 1e3, tip: frame.tip, tensions: frame.tensions });
    if (!Number.isNaN(trip)) document.body.dataset.trip = String(trip);
    const { trip: last } = document.body.dataset;
    const inMotion = frame.physics === "in_motion";
    const settled = frame.converged ? (frame.physics === "with_friction" ? "held by friction" : frame.stability) : "does not settle";
    this.places.title.textContent = { in_motion: "Motion", given: "Given pose" }[/** @type {string} */ (frame.physics)] ?? "Equilibrium";
    /** @type {[string, string, boolean?][]} */
    const readings = [
      ["tip (mm)", frame.tip.map(millimetres).join(", ")],
      ["tensions (N)", frame.tensions.map((tension) => tension.toFixed(2)).join(", ")],
      ...(inMotion ? /** @type {[string, string][]} */ ([
        ["time", `${frame.time.toFixed(2)} s`],
        ["computing", `${(100 * frame.load).toFixed(0)} % of the time`],
      ]) : frame.physics === "given" ? [] : /** @type {[string, string, boolean?][]} */ ([
        ["residual", `${frame.residual.toExponential(1)} N m`],
        ["equilibrium", settled, !frame.converged],
        ["solved in", `${(1e3 * frame.solve).toFixed(2)} ms, ${frame.iterations} steps`],
      ])),
      ["frame", last === undefined ? "-" : `${Number(last).toFixed(1)} ms`],
    ];
    this.places.readings.replaceChildren(...readings.flatMap(([name, text, wrong]) => {
      const [title, value] = [document.createElement("dt"), document.createElement("dd")];
      title.textContent = name;
      value.textContent = text;
      value.classList.toggle("wrong", wrong === true);
      return [title, value];
    }));
    this.touch(frame.contacts);
    Object.assign(document.body.dataset, {
      tip: frame.tip.join(","), command: frame.command.join(","), settled: String(frame.converged), solve: String(frame.solve),
      contacts: String(frame.contacts.length), stamp: String(frame.stamp), physics: frame.physics,
      time: String(frame.time), tensions: frame.tensions.join(","),
    });
  }

  /** @param {import("./link.js").Contact[]} contacts */
  touch(contacts) {
    this.places.section.hidden = contacts.length === 0;
    const [body] = this.places.contacts.tBodies;
    body.replaceChildren(...contacts.map(({ disc, partner, force, gap }) => {
      const row = document.createElement("tr");
      const name = partner < 0 ? `disc ${-1 - partner}` : this.layout.obstacles[partner].name;
      for (const text of [String(disc), name, Math.hypot(...force).toFixed(3), millimetres(gap)]) {
        row.insertCell().textContent = text;
      }
      return row;
    }));
  }

  /** Draws the last seconds. */
  plot() {
    requestAnimationFrame(() => this.plot());
    const now = performance.now() / 1e3;
    const kept = this.past.findIndex(({ time }) => time > now - SPAN);
    // One point before what is shown, so that its line begins at the edge.
    if (kept > 1) this.past.splice(0, kept - 1);
    else if (kept < 0 && this.past.length > 1) this.past.splice(0, this.past.length - 1);
    const { plot } = this.places;
    const context = plot.getContext("2d");
    if (context === null || this.past.length === 0) return;
    const style = getComputedStyle(plot);
    const isTip = this.places.plotted.value === "tip";
    const of = (/** @type {{tip: number[], tensions: number[]}} */ { tip, tensions }) => (isTip ? tip.map((x) => 1e3 * x) : tensions);
    let [low, high] = [Infinity, -Infinity];
    for (const one of this.past) {
      for (const value of of(one)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
    const room = Math.max(0.05 * (high - low), isTip ? 1 : 0.1);
    [low, high] = [low - room, high + room];
    const { width, height } = plot;
    const x = (/** @type {number} */ time) => width * (1 - (now - time) / SPAN);
    const y = (/** @type {number} */ value) => height * (1 - (value - low) / (high - low));
    context.clearRect(0, 0, width, height);
    context.font = "20px system-ui, sans-serif";
    context.fillStyle = style.getPropertyValue("--faint");
    const digits = isTip ? 0 : 1;
    context.fillText(high.toFixed(digits), 2, 20);
    context.fillText(low.toFixed(digits), 2, height - 6);
    context.lineWidth = 3;
    const named = (/** @type {string} */ color) => color.replace(/var\((.*)\)/, (_, name) => style.getPropertyValue(name));
    this.lines().forEach(([, color], line) => {
      context.strokeStyle = named(color);
      context.beginPath();
      for (const one of this.past) context.lineTo(x(one.time), y(of(one)[line]));
      context.lineTo(width, y(of(this.past[this.past.length - 1])[line]));
      context.stroke();
    });
  }
}
