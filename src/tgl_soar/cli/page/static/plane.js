// The vertical plane to scale: what stands still is drawn when the size or the fence changes, what
// moves is moved.  x to the right is downstream, z is up; the aircraft faces the wind, to the left.

import { draw, fixed, known, set, words } from "./dom.js";

const RAD = Math.PI / 180;
const NOSE = "M-17 0C-14 -3.2 -8 -4 0 -3.4L12 -2 18 -10 21 -10 20 .5C14 3 -8 4.2 -17 0Z";
const WING = "M-6 -1.6C-4 -3.4 4 -3 8 -.6L7 .8C2 .2 -4 .8 -6 -1.6Z";

const NAME_ASIDE = 26; // of a line's name from its point: the aircraft is that long

export class Plane {
  constructor(svg, model) {
    this.svg = svg;
    this.model = model;
    this.requested = null; // the line in the hand
    this.requestedAlong = null; // the point in the hand: metres along the line
    this.air = scenesAir(model); // whose updraft is drawn: "site" or "measured"
    this.under = svg.appendChild(draw("g"));
    this.still = svg.appendChild(draw("g"));
    this.moving = svg.appendChild(draw("g"));
    this.names = svg.appendChild(draw("g", { "pointer-events": "none" })); // no aircraft hides them
    this.part = {};
    this.build();
    this.key = "";
    new ResizeObserver(() => this.layout()).observe(svg);
    this.layout();
  }

  build() {
    const add = (name, tag, attributes, into = this.moving) => {
      this.part[name] = into.appendChild(draw(tag, attributes));
    };
    add("measured", "path", { class: "measured" });
    add("measuredTag", "text", { class: "tag m" });
    for (let i = 0; i < 4; i++) add(`trail${i}`, "path", { class: "trail", opacity: 0.16 + 0.24 * i });
    add("flown", "line", { class: "flown" });
    add("set", "line", { class: "set" });
    add("ghost", "g", { visibility: "hidden" });
    add("ghostPath", "path", { class: "ghost-path" }, this.part.ghost);
    add("ghostLine", "line", { class: "ghost-line" }, this.part.ghost);
    add("ghostRing", "circle", { class: "ghost-place", r: 13 }, this.part.ghost);
    add("ghostCore", "circle", { class: "ghost-place core", r: 3 }, this.part.ghost);
    add("handle", "g", { id: "handle" });
    add("grip", "line", { class: "grip", id: "line-grip" }, this.part.handle);
    add("leanReach", "circle", { class: "reach", r: 24, id: "lean-handle" }, this.part.handle);
    add("lean", "circle", { class: "knob lean", r: 8, "pointer-events": "none" }, this.part.handle);
    add("reach", "circle", { class: "reach", r: 26, id: "point-handle" }, this.part.handle);
    add("knob", "circle", { class: "knob", r: 10, "pointer-events": "none" }, this.part.handle);
    add("tag", "text", { class: "tag s" }, this.part.handle);
    add("point", "g", { visibility: "hidden", id: "held-point" });
    add("pointBand", "line", { class: "point-band" }, this.part.point);
    add("pointReach", "circle", { class: "reach", r: 15, id: "along-handle" }, this.part.point);
    add("pointFlown", "circle", { class: "point-flown", r: 5, "pointer-events": "none" }, this.part.point);
    add("pointMark", "path", { class: "point-mark", "pointer-events": "none" }, this.part.point);
    add("pointTag", "text", { class: "tag p", "pointer-events": "none" }, this.part.point);
    add("foreseen", "g", { visibility: "hidden", "pointer-events": "none" }); // the knob may be below it
    add("foreseenRing", "circle", { class: "settle", r: 11 }, this.part.foreseen);
    add("foreseenCross", "path", { class: "nowhere", d: "M-9 -9L9 9M-9 9L9 -9" }, this.part.foreseen);
    add("foreseenTag", "text", { class: "tag" }, this.part.foreseen);
    add("craft", "g", { class: "craft" });
    this.part.craft.append(draw("path", { d: NOSE }), draw("path", { d: WING }));
  }

  // --- scale ---------------------------------------------------------------------------------

  layout() {
    const box = this.svg.getBoundingClientRect();
    if (!box.width || !box.height) return;
    this.width = box.width;
    this.height = box.height;
    const [x0, x1, z0, z1] = this.model.scene.view;
    this.scale = Math.min(box.width / (x1 - x0), box.height / (z1 - z0));
    this.x0 = (x0 + x1) / 2 - box.width / 2 / this.scale;
    this.z1 = (z0 + z1) / 2 + box.height / 2 / this.scale;
    this.svg.setAttribute("viewBox", `0 0 ${box.width} ${box.height}`);
    this.key = "";
    this.drawn = null;
    this.update();
  }

  X(x) { return (x - this.x0) * this.scale; }
  Z(z) { return (this.z1 - z) * this.scale; }
  at(px, pz) {
    const box = this.svg.getBoundingClientRect();
    return { x: this.x0 + (px - box.left) / this.scale, z: this.z1 - (pz - box.top) / this.scale };
  }

  points(list) {
    return list.map(([x, z]) => `${this.X(x).toFixed(1)},${this.Z(z).toFixed(1)}`);
  }

  path(list) {
    const points = this.points(list.filter(([x, z]) => known(x) && known(z)));
    return points.length ? `M${points.join("L")}` : "";
  }

  // --- what stands still ---------------------------------------------------------------------

  drawStill() {
    const { scene, parameters: p } = this.model;
    const names = ["FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Z_MIN", "FENCE_Z_MAX", "CLEAR_MIN", "LND_X", "LND_Z", "LND_LEN"];
    const key = names.map((name) => p[name]).join();
    if (this.key === key) return;
    this.key = key;
    this.still.replaceChildren();
    this.names.replaceChildren();
    this.named = [];
    const add = (tag, attributes, text) => this.still.appendChild(draw(tag, attributes, text));
    const labels = this.drawGrid(add);
    this.drawGround(add, scene, p.CLEAR_MIN);
    for (const label of labels) this.still.append(label);
    for (const part of scene.contour) add("path", { class: "contour", d: this.path(part) });
    for (const part of scene.braked ?? []) add("path", { class: "contour braked", d: this.path(part) });
    const inside = scene.contour.flat().filter(([x]) => this.X(x) < this.width - 120);
    const top = inside.reduce((a, b) => (b[1] > a[1] ? b : a), inside[0]);
    if (top) this.tag(add, "tag c", top, "updraft = sink", "end");
    const braked = (scene.braked ?? []).flat().filter(([x]) => this.X(x) < this.width - 160);
    const low = braked.reduce((a, b) => (b[1] > a[1] ? b : a), braked[0]);
    if (low) this.tag(add, "tag c", low, "… with all of the brake", "end");
    this.drawFence(add, p);
    this.drawLanding(add, p);
    for (const preset of scene.presets) {
      add("line", { class: "preset", ...this.ends(preset) });
      add("circle", { class: "preset-dot", cx: this.X(preset.x), cy: this.Z(preset.z), r: 3 });
      this.name(preset);
    }
  }

  // A line's name, beside the place where the aircraft flies on it.
  name({ x, z, name }) {
    const [at, base] = [this.X(x), this.Z(z) + 4];
    const places = [[at + 12, base + 20], [at - NAME_ASIDE - breadth(name), base], [at + NAME_ASIDE, base]];
    const [left, low] = this.freest(places, name, this.pixels(this.model.scene.contour));
    this.names.append(draw("text", { class: "tag", x: left, y: low }, name));
    this.named.push([left + breadth(name) / 2, low - 4]);
  }

  // Of places for a text (its left end and base) the first that fewest points lie under.
  freest(places, text, points) {
    const wide = breadth(text);
    const under = ([left, base]) => {
      const inside = left > 2 && left + wide < this.width - 2 && base > 12 && base < this.height - 4;
      const crossed = points.filter(([x, y]) => x > left - 3 && x < left + wide + 3 && y > base - 12 && y < base + 5);
      return crossed.length + (inside ? 0 : 1000);
    };
    return places.reduce((best, place) => (under(place) < under(best) ? place : best));
  }

  pixels(parts) {
    return parts.flat().map(([x, z]) => [this.X(x), this.Z(z)]);
  }

  tag(add, name, [x, z], text, anchor = "start") {
    const aside = anchor === "end" ? -8 : 8;
    add("text", { class: name, x: this.X(x) + aside, y: this.Z(z) - 6, "text-anchor": anchor }, text);
  }

  // The updraft, of the site's air or as measured, and the measured contour.
  drawAir() {
    const { scene, measured } = this.model;
    const map = this.air === "measured" ? measured : scene.updraft;
    if (this.drawn?.measured === measured && this.drawn.map === map) return;
    this.drawn = { measured, map };
    this.under.replaceChildren(...(map ? [this.picture(map)] : []));
    const pieces = (measured?.contour ?? []).map((piece) => this.path(piece));
    this.part.measured.setAttribute("d", pieces.join(""));
    this.nameMeasured(measured?.contour ?? []);
  }

  // Beside an end of the measured contour, where it lies on nothing; the highest end comes first.
  nameMeasured(parts) {
    const text = parts.length ? "measured" : "";
    words(this.part.measuredTag, text);
    if (!text) return;
    const points = this.model.scene.presets.map((preset) => [preset.x, preset.z]);
    const taken = [...this.named, ...this.pixels([...parts, ...this.model.scene.contour, points])];
    const wide = breadth(text);
    const ends = this.pixels([parts.flatMap((part) => [part[0], part[part.length - 1]])]).sort((a, b) => a[1] - b[1]);
    const places = ends.flatMap(([x, y]) => [[x + 10, y + 4], [x - wide - 10, y + 4], [x - wide / 2, y - 12], [x - wide / 2, y + 20]]);
    const [left, base] = this.freest(places, text, taken);
    set(this.part.measuredTag, { x: left, y: base });
  }

  picture(map) {
    const rows = map.cells.length;
    const columns = map.cells[0].length;
    const stepZ = map.step_z ?? map.step;
    const canvas = document.createElement("canvas");
    canvas.width = columns;
    canvas.height = rows;
    const context = canvas.getContext("2d");
    const image = context.createImageData(columns, rows);
    const colour = getComputedStyle(this.svg).getPropertyValue("--air").split(",").map(Number);
    // Under the ground's edge the air of the site is drawn on from above: the ground covers it.
    // What was not measured stays empty.
    const cells = map.readings ? map.cells : map.cells.map((row, j) => row.map((w, i) => w
      ?? map.cells[j + 1]?.[i] ?? map.cells[j + 2]?.[i] ?? null));
    const strongest = Math.max(...map.cells.flat().filter((w) => w !== null), 1);
    cells.forEach((row, j) => row.forEach((w, i) => {
      const at = 4 * ((rows - 1 - j) * columns + i);
      const least = map.readings ? 18 : 0; // where nothing rises, but that is known
      image.data.set([...colour, w === null ? 0 : Math.max(least, w < 0 ? 0 : 205 * Math.pow(w / strongest, 1.15))], at);
    }));
    context.putImageData(image, 0, 0);
    return draw("image", {
      x: this.X(map.x - map.step / 2), y: this.Z(map.z + (rows - 0.5) * stepZ),
      width: columns * map.step * this.scale, height: rows * stepZ * this.scale,
      preserveAspectRatio: "none", href: canvas.toDataURL(),
    });
  }

  drawGrid(add) {
    const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
    const step = steps.find((s) => s * this.scale >= 60) ?? 200;
    const digits = step < 1 ? 1 : 0;
    const labels = [];
    const write = (x, y, text) => labels.push(draw("text", { class: "axis", x, y }, text));
    for (let x = Math.ceil(this.x0 / step) * step; this.X(x) < this.width; x += step) {
      add("line", { class: "grid", x1: this.X(x), x2: this.X(x), y1: 0, y2: this.height });
      write(this.X(x) + 3, this.height - 6, fixed(round0(x), digits));
    }
    for (let z = Math.floor(this.z1 / step) * step; this.Z(z) < this.height; z -= step) {
      add("line", { class: "grid", x1: 0, x2: this.width, y1: this.Z(z), y2: this.Z(z) });
      write(this.width - 34, this.Z(z) - 3, fixed(round0(z), digits));
    }
    write(8, this.height - 22, "wind →  x and height z in metres");
    return labels;
  }

  drawGround(add, scene, clearance) {
    const far = (this.width + this.height) / this.scale;
    if (scene.outline.length) add("path", { class: "outline", d: `${this.path(scene.outline)}Z` });
    if (!scene.ground.length) return;
    const first = scene.ground[0];
    const last = scene.ground[scene.ground.length - 1];
    const top = [[first[0] - far, first[1]], ...scene.ground, [last[0] + far, last[1]]];
    if (clearance > 0) {
      add("path", { class: "clear", d: this.path(top), "stroke-width": 2 * clearance * this.scale });
    }
    const low = this.z1 - far;
    add("path", { class: "ground", d: `${this.path([...top, [top[top.length - 1][0], low], [top[0][0], low]])}Z` });
  }

  drawFence(add, p) {
    const known4 = ["FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Z_MIN", "FENCE_Z_MAX"].every((n) => known(p[n]));
    if (!known4) return;
    const x = Math.max(this.X(p.FENCE_X_MIN), -20);
    const y = Math.max(this.Z(p.FENCE_Z_MAX), -20);
    const right = Math.min(this.X(p.FENCE_X_MAX), this.width + 20);
    const low = Math.min(this.Z(p.FENCE_Z_MIN), this.height + 20);
    add("rect", { class: "fence", x, y, width: Math.max(0, right - x), height: Math.max(0, low - y) });
    const base = Math.max(14, y - 5);
    const places = [right - 36, (x + right) / 2, right - 120].map((left) => [left, base]);
    const [left] = this.freest(places, "fence", this.pixels(this.model.scene.contour));
    add("text", { class: "tag f", x: left, y: base }, "fence");
  }

  // The strip about the landing point; none is known where it has no length.
  drawLanding(add, p) {
    if (!["LND_X", "LND_Z", "LND_LEN"].every((name) => known(p[name])) || !(p.LND_LEN > 0)) return;
    const half = 0.5 * p.LND_LEN;
    const z = this.Z(p.LND_Z);
    add("line", { class: "landing", x1: this.X(p.LND_X - half), y1: z, x2: this.X(p.LND_X + half), y2: z });
    add("circle", { class: "landing-dot", cx: this.X(p.LND_X), cy: z, r: 4 });
    this.tag(add, "tag l", [p.LND_X, p.LND_Z], "landing place");
  }

  // --- what moves ----------------------------------------------------------------------------

  // The ends of a line through the view.
  ends({ x, z, lean }) {
    const reach = (this.width + this.height) / this.scale;
    const [dx, dz] = [-Math.sin(lean * RAD), Math.cos(lean * RAD)];
    return {
      x1: this.X(x - reach * dx), y1: this.Z(z - reach * dz),
      x2: this.X(x + reach * dx), y2: this.Z(z + reach * dz),
    };
  }

  // Where the handle that turns a line is, from its point.
  leanHandle({ x, z, lean }) {
    const d = Math.min(110, this.height / 4) / this.scale;
    return { x: x - d * Math.sin(lean * RAD), z: z + d * Math.cos(lean * RAD) };
  }

  update() {
    if (!this.scale) return;
    this.drawStill();
    this.drawAir();
    const { now, line, ghost, alive } = this.model;
    const shown = this.requested ?? line;
    const flown = { x: now.line_x, z: now.line_z, lean: now.line_lean };
    this.show("flown", known(flown.x + flown.z + flown.lean) && this.model.flying, () => this.ends(flown));
    this.show("set", line, () => this.ends(line));
    this.show("handle", shown && !this.model.isRecording, () => ({}));
    if (shown) this.drawHandle(shown);
    this.drawPoint(shown);
    this.drawGhost(ghost);
    this.drawForeseen(now, flown);
    this.drawCraft(now, alive);
    this.drawTrail();
  }

  show(name, is, attributes) {
    const element = this.part[name];
    if (!is) { element.setAttribute("visibility", "hidden"); return; }
    set(element, { visibility: "visible", ...attributes() });
  }

  drawHandle(line) {
    const lean = this.leanHandle(line);
    const place = { cx: this.X(line.x), cy: this.Z(line.z) };
    const turn = { cx: this.X(lean.x), cy: this.Z(lean.z) };
    set(this.part.grip, this.ends(line));
    set(this.part.knob, place);
    set(this.part.reach, place);
    set(this.part.lean, turn);
    set(this.part.leanReach, turn);
    set(this.part.tag, { x: place.cx + 14, y: place.cy - 12 });
    words(this.part.tag, this.requested ? `${fixed(line.x)}, ${fixed(line.z)} m, ${fixed(line.lean, 1)}°` : "");
    this.svg.classList.toggle("held", this.model.heldByOther);
  }

  // The point that the brake holds, and the part of the line on which it can: between the contours
  // without the brake and with all of it.
  drawPoint(line) {
    const { scene, parameters: p, now, isRecording } = this.model;
    const along = this.requestedAlong ?? p.TGL_ALONG;
    const holds = p.TGL_HOLD > 0;
    const is = scene.has_brake && line && known(along) && !isRecording && (holds || along !== 0 || this.requestedAlong !== null);
    this.show("point", is, () => ({ class: holds || this.requestedAlong !== null ? "is-held" : "" }));
    if (!is) return;
    const place = ahead(line, along);
    const [x, z] = [this.X(place.x), this.Z(place.z)];
    set(this.part.pointReach, { cx: x, cy: z });
    set(this.part.pointMark, { d: `M${x} ${z - 9}L${x + 9} ${z}L${x} ${z + 9}L${x - 9} ${z}Z` });
    set(this.part.pointTag, { x: x - 14, y: z + 4, "text-anchor": "end" });
    // The point that is flown, where it is another one: on its way, or it has given way.
    const off = known(now.pt_off + now.soar_x + now.soar_z) ? alongOf(line, { x: now.soar_x, z: now.soar_z }) - now.pt_off : along;
    this.show("pointFlown", Math.abs(off - along) > 0.02, () => {
      const flown = ahead(line, off);
      return { cx: this.X(flown.x), cy: this.Z(flown.z), visibility: "inherit" };
    });
    const stands = known(now.pt_state) ? scene.points?.[now.pt_state] : "";
    words(this.part.pointTag, this.requestedAlong !== null ? `${fixed(along, 2)} m along the line` : holds ? stands : "");
    const ends = bandOn(line, scene);
    this.show("pointBand", ends, () => {
      const [low, high] = ends.map((end) => ahead(line, end));
      return { x1: this.X(low.x), y1: this.Z(low.z), x2: this.X(high.x), y2: this.Z(high.z), visibility: "inherit" };
    });
  }

  // Where a point is held that nobody has placed: in the middle of the band, else where the aircraft is.
  pointToHold() {
    const { line, now, scene } = this.model;
    const ends = bandOn(line, scene);
    if (ends) return (ends[0] + ends[1]) / 2;
    return line && known(now.soar_x + now.soar_z) ? alongOf(line, { x: now.soar_x, z: now.soar_z }) : 0;
  }

  drawGhost(ghost) {
    // In the own hand the line is where the hand is; the answer of the server follows it.
    const line = this.requested ?? ghost;
    this.show("ghost", line && (ghost || this.requested), () => ({}));
    if (!line) return;
    set(this.part.ghostLine, this.ends(line));
    set(this.part.ghost, { class: ghost?.refusal ? "refused" : "" });
    const place = ghost?.place;
    for (const name of ["ghostRing", "ghostCore"]) {
      this.show(name, place, () => ({ cx: this.X(place[0]), cy: this.Z(place[1]) }));
      if (!place) this.part[name].setAttribute("visibility", "hidden");
      else this.part[name].setAttribute("visibility", "inherit");
    }
    this.part.ghostPath.setAttribute("d", ghost ? this.path(ghost.path) : "");
  }

  // Where the module foresees that the aircraft stops on its line, or passes the limit.
  drawForeseen(now, flown) {
    const { fc_state: state, fc_z: z, fc_time: seconds } = now;
    const x = flown.x - (z - flown.z) * Math.tan(flown.lean * RAD);
    const is = known(x) && state >= 1 && this.model.flying;
    this.show("foreseen", is, () => ({ transform: `translate(${this.X(x).toFixed(1)} ${this.Z(z).toFixed(1)})` }));
    if (!is) return;
    const settles = state === 1;
    this.part.foreseenRing.setAttribute("visibility", settles ? "inherit" : "hidden");
    this.part.foreseenCross.setAttribute("visibility", settles ? "hidden" : "inherit");
    const text = settles ? (seconds >= 1 ? `stops in ${fixed(seconds, 0)} s` : "")
      : `no place to settle${known(seconds) ? ` · ${fixed(seconds, 1)} s` : ""}`;
    set(this.part.foreseenTag, { x: 26, y: 18, class: settles ? "tag n" : "tag bad" });
    words(this.part.foreseenTag, text);
  }

  drawCraft(now, alive) {
    const { soar_x: x, soar_z: z, pitch } = now;
    this.show("craft", known(x) && known(z), () => ({
      transform: `translate(${this.X(x).toFixed(1)} ${this.Z(z).toFixed(1)}) rotate(${known(pitch) ? pitch.toFixed(1) : 0})`,
      class: alive ? "craft" : "craft dead-craft",
    }));
  }

  drawTrail() {
    const { columns, rows } = this.model;
    const places = rows.map((row) => [row[columns.soar_x], row[columns.soar_z]]);
    const quarter = Math.ceil(places.length / 4) || 1;
    for (let i = 0; i < 4; i++) {
      const part = places.slice(i * quarter, (i + 1) * quarter + 1);
      this.part[`trail${i}`].setAttribute("d", this.path(part));
    }
  }
}

// What of the air is drawn at first: the site's, where its file has one.
const scenesAir = (model) => (model.scene.updraft ? "site" : "measured");

// A place so far up along a line.
const ahead = ({ x, z, lean }, along) => ({ x: x - along * Math.sin(lean * RAD), z: z + along * Math.cos(lean * RAD) });

// How far up along a line a place is, at a right angle.
export const alongOf = ({ x, z, lean }, place) => (x - place.x) * Math.sin(lean * RAD) + (place.z - z) * Math.cos(lean * RAD);

// From where to where on a line the brake holds a point, along it; null: not known, or nowhere.
function bandOn(line, scene) {
  if (!line) return null;
  const ends = [scene.braked ?? [], scene.contour].map((parts) => highest(line, parts));
  return ends.every((end) => end !== null) ? ends : null;
}

// The highest crossing of a line and a contour, along the line: the stable one; null: there is none.
function highest(line, parts) {
  const off = ([x, z]) => (x - line.x) * Math.cos(line.lean * RAD) + (z - line.z) * Math.sin(line.lean * RAD);
  let best = null;
  for (const part of parts) {
    for (let i = 1; i < part.length; i++) {
      const [a, b] = [off(part[i - 1]), off(part[i])];
      if (a === b || a * b > 0) continue;
      const t = a / (a - b);
      const [x, z] = [0, 1].map((k) => part[i - 1][k] + t * (part[i][k] - part[i - 1][k]));
      const along = alongOf(line, { x, z });
      if (best === null || along > best) best = along;
    }
  }
  return best;
}

// About how wide a label is, in pixels: all of them are small.
const breadth = (text) => 6.6 * text.length;

const round0 = (value) => (Math.abs(value) < 1e-9 ? 0 : value);

// With a tenth, as long as that fits.
const angle = (value) => `${fixed(value, Math.abs(value) < 99.95 ? 1 : 0)}°`;

// A small side view: the aircraft at its pitch, and the pitch that is asked for.
export class Attitude {
  constructor(svg) {
    this.asked = svg.appendChild(draw("line", { class: "set", x1: -50, x2: -26, y1: 0, y2: 0 }));
    svg.appendChild(draw("line", { class: "grid", x1: -56, x2: 56, y1: 0, y2: 0 }));
    this.craft = svg.appendChild(draw("g", { class: "craft" }));
    this.craft.append(draw("path", { d: NOSE }), draw("path", { d: WING }));
    this.text = svg.appendChild(draw("text", { class: "axis", x: -60, y: 35 }));
    this.roll = svg.appendChild(draw("text", { class: "axis", x: 60, y: 35, "text-anchor": "end" }));
  }

  update({ pitch, pitch_sp: asked, roll }) {
    this.craft.setAttribute("transform", `rotate(${known(pitch) ? pitch : 0}) scale(1.9)`);
    this.asked.setAttribute("visibility", known(asked) ? "visible" : "hidden");
    if (known(asked)) this.asked.setAttribute("transform", `rotate(${asked})`);
    words(this.text, `pitch ${angle(pitch)}`);
    words(this.roll, `roll ${angle(roll)}`);
  }
}
