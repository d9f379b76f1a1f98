//! What a plan's alignment is expected to be good to with all that it takes for granted: the budget of measurements that come
//! out as planned.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Plan;
use super::precision::Precision;
use crate::budget::{BoardSeen, Budget, Evidence, PitchSeen, e_axis};
use crate::calibrated::CalibratedCamera;
use crate::room::{Contact, Room};
use crate::shell::ShellObservation;
use bench::config::{Config, LBoundSource};
use plenoptics::optics::mla::micro_image_pitch;

/// Standard uncertainty of a white frame's pitch, as a share of it.
const PITCH_SIGMA: f64 = 2e-5;

/// What is to be expected with all that is taken for granted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExpectedBudget {
    /// Standard uncertainty of Δv, mm.
    pub delta_v_sigma_mm: f64,
    /// The same of e, mm.
    pub e_sigma_mm: f64,
    /// By how much e stays further from the shell than it is aimed at, mm: three of its standard uncertainties lie between the
    /// lens and where it touches, which is l_bound less `assembly.clearance_mm`.
    pub e_held_off_mm: f64,
}

impl fmt::Display for ExpectedBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { delta_v_sigma_mm, e_sigma_mm, e_held_off_mm } = self;
        write!(
            f,
            "with all that is taken for granted Δv is good to {delta_v_sigma_mm:.3} mm and e to {e_sigma_mm:.2} mm"
        )?;
        if *e_held_off_mm > 0.0 {
            write!(f, ", so that e stays {e_held_off_mm:.2} mm further from the shell than aimed at")?;
        }
        Ok(())
    }
}

impl ExpectedBudget {
    /// That of a plan; `None` where no light comes through the shell, or the equations have no solution.
    pub(super) fn of(config: &Config, plan: &Plan, precision: &Precision) -> Option<Self> {
        let seen = evidence(config, plan, precision);
        let budget = Budget::of(config, &seen, plan.solution.e)?;
        let measured = config.assembly.l_bound == LBoundSource::Measure;
        let contact = Contact {
            e_mm: plan.l_bound_mm - config.assembly.clearance_mm,
            // The picture tells it as well as it tells e.
            measured_sigma_mm: measured.then_some(budget.e_sigma_mm),
        };
        let room = Room { contact, e: e_axis(config, &seen)? };
        let least_mm = room.least_mm(plan.solution.e, plan.e.high_mm).unwrap_or(plan.e.high_mm);
        let e_held_off_mm = least_mm - plan.solution.e;
        Some(Self {
            delta_v_sigma_mm: budget.delta_v_sigma_mm,
            e_sigma_mm: budget.e_sigma_mm,
            // So little is no other place.
            e_held_off_mm: if e_held_off_mm > 0.5 * plan.e_tolerance_mm { e_held_off_mm } else { 0.0 },
        })
    }
}

/// What is seen where everything is as configured.
fn evidence(config: &Config, plan: &Plan, precision: &Precision) -> Evidence {
    let (design, solution) = (plan.design, &plan.solution);
    let pixel_mm = config.pixel_pitch().millimetres();
    let air = CalibratedCamera {
        lens_to_mla_mm: design.lens_to_mla(solution.delta_v),
        image_distance_sigma_mm: precision.delta_v_mm,
        ..CalibratedCamera::designed(config, solution.e)
    };
    // Each level has a third of the field.
    let sigma_px = 3.0_f64.sqrt() * precision.spacing_px;
    let boards = plan.places_about(solution.equivalent_distance).map(|distance_mm| BoardSeen {
        distance_mm,
        spacing_px: design.spacing_at(distance_mm, solution.delta_v) / pixel_mm,
        sigma_px,
    });
    let white_mm = plan.focus.home_mm - solution.delta_v;
    let pitch_px = micro_image_pitch(design.mla.pitch, air.lens_to_mla_mm + white_mm, design.mla.b()) / pixel_mm;
    let poses = [plan.mount_e_mm, plan.mount_e_mm - plan.e_probe_mm, solution.e];
    let shell = poses.map(|e_mm| ShellObservation {
        e_reading_mm: e_mm,
        trim_mm: 0.0,
        spacing_px: air.spacing_px(e_mm, 0.0),
        sigma_px: precision.spacing_px,
        sigma_random_px: precision.spacing_px,
    });
    Evidence {
        air,
        boards,
        pitch: Some(PitchSeen { pitch_px, sigma_px: PITCH_SIGMA * pitch_px, delta_v_mm: white_mm }),
        shell: shell.to_vec(),
        tilt_change: None,
        window_px: air.window_px.unwrap_or_default(),
    }
}
