// One time axis for the states of the contacts, the curves and the events: a cursor with its values, zoom, a pause of the view.
//
// `source()` is the store that is shown, `other()` a second one whose curves lie pale behind it. True values are lines,
// measurements are dots.

import { data, h, number, put, scaled, words } from "/page/dom.js";
import { inWords } from "/page/experiment.js";
import { band, ink, sized, ticked, ticks } from "/page/plot.js";
import { said, t } from "/page/text.js";

const FIRST = 3; // plots that are shown at first
const LANE = 92, EVENTS = 40, AXIS = 20, LEFT = 62, RIGHT = 8; // [px]
const STRIP = 20, ALL = 150; // [px] of the strip of one contact, and of many
const LEAST = 1e-3; // [s] that are shown
const SHRINKS = 1; // [s] of the viewer's time: the axis of a value adapts to smaller ones as fast as this
const QUIET = new Set(["contact", "state", "verdict"]); // kinds of events that are no marks

const MEANING = { stick: t("nothing slides"), "slip+": t("the surface is faster"), "slip-": t("the body is faster"), open: t("no contact") };

export function create(source, redraw, { whole = false, other = () => null, moved = () => {} } = {}) {
  const canvas = h("canvas", { id: whole ? "recorded" : "timeline", tabIndex: 0, role: "img", hidden: true,
    "aria-label": t("contacts, curves and events over time; arrow keys move the cursor, + and - zoom") });
  const empty = h("div", { class: "empty" }, t("Curves, contacts and events appear here when the rig moves."));
  const chips = h("div", { class: "chips", role: "group", "aria-label": t("channels") });
  const legend = h("div", { class: "row small soft" }); // of the states of contacts
  const readout = h("output", { class: "small", id: whole ? "recorded-readout" : "readout" });
  const contact = h("span", { id: whole ? "recorded-contact" : "contact" });
  const hold = h("button", { id: whole ? "recorded-hold" : "hold", "aria-pressed": "false", hidden: whole, onclick: () => freeze(end === null) }, t("Hold the view"));
  let plots = [], span = 5, end = null, cursor = null, lanes = [], before = null, dragged = null;

  const zoom = (factor) => {
    const [t0, t1] = range(), middle = cursor ?? t1;
    const next = Math.min(Math.max((t1 - t0) * factor, LEAST), whole ? source().t : source().kept);
    if (end !== null) end = Math.min(middle + (t1 - middle) * (next / (t1 - t0)), whole ? source().t : Infinity);
    span = next;
    redraw();
  };
  let waits = false;
  /** Draw once more, though nothing comes, while an axis adapts. */
  function later() {
    if (waits) return;
    waits = true;
    setTimeout(() => { waits = false; redraw(); }, 100);
  }

  const freeze = (on) => { end = on ? source().t : null; hold.setAttribute("aria-pressed", String(on)); redraw(); };
  const button = (text, label, action) => h("button", { "aria-label": label, title: label, translate: "no", onclick: action }, text);

  function range() {
    const last = end ?? (source().t || LEAST), first = Math.max(last - span, 0);
    return [first, Math.max(last, first + Math.min(span, whole ? LEAST : source().t || LEAST))];
  }

  function set(time) { cursor = time; moved(time); redraw(); }

  const timeAt = (event) => { const [t0, t1] = range(); return t0 + ((event.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT)) * (t1 - t0); };
  canvas.addEventListener("pointermove", (event) => {
    if (dragged && Math.abs(event.offsetX - dragged.x) > 3 && !whole) {
      if (end === null) freeze(true);
      end = Math.max(dragged.end - timeAt(event) + timeAt({ offsetX: dragged.x }), span);
    }
    if (!whole || event.buttons) set(Math.min(Math.max(timeAt(event), 0), source().t));
  });
  canvas.addEventListener("pointerdown", (event) => { dragged = { x: event.offsetX, end: end ?? source().t }; set(Math.min(Math.max(timeAt(event), 0), source().t)); });
  addEventListener("pointerup", () => { dragged = null; });
  canvas.addEventListener("pointerleave", () => { if (!whole && document.activeElement !== canvas) set(null); }); // keys hold the cursor
  canvas.addEventListener("wheel", (event) => { if (event.ctrlKey) { event.preventDefault(); zoom(event.deltaY > 0 ? 1.25 : 0.8); } }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const [t0, t1] = range(), step = (t1 - t0) / 100;
    const action = { ArrowLeft: () => set(Math.max((cursor ?? t1) - step, 0)), ArrowRight: () => set(Math.min((cursor ?? t1) + step, source().t)),
      "+": () => zoom(0.5), "-": () => zoom(2), Escape: () => set(whole ? 0 : null) }[event.key];
    if (action) { event.preventDefault(); action(); }
  });

  function chip(channel) {
    const toggle = h("button", { "aria-pressed": String(channel.on), onclick: () => {
      channel.on = !channel.on;
      toggle.setAttribute("aria-pressed", String(channel.on));
      redraw();
    } }, h("span", { class: channel.measured ? "key measured" : "key", style: `background-color:${channel.measured ? "transparent" : channel.colour};--tone:${channel.colour}` }),
    t(words(channel.name)), channel.measured ? ` (${t("measured")})` : "");
    return toggle;
  }

  function setup() {
    const { setup: about } = source();
    canvas.hidden = !about;
    empty.hidden = !canvas.hidden;
    for (const one of [chips, contact, readout, legend]) one.replaceChildren();
    if (!about) return;
    [end, cursor, before] = [whole ? source().t : null, whole ? 0 : null, null];
    if (whole) span = source().t;
    hold.setAttribute("aria-pressed", "false");
    const colour = (name) => about.outputs.find((one) => one.name === name)?.colour || "#56b4e9";
    plots = about.plots.map((plot, i) => ({ title: plot.title.replace(/ *\[.*\]$/, ""), range: null, channels: [
      ...plot.outputs.map((name) => ({ name, measured: false, colour: colour(name), factor: 1, unit: about.outputs.find((one) => one.name === name).unit, on: i < FIRST })),
      ...plot.sensors.map((name) => ({ name, measured: true, colour: about.sensors[name].colour, factor: about.sensors[name].factor,
        unit: plot.outputs.length ? about.outputs.find((one) => one.name === plot.outputs[0]).unit : about.sensors[name].unit, on: i < FIRST }))] }));
    if (about.contacts.length) {
      legend.replaceChildren(...about.modes.map(({ name, colour: of }) => h("span", {}, h("span", { class: "key", style: `background-color:${of}` }), `${said(name)}: ${MEANING[name] ?? ""}`)),
        h("span", {}, t("T: friction force, N: normal force")));
    }
    chips.replaceChildren(...plots.flatMap(({ channels }) => channels.map(chip)));
  }

  const curveOf = (store, { name, measured }) => (measured ? store?.sensors : store?.outputs)?.[name];

  function lane(pen, plot, top, width, t0, t1, x) {
    const shown = plot.channels.filter(({ on }) => on), back = other();
    let [low, high] = [Infinity, -Infinity];
    for (const channel of shown) {
      for (const store of [source(), back]) {
        const ends = (curveOf(store, channel)?.reach(t0, t1) ?? []).map((one) => one * channel.factor).filter(Number.isFinite);
        [low, high] = [Math.min(low, ...ends), Math.max(high, ...ends)];
      }
    }
    const known = low <= high, now = performance.now() / 1000;
    if (known) {
      const margin = 0.08 * (high - low) || Math.abs(high) * 0.08 || 1e-9;
      [low, high] = [low - margin, high + margin];
      if (plot.range && !whole) { // it grows at once and shrinks slowly, so that the picture does not tremble
        const part = 1 - Math.exp((plot.drawn - now) / SHRINKS);
        low = Math.min(low, plot.range[0] + part * (low - plot.range[0]));
        high = Math.max(high, plot.range[1] + part * (high - plot.range[1]));
        if (Math.max(plot.range[1] - high, low - plot.range[0]) > 0.01 * (high - low)) later();
      }
      plot.range = [low, high];
      plot.drawn = now;
    } else [low, high] = plot.range ?? [0, 1]; // nothing is known of this stretch
    const y = (v) => top + 18 + ((high - v) / (high - low)) * (LANE - 24);
    const [scale, unit] = scaled(shown[0].unit, Math.max(Math.abs(low), Math.abs(high)));
    [pen.fillStyle, pen.strokeStyle, pen.textAlign, pen.textBaseline, pen.lineWidth] = [ink().soft, ink().line, "right", "middle", 1];
    pen.beginPath();
    const lines = known || plot.range ? ticks(low * scale, high * scale, 3) : [];
    for (const tick of lines) {
      pen.moveTo(LEFT, y(tick / scale)); pen.lineTo(width - RIGHT, y(tick / scale));
      pen.fillText(ticked(tick, lines), LEFT - 6, y(tick / scale));
    }
    pen.stroke();
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, top, width - LEFT - RIGHT, LANE);
    pen.clip();
    for (const channel of [...shown].reverse()) {
      const place = (v) => y(v * channel.factor);
      if (curveOf(back, channel)) { pen.setLineDash([2, 3]); band(pen, curveOf(back, channel), t0, t1, x, place, ink().soft, channel.measured); pen.setLineDash([]); }
      if (curveOf(source(), channel)) band(pen, curveOf(source(), channel), t0, t1, x, place, channel.colour, channel.measured);
    }
    pen.restore();
    [pen.fillStyle, pen.textAlign] = [ink().text, "left"];
    pen.fillText(`${t(plot.title)}${unit && ` [${unit}]`}`, LEFT + 4, top + 8);
    lanes.push({ scale, unit, shown });
  }

  /** The states of all contacts, as strips; states that follow one another within a span lie below one another. */
  function strips(pen, row, width, t0, t1, x) {
    const { contacts, setup: { contacts: names, modes } } = source(), several = names.length > 1;
    [pen.textAlign, pen.textBaseline] = ["right", "middle"];
    contacts.forEach((curve, i) => {
      pen.fillStyle = ink().soft;
      if (row > 8) pen.fillText(several ? names[i].slice(0, 10) : t("contact"), LEFT - 6, (i + 0.5) * row);
      let last = -Infinity;
      for (let k = Math.max(curve.from(t0), 1); k < curve.t.length; k += 1) {
        const from = Math.max(x(curve.t[k - 1]), LEFT), to = x(curve.t[k]);
        if (to - last < 0.4 && curve.low[k] === curve.low[k - 1]) continue;
        last = to;
        const met = modes.filter((_, mode) => curve.low[k] & (1 << mode)), each = (row - (several ? 1 : 2)) / met.length;
        met.forEach(({ colour }, j) => { pen.fillStyle = colour; pen.fillRect(from, i * row + j * each, Math.min(to, width - RIGHT) - from + 0.7, each); });
        if (curve.t[k] > t1) break;
      }
    });
  }

  function marks(pen, top, width, t0, t1, x) {
    const ends = [-Infinity, -Infinity];
    [pen.textAlign, pen.textBaseline] = ["left", "middle"];
    for (const event of source().events) {
      const { t: at, kind, level } = event;
      if (at < t0 || at > t1 || QUIET.has(kind)) continue;
      pen.strokeStyle = pen.fillStyle = level === "error" ? "#d55e00" : kind === "step" ? ink().soft : ink().curve;
      pen.globalAlpha = 0.35;
      pen.beginPath(); pen.moveTo(x(at), 0); pen.lineTo(x(at), top); pen.stroke();
      pen.globalAlpha = 1;
      pen.beginPath(); pen.moveTo(x(at) - 4, top + 7); pen.lineTo(x(at) + 4, top + 7); pen.lineTo(x(at), top); pen.fill();
      const label = inWords(event, source()).slice(0, 42), size = pen.measureText(label).width;
      const from = Math.min(x(at) - 2, width - RIGHT - size), row = ends.findIndex((end) => end < from - 6);
      if (row >= 0) { pen.fillText(label, from, top + 14 + 13 * row); ends[row] = from + size; }
    }
  }

  function tell() {
    const store = source(), { modes } = store.setup;
    if (cursor === null) { put(readout, ""); return; }
    const values = lanes.flatMap(({ shown, scale, unit }) => shown.map((channel) => {
      const curve = curveOf(store, channel), i = Math.min(curve.from(cursor), curve.t.length - 1), low = curve.low[i], high = curve.high[i];
      const of = (v) => number(v * channel.factor * scale, 3);
      return i < 0 || low === null || low === undefined ? "" : `${t(words(channel.name))}${channel.measured ? ` (${t("measured")})` : ""} ${low === high ? of(low) : `${of(low)} … ${of(high)}`} ${unit}`;
    }));
    const contacts = store.contacts.slice(0, 4).map((curve) => modes.filter((_, mode) => curve.low[curve.from(cursor)] & (1 << mode)).map(({ name }) => said(name)).join("/"));
    const [t0, t1] = range(), near = store.events.filter(({ t: at, kind }) => !QUIET.has(kind) && Math.abs(at - cursor) < (t1 - t0) / 100);
    put(readout, [`t = ${number(cursor, 5)} s`, ...new Set(near.map((event) => inWords(event, store))), ...contacts, ...values].filter(Boolean).join("   "));
  }

  function now() {
    const { latest, contacts: curves, setup: { contacts, modes } } = source();
    const states = whole ? curves.map((curve) => Math.log2(curve.low[Math.min(curve.from(cursor ?? 0), curve.t.length - 1)])) : latest.contacts;
    const named = states.map((one) => modes[Math.floor(one)]?.name ?? "");
    put(contact, contacts.length > 1
      ? modes.map(({ name }) => [named.filter((one) => one === name).length, name]).filter(([count]) => count).map(([count, name]) => `${count} ${said(name)}`).join(", ")
      : said(named[0] ?? ""));
    contact.style.color = whole || contacts.length > 1 ? "" : modes[states[0]]?.colour ?? "";
  }

  function draw() {
    const store = source();
    if (!store?.setup) return;
    const { contacts } = store.setup, row = contacts.length ? Math.max(Math.min(STRIP, ALL / contacts.length), 4) : 0;
    const drawn = plots.filter(({ channels }) => channels.some(({ on }) => on)), strip = row * contacts.length + 4;
    const { pen, width, height } = sized(canvas, strip + LANE * drawn.length + EVENTS + AXIS), [t0, t1] = range();
    const x = (time) => LEFT + ((time - t0) / (t1 - t0)) * (width - LEFT - RIGHT);
    pen.font = "11px system-ui, sans-serif";
    strips(pen, row, width, t0, t1, x);
    lanes = [];
    drawn.forEach((plot, i) => lane(pen, plot, strip + LANE * i, width, t0, t1, x));
    marks(pen, height - EVENTS - AXIS, width, t0, t1, x);
    [pen.fillStyle, pen.strokeStyle, pen.textAlign] = [ink().soft, ink().line, "center"];
    pen.beginPath();
    const instants = ticks(t0, t1, width / 110);
    for (const tick of instants) {
      pen.moveTo(x(tick), strip); pen.lineTo(x(tick), height - AXIS);
      const label = `${ticked(tick, instants)} s`, half = pen.measureText(label).width / 2;
      pen.fillText(label, Math.min(x(tick), width - half), height - AXIS / 2);
    }
    pen.globalAlpha = 0.6; pen.stroke(); pen.globalAlpha = 1;
    if (cursor !== null && cursor >= t0 && cursor <= t1) {
      [pen.strokeStyle, pen.lineWidth] = [ink().text, 1.2];
      pen.beginPath(); pen.moveTo(x(cursor), 0); pen.lineTo(x(cursor), height - AXIS); pen.stroke();
    }
    now();
    tell();
  }

  const spans = whole ? [] : [1, 5, 20, 60].map((s) => button(`${s} s`, t("show the last {span} s", { span: s }), () => { span = s; redraw(); }));
  return {
    element: h("div", { class: "stack" }, h("div", { class: "row small" }, ...spans, button("+", t("zoom in"), () => zoom(0.5)), button("−", t("zoom out"), () => zoom(2)), hold), readout, empty, canvas, legend, chips),
    contact,
    setup,
    draw,
    seek: set,
    at: () => cursor,
  };
}
