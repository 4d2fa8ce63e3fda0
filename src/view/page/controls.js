// Sliders: of each tendon, and of each module's bend, its direction and co-contraction.

/**
 * A row with a slider.
 * @param {string} name
 * @param {{min: number, max: number, step: number}} range
 * @param {(value: number) => void} moved
 */
export function slider(name, { min, max, step }, moved) {
  const row = document.createElement("label");
  row.className = "row";
  const title = document.createElement("span");
  title.textContent = name;
  const input = document.createElement("input");
  Object.assign(input, { type: "range", min, max, step });
  const output = document.createElement("output");
  input.addEventListener("input", () => moved(input.valueAsNumber));
  row.append(title, input, output);
  const show = (/** @type {number} */ value, /** @type {string} */ text) => {
    if (document.activeElement !== input || !input.matches(":active")) input.value = String(value);
    output.textContent = text;
  };
  return { row, input, show };
}

/** The tendons of a module, and what they do together. */
class Module {
  /**
   * @param {string} name
   * @param {number[]} places places of its tendons in a command
   * @param {import("./link.js").Tendon[]} tendons
   * @param {(values: Map<number, number>) => void} moved
   */
  constructor(name, places, tendons, moved) {
    this.places = places;
    this.tendons = tendons;
    this.shape = { bend: 0, direction: 0, together: 0 };
    const change = (/** @type {object} */ part) => {
      Object.assign(this.shape, part);
      moved(this.values());
    };
    this.bend = slider(`${name.replace("module ", "")}: bend`, { min: 0, max: 4 / 3, step: 0.005 }, (bend) => change({ bend }));
    this.direction = slider("direction", { min: -180, max: 180, step: 1 }, (turn) => change({ direction: (turn * Math.PI) / 180 }));
    this.together = slider("together", { min: -1, max: 1, step: 0.01 }, (together) => change({ together }));
    this.rows = [this.bend.row, this.direction.row, this.together.row];
  }

  /** A command of the tendons of this shape, by their places. */
  values() {
    const { bend, direction, together } = this.shape;
    return new Map(this.tendons.map(({ low, high, angle }, index) => {
      const share = Math.max(-1, Math.min(1, together + bend * Math.cos(angle - direction)));
      return [this.places[index], (low + high) / 2 + (share * (high - low)) / 2];
    }));
  }

  /** The shape that is nearest to a command. @param {number[]} command */
  show(command) {
    const shares = this.tendons.map(({ low, high }, index) => (2 * command[this.places[index]] - low - high) / (high - low || 1));
    const count = shares.length;
    const sum = (/** @type {(angle: number) => number} */ weight) =>
      shares.reduce((total, share, index) => total + share * weight(this.tendons[index].angle), 0);
    const together = sum(() => 1) / count;
    const x = (2 / count) * sum(Math.cos), y = (2 / count) * sum(Math.sin);
    const bend = Math.hypot(x, y);
    // A module that is not bent keeps the direction that it had.
    const direction = bend > 1e-6 ? Math.atan2(y, x) : this.shape.direction;
    this.shape = { bend, direction, together };
    this.bend.show(bend, `${(100 * bend).toFixed(0)} %`);
    this.direction.show((direction * 180) / Math.PI, `${((direction * 180) / Math.PI).toFixed(0)}°`);
    this.together.show(together, `${Math.round(100 * together) + 0} %`);
  }
}

export class Controls {
  /**
   * @param {{tendons: HTMLElement, modules: HTMLElement}} places
   * @param {{command: (command: number[]) => void, begin: () => void}} changed
   */
  constructor(places, changed) {
    this.places = places;
    this.changed = changed;
    /** @type {number[]} */
    this.command = [];
    for (const place of [places.tendons, places.modules]) {
      place.addEventListener("pointerdown", () => changed.begin());
      place.addEventListener("keydown", (event) => {
        if (event.key.startsWith("Arrow") && !event.repeat) changed.begin();
      });
    }
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    this.layout = layout;
    this.tendons = layout.tendons.map(({ group, low, high }, index) =>
      slider(`${index + 1} ${group}`, { min: low, max: high, step: (high - low) / 1000 || 1 }, (value) => {
        this.set(new Map([[index, value]]));
      }));
    this.tendons.forEach(({ input }, index) => { input.dataset.tendon = String(index + 1); });
    this.places.tendons.replaceChildren(...this.tendons.map(({ row }) => row));
    const groups = Map.groupBy(layout.tendons.map((tendon, place) => ({ tendon, place })), ({ tendon }) => tendon.group);
    this.modules = [...groups].filter(([, members]) => members.length > 2).map(([name, members]) =>
      new Module(name, members.map(({ place }) => place), members.map(({ tendon }) => tendon), (values) => this.set(values)));
    this.places.modules.replaceChildren(...this.modules.flatMap(({ rows }) => rows));
  }

  /** @param {Map<number, number>} values */
  set(values) {
    this.command = this.command.map((value, place) => values.get(place) ?? value);
    this.changed.command(this.command);
    this.tell();
  }

  /** Shows a command. @param {number[]} command */
  move(command) {
    this.command = command;
    this.tell();
  }

  tell() {
    this.tendons.forEach(({ show }, index) => {
      const { unit } = this.layout.tendons[index];
      const value = this.command[index];
      show(value, unit === "m" ? `${(1e3 * value).toFixed(2)} mm` : `${value.toFixed(2)} ${unit}`);
    });
    for (const module of this.modules) module.show(this.command);
  }
}
