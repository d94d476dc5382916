// The rig as a moving picture, as `rig view` draws it. Before a run it shows the chosen scene at rest.

import { h, pane } from "/page/dom.js";
import { ink, sized } from "/page/plot.js";
import { Solids } from "/page/solids.js";

const TALLEST = 340; // [px]

export function create(bench) {
  const { store } = bench;
  const canvas = h("canvas", { class: "stage", role: "img", "aria-label": "moving picture of the rig", id: "rig-picture" });
  const text = h("div", { class: "small faint pre", id: "rig-text" });
  let form = null, rest = null; // the chosen scene, its picture

  /** The run, while it goes on, and after it until another scene or value is chosen; else the chosen scene. */
  function shown() {
    const chosen = bench.chosen().form;
    if (store.setup && (store.active || (chosen?.scene ?? store.setup.scene) === store.setup.scene)) return { run: true, solids: store.picture };
    if (chosen !== form) {
      form = chosen;
      rest = form?.picture?.shapes ? new Solids(form.picture) : null;
      rest?.move(form.picture.at);
    }
    return { run: false, solids: rest };
  }

  return {
    element: pane("Rig", canvas, text),
    draw() {
      const { run, solids } = shown();
      canvas.hidden = !run && !solids;
      const about = run ? store.setup : form;
      if (!about) return;
      canvas.classList.toggle("stage", solids !== null);
      if (solids) {
        solids.draw(sized(canvas, Math.min(0.6 * canvas.clientWidth, TALLEST)));
        text.textContent = run ? solids.text.replace(/ {2,}/g, ",  ") : `${about.title}: at rest`;
      } else if (run) {
        bars(sized(canvas, 230), store);
        text.textContent = "The plant of this scene declares no picture. Its outputs now, each as a share of the largest so far.";
      } else if (form.picture) text.textContent = `The picture of this plant cannot be drawn: ${form.picture.fault}`;
      else text.textContent = "The plant of this scene declares no picture; its outputs are shown when it runs.";
    },
  };
}

function bars({ pen, width, height }, store) {
  const names = store.setup.outputs.map(({ name }) => name).slice(0, 10);
  const row = height / Math.max(names.length, 1);
  pen.font = "11px system-ui, sans-serif";
  pen.textBaseline = "middle";
  names.forEach((name, i) => {
    const curve = store.outputs[name];
    const size = [...curve.low, ...curve.high].reduce((most, v) => Math.max(most, Math.abs(v ?? 0)), 0) || 1;
    const middle = (i + 0.5) * row, zero = 130 + (width - 140) / 2;
    pen.fillStyle = store.setup.outputs[i].colour || "#56b4e9";
    const to = (store.latest.v[i] ?? 0) / size * (width - 140) / 2;
    pen.fillRect(Math.min(zero, zero + to), middle - row * 0.3, Math.abs(to), row * 0.6);
    pen.fillStyle = ink().faint;
    pen.fillText(name.replaceAll("_", " ").slice(0, 22), 2, middle);
    pen.fillRect(zero, middle - row * 0.4, 1, row * 0.8);
  });
}
