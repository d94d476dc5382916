// The contact mode over the last seconds, as a strip of colours with their words.

import { h, pane } from "/page/dom.js";
import { sized } from "/page/plot.js";

const SPAN = 5;

export function create({ store }) {
  const canvas = h("canvas", { "aria-label": "contact mode over time" });
  const legend = h("div", { class: "small" });
  const now = h("strong", { id: "contact" });
  return {
    element: pane("Contact", canvas, h("div", { class: "row" }, now, legend)),
    setup() {
      legend.replaceChildren(...store.setup.modes.map(({ name, colour }) =>
        h("span", {}, h("span", { class: "key", style: `background:${colour}` }), name, " ")));
    },
    draw() {
      if (!store.setup) return;
      const { pen, width, height } = sized(canvas, 22);
      const { t, v } = store.modes;
      const begin = store.t - SPAN;
      const x = (time) => ((time - begin) / SPAN) * width;
      for (let i = t.length - 1; i > 0 && t[i] >= begin; i -= 1) {
        pen.fillStyle = store.setup.modes[v[i]]?.colour ?? "#000";
        pen.fillRect(x(t[i - 1]), 0, x(t[i]) - x(t[i - 1]) + 0.7, height);
      }
      now.textContent = store.setup.modes[v[v.length - 1]]?.name ?? "";
    },
  };
}
