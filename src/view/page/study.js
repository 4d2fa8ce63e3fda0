// The rows of a study as points of a figure; a click on one shows its robot.

const get = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** Room for the numbers at the edges (pixels of the canvas). */
const EDGE = { left: 90, right: 20, top: 20, bottom: 40 };
/** How near a click must be to a point (pixels of the canvas). */
const NEAR = 30;

export class StudyFigure {
  /** @param {(row: number) => void} ask */
  constructor(ask) {
    this.ask = ask;
    /** @type {HTMLCanvasElement} */
    this.canvas = get("scatter");
    for (const id of ["study-x", "study-y"]) get(id).onchange = () => this.draw();
    this.canvas.onclick = (event) => this.choose(event);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  /** @param {import("./link.js").Study | null} study */
  show(study) {
    this.study = study;
    get("study-section").hidden = study === null;
    if (study === null) return;
    get("study-title").textContent = study.title;
    for (const id of ["study-x", "study-y"]) {
      get(id).replaceChildren(...study.columns.map((name, place) => {
        const option = document.createElement("option");
        Object.assign(option, { value: String(place), textContent: name });
        return option;
      }));
    }
    // The first column that changes across, the last that does up; the number of the row is the first.
    const changing = study.columns.map((_, place) => place).filter((place) =>
      place > 0 && new Set(study.values.map((row) => row[place])).size > 1);
    get("study-x").value = String(changing[0] ?? 0);
    get("study-y").value = String(changing.at(-1) ?? 0);
    this.draw();
  }

  /** Points with a number in both columns, where they are drawn. */
  points() {
    const [x, y] = ["study-x", "study-y"].map((id) => Number(get(id).value));
    const found = this.study.rows.map((row, place) => ({ row, x: this.study.values[place][x], y: this.study.values[place][y] }))
      .filter((one) => one.x !== null && one.y !== null);
    const range = (/** @type {"x" | "y"} */ axis) => {
      const [low, high] = found.reduce(([low, high], one) => [Math.min(low, one[axis]), Math.max(high, one[axis])], [Infinity, -Infinity]);
      return low === high ? [low - 1, high + 1] : [low, high];
    };
    const [ranges, { width, height }] = [{ x: range("x"), y: range("y") }, this.canvas];
    const share = (/** @type {number} */ value, /** @type {number[]} */ [low, high]) => (value - low) / (high - low);
    const points = found.map((one) => ({
      row: one.row,
      x: EDGE.left + share(one.x, ranges.x) * (width - EDGE.left - EDGE.right),
      y: height - EDGE.bottom - share(one.y, ranges.y) * (height - EDGE.top - EDGE.bottom),
    }));
    return { points, ranges };
  }

  draw() {
    const context = this.canvas.getContext("2d");
    if (this.study === null || context === null) return;
    const style = getComputedStyle(this.canvas);
    const { width, height } = this.canvas;
    const { points, ranges } = this.points();
    context.clearRect(0, 0, width, height);
    context.font = "20px system-ui, sans-serif";
    context.fillStyle = style.getPropertyValue("--faint");
    const text = (/** @type {number} */ value) => String(Number(value.toPrecision(3)));
    context.textAlign = "right";
    context.fillText(text(ranges.y[1]), EDGE.left - 8, EDGE.top + 8);
    context.fillText(text(ranges.y[0]), EDGE.left - 8, height - EDGE.bottom);
    context.fillText(text(ranges.x[1]), width - EDGE.right, height - 10);
    context.textAlign = "left";
    context.fillText(text(ranges.x[0]), EDGE.left, height - 10);
    context.strokeStyle = style.getPropertyValue("--line");
    context.strokeRect(EDGE.left - 6, EDGE.top - 6, width - EDGE.left - EDGE.right + 12, height - EDGE.top - EDGE.bottom + 12);
    for (const { row, x, y } of points) {
      const isChosen = row === this.chosen;
      context.fillStyle = style.getPropertyValue(isChosen ? "--wrong" : "--accent");
      context.beginPath();
      context.arc(x, y, isChosen ? 9 : 4, 0, 2 * Math.PI);
      context.fill();
    }
  }

  /** @param {MouseEvent} event */
  choose(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [((event.clientX - box.left) / box.width) * this.canvas.width, ((event.clientY - box.top) / box.height) * this.canvas.height];
    const apart = (/** @type {{x: number, y: number}} */ one) => Math.hypot(one.x - x, one.y - y);
    const { points } = this.points();
    if (points.length === 0) return;
    const nearest = points.reduce((best, one) => (apart(one) < apart(best) ? one : best));
    if (apart(nearest) > NEAR) return;
    this.chosen = nearest.row;
    const values = this.study.values[this.study.rows.indexOf(nearest.row)];
    get("study-said").textContent = this.study.columns.map((name, place) => `${name}: ${values[place] ?? "-"}`).join("; ");
    document.body.dataset.row = String(nearest.row);
    this.draw();
    this.ask(nearest.row);
  }
}
