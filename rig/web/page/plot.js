// Curves over time on a canvas: as much as a bench needs, without a library.

import { number } from "/page/dom.js";

let inks = null;
matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => { inks = null; });

/** The colours of the page's scheme, for canvases: text, faint, line. */
export function ink() {
  const style = getComputedStyle(document.documentElement);
  inks ??= Object.fromEntries(["text", "faint", "line"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  return inks;
}

/** Set the size of a canvas to its place on the page; returns its context, width and height in CSS pixels. */
export function sized(canvas, height) {
  const width = canvas.clientWidth || 300;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
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
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i += 1) found.push(i * step);
  return found;
}

/** Draw bands [{t, low, high, colour, pale, factor}] (store.js) from time t0 to t1 with axes; returns the range of the values. */
export function lines(canvas, height, drawn, t0, t1, range) {
  const { pen, width } = sized(canvas, height);
  const left = 54, right = 6, top = 6, bottom = 18;
  let low = Infinity, high = -Infinity;
  for (const { t, factor = 1, ...ends } of drawn) {
    for (let i = t.length - 1; i >= 0 && t[i] >= t0; i -= 1) {
      if (ends.low[i] === null) continue;
      const [a, b] = [ends.low[i] * factor, ends.high[i] * factor];
      low = Math.min(low, a, b); high = Math.max(high, a, b);
    }
  }
  if (low > high) return range;
  const margin = 0.05 * (high - low) || Math.abs(high) * 0.05 || 1e-9;
  low -= margin; high += margin;
  if (range) { // it grows at once and shrinks slowly, so that the picture does not tremble
    low = Math.min(low, range[0] + 0.1 * (low - range[0]));
    high = Math.max(high, range[1] + 0.1 * (high - range[1]));
  }
  const x = (t) => left + ((t - t0) / (t1 - t0)) * (width - left - right);
  const y = (v) => top + ((high - v) / (high - low)) * (height - top - bottom);
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = ink().faint;
  pen.strokeStyle = ink().line;
  pen.lineWidth = 1;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  pen.beginPath();
  for (const tick of ticks(low, high, height / 40)) {
    pen.moveTo(left, y(tick)); pen.lineTo(width - right, y(tick));
    pen.fillText(number(tick, 3), left - 4, y(tick));
  }
  pen.textAlign = "center";
  for (const tick of ticks(t0, t1, width / 110)) {
    pen.moveTo(x(tick), top); pen.lineTo(x(tick), height - bottom);
    pen.fillText(`${number(tick, 5)} s`, x(tick), height - bottom + 10);
  }
  pen.stroke();
  pen.save();
  pen.beginPath();
  pen.rect(left, top, width - left - right, height - top - bottom);
  pen.clip();
  pen.lineJoin = "round";
  for (const { t, colour, pale = false, factor = 1, ...ends } of drawn) {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.globalAlpha = pale ? 0.45 : 1;
    pen.lineWidth = pale ? 1 : 1.6;
    let begin = t.length - 1;
    while (begin > 0 && t[begin] >= t0) begin -= 1;
    for (let end = begin; begin < t.length; begin = end + 1) { // from one gap to the next
      end = ends.low.indexOf(null, begin);
      if (end < 0) end = t.length;
      if (end === begin) continue;
      pen.beginPath();
      for (let i = begin; i < end; i += 1) { // one value is a point of a line; extremes hold for their whole span
        if (i > 0 && ends.low[i] !== ends.high[i]) pen.lineTo(x(t[i - 1]), y(ends.high[i] * factor));
        pen.lineTo(x(t[i]), y(ends.high[i] * factor));
      }
      for (let i = end - 1; i >= begin; i -= 1) {
        pen.lineTo(x(t[i]), y(ends.low[i] * factor));
        if (i > 0 && ends.low[i] !== ends.high[i]) pen.lineTo(x(t[i - 1]), y(ends.low[i] * factor));
      }
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
  }
  pen.restore();
  pen.globalAlpha = 1;
  return [low, high];
}
