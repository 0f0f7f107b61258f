// Quantities as a person reads them. What is not known reads "unknown", never as a number.

const FEET = 1 / 0.3048;
const KNOTS = 3600 / 1852;

let units = localStorage.getItem("units") === "aviation" ? "aviation" : "metric";

export const chosenUnits = () => units;

export function chooseUnits(choice) {
  units = choice;
  localStorage.setItem("units", choice);
}

const known = (value) => value !== null && value !== undefined;
// What is rounded to nothing has no sign: not "-0.0".
const rounded = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]*$)/, "");
const shown = (value, factor, digits, unit) =>
  known(value) ? `${rounded(value * factor, digits)} ${unit}` : "unknown";

export const height = (m) => (units === "aviation" ? shown(m, FEET, 0, "ft") : shown(m, 1, 1, "m"));
export const speed = (m_s) => (units === "aviation" ? shown(m_s, KNOTS, 1, "kt") : shown(m_s, 1, 1, "m/s"));
export const heading = (deg) => (known(deg) ? `${String(Math.round(deg) % 360).padStart(3, "0")}°` : "unknown");
export const percent = (value) => shown(value, 1, 0, "%");
export const place = ([north, east]) =>
  `${Math.abs(north).toFixed(5)}° ${north < 0 ? "S" : "N"}, ${Math.abs(east).toFixed(5)}° ${east < 0 ? "W" : "E"}`;
export const age = (s) => (known(s) ? `${s < 10 ? s.toFixed(1) : Math.round(s)} s ago` : "never");

/** Of a distance on the ground. */
export function distance(m) {
  if (units === "aviation") return m < 1852 ? shown(m, FEET, 0, "ft") : shown(m, 1 / 1852, 1, "NM");
  return m < 1000 ? shown(m, 1, 0, "m") : shown(m, 1e-3, 1, "km");
}

/** A time of day of the bridge's clock, in UTC. */
export const time = (ms) => (known(ms) ? `${new Date(ms).toISOString().slice(11, 19)} UTC` : "unknown");

const ALL_STATIONS = 32;

/** Levels of interoperability by name, with the payload stations that they are for. */
export function levels({ levels: named, stations }) {
  if (stations.length === 0) return named;
  return `${named}; ${stations.length === ALL_STATIONS ? "all payload stations" : `payload station ${stations.join(", ")}`}`;
}

/** The unit in which altitudes are typed. */
export const altitudeUnit = () => (units === "aviation" ? "ft" : "m");

/** What is typed in a field, in metres; null where nothing is, or no number: never a number of its own. */
export function altitudeIn(field) {
  const text = field.value.trim();
  const value = Number(text);
  if (text === "" || !Number.isFinite(value)) return null;
  return units === "aviation" ? value / FEET : value;
}

/** Metres as they are typed. */
export const inAltitude = (m) => String(Number((units === "aviation" ? m * FEET : m).toFixed(1)));

/** What a vehicle is called. */
export const name = (vehicle) => vehicle.tail_number || vehicle.id;
