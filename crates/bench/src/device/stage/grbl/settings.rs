//! Settings by number, and what a firmware was built with.

use std::collections::BTreeMap;

use super::Letter;

/// The controller's settings by number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings(BTreeMap<u16, f64>);

impl Settings {
    /// Reads the answer to `$$`. Lines that are not settings are passed over.
    #[must_use]
    pub fn from_lines(lines: &[String]) -> Self {
        Self(lines.iter().filter_map(|line| setting(line)).collect())
    }

    /// A setting's value.
    #[must_use]
    pub fn get(&self, number: u16) -> Option<f64> {
        self.0.get(&number).copied()
    }

    /// Whether a setting is there and not zero.
    #[must_use]
    pub fn is_on(&self, number: u16) -> bool {
        self.get(number).is_some_and(|value| value != 0.0)
    }

    /// The setting of an axis in one of the three-number groups: 100 steps/mm, 110 greatest rate (mm/min), 120
    /// acceleration (mm/s²), 130 travel (mm).
    #[must_use]
    pub fn of_axis(&self, group: u16, axis: Letter) -> Option<f64> {
        self.get(group + axis.index() as u16)
    }
}

/// Settings that are believed, each by itself, once two readings have said the same of it. A line has no checksum, and a
/// digit that is lost on the way makes another number of it, or another setting.
#[derive(Debug, Default)]
pub struct Votes {
    readings: usize,
    told: BTreeMap<u16, Vec<f64>>,
}

impl Votes {
    /// Ones that count what was believed before.
    #[must_use]
    pub fn after(before: &Settings) -> Self {
        let mut votes = Self::default();
        votes.told(before);
        votes
    }

    /// Takes a reading, and returns the settings once all of them are believed.
    pub fn told(&mut self, settings: &Settings) -> Option<Settings> {
        self.readings += 1;
        for (&number, &value) in &settings.0 {
            self.told.entry(number).or_default().push(value);
        }
        let mut agreed = BTreeMap::new();
        for (&number, values) in &self.told {
            let said = |value: f64| values.iter().filter(|&&other| other == value).count();
            let twice: Vec<f64> = values.iter().copied().filter(|&value| said(value) > 1).collect();
            match twice[..] {
                // Two values that were each said twice: one is of before.
                [first, ..] if twice.iter().any(|&value| value != first) => return None,
                [value, ..] => {
                    agreed.insert(number, value);
                }
                // What one reading of several has is no setting.
                [] if values.len() == 1 && self.readings > 2 => {}
                [] => return None,
            }
        }
        (self.readings > 1 && !agreed.is_empty()).then_some(Settings(agreed))
    }
}

/// Reads a settings line, `$100=400.000`.
#[must_use]
pub fn setting(line: &str) -> Option<(u16, f64)> {
    let (number, value) = line.strip_prefix('$')?.split_once('=')?;
    // Some builds add the setting's name in brackets.
    let value = value.split_whitespace().next()?;
    Some((number.parse().ok()?, value.parse().ok().filter(|value: &f64| value.is_finite())?))
}

/// Whether a letter is among the build options in the answer to `$I`.
fn built_with(lines: &[String], option: char) -> bool {
    lines
        .iter()
        .filter_map(|line| line.strip_prefix("[OPT:"))
        .filter_map(|options| options.split(',').next())
        .any(|letters| letters.contains(option))
}

/// Whether the answer to `$I` says that single axes can be homed (`H` among the build options).
#[must_use]
pub fn homes_single_axes(lines: &[String]) -> bool {
    built_with(lines, 'H')
}

/// Whether the answer to `$I` says that homing makes its end the machine's zero (`Z` among the build options).
#[must_use]
pub fn homes_to_zero(lines: &[String]) -> bool {
    built_with(lines, 'Z')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_believed_once_it_was_told_twice_alike() {
        let read =
            |lines: &[&str]| Settings::from_lines(&lines.iter().map(|&line| line.to_owned()).collect::<Vec<_>>());
        let whole = read(&["$27=2.000", "$101=8000.000", "$110=120.000"]);
        let mut agreed = Votes::default();
        assert_eq!(agreed.told(&whole), None, "once");
        assert_eq!(agreed.told(&whole), Some(whole.clone()));
        // Lost: a nought, a digit of a number, a whole line.
        let mut agreed = Votes::default();
        assert_eq!(agreed.told(&read(&["$27=2.000", "$101=800.000", "$110=120.000"])), None);
        assert_eq!(agreed.told(&read(&["$27=2.000", "$101=8000.000", "$10=120.000"])), None);
        assert_eq!(agreed.told(&read(&["$101=8000.000", "$110=120.000"])), Some(whole));
    }

    #[test]
    fn settings_and_options_are_read() {
        let lines: Vec<String> =
            ["$100=400.000", "$110=120.000 (x max rate)", "rubbish", "$x=1"].map(str::to_owned).to_vec();
        let settings = Settings::from_lines(&lines);
        assert_eq!(settings.of_axis(100, Letter::X), Some(400.0));
        assert_eq!(settings.of_axis(110, Letter::X), Some(120.0));
        assert_eq!(settings.of_axis(100, Letter::Y), None);
        assert!(homes_single_axes(&["[VER:1.1h.20190825:]".to_owned(), "[OPT:VH,15,128]".to_owned()]));
        assert!(!homes_single_axes(&["[VER:1.1H:]".to_owned(), "[OPT:V,15,128]".to_owned()]));
    }
}
