// Choose a scene, look at what it contains, change its values, start it.

import { get, post } from "/page/api.js";
import { listed } from "/page/panes/protocol.js";
import { h, number, pane, typed } from "/page/dom.js";

const KEPT = "chosen"; // what has been chosen on this tab, so that it outlasts a reload

export function create(bench) {
  const { store } = bench;
  const kept = JSON.parse(sessionStorage.getItem(KEPT) ?? "{}");
  const changes = kept.changes ?? {};
  let form = null;
  let good = false; // whether the values as they are can be started
  let shown = ""; // the scene whose form is shown
  let asked = 0;
  let wasActive = false;

  const list = h("select", { id: "scene", "aria-label": "scene", onchange: () => { clear(); show(); } });
  const title = h("strong", { id: "title" }), about = h("p", { class: "small pre", id: "about" }), warnings = h("div", { class: "warn small pre" });
  const effects = h("table"), steps = h("ol", { class: "small scroll" }), sections = h("div", { class: "values", id: "values", "aria-busy": "true" });
  const fault = h("div", { class: "fault", id: "form-fault", role: "alert" });
  const said = h("div", { class: "small pre" }), summary = h("pre", { class: "small scroll faint" });
  const whole = h("details", { hidden: true }, h("summary", { class: "small" }, "Whole summary"), summary);
  const outcome = h("div", { id: "outcome", role: "status" }, said, whole);
  const lines = h("div", { class: "small pre scroll faint", id: "lines" });
  const others = h("div", { id: "others" }), foreign = h("details", { ontoggle: () => foreign.open && look() },
    h("summary", {}, "Runs of other terminals"), others);
  const leave = h("button", { id: "leave", hidden: true, title: "the run continues", onclick: () => act(() => post("/api/run/leave", {})) }, "Stop following");
  const pace = h("input", { type: "text", value: kept.pace ?? "1", class: "value", id: "pace", "aria-label": "pace", onchange: keep });
  const duration = h("input", { type: "text", value: kept.duration ?? "", placeholder: "as the protocol", class: "value wide", id: "duration",
    "aria-label": "duration in s", onchange: () => show() });
  const start = h("button", { class: "main", id: "start", onclick: begin }, "Start");
  const name = h("input", { type: "text", class: "value", placeholder: "name", "aria-label": "name of the new scene", id: "save-name" });
  const saved = h("span", { class: "small" });

  function clear() { for (const key of Object.keys(changes)) delete changes[key]; }

  function keep() { sessionStorage.setItem(KEPT, JSON.stringify({ scene: list.value, changes, pace: pace.value, duration: duration.value })); }

  const body = () => ({ scene: list.value, changes, duration: duration.value.trim() ? typed(duration.value) : null });

  bench.chosen = () => ({ scene: list.value, changes, form });
  bench.choose = (scene) => { list.value = scene; clear(); show(); };

  async function show() {
    asked += 1;
    const mine = asked;
    keep();
    sections.setAttribute("aria-busy", "true");
    try {
      const found = await post("/api/scene", body());
      if (mine !== asked) return;
      form = found;
      shown = list.value;
      good = true;
      fault.textContent = "";
      render();
    } catch (error) {
      if (mine === asked) {
        good = false;
        fault.textContent = error.message;
        if (shown !== list.value) blank();
      }
    }
    if (mine === asked) sections.setAttribute("aria-busy", "false");
    update();
    bench.redraw();
  }

  /** The chosen scene cannot be shown: nothing is left of the one before. */
  function blank() {
    form = null;
    shown = "";
    for (const one of [title, about, warnings, effects, steps, sections]) one.replaceChildren();
  }

  function render() {
    title.textContent = form.title;
    about.textContent = form.about.replace(/([^\n])\n(?=\S)/g, "$1 "); // lines as long as the pane is wide
    warnings.textContent = [...form.notes, ...form.warnings, form.slow && `Paced, ${form.slow}`].filter(Boolean).join("\n");
    effects.replaceChildren(...form.effects.map((one) =>
      h("tr", { class: one.on ? "" : "faint" }, h("td", {}, one.name), h("td", {}, one.on ? "on" : "absent"), h("td", {}, one.about))));
    steps.replaceChildren(...listed(form.protocol));
    if (form.pace_limit && Number(pace.value) > form.pace_limit) pace.value = number(form.pace_limit);
    const { id, value } = document.activeElement; // what one is typing outlasts the new rows
    const open = new Set([...sections.querySelectorAll("details[open]")].map((one) => one.dataset.name));
    sections.replaceChildren(...form.sections.map((section) => h("details", { open: open.has(section.name), "data-name": section.name },
      h("summary", {}, section.name), h("table", {}, ...section.values.map(row)))));
    if (id && document.activeElement?.id !== id) {
      const again = document.getElementById(id);
      again?.focus();
      if (again?.type === "text") again.value = value;
    }
  }

  function row(entry) {
    const { key, kind, unit, limits } = entry;
    const change = (value) => { changes[key] = value; show(); };
    const properties = { "aria-label": key, id: `value-${key}`, class: key in changes ? "value changed" : "value" };
    let field;
    if (kind === "switch") {
      field = h("input", { ...properties, type: "checkbox", checked: entry.value, onchange: (e) => change(e.target.checked) });
    } else if (kind === "choice") {
      field = h("select", { ...properties, onchange: (e) => change(e.target.value) },
        ...entry.choices.map((one) => h("option", { selected: one === entry.value }, one)));
    } else if (kind === "fixed") {
      field = h("span", { class: "faint" }, number(entry.value));
    } else {
      field = h("input", { ...properties, type: "text", value: number(changes[key] ?? entry.value, 8),
        onchange: (e) => change(typed(e.target.value)) });
    }
    const range = limits ? `${number(limits[0])} to ${number(limits[1])} ${unit === "1" ? "" : unit}` : "";
    return h("tr", { title: [key, range, entry.note, entry.place].filter(Boolean).join("\n") },
      h("td", {}, entry.name), h("td", {}, field, ` ${unit === "1" ? "" : unit}`), h("td", { class: "faint" }, entry.origin));
  }

  async function act(action) {
    try {
      fault.textContent = "";
      await action();
    } catch (error) {
      fault.textContent = error.message;
    }
    update();
  }

  /** Live runs that this server did not start. */
  const look = () => act(async () => {
    const found = await get("/api/live");
    others.replaceChildren(...found.map(({ run, started, why }) => h("div", { class: "row small" },
      h("span", { class: "grow" }, run, h("div", { class: "faint" }, why || `since ${new Date(started * 1000).toISOString().slice(0, 19).replace("T", " ")} UTC`)),
      h("button", { disabled: why !== "" || store.active, onclick: () => act(() => post("/api/run/follow", { run })) }, "Follow"))),
    ...(found.length ? [] : [h("p", { class: "small faint" }, "none; runs of other users are not shown")]),
    h("button", { class: "small", onclick: look }, "Look again"));
  });

  function begin() {
    start.disabled = true;
    return act(() => post("/api/run", { ...body(), pace: pace.value.trim() === "max" ? "max" : typed(pace.value) }));
  }

  async function save() {
    try {
      const { file } = await post("/api/scene/save", { ...body(), name: name.value.trim() });
      saved.textContent = `saved: ${file}`;
      await fill(list.value);
    } catch (error) {
      saved.textContent = error.message;
    }
  }

  async function fill(chosen) {
    const cards = await get("/api/scenes");
    const options = (own) => cards.filter((one) => one.own === own).map((one) =>
      h("option", { value: one.name, title: one.about, selected: one.name === chosen }, `${one.name} – ${one.title}`));
    const own = options(true);
    list.replaceChildren(...(own.length ? [h("optgroup", { label: "this folder" }, ...own)] : []),
      h("optgroup", { label: "shipped" }, ...options(false)));
  }

  function update() {
    const { state } = store;
    start.disabled = store.active || !store.online || !good;
    const over = state.outcome;
    said.textContent = over ? told(over) : state.fault ?? "";
    said.className = `small pre ${state.fault || over?.exit_code ? "bad" : ""}`;
    whole.hidden = !over;
    summary.textContent = over?.text ?? "";
    leave.hidden = !(store.active && state.foreign);
    if (store.active !== wasActive) { wasActive = store.active; if (foreign.open) look(); }
    lines.textContent = (state.lines ?? []).join("\n");
  }

  /** What to know of a run that has ended: the timing verdict, how it ended, what went wrong. */
  function told({ verdict, reasons, ended, fault: cause, died, unrecorded }) {
    const how = verdict ? `Timing ${verdict}${reasons.length ? `: ${reasons.join("; ")}` : ""}` : "";
    const recording = unrecorded ? "the recording is not complete: see the summary" : store.state.log && `recorded: ${store.state.log}`;
    return [how, `ended: ${ended}`, cause && cause !== ended && cause, ...died, recording].filter(Boolean).join("\n");
  }

  fill(kept.scene ?? "pendulum").then(() => { if (kept.scene && list.value !== kept.scene) clear(); return show(); }, (error) => { fault.textContent = error.message; });
  return {
    element: pane("Scene", list, h("p", {}, title), about, warnings,
      h("div", { class: "row" }, h("label", {}, "pace ", pace), h("label", {}, "duration ", duration), start, leave), fault, outcome, foreign,
      h("details", {}, h("summary", {}, "Messages of the run"), lines),
      h("details", {}, h("summary", {}, "Effects"), effects), h("details", {}, h("summary", {}, "Protocol"), steps),
      h("details", { open: true }, h("summary", {}, "Values"), sections),
      h("details", {}, h("summary", {}, "Save these values as a scene"),
        h("div", { class: "row" }, name, h("button", { onclick: save, id: "save" }, "Save"), saved))),
    state: update,
  };
}
