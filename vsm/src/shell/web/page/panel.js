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

function band({ lowest_m, highest_m, outside }) {
  // Of the configuration, which is not recorded.
  if (lowest_m === null) return ["altitude band", "not recorded"];
  return ["altitude band", `${height(lowest_m)} to ${height(highest_m)} above home${outside ? ": OUTSIDE" : ""}`, outside ? "bad" : ""];
}

/** Alerts that stand. One that stays keeps its row: a screen reader reads what is new, and a button is not lost under a finger. */
function drawAlerts(vehicle, control) {
  const list = by("alerts");
  const before = new Map([...list.children].map((row) => [row.dataset.key, row]));
  const made = vehicle.alerts.map((alert) => {
    const key = `${vehicle.id} ${alert.id} ${alert.priority} ${alert.text}`;
    const row = before.get(key) ?? node("li", `${alert.priority}: ${alert.text}`, alert.priority);
    row.dataset.key = key;
    const by_whom = (alert.acknowledged ?? []).map((one) => `${one.cucs} ${time(one.at_ms)}`).join(", ");
    if (row.dataset.by !== by_whom) {
      row.dataset.by = by_whom;
      row.querySelector("small")?.remove();
      if (by_whom) row.append(node("small", ` acknowledged by ${by_whom}`));
    }
    const offered = control?.canAcknowledge(vehicle.id, alert.id) && !by_whom;
    const button = row.querySelector("button");
    if (offered && !button) {
      const press = node("button", "Acknowledge");
      press.type = "button";
      press.addEventListener("click", () => control.acknowledge(vehicle.id, alert.id));
      row.append(" ", press);
    } else if (!offered) {
      button?.remove();
    }
    return row;
  });
  if (made.length === 0) {
    const none = before.get("none") ?? node("li", "none", "quiet");
    none.dataset.key = "none";
    made.push(none);
  }
  for (const row of [...list.children]) if (!made.includes(row)) row.remove();
  made.forEach((row, i) => { if (list.children[i] !== row) list.insertBefore(row, list.children[i] ?? null); });
}

export function drawVehicle(vehicle, recorded, control) {
  const { motion, position, link } = vehicle;
  const armed = { true: "armed", false: "disarmed", null: "unknown" }[vehicle.armed];
  const ground = { true: "on the ground", false: "in the air", null: "unknown" }[vehicle.on_ground];
  const controller = vehicle.controller ? `${vehicle.controller} controls it` : "nobody controls it";
  // Nothing was accepted of it since the bridge was started: nothing is the last that was received.
  const never = !vehicle.live && vehicle.mode === null && link.state === "waiting";
  // The line above the map is about this moment: of a silent vehicle only who controls it is known.
  const now = (vehicle.live
    ? [vehicle.mode ?? "mode unknown", armed, ground, `${height(motion.above_home_m).replace(" ", "\u00a0")} above home`, controller]
    : [never ? "no data received yet" : "no data: state unknown", controller]).join(" · ");
  if (by("now").textContent !== now) by("now").textContent = by("now").title = now;
  by("vehicle-title").textContent = `Vehicle ${vehicle.tail_number} (${vehicle.id})`;
  rows(by("vehicle"), [
    ["data", vehicle.live ? "live" : never ? "no data received yet" : "no data: state unknown; what follows is the last that was received", vehicle.live ? "good" : "bad"],
    ["mode", vehicle.mode ?? "unknown"],
    ["motors", armed],
    ["where", ground],
    battery(vehicle),
    ["altitude", `${height(position?.[2])} AMSL, ${height(motion.above_home_m)} above home`],
    ["ground speed", speed(motion.ground_speed_m_s)],
    ["air speed", speed(motion.air_speed_m_s)],
    ["climb", speed(motion.climb_m_s)],
    ["heading", heading(motion.heading_deg)],
    ["position", position ? place(position) : "unknown"],
    ["flies to", vehicle.flies_to === null ? "no waypoint" : `waypoint ${vehicle.flies_to}`],
    band(vehicle.altitude_band),
    ...vehicle.looks_at.map((one) => [`camera ${one.station} looks at`, `${place(one.centre)}, ${height(one.range_m)} away`]),
  ]);
  drawAlerts(vehicle, control);
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
  rows(by("link"), recorded ? [["recorded", "frames that the bridge believed; signatures are not recorded"]] : [
    ["signing", ...signing(link)],
    ["state", { silent: `silent: last frame ${age(link.accepted_s)}`, waiting: "waiting: no frame accepted yet" }[link.state] ?? link.state, link.state === "live" ? "good" : "bad"],
    ["peer", link.peer ?? "no data received yet"],
    ["round trip", link.round_trip_s === null ? "not measured" : `${(link.round_trip_s * 1e3).toFixed(1)} ms`],
    ["lost", link.lost === null ? "unknown" : `${(link.lost * 100).toFixed(1)} % of the vehicle's frames`],
    ["newest answered", link.unanswered_s === null ? "unknown" : age(link.unanswered_s)],
  ]);
}

/** Counts by Message Type, with the name of each. */
const byType = (all, names) =>
  counts(Object.fromEntries(Object.entries(all).map(([type, n]) => [`${type} ${names[type] ?? "unknown"}:`, n])));

export function drawBridge(status, vehicle) {
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
    [`frames of ${vehicle.tail_number || vehicle.id}`, counts(vehicle.link.frames)],
    ["up", `${Math.round(status.uptime_s)} s`],
  ]);
}

const MAX_SHOWN = 400;
const events = [];

/** `all`: these are all, from the first; what was shown before goes. */
export function addEvents(fresh, all) {
  if (all) events.length = 0;
  events.push(...fresh);
  if (events.length > MAX_SHOWN) events.splice(0, events.length - MAX_SHOWN);
  drawEvents();
}


export function drawEvents() {
  const refused = by("only-refused").checked;
  const shown = events.filter((one) => !refused || one.text.includes("refused")).reverse();
  items(by("events"), shown.map((one) => node("li", `${time(one.at_ms)} ${one.about}: ${one.text}`, one.level)));
}
