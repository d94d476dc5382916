// What the run is worth so far: a chip with the timing verdict, the share of late frames and the energy residual, which
// unfolds to the whole of it.

import { data, h, number, put } from "/page/dom.js";
import { said, t } from "/page/text.js";

const MEANING = {
  VALID: t("times can be trusted"), DEGRADED: t("times can be trusted with care"), INVALID: t("do not trust times of this run"),
};
const LOOK = { VALID: "good", DEGRADED: "doubtful", INVALID: "bad" };

export function create(bench) {
  const table = h("table", { id: "trust" });
  const verdict = data("strong", { id: "verdict" }), short = h("span", { class: "small" });
  const chip = h("details", { class: "chip", hidden: true }, h("summary", { title: t("timing and energy of this run") }, verdict, short), h("div", { class: "card" }, table));
  return {
    element: chip,
    draw() {
      const store = bench.shown;
      const { health, setup } = store, { state } = bench.store;
      chip.hidden = !health || !setup;
      if (chip.hidden) return;
      const late = number((100 * health.late) / Math.max(health.tick, 1), 2), word = store.verdict;
      const energy = health.energy_error === null ? "" : Math.abs(health.energy_error).toExponential(0);
      put(verdict, said(word));
      verdict.className = LOOK[word] ?? "";
      put(short, ` ${[t("{late} % late", { late }), energy && t("energy balanced to {energy}", { energy })].filter(Boolean).join(" · ")}`);
      if (!chip.open) return;
      const reasons = state.outcome?.reasons ?? store.status?.reasons ?? [];
      const rows = [
        [t("timing"), word ? `${state.outcome ? "" : t("so far: ")}${MEANING[word] ?? ""}` : store.status ? t("this run does not follow the clock") : t("not judged yet")],
        [t("because"), reasons.map(said).join("; ")],
        [t("late frames"), t("{late} of {all}; 99 of 100 begin at most {most} ms late, the worst {worst} ms",
          { late: health.late, all: health.tick, most: number(Math.round(health.lateness_us) / 1e3, 3), worst: number(Math.round(health.worst_us) / 1e3, 3) })],
        [t("loop"), t("{held} commands held because no new one arrived, {lost} lost", { held: health.held, lost: health.drops })],
        [t("energy"), energy ? t("residual of the energy balance: {energy} of the largest term", { energy }) : t("not known")],
        [t("stick"), t("{share} % of the time", { share: number(100 * health.stick_share, 3) })],
        [t("refused"), t("{count} messages", { count: health.refused })],
        [t("this page"), t("{dropped} pictures left out, {lost} messages lost on the way to the server", { dropped: store.dropped, lost: store.lost })],
      ];
      table.replaceChildren(...rows.map(([name, text]) => h("tr", {}, h("th", {}, name), h("td", {}, text))));
    },
  };
}
