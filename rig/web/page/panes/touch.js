// Sliders for everything that may change while the rig runs, by the checks of `rig tune`; owned actuators; controllers.

import { h, number, pane, quantity, typed } from "/page/dom.js";

const EVERY = 100; // [ms] between two values of a slider that is being moved
const STEPS = 1000; // of a slider
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

const zeroOf = ({ low, high }) => (low >= 0 ? 0 : high <= 0 ? STEPS : STEPS / 2);

export function create(bench) {
  const { store } = bench;
  const fault = h("div", { class: "fault", id: "touch-fault", role: "alert" });
  const controllers = h("div"), box = h("div");
  const rows = new Map();

  /** Change a value; the row shows nothing else until it has been read back, or LATE has passed. */
  async function set(key, value, last = () => true) {
    const row = rows.get(key), known = () => store.values.find((one) => one.key === key);
    row?.expect(undefined, Infinity);
    try {
      const answer = await bench.set(key, value);
      const owner = answer.overruled?.[key];
      fault.textContent = owner ? `${owner} drives ${key}: the value takes effect when ${owner} is disconnected` : "";
      if (last()) row?.expect(answer.values?.[key.replace(`controllers.${known()?.of}.`, "")], performance.now() + (owner ? 0 : LATE));
      setTimeout(() => row?.show(known()), LATE + 1); // it was limited, or another operator has changed it
    } catch (error) {
      fault.textContent = error.message;
      row?.expect(undefined, 0);
      row?.show(known());
    }
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

  function row(entry) {
    const { key, unit, limits } = entry;
    const moved = throttled(key);
    const field = h("input", { type: "text", class: "value", id: `live-${key}`, "aria-label": key, placeholder: "not set", onchange: (e) => set(key, typed(e.target.value)) });
    const owner = h("span", { class: "small warn" });
    let slider = null, held = false;
    let wanted, until = 0; // what has been set: values that were read before do not replace it

    function expect(value, time) { [wanted, until] = [value, time]; }

    if (entry.kind === "switch") {
      slider = h("input", { type: "checkbox", "aria-label": key, onchange: (e) => set(key, e.target.checked) });
    } else if (entry.slider && entry.slider.low < entry.slider.high) {
      const { low, high, least } = entry.slider;
      slider = h("input", { type: "range", min: 0, max: STEPS, step: 1, id: `slider-${key}`,
        "aria-label": `${key}, ${number(low)} to ${quantity(high, unit)}${least ? ", logarithmic" : ""}`,
        onpointerdown: () => { held = true; }, onpointerup: () => { held = false; }, onpointercancel: () => { held = false; },
        oninput: (e) => {
          const value = Number(valueAt(entry.slider, Number(e.target.value)).toPrecision(4));
          e.target.setAttribute("aria-valuetext", quantity(value, unit));
          field.value = number(value);
          moved(value);
        } });
    }
    const range = limits ? `${number(limits[0])} to ${quantity(limits[1], unit)}` : "";
    const element = h("div", { class: "small", title: `${key}\n${range}` },
      h("div", { class: "row" }, h("span", { class: "grow" }, key.replace(`controllers.${entry.of}.`, "")), field, unit === "1" ? "" : unit), slider, owner);
    function show(now) {
      if (!now || (now.value !== wanted && performance.now() < until)) return;
      until = 0;
      if (document.activeElement !== field && !held) field.value = now.value === null ? "" : number(now.value, 6);
      if (slider?.type === "checkbox") slider.checked = Boolean(now.value);
      else if (slider && !held) slider.value = placeOf(entry.slider, now.value);
      owner.textContent = now.owner ? `driven by ${now.owner}` : "";
    }
    return { element, show, expect };
  }

  function control(name, { drives }) {
    const act = (what) => async () => {
      try {
        await bench.command({ do: what, controller: name });
        fault.textContent = "";
      } catch (error) {
        fault.textContent = error.message;
      }
    };
    return h("div", { class: "row small" }, h("span", { class: "grow" }, `${name} drives ${drives.join(", ")}`),
      h("button", { onclick: act("connect"), id: `connect-${name}` }, "Connect"),
      h("button", { onclick: act("disconnect"), id: `disconnect-${name}` }, "Disconnect"));
  }

  function build() {
    rows.clear();
    const tables = new Map();
    for (const entry of store.values) {
      if (entry.kind === "text" || entry.kind === "choice") continue;
      const table = entry.of === "plant" ? (entry.actuator ? "actuators" : "parameters of the rig") : `controller ${entry.of}`;
      const made = row(entry);
      rows.set(entry.key, made);
      tables.set(table, [...(tables.get(table) ?? []), made.element]);
    }
    box.replaceChildren(...[...tables].map(([name, elements]) =>
      h("details", { open: name === "actuators" || name.startsWith("controller") }, h("summary", {}, name), ...elements)));
  }

  let known = "";
  return {
    element: pane("Values of the running rig", fault, controllers, box),
    setup() {
      known = "";
      fault.textContent = "";
      controllers.replaceChildren(...Object.entries(store.setup.controllers).map(([name, one]) => control(name, one)));
      box.replaceChildren();
    },
    state() {
      const keys = `${store.setup?.run} ${store.values.map(({ key }) => key).join(" ")}`;
      if (keys !== known && store.values.length) { known = keys; build(); }
      for (const entry of store.values) rows.get(entry.key)?.show(entry);
      const off = !store.active || !store.online;
      for (const one of [...box.querySelectorAll("input"), ...controllers.querySelectorAll("button")]) one.disabled = off;
    },
  };
}
