// The mesh on the canvas: positions, colours, camera, gizmo, and the places of vertices on the screen.
/* global THREE */

const FAR = 50;
const UP = { y: new THREE.Vector3(0, 1, 0), z: new THREE.Vector3(0, 0, 1) };
const TOWARDS = { y: new THREE.Vector3(0.5, 0.25, 1), z: new THREE.Vector3(0.5, -1, 0.25) };
// Milliseconds: pictures that take longer than SLOW are drawn only after the view has rested for REST.
const SLOW = 50, REST = 400;

// Encode the distance to the camera, over FAR, in 24 bits; alpha marks the surface.
const DEPTH = {
  side: 2,
  vertexShader: `
    varying float distance_;
    void main() {
      vec4 at = modelViewMatrix * vec4(position, 1.0);
      distance_ = -at.z / ${FAR.toFixed(1)};
      gl_Position = projectionMatrix * at;
    }`,
  fragmentShader: `
    varying float distance_;
    void main() {
      vec3 digits = fract(distance_ * vec3(1.0, 255.0, 65025.0));
      gl_FragColor = vec4(digits - digits.yzz * vec3(1.0 / 255.0, 1.0 / 255.0, 0.0), 1.0);
    }`,
};

// Sum the area-weighted face normals around each vertex.
function addNormals(faces, P, N) {
  N.fill(0);
  for (let i = 0; i < faces.length; i += 3) {
    const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
    const x = P[a], y = P[a + 1], z = P[a + 2];
    const ux = P[b] - x, uy = P[b + 1] - y, uz = P[b + 2] - z;
    const vx = P[c] - x, vy = P[c + 1] - y, vz = P[c + 2] - z;
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    N[a] += nx; N[a + 1] += ny; N[a + 2] += nz;
    N[b] += nx; N[b + 1] += ny; N[b + 2] += nz;
    N[c] += nx; N[c + 1] += ny; N[c + 2] += nz;
  }
}

// Allocate a geometry for a number of vertices.
function emptyGeometry(faces, vertices) {
  const geometry = new THREE.BufferGeometry();
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  for (const name of ["position", "normal", "color"]) {
    geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * vertices), 3));
  }
  return geometry;
}

function place(geometry, positions) {
  const { position, normal } = geometry.attributes;
  position.array.set(positions);
  addNormals(geometry.index.array, position.array, normal.array);
  position.needsUpdate = normal.needsUpdate = true;
}

// Copy three numbers for each of some vertices.
function gather(vertices, from, into) {
  for (let i = 0, k = 0; i < vertices.length; i += 1, k += 3) {
    const v = 3 * vertices[i];
    into[k] = from[v];
    into[k + 1] = from[v + 1];
    into[k + 2] = from[v + 2];
  }
}

// A material of the file. Marked vertices keep their own colours, which are darker than white.
function painted({ colour, texture }) {
  const material = new THREE.MeshLambertMaterial({
    color: new THREE.Color().setRGB(...colour, THREE.SRGBColorSpace), map: texture ?? null, vertexColors: true, side: 2,
    polygonOffset: true, polygonOffsetFactor: 0.5,
  });
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <color_fragment>", `
      diffuseColor.rgb = mix(vColor.rgb, diffuseColor.rgb, smoothstep(1.5, 3.0, vColor.r + vColor.g + vColor.b));`);
  };
  return material;
}

// Measure the milliseconds for a picture whose data is on the graphics card already.
function secondPicture(renderer, render) {
  const gl = renderer.getContext(), pixel = new Uint8Array(4);
  let begin;
  for (let picture = 0; picture < 2; picture += 1) {
    begin = performance.now();
    render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until it is drawn
  }
  return performance.now() - begin;
}

// Whether a graphics card draws, which browsers do not always say. A processor takes 50 ms for a ball of 20,000
// triangles.
function drawnByCard() {
  const renderer = new THREE.WebGLRenderer();
  renderer.setSize(600, 600, false);
  const camera = new THREE.PerspectiveCamera(30, 1, 0.1, 10), scene = new THREE.Scene();
  camera.position.z = 4;
  const ball = new THREE.SphereGeometry(1, 100, 100), material = new THREE.MeshLambertMaterial({ side: 2 });
  scene.add(new THREE.Mesh(ball, material), new THREE.DirectionalLight());
  const taken = secondPicture(renderer, () => renderer.render(scene, camera));
  for (const made of [ball, material, renderer]) made.dispose();
  renderer.forceContextLoss();
  return taken < 12;
}

export class View {
  // `surface` is the element that receives mouse events.
  constructor(stage, canvas, surface) {
    Object.assign(this, { stage, canvas });
    this.drawn = drawnByCard() ? "card" : "processor";
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: this.drawn === "card" });
    this.fine = true;
    this.renderer.setClearColor(0xffffff);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.005, FAR);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x9a9690, 2.0);
    this.scene.add(this.sky);
    this.lamp = new THREE.DirectionalLight(0xffffff, 1.5);
    this.scene.add(this.lamp, this.lamp.target);
    this.surface = surface;
    this.setUp("y");
    this.pivot = new THREE.Object3D();
    this.scene.add(this.pivot);
    this.gizmo = new THREE.TransformControls(this.camera, surface);
    this.gizmo.setSize(0.8);
    this.gizmo.addEventListener("change", () => this.draw());
    this.gizmo.addEventListener("dragging-changed", ({ value }) => {
      this.controls.enabled = !value;
    });
    this.handle = this.gizmo.getHelper();
    this.scene.add(this.handle);
    this.depthScene = new THREE.Scene();
    this.target = new THREE.WebGLRenderTarget(1, 1);
    this.waiting = false;
    // While a button is down, slow pictures would delay the pointer.
    this.pressed = false;
    for (const [name, pressed] of [["pointerdown", true], ["pointerup", false], ["pointercancel", false]]) {
      surface.addEventListener(name, () => {
        this.pressed = pressed;
        if (this.slow) this.draw();
      });
    }
    new ResizeObserver(() => {
      this.resize();
      this.render();
    }).observe(canvas);
  }

  // Choose the axis that points up: "y" or "z".
  setUp(axis) {
    this.axis = axis;
    this.turnUp(UP[axis].clone());
  }

  // Turn the view by an angle about its direction.
  roll(angle) {
    const towards = this.camera.position.clone().sub(this.controls.target).normalize();
    this.turnUp(this.camera.up.clone().applyAxisAngle(towards, angle));
  }

  // OrbitControls read the direction upwards only when they are made.
  turnUp(up) {
    const { target, mouseButtons, touches } = this.controls ?? {};
    this.controls?.dispose();
    this.camera.up.copy(up);
    this.sky.position.copy(up);
    this.controls = new THREE.OrbitControls(this.camera, this.surface);
    this.controls.addEventListener("change", () => this.draw());
    if (target) Object.assign(this.controls, { mouseButtons, touches }).target.copy(target);
    this.controls.update();
    this.draw();
  }

  // `coarse` holds the vertices and faces of the preview of a large mesh.
  setMesh(faces, positions, coarse) {
    const geometry = emptyGeometry(faces, positions.length / 3);
    this.attributes = geometry.attributes;
    const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: 2, polygonOffset: true, polygonOffsetFactor: 0.5 });
    this.solid = new THREE.Mesh(geometry, material);
    const depth = new THREE.Mesh(geometry, new THREE.ShaderMaterial(DEPTH));
    this.solid.frustumCulled = depth.frustumCulled = false;
    this.scene.add(this.solid);
    this.depthScene.add(depth);
    if (coarse) {
      this.kept = coarse.vertices;
      this.coarse = new THREE.Mesh(emptyGeometry(coarse.faces, this.kept.length), material);
      this.coarse.frustumCulled = false;
      this.scene.add(this.coarse);
    }
    this.setPositions(positions);
    this.home();
    this.slow = Boolean(coarse) && secondPicture(this.renderer, () => this.render()) > SLOW;
  }

  // Show the materials of the file on copies of the vertices, with texture coordinates: see skin.py.
  setSkin({ vertex, uv, faces, runs }, materials) {
    const geometry = emptyGeometry(faces, vertex.length);
    geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2));
    for (const [first, count, material] of runs) geometry.addGroup(3 * first, 3 * count, material);
    this.skin = new THREE.Mesh(geometry, materials.map(painted));
    this.skin.frustumCulled = false;
    this.skin.userData.vertex = vertex;
    this.scene.add(this.skin);
    this.follow("position");
    this.follow("normal");
    this.isPainted = false;
  }

  // Copy an attribute of the vertices to the skin.
  follow(name) {
    const into = this.skin?.geometry.attributes[name];
    if (!into) return;
    gather(this.skin.userData.vertex, this.attributes[name].array, into.array);
    into.needsUpdate = true;
  }

  setPositions(positions) {
    place(this.solid.geometry, positions);
    this.follow("position");
    this.follow("normal");
    if (this.coarse) {
      const some = new Float32Array(3 * this.kept.length);
      gather(this.kept, positions, some);
      place(this.coarse.geometry, some);
    }
    this.stale = false;
    this.draw();
  }

  // Show a step of a drag; for a large mesh, `positions` are of its preview.
  setStep(positions) {
    if (!this.coarse) {
      this.setPositions(positions);
      return;
    }
    place(this.coarse.geometry, positions);
    this.stale = true;
    this.draw();
  }

  // `paint` fills an array with three linear colour values for each vertex. A skin is shown where its vertices are
  // not `marked`; without marks, it is hidden.
  setColours(paint, marked) {
    const { color } = this.attributes;
    paint(color.array);
    color.needsUpdate = true;
    if (this.coarse) {
      const few = this.coarse.geometry.attributes.color;
      gather(this.kept, color.array, few.array);
      few.needsUpdate = true;
    }
    this.isPainted = Boolean(this.skin && marked);
    if (this.isPainted) {
      const { array } = this.skin.geometry.attributes.color;
      this.follow("color");
      this.skin.userData.vertex.forEach((v, i) => marked[v] || array.fill(1, 3 * i, 3 * i + 3));
    }
    this.draw();
  }

  // Show the whole shape.
  home() {
    this.resize();
    const low = new THREE.Vector3(Infinity, Infinity, Infinity), high = low.clone().negate();
    const P = this.attributes.position.array, at = new THREE.Vector3();
    for (let i = 0; i < P.length; i += 3) {
      at.fromArray(P, i);
      low.min(at);
      high.max(at);
    }
    this.setUp(this.axis);
    const towards = TOWARDS[this.axis].clone().normalize();
    const right = new THREE.Vector3().crossVectors(UP[this.axis], towards).normalize();
    const upright = new THREE.Vector3().crossVectors(towards, right);
    const tall = Math.tan((this.camera.fov * Math.PI) / 360), wide = tall * this.camera.aspect;
    const centre = low.clone().add(high).multiplyScalar(0.5);
    let distance = 0;
    for (let corner = 0; corner < 8; corner += 1) {
      at.set(corner & 1 ? low.x : high.x, corner & 2 ? low.y : high.y, corner & 4 ? low.z : high.z).sub(centre);
      const need = Math.max(Math.abs(at.dot(upright)) / tall, Math.abs(at.dot(right)) / wide);
      distance = Math.max(distance, at.dot(towards) + 1.15 * need);
    }
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(towards, distance);
    this.controls.update();
    this.draw();
  }

  // Show edges of the mesh.
  setWires(shown) {
    this.wires ??= new THREE.Mesh(this.solid.geometry, new THREE.MeshLambertMaterial({ color: 0x20242b, wireframe: true, transparent: true, opacity: 0.35 }));
    this.wires.frustumCulled = false;
    if (shown) this.scene.add(this.wires);
    else this.scene.remove(this.wires);
    this.draw();
  }

  // Move the gizmo to a point, with the axes of a quaternion.
  attach(pivot, quaternion = [0, 0, 0, 1]) {
    this.pivot.position.fromArray(pivot);
    this.pivot.quaternion.fromArray(quaternion);
    this.gizmo.attach(this.pivot);
    this.camera.updateMatrixWorld();
    const at = this.pivot.position.clone().project(this.camera), { clientWidth, clientHeight, offsetTop } = this.canvas;
    this.stage.dataset.gizmo = [((1 + at.x) / 2) * clientWidth, offsetTop + ((1 - at.y) / 2) * clientHeight]; // where to drag
    this.draw();
  }

  detach() {
    this.gizmo.detach();
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.renderer.setSize(width, height, false);
    this.setPixels();
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
  }

  // A processor draws half the pixels in each direction while a preview is shown.
  setPixels() {
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2) * (this.fine ? 1 : 0.5));
  }

  // Draw one picture for many changes.
  draw() {
    if (this.slow) {
      clearTimeout(this.resting);
      this.resting = setTimeout(() => {
        this.resting = null;
        requestAnimationFrame(() => this.render());
      }, REST);
    }
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.render());
  }

  render() {
    this.waiting = false;
    const whole = !this.coarse || !(this.stale || this.resting || (this.slow && this.pressed));
    if (this.solid) this.solid.visible = whole && !this.isPainted;
    if (this.skin) this.skin.visible = whole && this.isPainted;
    if (this.coarse) {
      this.coarse.visible = !whole;
      if (this.wires) this.wires.visible = whole;
      const fine = whole || this.drawn === "card";
      if (fine !== this.fine) {
        this.fine = fine;
        this.setPixels();
      }
    }
    this.lamp.position.copy(this.camera.position);
    this.lamp.target.position.copy(this.controls.target);
    this.lamp.target.updateMatrixWorld();
    this.renderer.render(this.scene, this.camera);
  }

  // Return the pixels x, y of every vertex, and whether it is on the screen and not behind the surface.
  project(through) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const P = this.attributes.position.array, n = P.length / 3;
    this.camera.updateMatrixWorld();
    const world = this.camera.matrixWorldInverse.elements;
    const tall = height / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
    const depth = through ? null : this.readDepth(width, height);
    const x = new Float32Array(n), y = new Float32Array(n), seen = new Uint8Array(n);
    for (let v = 0, i = 0; v < n; v += 1, i += 3) {
      const px = P[i], py = P[i + 1], pz = P[i + 2];
      const z = -(world[2] * px + world[6] * py + world[10] * pz + world[14]);
      x[v] = width / 2 + (tall * (world[0] * px + world[4] * py + world[8] * pz + world[12])) / z;
      y[v] = height / 2 - (tall * (world[1] * px + world[5] * py + world[9] * pz + world[13])) / z;
      if (z <= 0 || x[v] < 0 || x[v] >= width || y[v] < 0 || y[v] >= height) continue;
      seen[v] = !depth || z <= farthest(depth, width, height, x[v] | 0, y[v] | 0) + 1e-3;
    }
    return { x, y, seen };
  }

  // Return the distance to the surface for each pixel, from the top; 0 where there is no surface.
  readDepth(width, height) {
    this.target.setSize(width, height);
    const alpha = this.renderer.getClearAlpha();
    this.renderer.setClearAlpha(0);
    this.renderer.setRenderTarget(this.target);
    this.renderer.clear();
    this.renderer.render(this.depthScene, this.camera);
    const bytes = new Uint8Array(4 * width * height);
    this.renderer.readRenderTargetPixels(this.target, 0, 0, width, height, bytes);
    this.renderer.setRenderTarget(null);
    this.renderer.setClearAlpha(alpha);
    const depth = new Float32Array(width * height);
    for (let row = 0, i = 0; row < height; row += 1) {
      const line = (height - 1 - row) * width;
      for (let column = 0; column < width; column += 1, i += 4) {
        if (!bytes[i + 3]) continue;
        depth[line + column] = FAR * (bytes[i] / 255 + bytes[i + 1] / 65025 + bytes[i + 2] / 16581375);
      }
    }
    return depth;
  }
}

// Return the greatest distance in the pixels around one pixel: a steep surface may be deeper at a vertex than in
// the centre of its pixel.
function farthest(depth, width, height, column, row) {
  let found = 0;
  for (let r = Math.max(row - 1, 0); r <= Math.min(row + 1, height - 1); r += 1) {
    for (let c = Math.max(column - 1, 0); c <= Math.min(column + 1, width - 1); c += 1) {
      found = Math.max(found, depth[r * width + c]);
    }
  }
  return found;
}
