// The page: a head, five views of which one is shown, one store, one web socket.
//
// A view, and a part of it, is a module that exports `create(bench)`, which returns an object with `element` and, as it needs:
//   state()   the state of the run, the connection or the values changed      setup()   a run has been described (`store.setup`, null until then)
//   draw()    new frames have come; called once for an animation frame, and only while its view is shown
//   enter(rest)   the view is shown; `rest` is what stands behind its name in the address
// `bench` has `store` (store.js: what is known of the run), `command(body)` and `set(key, value)`, which act on the run that
// this page shows and throw Errors with the server's text, `tell(text)`, which shows a text in the head, `redraw()`, `go(view)`,
// and what the bench adds: `chosen()`, `choose(scene)` and `begin()`.

import { get, post } from "/page/api.js";
import { connect } from "/page/socket.js";
import { Store } from "/page/store.js";
import { t } from "/page/text.js";
import * as head from "/page/panes/head.js";
import * as opening from "/page/panes/opening.js";
import * as running from "/page/panes/bench.js";
import * as recordings from "/page/panes/recordings.js";
import * as studies from "/page/panes/studies.js";
import * as lessons from "/page/panes/lessons.js";

const store = new Store();
const bench = {
  store,
  tell: (text) => top.tell(text),
  redraw: () => redraw(),
  go: (view) => { location.hash = view; },
  command: (body) => post("/api/run/command", { ...body, run: store.setup?.run ?? "" }),
  set: (key, value) => post("/api/run/set", { key, value, run: store.setup?.run ?? "" }),
};
const top = head.create(bench, { rigs: t("Rigs"), bench: t("Bench"), recordings: t("Recordings"), analysis: t("Analysis"), lessons: t("Lessons") });
const views = { bench: running.create(bench), rigs: opening.create(bench), recordings: recordings.create(bench), analysis: studies.create(bench),
  lessons: lessons.create(bench) };
const all = [top, ...Object.values(views)];
let shown = null;

document.getElementById("head").replaceWith(top.element);
document.getElementById("views").append(...Object.values(views).map(({ element }) => element));
for (const [name, { element }] of Object.entries(views)) { element.classList.add("view"); element.id = `view-${name}`; }

function show() {
  const [name, ...rest] = location.hash.slice(1).split("/");
  const before = shown;
  shown = name in views ? name : store.active ? "bench" : "rigs";
  for (const [one, { element }] of Object.entries(views)) element.hidden = one !== shown;
  top.show(shown);
  if (before !== shown) scrollTo(0, 0);
  views[shown].enter?.(rest.join("/"));
  redraw();
}

let asked = false;
function redraw() { // an animation frame is asked for only when something has come
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    top.draw();
    views[shown]?.draw?.();
  });
}

function tellAll() {
  for (const one of all) one.state?.();
  if (!location.hash && store.active) show();
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
    if (setup === null) top.tell(""); // a new run begins, and nothing is known of it yet
    else {
      for (const one of all) one.setup?.();
      missed();
    }
    tellAll();
  },
  values: (values) => { store.values = values; tellAll(); },
  class: (seat) => { store.seat = seat; tellAll(); },
  status: (status) => { store.status = status; redraw(); },
  frames: (frames) => { for (const frame of frames) store.take(frame); redraw(); },
};

connect((message) => messages[message.kind]?.(message[message.kind]), (online, why = "") => { Object.assign(store, { online, why }); tellAll(); });
addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: light)").addEventListener("change", redraw);
addEventListener("hashchange", show);
show();
