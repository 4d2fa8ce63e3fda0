// The page: a stage, controls and read-outs on one link to the solver.

import { Cameras, Pictures } from "./cameras.js";
import { Controls } from "./controls.js";
import { Link } from "./link.js";
import { Log, Network, Samples } from "./overlays.js";
import { PhysicsChoice } from "./physics.js";
import { RigPanel } from "./rig.js";
import { Readout } from "./readout.js";
import { RobotFile } from "./robot_file.js";
import { Stage } from "./stage.js";
import { StudyFigure } from "./study.js";

/** Time between two commands that are played (ms). */
const BEAT = 40;

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
let isRecording = false;

const link = new Link({
  robot(shown) {
    layout = shown;
    document.title = `${shown.name} - tdcr view`;
    get("name").textContent = shown.name;
    stage.show(shown);
    controls.show(shown);
    readout.show(shown);
    physics.show(shown);
    cameras.show(shown);
    file.show(shown.toml);
    kept = shown.recorded.length > 0 ? shown.recorded : kept.filter((one) => one.length === shown.tendons.length);
    start = undefined;
    past.length = 0;
    tellKept();
    say("");
  },
  picture: (picture) => cameras.draw(picture),
  taken(picture) {
    taken.draw(picture);
    get("taken-section").hidden = false;
    document.body.dataset.taken = String(picture.count);
  },
  overlays(overlays) {
    samples.show(overlays.data);
    log.show(overlays.log);
    study.show(overlays.study);
    network.show(overlays.model);
    rig.show(overlays.rig);
    stage.isFree = overlays.rig === null;
  },
  rig: (seen) => rig.hear(seen),
  moment: (moment) => log.tell(moment),
  cloud(cloud) {
    if (cloud.role === "prediction" && !network.on) return;
    if (cloud.role === "marked") {
      stage.target(cloud.points, cloud.distance);
      return;
    }
    stage.cloud(cloud);
    if (cloud.role === "sample") samples.tell(cloud);
    if (cloud.role === "prediction") network.tell(cloud);
    if (cloud.role === "measured") rig.look(cloud);
  },
  frame(frame, trip) {
    if (isRecording && !frame.command.every((value, index) => value === command[index])) {
      kept.push(frame.command);
      tellKept();
    }
    command = frame.command;
    start ??= frame.command;
    stage.move(frame);
    controls.move(frame.command);
    readout.move(frame, trip);
    physics.move(frame);
    get("payload").value = frame.payload;
    get("payload-value").textContent = `${(1e3 * frame.payload).toFixed(0)} g`;
    get("undo").disabled = past.length === 0;
    if (status.classList.contains("wrong")) say("");
    if (!frame.converged) say("the robot does not settle under this command", true);
  },
  refused(of, reason) {
    if (of === "robot") file.refuse(reason);
    if (of === "prediction") network.off();
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
const readout = new Readout({
  title: get("state"), readings: get("readings"), plot: get("plot"), plotted: get("plotted"), legend: get("legend"),
  contacts: get("contacts"), section: get("contacts-section"),
});
const physics = new PhysicsChoice(
  { choice: get("physics"), row: get("friction-row"), friction: get("friction"), value: get("friction-value") },
  (chosen, coefficient) => link.ask({ type: "physics", physics: chosen, coefficient }),
);
const cameras = new Cameras(
  { section: get("cameras-section"), pictures: get("pictures"), live: get("live"), look: get("look") },
  () => link.ask({ type: "pictures" }),
);

const taken = new Pictures(get("taken"));

const samples = new Samples((split, index) => { begin(); link.ask({ type: "sample", split, index }); }, () => stage.hide("sample"));
const network = new Network((on) => link.ask({ type: "predict", on }), () => stage.hide("prediction"));
const log = new Log((time) => link.ask({ type: "moment", time }));
const file = new RobotFile(
  { text: get("toml"), error: get("toml-error"), mark: get("toml-mark"), section: get("robot-section") },
  (toml) => link.ask({ type: "robot", toml }),
);
const rig = new RigPanel((order) => link.tell(order));
export const study = new StudyFigure((row) => link.ask({ type: "row", row }));

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
  for (const id of ["play", "save-commands", "clear"]) get(id).disabled = kept.length === 0;
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
get("record").onclick = () => {
  isRecording = !isRecording;
  get("record").textContent = isRecording ? "Stop recording" : "Record";
};
get("clear").onclick = () => { kept = []; stop(); tellKept(); };
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

addEventListener("keydown", (event) => {
  const isTyping = event.target instanceof HTMLTextAreaElement;
  if (isTyping || !stage.isFree) return;
  if ((event.ctrlKey || event.metaKey) && event.key === "z") {
    event.preventDefault();
    undo();
  } else if (event.key === "r" && !event.ctrlKey && !event.metaKey) reset();
});
