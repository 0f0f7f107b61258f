// What an operator would do next, by what the bridge reports: a line beside the state, and the button or field for it marked. It suggests, and
// commands nothing; what may be done is decided by the bridge.

/** What was seen of a vehicle since it was last on the ground, or of its last flight. */
const seen = new Map();

/** What is to be kept in mind between two looks: whether the vehicle has flown, and its route. */
function watch({ id, on_ground, flies_to }) {
  const known = seen.get(id) ?? { flew: false, route: false };
  seen.set(id, known);
  if (on_ground === false) known.flew = true;
  if (flies_to !== null) known.route = true;
  return known;
}

/** Another flight begins. */
export function begins(id) {
  seen.delete(id);
}

/** `[id of a button or a field, or null; what to do]`. `drawn`: points that were not sent yet, `fault`: why they cannot be; `route`: the vehicle has one; `waiting`: a command has just been sent, and the vehicle
 * does not show it yet. */
export function nextStep({ connected, own, vehicle, drawing, drawn, fault, route, altitude, waiting }) {
  if (!connected) return ["connect", "connect as a ground station"];
  if (!vehicle.live) return [null, "no data of the vehicle: wait"];
  const { flew, route: flown } = watch(vehicle);
  const { controller, on_ground, flies_to, mode, armed } = vehicle;
  if (waiting) return [null, "wait until the vehicle shows what was sent"];
  if (controller !== own && vehicle.handovers.some(({ to }) => to === own)) return [null, `wait: ${controller} is asked whether it hands over`];
  if (controller !== own) return controller ? ["ask", `${controller} controls it: ask for control, or take it by "even if another controls it"`] : ["take", "take control"];
  if (drawing && drawn < 2) return [null, "click on the map where the route leads, at least twice"];
  if (drawn >= 2) return fault ? ["route-altitude", fault] : ["send-drawn", drawing ? "click further points, or send the route" : "send the drawn route"];
  if (on_ground === true && flew && armed !== false) return [null, "it is down: wait until its motors stop"];
  if (on_ground === true && flew) return ["release", "landed: release it, or launch again"];
  if (on_ground === true && !route) return ["draw", "draw a route, drop a file of one on the map, or launch without"];
  if (on_ground === true) return altitude === null ? ["launch-altitude", "give an altitude above home to launch to"] : ["launch", "launch it"];
  if (on_ground !== false) return [null, "wait until the vehicle says whether it flies"];
  if (mode === "AUTO.TAKEOFF") return [null, "it climbs: wait"];
  if (mode === "AUTO.LAND" || mode === "AUTO.PRECLAND") return [null, "it lands: wait"];
  if (flies_to !== null) return [null, `it flies to waypoint ${flies_to}: watch it, hold it, or land it`];
  if (!route) return ["land", "no route is loaded: land it, draw a route, or loiter at a click"];
  return flown ? ["land", "the route is flown: land it, or fly it again"] : ["fly", "fly the route"];
}

/** What makes no sense now is dashed, with the reason; it may be pressed all the same, and the bridge decides. */
const USEFUL = [
  ["take", ({ vehicle, own }) => vehicle.controller !== own, "this station controls it"],
  ["ask", ({ vehicle, own }) => vehicle.controller !== null && vehicle.controller !== own, "no other station controls it"],
  ["release", ({ vehicle, own }) => vehicle.holders.some(({ id }) => id === own), "this station holds no level"],
  ["draw-clear", ({ points }) => points > 0, "nothing is drawn"],
  ["launch", ({ vehicle }) => vehicle.on_ground !== false, "it flies", true],
  ["fly", ({ vehicle, route }) => vehicle.on_ground !== true && route, "launch it, and send a route first", true],
  ["hold", ({ vehicle }) => vehicle.on_ground !== true, "it stands on the ground", true],
  ["land", ({ vehicle }) => vehicle.on_ground !== true, "it stands on the ground", true],
  ["loiter", ({ vehicle }) => vehicle.on_ground !== true, "it stands on the ground", true],
  ["loiter-middle", ({ vehicle }) => vehicle.on_ground !== true, "it stands on the ground", true],
  ["send-drawn", ({ points }) => points > 1, "draw two points first", true],
];

/** The id of what is marked. */
let aim = null;

/** The line leads to what it names, which may be out of sight; it presses nothing. */
export function leadToNext() {
  const target = aim && document.getElementById(aim);
  target?.scrollIntoView({ block: "center" });
  target?.focus({ preventScroll: true });
}

export function showNext(state) {
  const [target, text] = nextStep(state);
  const line = document.getElementById("next");
  aim = target;
  line.hidden = false;
  // What leads nowhere does not look as if it did.
  line.classList.toggle("leads", target !== null);
  if (line.textContent !== `Next: ${text}`) line.textContent = line.title = `Next: ${text}`;
  for (const marked of document.querySelectorAll(".next")) if (marked.id !== target) marked.classList.remove("next");
  if (target) document.getElementById(target).classList.add("next");
  const controls = state.connected && state.vehicle.controller === state.own;
  for (const [id, useful, why, ofControl] of USEFUL) {
    const one = document.getElementById(id);
    const reason = ofControl && !controls ? "take control first" : useful(state) ? "" : why;
    one.classList.toggle("idle", reason !== "");
    if (one.title !== reason) one.title = reason;
  }
}
