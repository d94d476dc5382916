// Curves over time on a canvas: as much as a bench needs, without a library.

import { decimal } from "/page/text.js";

let inks = null;
matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => { inks = null; });

/** The colours of the page's scheme, for canvases: text, soft, line, curve. */
export function ink() {
  const style = getComputedStyle(document.documentElement);
  inks ??= Object.fromEntries(["text", "soft", "line", "curve"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  return inks;
}

const places = new WeakMap(); // canvas -> its width and height on the page, so that drawing forces no layout
const watcher = new ResizeObserver((changes) => {
  for (const { target, contentRect } of changes) places.set(target, contentRect);
});

/** Set the size of a canvas to its place on the page; returns its context, width and height in CSS pixels. */
export function sized(canvas, wanted) {
  if (!places.get(canvas)?.width) { places.set(canvas, { width: canvas.clientWidth || 300, height: canvas.clientHeight }); watcher.observe(canvas); }
  const { width } = places.get(canvas), height = wanted ?? places.get(canvas).height;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    if (wanted !== undefined) canvas.style.height = `${height}px`;
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

/** Round numbers from low to high, about `count`. */
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1);
  const base = 10 ** Math.floor(Math.log10(raw));
  const step = base * ([1, 2, 5, 10].find((one) => one * base >= raw) ?? 10);
  const round = [];
  for (let i = Math.ceil(low / step); i * step <= high; i += 1) round.push(i * step);
  return round;
}

/** A tick in words: with as many decimals as its distance to the next one has, so that no two read alike. */
export function ticked(tick, all) {
  const step = all.length > 1 ? all[1] - all[0] : Math.abs(tick) || 1, decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return decimal(decimals > 6 || Math.abs(tick) >= 1e6 ? tick.toExponential(Math.max(0, Math.floor(Math.log10(Math.abs(tick) / step || 1)))) : String(Number(tick.toFixed(decimals))));
}

/** Draw the band of a curve (store.js) from time t0 to t1; `x(t)` and `y(v)` are its places. `dots`: a measurement, as points. */
export function band(pen, curve, t0, t1, x, y, colour, dots = false) {
  const { t, low, high } = curve;
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 1.6;
  pen.lineJoin = "round";
  pen.globalAlpha = dots ? 0.7 : 1;
  pen.beginPath();
  let drawing = false, column = -Infinity, down = 0, up = 0;
  for (let i = Math.max(curve.from(t0) - 1, 0); i < t.length; i += 1) {
    if (low[i] === null) { drawing = false; continue; }
    const at = x(t[i]), top = y(high[i]), bottom = y(low[i]);
    if (dots) { pen.rect(at - 0.8, top - 0.8, 1.6, Math.max(bottom - top, 0) + 1.6); if (t[i] > t1) break; continue; }
    const wide = i > 0 && low[i] !== high[i] && at - x(t[i - 1]) > 2;
    if (wide) pen.fillRect(x(t[i - 1]), top - 0.8, at - x(t[i - 1]), bottom - top + 1.6); // extremes hold for their whole span
    else if (!drawing) { pen.moveTo(at, bottom); pen.lineTo(at, top); } else if (at - column < 0.5) { // many in one column of points
      if (top < up) { pen.lineTo(at, top); up = top; }
      if (bottom > down) { pen.lineTo(at, bottom); down = bottom; }
      if (t[i] > t1) break;
      continue;
    } else { pen.lineTo(at, top); if (bottom !== top) pen.lineTo(at, bottom); }
    drawing = !wide;
    [column, up, down] = [at, top, bottom];
    if (t[i] > t1) break;
  }
  if (dots) pen.fill(); else pen.stroke();
  pen.globalAlpha = 1;
}
