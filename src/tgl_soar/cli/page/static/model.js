// What the page knows: the last of everything, rows of the last minute, texts.
// A flight fills it by frames, a recording by its slider; what draws does not know which.

export const HISTORY_S = 60;
// Of a mode by its name: its level to who watches, and whether the module is in control.
export const MODES = {
  ready: { level: "good", flying: false },
  capturing: { level: "warn", flying: true },
  soaring: { level: "good", flying: true },
  holding: { level: "warn", flying: true },
  recovering: { level: "bad", flying: true },
  released: { level: "bad", flying: false },
  failed: { level: "bad", flying: false },
  searching: { level: "warn", flying: true },
  launching: { level: "warn", flying: true },
  "breaking off": { level: "bad", flying: true },
  landing: { level: "warn", flying: true },
  beating: { level: "warn", flying: true },
};
const NOTICES = 50; // that wait to be shown: a window in the background draws nothing

export class Model {
  constructor(scene) {
    this.scene = scene;
    this.columns = Object.fromEntries(scene.rows.map((name, i) => [name, i]));
    this.now = {};
    this.parameters = {};
    this.rows = [];
    this.texts = [];
    this.notices = [];
    this.ghost = null;
    this.measured = null; // the air as the module measured it
    this.holder = 0;
    this.holderName = "";
    this.you = -1;
    this.alive = false;
    this.silence_s = null;
    this.connected = false;
    this.starts = 0;
    this.undo = 0;
    this.busy = false;
    this.received = 0;
    this.sent = 0;
    this.pages = 0;
    this.time = null; // of a recording
  }

  get isRecording() { return this.scene.source === "recording"; }
  get mode() {
    const number = this.now.soar_mode;
    return Number.isInteger(number) ? (this.scene.modes[number] ?? `mode ${number}`) : null;
  }
  get flying() { return MODES[this.mode]?.flying ?? false; }
  get line() {
    const [p, now] = [this.parameters, this.now];
    const line = this.isRecording // its parameters are those of its beginning
      ? { x: now.line_x, z: now.line_z, lean: now.line_lean }
      : { x: p.TGL_X, z: p.TGL_Z, lean: p.TGL_LEAN };
    return Object.values(line).every(Number.isFinite) ? line : null;
  }
  get heldByOther() { return this.holder !== 0 && this.holder !== this.you; }

  // A frame of the server's.
  apply(frame) {
    if ("you" in frame) this.you = frame.you;
    if (frame.whole) {
      this.rows = [];
      this.texts = [];
      this.now = {};
      this.parameters = {};
    }
    merge(this.now, frame.now);
    merge(this.parameters, frame.parameters);
    for (const [theirs, ours] of [["ghost", "ghost"], ["measured", "measured"], ["holder", "holder"],
      ["holder_name", "holderName"], ["alive", "alive"], ["silence_s", "silence_s"],
      ["starts", "starts"], ["undo", "undo"], ["busy", "busy"], ["received", "received"],
      ["sent", "sent"], ["pages", "pages"]]) {
      if (theirs in frame) this[ours] = frame[theirs];
    }
    if (frame.rows) {
      this.rows.push(...frame.rows);
      const first = this.rows[this.rows.length - 1][0] - HISTORY_S;
      const old = this.rows.findIndex((row) => row[0] >= first);
      if (old > 0) this.rows.splice(0, old);
    }
    for (const text of frame.texts ?? []) {
      const i = this.texts.findIndex((other) => other.first === text.first);
      if (i >= 0) this.texts[i] = text; else this.texts.push(text);
    }
    if (this.texts.length > 200) this.texts.splice(0, this.texts.length - 200);
    this.notices.push(...(frame.notices ?? [])); // whoever shows them takes them away
    if (this.notices.length > NOTICES) this.notices.splice(0, this.notices.length - NOTICES);
  }

  column(name) {
    const i = this.columns[name];
    return this.rows.map((row) => row[i]);
  }
}

function merge(into, change) {
  for (const [name, value] of Object.entries(change ?? {})) {
    if (value === null) into[name] = NaN; else into[name] = value;
  }
}
