// Asks the bridge how everything stands, twice a second, and shows it.

import { VehiclesMap } from "./map.js";
import { addEvents, drawBridge, drawEvents, drawVehicle } from "./panel.js";
import { drawProfile } from "./profile.js";
import { chooseUnits, chosenUnits } from "./units.js";

const EVERY_MS = 500;
const MAP_EVERY_MS = 2000;
const WITHIN_MS = 3000;

const map = new VehiclesMap(document.getElementById("map"));
const choice = document.getElementById("choice");
const units = document.getElementById("units");
const connection = document.getElementById("connection");

let status = null;
let shapes = [];
let shapesText = "";
let shapesAt = 0;
let nextEvent = 0;

async function read(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(WITHIN_MS) });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer;
}

const chosen = () => status?.vehicles.find((one) => one.id === choice.value) ?? status?.vehicles[0];

function offerVehicles(vehicles) {
  const ids = vehicles.map((one) => one.id).join();
  if (choice.dataset.ids === ids) return;
  const before = choice.value;
  choice.dataset.ids = ids;
  choice.replaceChildren(...vehicles.map((one) => new Option(`${one.tail_number} (${one.id})`, one.id)));
  if (vehicles.some((one) => one.id === before)) choice.value = before;
}

function draw() {
  const vehicle = chosen();
  if (!vehicle) return;
  drawBridge(status);
  drawVehicle(vehicle);
  map.drawVehicles(status.vehicles, vehicle.id);
  const shape = shapes.find((one) => one.id === vehicle.id);
  drawProfile(document.getElementById("profile"), document.getElementById("profile-text"), shape?.route, vehicle);
}

function drawShapes() {
  map.drawShapes(shapes, chosen()?.id);
}

function connected(text, kind) {
  if (connection.textContent !== text) connection.textContent = text;
  connection.className = kind;
}

async function refresh() {
  try {
    status = await (await read("status.json")).json();
    offerVehicles(status.vehicles);
    if (Date.now() - shapesAt >= MAP_EVERY_MS) {
      shapesAt = Date.now();
      const text = await (await read("map.json")).text();
      // Drawn again only where it is something else: what an operator points at does not flicker.
      if (text !== shapesText) {
        shapesText = text;
        shapes = JSON.parse(text);
        drawShapes();
      }
    }
    const fresh = await (await read(`events.json?from=${nextEvent}`)).json();
    if (fresh.length > 0) {
      nextEvent = fresh.at(-1).number + 1;
      addEvents(fresh);
    }
    draw();
    document.body.classList.remove("lost");
    connected("connected", "good");
  } catch (error) {
    // What is shown is old then, and the whole page says so.
    document.body.classList.add("lost");
    connected(`no answer of the bridge: what is shown is old (${error.message})`, "bad");
    // A bridge that was restarted numbers its events from 0.
    nextEvent = 0;
  }
  setTimeout(refresh, EVERY_MS);
}

units.value = chosenUnits();
units.addEventListener("change", () => { chooseUnits(units.value); draw(); });
choice.addEventListener("change", () => { drawShapes(); draw(); });
document.getElementById("only-refused").addEventListener("change", drawEvents);
refresh();
