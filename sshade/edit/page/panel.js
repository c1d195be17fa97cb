// The panel beside the mesh shows the state of the session and sends commands.

export const byId = (name) => document.getElementById(name);
export const checked = (name) => document.querySelector(`input[name=${name}]:checked`).value;

const whole = (number) => number.toLocaleString("en");

function element(tag, fields, ...children) {
  const made = Object.assign(document.createElement(tag), fields);
  made.append(...children);
  return made;
}

function icon(name) {
  const make = (tag) => document.createElementNS(byId("overlay").namespaceURI, tag);
  const svg = make("svg"), use = svg.appendChild(make("use"));
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  use.setAttribute("href", `#icon-${name}`);
  return svg;
}

export function say(sentence) {
  byId("message").hidden = !sentence;
  byId("message").firstElementChild.textContent = sentence ?? "";
}

const WORDS = { static: "Fixed", moving: "Movable" };

// `ask(command, args)` sends a command; `choose(number)` shows the details of a group and moves the gizmo to it;
// `shift(number, move, degrees)` moves a group.
export class Panel {
  constructor(ask, choose, shift) {
    Object.assign(this, { ask, choose, shift });
    byId("message").lastElementChild.addEventListener("click", () => say(null));
    for (const kind of ["static", "moving"]) {
      byId(kind).addEventListener("click", () => ask("mark", { kind }));
    }
    for (const name of ["undo", "redo", "recover"]) byId(name).addEventListener("click", () => ask(name));
    byId("discard").addEventListener("click", () => {
      if (window.confirm(`${byId("found").textContent} Delete it?`)) ask("discard");
    });
    for (const name of ["method", "volume", "area"]) {
      byId(name).addEventListener("change", () =>
        ask("set_up", { method: byId("method").value, volume: byId("volume").checked, area: byId("area").checked }),
      );
    }
  }

  show(facts, active) {
    const { mesh, settings } = facts;
    byId("name").textContent = mesh.name;
    byId("counts").textContent = `${whole(mesh.vertices)} vertices, ${whole(mesh.faces)} faces`;
    byId("picked").textContent = whole(facts.picked);
    byId("static").disabled = byId("moving").disabled = facts.picked === 0;
    byId("undo").disabled = !facts.undo;
    byId("redo").disabled = !facts.redo;
    byId("method").value = settings.method;
    byId("constraints").hidden = settings.method === "paper";
    byId("volume").checked = settings.volume;
    byId("area").checked = settings.area;
    byId("no-groups").hidden = facts.groups.length > 0;
    byId("loose").hidden = facts.groups.length === 0 || facts.groups.some(({ kind }) => kind === "static");
    byId("recovery").hidden = facts.recovery.length === 0;
    for (const { name, time, groups } of facts.recovery.slice(0, 1)) {
      const when = new Date(1000 * time).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" });
      byId("found").textContent = `${name} has unsaved work of ${when}: ${groups} ${groups === 1 ? "group" : "groups"}.`;
    }
    byId("changed").hidden = !facts.changed;
    byId("changed").textContent = facts.changed
      ? `${mesh.name} changed on disk. The groups belong to the version that was opened, which Save mesh writes. Start the editor again to use the new version.` : "";
    byId("trouble").hidden = !facts.trouble;
    byId("trouble").textContent = `No recovery file: ${facts.trouble}`;
    for (const what of ["handles", "mesh"]) {
      const { name } = byId(`save-${what}`).elements;
      if (document.activeElement !== name && !name.dataset.edited) name.value = facts.outputs[what];
    }
    this.list(facts, active);
  }

  // List the groups anew at the next change, also where nothing changed.
  forget() {
    this.listed = null;
  }

  list({ groups, scale, returns }, active) {
    const text = JSON.stringify([groups, active]);
    if (text === this.listed) return; // keep an input in which the user is typing
    this.listed = text;
    byId("quit").textContent = returns ? "Return to Python" : "End";
    const at = document.activeElement?.dataset.at; // the same place keeps the focus
    byId("groups").replaceChildren(...groups.map((group) => this.entry(group, group.number === active, scale)));
    if (active !== this.active) byId("groups").querySelector(".active")?.scrollIntoView({ block: "nearest" });
    this.active = active;
    if (at) byId("groups").querySelector(`[data-at="${at}"]`)?.focus();
  }

  entry(group, active, scale) {
    const { number, kind } = group;
    const button = (label, title, press) => element("button", { type: "button", textContent: label, title, onclick: press });
    const name = element("input", { type: "text", className: "name", value: group.name, title: "name of the group" });
    name.setAttribute("aria-label", "name of the group");
    name.onchange = () => this.ask("alter", { group: number, name: name.value.trim() });
    const choose = button("", "show what the group can do", () => this.choose(active ? null : number));
    choose.className = "choose";
    choose.dataset.at = `choose-${number}`;
    choose.setAttribute("aria-label", `choose ${group.name}`);
    choose.setAttribute("aria-pressed", active);
    choose.append(icon(kind));
    const kinds = element("span", { className: "kinds" }, ...Object.entries(WORDS).map(([value, word]) => {
      const radio = element("input", { type: "radio", name: `kind-${number}`, value, checked: value === kind });
      radio.dataset.at = `${value}-${number}`;
      radio.onchange = () => this.ask("alter", { group: number, kind: value });
      return element("label", { className: value === "moving" ? "movable" : "" }, radio, element("span", {}, icon(value), ` ${word}`));
    }));
    kinds.setAttribute("role", "radiogroup");
    kinds.setAttribute("aria-label", `${group.name} is`);
    const remove = button("", "delete the group; its vertices become unconstrained", () => this.ask("remove", { group: number }));
    remove.className = "delete";
    remove.append(icon("delete"), " Delete");
    const head = element("div", { className: "head" }, choose, name,
      element("span", { className: "small", textContent: whole(group.vertices) }));
    const made = element("li", { className: `${kind}${active ? " active" : ""}` }, head, element("div", { className: "row small" }, kinds, remove));
    if (active) made.append(...this.details(group, scale, button));
    return made;
  }

  // What can be done with the chosen group.
  details(group, scale, button) {
    const { number, kind } = group;
    const input = (label, fields) => {
      const made = element("input", { type: "number", step: "any", ...fields });
      made.setAttribute("aria-label", label);
      return made;
    };
    const weight = input("weight", { min: "0", placeholder: "hard", value: group.weight ?? "" });
    weight.title = "empty: the group reaches its targets; a number: the group is pulled, at 1 about as strongly as the surface resists";
    weight.onchange = () => {
      this.ask("alter", { group: number, weight: weight.value === "" ? null : Number(weight.value) });
    };
    const far = input("distance of the limit", { min: "0", value: this.far ?? Number((0.2 * scale).toPrecision(1)) });
    far.onchange = () => {
      this.far = far.value; // also for the next group
    };
    const rows = [
      element("div", { className: "row small" }, element("label", {}, "weight ", weight),
        button("pick", "pick the vertices of the group", () => this.ask("pick", { group: number })),
        button("to rest", "move the group back to its rest positions", () => this.ask("restore", { group: number }))),
    ];
    if (kind !== "moving") return rows;
    const three = (word, unit) => ["x", "y", "z"].map((c) => input(`${word} ${c}`, { placeholder: `${c} ${unit}`.trim() }));
    const move = three("move", ""), turn = three("turn", "°");
    const numbers = (inputs) => inputs.map(({ value }) => Number(value));
    const form = element("form", {},
      element("div", { className: "row small three" }, element("span", { textContent: "move" }), ...move),
      element("div", { className: "row small three" }, element("span", { textContent: "turn" }), ...turn,
        element("button", { textContent: "apply", title: "move by these lengths and turn by these degrees, along the axes of the arrows" })));
    form.onsubmit = (event) => {
      event.preventDefault();
      this.shift(number, numbers(move), numbers(turn));
    };
    rows.push(form, element("div", { className: "row small" },
      button("limit to", "fix everything farther away than this distance along the edges", () => this.ask("limit", { group: number, distance: Number(far.value) })), far));
    return rows;
  }
}
