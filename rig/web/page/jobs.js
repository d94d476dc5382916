// The jobs of a pane: processes beside the run, with their output, a button that stops them, and a link to their result.

import { get, post } from "/page/api.js";
import { h } from "/page/dom.js";

const ADDRESS = /(http:\/\/\S+)/;
const PROGRESS = /^(.*): (\d+) of (\d+)(, .* left)?$/; // as `rig` prints it without a terminal
const LOOK = 1000; // [ms] between two looks at jobs that work

/** The jobs of some commands of rig: {element, look()}. `attempt(action)` tells faults; `ended()` is called after the last one. */
export function jobs(commands, attempt, ended = () => {}) {
  const element = h("div"), shown = new Map(); // number -> {text: what is shown of the job, element}
  let looking = false;

  function output(line) {
    const found = line.match(ADDRESS);
    return found ? [h("a", { href: found[1], target: "_blank", rel: "noopener" }, line), "\n"] : [line, "\n"];
  }

  /** The progress that a job has told last, while it works. */
  function progress({ state, title, lines }) {
    const said = state === "working" ? lines.map((line) => line.match(PROGRESS)).findLast(Boolean) : null;
    return said ? h("label", { class: "row small" }, h("progress", { max: Number(said[3]), value: Number(said[2]), "aria-label": `progress of ${title}` }),
      said[0]) : null;
  }

  function drawn(one) {
    const state = one.state === "working" || one.code === 0 ? one.state : `${one.state}, exit code ${one.code}`;
    const result = one.result ? h("a", { href: `/jobs/${one.number}`, target: "_blank", rel: "noopener" }, `open the result (${one.result})`) : null;
    const stop = one.state === "working"
      ? h("button", { class: "small", onclick: () => attempt(async () => { await post("/api/jobs/stop", { number: one.number }); look(); }) }, "Stop") : null;
    const lines = h("div", { class: "pre scroll" }, ...one.lines.filter((line) => !PROGRESS.test(line)).flatMap(output));
    const before = shown.get(one.number)?.element;
    return h("details", { open: before?.open ?? true, class: "small" }, h("summary", {}, `${one.title}: ${state} `),
      h("div", { class: "row" }, result, stop), progress(one), lines);
  }

  function draw(one) {
    const text = JSON.stringify(one);
    if (shown.get(one.number)?.text !== text) shown.set(one.number, { text, element: drawn(one) });
    return shown.get(one.number).element;
  }

  async function look() {
    if (looking) return;
    looking = true;
    await attempt(async () => {
      for (let working = true, was = false; working; was = working) {
        const found = (await get("/api/jobs")).filter(({ command }) => commands.includes(command));
        const now = found.map(draw);
        if (now.some((one, i) => one !== element.children[i])) element.replaceChildren(...now);
        working = found.some(({ state }) => state === "working");
        if (was && !working) ended();
        if (working) await new Promise((done) => { setTimeout(done, LOOK); });
      }
    });
    looking = false;
  }

  look();
  return { element, look };
}
