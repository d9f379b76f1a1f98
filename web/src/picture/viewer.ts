// What keeps the connection and draws its pictures: told what to do, and reporting what came. It knows nothing of the
// page, so that it can work in a worker, where nothing that the page does delays a picture.

import { clockAfter, sentAt, unknown, type Clock } from "../daemon/clock";
import { range } from "./field-map";
import { Live } from "../daemon/live";
import type { Marks } from "./marks";
import { Painter, type Look, type Stamps, type Surface, type Taken } from "./painter";
import type { Overlay } from "../preferences";
import type { RegionFacts } from "./region-watch";
import { onFrame } from "./screen-frame";
import type { Link } from "../state";
import type { Size } from "./viewport";
import type { FrameReading, PictureFacts, ServerMessage } from "../daemon/wire";
import type { Wish } from "../daemon/wish";

export type Command =
  | { do: "open" }
  | { do: "close" }
  | { do: "retry" }
  | { do: "want"; wish: Wish }
  | { do: "attach"; canvas: Surface; over: Surface }
  | { do: "detach" }
  | { do: "look"; look: Look }
  | { do: "overlay"; overlays: Overlay[] }
  | { do: "mark"; marks: Marks }
  | { do: "snapshot"; snapshot: number; stamps: Stamps }
  | { do: "forget" }
  | { do: "forget-map" }
  | { do: "probe"; probe: number; x: number; y: number };

/** What the page says about a map of the spacing. */
export interface MapFacts {
  frameSeq: number;
  rangePx: number;
  /** Between two lines of equal spacing, px; null where it is level within the scatter. */
  stepPx: number | null;
}

/** Times are the page's clock, ms. */
export type Report =
  /** Now and then, whatever else there is to report. */
  | { is: "alive" }
  | { is: "link"; link: Link; nextAt: number | null }
  | { is: "message"; message: ServerMessage; cameAt: number }
  /** A picture has been drawn. */
  | { is: "picture"; facts: PictureFacts; size: Size; sentAt: number }
  | { is: "map"; map: MapFacts }
  | { is: "reading"; reading: FrameReading; cameAt: number }
  | { is: "saturation"; share: number | null }
  | { is: "region"; facts: RegionFacts | null }
  /** What is seen, as a PNG, and of which frame it is; null where nothing is. */
  | { is: "snapshot"; snapshot: number; taken: Taken | null }
  | { is: "grey"; probe: number; grey: number | null };

const ALIVE_MS = 1000;

export class Viewer {
  private readonly painter: Painter;
  private readonly live: Live;
  private clock: Clock = unknown;

  constructor(private readonly report: (report: Report) => void) {
    this.painter = new Painter(
      (share) => report({ is: "saturation", share }),
      (facts) => report({ is: "region", facts }),
    );
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.live = new Live(`${scheme}://${location.host}/api/v1/ws`, {
      link: (link, nextAt) => report({ is: "link", link, nextAt }),
      message: (message, cameAt) => {
        this.clock = clockAfter(this.clock, message, cameAt);
        report({ is: "message", message, cameAt });
      },
      picture: async (picture, cameAt) => {
        const { facts } = picture;
        const size = await this.painter.show(picture);
        if (size === null) return;
        this.aim();
        report({ is: "picture", facts, size, sentAt: sentAt(this.clock, facts, cameAt) });
        // A browser that draws its frames more slowly than pictures come is not sent more of them.
        await new Promise<void>((resolve) => onFrame(resolve));
      },
      reading: (reading, cameAt) => report({ is: "reading", reading, cameAt }),
      map: (map) => {
        const stepPx = this.painter.showMap(map);
        report({ is: "map", map: { frameSeq: map.frameSeq, rangePx: range(map), stepPx } });
      },
    });
    this.live.start();
    setInterval(() => report({ is: "alive" }), ALIVE_MS);
  }

  obey(command: Command): void {
    this.carryOut(command);
    this.aim();
  }

  /** Has sent what is seen. */
  private aim(): void {
    this.live.lookAt(this.painter.aim());
  }

  private carryOut(command: Command): void {
    switch (command.do) {
      case "open":
        return this.live.open();
      case "close":
        return this.live.close();
      case "retry":
        return this.live.now();
      case "want":
        return this.live.want(command.wish);
      case "attach":
        return this.painter.attach(command.canvas, command.over);
      case "detach":
        return this.painter.detach();
      case "look":
        return this.painter.lookAt(command.look);
      case "overlay":
        return this.painter.showOverlays(command.overlays);
      case "mark":
        return this.painter.showMarks(command.marks);
      case "snapshot":
        return void this.painter
          .snapshot(command.stamps)
          .then((taken) => this.report({ is: "snapshot", snapshot: command.snapshot, taken }));
      case "forget":
        return this.painter.forget();
      case "forget-map":
        return this.painter.forgetMap();
      case "probe": {
        const grey = this.painter.grey(command.x, command.y);
        return this.report({ is: "grey", probe: command.probe, grey });
      }
    }
  }
}
