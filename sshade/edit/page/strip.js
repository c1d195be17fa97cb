// The strip of an animation: a time, keys, and a player that shows the poses between the keys.
import { byId } from "./panel.js";

const ROOM = 1; // seconds behind the last key that the slider reaches
const rounded = (time) => Number(time.toFixed(3));
const near = (a, b) => Math.abs(a - b) < 5e-3;

export class Strip {
  // `ask(command, args)` sends a command, `seek(time)` asks for the positions of a pose, `draw(answer)` shows them,
  // `begin()` is called before the first of several.
  constructor(ask, { seek, draw, begin, complain }) {
    Object.assign(this, { ask, seek, draw, begin, complain });
    this.keys = [];
    this.playing = false;
    this.at = 0; // the exact time, which the field rounds
    this.wanted = null; // the time to show next
    this.busy = null; // the loop that shows times
    byId("slider").addEventListener("input", ({ target }) => this.scrub(Number(target.value)));
    byId("slider").addEventListener("change", ({ target }) => this.stay(Number(target.value)));
    byId("time").addEventListener("change", ({ target }) => {
      this.moveTo(Number(target.value));
      if (this.keys.length) this.stay(Number(target.value));
    });
    byId("key").addEventListener("click", async () => {
      if (this.moves) await this.stop();
      if (await this.ask("key", { time: this.keyAt(this.time) ?? this.time })) byId("key").focus();
    });
    byId("unkey").addEventListener("click", () => this.ask("unkey", { time: this.keyAt(this.time) }));
    byId("play").addEventListener("click", () => (this.playing ? this.stop() : this.play()));
  }

  get time() {
    return this.at;
  }

  get last() {
    return this.keys[this.keys.length - 1];
  }

  get moves() {
    return this.playing || this.busy !== null;
  }

  keyAt(time) {
    return this.keys.find((key) => near(key, time));
  }

  show({ keys, groups }) {
    const shown = JSON.stringify([keys, groups.length > 0]);
    this.keys = keys;
    if (keys.length < 2) this.playing = false;
    if (shown === this.shown) return;
    this.shown = shown;
    const focused = document.activeElement?.dataset.key;
    byId("slider").max = keys.length ? this.last + ROOM : 2 * ROOM;
    byId("slider").disabled = keys.length === 0;
    byId("play").disabled = keys.length < 2;
    byId("no-keys").hidden = keys.length > 0;
    byId("save-animation").hidden = keys.length === 0;
    byId("key").disabled = groups.length === 0;
    byId("keys").replaceChildren(...keys.map((time) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: `${rounded(time)} s` });
      button.dataset.key = time;
      button.setAttribute("aria-label", `go to the key at ${rounded(time)} s`);
      button.addEventListener("click", () => this.stay(time));
      return button;
    }));
    byId("keys").querySelector(`[data-key="${focused}"]`)?.focus();
    this.mark();
  }

  // Show the time, and whether a key is there.
  moveTo(time) {
    this.at = time;
    byId("time").value = rounded(time);
    byId("slider").value = time;
    this.mark();
  }

  mark() {
    byId("unkey").disabled = this.keyAt(this.time) === undefined;
    for (const button of byId("keys").children) button.setAttribute("aria-pressed", near(Number(button.dataset.key), this.time));
  }

  scrub(time) {
    this.playing = false;
    this.moveTo(time);
    this.wanted = time;
    this.busy ??= this.follow();
  }

  // Move the groups to the pose of a time.
  async stay(time) {
    this.playing = false;
    this.moveTo(time);
    this.wanted = null;
    await this.busy;
    await this.ask("pose", { time: this.keyAt(time) ?? time });
  }

  play() {
    this.playing = true;
    byId("play").textContent = "Stop";
    byId("play").setAttribute("aria-pressed", true);
    const first = this.keys[0], since = performance.now();
    this.next = () => first + (((performance.now() - since) / 1000) % (this.last - first));
    this.busy ??= this.follow();
  }

  stop() {
    return this.stay(rounded(this.time)); // the time that the field shows
  }

  // Show one time after the other until none is wanted.
  async follow() {
    this.begin();
    try {
      for (;;) {
        const time = this.playing ? this.next() : this.wanted;
        if (time === null) break;
        this.wanted = null;
        await this.draw(await this.seek(time));
        if (this.playing) this.moveTo(time);
      }
    } catch (error) {
      this.complain(error);
      this.wanted = null;
    }
    this.playing = false;
    byId("play").textContent = "Play";
    byId("play").setAttribute("aria-pressed", false);
    this.busy = null;
  }
}
