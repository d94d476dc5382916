// Events of the run, the newest on top.

import { data, h, pane } from "/page/dom.js";
import { inWords } from "/page/experiment.js";
import { decimal, said, t } from "/page/text.js";

const SHOWN = 60;

export function create(bench) {
  const rows = h("table");
  let shown = null;
  return {
    element: pane(t("Events"), h("div", { class: "scroll", tabIndex: 0, id: "events" }, rows)),
    draw() {
      const store = bench.shown;
      const last = store.events[store.events.length - 1];
      if (last === shown) return;
      shown = last;
      rows.replaceChildren(...store.events.slice(-SHOWN).reverse().map((one) => h("tr", { class: one.level === "error" ? "bad" : one.level === "warning" ? "doubtful" : "" },
        h("td", { class: "number" }, `${decimal(one.t.toFixed(3))} s`), data("td", {}, one.source === "plant" ? "" : one.source), h("td", {}, said(one.kind)),
        h("td", {}, inWords(one, store)))));
    },
  };
}
