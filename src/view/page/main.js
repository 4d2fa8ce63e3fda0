// The page: a stage, controls and read-outs on one link to the solver.

import { Controls } from "./controls.js";
import { Link } from "./link.js";
import { Readout } from "./readout.js";
import { Stage } from "./stage.js";

/** Time between two commands that are played (ms). */
const BEAT = 40;
/** Time that the editor waits for the next key (ms). */
const TYPED = 300;

const get = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const status = get("status");

/** @param {string} text */
function say(text, isWrong = false) {
  status.textContent = text;
  status.classList.toggle("wrong", isWrong);
}

/** @type {import("./link.js").Layout} */
let layout;
/** @type {number[] | undefined} */
let start;
/** @type {number[]} */
let command = [];
/** @type {number[][]} */
const past = [];
/** @type {number[][]} */
let kept = [];
/** @type {number | undefined} */
let playing;
let isEdited = false;

const link = new Link({
  robot(shown) {
    layout = shown;
    document.title = `${shown.name} - tdcr view`;
    get("name").textContent = shown.name;
    stage.show(shown);
    controls.show(shown);
    readout.show(shown);
    if (!isEdited) get("toml").value = shown.toml ?? "";
    get("toml-error").hidden = true;
    kept = shown.recorded.length > 0 ? shown.recorded : kept.filter((one) => one.length === shown.tendons.length);
    start = undefined;
    past.length = 0;
    tellKept();
    say("");
  },
  frame(frame, trip) {
    command = frame.command;
    start ??= frame.command;
    stage.move(frame);
    controls.move(frame.command);
    readout.move(frame, trip);
    get("payload").value = frame.payload;
    get("payload-value").textContent = `${(1e3 * frame.payload).toFixed(0)} g`;
    get("undo").disabled = past.length === 0;
    if (status.classList.contains("wrong")) say("");
    if (!frame.converged) say("the robot does not settle under this command", true);
  },
  refused(of, reason) {
    if (of === "robot") {
      get("toml-error").textContent = reason;
      get("toml-error").hidden = false;
      get("toml-error").closest("details").open = true;
    }
    say(reason, true);
  },
  lost() {
    say("the connection to `tdcr view` is lost: run it again", true);
    stop();
  },
});

/** Remembers the command, so that it can be undone to. */
function begin() {
  stop();
  past.push(command);
}

export const stage = new Stage(get("stage"), {
  grab: begin,
  drag: (disc, to) => link.ask({ type: "drag", disc, to }),
  push: (disc, force) => link.ask({ type: "push", disc, force }),
  release: (disc, pushed) => {
    if (pushed) link.ask({ type: "push", disc, force: [0, 0, 0] });
  },
});
const controls = new Controls({ tendons: get("tendons"), modules: get("modules") }, {
  begin,
  command: (values) => link.ask({ type: "command", command: values }),
});
const readout = new Readout({ readings: get("readings"), plot: get("plot"), contacts: get("contacts"), section: get("contacts-section") });

function undo() {
  const before = past.pop();
  if (before !== undefined) link.ask({ type: "command", command: before });
}

function reset() {
  if (start === undefined) return;
  begin();
  link.ask({ type: "settle", command: start });
}

function tellKept() {
  get("kept").textContent = kept.length === 0 ? "no commands kept" : `${kept.length} commands kept`;
  for (const id of ["play", "save-commands"]) get(id).disabled = kept.length === 0;
}

function stop() {
  clearInterval(playing);
  playing = undefined;
  get("play").textContent = "Play";
}

function play() {
  if (playing !== undefined) return stop();
  let next = 0;
  get("play").textContent = "Stop";
  playing = setInterval(() => {
    if (next >= kept.length) return stop();
    link.ask({ type: "command", command: kept[next] });
    next += 1;
  }, BEAT);
}

/** @param {Blob} blob @param {string} name */
function save(blob, name) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 1e4);
}

get("undo").onclick = undo;
get("reset").onclick = reset;
get("keep").onclick = () => { kept.push(command); tellKept(); };
get("play").onclick = play;
get("save-commands").onclick = () => {
  const header = layout.tendons.map(({ unit }, index) => `c${index} (${unit})`).join(",");
  save(new Blob([[header, ...kept.map((one) => one.join(","))].join("\n") + "\n"], { type: "text/csv" }), "commands.csv");
};
get("save-picture").onclick = async () => {
  const picture = await stage.picture();
  if (picture !== null) save(picture, `${layout.name}.png`);
};
get("save-robot").onclick = () => save(new Blob([get("toml").value], { type: "application/toml" }), `${layout.name}.toml`);
get("payload").addEventListener("input", () => link.ask({ type: "payload", mass: get("payload").valueAsNumber }));

/** @type {number | undefined} */
let typing;
get("toml").addEventListener("input", () => {
  isEdited = true;
  clearTimeout(typing);
  typing = setTimeout(() => link.ask({ type: "robot", toml: get("toml").value }), TYPED);
});
addEventListener("keydown", (event) => {
  const isTyping = event.target instanceof HTMLTextAreaElement;
  if (isTyping) return;
  if ((event.ctrlKey || event.metaKey) && event.key === "z") {
    event.preventDefault();
    undo();
  } else if (event.key === "r" && !event.ctrlKey && !event.metaKey) reset();
});
