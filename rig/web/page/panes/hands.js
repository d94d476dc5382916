// Values by hand, before a run and in it, by the checks of the command line: the few that matter for the rig as sliders, the
// others behind a search; owned actuators; controllers.

import { get } from "/page/api.js";
import { called, data, h, number, put, quantity, typed, words, written } from "/page/dom.js";
import { REGIONS, background, told } from "/page/regions.js";
import { said, t } from "/page/text.js";

const EVERY = 100; // [ms] between two values of a slider that is being moved
const STEPS = 1000; // of a slider
const MOST = 6; // sliders beside the search
const LATE = 2000; // [ms] after the answer to a change, in which values may still come that were read before it

/** The value at a place from 0 to STEPS of a slider {low, high, least}; with `least` its scale is logarithmic beside 0. */
export function valueAt({ low, high, least }, place) {
  if (!least) return low + ((high - low) * place) / STEPS;
  const zero = zeroOf({ low, high }), from = place - zero, end = from < 0 ? -low : high, room = from < 0 ? zero : STEPS - zero;
  return from === 0 ? 0 : Math.sign(from) * least * (end / least) ** (Math.abs(from) / room);
}

/** The place of a value; see `valueAt`. */
export function placeOf({ low, high, least }, value) {
  if (!least) return (STEPS * (value - low)) / (high - low);
  const zero = zeroOf({ low, high }), end = value < 0 ? -low : high, room = value < 0 ? zero : STEPS - zero;
  return Math.abs(value) < least ? zero : zero + Math.sign(value) * room * (Math.log(Math.abs(value) / least) / Math.log(end / least));
}

const maps = await get("/page/slider_maps.json").catch(() => ({})); // scene -> key -> map; without them sliders still work

const shortened = (value) => (Math.abs(value) >= 1e5 ? value.toExponential(0) : number(value, 2));

const zeroOf = ({ low, high }) => (low >= 0 ? 0 : high <= 0 ? STEPS : STEPS / 2);

export function create(bench) {
  const { store } = bench;
  const fault = h("div", { class: "fault", id: "touch-fault", role: "alert" });
  const controllers = h("div", { class: "stack" }), first = h("div"), sections = h("div", { id: "sections" });
  const find = h("input", { type: "search", id: "find", placeholder: t("find a value: mass, gain, rate"), "aria-label": t("find a value"), style: "width: 100%; margin-bottom: .5rem", oninput: sift });
  const legend = h("div", { class: "row small soft" }, ...["I", "II", "III"].map((region) =>
    h("span", {}, h("span", { class: "key", style: `background-color:${REGIONS[region][0]}` }), REGIONS[region][2])));
  const back = h("button", { class: "small", id: "back", hidden: true, onclick: () => restore() }, t("Back to the scene's values"));
  const count = h("span", {}), rest = h("details", { id: "all" }, h("summary", {}, count), find, sections);
  const box = h("div", { id: "values", "aria-busy": "true" }, first, rest);
  const rows = new Map(), before = new Map(); // before: values of the run before they were changed here
  let known = "", buttons = [], driving = null;

  /** Whether the values of the run are shown: while it goes on, and after it if another scene is chosen. */
  const live = () => bench.shown.setup !== null && store.values.length > 0 && (store.active || bench.chosen().scene !== store.setup.scene);
  const entries = () => (live() ? store.values.filter(({ kind }) => kind !== "text" && kind !== "choice")
    : bench.chosen().form?.sections.flatMap(({ values }) => values) ?? []);
  const declaredHands = () => (live() ? store.setup : bench.chosen().form)?.hands ?? {};
  const entryOf = (key) => entries().find((one) => one.key === key);

  /** Change a value; the row of a running rig shows nothing else until it has been read back, or LATE has passed. */
  async function set(key, value, last = () => true) {
    if (!live()) { bench.change(key, value); return; }
    const row = rows.get(key), now = entryOf(key)?.value;
    if (!before.has(key)) before.set(key, now);
    row?.expect(undefined, Infinity);
    try {
      const answer = await bench.set(key, value);
      const owner = answer.overruled?.[key];
      fault.textContent = owner ? t("{owner} drives {key}: the value takes effect when {owner} is disconnected", { owner, key: called(key, declaredHands()) }) : "";
      if (last()) row?.expect(answer.values?.[key.replace(`controllers.${entryOf(key)?.of}.`, "")], performance.now() + (owner ? 0 : LATE));
      setTimeout(() => row?.show(entryOf(key)), LATE + 1); // it was limited, or another operator has changed it
      row?.blame("");
    } catch (error) {
      row?.blame(said(error.message));
      row?.expect(undefined, 0);
      row?.show(entryOf(key));
    }
  }

  /** Before a run all values of the scene; in a run those that were changed on this page, as they were before. */
  async function restore() {
    if (!live()) { bench.reset(); return; }
    const values = [...before];
    before.clear();
    for (const [key, value] of values) await set(key, value);
    before.clear();
    back.hidden = true;
  }

  const mapOf = (key) => maps[(live() ? store.setup : bench.chosen().form)?.scene]?.[key];

  /** Whether all sliders but that of `key` are where the map of `key` was made: it holds for these values only. */
  function holds(key) {
    if (live() && entryOf(key)?.owner) return false; // it moves by itself
    return entries().every((one) => one.key === key || mapOf(one.key)?.at === undefined || mapOf(key).with?.[one.key] !== undefined
      || (live() && one.owner ? key.startsWith(`controllers.${one.owner}.`) : Math.abs(one.value - mapOf(one.key).at) <= 1e-3 * Math.abs(mapOf(one.key).at)));
  }

  /** Calls `set` at most every EVERY ms, and with the last value in any case. */
  function throttled(key) {
    let waiting = null;
    let busy = false;
    async function next() {
      if (busy || waiting === null) return;
      busy = true;
      const value = waiting;
      waiting = null;
      await set(key, value, () => waiting === null);
      setTimeout(() => { busy = false; next(); }, EVERY);
    }
    return (value) => { waiting = value; rows.get(key)?.expect(undefined, Infinity); next(); };
  }

  function row(entry, named) {
    const { key, unit, limits } = entry;
    const moved = throttled(key);
    const attributes = { id: `value-${key}`, "aria-label": named ? `${named}, ${key}` : key };
    const owner = h("span", { class: "small doubtful" }), wrong = h("div", { class: "fault small", id: `fault-${key}`, role: "alert" });
    const map = named ? mapOf(key) : undefined;
    let field, slider = null, held = false;
    let wanted, until = 0; // what has been set: values that were read before do not replace it
    if (entry.kind === "switch") field = h("input", { ...attributes, type: "checkbox", onchange: (e) => set(key, e.target.checked) });
    else if (entry.kind === "choice") field = h("select", { ...attributes, onchange: (e) => set(key, e.target.value) }, ...entry.choices.map((one) => h("option", {}, one)));
    else if (entry.kind === "fixed") field = h("span", { class: "soft" }, number(entry.value));
    else field = h("input", { ...attributes, type: "text", placeholder: t("not set"), onchange: (e) => set(key, typed(e.target.value)) });
    if (map) entry.slider = { low: map.low, high: map.high, least: 0 };
    if (entry.slider && entry.slider.low < entry.slider.high && (named || live())) {
      const { low, high, least } = entry.slider;
      slider = h("input", { type: "range", min: 0, max: STEPS, step: 1, id: `slider-${key}`,
        "aria-label": `${named || key}, ${number(low)} – ${quantity(high, unit)}`,
        onpointerdown: () => { held = true; }, onpointerup: () => { held = false; }, onpointercancel: () => { held = false; },
        oninput: (e) => {
          const value = Number(valueAt(entry.slider, Number(e.target.value)).toPrecision(4));
          e.target.setAttribute("aria-valuetext", quantity(value, unit));
          field.value = number(value);
          tell(value);
          if (live()) moved(value);
        },
        onchange: (e) => { if (!live()) set(key, Number(valueAt(entry.slider, Number(e.target.value)).toPrecision(4))); } });
      if (least) slider.title = t("logarithmic");
    }
    const ends = [h("span", {}), h("span", {})];
    const bar = h("div", { class: "map", hidden: !map }), says = h("div", { class: "small soft says", id: `says-${key}`, hidden: !map });
    if (map) slider.setAttribute("aria-describedby", says.id);
    const line = slider && named ? h("div", { class: "ends small soft" }, ends[0], h("div", {}, slider, bar), ends[1]) : slider;
    widen([]);
    const range = limits ? `${number(limits[0])} – ${quantity(limits[1], unit)}` : "";
    const element = data("div", { class: "hand", "data-key": key, title: [key, range, entry.note, entry.place].filter(Boolean).join("\n") },
      h("div", { class: "row" }, h("span", { class: "grow" }, named || called(key), " ", owner, entry.origin && !named ? h("span", { class: "small soft" }, `  ${said(entry.origin)}`) : null),
        field, h("span", { class: "small unit" }, written(unit))), wrong, line, says);

    /** Let the slider reach over a range too, as far as values are allowed. */
    function widen([from, to]) {
      if (!slider) return;
      const { low, high, least } = entry.slider, [bottom, top] = limits;
      entry.slider = { low: Math.max(Math.min(low, from ?? low), bottom), high: Math.min(Math.max(high, to ?? high), top), least };
      ends.forEach((one, i) => { one.textContent = shortened([entry.slider.low, entry.slider.high][i]); });
      if (map) bar.style.background = background(map, entry.slider);
    }

    /** Say what the map tells of a value. */
    function tell(value) {
      if (!map) return;
      const valid = holds(key), needed = Object.entries(map.with ?? {}).filter(([one]) => !one.startsWith("controllers."));
      bar.classList.toggle("pale", !valid);
      const when = key.startsWith("controllers.") ? t("when connected")
        : needed.map(([one, set]) => (entryOf(one)?.kind === "switch" ? t("with {key}", { key: t(words(one.replace(".", " "))) })
          : t("with {key}", { key: `${called(one, declaredHands())} ${quantity(set, entryOf(one)?.unit)}` }))).join(", ");
      put(says, valid ? [when, told(map, value, unit)].filter(Boolean).join(": ") : t("the bar holds for the scene's other values"));
    }

    function show(now) {
      if (!now || (live() && now.value !== wanted && performance.now() < until)) return;
      until = 0;
      const { changes, good } = bench.chosen(), changed = !live() && key in changes;
      const value = changed && (!good || box.ariaBusy === "true") ? changes[key] : now.value; // as it was typed, until it has been read
      if (field.type === "checkbox") field.checked = Boolean(now.value);
      else if (field.tagName === "SELECT") field.value = now.value;
      else if (field.tagName === "INPUT" && document.activeElement !== field && !held) field.value = now.value === null ? "" : number(value, live() ? 6 : 8);
      if (field.tagName === "INPUT" && field.type === "text") field.className = changed ? "value changed" : "value";
      if (slider && !held) { slider.value = placeOf(entry.slider, now.value); tell(now.value); }
      owner.textContent = now.owner ? t("driven by {owner}", { owner: now.owner }) : "";
    }
    return { element, widen, show, blame: (text) => put(wrong, text), expect(value, time) { [wanted, until] = [value, time]; } };
  }

  function control(name, drives) {
    const act = (what) => async () => {
      try {
        await bench.command({ do: what, controller: name });
        fault.textContent = "";
      } catch (error) {
        fault.textContent = said(error.message);
      }
    };
    return h("div", { class: "row small drives" }, h("span", { class: "grow" }, t("controller {name} drives {what}", { name, what: drives.map((key) => called(key, declaredHands())).join(", ") })),
      h("button", { onclick: act("connect"), id: `connect-${name}` }, t("Connect")),
      h("button", { onclick: act("disconnect"), id: `disconnect-${name}` }, t("Disconnect")));
  }

  function sift() {
    const asked = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const section of sections.children) {
      const all = [...section.querySelectorAll(".hand")];
      for (const one of all) one.hidden = !asked.every((word) => `${one.dataset.key} ${words(one.dataset.key)} ${one.textContent.toLowerCase()}`.includes(word));
      section.hidden = all.every((one) => one.hidden);
      if (asked.length) section.open = true;
    }
  }

  function build(all) {
    const { id, value } = document.activeElement; // what one is typing outlasts the new rows
    const open = new Set([...sections.querySelectorAll("details[open]")].map((one) => one.dataset.name));
    rows.clear();
    const declared = declaredHands(), tables = new Map();
    const hands = Object.fromEntries(Object.entries(declared).filter(([key]) => all.some((one) => one.key === key)).slice(0, MOST));
    for (const entry of all) {
      const named = entry.key in hands ? t(hands[entry.key]) : "", made = row(entry, named);
      rows.set(entry.key, made);
      if (!named) { const table = entry.key.slice(0, entry.key.lastIndexOf(".")) || "scene"; tables.set(table, [...(tables.get(table) ?? []), made.element]); }
    }
    first.replaceChildren(...Object.keys(hands).filter((key) => rows.has(key)).map((key) => rows.get(key).element));
    sections.replaceChildren(...[...tables].map(([table, elements]) =>
      h("details", { open: open.has(table), "data-name": table }, data("summary", {}, table.split(".").map((one) => t(words(one))).join(": ")), ...elements)));
    count.textContent = t("All other values ({count})", { count: all.length - Object.keys(hands).length });
    if (Object.keys(hands).some(mapOf)) first.prepend(legend);
    lay();
    sift();
    const again = id && document.activeElement?.id !== id ? document.getElementById(id) : null;
    if (again && box.contains(again)) { again.focus(); if (again.type === "text") again.value = value; }
  }

  /** Put the buttons of a controller below its slider, if it has one. */
  function lay() {
    for (const [name, element] of buttons) {
      const slider = [...rows].find(([key, { element: one }]) => key.startsWith(`controllers.${name}.`) && first.contains(one));
      if (slider) slider[1].element.after(element); else controllers.append(element);
    }
  }

  function state() {
    const of = bench.shown.setup ?? bench.chosen().form;
    if (of && of.controllers !== driving) {
      driving = of.controllers;
      for (const [, element] of buttons) element.remove();
      buttons = Object.entries(driving).map(([name, drives]) => [name, control(name, drives)]);
      lay();
    }
    const all = entries(), text = `${live()} ${(live() ? store.setup : bench.chosen().form)?.scene} ${all.map(({ key, kind }) => key + kind).join(" ")}`;
    if (text !== known && all.length) { known = text; build(all); }
    for (const entry of all) rows.get(entry.key)?.show(entry);
    back.hidden = live() ? !before.size : Object.keys(bench.chosen().changes).length === 0 || store.active;
    const off = store.active ? !store.online || !live() : live();
    for (const one of box.querySelectorAll(".hand input, .hand select")) one.disabled = off;
    for (const [, element] of buttons) for (const one of element.querySelectorAll("button")) one.disabled = off || !store.active; // a run connects
  }

  return {
    element: h("div", { class: "stack" }, h("div", { class: "row" }, h("h2", { class: "grow" }, t("Move a value, see what happens")), back), fault, box, controllers),
    box,
    /** Put the map of a value below its slider, which then reaches over the range of the map. */
    place(key, block, range) {
      const made = rows.get(key);
      if (!made || made.element.nextSibling === block) return;
      made.element.after(block);
      made.widen(range);
    },
    /** Say at its field what is wrong with a value; no `text`: none is wrong. Whether there is such a field. */
    blame(key, text = "") {
      if (!text) for (const made of rows.values()) made.blame("");
      else rows.get(key)?.blame(text);
      return rows.has(key);
    },
    setup() {
      fault.textContent = "";
      before.clear();
    },
    state,
  };
}
