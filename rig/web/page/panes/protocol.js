// The steps of the protocol; the one that goes on is marked.

import { h, pane } from "/page/dom.js";

export function create({ store }) {
  const list = h("ol", { class: "small" });
  const now = h("p", { class: "small", id: "step-now" });
  let shown = null;
  return {
    element: pane("Protocol", now, h("div", { class: "scroll" }, list)),
    setup() {
      shown = null;
      list.replaceChildren(...store.setup.protocol.map((text) => h("li", { class: "pre" }, text)));
    },
    draw() {
      const left = store.health?.eta_s ?? -1;
      now.textContent = [store.health?.phase, left >= 0 && store.active ? `${Math.round(left)} s left` : ""].filter(Boolean).join(", ");
      if (store.step === shown) return;
      shown = store.step;
      const same = [...list.children].filter((one) => one.textContent.trim() === shown);
      const before = [...list.children].findIndex((one) => one.className.includes("current"));
      const next = same.find((one) => [...list.children].indexOf(one) > before) ?? same[0];
      for (const one of list.children) {
        one.className = one === next ? "pre current" : "pre";
        if (one === next) one.setAttribute("aria-current", "step"); else one.removeAttribute("aria-current");
      }
    },
  };
}
