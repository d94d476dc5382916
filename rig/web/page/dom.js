// Elements and numbers. Numbers are written with a point in every language, as scenes and the command line write them.

/** Element `tag` with properties (on...: listeners, class, others: attributes or properties) and children. */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else if (name in element && name !== "list") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

/** A pane: a section with a heading. */
export function pane(title, ...children) {
  return h("section", { class: "pane", "aria-label": title }, h("h2", {}, title), ...children);
}

/** A number with `digits` significant digits, without superfluous zeros. */
export function number(value, digits = 4) {
  if (typeof value !== "number") return String(value ?? "");
  if (Number.isInteger(value) && Math.abs(value) < 1e15) return String(value);
  return String(Number(value.toPrecision(digits)));
}

/** A value with its unit; "1" is no unit. */
export function quantity(value, unit, digits = 4) {
  return unit && unit !== "1" ? `${number(value, digits)} ${unit}` : number(value, digits);
}

/** What a user typed, as a value for the server: a plain number becomes a number; a decimal comma is read as a point. */
export function typed(text) {
  const trimmed = text.trim();
  const plain = /^[-+]?\d*,\d+$/.test(trimmed) ? trimmed.replace(",", ".") : trimmed;
  return plain !== "" && Number.isFinite(Number(plain)) ? Number(plain) : plain;
}

/** Runs actions; what one of them throws stands in the element `fault`. */
export const attempting = (fault) => async (action) => {
  try {
    fault.textContent = "";
    await action();
  } catch (error) {
    fault.textContent = error.message;
  }
};
