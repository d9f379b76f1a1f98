// When the meter is drawn: at the screen's next frame after a reading, however many have come. Readings come faster than the
// page's text is drawn, and nothing but the meter changes with one.

import { Rate } from "./rate";
import { onFrame } from "./screen-frame";

export class Needle {
  private readonly draws = new Set<() => void>();
  private readonly readings = new Rate();
  private due = false;

  constructor(private readonly frame: (act: () => void) => void = onFrame) {}

  /** A reading has come. */
  moved(): void {
    this.readings.note(performance.now());
    if (this.due || this.draws.size === 0) return;
    this.due = true;
    this.frame(() => {
      this.due = false;
      for (const draw of this.draws) draw();
    });
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
