// The 3D view of a page: one case at a time, its shapes to switch between, the camera kept.
(() => {
  "use strict";
  const { cases } = JSON.parse(document.getElementById("turn-cases").textContent);
  const ramp = interpolated(document.getElementById("turn-ramp").textContent.split(", "));
  const byId = (name) => document.getElementById(`turn-${name}`);
  const stage = byId("stage"), list = byId("case"), shapes = byId("shapes"), beside = byId("beside");
  const body = new THREE.Color("#d9d5cf");

  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(30, 1, 0.01, 100);
  const sky = new THREE.HemisphereLight(0xffffff, 0x9a9690, 2.0), lamp = new THREE.DirectionalLight(0xffffff, 1.5);
  scene.add(sky, lamp, lamp.target);

  let controls = null;
  let renderer = null;
  let shown = null; // the case on the stage
  let framed = false; // whether the camera was placed; a hidden page has no size for it
  let order = 0; // the latest request: one that was overtaken draws nothing

  for (const [i, entry] of cases.entries()) list.append(new Option(entry.title, i));
  list.parentElement.hidden = cases.length < 2;

  function decode(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }

  // Return 256 colours between the given ones, as three.js computes with them.
  function interpolated(names) {
    const given = names.map((name) => new THREE.Color(name)), colour = new THREE.Color();
    const values = new Float32Array(3 * 256);
    for (let i = 0; i < 256; i += 1) {
      const at = (i / 255) * (given.length - 1), k = Math.min(Math.floor(at), given.length - 2);
      colour.lerpColors(given[k], given[k + 1], at - k).toArray(values, 3 * i);
    }
    return values;
  }

  // Return the arrays of a case, which view.py packed.
  async function unpack({ vertices: n, faces: m, low, span, shapes: parts, painted, skin }, i) {
    const packed = new Blob([decode(byId(`data-${i}`).textContent)]);
    const buffer = await new Response(packed.stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    let at = 0;
    const take = (Type, count) => {
      const from = at;
      at += 4 * Math.ceil((count * Type.BYTES_PER_ELEMENT) / 4);
      return new Type(buffer, from, count);
    };
    const faces = take(Uint32Array, 3 * m);
    const unpacked = parts.map((part) => {
      const packedPosition = take(Uint16Array, 3 * n), position = new Float32Array(3 * n);
      for (let k = 0; k < n; k += 1) {
        for (let c = 0; c < 3; c += 1) position[3 * k + c] = low[c] + (span[c] * packedPosition[c * n + k]) / 65535;
      }
      return { position, error: part.error ? take(Uint8Array, n) : null };
    });
    const colours = painted ? take(Uint8Array, 3 * n) : null;
    if (!skin) return { faces, shapes: unpacked, colours };
    const { vertices: k, runs } = skin;
    const arrays = { vertex: take(Uint32Array, k), uv: take(Float32Array, 2 * k), faces: take(Uint32Array, 3 * m), runs };
    const materials = await Promise.all(skin.materials.map(async ({ colour, image }) => {
      const map = image && new THREE.Texture(await createImageBitmap(new Blob([decode(image)])));
      if (map) {
        Object.assign(map, { wrapS: THREE.RepeatWrapping, wrapT: THREE.RepeatWrapping, colorSpace: THREE.SRGBColorSpace });
        Object.assign(map, { flipY: false, needsUpdate: true });
      }
      const color = new THREE.Color().setRGB(...colour, THREE.SRGBColorSpace);
      return new THREE.MeshLambertMaterial({ map: map ?? null, color, side: 2 });
    }));
    return { faces, shapes: unpacked, colours, skin: { ...arrays, materials } };
  }

  function geometryOf(faces, n) {
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    for (const name of ["position", "normal", "color"]) {
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * n), 3));
    }
    return geometry;
  }

  function add(parent, geometry, material) {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    parent.add(mesh);
    return mesh;
  }

  // Return what shows one shape: its surface, wires and handles.
  function makeSide(entry, { faces, skin }) {
    const group = new THREE.Object3D(), geometry = geometryOf(faces, entry.vertices);
    const offset = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    const surface = add(group, geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: 2, ...offset }));
    const wires = { wireframe: true, color: 0x223344, transparent: true, opacity: 0.4 };
    const wire = add(group, geometry, new THREE.MeshLambertMaterial(wires));
    const balls = spheres(entry.handles.length, 1), goals = spheres(entry.handles.length, 0.4);
    entry.dynamic.forEach((dynamic, k) => {
      const colour = new THREE.Color(dynamic ? "#f2c200" : "#2166ac");
      balls.setColorAt(k, colour);
      goals.setColorAt(k, colour);
      place(goals, k, dynamic ? entry.targets[k] : null);
    });
    group.add(balls, goals);
    scene.add(group);
    const side = { group, surface, wire, balls, goals };
    if (skin) {
      const copies = geometryOf(skin.faces, skin.vertex.length);
      copies.setAttribute("uv", new THREE.BufferAttribute(skin.uv, 2));
      for (const [first, count, material] of skin.runs) copies.addGroup(3 * first, 3 * count, material);
      side.skin = add(group, copies, skin.materials);
    }
    return side;
  }

  function clear() {
    for (const { group } of shown?.sides ?? []) {
      scene.remove(group);
      for (const part of group.children) {
        part.geometry.dispose();
        part.dispose?.(); // places and colours of spheres
      }
    }
  }

  async function showCase(i, keepShape) {
    const mine = ++order, entry = cases[i];
    const unpacked = await unpack(entry, i);
    if (mine !== order) return;
    const wanted = keepShape ? shapes.querySelector(":checked")?.value : null;
    clear();
    shown = { entry, unpacked, sides: [makeSide(entry, unpacked), makeSide(entry, unpacked)] };
    list.value = i;
    const coloured = entry.shapes.some((shape) => shape.error);
    byId("scale").hidden = byId("error").parentElement.hidden = !coloured;
    byId("skin").parentElement.hidden = !(entry.skin || entry.painted);
    byId("handles").parentElement.hidden = entry.handles.length === 0;
    beside.parentElement.hidden = shapes.hidden = entry.shapes.length < 2;
    for (const end of ["bottom", "top"]) byId(end).textContent = Number(entry[end].toPrecision(2));
    byId("label").textContent = entry.label;
    byId("note").textContent = entry.note;
    if (!keepShape) byId("error").checked = !entry.beside; // colours hide a limb that collapsed
    fillShapes(entry, wanted);
    frame();
    showShapes();
  }

  function spheres(count, opacity) {
    const ball = new THREE.SphereGeometry(0.0025, 12, 8);
    const matter = new THREE.MeshLambertMaterial({ transparent: opacity < 1, opacity });
    const instances = new THREE.InstancedMesh(ball, matter, count);
    instances.frustumCulled = false;
    return instances;
  }

  function place(instances, k, point) {
    const matrix = new THREE.Matrix4();
    if (point) matrix.makeTranslation(...point);
    else matrix.makeScale(0, 0, 0);
    instances.setMatrixAt(k, matrix);
    instances.instanceMatrix.needsUpdate = true;
  }

  function fillShapes(entry, wanted) {
    const names = entry.shapes.map((shape) => shape.name);
    const chosen = names.indexOf(names.includes(wanted) ? wanted : entry.first || names.at(-1));
    shapes.replaceChildren(
      "shown:",
      ...names.map((name, k) => {
        const label = document.createElement("label"), input = document.createElement("input");
        Object.assign(input, { type: "radio", name: "turn-shape", value: name, checked: k === chosen });
        label.append(input, name);
        label.title = entry.shapes[k].caption;
        return label;
      }),
    );
    beside.replaceChildren(new Option("nothing", ""), ...names.map((name) => new Option(name, name)));
    beside.value = entry.beside ?? "";
  }

  function showShapes() {
    if (!shown) return;
    const name = shapes.querySelector(":checked").value;
    showShape(shown.sides[0], beside.value || name);
    showShape(shown.sides[1], name);
    stage.dataset.shape = name;
    stage.dataset.case = shown.entry.id;
    resize();
    draw();
  }

  function showShape({ surface, wire, balls, goals, skin }, name) {
    const { entry, unpacked } = shown, { geometry } = surface;
    const { position, error } = unpacked.shapes[entry.shapes.findIndex((shape) => shape.name === name)];
    const { position: points, color } = geometry.attributes;
    const shaded = error && byId("error").checked, dressed = !shaded && byId("skin").checked;
    points.array.set(position);
    if (shaded) error.forEach((value, v) => color.array.set(ramp.subarray(3 * value, 3 * value + 3), 3 * v));
    else if (dressed && unpacked.colours) {
      unpacked.colours.forEach((value, k) => {
        color.array[k] = (value / 255) ** 2.2;
      });
    } else for (let v = 0; v < entry.vertices; v += 1) body.toArray(color.array, 3 * v);
    points.needsUpdate = color.needsUpdate = true;
    geometry.computeVertexNormals();
    if (skin) {
      for (const attribute of ["position", "normal"]) {
        const from = geometry.attributes[attribute].array, into = skin.geometry.attributes[attribute];
        unpacked.skin.vertex.forEach((v, k) => into.array.set(from.subarray(3 * v, 3 * v + 3), 3 * k));
        into.needsUpdate = true;
      }
      skin.visible = dressed;
    }
    surface.visible = !skin?.visible;
    wire.visible = byId("wire").checked;
    entry.handles.forEach((v, h) => place(balls, h, position.subarray(3 * v, 3 * v + 3)));
    balls.visible = byId("handles").checked;
    goals.visible = balls.visible && name === "rest";
  }

  // All shapes of the case in sight, from the direction of its pictures.
  function frame() {
    const { low, span, camera: look } = shown.entry;
    camera.up.fromArray(look.up).normalize();
    sky.position.copy(camera.up);
    controls?.dispose(); // it reads the upward direction only when it is made
    controls = new THREE.OrbitControls(camera, stage);
    controls.addEventListener("change", draw);
    const towards = new THREE.Vector3(...look.towards).normalize();
    const right = new THREE.Vector3().crossVectors(camera.up, towards).normalize();
    const upright = new THREE.Vector3().crossVectors(towards, right);
    const centre = new THREE.Vector3(...low.map((x, c) => x + span[c] / 2));
    resize();
    framed = stage.clientWidth > 0 && stage.clientHeight > 0;
    if (!framed) return;
    const tall = Math.tan((camera.fov * Math.PI) / 360), wide = tall * camera.aspect;
    let distance = 0; // at which every corner of the box is inside of the picture
    for (let corner = 0; corner < 8; corner += 1) {
      const at = new THREE.Vector3(...span.map((x, c) => (corner & (1 << c) ? x : -x) / 2));
      const need = Math.max(Math.abs(at.dot(upright)) / tall, Math.abs(at.dot(right)) / wide);
      distance = Math.max(distance, at.dot(towards) + 1.05 * need);
    }
    camera.near = distance / 100;
    camera.far = distance * 10;
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(towards, distance);
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }

  function resize() {
    const { clientWidth: width, clientHeight: height } = stage;
    if (!width || !height) return;
    renderer?.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer?.setSize(width, height, false);
    camera.aspect = width / (beside.value ? 2 : 1) / height;
    camera.updateProjectionMatrix();
  }

  function begin() {
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true });
    } catch {
      stage.textContent = "This browser draws no WebGL, which the 3D view needs.";
      return;
    }
    renderer.setClearColor(0xffffff);
    renderer.setScissorTest(true);
    renderer.domElement.id = "turn-canvas";
    stage.replaceChildren(renderer.domElement);
  }

  // Draw the shape that is shown, and another one on its left.
  function draw() {
    if (!shown) return;
    lamp.position.copy(camera.position);
    lamp.target.position.copy(controls.target);
    lamp.target.updateMatrixWorld();
    const { clientWidth, clientHeight } = stage, sides = beside.value ? shown.sides : shown.sides.slice(1);
    const width = clientWidth / sides.length;
    sides.forEach((side, k) => {
      for (const one of shown.sides) one.group.visible = one === side;
      renderer?.setViewport(k * width, 0, width, clientHeight);
      renderer?.setScissor(k * width, 0, width, clientHeight);
      renderer?.render(scene, camera);
    });
  }

  list.addEventListener("change", () => showCase(Number(list.value), true));
  beside.addEventListener("change", () => {
    showShapes();
    frame();
  });
  for (const name of ["shapes", "error", "skin", "handles", "wire"]) byId(name).addEventListener("change", showShapes);
  byId("home").addEventListener("click", frame);
  document.addEventListener("keydown", ({ key, target, ctrlKey, metaKey, altKey }) => {
    if (!shown || ctrlKey || metaKey || altKey || target.matches("select")) return;
    const inputs = [...shapes.querySelectorAll("input")], at = inputs.findIndex(({ checked }) => checked);
    if (key === "b") inputs[(at + 1) % inputs.length].click();
    if (key === "w") byId("wire").click();
  });
  for (const link of document.querySelectorAll("a.turn")) {
    const i = cases.findIndex((entry) => entry.id === link.dataset.case);
    link.addEventListener("click", () => showCase(i, true));
  }
  new ResizeObserver(() => {
    if (shown && !framed) frame();
    resize();
    draw();
  }).observe(stage);
  begin();
  showCase(0, false);
})();
