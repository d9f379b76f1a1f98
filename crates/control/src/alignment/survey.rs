//! Jobs that measure for measuring's sake: the spacing over an axis's travel, and over time.

use std::time::Duration;

use tokio::time::Instant;

use super::Alignment;
use crate::events::ShellState;
use crate::job::outcome::Outcome;
use crate::job::request::Sweep;
use crate::job::{IterationKind, Stage};
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::swept_way::{Shows, SweptWay};
use crate::loops::through_focus;
use crate::loops::through_focus::Point;
use crate::measuring::eye::Seen;
use crate::measuring::not_measured::NotMeasured;
use crate::plan::AirBoards;
use crate::running::end::JobEnd;
use bench::device::{AxisName, Setup};
use plenoptics::units::Millimetres;

/// A spacing seen at a place or a time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// Position (mm) or time (h).
    at: f64,
    spacing_px: f64,
    sigma_px: f64,
    /// EOG of the central view, mean per pixel, where one was made.
    eog: Option<f64>,
}

impl Alignment<'_> {
    /// Measures the spacing at equal steps of one axis, and goes back where it was.
    pub(crate) async fn focus_sweep(&mut self, sweep: Sweep, distance_mm: Option<f64>) -> Result<(), JobEnd> {
        self.context.stage(Stage::Survey);
        self.context.begin(sweep.steps + 4);
        self.eye.check_camera()?;
        let start = self.motion.position_mm(sweep.axis)?;
        self.context.log(format!("the {} axis stands at {start:.3} mm, and comes back there at the end", sweep.axis));
        // Both ends before anything moves.
        for end in [sweep.from_mm, sweep.to_mm] {
            self.motion.check(sweep.axis, Millimetres(end))?;
        }
        if sweep.axis == AxisName::Focus && self.lacks_board() {
            // Board and white frame are to serve all of the way.
            let middle_mm = f64::midpoint(sweep.from_mm, sweep.to_mm);
            self.context.doing(format!("sweep: focus axis to {middle_mm:.3} mm, the middle"));
            self.go(AxisName::Focus, middle_mm).await?;
        }
        self.something_to_measure(distance_mm).await?;
        self.context.step_of_bench("measuring");
        let mut way = self.swept_way(sweep.axis);
        self.context.doing(format!("sweep: measuring where the {} axis stands", sweep.axis));
        self.look_on_the_way(way.as_mut(), sweep.axis).await?;
        let mut samples = Vec::new();
        let mut two_boards = Vec::new();
        for step in 0..sweep.steps {
            let share = f64::from(step) / f64::from(sweep.steps - 1);
            let to = sweep.from_mm + share * (sweep.to_mm - sweep.from_mm);
            self.context.doing(format!("sweep: {} axis at {to:.3} mm", sweep.axis));
            self.go(sweep.axis, to).await?;
            match self.context.unless_cancelled(self.eye.spacing(1, None)).await {
                Ok(seen) => {
                    samples.push(self.sample(&seen, Some(sweep.axis), to));
                    self.check_way(way.as_mut(), sweep.axis, &seen)?;
                }
                // Out of the range of focus is what a sweep may well run into.
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) => {
                    self.context.log(format!("nothing measured at {to:.3} mm: {why}"));
                }
                Err(JobEnd::NotMeasured(NotMeasured::TwoBoards { why, spacings_px })) => {
                    self.context.log(format!("nothing measured at {to:.3} mm: {why}"));
                    two_boards.push((why, spacings_px));
                }
                Err(end) => return Err(end),
            }
        }
        self.context.doing(format!("sweep: {} axis back to {start:.3} mm", sweep.axis));
        self.go(sweep.axis, start).await?;
        self.context.doing("sweep: measuring where it began");
        self.look_on_the_way(way.as_mut(), sweep.axis).await?;
        let target_px = self.eye.target_px();
        if let Some((why, _)) = two_boards.into_iter().find(|(_, seen_px)| !is_beyond(&samples, *seen_px, target_px)) {
            return Err(JobEnd::failed(why));
        }
        if samples.is_empty() {
            return Err(JobEnd::NotConverged { why: "no spacing could be measured anywhere on the way".to_owned() });
        }
        let crossing = crossing(&samples, target_px);
        let at = |sample: &Sample, value, sigma| Point { position_mm: sample.at, value, sigma };
        let spacings: Vec<Point> =
            samples.iter().map(|sample| at(sample, sample.spacing_px, sample.sigma_px)).collect();
        let eogs: Vec<Point> = samples.iter().filter_map(|sample| sample.eog.map(|eog| at(sample, eog, 1.0))).collect();
        let best = through_focus::by_spacing(&spacings, target_px, self.design.mla.pitch / self.eye.pixel_mm());
        // Of the best focus that is told: the curve's where there is one.
        let slope = best.as_ref().map(|best| best.slope).or(crossing.map(|crossing| crossing.slope));
        self.context.outcome(Outcome::FocusSweep {
            axis: sweep.axis,
            positions: sweep.steps,
            measured: samples.len() as u32,
            crossing_mm: crossing.map(|crossing| crossing.at),
            crossing_sigma_mm: crossing.map(|crossing| crossing.sigma),
            slope_px_per_mm: slope,
            best_focus: best.map(|best| best.place),
            eog_peak: through_focus::by_eog(&eogs),
        });
        Ok(())
    }

    /// What is to be seen of an axis's way as it is swept; `None` where a picture says nothing of it.
    fn swept_way(&self, axis: AxisName) -> Option<SweptWay> {
        let focus_mm = self.motion.position_mm(AxisName::Focus).ok();
        let calibrated = self.eye.air_step().zip(focus_mm).map(|(air, focus_mm)| {
            let trim_mm = (focus_mm - air.focus_mm) * air.focus_scale.unwrap_or(1.0);
            CalibratedCamera { lens_to_mla_mm: air.camera.lens_to_mla_mm + trim_mm, ..air.camera }
        });
        let to_scale = calibrated.is_some() || axis == AxisName::Focus;
        let camera = calibrated.or_else(|| {
            let e_mm = self.design.joint(self.motion.l_bound_mm()).e;
            let designed = CalibratedCamera::designed(self.config, e_mm);
            let lens_to_mla_mm = self.design.lens_to_mla(focus_mm?);
            Some(CalibratedCamera { lens_to_mla_mm, ..designed })
        })?;
        let shows = match (axis, self.motion.shell()) {
            (AxisName::Focus, _) => Shows::Focus(camera),
            (AxisName::E, ShellState::Off) => Shows::EInAir(camera),
            (AxisName::E, ShellState::On) => Shows::EThroughShell(camera),
            (AxisName::E, ShellState::Unknown) => return None,
        };
        Some(SweptWay::new(shows, to_scale, self.motion.axis(axis).backlash_mm))
    }

    /// Looks where a swept axis is, for its way alone. Out of the range of focus there is nothing to be seen of it.
    async fn look_on_the_way(&self, way: Option<&mut SweptWay>, axis: AxisName) -> Result<(), JobEnd> {
        match self.context.unless_cancelled(self.eye.spacing(1, None)).await {
            Ok(seen) => self.check_way(way, axis, &seen),
            Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. } | NotMeasured::TwoBoards { .. })) => Ok(()),
            Err(end) => Err(end),
        }
    }

    /// Ends a sweep whose axis is not where it says that it is.
    fn check_way(&self, way: Option<&mut SweptWay>, axis: AxisName, seen: &Seen) -> Result<(), JobEnd> {
        let reading_mm = self.motion.position_mm(axis)?;
        let spacing = &seen.spacing;
        let fault = way.and_then(|way| way.see(reading_mm, spacing.spacing_px, spacing.spacing_sigma_px));
        fault.map_or(Ok(()), |fault| Err(fault.into()))
    }

    /// Measures the spacing over time, with nothing moved.
    pub(crate) async fn spacing_watch(&mut self, duration_s: f64, interval_s: f64) -> Result<(), JobEnd> {
        self.context.stage(Stage::Survey);
        self.context.begin((duration_s / interval_s).ceil() as u32 + 1);
        self.context.log(format!("measuring every {interval_s:.1} s for {duration_s:.0} s"));
        self.eye.check_camera()?;
        self.something_to_measure(None).await?;
        self.context.step_of_bench("measuring");
        let (interval, duration) = (Duration::from_secs_f64(interval_s), Duration::from_secs_f64(duration_s));
        let mut samples = Vec::new();
        // By the frames' own times and no other clock: replayed, the same frames make the same watch.
        let mut schedule: Option<Schedule> = None;
        let mut unmeasured = 0;
        loop {
            self.context.doing("watching the spacing");
            let seen = match self.context.unless_cancelled(self.eye.spacing(1, None)).await {
                Ok(seen) => Ok(seen),
                // Somebody steps between, or the light goes out: hours of a watch are not lost by it.
                Err(JobEnd::NotMeasured(gap @ (NotMeasured::Unmeasurable { .. } | NotMeasured::OldPicture))) => {
                    Err(gap)
                }
                Err(end) => return Err(end),
            };
            let taken = match &seen {
                Ok(seen) => seen.taken,
                Err(_) => self.eye.looked_at().map_or_else(Instant::now, |frame| frame.exposed_to),
            };
            let schedule = schedule.get_or_insert(Schedule { begin: taken, due: taken });
            let elapsed = schedule.elapsed(taken);
            match seen {
                Ok(seen) => samples.push(self.sample(&seen, None, elapsed.as_secs_f64() / 3600.0)),
                Err(why) => {
                    unmeasured += 1;
                    self.context.log(format!("nothing measured after {:.0} s: {why}", elapsed.as_secs_f64()));
                }
            }
            schedule.due = (schedule.due + interval).max(taken);
            let due = schedule.due;
            if schedule.elapsed(due) >= duration {
                break;
            }
            let rest = async {
                tokio::time::sleep_until(due).await;
                Ok::<(), JobEnd>(())
            };
            self.context.unless_cancelled(rest).await?;
        }
        if samples.is_empty() {
            return Err(JobEnd::NotConverged { why: "no spacing could be measured over all of the watch".to_owned() });
        }
        self.context.outcome(watched(&samples, unmeasured));
        Ok(())
    }

    fn sample(&self, seen: &Seen, axis: Option<AxisName>, at: f64) -> Sample {
        let (spacing_px, sigma_px) = (seen.spacing.spacing_px, seen.spacing.spacing_sigma_px);
        let difference = spacing_px - self.eye.target_px();
        let decision = format!("{difference:+.4} px from the target");
        let mut iteration =
            self.iteration(Stage::Survey, IterationKind::Sample, axis.unwrap_or(AxisName::Focus), seen, decision);
        iteration.axis = axis;
        self.context.record(iteration);
        Sample { at, spacing_px, sigma_px, eog: seen.eog }
    }

    /// Whether a flat board is to be put up: there is no white frame yet, or another job has left something else.
    fn lacks_board(&self) -> bool {
        !self.eye.has_white() || self.eye.in_view().lacks_flat_board()
    }

    /// Puts up a flat board where there is none, at a distance in air (mm) or where it is in range; and has a white frame
    /// taken where there is none that fits. Otherwise what is there is measured.
    async fn something_to_measure(&mut self, distance_mm: Option<f64>) -> Result<(), JobEnd> {
        if !self.lacks_board() {
            return Ok(());
        }
        let has_white = self.eye.has_white();
        // For a white frame the shell is taken off, and put on again. Where it is not known whether it is on, it stays off.
        let shell = self.motion.shell();
        if !has_white {
            self.white_frame().await?;
        }
        self.flat_board(shell, distance_mm).await?;
        if has_white && self.white_is_off().await? {
            self.another_white_frame().await?;
            self.flat_board(shell, distance_mm).await?;
        }
        Ok(())
    }

    /// Puts up a flat board: in water where the shell is to be on.
    async fn flat_board(&mut self, shell: ShellState, distance_mm: Option<f64>) -> Result<(), JobEnd> {
        if shell != ShellState::On {
            let plan = self.plan(self.design.joint(self.motion.l_bound_mm()), self.config.assembly.initial_e_mm);
            let in_range = || {
                let reading_mm = self.motion.position_mm(AxisName::Focus).ok()?;
                plan.boards_at(reading_mm, plan.unknown_delta_v_mm(reading_mm), None).map(|boards| boards.middle_mm())
            };
            let distance_mm = distance_mm.or_else(in_range).unwrap_or(plan.solution.equivalent_distance);
            return self.place(AirBoards::Flat(distance_mm)).await;
        }
        let distance_mm = self.config.object.distance_mm;
        let instruction = format!(
            "Take the diffuser off if it is on. With the shell on and the tank full, put the flat board {distance_mm:.1} mm from the shell's outer vertex."
        );
        let setup = Setup::WaterBoard { distance_mm };
        self.motion.set_shell(ShellState::On);
        self.ask("board_in_water", instruction, Some(format!("{distance_mm:.1} mm")), setup).await
    }
}

/// When a watch began, and when its next measurement is due.
#[derive(Debug, Clone, Copy)]
struct Schedule {
    begin: Instant,
    due: Instant,
}

impl Schedule {
    fn elapsed(&self, at: Instant) -> Duration {
        at.saturating_duration_since(self.begin)
    }
}

/// Whether two boards are seen only further from focus than everything that was measured as one. What a frame shows there may
/// look like two; two that are there are seen nearer to focus, too.
fn is_beyond(samples: &[Sample], seen_px: [f64; 2], target_px: f64) -> bool {
    let off = |spacing_px: f64| (spacing_px - target_px).abs();
    let measured = samples.iter().map(|sample| off(sample.spacing_px)).fold(0.0, f64::max);
    !samples.is_empty() && seen_px.into_iter().all(|spacing_px| off(spacing_px) > measured)
}

/// Where a line of samples meets a target.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Crossing {
    at: f64,
    sigma: f64,
    slope: f64,
}

/// The first pair of neighbours astride the target, interpolated linearly. By how much the spacing bends between them, as
/// those beside them show, is part of the uncertainty.
fn crossing(samples: &[Sample], target_px: f64) -> Option<Crossing> {
    samples.windows(2).enumerate().find_map(|(k, pair)| {
        let (near, far) = (pair[0], pair[1]);
        let (below, above) = (near.spacing_px - target_px, far.spacing_px - target_px);
        if below * above > 0.0 || below == above {
            return None;
        }
        let slope = (far.spacing_px - near.spacing_px) / (far.at - near.at);
        let share = below / (below - above);
        let at = near.at + share * (far.at - near.at);
        let beside = [k.checked_sub(1), Some(k)].into_iter().flatten().filter_map(|from| samples.get(from..from + 3));
        let bend_px = beside.map(bend).fold(0.0, f64::max) * ((at - near.at) * (far.at - at)).abs();
        let sigma = (near.sigma_px * (1.0 - share)).hypot(far.sigma_px * share).hypot(bend_px) / slope.abs();
        Some(Crossing { at, sigma, slope })
    })
}

/// Half of how fast the slope of three samples changes, px per mm².
fn bend(three: &[Sample]) -> f64 {
    let slope = |a: &Sample, b: &Sample| (b.spacing_px - a.spacing_px) / (b.at - a.at);
    ((slope(&three[1], &three[2]) - slope(&three[0], &three[1])) / (three[2].at - three[0].at)).abs()
}

/// Mean, line over time, and scatter about it; and how often there was nothing to measure.
fn watched(samples: &[Sample], unmeasured: u32) -> Outcome {
    let count = samples.len() as f64;
    let mean = |value: fn(&Sample) -> f64| samples.iter().map(value).sum::<f64>() / count;
    let (mean_at, mean_px) = (mean(|sample| sample.at), mean(|sample| sample.spacing_px));
    let spread: f64 = samples.iter().map(|sample| (sample.at - mean_at).powi(2)).sum();
    let together: f64 = samples.iter().map(|sample| (sample.at - mean_at) * (sample.spacing_px - mean_px)).sum();
    let slope = if spread > 0.0 { together / spread } else { 0.0 };
    let square: f64 =
        samples.iter().map(|sample| (sample.spacing_px - mean_px - slope * (sample.at - mean_at)).powi(2)).sum();
    let least = samples.iter().map(|sample| sample.spacing_px).fold(f64::INFINITY, f64::min);
    let greatest = samples.iter().map(|sample| sample.spacing_px).fold(f64::NEG_INFINITY, f64::max);
    let scatter_px = (samples.len() > 2).then(|| (square / (count - 2.0)).sqrt());
    Outcome::SpacingWatch {
        measured: samples.len() as u32,
        unmeasured,
        mean_px,
        scatter_px: scatter_px.unwrap_or(0.0),
        drift_px_per_h: slope,
        drift_sigma_px_per_h: scatter_px.filter(|_| spread > 0.0).map(|scatter_px| scatter_px / spread.sqrt()),
        least_px: least,
        greatest_px: greatest,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(at: f64, spacing_px: f64) -> Sample {
        Sample { at, spacing_px, sigma_px: 0.002, eog: None }
    }

    #[test]
    fn the_crossing_lies_between_its_neighbours() {
        let samples = [sample(0.0, 22.0), sample(1.0, 20.0), sample(2.0, 19.0)];
        let found = crossing(&samples, 19.25).unwrap();
        assert!((found.at - 1.75).abs() < 1e-12 && (found.slope + 1.0).abs() < 1e-12, "{found:?}");
        // The slope changes by 1 px/mm from one stretch to the next: halfway less what a quarter has to go.
        let bend = 0.5 * 0.75 * 0.25;
        assert!((found.sigma - (0.002 * 0.25f64.hypot(0.75)).hypot(bend)).abs() < 1e-12, "{found:?}");
        let straight = crossing(&samples[1..], 19.25).unwrap();
        assert!((straight.sigma - 0.002 * 0.25f64.hypot(0.75)).abs() < 1e-12, "{straight:?}");
        assert_eq!(crossing(&samples, 18.0), None);
        assert_eq!(crossing(&samples[..1], 22.5), None);
    }

    #[test]
    fn two_boards_count_unless_they_are_seen_beyond_all_that_was_measured() {
        let samples = [sample(0.0, 22.0), sample(1.0, 20.0), sample(2.0, 18.0)];
        let beyond = |seen_px| is_beyond(&samples, seen_px, 19.5);
        assert!(beyond([23.1, 22.5]) && beyond([16.5, 15.9]));
        assert!(!beyond([23.1, 21.9]) && !beyond([20.2, 19.6]) && !beyond([18.3, 17.1]));
        assert!(!is_beyond(&[], [23.1, 22.5], 19.5));
    }

    #[test]
    fn a_watch_tells_drift_from_scatter() {
        let samples: Vec<Sample> = (0..10)
            .map(|i| sample(f64::from(i), 20.0 + 0.1 * f64::from(i) + if i % 2 == 0 { 0.01 } else { -0.01 }))
            .collect();
        let Outcome::SpacingWatch {
            measured,
            unmeasured,
            mean_px,
            scatter_px,
            drift_px_per_h,
            drift_sigma_px_per_h,
            least_px,
            greatest_px,
        } = watched(&samples, 2)
        else {
            panic!("another outcome");
        };
        // Ten times an hour apart spread by 82.5 h².
        let sigma = scatter_px / 82.5f64.sqrt();
        assert!((drift_sigma_px_per_h.unwrap() - sigma).abs() < 1e-12, "{drift_sigma_px_per_h:?}");
        let Outcome::SpacingWatch { drift_sigma_px_per_h: None, .. } = watched(&samples[..2], 0) else {
            panic!("two tell no scatter");
        };
        assert_eq!((measured, unmeasured), (10, 2));
        assert!((mean_px - 20.45).abs() < 1e-9 && (drift_px_per_h - 0.1).abs() < 0.002, "{drift_px_per_h}");
        assert!((0.009..0.013).contains(&scatter_px), "{scatter_px}");
        assert!((least_px - 20.01).abs() < 1e-9 && (greatest_px - 20.89).abs() < 1e-9, "{least_px} to {greatest_px}");
    }
}
