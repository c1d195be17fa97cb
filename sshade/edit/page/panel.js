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

// `ask(command, args)` sends a command; `choose(number)` moves the gizmo to a group.
export class Panel {
  constructor(ask, choose) {
    Object.assign(this, { ask, choose });
    byId("message").lastElementChild.addEventListener("click", () => say(null));
    for (const kind of ["static", "moving"]) {
      byId(kind).addEventListener("click", () => ask("mark", { kind }));
    }
    for (const name of ["undo", "redo"]) byId(name).addEventListener("click", () => ask(name));
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
      button("×", "remove the group", () => this.ask("remove", { group: number })),
    );
    return element("li", { className: `${kind}${active ? " active" : ""}` }, head, row);
  }
}
