// What a rig does at a value: colour, meaning, and a word of it. Regions of maps, and of the eigenvalues of a closed loop.

import { quantity } from "/page/dom.js";
import { t } from "/page/text.js";

const GREEN = "#2e7d5b", AMBER = "#c98f1e", RED = "#b8452f";
const QUIET = t("it is quiet"), VIBRATES = t("it vibrates");

export const REGIONS = {
  I: [GREEN, t("sliding, no vibration found"), QUIET], II: [AMBER, t("sliding and vibration: the past decides"), t("quiet or not: the past decides")],
  III: [RED, t("vibration only"), VIBRATES], stuck: ["#6f6fae", t("nothing moves"), t("nothing moves")],
  stable: [GREEN, t("sliding is stable"), t("small vibrations die out")], unstable: [RED, t("sliding is unstable"), VIBRATES], "?": ["#808080", t("undecided"), t("undecided")],
};

/** The map of a slider {low, high, spans: [[end, region]]} as a CSS background over the range {low, high} of the slider. */
export function background(map, { low, high }) {
  const part = (value) => `${(100 * (value - low)) / (high - low)}%`;
  const stops = map.spans.map(([end, region], i) => `${REGIONS[region][0]} ${part(i ? map.spans[i - 1][0] : map.low)} ${part(end)}`);
  return `linear-gradient(90deg, transparent ${part(map.low)}, ${stops.join(", ")}, transparent ${part(map.high)})`;
}

/** What the rig does at a value, and where the nearest quiet values are. */
export function told(map, value, unit) {
  const calm = (region) => ["I", "stable"].includes(region), here = map.spans.findIndex(([end]) => value <= end);
  if (here < 0 || value < map.low) return "";
  const word = REGIONS[map.spans[here][1]][2];
  const kinds = new Set(map.spans.map(([, region]) => region).filter((region) => !["stuck", "?"].includes(region)));
  if (kinds.size === 1 && kinds.has(map.spans[here][1])) return t("{word} at every value: this slider does not decide it", { word });
  if (calm(map.spans[here][1])) {
    const ends = [here ? t("from {value}", { value: quantity(map.spans[here - 1][0], unit, 3) }) : "", here < map.spans.length - 1 ? t("up to {value}", { value: quantity(map.spans[here][0], unit, 3) }) : ""];
    return [word, ...ends].filter(Boolean).join(" ");
  }
  const below = map.spans.findLastIndex(([, region], i) => i < here && calm(region)), above = map.spans.findIndex(([, region], i) => i > here && calm(region));
  const places = [below < 0 ? "" : t("quiet below {value}", { value: quantity(map.spans[below][0], unit, 3) }),
    above < 0 ? "" : t("quiet above {value}", { value: quantity(map.spans[above - 1][0], unit, 3) })].filter(Boolean);
  return [word, ...(places.length ? places : [t("no value here is quiet for certain")])].join("; ");
}
