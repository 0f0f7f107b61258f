// The altitude along the route and the speeds commanded on it, and where the vehicle is and how fast it flies beside them.

import { distance, height, speed } from "./units.js";

// The name of a language, not an address: nothing is loaded from there.
const SVG = "http://www.w3.org/2000/svg";
const EARTH_M = 6_371_008.8;
const MARGIN = { left: 56, right: 56, top: 12, bottom: 22 };

const radians = (deg) => (deg * Math.PI) / 180;

/** Metres between two places: flat, as a route is short. */
export function metres([north, east], [toNorth, toEast]) {
  const y = radians(toNorth - north);
  const x = radians(toEast - east) * Math.cos(radians((north + toNorth) / 2));
  return EARTH_M * Math.hypot(x, y);
}

function svg(name, attributes, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

/** The point of the route nearest to a place, as a distance along it. */
function nearest(points, at) {
  let best = null;
  for (let i = 1; i < points.length; i += 1) {
    const [a, b] = [points[i - 1], points[i]];
    const length = b.along - a.along;
    const scale = Math.cos(radians(a.at[0]));
    const d = [b.at[0] - a.at[0], (b.at[1] - a.at[1]) * scale];
    const p = [at[0] - a.at[0], (at[1] - a.at[1]) * scale];
    const square = d[0] ** 2 + d[1] ** 2;
    const part = square > 0 ? Math.min(1, Math.max(0, (d[0] * p[0] + d[1] * p[1]) / square)) : 0;
    const off = metres(at, [a.at[0] + part * d[0], a.at[1] + (part * d[1]) / scale]);
    if (best === null || off < best.off) best = { off, along: a.along + part * length };
  }
  return best;
}

/** How far along the route each waypoint with a speed is: in their order, as a route may pass a place twice. */
function speedsAlong(points, waypoints) {
  const legs = [];
  let from = 0;
  let before = 0;
  for (const { at, speed_m_s } of waypoints) {
    const off = points.map((point, i) => (i < from ? Infinity : metres(point.at, at)));
    const here = off.findIndex((m) => m < 1);
    from = here >= 0 ? here : off.indexOf(Math.min(...off));
    const { along } = points[from];
    if (speed_m_s !== null) legs.push({ from: before, to: along, speed_m_s });
    before = along;
  }
  return legs;
}

/** Steps of the commanded speed, and the vehicle's beside them, by a scale of their own at the right. */
function drawSpeeds(legs, flown, { width, height: tall }, x, parts) {
  const all = legs.map((leg) => leg.speed_m_s);
  if (flown) all.push(flown.speed_m_s);
  if (legs.length === 0) return;
  const high = Math.max(...all, 1) * 1.15;
  const y = (m_s) => tall - MARGIN.bottom - (m_s / high) * (tall - MARGIN.top - MARGIN.bottom);
  for (const leg of legs) parts.push(svg("line", { class: "speed", x1: x(leg.from), x2: x(leg.to), y1: y(leg.speed_m_s), y2: y(leg.speed_m_s) }));
  for (const m_s of new Set([Math.min(...legs.map((leg) => leg.speed_m_s)), Math.max(...legs.map((leg) => leg.speed_m_s))]))
    parts.push(svg("text", { class: "speed-text", x: width - MARGIN.right + 6, y: y(m_s) + 4 }, speed(m_s)));
  if (flown) parts.push(svg("rect", { class: "flown-speed", x: x(flown.along) - 4, y: y(flown.speed_m_s) - 4, width: 8, height: 8 }));
}

/** `home`: of the vehicle, where it is known; altitudes are shown above it then, as they are typed. */
export function drawProfile(node, caption, route, vehicle, home) {
  const points = [];
  for (const { at, amsl_m } of route?.path ?? []) {
    const before = points.at(-1);
    const along = before ? before.along + metres(before.at, at) : 0;
    points.push({ at, along, amsl_m });
  }
  const drawn = points.filter((point) => point.amsl_m !== null);
  if (drawn.length < 2) {
    node.replaceChildren();
    caption.textContent = route ? "the altitudes of the route are above a home that is not known yet" : "no route";
    return;
  }
  const altitudes = drawn.map((point) => point.amsl_m);
  if (vehicle.position) altitudes.push(vehicle.position[2]);
  const from = home?.[2] ?? 0;
  // In the pixels of the screen: its texts are as large on a phone.
  const size = { width: node.clientWidth || 600, height: node.clientHeight || 130 };
  const low = Math.min(...altitudes) - 5;
  const high = Math.max(...altitudes) + 5;
  const length = Math.max(points.at(-1).along, 1);
  const x = (m) => MARGIN.left + (m / length) * (size.width - MARGIN.left - MARGIN.right);
  const y = (m) => size.height - MARGIN.bottom - ((m - low) / (high - low)) * (size.height - MARGIN.top - MARGIN.bottom);
  const parts = [];
  // Where it is flat one line is enough: two texts would stand on each other.
  for (const m of y(low + 5) - y(high - 5) > 16 ? [low + 5, high - 5] : [low + 5]) {
    parts.push(svg("line", { x1: MARGIN.left, x2: size.width - MARGIN.right, y1: y(m), y2: y(m), class: "grid" }));
    parts.push(svg("text", { x: MARGIN.left - 6, y: y(m) + 4, "text-anchor": "end" }, height(m - from)));
  }
  parts.push(svg("text", { x: size.width - MARGIN.right, y: size.height - 6, "text-anchor": "end" }, distance(length)));
  parts.push(svg("polyline", { class: "route", points: drawn.map((p) => `${x(p.along)},${y(p.amsl_m)}`).join(" ") }));
  const at = vehicle.live && vehicle.position ? nearest(points, vehicle.position) : null;
  const flown = at && vehicle.motion.ground_speed_m_s !== null ? { along: at.along, speed_m_s: vehicle.motion.ground_speed_m_s } : null;
  const legs = speedsAlong(points, route.waypoints);
  drawSpeeds(legs, flown, size, x, parts);
  if (at) parts.push(svg("circle", { class: "vehicle", cx: x(at.along), cy: y(vehicle.position[2]), r: 5 }));
  node.setAttribute("viewBox", `0 0 ${size.width} ${size.height}`);
  node.replaceChildren(...parts);
  const beside = at ? `; the vehicle is ${distance(at.off)} beside it` : "";
  const speeds = legs.length > 0 ? "; dashed: the commanded speed, with the vehicle's as a square" : "";
  caption.textContent = `altitude above ${home ? "home" : "mean sea level"} along the route, ${distance(length)}${beside}${speeds}`;
}
