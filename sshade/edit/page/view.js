// The mesh on the canvas: positions, colours, camera, gizmo, and the places of vertices on the screen.
/* global THREE */

const FAR = 50;
const UP = { y: new THREE.Vector3(0, 1, 0), z: new THREE.Vector3(0, 0, 1) };
const TOWARDS = { y: new THREE.Vector3(0.5, 0.25, 1).normalize(), z: new THREE.Vector3(0.5, -1, 0.25).normalize() };

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
  geometry.attributes.position.array.set(positions);
  geometry.attributes.position.needsUpdate = true;
  geometry.computeVertexNormals();
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

// The floor is a square with a line every tenth of the diagonal, which fades away from the middle.
const FLOOR = {
  side: 2, transparent: true, depthWrite: false,
  vertexShader: `
    varying vec2 at;
    void main() {
      at = position.xz;
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    }`,
  fragmentShader: `
    varying vec2 at;
    void main() {
      vec2 off = abs(fract(10.0 * at - 0.5) - 0.5) / fwidth(10.0 * at);
      float line = 1.0 - min(min(off.x, off.y), 1.0);
      gl_FragColor = vec4(0.25, 0.3, 0.37, 0.5 * line * smoothstep(1.5, 0.4, length(at)));
    }`,
};

function makeFloor() {
  const geometry = new THREE.BufferGeometry();
  const corners = [-1.5, 0, -1.5, 1.5, 0, -1.5, 1.5, 0, 1.5, -1.5, 0, 1.5];
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(corners), 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  return new THREE.Mesh(geometry, new THREE.ShaderMaterial(FLOOR));
}

// Draw the directions of x, y and z in a corner.
function drawAxes(svg, camera) {
  const turn = camera.quaternion.clone().invert();
  svg.innerHTML = ["x", "y", "z"].map((name, c) => {
    const { x, y } = new THREE.Vector3().setComponent(c, 26).applyQuaternion(turn);
    return `<g class="axis-${name}"><path d="M0,0L${x},${-y}"/><text x="${1.3 * x}" y="${-1.3 * y}">${name}</text></g>`;
  }).join("");
}

export class View {
  // `surface` is the element that receives mouse events.
  constructor(stage, canvas, surface) {
    Object.assign(this, { stage, canvas });
    this.axes = stage.querySelector("#axes");
    // Smooth edges take a processor, which draws where there is no graphics card, twice the time.
    const gl = document.createElement("canvas").getContext("webgl2"), names = gl?.getExtension("WEBGL_debug_renderer_info");
    const slow = names && /swiftshader|llvmpipe|basic render/i.test(gl.getParameter(names.UNMASKED_RENDERER_WEBGL));
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !slow });
    this.renderer.setClearColor(0xd3dae3); // as in style.css
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.005, FAR);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x9a9690, 2.0);
    this.scene.add(this.sky);
    this.lamp = new THREE.DirectionalLight(0xffffff, 1.5);
    this.floor = makeFloor();
    this.scene.add(this.lamp, this.lamp.target, this.floor);
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
    this.scene.add(this.gizmo.getHelper());
    this.depthScene = new THREE.Scene();
    this.target = new THREE.WebGLRenderTarget(1, 1);
    this.waiting = false;
    new ResizeObserver(() => {
      this.resize();
      this.render();
    }).observe(canvas);
  }

  // Choose the axis that points up: "y" or "z". OrbitControls read it only when they are made.
  setUp(axis) {
    const { mouseButtons, touches } = this.controls ?? {}, { cursor } = this.surface.style;
    this.axis = axis;
    this.controls?.dispose();
    this.camera.up.copy(UP[axis]);
    this.sky.position.copy(UP[axis]);
    this.floor.quaternion.setFromUnitVectors(UP.y, UP[axis]);
    this.controls = new THREE.OrbitControls(this.camera, this.surface);
    this.controls.addEventListener("change", () => this.draw());
    if (mouseButtons) Object.assign(this.controls, { mouseButtons, touches });
    this.surface.style.cursor = cursor; // the former controls have taken it
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

  // Show the whole shape, with an axis that points up.
  home(up = this.axis) {
    this.resize();
    this.solid.geometry.computeBoundingBox();
    const { min: low, max: high } = this.solid.geometry.boundingBox;
    this.setUp(up);
    const height = UP[up].dot(low), centre = low.clone().add(high).multiplyScalar(0.5);
    this.floor.position.copy(centre).addScaledVector(UP[up], height - UP[up].dot(centre));
    const tall = Math.tan((this.camera.fov * Math.PI) / 360), narrow = Math.atan(tall * Math.min(1, this.camera.aspect));
    const distance = high.distanceTo(low) / 2 / Math.sin(narrow);
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(TOWARDS[up], distance);
    this.controls.update();
    this.draw();
  }

  // Move the gizmo to a point.
  attach(pivot) {
    this.pivot.position.fromArray(pivot);
    this.pivot.quaternion.set(0, 0, 0, 1);
    this.gizmo.attach(this.pivot);
    this.camera.updateMatrixWorld();
    const at = this.pivot.position.clone().project(this.camera), { clientWidth, clientHeight, offsetTop } = this.canvas;
    this.stage.dataset.gizmo = [((1 + at.x) / 2) * clientWidth, offsetTop + ((1 - at.y) / 2) * clientHeight]; // where to drag
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.renderer.setSize(width, height, false);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
  }

  // Draw one picture for many changes.
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.render());
  }

  render() {
    this.waiting = false;
    const whole = !this.stale;
    if (this.solid) this.solid.visible = whole && !this.isPainted;
    if (this.skin) this.skin.visible = this.isPainted;
    if (this.coarse) this.coarse.visible = !whole;
    this.lamp.position.copy(this.camera.position);
    this.lamp.target.position.copy(this.controls.target);
    this.lamp.target.updateMatrixWorld();
    this.renderer.render(this.scene, this.camera);
    drawAxes(this.axes, this.camera);
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
