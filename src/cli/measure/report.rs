//! What `plenalign measure` prints.

use serde::Serialize;

use super::{Args, disagreements};
use crate::cli::grid::{GridReport, noise_words};
use crate::config::{Config, SpacingTarget};
use crate::imaging::known::Known;
use crate::imaging::measurement::{FrameMeasurement, WhiteModel};
use crate::imaging::microlenses::{FlaggedMicrolens, MicrolensFlag};
use crate::imaging::spacing::{LensSpacing, LensState, Spacing, SpacingMap, TwoBoards};
use crate::optics::MlaMode;
use crate::raw::RawImage;

/// The spacing on the wire.
#[derive(Debug, Serialize)]
struct SpacingReport {
    on_axis_px: f64,
    /// Noise and what the model cannot explain.
    on_axis_sigma_px: f64,
    /// Noise alone.
    on_axis_sigma_random_px: f64,
    /// The Cramér–Rao bound for the latter.
    on_axis_sigma_bound_px: Option<f64>,
    tilt_x_px: f64,
    tilt_y_px: f64,
    curvature_px: f64,
    astigmatism_px: f64,
    row_column_px: f64,
    diagonal_px: f64,
    /// Of l_0 and the six before, in their order, px².
    covariance_px2: [[f64; 7]; 7],
    mode: MlaMode,
    window_px: f64,
    noise_grey_levels: f64,
    correlation: f64,
    residual_ratio: f64,
    pairs: usize,
    micro_images: LensCounts,
    /// Two boards that are in the field, which has one spacing with one board only.
    two_boards: Option<TwoBoards>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lenses: Option<Vec<LensSpacing>>,
}

/// How many micro-images are in which state.
#[derive(Debug, Default, Serialize)]
struct LensCounts {
    matched: usize,
    mismatched: usize,
    blank: usize,
}

impl LensCounts {
    fn new(map: Option<&SpacingMap>) -> Self {
        let count = |state| map.map_or(0, |map| map.lenses.iter().filter(|lens| lens.state == state).count());
        Self {
            matched: count(LensState::Matched),
            mismatched: count(LensState::Mismatched),
            blank: count(LensState::Blank),
        }
    }
}

impl SpacingReport {
    fn new(spacing: &Spacing, map: Option<&SpacingMap>, mla_pitch_px: f64, lenses: bool) -> Self {
        Self {
            on_axis_px: spacing.on_axis_px,
            on_axis_sigma_px: spacing.sigma_px,
            on_axis_sigma_random_px: spacing.sigma_random_px,
            on_axis_sigma_bound_px: spacing.sigma_bound_px,
            tilt_x_px: spacing.tilt_x_px,
            tilt_y_px: spacing.tilt_y_px,
            curvature_px: spacing.curvature_px,
            astigmatism_px: spacing.astigmatism_px,
            row_column_px: spacing.row_column_px,
            diagonal_px: spacing.diagonal_px,
            covariance_px2: spacing.covariance,
            mode: if spacing.on_axis_px < mla_pitch_px { MlaMode::Galilean } else { MlaMode::Keplerian },
            window_px: spacing.window_px,
            noise_grey_levels: spacing.noise_grey_levels,
            correlation: spacing.correlation,
            residual_ratio: spacing.residual_ratio,
            pairs: spacing.pairs,
            micro_images: LensCounts::new(map),
            two_boards: spacing.two_boards,
            lenses: map.filter(|_| lenses).map(|map| map.lenses.clone()),
        }
    }
}

/// The spacing in focus.
#[derive(Debug, Serialize)]
struct Targets {
    /// Eq. 16, which holds for rays near the axis, px.
    paraxial_px: f64,
    /// Through the shell at the e given: the one pair of chief rays astride the axis, exactly traced, px.
    chief_ray_px: Option<f64>,
    /// Through the shell at the e given: exact rays averaged over the window of this measurement, px.
    window_px: Option<f64>,
}

impl Targets {
    fn new(config: &Config, e: Option<f64>, window_px: f64) -> Self {
        let (design, pixel) = (config.design(), config.pixel_pitch().millimetres());
        let view = e.map(|e| design.exact_in_water(design.clarity(e).delta_v, e));
        Self {
            paraxial_px: design.mla.target_spacing() / pixel,
            chief_ray_px: view.and_then(|view| view.chief_pair_spacing()).map(|spacing| spacing / pixel),
            window_px: view.and_then(|view| {
                view.excess(window_px * pixel).map(|excess| (view.paraxial_spacing() + excess) / pixel)
            }),
        }
    }
}

/// What the white frame says of the microlenses.
#[derive(Debug, Serialize)]
struct WhiteReport {
    micro_images: usize,
    residual_px: f64,
    scatter_px: f64,
    /// Those that are dead, missing or dirty.
    flagged: Vec<FlaggedMicrolens>,
}

impl WhiteReport {
    fn new((white, flagged): (&WhiteModel, &[FlaggedMicrolens])) -> Self {
        Self {
            micro_images: white.grid.micro_images(),
            residual_px: white.grid.residual_px,
            scatter_px: white.grid.scatter_px,
            flagged: flagged.to_vec(),
        }
    }

    /// Such as `2 dead, 1 dirty of 1369`.
    fn words(&self) -> String {
        let kinds =
            [(MicrolensFlag::Dead, "dead"), (MicrolensFlag::Missing, "missing"), (MicrolensFlag::Dirty, "dirty")];
        let counts: Vec<String> = kinds
            .iter()
            .map(|(flag, word)| (self.flagged.iter().filter(|lens| lens.flag == *flag).count(), word))
            .filter(|(count, _)| *count > 0)
            .map(|(count, word)| format!("{count} {word}"))
            .collect();
        let flagged = if counts.is_empty() { "none flagged".to_owned() } else { counts.join(", ") };
        format!("{flagged} of {} in the white frame", self.micro_images)
    }
}

/// What is known of a frame that is refused.
#[derive(Debug, Serialize)]
pub(super) struct Refused {
    grid: Option<GridReport>,
    noise_grey_levels: Option<f64>,
    /// Why there is no spacing.
    refused: String,
}

impl Refused {
    pub(super) fn new(known: &Known, refused: String) -> Self {
        Self { grid: known.grid.as_ref().map(GridReport::new), noise_grey_levels: known.noise_grey_levels, refused }
    }

    pub(super) fn print(&self) {
        let row = |name: &str, value: String| println!("{name:<16} {value}");
        for (name, value) in self.grid.iter().flat_map(GridReport::rows) {
            row(name, value);
        }
        if let Some(noise) = self.noise_grey_levels {
            row("noise", noise_words(noise));
        }
    }
}

/// What is printed, and the JSON object.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    grid: GridReport,
    white: Option<WhiteReport>,
    spacing: SpacingReport,
    /// The target of the configuration: paraxial, or (where it asks for that and e is given) over the window.
    target_px: f64,
    targets: Targets,
    in_focus: bool,
    /// Along the axis from O, or from the lens in air.
    object_distance_mm: Option<f64>,
    /// Why there is no object distance.
    object_distance_reason: Option<String>,
    frame_size_px: [usize; 2],
    frames: usize,
    warnings: Vec<String>,
}

impl Report {
    pub(super) fn new(
        config: &Config,
        args: &Args,
        raws: &[RawImage],
        white: Option<(&WhiteModel, &[FlaggedMicrolens])>,
        measured: &FrameMeasurement,
    ) -> Self {
        let pixel = config.pixel_pitch().millimetres();
        let mla_pitch_px = config.design().mla.pitch / pixel;
        let spacing_px = measured.spacing.on_axis_px;
        let targets = Targets::new(config, args.pose.e, measured.spacing.window_px);
        let target_px = match config.assembly.spacing_target {
            SpacingTarget::Exact => targets.window_px.unwrap_or(targets.paraxial_px),
            SpacingTarget::Paraxial => targets.paraxial_px,
        };
        let distance = object_distance(config, args, spacing_px * pixel, measured.spacing.window_px * pixel);
        let mut warnings = disagreements(config, &raws[0], &measured.grid, spacing_px);
        match measured.vignetting_fit {
            Some(fit) if !fit.fits() => warnings
                .push(format!("the white frame does not fit: {fit}; take one with this aperture, at this setting")),
            None => warnings.push("no white frame: the vignetting was estimated from the frame itself".to_owned()),
            Some(_) => {}
        }
        if let Some(two) = measured.spacing.two_boards {
            let [larger, smaller] = two.spacings_px;
            warnings.push(format!(
                "the frame shows two boards: {larger:.3} px over {:.0} % of it and {smaller:.3} px over {:.0} %; the \
                 spacing stated is neither's: let one of them fill the picture",
                100.0 * (1.0 - two.share),
                100.0 * two.share
            ));
        }
        Self {
            grid: GridReport::new(&measured.grid),
            white: white.map(WhiteReport::new),
            spacing: SpacingReport::new(&measured.spacing, measured.map.as_ref(), mla_pitch_px, args.lenses),
            target_px,
            targets,
            in_focus: measured.spacing.two_boards.is_none()
                && (spacing_px - target_px).abs() <= config.assembly.blur_limit_px,
            object_distance_mm: distance.as_ref().ok().copied(),
            object_distance_reason: distance.err(),
            frame_size_px: [raws[0].width(), raws[0].height()],
            frames: raws.len(),
            warnings,
        }
    }

    pub(super) fn target_px(&self) -> f64 {
        self.target_px
    }

    pub(super) fn print(&self) {
        let (grid, spacing) = (&self.grid, &self.spacing);
        let row = |name: &str, value: String| println!("{name:<16} {value}");
        let several = if self.frames > 1 { format!(", {} frames together", self.frames) } else { String::new() };
        row("frame", format!("{} x {} px{several}", self.frame_size_px[0], self.frame_size_px[1]));
        for (name, value) in grid.rows() {
            row(name, value);
        }
        if let Some(white) = &self.white {
            row("microlenses", white.words());
        }
        let mode = match spacing.mode {
            MlaMode::Galilean => "Galilean",
            MlaMode::Keplerian => "Keplerian",
        };
        row("spacing", format!("{:.4} ± {:.4} px on the axis ({mode})", spacing.on_axis_px, spacing.on_axis_sigma_px));
        row(
            "from noise alone",
            format!(
                "± {:.4} px, Cramér–Rao bound {} px, noise {:.2} grey levels",
                spacing.on_axis_sigma_random_px,
                spacing.on_axis_sigma_bound_px.map_or("not known".to_owned(), |bound| format!("{bound:.4}")),
                spacing.noise_grey_levels
            ),
        );
        let sigma = |term: usize| spacing.covariance_px2[term][term].sqrt();
        row(
            "tilt",
            format!(
                "{:+.4} ± {:.4}, {:+.4} ± {:.4} px per half frame width",
                spacing.tilt_x_px,
                sigma(1),
                spacing.tilt_y_px,
                sigma(2)
            ),
        );
        row(
            "curvature",
            format!(
                "{:+.4} ± {:.4} px per half frame width squared; radial − tangential {:+.4} ± {:.4} px",
                spacing.curvature_px,
                sigma(3),
                spacing.astigmatism_px,
                sigma(4)
            ),
        );
        row(
            "rows − columns",
            format!(
                "{:+.4} ± {:.4} px; diagonals {:+.4} ± {:.4} px",
                spacing.row_column_px,
                sigma(5),
                spacing.diagonal_px,
                sigma(6)
            ),
        );
        let counts = &spacing.micro_images;
        row(
            "pairs",
            format!(
                "{}, correlation {:.3}; micro-images: {} matched, {} not, {} without texture",
                spacing.pairs, spacing.correlation, counts.matched, counts.mismatched, counts.blank
            ),
        );
        let focus = match (spacing.two_boards, self.in_focus) {
            (Some(_), _) => "two boards, neither told from it",
            (None, true) => "in focus",
            (None, false) => "out of focus",
        };
        row("target", format!("{:.4} px: {focus}", self.target_px));
        if let (Some(chief), Some(window)) = (self.targets.chief_ray_px, self.targets.window_px) {
            row(
                "",
                format!(
                    "paraxial {:.4}, chief rays {chief:.4}, over the window {window:.4} px",
                    self.targets.paraxial_px
                ),
            );
        }
        match (&self.object_distance_mm, &self.object_distance_reason) {
            (Some(distance), _) => row("object distance", format!("{distance:.2} mm")),
            (None, reason) => {
                row("object distance", format!("unknown: {}", reason.as_deref().unwrap_or("not asked for")));
            }
        }
        for warning in &self.warnings {
            row("note", warning.clone());
        }
    }
}

/// Distance of the object along the axis, mm: from O through the shell, from the lens in air. The reason where there
/// is none.
fn object_distance(config: &Config, args: &Args, spacing_mm: f64, window_mm: f64) -> Result<f64, String> {
    let design = config.design();
    let Some(delta_v) = args.pose.delta_v else {
        return Err("Δv is not given: --delta-v, with --e or --air".to_owned());
    };
    // The inverse is paraxial: what the shell's aberrations add over the window is taken off first.
    let aberrations = args.pose.e.and_then(|e| design.exact_in_water(delta_v, e).excess(window_mm)).unwrap_or(0.0);
    let equivalent = design.equivalent_from_spacing(spacing_mm - aberrations, delta_v);
    let distance = match (args.pose.e, args.pose.air) {
        (_, true) => equivalent,
        (Some(e), false) => design.shell.object_distance(equivalent, e),
        (None, false) => return Err("neither e nor air is given: --e or --air".to_owned()),
    };
    if distance.is_finite() && distance > 0.0 {
        Ok(distance)
    } else {
        Err(format!("no real object has this spacing at Δv = {delta_v} mm: Δv, e or the configured camera are others"))
    }
}
