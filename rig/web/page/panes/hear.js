// Hear: a sensor of the running scene on the loudspeaker, at a volume that starts low. At another pace than 1 the same
// samples are played slower or faster, so that the pitch changes with the pace.

import { data, h, number } from "/page/dom.js";
import { said, t } from "/page/text.js";

const VOLUME = 10; // of 100: the volume at first

export function create(bench) {
  const { store } = bench;
  const fault = data("div", { class: "fault", id: "hear-fault", role: "alert" });
  const list = data("select", { id: "hear-sensor", "aria-label": t("sensor to hear"), onchange: () => { if (playing) listen(); } });
  const button = h("button", { id: "hear", "aria-pressed": "false", onclick: () => (playing ? silence() : listen()) }, t("Listen"));
  const volume = h("input", { type: "range", min: 0, max: 100, value: VOLUME, id: "volume", oninput: () => turn() });
  const told = data("div", { class: "small pre", id: "hear-told", role: "status" });
  const box = h("details", { class: "chip", hidden: true }, h("summary", { id: "hear-open" }, t("Sound")),
    h("div", { class: "card stack" }, list, h("div", { class: "row" }, button, h("label", { class: "small grow" }, t("volume"), " ", volume)), fault, told));
  let playing = null; // {context, gain, worker} while the page listens
  let starting = 0, sounded = false; // sounded: whether there was a run at the last look

  const turn = () => { if (playing) playing.gain.gain.value = (volume.value / 100) ** 2; };

  async function listen() {
    silence();
    starting += 1;
    const mine = starting;
    fault.textContent = "";
    const name = list.value, sensor = store.setup.sound.sensors[name], pace = store.state.pace;
    if (!pace) {
      fault.textContent = t("This run does not follow the clock: its sound would not be steady. Start it at a pace, such as 1.");
      return;
    }
    const rate = sensor.rate * pace;
    let context;
    try {
      context = new AudioContext({ sampleRate: rate });
    } catch {
      fault.textContent = t("This browser cannot play {rate} samples per second ({name} at pace {pace}). Choose a pace nearer to 1, or another sensor.",
        { rate: number(rate, 6), name, pace: number(pace) });
      return;
    }
    playing = { context, gain: context.createGain(), worker: null };
    show();
    try {
      await context.audioWorklet.addModule("/page/loudspeaker.js");
      await context.resume();
    } catch (error) {
      if (mine === starting) { silence(); fault.textContent = `${t("This browser does not play the sound:")} ${error.message}`; }
      return;
    }
    if (mine !== starting || playing?.context !== context) return;
    const node = new AudioWorkletNode(context, "loudspeaker",
      { numberOfInputs: 0, outputChannelCount: [1], processorOptions: { reference: sensor.reference } });
    node.connect(playing.gain).connect(context.destination);
    turn();
    node.port.onmessage = ({ data }) => tell(data, sensor, pace);
    const worker = new Worker("/page/samples.js");
    const { port1, port2 } = new MessageChannel();
    node.port.postMessage(port1, [port1]);
    worker.postMessage({ address: `ws://${location.host}/sound/${encodeURIComponent(name)}`, port: port2 }, [port2]);
    worker.onmessage = () => { silence(); fault.textContent = t("The connection for the sound was interrupted; press Listen again."); };
    playing.worker = worker;
  }

  function silence() {
    starting += 1;
    const before = playing;
    playing = null;
    before?.worker?.terminate(); // its connection ends with it
    before?.context.close();
    told.textContent = "";
    show();
  }

  function tell({ stored, playing: sounds, gaps, dropped, level, full }, { unit, reference, rate }, pace) {
    if (!playing) return;
    const decibel = (value) => `${(20 * Math.log10(Math.max(value / reference, 1e-3))).toFixed(0)} dB`;
    told.textContent = [
      sounds ? t("{level} (0 dB is {reference} {unit}); full scale of the loudspeaker: {full} {unit}",
        { level: decibel(level), reference: reference.toExponential(0), unit, full: number(full, 2) }) : t("silent: no samples arrive"),
      pace === 1 ? "" : t("played at {pace} times the speed, so that the pitch is that of the pace", { pace: number(pace) }),
      t("{stored} ms in store, gaps: {gaps}, {late} s dropped because it was late", { stored: Math.round(1000 * stored), gaps, late: number(dropped / rate / pace, 2) }),
    ].filter(Boolean).join("\n");
  }

  function show() {
    button.textContent = playing ? t("Silence") : t("Listen");
    button.setAttribute("aria-pressed", String(playing !== null));
    button.disabled = !playing && !(store.setup && store.active && store.online && list.value);
  }

  return {
    element: box,
    setup() {
      const again = playing !== null, before = list.value;
      silence();
      box.hidden = !bench.shown.setup;
      if (box.hidden) return;
      const { sensors, why } = store.setup.sound;
      for (const one of [list, button.parentElement]) one.hidden = why !== "";
      told.textContent = said(why); // there is no sensor to hear
      list.replaceChildren(...Object.entries(sensors).map(([name, { unit, rate }]) =>
        h("option", { value: name, selected: name === before }, `${name} (${unit}, ${number(rate / 1e3)} kHz)`)));
      fault.textContent = "";
      if (again && list.value) listen(); // the next run goes on sounding
    },
    state() {
      if (playing && !store.active) silence();
      if (sounded && !store.active) box.open = false; // or it would cover what the run ended with
      sounded = store.active;
      show();
    },
  };
}
