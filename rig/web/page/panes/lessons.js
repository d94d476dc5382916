// Lessons: a list, the text of one, and a button that chooses its scene. The server makes the HTML from its own pages.

import { get, post } from "/page/api.js";
import { attempting, h, pane } from "/page/dom.js";

export function create(bench) {
  const fault = h("div", { class: "fault", role: "alert" });
  const attempt = attempting(fault);
  const text = h("div", { id: "lesson", class: "small scroll lesson" });
  const take = h("button", { id: "lesson-scene", disabled: true, onclick: () => bench.choose(chosen().scene) }, "Choose its scene");
  const list = h("select", { id: "lessons", "aria-label": "lesson", onchange: show });
  let all = [];
  const chosen = () => all.find(({ number }) => String(number) === list.value);

  function show() {
    return attempt(async () => {
      const { html } = await post("/api/lesson", { number: chosen().number });
      text.innerHTML = html;
      text.scrollTop = 0;
      take.disabled = false;
    });
  }

  const open = () => attempt(async () => {
    if (all.length) return;
    all = await get("/api/lessons");
    list.replaceChildren(...all.map(({ number, title, time }) => h("option", { value: number }, `${number}. ${title} (${time})`)));
    await show();
  });
  const whole = h("details", { ontoggle: () => whole.open && open() }, h("summary", {}, "Show the lessons"),
    h("div", { class: "row" }, list, take), text);
  return { element: pane("Lessons", whole, fault) };
}
