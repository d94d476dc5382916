// The phase portrait: velocity over displacement of the last two seconds, in the colours of the contact modes.

import { h, number, pane } from "/page/dom.js";
import { sized } from "/page/plot.js";

const SPAN = 2;

export function create({ store }) {
  const canvas = h("canvas", { "aria-label": "phase portrait" });
  const about = h("div", { class: "small faint" });
  let reach = [0, 0];
  return {
    element: pane("Phase portrait", canvas, about),
    setup() {
      reach = [0, 0];
      const pair = store.setup.portrait;
      canvas.hidden = !pair;
      about.textContent = pair ? "" : "this rig has no pair of displacement and velocity";
    },
    draw() {
      const pair = store.setup?.portrait;
      if (!pair) return;
      const [x, v] = pair.map((name) => store.outputs[name]);
      const { pen, width, height } = sized(canvas, Math.min(canvas.clientWidth || 240, 260));
      const from = store.t - SPAN;
      let first = x.t.length - 1;
      while (first > 0 && x.t[first - 1] >= from) first -= 1;
      for (let i = Math.max(first, 0); i < x.t.length; i += 1) {
        reach = [Math.max(reach[0], Math.abs(x.v[i] ?? 0)), Math.max(reach[1], Math.abs(v.v[i] ?? 0))];
      }
      const px = (i) => width / 2 + 0.47 * width * (x.v[i] ?? 0) / (reach[0] || 1);
      const py = (i) => height / 2 - 0.45 * height * (v.v[i] ?? 0) / (reach[1] || 1);
      pen.strokeStyle = "#333a45";
      pen.beginPath();
      pen.moveTo(0, height / 2); pen.lineTo(width, height / 2);
      pen.moveTo(width / 2, 0); pen.lineTo(width / 2, height);
      pen.stroke();
      pen.lineWidth = 1.6;
      for (let i = Math.max(first, 1); i < x.t.length; i += 1) {
        pen.strokeStyle = store.setup.modes[store.modes.v[i]]?.colour ?? "#98a2b0";
        pen.beginPath();
        pen.moveTo(px(i - 1), py(i - 1)); pen.lineTo(px(i), py(i));
        pen.stroke();
      }
      const last = x.t.length - 1;
      if (last >= 0) {
        pen.fillStyle = "#ffffff";
        pen.beginPath();
        pen.arc(px(last), py(last), 4, 0, 2 * Math.PI);
        pen.fill();
      }
      const unit = (name) => store.setup.outputs.find((one) => one.name === name).unit;
      about.textContent = `across ${pair[0].replaceAll("_", " ")} ±${number(reach[0], 3)} ${unit(pair[0])}, `
        + `up ${pair[1].replaceAll("_", " ")} ±${number(reach[1], 3)} ${unit(pair[1])}`;
    },
  };
}
