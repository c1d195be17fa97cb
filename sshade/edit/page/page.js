// Translate pointers and buttons into commands, and answers into the shown mesh and panel.
/* global THREE */
import { Look } from "./look.js";
import { Panel, byId, checked, say } from "./panel.js";
import { Picking } from "./picking.js";
import { View } from "./view.js";

const TYPES = { float32: Float32Array, uint32: Uint32Array, uint8: Uint8Array };
const HINTS = {
  view: "Choose Click, Brush, Rectangle or Lasso. Drag turns the view, the right button moves it, the wheel zooms.",
  click: "Click on a vertex.",
  brush: "Paint over vertices.",
  rectangle: "Draw a rectangle.",
  lasso: "Draw around vertices.",
};
const FRONT = "Tick “also hidden vertices” to pick through.";
const PICKING = "Shift adds, Ctrl removes, the right button turns the view.";
const stage = byId("stage");
const hasEnded = () => document.body.classList.contains("ended");

let facts = null; // latest facts from the session
const arrays = {}; // latest arrays from the session
let active = null; // number of the group with the gizmo
let settling = null; // number of the computation that runs
let order = 0; // counts requests that change the shape, so that outdated shapes are not shown
let queue = Promise.resolve();
let released = null, result = ""; // when the last drag ended, and what became of it
let drags = 0; // that ended

let view;
try {
  view = new View(stage, byId("canvas"), byId("overlay"));
} catch {
  say("The editor needs WebGL, which this browser does not support.");
  throw new Error("no WebGL");
}
const look = new Look(view, arrays, () => facts);
const panel = new Panel(ask, choose);
const picking = new Picking(view, byId("overlay"), {
  tool: () => checked("tool"),
  how: () => checked("how"),
  through: () => byId("through").checked,
  radius: () => Number(byId("radius").value),
  picked: (vertices, how) => send(`select?how=${how}`, vertices).finally(() => look.paint(null)),
  painting: (found, how) => look.paint(found, how),
  touched: (vertex) => arrays.labels[vertex] && choose(facts.groups[arrays.labels[vertex] - 1].number),
});

// Send one request after the other.
function send(path, body) {
  const answer = queue.then(() => request(path, body));
  queue = answer.then(() => {}, () => {});
  return answer.then(take).catch(complain);
}

function ask(command, given = {}) {
  order += 1;
  released = null;
  result = "";
  say(null);
  busy(true);
  return send(command, JSON.stringify(given));
}

async function request(path, body) {
  let response;
  try {
    response = await fetch(path, body === undefined ? {} : { method: "POST", body });
  } catch {
    throw new Error("The editor does not answer; check whether its program still runs.");
  }
  if (!response.ok) {
    const refused = await response.json().catch(() => ({ error: `the editor answers ${response.status}` }));
    throw Object.assign(new Error(refused.error), refused);
  }
  return unpack(await response.arrayBuffer());
}

function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const said = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  let at = 4 + size;
  said.sent = {};
  for (const [name, type, count] of said.arrays) {
    said.sent[name] = new TYPES[type](buffer, at, count);
    at += 4 * Math.ceil((count * TYPES[type].BYTES_PER_ELEMENT) / 4);
  }
  return said;
}

function complain(error) {
  if (error.superseded || hasEnded()) return null;
  busy(false);
  if (facts) panel.show(facts, active, true);
  say(`${error.message}${/[.?!]$/.test(error.message) ? "" : "."}`); // not capitalised: it may be the name of a file
  return null;
}

// Show an answer.
function take(said) {
  facts = { ...facts, ...said };
  Object.assign(arrays, said.sent);
  if (said.sent.positions && !view.gizmo.dragging) flip(false);
  if (said.marked) active = said.marked;
  if (facts.converged && released) report();
  refresh();
  if (said.marked && chosen()?.kind === "moved") byId("view").click();
  busy(!facts.converged);
  if (!facts.converged) settle();
  return said;
}

const chosen = () => facts.groups.find(({ number }) => number === active);

function refresh() {
  if (!facts) return;
  if (!chosen()) active = facts.groups.at(-1)?.number ?? null;
  const group = chosen(), moves = group?.kind === "moved";
  if (!moves) view.gizmo.detach();
  else if (!view.gizmo.dragging) view.attach(group.pivot);
  byId("gizmo-bar").hidden = !moves;
  byId("typed").elements[3].textContent = checked("gizmo") === "rotate" ? "degrees" : "move";
  panel.show(facts, active);
  look.draw();
  guide(moves && group);
  stage.dataset.state = facts.converged ? "converged" : "computing";
  stage.dataset.version = facts.version;
}

// Say what to do next: the step of the work, and one sentence.
function guide(moved) {
  const tool = checked("tool"), turns = checked("gizmo") === "rotate";
  let step = 0, sentence = HINTS[tool];
  if (tool !== "view") sentence += `${tool === "click" || byId("through").checked ? "" : ` ${FRONT}`} ${PICKING}`;
  if (facts.picked) [step, sentence] = [1, "Click Fix to keep the picked vertices in place, or Move to drag them."];
  else if (moved && tool === "view") {
    [step, sentence] = [2, result || `Drag the ${turns ? "rings to turn" : "arrows to move"} ${moved.name}.`];
  } else if (tool === "view" && facts.groups.length) sentence = `${HINTS.view} Click on a group to select it.`;
  byId("guide").querySelectorAll("li").forEach((item, k) => item.setAttribute("aria-current", k === step ? "step" : "false"));
  byId("hint").textContent = sentence;
}

// Say how long the last drag took to settle, and what to do if it moved too much.
function report() {
  result = `Done in ${((performance.now() - released) / 1000).toFixed(1)} s. `;
  result += drags++ ? "Drag on, or save the mesh." : "Other parts move too? Pick and Fix them, or use Fix everything farther than.";
  released = null;
}

// Say that the program computes, until it does not.
function busy(computes) {
  byId("busy").hidden = !computes;
  byId("save-mesh").elements[1].disabled = computes;
  byId("busy").firstElementChild.textContent = "computing ...";
}

// Show the shape at rest, or the latest shape.
function flip(before) {
  byId("before").setAttribute("aria-pressed", before);
  view.setPositions(before ? arrays.rest : arrays.positions);
}

function choose(number) {
  active = number;
  result = "";
  byId("view").click();
  refresh();
}

// Compute the converged shape; a later change makes it outdated.
async function settle() {
  const mine = order;
  if (settling === mine) return;
  settling = mine;
  try {
    const said = await request("settle", "{}");
    if (mine === order) take(said);
  } catch (error) {
    if (mine === order) complain(error);
  } finally {
    if (settling === mine) settling = null;
  }
}

// A drag requests the latest place of the gizmo as soon as the previous request was answered. While the mouse
// rests, a few further steps let the mesh converge.
const drag = { moved: false, wanted: null, last: null, idle: 0, busy: null };
const IDLE = 20;

function motion() {
  const { position, quaternion } = view.pivot, { pivot } = drag;
  return { pivot, move: position.toArray().map((x, c) => x - pivot[c]), quaternion: quaternion.toArray() };
}

function step() {
  if (!drag.wanted && !(drag.last && drag.idle < IDLE)) return null;
  drag.idle = drag.wanted ? 0 : drag.idle + 1;
  drag.last = drag.wanted ?? drag.last;
  drag.wanted = null;
  return request("drag", JSON.stringify({ group: active, ...drag.last }));
}

// The server computes the next step while this step is drawn.
async function follow() {
  for (let asked = step(); asked; ) {
    try {
      busy(true);
      const { sent } = await asked;
      busy(false);
      asked = step();
      view.setStep(sent.positions);
      await new Promise(requestAnimationFrame); // a step without a picture would be wasted
    } catch (error) {
      complain(error);
      drag.wanted = drag.last = asked = null;
    }
  }
  drag.busy = null;
}

view.gizmo.addEventListener("dragging-changed", ({ value }) => {
  if (value) {
    Object.assign(drag, { pivot: view.pivot.position.toArray(), moved: false });
    say(null);
    order += 1;
    result = "";
    flip(false);
    guide(chosen());
    busy(false);
    stage.dataset.state = "dragging";
  } else if (!drag.moved) {
    refresh();
  } else {
    drag.wanted = drag.last = null;
    const given = { group: active, ...motion() };
    (drag.busy ?? Promise.resolve()).then(() => {
      ask("release", given);
      released = performance.now();
    });
  }
});
view.gizmo.addEventListener("objectChange", () => {
  if (!view.gizmo.dragging) return;
  drag.wanted = motion();
  drag.moved = true;
  drag.busy ??= follow();
});

for (const input of document.querySelectorAll("input[name=tool]")) {
  input.addEventListener("change", () => {
    picking.use(input.value);
    view.gizmo.enabled = input.value === "view"; // strokes over the arrows pick
    byId("brush").hidden = input.value !== "brush";
    refresh();
  });
}
for (const input of document.querySelectorAll("input[name=gizmo]")) {
  input.addEventListener("change", () => {
    view.gizmo.setMode(input.value);
    result = "";
    refresh();
  });
}
byId("typed").addEventListener("submit", (event) => {
  event.preventDefault();
  const given = ["x", "y", "z"].map((name) => Number(event.target.elements[name].value.replace(",", ".")));
  if (!given.every(Number.isFinite)) return say("Type numbers.");
  const turns = checked("gizmo") === "rotate", turn = new THREE.Quaternion();
  ["x", "y", "z"].forEach((name, c) => {
    const about = new THREE.Vector3().setComponent(c, 1);
    if (turns) turn.premultiply(new THREE.Quaternion().setFromAxisAngle(about, (given[c] * Math.PI) / 180));
  });
  const move = given.map((x) => (turns ? 0 : x / facts.scale));
  ask("release", { group: active, pivot: chosen().pivot, move, quaternion: turn.toArray() });
  released = performance.now();
  return event.target.reset();
});
for (const button of document.querySelectorAll("#sets button")) {
  button.addEventListener("click", () => send(`select?how=${button.value}`, new Uint32Array(0)));
}
byId("through").addEventListener("change", refresh);
byId("home").addEventListener("click", () => view.home());
byId("before").addEventListener("click", ({ target }) => flip(target.getAttribute("aria-pressed") === "false"));
byId("up").addEventListener("change", () => view.home(byId("up").value));
byId("help").addEventListener("click", () => byId("keys").showModal());

let saving = Promise.resolve(); // the save that runs
const FORMS = { mesh: byId("save-mesh"), handles: byId("save-handles") };
for (const [what, form] of Object.entries(FORMS)) {
  const { name } = form.elements;
  name.addEventListener("input", () => {
    name.dataset.edited = "yes";
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    saving = store(what);
  });
}

async function store(...contents) {
  say(null);
  byId("saved").textContent = "";
  for (const what of contents) {
    const { name } = FORMS[what].elements;
    try {
      await queue;
      const said = await save({ what, name: name.value });
      delete name.dataset.edited;
      if (!said) continue;
      take(said);
      const lost = said.lost.length ? `, without ${said.lost.join(" and ")}: the format cannot hold them` : "";
      byId("saved").textContent += `Saved ${said.saved}${lost}. `;
      byId("command").textContent = said.command;
      byId("command").hidden = !facts.groups.length || facts.unsaved;
      byId("saved").scrollIntoView({ block: "nearest" });
    } catch (error) {
      if (error.superseded) say(`${name.value} was not saved, because the handles moved meanwhile; save it again.`);
      else complain(error);
    }
  }
}

async function save(given) {
  try {
    return await request("save", JSON.stringify(given));
  } catch (error) {
    if (!error.exists) throw error;
    if (!window.confirm(`${error.message}. Replace it?`)) return null;
    return request("save", JSON.stringify({ ...given, over: true }));
  }
}

const KEYS = {
  1: "[value=view]", 2: "[value=click]", 3: "[value=brush]", 4: "[value=rectangle]", 5: "[value=lasso]",
  g: "[value=translate]", r: "[value=rotate]", h: "#home", b: "#before", f: "#fixed", m: "#moved", "?": "#help",
  delete: "#remove",
};
window.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase(), control = event.ctrlKey || event.metaKey;
  if (hasEnded()) return;
  if (control && key === "s") {
    event.preventDefault();
    saving = store("mesh", "handles");
  }
  if (event.target.matches("input:not([type]), input[type=text], input[type=number]") || byId("keys").open) return;
  if (control && (key === "z" || key === "y")) {
    event.preventDefault();
    byId(key === "y" || event.shiftKey ? "redo" : "undo").click();
  } else if (!event.target.matches("select") && !control && !event.altKey && KEYS[key]) {
    const wanted = document.querySelector(KEYS[key]);
    if (wanted.checkVisibility()) wanted.click();
  } else if (key === "escape") picking.cancel();
});

byId("quit").addEventListener("click", async () => {
  await saving;
  if (facts?.unsaved && !window.confirm("The handles are not saved; a recovery file keeps them. End the editor?")) return;
  await request("quit", "").catch(() => {});
  ended("The editor has ended; this page can be closed.");
});

function ended(sentence) {
  document.body.classList.add("ended");
  say(sentence);
}

// Show the progress of computations, until the editor ends.
async function watch() {
  for (let answer; (answer = await fetch("progress").catch(() => null))?.ok; ) {
    byId("busy").firstElementChild.textContent = `${(await answer.json()) || "computing"} ...`;
    await new Promise((next) => setTimeout(next, 500));
  }
  if (hasEnded()) return;
  ended("The editor has ended. Start sshade edit again; it offers work that was not saved.");
}

picking.use("view");
request("whole")
  .then((said) => {
    const { faces, positions, coarse, coarse_faces } = said.sent;
    view.setMesh(faces, positions, coarse && { vertices: coarse, faces: coarse_faces });
    view.home(byId("up").value);
    byId("coloured").hidden = !said.coloured && !said.skin;
    if (said.coloured) {
      request("colours").then(({ sent }) => {
        arrays.colours = sent.colours;
        look.draw();
      }).catch(complain);
    }
    if (said.skin) request("skin").then((skin) => look.load(skin, complain)).catch(complain);
    take(said);
  })
  .catch(complain);
watch();
