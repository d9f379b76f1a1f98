//! What was found on the machine, as data: the checks look at nothing else.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use jiff::Timestamp;

use crate::config::{Config, ConfigError, ControllerConfig};
use crate::device::camera::find::Node;
use crate::device::camera::genicam::found::FoundCamera;
use crate::device::camera::offer::Offer;
use crate::device::connected::ConnectedPort;
use crate::store::Inspection;

/// Everything that was found.
#[derive(Debug)]
pub(super) struct Facts {
    pub(super) system: SystemFacts,
    /// Who runs this command.
    pub(super) user: Account,
    /// The user that the service runs as, where there is one.
    pub(super) service: Option<Account>,
    pub(super) configuration: ConfigurationFacts,
    /// What is in the state folder; or why there is none.
    pub(super) state: Result<StateFacts, String>,
    /// Every serial port.
    pub(super) ports: Vec<PortFacts>,
    /// The controllers of the configured axes.
    pub(super) controllers: Vec<ControllerFacts>,
    /// Every video device.
    pub(super) cameras: Vec<VideoFacts>,
    /// The configured camera.
    pub(super) camera: Option<CameraSource>,
    /// The process that holds the configured bench.
    pub(super) holder: Option<Process>,
    /// Programs that are known to get hold of serial ports, while they run.
    pub(super) meddlers: Vec<Process>,
    pub(super) server: ServerFacts,
}

/// Program, machine and clock.
#[derive(Debug)]
pub(super) struct SystemFacts {
    /// Version of this program.
    pub(super) version: String,
    /// The operating system's name, such as `Debian GNU/Linux 13 (trixie)`.
    pub(super) system: String,
    /// The kernel's release.
    pub(super) kernel: String,
    /// The processor's architecture.
    pub(super) architecture: String,
    /// Whether udev runs: it makes the names that stay.
    pub(super) udev: bool,
    /// The clock.
    pub(super) now: Timestamp,
    /// Whether something keeps the clock right; `None` where nobody can say.
    pub(super) synchronised: Option<bool>,
    /// Why libjpeg-turbo is not used; `None` where it is.
    pub(super) turbo_fault: Option<String>,
}

/// A user of the machine and what it may.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Account {
    pub(super) name: String,
    pub(super) uid: u32,
    /// Groups in force, by number.
    pub(super) gids: Vec<u32>,
    /// Groups that the next login has, by number.
    pub(super) listed_gids: Vec<u32>,
}

impl Account {
    /// Whether it is the superuser, who may open everything.
    pub(super) const fn is_root(&self) -> bool {
        self.uid == 0
    }
}

/// What became of the configuration.
#[derive(Debug)]
pub(super) struct ConfigurationFacts {
    /// The file named, if one was.
    pub(super) file: Option<PathBuf>,
    /// The service's file, where it is there and is not the one named.
    pub(super) service_file: Option<PathBuf>,
    /// What is in force; or why nothing is.
    pub(super) config: Result<Config, ConfigError>,
}

impl ConfigurationFacts {
    /// The configuration in force, where there is one.
    pub(super) fn config(&self) -> Option<&Config> {
        self.config.as_ref().ok()
    }

    /// The file for a sentence.
    pub(super) fn name(&self) -> String {
        self.file.as_ref().map_or_else(|| "the configuration".to_owned(), |file| file.display().to_string())
    }
}

/// The state folder.
#[derive(Debug)]
pub(super) struct StateFacts {
    pub(super) folder: FolderFacts,
    /// The folder of recordings, where it is another one.
    pub(super) recordings: Option<FolderFacts>,
    /// The history; `None` where there is none yet.
    pub(super) history: Result<Option<Inspection>, String>,
    /// The tokens.
    pub(super) tokens: Result<TokenFacts, String>,
}

/// A folder that is written to.
#[derive(Debug)]
pub(super) struct FolderFacts {
    pub(super) path: PathBuf,
    /// What is there.
    pub(super) kind: FolderKind,
    /// The folder itself, or the nearest above it that exists.
    pub(super) nearest: PathBuf,
    /// Why it cannot be written by this user; `None` where it can.
    pub(super) unwritable: Option<String>,
    /// Whether its disk is mounted read-only.
    pub(super) read_only: bool,
    /// Room for this user, bytes; `None` where the system does not say.
    pub(super) free_bytes: Option<u64>,
}

/// What is at a folder's path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FolderKind {
    /// The folder.
    Folder,
    /// Nothing: it would be made.
    Missing,
    /// Something else.
    Other,
}

/// The tokens by which people are let in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct TokenFacts {
    pub(super) valid: usize,
    pub(super) expired: usize,
}

/// A serial port.
#[derive(Debug)]
pub(super) struct PortFacts {
    pub(super) port: ConnectedPort,
    pub(super) file: DeviceFile,
}

/// A controller of the configuration.
#[derive(Debug)]
pub(super) struct ControllerFacts {
    /// Its name.
    pub(super) name: String,
    pub(super) config: ControllerConfig,
    /// Where its port leads now; or why nowhere.
    pub(super) port: Result<DeviceFile, String>,
    /// What it says it is, where it was asked; or why it does not say.
    pub(super) identity: Option<Result<String, String>>,
}

/// A video device.
#[derive(Debug)]
pub(super) struct VideoFacts {
    pub(super) node: Node,
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    pub(super) names: Vec<String>,
    pub(super) offers: Vec<Offer>,
    pub(super) file: DeviceFile,
}

/// The configured camera.
#[derive(Debug)]
pub(super) enum CameraSource {
    /// A video device, by its path; or why there is none.
    Device(Result<PathBuf, String>),
    /// A GenICam camera; or why there is none.
    Genicam(Result<Box<GenicamFacts>, String>),
    /// How many files are played; or why none.
    Files(Result<usize, String>),
}

/// A GenICam camera and the way to it.
#[derive(Debug, Clone)]
pub(super) struct GenicamFacts {
    pub(super) camera: FoundCamera,
    pub(super) way: WayFacts,
}

/// What the way to a camera carries.
#[derive(Debug, Clone)]
pub(super) enum WayFacts {
    /// The network.
    Network(NetworkFacts),
    /// USB.
    Usb {
        /// Its device file; or why there is none.
        file: Result<DeviceFile, String>,
        /// The memory that the kernel gives all programs for what is under way, MiB; 0: as much as they want.
        memory_mib: Option<u32>,
    },
}

/// What a network carries.
#[derive(Debug, Clone)]
pub(super) struct NetworkFacts {
    /// The interface.
    pub(super) interface: String,
    /// Bytes of the largest packet that it carries.
    pub(super) mtu: Option<u32>,
    /// What it carries, Mbit/s.
    pub(super) link_mbit_per_s: Option<u32>,
    /// The largest buffer that the kernel gives a socket for what it receives, bytes.
    pub(super) most_buffer_bytes: Option<u64>,
}

/// A device file and who may open it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct DeviceFile {
    /// The file itself, every link followed.
    pub(super) path: PathBuf,
    /// Whether it is a device at all.
    pub(super) is_device: bool,
    /// Permission bits.
    pub(super) mode: u32,
    pub(super) uid: u32,
    pub(super) gid: u32,
    /// Name of its group, or its number.
    pub(super) group: String,
    /// Whether this user may read and write it, as the kernel says.
    pub(super) ours: bool,
    /// Processes that have it open, as far as this user can see.
    pub(super) open_in: Vec<Process>,
    /// The USB device that it belongs to.
    pub(super) usb: Option<UsbFacts>,
}

impl DeviceFile {
    /// Whether a user may read and write it, by its permission bits.
    pub(super) fn may_be_opened_by(&self, account: &Account) -> bool {
        self.may_be_opened(account.uid, &account.gids)
    }

    /// Whether that user could after the next login.
    pub(super) fn could_be_opened_by(&self, account: &Account) -> bool {
        self.may_be_opened(account.uid, &account.listed_gids)
    }

    fn may_be_opened(&self, uid: u32, gids: &[u32]) -> bool {
        let bits = if uid == self.uid {
            self.mode >> 6
        } else if gids.contains(&self.gid) {
            self.mode >> 3
        } else {
            self.mode
        };
        uid == 0 || bits & 0o6 == 0o6
    }
}

/// The USB device that something belongs to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct UsbFacts {
    /// Its folder in sysfs.
    pub(super) folder: PathBuf,
    /// Whether the kernel may switch it off while nobody uses it.
    pub(super) autosuspend: bool,
    /// Whether udev tells ModemManager to leave it alone.
    pub(super) modem_manager_ignores: bool,
}

impl UsbFacts {
    /// What is written to keep it on.
    pub(super) fn power_control(&self) -> PathBuf {
        self.folder.join("power/control")
    }
}

/// A process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Process {
    pub(super) pid: u32,
    /// Its name, as the kernel has it.
    pub(super) name: String,
    /// Its command line; empty where it is not to be seen.
    pub(super) command: String,
}

impl Process {
    /// For a sentence.
    pub(super) fn said(&self) -> String {
        if self.command.is_empty() {
            format!("pid {} ({})", self.pid, self.name)
        } else {
            format!("pid {} ({})", self.pid, self.command)
        }
    }

    /// Whether it is this program.
    pub(super) fn is_plenalign(&self) -> bool {
        self.name == "plenalign"
    }
}

/// Where the daemon is to serve, and what is there.
#[derive(Debug)]
pub(super) struct ServerFacts {
    /// As given.
    pub(super) listen: String,
    /// The address that it means; or why none.
    pub(super) address: Result<SocketAddr, String>,
    pub(super) port: PortState,
    /// The certificate that would be served, where there is one.
    pub(super) certificate: Option<CertificateFacts>,
    /// Files that a process of this user may have open; `None` where the system does not say.
    pub(super) open_files: Option<u64>,
}

/// What is at the port.
#[derive(Debug)]
pub(super) enum PortState {
    /// Nothing: it can be taken.
    Free,
    /// It cannot be taken, and this is why.
    Refused(String),
    /// Something listens there.
    Taken {
        /// Where it was asked.
        url: String,
        /// What it says of itself; or why that is no daemon's answer.
        daemon: Result<DaemonFacts, String>,
    },
}

/// A daemon that answers.
#[derive(Debug)]
pub(super) struct DaemonFacts {
    pub(super) version: String,
    pub(super) simulated: bool,
    /// What keeps its bench from working; empty where nothing does.
    pub(super) hindrances: Vec<String>,
}

/// A certificate and its key.
#[derive(Debug)]
pub(super) struct CertificateFacts {
    pub(super) path: PathBuf,
    /// Whether `plenalign tls init` made it.
    pub(super) own: bool,
    /// Why it cannot be used; `None` where it can.
    pub(super) fault: Option<String>,
    /// Since when it is good.
    pub(super) from: Option<Timestamp>,
    /// Until when.
    pub(super) until: Option<Timestamp>,
}

/// A path for a shell: in quotes where it has to be.
pub(super) fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:@%,=".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_opened_by_its_owner_its_group_and_root() {
        let file = DeviceFile {
            path: "/dev/ttyUSB0".into(),
            is_device: true,
            mode: 0o660,
            uid: 0,
            gid: 20,
            group: "dialout".to_owned(),
            ours: false,
            open_in: Vec::new(),
            usb: None,
        };
        let account = |uid, gids: &[u32], listed: &[u32]| Account {
            name: "ana".to_owned(),
            uid,
            gids: gids.to_vec(),
            listed_gids: listed.to_vec(),
        };
        assert!(file.may_be_opened_by(&account(0, &[], &[])));
        assert!(file.may_be_opened_by(&account(1000, &[1000, 20], &[])));
        let ana = account(1000, &[1000], &[1000, 20]);
        assert!(!file.may_be_opened_by(&ana) && file.could_be_opened_by(&ana));
        // The owner's bits count for the owner, whatever the group's are.
        let own = DeviceFile { mode: 0o060, uid: 1000, ..file };
        assert!(!own.may_be_opened_by(&account(1000, &[20], &[])));
    }

    #[test]
    fn a_path_can_be_typed() {
        assert_eq!(quoted(Path::new("/dev/serial/by-id/usb-FTDI_A-if00")), "/dev/serial/by-id/usb-FTDI_A-if00");
        assert_eq!(quoted(Path::new("/home/a b/it's.toml")), r"'/home/a b/it'\''s.toml'");
    }
}
