// The map: vehicles with their tracks, routes, fences, home, rally points and what cameras look at, over a grid; beneath it what
// the bridge has of the ground, from a file on its computer. Nothing is loaded from elsewhere.

/* global L */

const TRACK_POINTS = 2000;
// Beyond so many vehicles those that are not chosen are dots, without track and plan: a page must stay quick with a thousand.
export const MANY = 60;
const GRID_STEPS_DEG = [90, 45, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001];

const latitude = (value, digits) => `${Math.abs(value).toFixed(digits)}° ${value < 0 ? "S" : "N"}`;
const longitude = (value, digits) => `${Math.abs(value).toFixed(digits)}° ${value < 0 ? "W" : "E"}`;

/** Lines of latitude and longitude, at steps that suit the zoom. */
function drawGrid(map, grid) {
  grid.clearLayers();
  const bounds = map.getBounds();
  const wide = bounds.getEast() - bounds.getWest();
  const step = GRID_STEPS_DEG.find((each) => wide / each >= 4) ?? GRID_STEPS_DEG.at(-1);
  const digits = Math.max(0, Math.ceil(-Math.log10(step)));
  const line = (from, to, text, at, kind) => {
    L.polyline([from, to], { className: "grid", interactive: false, weight: 1 }).addTo(grid);
    L.marker(at, { interactive: false, keyboard: false, icon: L.divIcon({ className: `grid-text ${kind}`, html: "", iconSize: [0, 0] }) })
      .addTo(grid).getElement().textContent = text;
  };
  const [south, north, west, east] = [bounds.getSouth(), bounds.getNorth(), bounds.getWest(), bounds.getEast()];
  for (let at = Math.ceil(south / step) * step; at <= north; at += step)
    line([at, west], [at, east], latitude(at, digits), [at, west], "parallel");
  for (let at = Math.ceil(west / step) * step; at <= east; at += step)
    line([south, at], [north, at], longitude(at, digits), [north, at], "meridian");
}

const icon = (className, text, size) => {
  const made = L.divIcon({ className, html: "", iconSize: [size, size] });
  made.fill = text;
  return made;
};

/** A marker with a text: set as text, never as HTML. */
function marker(at, className, text, title, size = 22) {
  const made = L.marker(at, { icon: icon(className, text, size), title, alt: title, keyboard: false });
  made.on("add", () => { made.getElement().textContent = text; });
  return made;
}

export class VehiclesMap {
  #map;
  #grid;
  #shapes;
  #moving;
  #vehicles = new Map();
  #placed = false;
  #draft;
  #tool = null;

  constructor(node) {
    this.#map = L.map(node, { preferCanvas: false, zoomControl: true, attributionControl: true, zoomSnap: 0.5, maxZoom: 21 });
    this.#map.attributionControl.setPrefix("Leaflet");
    L.control.scale({ metric: true, imperial: true }).addTo(this.#map);
    this.#grid = L.layerGroup().addTo(this.#map);
    this.#shapes = L.layerGroup().addTo(this.#map);
    this.#moving = L.layerGroup().addTo(this.#map);
    this.#draft = L.layerGroup().addTo(this.#map);
    this.#map.on("click", ({ latlng }) => this.#tool?.click([latlng.lat, latlng.lng]));
    document.addEventListener("keydown", ({ key }) => { if (key === "Escape") this.stop(); });
    this.#map.setView([0, 0], 2);
    this.#map.on("moveend zoomend resize", () => drawGrid(this.#map, this.#grid));
    drawGrid(this.#map, this.#grid);
  }

  /** Pictures of the ground, of this zoom and within these bounds; beyond their zoom they are drawn larger. */
  showTiles({ min_zoom, max_zoom, bounds: [south, west, north, east], attribution }) {
    L.tileLayer("tiles/{z}/{x}/{y}", {
      minNativeZoom: min_zoom,
      maxNativeZoom: max_zoom,
      minZoom: min_zoom,
      maxZoom: this.#map.getMaxZoom(),
      bounds: [[south, west], [north, east]],
      // Of the file: as text, whatever is in it.
      attribution: attribution === null ? undefined : new Option(attribution).innerHTML,
    }).addTo(this.#map);
  }

  /** What changes seldom. */
  drawShapes(vehicles, chosen) {
    this.#shapes.clearLayers();
    const all = L.latLngBounds([]);
    const shown = vehicles.length > MANY ? vehicles.filter(({ id }) => id === chosen) : vehicles;
    for (const { id, home, route, fence, rally } of shown) {
      const faded = id === chosen ? "" : " faded";
      for (const area of fence.areas) {
        const options = { className: `${area.keep_in ? "keep-in" : "keep-out"}${fence.aboard ? "" : " not-aboard"}${faded}` };
        const shape = area.radius_m === null
          ? L.polygon(area.corners, options)
          : L.circle(area.corners[0], { radius: area.radius_m, ...options });
        shape.bindTooltip(`${area.keep_in ? "stay inside" : "stay outside"}${fence.aboard ? "" : ": not shown by the vehicle"}`);
        shape.addTo(this.#shapes);
      }
      if (route) {
        const path = route.path.map((one) => one.at);
        // What a vehicle does not name may be another by now.
        const aboard = route.aboard === true ? "" : " not-aboard";
        L.polyline(path, { className: `route${aboard}${faded}`, interactive: false }).addTo(this.#shapes);
        for (const at of path) all.extend(at);
        for (const one of route.waypoints) {
          marker(one.at, `waypoint${faded}`, String(one.number), `waypoint ${one.number}`).addTo(this.#shapes);
        }
      }
      rally.forEach((one) => marker(one.at, `rally${faded}`, "R", "rally point").addTo(this.#shapes));
      if (home) {
        all.extend([home[0], home[1]]);
        marker([home[0], home[1]], `home${faded}`, "H", "home").addTo(this.#shapes);
      }
    }
    this.#bounds = all;
    this.#show();
  }

  /**
   * Gives clicks on the map to a tool, or to none where it has them already: one has them at a time. `tool.click(at)` is given each,
   * `tool.pressed(on)` is called when it has them and when no longer: by this, by Escape, or since another has.
   */
  toggle(tool) {
    this.#give(tool === this.#tool ? null : tool);
  }

  /** No tool has the clicks any more: they do what maps do. */
  stop() {
    this.#give(null);
  }

  #give(tool) {
    const before = this.#tool;
    this.#tool = tool;
    this.#map.getContainer().classList.toggle("clicking", tool !== null);
    before?.pressed(false);
    tool?.pressed(true);
  }

  /** The place in the middle of the map. */
  middle() {
    const { lat, lng } = this.#map.getCenter();
    return [lat, lng];
  }

  /** A route that is being drawn. */
  drawDraft(points) {
    this.#draft.clearLayers();
    L.polyline(points, { className: "draft", interactive: false }).addTo(this.#draft);
    points.forEach((at, i) => marker(at, "draft-point", String(i + 1), `drawn point ${i + 1}`).addTo(this.#draft));
  }

  #bounds = null;

  /** The first thing that has a place is shown; after that the map is the operator's. */
  #show() {
    if (this.#placed || !this.#bounds?.isValid()) return;
    this.#placed = true;
    this.#map.fitBounds(this.#bounds.pad(0.25), { animate: false, maxZoom: 18 });
  }

  #tracks = new Map();

  /** The whole tracks of a recording: points of time, ms, latitude and longitude. */
  setTracks(tracks) {
    this.#tracks = new Map(tracks);
    // At its first moment a vehicle often has no place yet: what is shown first is where all of it is flown.
    const all = L.latLngBounds(tracks.flatMap(([, points]) => points.map(([, north, east]) => [north, east])));
    if (all.isValid()) this.#bounds = all;
    this.#show();
  }

  /** Where the vehicle was: since the page was opened, or in a recording until this moment. */
  #track(id, at, live, moment) {
    const recorded = this.#tracks.get(id);
    if (recorded) return [...recorded.filter(([ms]) => ms <= moment).map(([, north, east]) => [north, east]), at];
    const track = this.#vehicles.get(id) ?? [];
    this.#vehicles.set(id, track);
    const last = track.at(-1);
    if (live && (!last || last[0] !== at[0] || last[1] !== at[1])) track.push(at);
    if (track.length > TRACK_POINTS) track.shift();
    return track;
  }

  /** What is drawn of each vehicle, which moves with it. */
  #drawn = new Map();

  /** Where the vehicles are; `moment`: of a recording. */
  drawVehicles(vehicles, chosen, moment) {
    const there = new Set();
    for (const vehicle of vehicles) {
      const { id, position, live } = vehicle;
      if (!position) continue;
      there.add(id);
      const at = [position[0], position[1]];
      const dot = vehicles.length > MANY && id !== chosen;
      let drawn = this.#drawn.get(id);
      if (drawn?.dot !== dot) {
        drawn?.layer.remove();
        drawn = dot ? new Dot(id, this.#dots) : new Aircraft();
        drawn.layer.addTo(this.#moving);
        this.#drawn.set(id, drawn);
      }
      drawn.move(at, vehicle, id !== chosen, dot ? [] : this.#track(id, at, live, moment));
      if (!this.#placed && (this.#bounds === null || !this.#bounds.isValid())) {
        this.#placed = true;
        this.#map.setView(at, 16);
      }
    }
    for (const [id, { layer }] of this.#drawn) {
      if (there.has(id)) continue;
      layer.remove();
      this.#drawn.delete(id);
    }
  }

  #dots = L.canvas();
}

/** One of very many vehicles. */
class Dot {
  dot = true;

  constructor(id, renderer) {
    const color = getComputedStyle(document.documentElement).getPropertyValue("--track");
    this.layer = L.circleMarker([0, 0], { renderer, radius: 3, color, weight: 1, fillOpacity: 0.6 }).bindTooltip(id);
  }

  move(at, { live }) {
    this.layer.setLatLng(at);
    this.layer.setStyle({ opacity: live ? 1 : 0.3 });
  }
}

/** A vehicle with its track, its name and where its cameras look. */
class Aircraft {
  dot = false;
  #track = L.polyline([], { className: "track", interactive: false });
  #sights = L.layerGroup();
  #marker = marker([0, 0], "aircraft", "", "", 30).setZIndexOffset(1000);
  #body = document.createElement("i");
  #label = document.createElement("b");

  constructor() {
    this.layer = L.layerGroup([this.#track, this.#sights, this.#marker]);
    this.#marker.on("add", () => { this.#marker.getElement().replaceChildren(this.#body, this.#label); });
  }

  move(at, { id, motion, live, tail_number, looks_at }, faded, track) {
    const name = tail_number || id;
    this.#track.setLatLngs(track);
    this.#marker.setLatLng(at);
    const node = this.#marker.getElement();
    node.title = node.ariaLabel = `${name}${live ? "" : ": no data"}`;
    node.classList.toggle("stale", !live);
    for (const each of [node, this.#track.getElement()]) each?.classList.toggle("faded", faded);
    this.#body.textContent = motion.heading_deg === null ? "●" : "▲";
    this.#body.style.transform = `rotate(${motion.heading_deg ?? 0}deg)`;
    this.#label.textContent = name;
    this.#sights.clearLayers();
    for (const seen of looks_at) {
      const centre = [seen.centre[0], seen.centre[1]];
      L.polyline([at, centre], { className: `sight${faded ? " faded" : ""}`, interactive: false }).addTo(this.#sights);
      marker(centre, `footprint${faded ? " faded" : ""}`, "+", `centre of the image of station ${seen.station}`).addTo(this.#sights);
    }
  }
}
