// The 3D view of a page: one case at a time, its shapes to switch between, the camera kept.
(() => {
  "use strict";
  const { cases, camera: look } = JSON.parse(document.getElementById("turn-cases").textContent);
  const ramp = interpolated(document.getElementById("turn-ramp").textContent.split(", "));
  const byId = (name) => document.getElementById(`turn-${name}`);
  const stage = byId("stage"), list = byId("case"), shapes = byId("shapes");
  const body = new THREE.Color("#d9d5cf");

  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(30, 1, 0.01, 100);
  camera.up.fromArray(look.up).normalize();
  const controls = new THREE.OrbitControls(camera, stage);
  controls.addEventListener("change", draw);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x9a9690, 2.0));
  const lamp = new THREE.DirectionalLight(0xffffff, 1.5);
  scene.add(lamp, lamp.target);

  let renderer = null;
  let shown = null; // the case on the stage
  let framed = false; // whether the camera was placed; a hidden page has no size for it
  let order = 0; // the latest request: one that was overtaken draws nothing

  for (const [i, entry] of cases.entries()) {
    list.append(new Option(entry.title, i));
  }
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

  async function unpack(i) {
    const packed = new Blob([decode(byId(`data-${i}`).textContent)]);
    const stream = packed.stream().pipeThrough(new DecompressionStream("gzip"));
    const buffer = await new Response(stream).arrayBuffer();
    const { vertices: n, faces: m, low, span, shapes: parts } = cases[i];
    const view = new DataView(buffer);
    let at = 0;
    const faces = new Uint16Array(3 * m);
    for (let k = 0; k < 3 * m; k += 1, at += 2) faces[k] = view.getUint16(at, true);
    const unpacked = parts.map((part) => {
      const position = new Float32Array(3 * n);
      for (let c = 0; c < 3; c += 1) {
        for (let k = 0; k < n; k += 1, at += 2) {
          position[3 * k + c] = low[c] + (span[c] * view.getUint16(at, true)) / 65535;
        }
      }
      const error = part.error ? new Uint8Array(buffer, at, n) : null;
      at += part.error ? n : 0;
      return { position, error };
    });
    return { faces, shapes: unpacked };
  }

  function clear() {
    for (const part of shown?.parts ?? []) {
      scene.remove(part);
      part.geometry.dispose();
      part.material.dispose();
    }
  }

  async function showCase(i, keepShape) {
    const mine = ++order;
    const { faces, shapes: unpacked } = await unpack(i);
    if (mine !== order) return;
    const wanted = keepShape ? shapes.querySelector(":checked")?.value : null;
    clear();
    const entry = cases[i], n = entry.vertices;
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * n), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * n), 3));
    const surface = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: 2 }));
    surface.frustumCulled = false;
    const balls = spheres(entry.handles.length, 1), goals = spheres(entry.handles.length, 0.4);
    entry.dynamic.forEach((dynamic, k) => {
      const colour = new THREE.Color(dynamic ? "#f2c200" : "#2166ac");
      balls.setColorAt(k, colour);
      goals.setColorAt(k, colour);
      place(goals, k, dynamic ? entry.targets[k] : null);
    });
    shown = { entry, surface, balls, goals, unpacked, parts: [surface, balls, goals] };
    scene.add(...shown.parts);
    list.value = i;
    const coloured = entry.shapes.some((shape) => shape.error);
    byId("scale").hidden = byId("error").parentElement.hidden = !coloured;
    byId("handles").parentElement.hidden = entry.handles.length === 0;
    shapes.hidden = entry.shapes.length < 2;
    for (const end of ["bottom", "top"]) byId(end).textContent = Number(entry[end].toPrecision(2));
    byId("label").textContent = entry.label;
    byId("note").textContent = entry.note;
    fillShapes(entry, wanted);
    frame();
    showShape();
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
    const chosen = Math.max(0, wanted ? names.indexOf(wanted) : names.length - 1);
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
  }

  function showShape() {
    if (!shown) return;
    const { entry, surface, balls, goals, unpacked } = shown;
    const name = shapes.querySelector(":checked").value;
    const k = entry.shapes.findIndex((shape) => shape.name === name);
    const { position, error } = unpacked[k];
    const { position: points, color } = surface.geometry.attributes;
    points.array.set(position);
    if (error && byId("error").checked) {
      error.forEach((value, v) => color.array.set(ramp.subarray(3 * value, 3 * value + 3), 3 * v));
    } else {
      for (let v = 0; v < entry.vertices; v += 1) body.toArray(color.array, 3 * v);
    }
    points.needsUpdate = color.needsUpdate = true;
    surface.geometry.computeVertexNormals();
    entry.handles.forEach((v, h) => place(balls, h, position.subarray(3 * v, 3 * v + 3)));
    balls.visible = byId("handles").checked;
    goals.visible = balls.visible && name === "rest";
    stage.dataset.shape = name;
    stage.dataset.case = entry.id;
    draw();
  }

  // All shapes of the case in sight, from the direction of the pictures.
  function frame() {
    const { low, span } = shown.entry;
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
    camera.aspect = width / height;
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
    renderer.domElement.id = "turn-canvas";
    stage.replaceChildren(renderer.domElement);
    resize();
    draw();
  }

  function draw() {
    lamp.position.copy(camera.position);
    lamp.target.position.copy(controls.target);
    lamp.target.updateMatrixWorld();
    renderer?.render(scene, camera);
  }

  list.addEventListener("change", () => showCase(Number(list.value), true));
  shapes.addEventListener("change", showShape);
  byId("error").addEventListener("change", showShape);
  byId("handles").addEventListener("change", showShape);
  byId("home").addEventListener("click", frame);
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
