// Head, gauges, entry checks, messages: what the operator reads beside the plane.

import { $, fixed, known, level, make, words } from "./dom.js";
import { MODES } from "./model.js";

const SEVERITIES = ["emergency", "alert", "critical", "error", "warning", "notice", "info", "debug"];

export function updateHead(model) {
  const mode = $("mode");
  words(mode, model.mode ?? "no mode");
  level(mode, MODES[model.mode]?.level ?? "none");
  const link = $("link");
  if (model.isRecording) { words(link, "recording"); level(link, "none"); }
  else if (!model.connected) { words(link, "page cut off"); level(link, "bad"); }
  else if (model.silence_s === null) { words(link, "waiting for the module"); level(link, "warn"); }
  else if (!model.alive) { words(link, `silent for ${fixed(model.silence_s, 0)} s`); level(link, "bad"); }
  else { words(link, "link alive"); level(link, "good"); }
  const battery = $("battery");
  battery.hidden = !known(model.now.battery_v);
  words(battery, `${fixed(model.now.battery_v, 1)} V${known(model.now.battery) ? ` · ${Math.round(model.now.battery * 100)} %` : ""}`);
  const can = model.connected && model.alive && !model.isRecording;
  $("engage").disabled = !can || model.flying;
  for (const id of ["release", "abort"]) $(id).disabled = !model.connected || model.isRecording;
}

// The worst of each kind, in words, and how near it is: 0 far away, 1 at its limit.
function gauges({ now, parameters: p, alive, silence_s: silence, isRecording, scene }) {
  const list = [];
  const add = (name, text, near) => list.push({ name, text, near: known(near) ? Math.max(0, Math.min(1.2, near)) : null });
  const height = now.clearance;
  add("height over the ground", fixed(height, 2, "m"), p.CLEAR_MIN > 0 && known(height) ? (height > 0 ? p.CLEAR_MIN / height : 1.2) : null);
  add("margin to the stall", fixed(now.stall, 1, "°"), known(now.stall) ? 1 - now.stall / 8 : null);
  add("place to settle", ...settling(now, p, scene.forecasts));
  if (known(now.esc_left)) add("height left for landing", ...wayHome(now));
  add("position age", fixed(now.age_pos, 2, "s"), now.age_pos / p.AGE_POS_HOLD);
  add("attitude age", fixed(now.age_att, 3, "s"), now.age_att / p.AGE_ATT_MAX);
  add("autopilot's heartbeat", fixed(now.age_ap, 1, "s"), now.age_ap / p.AGE_AP_MAX);
  add("distance to the line", fixed(now.e_rho * 100, 1, "cm"), Math.abs(now.e_rho) / p.CAPTURE_MAX);
  add("lost on the autopilot's link", known(now.loss) ? `${(now.loss * 100).toFixed(0)} %` : "–", now.loss / 0.2);
  if (known(now.battery)) add("battery", `${Math.round(now.battery * 100)} %`, 1 - (now.battery - 0.2) / 0.8);
  if (!isRecording && !alive) add("telemetry", known(silence) ? `silent for ${silence.toFixed(0)} s` : "none yet", 1.2);
  return list.sort((a, b) => (b.near ?? -1) - (a.near ?? -1));
}

// The module's forecast: at its limit where the chance of a place is FC_CHANCE, and there is none.
function settling({ fc_state: state, fc_chance: chance, fc_time: seconds, fc_z: z }, p, texts) {
  if (!known(state) || state < 1) return ["–", null];
  const when = known(seconds) ? ` in ${fixed(seconds, 1)} s` : "";
  if (state > 1) return [`none: ${texts[state] ?? "not known why"}${when}`, 1.2];
  return [`z ${fixed(z, 2)} m${when}`, (1 - chance) / (1 - (known(p.FC_CHANCE) ? p.FC_CHANCE : 0))];
}

// What the way home would leave: at its limit where there is none, far from it at 5 m.
function wayHome({ esc_left: left, esc_time: seconds }) {
  const when = left > 0 && known(seconds) && seconds < 600 ? `, gone in ${fixed(seconds, 0)} s` : "";
  return [`${fixed(left, 1, "m")}${when}`, 1 - left / 5];
}

export function updateGauges(model) {
  const list = $("gauge-list");
  const found = gauges(model);
  while (list.children.length < found.length) {
    const row = list.appendChild(make("li"));
    row.append(make("span"), make("b"), make("div", { class: "bar" }));
    row.lastChild.append(make("i"));
  }
  while (list.children.length > found.length) list.lastChild.remove();
  found.forEach((gauge, i) => {
    const row = list.children[i];
    const [name, value, bar] = row.children;
    const how = gauge.near === null ? "none" : gauge.near >= 0.95 ? "bad" : gauge.near >= 0.7 ? "warn" : "good";
    level(row, how);
    words(name, gauge.name);
    const said = gauge.text.startsWith("none") ? {} : { bad: " – at its limit", warn: " – close" };
    words(value, gauge.text + (said[how] ?? ""));
    bar.firstChild.style.width = `${Math.min(100, 100 * (gauge.near ?? 0))}%`;
  });
}

export function updateChecks(model) {
  const list = $("check-list");
  const { checks, faults } = model.scene;
  if (!list.children.length) for (const [, text] of checks) list.append(make("li", {}, text));
  const lacks = model.now.entry;
  const isKnown = known(lacks) && (model.alive || model.isRecording);
  let missing = 0;
  checks.forEach(([bit, text], i) => {
    const holds = isKnown ? ((lacks & bit) === 0 ? "yes" : "no") : "unknown";
    missing += holds === "no";
    const row = list.children[i];
    if (row.dataset.holds !== holds) {
      row.dataset.holds = holds;
      row.textContent = holds === "no" ? `missing: ${text}` : holds === "yes" ? text : `not known: ${text}`;
    }
  });
  const found = known(model.now.faults) ? faults.filter(([bit]) => model.now.faults & bit).map(([, text]) => text) : [];
  words($("checks-count"), !isKnown ? "– not known" : missing ? `– ${missing} missing` : "– all hold");
  $("checks-count").title = found.join(", ");
}

export class Messages {
  constructor(list, model) {
    this.list = list;
    this.model = model;
    this.key = "";
  }

  update() {
    const texts = this.model.texts;
    const last = texts[texts.length - 1];
    const key = last ? `${texts.length}:${last.first}:${last.text}` : "";
    if (key === this.key) return;
    this.key = key;
    this.list.replaceChildren(...texts.slice(-100).reverse().map((text) => {
      const row = make("li", {}, text.text);
      row.dataset.level = text.severity <= 3 ? "bad" : text.severity === 4 ? "warn" : "none";
      const when = this.model.isRecording ? `${text.time.toFixed(1)} s` : new Date(text.time * 1000).toLocaleTimeString();
      row.prepend(make("small", {}, `${when} · ${text.source ?? text.kind} · ${SEVERITIES[text.severity] ?? ""}`));
      return row;
    }));
  }
}

export function ghostWords(model, requested) {
  const element = $("ghost-words");
  const { ghost } = model;
  if (!ghost || (!requested && !model.holder)) {
    level(element, "soft");
    words(element, model.isRecording ? "A recording: nothing can be moved."
      : !model.line ? "Waiting for the module's parameters." : "Drag the line by its point, turn it by its ring, or use the arrow keys.");
    return;
  }
  if (ghost.refusal) {
    level(element, "bad");
    words(element, `Would be refused: ${ghost.refusal}`);
    return;
  }
  level(element, "ghost");
  const place = ghost.place ? `settles at x ${fixed(ghost.place[0])}, z ${fixed(ghost.place[1])} m` : "no place to settle";
  const when = known(ghost.settles_s) ? ` within ${fixed(ghost.settles_s, 0)} s` : "";
  const more = ghost.words ? ` – ${ghost.words}` : "";
  words(element, `${place}${when}${more}${ghost.warning ? ` – ${ghost.warning}` : ""}`);
}

// What of the air is drawn, and what the measured map knows.
export function airWords(model, plane) {
  const { measured } = model;
  const at = $("air-words");
  const readings = measured ? `measured: ${measured.readings} readings` : "measured: nothing yet; it begins when the module is engaged";
  const ground = measured?.loose > 0.5 ? "; the flow does not follow the site's ground" : "";
  level(at, ground ? "warn" : "none");
  words(at, plane.air === "measured" || measured ? readings + ground : "");
}

// How the point on the line stands: the box shows what the module has confirmed.
export function pointWords(model) {
  const { now, parameters: p, scene } = model;
  const box = $("hold-point");
  box.checked = p.TGL_HOLD > 0;
  box.disabled = model.isRecording || !model.connected || !known(p.TGL_HOLD);
  const at = $("point-words");
  const stands = scene.points?.[now.pt_state] ?? "";
  const off = known(now.pt_off) ? `, ${fixed(now.pt_off * 100, 1)} cm off` : "";
  const brake = known(now.brake) && now.pt_state > 0 ? `, brake ${Math.round(now.brake * 100)} %` : "";
  level(at, now.pt_state > 1 ? "warn" : "none");
  words(at, p.TGL_HOLD > 0 && stands ? `${stands}${off}${brake}` : "");
}

export function lineWords(model) {
  const { line, now } = model;
  const at = known(now.soar_x) && known(now.soar_z) ? `aircraft at x ${fixed(now.soar_x)}, z ${fixed(now.soar_z)} m` : "no position";
  words($("line-words"), line ? `line at x ${fixed(line.x)}, z ${fixed(line.z)} m, lean ${fixed(line.lean, 1)}° · ${at}` : at);
  const holder = $("holder");
  level(holder, model.heldByOther ? "warn" : "none");
  words(holder, model.heldByOther ? `${model.holderName} holds the line` : model.busy ? "the module is being asked …" : "");
}
