// The page of a class: the run, as each watcher wants to see it, and the operation for the one to whom it was handed over.

import { get, post } from "/page/api.js";
import { attempting, data, h, joined, put } from "/page/dom.js";
import { sentence } from "/page/experiment.js";
import { connect } from "/page/socket.js";
import { Store } from "/page/store.js";
import { said, t } from "/page/text.js";
import * as eventsOf from "/page/panes/events.js";
import * as handsOf from "/page/panes/hands.js";
import * as head from "/page/panes/head.js";
import * as portraitOf from "/page/panes/portrait.js";
import * as protocolOf from "/page/panes/protocol.js";
import * as rigOf from "/page/panes/rig.js";
import * as timeOf from "/page/panes/time.js";
import * as trustOf from "/page/panes/trust.js";

const store = new Store();
const bench = {
  store,
  shown: store,
  tell: (text) => top.tell(text),
  redraw,
  command: (body) => post("/api/run/command", { ...body, run: store.setup?.run ?? "" }),
  set: (key, value) => post("/api/run/set", { key, value, run: store.setup?.run ?? "" }),
  chosen: () => ({ scene: store.setup?.scene ?? "", changes: {}, form: null, good: false }),
};
const { you } = await get("/api/class");
const top = head.create(bench, {}), fault = h("div", { class: "fault", id: "seat-fault", role: "alert" }), act = attempting(fault);
const [rig, hands, protocol, portrait, events, trust] = [rigOf, handsOf, protocolOf, portraitOf, eventsOf, trustOf].map((one) => one.create(bench));
const time = timeOf.create(() => store, redraw), all = [top, rig, hands, protocol, portrait, events, trust, time];
const title = h("h1", { id: "title" }), about = h("p", { class: "small pre" }), experiment = h("p", { id: "experiment" });

const name = h("input", { type: "text", class: "value wide", id: "your-name", maxLength: 40, placeholder: t("your name"), "aria-label": t("your name") });
const ask = h("button", { id: "ask", onclick: () => act(() => post("/api/class", { do: "ask", name: name.value })) }, t("Ask to operate"));
const back = h("button", { id: "give-back", onclick: () => act(() => post("/api/class", { do: "back" })) }, t("Give back"));
const who = data("span", { class: "grow", id: "who", role: "status" });
const pause = h("button", { id: "pause", onclick: () => act(() => bench.command({ do: store.state.phase === "paused" ? "resume" : "pause" })) });
const values = h("section", { class: "card stack hands", "aria-label": t("values"), hidden: true }, hands.element);
hands.box.setAttribute("aria-busy", "false");
const emergency = top.element.querySelector("#emergency");

document.getElementById("head").replaceWith(top.element);
document.getElementById("views").append(h("div", { class: "bench", id: "watch" },
  h("section", { class: "stagearea stack", "aria-label": t("rig") },
    h("div", { class: "frame" }, rig.element, h("div", { class: "over top" }, title), h("div", { class: "over bottom" }, time.contact, rig.text)),
    h("div", { class: "row bar" }, who, name, ask, pause, back, trust.element), fault, protocol.element, experiment),
  values, h("section", { class: "card stack time", "aria-label": t("time") }, time.element),
  h("div", { class: "more columns" }, about, portrait.element, events.element)));

let asked = false;
function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    put(experiment, sentence(store));
    for (const one of all) one.draw?.();
  });
}

function tellAll() {
  for (const one of all) one.state?.();
  const seat = store.seat ?? { holder: "", name: "", asking: [] }, mine = seat.holder === you, asks = seat.asking.some(({ id }) => id === you);
  put(who, mine ? t("You operate the run.") : asks ? t("You have asked to operate.") : seat.holder ? t("{name} operates the run.", { name: seat.name }) : t("You watch."));
  name.hidden = ask.hidden = mine || asks;
  back.hidden = !mine && !asks;
  values.hidden = emergency.hidden = !mine;
  pause.hidden = !mine || !["running", "paused"].includes(store.state.phase);
  put(pause, store.state.phase === "paused" ? t("Resume") : t("Pause"));
  put(title, store.setup ? said(store.setup.title) : t("no run yet"));
  put(about, store.setup ? said(joined(store.setup.about)) : "");
  redraw();
}

const messages = {
  state: (state) => { store.state = state; },
  setup: (setup) => {
    store.clear(setup);
    if (setup) for (const one of all) one.setup?.();
  },
  values: (known) => { store.values = known; },
  class: (seat) => { store.seat = seat; },
  status: (status) => { store.status = status; },
};

connect((message) => {
  if (message.kind === "frames") { for (const frame of message.frames) store.take(frame); redraw(); return; }
  messages[message.kind]?.(message[message.kind]);
  tellAll();
}, (online, why = "") => { Object.assign(store, { online, why }); tellAll(); });
addEventListener("resize", redraw);
