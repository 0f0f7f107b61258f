// What an operator would do next, by what the bridge reports: a line beside the state, and the button for it marked. It suggests, and
// commands nothing; what may be done is decided by the bridge.

/** Vehicles that have flown a route since their last landing. */
const flew = new Set();

/** What is to be kept in mind between two looks: whether the vehicle has flown its route. */
function watch(vehicle) {
  if (vehicle.on_ground === true) flew.delete(vehicle.id);
  else if (vehicle.flies_to !== null) flew.add(vehicle.id);
}

/** `[id of a button or null, what to do]`. `drawn`: points that were not sent yet; `route`: the vehicle has one. */
export function nextStep({ connected, own, vehicle, drawing, drawn, route }) {
  if (!connected) return ["connect", "connect as a ground station"];
  watch(vehicle);
  if (vehicle.controller !== own)
    return ["take", vehicle.controller ? `take control: ${vehicle.controller} has it, and is asked, or overridden where "even from who has it" is ticked` : "take control"];
  if (drawing && drawn < 2) return [null, "click on the map where the route leads, at least twice"];
  if (drawn >= 2) return ["send-drawn", drawing ? "click on, or send the drawn route" : "send the drawn route"];
  if (vehicle.on_ground === true)
    return route ? ["launch", "launch: give an altitude above home first"] : ["draw", "draw a route, or drop a file of one on the map"];
  if (vehicle.on_ground !== false) return [null, "wait until the vehicle says whether it flies"];
  if (vehicle.flies_to !== null) return [null, `it flies to waypoint ${vehicle.flies_to}: watch it, hold it, or land it`];
  if (route && !flew.has(vehicle.id)) return ["fly", "fly the route"];
  return ["land", "land it, or fly on"];
}

/** What only who controls the vehicle does. */
const OF_CONTROL = ["launch", "fly", "hold", "land", "loiter", "loiter-middle", "send-drawn"];

export function showNext(state) {
  const [button, text] = nextStep(state);
  const line = document.getElementById("next");
  if (line.textContent !== `Next: ${text}`) line.textContent = `Next: ${text}`;
  for (const marked of document.querySelectorAll("button.next")) if (marked.id !== button) marked.classList.remove("next");
  if (button) document.getElementById(button).classList.add("next");
  const controls = state.connected && state.vehicle.controller === state.own;
  for (const id of OF_CONTROL) {
    const one = document.getElementById(id);
    one.classList.toggle("idle", !controls);
    one.title = controls ? "" : "take control first";
  }
}
