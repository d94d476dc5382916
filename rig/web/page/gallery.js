// The moving pictures of the opening, drawn in a thread of its own, so that the page answers while they move.
//
// The page sends {id, canvas, scene} once for each picture, then {id, width, height, ratio} when its place changes, {id, seen}
// when it comes into view or leaves it, and {hold} to stop all of them. `{painted: id}` is the answer to a first picture.

import { Solids } from "/page/solids.js";

const RATE = 15; // pictures of a track in a second
const pictures = new Map(); // id -> {canvas, scene, solids, number, width, height, ratio, seen}
let tracks = {}, hold = false;

/** Places of all numbers in nested lists: [list, index] of each. */
const leaves = (value) => value.flatMap((one, i) => (Array.isArray(one) ? leaves(one) : [[value, i]]));

/** The frames of a track, as docs/page_tracks.py packs them. */
function unpacked({ count, first, moves }) {
  const frames = [first, ...Array.from({ length: count - 1 }, () => ({}))];
  for (const [path, name, which, steps] of moves) {
    let value = first[path]?.[name];
    for (let k = 1; k < count; k += 1) {
      if (which) {
        const all = leaves(value = structuredClone(value));
        which.forEach((i, j) => { const [list, at] = all[i]; list[at] += steps[(k - 1) * which.length + j] / 1000; });
      } else value = steps[k - 1];
      if (value !== null) (frames[k][path] ??= {})[name] = value;
    }
  }
  return frames;
}

function paint(id, one) {
  const { canvas, width, height, ratio } = one, track = tracks[one.scene], first = !one.solids;
  if (!track || !width) return;
  one.solids ??= new Solids(track.still);
  track.frames ??= unpacked(track);
  one.solids.move(track.frames[one.number % track.count]);
  one.number += 1;
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  one.solids.draw({ pen, width, height });
  if (first) postMessage({ painted: id });
}

function tick() { for (const [id, one] of pictures) if (one.seen && !(hold && one.solids)) paint(id, one); }

onmessage = ({ data: { id, hold: held, ...told } }) => {
  if (held !== undefined) hold = held;
  if (id !== undefined) pictures.set(id, { number: 0, ...pictures.get(id), ...told });
};
fetch("/page/tracks.json").then((answer) => answer.json()).then((all) => { tracks = all; setInterval(tick, 1000 / RATE); });
