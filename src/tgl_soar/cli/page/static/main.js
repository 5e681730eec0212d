// The page: asks for the place, opens the socket or the recording, and draws once a frame.

import { $, level, make, words } from "./dom.js";
import { Hand } from "./hand.js";
import { Live } from "./live.js";
import { Model } from "./model.js";
import { Messages, airWords, ghostWords, lineWords, pointWords, updateChecks, updateGauges, updateHead } from "./panels.js";
import { Parameters } from "./parameters.js";
import { Attitude, Plane } from "./plane.js";
import { Replay } from "./replay.js";
import { Strips } from "./strips.js";

const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";
const NOTICE_MS = 7000;

function banner(text, how = "bad") {
  const element = $("banner");
  element.hidden = !text;
  words(element, text);
  level(element, how);
}

async function get(path) {
  const response = await fetch(path, { headers: { Authorization: `Bearer ${token}` } });
  if (!response.ok) throw new Error((await response.text()).trim());
  return response.json();
}

function notices(model) {
  for (const notice of model.notices) {
    const element = make("p", {}, notice.text);
    element.dataset.ok = notice.ok ? "yes" : "no";
    $("notices").append(element);
    setTimeout(() => element.remove(), NOTICE_MS);
  }
  while ($("notices").children.length > 5) $("notices").firstChild.remove();
  model.notices = [];
}

function presets(model, ask) {
  model.scene.presets.forEach((preset, i) => {
    const button = make("button", { "aria-pressed": "false", title: `x ${preset.x}, z ${preset.z} m, lean ${preset.lean}°` }, preset.name);
    button.addEventListener("click", () => ask("preset", { number: i + 1 }));
    $("presets").append(button);
  });
}

// The survey's button, and the place on the contour as the module echoes it.
function surveyed(model) {
  const { SRV_START: way, TGL_PLACE: place } = model.parameters;
  const cannot = model.isRecording || !model.connected || model.heldByOther;
  words($("survey"), way ? `Stop the survey (${["", "downstream", "upstream", "home"][way]})` : "Survey the contour");
  $("survey").disabled = cannot || !(way || model.mode === "soaring");
  $("place").disabled = cannot || Boolean(way);
  if (document.activeElement === $("place")) return;
  const known = place !== undefined && place >= 0;
  if (known) $("place").value = place;
  words($("place-words"), known ? `${place.toFixed(2)} m` : "elsewhere");
}

function theme() {
  const asked = localStorage.getItem("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const put = (name) => { document.documentElement.dataset.theme = name; };
  put(asked ?? (dark.matches ? "dark" : "light"));
  dark.addEventListener("change", () => { if (!localStorage.getItem("theme")) put(dark.matches ? "dark" : "light"); });
  return () => {
    const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("theme", next);
    put(next);
  };
}

async function begin() {
  const turn = theme();
  let scene;
  try {
    scene = await get("/scene");
  } catch (error) {
    banner(`This page cannot be opened: ${error.message}`);
    return;
  }
  const model = new Model(scene);
  words($("site"), scene.site);
  words($("airframe"), scene.airframe);
  document.title = `${scene.site} – tgl_soar`;
  const plane = new Plane($("plane"), model);
  $("theme").addEventListener("click", () => { turn(); plane.layout(); });
  $("air").value = plane.air;
  $("air").disabled = !scene.updraft; // a choice only where there are two
  $("air").addEventListener("change", (event) => { plane.air = event.target.value; plane.update(); airWords(model, plane); });
  const attitude = new Attitude($("attitude"));
  const strips = new Strips($("strip-list"), model);
  const messages = new Messages($("message-list"), model);
  let live = null;
  const ask = (what, fields) => live?.ask(what, fields) ?? false;
  const hand = new Hand(plane, model, ask);
  const parameters = new Parameters($("parameter-list"), model, ask);
  presets(model, ask);
  for (const id of ["engage", "release", "abort", "undo"]) $(id).addEventListener("click", () => ask(id));
  $("along").addEventListener("change", (event) => { hand.along = event.target.checked; });

  $("survey").addEventListener("click", () => ask("set", { name: "SRV_START", value: model.parameters.SRV_START ? 0 : 1 }));
  $("place-row").hidden = !scene.contour_m;
  $("place").max = scene.contour_m;
  $("place").addEventListener("input", (event) => words($("place-words"), `${Number(event.target.value).toFixed(2)} m`));
  $("place").addEventListener("change", (event) => {
    ask("set", { name: "TGL_PLACE", value: Number(event.target.value) });
    event.target.blur(); // from here on it shows the module's echo
  });

  $("point-row").hidden = !scene.has_brake;
  $("hold-point").addEventListener("change", (event) => {
    const { checked } = event.target;
    const along = Math.round(plane.pointToHold() * 100) / 100;
    if (checked && !model.parameters.TGL_ALONG) ask("set", { name: "TGL_ALONG", value: along });
    ask("set", { name: "TGL_HOLD", value: checked ? 1 : 0 });
  });

  let waits = false;
  let starts = null; // of the module, as the last frame counted them
  const measured = [];
  const paint = () => {
    waits = false;
    plane.update();
    attitude.update(model.now);
    strips.update();
    updateHead(model);
    updateGauges(model);
    updateChecks(model);
    messages.update();
    parameters.update();
    lineWords(model);
    pointWords(model);
    airWords(model, plane);
    ghostWords(model, plane.requested);
    notices(model);
    const number = model.parameters.TGL_PRESET;
    [...$("presets").children].forEach((button, i) => {
      button.setAttribute("aria-pressed", String(number === i + 1));
      button.disabled = model.isRecording || !model.line || model.heldByOther || !model.connected;
    });
    surveyed(model);
    $("undo").disabled = !model.undo || model.heldByOther;
    if (model.received && model.received !== measured.last) {
      measured.last = model.received;
      measured.push(Date.now() / 1000 - model.received);
      if (measured.length > 400) measured.shift();
    }
    if (!model.isRecording && model.connected) {
      const gone = model.silence_s !== null && !model.alive;
      banner(gone ? `No telemetry for ${model.silence_s.toFixed(0)} s: what is shown is old.` : "");
    }
  };
  const redraw = () => { if (!waits) { waits = true; requestAnimationFrame(paint); } };

  if (scene.source === "recording") {
    const recording = await get("/recording");
    words($("site"), `${recording.name} – ${scene.site}`);
    banner((recording.notes ?? []).join(" · "), "warn");
    words($("foot"), [recording.kind, ...recording.missing, ...recording.lost].join(" · "));
    model.measured = recording.measured;
    const replay = new Replay(recording, model, redraw);
    window.page = { model, plane, hand, replay, measured };
    return;
  }
  const onFrame = (frame) => {
    model.apply(frame);
    if ("starts" in frame && model.starts !== starts) {
      if (starts !== null && model.starts > starts) model.notices.push({ ok: false, text: "The module has been started again: it is not engaged." });
      starts = model.starts;
      hand.cancel();
    }
    redraw();
  };
  const onState = (connected, reason) => {
    if (model.connected === connected && connected) return;
    model.connected = connected;
    if (!connected) {
      hand.cancel();
      banner(reason ? `The page was refused: ${reason}` : "The page is cut off from its server. The flight goes on; it is tried again every second.");
    }
    redraw();
  };
  live = new Live(token, localStorage.getItem("name") ?? "", onFrame, onState);
  window.page = { model, plane, hand, live, measured };
}

begin();
