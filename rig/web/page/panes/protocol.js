// The steps of the protocol; the one that goes on is marked, and with repeats the round.

import { h, pane } from "/page/dom.js";

/** The steps as list items; `found` gets those of single steps and of repeats, in their order. */
export function listed(steps, found = []) {
  return steps.map((step) => {
    const item = typeof step === "string" ? h("li", {}, step) : h("li", {},
      h("span", {}, step.times === "forever" ? "repeat for ever" : `repeat ${step.times} times`), h("span", { class: "round" }));
    found.push(item);
    if (step.steps) item.append(h("ol", {}, ...listed(step.steps, found)));
    return item;
  });
}

const count = (steps) => steps.reduce((sum, { steps: inner, times }) => sum + (inner ? count(inner) * (times === "forever" ? Infinity : times) : 1), 0);
const lines = (steps) => steps.reduce((sum, { steps: inner }) => sum + 1 + (inner ? lines(inner) : 0), 0);

/** Where the step `number` (from 1, repeats unrolled) is: indices of its line and of those of its repeats, with rounds. */
export function place(steps, number) {
  let left = number - 1, line = 0;
  for (const step of steps) {
    const inner = step.steps, each = inner ? count(inner) : 1, whole = inner && step.times === "forever" ? Infinity : each * (inner ? step.times : 1);
    if (left >= 0 && left < whole) {
      if (!inner) return { line, rounds: [] };
      const below = place(inner, (left % each) + 1);
      return { line: line + 1 + below.line,
        rounds: [{ line, round: Math.floor(left / each) + 1 }, ...below.rounds.map((one) => ({ ...one, line: line + 1 + one.line }))] };
    }
    left -= whole;
    line += inner ? 1 + lines(inner) : 1;
  }
  return null;
}

export function create({ store }) {
  const list = h("ol", { class: "small", id: "steps" });
  const now = h("p", { class: "small", id: "step-now" });
  let items = [], shown = null;
  return {
    element: pane("Protocol", now, h("div", { class: "scroll" }, list)),
    setup() {
      shown = null;
      items = [];
      list.replaceChildren(...listed(store.setup.protocol, items));
    },
    draw() {
      const left = store.health?.eta_s ?? -1;
      now.textContent = [store.health?.phase, left >= 0 && store.active ? `${Math.round(left)} s left` : ""].filter(Boolean).join(", ");
      const step = store.status?.step ?? 0;
      if (step === shown || !store.setup) return;
      shown = step;
      const at = place(store.setup.protocol, step);
      items.forEach((one, i) => {
        one.classList.toggle("current", i === at?.line);
        if (i === at?.line) one.setAttribute("aria-current", "step"); else one.removeAttribute("aria-current");
        const round = one.querySelector(":scope > .round");
        if (round) round.textContent = at?.rounds.filter(({ line }) => line === i).map((of) => `, round ${of.round}`).join("") ?? "";
      });
      const current = items[at?.line], box = list.parentElement;
      if (current) box.scrollTop += Math.max(current.getBoundingClientRect().bottom - box.getBoundingClientRect().bottom, 0)
        + Math.min(current.getBoundingClientRect().top - box.getBoundingClientRect().top, 0);
    },
  };
}
