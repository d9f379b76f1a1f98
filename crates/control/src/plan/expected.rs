//! What a plan's alignment is expected to be good to with all that it takes for granted: the budget of measurements that come
//! out as planned.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::precision::Precision;
use super::{AirBoards, Plan};
use crate::budget::{AirPlace, BoardSeen, Budget, Evidence, PitchSeen, e_axis};
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::room::{Contact, Room};
use crate::loops::shell::ShellObservation;
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
    let boards_at = |delta_v_mm: f64, middle_mm: f64| {
        plan.places_about(middle_mm).map(|distance_mm| BoardSeen {
            distance_mm,
            spacing_px: design.spacing_at(distance_mm, delta_v_mm) / pixel_mm,
            sigma_px,
        })
    };
    let boards = boards_at(solution.delta_v, solution.equivalent_distance);
    // The first are looked at where the white frame is taken.
    let white_mm = plan.focus.home_mm;
    let first = plan.boards_at(white_mm, plan.unknown_delta_v_mm(white_mm), None).map(|boards| AirPlace {
        focus_mm: white_mm,
        boards: match boards {
            AirBoards::Levels(_) => boards_at(white_mm, boards.middle_mm()).to_vec(),
            AirBoards::Flat(distance_mm) => vec![BoardSeen {
                distance_mm,
                spacing_px: design.spacing_at(distance_mm, white_mm) / pixel_mm,
                sigma_px: precision.spacing_px,
            }],
        },
    });
    let pitch_px = micro_image_pitch(design.mla.pitch, design.lens_to_mla(white_mm), design.mla.b()) / pixel_mm;
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
        focus_mm: solution.delta_v,
        focus_scale: 1.0,
        places: first.into_iter().collect(),
        boards,
        pitch: Some(PitchSeen { pitch_px, sigma_px: PITCH_SIGMA * pitch_px, focus_mm: white_mm }),
        shell: shell.to_vec(),
        tilt_change: None,
        window_px: air.window_px.unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the white frame was taken is told by the boards that were seen there, not by the focus axis's word alone: by the
    /// pitch there Δv is known where f is not.
    #[test]
    fn boards_tell_the_focus_axis_scale() {
        const SCALE: f64 = 1.05;
        let config = Config::default();
        let (design, assembly) = (config.design(), &config.assembly);
        let plan = Plan::new(&config, design.joint(assembly.l_bound_mm), assembly.l_bound_mm, assembly.initial_e_mm);
        let as_configured = evidence(&config, &plan, &Precision::of(&config, &plan));
        let budget = |seen: &Evidence| Budget::of(&config, seen, plan.solution.e).unwrap();
        let known = budget(&as_configured);

        // An axis that moves by more than it reads has shown the same at readings that are nearer to one another.
        let reading = |focus_mm: f64| as_configured.focus_mm + (focus_mm - as_configured.focus_mm) / SCALE;
        let mut stretched = as_configured.clone();
        stretched.places.iter_mut().for_each(|place| place.focus_mm = reading(place.focus_mm));
        stretched.pitch.iter_mut().for_each(|pitch| pitch.focus_mm = reading(pitch.focus_mm));
        let (told, untold) = (budget(&stretched), budget(&Evidence { places: Vec::new(), ..stretched.clone() }));
        let off = |budget: &Budget| (budget.delta_v_mm - known.delta_v_mm).abs();
        assert!(off(&told) < 0.1 * known.delta_v_sigma_mm, "{} {}", told.delta_v_mm, known.delta_v_mm);
        assert!((told.delta_v_sigma_mm / known.delta_v_sigma_mm - 1.0).abs() < 0.1, "{}", told.delta_v_sigma_mm);
        // Without them it is uncertain by what the axis is, too.
        let by_axis = |budget: &Budget| {
            let part = budget.parts.iter().find(|part| part.name == "scale of the focus axis").unwrap();
            part.delta_v_mm
        };
        assert!(by_axis(&untold) > 2.0 * by_axis(&told), "{} {}", by_axis(&untold), by_axis(&told));
        assert!(untold.delta_v_sigma_mm > told.delta_v_sigma_mm, "{}", untold.delta_v_sigma_mm);
        assert!(off(&untold) < 2.0 * untold.delta_v_sigma_mm, "{} {}", untold.delta_v_mm, known.delta_v_mm);
    }
}
