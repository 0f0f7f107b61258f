// A route that is drawn: points by clicks or at the middle of the map, each with its altitude above home. An altitude that was not
// given is none: such a route is not sent.

import { altitudeIn, altitudeUnit, inAltitude, place } from "./units.js";

const by = (id) => document.getElementById(id);

export class Drawing {
  #map;
  #points = [];
  #listening = false;
  /** What was sent is as it is drawn. */
  #sent = false;
  #changed;

  /** `changed()` is called after each change. */
  constructor(map, changed) {
    this.#map = map;
    this.#changed = changed;
    const tool = { click: (at) => this.#add(at), pressed: (on) => this.#listen(on) };
    by("draw").addEventListener("click", () => map.toggle(tool));
    by("draw-middle").addEventListener("click", () => this.#add(this.#map.middle()));
    by("draw-clear").addEventListener("click", () => this.clear());
    // What a point was not given it has from the route, as long as it is given there.
    by("route-altitude").addEventListener("input", () => {
      this.#sent = false;
      this.refresh();
      this.#changed();
    });
  }

  get points() {
    const ofRoute = altitudeIn(by("route-altitude"));
    return this.#points.map((point) => ({ ...point, heightM: point.heightM ?? ofRoute }));
  }

  /** Points that were not sent as they are. */
  get unsent() {
    return this.#sent ? 0 : this.#points.length;
  }

  /** Whether clicks on the map are points of it. */
  get listening() {
    return this.#listening;
  }

  /** The altitude of the route stands in the fields of the points that have it. */
  refresh() {
    const ofRoute = altitudeIn(by("route-altitude"));
    const text = ofRoute === null ? "" : inAltitude(ofRoute);
    for (const input of this.#inputs()) {
      input.placeholder = text;
      input.required = text === "";
    }
  }

  sent() {
    this.#sent = true;
    this.#changed();
  }

  /** Why the route cannot be sent yet; null where it can. */
  fault() {
    if (this.#points.length < 2) return "a route has two points or more: click on the map";
    const unreadable = this.#inputs().findIndex(isUnreadable);
    if (unreadable >= 0) return `the altitude of point ${unreadable + 1} is no number`;
    const bare = this.points.findIndex(({ heightM }) => heightM === null);
    return bare < 0 ? null : `point ${bare + 1} has no altitude: give the route's, or its own`;
  }

  /** Leads to what is wrong or missing: the altitude of the route, or of a point where that is given. */
  showFault() {
    const missing = altitudeIn(by("route-altitude")) === null ? by("route-altitude") : document.querySelector("#draft input:invalid");
    if (this.#points.length >= 2) (this.#inputs().find(isUnreadable) ?? missing)?.focus();
  }

  /** The fields of the points' altitudes. */
  #inputs() {
    return [...by("draft").querySelectorAll("input")];
  }


  clear() {
    this.#points = [];
    this.#show();
  }

  #listen(on) {
    this.#listening = on;
    if (on) {
      // What was sent is flown: what is drawn now is another route.
      if (this.#sent) this.clear();
      by("map").scrollIntoView({ block: "nearest" });
    }
    by("draw").setAttribute("aria-pressed", String(on));
    this.#changed();
  }

  #add(at) {
    this.#points.push({ at, heightM: null, speedMs: null });
    this.#show();
  }

  /** The list beside the map, and the line on it. */
  #show() {
    this.#sent = false;
    this.#map.drawDraft(this.#points.map(({ at }) => at));
    const rows = this.#points.map((point, i) => {
      const row = document.createElement("li");
      const label = document.createElement("label");
      const input = document.createElement("input");
      input.type = "number";
      input.className = "altitude";
      input.step = "any";
      input.value = point.heightM === null ? "" : inAltitude(point.heightM);
      input.addEventListener("change", () => {
        point.heightM = altitudeIn(input);
        this.#sent = false;
        this.#changed();
      });
      const unit = document.createElement("span");
      unit.className = "altitude-unit";
      unit.textContent = altitudeUnit();
      label.append(`${i + 1}: `, input, " ", unit);
      const where = document.createElement("small");
      where.textContent = place(point.at);
      const gone = document.createElement("button");
      gone.type = "button";
      gone.textContent = "×";
      gone.setAttribute("aria-label", `Remove point ${i + 1}`);
      gone.addEventListener("click", () => {
        this.#points.splice(i, 1);
        this.#show();
      });
      row.append(label, where, gone);
      return row;
    });
    by("draft").replaceChildren(...rows);
    this.refresh();
    this.#changed();
  }
}

/** What is typed there is no number, and reads as nothing. */
const isUnreadable = ({ validity }) => validity.badInput;
