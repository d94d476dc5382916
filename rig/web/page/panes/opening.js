// The opening: rigs as moving pictures, from short recordings of their scenes (gallery.js), a search, and one Start.

import { get } from "/page/api.js";
import { data, h, joined } from "/page/dom.js";
import { said, t } from "/page/text.js";

const FIRST = "pendulum_by_hand"; // the demonstration
const STILL = matchMedia("(prefers-reduced-motion: reduce)");

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
  const gallery = new Worker("/page/gallery.js", { type: "module" }), canvases = [];
  let cards = null;

  function picture(scene) {
    const canvas = h("canvas", { class: "stage", "aria-hidden": "true" }), drawn = canvas.transferControlToOffscreen();
    gallery.postMessage({ id: canvases.push(canvas) - 1, canvas: drawn, scene: SAME[scene] ?? scene }, [drawn]);
    places.observe(canvas);
    views.observe(canvas);
    return canvas;
  }

  const places = new ResizeObserver((changes) => {
    for (const { target, contentRect: { width, height } } of changes) gallery.postMessage({ id: canvases.indexOf(target), width, height, ratio: devicePixelRatio || 1 });
  });
  const views = new IntersectionObserver((changes) => { // of a view that is not shown no picture is seen
    for (const { target, isIntersecting: seen } of changes) gallery.postMessage({ id: canvases.indexOf(target), seen });
  });
  const hold = () => gallery.postMessage({ hold: document.hidden || STILL.matches });
  document.addEventListener("visibilitychange", hold);
  gallery.onmessage = ({ data: { painted } }) => { canvases[painted].dataset.painted = ""; };
  hold();

  const card = (scene, [title, about]) => h("a", { href: `#bench/${scene}` }, picture(scene), h("div", {}, h("h3", {}, title), h("p", { class: "small soft" }, about)));
  const row = (one) => h("a", { href: `#bench/${one.name}` }, h("div", {}, h("h2", {}, said(one.title)), h("p", { class: "small soft" }, first(one.about)),
    data("p", { class: "small soft" }, one.name)));

  /** The first sentence of a description. */
  const first = (about) => said(joined(about)).match(/^.*?[.:](?=\s|$)/)?.[0].replace(/:$/, ".") ?? about;

  const found = h("div", { class: "cards", id: "found", "aria-live": "polite" });
  const groups = h("div", { class: "groups" }, ...GROUPS.map(([title, scenes]) => h("section", { "aria-label": title }, h("h2", {}, title),
    h("div", { class: "cards" }, ...Object.entries(scenes).map(([scene, texts]) => card(scene, texts))))));
  const search = h("input", { type: "search", id: "search", placeholder: t("Search: squeal, seal, dither, shunt"), "aria-label": t("search rigs"), oninput: look });

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
    state() { start.disabled = store().active || !store().online; },
  };

  function store() { return bench.store; }
}
