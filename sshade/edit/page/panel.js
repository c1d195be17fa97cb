// The panel beside the mesh shows the state of the session and sends commands.

export const byId = (name) => document.getElementById(name);
export const checked = (name) => document.querySelector(`input[name=${name}]:checked`).value;

const whole = (number) => number.toLocaleString("en");

function element(tag, fields, ...children) {
  const made = Object.assign(document.createElement(tag), fields);
  made.append(...children);
  return made;
}

export function say(sentence) {
  byId("message").hidden = !sentence;
  byId("message").firstElementChild.textContent = sentence ?? "";
}

// Ways in which a group moves, by the key of its slide.
const SLIDES = {
  "": "keeps its place", plane: "on a plane", line: "on a line", axes: "along axes",
  rest: "on the rest surface", free: "rotation only",
};

// `ask(command, args)` sends a command; `choose(number)` moves the gizmo to a group.
export class Panel {
  constructor(ask, choose) {
    Object.assign(this, { ask, choose });
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
    byId("recovery").hidden = facts.recovery.length === 0;
    for (const { name, time, groups } of facts.recovery.slice(0, 1)) {
      const when = new Date(1000 * time).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" });
      byId("found").textContent = `${name} has unsaved work of ${when}: ${groups} ${groups === 1 ? "group" : "groups"}.`;
    }
    byId("trouble").hidden = !facts.trouble;
    byId("trouble").textContent = `No recovery file: ${facts.trouble}`;
    for (const what of ["handles", "mesh"]) {
      const { name } = byId(`save-${what}`).elements;
      if (document.activeElement !== name && !name.dataset.edited) name.value = facts.outputs[what];
    }
    this.list(facts.groups, active);
  }

  list(groups, active) {
    const text = JSON.stringify([groups, active]);
    if (text === this.listed) return; // keep an input in which the user is typing
    this.listed = text;
    byId("groups").replaceChildren(...groups.map((group) => this.entry(group, group.number === active)));
  }

  entry(group, active) {
    const { number, kind } = group, button = (label, title, press) =>
      element("button", { type: "button", textContent: label, title, onclick: press });
    const name = element("input", { type: "text", className: "name", value: group.name, title: "name of the group" });
    name.setAttribute("aria-label", "name of the group");
    name.onchange = () => this.ask("alter", { group: number, name: name.value.trim() });
    const weight = element("input", { type: "number", min: "0", step: "any", placeholder: "hard" });
    weight.value = group.weight ?? "";
    weight.title = "empty: the group reaches its targets; a number: the group is pulled, at 1 about as strongly as the surface resists";
    weight.setAttribute("aria-label", "weight");
    weight.onchange = () => {
      this.ask("alter", { group: number, weight: weight.value === "" ? null : Number(weight.value) });
    };
    const other = kind === "moving" ? "static" : "moving";
    const head = element("div", { className: "head" }, element("span", { className: "chip" }), name,
      element("span", { className: "small", textContent: whole(group.vertices) }));
    const row = element("div", { className: "row small" });
    if (kind === "moving") {
      const drag = button("drag", "show the gizmo of the group", () => this.choose(active ? null : number));
      drag.setAttribute("aria-pressed", active);
      row.append(drag);
    }
    row.append(
      button(kind === "moving" ? "fix" : "make movable", kind === "moving" ? "fix the group where it is" : "make the group movable", () => this.ask("alter", { group: number, kind: other })),
      button("pick", "pick the vertices of the group", () => this.ask("pick", { group: number })),
      button("rest", "move the group back to its rest positions", () => this.ask("restore", { group: number })),
      weight,
    );
    const slide = this.slide(group);
    slide.append(button("×", "remove the group", () => this.ask("remove", { group: number })));
    return element("li", { className: `${kind}${active ? " active" : ""}` }, head, row, slide);
  }

  // A list of the ways in which the group moves, and the direction of its plane or line, or its axes.
  slide({ number, slide }) {
    const send = (value) => this.ask("alter", { group: number, slide: value });
    const [[key, value]] = slide === null ? [[""]] : slide === "free" ? [["free"]] : Object.entries(slide);
    const way = key === "surface" ? (value === "rest" ? "rest" : "file") : key;
    const ways = way === "file" ? { ...SLIDES, file: `on ${value.split("/").pop()}` } : SLIDES;
    const select = element("select", { title: "how the group moves" },
      ...Object.entries(ways).map(([name, label]) => element("option", { value: name, textContent: label })));
    select.value = way;
    select.setAttribute("aria-label", "how the group moves");
    const first = { "": null, plane: { plane: null }, line: { line: null }, axes: { axes: "xy" }, rest: { surface: "rest" }, free: "free" };
    select.onchange = () => send(first[select.value]);
    const row = element("div", { className: "row small" }, select);
    if (!["plane", "line", "axes"].includes(way)) return row;
    const axes = way === "axes";
    const text = element("input", { type: "text", value: axes ? value : value.map((x) => Number(x.toFixed(3))).join(" ") });
    text.title = axes ? "one or two axes along which the group slides, such as xz" : `x y z of the ${way === "plane" ? "normal of the plane" : "direction of the line"}`;
    text.setAttribute("aria-label", axes ? "axes" : "direction");
    text.onchange = () => send({ [way]: axes ? text.value.trim() : text.value.trim().split(/[\s,]+/).map(Number) });
    row.append(text);
    return row;
  }
}
