// What the solver says, in numbers and over time.

/** Time that the plot shows (s). */
const SPAN = 10;

const millimetres = (/** @type {number} */ value) => (1e3 * value).toFixed(2);

export class Readout {
  /** @param {{readings: HTMLElement, plot: HTMLCanvasElement, contacts: HTMLTableElement, section: HTMLElement}} places */
  constructor(places) {
    this.places = places;
    /** @type {{time: number, tip: number[]}[]} */
    this.past = [];
    requestAnimationFrame(() => this.plot());
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    this.layout = layout;
    this.past = [];
  }

  /**
   * @param {import("./link.js").Frame} frame
   * @param {number} trip time from a request to its frame (ms)
   */
  move(frame, trip) {
    this.past.push({ time: performance.now() / 1e3, tip: frame.tip });
    const settled = frame.converged ? frame.stability : "does not settle";
    /** @type {[string, string, boolean?][]} */
    const readings = [
      ["tip (mm)", frame.tip.map(millimetres).join(", ")],
      ["tensions (N)", frame.tensions.map((tension) => tension.toFixed(2)).join(", ")],
      ["residual", `${frame.residual.toExponential(1)} N m`],
      ["equilibrium", settled, !frame.converged],
      ["solved in", `${(1e3 * frame.solve).toFixed(2)} ms, ${frame.iterations} steps`],
      ["frame", Number.isNaN(trip) ? "-" : `${trip.toFixed(1)} ms`],
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
      trip: String(trip), contacts: String(frame.contacts.length), stamp: String(frame.stamp),
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

  /** Draws the tip over the last seconds. */
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
    const values = this.past.flatMap(({ tip }) => tip);
    let [low, high] = [Math.min(...values), Math.max(...values)];
    const room = Math.max(0.05 * (high - low), 1e-3);
    [low, high] = [low - room, high + room];
    const { width, height } = plot;
    const x = (/** @type {number} */ time) => width * (1 - (now - time) / SPAN);
    const y = (/** @type {number} */ value) => height * (1 - (value - low) / (high - low));
    context.clearRect(0, 0, width, height);
    context.font = "20px system-ui, sans-serif";
    context.fillStyle = style.getPropertyValue("--faint");
    context.fillText(`${(1e3 * high).toFixed(0)}`, 2, 20);
    context.fillText(`${(1e3 * low).toFixed(0)}`, 2, height - 6);
    context.lineWidth = 3;
    ["--x", "--y", "--z"].forEach((color, axis) => {
      context.strokeStyle = style.getPropertyValue(color);
      context.beginPath();
      for (const { time, tip } of this.past) {
        context.lineTo(x(time), y(tip[axis]));
      }
      context.lineTo(width, y(this.past[this.past.length - 1].tip[axis]));
      context.stroke();
    });
  }
}
