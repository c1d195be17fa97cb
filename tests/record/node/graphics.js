// A renderer without a graphics card: it says what each picture shows, and draws depths for the page to read.
/* global THREE */
import { crc32 } from "node:zlib";

const exact = (x) => (Math.abs(x) < 5e-7 ? "@0" : `@${x.toFixed(6)}`);
export const row = (values) => Array.from(values, exact).join(" ");
export const sum = (values) => `#${crc32(String(values)).toString(16).padStart(8, "0")}`;

// Two sums with weights tell arrays apart, as tests/record/described.py does.
function digest(values) {
  const sums = [0, 0];
  values.forEach((x, k) => {
    const angle = (k * (Math.sqrt(5) - 1)) / 2;
    sums[0] += x * (1 + 0.5 * Math.cos(angle));
    sums[1] += x * Math.sin(7 * angle + 1);
  });
  return row(sums.map((x) => x / Math.sqrt(values.length || 1)));
}

// Count colours, and say which vertices have which.
function colours(values) {
  const names = [], counts = {}, colour = new THREE.Color();
  for (let k = 0; k < values.length; k += 3) {
    names.push(`"${colour.fromArray(values, k).getHexString()}"`);
    counts[names.at(-1)] = 1 + (counts[names.at(-1)] ?? 0);
  }
  const many = Object.entries(counts).sort(([a], [b]) => (a < b ? -1 : 1));
  const told = many.length > 8 ? `${many.length} colours ${digest(values)}` : many.map(([name, count]) => `${count} ${name}`).join(", ");
  return `${told} ${many.length > 1 ? sum(names) : ""}`.trim();
}

export class Renderer {
  static told = () => {}; // receives the descriptions of pictures, and of what the renderer is set to
  static fails = false;

  // The pixel of a vertex in the latest picture.
  static pixel(v, { width, height }) {
    const { scene, camera } = Renderer.latest, [mesh] = scene.children.flatMap((object) => [object, ...object.children])
      .filter(({ isMesh, geometry }) => isMesh && geometry.attributes.color);
    const at = new THREE.Vector3().fromArray(mesh.geometry.attributes.position.array, 3 * v).project(camera);
    return [((1 + at.x) / 2) * width, ((1 - at.y) / 2) * height];
  }

  constructor({ canvas, ...settings }) {
    if (Renderer.fails) throw new Error("no WebGL");
    Object.assign(this, { domElement: canvas ?? document.createElement("canvas"), target: null, alpha: 1, kept: new WeakMap(), card: new Set(), view: [0, 0], cut: null });
    Renderer.told({ renderer: JSON.stringify(settings) });
  }

  setClearColor(colour) { Renderer.told({ background: new THREE.Color(colour).getHexString() }); }
  getClearAlpha() { return this.alpha; }
  setClearAlpha(alpha) { this.alpha = alpha; }
  setSize(width, height, styled) { this.size = [width, height, styled ?? true]; }
  setPixelRatio(ratio) { this.ratio = ratio; }
  setScissorTest(on) { this.cuts = on; }
  setScissor(...box) { this.cut = box; }
  setViewport(...box) { this.view = box; }
  setRenderTarget(target) { this.target = target; }

  clear() {
    const { width, height } = this.target;
    this.target.bytes = new Uint8Array(4 * width * height).fill(Math.round(255 * this.alpha));
    this.target.depth = new Float64Array(width * height).fill(Infinity);
  }

  readRenderTargetPixels({ bytes }, x, y, width, height, into) {
    into.set(bytes.subarray(0, 4 * width * height));
  }

  render(scene, camera) {
    scene.updateMatrixWorld();
    if (!camera.parent) camera.updateMatrixWorld();
    if (this.target) return this.drawDepth(scene, camera);
    Renderer.latest = { scene, camera };
    const at = this.cuts ? `at ${this.view.join(" ")} ` : "", shown = {};
    if (this.cuts && String(this.view) !== String(this.cut)) shown[`${at}cut`] = String(this.cut);
    shown[`${at}size`] = `${this.size} of ratio ${this.ratio}`;
    shown[`${at}camera`] = `${row(camera.position.toArray())}, looks ${row(camera.quaternion.toArray())}, lens ${row([0, 5, 10, 14].map((k) => camera.projectionMatrix.elements[k]))}`;
    this.describe(scene, camera, shown, at);
    const held = new Set();
    scene.traverse((object) => held.add(object).add(object.geometry));
    const left = [...this.card].filter((one) => !held.has(one));
    if (left.length) shown[`${at}left on the card`] = left.map((one) => one.type).join(", ");
    return Renderer.told(shown, at);
  }

  // Keep an object on the graphics card until it is disposed of.
  keep(object) {
    if (this.card.has(object)) return;
    this.card.add(object);
    object.addEventListener("dispose", () => this.card.delete(object));
  }

  // The content of an attribute when it was last sent to the graphics card.
  sent(attribute) {
    const { kept } = this;
    if (kept.get(attribute)?.version !== attribute.version) kept.set(attribute, { version: attribute.version, array: attribute.array.slice() });
    return kept.get(attribute).array;
  }

  describe(object, camera, shown, at) {
    if (!object.visible) return;
    if (object.isTransformControlsRoot) {
      const { mode, axis, dragging, size, enabled, object: held } = object.controls;
      shown[`${at}gizmo`] = `${mode} ${row(held.position.toArray())} ${row(held.quaternion.toArray())} of size ${size}${axis ? ` on ${axis}` : ""}${dragging ? " dragging" : ""}${enabled ? "" : " not enabled"}`;
      return;
    }
    if (object.isLight) {
      const to = object.target ? ` to ${row(object.target.matrixWorld.elements.slice(12, 15))}` : "";
      const below = object.groundColor ? ` and ${object.groundColor.getHexString()}` : "";
      shown[`${at}${object.type}`] = `${object.intensity} ${object.color.getHexString()}${below} ${object.position.equals(camera.position) ? "at the camera" : row(object.position.toArray())}${to}`;
    }
    if (object.isMesh) this.describeMesh(object, shown, at);
    for (const child of object.children) this.describe(child, camera, shown, at);
  }

  describeMesh(mesh, shown, at) {
    const { geometry, material } = mesh, { attributes } = geometry, all = [material].flat();
    const kind = mesh.isInstancedMesh ? (all[0].transparent ? "goals" : "handles") : all[0].wireframe ? "wires"
      : Array.isArray(material) ? "skin" : all[0].isShaderMaterial ? "floor" : "surface";
    const name = `${at}${kind} of ${mesh.isInstancedMesh ? mesh.count : attributes.position.count}`;
    this.keep(geometry);
    if (mesh.isInstancedMesh) this.keep(mesh);
    const index = geometry.index && this.sent(geometry.index);
    shown[name] = `${mesh.isInstancedMesh ? "" : sum(index)} ${all.map(settings).join("; ")} ${sum(JSON.stringify(geometry.groups))}${mesh.frustumCulled ? " culled" : ""}`.trim();
    if (mesh.isInstancedMesh) {
      shown[`${name}: places`] = digest(this.sent(mesh.instanceMatrix));
      shown[`${name}: colours`] = mesh.instanceColor ? colours(this.sent(mesh.instanceColor)) : "none";
      return;
    }
    if (!mesh.matrix.equals(new THREE.Matrix4())) shown[`${name}: place`] = row([...mesh.position.toArray(), ...mesh.quaternion.toArray()]);
    for (const [key, attribute] of Object.entries(attributes)) {
      shown[`${name}: ${key}`] = key === "color" ? colours(this.sent(attribute)) : digest(this.sent(attribute));
    }
  }

  // Draw each triangle into a buffer of depths, with the values that the shader of the page gives.
  drawDepth(scene, camera) {
    const { width, height, bytes, depth } = this.target, point = new THREE.Vector3();
    const drawn = [];
    scene.traverse((object) => object.isMesh && object.visible && drawn.push(object));
    for (const { geometry, matrixWorld } of drawn) {
      const P = this.sent(geometry.attributes.position), n = P.length / 3, x = [], y = [], z = [];
      for (let v = 0; v < n; v += 1) {
        point.fromArray(P, 3 * v).applyMatrix4(matrixWorld).applyMatrix4(camera.matrixWorldInverse);
        z.push(-point.z);
        point.applyMatrix4(camera.projectionMatrix);
        x.push(((1 + point.x) / 2) * width);
        y.push(((1 + point.y) / 2) * height);
      }
      const faces = this.sent(geometry.index);
      for (let f = 0; f < faces.length; f += 3) {
        const [a, b, c] = faces.subarray(f, f + 3), area = (x[b] - x[a]) * (y[c] - y[a]) - (x[c] - x[a]) * (y[b] - y[a]);
        if (!area || Math.min(z[a], z[b], z[c]) <= camera.near) continue;
        const [left, right] = [Math.min(x[a], x[b], x[c]), Math.max(x[a], x[b], x[c])].map((at) => Math.min(width, Math.max(0, Math.round(at))));
        const [low, high] = [Math.min(y[a], y[b], y[c]), Math.max(y[a], y[b], y[c])].map((at) => Math.min(height, Math.max(0, Math.round(at))));
        for (let r = low; r < high; r += 1) {
          for (let q = left; q < right; q += 1) {
            const px = q + 0.5, py = r + 0.5;
            const s = ((px - x[a]) * (y[c] - y[a]) - (x[c] - x[a]) * (py - y[a])) / area;
            const t = ((x[b] - x[a]) * (py - y[a]) - (px - x[a]) * (y[b] - y[a])) / area;
            const far = 1 / ((1 - s - t) / z[a] + s / z[b] + t / z[c]), at = r * width + q;
            if (s < 0 || t < 0 || s + t > 1 || far >= depth[at]) continue;
            depth[at] = far;
          }
        }
      }
    }
    depth.forEach((far, at) => {
      if (far === Infinity) return;
      const part = far / 50, first = part % 1, second = (255 * part) % 1, third = (65025 * part) % 1;
      bytes[4 * at] = Math.round(255 * first - second);
      bytes[4 * at + 1] = Math.round(255 * second - third);
      bytes[4 * at + 2] = Math.round(255 * third);
      bytes[4 * at + 3] = 255;
    });
  }
}

// What a material is set to; of a texture, the image and whether it was sent.
function settings(material) {
  const { color, map, side, transparent, opacity, polygonOffset, polygonOffsetFactor, polygonOffsetUnits, vertexColors, vertexShader, fragmentShader, depthWrite } = material;
  const shader = { fragmentShader: "#include <color_fragment>" };
  material.onBeforeCompile(shader);
  const told = [color?.getHexString() ?? sum(vertexShader + fragmentShader), `side ${side}`];
  if (vertexColors) told.push("of vertices");
  if (transparent) told.push(`opacity ${opacity}`);
  if (!depthWrite) told.push("no depth");
  if (polygonOffset) told.push(`offset ${polygonOffsetFactor} ${polygonOffsetUnits}`);
  if (shader.fragmentShader.length > 30) told.push(sum(shader.fragmentShader));
  if (map) told.push(map.version ? `image ${map.image.name} ${map.wrapS} ${map.wrapT} ${map.colorSpace} ${map.flipY}` : "image that was not sent");
  return told.join(", ");
}
