//! What a calibration may have to find, what is known of it beforehand, and how a set-up that cannot tell is named.

use std::fmt;

/// One of the numbers that a calibration finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Unknown {
    /// d: main lens to MLA.
    D,
    /// b: MLA to sensor.
    B,
    /// What all boards' distances have in common: their shift against those given.
    Distance,
    /// f of the main lens.
    FocalLength,
}

impl Unknown {
    /// The words used in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::D => "d",
            Self::B => "b",
            Self::Distance => "the boards' distance",
            Self::FocalLength => "f",
        }
    }
}

/// The names of several unknowns as a list in words: "f, b and d".
pub(super) fn listed(unknowns: &[Unknown]) -> String {
    let said_first = [Unknown::FocalLength, Unknown::Distance, Unknown::B, Unknown::D];
    let names: Vec<&str> = said_first.into_iter().filter(|u| unknowns.contains(u)).map(Unknown::name).collect();
    match names.split_last() {
        None => String::new(),
        Some((last, [])) => (*last).to_owned(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}

/// How well a length is known before the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// It is held.
    Exactly,
    /// To within this standard uncertainty, mm, > 0: the fit weighs it as one more equation.
    Within(f64),
    /// Not at all: the fit has to find it.
    NotAtAll,
}

impl Known {
    /// Known to a standard uncertainty (mm): held where that is zero.
    #[must_use]
    pub fn to(sigma_mm: f64) -> Self {
        if sigma_mm > 0.0 { Self::Within(sigma_mm) } else { Self::Exactly }
    }

    /// Whether the fit may change it.
    #[must_use]
    pub fn free(self) -> bool {
        self != Self::Exactly
    }

    /// The standard uncertainty (mm) that makes it an equation of the fit.
    pub(super) fn prior_mm(self) -> Option<f64> {
        match self {
            Self::Within(sigma) => Some(sigma),
            Self::Exactly | Self::NotAtAll => None,
        }
    }
}

/// A set-up that cannot tell some of its unknowns apart, and what it would take.
#[derive(Debug, Clone, PartialEq)]
pub struct Degeneracy {
    /// The unknowns that can change together without anything to show for it.
    pub unknowns: Vec<Unknown>,
    /// The one of them that was found too loose, with the standard uncertainty it would have, mm: infinite where nothing
    /// at all tells.
    pub loosest: (Unknown, f64),
    /// Whether the micro-image pitch was one of the equations.
    pub with_pitch: bool,
    /// Whether the boards' distances were known.
    pub distances_known: bool,
}

impl fmt::Display for Degeneracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (loosest, sigma_mm) = self.loosest;
        write!(f, "{} cannot be told apart from spacings against ", listed(&self.unknowns))?;
        f.write_str(if self.distances_known { "distance" } else { "the steps between the boards" })?;
        f.write_str(if self.with_pitch { " and the micro-image pitch" } else { " alone" })?;
        if sigma_mm.is_finite() {
            write!(f, " ({} would be uncertain by {sigma_mm:.2} mm)", loosest.name())?;
        } else {
            f.write_str(", however many boards there are")?;
        }
        let has = |unknown| self.unknowns.contains(&unknown);
        let mut remedies = Vec::new();
        if !self.with_pitch {
            remedies.push("add the micro-image pitch as an equation");
        }
        if has(Unknown::FocalLength) {
            remedies.push("give f");
        }
        if has(Unknown::Distance) {
            remedies.push("give the boards' distance");
        }
        if has(Unknown::B) {
            remedies.push("hold b");
        }
        if sigma_mm.is_finite() {
            remedies.push("put the boards further apart");
        }
        write!(f, ": {}", remedies.join(", or "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_degeneracy_names_its_unknowns_and_the_way_out() {
        let unknowns = vec![Unknown::D, Unknown::B, Unknown::FocalLength];
        let alone =
            Degeneracy { unknowns, loosest: (Unknown::FocalLength, 13.06), with_pitch: false, distances_known: true };
        let said = alone.to_string();
        assert!(said.starts_with("f, b and d cannot be told apart from spacings against distance alone"), "{said}");
        assert!(said.contains("f would be uncertain by 13.06 mm") && said.contains("micro-image pitch"), "{said}");
        let endless = Degeneracy { loosest: (Unknown::Distance, f64::INFINITY), distances_known: false, ..alone };
        let said = endless.to_string();
        assert!(said.contains("however many boards") && !said.contains("further apart"), "{said}");
        assert_eq!(listed(&[Unknown::D]), "d");
    }

    #[test]
    fn what_is_known_to_nothing_is_held() {
        assert_eq!(Known::to(0.0), Known::Exactly);
        assert_eq!(Known::to(0.1), Known::Within(0.1));
        assert!(Known::NotAtAll.free() && !Known::Exactly.free());
    }
}
