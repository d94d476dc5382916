// The rig as a moving picture. Motions of body and surface have one magnification, so that they move together in stick;
// the body has the colour of the contact mode; arrows show friction and normal force.

import { h, number, pane } from "/page/dom.js";
import { sized } from "/page/plot.js";

const HEIGHT = 230;

export function create({ store }) {
  const canvas = h("canvas", { "aria-label": "moving picture of the rig" });
  const text = h("div", { class: "small faint", id: "rig-text" });
  let travel = 0; // of the surface, magnified
  let seen = -Infinity; // simulated time up to which it is integrated

  return {
    element: pane("Rig", canvas, text),
    setup() {
      travel = 0;
      seen = -Infinity;
      canvas.hidden = false;
      text.textContent = "";
    },
    draw() {
      const picture = store.setup?.picture;
      if (!store.setup) return;
      if (!picture || picture.kind === "own") {
        draws.bars(sized(canvas, HEIGHT), store);
        text.textContent = "outputs now, each as a share of the largest so far";
        return;
      }
      const surface = store.outputs[picture.surface];
      for (let i = surface.t.findIndex((t) => t > seen); i > 0 && i < surface.t.length; i += 1) {
        travel += picture.motion * (surface.v[i] ?? 0) * (surface.t[i] - surface.t[i - 1]);
      }
      seen = surface.t[surface.t.length - 1] ?? seen;
      const mode = store.setup.modes[store.modes.v[store.modes.v.length - 1]];
      const at = (name) => (name ? store.now(name) || 0 : 0);
      draws[picture.kind](sized(canvas, HEIGHT), picture, at, travel, mode?.colour ?? "#98a2b0");
      text.textContent = `${mode?.name ?? ""}, friction ${number(at(picture.friction), 3)} N, normal force `
        + `${number(at(picture.normal), 3)} N, motion × ${picture.motion}`;
    },
  };
}

function arrow(pen, x, y, dx, dy, colour) {
  const length = Math.hypot(dx, dy);
  if (length < 2) return;
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(x, y); pen.lineTo(x + dx, y + dy);
  pen.stroke();
  const [ux, uy] = [dx / length, dy / length];
  pen.beginPath();
  pen.moveTo(x + dx + 5 * ux, y + dy + 5 * uy);
  pen.lineTo(x + dx - 5 * ux - 5 * uy, y + dy - 5 * uy + 5 * ux);
  pen.lineTo(x + dx - 5 * ux + 5 * uy, y + dy - 5 * uy - 5 * ux);
  pen.fill();
}

function spring(pen, x0, y0, x1, y1) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const length = Math.hypot(dx, dy) || 1;
  pen.strokeStyle = "#c4c8d0";
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(x0, y0);
  for (let i = 0; i <= 10; i += 1) {
    const share = 0.12 + 0.076 * i;
    const side = i === 0 || i === 10 ? 0 : (i % 2 ? 7 : -7);
    pen.lineTo(x0 + share * dx - side * dy / length, y0 + share * dy + side * dx / length);
  }
  pen.lineTo(x1, y1);
  pen.stroke();
}

const FRICTION = "#d55e00", NORMAL = "#56b4e9";

const draws = {
  on_belt({ pen, width, height }, picture, at, travel, colour) {
    const scale = Math.min(width / 3.4, height / 1.5); // pixels per length of the picture
    const x = (v) => width / 2 + v * scale, y = (v) => height * 0.72 - v * scale;
    pen.fillStyle = "#4a505c";
    pen.fillRect(x(-1.5), y(0), 3 * scale, 0.05 * scale);
    pen.strokeStyle = "#d6dbe2";
    pen.lineWidth = 2;
    pen.beginPath();
    for (let mark = -1.5 + ((travel % 0.25) + 0.25) % 0.25; mark < 1.5; mark += 0.25) { pen.moveTo(x(mark), y(0)); pen.lineTo(x(mark), y(-0.05)); }
    pen.stroke();
    const across = picture.lifted ? 1 : 0.25;
    const px = picture.motion * at(picture.along), py = (picture.lifted ? 0.17 : 0) + picture.motion * across * at(picture.up);
    spring(pen, x(-1.4), y(0.2), x(px - 0.2), y(py + 0.2));
    pen.fillStyle = "#969eaa";
    pen.fillRect(x(-1.46), y(0.45), 0.06 * scale, 0.45 * scale);
    pen.save();
    pen.translate(x(px), y(py + 0.2));
    pen.rotate(-(picture.motion * at(picture.turn)) + picture.lean);
    pen.fillStyle = colour;
    if (picture.lean) pen.fillRect(-0.06 * scale, -0.55 * scale, 0.12 * scale, 0.75 * scale);
    else pen.fillRect(-0.2 * scale, -0.17 * scale, 0.4 * scale, 0.36 * scale);
    pen.restore();
    const force = 0.5 * scale / picture.force;
    arrow(pen, x(px), y(py + 0.05), at(picture.friction) * force, 0, FRICTION);
    const load = Math.max(at(picture.normal), 0) * 0.5 * force;
    arrow(pen, x(px), y(py + 0.42) - load, 0, load, NORMAL);
  },

  on_disc({ pen, width, height }, picture, at, travel, colour) {
    const radius = Math.min(width, height) * 0.45, cx = width / 2, cy = height / 2;
    pen.fillStyle = "#4a505c";
    pen.beginPath();
    pen.arc(cx, cy, radius, 0, 2 * Math.PI);
    pen.fill();
    pen.strokeStyle = "#d6dbe2";
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (let i = 0; i < 24; i += 1) {
      const turn = travel + (i * Math.PI) / 12, inner = i % 8 ? 0.93 : 0.3;
      pen.moveTo(cx + inner * radius * Math.cos(turn), cy - inner * radius * Math.sin(turn));
      pen.lineTo(cx + 0.99 * radius * Math.cos(turn), cy - 0.99 * radius * Math.sin(turn));
    }
    pen.stroke();
    const angle = picture.motion * at(picture.angle), [c, s] = [Math.cos(angle), -Math.sin(angle)];
    spring(pen, cx + 0.55 * radius, cy + 0.75 * radius, cx + 0.55 * radius * c, cy + 0.55 * radius * s);
    pen.strokeStyle = "#969eaa";
    pen.lineWidth = 8;
    pen.beginPath();
    pen.moveTo(cx, cy); pen.lineTo(cx + 0.8 * radius * c, cy + 0.8 * radius * s);
    pen.stroke();
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(cx + 0.8 * radius * c, cy + 0.8 * radius * s, 0.09 * radius, 0, 2 * Math.PI);
    pen.fill();
    const force = (at(picture.friction) / picture.force) * 0.5 * radius;
    arrow(pen, cx + 0.93 * radius * c, cy + 0.93 * radius * s, force * s, -force * c, FRICTION);
    const load = Math.max(at(picture.normal), 0) / picture.force * 0.25 * radius;
    arrow(pen, cx - radius - 14, cy - load / 2, 0, load, NORMAL);
  },

  bars({ pen, width, height }, store) {
    const names = store.setup.outputs.map(({ name }) => name).slice(0, 10);
    const row = height / Math.max(names.length, 1);
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "middle";
    names.forEach((name, i) => {
      const curve = store.outputs[name];
      const size = curve.v.reduce((most, v) => Math.max(most, Math.abs(v ?? 0)), 0) || 1;
      const middle = (i + 0.5) * row, zero = 130 + (width - 140) / 2;
      pen.fillStyle = store.setup.outputs[i].colour || "#56b4e9";
      const to = (store.now(name) || 0) / size * (width - 140) / 2;
      pen.fillRect(Math.min(zero, zero + to), middle - row * 0.3, Math.abs(to), row * 0.6);
      pen.fillStyle = "#98a2b0";
      pen.fillText(name.replaceAll("_", " ").slice(0, 22), 2, middle);
      pen.fillRect(zero, middle - row * 0.4, 1, row * 0.8);
    });
  },
};
