// The state beside the map. Everything is set as text: nothing that a vehicle or a station sends is ever markup.

import { age, heading, height, levels, percent, place, speed, time } from "./units.js";

const VERIFIED_WITHIN_S = 3.5;

const node = (tag, text, kind) => {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
};

/** Rows of a list of names and values; only what has changed is set, so that a screen reader does not read all again. */
function rows(list, entries) {
  const wanted = entries.map(([name, value, kind]) => [name, String(value), kind ?? ""]);
  const same = wanted.length * 2 === list.children.length
    && wanted.every(([name], i) => list.children[2 * i].textContent === name);
  if (!same) list.replaceChildren(...wanted.flatMap(([name]) => [node("dt", name), node("dd", "")]));
  wanted.forEach(([, value, kind], i) => {
    const shown = list.children[2 * i + 1];
    if (shown.textContent !== value) shown.textContent = value;
    if (shown.className !== kind) shown.className = kind;
  });
}

/** Replaces what a list shows where it is something else. */
function items(list, made) {
  const text = (all) => [...all].map((one) => `${one.className} ${one.textContent}`).join("\n");
  if (text(list.children) !== text(made)) list.replaceChildren(...made);
}

const by = (id) => document.getElementById(id);
const counts = (all) =>
  Object.entries(all).filter(([, n]) => n > 0).map(([name, n]) => `${name} ${n}`).join(", ") || "none";

/** What was verified, never what is configured. */
function signing(link) {
  if (!link.signed) return ["not signed: anybody on this link can command the vehicle", "bad"];
  if (link.verified_s !== null && link.verified_s <= VERIFIED_WITHIN_S)
    return [`verified ${age(link.verified_s)}, key ${link.verified_key_id}`, "good"];
  const last = link.verified_s === null ? "no frame has verified" : `last verified ${age(link.verified_s)}`;
  return [`NOT VERIFIED: ${last}; what arrives: ${link.arrives ?? "nothing"}`, "bad"];
}

function battery(vehicle) {
  const level = vehicle.battery_percent;
  return ["battery", percent(level), level !== null && level <= 20 ? "bad" : ""];
}

export function drawVehicle(vehicle) {
  const { motion, position, link } = vehicle;
  const armed = { true: "armed", false: "disarmed", null: "unknown" }[vehicle.armed];
  const ground = { true: "on the ground", false: "in the air", null: "unknown" }[vehicle.on_ground];
  by("vehicle-title").textContent = `Vehicle ${vehicle.tail_number} (${vehicle.id})`;
  rows(by("vehicle"), [
    ["data", vehicle.live ? "live" : "no data: state unknown; what follows is the last that was received", vehicle.live ? "good" : "bad"],
    ["mode", vehicle.mode ?? "unknown"],
    ["motors", armed],
    ["on", ground],
    battery(vehicle),
    ["altitude", `${height(position?.[2])} AMSL, ${height(motion.above_home_m)} above home`],
    ["ground speed", speed(motion.ground_speed_m_s)],
    ["air speed", speed(motion.air_speed_m_s)],
    ["climb", speed(motion.climb_m_s)],
    ["heading", heading(motion.heading_deg)],
    ["position", position ? place(position) : "unknown"],
    ["flies to", vehicle.flies_to === null ? "no waypoint" : `waypoint ${vehicle.flies_to}`],
    ["altitude band", `${height(vehicle.altitude_band.lowest_m)} to ${height(vehicle.altitude_band.highest_m)} above home${vehicle.altitude_band.outside ? ": OUTSIDE" : ""}`, vehicle.altitude_band.outside ? "bad" : ""],
    ...vehicle.looks_at.map((one) => [`camera ${one.station} looks at`, `${place(one.centre)}, ${height(one.range_m)} away`]),
  ]);
  items(by("alerts"), vehicle.alerts.length > 0
    ? vehicle.alerts.map((alert) => node("li", `${alert.priority}: ${alert.text}`, alert.priority))
    : [node("li", "none stands", "quiet")]);
  const holders = vehicle.holders.map((holder) => {
    const row = node("tr", "", holder.id === vehicle.controller ? "controls" : "");
    const name = holder.id === vehicle.controller ? `${holder.id} (controls)` : holder.id;
    row.append(node("th", name), node("td", levels(holder)), node("td", time(holder.since_ms)));
    return row;
  });
  const nobody = node("tr", "");
  const cell = node("td", "nobody holds a level");
  cell.colSpan = 3;
  nobody.append(cell);
  items(by("holders"), holders.length > 0 ? holders : [nobody]);
  items(by("handovers"), vehicle.handovers.map((one) =>
    node("li", `${one.rights}: ${one.from ?? "free"} → ${one.to}, waits for ${one.waits_for}`)));
  rows(by("link"), [
    ["signing", ...signing(link)],
    ["state", link.state, link.state === "live" ? "good" : "bad"],
    ["peer", link.peer ?? "no data received yet"],
    ["round trip", link.round_trip_s === null ? "not measured" : `${(link.round_trip_s * 1e3).toFixed(1)} ms`],
    ["lost", link.lost === null ? "unknown" : `${(link.lost * 100).toFixed(1)} % of the vehicle's frames`],
    ["newest answered", link.unanswered_s === null ? "unknown" : age(link.unanswered_s)],
  ]);
}

/** Counts by Message Type, with the name of each. */
const byType = (all, names) =>
  counts(Object.fromEntries(Object.entries(all).map(([type, n]) => [`${type} ${names[type] ?? "unknown"}:`, n])));

export function drawBridge(status) {
  by("vsm").textContent = status.vsm;
  items(by("warnings"), [
    ...status.warnings.map((text) => node("p", text, "bad")),
    ...status.findings.map((one) => node("p", `${one.cause}; ${one.cure}`, "bad")),
  ]);
  rows(by("stations"), status.stations.map((one) => [
    one.id,
    one.address === null
      ? "no data received yet"
      : `${one.address}${one.proof === "none" ? " (not proven)" : ""}${one.guard ? ", guarded" : ""}, last message ${age(one.silent_s)}`,
  ]));
  rows(by("counters"), [
    ["received by type", byType(status.received, status.message_names)],
    ["sent by type", byType(status.sent, status.message_names)],
    ["refused", counts(status.refused)],
    ...status.vehicles.map((one) => [`frames of ${one.tail_number || one.id}`, counts(one.link.frames)]),
    ["up", `${Math.round(status.uptime_s)} s`],
  ]);
}

const MAX_SHOWN = 400;
const events = [];

export function addEvents(fresh) {
  events.push(...fresh);
  if (events.length > MAX_SHOWN) events.splice(0, events.length - MAX_SHOWN);
  drawEvents();
}

export function drawEvents() {
  const refused = by("only-refused").checked;
  const shown = events.filter((one) => !refused || one.text.includes("refused")).reverse();
  items(by("events"), shown.map((one) => node("li", `${time(one.at_ms)} ${one.about}: ${one.text}`, one.level)));
}
