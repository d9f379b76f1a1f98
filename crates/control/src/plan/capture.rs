//! Where a board can be measured at all: the spacings that the estimator finds without a starting value.

use plenoptics::imaging::spacing::capture_range;
use plenoptics::optics::CameraDesign;

/// Share of the MLA pitch by which a planned spacing keeps away from the ends of the capture range.
const MARGIN: f64 = 0.02;
/// No board is put nearer to the lens than so many focal lengths.
const NEAREST_FOCAL_LENGTHS: f64 = 1.15;

/// How finely places are looked for.
const SPACINGS: u32 = 12;

/// The capture range of a design, and the distances at which boards may stand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Capture {
    design: CameraDesign,
    /// Least and greatest spacing planned for, in MLA pitches.
    range: [f64; 2],
    farthest_mm: f64,
}

impl Capture {
    /// That of a design whose boards stand no further than `farthest_mm`.
    pub(super) fn new(design: CameraDesign, farthest_mm: f64) -> Self {
        let [low, high] = capture_range(design.mla.mode);
        Self { design, range: [low + MARGIN, high - MARGIN], farthest_mm }
    }

    /// Least and greatest spacing planned for, in MLA pitches.
    pub(super) const fn range(&self) -> [f64; 2] {
        self.range
    }

    /// The same with boards as far away as they may be wanted.
    pub(super) const fn anywhere(&self) -> Self {
        Self { farthest_mm: f64::INFINITY, ..*self }
    }

    /// Whether a spacing, in MLA pitches, is within.
    pub(super) fn holds(&self, spacing: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&spacing)
    }

    /// The spacing (in MLA pitches) of a board at a distance (mm) with the camera at Δv (mm).
    pub(super) fn spacing(&self, distance_mm: f64, delta_v_mm: f64) -> f64 {
        self.design.spacing_at(distance_mm, delta_v_mm) / self.design.mla.pitch
    }

    /// By how much the spacings of neighbouring levels differ (in MLA pitches) that stand a step apart (mm) about a
    /// distance (mm), the mean of both, with the camera at Δv (mm).
    pub(super) fn levels_apart(&self, middle_mm: f64, step_mm: f64, delta_v_mm: f64) -> f64 {
        let spacing = |distance_mm: f64| self.spacing(distance_mm, delta_v_mm);
        0.5 * (spacing(middle_mm - step_mm) - spacing(middle_mm + step_mm)).abs()
    }

    /// Whether a board at a distance (mm) can be measured wherever Δv is, as far as it is known: give or take
    /// `within_mm`.
    pub(super) fn sees(&self, distance_mm: f64, delta_v_mm: f64, within_mm: f64) -> bool {
        let ends = [delta_v_mm - within_mm, delta_v_mm + within_mm].map(|at| self.a(distance_mm, at));
        // Between two images on one side of the array there is none on the other.
        ends[0] * ends[1] > 0.0
            && ends.iter().all(|a| self.holds(1.0 - self.design.mla.b() / a))
            && self.stands(distance_mm)
    }

    fn a(&self, distance_mm: f64, delta_v_mm: f64) -> f64 {
        self.design.main_lens.image_distance(distance_mm) - self.design.lens_to_mla(delta_v_mm)
    }

    /// Whether a board can stand at a distance (mm).
    pub(super) fn stands(&self, distance_mm: f64) -> bool {
        distance_mm >= self.nearest_mm() && distance_mm <= self.farthest_mm
    }

    /// The nearest distance at which a board is put, mm.
    pub(super) fn nearest_mm(&self) -> f64 {
        NEAREST_FOCAL_LENGTHS * self.design.main_lens.focal_length
    }

    /// Where a board has a spacing (in MLA pitches) with the camera at Δv (mm): mm, `None` beyond infinity.
    pub(super) fn distance_mm(&self, spacing: f64, delta_v_mm: f64) -> Option<f64> {
        let image = self.design.lens_to_mla(delta_v_mm) + self.design.mla.b() / (1.0 - spacing);
        let focal_length = self.design.main_lens.focal_length;
        (image > focal_length).then(|| self.design.main_lens.object_distance(image))
    }

    /// Where a board can be measured with Δv known to `within_mm`, mm: at `wanted_mm` where that will do, or as near to
    /// focus as it goes. `None` where there is no such place.
    pub(super) fn place_mm(&self, wanted_mm: f64, delta_v_mm: f64, within_mm: f64) -> Option<f64> {
        let in_focus = self.design.mla.target_spacing() / self.design.mla.pitch;
        let [low, high] = self.range;
        // From focus outwards, to both ends of the range.
        let spacings = (0..=SPACINGS).flat_map(|k| {
            let share = f64::from(k) / f64::from(SPACINGS);
            [in_focus + share * (high - in_focus), in_focus + share * (low - in_focus)]
        });
        let places = spacings.filter_map(|spacing| self.distance_mm(spacing, delta_v_mm));
        std::iter::once(wanted_mm).chain(places).find(|&place| self.sees(place, delta_v_mm, within_mm))
    }
}
