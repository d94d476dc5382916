// What the page knows of a run: its setup, title and protocol, curves, events and verdict. Panes read it; `take` and the other
// methods are called for each message.

import { Amplitude } from "/page/experiment.js";
import { Solids } from "/page/solids.js";

const SPAN = 60; // [s] of simulated time that the curves of a run keep
const MOST_EVENTS = 300;

const STEPS = 2000, PORTRAIT = 2; // most steps of the phase portrait, and its longest time [s]

/** Extremes in spans, of the last `kept` seconds: each span ends at its time and begins at the one before; null: not known. */
class Curve {
  constructor(kept) { this.kept = kept; this.t = []; this.low = []; this.high = []; }

  /** Index of the first span that ends at a time or later. */
  from(time) {
    let [low, high] = [0, this.t.length];
    while (low < high) { const middle = (low + high) >> 1; if (this.t[middle] < time) low = middle + 1; else high = middle; }
    return low;
  }

  /** Lowest and highest value from a time to a time; Infinity, -Infinity if nothing is known there. */
  reach(t0, t1) {
    let low = Infinity, high = -Infinity;
    for (let i = this.from(t0); i < this.t.length; i += 1) {
      if (this.low[i] !== null) { low = Math.min(low, this.low[i]); high = Math.max(high, this.high[i]); }
      if (this.t[i] >= t1) break;
    }
    return [low, high];
  }

  /** Add spans, the first of which begins at `from`: what lies between it and the last one is not known. */
  push(from, t, low, high) {
    if (!(from <= this.t.at(-1) + 1e-9)) this.add(from, null, null);
    for (let i = 0; i < t.length; i += 1) this.add(t[i], low[i], high[i]);
    const begin = this.t.at(-1) - this.kept;
    if (this.t.length > 400 && this.t[Math.floor(this.t.length / 2)] < begin) {
      const first = this.from(begin);
      for (const column of [this.t, this.low, this.high]) column.splice(0, first);
    }
  }

  add(t, low, high) { this.t.push(t); this.low.push(low); this.high.push(high); }
}

/** One stretch of the latest steps of the plant, none left out: displacement, velocity, mode. */
class Stretch {
  constructor() { this.end = -1; this.x = []; this.v = []; this.mode = []; }

  push({ from, step, x, v, mode }) {
    if (Math.abs(from - this.end) > step / 2) this.x = this.v = this.mode = []; // it does not follow: a new stretch
    const most = Math.min(STEPS, Math.round(PORTRAIT / step));
    for (const [name, column] of Object.entries({ x, v, mode })) this[name] = this[name].concat(column).slice(-most);
    this.end = from + x.length * step;
    this.seconds = this.x.length * step;
  }
}

export class Store {
  /** `kept`: seconds of the curves that are kept. */
  constructor(kept = SPAN) {
    this.kept = kept;
    this.state = { phase: "idle", lines: [] };
    this.online = false;
    this.why = "no answer yet"; // why it is not connected
    this.values = [];
    this.seat = null; // who operates the run that a class watches, and who asks
    this.clear(null);
  }

  clear(setup) {
    this.setup = setup;
    this.t = 0;
    this.outputs = {}; // name -> Curve
    this.contacts = (setup?.contacts ?? []).map(() => new Curve(this.kept)); // modes of each contact, as bits
    this.steps = new Stretch();
    this.latest = { v: [], contacts: [] }; // values of the outputs and mode of each contact
    this.sensors = {}; // name -> Curve, in the unit of the sensor
    this.health = null;
    this.events = [];
    this.amplitude = setup ? new Amplitude(setup) : null;
    this.status = null; // {verdict, reasons, step} so far
    this.lost = 0; // messages that the server missed
    this.dropped = 0; // frames that this page missed
    this.number = 0;
    this.picture = setup?.picture ? new Solids(setup.picture) : null;
    for (const { name } of setup?.outputs ?? []) this.outputs[name] = new Curve(this.kept);
    for (const name of Object.keys(setup?.sensors ?? {})) this.sensors[name] = new Curve(this.kept);
  }

  take(frame) {
    if (this.setup === null) return;
    if (frame.missed) { this.spans(frame); return; }
    if (this.number) this.dropped += Math.max(frame.n - this.number - 1, 0);
    this.number = frame.n;
    this.t = frame.t;
    this.lost = frame.lost;
    if (frame.picture) this.picture?.move(frame.picture);
    if (frame.now) this.latest = frame.now;
    this.spans(frame);
    if (frame.portrait) this.steps.push(frame.portrait);
    if (frame.health) this.health = frame.health;
    this.hear(frame.events ?? []);
  }

  /** The extremes of outputs, contacts and sensors in the spans of a frame. */
  spans({ rows, meas = {} }) {
    if (rows) {
      const { from, t, low, high, contacts } = rows;
      this.setup.outputs.forEach(({ name }, i) => this.outputs[name].push(from, t, low[i], high[i]));
      this.contacts.forEach((curve, i) => curve.push(from, t, contacts[i], contacts[i]));
      this.amplitude.push(rows);
    }
    for (const [name, { from, t, low, high }] of Object.entries(meas)) this.sensors[name]?.push(from, t, low, high);
  }

  /** Add events; one that is there came both with a frame and with the list of former ones. */
  hear(events) {
    const id = ({ t, source, kind, text }) => `${t} ${source} ${kind} ${text}`, known = new Set(this.events.map(id));
    this.events.push(...events.filter((event) => !known.has(id(event))));
    this.events.splice(0, this.events.length - MOST_EVENTS);
  }

  /** The timing verdict: at the end of the run, or so far; "" if the run does not follow the clock. */
  get verdict() { return this.state.outcome?.verdict ?? this.status?.verdict ?? ""; }

  get active() { return !["idle", "ended"].includes(this.state.phase); }
}
