// The line in the hand: dragged by its point, turned by its handle, or moved by keys.  While it is
// held the server says what would become of it; it goes out when it is released.

import { known } from "./dom.js";
import { alongOf } from "./plane.js";

const LOOKS_MS = 50;
const KEYS_MS = 350; // after the last key the line is released
const DEG = 180 / Math.PI;

export class Hand {
  constructor(plane, model, ask) {
    this.plane = plane;
    this.model = model;
    this.ask = ask;
    this.along = false; // the contour
    this.looked = 0;
    this.timer = null;
    this.drag = null;
    const { svg } = plane;
    // A finger on the line moves it; beside it, it scrolls the page.
    svg.addEventListener("touchstart", (event) => { if (kindOf(event.target) && this.may) event.preventDefault(); }, { passive: false });
    svg.addEventListener("pointerdown", (event) => this.down(event));
    svg.addEventListener("pointermove", (event) => this.moved(event));
    svg.addEventListener("pointerup", (event) => this.up(event));
    svg.addEventListener("pointercancel", () => this.cancel());
    svg.addEventListener("keydown", (event) => this.pressed(event));
    svg.addEventListener("blur", () => { if (this.plane.requested && !this.drag) this.send(); });
  }

  get may() { return this.model.line && !this.model.isRecording && !this.model.heldByOther && this.model.connected; }

  down(event) {
    const kind = kindOf(event.target);
    if (!kind || !this.may || event.button > 0) return;
    event.preventDefault();
    this.plane.svg.classList.add("by-pointer");
    this.plane.svg.focus({ preventScroll: true });
    this.plane.svg.setPointerCapture(event.pointerId);
    const place = this.plane.at(event.clientX, event.clientY);
    if (kind === "along") {
      const along = this.model.parameters.TGL_ALONG;
      this.drag = { kind, id: event.pointerId, offset: along - alongOf(this.model.line, place) };
      this.plane.requestedAlong = along;
      return;
    }
    const line = { ...(this.plane.requested ?? this.model.line) };
    this.drag = { kind, id: event.pointerId, from: line, dx: line.x - place.x, dz: line.z - place.z };
    clearTimeout(this.timer);
    this.plane.requested = line;
    this.ask("hold");
    this.look(true);
  }

  moved(event) {
    if (!this.drag || event.pointerId !== this.drag.id) return;
    const place = this.plane.at(event.clientX, event.clientY);
    if (this.drag.kind === "along") {
      const along = alongOf(this.model.line, place) + this.drag.offset;
      this.plane.requestedAlong = Math.max(-100, Math.min(100, centimetres(along)));
      this.plane.update();
      return;
    }
    const { requested } = this.plane;
    if (this.drag.kind === "turn") {
      const lean = Math.atan2(requested.x - place.x, place.z - requested.z) * DEG;
      requested.lean = degrees(lean);
    } else {
      requested.x = centimetres(place.x + this.drag.dx);
      requested.z = centimetres(place.z + this.drag.dz);
      if (this.along) this.snap(requested);
    }
    this.look(false);
    this.plane.update();
  }

  up(event) {
    if (!this.drag || event.pointerId !== this.drag.id) return;
    this.moved(event);
    const { kind } = this.drag;
    this.drag = null;
    if (kind === "along") this.sendAlong(); else this.send();
  }

  pressed(event) {
    if (event.key === "Escape") { this.cancel(); return; }
    if (event.key === "Enter" && this.plane.requested && !this.drag) { this.send(); return; }
    const step = event.shiftKey ? 0.1 : 0.01;
    const change = {
      ArrowLeft: { x: -step }, ArrowRight: { x: step }, ArrowUp: { z: step }, ArrowDown: { z: -step },
      "[": { lean: -1 }, "]": { lean: 1 }, "{": { lean: -5 }, "}": { lean: 5 },
    }[event.key];
    if (!change || !this.may || this.drag) return;
    event.preventDefault();
    this.plane.svg.classList.remove("by-pointer");
    const requested = this.plane.requested ?? { ...this.model.line };
    this.plane.requested = requested;
    if (change.lean) requested.lean = degrees(requested.lean + change.lean);
    if (change.x) requested.x = centimetres(requested.x + change.x);
    if (change.z) requested.z = centimetres(requested.z + change.z);
    if (this.along && !change.lean) this.snap(requested);
    this.look(true);
    this.plane.update();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.send(), KEYS_MS);
  }

  // The nearest place of the contour: of the site's, or of the measured one where there is no other.
  snap(requested) {
    let best = null;
    const { scene, measured } = this.model;
    for (const part of scene.contour.length ? scene.contour : measured?.contour ?? []) {
      for (let i = 1; i < part.length; i++) {
        const [ax, az] = part[i - 1];
        const [bx, bz] = part[i];
        const length = (bx - ax) ** 2 + (bz - az) ** 2;
        if (!(length > 0)) continue;
        const t = Math.max(0, Math.min(1, ((requested.x - ax) * (bx - ax) + (requested.z - az) * (bz - az)) / length));
        const [x, z] = [ax + t * (bx - ax), az + t * (bz - az)];
        const away = (x - requested.x) ** 2 + (z - requested.z) ** 2;
        if (!best || away < best.away) best = { x, z, away };
      }
    }
    if (best && known(best.x)) [requested.x, requested.z] = [centimetres(best.x), centimetres(best.z)];
  }

  look(now) {
    const time = performance.now();
    clearTimeout(this.later);
    if (!now && time - this.looked < LOOKS_MS) {
      this.later = setTimeout(() => { if (this.plane.requested) this.look(true); }, LOOKS_MS);
      return;
    }
    this.looked = time;
    this.ask("look", this.plane.requested);
  }

  send() {
    clearTimeout(this.timer);
    clearTimeout(this.later);
    const { requested } = this.plane;
    this.plane.requested = null;
    if (requested && this.may) this.ask("move", { ...requested, at: Date.now() / 1000 });
    this.plane.update();
  }

  // A point that is dragged is a point to be held.
  sendAlong() {
    const along = this.plane.requestedAlong;
    this.plane.requestedAlong = null;
    const { TGL_ALONG: before, TGL_HOLD: holds } = this.model.parameters;
    if (along !== null && along !== before && this.may) {
      this.ask("set", { name: "TGL_ALONG", value: along });
      if (!(holds > 0)) this.ask("set", { name: "TGL_HOLD", value: 1 });
    }
    this.plane.update();
  }

  cancel() {
    clearTimeout(this.timer);
    clearTimeout(this.later);
    if (this.plane.requested) this.ask("drop");
    this.drag = null;
    this.plane.requested = null;
    this.plane.requestedAlong = null;
    this.plane.update();
  }
}

// What is done to the line where it is taken; undefined: it is not taken there.
const kindOf = (target) => ({ "point-handle": "move", "line-grip": "move", "lean-handle": "turn", "along-handle": "along" })[target.id];

const degrees = (lean) => Math.round(Math.max(-60, Math.min(60, lean)) * 10) / 10;
const centimetres = (value) => Math.round(value * 100) / 100;
