// Maps and cost tables: those of the folder, with their figures, and new ones of the scene that is chosen.

import { get, post } from "/page/api.js";
import { axis } from "/page/axis.js";
import { attempting, data, front, h, pane, put } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";
import { language, said, t } from "/page/text.js";

const COUNT = 20; // values of an axis at first

export function create(bench) {
  const fault = data("div", { class: "fault pre", id: "studies-fault", role: "alert" });
  const attempt = attempting(fault);
  const list = h("div", { id: "studies" });
  const note = h("p", { class: "small soft" }), which = h("strong");
  const jobs = jobsOf(["modes", "map", "cost"], attempt, fill);
  jobs.element.id = "studies-jobs";
  const x = axis(bench, "map-x", t("over"), { count: COUNT }), y = axis(bench, "map-y", t("and over"), { count: COUNT, second: true });
  const start = (what) => () => attempt(async () => {
    const { scene, changes } = bench.chosen();
    await post("/api/studies/work", { what, scene, changes, x: x.text(), y: y.text() });
    jobs.look();
  });

  function study({ kind, name, about, changed, finished, files }) {
    const address = (file) => `/studies/${kind}/${encodeURIComponent(name)}/${encodeURIComponent(file)}`;
    const when = new Date(changed * 1000).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
    const figures = h("div");
    return h("details", {
      class: "small", "data-name": `${kind}/${name}`,
      ontoggle: ({ target }) => { // pictures are loaded when they are looked at
        if (target.open) {
          figures.replaceChildren(...files.filter((file) => file.endsWith(".png")).map((file) =>
            h("a", { href: address(file), target: "_blank", rel: "noopener" }, h("img", { src: `${address(file)}?${changed}`, alt: `${name}, ${file}` }))));
        }
      },
    }, h("summary", {}, about ? data("strong", {}, about) : "", data("span", { class: "soft" }, ` ${kind}/${name}, ${when}`)), finished ? null : h("div", { class: "doubtful" }, t("unfinished: start it again and it continues")),
    data("div", { class: "row" }, ...files.map((file) => h("a", { href: address(file), target: "_blank", rel: "noopener" }, file))), figures);
  }

  function fill() {
    return attempt(async () => {
      const open = new Set([...list.querySelectorAll("details[open]")].map((one) => one.dataset.name));
      const known = await get("/api/studies");
      list.replaceChildren(...known.map(study));
      for (const one of list.children) one.open = open.has(one.dataset.name);
      if (!known.length) list.replaceChildren(h("p", { class: "small soft" }, t("none yet in this folder")));
    });
  }

  note.textContent = t("With its changed values: eigenvalues take seconds. A map simulates many runs, a cost table compares methods and steps. Both take minutes to hours and all processors: do not start them beside a run whose timing matters. Results of a stopped job are kept.");
  const button = (id, text, title = "") => h("button", { onclick: start(id), id, title }, text);
  return {
    element: h("div", { class: "split" }, front(t("Analyse a rig"), h("div", { class: "small" }, t("on the bench:"), " ", which), x.element, y.element,
      h("div", { class: "row" }, button("modes", t("Eigenvalues"), t("frequency and growth rate of each vibration mode")), button("map", t("Map by simulation")),
        button("regions", t("Map by eigenvalues"), t("where sliding is unstable, over two values; seconds")), button("cost", t("Cost table"))), note),
    h("div", { class: "stack" }, fault, jobs.element, pane(t("Maps and cost tables of this folder"), list))),
    enter() { fill(); jobs.look(); },
    draw() { // the form of the scene may come later
      put(which, said(bench.chosen().form?.title ?? ""));
      for (const one of [x, y]) one.fill();
    },
  };
}
