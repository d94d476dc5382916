// Events of the run, the newest on top.

import { h, pane } from "/page/dom.js";

const SHOWN = 60;

export function create({ store }) {
  const rows = h("table");
  let shown = null;
  return {
    element: pane("Events", h("div", { class: "scroll", tabIndex: 0, id: "events" }, rows)),
    draw() {
      const last = store.events[store.events.length - 1];
      if (last === shown) return;
      shown = last;
      rows.replaceChildren(...store.events.slice(-SHOWN).reverse().map((one) => h("tr", { class: one.level === "error" ? "bad" : one.level },
        h("td", { class: "num" }, `${one.t.toFixed(3)} s`), h("td", {}, one.source === "plant" ? "" : one.source), h("td", {}, one.kind),
        h("td", {}, one.text))));
    },
  };
}
