// The panel beside the mesh shows the state of the session and sends commands.

export const byId = (name) => document.getElementById(name);
export const checked = (name) => document.querySelector(`input[name=${name}]:checked`).value;

const whole = (number) => number.toLocaleString("en");

export function say(sentence) {
  byId("message").hidden = !sentence;
  byId("message").firstElementChild.textContent = sentence ?? "";
}

// `ask(command, args)` sends a command; `choose(number)` selects a group.
export class Panel {
  constructor(ask, choose) {
    Object.assign(this, { ask, choose });
    byId("message").lastElementChild.addEventListener("click", () => say(null));
    for (const kind of ["fixed", "moved"]) byId(kind).addEventListener("click", () => ask("mark", { kind }));
    for (const name of ["undo", "redo", "recover"]) byId(name).addEventListener("click", () => ask(name));
    byId("discard").addEventListener("click", () => {
      if (window.confirm(`${byId("found").textContent} Delete it?`)) ask("discard");
    });
    for (const name of ["method", "joints"]) {
      const given = () => ({ method: byId("method").value, joints: byId("joints").disabled ? null : Number(byId("joints").value) });
      byId(name).addEventListener("change", () => ask("set_up", given()));
    }
    this.listenToGroup();
  }

  // The controls of the selected group.
  listenToGroup() {
    const act = (command, given = {}) => this.ask(command, { group: this.active, ...given });
    for (const name of ["remove", "pick", "restore"]) byId(name).addEventListener("click", () => act(name));
    for (const radio of document.querySelectorAll("input[name=kind]")) {
      radio.addEventListener("change", () => act("alter", { kind: radio.value }));
    }
    byId("group-name").addEventListener("change", ({ target }) => act("alter", { name: target.value.trim() }));
    byId("weight").addEventListener("change", ({ target: { value } }) => act("alter", { weight: value === "" ? null : Number(value) }));
    byId("limit").addEventListener("submit", (event) => {
      event.preventDefault();
      act("limit", { distance: Number(event.target.elements.distance.value) });
    });
  }

  // A field in which the user types keeps its text, unless `refused` says that its value was refused.
  show(facts, active, refused = false) {
    const { mesh, method, groups, carried, scale } = facts;
    const set = (input, value) => {
      if (refused || active !== this.active || document.activeElement !== input) input.value = value;
    };
    byId("name").textContent = mesh.name;
    byId("counts").textContent = `${whole(mesh.vertices)} vertices, ${whole(mesh.faces)} faces`;
    byId("picked").textContent = whole(facts.picked) + (facts.parts > 1 ? ` in ${whole(facts.parts)} components` : "");
    byId("fixed").disabled = byId("moved").disabled = facts.picked === 0;
    byId("undo").disabled = !facts.undo;
    byId("redo").disabled = !facts.redo;
    byId("method").value = byId("method-name").textContent = method;
    byId("joints").disabled = method === "paper";
    set(byId("joints"), facts.joints);
    byId("quality").textContent = facts.quality && `${facts.quality[0].toUpperCase()}${facts.quality.slice(1)}.`;
    byId("loose").hidden = groups.length === 0 || groups.some(({ kind }) => kind === "fixed");
    byId("carried").hidden = !carried;
    byId("carried").textContent = `Components without handles: ${carried}. They move with the nearest component.`;
    byId("recovery").hidden = facts.recovery.length === 0;
    for (const { name, time, groups: count } of facts.recovery.slice(0, 1)) {
      const when = new Date(1000 * time).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" });
      byId("found").textContent = `${name} has unsaved work of ${when}: ${count} ${count === 1 ? "group" : "groups"}.`;
    }
    byId("trouble").hidden = !facts.trouble;
    byId("trouble").textContent = `No recovery file: ${facts.trouble}`;
    for (const what of ["handles", "mesh"]) {
      const { name } = byId(`save-${what}`).elements;
      if (!name.dataset.edited) set(name, facts.outputs[what]);
    }
    byId("groups").parentElement.hidden = groups.length === 0;
    this.list(groups, active);
    byId("group").hidden = active === null;
    for (const { number, name, kind, weight } of groups) {
      if (number !== active) continue;
      set(byId("group-name"), name);
      set(byId("weight"), weight ?? "");
      document.querySelector(`input[name=kind][value=${kind}]`).checked = true;
      byId("limit").hidden = kind !== "moved";
      byId("limit").elements.distance.value ||= Number((0.2 * scale).toPrecision(1));
    }
    this.active = active;
  }

  // List the groups. The focus stays on its row.
  list(groups, active) {
    const row = document.activeElement?.dataset.group;
    byId("groups").replaceChildren(...groups.map(({ number, name, kind, vertices }) => {
      const item = byId("row").content.cloneNode(true).firstElementChild, button = item.firstElementChild;
      button.className = kind;
      button.dataset.group = number;
      button.setAttribute("aria-pressed", number === active);
      button.addEventListener("click", () => this.choose(number));
      [button.children[0].textContent, button.children[1].textContent] = [name, `${kind}, ${whole(vertices)}`];
      return item;
    }));
    byId("groups").querySelector(`[data-group="${row}"]`)?.focus();
    if (active !== this.active) byId("groups").querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest" });
  }
}
