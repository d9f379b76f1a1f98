import { describe, expect, it } from "vitest";
import { fixed, sentence, signed, withSigma } from "../src/words/format";
import { receive, receivePicture, receiveReading, remember } from "../src/received";
import {
  currentJob,
  endsPress,
  initial,
  isMeterOld,
  meterAge,
  newsOfReset,
  pictureAge,
  pictureState,
  STALE_MS,
  type State,
} from "../src/state";
import { NO_ANSWER } from "../src/daemon/no-answer";
import type { Bench, Job, ServerMessage, Setup } from "../src/daemon/wire";
import { bestAnew, reading as readingIn } from "../src/meter/reading";
import { isBeingSetUp, knowsMotion, showsTilt } from "../src/meter/set-up";
import { along, axisScale } from "../src/bench/travel";
import {
  bench,
  boot,
  frameReading,
  job,
  lostReading,
  measurement,
  picture,
  refusedReading,
  snapshot,
  told,
} from "./fixtures";

const open = (): State => receive(initial, snapshot(5, [job("a", 1)]), 1000);

describe("meterAge", () => {
  it("counts from when a measurement came, or from when it was taken if a snapshot brings it", () => {
    expect(meterAge(open(), 9000)).toBeNull();
    const message = {
      type: "measurement",
      seq: 6,
      boot_id: boot,
      measurement: measurement(20, 0.01),
    } as const;
    const came = receive(open(), message, 5000);
    expect(meterAge(came, 9000)).toBe(4000);
    const taken = { ...message.measurement, captured_at: "1970-01-01T00:00:02Z" };
    const reloaded = receive(initial, { ...snapshot(1), measurement: taken } as ServerMessage, 9000);
    expect(meterAge(reloaded, 9000)).toBe(7000);
  });

  it("counts from when the frame was taken once the daemon has told the time, whatever this page's clock says", () => {
    const captured_at = "2026-01-01T00:00:10Z";
    const message = { type: "measurement", seq: 6, boot_id: boot } as const;
    const came = receive(
      open(),
      { ...message, measurement: { ...measurement(20, 0.01), captured_at } },
      5000,
    );
    const tick = { type: "tick", seq: 6, boot_id: boot, ...told("2026-01-01T00:00:14Z") } as const;
    const known = receive(came, tick, 6000);
    expect(meterAge(known, 6000)).toBe(4000);
    expect(meterAge(known, 7500)).toBe(5500);
  });
});

describe("receive", () => {
  it("takes a snapshot whole and opens the link", () => {
    const state = open();
    expect(state).toMatchObject({ link: "open", seq: 5, bootId: boot, bench, heardAt: 1000 });
    expect(state.jobs.map((it) => it.id)).toEqual(["a"]);
  });

  it("replaces a job by a newer one, adds a new one, and keeps out an older one", () => {
    let state = receive(open(), { type: "job", seq: 6, boot_id: boot, job: job("a", 3, "converged") }, 0);
    state = receive(state, { type: "job", seq: 7, boot_id: boot, job: job("a", 2) }, 0);
    state = receive(state, { type: "job", seq: 8, boot_id: boot, job: job("b", 1) }, 0);
    expect(state.jobs.map((it) => [it.id, it.state])).toEqual([
      ["a", "converged"],
      ["b", "running"],
    ]);
    expect(state.seq).toBe(8);
  });

  it("takes back that no picture could be made once there is one, and no other problem", () => {
    const after = (type: string) =>
      receivePicture(
        { ...open(), problem: { type, title: "", status: 409, detail: "" } },
        picture,
        2000,
        2000,
      ).problem;
    expect(after("urn:plenalign:problem:not-viewable")).toBeNull();
    expect(after("urn:plenalign:problem:lease-held")).not.toBeNull();
  });

  it("forgets the picture of another start of the daemon, and takes no change before its snapshot", () => {
    const seen = receivePicture(open(), picture, 2000, 2000);
    const stray = receive(
      seen,
      { type: "bench", seq: 1, boot_id: "other", bench: { ...bench, simulated: false } },
      0,
    );
    expect(stray.bench).toBe(seen.bench);
    const fresh = receive(seen, snapshot(1, [], "other"), 3000);
    expect(fresh).toMatchObject({ bootId: "other", seq: 1, picture: null, jobs: [] });
    expect(receive(seen, snapshot(9), 3000).picture).toBe(picture);
  });

  it("forgets that the daemon did not answer once it does, and nothing else that went wrong", () => {
    const problem = (type: string) => ({ type, title: "t", status: 0, detail: "d" });
    const after = (type: string) => receive({ ...open(), problem: problem(type) }, snapshot(6), 0).problem;
    expect([after(NO_ANSWER), after("about:blank")]).toEqual([null, problem("about:blank")]);
  });

  it("forgets that an axis moved once that one has stood long enough for it to be read, and not for another's sake", () => {
    const problem = {
      ...{ type: "urn:plenalign:problem:moving", title: "t", status: 409, detail: "d" },
      axis: "focus" as const,
    };
    const [focus, e] = bench.axes as [Bench["axes"][0], Bench["axes"][0]];
    const after = (focusMoves: boolean, eMoves: boolean) => {
      const axes = [
        { ...focus, moving: focusMoves },
        { ...e, moving: eMoves },
      ];
      const message = { type: "bench", seq: 6, boot_id: boot, bench: { ...bench, axes } } as ServerMessage;
      return receive({ ...open(), problem }, message, 0);
    };
    // Refused at its very end, too: no more comes of an axis that stands already but the seconds.
    const tick = { type: "tick", seq: 6, boot_id: boot } as ServerMessage;
    const at = (state: State, now: number) => receive(state, tick, now).problem;
    for (const still of [after(false, true), after(false, false)]) {
      expect([at(still, 4900), at(still, 5000)]).toEqual([problem, null]);
    }
    for (const moves of [after(true, true), after(true, false)]) expect(at(moves, 60_000)).toEqual(problem);
    // It moves again meanwhile.
    const again = receive({ ...after(true, true), overAt: 0 }, tick, 4000);
    expect(at(again, 6000)).toEqual(problem);
  });

  it("shows a problem that the daemon has with a message", () => {
    const problem = { type: "urn:plenalign:problem:invalid", title: "t", status: 422, detail: "d" };
    expect(receive(open(), { type: "problem", seq: 5, boot_id: boot, problem }, 0).problem).toEqual(problem);
  });
});

describe("the picture", () => {
  it("ages from what the daemon said and from when it came", () => {
    const state = receivePicture(open(), picture, 2000, 2000);
    expect(pictureAge(state, 2050)).toBe(150);
    expect(pictureState(state, 2000 + STALE_MS - 100)).toBe("fresh");
    expect(pictureState(state, 2001 + STALE_MS - 100)).toBe("stale");
  });

  it("is not stale at the age that such a picture always has, and is once the next one does not come", () => {
    const depth = (state: State, sentAt: number) =>
      receivePicture(state, { ...picture, show: "depth", ageMs: 3000 }, sentAt, sentAt);
    // One every 4 s, 3 s old when it is sent: 7 s old when the next takes its place.
    const state = depth(depth(open(), 2000), 6000);
    expect([pictureState(state, 6000), pictureState(state, 9999)]).toEqual(["fresh", "fresh"]);
    expect(pictureState(state, 6000 + 1.5 * 7000 - 3000 + 1)).toBe("stale");
    // Whatever there was before it, a raw frame is to be of now.
    const raw = receivePicture(state, picture, 7000, 7000);
    expect(pictureState(raw, 7000 + STALE_MS - 99)).toBe("stale");
    // After an hour in the background the next is not waited for as long.
    expect(pictureState(depth(state, 3_600_000), 3_600_000 + 27_001)).toBe("stale");
  });

  it("is stale at once when the link is lost, and none before the first", () => {
    expect(pictureState(open(), 1000)).toBe("none");
    const state: State = { ...receivePicture(open(), picture, 2000, 2000), link: "lost" };
    expect(pictureState(state, 2000)).toBe("stale");
  });
});

/** Through the shell. */
const reading = (of: Parameters<typeof readingIn>[0]) => readingIn(of, { inAir: false, otherwise: null });

describe("reading", () => {
  it("says which way to go: a larger Δv or e makes the spacing smaller", () => {
    expect(reading(measurement(19.8, 0.002)).direction).toBe("larger");
    expect(reading(measurement(19.7, 0.002)).direction).toBe("smaller");
    expect(reading(measurement(19.726, 0.002)).direction).toBe("there");
    expect(reading(measurement(19.726, 0.002)).differencePx).toBeCloseTo(0.001, 9);
    expect(open().reading).toBeNull();
  });

  it("is on the target where a job accepts it, however well it is known, and nowhere else", () => {
    const direction = (differencePx: number, sigmaPx: number) =>
      reading(measurement(19.725 + differencePx, sigmaPx)).direction;
    // What a job has called converged, 5 standard uncertainties off.
    expect([direction(0.0117, 0.0021), direction(-0.0159, 0.0005)]).toEqual(["there", "there"]);
    expect([direction(0.0161, 0.0005), direction(-0.0161, 0.002)]).toEqual(["larger", "smaller"]);
    // Too uncertain to be accepted, it is not called on target, nor is anybody sent anywhere.
    expect([direction(0.001, 0.017), direction(0.03, 0.016)]).toEqual(["unsure", "unsure"]);
    // In air a job wants to be sure.
    const inAir = (differencePx: number, sigmaPx: number) =>
      readingIn(measurement(19.725 + differencePx, sigmaPx), { inAir: true, otherwise: null }).direction;
    expect([inAir(0.0117, 0.0021), inAir(0.0117, 0.0022)]).toEqual(["there", "larger"]);
    expect(inAir(0.004, 0.007)).toBe("unsure");
    expect(direction(0.04, 0.017)).toBe("larger");
  });
});

describe("what the meter reads, frame by frame", () => {
  const measured = (state: State, captured_at: string, now: number): State =>
    receive(
      state,
      {
        type: "measurement",
        seq: 6,
        boot_id: boot,
        measurement: { ...measurement(19.8, 0.002), captured_at },
      },
      now,
    );
  const second = (count: number) => new Date(1000 * count).toISOString();

  it("is shown, held and charted in the place of what was measured before", () => {
    const before = measured(open(), second(1), 2000);
    const state = receiveReading(before, frameReading(19.73, 3000), 3050);
    expect(state.reading).toMatchObject({ of: "frame", spacingPx: 19.73, pitchPx: 29.4, settled: true });
    expect(state.best?.differencePx).toBeCloseTo(0.005, 9);
    expect(state.spacings.points.map(({ spacingPx }) => spacingPx)).toEqual([19.8, 19.73]);
    expect(state).toMatchObject({
      heardAt: 3050,
      framesLeftOut: 2,
      widthPx: 1160,
      measurement: before.measurement,
    });
  });

  it("is shown and held as the mean of the frames at rest, and charted by itself", () => {
    const combined = { spacingPx: 19.743, sigmaPx: 0.0008, frames: 40 };
    const state = receiveReading(open(), frameReading(19.73, 3000, combined), 3050);
    // The mean is outside of what a job accepts where the single frame's spacing is within.
    expect(state.reading).toMatchObject({ ...combined, direction: "larger" });
    expect(state.reading?.single).toEqual({ spacingPx: 19.73, sigmaPx: 0.002 });
    expect(state.best?.differencePx).toBeCloseTo(0.018, 9);
    expect(state.best?.sigmaPx).toBe(0.0008);
    expect(state.spacings.points).toEqual([{ spacingPx: 19.73, sigmaPx: 0.002, targetPx: 19.725 }]);
  });

  it("gives way to a whole measurement where frames are read no more, and to one of a newer frame only", () => {
    const read = receiveReading(open(), frameReading(19.73, 3000), 3050);
    const late = measured(read, second(2), 3100);
    expect(late.reading).toBe(read.reading);
    expect(late.spacings).toBe(read.spacings);
    expect(late.clarities.at).toEqual([3.1]);
    expect(measured(read, second(3.5), 3900).reading).toBe(read.reading);
    expect(measured(read, second(4), 5000).reading).toMatchObject({ of: "measurement", spacingPx: 19.8 });
    const lost = receiveReading(read, lostReading("gone", 3100), 3150);
    expect(measured(lost, second(4), 5000).missing).toBe(lost.missing);
    expect(measured(lost, second(8), 9000).missing).toBeNull();
  });

  it("is lost from the frame on that says so until one is measured, whatever cannot be measured meanwhile", () => {
    const read = receiveReading(open(), frameReading(19.73, 3000), 3050);
    const lost = receiveReading(read, lostReading("the board went", 3100), 3150);
    expect(lost.missing).toMatchObject({ is: "lost", why: "the board went" });
    const dark = receiveReading(lost, refusedReading("too dark", 3200), 3250);
    expect(dark.missing).toMatchObject({ is: "lost", why: "too dark", capturedAt: 3200 });
    // Which is over with the frame that was.
    const still = receiveReading(dark, lostReading("nothing matches", 3300), 3350);
    expect(still.missing).toMatchObject({ is: "lost", why: "nothing matches" });
    expect(still.best).toBe(read.best);
    const found = receiveReading(still, frameReading(19.7, 3400), 3450);
    expect(found).toMatchObject({ missing: null, reading: { spacingPx: 19.7 } });
  });

  it("leaves no best to begin with anew where it is lost or of two boards, of which none is charted", () => {
    const state = receiveReading(open(), frameReading(19.73, 3000), 3050);
    expect(bestAnew(state)).toMatchObject({ targetPx: state.reading?.targetPx });
    expect(bestAnew(receiveReading(state, lostReading("gone", 3100), 3150))).toBeNull();
    const twoBoards = { spacings_px: [19.7, 19.1], share: 0.3, difference_sigma_px: 0.01 };
    const measured = {
      ...measurement(19.7, 0.001),
      captured_at: new Date(3000).toISOString(),
      two_boards: twoBoards,
    };
    const two = receiveReading({ ...state, measurement: measured }, frameReading(19.73, 3100), 3150);
    expect(bestAnew(two)).toBeNull();
    expect(two.spacings).toBe(state.spacings);
    const levels = { ...state, bench: { ...bench, in_view: "stepped_board" as const } };
    expect(receiveReading(levels, frameReading(19.73, 3100), 3150).spacings).toBe(state.spacings);
  });

  it("is old after a second without it, and at once where a frame cannot be measured, or none comes", () => {
    const read = receiveReading(open(), frameReading(19.73, 3000), 3050);
    expect([meterAge(read, 3150), isMeterOld(read, 3999)]).toEqual([150, false]);
    expect(isMeterOld(read, 4001)).toBe(true);
    expect(isMeterOld({ ...read, link: "lost" }, 3100)).toBe(true);
    const refused = receiveReading(read, refusedReading("too dark", 3100), 3150);
    expect(refused.reading).toBe(read.reading);
    expect([meterAge(refused, 3200), isMeterOld(refused, 3200)]).toEqual([200, true]);
    const lost = receiveReading(read, lostReading("gone", 3100), 3150);
    expect([meterAge(lost, 3200), isMeterOld(lost, 8100), isMeterOld(lost, 8200)]).toEqual([
      100,
      false,
      true,
    ]);
    const unplugged = { ...lost, bench: { ...bench, camera: { ...bench.camera, online: false } } };
    expect(isMeterOld(unplugged, 3200)).toBe(true);
    const whole = measured(open(), second(3), 3050);
    expect([isMeterOld(whole, 8000), isMeterOld(whole, 8100)]).toEqual([false, true]);
  });
});

describe("currentJob", () => {
  it("is the one under way, or else the newest", () => {
    const state = receive(open(), { type: "job", seq: 6, boot_id: boot, job: job("b", 1) }, 0);
    expect(currentJob(state)?.id).toBe("b");
    expect(currentJob({ ...state, bench: { ...bench, job: "a" } })?.id).toBe("a");
    expect(currentJob(initial)).toBeNull();
  });
});

describe("axisScale", () => {
  it("holds the travel, the wall and a position beyond it", () => {
    const e = bench.axes[1]!;
    const scale = axisScale(bench, e);
    expect(scale.wall).toBe(-0.1);
    expect(along(scale, -0.1)).toBeGreaterThan(0);
    expect(along(scale, e.high_limit_mm)).toBeLessThan(1);
    expect(axisScale(bench, bench.axes[0]!).wall).toBeNull();
    expect(axisScale(bench, { ...e, position_mm: -3 }).low).toBeLessThan(-3);
  });
});

describe("numbers", () => {
  it("have a true minus sign and no minus zero", () => {
    expect(fixed(-1.25, 1)).toBe("−1.3");
    expect(fixed(-0.00001, 3)).toBe("0.000");
    expect(signed(0.5, 2)).toBe("+0.50");
    expect(signed(0, 2)).toBe("0.00");
    expect(withSigma(2.2041, 0.0004, 4)).toBe("2.2041 ± 0.0004");
    expect(withSigma(null, 1, 2)).toBeNull();
  });

  it("and a daemon's words begin as sentences do, unless with a name", () => {
    expect(["a browser has it", "the e axis", "e_mm: 3 is", "b is not", "Ada has it"].map(sentence)).toEqual([
      "A browser has it",
      "The e axis",
      "e_mm: 3 is",
      "b is not",
      "Ada has it",
    ]);
  });
});

describe("the bench anew", () => {
  const said = (change: Partial<typeof bench>): ServerMessage => ({
    type: "bench",
    seq: 9,
    boot_id: boot,
    bench: { ...bench, ...change },
  });
  const measured = (): State =>
    receive(
      open(),
      {
        type: "measurement",
        seq: 6,
        boot_id: boot,
        measurement: { ...measurement(19.73, 0.002), eog: 1300 },
      },
      5000,
    );

  it("forgets what was read of another set-up, the best of it too, and takes no more of that", () => {
    const at = (set_up_at: string) => said({ set_up_at });
    const before = measured();
    const kept = receive(before, said({}), 6000);
    expect([kept.reading, kept.best]).toEqual([before.reading, before.best]);
    expect(kept.best).not.toBeNull();
    // What was measured is of 2026-01-01T00:00:00Z.
    const next = receive(before, at("2026-01-01T00:00:01Z"), 6000);
    expect([next.reading, next.best]).toEqual([null, null]);
    const capturedAt = Date.parse("2026-01-01T00:00:00.900Z");
    expect(receiveReading(next, frameReading(19.725, capturedAt), 6100).reading).toBeNull();
    expect(receiveReading(next, lostReading("gone", capturedAt), 6100).missing).toBeNull();
    const late = { ...measurement(19.725, 0.002), captured_at: "2026-01-01T00:00:00.999Z" };
    const message = { type: "measurement", seq: 7, boot_id: boot, measurement: late } as const;
    expect(receive(next, message, 6200)).toMatchObject({ reading: null, best: null });
    const read = receiveReading(next, frameReading(19.73, capturedAt + 100), 6300);
    expect(read.best?.differencePx).toBeCloseTo(0.005, 9);
    // Nor is it shown to who opens the page later.
    const opened = { ...snapshot(1), bench: { ...bench, set_up_at: "2026-01-01T00:00:01Z" } };
    expect(receive(initial, { ...opened, measurement: late } as ServerMessage, 7000).reading).toBeNull();
    expect(receive(read, { ...opened, measurement: late } as ServerMessage, 7000).best).toEqual(read.best);
  });

  it("is being set up while the operator is asked for another scene, and only then", () => {
    const waiting = job("a", 1, "waiting_for_operator");
    expect(isBeingSetUp(bench, waiting)).toBe(true);
    // The aperture is set before the board that stands there.
    expect(isBeingSetUp({ ...bench, in_view: "flat_board" }, waiting)).toBe(false);
    expect([isBeingSetUp(bench, job("a", 1)), isBeingSetUp(bench, null)]).toEqual([false, false]);
    // Confirmed, until the bench has said what stands there.
    const goesOn = (setup: Setup): Job => ({
      ...job("a", 2),
      steps: [{ name: "step", state: "now", setup }],
    });
    expect(isBeingSetUp(bench, goesOn({ type: "diffuser" }))).toBe(true);
    expect(isBeingSetUp({ ...bench, in_view: "other" }, goesOn({ type: "diffuser" }))).toBe(false);
    expect(isBeingSetUp(bench, goesOn({ type: "aperture", diameter_mm: 6, ring_f_number: 4 }))).toBe(false);
    expect([knowsMotion(bench), knowsMotion(null)]).toEqual([true, false]);
    const unplugged = bench.axes.map((axis) => ({ ...axis, connected: axis.axis === "e" }));
    expect(knowsMotion({ ...bench, axes: unplugged })).toBe(false);
    const of = (in_view: NonNullable<Bench["in_view"]>) => showsTilt({ ...bench, in_view });
    expect([of("unknown"), of("flat_board"), of("stepped_board"), of("other")]).toEqual([
      false,
      true,
      false,
      false,
    ]);
  });

  it("forgets what became of a stop once it is reset, and not before it is known", () => {
    const sent: State = { ...open(), stopSent: { focus: "confirmed", e: "undeliverable", kept: true } };
    const before = receive(sent, said({}), 6000);
    expect(before.stopSent).toEqual({ focus: "confirmed", e: "undeliverable", kept: true });
    const latched = receive(before, said({ stop: { latched: true, since: "2026-01-01T00:00:00Z" } }), 6000);
    expect(latched.stopSent).not.toBeNull();
    expect(receive(latched, said({}), 7000).stopSent).toBeNull();
    // Nor is it known of another run of the daemon, stopped though that may be.
    const connected = (run: string) => ({ ...snapshot(9, [], run), bench: latched.bench }) as ServerMessage;
    expect(receive(latched, connected(boot), 7000).stopSent).not.toBeNull();
    expect(receive(latched, connected("another"), 7000).stopSent).toBeNull();
  });

  it("fills the charts with what the daemon knows, before the page was opened and while it was cut off", () => {
    const at = (ms: number) => new Date(ms).toISOString();
    // The daemon's clock is 1 s behind.
    const recent = {
      now: at(99_000),
      positions: [
        { at: at(1000), focus_mm: 1, e_mm: null },
        { at: at(50_000), focus_mm: 2, e_mm: 30 },
      ],
      spacings: [{ at: at(3000), spacing_px: 20, spacing_sigma_px: 0.01, spacing_target_px: 19.7 }],
      clarities: [{ at: at(3000), eog: 7 }],
    };
    const state = remember(open(), recent, 100_000);
    expect(state.axes.at).toEqual([1, 2, 51]);
    expect(state.axes.points.slice(1)).toEqual([
      { focusMm: 1, eMm: null },
      { focusMm: 2, eMm: 30 },
    ]);
    expect(state.spacings).toMatchObject({
      at: [4],
      points: [{ spacingPx: 20, sigmaPx: 0.01, targetPx: 19.7 }],
    });
    expect(state.clarities).toMatchObject({ at: [4], points: [7] });
    const now = measured();
    expect(remember(now, { ...recent, spacings: [], clarities: [] }, 100_000).spacings).toBe(now.spacings);
    expect(remember(now, recent, 100_000).spacings.at).toEqual([4, 5]);
  });

  it("charts a measurement by when its frame was taken, as the meter counts its age", () => {
    const at = (second: string) => `2026-01-01T00:00:${second}Z`;
    const tick = { type: "tick", seq: 5, boot_id: boot, ...told(at("20")) } as const;
    const known = receive(open(), tick, 100_000);
    const late = { ...measurement(19.73, 0.002), captured_at: at("09"), eog: 1300 };
    const state = receive(known, { type: "measurement", seq: 6, boot_id: boot, measurement: late }, 100_000);
    expect(meterAge(state, 100_000)).toBe(11_000);
    expect([state.spacings.at, state.clarities.at]).toEqual([[89], [89]]);
    const read = receiveReading(state, frameReading(19.72, Date.parse(at("19.5"))), 100_000);
    expect(meterAge(read, 100_000)).toBe(500);
    expect(read.spacings.at).toEqual([89, 99.5]);
  });

  it("keeps clarity beside the spacing, for the charts", () => {
    expect(measured().spacings.points).toEqual([{ spacingPx: 19.73, sigmaPx: 0.002, targetPx: 19.725 }]);
    expect(measured().clarities).toMatchObject({ at: measured().spacings.at, points: [1300] });
  });
});

describe("a stop and its reset", () => {
  const at = "2026-01-01T00:00:00Z";
  const reset = { at, by: "Ada", why: "clear", stopped_at: null, stopped_by: null };
  const withStop = (stop: Partial<Bench["stop"]>): State => {
    const state = open();
    return { ...state, bench: { ...bench, stop: { ...bench.stop, ...stop } } };
  };

  it("let go of what is held down, also where both came between two messages", () => {
    expect(endsPress(open(), open())).toBe(false);
    expect(endsPress(open(), { ...open(), link: "lost" })).toBe(true);
    expect(endsPress(open(), withStop({ latched: true }))).toBe(true);
    expect(endsPress(open(), withStop({ reset }))).toBe(true);
    expect(endsPress(withStop({ reset }), withStop({ reset }))).toBe(false);
    const again = { ...reset, at: "2026-01-01T00:00:01Z" };
    expect(endsPress(withStop({ reset }), withStop({ reset: again }))).toBe(true);
  });

  it("leave nothing to be said of a stop that was not delivered, once it is known whether the bench is stopped", () => {
    const stopFailed = { type: "about:blank", title: "t", status: 0, detail: "d" };
    const cut: State = { ...open(), link: "lost", stopFailed };
    const back = (latched: boolean) =>
      receive(
        cut,
        { ...snapshot(9), bench: { ...bench, stop: { ...bench.stop, latched } } } as ServerMessage,
        0,
      );
    expect(back(true)).toMatchObject({ stopFailed: null, notStopped: false });
    expect(back(false)).toMatchObject({ stopFailed: null, notStopped: true });
    expect(receive(open(), snapshot(9), 0).notStopped).toBe(false);
    // Tried once more, it got through after all.
    const stopped = { ...bench, stop: { ...bench.stop, latched: true } };
    const arrived = { type: "bench", seq: 10, boot_id: boot, bench: stopped } as ServerMessage;
    expect(receive(back(false), arrived, 0).notStopped).toBe(false);
    const going = { ...arrived, bench } as ServerMessage;
    expect(receive(back(false), going, 0).notStopped).toBe(true);

    // A daemon that has just begun does not know how an earlier run left it.
    const said = (stop: Partial<Bench["stop"]>) => ({ ...bench, stop: { ...bench.stop, ...stop } });
    const unread = receive(
      cut,
      { ...snapshot(9), bench: said({ latched: true, unread: "not yet" }) } as ServerMessage,
      0,
    );
    expect(unread).toMatchObject({ stopFailed, notStopped: false });
    const read: ServerMessage = { type: "bench", seq: 10, boot_id: boot, bench: said({ latched: false }) };
    expect(receive(unread, read, 0)).toMatchObject({ stopFailed: null, notStopped: true });
    // And one that has been there all the time need not have heard of it yet.
    expect(receive({ ...open(), stopFailed }, read, 0)).toMatchObject({ stopFailed, notStopped: false });
  });

  it("are news for ten minutes, until they are dismissed or the bench is stopped again", () => {
    const now = Date.parse(at);
    expect(newsOfReset(open(), now)).toBeNull();
    expect(newsOfReset(withStop({ reset }), now + 599_000)).toEqual(reset);
    expect(newsOfReset(withStop({ reset }), now + 601_000)).toBeNull();
    expect(newsOfReset({ ...withStop({ reset }), resetSeen: at }, now)).toBeNull();
    expect(newsOfReset(withStop({ reset, latched: true }), now)).toBeNull();
  });
});
