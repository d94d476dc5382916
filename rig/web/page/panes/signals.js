// Scrolling curves of channels: the plots that the rig declares, outputs in front, measurements pale behind them.

import { h, pane } from "/page/dom.js";
import { lines } from "/page/plot.js";

const FIRST = 3; // plots that are open at first

export function create(bench) {
  const { store } = bench;
  const span = h("select", { "aria-label": "time shown", style: "width: auto" },
    ...[1, 2, 5, 10].map((s) => h("option", { value: s, selected: s === 5 }, `${s} s`)));
  const box = h("div");
  let plots = [];
  return {
    element: pane("Channels", h("div", { class: "row small" }, "show the last ", span), box),
    setup() {
      plots = store.setup.plots.map((plot, i) => {
        const canvas = h("canvas", { "aria-label": plot.title });
        const keys = [...plot.outputs.map((name) => [name, colour(name)]),
          ...plot.sensors.map((name) => [`${name} (measured)`, store.setup.sensors[name].colour])]
          .map(([name, tone]) => h("span", {}, h("span", { class: "key", style: `background:${tone}` }), name.replaceAll("_", " "), " "));
        const details = h("details", { open: i < FIRST }, h("summary", { class: "small" }, plot.title, " ", ...keys), canvas);
        return { ...plot, canvas, details, range: null };
      });
      box.replaceChildren(...plots.map(({ details }) => details));
    },
    draw() {
      if (!store.setup) return;
      const end = store.t || 1e-3, begin = Math.max(end - Number(span.value), 0);
      for (const plot of plots) {
        if (!plot.details.open) continue;
        const measured = plot.sensors.map((name) => ({ ...store.sensors[name], colour: store.setup.sensors[name].colour,
          pale: plot.outputs.length > 0, factor: store.setup.sensors[name].factor }));
        const drawn = plot.outputs.map((name) => ({ ...store.outputs[name], colour: colour(name) }));
        plot.range = lines(plot.canvas, 130, [...measured, ...drawn], begin, end, plot.range);
      }
    },
  };

  function colour(name) { return store.setup.outputs.find((one) => one.name === name)?.colour || "#56b4e9"; }
}
