// Asks the bridge how everything stands, twice a second, and shows it; of a recording, how it stood at the moment of its time line.

import { Control } from "./control.js";
import { VehicleList } from "./list.js";
import { MANY, VehiclesMap } from "./map.js";
import { addEvents, drawBridge, drawEvents, drawVehicle } from "./panel.js";
import { drawProfile } from "./profile.js";
import { TimeLine } from "./replay.js";
import { altitudeIn, chooseUnits, chosenUnits, inAltitude } from "./units.js";

const EVERY_MS = 500;
const MAP_EVERY_MS = 2000;
// A recording is played smoothly.
const REPLAY_EVERY_MS = 200;
const WITHIN_MS = 3000;
// Of a recording of hours they are long.
const TRACKS_WITHIN_MS = 30_000;

const map = new VehiclesMap(document.getElementById("map"));
const list = new VehicleList(choose);
const units = document.getElementById("units");
const connection = document.getElementById("connection");

let status = null;
let shapes = [];
let shapesText = "";
let shapesAt = 0;
let nextEvent = 0;
let timeLine = null;
let control = null;
let link = takeLink();
let timer = 0;
let running = false;
let begun = false;

async function read(path, withinMs = WITHIN_MS) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(withinMs) }).catch((fault) => {
    throw isLate(fault) ? fault : new Error("it cannot be reached");
  });
  if (!answer.ok) throw new Error(`it answers ${path} with ${answer.status}`);
  return answer;
}

/** Also while an answer is read. */
const isLate = ({ name }) => name === "TimeoutError";

/** The vehicle that is shown; none until all of it is here. */
const chosen = () => (list.chosen?.motion ? list.chosen : undefined);

/** Another one is chosen: of very many, what its list does not show is read at once. */
function choose() {
  drawShapes();
  draw();
  if (!chosen() && !running) refresh();
}

function draw() {
  const vehicle = chosen();
  if (!vehicle) return;
  drawBridge(status, vehicle);
  drawVehicle(vehicle, timeLine !== null, control);
  const shape = shapes.find((one) => one.id === vehicle.id);
  control?.draw(shape?.route ?? null);
  map.drawVehicles(status.vehicles, vehicle.id, timeLine?.at);
  drawProfile(document.getElementById("profile"), document.getElementById("profile-text"), shape?.route, vehicle, shape?.home);
}

function drawShapes() {
  map.drawShapes(shapes, list.chosen?.id);
}

function connected(text, kind) {
  if (connection.textContent !== text) connection.textContent = text;
  connection.className = kind;
}

/** The link of a demo brings id and key behind its #: they go from the address at once, whether or not they are of use here. */
function takeLink() {
  const [, id, key] = location.hash.match(/^#((?:[0-9a-f]{2}:){3}[0-9a-f]{2})=([0-9a-f]{64})$/i) ?? [];
  if (!key) return null;
  history.replaceState(null, "", location.pathname);
  return { id, key };
}

/** Once it is known whether it is of use. */
function useLink() {
  if (!begun) return;
  if (link) control?.fillIn(link);
  link = null;
}

/** What differs between a running bridge and a recording. All is read before anything is made: where reading fails it is begun again. */
async function begin() {
  const { replay, control: controllable, tiles } = await (await read("page.json")).json();
  const tracks = replay ? await (await read("tracks.json", TRACKS_WITHIN_MS)).json() : [];
  if (tiles) map.showTiles(tiles);
  if (controllable) control = new Control(map, chosen, () => status?.vehicles ?? []);
  if (replay) timeLine = new TimeLine(replay, sought);
  map.setTracks(tracks);
}

/** Another moment is chosen: it is shown at once. */
function sought(elsewhere) {
  if (elsewhere) shapesAt = 0;
  if (!running) refresh();
}

/** `many`: all of the one vehicle that is shown, and rows for the list of the others. How many there are is not known at first. */
async function readStatus(many) {
  const of = [timeLine && `at=${timeLine.at}`, many && `details=${list.chosen?.id ?? ""}`].filter(Boolean).join("&");
  const found = await (await read(`status.json${of && `?${of}`}`)).json();
  return many && found.vehicles.length <= MANY ? readStatus(false) : found;
}

async function show() {
  if (!begun) {
    await begin();
    begun = true;
    useLink();
  }
  timeLine?.tick();
  const of = timeLine ? `?at=${timeLine.at}` : "";
  const uptime = status?.uptime_s;
  status = await readStatus(!status || status.vehicles.length > MANY);
  // A bridge that was restarted numbers its events from 0; of a recording it is an earlier moment, at which those that are shown were not yet.
  if (status.uptime_s < uptime) nextEvent = 0;
  list.draw(status.vehicles, timeLine !== null);
  if (Date.now() - shapesAt >= MAP_EVERY_MS) {
    shapesAt = Date.now();
    const text = await (await read(`map.json${of}`)).text();
    // Drawn again only where it is something else: what an operator points at does not flicker.
    if (text !== shapesText) {
      shapesText = text;
      shapes = JSON.parse(text);
      drawShapes();
    }
  }
  const from = nextEvent;
  const fresh = await (await read(`events.json?from=${from}${of.replace("?", "&")}`)).json();
  if (from === 0 || fresh.length > 0) addEvents(fresh, from === 0);
  if (fresh.length > 0) nextEvent = fresh.at(-1).number + 1;
  draw();
}

async function refresh() {
  clearTimeout(timer);
  running = true;
  let failed = false;
  const moment = timeLine?.at;
  try {
    await show();
    document.body.classList.remove("lost");
    connected(timeLine ? "a recording: nothing here is live" : "bridge answers", timeLine ? "quiet" : "good");
  } catch (error) {
    failed = true;
    // What is shown is old then, and the whole page says so.
    document.body.classList.add("lost");
    connected(`no answer of the bridge: what is shown is old (${isLate(error) ? "it takes too long" : error.message})`, "bad");
    // Another bridge may answer next.
    nextEvent = 0;
  }
  running = false;
  // Sought while it was read: what was shown is another moment.
  const late = timeLine && moment !== undefined && timeLine.at < moment;
  const unread = !failed && list.chosen && !chosen();
  timer = setTimeout(refresh, late || unread ? 0 : timeLine ? REPLAY_EVERY_MS : EVERY_MS);
}

// A link that is opened where the page is open already loads nothing.
addEventListener("hashchange", () => {
  link = takeLink() ?? link;
  useLink();
});
units.value = chosenUnits();
units.addEventListener("change", () => {
  // What is typed stays the same altitude.
  const typed = [...document.querySelectorAll("input.altitude")].map((field) => [field, altitudeIn(field)]);
  chooseUnits(units.value);
  for (const [field, m] of typed) field.value = m === null ? "" : inAltitude(m);
  draw();
});
document.getElementById("only-refused").addEventListener("change", drawEvents);
refresh();
