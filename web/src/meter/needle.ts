// When the meter is drawn: soon after a reading, however many have come, and by itself. Readings come faster than the page's
// text is drawn, and nothing but the meter changes with one.

import { Cadence } from "../browser/cadence";
import { Rate } from "../browser/rate";

/** A frame of the screen, ms: what is drawn more often is not seen. */
const FRAME_MS = 16;

export class Needle {
  private readonly draws = new Set<() => void>();
  private readonly readings = new Rate();
  private readonly cadence = new Cadence(() => {
    for (const draw of this.draws) draw();
  });

  /** A reading has come. */
  moved(): void {
    this.readings.note(performance.now());
    if (this.draws.size > 0) this.cadence.due(FRAME_MS);
  }

  /** Has the meter drawn with readings from now on; returns what ends that. */
  follow(draw: () => void): () => void {
    this.draws.add(draw);
    return () => void this.draws.delete(draw);
  }

  /** Readings a second, of late. */
  get rate(): number {
    return this.readings.at(performance.now());
  }
}

/** The page's one. */
export const needle = new Needle();
