//! `plenalign plan`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use super::Context;
use crate::control::plan::{ExpectedBudget, PlanView, PlannedBoards};

/// Arguments of `plenalign plan`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Ends with 1 where something stands in the way.
pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let plan = PlanView::of(&context.config, &context.origin);
    let mut text = if args.json { serde_json::to_string_pretty(&plan)? } else { written(&plan)? };
    if args.json {
        text.push('\n');
    }
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(if plan.possible { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn written(plan: &PlanView) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "Camera: {}", plan.origin)?;
    writeln!(out)?;
    let mut line = |name: &str, value: String| writeln!(out, "{name:<24} {value}");
    line("Δv", format!("{:.4} mm to ±{} mm", plan.delta_v_mm, plan.delta_v_tolerance_mm))?;
    line("e", format!("{:.3} mm to ±{} mm", plan.e_mm, plan.e_tolerance_mm))?;
    if plan.e_above_mm > plan.e_tolerance_mm {
        let above =
            format!("or up to {:.1} mm more: the axis's reading does not pass the wall, whatever", plan.e_above_mm);
        line("", format!("{above} its zero and scale"))?;
    }
    line("spacing in focus", format!("{:.3} px to ±{:.3} px", plan.spacing_target_px, plan.spacing_tolerance_px))?;
    let boards = match plan.boards_in_air {
        PlannedBoards::TripleLevel => "three levels side by side",
        PlannedBoards::FlatInTurn => "one flat board, put to three places in turn",
    };
    line("boards in air", boards.to_owned())?;
    for board in &plan.boards {
        line("", format!("at {:.1} mm: spacing {:.2} px", board.distance_mm, board.spacing_px))?;
    }
    if let Some(first_mm) = plan.first_board_mm {
        line("first board in air", format!("at {first_mm:.1} mm, with the focus axis as its homing leaves it"))?;
    }
    let mounted = format!("at e = {:.1} mm: spacing {:.2} px", plan.mount_e_mm, plan.mount_spacing_px);
    line("shell mounted", mounted)?;
    line("aberrations of the shell", format!("{:+.3} px of the spacing in focus", plan.aberrations_px))?;
    line("first moves", format!("{:.3} mm of focus, {:.3} mm of e", plan.focus_probe_mm, plan.e_probe_mm))?;
    line("search", format!("by {:.3} mm of focus where a picture cannot be measured", plan.search_step_mm))?;
    let (spacing, delta_v, e) = (plan.spacing_sigma_px, plan.delta_v_sigma_mm, plan.e_sigma_mm);
    line("expected to be good to", format!("spacing {spacing:.4} px, Δv {delta_v:.4} mm, e {e:.3} mm"))?;
    line("", format!("by the picture and the axes alone: {}", plan.assumed))?;
    if let Some(budget) = plan.by_budget {
        let ExpectedBudget { delta_v_sigma_mm, e_sigma_mm, e_held_off_mm } = budget;
        line("", format!("Δv {delta_v_sigma_mm:.3} mm, e {e_sigma_mm:.2} mm with all that is taken for granted"))?;
        if e_held_off_mm > 0.0 {
            line(
                "",
                format!(
                    "e stays {e_held_off_mm:.2} mm further from the shell: three of what it is good to, to be clear of it"
                ),
            )?;
        }
    }
    line("time", format!("about {:.0} s besides the operator", plan.duration_s))?;
    line("operator", format!("{} steps", plan.operator_steps.len()))?;
    for (number, step) in plan.operator_steps.iter().enumerate() {
        let value = step.value.as_ref().map_or_else(String::new, |value| format!(": {value}"));
        line("", format!("{}. {}{value}", number + 1, step.name.replace('_', " ")))?;
    }
    if plan.possible {
        writeln!(out, "\nNothing stands in the way.")?;
    }
    for obstacle in &plan.obstacles {
        writeln!(out, "\nIn the way: {obstacle}.")?;
    }
    Ok(out)
}
