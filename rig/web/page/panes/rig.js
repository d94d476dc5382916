// The rig as a moving picture, as `rig view` draws it. Before a run it shows the chosen scene at rest.

import { data, h, put, words } from "/page/dom.js";
import { sized } from "/page/plot.js";
import { Solids } from "/page/solids.js";
import { said, t } from "/page/text.js";

export function create(bench) {
  const canvas = h("canvas", { class: "stage", role: "img", "aria-label": t("moving picture of the rig"), id: "rig-picture" });
  const text = data("span", { id: "rig-text" });
  let form = null, rest = null; // the chosen scene, its picture

  /** The run that is shown, else the chosen scene at rest. */
  function shown() {
    const chosen = bench.chosen().form, store = bench.shown;
    if (store.setup) return { run: true, solids: store.picture };
    if (chosen !== form) {
      form = chosen;
      rest = form?.picture?.shapes ? new Solids(form.picture) : null;
      rest?.move(form.picture.at);
    }
    return { run: false, solids: rest };
  }

  return {
    element: canvas,
    text,
    draw() {
      const { run, solids } = shown();
      const place = sized(canvas);
      if (!run && !form) return;
      if (solids) {
        solids.draw(place);
        put(text, run ? solids.text.replace(/^(stick|slip[+-]|open)(?= {2,}) */, "").split(/ {2,}/).map(said).join(",  ") : t("at rest")); // the state stands beside it
      } else if (run) {
        bars(place, bench.shown);
        text.textContent = t("The plant of this scene declares no picture. Its outputs now, each as a share of the largest so far.");
      } else text.textContent = form.picture ? `${t("The picture of this plant cannot be drawn:")} ${form.picture.fault}`
        : t("The plant of this scene declares no picture; its outputs are shown when it runs.");
    },
  };
}

function bars({ pen, width, height }, store) {
  const names = store.setup.outputs.map(({ name }) => name).slice(0, 10);
  const row = (height - 90) / Math.max(names.length, 1);
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  names.forEach((name, i) => {
    const curve = store.outputs[name];
    const size = curve.reach(-Infinity, Infinity).reduce((most, v) => Math.max(most, Math.abs(v)), 0) || 1;
    const middle = 45 + (i + 0.5) * row, zero = 150 + (width - 170) / 2;
    pen.fillStyle = store.setup.outputs[i].colour || "#56b4e9";
    const to = ((store.latest.v[i] ?? 0) / size) * (width - 170) / 2;
    pen.fillRect(Math.min(zero, zero + to), middle - row * 0.3, Math.abs(to), row * 0.6);
    pen.fillStyle = "#c9d1da";
    pen.fillText(words(name).slice(0, 22), 14, middle);
    pen.fillRect(zero, middle - row * 0.4, 1, row * 0.8);
  });
}
