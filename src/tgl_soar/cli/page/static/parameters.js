// Every parameter with unit, range, default and meaning; a change shows what came back.

import { $, known, make, words } from "./dom.js";

export class Parameters {
  constructor(box, model, ask) {
    this.model = model;
    this.rows = new Map();
    const groups = new Map();
    for (const parameter of model.scene.parameters) {
      const { group } = parameter;
      if (!groups.has(group)) {
        const section = box.appendChild(make("section"));
        section.append(make("h3", {}, group));
        groups.set(group, section);
      }
      groups.get(group).append(this.row(parameter, ask));
    }
    $("parameter-filter").addEventListener("input", (event) => this.filter(event.target.value.toLowerCase()));
  }

  row(parameter, ask) {
    const row = make("div", { class: "parameter" });
    const value = make("div", { class: "value" });
    const input = make("input", { type: "number", step: "any", "aria-label": parameter.name, disabled: "" });
    value.append(input, make("span", {}, parameter.unit));
    const range = `${short(parameter.min)} to ${short(parameter.max)}, default ${short(parameter.default)}`;
    const ground = parameter.in_flight ? "" : " On the ground only.";
    row.append(make("code", {}, parameter.name), value, make("small", {}, range),
      make("span", { class: "meaning" }, parameter.meaning + ground));
    input.addEventListener("change", () => {
      if (input.value !== "" && known(Number(input.value))) ask("set", { name: parameter.name, value: Number(input.value) });
      this.rows.get(parameter.name).shown = NaN; // the echo is shown, whatever it is
    });
    input.addEventListener("keydown", (event) => { if (event.key === "Escape") { this.rows.get(parameter.name).shown = NaN; input.blur(); } });
    this.rows.set(parameter.name, { row, input, parameter, shown: NaN, text: `${parameter.name} ${parameter.meaning}`.toLowerCase() });
    return row;
  }

  filter(text) {
    for (const { row, text: own } of this.rows.values()) row.hidden = !own.includes(text);
    for (const section of $("parameter-list").children) {
      section.hidden = ![...section.querySelectorAll(".parameter")].some((row) => !row.hidden);
    }
  }

  update() {
    if (!$("parameter-details").open) return;
    for (const entry of this.rows.values()) {
      const value = this.model.parameters[entry.parameter.name];
      entry.input.disabled = !known(value) || this.model.isRecording || !this.model.connected;
      if (!known(value) || value === entry.shown || document.activeElement === entry.input) continue;
      entry.shown = value;
      entry.input.value = short(value);
      entry.row.classList.toggle("changed", Math.abs(value - entry.parameter.default) > 1e-6 * Math.abs(value));
    }
    words($("parameter-details").querySelector("h2"), `Parameters – ${Object.keys(this.model.parameters).length} known`);
  }
}

const short = (value) => String(Number(value.toPrecision(6)));
