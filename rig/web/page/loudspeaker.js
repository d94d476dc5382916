// Plays samples as they come from a port (samples.js), in the thread of the sound card. It begins with START in store,
// fills up again after a gap, and drops what is later than MOST, so that the sound stays about 0.2 s behind the rig.
//
// Full scale is the largest sample so far, so that nothing is ever cut off, and at least 80 dB.

const START = 0.15, MOST = 0.4; // [s]
const HIGHPASS = 20; // [Hz] what is below is no sound
const LOUD = 1e4; // of the reference: 80 dB
const REPORT = 0.25; // [s]

class Loudspeaker extends AudioWorkletProcessor {
  constructor({ processorOptions }) {
    super();
    this.store = new Float32Array(Math.ceil(sampleRate));
    this.written = 0; this.read = 0; // samples since the begin
    this.playing = false;
    this.before = null; this.value = 0; // of the high-pass filter
    this.keep = Math.exp((-2 * Math.PI * HIGHPASS) / sampleRate);
    this.full = processorOptions.reference * LOUD;
    this.gaps = 0; this.dropped = 0;
    this.squares = 0; this.count = 0;
    this.port.onmessage = ({ data: samples }) => { samples.onmessage = ({ data }) => this.take(data); };
  }

  take(samples) {
    const late = samples.length - this.store.length;
    for (let i = Math.max(late, 0); i < samples.length; i += 1) {
      this.store[this.written % this.store.length] = samples[i];
      this.written += 1;
    }
    if (this.written - this.read > MOST * sampleRate) {
      const next = this.written - Math.round(START * sampleRate);
      this.dropped += next - this.read;
      this.read = next;
    }
  }

  process(_, [[out]]) {
    const stored = this.written - this.read;
    if (!this.playing) this.playing = stored >= START * sampleRate;
    else if (stored < out.length) { this.playing = false; this.gaps += 1; }
    for (let i = 0; i < out.length; i += 1) {
      if (this.playing) {
        const sample = this.store[this.read % this.store.length];
        this.read += 1;
        this.value = this.keep * (this.value + sample - (this.before ?? sample));
        this.before = sample;
        this.squares += this.value * this.value;
        this.count += 1;
      } else {
        this.value *= this.keep; // fades out without a click
      }
      this.full = Math.max(this.full, Math.abs(this.value));
      out[i] = this.value / this.full;
    }
    this.passed = (this.passed ?? 0) + out.length;
    if (this.passed >= REPORT * sampleRate) {
      this.port.postMessage({ stored: (this.written - this.read) / sampleRate, playing: this.playing, gaps: this.gaps,
        dropped: this.dropped, level: this.count ? Math.sqrt(this.squares / this.count) : 0, full: this.full });
      this.passed = 0; this.squares = 0; this.count = 0;
    }
    return true;
  }
}

registerProcessor("loudspeaker", Loudspeaker);
