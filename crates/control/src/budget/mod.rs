//! What an alignment is good to: every value that it takes for granted has a standard uncertainty ([`UncertaintyConfig`]),
//! which is carried through air step and shell step with what they share kept shared. An error of f makes Δv wrong, but not
//! the focus, because the spacing is brought to its target all the same.
//!
//! Configured values and measurements are put together by least squares; where they contradict each other, that is said.
//!
//! ```text
//!   evidence.rs     what was seen
//!   part.rs         what is taken for granted, and how well it is known
//!   model.rs        what would be seen, were each part a little off
//!   adjustment.rs   least squares, and what each part does to the result
//! ```
//!
//! [`UncertaintyConfig`]: bench::config::UncertaintyConfig

mod adjustment;
mod evidence;
mod model;
mod part;

use std::fmt;

use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use bench::config::Config;

pub(crate) use evidence::AirStep;
pub use evidence::{AirPlace, BoardSeen, Evidence, PitchSeen};

use crate::budget::adjustment::{Adjusted, slopes};
use crate::budget::model::Model;
use crate::budget::part::Part;
use crate::loops::room::EAxis;

/// A part that is further off than this many standard uncertainties contradicts the measurements.
const CONTRADICTS: f64 = 4.0;
/// Parts that explain a contradiction as well as the best does, to within this share of its pull, are named with it.
const AS_GOOD: f64 = 0.9;

/// Whether a value is within its tolerance, as far as its uncertainty lets anybody tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is, by two standard uncertainties.
    Within,
    /// It is not, by two standard uncertainties.
    Outside,
    /// It is too uncertain for its tolerance, or too near to the tolerance's end.
    CannotBeTold,
}

impl Verdict {
    /// Of a value that may be so far from the one wanted.
    fn of(off: f64, sigma: f64, tolerance: f64) -> Self {
        if off.abs() + 2.0 * sigma <= tolerance {
            Self::Within
        } else if off.abs() - 2.0 * sigma > tolerance {
            Self::Outside
        } else {
            Self::CannotBeTold
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Within => "within tolerance",
            Self::Outside => "outside tolerance",
            Self::CannotBeTold => "cannot be told",
        })
    }
}

/// What one part of the budget does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BudgetPart {
    /// What it is.
    pub name: String,
    /// The key that says how well it is known; `null` for a measurement.
    pub key: Option<String>,
    /// What Δv is uncertain by because of it, mm.
    pub delta_v_mm: f64,
    /// The same of e, mm.
    pub e_mm: f64,
    /// The same of the spacing's distance from the one in focus, px.
    pub off_focus_px: f64,
    /// What would make it smaller.
    pub remedy: String,
}

/// What an alignment is good to, with all that it takes for granted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Budget {
    /// Δv, mm: d + N b less the air design's v.
    pub delta_v_mm: f64,
    /// Its standard uncertainty, mm.
    pub delta_v_sigma_mm: f64,
    /// e, mm: from the shell's centre back to the lens's principal point.
    pub e_mm: f64,
    /// Its standard uncertainty, mm.
    pub e_sigma_mm: f64,
    /// The spacing near the axis less that at which the microlenses focus, px: its size is the blur's diameter.
    pub off_focus_px: f64,
    /// Its standard uncertainty, px.
    pub off_focus_sigma_px: f64,
    /// Correlation of Δv, e and the spacing's distance from focus.
    pub correlation: [[f64; 3]; 3],
    /// Whether the object is in focus: its blur against `assembly.blur_limit_px`.
    pub in_focus: Verdict,
    /// Δv against `assembly.delta_v_tolerance_mm`.
    pub delta_v: Verdict,
    /// e against `assembly.e_tolerance_mm`.
    pub e: Verdict,
    /// Both verdicts in a sentence, with the part that most is lost by where one cannot be told.
    pub conclusion: String,
    /// The parts, the one that costs most of its tolerance first.
    pub parts: Vec<BudgetPart>,
    /// What was configured and what was measured that do not go together, a sentence each.
    pub contradictions: Vec<String>,
}

impl Budget {
    /// The budget of an alignment that wanted e to be `e_target_mm`. `None` where it never looked through the shell, or what
    /// it saw fits nothing.
    #[must_use]
    pub fn of(config: &Config, seen: &Evidence, e_target_mm: f64) -> Option<Self> {
        let model = Model::new(config, seen)?;
        let (measurements, adjusted) = model.adjusted()?;
        let found = model.results(&adjusted.unknowns)?;
        let rows = slopes(&adjusted.unknowns, found.len(), |unknowns| {
            model.results(unknowns).map_or_else(|| DVector::zeros(found.len()), |found| DVector::from_row_slice(&found))
        });
        let gradient: [DVector<f64>; 3] = std::array::from_fn(|row| rows.row(row).transpose());
        let sigma = gradient.each_ref().map(|slopes| adjusted.sigma(slopes));
        let correlation = std::array::from_fn(|i| {
            std::array::from_fn(|j| match sigma[i] * sigma[j] {
                // Of what is exact there is none.
                0.0 => f64::from(i == j),
                both => adjusted.covariance_of(&gradient[i], &gradient[j]) / both,
            })
        });
        let tolerances = config.tolerances();
        let tolerance = [tolerances.delta_v_mm, tolerances.e_mm, config.assembly.blur_limit_px];
        let wanted = [config.design().clarity(found[1]).delta_v, e_target_mm, 0.0];
        let verdict = |k: usize| Verdict::of(found[k] - wanted[k], sigma[k], tolerance[k]);
        let parts = parts(&model, &measurements, &adjusted, &gradient, tolerance);
        let mut budget = Self {
            delta_v_mm: found[0],
            delta_v_sigma_mm: sigma[0],
            e_mm: found[1],
            e_sigma_mm: sigma[1],
            off_focus_px: found[2],
            off_focus_sigma_px: sigma[2],
            correlation,
            in_focus: verdict(2),
            delta_v: verdict(0),
            e: verdict(1),
            conclusion: String::new(),
            parts,
            contradictions: contradictions(&model, &measurements, &adjusted),
        };
        budget.conclusion = budget.concluded(wanted, tolerance);
        Some(budget)
    }

    /// Both verdicts in a sentence, with what Δv and e (mm) were to be, and how near that.
    fn concluded(&self, wanted: [f64; 3], tolerance: [f64; 3]) -> String {
        let focus = match self.in_focus {
            Verdict::Within => "in focus",
            Verdict::Outside => "out of focus",
            Verdict::CannotBeTold => "whether it is in focus cannot be told",
        };
        let most = |cost: fn(&BudgetPart) -> f64| {
            let part = self.parts.iter().max_by(|one, other| cost(one).total_cmp(&cost(other)));
            part.map_or_else(String::new, |part| format!(", mostly for the {}: {}", part.name, part.remedy))
        };
        let said = |what: &str, k: usize, (value, sigma): (f64, f64), verdict, digits: usize, why: String| {
            let value = format!("{what} = {value:.digits$} ± {sigma:.digits$} mm");
            let to_be = format!("({:.digits$} mm, give or take {:.digits$} mm)", wanted[k], tolerance[k]);
            match verdict {
                Verdict::CannotBeTold => format!("whether {value} is within tolerance {to_be} cannot be told{why}"),
                verdict => format!("{value} is {verdict} {to_be}"),
            }
        };
        let (delta_v, e) = ((self.delta_v_mm, self.delta_v_sigma_mm), (self.e_mm, self.e_sigma_mm));
        let delta_v = said("Δv", 0, delta_v, self.delta_v, 4, most(|part| part.delta_v_mm));
        let e = said("e", 1, e, self.e, 3, most(|part| part.e_mm));
        format!(
            "{focus} (the blur is {:.3} ± {:.3} px); {delta_v}; {e}",
            self.off_focus_px.abs(),
            self.off_focus_sigma_px
        )
    }
}

/// What the e axis's readings mean by all that was seen and all that is taken for granted, and where a half of that is in doubt.
/// `None` where what was seen fits nothing.
#[must_use]
pub fn e_axis(config: &Config, seen: &Evidence) -> Option<EAxis> {
    let model = Model::new(config, seen)?;
    let in_doubt_of = |doubtful: &[Part]| {
        let model = model.in_doubt_of(doubtful);
        let (_, adjusted) = model.adjusted()?;
        Some(model.e_axis(&adjusted))
    };
    Some(EAxis {
        by_all: in_doubt_of(&[])?,
        by_picture: in_doubt_of(&[Part::EZero])?,
        by_axis: in_doubt_of(&[Part::OuterRadius, Part::InnerRadius, Part::BoardInWater])?,
    })
}

/// What each part does, those of one name together.
fn parts(
    model: &Model<'_>,
    measurements: &[&str],
    adjusted: &Adjusted,
    gradient: &[DVector<f64>; 3],
    tolerance: [f64; 3],
) -> Vec<BudgetPart> {
    let mut parts: Vec<BudgetPart> = Vec::new();
    let mut add = |name: &str, key: Option<&str>, remedy: &str, does: [f64; 3]| {
        if let Some(known) = parts.iter_mut().find(|part| part.name == name) {
            known.delta_v_mm = known.delta_v_mm.hypot(does[0]);
            known.e_mm = known.e_mm.hypot(does[1]);
            known.off_focus_px = known.off_focus_px.hypot(does[2]);
        } else {
            parts.push(BudgetPart {
                name: name.to_owned(),
                key: key.map(str::to_owned),
                delta_v_mm: does[0],
                e_mm: does[1],
                off_focus_px: does[2],
                remedy: remedy.to_owned(),
            });
        }
    };
    for (unknown, (part, _)) in model.parts.iter().enumerate() {
        let does = gradient.each_ref().map(|slopes| adjusted.by_unknown(slopes, unknown));
        add(part.name(), Some(part.key()), part.remedy(), does);
    }
    for (measurement, name) in measurements.iter().enumerate() {
        let does = gradient.each_ref().map(|slopes| adjusted.by_measurement(slopes, measurement));
        add(name, None, "more frames, more light, more texture", does);
    }
    let cost = |part: &BudgetPart| {
        (part.delta_v_mm / tolerance[0]).max(part.e_mm / tolerance[1]).max(part.off_focus_px / tolerance[2])
    };
    parts.sort_by(|one, other| cost(other).total_cmp(&cost(one)));
    parts
}

/// What does not go together.
fn contradictions(model: &Model<'_>, measurements: &[&str], adjusted: &Adjusted) -> Vec<String> {
    let mut pulls: Vec<(usize, f64)> = (0..model.parts.len()).map(|k| (k, adjusted.pull(k).abs())).collect();
    pulls.sort_by(|one, other| other.1.total_cmp(&one.1));
    let strongest = pulls.first().map_or(0.0, |(_, pull)| *pull);
    let mut said: Vec<String> = pulls
        .into_iter()
        .filter(|(_, pull)| *pull > CONTRADICTS && *pull >= AS_GOOD * strongest)
        .filter_map(|(unknown, pull)| {
            let (part, sigma) = model.parts[unknown];
            let without = adjusted.without(unknown)?;
            Some(format!(
                "what was measured contradicts the {} by {pull:.1} standard uncertainties: it would fit one {:+.4} ± {:.4}{unit} from what is configured, which is taken to be right to ± {sigma:.4}{unit} ({})",
                part.name(),
                without.value * sigma,
                without.sigma * sigma,
                part.key(),
                unit = part.unit(),
            ))
        })
        .collect();
    if said.is_empty()
        && let Some((name, left)) =
            measurements.iter().zip(&adjusted.left).max_by(|one, other| one.1.abs().total_cmp(&other.1.abs()))
        && left.abs() > CONTRADICTS
    {
        said.push(format!(
            "the {name} do not fit the rest by {:.1} standard uncertainties, whatever is changed of what is configured",
            left.abs()
        ));
    }
    said
}
