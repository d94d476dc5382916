// The mode of every contact over the last seconds, as strips of colours with their words.

import { h, pane } from "/page/dom.js";
import { ink, sized } from "/page/plot.js";

const SPAN = 5; // [s]
const HIGHEST = 22, ALL = 190; // [px] of one strip, and of many

export function create({ store }) {
  const canvas = h("canvas", { role: "img", "aria-label": "states of the contacts over time" });
  const legend = h("div", { class: "small" });
  const now = h("strong", { id: "contact" });
  const why = h("p", { class: "small faint" });
  const box = h("div", { hidden: true }, canvas, h("div", { class: "row" }, now, legend));
  return {
    element: pane("Contact", why, box),
    setup() {
      const { contacts, modes } = store.setup;
      box.hidden = contacts.length === 0;
      why.textContent = contacts.length ? "" : "This rig has no single contacts: it is bonded, or its contact is a film of points, which the picture shows.";
      legend.replaceChildren(...modes.map(({ name, colour }) =>
        h("span", {}, h("span", { class: "key", style: `background:${colour}` }), name, " ")));
    },
    draw() {
      const names = store.setup?.contacts ?? [];
      if (!names.length) return;
      const row = Math.max(Math.min(HIGHEST, ALL / names.length), 6), several = names.length > 1;
      const { pen, width } = sized(canvas, row * names.length);
      pen.font = "11px system-ui, sans-serif";
      pen.textBaseline = "middle";
      const left = several && row > 9 ? Math.max(...names.map((name) => pen.measureText(name).width)) + 8 : 0;
      const begin = Math.max(store.t - SPAN, 0), x = (time) => left + ((time - begin) / (store.t - begin || 1)) * (width - left);
      store.contacts.forEach(({ t, low: bits }, lane) => {
        if (left) { pen.fillStyle = ink().faint; pen.fillText(names[lane], 0, (lane + 0.5) * row); }
        for (let i = t.length - 1; i > 0 && t[i] >= begin; i -= 1) {
          const from = Math.max(x(t[i - 1]), left), met = store.setup.modes.filter((_, mode) => bits[i] & (1 << mode));
          const each = (row - (several ? 1 : 0)) / met.length; // modes that follow one another within a span are drawn below one another
          met.forEach(({ colour }, k) => {
            pen.fillStyle = colour;
            pen.fillRect(from, lane * row + k * each, x(t[i]) - from + 0.7, each);
          });
        }
      });
      now.textContent = several ? summary(store) : word(store, store.latest.contacts[0]);
    },
  };
}

const word = (store, mode) => store.setup.modes[mode]?.name ?? "";

/** How many contacts are in each mode now. */
function summary(store) {
  const words = store.latest.contacts.map((one) => word(store, one));
  return store.setup.modes.map(({ name }) => [words.filter((one) => one === name).length, name]).filter(([count]) => count)
    .map(([count, name]) => `${count} ${name}`).join(", ");
}
