// Choose a value of the chosen scene in words and a range of it in its unit, for branches and maps.

import { called, data, h, number, typed, written } from "/page/dom.js";
import { t } from "/page/text.js";

const WIDE = 4; // the range that is proposed for a value without a slider of its own, as a multiple of the present value
const FIRST = "drive.speed"; // is proposed where a scene has it

/** {element, fill(), text()}: `id` begins the ids of its fields; `count`: values along the axis; `second`: "none" can be chosen. */
export function axis(bench, id, label, { count = 0, second = false } = {}) {
  const field = (name, text, size) => h("input", { type: "text", class: `value ${size}`, id: `${id}-${name}`, "aria-label": `${label}: ${text}`, translate: "no" });
  const key = h("select", { id: `${id}-over`, "aria-label": label, onchange: propose });
  const from = field("from", t("from"), ""), to = field("to", t("to"), ""), values = field("count", t("values"), "");
  const unit = data("span"), range = h("span", { class: "row" }, t("from"), " ", from, t("to"), " ", to, unit);
  let shown = null;

  const entries = () => bench.chosen().form?.sections.flatMap((section) => section.values) ?? [];
  const chosen = () => entries().find((entry) => entry.key === key.value);

  /** Offer the values of the chosen scene: those that have a name in its plant first. */
  function fill() {
    const { form, scene } = bench.chosen();
    if (!form || scene === shown) return;
    shown = scene;
    const numbers = entries().filter(({ value, kind }) => kind === "number" && value !== 0).map((entry) => entry.key);
    const first = Object.keys(form.hands).filter((one) => numbers.includes(one)), others = numbers.filter((one) => !first.includes(one));
    const option = (one, text) => data("option", { value: one, selected: one === FIRST && !second }, text);
    key.replaceChildren(...(second ? [h("option", { value: "" }, t("no second value"))] : []),
      h("optgroup", { label: t("values of this rig") }, ...first.map((one) => option(one, called(one, form.hands)))),
      h("optgroup", { label: t("all others") }, ...others.map((one) => option(one, `${called(one, form.hands)} (${one})`))));
    propose();
  }

  /** Propose the range of its slider, else one about the present value, as far as values are allowed. */
  function propose() {
    const entry = chosen();
    range.hidden = !entry;
    if (!entry) return;
    const [least, most] = entry.limits ?? [-Infinity, Infinity], ends = [entry.value / WIDE, entry.value * WIDE].sort((a, b) => a - b);
    const { low, high } = entry.key in bench.chosen().form.hands && entry.slider ? entry.slider : { low: Math.max(ends[0], least), high: Math.min(ends[1], most) };
    [from.value, to.value, values.value] = [number(low), number(high), String(count)];
    unit.textContent = written(entry.unit);
  }

  if (count) range.append(h("label", {}, t("values"), " ", values));
  return {
    element: h("div", { class: "axis small" }, h("label", {}, label, " ", key), range),
    fill,
    /** KEY=FROM:TO or KEY=FROM:TO:COUNT as `rig map` reads it, in SI units unless others are typed; "" for no value. */
    text() {
      if (!chosen()) return "";
      const ends = [from, to].map(({ value }) => typed(value));
      return [`${key.value}=${ends.join(":")}`, ...(count ? [values.value.trim()] : [])].join(":");
    },
  };
}
