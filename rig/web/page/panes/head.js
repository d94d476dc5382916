// The head: which run, its phase and time, stop and emergency stop within reach wherever the page is scrolled to.

import { h, number, typed } from "/page/dom.js";

const PHASES = {
  idle: "no run yet", starting: "starting", running: "running", paused: "paused", ending: "ending", ended: "ended",
};

const FAULTS = ["fault", "diverged", "limit", "emergency"]; // kinds of events

export function create(bench) {
  const { store } = bench;
  const run = h("span", { class: "faint", id: "run" });
  const phase = h("strong", { id: "phase", role: "status" });
  const doing = h("span", { class: "small faint", id: "doing" }); // what a run that starts is waiting for
  const time = h("span", { id: "time" });
  const verdict = h("span", { id: "verdict" });
  const fault = h("div", { class: "fault", id: "fault", role: "alert", style: "flex-basis: 100%" });

  const cause = h("div", { class: "fault", id: "cause", role: "alert", style: "flex-basis: 100%" });

  const act = (body) => async () => {
    try {
      await bench.command(body());
      tell("");
    } catch (error) {
      tell(error.message);
    }
  };
  const button = (text, body, properties = {}) => h("button", { onclick: act(body), ...properties }, text);
  const pause = button("Pause", () => ({ do: store.state.phase === "paused" ? "resume" : "pause" }), { id: "pause" });
  const step = button("Single step", () => ({ do: "step" }), { id: "step", title: "one frame of the paused run" });
  const impulse = h("input", { type: "text", inputMode: "decimal", value: "0.05", class: "value", id: "impulse",
    "aria-label": "impulse of the knock in N s", title: "impulse in N s", style: "width: 4.5rem" });
  const knock = button("Knock", () => ({ do: "knock", impulse: typed(impulse.value) }), { id: "knock" });
  const stop = button("Stop", () => ({ do: "stop" }), { id: "stop" });
  const emergency = button("EMERGENCY STOP", () => ({ do: "emergency" }), { id: "emergency", class: "emergency",
    title: "all actuators to their safe values at once; half a second later the run ends" });

  /** The last fault that the run itself has told, while it goes on. */
  function broken() {
    const found = store.active ? store.events.findLast(({ kind }) => FAULTS.includes(kind)) : null;
    return found ? `${found.source}: ${found.text}` : "";
  }

  function show() {
    const rate = store.active && store.health ? `, pace ${number(store.health.rate, 3)}` : ""; // of the last fifth of a second
    time.textContent = store.setup ? `t = ${store.t.toFixed(2)} s${rate}` : "";
    const word = store.verdict;
    verdict.textContent = word;
    verdict.className = { VALID: "good", DEGRADED: "warn", INVALID: "bad" }[word] ?? "";
  }

  function tell(text) { fault.textContent = text; }

  return {
    element: h("header", {}, h("h1", {}, "friction-rig"), phase, doing, time, verdict, run, h("span", { class: "grow" }),
      h("span", { class: "row" }, pause, step, h("label", { class: "row small" }, impulse, "N s"), knock, stop, emergency), fault, cause),
    tell,
    state() {
      const { state, online, active } = store;
      const live = ["running", "paused"].includes(state.phase);
      phase.textContent = online ? PHASES[state.phase] : `not connected: ${store.why}`;
      phase.className = online ? "" : "bad";
      doing.textContent = state.phase === "starting" ? state.lines.at(-1) ?? "" : "";
      run.textContent = state.run ? `${state.title} (${state.run})` : state.title ?? "";
      pause.textContent = state.phase === "paused" ? "Resume" : "Pause";
      pause.disabled = knock.disabled = !(online && live);
      step.disabled = !(online && state.phase === "paused");
      stop.disabled = emergency.disabled = !(online && active);
      show();
      document.title = active ? `${state.title}: ${PHASES[state.phase]}` : "friction-rig bench";
    },
    draw() {
      const why = broken();
      if (cause.textContent !== why) cause.textContent = why;
      show();
    },
  };
}
