// Strips of the last minute, with the modes behind them.

import { draw, fixed, known, make, set, words } from "./dom.js";
import { HISTORY_S, MODES } from "./model.js";

const [WIDTH, HEIGHT] = [300, 100];

const STRIPS = [
  { title: "distance to the line", unit: "cm", span: 4, zero: true, digits: 1,
    curves: [{ name: "e_rho", colour: "var(--line)", of: (r) => r.e_rho * 100 }] },
  { title: "pitch, and its setpoint", unit: "°", span: 4, digits: 1,
    curves: [{ name: "pitch", colour: "var(--line)", of: (r) => r.pitch },
      { name: "setpoint", colour: "var(--sp)", of: (r) => r.pitch_sp }] },
  { title: "elevator", unit: "%", span: 20, zero: true, digits: 0,
    curves: [{ name: "elevator", colour: "var(--line)", of: (r) => r.elevator * 100 }] },
  { title: "updraft, and sink", unit: "m/s", span: 0.4, digits: 2,
    curves: [{ name: "updraft", colour: "var(--air-line)", of: (r) => r.updraft },
      { name: "sink", colour: "var(--sp)", of: (r) => r.updraft - r.excess }] },
  { title: "airspeed", unit: "m/s", span: 1, digits: 1,
    curves: [{ name: "airspeed", colour: "var(--line)", of: (r) => r.airspeed }] },
];

export class Strips {
  constructor(box, model) {
    this.model = model;
    this.drawn = -1;
    this.strips = STRIPS.map((strip) => {
      const element = box.appendChild(make("div", { class: "strip" }));
      const head = element.appendChild(make("h3"));
      head.append(make("b", {}, strip.title));
      const value = head.appendChild(make("span"));
      const svg = element.appendChild(draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none" }));
      const bands = svg.appendChild(draw("g", { opacity: 0.13 }));
      const zero = svg.appendChild(draw("line", { class: "zero", x1: 0, x2: WIDTH }));
      const paths = strip.curves.map((curve) => {
        const path = svg.appendChild(draw("path"));
        path.style.stroke = curve.colour;
        return path;
      });
      const range = element.appendChild(make("small", { class: "hint" }));
      return { ...strip, value, svg, bands, zero, paths, range };
    });
  }

  update() {
    const { rows, columns } = this.model;
    const last = rows[rows.length - 1];
    if (!last || this.drawn === last[0]) return;
    this.drawn = last[0];
    const end = last[0];
    const x = (t) => WIDTH * (1 - (end - t) / HISTORY_S);
    const read = rows.map((row) => {
      const of = (name) => row[columns[name]] ?? NaN;
      return { t: row[0], mode: of("soar_mode"), e_rho: of("e_rho"), pitch: of("pitch"), pitch_sp: of("pitch_sp"),
        elevator: of("elevator"), updraft: of("updraft"), excess: of("excess"), airspeed: of("airspeed") };
    });
    const bands = modeBands(read);
    for (const strip of this.strips) this.drawStrip(strip, read, x, bands);
  }

  drawStrip(strip, read, x, bands) {
    const values = strip.curves.map((curve) => read.map(curve.of));
    const all = values.flat().filter(known);
    let low = Math.min(...all);
    let high = Math.max(...all);
    if (!all.length) [low, high] = [0, strip.span];
    if (strip.zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    const room = Math.max(0, strip.span - (high - low)) / 2 + 0.05 * Math.max(strip.span, high - low);
    [low, high] = [low - room, high + room];
    const y = (v) => HEIGHT * (1 - (v - low) / (high - low));
    values.forEach((series, k) => {
      let d = "";
      let pen = false;
      series.forEach((v, i) => {
        if (!known(v)) { pen = false; return; }
        d += `${pen ? "L" : "M"}${x(read[i].t).toFixed(1)} ${y(v).toFixed(1)}`;
        pen = true;
      });
      strip.paths[k].setAttribute("d", d);
    });
    set(strip.zero, { y1: y(0), y2: y(0), visibility: low < 0 && high > 0 ? "visible" : "hidden" });
    strip.bands.replaceChildren(...bands.map(([from, to, mode]) => {
      const band = draw("rect", { x: x(from), width: Math.max(0, x(to) - x(from)), y: 0, height: HEIGHT });
      band.style.fill = bandColour(MODES[this.model.scene.modes[mode]]);
      return band;
    }));
    const now = values.map((series) => fixed(series[series.length - 1], strip.digits)).join(" / ");
    words(strip.value, `${now} ${strip.unit}`);
    words(strip.range, `${fixed(low, strip.digits)} to ${fixed(high, strip.digits)} ${strip.unit}`);
  }
}

// What flies, or has ended, has its level's colour; before that nothing is coloured.
function bandColour(mode) {
  return mode && (mode.flying || mode.level === "bad") ? `var(--${mode.level})` : "var(--soft)";
}

function modeBands(read) {
  const bands = [];
  for (const { t, mode } of read) {
    const last = bands[bands.length - 1];
    if (last && last[2] === mode) last[1] = t;
    else if (known(mode)) { if (last) last[1] = t; bands.push([t, t, mode]); }
  }
  return bands;
}
