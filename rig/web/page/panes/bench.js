// The bench: the rig as a wide picture with its commands, values by hand, one time axis, and what else there is to know.
//
// It shows either a run, as `bench.shown` has it, or the scene that is chosen for the next one (`bench.chosen()`), never parts of
// both. A run is shown from its beginning until another scene is chosen after its end.

import { get, post } from "/page/api.js";
import { attempting, data, h, joined, number, pane, put, typed } from "/page/dom.js";
import { sentence } from "/page/experiment.js";
import { Store } from "/page/store.js";
import { said as told, t } from "/page/text.js";
import * as branchesOf from "/page/panes/branches.js";
import * as classOf from "/page/panes/class.js";
import * as eventsOf from "/page/panes/events.js";
import * as handsOf from "/page/panes/hands.js";
import * as hearOf from "/page/panes/hear.js";
import * as portraitOf from "/page/panes/portrait.js";
import * as protocolOf from "/page/panes/protocol.js";
import * as rigOf from "/page/panes/rig.js";
import * as timeOf from "/page/panes/time.js";
import * as trustOf from "/page/panes/trust.js";

const PROGRESS = /(\d+) of (\d+) compiled/;
const KEPT = "chosen"; // what has been chosen on this tab, so that it outlasts a reload

export function create(bench) {
  const { store } = bench;
  const kept = JSON.parse(sessionStorage.getItem(KEPT) ?? "{}");
  const changes = kept.changes ?? {};
  let form = null;
  let good = false; // whether the values as they are can be started
  let shown = ""; // the scene whose form is shown
  let asked = 0, starting = false, wasActive = false, wasRun = null;
  const nothing = new Store(); // what there is of a run while a scene is shown
  let left = kept.left ?? ""; // the run that was left for a scene, after its end
  let picked = kept.scene !== undefined; // a scene was chosen here; until then it is that of the run

  const list = data("select", { id: "scene", "aria-label": t("rig"), onchange: () => { pick(list.value); show(); } });
  const next = h("div", { class: "row small", id: "next", hidden: true }), nextTitle = h("span", { class: "grow" });
  next.append(nextTitle, h("button", { id: "show-next", onclick: () => { leaveRun(); show(); } }, t("Show it")));
  const title = h("h1", { id: "title" }), about = h("p", { class: "small pre", id: "about" }), warnings = h("div", { class: "doubtful small pre" });
  const effects = h("table", { id: "effects" }), of = h("details", {}, h("summary", {}, t("Effects")), effects);
  const fault = h("div", { class: "fault", id: "form-fault", role: "alert" }), act = attempting(fault);
  const said = h("div", { class: "small pre grow" }), summary = data("pre", { class: "scroll", tabIndex: 0 }), recorded = h("div", { class: "small" });
  const whole = h("details", { hidden: true }, h("summary", { class: "small" }, t("Whole summary")), recorded, summary);
  const again = h("button", { id: "look-at-it", hidden: true, onclick: () => bench.go(`recordings/${store.state.log}`) }, t("Look at the recording"));
  const experiment = h("p", { id: "experiment" }), how = data("span", { id: "doing" }), far = h("progress", { "aria-label": t("starting") });
  const doing = h("div", { class: "doing", role: "status", hidden: true }, far, how); // what a run that starts waits for, and how far it is
  const outcome = h("div", { id: "outcome", class: "row", role: "status", hidden: true }, said, whole, again);
  const lines = data("div", { class: "small pre scroll soft", id: "lines", tabIndex: 0 });
  const others = h("div", { id: "others" }), foreign = h("details", { ontoggle: () => foreign.open && look() }, h("summary", {}, t("Runs of other terminals")), others);
  const leave = h("button", { id: "leave", hidden: true, title: t("the run continues"), onclick: () => act(() => post("/api/run/leave", {})) }, t("Stop following"));
  const pace = h("input", { type: "text", value: kept.pace ?? "1", class: "value", id: "pace", "aria-label": t("pace"), onchange: keep });
  const duration = h("input", { type: "text", value: kept.duration ?? "", placeholder: t("as the protocol"), class: "value wide", id: "duration",
    "aria-label": t("duration in s"), onchange: () => show() });
  const start = h("button", { class: "go", id: "start", onclick: () => begin() }, t("Start"));
  const name = h("input", { type: "text", class: "value wide", placeholder: t("name"), "aria-label": t("name of the new scene"), id: "save-name" });
  const saved = data("span", { class: "small" });

  const command = (text, body, properties) => h("button", { onclick: () => act(() => bench.command(body())), ...properties }, text);
  const pause = command(t("Pause"), () => ({ do: store.state.phase === "paused" ? "resume" : "pause" }), { id: "pause", hidden: true });
  const step = command(t("Single step"), () => ({ do: "step" }), { id: "step", hidden: true, title: t("one frame of the paused run") });
  const impulse = h("input", { type: "text", inputMode: "decimal", value: "0.05", class: "value", id: "impulse", hidden: true,
    "aria-label": t("impulse of the knock in N s"), title: t("impulse in N s"), style: "width: 4.5rem" });
  const unit = data("span", { class: "small", hidden: true }, "N s");
  const knock = command(t("Knock"), () => ({ do: "knock", impulse: typed(impulse.value) }), { id: "knock", hidden: true });
  const stop = command(t("Stop"), () => ({ do: "stop" }), { id: "stop", hidden: true });

  const [rig, hands, branches, time, trust, protocol, portrait, events, hear] = [rigOf, handsOf, branchesOf, timeOf, trustOf, protocolOf, portraitOf, eventsOf, hearOf]
    .map((one) => (one === timeOf ? one.create(() => bench.shown, bench.redraw) : one.create(bench)));
  const seat = classOf.create(bench), parts = [seat, rig, hands, branches, time, trust, protocol, portrait, events, hear];

  function clear() { for (const key of Object.keys(changes)) delete changes[key]; }

  function keep() { sessionStorage.setItem(KEPT, JSON.stringify({ scene: picked ? list.value : undefined, changes, left, pace: pace.value, duration: duration.value })); }

  const body = () => ({ scene: list.value, changes, duration: duration.value.trim() ? typed(duration.value) : null });

  const ofRun = () => store.setup !== null && (store.active || store.setup.run !== left);
  Object.defineProperty(bench, "shown", { get: () => (ofRun() ? store : nothing) });

  /** After the end of a run: show the chosen scene. */
  function leaveRun() { if (!store.active) left = store.setup?.run ?? ""; }

  function pick(scene) {
    leaveRun();
    [list.value, picked] = [scene, true];
    clear();
  }

  /** On a page where nothing was chosen yet: choose the scene of the run, for the next one. */
  async function follow() {
    await filled;
    const scene = store.setup?.scene;
    if (picked || list.value === scene || ![...list.options].some(({ value }) => value === scene)) return;
    list.value = scene;
    clear();
    await show();
  }

  bench.chosen = () => ({ scene: list.value, changes, form, good });
  bench.change = (key, value) => { changes[key] = value; show(key); };
  bench.reset = () => { clear(); show(); };
  bench.choose = async (scene, now = false) => {
    await filled;
    if (list.value !== scene || !form) { pick(scene); await show(); }
    if (now && good && !store.active) await begin();
  };
  bench.place = (...which) => hands.place(...which);

  /** Show the form of the chosen scene; a fault is that of the value `key`, if it has just been changed. */
  async function show(key = "") {
    asked += 1;
    const mine = asked;
    keep();
    hands.box.setAttribute("aria-busy", "true");
    try {
      const told = await post("/api/scene", body());
      if (mine !== asked) return;
      form = told;
      shown = list.value;
      good = true;
      fault.textContent = "";
      hands.blame();
      render();
    } catch (error) {
      if (mine === asked) {
        good = false;
        const text = told(error.message);
        if (!text.includes("\n") && hands.blame(key, text.replace(`${list.value}: `, ""))) fault.textContent = "";
        else fault.textContent = text;
        if (shown !== list.value) blank();
      }
    }
    if (mine === asked) hands.box.setAttribute("aria-busy", "false");
    update();
    bench.redraw();
  }

  /** The chosen scene cannot be shown: nothing is left of the one before. */
  function blank() {
    form = null;
    shown = "";
    for (const one of [warnings, effects, hands.box]) one.replaceChildren();
  }

  function render() {
    warnings.textContent = [...form.notes, ...form.warnings, form.slow].filter(Boolean).map(told).join("\n");
    effects.replaceChildren(...form.effects.map((one) =>
      h("tr", { class: one.on ? "" : "soft" }, h("td", {}, told(one.name)), h("td", {}, one.on ? t("on") : "–"), h("td", {}, told(one.about)))));
    if (form.pace_limit && typed(pace.value) > form.pace_limit) pace.value = number(form.pace_limit);
  }

  /** The title and the text of what is shown, and the scene that waits while it is another one. */
  function label() {
    const what = bench.shown.setup ?? form;
    put(title, what ? told(what.title) : "");
    put(about, what ? told(joined(what.about)) : "");
    next.hidden = !(bench.shown.setup && form && form.scene !== bench.shown.setup.scene);
    put(nextTitle, next.hidden ? "" : t("for the next run: {title}", { title: told(form.title) }));
    next.lastChild.hidden = store.active;
    warnings.hidden = of.hidden = !next.hidden; // they are of the other scene
    if (wasRun === bench.shown.setup) return;
    wasRun = bench.shown.setup;
    for (const one of parts) one.setup?.();
    bench.redraw();
  }

  /** Live runs that this server did not start. */
  const look = () => act(async () => {
    const live = await get("/api/live");
    others.replaceChildren(...live.map(({ run, started, why }) => h("div", { class: "row small" },
      data("span", { class: "grow" }, run, h("div", { class: "soft" }, told(why) || `${new Date(started * 1000).toISOString().slice(0, 19).replace("T", " ")} UTC`)),
      h("button", { class: "follow", disabled: why !== "" || store.active, onclick: () => act(() => post("/api/run/follow", { run })) }, t("Follow")))),
    ...(live.length ? [] : [h("p", { class: "small soft" }, t("none; runs of other users are not shown"))]),
    h("button", { class: "small", onclick: look }, t("Look again")));
  });

  function begin() {
    starting = start.disabled = true;
    return act(() => post("/api/run", { ...body(), pace: pace.value.trim() === "max" ? "max" : typed(pace.value) })).finally(() => { starting = false; update(); });
  }

  const save = async () => {
    try {
      const { file } = await post("/api/scene/save", { ...body(), name: name.value.trim() });
      saved.textContent = file;
      await fill(list.value);
    } catch (error) {
      saved.textContent = told(error.message);
    }
  };

  async function fill(chosen) {
    const cards = await get("/api/scenes");
    const option = (one) => h("option", { value: one.name, title: one.about, selected: one.name === chosen }, `${one.name} – ${told(one.title)}`);
    const own = cards.filter((one) => one.own), groups = Object.groupBy(cards.filter((one) => !one.own), ({ group }) => group);
    list.replaceChildren(...(own.length ? [h("optgroup", { label: t("this folder") }, ...own.map(option))] : []),
      ...Object.entries(groups).map(([group, scenes]) => h("optgroup", { label: told(group) }, ...scenes.map(option))));
  }

  function update() {
    label();
    const { state, online, active } = store, live = ["running", "paused"].includes(state.phase);
    start.hidden = active;
    start.disabled = active || !online || !good || starting;
    for (const one of [pause, stop, knock, impulse, unit]) one.hidden = !active;
    doing.hidden = state.phase !== "starting";
    experiment.hidden = !doing.hidden;
    const line = state.lines?.at(-1)?.replace(/^plant: /, "") ?? "", share = line.match(PROGRESS);
    put(how, told(line) || t("the processes of the run start"));
    if (share) [far.value, far.max] = share.slice(1).map(Number); else far.removeAttribute("value");
    pause.textContent = state.phase === "paused" ? t("Resume") : t("Pause");
    pause.disabled = knock.disabled = !(online && live);
    step.hidden = state.phase !== "paused";
    step.disabled = !online;
    stop.disabled = !(online && active);
    const over = bench.shown.setup || !store.setup ? state.outcome : null;
    said.textContent = over ? result(over) : told((bench.shown.setup || !store.setup) && state.fault ? state.fault : "");
    said.className = `small pre ${state.fault || over?.exit_code ? "bad" : ""}`;
    whole.hidden = !over;
    outcome.hidden = !said.textContent;
    summary.textContent = over?.text ?? "";
    recorded.textContent = store.state.log ? t("recorded: {file}", { file: store.state.log }) : "";
    leave.hidden = !(active && state.foreign);
    if (active !== wasActive) { wasActive = active; if (foreign.open) look(); }
    lines.textContent = (state.lines ?? []).join("\n");
    for (const one of parts) one.state?.();
  }

  /** What to know of a run that has ended: how, what went wrong, where it is recorded. The chip has the timing. */
  function result({ ended, fault: cause, died, unrecorded }) {
    const recording = unrecorded ? t("the recording is not complete: see the summary") : "";
    return [t("ended: {how}", { how: told(ended) }), cause && cause !== ended && told(cause), ...died.map(told), recording].filter(Boolean).join("\n");
  }

  const filled = fill(kept.scene ?? "pendulum").then(() => { if (kept.scene && list.value !== kept.scene) clear(); return show(); },
    (error) => { fault.textContent = told(error.message); });
  const picture = h("div", { class: "frame" }, rig.element, h("div", { class: "over top" }, title), h("div", { class: "over bottom" }, time.contact, rig.text));
  return {
    element: h("div", { class: "bench" },
      h("section", { class: "stagearea stack", "aria-label": t("rig") }, picture,
        h("div", { class: "row bar" }, start, pause, step, stop, knock, impulse, unit, h("div", { class: "row asides" }, hear.element, trust.element)), protocol.element, doing, experiment,
        h("div", { class: "told stack" }, seat.element, fault, outcome, leave)),
      h("section", { class: "card stack hands", "aria-label": t("values") }, hands.element, branches.element),
      h("section", { class: "card stack time", "aria-label": t("time") }, time.element),
      h("div", { class: "more columns" },
        pane(t("This rig"), list, next, h("div", { class: "row" }, h("label", { class: "small" }, t("pace"), " ", pace), h("label", { class: "small" }, t("duration"), " ", duration)), about, warnings,
          of,
          h("details", {}, h("summary", {}, t("Save these values as a scene")), h("div", { class: "row" }, name, h("button", { onclick: save, id: "save" }, t("Save")), saved)),
          foreign, h("details", {}, h("summary", {}, t("Messages of the run")), lines)),
        portrait.element, events.element)),
    enter(scene) { if (scene && !store.active) bench.choose(scene); },
    setup() { follow(); },
    state() { again.hidden = store.active || !store.state.log; update(); },
    draw() {
      put(experiment, sentence(bench.shown));
      for (const one of parts) one.draw?.();
    },
  };
}
