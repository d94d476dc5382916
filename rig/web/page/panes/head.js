// The head: where one is, how the run goes, and the emergency stop, which stands at one place in every view.

import { data, h, number, put } from "/page/dom.js";
import { decimal, language, languages, said, speak, t } from "/page/text.js";

const PHASES = {
  idle: t("no run yet"), starting: t("starting"), running: t("running"), paused: t("paused"), ending: t("ending"), ended: t("ended"),
};
const FAULTS = ["fault", "diverged", "limit", "emergency"]; // kinds of events

export function create(bench, views) {
  const { store } = bench;
  const run = data("span", { class: "soft small", id: "run" });
  const phase = h("strong", { id: "phase", role: "status" });
  const time = h("span", { id: "time" });
  const fault = data("div", { class: "fault", id: "fault", role: "alert" }), cause = data("div", { class: "fault", id: "cause", role: "alert" });
  const links = Object.entries(views).map(([name, text]) => h("a", { href: `#${name}` }, text));
  const other = Object.keys(languages).find((one) => one !== language);
  const speaks = h("button", { class: "link small language", translate: "no", lang: other, onclick: () => speak(other) }, languages[other]);
  const emergency = h("button", { id: "emergency", class: "emergency", title: t("all actuators to their safe values at once; half a second later the run ends"),
    onclick: () => bench.command({ do: "emergency" }).then(() => tell(""), (error) => tell(error.message)) }, t("EMERGENCY STOP"));

  /** The last fault that the run itself has told, while it goes on. */
  function broken() {
    const event = store.active ? store.events.findLast(({ kind }) => FAULTS.includes(kind)) : null;
    return event ? `${event.source}: ${said(event.text)}` : "";
  }

  function tell(text) { fault.textContent = said(text); }

  function draw() {
    const rate = store.active && store.health ? `, ${t("pace")} ${number(store.health.rate, 3)}` : ""; // of the last fifth of a second
    put(time, bench.shown?.setup ? `t = ${decimal(store.t.toFixed(2))} s${rate}` : "");
    const why = broken();
    put(cause, why);
  }

  const brand = h("a", { class: "brand", href: "#rigs", translate: "no" }, "friction-rig"), narrow = matchMedia("(max-width: 720px)"); // as in style.css
  const rest = [h("nav", { "aria-label": t("views") }, ...links), h("span", { class: "status" }, run, time, phase)];
  const order = () => (narrow.matches ? emergency : brand).after(...rest); // of keys as it is seen
  const element = h("header", {}, brand, speaks, emergency, fault, cause);
  narrow.addEventListener("change", order);
  order();

  return {
    element,
    tell,
    draw,
    show(view) { links.forEach((one, i) => (Object.keys(views)[i] === view ? one.setAttribute("aria-current", "page") : one.removeAttribute("aria-current"))); },
    state() {
      const { state, online, active } = store;
      phase.className = online ? "" : "bad";
      const known = active || !store.setup || bench.shown.setup; // after a run, as long as it is the one that is shown
      phase.textContent = online ? PHASES[known ? state.phase : "idle"] : `${t("not connected")}: ${said(store.why)}`;
      run.textContent = state.phase === "starting" || !known ? "" : state.run ? `${said(state.title)} (${state.run})` : said(state.title ?? "");
      emergency.disabled = !(online && active);
      document.title = active ? `${said(state.title)}: ${PHASES[state.phase]}` : "friction-rig";
      draw();
    },
  };
}
