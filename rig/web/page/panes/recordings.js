// The recordings of the folder: verify, report, view, download, compare; the jobs that do so, with their output.

import { get, post } from "/page/api.js";
import { attempting, h, number, pane } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";

export function create(bench) {
  const { store } = bench;
  const fault = h("div", { class: "fault", id: "recordings-fault", role: "alert" });
  const attempt = attempting(fault);
  const list = h("table", { id: "recordings" });
  const box = h("details", { ontoggle: () => box.open && fill() }, h("summary", {}, "Show recordings"),
    h("div", { class: "scroll" }, list));
  let chosen = null; // the first recording of a comparison

  const work = (body) => () => attempt(async () => { await post("/api/recordings/work", body); jobs.look(); });

  function compare(name) {
    return () => {
      if (chosen === null) {
        chosen = name;
        fault.textContent = `compare ${name} with ...: press Compare at another recording`;
      } else {
        work({ what: "compare", name: chosen, other: name })();
        chosen = null;
      }
    };
  }

  function row(one) {
    const link = h("a", { href: `/recordings/${encodeURIComponent(one.name)}`, title: "download (MCAP)" }, one.name);
    const button = (text, what, title) => h("button", { class: "small", title, onclick: work({ what, name: one.name }) }, text);
    const about = one.fault || [one.title, one.began && new Date(one.began * 1000).toISOString().slice(0, 19).replace("T", " "),
      one.seconds !== null && `${number(one.seconds)} s`, one.timing, `${number(one.bytes / 1e6, 3)} MB`, ...one.notes].filter(Boolean).join(", ");
    return h("tr", {}, h("td", {}, link, h("div", { class: "small faint" }, about), h("div", { class: "row" },
      button("Verify", "verify", "simulate it again and compare every bit"), button("Report", "report", "a page with figures"),
      button("CSV", "csv", "tables, as a ZIP file"), button("View", "view", "in rerun"),
      h("button", { class: "small", onclick: compare(one.name) }, "Compare"))));
  }

  const fill = () => attempt(async () => {
    const found = await get("/api/recordings");
    list.replaceChildren(...found.map(row));
    if (!found.length) list.replaceChildren(h("tr", {}, h("td", {}, "no recordings yet: every run makes one")));
  });

  const jobs = jobsOf(["verify", "report", "export", "diff", "view"], attempt);
  jobs.element.id = "jobs";

  const view = h("button", { id: "view", title: "the full view in rerun's page, for the active run",
    onclick: () => attempt(async () => { await post("/api/view", {}); jobs.look(); }) }, "View the run in rerun");
  let phase = "";
  return {
    element: pane("Recordings", view, fault, jobs.element, box),
    state() {
      view.disabled = !store.active || !store.online;
      if (store.state.phase === "ended" && phase !== "ended" && box.open) fill();
      phase = store.state.phase;
    },
  };
}
