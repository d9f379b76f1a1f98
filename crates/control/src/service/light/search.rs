//! How exposure and gain are found for a white frame: decisions alone, frame by frame.

use bench::device::light::{ControlName, ControlUnit, LightControl};
use plenoptics::raw::{CLIPPED_SHARE, Histogram};

/// The level that is looked at: of a white frame's pixels all but this share are at most so bright, so that neither a lamp
/// mirrored in the lens nor a hot pixel decides.
const BRIGHT_SHARE: f64 = 0.995;
/// Where that is to be, as a part of white, and between which two it may be: there is room for what is brighter, and the
/// vignetting's dark edges are well above black.
const AIM: f64 = 0.8;
const WITHIN: [f64; 2] = [0.7, 0.9];
/// Where steps are too coarse for that, the darker of two is taken down to this: below it, half of the depth is unused.
const FLOOR: f64 = 0.5;
/// Nothing is concluded from less light than that, as a part of white, and more than so many times brighter is not tried
/// at once: near black there is an offset in the levels.
const LEAST_LEVEL: f64 = 0.02;
const MOST_TIMES: f64 = 8.0;
/// Frames that are looked at before it is given up.
pub(super) const MOST_FRAMES: u32 = 20;

/// What a frame says of its exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lit {
    /// The bright pixels' level, as a part of white.
    level: f64,
    /// Share of the pixels that are clipped.
    clipped: f64,
}

impl Lit {
    pub(super) fn of(histogram: &Histogram) -> Self {
        Self { level: histogram.level_of(BRIGHT_SHARE), clipped: histogram.clipped_share() }
    }

    /// The bright pixels' level, as a part of white.
    pub(super) const fn level(self) -> f64 {
        self.level
    }

    fn is_too_bright(self) -> bool {
        self.clipped > CLIPPED_SHARE || self.level > WITHIN[1]
    }

    fn is_right(self) -> bool {
        !self.is_too_bright() && self.level >= WITHIN[0]
    }

    /// By how much the light is to be multiplied, as far as the levels are proportional to it.
    fn times(self) -> f64 {
        if self.clipped > CLIPPED_SHARE {
            // How much too bright cannot be seen any more; the more of it, the more.
            return if self.clipped > 0.2 { 0.25 } else { 0.5 };
        }
        (AIM / self.level.max(LEAST_LEVEL)).min(MOST_TIMES)
    }
}

/// What is to be done next.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Next {
    /// A control is to be set, and another frame to be taken.
    Set(ControlName, f64),
    /// The frame is exposed as it should be.
    Right,
    /// It cannot be, in words.
    Impossible(String),
}

/// A search under way.
#[derive(Debug)]
pub(super) struct Search {
    /// The controls that can be set, in the order in which they make a picture brighter, with their values.
    controls: Vec<(LightControl, f64)>,
    /// Which is being searched.
    at: usize,
    /// Its greatest value known to be too dark, and its least known to be too bright.
    bracket: [Option<f64>; 2],
    /// Whose steps are too coarse.
    coarse: Option<ControlName>,
    begun: bool,
}

impl Search {
    /// A search over a camera's controls. A frame is not exposed for longer than `interval_ms`, which would make the
    /// camera slower.
    pub(super) fn new(controls: &[LightControl], interval_ms: f64) -> Self {
        let settable = controls.iter().filter(|control| control.locked.is_none());
        let with_value = settable.filter_map(|control| {
            let value = control.value?;
            let mut control = control.clone();
            if control.unit == ControlUnit::Ms {
                control.maximum = control.maximum.min(interval_ms.max(value).max(control.minimum));
            }
            Some((control, value))
        });
        Self { controls: with_value.collect(), at: 0, bracket: [None; 2], coarse: None, begun: false }
    }

    /// What is to be done after a frame.
    pub(super) fn next(&mut self, lit: Lit) -> Next {
        if lit.is_right() {
            return Next::Right;
        }
        if !std::mem::replace(&mut self.begun, true)
            && let Some(least_gain) = self.least_gain()
        {
            return least_gain;
        }
        while let Some((control, value)) = self.controls.get_mut(self.at) {
            let proposed = propose(control, *value, &mut self.bracket, lit);
            match proposed {
                Some(proposed) if proposed == *value => return Next::Right,
                Some(proposed) => {
                    *value = proposed;
                    return Next::Set(control.name, proposed);
                }
                None => {
                    let coarse = matches!(self.bracket, [Some(_), Some(_)]).then_some(control.name);
                    self.coarse = self.coarse.or(coarse);
                    (self.at, self.bracket) = (self.at + 1, [None; 2]);
                }
            }
        }
        Next::Impossible(self.why_not(lit))
    }

    /// Where a picture is not right as it is, the gain begins at its least: what is not amplified has the least noise.
    fn least_gain(&mut self) -> Option<Next> {
        let [first, .., (gain, value)] = &mut self.controls[..] else { return None };
        if first.0.name != ControlName::Exposure || *value <= gain.minimum {
            return None;
        }
        *value = gain.minimum;
        Some(Next::Set(gain.name, gain.minimum))
    }

    fn why_not(&self, lit: Lit) -> String {
        if let Some(name) = self.coarse.filter(|_| !lit.is_too_bright()) {
            let (level, floor) = (100.0 * lit.level, 100.0 * FLOOR);
            return format!(
                "between two steps of the {name} the picture is either too bright or too dark, at {level:.0} % of white \
                 and not {floor:.0} %: change the light"
            );
        }
        let [is, wanted, end] = match lit.is_too_bright() {
            true => ["too bright", "less light", "least"],
            false => ["too dark", "more light, or a diffuser before the lens that is lit", "greatest"],
        };
        let at =
            self.controls.iter().map(|(control, value)| format!("{} {value}{}", control.name, control.unit.suffix()));
        let at: Vec<String> = at.collect();
        format!("the picture is {is} at the {end} that is tried ({}): it needs {wanted}", at.join(", "))
    }
}

/// The value to try next; the present one where no step of the control is nearer to what is wanted; `None` where the
/// control is at its end, or its steps are too coarse.
fn propose(control: &LightControl, value: f64, bracket: &mut [Option<f64>; 2], lit: Lit) -> Option<f64> {
    let too_bright = lit.is_too_bright();
    bracket[usize::from(too_bright)] = Some(value);
    // Where the light changes, what was known of this value and of those beyond it holds no more.
    let other = &mut bracket[usize::from(!too_bright)];
    *other = other.filter(|other| if too_bright { *other < value } else { *other > value });
    let half_step = 0.5 * control.step;
    let at_end = if too_bright { value - half_step < control.minimum } else { value + half_step > last_of(control) };
    if at_end {
        return None;
    }
    let [low, high] = [bracket[0].unwrap_or(control.minimum), bracket[1].unwrap_or(control.maximum)];
    if let [Some(dark), Some(bright)] = *bracket
        && bright - dark < 1.5 * control.step
    {
        // Between two steps: the darker one is not clipped.
        return (value != dark || lit.level >= FLOOR).then_some(dark);
    }
    // What a number stands for is known of a time, a factor and decibels; of the driver's own that it grows.
    let guessed = match control.unit {
        ControlUnit::Ms | ControlUnit::Factor => value * lit.times(),
        ControlUnit::Db => value + 20.0 * lit.times().log10(),
        ControlUnit::Driver => 0.5 * (low + high),
    };
    let inside = |wanted: f64| {
        let within = match bracket {
            [Some(_), Some(_)] => wanted > low + half_step && wanted < high - half_step,
            _ => true,
        };
        if within { wanted } else { 0.5 * (low + high) }
    };
    let stepped = control.nearest(inside(guessed).clamp(control.minimum, control.maximum))?;
    let step = if too_bright { -control.step } else { control.step };
    // By one step at least, whatever the levels say.
    let moved = if (stepped - value) * step > 0.0 { stepped } else { value + step };
    control.nearest(moved.clamp(control.minimum, control.maximum))
}

/// The greatest value on a step.
fn last_of(control: &LightControl) -> f64 {
    control.nearest(control.maximum).unwrap_or(control.maximum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control(name: ControlName, unit: ControlUnit, value: f64, [minimum, maximum, step]: [f64; 3]) -> LightControl {
        let key = name.name().to_owned();
        let (default, automatic, locked) = (minimum, false, None);
        LightControl { name, key, unit, value: Some(value), minimum, maximum, step, default, automatic, locked }
    }

    fn exposure(value: f64) -> LightControl {
        control(ControlName::Exposure, ControlUnit::Ms, value, [0.1, 100.0, 0.1])
    }

    fn gain(value: f64) -> LightControl {
        control(ControlName::Gain, ControlUnit::Factor, value, [1.0, 16.0, 0.1])
    }

    /// A camera under a lamp: a level that grows with exposure and `amplified` gain, with an offset, and clips.
    fn searched(
        controls: &[LightControl],
        lamp: f64,
        amplified: impl Fn(f64) -> f64,
    ) -> (Next, Vec<(ControlName, f64)>, u32) {
        let mut search = Search::new(controls, 33.3);
        let value = |controls: &[LightControl], name| {
            controls.iter().find(|control| control.name == name).and_then(|control| control.value)
        };
        let mut exposure_ms = value(controls, ControlName::Exposure).unwrap_or(10.0);
        let mut gain = value(controls, ControlName::Gain).unwrap_or(1.0);
        let mut set = Vec::new();
        for frame in 1..=MOST_FRAMES {
            let level = 0.015 + lamp * exposure_ms * amplified(gain);
            let clipped = if level > 1.3 {
                0.5
            } else if level > 0.98 {
                0.05
            } else {
                0.0
            };
            match search.next(Lit { level: level.min(1.0), clipped }) {
                Next::Set(ControlName::Exposure, to) => (exposure_ms, _) = (to, set.push((ControlName::Exposure, to))),
                Next::Set(ControlName::Gain, to) => (gain, _) = (to, set.push((ControlName::Gain, to))),
                done => {
                    if done == Next::Right {
                        // Or a step of 0.1 ms more is too much.
                        let next = level + 0.1 * lamp * amplified(gain);
                        let right = level <= WITHIN[1] && (level >= WITHIN[0] || next > WITHIN[1]);
                        assert!(right, "{level} after {set:?}");
                    }
                    return (done, set, frame);
                }
            }
        }
        panic!("it does not end: {set:?}");
    }

    #[test]
    fn a_picture_that_is_right_is_left_as_it_is() {
        let (done, set, _) = searched(&[exposure(10.0), gain(4.0)], 0.02, |gain| gain);
        assert_eq!((done, set), (Next::Right, vec![]));
    }

    #[test]
    fn exposure_is_found_over_the_whole_range_within_few_frames() {
        // Twelve stops of light.
        for stop in 0..=12 {
            let lamp = 0.025 * 2f64.powi(stop);
            for begin in [0.1, 10.0, 33.0] {
                let (done, set, frames) = searched(&[exposure(begin), gain(1.0)], lamp, |gain| gain);
                if stop <= 6 {
                    assert_eq!(done, Next::Right, "{lamp} from {begin}: {set:?}");
                }
                assert!(frames <= 14, "{frames} for {lamp} from {begin}: {set:?}");
                assert!(set.iter().all(|(name, _)| *name == ControlName::Exposure), "{set:?}");
            }
        }
    }

    #[test]
    fn gain_goes_down_first_and_up_only_where_exposure_is_at_its_end() {
        let (done, set, _) = searched(&[exposure(10.0), gain(16.0)], 0.05, |gain| gain);
        assert_eq!((done, set[0]), (Next::Right, (ControlName::Gain, 1.0)));
        // At 33.3 ms, the frame's interval, it is five times too dark.
        let (done, set, _) = searched(&[exposure(10.0), gain(1.0)], 0.005, |gain| gain);
        let longest =
            set.iter().filter(|(name, _)| *name == ControlName::Exposure).map(|(_, to)| *to).fold(0.0, f64::max);
        let (name, last) = set[set.len() - 1];
        assert!(done == Next::Right && longest == 33.3 && name == ControlName::Gain && last > 3.5, "{set:?}");
    }

    #[test]
    fn what_a_drivers_numbers_stand_for_need_not_be_known() {
        let driver = control(ControlName::Gain, ControlUnit::Driver, 0.0, [0.0, 480.0, 10.0]);
        // 0.05 dB each.
        let amplified = |gain: f64| 10f64.powf(gain * 0.05 / 20.0);
        let (done, set, frames) = searched(std::slice::from_ref(&driver), 0.025, amplified);
        assert!(done == Next::Right && frames <= 8, "{frames}: {set:?}");
        let (done, set, _) = searched(&[exposure(1.0), driver], 0.005, amplified);
        assert_eq!(done, Next::Right, "{set:?}");
    }

    #[test]
    fn a_gain_in_decibels_is_found_as_quickly_as_a_factor() {
        let amplified = |gain: f64| 10f64.powf(gain / 20.0);
        for begin in [-6.0, 0.0, 24.0] {
            let gain = control(ControlName::Gain, ControlUnit::Db, begin, [-6.0, 24.0, 0.1]);
            let (done, set, frames) = searched(std::slice::from_ref(&gain), 0.025, amplified);
            assert!(done == Next::Right && frames <= 4, "{frames} from {begin} dB: {set:?}");
        }
    }

    #[test]
    fn too_much_and_too_little_light_are_told() {
        let controls = [exposure(10.0), gain(1.0)];
        let (dark, ..) = searched(&controls, 1e-5, |gain| gain);
        let Next::Impossible(why) = dark else { panic!("{dark:?}") };
        assert!(why.contains("too dark") && why.contains("exposure 33.3 ms, gain 16"), "{why}");
        let (bright, ..) = searched(&controls, 500.0, |gain| gain);
        let Next::Impossible(why) = bright else { panic!("{bright:?}") };
        assert!(why.contains("too bright") && why.contains("exposure 0.1 ms, gain 1"), "{why}");
        // Nothing can be set.
        let locked = LightControl { locked: Some("read-only".to_owned()), ..exposure(10.0) };
        assert!(matches!(searched(&[locked], 1e-5, |gain| gain).0, Next::Impossible(_)));
    }

    #[test]
    fn between_two_coarse_steps_the_darker_one_is_taken() {
        let coarse = control(ControlName::Exposure, ControlUnit::Ms, 30.0, [10.0, 100.0, 10.0]);
        let mut search = Search::new(&[coarse], 100.0);
        let lit = |level: f64| Lit { level, clipped: if level > 0.98 { 0.1 } else { 0.0 } };
        // 20 ms gives 0.6, 30 ms 0.91.
        assert_eq!(search.next(lit(0.91)), Next::Set(ControlName::Exposure, 20.0));
        assert_eq!(search.next(lit(0.6)), Next::Right);
    }

    #[test]
    fn a_step_that_leaves_the_picture_dark_is_not_right() {
        let lit = |level: f64| Lit { level, clipped: if level > 0.98 { 0.1 } else { 0.0 } };
        let coarse = || control(ControlName::Exposure, ControlUnit::Ms, 20.0, [0.0, 100.0, 10.0]);
        // 10 ms gives 0.48, 20 ms 0.95.
        let mut search = Search::new(&[coarse()], 100.0);
        assert_eq!(search.next(lit(0.95)), Next::Set(ControlName::Exposure, 10.0));
        let Next::Impossible(why) = search.next(lit(0.48)) else { panic!("taken") };
        assert!(why.contains("two steps of the exposure") && why.contains("48 % of white"), "{why}");
        // A gain with finer steps makes up for it.
        let mut search = Search::new(&[coarse(), gain(1.0)], 100.0);
        assert_eq!(search.next(lit(0.95)), Next::Set(ControlName::Exposure, 10.0));
        assert_eq!(search.next(lit(0.48)), Next::Set(ControlName::Gain, 1.7));
        assert_eq!(search.next(lit(0.8)), Next::Right);
    }
}
