// Translate pointers and buttons into commands, and answers into the shown mesh and panel.
/* global THREE */
import { Look } from "./look.js";
import { Panel, byId, checked, say } from "./panel.js";
import { Picking } from "./picking.js";
import { View } from "./view.js";

const TYPES = { float32: Float32Array, uint32: Uint32Array, uint8: Uint8Array };
const HINTS = {
  view: "Drag to rotate the view, right button to pan, wheel to zoom.",
  click: "Click on a vertex. The right button rotates the view.",
  brush: "Paint over vertices. Shift adds, Ctrl removes, the right button rotates the view.",
  rectangle: "Draw a rectangle. Shift adds, Ctrl removes, the right button rotates the view.",
  lasso: "Draw around vertices. Shift adds, Ctrl removes, the right button rotates the view.",
};
const stage = byId("stage");
const BACK = ["undo", "redo", "restore"]; // commands that take groups back
const ROLL = Math.PI / 12; // a step of a roll, and of a turn that snaps
// Attempts to reach the program again, and milliseconds between them.
const TRIES = 4, WAIT = 500;

let facts = null; // latest facts from the session
const arrays = {}; // latest arrays from the session
let active = null; // number of the group with the gizmo
let settling = null; // number of the computation that runs
let order = 0; // counts requests that change the shape, so that outdated shapes are not shown
let queue = Promise.resolve();
let solving = Promise.resolve(); // the computation that runs
let heard = 0, behind = false; // latest version of the session, and whether another page changed it meanwhile
let resting = false; // whether the rest shape is shown
const pivots = new Map(); // offsets of moved pivots from the middles of their groups
let frame = null; // local axes of the active group as a quaternion, and what they belong to

let view;
try {
  view = new View(stage, byId("canvas"), byId("overlay"));
} catch {
  say("The editor needs WebGL, which this browser does not support.");
  throw new Error("no WebGL");
}
const look = new Look(view, arrays, () => facts);
const panel = new Panel(ask, choose, shift);
const picking = new Picking(view, byId("overlay"), {
  tool: () => checked("tool"),
  how: () => checked("how"),
  through: () => byId("through").checked,
  radius: () => Number(byId("radius").value),
  picked: (vertices, how) => send(`select?how=${how}`, vertices).finally(() => look.paint(null)),
  painting: (found, how) => look.paint(found, how),
});

// Send one request after the other.
function send(path, body) {
  const answer = queue.then(() => request(path, body));
  queue = answer.then(() => {}, () => {});
  return answer.then(take).catch(complain);
}

function ask(command, given = {}) {
  order += 1;
  if (BACK.includes(command)) pivots.clear(); // the places of moved pivots are not in the history
  say(null);
  return send(command, JSON.stringify(given));
}

async function request(path, body) {
  let response;
  try {
    response = await fetch(path, body === undefined ? {} : { method: "POST", body });
  } catch {
    throw Object.assign(new Error("The editor does not answer; check whether its program still runs."), { gone: true });
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
  if (error.superseded || document.body.classList.contains("ended")) return null;
  panel.forget(); // a refused value does not stay in its field
  if (facts) panel.show(facts, active);
  const text = error.message;
  say(`${text}${/[.?!]$/.test(text) ? "" : "."}`); // not capitalised: it may begin with the name of a file
  return null;
}

// Show an answer.
function take(said) {
  facts = { ...facts, ...said };
  const { sent } = said;
  Object.assign(arrays, sent);
  if (!sent.change && (sent.positions || !facts.converged)) arrays.change = null;
  if (sent.positions && !view.gizmo.dragging) placed();
  if ("marked" in said && facts.groups.some((group) => group.number === said.marked && group.kind === "moving")) {
    active = said.marked;
    byId("tools").querySelector("[value=view]").click();
  }
  refresh();
  if (!facts.converged) settle();
  else if (!arrays.change && byId("errors").checked) settle();
  return said;
}

function placed() {
  view.setPositions(resting ? arrays.rest : arrays.positions);
}

const chosen = () => facts.groups.find(({ number }) => number === active);

function refresh() {
  const group = chosen(), moves = group?.kind === "moving" && !resting;
  if (!group) active = null;
  if (!moves) view.detach();
  else if (!view.gizmo.dragging) attach(group);
  byId("gizmo-bar").hidden = !moves;
  panel.show(facts, active);
  look.draw();
  stage.dataset.state = facts.converged ? "converged" : "computing";
  stage.dataset.picked = facts.picked;
  stage.dataset.version = facts.version;
}

// The point about which a group turns.
function pivotOf({ number, pivot }) {
  const offset = pivots.get(number) ?? [0, 0, 0];
  return pivot.map((x, c) => x + offset[c]);
}

function attach(group) {
  const key = `${group.number} ${facts.version}`, local = byId("local").checked;
  view.gizmo.setSpace(local ? "local" : "world");
  view.attach(pivotOf(group), local && frame?.key === key ? frame.quaternion : undefined);
  if (!local || frame?.key === key) return;
  frame = { key, quaternion: undefined };
  request("frame", JSON.stringify({ group: group.number })).then((said) => {
    if (frame.key !== key) return;
    frame.quaternion = said.frame;
    refresh();
  }).catch(complain);
}

function choose(number) {
  active = number;
  byId("tools").querySelector("[value=view]").click();
  refresh();
}

// Move a group by lengths in the unit of the mesh, and turn it by degrees, along the axes of the gizmo.
function shift(number, lengths, degrees) {
  const axes = new THREE.Quaternion(...(view.gizmo.space === "local" && frame?.quaternion ? frame.quaternion : [0, 0, 0, 1]));
  const turn = axes.clone().invert();
  degrees.forEach((angle, c) => {
    const about = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3().setComponent(c, 1), (angle * Math.PI) / 180);
    turn.premultiply(about);
  });
  turn.premultiply(axes);
  const move = new THREE.Vector3(...lengths).divideScalar(facts.scale).applyQuaternion(axes);
  const quaternion = degrees.some(Boolean) ? turn.toArray() : [0, 0, 0, 1];
  return release(number, { pivot: pivotOf(chosen()), move: move.toArray(), quaternion });
}

// A moved pivot moves with its group.
async function release(number, given) {
  const said = await ask("release", { group: number, drawn: view.drawn, ...given });
  const group = said?.groups.find((one) => one.number === number);
  if (!group || !pivots.has(number)) return;
  pivots.set(number, given.pivot.map((x, c) => x + given.move[c] - group.pivot[c]));
  refresh();
}

// Take over what another page changed.
let catching = false;
async function catchUp() {
  if (catching || !facts) return;
  catching = true;
  for (let last = null; last !== queue; ) {
    last = queue;
    await last;
    await solving;
  }
  catching = false;
  if (view.gizmo.dragging || (heard <= facts.version && !behind)) return;
  behind = false;
  await send("now");
}

// Compute the converged shape; a later change makes it outdated.
function settle() {
  if (settling !== order) solving = solve(order);
}

async function solve(mine) {
  settling = mine;
  byId("busy").hidden = false;
  byId("stage-text").textContent = "solving";
  try {
    const said = await request("settle", "{}");
    if (mine === order) take(said);
  } catch (error) {
    if (mine === order) complain(error);
  } finally {
    if (settling === mine) settling = null;
    if (mine === order) byId("busy").hidden = true;
    catchUp();
  }
}

// A drag requests the latest place of the gizmo as soon as the previous request was answered. While the mouse
// rests, a few further steps let the mesh converge.
const drag = { wanted: null, last: null, idle: 0, busy: null, steps: 0, since: 0 };
const IDLE = 20;

function motion() {
  const { position, quaternion } = view.pivot, { pivot, axes } = drag, start = new THREE.Vector3(...pivot);
  if (byId("snap").checked) {
    const length = Number(byId("snap-step").value) / facts.scale;
    const move = position.clone().sub(start).applyQuaternion(axes.clone().invert());
    if (length > 0) move.fromArray(move.toArray().map((x) => length * Math.round(x / length)));
    position.copy(move.applyQuaternion(axes)).add(start);
  }
  const turn = quaternion.equals(axes) ? new THREE.Quaternion() : quaternion.clone().multiply(axes.clone().invert());
  return { pivot, move: position.clone().sub(start).toArray(), quaternion: turn.toArray() };
}

function step() {
  if (!drag.wanted && !(drag.last && drag.idle < IDLE)) return null;
  drag.idle = drag.wanted ? 0 : drag.idle + 1;
  drag.last = drag.wanted ?? drag.last;
  drag.wanted = null;
  return request("drag", JSON.stringify({ group: active, drawn: view.drawn, ...drag.last }));
}

// The server computes the next step while this step is drawn.
async function follow() {
  for (let asked = step(); asked; ) {
    try {
      const { sent } = await asked;
      asked = step();
      view.setStep(sent.positions);
      await new Promise(requestAnimationFrame); // a step without a picture would be wasted
      drag.steps += 1;
    } catch (error) {
      complain(error);
      drag.wanted = drag.last = asked = null;
    }
  }
  drag.busy = null;
}

view.gizmo.addEventListener("dragging-changed", ({ value }) => {
  if (value) {
    Object.assign(drag, { pivot: view.pivot.position.toArray(), axes: view.pivot.quaternion.clone(), steps: 0, since: performance.now() });
    if (byId("pivot").checked) return;
    say(null);
    order += 1;
    byId("busy").hidden = true;
    stage.dataset.state = "dragging";
  } else if (byId("pivot").checked) {
    const { pivot } = chosen();
    pivots.set(active, view.pivot.position.toArray().map((x, c) => x - pivot[c]));
    refresh();
  } else {
    drag.wanted = drag.last = null;
    const given = motion(), number = active;
    const rate = (1000 * drag.steps) / (performance.now() - drag.since);
    stage.dataset.rate = rate.toFixed(1);
    byId("hint").textContent = `${rate.toFixed(0)} steps a second`;
    (drag.busy ?? Promise.resolve()).then(() => release(number, given)).then(catchUp);
  }
});
view.gizmo.addEventListener("objectChange", () => {
  if (!view.gizmo.dragging || byId("pivot").checked) return;
  drag.wanted = motion();
  drag.busy ??= follow();
});

for (const input of document.querySelectorAll("input[name=tool]")) {
  input.addEventListener("change", () => {
    picking.use(input.value);
    view.gizmo.enabled = input.value === "view"; // strokes over the arrows pick
    byId("hint").textContent = HINTS[input.value];
  });
}
for (const input of document.querySelectorAll("input[name=gizmo]")) {
  input.addEventListener("change", () => view.gizmo.setMode(input.value));
}
for (const button of document.querySelectorAll("#sets button, #reach [value=linked]")) {
  button.addEventListener("click", () => send(`select?how=${button.value}`, new Uint32Array(0)));
}
byId("home").addEventListener("click", () => view.home());
byId("up").addEventListener("change", () => {
  view.setUp(byId("up").value);
  view.home();
});
byId("left").addEventListener("click", () => view.roll(ROLL));
byId("right").addEventListener("click", () => view.roll(-ROLL));
byId("wires").addEventListener("change", () => view.setWires(byId("wires").checked));
byId("rest").addEventListener("click", async () => {
  arrays.rest ??= (await request("rest")).sent.positions;
  resting = !resting;
  byId("rest").setAttribute("aria-pressed", resting);
  placed();
  refresh();
});
byId("local").addEventListener("change", refresh);
byId("snap").addEventListener("change", () => {
  byId("snap-step").hidden = !byId("snap").checked;
  view.gizmo.setRotationSnap(byId("snap").checked ? ROLL : null);
});
byId("pivot").addEventListener("change", () => {
  if (byId("pivot").checked) byId("gizmo-bar").querySelector("[value=translate]").click();
});
byId("reach").addEventListener("submit", (event) => {
  event.preventDefault();
  say(null);
  send("reach", JSON.stringify({ distance: Number(event.target.elements.distance.value) }));
});
byId("errors").addEventListener("change", () => arrays.change || settle());

let saving = Promise.resolve(); // the save that runs
for (const what of ["handles", "mesh"]) {
  const form = byId(`save-${what}`), { name } = form.elements;
  name.addEventListener("input", () => {
    name.dataset.edited = "yes";
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    saving = store({ what, name: name.value });
  });
  async function store(given) {
    say(null);
    byId("saved").textContent = "";
    try {
      await queue;
      const said = await save(given);
      delete name.dataset.edited;
      if (!said) return;
      take(said);
      const lost = said.lost.length ? `, without ${said.lost.join(" and ")}: the format cannot hold them` : "";
      byId("saved").textContent = `Saved ${said.saved}${lost}.`;
      byId("command").textContent = said.command;
      byId("command").hidden = !facts.groups.length || (what === "mesh" && facts.unsaved);
      byId("saved").scrollIntoView({ block: "nearest" });
    } catch (error) {
      if (error.superseded) say(`${given.name} was not saved, because the handles moved meanwhile; save it again.`);
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

byId("open").addEventListener("change", async ({ target }) => {
  const [file] = target.files, lost = facts.unsaved ? "The handles are not saved. Undo brings them back. " : "";
  if (!file || (lost && !window.confirm(`${lost}Open ${file.name} in their place?`))) {
    target.value = "";
    return;
  }
  order += 1;
  say(null);
  await send(`open?name=${encodeURIComponent(file.name)}`, await file.arrayBuffer());
  target.value = "";
});

const KEYS = {
  1: "[value=view]", 2: "[value=click]", 3: "[value=brush]", 4: "[value=rectangle]", 5: "[value=lasso]",
  g: "[value=translate]", r: "[value=rotate]", h: "#home", s: "#static", m: "#moving", b: "#rest", l: "#local",
  n: "#snap", p: "#pivot",
};
window.addEventListener("keydown", (event) => {
  if (event.target.matches("input[type=text], input[type=number]")) return;
  const key = event.key.toLowerCase(), list = event.target.matches("select");
  if ((event.ctrlKey || event.metaKey) && (key === "z" || key === "y")) {
    event.preventDefault();
    byId(key === "y" || event.shiftKey ? "redo" : "undo").click();
  } else if (!list && !event.ctrlKey && !event.metaKey && !event.altKey && KEYS[key]) {
    document.querySelector(KEYS[key]).click();
  } else if (key === "escape") picking.cancel();
});

byId("quit").addEventListener("click", async () => {
  await saving;
  const unsaved = facts?.unsaved && !facts.returns;
  if (unsaved && !window.confirm("The handles are not saved; a recovery file keeps them. End the editor?")) return;
  await request("quit", "").catch(() => {});
  ended(`${facts?.returns ? "Python goes on with the handles" : "The editor has ended"}; this page can be closed.`);
});

function ended(sentence) {
  document.body.classList.add("ended");
  say(sentence);
}

// This request is answered until the editor ends, with the progress of computations.
async function listen() {
  const reader = (await fetch("alive")).body.pipeThrough(new TextDecoderStream()).getReader();
  for (let text = "", part; !(part = await reader.read()).done; ) {
    text += part.value;
    const lines = text.split("\n");
    text = lines.pop();
    for (const line of lines.filter(Boolean)) {
      const { stage: at, version } = JSON.parse(line);
      if (at) byId("stage-text").textContent = `${at.stage} ${at.done}/${at.total} ${at.note}`;
      heard = version;
      behind ||= view.gizmo.dragging && version > facts?.version;
      catchUp();
    }
  }
}

// A browser may drop the connection of a page in the background, so a lost connection is tried again.
async function stayConnected() {
  for (let lost = 0; lost < TRIES && !document.body.classList.contains("ended"); lost += 1) {
    const begin = performance.now();
    await listen().catch(() => {});
    if (performance.now() - begin > WAIT) lost = 0;
    await new Promise((resolve) => setTimeout(resolve, WAIT));
  }
  if (document.body.classList.contains("ended")) return;
  const again = facts?.returns ? "Call sshade.edit_handles" : "Start sshade edit";
  ended(`The editor has ended. ${again} again; it offers work that was not saved.`);
}

picking.use("view");
byId("hint").textContent = HINTS.view;
request(`whole?drawn=${view.drawn}`)
  .then((said) => {
    const { faces, positions, coarse, coarse_faces } = said.sent;
    view.setMesh(faces, positions, coarse && { vertices: coarse, faces: coarse_faces });
    const step = (fraction) => Number((fraction * said.scale).toPrecision(1));
    byId("snap-step").value = step(0.01);
    byId("reach").elements.distance.value = step(0.05);
    byId("up").value = said.up;
    view.setUp(said.up);
    view.home();
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
stayConnected();
