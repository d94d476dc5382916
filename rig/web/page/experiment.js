// What became of the vibration: its amplitude in stretches of a run, and a sentence of it.

import { called, number, quantity, scaled } from "/page/dom.js";
import { said, t } from "/page/text.js";

const FRAMES = 20; // of a stretch: about one second of the viewer's time, at any pace
const CALM = 0.05; // of the largest amplitude, below which it is quiet
const FAINT = 0.01; // of the speed of the surface: an amplitude below is no vibration
const CHANGES = ["parameter", "knock", "connected", "disconnected", "step"]; // kinds of events that can be the cause

/** An event in words: a value with its name and unit. */
export function inWords({ kind, text, data }, { setup, values }) {
  if (kind !== "parameter" || !data?.set) return said(text) || said(kind);
  return Object.entries(data.set).map(([key, value]) => `${called(key, setup.hands)} ${quantity(value, values.find((one) => one.key === key)?.unit)}`).join(", ");
}

/** The amplitude (half of peak to peak) of the velocity, or of the first output, stretch by stretch. */
export class Amplitude {
  constructor(setup) {
    const names = setup.outputs.map(({ name }) => name);
    this.output = Math.max(names.indexOf(setup.portrait?.[1]), 0);
    this.surface = names.indexOf("surface_speed");
    this.unit = setup.outputs[this.output]?.unit ?? "";
    this.stretches = []; // {from, size}
    this.moves = 0; // largest speed of the surface
    this.begin(null);
  }

  /** Whether the frames begin at the begin of the run: a page that is opened later does not know what was before. */
  get whole() { return 2 * this.stretches[0].from <= (this.stretches[1]?.from ?? this.from); }

  begin(from) { [this.from, this.low, this.high, this.count] = [from, Infinity, -Infinity, 0]; }

  push({ t: ends, low, high }) {
    this.from ??= ends[0];
    for (let i = 0; i < ends.length; i += 1) {
      if (low[this.output][i] === null) continue;
      [this.low, this.high] = [Math.min(this.low, low[this.output][i]), Math.max(this.high, high[this.output][i])];
      if (this.surface >= 0) this.moves = Math.max(this.moves, Math.abs(high[this.surface][i]));
    }
    this.count += 1;
    if (this.count < FRAMES) return;
    this.stretches.push({ from: this.from, size: Math.max(this.high - this.low, 0) / 2 });
    this.begin(ends.at(-1));
  }
}

/** The sentence: quiet since when and after what, or how much it vibrates; "" as long as nothing can be told. */
export function sentence(store) {
  const { stretches, unit, moves } = store.amplitude ?? { stretches: [] };
  if (!stretches.length) return "";
  const most = Math.max(...stretches.map(({ size }) => size)), last = stretches.at(-1).size;
  const vibrates = ({ size }) => size > Math.max(CALM * most, FAINT * moves);
  const [factor, written] = scaled(unit, most), told = (size) => number(size * factor, 2);
  const until = stretches.findLastIndex(vibrates), since = stretches[until + 1]?.from;
  if (until < 0) return store.amplitude.whole ? t("quiet all the time") : t("quiet since {time} s", { time: number(stretches[0].from, 3) });
  const cause = (from) => store.events.findLast(({ t: at, kind, text }) => at <= from && at > 0 && CHANGES.includes(kind) && !text.startsWith("hold")); // to hold changes nothing
  if (since === undefined) {
    const calm = stretches.findLastIndex((one) => !vibrates(one)), event = calm >= 0 ? cause(stretches[calm + 2]?.from ?? store.t) : null;
    return [t("vibrates: amplitude {size} {unit}", { size: told(last), unit: written }), event ? t("after {cause}", { cause: inWords(event, store) }) : ""].filter(Boolean).join(", ");
  }
  const event = cause(since), change = t("quiet since {time} s: amplitude {before} to {after} {unit}", { time: number(since, 3), before: told(most), after: told(last), unit: written });
  return event ? `${change}, ${t("after {cause}", { cause: inWords(event, store) })}` : change;
}
