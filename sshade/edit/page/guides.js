// The planes, lines and surfaces on which groups slide.
import { COLOURS } from "./look.js";

export class Guides {
  // `request(path)` asks the server for a surface.
  constructor(view, request) {
    Object.assign(this, { view, request, surfaces: {}, shown: "" });
  }

  show(groups) {
    const guides = [], { surfaces } = this;
    this.groups = groups;
    for (const { number, kind, slide, pivot } of groups) {
      if (!slide || slide === "free") continue;
      const [[way, value]] = Object.entries(slide);
      if (way === "surface") {
        surfaces[value] ??= this.request(`surface?group=${number}`).then((said) => {
          surfaces[value] = said.sent;
          this.show(this.groups);
        }).catch(() => delete surfaces[value]);
        if (surfaces[value].faces) guides.push({ kind: "surface", name: value, colour: COLOURS[kind] });
        continue;
      }
      const axes = way === "axes" && [..."xyz"].map((c) => Number(value.includes(c)));
      const plane = way === "plane" || (axes && value.length === 2);
      const direction = axes ? axes.map((there) => (plane ? 1 - there : there)) : value;
      guides.push({ kind: plane ? "plane" : "line", at: pivot, direction, colour: COLOURS[kind] });
    }
    const text = JSON.stringify(guides);
    if (text === this.shown) return;
    this.shown = text;
    this.view.setGuides(guides.map((one) => ({ ...one, ...(one.name && surfaces[one.name]) })));
    this.view.stage.dataset.guides = guides.map(({ kind }) => kind).join(" ");
  }
}
