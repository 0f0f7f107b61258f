// Control: this page as a ground station. What it sends are messages of the DLI over the WebSocket; what it shows of the vehicle
// is what the vehicle reports, elsewhere on the page, and here what became of each command.

import { Commands, remember, set } from "./commands.js";
import { confirmed } from "./confirm.js";
import { Drawing } from "./drawing.js";
import * as messages from "./messages.js";
import { begins, leadToNext, showNext } from "./next.js";
import { ControlSocket, importKey } from "./socket.js";
import { altitudeIn, altitudeUnit, height, name } from "./units.js";

const by = (id) => document.getElementById(id);
// The bridge ends a connection over a frame of more than 256 KiB: the route, as JSON, has to leave room for the rest of its frame.
const MAX_ROUTE_BYTES = 250_000;
// A bridge that is started again reads what it has stored; a controller may be silent for 10 s.
const AGAIN_AFTER_MS = 1000;
// Control that ends so soon after this station has given it up is not lost.
const GIVEN_WITHIN_MS = 10_000;

const idText = (id) => (typeof id === "string" ? id : (id >>> 0).toString(16).padStart(8, "0").replace(/(..)(?=.)/g, "$1:"));

export class Control {
  #map;
  #drawing;
  #chosen;
  #all;
  #socket = null;
  #connecting = false;
  #own = null;
  /** The key that was used last, which no script can read: who connects again as the same station needs not give it again. */
  #key = null;
  /** It is this page that ends the connection. */
  #leaves = false;
  /** The timer by which a connection that has broken is opened again. */
  #again = 0;
  /** The ids of the vehicles that this station controls, by what the bridge has reported last. */
  #controlled = new Set();
  /** Of those that it has given up: when. */
  #given = new Map();
  /** Of those that it has lost, until it controls them again or has said so while it was connected. */
  #lost = new Set();
  #vsm = null;
  #loi = [];
  #beat = null;
  #commands = new Commands(by("commands"), (text, kind) => this.#say(text, kind));
  /** By vehicle and alert: to whom its 16000 belongs, and its stamp. */
  #alerts = new Map();
  /** By vehicle: {cucs, levels} that asks for what this station holds. */
  #asked = new Map();
  /** That of them which the page shows. */
  #read = null;
  #route = null;
  /** Why a route was not sent, as long as that is so. */
  #unsent = null;
  /** The route that is under way: {one: its command, ended: a promise of its end, end}. */
  #underway = null;

  /** `chosen()` is the status of the vehicle that is shown, `all()` that of each. */
  constructor(map, chosen, all) {
    this.#map = map;
    this.#chosen = () => asKnown(chosen());
    this.#all = () => all().map(asKnown);
    this.#drawing = new Drawing(map, () => this.draw());
    by("control").hidden = false;
    by("sign-in").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#connect();
    });
    const on = (id, act) => by(id).addEventListener("click", act);
    on("disconnect", () => this.#disconnect());
    addEventListener("beforeunload", (event) => {
      if (this.#socket && this.#flown(this.#all()).length > 0) event.preventDefault();
    });
    for (const [field, button] of [["launch-altitude", "launch"], ["fly-from", "fly"]])
      by(field).addEventListener("keydown", (event) => {
        if (event.key !== "Enter") return;
        // Else it presses what has the keyboard then: No, of the question that has just been asked.
        event.preventDefault();
        by(button).click();
      });
    on("next", leadToNext);
    on("take", () => this.#take());
    on("ask", () => this.#command("ask for control", ({ id }) => messages.ask(id, this.#vsm, this.#own, this.#loi)));
    on("release", () => this.#release());
    on("send-drawn", () => this.#sendDrawn());
    by("route-file").addEventListener("change", () => this.#sendFile(by("route-file").files[0]));
    on("launch", () => this.#launch());
    on("fly", () => this.#fly());
    on("hold", () => this.#ask("hold where it is", "Hold", (vehicle) => messages.hold(vehicle.id)));
    on("land", () => this.#ask("land where it is", "Land", (vehicle) => messages.land(vehicle.id)));
    const loiter = {
      click: (at) => {
        map.stop();
        this.#loiter(at);
      },
      pressed: (is) => this.#loiterPressed(is),
    };
    on("loiter", () => map.toggle(loiter));
    on("loiter-middle", () => this.#loiter(this.#map.middle()));
    on("hand-over", () => this.#answer(true));
    on("refuse", () => this.#answer(false));
    this.#takeDrops();
    this.draw();
  }

  /** Fills in what a link has brought. Who opened it still connects by himself: whoever sends a link must not decide as which station its reader flies. */
  fillIn({ id, key }) {
    if (this.#socket) return;
    by("station-id").value = id;
    by("key").value = key;
    this.#say(`filled in by the link: press Connect to be ${id}`, "");
  }

  /** Whether this alert can be acknowledged here: its 16000 was received. */
  canAcknowledge(vehicle, alert) {
    return this.#socket !== null && this.#alerts.has(`${vehicle} ${alert}`);
  }

  acknowledge(vehicle, alert) {
    // The button stays until it is drawn again, also where the connection has just ended.
    if (!this.canAcknowledge(vehicle, alert)) return;
    const { from, stamp } = this.#alerts.get(`${vehicle} ${alert}`);
    this.#socket.send({ message: messages.acknowledge(from, stamp) });
  }

  /** Shows what this station may do now, by what the bridge reports of its rights. `route`: the one of the vehicle that is shown. */
  draw(route = this.#route) {
    this.#route = route;
    const vehicle = this.#chosen();
    const connected = this.#socket !== null;
    this.#noteLosses();
    if (connected) this.#sayLosses();
    by("sign-in").hidden = connected;
    by("station").hidden = !connected;
    for (const unit of document.querySelectorAll(".altitude-unit")) set(unit, altitudeUnit());
    if (vehicle) {
      const { unsent: drawn, listening: drawing, points } = this.#drawing;
      showNext({
        connected, own: this.#own, vehicle, drawing, drawn, points: points.length, fault: this.#drawing.fault(),
        route: route?.aboard === true, altitude: altitudeIn(by("launch-altitude")), waiting: this.#commands.waiting,
      });
      if (this.#unsent && this.#drawing.fault() !== this.#unsent) {
        this.#unsent = null;
        if (connected) this.#sayLast();
      }
      this.#drawing.refresh();
    }
    if (!connected || !vehicle) return;
    const held = vehicle.holders.find((one) => one.id === this.#own);
    set(by("station-rights"), held ? `holds LOI ${held.levels} of ${name(vehicle)}` : `holds no level of ${name(vehicle)}`);
    by("station-rights").className = held ? "good" : "";
    const asked = this.#asked.get(vehicle.id);
    // A request that has ended is no longer among what waits.
    by("asked").hidden = !asked || !held || !vehicle.handovers.some(({ to }) => to === asked.cucs);
    if (asked) set(by("asked-text"), `${asked.cucs} asks for ${asked.levels.join(", ")}`);
    this.#read = asked;
  }

  /** `broken`: a connection that broke is opened again. */
  async #connect(broken = false) {
    // A second connection would take the place of the first, whose end would be taken for its own.
    if (this.#connecting || this.#socket) return;
    // Who fills in the form meanwhile connects by himself.
    if (broken && (by("station-id").value !== this.#own || by("key").value !== "" || by("key-file").files.length > 0)) return;
    this.#connecting = true;
    clearTimeout(this.#again);
    const id = by("station-id").value.trim().toLowerCase();
    if (!broken) this.#say("connecting", "");
    let key;
    try {
      const file = by("key-file").files[0];
      const typed = file ? await file.text() : by("key").value;
      key = typed === "" && id === this.#own && this.#key ? this.#key : await importKey(typed);
      [this.#socket, { vsm: this.#vsm, loi: this.#loi }] = await ControlSocket.open(id, key, (body) => this.#taken(body), (why, breaks) => this.#ended(why, breaks));
    } catch (fault) {
      if (broken && fault.broken) this.#connectSoon();
      else this.#say(`not connected: ${fault.message ?? fault}`, "bad");
      return;
    } finally {
      this.#connecting = false;
    }
    // The key is in the hands of the browser now: it is not kept where it was typed.
    by("sign-in").reset();
    by("station-id").value = id;
    by("key").placeholder = "as before";
    // What another station has controlled was not this one's.
    if (id !== this.#own) for (const known of [this.#controlled, this.#lost]) known.clear();
    [this.#own, this.#key, this.#leaves] = [id, key, false];
    set(by("station-name"), id);
    this.#say(`connected${broken ? " again" : ""} as ${id}; may hold LOI ${this.#loi.join(", ")}`, "good");
    this.#beat = new Worker("page/beat.js");
    // At once, whatever else is under way: who is silent loses control.
    this.#beat.onmessage = () => this.#socket?.send({ message: messages.heartbeat(this.#vsm) });
    this.draw();
    // Who was elsewhere when it broke stays there.
    if (!broken) by("take").focus();
  }

  #noteLosses() {
    for (const { id, controller } of this.#own ? this.#all() : []) {
      if (controller === this.#own) {
        this.#controlled.add(id);
        this.#lost.delete(id);
      } else if (this.#controlled.delete(id)) {
        const given = this.#leaves || performance.now() - (this.#given.get(id) ?? -Infinity) < GIVEN_WITHIN_MS;
        this.#given.delete(id);
        if (!given) this.#lost.add(id);
      }
    }
  }

  /** It is offered, and never taken by itself: somebody else may have decided meanwhile who is to fly. */
  #sayLosses() {
    const lost = this.#all().filter(({ id }) => this.#lost.has(id));
    if (lost.length === 0) return;
    this.#lost.clear();
    const who = lost.map((one) => `${name(one)}: control is lost, ${one.controller ?? "nobody"} controls it now`);
    this.#say(`${who.join("; ")}; to have it again, press ${by("take").textContent}`, "bad");
  }

  #connectSoon() {
    this.#again = setTimeout(() => this.#connect(true), AGAIN_AFTER_MS);
  }

  /** `breaks`: nobody has ended it. Then it is opened again: a station that is silent loses control, and its vehicle may be in flight. */
  #ended(why, breaks) {
    this.#beat?.terminate();
    this.#socket = null;
    this.#map.stop();
    this.#routeEnds();
    this.#alerts.clear();
    this.#asked.clear();
    this.#commands.end();
    if (breaks) {
      this.#say(`disconnected: ${why}; connecting again as ${this.#own}`, "bad");
      this.#connectSoon();
    } else if (this.#leaves) this.#say("disconnected; to be the same station again, press Connect", "");
    else this.#say(why ? `disconnected: ${why}` : "disconnected", why ? "bad" : "");
    this.draw();
  }

  /** What was said of a tool or a field is over. */
  #sayLast() {
    if (!this.#commands.sayNewest()) this.#say("", "");
  }

  #say(text, kind) {
    set(by("control-state"), text);
    by("control-state").title = text;
    by("control-state").className = kind;
  }

  /**
   * Frames go in the order of their stamps: while a route takes stamps of its own, what follows waits for its end. False where
   * the connection has ended meanwhile: then nothing is sent.
   */
  async #turn(label, vehicle) {
    while (this.#underway) await this.#underway.ended;
    if (!this.#socket) this.#say(`${name(vehicle)}: ${label}: not sent: disconnected`, "bad");
    return this.#socket !== null;
  }

  #routeEnds() {
    this.#underway?.end();
    this.#underway = null;
  }

  async #command(label, make, vehicle = this.#chosen()) {
    if (!vehicle || !(await this.#turn(label, vehicle))) return;
    const message = make(vehicle);
    const one = this.#commands.add(label, vehicle, message.fields["Time Stamp"]);
    one.n = this.#socket.send({ message });
  }

  /** What is asked of one vehicle is sent to that one, whichever is shown when the answer comes. */
  async #ask(what, yes, make) {
    const vehicle = this.#chosen();
    if (!vehicle || !(await confirmed(`${name(vehicle)}: ${what}?`, yes))) return;
    await this.#command(what, make, vehicle);
  }

  async #take() {
    const override = by("override").checked;
    const vehicle = this.#chosen();
    const holder = vehicle?.controller;
    if (override && holder && holder !== this.#own
      && !(await confirmed(`Take ${name(vehicle)} from ${holder}, which controls it?`, "Take it"))) return;
    const make = override ? messages.override : messages.request;
    await this.#command(override ? "take from its holder" : "take", ({ id }) => make(id, this.#vsm, this.#loi), vehicle);
  }

  /** Those of the vehicles that this station controls and that may be in the air. */
  #flown(vehicles) {
    return vehicles.filter((one) => one.controller === this.#own && one.on_ground !== true);
  }

  /** In the air nobody commands them afterwards: that is asked first. */
  async #mayLeave(vehicles, what, yes) {
    const flown = this.#flown(vehicles).map(name).join(", ");
    return flown === "" || confirmed(`Nobody will control ${flown} then, possibly in flight: ${what}?`, yes);
  }

  async #release() {
    const vehicle = this.#chosen();
    if (!vehicle || !(await this.#mayLeave([vehicle], "release it", "Release"))) return;
    this.#given.set(vehicle.id, performance.now());
    await this.#command("release", ({ id }) => messages.relinquish(id, this.#vsm), vehicle);
  }

  async #disconnect() {
    if (!(await this.#mayLeave(this.#all(), "disconnect", "Disconnect"))) return;
    this.#leaves = true;
    this.#socket?.close();
  }

  #launch() {
    if (!this.#isUsable("launch-altitude")) return;
    const heightM = altitudeIn(by("launch-altitude"));
    const { id, on_ground } = this.#chosen() ?? {};
    if (on_ground === true) begins(id);
    this.#ask(`launch to ${height(heightM)} above home`, "Launch", (vehicle) => messages.launch(vehicle.id, heightM));
  }

  #fly() {
    if (!this.#isUsable("fly-from")) return;
    const from = by("fly-from").value.trim();
    const number = from === "" ? null : Number(from);
    const waypoints = this.#route?.aboard === true ? ` of ${this.#route.waypoints.length} waypoints` : "";
    const route = number === null ? `fly the loaded route${waypoints}` : `fly the route from waypoint ${number}`;
    // PX4 takes the mode on the ground too, and stays there.
    const what = this.#chosen()?.on_ground === true ? `${route} (it stands on the ground, and waits there until it is launched)` : route;
    this.#ask(what, "Fly", ({ id }) => messages.flyRoute(id, number));
  }

  #loiterPressed(is) {
    by("loiter").setAttribute("aria-pressed", String(is));
    if (is) this.#say("click on the map where it is to loiter; Escape: not", "");
    else this.#sayLast();
  }

  #loiter(at) {
    if (!this.#isUsable("loiter-altitude")) return;
    const heightM = altitudeIn(by("loiter-altitude"));
    const level = heightM === null ? "at its altitude" : `at ${height(heightM)} above home`;
    this.#ask(`loiter at ${at.map((one) => one.toFixed(5)).join(", ")} ${level}`, "Loiter", ({ id }) => messages.loiterAt(id, at, heightM));
  }

  /** Whether a field has a number that it takes, or none where it needs none. What is no number reads as none: nothing is sent by it. */
  #isUsable(id) {
    if (by(id).reportValidity()) return true;
    this.#say(`nothing is sent: ${by(id).labels[0].firstChild.textContent.trim()}: ${by(id).validationMessage}`, "bad");
    return false;
  }

  async #sendDrawn() {
    const fault = this.#drawing.fault();
    if (fault) {
      this.#drawing.showFault();
      this.#unsent = fault;
      return this.#say(`the route is not sent: ${fault}`, "bad");
    }
    this.#map.stop();
    const route = by("route-name").value.trim() || "DRAWN";
    const text = messages.routeFile(route, this.#drawing.points);
    if (await this.#sendRoute(`route ${route}`, { file: "drawn.route.toml", text })) this.#drawing.sent();
    return undefined;
  }

  async #sendFile(file) {
    if (!file) return undefined;
    // Chosen again it is another choice.
    by("route-file").value = "";
    if (!this.#isUsable("route-altitude")) return undefined;
    // Before it is read: while a page reads a film it sends no heartbeat.
    if (file.size > MAX_ROUTE_BYTES) return this.#tooLarge(file, file.size);
    const route = { file: file.name };
    if (/\.kmz$/i.test(file.name)) {
      const all = new Uint8Array(await file.arrayBuffer());
      route.base64 = btoa(Array.from(all, (one) => String.fromCharCode(one)).join(""));
    } else {
      route.text = await file.text();
    }
    // For a file without altitudes alone; one that has them keeps them.
    const heightM = altitudeIn(by("route-altitude"));
    if (heightM !== null) route.height_m = heightM;
    const { size } = new Blob([JSON.stringify(route)]);
    return size > MAX_ROUTE_BYTES ? this.#tooLarge(file, size) : this.#sendRoute(`route of ${file.name}`, route);
  }

  #tooLarge({ name: file }, size) {
    this.#say(`the route is not sent: ${file} takes ${size} bytes, expected at most ${MAX_ROUTE_BYTES}`, "bad");
  }

  /** Whether it was sent. */
  async #sendRoute(label, route) {
    const vehicle = this.#chosen();
    if (!vehicle || !this.#socket) {
      this.#say("the route is not sent: connect and take control first", "bad");
      return false;
    }
    if (vehicle.armed !== false && !(await confirmed(`${name(vehicle)} may be flying: load the ${label} into it?`, "Load"))) return false;
    if (!(await this.#turn(label, vehicle))) return false;
    const one = this.#commands.add(label, vehicle, null);
    this.#underway = { one };
    this.#underway.ended = new Promise((end) => { this.#underway.end = end; });
    one.n = this.#socket.send({ route: { vehicle: vehicle.id, stamp: messages.stamp(), ...route } });
    return true;
  }

  /** A file may be dropped on the map. One that is dropped beside it must not take the page's place; fields take it themselves. */
  #takeDrops() {
    const keep = (event) => { if (!(event.target instanceof HTMLInputElement)) event.preventDefault(); };
    addEventListener("dragover", keep);
    addEventListener("drop", keep);
    by("map").addEventListener("drop", (event) => this.#sendFile(event.dataTransfer.files[0]));
  }

  #answer(yes) {
    const vehicle = this.#chosen();
    const asked = this.#asked.get(vehicle?.id);
    // What came since the text was drawn was not read yet.
    if (!asked || asked !== this.#read) return this.draw();
    this.#asked.delete(vehicle.id);
    if (yes) this.#given.set(vehicle.id, performance.now());
    const label = yes ? `hand over to ${asked.cucs}` : `refuse ${asked.cucs}`;
    this.#command(label, ({ id }) => messages.handOver(id, this.#vsm, asked.cucs, yes ? asked.levels : []), vehicle);
    return this.draw();
  }

  #taken(body) {
    if (body.error) return this.#failed(body.error);
    if (body.route) return this.#routed(body.route);
    const { id, source, fields } = body.message ?? {};
    const from = source === undefined ? null : idText(source);
    if (id === 17000) this.#commands.answered(fields);
    else if (id === 16000) this.#alerted(from, fields);
    else if (id === 4) {
      const asked = { cucs: idText(fields["Requesting CUCS ID"]), levels: fields["Requested/Handover LOI"] ?? [] };
      // One that is repeated is the one that was read.
      if (JSON.stringify(asked) !== JSON.stringify(this.#asked.get(from))) this.#asked.set(from, asked);
      this.draw();
    }
    return undefined;
  }

  #failed({ of, why }) {
    const one = this.#commands.inFrame(of);
    if (one && one === this.#underway?.one) this.#routeEnds();
    this.#commands.finish(one, `not used: ${why}`, "bad");
  }

  #routed({ of, load, lost }) {
    const one = this.#commands.inFrame(of);
    messages.stampedUntil(load);
    this.#routeEnds();
    if (!one) return;
    one.stamp = load;
    // Beside whatever becomes of it: an upload that is accepted is accepted without these.
    if (lost.length > 0) one.what += `, without ${lost.join(", ")}`;
    this.#commands.draw();
  }

  #alerted(from, fields) {
    remember(this.#alerts, `${from} ${Math.abs(fields["Alert (Warning) ID"] ?? 0)}`, { from, stamp: fields["Time Stamp"] });
    this.#commands.alerted(from, fields);
  }
}

/** What a silent vehicle has reported last is not known now: nothing is asked, advised or left out by it. The bridge judges alike. */
const asKnown = (vehicle) => (vehicle && !vehicle.live ? { ...vehicle, armed: null, on_ground: null, mode: null, flies_to: null } : vehicle);
