// Lessons: a list, the text of one, a button that puts its rig on the bench, and a Run at each command whose result can be
// compared with the numbers that stand beside it. The server makes the HTML from its own pages.

import { get, post } from "/page/api.js";
import { attempting, data, front, h } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";
import { language, said, t } from "/page/text.js";

const COMMAND = /^rig [a-z]/;

export function create(bench) {
  const fault = data("div", { class: "fault", role: "alert" });
  const attempt = attempting(fault);
  const text = data("article", { id: "lesson", class: "lesson" });
  const take = h("button", { id: "lesson-scene", disabled: true, onclick: () => { bench.choose(shown.scene); bench.go("bench"); } }, t("Put its rig on the bench"));
  const list = h("div", { id: "lessons", class: "stack" });
  let all = [], shown = null;

  /** The table of expected numbers that follows a command, before the next command; null without one. */
  function tableOf(block) {
    let next = block.nextElementSibling;
    while (next && next.tagName !== "TABLE" && !(next.tagName === "PRE" && COMMAND.test(next.textContent))) next = next.nextElementSibling;
    return next?.tagName === "TABLE" ? next : null;
  }

  /** Put the numbers that a command has given beside those of the table, with a mark each. */
  function compare(table, { numbers }) {
    const rows = [...(table?.tBodies[0].rows ?? [])], given = numbers.slice(-rows.length || numbers.length);
    if (!rows.length || given.length < rows.length) return;
    for (const one of table.querySelectorAll(".given")) one.remove();
    table.tHead.rows[0].append(h("th", { class: "given" }, t("your run")), h("th", { class: "given" }));
    rows.forEach((row, i) => {
      const { value, agrees } = given[i];
      row.append(data("td", { class: "given number" }, value), h("td", { class: `given ${agrees ? "good" : "bad"}` }, agrees ? t("✓ agrees") : t("✗ differs")));
    });
  }

  /** A Run for each command of a block, with its output below. */
  function offer(block) {
    for (const line of block.textContent.split("\n").filter((one) => COMMAND.test(one)).reverse()) {
      const table = tableOf(block), jobs = jobsOf([line], attempt, ([latest]) => compare(table, latest));
      block.after(h("div", { class: "row small" }, h("button", { class: "run", title: line, onclick: () => attempt(async () => {
        await post("/api/lesson/run", { number: shown.number, command: line });
        jobs.look();
      }) }, t("Run"))), jobs.element);
    }
  }

  function show(lesson) {
    return attempt(async () => {
      if (shown === lesson) return;
      const { html } = await post("/api/lesson", { number: lesson.number, language });
      shown = lesson;
      text.innerHTML = html;
      text.querySelectorAll("pre").forEach((one) => { one.tabIndex = 0; offer(one); });
      take.disabled = false;
      [...list.children].forEach((one, i) => (all[i] === shown ? one.setAttribute("aria-current", "page") : one.removeAttribute("aria-current")));
    });
  }

  const row = (one) => h("a", { href: `#lessons/${one.number}`, class: "small" }, h("strong", {}, `${one.number}. ${said(one.title)}`), h("div", { class: "soft" }, said(one.time)));

  return {
    element: h("div", { class: "split" }, front(t("Lessons"), fault, list), h("div", { class: "card stack" }, take, text)),
    enter: (number) => attempt(async () => {
      if (!all.length) {
        all = await get("/api/lessons");
        list.replaceChildren(...all.map(row));
      }
      const lesson = all.find((one) => String(one.number) === number) ?? shown ?? all[0];
      await show(lesson);
    }),
  };
}
