// The jobs of some commands of rig: processes beside the run, with their output, a button that stops them, and their result:
// a picture, a report and a sound are shown at once.

import { get, post } from "/page/api.js";
import { data, h } from "/page/dom.js";
import { said, t } from "/page/text.js";

const ADDRESS = /(http:\/\/\S+)/;
const PROGRESS = /^(.*): (\d+) of (\d+)(, .* left)?$/; // as `rig` prints it without a terminal
const LOOK = 1000; // [ms] between two looks at jobs that work

/** {element, look()} of `commands`. `attempt(action)` tells faults; `ended(jobs)` is called when none of them works any more. */
export function jobs(commands, attempt, ended = () => {}) {
  const element = h("div"), shown = new Map(); // number -> {text: what is shown of the job, element}
  let looking = false;

  function output(line) {
    const address = line.match(ADDRESS);
    return address ? [h("a", { href: address[1], target: "_blank", rel: "noopener" }, line), "\n"] : [line, "\n"];
  }

  /** The progress that a job has told last, while it works. */
  function progress({ state, title, lines }) {
    const said = state === "working" ? lines.map((line) => line.match(PROGRESS)).findLast(Boolean) : null;
    return said ? data("label", { class: "row small" }, h("progress", { max: Number(said[3]), value: Number(said[2]), "aria-label": title }), said[0]) : null;
  }

  /** A picture or a sound itself, beside the link to it. */
  function result({ number, title, result: name }) {
    if (!name) return [];
    const address = `/jobs/${number}`, link = h("a", { href: address, target: "_blank", rel: "noopener" }, t("open the result"), data("span", {}, ` (${name})`));
    if (/\.(png|gif)$/.test(name)) return [link, h("img", { src: address, alt: title, loading: "lazy" })];
    if (name.endsWith(".html")) return [link, h("iframe", { src: address, title, loading: "lazy" })]; // in the style of this page
    return /\.wav$/.test(name) ? [link, h("audio", { src: address, controls: true, "aria-label": name })] : [link];
  }

  function drawn(one) {
    const state = { working: t("working"), done: t("done"), stopped: t("stopped") }[one.state] ?? one.state;
    const code = one.state === "working" || one.code === 0 ? "" : t(", exit code {code}", { code: one.code });
    const stop = one.state === "working"
      ? h("button", { class: "small", onclick: () => attempt(async () => { await post("/api/jobs/stop", { number: one.number }); look(); }) }, t("Stop")) : null;
    const lines = data("pre", { class: "scroll", tabIndex: 0 }, ...one.lines.filter((line) => !PROGRESS.test(line)).flatMap(output));
    const before = shown.get(one.number)?.element;
    return h("details", { open: before?.open ?? true, class: "small job" }, h("summary", {}, h("span", {}, said(one.title)), ": ", `${state}${code} `),
      h("div", { class: "stack" }, ...result(one), stop), progress(one), lines);
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
      for (let working = true; working;) {
        const known = (await get("/api/jobs")).filter(({ command, title }) => [command, title].some((one) => commands.includes(one)));
        const now = known.map(draw);
        if (now.some((one, i) => one !== element.children[i])) element.replaceChildren(...now);
        working = known.some(({ state }) => state === "working");
        if (known.length && !working) ended(known);
        if (working) await new Promise((done) => { setTimeout(done, LOOK); });
      }
    });
    looking = false;
  }

  look();
  return { element, look };
}
