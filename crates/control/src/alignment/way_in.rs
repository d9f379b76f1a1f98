//! The way in from far: where a picture cannot be measured, the sharpness of the raw frame leads the focus axis to where
//! one can. That axis takes array and sensor along behind the lens, so it touches nothing, with the shell on either.

use super::Alignment;
use super::air_step::InAir;
use crate::loops::air::AirObservation;
use crate::loops::axis_model::follows;
use crate::loops::mistake::ShellLook;
use crate::measuring::eye::Seen;
use crate::measuring::not_measured::NotMeasured;
use crate::plan::{AirBoards, Plan};
use crate::running::end::JobEnd;
use bench::device::AxisName;
use plenoptics::imaging::clarity::Sharpness;

/// Places of the focus axis that are tried before the search is given up.
const MOST_PLACES: usize = 24;
/// Standard uncertainties by which two pictures' sharpness differs where something has moved.
const CHANGED_SIGMAS: f64 = 4.0;
/// Places after which the picture must have changed.
const CHANGED_AFTER: usize = 4;
/// Shorter ways of the focus axis than this lead nowhere new, mm.
const SAME_PLACE_MM: f64 = 1e-6;

/// What to do next.
#[derive(Debug, Clone, PartialEq)]
enum WayDecision {
    /// Try here, mm of the focus axis's reading.
    Move { to_mm: f64 },
    /// There is nowhere left to look; why nothing was found, in words.
    Lost { why: String },
}

/// A search outwards from where the focus axis stands, always on the side that looks sharper at its end. Pure: sharpness
/// in, decision out.
#[derive(Debug, Clone)]
struct WayIn {
    low_mm: f64,
    high_mm: f64,
    /// From one place to the next, mm.
    step_mm: f64,
    /// Longest move, mm.
    most_mm: f64,
    /// Where it has been (mm), by rising reading.
    seen: Vec<(f64, Sharpness)>,
}

impl WayIn {
    /// A search that has seen nothing, within these readings, mm.
    fn new([low_mm, high_mm]: [f64; 2], step_mm: f64, most_mm: f64) -> Self {
        Self { low_mm, high_mm, step_mm: step_mm.min(most_mm), most_mm, seen: Vec::new() }
    }

    /// Takes in how sharp the picture is that could not be measured, and decides.
    fn next(&mut self, reading_mm: f64, sharpness: Sharpness) -> WayDecision {
        let place = self.seen.partition_point(|&(reading, _)| reading < reading_mm);
        self.seen.insert(place, (reading_mm, sharpness));
        let (&(first, at_first), &(last, at_last)) = (&self.seen[0], &self.seen[self.seen.len() - 1]);
        if self.seen.len() > CHANGED_AFTER && !self.has_changed() {
            return WayDecision::Lost {
                why: format!(
                    "the picture stays as sharp as it is while the focus axis goes from {first:.2} to {last:.2} mm: is the axis coupled, and is there a board in the light?"
                ),
            };
        }
        // An end of the travel that is nearer than a step is looked at, too.
        let further = [
            ((first - self.step_mm).max(self.low_mm), first, at_first),
            ((last + self.step_mm).min(self.high_mm), last, at_last),
        ];
        let next = further
            .into_iter()
            .filter(|&(to_mm, from_mm, _)| {
                (to_mm - from_mm).abs() > SAME_PLACE_MM && (to_mm - reading_mm).abs() <= self.most_mm
            })
            .max_by(|(.., one), (.., other)| one.energy.total_cmp(&other.energy));
        match next {
            Some((to_mm, ..)) if self.seen.len() < MOST_PLACES => WayDecision::Move { to_mm },
            _ => WayDecision::Lost {
                why: format!(
                    "nowhere from {first:.2} to {last:.2} mm of the focus axis can it be measured; it is sharpest at {:.2} mm",
                    self.sharpest_mm()
                ),
            },
        }
    }

    /// Whether the picture has changed on the way, by more than noise does it.
    fn has_changed(&self) -> bool {
        let by = |one: &Sharpness, other: &Sharpness| (one.energy - other.energy).abs() / one.sigma.hypot(other.sigma);
        self.seen.iter().any(|(_, one)| self.seen.iter().any(|(_, other)| by(one, other) > CHANGED_SIGMAS))
    }

    fn sharpest_mm(&self) -> f64 {
        let sharpest = self.seen.iter().max_by(|(_, one), (_, other)| one.energy.total_cmp(&other.energy));
        sharpest.map_or(f64::NAN, |&(reading, _)| reading)
    }
}

impl Alignment<'_> {
    /// Leads the focus axis to where the boards in air can be measured; they could not be where it stands, for a reason.
    pub(crate) async fn way_in_air(&mut self, boards: AirBoards, plan: &Plan, why: String) -> Result<InAir, JobEnd> {
        self.context.log(format!("{why}: the focus axis is led by the picture's sharpness"));
        let mut way = self.way_in(plan);
        loop {
            if let Err(lost) = self.follow(&mut way, self.sharpness().await?).await? {
                return Err(NotMeasured::Unmeasurable { why: format!("{why}; {lost}") }.into());
            }
            let reading_mm = self.motion.position_mm(AxisName::Focus)?;
            if self.retook_far_white(reading_mm, plan).await? {
                self.place(boards).await?;
            }
            let here = match self.observe_air(boards, plan, 1).await {
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. })) => continue,
                seen => seen?.0,
            };
            // Far out of focus a spacing may be a chance: the picture has to follow.
            let back_mm = if reading_mm > plan.solution.delta_v { -plan.focus_probe_mm } else { plan.focus_probe_mm };
            self.context.doing("way in: does the picture follow?");
            self.go(AxisName::Focus, reading_mm + back_mm).await?;
            match self.observe_air(boards, plan, 1).await {
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. })) => {}
                Err(end) => return Err(end),
                Ok(there) if has_followed(&here, &there.0) => return Ok(there),
                Ok(_) => self.context.log("a picture can be measured, but does not follow the axis"),
            }
            self.go(AxisName::Focus, reading_mm).await?;
        }
    }

    /// What to look at where the first picture through the shell cannot be measured: with the focus axis led to where it
    /// can, the picture says what is not as it was asked for. The axis goes back to where it stood. Where the picture can be
    /// measured there by then, the step goes on, and what was found is returned in case it cannot again.
    pub(crate) async fn look_through_shell(
        &self,
        look: &ShellLook<'_>,
        plan: &Plan,
        why: String,
    ) -> Result<String, JobEnd> {
        self.context
            .log(format!("{why}: the focus axis is led by the picture's sharpness, to see what is before the lens"));
        let named = self.named_through_shell(look, plan, &why).await?;
        match self.context.unless_cancelled(self.eye.spacing(1, None)).await {
            Ok(_) => {
                self.context.log("back where it stood the picture can be measured now: the step goes on");
                Ok(named)
            }
            Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. })) => Err(self.contradicted(named)),
            Err(end) => Err(end),
        }
    }

    async fn named_through_shell(&self, look: &ShellLook<'_>, plan: &Plan, why: &str) -> Result<String, JobEnd> {
        let start_mm = self.motion.position_mm(AxisName::Focus)?;
        let sharpest = match self.sharpest_through_shell(plan).await {
            // The light went out on the way.
            Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) => Err(why),
            sharpest => sharpest?,
        };
        self.context.doing(format!("shell: focus axis back to {start_mm:.4} mm"));
        self.go(AxisName::Focus, start_mm).await?;
        let (at_mm, seen) = match sharpest {
            Ok(found) => found,
            Err(lost) => return Ok(format!("{} ({lost})", look.unmeasurable(why))),
        };
        let scale = self.findings.focus_scale.unwrap_or(1.0);
        let trim_mm = look.trim_mm + scale * (at_mm - start_mm);
        let there = ShellLook { trim_mm, trim_bound_mm: self.config.bench.focus.backlash_mm, ..*look };
        Ok(there.contradiction(&seen.spacing).unwrap_or_else(|| {
            format!(
                "{} With Δv {trim_mm:+.2} mm off it can, and shows e = {:.2} mm: set assembly.initial_e_mm to where the picture is in the range of focus.",
                look.unmeasurable(why),
                look.camera.e_mm(seen.spacing.spacing_px, trim_mm)
            )
        }))
    }

    /// Where (mm of the focus axis's reading) the picture through the shell is sharpest, and what is seen there: at the ends
    /// of the range of focus a spacing may be a chance. Or why there is nothing, in words.
    async fn sharpest_through_shell(&self, plan: &Plan) -> Result<Result<(f64, Seen), String>, JobEnd> {
        let mut way = self.way_in(plan);
        let mut sharpest: Option<(Sharpness, f64, Seen)> = None;
        loop {
            let sharpness = self.sharpness().await?;
            match self.context.unless_cancelled(self.eye.spacing(1, None)).await {
                Ok(seen) => match sharpest.take() {
                    Some((energy, at_mm, seen)) if energy.energy > sharpness.energy => return Ok(Ok((at_mm, seen))),
                    _ => sharpest = Some((sharpness, self.motion.position_mm(AxisName::Focus)?, seen)),
                },
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. })) => {}
                Err(end) => return Err(end),
            }
            if let Err(lost) = self.follow(&mut way, sharpness).await? {
                return Ok(sharpest.map(|(_, at_mm, seen)| (at_mm, seen)).ok_or(lost));
            }
        }
    }

    fn way_in(&self, plan: &Plan) -> WayIn {
        let (low_mm, high_mm) = self.motion.range_mm(AxisName::Focus);
        WayIn::new([low_mm, high_mm], plan.search_step_mm, plan.air_goal().most_mm)
    }

    async fn sharpness(&self) -> Result<Sharpness, JobEnd> {
        self.context.unless_cancelled(self.eye.sharpness()).await
    }

    /// One step of a search: the focus axis to the next place. The inner error is why there is none, in words.
    async fn follow(&self, way: &mut WayIn, sharpness: Sharpness) -> Result<Result<(), String>, JobEnd> {
        let reading_mm = self.motion.position_mm(AxisName::Focus)?;
        match way.next(reading_mm, sharpness) {
            WayDecision::Move { to_mm } => {
                self.context.log(format!(
                    "with the focus axis at {reading_mm:.3} mm the sharpness is {:.2} ± {:.2}: on to {to_mm:.3} mm",
                    sharpness.energy, sharpness.sigma
                ));
                self.context.doing(format!("way in: focus axis to {to_mm:.3} mm"));
                self.go(AxisName::Focus, to_mm).await?;
                Ok(Ok(()))
            }
            WayDecision::Lost { why } => Ok(Err(why)),
        }
    }
}

/// Whether the picture followed the axis from one place to another.
fn has_followed(from: &AirObservation, to: &AirObservation) -> bool {
    let moved_mm = to.reading_mm - from.reading_mm;
    follows(moved_mm, to.delta_v_mm - from.delta_v_mm, from.sigma_mm.hypot(to.sigma_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Searches with a picture that looks like `sharpness` at a reading, and can be measured within `found` of `focus`.
    fn search(
        travel: [f64; 2],
        most_mm: f64,
        sharpness: impl Fn(f64) -> f64,
        (focus, found): (f64, f64),
    ) -> (Vec<f64>, Option<String>) {
        let mut way = WayIn::new(travel, 0.5, most_mm);
        let (mut reading, mut been) = (0.0, vec![0.0]);
        loop {
            if (reading - focus).abs() <= found {
                return (been, None);
            }
            match way.next(reading, Sharpness { energy: sharpness(reading), sigma: 0.5 }) {
                WayDecision::Move { to_mm } => {
                    assert!((to_mm - reading).abs() <= most_mm + 1e-9, "{reading} to {to_mm}");
                    assert!((travel[0]..=travel[1]).contains(&to_mm), "{to_mm}");
                    reading = to_mm;
                    been.push(to_mm);
                }
                WayDecision::Lost { why } => return (been, Some(why)),
            }
        }
    }

    #[test]
    fn the_sharper_side_is_followed() {
        let peak = |at: f64| move |x: f64| 200.0 + 800.0 / (1.0 + (x - at).powi(2));
        for at in [-3.0, -1.0, 2.0, 4.0] {
            let (been, lost) = search([-6.0, 6.0], 40.0, peak(at), (at, 0.4));
            assert_eq!(lost, None, "{been:?}");
            // Once to the wrong side at most.
            let wrong = been.iter().filter(|&&x| x * at < 0.0).count();
            assert!(wrong <= 1, "{been:?}");
        }
    }

    #[test]
    fn a_dip_does_not_hide_what_lies_behind_it() {
        let dip = |x: f64| 200.0 - 40.0 * (-(x - 1.0).powi(2)).exp() + 500.0 * (-(x - 4.0).powi(2)).exp();
        let (been, lost) = search([-2.0, 6.0], 40.0, dip, (4.0, 0.4));
        assert_eq!(lost, None, "{been:?}");
    }

    #[test]
    fn nothing_found_is_said_with_where_it_was_looked_for() {
        let (been, lost) = search([-1.2, 1.3], 40.0, |x| 100.0 + 10.0 * x, (9.0, 0.1));
        let lost = lost.unwrap();
        assert!(lost.contains("from -1.20 to 1.30 mm") && lost.contains("sharpest at 1.30 mm"), "{lost}");
        assert_eq!(been.len(), 7, "{been:?}");
        // No move is longer than one may be.
        let (_, lost) = search([-8.0, 8.0], 0.6, |x| 100.0 + 10.0 * x.abs(), (9.0, 0.1));
        assert!(lost.is_some());
    }

    #[test]
    fn a_picture_that_never_changes_ends_the_search() {
        let (been, lost) = search([-6.0, 6.0], 40.0, |_| 100.0, (5.0, 0.1));
        assert!(lost.unwrap().contains("is the axis coupled"));
        assert_eq!(been.len(), CHANGED_AFTER + 1, "{been:?}");
    }
}
