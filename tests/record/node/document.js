// A document without a browser: what the pages of this project use of HTML and of its events, and no more.

const EMPTY = new Set(["input", "link", "meta", "br", "img"]), RAW = new Set(["script", "style"]);
const FIELDS = "input, select, button";
const LETTERS = { amp: "&", lt: "<", gt: ">", quot: '"', hellip: "\u2026", times: "\u00d7" };
const TOKEN = /<!--[^]*?-->|<![^>]*>|<\/([\w-]+)\s*>|<([\w-]+)((?:"[^"]*"|'[^']*'|[^>"'])*?)(\/?)>|[^<]+|</g;
const ATTRIBUTE = /([^\s=]+)(?:\s*=\s*(?:"([^"]*)"|'([^']*)'|(\S+)))?/g;
const SIMPLE = /^([\w-]+)|#([\w-]+)|\.([\w-]+)|\[([\w-]+)(?:="?([^\]"]*)"?)?\]|(:checked)|:not\(([^)]*)\)/g;

const decoded = (text) => text.replace(/&(?:#(\d+)|(\w+));/g, (all, code, name) => (code ? String.fromCodePoint(code) : LETTERS[name] ?? all));

// Selectors as tests of elements: alternatives of descendants of compounds of tests.
const known = new Map();

function compiled(selector) {
  if (!known.has(selector)) known.set(selector, selector.split(",").map((one) => one.trim().split(/\s+/).map(testsOf)));
  return known.get(selector);
}

function testsOf(compound) {
  let read = 0;
  const tests = [...compound.matchAll(SIMPLE)].map(([all, tag, id, name, attribute, value, checked, not]) => {
    read += all.length;
    if (tag) return (element) => element.tag === tag;
    if (id) return (element) => element.id === id;
    if (name) return (element) => element.classList.contains(name);
    if (attribute) return ({ attributes }) => (value === undefined ? attributes.has(attribute) : attributes.get(attribute) === value);
    return checked ? (element) => element.checked : (element) => !element.matches(not);
  });
  if (read < compound.length) throw new Error(`the selector ${compound} is not known`);
  return tests;
}

// What is told of errors in listeners, which end no other listener.
export const errors = { tell: (error) => { throw error; } };

class Target {
  heard = [];

  addEventListener(type, tell, options) {
    const capture = Boolean(options?.capture ?? options);
    if (!this.heard.some((one) => one.type === type && one.tell === tell && one.capture === capture)) this.heard.push({ type, tell, capture });
  }

  removeEventListener(type, tell, options) {
    const capture = Boolean(options?.capture ?? options);
    this.heard = this.heard.filter((one) => one.type !== type || one.tell !== tell || one.capture !== capture);
  }

  // Tell an event to this target and, from inside to outside, to what holds it.
  send(type, fields = {}, bubbles = true) {
    const event = {
      type, target: this, defaultPrevented: false, ...fields,
      preventDefault() { this.defaultPrevented = true; },
      stopPropagation() { this.stopped = true; },
    };
    const path = [this];
    while (bubbles && path.at(-1).outside) path.push(path.at(-1).outside);
    const told = [...path.toReversed().map((one) => [one, true]), ...path.map((one) => [one, false])];
    for (const [one, capture] of told) {
      for (const { type: own, tell, capture: early } of [...one.heard]) {
        if (own !== type || early !== capture || event.stopped) continue;
        event.currentTarget = one;
        try {
          tell.call(one, event);
        } catch (error) {
          errors.tell(error);
        }
      }
    }
    return event;
  }
}

// A part of the document. Its nodes are elements and texts.
class Element extends Target {
  attributes = new Map();
  nodes = [];
  style = {};
  outside = null;

  constructor(tag, page) {
    super();
    Object.assign(this, { tag, ownerDocument: page });
  }

  get children() { return this.nodes.filter((node) => node instanceof Element); }
  get firstElementChild() { return this.children[0] ?? null; }
  get lastElementChild() { return this.children.at(-1) ?? null; }
  get parentElement() { return this.outside instanceof Element ? this.outside : null; }
  get isConnected() { return this.root === this.ownerDocument; }
  get root() { return this.outside instanceof Element || this.outside instanceof Page ? this.outside.root : this; }
  getRootNode() { return this.root; }

  // All elements inside, in their order.
  walk(found = []) {
    for (const node of this.nodes) {
      if (!(node instanceof Element)) continue;
      found.push(node);
      node.walk(found);
    }
    return found;
  }

  append(...nodes) {
    for (const node of nodes) {
      if (node instanceof Element) {
        if (node.outside) node.outside.nodes = node.outside.nodes.filter((one) => one !== node);
        node.outside = this;
      }
      this.nodes.push(node instanceof Element ? node : String(node));
      if (node instanceof Element) this.ownerDocument.added(node);
    }
  }

  replaceChildren(...nodes) {
    for (const child of this.children) child.outside = null;
    this.nodes = [];
    this.append(...nodes);
  }

  cloneNode() {
    const copy = new Element(this.tag, this.ownerDocument);
    copy.attributes = new Map(this.attributes);
    copy.append(...this.nodes.map((node) => (node instanceof Element ? node.cloneNode() : node)));
    return copy;
  }

  get textContent() { return this.nodes.map((node) => node.textContent ?? node).join(""); }
  set textContent(text) { this.replaceChildren(...(text ?? "") === "" ? [] : [text]); }
  set innerHTML(text) {
    this.replaceChildren();
    fill(this, text);
  }

  getAttribute(name) { return this.attributes.get(name) ?? null; }
  setAttribute(name, value) { this.attributes.set(name, String(value)); }
  toggle(name, on) {
    if (on) this.attributes.set(name, "");
    else this.attributes.delete(name);
  }

  get dataset() {
    return new Proxy(this.attributes, {
      get: (all, name) => all.get(`data-${name}`),
      set: (all, name, value) => Boolean(all.set(`data-${name}`, String(value))),
      deleteProperty: (all, name) => all.delete(`data-${name}`) || true,
    });
  }

  get classList() {
    const names = new Set((this.getAttribute("class") ?? "").split(/\s+/).filter(Boolean));
    const keep = () => this.setAttribute("class", [...names].join(" "));
    return { contains: (name) => names.has(name), add: (name) => keep(names.add(name)), remove: (name) => keep(names.delete(name)) };
  }

  get className() { return this.getAttribute("class") ?? ""; }
  set className(names) { this.setAttribute("class", names); }

  matches(selector) {
    return compiled(selector).some((compounds) => {
      if (!this.fits(compounds.at(-1))) return false;
      let left = compounds.length - 2;
      for (let at = this.parentElement; at && left >= 0; at = at.parentElement) left -= at.fits(compounds[left]);
      return left < 0;
    });
  }

  fits(tests) { return tests.every((test) => test(this)); }

  querySelectorAll(selector) { return this.walk().filter((element) => element.matches(selector)); }
  querySelector(selector) { return this.walk().find((element) => element.matches(selector)) ?? null; }
  closest(selector) { return this.matches(selector) ? this : this.parentElement?.closest(selector) ?? null; }

  checkVisibility() {
    if (!this.isConnected) return false;
    for (let at = this; at; at = at.parentElement) {
      if (at.hidden || (at.tag === "dialog" && !at.open)) return false;
      const around = at.parentElement;
      if (around?.tag === "details" && !around.open && at.tag !== "summary") return false;
    }
    return true;
  }

  // Fields of forms.
  get form() { return this.closest("form"); }
  get elements() {
    const fields = this.querySelectorAll(FIELDS);
    return Object.assign(fields, Object.fromEntries(fields.filter(({ name }) => name).map((field) => [field.name, field])));
  }

  get options() { return this.querySelectorAll("option"); }

  get value() {
    if (this.tag === "select") return (this.options.includes(this.chosen) || this.chosen === null ? this.chosen : this.options[0])?.value ?? "";
    return this.own ?? this.getAttribute("value") ?? (this.tag === "option" ? this.textContent : "");
  }

  set value(value) {
    const text = value === null ? "" : String(value);
    if (this.tag === "select") this.chosen = this.options.find((option) => option.value === text) ?? null;
    else if (this.tag === "button" || this.tag === "option" || this.type === "radio") this.setAttribute("value", text);
    else this.own = this.type === "number" && (text.trim() === "" || !Number.isFinite(Number(text))) ? "" : text;
  }

  get checked() { return this.tag === "input" ? this.ticked ?? this.attributes.has("checked") : undefined; }
  set checked(on) {
    if (on && this.type === "radio") {
      for (const one of this.root.walk()) if (one.type === "radio" && one.name === this.name) one.ticked = false;
    }
    this.ticked = Boolean(on);
  }

  reset() {
    for (const field of this.elements) field.own = undefined;
  }

  // Acts of the user, and their effects that no script makes.
  click() {
    if (this.disabled) return;
    const kind = this.tag === "input" ? this.type : this.tag, was = this.checked;
    if (kind === "checkbox") this.checked = !was;
    if (kind === "radio") this.checked = true;
    const event = this.send("click");
    if (event.defaultPrevented) this.ticked = was;
    else if (this.tag === "input" && this.checked !== was) {
      this.send("input");
      this.send("change");
    } else if (kind === "button" && this.form && this.type !== "button") this.form.submitted();
    else if (kind === "summary") this.parentElement.open = !this.parentElement.open;
  }

  submitted() {
    if (this.getAttribute("method") === "dialog") this.closest("dialog").close();
    else if (!this.send("submit").defaultPrevented) errors.tell(new Error("the page would be left"));
  }

  focus() {
    const page = this.ownerDocument;
    if (page.activeElement === this || !this.checkVisibility() || this.disabled) return;
    page.activeElement.blur();
    page.focused = this;
  }

  blur() {
    this.commit();
    this.ownerDocument.focused = null;
  }

  // Tell of a text that was typed.
  commit() {
    const { typed } = this;
    this.typed = false;
    if (typed) this.send("change");
  }

  showModal() { this.open = true; }
  close() { this.open = false; }
  setPointerCapture() {}
  releasePointerCapture() {}
  getContext() { return this.ownerDocument.graphics && { getExtension: () => ({ UNMASKED_RENDERER_WEBGL: 1 }), getParameter: () => this.ownerDocument.graphics }; }
  scrollIntoView() { this.ownerDocument.scrolled(this); }

  // The page is laid out as one box.
  get clientWidth() { return this.ownerDocument.box.width; }
  get clientHeight() { return this.ownerDocument.box.height; }
  get offsetTop() { return this.ownerDocument.box.offset; }
  getBoundingClientRect() { return this.ownerDocument.box; }
}
for (const name of ["hidden", "disabled", "open"]) {
  Object.defineProperty(Element.prototype, name, {
    get() { return this.attributes.has(name); },
    set(on) { this.toggle(name, on); },
  });
}
for (const name of ["id", "name", "type", "title"]) {
  Object.defineProperty(Element.prototype, name, {
    get() { return this.getAttribute(name) ?? ""; },
    set(value) { this.setAttribute(name, value); },
  });
}

export class Page extends Element {
  focused = null;
  kept = new Map();
  box = { left: 40, top: 30, width: 640, height: 480, offset: 6 };
  added = () => {};
  scrolled = () => {};

  constructor(text, window) {
    super("#document", null);
    this.ownerDocument = this;
    this.outside = window;
    fill(this, text);
  }

  get root() { return this; }
  get body() { return this.querySelector("body"); }
  get documentElement() { return this.firstElementChild; }
  get activeElement() { return this.focused?.checkVisibility() ? this.focused : this.body; }
  getElementById(id) {
    const kept = this.kept.get(id);
    if (kept?.isConnected && kept.id === id) return kept;
    const found = this.walk().find((element) => element.attributes.get("id") === id) ?? null;
    this.kept.set(id, found);
    return found;
  }

  createElement(tag) { return new Element(tag, this); }
  createElementNS(_, tag) { return new Element(tag, this); }
}

export const newWindow = () => new Target();

// Read HTML into an element.
function fill(element, text) {
  let at = element;
  TOKEN.lastIndex = 0;
  for (let found; (found = TOKEN.exec(text)); ) {
    const [all, ends, begins, attributes, closed] = found;
    if (ends) {
      while (at !== element && at.tag !== ends) at = at.outside;
      if (ends === "template") [at.content, at.nodes] = [Object.assign(new Element("#part", at.ownerDocument), { nodes: at.nodes }), []];
      if (at !== element) at = at.outside;
    } else if (begins) {
      const child = new Element(begins, at.ownerDocument);
      for (const [, name, ...values] of attributes.matchAll(ATTRIBUTE)) child.setAttribute(name, decoded(values.find((value) => value !== undefined) ?? ""));
      child.outside = at;
      at.nodes.push(child);
      if (RAW.has(begins)) {
        const end = text.indexOf(`</${begins}`, TOKEN.lastIndex);
        child.nodes = [text.slice(TOKEN.lastIndex, end)];
        TOKEN.lastIndex = text.indexOf(">", end) + 1;
      } else if (!EMPTY.has(begins) && !closed) at = child;
    } else if (!all.startsWith("<!")) at.nodes.push(decoded(all));
  }
}
