// What the vertices look like: picked, in a group, by the change of edge length, or as the file has them.
/* global THREE */
import { byId } from "./panel.js";

// three.js computes with linear colours.
const linear = (css) => new THREE.Color(css).toArray();
const BODY = linear("#d9d5cf"), PICKED = linear("#1a9850");
export const COLOURS = { static: "#2166ac", moving: "#f2c200" };
const KINDS = { static: linear(COLOURS.static), moving: linear(COLOURS.moving) };
// Linear values of the bytes of colours in files.
const LINEAR = Float32Array.from({ length: 256 }, (_, byte) => linear(`rgb(${byte},0,0)`)[0]);
const STOPS = ["rgb(252,253,191)", "rgb(254,159,109)", "rgb(222,73,104)", "rgb(140,41,129)", "rgb(59,15,112)", "rgb(0,0,4)"];
const RAMP = Array.from({ length: 256 }, (_, i) => {
  const at = (i / 255) * (STOPS.length - 1), k = Math.min(Math.floor(at), STOPS.length - 2);
  return new THREE.Color(STOPS[k]).lerp(new THREE.Color(STOPS[k + 1]), at - k).toArray();
});

// `arrays` are the latest arrays from the session, and `known()` returns its latest facts.
export class Look {
  constructor(view, arrays, known) {
    Object.assign(this, { view, arrays, known, painted: null, waiting: false });
    for (const name of ["colours", "errors"]) byId(name).addEventListener("change", () => this.draw());
  }

  // Show the vertices under the brush as it will pick them.
  paint(found, how) {
    this.painted = found && { found, how };
    this.draw();
  }

  draw() {
    if (this.waiting || !this.arrays.labels) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.colour();
    });
  }

  colour() {
    const { view, arrays } = this, facts = this.known();
    const { labels, selection, change } = arrays, { found, how } = this.painted ?? {};
    const shows = byId("errors").checked && change;
    const base = byId("colours").checked && arrays.colours, skinned = byId("colours").checked && view.skin && !shows;
    const kinds = [BODY, ...facts.groups.map(({ kind }) => KINDS[kind])];
    byId("legend").hidden = !shows;
    byId("top").textContent = shows ? Number(facts.top.toPrecision(2)) : "";
    const marked = skinned && new Uint8Array(labels.length);
    view.setColours((colours) => {
      for (let v = 0, i = 0; v < labels.length; v += 1, i += 3) {
        let picked = selection[v] && !(found && how === "replace");
        if (found && found[v]) picked = how !== "remove";
        if (marked) marked[v] = picked || labels[v];
        if (!picked && !labels[v] && !shows && base) {
          colours[i] = LINEAR[base[i]];
          colours[i + 1] = LINEAR[base[i + 1]];
          colours[i + 2] = LINEAR[base[i + 2]];
          continue;
        }
        const own = picked ? PICKED : labels[v] || !shows ? kinds[labels[v]] : RAMP[change[v]];
        colours[i] = own[0];
        colours[i + 1] = own[1];
        colours[i + 2] = own[2];
      }
    }, marked);
  }

  // Load the materials of the file, unless they are one colour or the vertices have colours instead. The preview of a
  // large mesh gets the colours of the vertices.
  async load({ materials, runs, sent }, complain) {
    const { view, arrays } = this, facts = this.known();
    const several = new Set(materials.map(({ colour: own }) => own.join())).size > 1;
    if (!materials.some(({ image }) => image) && (facts.coloured || !several)) {
      byId("coloured").hidden = !facts.coloured;
      view.stage.dataset.skin = "plain";
      return;
    }
    const images = await Promise.all(materials.map(async ({ image }, i) => {
      if (!image) return null;
      const response = await fetch(`image?material=${i}`);
      if (response.ok) return createImageBitmap(await response.blob()).catch(() => null);
      complain(new Error((await response.json()).error));
      return null;
    }));
    const looks = materials.map(({ colour: own }, i) => {
      if (!images[i]) return { colour: own };
      const texture = new THREE.Texture(images[i]);
      Object.assign(texture, { wrapS: THREE.RepeatWrapping, wrapT: THREE.RepeatWrapping, colorSpace: THREE.SRGBColorSpace });
      Object.assign(texture, { flipY: false, needsUpdate: true });
      return { colour: own, texture };
    });
    arrays.colours ??= sampled(sent, runs, materials, images, arrays.labels.length);
    view.setSkin({ ...sent, runs }, looks);
    view.stage.dataset.skin = "shown";
    this.draw();
  }
}

// Return a colour of three bytes for each vertex: of its material and its place in the texture.
function sampled({ vertex, uv, faces }, runs, materials, images, vertices) {
  const colours = new Uint8Array(3 * vertices);
  for (const [first, count, number] of runs) {
    const { colour: own } = materials[number], image = images[number];
    let pixels = null, width = 1, height = 1;
    if (image) {
      [width, height] = [image.width, image.height].map((side) => Math.min(side, 1024));
      const canvas = Object.assign(document.createElement("canvas"), { width, height });
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0, width, height);
      pixels = context.getImageData(0, 0, width, height).data;
    }
    const at = (x, size) => Math.min(Math.floor((x - Math.floor(x)) * size), size - 1);
    for (let corner = 3 * first; corner < 3 * (first + count); corner += 1) {
      const k = faces[corner], pixel = 4 * (at(uv[2 * k], width) + width * at(uv[2 * k + 1], height));
      for (let c = 0; c < 3; c += 1) colours[3 * vertex[k] + c] = own[c] * (pixels ? pixels[pixel + c] : 255);
    }
  }
  return colours;
}
