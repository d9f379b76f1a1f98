//! What the PI twin says of itself: the commands that it knows and the parameters of its stages, as a C-863 lists them.

use super::pi::Axis;

/// A command or question that the twin answers, and what for.
pub(super) const COMMANDS: &[&str] = &[
    "#5 Request Motion Status",
    "#7 Request Controller Ready Status",
    "#24 Stop All Axes",
    "*IDN? Get Device Identification",
    "ACC {<AxisID> <Acceleration>} Set Closed-Loop Acceleration",
    "ACC? [{<AxisID>}] Get Closed-Loop Acceleration",
    "CST? [{<AxisID>}] Get Assignment Of Stages To Axes",
    "CSV? Get Current Syntax Version",
    "DEC {<AxisID> <Deceleration>} Set Closed-Loop Deceleration",
    "DEC? [{<AxisID>}] Get Closed-Loop Deceleration",
    "ERR? Get Error Number",
    "FNL [{<AxisID>}] Fast Reference Move To Negative Limit",
    "FPL [{<AxisID>}] Fast Reference Move To Positive Limit",
    "FRF [{<AxisID>}] Fast Reference Move To Reference Switch",
    "FRF? [{<AxisID>}] Get Referencing Result",
    "GOH [{<AxisID>}] Go To Home Position",
    "HLP? Get List Of Available Commands",
    "HLT [{<AxisID>}] Halt Motion Smoothly",
    "HPA? Get List Of Available Parameters",
    "LIM? [{<AxisID>}] Indicate Limit Switches",
    "MOV {<AxisID> <Position>} Set Target Position",
    "MOV? [{<AxisID>}] Get Target Position",
    "MVR {<AxisID> <Distance>} Set Target Relative To Current Position",
    "ONT? [{<AxisID>}] Get On-Target State",
    "POS? [{<AxisID>}] Get Real Position",
    "PUN? [{<AxisID>}] Get Axis Unit",
    "RBT Reboot System",
    "RON {<AxisID> <ReferenceOn>} Set Reference Mode",
    "RON? [{<AxisID>}] Get Reference Mode",
    "SAI? [ALL] Get List Of Current Axis Identifiers",
    "SPA {<ItemID> <PamID> <PamValue>} Set Volatile Memory Parameters",
    "SPA? [{<ItemID> <PamID>}] Get Volatile Memory Parameters",
    "STP Stop All Axes",
    "SVO {<AxisID> <ServoState>} Set Servo Mode",
    "SVO? [{<AxisID>}] Get Servo Mode",
    "TMN? [{<AxisID>}] Get Minimum Commandable Position",
    "TMX? [{<AxisID>}] Get Maximum Commandable Position",
    "TRS? [{<AxisID>}] Indicate Reference Switch",
    "VEL {<AxisID> <Velocity>} Set Closed-Loop Velocity",
    "VEL? [{<AxisID>}] Get Closed-Loop Velocity",
    "VER? Get Versions Of Firmware And Drivers",
];

/// A parameter of an axis.
pub(super) struct Parameter {
    pub(super) number: u32,
    kind: &'static str,
    name: &'static str,
    get: fn(&Axis) -> String,
    /// `None` where it can only be read.
    set: Option<fn(&mut Axis, f64)>,
}

const fn number(
    number: u32,
    name: &'static str,
    get: fn(&Axis) -> String,
    set: Option<fn(&mut Axis, f64)>,
) -> Parameter {
    Parameter { number, kind: "FLOAT", name, get, set }
}

const PARAMETERS: &[Parameter] = &[
    number(0x0A, "Maximum Closed-Loop Velocity", |axis| float(axis.drive.config.speed_mm_per_s), None),
    number(0x0B, "Closed-Loop Acceleration", |axis| float(axis.drive.acceleration), Some(set_acceleration)),
    number(0x0C, "Closed-Loop Deceleration", |axis| float(axis.drive.acceleration), Some(set_acceleration)),
    number(0x15, "Maximum Travel In Positive Direction", |axis| float(axis.high), Some(|axis, to| axis.high = to)),
    number(0x30, "Maximum Travel In Negative Direction", |axis| float(axis.low), Some(|axis, to| axis.low = to)),
    Parameter { number: 0x3C, kind: "CHAR", name: "Stage Name", get: |_| STAGE.to_owned(), set: None },
    number(0x49, "Closed-Loop Velocity", |axis| float(axis.drive.speed), Some(|axis, to| axis.drive.speed = to)),
];

/// The stage's name.
pub(super) const STAGE: &str = "M-404.42S";

fn set_acceleration(axis: &mut Axis, to: f64) {
    axis.drive.acceleration = to;
}

fn float(value: f64) -> String {
    format!("{value:.6}")
}

/// A parameter by its number as it is written: decimal, or hexadecimal after `0x`.
pub(super) fn parameter(written: &str) -> Option<&'static Parameter> {
    let hexadecimal = written.strip_prefix("0x").or_else(|| written.strip_prefix("0X"));
    let number = match hexadecimal {
        Some(digits) => u32::from_str_radix(digits, 16).ok()?,
        None => written.parse().ok()?,
    };
    PARAMETERS.iter().find(|parameter| parameter.number == number)
}

impl Parameter {
    /// The line that tells it.
    pub(super) fn line(&self, axis: &Axis) -> String {
        format!("{} 0x{:X}={}", axis.name(), self.number, (self.get)(axis))
    }

    /// Sets it; tells whether it can be set to that.
    pub(super) fn set(&self, axis: &mut Axis, value: &str) -> bool {
        match (self.set, value.parse::<f64>()) {
            (Some(set), Ok(value)) if value.is_finite() => {
                set(axis, value);
                true
            }
            _ => false,
        }
    }
}

/// Every parameter of an axis, a line each.
pub(super) fn all(axis: &Axis) -> impl Iterator<Item = String> + '_ {
    PARAMETERS.iter().map(|parameter| parameter.line(axis))
}

/// The answer to `HLP?`.
pub(super) fn help() -> Vec<String> {
    let lines = COMMANDS.iter().map(|&line| line.to_owned());
    std::iter::once("The following commands are valid:".to_owned())
        .chain(lines)
        .chain(std::iter::once("end of help".to_owned()))
        .collect()
}

/// The answer to `HPA?`.
pub(super) fn parameters() -> Vec<String> {
    let line = |p: &Parameter| format!("0x{:X}=\t0\t1\t{}\tMotion\t{}", p.number, p.kind, p.name);
    std::iter::once("The following parameters are valid:".to_owned())
        .chain(PARAMETERS.iter().map(line))
        .chain(std::iter::once("end of help".to_owned()))
        .collect()
}
