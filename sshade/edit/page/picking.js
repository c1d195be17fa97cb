// Pick vertices by click, brush, rectangle and lasso, with a sketch over the mesh.

// Greatest distance from the pointer to a vertex, and greatest way of the pointer during a click, in pixels.
const CLICK = 16, STILL = 5;

export class Picking {
  // `picked(vertices, how)` receives the vertices of a stroke; `painting(vertices)` the vertices under the brush;
  // `touched(vertex)` the vertex of a click with the tool View.
  constructor(view, overlay, { tool, how, through, radius, picked, painting, touched }) {
    Object.assign(this, { view, overlay, tool, how, through, radius, picked, painting, touched });
    this.stroke = this.pressed = null;
    this.outline = overlay.firstElementChild;
    overlay.addEventListener("pointerdown", (event) => this.begin(event));
    overlay.addEventListener("pointermove", (event) => this.move(event));
    overlay.addEventListener("pointerup", (event) => this.end(event));
    overlay.addEventListener("pointercancel", () => this.cancel());
    overlay.addEventListener("pointerleave", () => this.stroke || this.clear());
    overlay.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  // With a picking tool the right button and two fingers turn the view; else the controls work as usual.
  use(tool) {
    const { controls } = this.view, picks = tool !== "view";
    controls.mouseButtons = picks ? { LEFT: null, MIDDLE: 1, RIGHT: 0 } : { LEFT: 0, MIDDLE: 1, RIGHT: 2 };
    controls.touches = picks ? { ONE: null, TWO: 3 } : { ONE: 0, TWO: 2 };
    this.overlay.style.cursor = picks ? "crosshair" : "grab";
    this.cancel();
  }

  place(event) {
    const box = this.overlay.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  begin(event) {
    const free = event.button === 0 && event.isPrimary && !this.view.gizmo.axis;
    this.pressed = free && this.tool() === "view" ? this.place(event) : null;
    if (this.stroke && event.pointerType === "touch") this.cancel(); // a second finger turns the view
    else if (this.tool() !== "view" && free) {
      const shown = this.view.project(this.through());
      const how = event.shiftKey ? "add" : event.ctrlKey || event.metaKey ? "remove" : this.how();
      const at = this.place(event), n = shown.x.length;
      this.stroke = { id: event.pointerId, tool: this.tool(), how, shown, path: [at], found: new Uint8Array(n) };
      this.overlay.setPointerCapture(event.pointerId);
      if (this.stroke.tool === "brush") this.paint(at, at);
    }
  }

  move(event) {
    const at = this.place(event), { stroke } = this;
    if (stroke && event.pointerId === stroke.id) {
      const last = stroke.path[stroke.path.length - 1];
      if (stroke.tool === "brush") this.paint(last, at);
      stroke.path.push(at);
    }
    this.sketch(at);
  }

  end(event) {
    const { stroke, pressed } = this;
    if (pressed) this.touch(pressed, this.place(event));
    if (!stroke || event.pointerId !== stroke.id) return;
    const { shown, path, found } = stroke;
    if (stroke.tool === "click") {
      const vertex = nearest(shown, this.place(event));
      if (vertex >= 0) found[vertex] = 1;
    }
    if (stroke.tool === "rectangle") inLasso(shown, rectangle(path[0], this.place(event)), found);
    if (stroke.tool === "lasso") inLasso(shown, path, found);
    this.stroke = null;
    this.clear();
    this.picked(numbers(found), stroke.how);
  }

  // A press that does not move the pointer is a click.
  touch([ax, ay], [bx, by]) {
    const vertex = Math.hypot(bx - ax, by - ay) < STILL ? nearest(this.view.project(false), [bx, by]) : -1;
    if (vertex >= 0) this.touched(vertex);
  }

  cancel() {
    const brushed = this.stroke?.tool === "brush";
    this.stroke = null;
    this.clear();
    if (brushed) this.painting(null);
  }

  // Find the vertices within the radius of the line between two points.
  paint([ax, ay], [bx, by]) {
    const { x, y, seen } = this.stroke.shown, { found } = this.stroke, r = this.radius();
    const dx = bx - ax, dy = by - ay, square = dx * dx + dy * dy || 1;
    for (let v = 0; v < x.length; v += 1) {
      if (!seen[v] || found[v]) continue;
      const t = Math.min(1, Math.max(0, ((x[v] - ax) * dx + (y[v] - ay) * dy) / square));
      if (Math.hypot(x[v] - ax - t * dx, y[v] - ay - t * dy) <= r) found[v] = 1;
    }
    this.painting(found, this.stroke.how);
  }

  clear() {
    this.outline.setAttribute("d", "");
  }

  sketch(at) {
    const { tool, path: points } = this.stroke ?? {}, r = this.radius(), [x, y] = at;
    let path = "";
    if (this.tool() === "brush") {
      path = `M${x - r},${y}a${r},${r} 0 1 0 ${2 * r},0a${r},${r} 0 1 0 ${-2 * r},0`;
    } else if (tool === "rectangle") path = `M${rectangle(points[0], at).join("L")}Z`;
    else if (tool === "lasso") path = `M${points.join("L")}Z`;
    this.outline.setAttribute("d", path);
  }
}

function numbers(found) {
  const list = [];
  for (let v = 0; v < found.length; v += 1) if (found[v]) list.push(v);
  return Uint32Array.from(list);
}

function nearest({ x, y, seen }, [px, py]) {
  let best = -1, least = CLICK;
  for (let v = 0; v < x.length; v += 1) {
    const distance = seen[v] ? Math.hypot(x[v] - px, y[v] - py) : Infinity;
    if (distance < least) [best, least] = [v, distance];
  }
  return best;
}

function rectangle([ax, ay], [bx, by]) {
  return [[ax, ay], [bx, ay], [bx, by], [ax, by]];
}

// A vertex is inside if a line to the right meets the path an odd number of times.
function inLasso({ x, y, seen }, path, found) {
  const across = path.map((point) => point[0]), down = path.map((point) => point[1]);
  const box = [Math.min(...across), Math.max(...across), Math.min(...down), Math.max(...down)];
  for (let v = 0; v < x.length; v += 1) {
    if (!seen[v] || x[v] < box[0] || x[v] > box[1] || y[v] < box[2] || y[v] > box[3]) continue;
    let inside = false;
    for (let i = 0, j = path.length - 1; i < path.length; j = i, i += 1) {
      const above = down[i] > y[v] !== down[j] > y[v];
      if (above && x[v] < across[i] + ((across[j] - across[i]) * (y[v] - down[i])) / (down[j] - down[i])) {
        inside = !inside;
      }
    }
    if (inside) found[v] = 1;
  }
}
