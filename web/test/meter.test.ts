import { describe, expect, it } from "vitest";
import { advice } from "../src/meter/advice";
import { correction, octant, tilt } from "../src/meter/correction";
import { hindrance } from "../src/meter/hindrance";
import { band, beyond, digits, END_PX, place, steadyDigits } from "../src/meter/scale";
import { best, isCalledInFocus, reading as readingIn } from "../src/meter/reading";
import { receive, receiveReading } from "../src/received";
import { initial, type State } from "../src/state";
import { strings } from "../src/strings";
import { strings as de } from "../src/strings/de";
import { strings as en } from "../src/strings/en";
import { toneNow } from "../src/meter/tone";
import type { Bench } from "../src/daemon/wire";
import { bench as snapshotBench, boot, design, frameReading, measurement, snapshot } from "./fixtures";

describe("the meter's scale", () => {
  it("has the target in the middle, the ends at its ends, and keeps what is beyond at the end", () => {
    expect(place(0)).toBe(0);
    expect(place(END_PX)).toBe(1);
    expect(place(-END_PX)).toBe(-1);
    expect(place(5000)).toBe(1);
    expect(place(-Infinity)).toBe(-1);
    expect(place(NaN)).toBe(0);
    expect([beyond(10), beyond(-10.1)]).toEqual([false, true]);
  });

  it("shows a hundredth of a pixel from the target, and grows all the way", () => {
    expect(place(0.01)).toBeGreaterThan(0.05);
    const places = [-10, -1, -0.1, -0.01, 0, 0.01, 0.1, 1, 10].map(place);
    expect(places).toEqual([...places].sort((a, b) => a - b));
    expect(new Set(places).size).toBe(places.length);
    expect(place(-0.3)).toBeCloseTo(-place(0.3), 12);
  });

  it("has a band of two standard uncertainties on either side of the reading", () => {
    expect(band(0.1, 0.02)).toEqual({ from: place(0.06), to: place(0.14) });
    expect(band(0, 0)).toEqual({ from: 0, to: 0 });
  });

  it("gives two digits of the uncertainty, and four decimals at most", () => {
    expect([0.0021, 0.013, 0.4, 3, 25, 0, Infinity].map(digits)).toEqual([4, 3, 2, 1, 0, 4, 4]);
  });
});

describe("the meter's figure", () => {
  it("keeps its length while the uncertainty only just calls for another", () => {
    expect(steadyDigits(0.0099, null)).toBe(4);
    expect(steadyDigits(0.0101, 4)).toBe(4);
    expect(steadyDigits(0.0099, 3)).toBe(3);
    expect(steadyDigits(0.02, 4)).toBe(3);
    expect(steadyDigits(0.0099, 0)).toBe(4);
  });
});

/** Through the shell. */
const reading = (of: Parameters<typeof readingIn>[0]) => readingIn(of, { inAir: false, otherwise: null });

describe("peak hold", () => {
  it("keeps what came closest to the target, and where the axes stood", () => {
    const moving = best(null, reading({ ...measurement(19.8, 0.002), focus_mm: 1.5, settled: false }));
    expect(moving, "where an axis stood that moved is not known").toMatchObject({ focusMm: null, eMm: null });
    const first = best(null, reading({ ...measurement(19.8, 0.002), focus_mm: 1.5, e_mm: null }));
    expect(first).toMatchObject({ focusMm: 1.5, eMm: null, targetPx: 19.725 });
    const better = best(first, reading(measurement(19.71, 0.002)));
    expect(better.differencePx).toBeCloseTo(-0.015, 9);
    expect(best(better, reading(measurement(19.75, 0.002)))).toBe(better);
    const surer = best(better, reading(measurement(19.7115, 0.0005)));
    expect(best(surer, reading(measurement(19.7249, 0.05)))).toBe(surer);
  });

  it("begins anew with another target", () => {
    const held = best(null, reading(measurement(19.726, 0.002)));
    const other = best(held, reading({ ...measurement(25, 0.002), spacing_target_px: 20 }));
    expect(other.differencePx).toBe(5);
  });
});

describe("two boards in view", () => {
  const two = { spacings_px: [19.93, 19.725], difference_sigma_px: 0.004, share: 0.38 };
  const at = Date.parse("2026-01-01T00:00:10Z");
  const state: State = {
    ...receive(initial, snapshot(5), at),
    measurement: { ...measurement(19.725, 0.001), two_boards: two },
    tone: true,
    link: "open",
  };

  it("are never on target or in focus, order no move, sound no tone and are never the best", () => {
    const { reading: seen, best: held } = receiveReading(state, frameReading(19.725, at), at);
    expect(seen).toMatchObject({ direction: "two_boards", inFocus: false, twoBoards: two });
    expect(held).toBeNull();
    expect(toneNow({ ...state, reading: seen, readingAt: at }, at)).toBeNull();
    const { main, other } = advice(seen!, correction(design, seen!), "e", "mm");
    expect([main, other]).toEqual([strings.meter.twoBoards("19.93", "19.73", "38"), null]);
    const whole = reading({ ...state.measurement!, in_focus: true });
    expect(whole).toMatchObject({ direction: "two_boards", inFocus: false });
    // Nobody has asked for it: it may be one of several levels.
    const unasked = readingIn(state.measurement!, { inAir: false, otherwise: "unasked" });
    expect(advice(unasked, null, "e", "mm").main).toBe(strings.meter.orderless.unasked);
  });

  it("say nothing of the next measurement that shows one", () => {
    const one: State = { ...state, measurement: measurement(19.725, 0.001) };
    const { reading: seen } = receiveReading(one, frameReading(19.725, at), at);
    expect(seen).toMatchObject({ direction: "there", inFocus: true, twoBoards: null });
  });
});

describe("a spacing that steps over the field", () => {
  const at = Date.parse("2026-01-01T00:00:10Z");
  const whole = (atMs: number) => ({
    ...measurement(19.725, 0.001),
    captured_at: new Date(at + atMs).toISOString(),
  });
  const state: State = { ...initial, measurement: whole(-500), tone: true, link: "open" };
  const read = (before: State, atMs: number, doubted: boolean, combined = {}) => {
    const frame = frameReading(19.7251, at + atMs, combined);
    const found = frame.found.is === "measured" ? { ...frame.found, doubted } : frame.found;
    return receiveReading(before, { ...frame, found }, at + atMs);
  };

  it("is of no board until it is measured in whole: it is no figure, order, tone or best", () => {
    const one = read(state, 0, false);
    expect(one.reading).toMatchObject({ direction: "there", inFocus: true });
    const doubted = read(one, 40, true, { ofNewPicture: true });
    expect(doubted.reading).toMatchObject({ direction: "doubted", inFocus: false, twoBoards: null });
    expect(doubted.best).toBe(one.best);
    expect(toneNow(doubted, at + 40)).toBeNull();
    const { main, other } = advice(doubted.reading!, correction(design, doubted.reading!), "e", "mm");
    expect([main, other]).toEqual([strings.meter.doubtedMore(""), null]);
    const stuck = { ...doubted.reading!, unresolved: "the frame is too dark" };
    expect(advice(stuck, null, "e", "mm").main).toMatch(/in whole; none could be: the frame is too dark$/);
    // One board after all, whose tilt steps: it has been measured.
    const sure = read({ ...doubted, measurement: whole(60) }, 80, false, { spanMs: 40, ofNewPicture: true });
    expect(sure.reading).toMatchObject({ direction: "there", inFocus: true });
  });

  it("says what is known where two boards or several levels are", () => {
    const two = { spacings_px: [19.93, 19.725], difference_sigma_px: 0.004, share: 0.38 };
    const seen = read({ ...state, measurement: { ...whole(-500), two_boards: two } }, 0, true);
    expect(seen.reading?.direction).toBe("two_boards");
    const bench = { ...snapshotBench, in_view: "stepped_board" as const };
    expect(read({ ...state, bench }, 0, true).reading?.direction).toBe("levels");
  });

  it("takes with it what was the best since one board was measured in whole, however often it has leapt since", () => {
    let now = read(state, 0, false);
    // Nearer by chance, of a picture that nobody has measured; then it leaps again, and again.
    const surer = { sigmaPx: 0.0001, ofNewPicture: true };
    now = read(now, 100, false, surer);
    expect(now.best).toMatchObject({ capturedAt: at + 100 });
    now = read(now, 200, false, { ofNewPicture: true });
    now = read(now, 300, true, { ofNewPicture: true });
    expect(now.reading).toMatchObject({ pictureAt: at + 300, unmeasuredAt: at + 100 });
    expect(now.best).toBeNull();
  });
});

describe("a board of several levels in view", () => {
  const at = Date.parse("2026-01-01T00:00:10Z");
  const bench = { ...snapshotBench, in_view: "stepped_board" as const, shell: "off" as const };
  const state: State = { ...initial, bench, tone: true, link: "open" };

  it("is never on target or in focus, orders no move, sounds no tone and is never the best, whoever read it", () => {
    const whole = measurement(19.725, 0.001);
    const framed = receiveReading({ ...state, measurement: whole }, frameReading(19.725, at), at);
    const measured = receive(state, { type: "measurement", seq: 1, boot_id: boot, measurement: whole }, at);
    for (const { reading: seen, best: held } of [framed, measured]) {
      expect(seen).toMatchObject({ direction: "levels", inFocus: false });
      expect(held).toBeNull();
      expect(toneNow({ ...state, reading: seen, readingAt: at }, at)).toBeNull();
      const { main, other } = advice(seen!, correction(design, seen!), "delta_v", "mm");
      expect([main, other]).toEqual([strings.meter.orderless.levels, null]);
    }
    // Nor is one that stands elsewhere, which has another target.
    const elsewhere = {
      ...state,
      bench: { ...bench, in_view: "board_elsewhere" as const },
      measurement: whole,
    };
    const { reading: there, best: none } = receiveReading(elsewhere, frameReading(19.725, at), at);
    expect([there?.direction, there?.inFocus, none]).toEqual(["elsewhere", false, null]);
    expect(advice(there!, correction(design, there!), "delta_v", "mm").main).toBe(
      strings.meter.orderless.elsewhere,
    );
    // Nor is any while nobody has said whether the shell is on: in air the target is another.
    const unsaid = {
      ...state,
      bench: { ...snapshotBench, in_view: "flat_board" as const, shell: "unknown" as const },
      measurement: whole,
    };
    const { reading: one, best: neither } = receiveReading(unsaid, frameReading(19.725, at), at);
    expect([one?.direction, one?.inFocus, neither]).toEqual(["unsaid", false, null]);
    expect(advice(one!, correction(design, one!), "e", "mm").main).toBe(strings.meter.orderless.unsaid);
    // Nor by one that no job has asked for: a job may have ended with none.
    const unasked = {
      ...state,
      bench: { ...snapshotBench, in_view: "other" as const, shell: "off" as const },
      measurement: whole,
    };
    const { reading: other, best: nothing } = receiveReading(unasked, frameReading(19.725, at), at);
    expect([other?.direction, other?.inFocus, nothing]).toEqual(["unasked", false, null]);
    expect(advice(other!, correction(design, other!), "delta_v", "mm").main).toBe(
      strings.meter.orderless.unasked,
    );
    // Whatever was seen of two boards before: they are its levels.
    const two = { spacings_px: [19.93, 19.725], difference_sigma_px: 0.004, share: 0.38 };
    const both = receiveReading(
      { ...state, measurement: { ...whole, two_boards: two } },
      frameReading(19.7, at),
      at,
    );
    expect(both.reading?.direction).toBe("levels");
  });
});

describe("a picture that is another one", () => {
  const start = Date.parse("2026-01-01T00:00:10Z");
  const whole = (atMs: number) => ({
    ...measurement(19.725, 0.001),
    captured_at: new Date(start + atMs).toISOString(),
  });
  const read = (state: State, atMs: number, spanMs: number, ofNewPicture: boolean) =>
    receiveReading(state, frameReading(19.725, start + atMs, { spanMs, ofNewPicture }), start + atMs);

  it("is not in focus where nothing was measured in whole since what is in view was set up", () => {
    expect(read({ ...initial, link: "open" }, 0, 0, false).reading?.inFocus).toBe(false);
    const bench = { ...snapshotBench, set_up_at: new Date(start).toISOString() };
    const measured = (atMs: number): State => ({ ...initial, link: "open", bench, measurement: whole(atMs) });
    expect(read(measured(-500), 100, 0, false).reading?.inFocus).toBe(false);
    expect(read(measured(50), 100, 0, false).reading?.inFocus).toBe(true);
  });

  it("is in focus only once it was measured in whole: until then nobody knows of how many boards it is", () => {
    let state = read({ ...initial, link: "open", measurement: whole(-500) }, 0, 0, true);
    expect(state.reading).toMatchObject({ inFocus: false, direction: "there" });
    state = read({ ...state, measurement: whole(50) }, 100, 100, true);
    expect(state.reading?.inFocus).toBe(true);
    // What is combined reaches back some seconds only; the picture is the same.
    state = read(state, 20_000, 15_000, true);
    expect(state.reading?.inFocus).toBe(false);
    state = read({ ...state, measurement: whole(19_000) }, 20_100, 5000, true);
    for (let ms = 20_200; ms < 40_000; ms += 100) {
      state = read(state, ms, 5000, true);
      expect(state.reading?.inFocus).toBe(true);
    }
    // An axis that moves leaves the board as it was, another picture does not.
    state = read(state, 40_000, 0, false);
    expect(state.reading?.inFocus).toBe(true);
    state = read(state, 40_100, 0, true);
    expect(state.reading?.inFocus).toBe(false);
    state = read(state, 40_200, 0, false);
    expect(state.reading?.inFocus).toBe(false);
    state = read({ ...state, measurement: whole(40_150) }, 40_300, 0, false);
    expect(state.reading?.inFocus).toBe(true);
  });

  it("leaves nothing as the best that was read before it was known to be of two boards", () => {
    const two = { spacings_px: [19.93, 19.725], difference_sigma_px: 0.004, share: 0.38 };
    let state = read({ ...initial, link: "open", measurement: whole(-500) }, 0, 0, false);
    const one = state.best;
    expect(one).toMatchObject({ capturedAt: start });
    // What one board was best at stays.
    state = read({ ...state, measurement: { ...whole(1100), two_boards: two } }, 1200, 200, true);
    expect(state.best).toBe(one);
    // Another picture, nearer by chance, before anybody has measured it in whole.
    state = receiveReading(
      { ...state, measurement: whole(1300) },
      frameReading(19.72501, start + 2000, { sigmaPx: 0.0001, spacingPx: 19.72501, ofNewPicture: true }),
      start + 2000,
    );
    expect(state.best).toMatchObject({ capturedAt: start + 2000 });
    state = read({ ...state, measurement: { ...whole(2100), two_boards: two } }, 2200, 200, true);
    expect(state.reading?.direction).toBe("two_boards");
    expect(state.best).toBeNull();
  });
});

describe("the correction", () => {
  it("is Eq. 9 turned round: a spacing made by a known Δv error is told as that error", () => {
    // Galilean: l = D (a − b) / a, with a 0.05 mm larger than in focus.
    const { a_mm: a, b_mm: b } = design.mla;
    const pitch = (design.spacing_target_px * a) / (a - b);
    const off = a + 0.05;
    const seen = measurement((pitch * (off - b)) / off, 0.002);
    const found = correction(design, reading({ ...seen, spacing_target_px: design.spacing_target_px }));
    expect(found?.deltaVMm).toBeCloseTo(0.05, 9);
    // dl/da = D b / a².
    expect(found?.sigmaMm).toBeCloseTo((0.002 * off * off) / (pitch * b), 9);
    expect(found?.eMm).toBeGreaterThan(0);
  });

  it("of e leads to where the design is in focus, from near and from far", () => {
    const far = ({ joint, clarity, spacing_target_px: target, mla: { a_mm: a, b_mm: b } }: typeof design) => {
      // With Δv as in the joint solution, at the clarity one's e.
      const off = a - (joint.delta_v_mm - clarity.delta_v_mm);
      return (((target * a) / (a - b)) * (off - b)) / off;
    };
    const at = (spacing: number, e_mm: number) =>
      correction(
        design,
        reading({ ...measurement(spacing, 0.002), spacing_target_px: design.spacing_target_px, e_mm }),
      )?.eMm;
    const { spacing_target_px: target, blur_limit_px: blur, e_tolerance: within } = design;
    expect(at(target - blur, within!.high_mm!)).toBeCloseTo(-within!.high_mm!, 3);
    expect(at(target + blur, within!.low_mm!)).toBeCloseTo(-within!.low_mm!, 3);
    expect(at(far(design), 30)).toBeCloseTo(-30, 3);
    // As the simulated bench has it: 2 mm too large an e, the picture by exact rays.
    expect(Math.abs(at(target - 0.3407, 2)! + 2)).toBeLessThan(0.1);
  });

  it("holds in Keplerian mode, where the spacing is larger than the pitch", () => {
    const { a_mm: a, b_mm: b } = design.mla;
    const keplerian = { ...design, spacing_target_px: (29 * (-a - b)) / -a };
    const off = -a + 0.02;
    const seen = {
      ...measurement((29 * (off - b)) / off, 0.002),
      spacing_target_px: keplerian.spacing_target_px,
    };
    expect(correction(keplerian, reading({ ...seen, micro_image_pitch_px: 29.3 }))?.deltaVMm).toBeCloseTo(
      0.02,
      9,
    );
  });

  it("is told only where it can be", () => {
    expect(correction(null, reading(measurement(19.8, 0.002)))).toBeNull();
    expect(correction(design, null)).toBeNull();
    expect(correction(design, reading(measurement(28.985, 0.002)))).toBeNull();
    const flat = { ...design, clarity: { ...design.clarity, e_mm: design.joint.e_mm } };
    expect(correction(flat, reading(measurement(19.8, 0.002)))?.eMm).toBeNull();
  });
});

describe("the tilt", () => {
  it("is an angle that grows with the frame's slope, and the way the spacing grows", () => {
    const seen = measurement(19.725, 0.002);
    const leaning = { ...seen, spacing: { ...seen.spacing, tilt_x_px: 0, tilt_y_px: 0.4 } };
    const found = tilt(design, reading(leaning), 1160);
    // dl/dΔv = D b / a² = 8.695 px/mm; half the frame is 2.001 mm wide.
    expect(found?.degrees).toBeCloseTo((Math.atan(0.4 / 8.695 / 2.001) * 180) / Math.PI, 2);
    expect(found?.sigmaDegrees).toBeCloseTo(
      (Math.atan((Math.sqrt(3) * 0.002) / 8.695 / 2.001) * 180) / Math.PI,
      4,
    );
    expect(octant(found?.towards ?? 0)).toBe("bottom");
    expect(tilt(design, reading(leaning), 0)).toBeNull();
  });

  it("has eight names", () => {
    expect([0, 50, 90, 135, 180, -180, -90, -40].map((degrees) => octant((degrees * Math.PI) / 180))).toEqual(
      ["right", "lowerRight", "bottom", "lowerLeft", "left", "left", "top", "upperRight"],
    );
  });
});

describe("the advice", () => {
  const of = (spacing: number, moved: "e" | "delta_v") => {
    const seen = measurement(spacing, 0.002);
    const now = reading(seen);
    return advice(now, correction(design, now), moved, "mm");
  };

  it("moves the camera away from the shell where the spacing is too large, towards it where it is too small", () => {
    expect(of(19.78, "e").main).toMatch(/^Move the camera 0\.\d\d mm away from the shell$/);
    expect(of(19.67, "e").main).toMatch(/^Move the camera 0\.\d\d mm towards the shell$/);
    expect(of(19.78, "e").other).toMatch(/^or Δv by \+0\.00\d+ mm$/);
  });

  it("moves MLA and sensor while Δv is set", () => {
    expect(of(19.78, "delta_v").main).toMatch(/^Move MLA and sensor 0\.\d+ mm away from the lens$/);
    expect(of(19.67, "delta_v").main).toMatch(/towards the lens$/);
    // The shell is off then: there is no e to be moved.
    expect(of(19.67, "delta_v").other).toBeNull();
  });

  it("calls for no move on the target, and for no distance far from it", () => {
    expect(of(19.7255, "e").main).toMatch(/no move/);
    expect(of(28.985, "e")).toEqual({ main: expect.stringMatching(/must grow/) as string, other: null });
  });

  it("is never given beside IN FOCUS", () => {
    const called = [19.78, 19.67, 19.7255].map((spacing) => {
      const now = reading({ ...measurement(spacing, 0.002), in_focus: true });
      return [advice(now, correction(design, now), "e", "mm").main, isCalledInFocus(now)] as const;
    });
    expect(called.map(([main, inFocus]) => [main.startsWith("Move"), inFocus])).toEqual([
      [true, false],
      [true, false],
      [false, true],
    ]);
  });

  it("gives no distance that an axis cannot go, and what can be done in its place once", () => {
    const seen = reading(measurement(19.78, 0.002));
    const { deltaVMm, eMm } = correction(design, seen)!;
    const by = { e: eMm, delta_v: deltaVMm };
    const { past } = strings.meter.hindered;
    const said = (moved: keyof typeof by, ...reached: (keyof typeof by)[]) => {
      const { main, other } = advice(seen, correction(design, seen), moved, "mm", (axis, byMm) => {
        expect(byMm).toBe(by[axis]);
        return reached.includes(axis) ? null : past[axis];
      });
      return `${main}; ${other}`;
    };
    expect(said("e")).toBe(`${past.e}. ${past.delta_v}; null`);
    expect(said("delta_v", "e")).toBe(`${past.delta_v}; null`);
    expect(said("e", "delta_v")).toMatch(
      /^The e axis cannot go as far as it would have to\. Move MLA and sensor 0\.\d+ mm away from the lens; null$/,
    );
    expect(said("e", "e")).toMatch(/^Move the camera .*; null$/);
    expect(said("delta_v", "delta_v")).toMatch(/^Move MLA and sensor /);
  });

  it("orders nothing while nothing can be moved, and says why", () => {
    const { hindered } = strings.meter;
    const of = (change: Partial<Bench>, spacing = 19.78) => {
      const seen = reading(measurement(spacing, 0.002));
      return advice(seen, correction(design, seen), "e", "mm", (moved, byMm) =>
        hindrance({ ...snapshotBench, ...change }, moved, byMm),
      );
    };
    expect(of({}).main).toMatch(/^Move the camera /);
    const full = { history_fault: "the disk is full" };
    // Far from the target, too, where no distance is told; on it no move is called for.
    for (const spacing of [19.78, 28.985])
      expect(of(full, spacing)).toEqual({ main: hindered.history, other: null });
    expect(of(full, 19.7255).main).toMatch(/no move/);
    // A job has refused to move anything by this picture.
    const against = { contradicted: "the spacing is 19.033 px, and should be 15.478 px" };
    expect(of(against)).toEqual({ main: hindered.contradicted, other: null });
    expect(of({ stop: { latched: true } })).toEqual({ main: hindered.stopped, other: null });
    const [focus, e] = snapshotBench.axes as [Bench["axes"][0], Bench["axes"][0]];
    const gone = of({ axes: [focus, { ...e, connected: false }] });
    expect(gone.main).toMatch(/^The e axis cannot be moved now\. Move MLA and sensor /);
    for (const barred of [{ fault: "locked" }, { homed: false }])
      expect(of({ axes: [{ ...focus, ...barred }, e] })).toMatchObject({ other: null });
    // What the air step has set is not to be undone for an e axis that has only to be homed.
    const lost = of({ axes: [focus, { ...e, homed: false }] });
    expect(lost).toEqual({ main: hindered.unhomed.e, other: null });
    // Nor to be homed while it is refused.
    const pressed = of({ axes: [focus, { ...e, homed: false, limit_switch: true }] });
    expect(pressed).toEqual({ main: hindered.onSwitch.e, other: null });
  });

  it("begins each of its sentences as one, in each language", () => {
    for (const { meter } of [en, de]) {
      const { hindered, away, towards, grow, shrink } = meter;
      const all = [
        ...[meter.thereMore("1"), meter.unsureMore, ...Object.values(meter.orderless), meter.doubtedMore("")],
        ...[meter.twoBoards("1", "2", "3"), meter.tooFar("w"), meter.job, meter.oldMore],
        ...[
          meter.grows,
          meter.shrinks,
          hindered.out,
          hindered.onSwitch,
          hindered.unhomed,
          hindered.past,
        ].flatMap((of) => Object.values(of)),
        ...[hindered.stopped, hindered.history],
        ...[away, towards, grow, shrink].map((of) => of("1 mm")),
      ];
      expect(all.filter((text) => !/^(\p{Lu}|Δv )/u.test(text))).toEqual([]);
    }
  });

  it("says which way alone while the micro-images are not known", () => {
    const unknown = { ...reading(measurement(19.78, 0.002)), pitchPx: null };
    expect(correction(design, unknown)).toBeNull();
    expect(tilt(design, unknown, 1160)).toBeNull();
    expect(advice(unknown, null, "e", "mm").main).toBe("Δv or e must grow");
  });
});
