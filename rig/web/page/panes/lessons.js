// Lessons: a list, the text of one, a button that puts its rig on the bench, and a Run at each command whose result can be
// compared with the numbers that stand beside it. The server makes the HTML from its own pages.

import { get, post } from "/page/api.js";
import { attempting, data, h, pane } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";
import { language, said, t } from "/page/text.js";

export function create(bench) {
  const fault = data("div", { class: "fault", role: "alert" });
  const attempt = attempting(fault);
  const text = data("article", { id: "lesson", class: "lesson" });
  const take = h("button", { id: "lesson-scene", disabled: true, onclick: () => { bench.choose(chosen().scene); bench.go("bench"); } }, t("Put its rig on the bench"));
  const list = data("select", { id: "lessons", "aria-label": t("lesson"), onchange: () => bench.go(`lessons/${list.value}`) });
  let all = [], shown = "";
  const chosen = () => all.find(({ number }) => String(number) === list.value);

  /** A Run for each command of a block, with its output below. */
  function offer(block) {
    for (const line of block.textContent.split("\n").filter((one) => /^rig [a-z]/.test(one)).reverse()) {
      const jobs = jobsOf([line], attempt);
      block.after(h("div", { class: "row small" }, h("button", { class: "run", title: line, onclick: () => attempt(async () => {
        await post("/api/lesson/run", { number: chosen().number, command: line });
        jobs.look();
      }) }, t("Run"))), jobs.element);
    }
  }

  function show() {
    return attempt(async () => {
      if (shown === list.value) return;
      const { html } = await post("/api/lesson", { number: chosen().number, language });
      shown = list.value;
      text.innerHTML = html;
      text.querySelectorAll("pre").forEach((one) => { one.tabIndex = 0; offer(one); });
      take.disabled = false;
    });
  }

  return {
    element: h("div", { class: "split" }, pane(t("Lessons"), list, take, fault), h("div", { class: "card" }, text)),
    enter: (number) => attempt(async () => {
      if (!all.length) {
        all = await get("/api/lessons");
        list.replaceChildren(...all.map((one) => h("option", { value: one.number }, `${one.number}. ${said(one.title)} (${said(one.time)})`)));
      }
      if (number) list.value = number;
      await show();
    }),
  };
}
