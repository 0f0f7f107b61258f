// The list of vehicles to choose from: with many, by name and by state, and never longer than a list is of use.

const FILTERED_FROM = 12;
// Nobody reads a list of a thousand, and a page must stay quick while vehicles of it change their state.
const MAX_OFFERED = 200;

/** What is known of a vehicle now: one may be in several groups. Of a vehicle without data it is not known whether it flies. */
const GROUPS = [
  ["all", "all", () => true],
  ["linked", "linked", ({ live }) => live],
  ["lost", "no data", ({ live }) => !live],
  ["flying", "in the air", ({ live, on_ground }) => live && on_ground === false],
  // What arrives counts, never the setting.
  ["unsigned", "not signed", ({ link }) => !link.signed || (link.arrives !== null && link.arrives !== "verified")],
];

const by = (id) => document.getElementById(id);

export class VehicleList {
  #choice = by("choice");
  #name = by("filter");
  #state = by("group");
  #options = new Map();
  #offered = "";
  #vehicles = [];

  /** `chosen` is called when another vehicle is chosen. */
  constructor(chosen) {
    this.#state.replaceChildren(...GROUPS.map(([group, text]) => new Option(text, group)));
    this.#choice.addEventListener("change", chosen);
    for (const [field, event] of [[this.#name, "input"], [this.#state, "change"]])
      field.addEventListener(event, () => this.#offer());
  }

  /** The vehicle that is shown: the one that was chosen, else the first. */
  get chosen() {
    return this.#vehicles.find((one) => one.id === this.#choice.value) ?? this.#vehicles[0];
  }

  /** `recorded`: of a recording, in which signatures are not recorded. */
  draw(vehicles, recorded) {
    this.#vehicles = vehicles;
    const few = vehicles.length < FILTERED_FROM;
    this.#name.parentElement.hidden = this.#state.parentElement.hidden = few;
    if (!few) {
      for (const [i, [group, text, has]] of GROUPS.entries()) {
        const option = this.#state.options[i];
        const shown = `${text} (${vehicles.filter(has).length})`;
        if (option.textContent !== shown) option.textContent = shown;
        option.hidden = recorded && group === "unsigned";
      }
    }
    this.#offer();
  }

  /** Those of the group whose name or id has the text; the one that is shown stays. Nothing is drawn where nothing is different. */
  #offer() {
    const few = this.#vehicles.length < FILTERED_FROM;
    const text = few ? "" : this.#name.value.trim().toLowerCase();
    const [, , has] = GROUPS.find(([group]) => group === this.#state.value && !few) ?? GROUPS[0];
    const before = this.#choice.value;
    const found = this.#vehicles.filter((one) => one.id === before || (has(one) && name(one).toLowerCase().includes(text)));
    const shown = found.slice(0, MAX_OFFERED);
    const chosen = found.find((one) => one.id === before);
    if (chosen && !shown.includes(chosen)) shown.push(chosen);
    const more = found.length - shown.length;
    const offered = `${shown.map(name).join()} ${more}`;
    if (offered === this.#offered) return;
    this.#offered = offered;
    const options = shown.map((one) => this.#option(one));
    if (more > 0) {
      const rest = new Option(`and ${more} more: choose by name or state`, "");
      rest.disabled = true;
      options.push(rest);
    }
    this.#choice.replaceChildren(...options);
    if (chosen) this.#choice.value = before;
  }

  #option(vehicle) {
    const text = name(vehicle);
    let option = this.#options.get(vehicle.id);
    if (option?.textContent !== text) {
      option = new Option(text, vehicle.id);
      this.#options.set(vehicle.id, option);
    }
    return option;
  }
}

const name = ({ id, tail_number }) => (tail_number ? `${tail_number} (${id})` : id);
