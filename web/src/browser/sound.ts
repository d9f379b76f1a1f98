// The page's sounds: the tone that follows the spacing, and the call when it is the operator's turn. Browsers let a page
// sound only once somebody has pressed something on it.

import type { Tone } from "../meter/tone";

const VOLUME = 0.2;
/** So fast a change that the ear hears none, s. */
const GLIDE_S = 0.02;
/** The call: two notes, Hz, and how long each is, s. */
const CALL_HZ = [660, 880] as const;
const NOTE_S = 0.18;

interface Voice {
  pitch: OscillatorNode;
  /** What is left of the tone: half of it, and another half as the pulses go. */
  loudness: GainNode;
  beat: OscillatorNode;
  depth: GainNode;
}

class Sound {
  private context: AudioContext | null = null;
  private voice: Voice | null = null;

  /** Sounds a tone until it is told another, or none. */
  play(tone: Tone | null): void {
    if (tone === null && this.voice === null) return;
    const { context, voice } = this.ready();
    const now = context.currentTime;
    const steady = tone?.pulses === null;
    if (tone) voice.pitch.frequency.setTargetAtTime(tone.hertz, now, GLIDE_S);
    if (tone?.pulses) voice.beat.frequency.setTargetAtTime(tone.pulses, now, GLIDE_S);
    voice.depth.gain.setTargetAtTime(tone && !steady ? VOLUME / 2 : 0, now, GLIDE_S);
    voice.loudness.gain.setTargetAtTime(tone ? (steady ? VOLUME : VOLUME / 2) : 0, now, GLIDE_S);
  }

  /** Calls the operator. */
  call(): void {
    const context = this.heard();
    CALL_HZ.forEach((hertz, number) => {
      const from = context.currentTime + number * NOTE_S;
      const note = new OscillatorNode(context, { frequency: hertz });
      const loudness = new GainNode(context, { gain: VOLUME });
      loudness.gain.setTargetAtTime(0, from + 0.7 * NOTE_S, GLIDE_S);
      note.connect(loudness).connect(context.destination);
      note.start(from);
      note.stop(from + 2 * NOTE_S);
    });
  }

  private heard(): AudioContext {
    this.context ??= new AudioContext();
    // Where nobody has pressed anything yet, the browser refuses: it is tried again with the next sound.
    if (this.context.state === "suspended") void this.context.resume().catch(() => undefined);
    return this.context;
  }

  private ready(): { context: AudioContext; voice: Voice } {
    const context = this.heard();
    if (!this.voice) {
      const pitch = new OscillatorNode(context, { type: "triangle" });
      const loudness = new GainNode(context, { gain: 0 });
      const beat = new OscillatorNode(context, { type: "square" });
      const depth = new GainNode(context, { gain: 0 });
      pitch.connect(loudness).connect(context.destination);
      beat.connect(depth).connect(loudness.gain);
      pitch.start();
      beat.start();
      this.voice = { pitch, loudness, beat, depth };
    }
    return { context, voice: this.voice };
  }
}

/** The page's one. */
export const sound = new Sound();
