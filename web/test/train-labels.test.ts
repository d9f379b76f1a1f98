import { describe, expect, it } from "vitest";
import { placed } from "../src/design/labels";
import { boxOf, fitted, PARTS, type Train } from "../src/design/optical-train";
import { trainLabels } from "../src/design/train-labels";

const box = { x: 0, y: 0, width: 100, height: 100 };

describe("labels", () => {
  it("stand where they like best, and elsewhere where that is taken", () => {
    const spots = [
      { x: 50, y: 50, anchor: "middle" as const },
      { x: 50, y: 70, anchor: "middle" as const },
    ];
    const words = ["one", "two", "three"].map((text) => ({ text, spots }));
    expect(placed(words, 10, box, [])).toEqual([
      { text: "one", x: 50, y: 50, anchor: "middle" },
      { text: "two", x: 50, y: 70, anchor: "middle" },
    ]);
  });

  it("do not stand over what is drawn, nor half outside", () => {
    const label = { text: "sensor", spots: [{ x: 90, y: 50, anchor: "start" as const }] };
    expect(placed([label], 10, box, [])).toEqual([]);
    const inside = { text: "sensor", spots: [{ x: 10, y: 50, anchor: "start" as const }] };
    expect(placed([inside], 10, box, [{ x: 20, y: 45, width: 2, height: 2 }])).toEqual([]);
  });
});

describe("the words of the optical train", () => {
  const train = (e: number | null): Train => ({
    centre: e === null ? null : -e,
    outerRadius: 59,
    innerRadius: 51,
    mla: 22,
    sensor: 22.34,
    object: -((e ?? 0) + 59 + 800),
    aperture: 6.4,
    sensorWidth: 4,
    boardWidth: 156,
    pitch: 0.1,
    rays: [],
  });

  it("are all there wherever the shell's centre is, however wide the drawing", () => {
    for (const e of [null, -5, 0, 0.5, 3, 10, 28, 40]) {
      for (const part of PARTS) {
        for (const [width, height] of [
          [250, 208],
          [330, 208],
          [640, 300],
          [1200, 350],
        ] as const) {
          const drawn = train(e);
          const whole = fitted(boxOf(drawn, part), width / height);
          const found = trainLabels(drawn, part, whole, (12 * whole.width) / width, whole.width / 4);
          const wanted = {
            camera: ["MLA, sensor", "main lens", ...(e === null ? [] : ["centre C", "water"])],
            scene: ["board", ...(e === null ? [] : ["water"])],
            mla: ["MLA", "sensor"],
          }[part];
          expect(found.map(({ text }) => text).sort(), `${part} ${e} ${width}`).toEqual(wanted.sort());
        }
      }
    }
  });
});
