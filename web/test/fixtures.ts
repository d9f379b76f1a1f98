import type { Told } from "../src/daemon/clock";
import type {
  Bench,
  Combined,
  Design,
  Found,
  FrameReading,
  Job,
  Measurement,
  PictureFacts,
  ServerMessage,
} from "../src/daemon/wire";

export const boot = "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";

/** What the daemon says of its clocks where its wall clock is `setMs` ahead of the one that nobody sets. */
export const told = (now: string, setMs = 0): Told => ({
  now,
  monotonic_us: 1000 * (Date.parse(now) - setMs),
});

export const bench: Bench = {
  simulated: true,
  design_origin: "reference preset",
  axes: [
    {
      axis: "focus",
      driver: "grbl",
      identity: "",
      location: "simulated",
      connected: true,
      homed: true,
      position_mm: 1.5,
      moving: false,
      low_limit_mm: -2,
      high_limit_mm: 5,
      jog_speed_mm_per_s: 4,
      limit_switch: false,
      disagreements: [],
    },
    {
      axis: "e",
      driver: "grbl",
      identity: "",
      location: "simulated",
      connected: true,
      homed: true,
      position_mm: 30,
      moving: false,
      low_limit_mm: -0.1,
      high_limit_mm: 32,
      jog_speed_mm_per_s: 4,
      limit_switch: false,
      disagreements: [],
    },
  ],
  camera: {
    driver: "simulated",
    identity: "",
    online: true,
    frames_lost: 0,
    frames_damaged: 0,
    notes: [],
    replay: false,
  },
  shell: "on",
  in_view: "unknown",
  set_up_at: "1970-01-01T00:00:00Z",
  air_step_holds: false,
  stop: { latched: false },
  e_wall_mm: -0.1,
  e_untold: false,
};

export function job(id: string, generation: number, state: Job["state"] = "running"): Job {
  return {
    href: `/api/v1/jobs/${id}`,
    id,
    kind: "joint_alignment",
    request: { kind: "joint_alignment" },
    owner: "ada",
    state,
    stage: "air",
    simulated: true,
    generation,
    created_at: "2026-01-01T00:00:00Z",
    progress: { step: 1, of: 10, doing: "moving" },
    iterations: [],
    log: [],
  };
}

export function measurement(spacing_px: number, spacing_sigma_px: number): Measurement {
  return {
    frame_seq: 1,
    captured_at: "2026-01-01T00:00:00Z",
    settled: true,
    spacing: {
      spacing_px,
      spacing_sigma_px,
      tilt_x_px: 0,
      tilt_y_px: 0,
      curvature_px: 0,
      pairs: 9,
      frames: 1,
    },
    spacing_target_px: 19.725,
    spacing_tolerance_px: 0.016,
    in_focus: true,
    micro_image_pitch_px: 29.4,
  };
}

function read(found: Found, capturedAt: number): FrameReading {
  const axes = { focusMm: 1.5, eMm: 30, settled: true };
  return {
    ...axes,
    capturedAt,
    monotonicMs: capturedAt,
    ageMs: 50,
    framesLeftOut: 2,
    widthPx: 1160,
    targetPx: 19.725,
    tolerancePx: 0.016,
    found,
  };
}

/** What the meter says of a frame, 50 ms after it was taken at `capturedAt`, ms, and of frames combined: of itself alone
 *  where they are not given. */
export function frameReading(
  spacingPx: number,
  capturedAt: number,
  combined: Partial<Combined> = {},
): FrameReading {
  const alone = { spacingPx, sigmaPx: 0.002, frames: 1, spanMs: 0, ofNewPicture: false };
  const level = {
    sigmaPx: 0.002,
    tiltXPx: 0,
    tiltYPx: 0,
    inFocus: true,
    doubted: false,
    unresolved: "",
    combined: { ...alone, ...combined },
  };
  return read({ is: "measured", spacingPx, ...level }, capturedAt);
}

export const lostReading = (why: string, capturedAt: number) => read({ is: "lost", why }, capturedAt);
export const refusedReading = (why: string, capturedAt: number) => read({ is: "refused", why }, capturedAt);

export const picture: PictureFacts = {
  seq: 7,
  capturedAt: new Date(0),
  monotonicMs: 0,
  ageMs: 100,
  focusMm: 0,
  eMm: 30,
  settled: true,
  preview: true,
  simulated: true,
  replayed: false,
  framesSkipped: 0,
  alike: 1,
  widthPx: 1160,
  heightPx: 1160,
  part: null,
  show: "raw",
  nearMm: null,
  farMm: null,
};

export function snapshot(seq: number, jobs: Job[] = [], boot_id = boot): ServerMessage {
  return { type: "snapshot", seq, boot_id, version: "0.1.0", bench, jobs };
}

/** The reference preset's. */
export const design: Design = {
  origin: "reference preset",
  air: {
    object_distance_mm: 800,
    image_distance_mm: 20.512821,
    aperture_mm: 5.715651,
    fov_deg: 11.56,
    half_width_mm: 80.9,
  },
  direct: { e_mm: 30 },
  fov_optimal_e_mm: 0,
  clarity: solution(1.744839625, 30),
  joint: solution(2.205040031, 0),
  mla: { a_mm: 1.065, b_mm: 0.340255591, f_number: 3.40255591 },
  spacing_target_px: 19.7249618,
  depth_resolution_mm: [87.46, 29.15],
  depth_resolution_water_mm: [109.59, 36.53],
  e_max_mm: 821,
  blur_limit_px: 1,
  e_tolerance: { low_mm: -6.67, high_mm: 5.84 },
  water_refractive_index: 1.333,
  notices: [],
};

function solution(delta_v_mm: number, e_mm: number): Design["joint"] {
  return {
    delta_v_mm,
    e_mm,
    equivalent_distance_mm: 197.174586 - (30 - e_mm),
    image_distance_mm: 20.512821 + delta_v_mm,
    aperture_mm: 6.3,
    aperture_change_mm: 0.6,
    main_lens_f_number: 3.57,
    aperture_ring_f_number: 3.2,
    fov_inner_deg: 10.4,
  };
}
