// Play the scripts of a page with actions of a user, one line each, and say what each line changes.
//
// The line `open ["ADDRESS", "SCRIPT", "GRAPHICS"]` opens the page of an editor, whose module is SCRIPT, and
// `open ["FILE", "", "GRAPHICS"]` a page in a file, or the page whose text this is. GRAPHICS names the graphics card; "" is none. Time stands still while
// nothing is awaited: requests are answered one by one, and a frame is drawn when no request is left.
import http from "node:http";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";
import vm from "node:vm";
import { gunzipSync } from "node:zlib";
import { Page, errors, newWindow } from "./document.js";
import { Renderer, row, sum } from "./graphics.js";

const FRAME = 16, FRAMES = 400; // milliseconds, and the most that one line may draw
const TOLD = 8; // vertices of a request that are written out
let address, document, window;
const agent = new http.Agent({ keepAlive: true });

let said = []; // what the line made happen
const say = (text) => said.push(text.replace(/\s+/g, " ").trim());
errors.tell = (error) => say(`error: ${error.message ?? error}`);
for (const name of ["uncaughtException", "unhandledRejection"]) process.on(name, errors.tell);

// Requests
let waiting, kept, holding, refusals, gone;

function fetch(path, { method = "GET", body } = {}) {
  const name = path.split("?")[0];
  if (name !== "progress") say(`asks ${method === "GET" ? "" : `${method} `}${path} ${described(body)}`);
  return new Promise((resolve, reject) => waiting.push({ name, path, method, body, resolve, reject }));
}

function described(body) {
  if (body === undefined || typeof body === "string") return (body ?? "").replace(/-?\d+\.\d+(e-?\d+)?/g, (x) => row([Number(x)]));
  return body.length > TOLD ? `${body.length} vertices ${sum(body)}` : `[${body}]`;
}

// Ask the editor, or give the answer that was prepared.
async function asked({ name, path, method, body, content }) {
  if (content) return { status: 200, content };
  const at = refusals.findIndex((one) => one.name === name);
  if (gone || refusals[at]?.lost) {
    if (!gone) refusals.splice(at, 1);
    return null;
  }
  if (at >= 0) return refusals.splice(at, 1)[0];
  gone = name === "quit"; // the program ends
  return new Promise((resolve, reject) => {
    const sent = http.request(`${address}${path}`, { method, agent, timeout: 20000 }, (answer) => {
      const parts = [];
      answer.on("data", (part) => parts.push(part));
      answer.on("end", () => resolve({ status: answer.statusCode, content: Buffer.concat(parts) }));
    });
    sent.on("error", reject);
    sent.end(body && (typeof body === "string" ? body : Buffer.from(body.buffer)));
  }).catch(() => null);
}

function give({ name, resolve, reject }, answer) {
  if (!answer) return reject(new TypeError("fetch failed"));
  const { status, content } = answer;
  if (status !== 200) say(`${name} is refused: ${status} ${content}`);
  return resolve({
    ok: status === 200, status,
    json: async () => JSON.parse(content),
    blob: async () => new Picture([content]),
    arrayBuffer: async () => content.buffer.slice(content.byteOffset, content.byteOffset + content.length),
  });
}

// Frames and timers
let now, confirmed, timers, frames, observers;
const quiet = () => new Promise((resume) => setImmediate(resume));

async function settle() {
  for (let drawn = 0; drawn < FRAMES; ) {
    await quiet();
    if (waiting.length) {
      const request = waiting.shift(), answer = await asked(request);
      if (holding.has(request.name)) kept.push([request, answer]);
      else give(request, answer);
    } else if (frames.length || observers.some(({ due }) => due)) {
      now += FRAME;
      drawn += 1;
      for (const draw of frames.splice(0)) attempt(draw);
      for (const observer of observers.filter(({ due }) => due)) {
        observer.due = false;
        attempt(observer.tell);
      }
    } else return;
  }
  say("the page draws for ever");
}

function attempt(act) {
  try {
    act(now);
  } catch (error) {
    errors.tell(error);
  }
}

// The picture on the screen, by the parts that were drawn.
let pictures, picture;
const LASTING = /^(renderer|background)$/;
const extent = (key) => {
  const [, x, width] = key.match(/^at (\S+) \S+ (\S+)/)?.map(Number) ?? [0, 0, Infinity];
  return [x, x + width];
};
Renderer.told = (parts, at) => {
  if (at !== undefined) {
    const [left, right] = extent(at);
    pictures += 1;
    picture = Object.fromEntries(Object.entries(picture).filter(([key]) => LASTING.test(key) || extent(key)[0] >= right || extent(key)[1] <= left));
  }
  Object.assign(picture, parts);
};

// What the page is made of
class Picture {
  constructor(parts) { Object.assign(this, { parts, name: sum(parts[0]) }); }
  stream() { return { pipeThrough: ({ kind }) => Object.assign(this, { kind }) }; }
}

const given = {
  fetch,
  requestAnimationFrame: (draw) => frames.push(draw),
  setTimeout: (act, after) => timers.push({ act, at: now + after }),
  performance: { now: () => now },
  console: Object.fromEntries(["log", "warn", "error"].map((name) => [name, (...words) => say(`console: ${words.join(" ")}`)])),
  createImageBitmap: async (picture) => (String(Buffer.from(picture.parts[0])).startsWith("broken") ? Promise.reject(new Error("no image")) : picture),
  Blob: Picture,
  DecompressionStream: class { constructor(kind) { this.kind = kind; } },
  Option: function Option(words, value) {
    return Object.assign(document.createElement("option"), { textContent: words, value });
  },
  ResizeObserver: class {
    constructor(tell) { Object.assign(this, { tell, due: false }); }
    observe() { observers.push(Object.assign(this, { due: true })); }
  },
  // The content of a stream, when it is answered.
  Response: class {
    constructor({ parts, kind }) { Object.assign(this, { bytes: kind === "gzip" ? gunzipSync(parts[0]) : Buffer.from("") }); }
    async text() { return String(this.bytes); }
    arrayBuffer() {
      return new Promise((resolve) => waiting.push({ name: "unpack", content: this.bytes, resolve })).then((answer) => answer.arrayBuffer());
    }
  },
};
for (const [name, value] of Object.entries(given)) Object.defineProperty(globalThis, name, { value, writable: true, configurable: true });
let three; // as the page gets it
Object.defineProperty(globalThis, "THREE", { get: () => three, set: (value) => { three = { ...value, WebGLRenderer: Renderer }; } });

function run(element) {
  if (!["", "module"].includes(element.type)) return;
  vm.runInThisContext(element.textContent);
}

// What the page shows
function label(element) {
  if (element.id) return `#${element.id}`;
  const around = element.parentElement, { name } = element;
  if (name && element.closest("[id]")) return `${["radio"].includes(element.type) ? "" : `${label(element.closest("[id]"))} `}${name}${element.type === "radio" ? `=${element.value}` : ""}`;
  const inner = element.tag === "label" && element.querySelector("[id]");
  if (inner) return `label of ${label(inner)}`;
  if (!around || ["body", "#document"].includes(element.tag)) return element.tag;
  const alike = around.children.filter(({ tag }) => tag === element.tag);
  return `${label(around)} ${element.tag}${alike.length > 1 || element.tag === "li" ? ` ${1 + alike.indexOf(element)}` : ""}`;
}

const rounded = (words) => words.replace(/-?\d+\.\d{3,}(e-?\d+)?/g, (x) => Number(Number(x).toFixed(3)));

function content() {
  const found = {};
  for (const element of document.walk()) {
    if (["script", "style", "head"].includes(element.tag) || element.closest("#axes g")) continue;
    const drawn = (element.id === "axes" ? element.walk() : []).flatMap((part) => [...part.attributes.values()]);
    const facets = drawn.length ? { drawn: rounded(`${drawn.join(" ")} ${element.textContent}`) } : {};
    const words = element.nodes.filter((node) => typeof node === "string").join("").replace(/\s+/g, " ").trim();
    if (words) facets.text = words;
    for (const [name, value] of element.attributes) if (name !== "id" && name !== "value" && name !== "checked") facets[name] = value && rounded(value);
    if (element.matches("input, select")) facets.value = element.value;
    if (element.checked) facets.checked = "";
    if (element.style.cursor) facets.cursor = element.style.cursor;
    found[label(element)] = facets;
  }
  return { found, focus: label(document.activeElement), picture: { ...picture } };
}

function differences(before, after) {
  const lines = [], gone = [], keys = new Set([...Object.keys(after.found), ...Object.keys(before.found)]);
  for (const key of keys) {
    const old = before.found[key] ?? {}, own = after.found[key];
    if (!own && !gone.some((one) => key.startsWith(`${one} `))) gone.push(key);
    const changes = Object.keys({ ...own, ...old }).filter((name) => own && own[name] !== old[name]).map((name) => (
      own[name] === undefined ? `not ${name}` : name === "text" ? `"${own.text}"` : own[name] === "" && name !== "value" ? name : `${name}=${own[name]}`));
    if (changes.length) lines.push(`${key}: ${changes.join(", ")}`);
  }
  lines.push(...gone.map((key) => `${key} is gone`));
  if (after.focus !== before.focus) lines.push(`focus: ${after.focus}`);
  for (const key of Object.keys({ ...after.picture, ...before.picture })) {
    const region = key.match(/^at \S+ \S+ \S+ \S+/)?.[0] ?? "picture";
    const left = Object.keys(after.picture).some((own) => own.startsWith(region));
    const object = region !== "picture" && !left ? `at ${region.slice(3)}` : key.split(": ")[0];
    if (after.picture[key] === undefined) lines.push(`picture without ${object}`);
    else if (after.picture[key] !== before.picture[key]) lines.push(`picture: ${key}: ${after.picture[key]}`);
  }
  return [...new Set(lines)];
}

// Actions
function one(selector) {
  const element = document.querySelector(selector);
  if (element) return element;
  throw new Error(`there is no ${selector}`);
}

const surface = () => document.querySelector("#overlay") ?? document.querySelector("#turn-canvas");
const pointers = new Map(); // the button of each pointer that is down

// A place is X,Y on the surface, or NAME+X,Y from the gizmo or from a vertex: gizmo, v7.
function placed(word) {
  const [, name, x, y] = word.match(/^(gizmo|v\d+)?\+?(?:(-?[\d.]+),(-?[\d.]+))?$/), { left, top, offset } = document.box;
  const [fromX, fromY] = !name ? [0, 0] : name === "gizmo" ? document.querySelector("#stage").dataset.gizmo.split(",").map(Number)
    : Renderer.pixel(Number(name.slice(1)), document.box);
  return { clientX: left + fromX + Number(x ?? 0), clientY: top + fromY - (name === "gizmo" ? offset : 0) + Number(y ?? 0) };
}

// The fields of an event; further words are keys that are held, the button, and the kind and number of a pointer.
function fields(words) {
  const id = Number(words.find((word) => /^\d$/.test(word)) ?? 1), has = (word) => words.includes(word);
  const keys = Object.fromEntries(["shift", "ctrl", "meta", "alt"].map((name) => [`${name}Key`, has(name)]));
  const button = has("right") ? 2 : has("middle") ? 1 : 0;
  return { ...keys, button, pointerId: id, isPrimary: id === 1, pointerType: has("touch") ? "touch" : "mouse" };
}

function point(type, [place, ...words]) {
  const { clientX, clientY } = placed(place), given = fields(words);
  if (type === "pointermove") given.button = -1;
  const event = surface().send(type, { ...given, clientX, clientY, pageX: clientX, pageY: clientY, deltaY: given.deltaY ?? Number(words[0]), deltaMode: 0 });
  if (type === "contextmenu" && event.defaultPrevented) say("no menu opens");
}

const ACTIONS = {
  click(...words) {
    const selector = words.join(" ");
    const element = one(selector);
    if (!element.checkVisibility()) return say(`${selector} is hidden`);
    if (element.disabled) return say(`${selector} is disabled`);
    const control = element.closest("summary") ?? element;
    control.focus();
    return control.click();
  },
  type(selector, ...words) {
    const field = one(selector).elements?.[0] ?? one(selector);
    if (!field.checkVisibility()) say(`${selector} is hidden`);
    field.focus();
    field.value = words.join(" ");
    field.typed = true;
    field.send("input");
  },
  choose(selector, ...words) {
    const field = one(selector);
    field.focus();
    field.value = words.join(" ");
    field.send("change");
  },
  leave: () => document.activeElement.blur(),
  focus: (selector) => one(selector).focus(),
  key(key, ...words) {
    const at = document.activeElement, event = at.send("keydown", { key, ...fields(words) });
    if (event.defaultPrevented) return say(`the browser does nothing at ${key}`);
    const dialog = document.querySelector("dialog[open]");
    if (key === "Escape" && dialog) dialog.close();
    if (key !== "Enter") return null;
    if (at.matches("button, summary")) return at.click();
    at.commit();
    return at.form?.querySelector("button")?.click();
  },
  press: (...words) => point("pointerdown", words),
  move: (...words) => point("pointermove", words),
  release: (...words) => point("pointerup", words),
  cancel: (...words) => point("pointercancel", words),
  exit: () => surface().send("pointerleave", {}, false),
  menu: (...words) => point("contextmenu", words),
  wheel: (...words) => point("wheel", words),
  no: () => { confirmed = false; },
  hold: (name) => holding.add(name),
  answer(name) {
    const at = kept.findIndex(([request]) => request.name === name);
    if (at < 0) say(`nothing is held of ${name}`);
    else give(...kept.splice(at, 1)[0]);
  },
  free(name) {
    holding.delete(name);
    for (const [request, answer] of kept.splice(0)) give(request, answer);
  },
  refuse: (name, status, ...words) => refusals.push({ name, status: Number(status), content: Buffer.from(words.join(" ")) }),
  lose: (name) => refusals.push({ name, lost: true }),
  gone: () => { gone = true; },
  size(width, height) {
    Object.assign(document.box, { width: Number(width), height: Number(height) });
    for (const observer of observers) observer.due = true;
  },
  wait(ms) {
    now += Number(ms);
    for (const { act } of timers.filter(({ at }) => at <= now)) act();
    timers = timers.filter(({ at }) => at > now);
  },
};

// Actions with "; " between them wait for each other, those with " & " do not.
async function played(line) {
  for (const actions of line.split("; ")) {
    for (const action of actions.split(" & ")) {
      const [name, ...words] = action.trim().split(" ");
      attempt(() => ACTIONS[name](...words));
    }
    await settle();
  }
}

// Open a page; its scripts begin anew.
let opened = 0;
async function open(shown, script, graphics) {
  [address, opened] = [shown, opened + 1];
  [waiting, kept, holding, refusals, gone] = [[], [], new Set(), [], false];
  [now, confirmed, timers, frames, observers, pictures, picture] = [1000, true, [], [], [], 0, {}];
  window = newWindow();
  const file = script ? new URL("index.html", pathToFileURL(script)) : address;
  document = new Page(String(file).startsWith("<") ? file : readFileSync(file, "utf8"), window);
  document.graphics = graphics;
  Renderer.fails = !graphics;
  document.scrolled = (element) => say(`scrolls to ${label(element)}`);
  document.added = (element) => element.tag === "script" && element.isConnected && run(element);
  Object.assign(window, { devicePixelRatio: 1.5, confirm });
  Object.assign(globalThis, { window, document });
  before = content();
  for (const element of document.walk().filter(({ tag }) => tag === "script")) {
    const source = element.getAttribute("src");
    if (source === "three.js" && !three) vm.runInThisContext(String((await asked({ path: "three.js", method: "GET" })).content));
    if (source === "page.js") await import(`${pathToFileURL(script)}?${opened}`).catch(errors.tell);
    else if (!source) attempt(() => run(element));
  }
  await settle();
}

function confirm(question) {
  const answer = confirmed;
  say(`asks "${question}": ${answer ? "yes" : "no"}`);
  confirmed = true;
  return answer;
}

let before;
function report() {
  const after = content(), lines = [];
  for (let k = 0, count; k < said.length; k += count) {
    for (count = 1; said[k + count] === said[k]; ) count += 1;
    lines.push(count > 1 ? `${said[k]} (${count} times)` : said[k]);
  }
  lines.push(...differences(before, after));
  if (pictures) lines.push(`${pictures} ${pictures === 1 ? "picture" : "pictures"}`);
  process.stdout.write(`${[...lines, "."].join("\n")}\n`);
  [before, said, pictures] = [after, [], 0];
}

for await (const line of createInterface({ input: process.stdin })) {
  if (line.startsWith("open ")) await open(...JSON.parse(line.slice(5)));
  else await played(line);
  report();
}
process.exit(0);
