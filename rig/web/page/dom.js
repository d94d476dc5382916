// Elements and numbers. In German numbers have a decimal comma; a point is read too.

import { decimal, language, said, t } from "/page/text.js";

/** Element `tag` with properties (on...: listeners, class, others: attributes or properties) and children. */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else if (name in element && name !== "list" && name !== "translate") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

/** Set the text of an element, which costs nothing if it has that text. */
export function put(element, text) { if (element.textContent !== text) element.textContent = text; }

/** What is not for translation: a name, a value, the output of a command. */
export const data = (tag, properties = {}, ...children) => h(tag, { translate: "no", ...properties }, ...children);

/** A card: a section with a heading; the first one of a view has a heading of the first level. */
export function pane(title, ...children) {
  return h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...children);
}
export const front = (title, ...children) => h("section", { class: "card stack", "aria-label": title }, h("h1", {}, title), ...children);

/** A number with `digits` significant digits, without superfluous zeros. */
export function number(value, digits = 4) {
  if (typeof value !== "number") return String(value ?? "");
  if (Number.isInteger(value) && Math.abs(value) < 1e15) return String(value);
  return decimal(String(Number(value.toPrecision(digits))));
}

/** A unit as it is written; "1" is no unit. */
export const written = (unit) => (!unit || unit === "1" ? "" : unit.replaceAll("*", " "));

/** A value with its unit. */
export const quantity = (value, unit, digits = 4) => [number(value, digits), written(unit)].filter(Boolean).join(" ");

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** The factor and the unit in which a size reads well: 8.44e-6 m is 8.44 µm. Units of more than one word keep theirs. */
export function scaled(unit, size) {
  if (!/^(m|N|Pa|V|A|W|J|Hz|s|C|F|H|g)(\/s(\^2)?)?$/.test(unit) || !(size > 0)) return [1, unit === "1" ? "" : unit];
  const [factor, prefix] = PREFIXES.find(([one]) => size >= one) ?? PREFIXES.at(-1);
  return [1 / factor, prefix + unit];
}

/** What a user typed, as a value for the server: a plain number becomes a number; texts with a unit are read there. */
export function typed(text) {
  const given = text.trim(), trimmed = language === "de" && /^[-+]?\d+,\d+$/.test(given) ? given.replace(",", ".") : given;
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(trimmed) && Number.isFinite(Number(trimmed)) ? Number(trimmed) : trimmed;
}

/** Runs actions; what one of them throws stands in the element `fault`. */
export const attempting = (fault) => async (action) => {
  try {
    fault.textContent = "";
    await action();
  } catch (error) {
    fault.textContent = said(error.message);
  }
};

/** A text whose lines are as long as a file is wide, as paragraphs. */
export const joined = (text) => text.replace(/([^\n])\n(?=\S)/g, "$1 ");

/** A list of names as words: friction_force is "friction force". */
export const words = (name) => name.replaceAll("_", " ");

/** The value of a key in words: as the plant declares it among `hands`, else by its last name. */
export const called = (key, hands = {}) => t(hands?.[key] ?? words(key.slice(key.lastIndexOf(".") + 1)));
