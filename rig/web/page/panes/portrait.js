// The phase portrait: velocity over displacement at every step of the last stretch, in the colours of the contact states.

import { h, number, pane, put, quantity, words } from "/page/dom.js";
import { ink, sized } from "/page/plot.js";
import { t } from "/page/text.js";

export function create(bench) {
  const canvas = h("canvas", { role: "img", "aria-label": t("phase portrait") });
  const about = h("div", { class: "small soft", translate: "no" });
  let reach = [null, null]; // [low, high] of both so far
  return {
    element: pane(t("Phase portrait"), canvas, about),
    setup() {
      reach = [null, null];
      const run = bench.shown.setup, pair = run?.portrait;
      canvas.hidden = !pair;
      about.textContent = pair || !run ? "" : t("this rig has no pair of displacement and velocity");
    },
    draw() {
      const store = bench.shown;
      const pair = store.setup?.portrait;
      if (!pair) return;
      const { x, v, mode, seconds } = store.steps;
      const { pen, width, height } = sized(canvas, 240);
      x.forEach((one, i) => { reach = [wider(reach[0], one), wider(reach[1], v[i])]; });
      if (!reach[0] || !reach[1]) return;
      const place = ([low, high], value, size) => size * (0.5 + 0.92 * (value - (low + high) / 2) / (high - low || 1));
      const px = (i) => place(reach[0], x[i], width), py = (i) => height - place(reach[1], v[i], height);
      const zero = [place(reach[0], 0, width), height - place(reach[1], 0, height)];
      pen.strokeStyle = ink().line;
      pen.beginPath();
      pen.moveTo(0, zero[1]); pen.lineTo(width, zero[1]);
      pen.moveTo(zero[0], 0); pen.lineTo(zero[0], height);
      pen.stroke();
      pen.lineWidth = 1.6;
      for (let i = 1; i < x.length; i += 1) {
        if ([x[i - 1], x[i], v[i - 1], v[i]].includes(null)) continue;
        pen.strokeStyle = store.setup.modes[mode[i]]?.colour ?? "#98a2b0";
        pen.beginPath();
        pen.moveTo(px(i - 1), py(i - 1)); pen.lineTo(px(i), py(i));
        pen.stroke();
      }
      const last = x.length - 1;
      if (last >= 0) {
        pen.fillStyle = ink().text;
        pen.beginPath();
        pen.arc(px(last), py(last), 4, 0, 2 * Math.PI);
        pen.fill();
      }
      const unit = (name) => store.setup.outputs.find((one) => one.name === name).unit;
      const said = (i) => `${words(pair[i])} ${number(reach[i][0], 3)} to ${quantity(reach[i][1], unit(pair[i]), 3)}`;
      put(about, t("across {x}, up {y}; every step of the last {time}", { x: said(0), y: said(1), time: quantity(seconds, "s", 3) }));
    },
  };
}

const wider = (range, value) => (value === null ? range : range === null ? [value, value] : [Math.min(range[0], value), Math.max(range[1], value)]);
