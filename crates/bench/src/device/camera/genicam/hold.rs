//! Whether this program still has control of its camera. One on the network that another program has taken may send frames on,
//! but not those that were asked for. One on USB nobody can take: the kernel gives it to one program at a time.

use std::time::{Duration, Instant};

use viva_genicam::genapi::RegisterIo as _;
use viva_genicam::gige::consts;
use viva_genicam::u3v::registers::abrm;
use viva_genicam::{ControlState, GigeRegisterIo};

use super::features;
use super::transport::{Device, Transport};

/// How often it is asked: well within the usual heartbeat of 3 s, after which a camera lets go.
const ASK_EVERY: Duration = Duration::from_secs(1);
/// Where a camera says what it can do, and the bit of it for telling which program has control.
const ABILITIES: u64 = 0x0934;
const NAMES_CONTROLLER: u32 = 1 << 27;
/// What a program writes that wants control.
const CONTROL: u32 = 2;

/// What is said where nobody has control any more.
const LET_GO: &str = "it let go of this program: it was restarted, or heard nothing of this program for too long";
/// What is said where another has.
const TAKEN: &str = "another program took control of it";

/// This program's control of an open camera.
pub(super) struct Hold {
    /// Whether the camera says which program has control.
    names_controller: bool,
    asked_at: Instant,
    /// Whether it did not answer when it was asked last.
    silent: bool,
}

impl Hold {
    /// Of a camera that was just opened.
    pub(super) fn of(device: &Device) -> Self {
        let names_controller = match device.transport() {
            Transport::Gige(gige) => word(gige, ABILITIES).is_ok_and(|abilities| abilities & NAMES_CONTROLLER != 0),
            Transport::Usb(_) => false,
        };
        Self { names_controller, asked_at: Instant::now(), silent: false }
    }

    /// Whether the camera did not answer when it was asked last.
    pub(super) const fn is_silent(&self) -> bool {
        self.silent
    }

    /// Asks from time to time whether the camera is still this program's own.
    ///
    /// # Errors
    /// Why it is not, or that it does not answer, in words.
    pub(super) fn check(&mut self, device: &Device) -> Result<(), String> {
        match device.transport() {
            Transport::Gige(gige) if gige.control_state() != ControlState::Held => return Err(self.lost(gige)),
            Transport::Usb(usb) if usb.is_lost() => {
                self.silent = true;
                return Err(features::UNPLUGGED.to_owned());
            }
            Transport::Gige(_) | Transport::Usb(_) => {}
        }
        if self.asked_at.elapsed() < ASK_EVERY {
            return Ok(());
        }
        self.ask(device)
    }

    /// Asks at once.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub(super) fn ask(&mut self, device: &Device) -> Result<(), String> {
        self.asked_at = Instant::now();
        match device.transport() {
            Transport::Gige(gige) => self.ask_network(gige),
            Transport::Usb(usb) => {
                let answer = usb.read(abrm::GENCP_VERSION, 4);
                self.silent = answer.is_err();
                answer.map(|_| ()).map_err(|error| features::why(&error))
            }
        }
    }

    fn ask_network(&mut self, gige: &GigeRegisterIo) -> Result<(), String> {
        match gige.refresh_control_state() {
            Ok(ControlState::Held) => self.silent = false,
            Ok(_) => return Err(self.lost(gige)),
            Err(error) => {
                self.silent = true;
                return Err(features::why(&error));
            }
        }
        if !self.names_controller
            // Whoever has control may ask for it again, and nobody else may: the camera's state tells no more than that
            // somebody has it.
            && let Err(error) = gige.write(consts::CONTROL_CHANNEL_PRIVILEGE, &CONTROL.to_be_bytes())
        {
            let held = gige.control_state() == ControlState::Held;
            return Err(if held { features::why(&error) } else { self.lost(gige) });
        }
        Ok(())
    }

    /// Who has the camera now.
    fn lost(&mut self, gige: &GigeRegisterIo) -> String {
        match word(gige, consts::CONTROL_CHANNEL_PRIVILEGE) {
            Ok(privilege) if privilege & consts::CCP_CONTROLLER_BITS == 0 => LET_GO.to_owned(),
            Ok(_) => TAKEN.to_owned(),
            Err(why) if why == features::CONTROLLED => TAKEN.to_owned(),
            Err(_) => {
                self.silent = true;
                format!("{TAKEN}, or it was restarted")
            }
        }
    }
}

/// A register's value.
fn word(gige: &GigeRegisterIo, at: u64) -> Result<u32, String> {
    let bytes = gige.read(at, 4).map_err(|error| features::why(&error))?;
    bytes.try_into().map(u32::from_be_bytes).map_err(|_| "no register".to_owned())
}
