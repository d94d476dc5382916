// The opening: rigs as moving pictures, from short recordings of their scenes (tracks.json), a search, and one Start.

import { get } from "/page/api.js";
import { data, h, joined } from "/page/dom.js";
import { sized } from "/page/plot.js";
import { Solids } from "/page/solids.js";
import { said, t } from "/page/text.js";

const RATE = 15; // pictures of a track in a second
const FIRST = "pendulum_by_hand"; // the demonstration
const STILL = matchMedia("(prefers-reduced-motion: reduce)");

/** Places of all numbers in nested lists: [list, index] of each. */
const leaves = (value) => value.flatMap((one, i) => (Array.isArray(one) ? leaves(one) : [[value, i]]));

/** The frames of a track, as docs/page_tracks.py packs them. */
function unpacked({ count, first, moves }) {
  const frames = [first, ...Array.from({ length: count - 1 }, () => ({}))];
  for (const [path, name, which, steps] of moves) {
    let value = first[path]?.[name];
    for (let k = 1; k < count; k += 1) {
      if (which) {
        const all = leaves(value = structuredClone(value));
        which.forEach((i, j) => { const [list, at] = all[i]; list[at] += steps[(k - 1) * which.length + j] / 1000; });
      } else value = steps[k - 1];
      if (value !== null) (frames[k][path] ??= {})[name] = value;
    }
  }
  return frames;
}

const GROUPS = [
  [t("Stick-slip"), {
    pendulum: [t("Pendulum on a disc"), t("It sticks to the turning disc, tears off, and swings back three times a second.")],
    belt: [t("Mass on a belt"), t("The belt carries the mass along until the spring pulls it back.")],
    belt_tuned_mass: [t("With a tuned mass"), t("A small tilted mass on top takes the vibration away.")],
    belt_shunt: [t("With a piezo stack"), t("A circuit makes the spring softer, and the rhythm changes.")],
  }],
  [t("Mode coupling"), {
    two_dof: [t("Two springs, one mass"), t("Friction joins two vibrations, and together they grow.")],
    four_dof: [t("Three bodies on a belt"), t("The middle body begins to hop on the belt.")],
    pin: [t("Tilted pin"), t("Tilted against the motion, the pin digs in and hammers the disc.")],
    north: [t("Flutter of a pad"), t("A pad that can tilt and move flutters 2274 times a second.")],
    disc_slider: [t("Slider on a bending disc"), t("The disc bends under a slider that sticks in every period.")],
  }],
  [t("Brake and shunt"), {
    brake: [t("Disc brake"), t("Pads, calliper and disc squeal at 2.1 kHz.")],
    brake_shunt: [t("Brake with a shunt"), t("A coil across a piezo stack silences the squeal.")],
    plate: [t("Plate under a slider"), t("The film between them opens at some points, then everywhere, and the motion is chaotic.")],
  }],
  [t("Measured"), {
    lever: [t("Slider with a lever"), t("Its parameters are identified from measurements; below 2 rpm it sticks and slips.")],
    seal_p: [t("Seal on a bolt"), t("A friction curve that was measured on a seal, and the vibration that it makes.")],
    tip: [t("Tip on a disc"), t("Sliding or sticking: both are stable, and a knock decides.")],
    tread: [t("Tread block"), t("The edge of a rubber block squeaks on glass at 294 Hz.")],
  }],
];
const SAME = { brake_shunt: "brake", pendulum_by_hand: "pendulum" }; // scene -> the one whose picture is shown

export function create(bench) {
  const moving = new Map(); // canvas -> {solids, frames, number}
  const seen = new Set();
  let tracks = null, cards = null, timer = null, painting = false;

  function picture(scene) {
    const canvas = h("canvas", { class: "stage", "aria-hidden": "true" });
    moving.set(canvas, { scene: SAME[scene] ?? scene, solids: null, number: 0 });
    watcher.observe(canvas);
    return canvas;
  }

  const watcher = new IntersectionObserver((changes) => {
    for (const { target, isIntersecting } of changes) if (isIntersecting) seen.add(target); else seen.delete(target);
    tick();
  });

  function paint(canvas) {
    const one = moving.get(canvas), track = tracks?.[one.scene];
    if (!track) return;
    one.solids ??= new Solids(track.still);
    track.frames ??= unpacked(track);
    one.solids.move(track.frames[one.number % track.count]);
    one.number += 1;
    one.solids.draw(sized(canvas));
  }

  /** Paint what is seen, each picture in a task of its own: the page answers between them. */
  async function tick() {
    if (painting || document.hidden || element.hidden) return;
    painting = true;
    for (const canvas of [...seen]) { paint(canvas); await new Promise((done) => { setTimeout(done); }); }
    painting = false;
  }

  const card = (scene, [title, about]) => h("a", { href: `#bench/${scene}` }, picture(scene), h("div", {}, h("h3", {}, title), h("p", { class: "small soft" }, about)));
  const row = (one) => h("a", { href: `#bench/${one.name}` }, h("div", {}, h("h3", {}, said(one.title)), h("p", { class: "small soft" }, first(one.about)),
    data("p", { class: "small soft" }, one.name)));

  /** The first sentence of a description. */
  const first = (about) => said(joined(about)).match(/^.*?[.:](?=\s|$)/)?.[0].replace(/:$/, ".") ?? about;

  const found = h("div", { class: "cards", id: "found", "aria-live": "polite" });
  const groups = h("div", { class: "groups" }, ...GROUPS.map(([title, scenes]) => h("section", { "aria-label": title }, h("h2", {}, title),
    h("div", { class: "cards" }, ...Object.entries(scenes).map(([scene, texts]) => card(scene, texts))))));
  const search = h("input", { type: "search", id: "search", placeholder: t("Search all rigs: squeal, seal, dither, shunt"), "aria-label": t("search rigs"), oninput: look });

  async function look() {
    cards ??= await get("/api/scenes");
    const asked = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const known = Object.assign({}, ...GROUPS.map(([, scenes]) => scenes));
    const has = (one) => { const text = [one.name, one.title, one.about, one.plant, said(one.title), said(joined(one.about)), ...(known[one.name] ?? [])].join(" ").toLowerCase(); return asked.every((word) => text.includes(word)); };
    groups.hidden = asked.length > 0;
    found.replaceChildren(...(asked.length ? cards.filter(has).map(row) : []));
    if (asked.length && !found.children.length) found.append(h("p", { class: "soft" }, t("no rig has these words")));
  }

  const start = h("button", { class: "go", id: "demo", onclick: () => { bench.choose(FIRST, true); bench.go("bench"); } }, t("Start"));
  const element = h("div", {}, h("section", { class: "hero", "aria-label": t("demonstration") }, picture(FIRST),
    h("div", {}, h("h1", {}, t("Why does it squeal, and what stops it?")),
      h("p", {}, t("A test rig for friction-induced vibration, in real time. Start this pendulum: it sticks and slips. Then move a slider until it is quiet.")), start)),
  h("div", { class: "search", style: "margin-top: 1.6rem" }, search), found, groups);

  return {
    element,
    async enter() {
      timer ??= setInterval(tick, 1000 / RATE);
      if (STILL.matches) { clearInterval(timer); timer = 1; }
      tracks ??= await fetch("/page/tracks.json").then((answer) => answer.json());
      tick();
    },
    state() { start.disabled = store().active || !store().online; },
  };

  function store() { return bench.store; }
}
