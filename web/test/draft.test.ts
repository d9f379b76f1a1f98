import { describe, expect, it } from "vitest";
import type { JsonObject } from "../src/design/config-schema";
import {
  awaited,
  count,
  difference,
  isChanged,
  laidOver,
  overtaken,
  rebased,
  spelt,
  typed,
} from "../src/design/draft";
import { Newest } from "../src/daemon/newest";
import { barLength, boxOf, fitted, hemisphere, trainOf } from "../src/design/optical-train";
import { waterBy, waterSaid } from "../src/design/water";
import type { DraftState } from "../src/daemon/wire";

const base: JsonObject = {
  shell: { outer_radius_mm: 59, inner_radius_mm: 51 },
  mla: { mode: "galilean", pitch_mm: 0.1 },
  water: { refractive_index: 1.333 },
};

describe("a draft", () => {
  it("is spelt and read in the unit chosen, without digits that nobody typed", () => {
    expect(spelt(0.1, "length", "µm")).toBe("100");
    expect(spelt(0.1 + 0.2, "length", "µm")).toBe("300");
    expect(typed("51,3", "length", "mm")).toBe(51.3);
    expect(typed("345", "length", "µm")).toBe(0.345);
    expect(typed("3.45", "pixel", "µm")).toBe(3.45);
    expect(typed("wide", "length", "mm")).toBe("wide");
    expect(typed("", "plain", "mm")).toBe("");
  });

  it("asks only for what differs, and for the water whole", () => {
    const edited = {
      ...base,
      shell: { outer_radius_mm: 80, inner_radius_mm: 51 },
      water: { temperature_c: 20, salinity_permille: 0, wavelength_nm: 550 },
    };
    const changes = difference(base, edited);
    expect(changes).toEqual({ shell: { outer_radius_mm: 80 }, water: edited.water });
    expect(count(changes)).toBe(4);
    expect(difference(base, base)).toEqual({});
    expect(isChanged(base, edited, "shell.outer_radius_mm")).toBe(true);
    expect(isChanged(base, edited, "mla.pitch_mm")).toBe(false);
  });

  it("is laid over what the file says, whose other keys stay", () => {
    const stored = { ...base, shell: { outer_radius_mm: 60, inner_radius_mm: 52 }, bench: { e: 1 } };
    const changes = { shell: { outer_radius_mm: 80 }, water: { temperature_c: 20 } };
    expect(laidOver(stored, changes)).toEqual({
      ...base,
      shell: { outer_radius_mm: 80, inner_radius_mm: 52 },
      water: { temperature_c: 20 },
      bench: { e: 1 },
    });
  });

  it("begins from what waits in the file for the daemon's next start", () => {
    const stored = {
      ...base,
      shell: { outer_radius_mm: 70, inner_radius_mm: 52 },
      water: { temperature_c: 20 },
      bench: { e: 1 },
    };
    const file = {
      stored,
      fault: null,
      etag: '"1"',
      waiting: ["shell.outer_radius_mm", "water.temperature_c", "bench.e"],
    };
    // The inner radius differs for another reason: the command line has set it.
    const shell = { outer_radius_mm: 70, inner_radius_mm: 51 };
    expect(awaited(base, file)).toEqual({ ...base, shell, water: { temperature_c: 20 } });
    expect(awaited(base, { stored: null, fault: "mend it", etag: null, waiting: [] })).toBe(base);
    expect(awaited(base, null)).toBe(base);
  });

  it("goes on over another configuration, which nothing but its own changes differs from", () => {
    const now = { ...base, shell: { outer_radius_mm: 70, inner_radius_mm: 51 } };
    expect(rebased(null, null, now)).toBe(now);
    expect(rebased(base, base, now)).toEqual(now);
    const draft = { ...base, mla: { mode: "galilean", pitch_mm: 0.12 } };
    expect(rebased(draft, base, now)).toEqual({ ...now, mla: draft.mla });
  });

  it("knows what has been changed elsewhere meanwhile", () => {
    const pitch = (mm: number) => ({ ...base, mla: { mode: "galilean", pitch_mm: mm } });
    const paths = ["mla.pitch_mm", "mla.mode", "shell.outer_radius_mm"];
    expect(overtaken(pitch(0.12), pitch(0.1), pitch(0.11), paths)).toEqual(["mla.pitch_mm"]);
    // To the same value, elsewhere only, and here only.
    expect(overtaken(pitch(0.12), pitch(0.1), pitch(0.12), paths)).toEqual([]);
    expect(overtaken(pitch(0.1), pitch(0.1), pitch(0.11), paths)).toEqual([]);
    expect(overtaken(pitch(0.12), pitch(0.1), pitch(0.1), paths)).toEqual([]);
  });

  it("undoes nothing that another has changed beside it, however deep", () => {
    const camera = (device: string, rate: number | null) => ({
      bench: { camera: rate === null ? { device } : { device, frame_rate_hz: rate } },
    });
    const [stored, mine, theirs] = [camera("a", 10), camera("a", 20), camera("b", 10)];
    expect(rebased(mine, stored, theirs)).toEqual(camera("b", 20));
    // What was taken out stays out.
    expect(rebased(camera("a", null), stored, theirs)).toEqual(camera("b", null));
  });

  it("says the water by its index or by its conditions", () => {
    expect(waterBy(base["water"])).toBe("index");
    expect(waterBy({ temperature_c: 20 })).toBe("conditions");
    expect(waterBy({ refractive_index: null, temperature_c: 20 })).toBe("conditions");
    expect(waterSaid("index", 1.33345678)).toEqual({ refractive_index: 1.333457 });
    expect(waterBy(waterSaid("conditions", 1.33))).toBe("conditions");
  });
});

describe("the newest question", () => {
  it("alone has an answer, in whatever order answers come", async () => {
    const newest = new Newest();
    let late: (value: string) => void = () => undefined;
    const first = newest.of(new Promise<string>((resolve) => (late = resolve)));
    const second = newest.of(Promise.resolve("second"));
    expect(await second).toBe("second");
    late("first");
    expect(await first).toBeNull();
  });
});

describe("the drawing", () => {
  const state: DraftState = {
    state: "joint",
    delta_v_mm: 2.2,
    e_mm: 10,
    lens_to_mla_mm: 21,
    image_distance_mm: 22,
    aperture_mm: 6,
    aperture_ring_f_number: 3,
    fov_deg: 10,
    board_width_mm: 156,
    blur_px: 0,
    depth_of_field: null,
    e_tolerance: null,
    reoptimise: null,
    rays: [
      {
        field: 0,
        points_mm: [
          [-21.3, 0.1],
          [-21, 0.2],
          [0, 3],
          [869, 0],
        ],
      },
    ],
  };
  const parts = {
    outerRadius: 59,
    innerRadius: 51,
    pitch: 0.1,
    b: 0.34,
    sensorWidth: 4,
    objectDistance: 800,
  };

  it("has the object on the left and the sensor on the right, at their places", () => {
    const train = trainOf(state, parts);
    expect([train.centre, train.mla, train.sensor, train.object]).toEqual([-10, 21, 21.34, -869]);
    expect(train.rays[0]?.points).toBe("21.3,-0.1 21,-0.2 0,-3 -869,0");
    expect(trainOf({ ...state, e_mm: null }, parts)).toMatchObject({ centre: null, object: -800 });
  });

  it("shows each part whole", () => {
    const train = trainOf(state, parts);
    const within = (box: ReturnType<typeof boxOf>, x: number) => x > box.x && x < box.x + box.width;
    const camera = boxOf(train, "camera");
    for (const x of [-69, -10, 0, 21.34]) expect(within(camera, x)).toBe(true);
    expect(within(camera, train.object)).toBe(false);
    expect(camera.height).toBeGreaterThan(2 * 6);
    expect(within(boxOf(train, "scene"), train.object)).toBe(true);
    expect(boxOf(train, "scene").height).toBeGreaterThan(156);
    const mla = boxOf(train, "mla");
    expect(within(mla, 21) && within(mla, 21.34) && !within(mla, 0)).toBe(true);
  });

  it("fills where it is shown, with nothing of it left out", () => {
    const box = { x: -70, y: -10, width: 100, height: 20 };
    expect(fitted(box, 10)).toEqual({ x: -170, y: -10, width: 200, height: 20 });
    expect(fitted(box, 2)).toEqual({ x: -70, y: -25, width: 100, height: 50 });
  });

  it("has half circles about C, and bars of round lengths", () => {
    expect(hemisphere(-10, 59)).toBe("M-10 -59A59 59 0 0 0 -10 59");
    expect([120, 900, 0.8, 4].map(barLength)).toEqual([20, 200, 0.2, 1]);
  });
});
