// A recording in the place of a flight: a slider puts the model where the flight was.

import { $, minutes } from "./dom.js";
import { HISTORY_S } from "./model.js";

export class Replay {
  constructor(recording, model, onChange) {
    this.recording = recording;
    this.model = model;
    this.onChange = onChange;
    this.playing = false;
    this.time = 0;
    model.alive = true;
    model.connected = true;
    model.parameters = recording.parameters;
    $("replay").hidden = false;
    const slider = $("slider");
    slider.max = recording.duration_s;
    slider.addEventListener("input", () => { this.playing = false; this.go(Number(slider.value)); });
    $("play").addEventListener("click", () => this.play(!this.playing));
    this.go(0);
  }

  play(is) {
    this.playing = is;
    if (!is) { this.go(this.time); return; }
    if (this.time >= this.recording.duration_s) this.time = 0;
    let before = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.time += ((now - before) / 1000) * Number($("speed").value);
      before = now;
      if (this.time >= this.recording.duration_s) this.playing = false;
      this.go(Math.min(this.time, this.recording.duration_s));
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  go(time) {
    const { rows, texts } = this.recording;
    this.time = time;
    const step = rows[1][0] - rows[0][0];
    const last = Math.min(rows.length - 1, Math.floor(time / step + 1e-6));
    const first = Math.max(0, Math.floor((time - HISTORY_S) / step));
    const thin = Math.max(1, Math.floor((last - first) / 300));
    const { model } = this;
    model.rows = rows.slice(first, last + 1).filter((_, i) => (last - first - i) % thin === 0);
    model.now = Object.fromEntries(model.scene.rows.map((name, i) => [name, rows[last][i] ?? NaN]));
    model.texts = texts.filter((text) => text.time <= time).map((text, i) => ({ ...text, first: i, severity: 6 }));
    model.time = time;
    $("slider").value = time;
    $("clock").textContent = `${minutes(time)} / ${minutes(this.recording.duration_s)}`;
    $("play").textContent = this.playing ? "⏸" : "▶";
    this.onChange();
  }
}
