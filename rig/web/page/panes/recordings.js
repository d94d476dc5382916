// Recordings of the folder: one of them plays in the page, on the time axis of the bench; two are compared; what can be
// done with it: hear, spectrum, report, verify, tables, continue from an instant with another value.

import { get, post } from "/page/api.js";
import { attempting, data, front, h, number, put, typed } from "/page/dom.js";
import { jobs as jobsOf } from "/page/jobs.js";
import { sized } from "/page/plot.js";
import { Solids } from "/page/solids.js";
import { Store } from "/page/store.js";
import { language, said, t } from "/page/text.js";
import * as timeOf from "/page/panes/time.js";

const LOOK = { VALID: "good", DEGRADED: "doubtful", INVALID: "bad" }; // of timing verdicts

export function create(bench) {
  const fault = data("div", { class: "fault", id: "recordings-fault", role: "alert" });
  const attempt = attempting(fault);
  const list = h("div", { class: "stack", id: "recordings" });
  const canvas = h("canvas", { class: "stage", role: "img", "aria-label": t("moving picture of the rig"), id: "recorded-picture" });
  const title = h("h2"), about = data("div", { class: "small soft" });
  const play = h("button", { id: "play", onclick: () => { if (time.at() >= store.t) time.seek(0); playing = playing ? null : performance.now(); run(); } }, t("Play"));
  const scrub = h("input", { type: "range", id: "scrub", min: 0, max: 1000, step: 1, value: 0, "aria-label": t("instant of the recording"), oninput: () => time.seek((scrub.value / 1000) * store.t) });
  const against = data("select", { id: "against", "aria-label": t("compare with"), style: "width: auto", onchange: () => attempt(compare) });
  const key = data("select", { id: "from-key", "aria-label": t("value to change"), style: "width: auto" }), value = h("input", { type: "text", class: "value", id: "from-value", "aria-label": t("new value"), translate: "no", placeholder: "15 N" });
  let store = null, second = null, pictures = null, solids = null, shownFrame = 0, playing = null, name = "", known = [];
  const time = timeOf.create(() => store, draw, { whole: true, other: () => second, moved: (at) => { scrub.value = at === null ? 0 : (1000 * at) / store.t; } });

  const work = (body) => () => attempt(async () => { await post("/api/recordings/work", { name, ...body }); jobs.look(); });
  const button = (text, what, hint = "") => h("button", { title: hint, id: `do-${what}`, onclick: work({ what }) }, text);

  async function read(which) {
    const told = await post("/api/recordings/open", { name: which }), made = new Store(Infinity);
    made.clear(told.setup);
    made.take(told.frame);
    return { made, told };
  }

  const open = (which) => attempt(async () => {
    title.textContent = which;
    const { made, told } = await read(which);
    [store, second, pictures, name, playing] = [made, null, told.pictures, which, null];
    solids = null;
    const one = known.find((row) => row.name === which);
    title.textContent = said(told.setup.title);
    about.replaceChildren(...[h("a", { href: `/recordings/${encodeURIComponent(which)}`, title: "MCAP" }, which), ...(one ? [", ", facts(one)] : [])]);
    against.replaceChildren(h("option", { value: "" }, "–"), ...known.filter((row) => row.scene === one?.scene && row.name !== which).map((row) => h("option", { value: row.name }, row.name)));
    key.replaceChildren(...Object.entries(told.setup.hands).map(([of, words]) => h("option", { value: of }, t(words))));
    time.setup();
    player.hidden = false;
    mark();
    draw();
  });

  async function compare() {
    second = against.value ? (await read(against.value)).made : null;
    draw();
    if (against.value) work({ what: "compare", other: against.value })();
  }

  function draw() {
    if (!store) return;
    put(play, playing ? t("Pause") : t("Play"));
    const at = time.at() ?? 0;
    const wanted = Math.max(pictures.t.findLastIndex((one) => one <= at), 0);
    if (pictures.frames.length) {
      if (!solids || wanted < shownFrame) { solids = new Solids(store.setup.picture); shownFrame = -1; }
      for (; shownFrame < wanted; shownFrame += 1) solids.move(pictures.frames[shownFrame + 1]);
      const place = sized(canvas);
      solids.draw(place);
    }
    canvas.hidden = !pictures.frames.length;
    time.draw();
  }

  function run() {
    requestAnimationFrame((now) => {
      if (!playing || view.hidden) { playing = null; draw(); return; }
      time.seek(Math.min(time.at() + Math.max(now - playing, 0) / 1000, store.t));
      playing = time.at() < store.t ? now : null;
      draw();
      run();
    });
  }

  const when = (one) => (one.began ? new Date(one.began * 1000).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" }) : "");
  const length = (one) => (one.seconds === null ? "" : `${number(one.seconds)}\u00a0s`);
  const facts = (one) => [`${number(one.bytes / 1e6, 3)} MB`, ...one.notes.map(said)].join(", ");

  const small = new Map(); // name and time of a recording -> its picture in the list, as soon as it has been seen
  const views = new IntersectionObserver((changes) => {
    for (const { target, isIntersecting: seen } of changes) if (seen) { views.unobserve(target); paint(target); }
  });

  async function paint(place) {
    const { name: which, began } = place.recording, key = `${which} ${began}`;
    if (!small.has(key)) small.set(key, post("/api/recordings/picture", { name: which }).catch(() => null));
    const picture = await small.get(key);
    if (!picture?.shapes) return;
    const rig = new Solids(picture);
    rig.move(picture.at);
    rig.draw(sized(place));
  }

  function row(one) {
    const place = h("canvas", { class: "stage", "aria-hidden": "true" });
    place.recording = one;
    views.observe(place);
    return h("a", { href: `#recordings/${one.name}`, class: "recording small" }, place, h("div", {}, h("strong", {}, said(one.title) || one.name),
      one.fault ? data("div", { class: "bad" }, said(one.fault)) : [h("div", { class: LOOK[one.timing] ?? "soft" }, said(one.timing)),
        h("div", { class: "soft" }, [when(one), length(one)].filter(Boolean).join(" · "))]));
  }

  const mark = () => [...list.children].forEach((one, i) => { if (known[i]?.name === name) one.setAttribute("aria-current", "true"); else one.removeAttribute("aria-current"); });

  const fill = () => attempt(async () => {
    known = await get("/api/recordings");
    list.replaceChildren(...known.map(row));
    mark();
    if (!known.length) list.replaceChildren(h("p", { class: "soft" }, t("no recordings yet: every run makes one")));
  });

  const jobs = jobsOf(["verify", "report", "export", "diff", "view", "analyse", "simulate"], attempt, fill);
  jobs.element.id = "jobs";
  const player = h("section", { class: "card stack", hidden: true, "aria-label": t("recording") }, title, about, canvas, h("div", { class: "row" }, play, h("span", { class: "grow" }, scrub), time.contact),
    time.element,
    h("div", { class: "row" }, button(t("Hear"), "sound", t("the sound of its microphone")), button(t("Spectrum"), "spectrum"), button(t("Report"), "report", t("a page with figures")),
      button(t("Verify"), "verify", t("simulate it again and compare every bit")), button(t("Tables"), "csv", t("CSV, as a ZIP file")), button(data("span", {}, "rerun"), "view", t("the full view in rerun"))),
    h("div", { class: "row small" }, h("label", {}, t("compare with"), " ", against)),
    h("div", { class: "row small" }, t("from the instant of the cursor with"), key, "=", value, h("button", { id: "continue", onclick: () => attempt(async () => {
      const changes = value.value.trim() ? { [key.value]: typed(value.value) } : {};
      await post("/api/recordings/work", { what: "continue", name, at: Number((time.at() ?? 0).toFixed(3)), changes });
      jobs.look();
    }) }, t("Continue from here"))));
  const view = h("div", { class: "split" }, front(t("Recordings"), list), h("div", { class: "stack" }, fault, player, jobs.element));
  let phase = "";
  return {
    element: view,
    async enter(which) {
      await fill();
      jobs.look();
      if (which && which !== name) await open(decodeURIComponent(which));
      else if (!which && !name) { const whole = known.find((one) => !one.fault); if (whole) await open(whole.name); }
    },
    state() {
      if (bench.store.state.phase === "ended" && phase !== "ended" && !view.hidden) fill();
      phase = bench.store.state.phase;
    },
    draw,
  };
}
