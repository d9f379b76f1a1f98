import { describe, expect, it } from "vitest";
import * as units from "../src/words/units";
import { figures } from "../src/views/job/result";
import type { Report } from "../src/daemon/wire";

describe("lengths", () => {
  it("are the same in both units, with as many digits", () => {
    expect(units.length(1.2345, "mm")).toBe("1.234 mm");
    expect(units.length(1.2345, "µm")).toBe("1234 µm");
    expect(units.bare(-0.0005, "µm", 4)).toBe("−0.5");
    expect(units.signedLength(0.0012, "µm", 4)).toBe("+1.2 µm");
    // What is told to a tenth of a millimetre is no more exact in the other unit, and no other figure.
    expect(units.lengths([159.23, 198.522], "mm", 1)).toBe("159.2, 198.5 mm");
    expect(units.lengths([159.23, 198.522], "µm", 1)).toBe("159200, 198500 µm");
    expect(units.signedLength(-0.368, "µm", 2)).toBe("−370 µm");
    for (const unit of units.UNITS) expect(units.toMm(units.inUnit(0.42, unit), unit)).toBeCloseTo(0.42, 12);
  });

  it("carry their uncertainty along, and are nothing where they are not known", () => {
    expect(units.measuredLength(2.2074, 0.0003, "mm", 4)).toBe("2.2074 ± 0.0003 mm");
    expect(units.measuredLength(2.2074, 0.0003, "µm", 4)).toBe("2207.4 ± 0.3 µm");
    expect(units.measuredLength(2.2074, null, "µm", 4)).toBe("2207.4 µm");
    expect(units.measuredLength(null, 0.1, "mm", 4)).toBeNull();
    expect(units.bareMeasured(0.5, 0.01, "µm", 3)).toBe("500 ± 10");
  });

  it("are typed and spelt without digits that the unit makes up", () => {
    expect(units.typedMm(0.1 + 0.2, "µm")).toBe(0.0003);
    expect(units.plain(0.07, "µm")).toBe("70");
    expect(units.plain(0.1, "mm")).toBe("0.1");
  });

  it("are divided by, too", () => {
    expect(units.pixelsPer(8.6953, "mm", 4)).toBe("8.6953 px/mm");
    expect(units.pixelsPer(8.6953, "µm", 4)).toBe("0.0086953 px/µm");
  });
});

describe("what the daemon says", () => {
  it("has its lengths in the unit chosen, and nothing else changed", () => {
    const said = "move the e axis to −4.425 mm; 8.7 px/mm, step 3, 2 mm² and 5 mm/s";
    expect(units.reworded(said, "mm")).toBe(said);
    expect(units.reworded(said, "µm")).toBe(
      "move the e axis to −4425 µm; 8.7 px/mm, step 3, 2 mm² and 5 mm/s",
    );
    expect(units.reworded("levels at 159.2, 167.2, 175.2 mm from it", "µm")).toBe(
      "levels at 159200, 167200, 175200 µm from it",
    );
    expect(units.reworded("within -2 to 0.0005 mm", "µm")).toBe("within -2000 to 0.5 µm");
    expect(units.reworded("v1.2 mm", "µm")).toBe("v1.2 mm");
  });

  it("has a length and its uncertainty in one unit", () => {
    const said =
      "in focus (the blur is 0.003 ± 0.002 px); Δv = 2.2041 ± 0.0004 mm is within tolerance; e = -0.012 ± 0.016 mm";
    expect(units.reworded(said, "µm")).toBe(
      "in focus (the blur is 0.003 ± 0.002 px); Δv = 2204.1 ± 0.4 µm is within tolerance; e = -12 ± 16 µm",
    );
    expect(units.reworded("Δv = 2.2050 mm to ±0.005 mm", "µm")).toBe("Δv = 2205.0 µm to ±5 µm");
  });
});

describe("what a job reaches for", () => {
  it("is a length where it is Δv, and pixels where it is the spacing", () => {
    const deltaV = { name: "delta_v_mm", value: 2.2073, sigma: 0.0004, target: 2.205 };
    expect(units.reached(deltaV, "µm")).toEqual({ value: "2207.3 ± 0.4 µm", target: "2205.0 µm" });
    const spacing = { name: "spacing_px", value: 19.7113, sigma: 0.0025, target: null };
    const best = { name: "best_focus_mm", value: 2.0934, sigma: 0.0026 };
    expect(units.reached(best, "mm")).toEqual({ value: "2.0934 ± 0.0026 mm", target: null });
    expect(units.reached(spacing, "µm")).toEqual({ value: "19.7113 ± 0.0025 px", target: null });
  });
});

describe("the report", () => {
  const report: Report = {
    aperture_mm: 6.364,
    aperture_ring_f_number: 3.14,
    delta_v_air_target_mm: 2.205,
    delta_v_mm: 2.2074,
    delta_v_sigma_mm: 0.0003,
    delta_v_target_mm: 2.2046,
    depth_of_field: { low_mm: 607, high_mm: null },
    design_origin: "reference preset",
    e_mm: 0.024,
    e_sigma_mm: 0.016,
    e_target_mm: 0,
    e_tolerance: { low_mm: -6.78, high_mm: 5.71 },
    e_readback_mm: null,
    focus_readback_mm: 2.103,
    e_wall_mm: -0.1,
    l_bound_mm: 0,
    moves_air: 2,
    moves_shell: 2,
    notes: [],
    shell_step_done: "e translated",
    spacing_px: 19.7113,
    spacing_sigma_px: 0.0025,
    spacing_target_px: 19.725,
    spacing_targets: { paraxial_px: 19.725 },
    time_spent: {
      total_s: 75.26,
      operator_s: 12,
      motion_s: 40.16,
      settling_s: 4.4,
      frames_s: 9,
      measuring_s: 8.2,
      other_s: 1.5,
    },
  } as unknown as Report;

  it("says where the time went", () => {
    expect(figures(report, "mm").find(([name]) => name === "Time")?.[1]).toBe(
      "75.3 s: operator 12.0 s, motion 40.2 s, settling 4.4 s, waiting for frames 9.0 s, measuring 8.2 s, other 1.5 s",
    );
    const before = { ...report, time_spent: null };
    expect(figures(before, "mm").some(([name]) => name === "Time")).toBe(false);
  });

  it("tells nothing of what follows from an e that was not measured", () => {
    const told = (of: Report) => new Map(figures(of, "mm").map(([name, value]) => [name, value]));
    const missing = { depth_of_field: null, e_tolerance: null, fov_water_deg: null };
    const reached = told({ ...report, ...missing, e_mm: 18.8 });
    expect(reached.get("Depth of field")).toBe("nowhere within the blur limit");
    const failed = told({ ...report, ...missing, e_mm: null });
    for (const name of ["Depth of field", "e within the blur limit", "Field of view in water"])
      expect(failed.get(name), name).toBe("not measured");
  });

  it("has every length in the unit chosen, and none in the other", () => {
    const text = (unit: units.LengthUnit) =>
      figures(report, unit)
        .map(([name, value]) => `${name}: ${value}`)
        .join("\n");
    expect(text("mm")).toContain("Δv: 2.2074 ± 0.0003 mm, target 2.2046 mm");
    expect(text("mm")).not.toContain("µm");
    expect(text("µm")).toContain("Δv: 2207.4 ± 0.3 µm, target 2204.6 µm");
    expect(text("µm")).toContain("Depth of field: 607000 µm to ∞");
    expect(text("µm")).toContain("focus 2103 µm, e unknown");
    expect(text("µm")).not.toMatch(/\bmm\b/);
  });
});
