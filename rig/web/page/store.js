// What the page knows of the present run. Panes read it; `take` and the other methods are called for each message.

import { Solids } from "/page/solids.js";

const SPAN = 10; // [s] of simulated time that curves keep
const MOST_EVENTS = 300;

/** A curve: times and values of the last SPAN seconds, cut now and then. */
class Curve {
  constructor() { this.t = []; this.v = []; }

  push(t, v) {
    for (let i = 0; i < t.length; i += 1) { this.t.push(t[i]); this.v.push(v[i]); }
    const from = this.t[this.t.length - 1] - SPAN;
    if (this.t.length > 400 && this.t[Math.floor(this.t.length / 2)] < from) {
      const first = this.t.findIndex((one) => one >= from);
      this.t.splice(0, first);
      this.v.splice(0, first);
    }
  }
}

export class Store {
  constructor() {
    this.state = { phase: "idle", lines: [] };
    this.online = false;
    this.why = "no answer yet"; // why it is not connected
    this.values = [];
    this.clear(null);
  }

  clear(setup) {
    this.setup = setup;
    this.t = 0;
    this.outputs = {}; // name -> Curve
    this.modes = new Curve();
    this.contacts = (setup?.contacts ?? []).map(() => new Curve()); // indices of contact states
    this.sensors = {}; // name -> Curve, in the unit of the sensor
    this.health = null;
    this.commands = {};
    this.events = [];
    this.status = null; // {verdict, reasons, step} so far
    this.lost = 0; // messages that the server missed
    this.dropped = 0; // frames that this page missed
    this.number = 0;
    this.picture = setup?.picture ? new Solids(setup.picture) : null;
    for (const { name } of setup?.outputs ?? []) this.outputs[name] = new Curve();
    for (const name of Object.keys(setup?.sensors ?? {})) this.sensors[name] = new Curve();
  }

  take(frame) {
    if (this.setup === null) return;
    if (this.number) this.dropped += Math.max(frame.n - this.number - 1, 0);
    this.number = frame.n;
    this.t = frame.t;
    this.lost = frame.lost;
    if (frame.picture) this.picture?.move(frame.picture);
    if (frame.rows) {
      this.setup.outputs.forEach(({ name }, i) => this.outputs[name].push(frame.rows.t, frame.rows.v[i]));
      this.modes.push(frame.rows.t, frame.rows.mode);
      this.contacts.forEach((curve, i) => curve.push(frame.rows.t, frame.rows.contacts[i]));
    }
    for (const [name, { t, v }] of Object.entries(frame.meas ?? {})) this.sensors[name]?.push(t, v);
    Object.assign(this.commands, frame.commands ?? {});
    if (frame.health) this.health = frame.health;
    this.hear(frame.events ?? []);
  }

  hear(events) {
    this.events.push(...events);
    this.events.splice(0, this.events.length - MOST_EVENTS);
  }

  /** Latest value of an output; NaN before the first one. */
  now(name) {
    const curve = this.outputs[name];
    return curve && curve.v.length ? curve.v[curve.v.length - 1] ?? NaN : NaN;
  }

  /** The timing verdict: at the end of the run, or so far; "" if the run does not follow the clock. */
  get verdict() { return this.state.outcome?.verdict ?? this.status?.verdict ?? ""; }

  get active() { return !["idle", "ended"].includes(this.state.phase); }
}
