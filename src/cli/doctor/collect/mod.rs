//! Looking at the machine. Nothing is written, no serial port is opened unless that is asked for, and nothing is sent to
//! a device but, then, the question what it is.

mod accounts;
mod devices;
mod processes;
mod server;
mod state;
mod system;

use std::path::{Path, PathBuf};

use super::facts::{ConfigurationFacts, ControllerFacts, Facts};
use crate::config::{BenchDriver, Config};
use crate::device::open::identify;

/// The service's configuration file.
const SERVICE_FILE: &str = "/etc/plenalign/plenalign.toml";
/// The service's user.
const SERVICE_USER: &str = "plenalign";

/// What is to be looked at.
pub(super) struct Wanted<'a> {
    /// The configuration file, if one is named.
    pub(super) file: Option<&'a Path>,
    /// Keys that are set on the command line.
    pub(super) set: &'a [String],
    /// Where the daemon is to serve.
    pub(super) listen: &'a str,
    /// Whether the configured controllers are asked what they are.
    pub(super) identify: bool,
}

/// Looks at everything.
pub(super) async fn facts(wanted: Wanted<'_>) -> Facts {
    let configuration = configuration(wanted.file, wanted.set);
    let config = configuration.config().cloned();
    let holder = config.as_ref().and_then(|config| processes::bench_holder(&config.bench));
    let open_files = processes::open_devices();
    let ports = devices::ports(&open_files);
    let mut controllers = config.as_ref().map(|config| devices::controllers(config, &open_files)).unwrap_or_default();
    if wanted.identify {
        let held = holder.as_ref().map(|holder| format!("not asked: {} has the bench", holder.said()));
        for controller in &mut controllers {
            ask(controller, held.as_deref()).await;
        }
    }
    let state = state::state(config.as_ref());
    Facts {
        system: system::system(),
        user: accounts::of_this_process(),
        service: accounts::of_service(SERVICE_USER),
        ports,
        controllers,
        cameras: devices::cameras(&open_files),
        camera: config.as_ref().and_then(|config| devices::camera_source(config, &open_files)),
        holder,
        meddlers: processes::meddlers(),
        server: server::server(wanted.listen, config.as_ref()).await,
        state,
        configuration,
    }
}

/// Asks a controller what it is; not while another process has the bench.
async fn ask(controller: &mut ControllerFacts, held: Option<&str>) {
    let Ok(file) = &controller.port else { return };
    controller.identity = Some(match (held, file.open_in.first()) {
        (Some(why), _) => Err(why.to_owned()),
        (None, Some(process)) => Err(format!("not asked: {} has its port", process.said())),
        (None, None) => identify(&controller.name, &controller.config).await.map_err(|error| error.to_string()),
    });
}

fn configuration(file: Option<&Path>, set: &[String]) -> ConfigurationFacts {
    let service_file = PathBuf::from(SERVICE_FILE);
    let is_named = file.is_some_and(|file| file == service_file);
    ConfigurationFacts {
        file: file.map(Path::to_owned),
        service_file: (!is_named && service_file.exists()).then_some(service_file),
        config: Config::open(file, set).map(|(config, _)| config),
    }
}

/// Whether the bench is real.
fn is_hardware(config: &Config) -> bool {
    config.bench.driver == BenchDriver::Hardware
}
