// Who operates the run that a class watches. The page of the user hands the operation over and takes it back.

import { post } from "/page/api.js";
import { attempting, data, h } from "/page/dom.js";
import { t } from "/page/text.js";

export function create(bench) {
  const fault = h("div", { class: "fault", role: "alert" }), act = attempting(fault), rows = h("div", { class: "stack" });
  const element = h("div", { class: "card stack", id: "class", hidden: true }, rows, fault);
  const row = (text, name, button, id, body) => h("div", { class: "row small" }, h("span", {}, text), data("strong", { class: "grow" }, name),
    h("button", { id, onclick: () => act(() => post("/api/class", body)) }, button));
  let known = "";
  return {
    element,
    state() {
      const { seat } = bench.store, text = JSON.stringify(seat);
      element.hidden = !seat?.holder && !seat?.asking.length;
      if (text === known || !seat) return;
      known = text;
      rows.replaceChildren(...(seat.holder ? [row(t("operates the run:"), seat.name, t("Take back"), "take-back", { do: "back" })] : []),
        ...seat.asking.map(({ id, name }) => row(t("asks to operate:"), name, t("Hand over"), `hand-${id}`, { do: "hand", to: id })));
    },
  };
}
