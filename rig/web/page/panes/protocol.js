// The protocol as a line of its steps; the one that goes on is marked and told in words, with repeats the round.

import { h, put } from "/page/dom.js";
import { said, t } from "/page/text.js";

/** The steps as list items; `items` gets those of single steps and of repeats, in their order. */
function listed(steps, items) {
  return steps.map((step) => {
    const item = h("li", {}, h("span", {}, typeof step === "string" ? said(step) : step.times === "forever" ? t("repeat for ever") : t("repeat {times} times", step)));
    items.push(item);
    if (step.steps) item.append(h("ol", {}, ...listed(step.steps, items)));
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

export function create(bench) {
  const list = h("ol", { class: "line", id: "steps", "aria-label": t("protocol") });
  const now = h("span", { class: "small grow", id: "step-now" }), left = h("span", { class: "small soft" });
  let items = [], steps = null, drawn = "";

  function lay(protocol) {
    [steps, items, drawn] = [protocol, [], ""];
    list.replaceChildren(...listed(protocol, items));
    for (const one of items) one.title = one.firstChild.textContent;
  }

  return {
    element: h("div", { class: "stack", style: "gap: .25rem" }, list, h("div", { class: "row" }, now, left)),
    /** The steps of the run that is shown, or of the chosen scene. */
    state() {
      const wanted = (bench.shown.setup ?? bench.chosen().form)?.protocol ?? [];
      if (wanted !== steps) { lay(wanted); now.textContent = left.textContent = ""; }
    },
    draw() {
      const store = bench.shown, { active } = bench.store;
      const rest = store.health?.eta_s ?? -1, step = store.status?.step ?? 0;
      put(left, rest >= 0 && active ? t("the run ends in {seconds} s", { seconds: Math.round(rest) }) : "");
      const done = active && store.status?.done, text = `${step} ${active} ${done}`;
      if (!steps || !store.setup || text === drawn) return;
      drawn = text;
      const at = done ? null : place(steps, step);
      items.forEach((one, i) => {
        one.classList.toggle("current", i === at?.line);
        one.classList.toggle("past", (done || (at !== null && i < at.line)) && !one.querySelector("ol"));
        if (i === at?.line) one.setAttribute("aria-current", "step"); else one.removeAttribute("aria-current");
      });
      const rounds = at?.rounds.map(({ round }) => t("round {round}", { round })).join(", ");
      const number = items.length > 1 ? `${at?.line + 1}/${items.length}: ` : "";
      now.textContent = at ? [number + items[at.line].title, rounds].filter(Boolean).join(", ") : done ? t("the protocol is over, its last values stay") : "";
    },
  };
}
