// The WebSocket of a ground station in the browser: opening, MACs and counters of docs/guide/websocket.md. It knows no message.

const VERSION = 1;
// The bridge waits 5 s for a hello.
const OPEN_WITHIN_MS = 10_000;
const bytes = (text) => new TextEncoder().encode(text);
const hex = (buffer) => [...new Uint8Array(buffer)].map((one) => one.toString(16).padStart(2, "0")).join("");
const unhex = (text) => Uint8Array.from(text.match(/../g) ?? [], (pair) => Number.parseInt(pair, 16));
const idBytes = (id) => unhex(id.replaceAll(":", ""));

const REASONS = {
  4001: "this ground station has connected from elsewhere",
  4003: "not authenticated: the key is not the one of this id, or the configuration does not list the id with web = true",
  4004: "what this page sent did not verify",
  4005: "what this page sent came in another order",
  4006: "this page sent too much in one frame",
  4007: "the bridge had no answer of this page for 15 s, or it read too slowly",
  4008: "this page sent more than it may",
  4009: "this page sent what the bridge cannot read: it may be of another version",
  4010: "the key was replaced or revoked",
  1001: "the bridge has ended",
  1006: "the connection broke",
};
// Neither end has wanted it so: a bridge that is stopped is often started again, and who was taken for gone (4007) is back.
const BREAKS = [1001, 1006, 4007];

const UNREACHED = "the bridge does not answer, or control is not switched on ([web] control)";

/** The key as text of 64 hex digits: kept where no script can read it again. Throws where it is none. */
export async function importKey(text) {
  const digits = text.trim();
  if (!/^[0-9a-f]{64}$/i.test(digits)) throw new Error("the key has 64 hexadecimal digits, as vsm guard keygen writes it");
  return crypto.subtle.importKey("raw", unhex(digits), "HKDF", false, ["deriveBits"]);
}

const hmacKey = (raw, use) => crypto.subtle.importKey("raw", raw, { name: "HMAC", hash: "SHA-256" }, false, [use]);

/** The key of one direction of one connection. */
async function sessionKey(key, direction, about, use) {
  const info = { name: "HKDF", hash: "SHA-256", salt: new Uint8Array(), info: bytes(direction) };
  const half = await hmacKey(await crypto.subtle.deriveBits(info, key, 256), "sign");
  return hmacKey(await crypto.subtle.sign("HMAC", half, about), use);
}

export class ControlSocket {
  #socket;
  #challenged = false;
  #closing = false;
  #sent = 0;
  #received = 0;
  #sign;
  #verify;
  #sending = Promise.resolve();
  #receiving = Promise.resolve();
  #take;
  #closed;

  /**
   * Resolves with the VSM's welcome once both ends are authenticated; rejects with the reason where they are not. `take(body)`
   * is given each later frame, `closed(reason, broken)` the end; broken, also of what it rejects with: neither end has refused the other.
   */
  static open(id, key, take, closed) {
    return new Promise((resolve, reject) => {
      const made = new ControlSocket();
      made.#take = take;
      made.#closed = (why, broken) => reject(Object.assign(new Error(why), { broken }));
      const url = new URL("control", location.href.replace(/^http/, "ws"));
      made.#socket = new WebSocket(url);
      made.#socket.onclose = ({ code, reason }) => {
        const closed = made.#challenged || code !== 1006 ? REASONS[code] ?? reason ?? "" : UNREACHED;
        // Who closes is not always answered before the connection is gone: 1006 then, too.
        made.#end(closed, BREAKS.includes(code) && !made.#closing);
      };
      const late = setTimeout(() => made.#fail("no answer of the bridge", true), OPEN_WITHIN_MS);
      // Frames are looked at one after another: a MAC takes its time, and the order counts.
      const opening = (handle) => (event) => {
        made.#receiving = made.#receiving.then(() => handle(event.data)).catch((fault) => made.#fail(fault.message));
      };
      made.#socket.onmessage = opening(async (text) => {
        made.#challenged = true;
        if (!made.#sign) return made.#hello(JSON.parse(text).challenge, id, key);
        const body = await made.#open(text);
        if (made.#received > 0) return made.#take(body);
        if (!body.welcome) throw new Error("the VSM has not sent its welcome");
        clearTimeout(late);
        made.#received = 1;
        made.#closed = closed;
        return resolve([made, body.welcome]);
      });
    });
  }

  async #hello(challenge, id, key) {
    if (challenge?.version !== VERSION) throw new Error(`the VSM speaks version ${challenge?.version}, expected ${VERSION}`);
    const random = crypto.getRandomValues(new Uint8Array(32));
    const parts = [bytes("vsm-web-1"), idBytes(challenge.vsm), idBytes(id), unhex(challenge.random), random];
    const about = new Uint8Array(await new Blob(parts).arrayBuffer());
    this.#verify = await sessionKey(key, "v2c", about, "verify");
    this.#sign = await sessionKey(key, "c2v", about, "sign");
    await this.#put({ n: 0, hello: { version: VERSION, cucs: id, random: hex(random) } });
    this.#sent = 1;
  }

  async #put(body) {
    const text = JSON.stringify(body);
    const mac = hex(await crypto.subtle.sign("HMAC", this.#sign, bytes(text)));
    if (this.#socket.readyState === WebSocket.OPEN) this.#socket.send(`${mac} ${text}`);
  }

  /** What a frame holds, where it verifies and is the next. */
  async #open(frame) {
    const text = frame.slice(65);
    const good = await crypto.subtle.verify("HMAC", this.#verify, unhex(frame.slice(0, 64)), bytes(text));
    if (!good) throw new Error("a frame of the VSM does not verify: this is not the VSM, or the key is another");
    const body = JSON.parse(text);
    if (body.n !== this.#received) throw new Error(`frame ${body.n} of the VSM, expected ${this.#received}`);
    if (this.#received > 0) this.#received += 1;
    return body;
  }

  /** Sends a frame after those before it, and returns its number. */
  send(body) {
    const n = this.#sent;
    this.#sent += 1;
    this.#sending = this.#sending.then(() => this.#put({ n, ...body })).catch((fault) => this.#fail(fault.message));
    return n;
  }

  close() {
    this.#closing = true;
    this.#socket.close();
  }

  #fail(reason, broken = false) {
    this.#end(reason, broken);
    this.#socket.close();
  }

  #end(reason, broken) {
    const closed = this.#closed;
    this.#closed = () => {};
    // Frames that wait for their turn are of an ended connection.
    this.#take = () => {};
    closed(reason, broken);
  }
}
