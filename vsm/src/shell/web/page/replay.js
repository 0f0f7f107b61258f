// The time line of a recording: which moment is shown, played at a speed or sought by mouse and keyboard.

import { time } from "./units.js";

const by = (id) => document.getElementById(id);
const STEP_MS = 10_000;

export class TimeLine {
  #span;
  #at;
  #seen = performance.now();
  #playing = false;
  #changed;

  /** `changed(sought)` is called where another moment is to be shown; sought: not the one that follows. */
  constructor(span, changed) {
    this.#span = span;
    this.#at = span.from_ms;
    this.#changed = changed;
    by("timeline").hidden = false;
    const slider = by("moment");
    slider.max = span.to_ms - span.from_ms;
    slider.addEventListener("input", () => this.seek(span.from_ms + Number(slider.value)));
    slider.addEventListener("keydown", (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      this.#toggle();
    });
    by("play").addEventListener("click", () => this.#toggle());
    by("back").addEventListener("click", () => this.seek(this.#at - STEP_MS));
    by("forward").addEventListener("click", () => this.seek(this.#at + STEP_MS));
    this.#show();
  }

  /** The moment that is shown, ms since 1970. */
  get at() {
    return Math.round(this.#at);
  }

  /** Advances by the time that has passed, where it plays. */
  tick() {
    const now = performance.now();
    const passed = now - this.#seen;
    this.#seen = now;
    if (!this.#playing) return;
    this.#at = Math.min(this.#span.to_ms, this.#at + passed * Number(by("speed").value));
    if (this.#at >= this.#span.to_ms) this.#toggle();
    this.#show();
  }

  seek(at) {
    this.#at = Math.min(this.#span.to_ms, Math.max(this.#span.from_ms, at));
    this.#show();
    this.#changed(true);
  }

  #toggle() {
    this.#playing = !this.#playing;
    this.#seen = performance.now();
    // What has ended is played from its beginning.
    if (this.#playing && this.#at >= this.#span.to_ms) this.seek(this.#span.from_ms);
    by("play").textContent = this.#playing ? "Pause" : "Play";
    this.#changed(false);
  }

  #show() {
    const slider = by("moment");
    const value = String(Math.round(this.#at - this.#span.from_ms));
    if (document.activeElement !== slider || slider.value !== value) slider.value = value;
    const shown = `${new Date(this.#at).toISOString().slice(0, 10)} ${time(this.#at)}`;
    by("moment-text").textContent = shown;
    slider.setAttribute("aria-valuetext", shown);
  }
}
