// The page: a head, panes in three columns, one store, one web socket.
//
// A pane is a module in panes/ that exports `create(bench)`, which returns an object with `element` and, as it needs them:
//   state()   the state of the run, the connection or the values changed      setup()   a run has been described (`store.setup`, null until then)
//   draw()    new frames have come; called once for an animation frame, and only while the pane is on the screen
// `bench` has `store` (store.js: what is known of the run), `command(body)` and `set(key, value)`, which act on the run that
// this page shows and throw Errors with the server's text, `tell(text)`, which
// shows a text in the head, `redraw()`, and what the pane of the scene adds: `chosen()` and `choose(scene)`.

import { get, post } from "/page/api.js";
import { connect } from "/page/socket.js";
import { Store } from "/page/store.js";
import { h } from "/page/dom.js";
import * as head from "/page/panes/head.js";
import * as choose from "/page/panes/choose.js";
import * as branches from "/page/panes/branches.js";
import * as touch from "/page/panes/touch.js";
import * as rig from "/page/panes/rig.js";
import * as signals from "/page/panes/signals.js";
import * as strip from "/page/panes/strip.js";
import * as portrait from "/page/panes/portrait.js";
import * as trust from "/page/panes/trust.js";
import * as protocol from "/page/panes/protocol.js";
import * as events from "/page/panes/events.js";
import * as hear from "/page/panes/hear.js";
import * as recordings from "/page/panes/recordings.js";
import * as studies from "/page/panes/studies.js";
import * as lessons from "/page/panes/lessons.js";

const COLUMNS = [[choose, branches, touch], [rig, strip, signals, studies, lessons], [protocol, trust, portrait, hear, events, recordings]];

const LIVE = new Set([touch, strip, signals, protocol, trust, portrait, events]); // panes that show nothing before a run is described

const store = new Store();
const bench = {
  store,
  tell: (text) => top.tell(text),
  redraw: () => redraw(),
  command: (body) => post("/api/run/command", { ...body, run: store.setup?.run ?? "" }),
  set: (key, value) => post("/api/run/set", { key, value, run: store.setup?.run ?? "" }),
};
const top = head.create(bench);
const panes = COLUMNS.map((column) => column.map((one) => one.create(bench)));
const reveal = () => COLUMNS.flat().forEach((one, i) => { panes.flat()[i].element.hidden = LIVE.has(one) && store.setup === null; });
reveal();
const all = [top, ...panes.flat()];

document.getElementById("head").replaceWith(top.element);
document.getElementById("panes").append(
  ...panes.map((column) => h("div", { class: "column" }, ...column.map((one) => one.element))));

const shown = new Set();
const watcher = new IntersectionObserver((changes) => {
  for (const { target, isIntersecting } of changes) {
    const one = all.find(({ element }) => element === target);
    if (isIntersecting) shown.add(one); else shown.delete(one);
  }
  redraw();
});
for (const one of all) watcher.observe(one.element);

let asked = false;
function redraw() { // an animation frame is asked for only when something has come
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    for (const one of shown) one.draw?.();
  });
}

function tellAll() {
  for (const one of all) one.state?.();
  redraw();
}

async function missed() { // events of before this page was connected
  const { run, events: known } = await get("/api/run").catch(() => ({ events: [] }));
  if (run === store.setup?.run) { store.events = []; store.hear(known); redraw(); }
}

const messages = {
  state: (state) => { store.state = state; tellAll(); },
  setup: (setup) => {
    store.clear(setup);
    reveal();
    if (setup === null) top.tell(""); // a new run begins, and nothing is known of it yet
    else {
      for (const one of all) one.setup?.();
      missed();
    }
    tellAll();
  },
  values: (values) => { store.values = values; tellAll(); },
  status: (status) => { store.status = status; redraw(); },
  frames: (frames) => { for (const frame of frames) store.take(frame); redraw(); },
};

connect((message) => messages[message.kind]?.(message[message.kind]), (online, why = "") => { Object.assign(store, { online, why }); tellAll(); });
addEventListener("resize", redraw);
