// Branches and maps of the chosen scene, below the slider of their value: stable and unstable motions over one value, or
// where the rig slides and vibrates, over one or two; the boundaries, and a dot for the present state.

import { post } from "/page/api.js";
import { axis } from "/page/axis.js";
import { attempting, called, data, h, number, put, quantity, scaled, words, written } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";
import { ink, sized, ticks } from "/page/plot.js";
import { REGIONS } from "/page/regions.js";
import { said, t } from "/page/text.js";

const left = 54, bottom = 18, edge = 6; // [px] about the picture
const LATELY = 1; // [s] of the run of which the extremes are shown

export function create(bench) {
  const { store } = bench;
  const canvas = h("canvas", { id: "branches-picture", role: "img", "aria-label": t("branches and the present state"), hidden: true });
  const list = h("select", { id: "branches-list", "aria-label": t("branches over"), hidden: true, onchange: () => bench.redraw() });
  const note = h("div", { class: "small soft", id: "branches-note" }), differs = h("div", { class: "small doubtful", id: "branches-differ" });
  const legend = h("div", { class: "row small" });
  const fault = data("div", { class: "fault pre", id: "branches-fault", role: "alert" });
  const attempt = attempting(fault);
  const over = axis(bench, "branches", t("branches over"));
  let known = [], asked = "";

  const inWords = (one) => called(one, bench.chosen().form?.hands);

  const valueOf = (name) => bench.chosen().form?.sections.flatMap(({ values }) => values).find((one) => one.key === name)?.value;
  const liveOf = (name) => (store.active ? store.values.find((one) => one.key === name) : undefined);
  const valueNow = (name) => liveOf(name)?.value ?? valueOf(name);
  const jobs = jobsOf(["branches"], attempt, fill);
  jobs.element.id = "branches-jobs";
  const compute = () => attempt(async () => {
    const { scene, changes } = bench.chosen();
    await post("/api/studies/work", { what: "branches", scene, changes, x: over.text() });
    jobs.look();
  });

  /** The branches that are there for the chosen scene with its values. */
  async function fill() {
    const { scene, changes, form } = bench.chosen();
    if (!form) return;
    await attempt(async () => {
      known = await post("/api/studies/beside", { scene, changes });
      list.replaceChildren(...known.map((one, i) => h("option", { value: i },
        one.regions ? `${t("map")}: ${one.axes.map(({ key: over }) => inWords(over)).join(" × ")}` : `${t(words(one.output))} / ${inWords(one.key)}`)));
      list.hidden = known.length < 2;
      canvas.hidden = !known.length;
      note.textContent = known.length ? "" : t("no map yet for these values");
    });
    over.fill();
    bench.redraw();
  }

  /** Value of the parameter, extremes and latest value of the output, as far as they are known. */
  function present({ key, output }) {
    const at = valueNow(key), curve = store.outputs[output];
    if (!liveOf(key) || !curve) return { at };
    let low = Infinity, high = -Infinity;
    for (let i = curve.t.length - 1; i >= 0 && curve.t[i] > store.t - LATELY; i -= 1) {
      if (curve.low[i] === null) continue;
      [low, high] = [Math.min(low, curve.low[i]), Math.max(high, curve.high[i])];
    }
    return { at, low, high, now: store.latest.v[store.setup.outputs.findIndex(({ name }) => name === output)] };
  }

  /** Draw branches; returns what to say of them. */
  function branches(shown) {
    const { pen, width, height } = sized(canvas, 210), here = present(shown);
    const points = shown.branches.flatMap((one) => one.points), ends = points.flatMap(([, low, high]) => [low, high]);
    if (here.low <= here.high) ends.push(here.low, here.high);
    const low = Math.min(...ends), high = Math.max(...ends), most = Math.max(...points.map(([, , , stick]) => stick)) || 1, [a, b] = shown.range;
    const x = (value) => left + ((value - a) / (b - a)) * (width - left - edge);
    const y = (value) => edge + ((high - value) / (high - low || 1)) * (height - edge - bottom);
    pen.font = "11px system-ui, sans-serif";
    [pen.fillStyle, pen.strokeStyle, pen.textAlign, pen.textBaseline] = [ink().soft, ink().line, "right", "middle"];
    pen.beginPath();
    const [scale, unit] = scaled(shown.output_unit, Math.max(Math.abs(low), Math.abs(high)));
    for (const tick of ticks(low * scale, high * scale, 4)) { pen.moveTo(left, y(tick / scale)); pen.lineTo(width - edge, y(tick / scale)); pen.fillText(number(tick, 3), left - 4, y(tick / scale)); }
    pen.textAlign = "center";
    for (const tick of ticks(a, b, width / 90)) { pen.moveTo(x(tick), edge); pen.lineTo(x(tick), height - bottom); pen.fillText(number(tick, 4), x(tick), height - 8); }
    pen.stroke();
    for (const { kind, points: line } of shown.branches) {
      for (const side of [1, 2]) {
        let way = 0;
        for (let i = 1; i < line.length; i += 1) {
          const [p, q] = [line[i - 1], line[i]], stable = p[4] && q[4];
          pen.strokeStyle = kind === "sliding" ? ink().text : `hsl(${265 - (195 * (p[3] + q[3])) / 2 / most} 65% 58%)`;
          pen.lineWidth = kind === "sliding" ? 1.2 : 2;
          pen.setLineDash(stable ? [] : [5, 4]);
          pen.lineDashOffset = way; // the dashes go on over the points
          pen.beginPath();
          pen.moveTo(x(p[0]), y(p[side])); pen.lineTo(x(q[0]), y(q[side]));
          pen.stroke();
          way += Math.hypot(x(q[0]) - x(p[0]), y(q[side]) - y(p[side]));
        }
      }
    }
    pen.setLineDash([]);
    [pen.strokeStyle, pen.lineWidth] = [ink().text, 1.3];
    let free = left; // [px] where there is room for a name
    for (const [name, value, ...pair] of shown.specials.toSorted((one, other) => one[1] - other[1])) { // the boundaries that are crossed
      pen.setLineDash([2, 4]); pen.beginPath(); pen.moveTo(x(value), edge); pen.lineTo(x(value), height - bottom); pen.stroke(); pen.setLineDash([]);
      const half = pen.measureText(said(name)).width / 2 + 3, place = Math.min(Math.max(x(value), free + half), width - edge - half);
      if (place - half >= free && Math.abs(place - x(value)) <= half) { pen.fillText(said(name), place, edge + 5); free = place + half; }
      for (const one of pair) { pen.strokeRect(x(value) - 3, y(one) - 3, 6, 6); }
    }
    if (a <= here.at && here.at <= b) {
      pen.strokeStyle = pen.fillStyle = "#d55e00";
      pen.beginPath();
      if (here.low <= here.high) { pen.moveTo(x(here.at), y(here.low)); pen.lineTo(x(here.at), y(here.high)); }
      else { pen.moveTo(x(here.at), edge); pen.lineTo(x(here.at), height - bottom); }
      pen.stroke();
      if (Number.isFinite(here.now)) { pen.beginPath(); pen.arc(x(here.at), y(here.now), 4.5, 0, 2 * Math.PI); pen.fill(); }
    }
    const specials = shown.specials.map(([name, value]) => t("{name} at {value}", { name: said(name), value: quantity(value, shown.unit, 5) })).join(", ");
    const at = quantity(here.at, shown.unit);
    const state = here.low <= here.high ? t("dot: the run at {at}, with its extremes of the last second", { at }) : t("line: {at}", { at });
    const up = t("up: {key}", { key: `${t(words(shown.output))}${unit && ` [${unit}]`}` });
    return [specials, t("full: stable, dashed: unstable, from violet (slip) to yellow (stick)"), state, up].filter(Boolean).join("; ");
  }

  /** Draw a map: the region of each point, the boundaries between them, the present values; returns what to say of it. */
  function map({ axes: [over, up], regions }) {
    const { pen, width, height } = sized(canvas, up ? 210 : 80), many = over.values.length, [a, b] = [over.values[0], over.values.at(-1)];
    const [c, d] = up ? [up.values[0], up.values.at(-1)] : [0, 1];
    const x = (value) => left + ((value - a) / (b - a)) * (width - left - edge), y = (value) => edge + ((d - value) / (d - c)) * (height - edge - bottom);
    const mid = (values, i, place) => place(i <= 0 ? values[0] : i >= values.length ? values.at(-1) : (values[i - 1] + values[i]) / 2);
    const row = (i) => (up ? mid(up.values, i, y) : [y(0), y(1)][i]);
    regions.forEach((line, j) => line.forEach((region, i) => {
      const [from, to, low, high] = [mid(over.values, i, x), mid(over.values, i + 1, x), row(j), row(j + 1)];
      pen.fillStyle = REGIONS[region][0];
      pen.fillRect(from, high, to - from + 0.5, low - high + 0.5);
      pen.fillStyle = ink().text;
      if (i && line[i - 1] !== region) pen.fillRect(from - 0.8, high, 1.6, low - high);
      if (j && regions[j - 1][i] !== region) pen.fillRect(from, low - 0.8, to - from, 1.6);
    }));
    [pen.font, pen.fillStyle, pen.textAlign, pen.textBaseline] = ["11px system-ui, sans-serif", ink().soft, "center", "middle"];
    for (const tick of ticks(a, b, width / 90)) pen.fillText(number(tick, 4), Math.min(x(tick), width - 12), height - 8);
    pen.textAlign = "right";
    for (const tick of up ? ticks(c, d, 4) : []) pen.fillText(number(tick, 3), left - 4, y(tick));
    const [at, height0] = [over, up].map((axis) => (axis ? valueNow(axis.key) : 0.5));
    const nearest = (values, value) => values.reduce((best, one, i) => (Math.abs(one - value) < Math.abs(values[best] - value) ? i : best), 0);
    const inside = a <= at && at <= b && c <= height0 && height0 <= d, column = nearest(over.values, at);
    const line = regions[up ? nearest(up.values, height0) : 0], region = line[column];
    if (inside) {
      pen.beginPath(); pen.arc(x(at), y(height0), 6, 0, 2 * Math.PI);
      [pen.fillStyle, pen.strokeStyle, pen.lineWidth] = ["#d55e00", "#fff", 2];
      pen.fill(); pen.stroke();
    }
    const next = [-1, 1].map((way) => { // the boundaries on both sides of the present value
      for (let i = column; i + way >= 0 && i + way < many; i += way) if (line[i + way] !== region) return quantity((over.values[i] + over.values[i + way]) / 2, over.unit, 3);
      return "";
    }).filter(Boolean);
    const where = [over, up].filter(Boolean).map((axis) => `${inWords(axis.key)} ${quantity(valueNow(axis.key), axis.unit)}`).join(", ");
    return [inside ? t("dot: {where}, {region}", { where, region: REGIONS[region][1] }) : t("the present values are outside of the map: {where}", { where }),
      inside && next.length ? t("boundaries of {key} near {places}", { key: inWords(over.key), places: next.join(", ") }) : "", up ? t("up: {key}", { key: `${inWords(up.key)}${up.unit === "1" ? "" : ` [${written(up.unit)}]`}` }) : ""].filter(Boolean).join("; ");
  }

  function draw() {
    const { scene, changes, form, good } = bench.chosen?.() ?? {}, text = JSON.stringify([scene, changes]);
    if (form && good && text !== asked) { asked = text; fill(); }
    const shown = bench.shown.setup && bench.shown.setup.scene !== scene ? null : known[list.value]; // another scene waits for the next run
    if (!shown) { put(differs, ""); legend.replaceChildren(); legend.of = null; return; }
    put(note, shown.regions ? map(shown) : branches(shown));
    if (legend.of !== shown) {
      legend.of = shown;
      legend.replaceChildren(...[...new Set(shown.regions?.flat())].map((one) => h("span", {}, h("span", { class: "key", style: `background-color:${REGIONS[one][0]}` }), REGIONS[one][1])));
    }
    bench.place(shown.key, block, shown.range);
    const other = store.active ? store.values.filter(({ key: name, value }) => name !== shown.key && name !== shown.axes?.[1]?.key && typeof shown.values[name] === "number"
      && Math.abs(value - shown.values[name]) > 1e-9 * Math.abs(value)) : [];
    put(differs, other.length ? `${t("the run has other values:")} ${other.map((one) => `${inWords(one.key)} ${number(one.value)} ≠ ${quantity(shown.values[one.key], one.unit)}`).join("; ")}` : "");
  }

  const block = h("div", { class: "stack", style: "gap: .2rem" }, list, canvas, legend, note, differs);
  return {
    element: h("div", { class: "stack" }, block, h("details", {}, h("summary", {}, t("Draw the map of a value: where it slides, sticks, vibrates")),
      over.element, h("button", { onclick: compute, id: "branches-compute",
        title: t("stable and unstable motions; most rigs take seconds") }, t("Compute"))), fault, jobs.element),
    draw,
    state: () => bench.redraw(),
  };
}
