// What this station has sent, and what became of each command: by the answers of the vehicle (17000) and the reasons beside them (16000).

import { name, time } from "./units.js";

const MAX_SHOWN = 30;
const MAX_KEPT = 1000;
// Why a command is refused comes as an alert beside the answer.
const REASON_WITHIN_MS = 2000;
// The status is asked for twice a second.
const SHOWN_WITHIN_MS = 1000;

export class Commands {
  #list;
  #say;
  /** The newest first: {name, what, vehicle, state, kind, stamp, n, at}. */
  #all = [];
  /** Texts of alerts whose last part is not there yet. */
  #parts = new Map();
  #reasons = [];

  /** `say(text, kind)` shows what became of the newest where it is seen, whatever is scrolled. */
  constructor(list, say) {
    this.#list = list;
    this.#say = say;
  }

  add(what, vehicle, stamp) {
    const one = { name: name(vehicle), what, vehicle: vehicle.id, state: "sent", kind: "", stamp, at: performance.now(), since: Date.now() };
    this.#all.unshift(one);
    this.#all.length = Math.min(this.#all.length, MAX_SHOWN);
    this.sayNewest();
    this.draw();
    return one;
  }

  /** The command in the frame of this number. */
  inFrame(n) {
    return this.#all.find((known) => known.n === n);
  }

  /** The newest command has no answer yet, or the vehicle has had no time to show what became of it. What was refused it never shows. */
  get waiting() {
    const [newest] = this.#all;
    if (newest === undefined || newest.kind === "bad") return false;
    return newest.state === "sent" || performance.now() - newest.at < SHOWN_WITHIN_MS;
  }

  /** Shows once more what became of the newest; false where there is none. */
  sayNewest() {
    const [newest] = this.#all;
    if (newest) this.#say(...inShort(newest));
    return newest !== undefined;
  }

  /** The connection has ended. */
  end() {
    for (const one of this.#all) {
      // The next connection numbers its frames from the beginning.
      one.n = null;
      if (one.state === "sent") Object.assign(one, { state: "not answered: the connection has ended", kind: "bad" });
    }
    this.draw();
  }

  /** A 17000. */
  answered(fields) {
    const one = this.#all.find((known) => known.stamp === fields["Original Message Time Stamp"]);
    const kind = fields["Acknowledgement Type"];
    if (kind === "refused") this.finish(one, "REFUSED", "bad");
    else if (kind === "carried out") this.finish(one, "accepted", "good");
    else if (one?.state === "sent") this.finish(one, "received", "");
  }

  /** A 16000, which may be a reason. */
  alerted(from, fields) {
    const text = this.#whole(`${from} ${Math.abs(fields["Alert (Warning) ID"] ?? 0)}`, fields);
    // A reason stands beside its refusal, before or behind it, and comes from the vehicle that has refused. What the vehicle or the
    // VSM reports by itself may stand there too: a finding of the VSM comes in a vehicle's name.
    if (text === null || !isAnswer(fields)) return;
    const now = performance.now();
    this.#reasons = this.#reasons.filter(({ at }) => now - at < REASON_WITHIN_MS);
    this.#reasons.push({ at: now, from, text });
    const refused = this.#all.find((one) => one.vehicle === from && one.state.startsWith("REFUSED") && now - one.at < REASON_WITHIN_MS);
    if (refused) this.finish(refused, "REFUSED", "bad");
  }

  /** The text of an alert, once its last part is there; null before. */
  #whole(key, fields) {
    const [order, total, text] = [fields["Append Order"], fields["Append Total Number"] ?? 1, fields.Text ?? ""];
    if (total <= 1 || order === undefined) return text;
    const parts = this.#parts.get(key) ?? new Map();
    remember(this.#parts, key, parts.set(order, text));
    if (parts.size < total) return null;
    this.#parts.delete(key);
    return [...parts].sort(([a], [b]) => a - b).map(([, part]) => part).join("");
  }

  finish(one, state, kind) {
    if (!one) return;
    const now = performance.now();
    if (state === "REFUSED") {
      if (!one.state.startsWith("REFUSED")) one.at = now;
      const texts = this.#reasons
        .filter(({ at, from }) => from === one.vehicle && Math.abs(at - one.at) < REASON_WITHIN_MS)
        .map(({ text }) => text);
      one.reasons = [...new Set(texts)];
      one.state = ["REFUSED", ...one.reasons].join(": ");
    } else {
      one.state = state;
    }
    if (state !== "REFUSED") one.at = now;
    one.kind = kind;
    if (one === this.#all[0]) this.sayNewest();
    this.draw();
  }

  /** A row of its own for each, so that a screen reader reads what has changed. */
  draw() {
    this.#all.forEach((one, i) => {
      one.row ??= document.createElement("li");
      one.row.className = one.kind;
      set(one.row, `${time(one.since)} ${one.name}: ${one.what}: ${one.state}`);
      if (this.#list.children[i] !== one.row) this.#list.insertBefore(one.row, this.#list.children[i] ?? null);
    });
    while (this.#list.children.length > this.#all.length) this.#list.lastChild.remove();
  }
}

/**
 * For a line that is cut where it is long, and stands under another vehicle once that is chosen: the vehicle comes first there, then what
 * went wrong, and why; what was sent its reader knows. What a reason has before "refused: " names that only.
 */
function inShort({ name: vehicle, what, state, kind, reasons = [] }) {
  if (kind !== "bad") return [`${vehicle}: ${what}: ${state}`, kind];
  const why = reasons.map((text) => text.replace(/^.*? refused: /, ""));
  return [`${vehicle}: ${why.length > 0 ? ["REFUSED", ...why].join(": ") : state} (${what})`, kind];
}

/** An answer to a message of this station, by what mapping.md says of their alerts. */
const isAnswer = (fields) => fields.Priority === "caution" && fields["Subsystem ID"] === "VSM status";

/** Keeps an entry as the newest; the oldest make room, so that a page that is open for days stays small. */
export function remember(entries, key, value) {
  entries.delete(key);
  entries.set(key, value);
  if (entries.size > MAX_KEPT) entries.delete(entries.keys().next().value);
}

export function set(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
