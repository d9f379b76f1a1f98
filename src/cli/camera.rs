//! `plenalign camera`: the cameras that are connected, what they offer, and their controls; a daemon's, by
//! [`super::exposure`].

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use anyhow::{Context as _, anyhow};
use serde::Serialize;

use super::{Context, exposure};
use crate::config::{CameraConfig, CameraDriver, GenicamName};
use crate::device::camera::controls::{self, Control};
use crate::device::camera::find::{self, Node};
use crate::device::camera::genicam::find as genicam;
use crate::device::camera::genicam::found::{FoundCamera, Way};
use crate::device::camera::genicam::listing::Feature;
use crate::device::camera::genicam::survey;
use crate::device::camera::offer::{self, Offer};

/// Arguments of `plenalign camera`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// List every camera with its formats, sizes and frame rates.
    List(ListArgs),
    /// List a camera's controls with their values and ranges.
    Controls(ControlsArgs),
    /// Read or set the exposure and gain of a running daemon's camera.
    Exposure(exposure::Args),
}

#[derive(Debug, clap::Args)]
struct ListArgs {
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct ControlsArgs {
    /// The camera, as `bench.camera.device` names it: a device file, card:NAME or usb:SERIAL; of a GenICam camera
    /// serial:NUMBER, name:NAME, its address, or usb:VENDOR:PRODUCT; the configured one unless given.
    device: Option<String>,
    /// Set what [bench.camera.controls] says and switch the camera's automatics off, as the daemon does, then list.
    #[arg(long)]
    apply: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// A camera and what it offers.
#[derive(Debug, Serialize)]
struct Listed {
    #[serde(flatten)]
    node: Node,
    formats: Vec<Offer>,
}

#[derive(Debug, Serialize)]
struct Cameras {
    cameras: Vec<Listed>,
    /// GenICam cameras that answer on the interfaces of the configuration.
    network: Vec<FoundCamera>,
    /// GenICam cameras on USB.
    usb: Vec<FoundCamera>,
}

/// A camera's controls.
#[derive(Debug, Serialize)]
struct Controls<C> {
    device: String,
    controls: Vec<C>,
    /// What came of setting the configured ones.
    notes: Vec<String>,
}

/// What a camera's control is shown by.
trait Shown {
    /// Its key in the configuration, its value where it has one, what it takes, and why it cannot be set.
    fn shown(&self) -> (&str, Option<String>, String, Option<&str>);
}

impl Shown for Control {
    fn shown(&self) -> (&str, Option<String>, String, Option<&str>) {
        (&self.key, self.value.map(|value| self.said(value)), self.choices(), self.locked)
    }
}

impl Shown for Feature {
    fn shown(&self) -> (&str, Option<String>, String, Option<&str>) {
        (&self.key, self.value.as_ref().map(ToString::to_string), self.choices.clone(), self.locked.as_deref())
    }
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let text = match args.command {
        Command::List(args) => {
            let (found, wrong) = survey::cameras(&context.config.bench.camera.interfaces);
            for why in wrong {
                eprintln!("{why}");
            }
            let (network, usb) = found.into_iter().partition(|camera| matches!(camera.way, Way::Network { .. }));
            let cameras = Cameras { cameras: find::nodes().into_iter().map(listed).collect(), network, usb };
            if args.json { json(&cameras)? } else { cameras_text(&cameras)? }
        }
        Command::Controls(args) => {
            let camera = configured(&context, &args)?;
            match GenicamName::of(&camera.device) {
                Some(_) => said(&read_features(&camera, args.apply)?, args.json)?,
                None => said(&read_controls(&camera, args.apply)?, args.json)?,
            }
        }
        Command::Exposure(args) => return exposure::run(&args),
    };
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

fn json(view: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(view)? + "\n")
}

fn listed(node: Node) -> Listed {
    let formats = match (&node.unusable, find::open(&node.path)) {
        (None, Ok(device)) => offer::offers(&device),
        _ => Vec::new(),
    };
    Listed { node, formats }
}

fn said<C: Serialize + Shown>(controls: &Controls<C>, as_json: bool) -> anyhow::Result<String> {
    if as_json { json(controls) } else { Ok(controls_text(controls)?) }
}

/// The configuration with the camera that is named, where one is.
fn configured(context: &Context, args: &ControlsArgs) -> anyhow::Result<CameraConfig> {
    let camera = &context.config.bench.camera;
    match &args.device {
        Some(device) => Ok(CameraConfig { device: device.clone(), ..camera.clone() }),
        None if camera.driver == CameraDriver::Files => {
            Err(anyhow!("bench.camera.driver = \"files\" has no controls; name a camera"))
        }
        None => Ok(camera.clone()),
    }
}

fn read_features(camera: &CameraConfig, apply: bool) -> anyhow::Result<Controls<Feature>> {
    let (controls, notes) = genicam::features_of(camera, apply).map_err(|why| anyhow!(why))?;
    Ok(Controls { device: camera.device.clone(), controls, notes })
}

fn read_controls(camera: &CameraConfig, apply: bool) -> anyhow::Result<Controls<Control>> {
    let path = find::resolve(&camera.device).map_err(|why| anyhow!(why))?;
    let opened = find::open(&path).map_err(|why| anyhow!(why))?;
    let notes = match apply {
        true => controls::apply(&opened, &camera.controls).map_err(|why| anyhow!(why)).context("nothing was set")?,
        false => Vec::new(),
    };
    Ok(Controls { device: path.display().to_string(), controls: controls::list(&opened), notes })
}

fn cameras_text(Cameras { cameras, network, usb }: &Cameras) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    if cameras.is_empty() && network.is_empty() && usb.is_empty() {
        writeln!(out, "no video device is connected")?;
    }
    for camera in network.iter().chain(usb) {
        let by = match &camera.way {
            Way::Network { interface, .. } => format!(", {interface}"),
            Way::Usb { carried_mbit_per_s, .. } => {
                carried_mbit_per_s.map_or_else(String::new, |carried| format!(", {carried} Mbit/s of frames"))
            }
        };
        writeln!(out, "{}  {} ({}{by})", camera.path(), camera.model, camera.standard())?;
        for name in camera.names() {
            writeln!(out, "  device = {name:?}")?;
        }
        if let Some(why) = &camera.unusable {
            writeln!(out, "  cannot be used: {why}")?;
        }
        let readable = camera.readable();
        for format in &readable {
            writeln!(out, "  format = {format:?}")?;
        }
        let unread: Vec<&str> =
            camera.formats.iter().filter(|name| !readable.contains(name)).map(String::as_str).collect();
        if !unread.is_empty() {
            writeln!(out, "  not read: {}", unread.join(", "))?;
        }
    }
    for Listed { node, formats } in cameras {
        writeln!(out, "{}  {} ({}, {})", node.path.display(), node.card, node.driver, node.bus)?;
        for link in &node.by_id {
            writeln!(out, "  device = \"{}\"", link.display())?;
        }
        if let Some(serial) = &node.usb_serial {
            writeln!(out, "  device = \"usb:{serial}\"")?;
        }
        if !node.card.is_empty() {
            writeln!(out, "  device = \"card:{}\"", node.card)?;
        }
        if let Some(why) = &node.unusable {
            writeln!(out, "  cannot be used: {why}")?;
        }
        let unread: Vec<&str> = formats.iter().filter(|f| !f.readable).map(|f| f.format.as_str()).collect();
        for format in formats.iter().filter(|format| format.readable) {
            let worth = if format.recompressed { ", for viewing only" } else { "" };
            writeln!(out, "  format = \"{}\"  {}{worth}", format.format, format.description)?;
            for size in &format.sizes {
                let mut rates = size.rates_hz.clone();
                rates.sort_by(f64::total_cmp);
                let rates: Vec<String> = rates.iter().map(|rate| format!("{rate:.4}")).collect();
                let rates: Vec<&str> =
                    rates.iter().map(|rate| rate.trim_end_matches('0').trim_end_matches('.')).collect();
                let rates = if rates.is_empty() { String::new() } else { format!("  {} Hz", rates.join(", ")) };
                writeln!(out, "    {size}{rates}")?;
            }
        }
        if !unread.is_empty() {
            writeln!(out, "  not read: {}", unread.join(", "))?;
        }
    }
    Ok(out)
}

fn controls_text<C: Shown>(controls: &Controls<C>) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "{}, as in [bench.camera.controls]:", controls.device)?;
    let rows: Vec<_> = controls.controls.iter().map(Shown::shown).collect();
    let width = rows.iter().map(|(key, ..)| key.len()).max().unwrap_or(0);
    for (key, value, choices, locked) in rows {
        let value = value.unwrap_or_else(|| "-".to_owned());
        let locked = locked.map_or_else(String::new, |why| format!("  ({why})"));
        writeln!(out, "  {key:<width$} = {value:<20}  {choices}{locked}")?;
    }
    if controls.controls.is_empty() {
        writeln!(out, "  it has none")?;
    }
    for note in &controls.notes {
        writeln!(out, "{note}")?;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ControlValue;
    use crate::device::camera::offer::Size;

    #[test]
    fn a_feature_is_shown_as_it_is_configured() {
        let feature = |key: &str, value, choices: &str, locked: Option<&str>| Feature {
            key: key.to_owned(),
            kind: "Float",
            value: Some(value),
            minimum: None,
            maximum: None,
            step: None,
            items: Vec::new(),
            unit: None,
            locked: locked.map(str::to_owned),
            choices: choices.to_owned(),
        };
        let controls = vec![
            feature("Gain", ControlValue::Real(1.5), "0 to 24 dB", None),
            feature("PixelFormat", ControlValue::Item("Mono8".to_owned()), "Mono8, Mono12p", Some("read-only")),
        ];
        let text = controls_text(&Controls { device: "serial:B2".to_owned(), controls, notes: Vec::new() }).unwrap();
        let lines = [
            "serial:B2, as in [bench.camera.controls]:",
            "  Gain        = 1.5                   0 to 24 dB",
            "  PixelFormat = \"Mono8\"               Mono8, Mono12p  (read-only)",
        ];
        assert_eq!(text.lines().collect::<Vec<_>>(), lines);
    }

    #[test]
    fn a_camera_is_shown_with_every_way_to_name_it() {
        let node = Node {
            path: "/dev/video2".into(),
            by_id: vec!["/dev/v4l/by-id/usb-Mono-index0".into()],
            card: "Mono".to_owned(),
            driver: "uvcvideo".to_owned(),
            bus: "usb-1".to_owned(),
            usb_serial: Some("A1".to_owned()),
            unusable: None,
        };
        let format = |name: &str, readable| Offer {
            format: name.to_owned(),
            description: "of the driver".to_owned(),
            readable,
            recompressed: name == "MJPG",
            sizes: vec![Size { least_px: [640, 480], most_px: [640, 480], step_px: [0, 0], rates_hz: vec![30.0, 7.5] }],
        };
        let formats = vec![format("Y12", true), format("MJPG", true), format("H264", false)];
        let network = FoundCamera {
            way: Way::Network { address: std::net::Ipv4Addr::new(10, 0, 0, 5), interface: "eth1".to_owned() },
            model: "Maker Mono".to_owned(),
            serial: Some("B2".to_owned()),
            user_name: None,
            formats: vec!["Mono12p".to_owned(), "RGB8".to_owned()],
            unusable: None,
        };
        let way = Way::Usb {
            file: "/dev/bus/usb/002/005".into(),
            product: "2676:ba02".to_owned(),
            carried_mbit_per_s: Some(3200),
        };
        let usb = FoundCamera { way, serial: Some("C3".to_owned()), ..network.clone() };
        let cameras = Cameras { cameras: vec![Listed { node, formats }], network: vec![network], usb: vec![usb] };
        let text = cameras_text(&cameras).unwrap();
        for line in [
            "/dev/video2  Mono (uvcvideo, usb-1)",
            "  device = \"/dev/v4l/by-id/usb-Mono-index0\"",
            "  device = \"usb:A1\"",
            "  device = \"card:Mono\"",
            "  format = \"Y12\"  of the driver",
            "    640x480  7.5, 30 Hz",
            "  format = \"MJPG\"  of the driver, for viewing only",
            "  not read: H264",
            "10.0.0.5  Maker Mono (GigE Vision, eth1)",
            "  device = \"serial:B2\"",
            "  device = \"10.0.0.5\"",
            "  format = \"Mono12p\"",
            "  not read: RGB8",
            "/dev/bus/usb/002/005  Maker Mono (USB3 Vision, 3200 Mbit/s of frames)",
            "  device = \"serial:C3\"",
            "  device = \"usb:2676:ba02\"",
        ] {
            assert!(text.lines().any(|shown| shown == line), "{line}\n{text}");
        }
        assert_eq!(
            cameras_text(&Cameras { cameras: vec![], network: vec![], usb: vec![] }).unwrap(),
            "no video device is connected\n"
        );
    }
}
