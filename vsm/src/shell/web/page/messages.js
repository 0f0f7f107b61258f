// Messages of the DLI as a ground station sends them, by the names of docs/reference/dli, and a drawn route as a file.

const EPOCH_MS = Date.UTC(2000, 0, 1);
/** An id among the fields of a message is a signed number of 32 bits. */
const number = (id) => Number.parseInt(id.replaceAll(":", ""), 16) | 0;
const NO_LINK = number("ff:00:00:00");

let last = 0;

/** A Time Stamp: ms since 2000, each later than the one before. */
export function stamp() {
  last = Math.max(last + 1, Date.now() - EPOCH_MS);
  return last;
}

/** Stamps up to this one are used. */
export function stampedUntil(used) {
  last = Math.max(last, used);
}

const message = (id, destination, fields, ack = true) => ({ id, destination, ack, fields: { "Time Stamp": stamp(), ...fields } });

export const heartbeat = (vsm) => message(16002, vsm, {}, false);

const levels = (numbers) => numbers.map((one) => `LOI ${one}`);

const authorisation = (vehicle, vsm, numbers, access) => message(1, vehicle, {
  "VSM ID": number(vsm),
  "Data Link ID": NO_LINK,
  "Requested/Handover LOI": levels(numbers),
  "Requested/Handover Access": access,
});

export const request = (vehicle, vsm, numbers) => authorisation(vehicle, vsm, numbers, "request control");
export const override = (vehicle, vsm, numbers) => authorisation(vehicle, vsm, numbers, "override control");
export const relinquish = (vehicle, vsm) => authorisation(vehicle, vsm, [], "relinquish / hand off control");

/** Message 4: consent to the request of another ground station, or with no level its refusal. */
export const handOver = (vehicle, vsm, to, named) => message(4, vehicle, {
  "VSM ID": number(vsm),
  "Data Link ID": NO_LINK,
  "Requested/Handover LOI": named,
  "Requesting CUCS ID": number(to),
});

/** Message 4 that names its sender: a request that the holder consents to or refuses. */
export const ask = (vehicle, vsm, own, numbers) => handOver(vehicle, vsm, own, levels(numbers));

/** 2016. A height is metres above home; without one the altitude is not commanded. */
function mode(vehicle, name, heightM, more = {}) {
  const fields = { "Select Flight Path Control Mode": name, ...more };
  if (heightM !== null) Object.assign(fields, { "Altitude Command Type": "altitude", "Commanded Altitude": heightM, "Altitude Type": "AGL" });
  return message(2016, vehicle, fields);
}

const radians = (degrees) => (degrees * Math.PI) / 180;

export const launch = (vehicle, heightM) => mode(vehicle, "launch", heightM);
export const flyRoute = (vehicle, from) => mode(vehicle, "waypoint", null, from === null ? {} : { "Commanded Waypoint Number": from });
export const land = (vehicle) => mode(vehicle, "autoland engage", null);
export const hold = (vehicle) => mode(vehicle, "loiter", null);
export const loiterAt = (vehicle, [north, east], heightM) => mode(vehicle, "loiter", heightM, {
  "Loiter Position Latitude": radians(north),
  "Loiter Position Longitude": radians(east),
});

/** 17000 for a 16000: a person has read it. */
export const acknowledge = (to, alertStamp) => message(17000, to, {
  "Original Message Time Stamp": alertStamp,
  "Original Message Type": 16000,
  "Acknowledgement Type": "received (T)",
}, false);

/** A route file of drawn points: degrees, metres above home, m/s where one was given. */
export function routeFile(name, points) {
  const lines = [`mission_id = ${JSON.stringify(name)}`, 'id = "drawn"', 'type = "flight"', "", "[defaults]", 'altitude_type = "agl"'];
  points.forEach(({ at, heightM, speedMs }, i) => {
    lines.push("", "[[waypoint]]", `number = ${i + 1}`, `latitude = ${at[0].toFixed(8)}`, `longitude = ${at[1].toFixed(8)}`, `altitude = ${heightM.toFixed(2)}`);
    if (speedMs !== null) lines.push(`speed = ${speedMs.toFixed(2)}`);
  });
  return `${lines.join("\n")}\n`;
}
