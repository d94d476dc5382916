// What the run is worth so far, in words: timing verdict, loop latency, losses, energy residual.

import { h, number, pane } from "/page/dom.js";

const MEANING = {
  VALID: "times can be trusted",
  DEGRADED: "times can be trusted with care",
  INVALID: "do not trust times of this run",
};

export function create({ store }) {
  const table = h("table", { id: "trust" });
  return {
    element: pane("Timing and energy", table),
    setup() { table.replaceChildren(); },
    draw() {
      const { health, setup, state } = store;
      if (!health || !setup) return;
      const late = (100 * health.late) / Math.max(health.tick, 1);
      const word = store.verdict, reasons = state.outcome?.reasons ?? store.status?.reasons ?? [];
      const rows = [
        ["timing", word ? `${word}${state.outcome ? "" : " so far"}: ${MEANING[word] ?? ""}` : store.status ? "this run does not follow the clock" : "not judged yet"],
        ["because", reasons.join("; ") + (reasons.length && !state.outcome ? "; what the recorder and the controllers missed is counted at the end" : "")],
        ["late frames", `${health.late} of ${health.tick} (${number(late, 2)} %); 99 of 100 begin at most ${number(health.lateness_us / 1e3, 3)} ms late, the worst ${number(health.worst_us / 1e3, 3)} ms`],
        ["loop", `${health.held} commands held because no new one arrived, ${health.drops} lost`],
        ["energy", `residual of the energy balance: ${health.energy_error === null ? "none" : health.energy_error.toExponential(0)} of the largest term`],
        ["stick", `${number(100 * health.stick_share, 3)} % of the time`],
        ["refused", `${health.refused} messages`],
        ["this page", `${store.dropped} pictures left out, ${store.lost} messages lost on the way to the server`],
      ];
      table.replaceChildren(...rows.map(([name, text]) => h("tr", {}, h("th", {}, name),
        h("td", { class: name === "timing" ? { VALID: "good", DEGRADED: "warn", INVALID: "bad" }[word] ?? "" : "" }, text))));
    },
  };
}
