// What the vertices look like: picked, in a group, or as the file has them.
/* global THREE */
import { byId } from "./panel.js";

// three.js computes with linear colours.
const linear = (css) => new THREE.Color(css).toArray();
const BODY = linear("#e6e1d9"), PICKED = linear("#1a9850");
const KINDS = { fixed: linear("#2166ac"), moved: linear("#f2c200") };
// Linear values of the bytes of colours in files.
const LINEAR = Float32Array.from({ length: 256 }, (_, byte) => linear(`rgb(${byte},0,0)`)[0]);

// `arrays` are the latest arrays from the session, and `known()` returns its latest facts.
export class Look {
  constructor(view, arrays, known) {
    Object.assign(this, { view, arrays, known, painted: null, waiting: false });
    byId("colours").addEventListener("change", () => this.draw());
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
    const { labels, selection } = arrays, { found, how } = this.painted ?? {}, coloured = byId("colours").checked;
    const base = coloured && arrays.colours;
    const kinds = [BODY, ...facts.groups.map(({ kind }) => KINDS[kind])];
    const marked = coloured && view.skin && new Uint8Array(labels.length);
    view.setColours((colours) => {
      for (let v = 0, i = 0; v < labels.length; v += 1, i += 3) {
        let picked = selection[v] && !(found && how === "replace");
        if (found && found[v]) picked = how !== "remove";
        if (marked) marked[v] = picked || labels[v];
        if (!picked && !labels[v] && base) {
          colours[i] = LINEAR[base[i]];
          colours[i + 1] = LINEAR[base[i + 1]];
          colours[i + 2] = LINEAR[base[i + 2]];
          continue;
        }
        const own = picked ? PICKED : kinds[labels[v]];
        colours[i] = own[0];
        colours[i + 1] = own[1];
        colours[i + 2] = own[2];
      }
    }, marked);
  }

  // Load the materials of the file, unless they are one colour or the vertices have colours instead.
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
      if (!response.ok) return complain(new Error((await response.json()).error));
      return createImageBitmap(await response.blob()).catch(() => complain(new Error("the browser cannot show a texture of the file")));
    }));
    const looks = materials.map(({ colour: own }, i) => {
      if (!images[i]) return { colour: own };
      const texture = new THREE.Texture(images[i]);
      Object.assign(texture, { wrapS: THREE.RepeatWrapping, wrapT: THREE.RepeatWrapping, colorSpace: THREE.SRGBColorSpace });
      Object.assign(texture, { flipY: false, needsUpdate: true });
      return { colour: own, texture };
    });
    view.setSkin({ ...sent, runs }, looks);
    view.stage.dataset.skin = "shown";
    this.draw();
  }
}
