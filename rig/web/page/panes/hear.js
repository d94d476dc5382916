// Hear: a sensor of the running scene on the loudspeaker, at a volume that starts low. At another pace than 1 the same
// samples are played slower or faster, so that the pitch changes with the pace.

import { h, number, pane } from "/page/dom.js";

const VOLUME = 10; // of 100: the volume at first

export function create(bench) {
  const { store } = bench;
  const why = h("p", { class: "small faint", id: "hear-why" });
  const fault = h("div", { class: "fault", id: "hear-fault", role: "alert" });
  const list = h("select", { id: "hear-sensor", "aria-label": "sensor to hear", onchange: () => { if (playing) listen(); } });
  const button = h("button", { id: "hear", "aria-pressed": "false", onclick: () => (playing ? silence() : listen()) }, "Listen");
  const volume = h("input", { type: "range", min: 0, max: 100, value: VOLUME, id: "volume", oninput: () => turn() });
  const told = h("div", { class: "small", id: "hear-told", role: "status" });
  const box = h("div", {}, list, h("div", { class: "row" }, button), h("label", { class: "small" }, "volume ", volume), fault, told);
  let playing = null; // {context, gain, worker} while the page listens
  let starting = 0;

  const turn = () => { if (playing) playing.gain.gain.value = (volume.value / 100) ** 2; };

  async function listen() {
    silence();
    starting += 1;
    const mine = starting;
    fault.textContent = "";
    const name = list.value, sensor = store.setup.sound.sensors[name], pace = store.state.pace;
    if (!pace) {
      fault.textContent = "This run does not follow the clock: its sound would not be steady. Start it at a pace, such as 1.";
      return;
    }
    const rate = sensor.rate * pace;
    let context;
    try {
      context = new AudioContext({ sampleRate: rate });
    } catch {
      fault.textContent = `This browser cannot play ${number(rate, 6)} samples per second (${name} at pace ${number(pace)}). Choose a pace nearer to 1, or another sensor.`;
      return;
    }
    playing = { context, gain: context.createGain(), worker: null };
    show();
    try {
      await context.audioWorklet.addModule("/page/loudspeaker.js");
      await context.resume();
    } catch (error) {
      if (mine === starting) { silence(); fault.textContent = `This browser does not play the sound: ${error.message}`; }
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
    worker.onmessage = () => { silence(); fault.textContent = "The connection for the sound was interrupted; press Listen again."; };
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
      sounds ? `${decibel(level)} (0 dB is ${reference.toExponential(0)} ${unit}); full scale of the loudspeaker: ${number(full, 2)} ${unit}`
        : "silent: no samples arrive",
      pace === 1 ? "" : `played at ${number(pace)} times the speed, so that the pitch is that of the pace`,
      `${Math.round(1000 * stored)} ms in store, ${gaps} ${gaps === 1 ? "gap" : "gaps"}, ${number(dropped / rate / pace, 2)} s dropped because it was late`,
    ].filter(Boolean).join("\n");
  }

  function show() {
    button.textContent = playing ? "Silence" : "Listen";
    button.setAttribute("aria-pressed", String(playing !== null));
    button.disabled = !playing && !(store.setup && store.active && store.online && list.value);
  }

  told.classList.add("pre");
  box.hidden = true;
  why.textContent = "Start a run: this pane plays the sound of its microphone or of another fast sensor.";
  return {
    element: pane("Sound", why, box),
    setup() {
      const again = playing !== null, before = list.value;
      silence();
      const { sensors, why: reason } = store.setup.sound;
      why.textContent = reason;
      box.hidden = reason !== "";
      list.replaceChildren(...Object.entries(sensors).map(([name, { unit, rate }]) =>
        h("option", { value: name, selected: name === before }, `${name} (${unit}, ${number(rate / 1e3)} kHz)`)));
      fault.textContent = "";
      if (again && list.value) listen(); // the next run goes on sounding
    },
    state() {
      if (playing && !store.active) silence();
      show();
    },
  };
}
