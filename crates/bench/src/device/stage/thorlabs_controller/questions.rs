//! Exchanges with a controller's units: questions whose answers can be told apart, and commands that a question follows.

use super::{Axis, ThorlabsDialogue, state_question};
use crate::device::DeviceError;
use crate::device::stage::thorlabs::status::Bits;
use crate::device::stage::thorlabs::{CHANNEL, MAIN_BOARD, Message, id};

/// The last question, and the unit that it was put to.
///
/// An answer names its question, and not which time it was asked: one that comes late or twice would be taken for the
/// next to the same question. So no two questions of the same kind to the same unit are neighbours: the answer to the
/// one between comes after every answer to the first, of the same unit; what the main board answers says nothing of its
/// bays. Whoever asks holds this meanwhile.
#[derive(Debug, Default)]
pub(super) struct Turn {
    last: Option<(u16, u8)>,
}

/// A question as bytes. To a servo's unit it is said with it that the host is still there: one that believes it gone
/// answers no more.
fn asking(question: u16, unit: u8, subject: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    if question == id::REQ_SERVO {
        bytes.extend(Message::short(id::STILL_THERE, unit, 0, 0).bytes());
    }
    bytes.extend(Message::short(question, unit, subject, 0).bytes());
    bytes
}

/// A question of another kind.
const fn other_than(question: u16) -> u16 {
    if question == id::REQ_BITS { id::REQ_POSITION } else { id::REQ_BITS }
}

impl ThorlabsDialogue {
    /// Asks a unit, once more if no answer came.
    pub(super) async fn ask(
        &self,
        turn: &mut Turn,
        unit: u8,
        what: &str,
        question: u16,
        subject: u8,
    ) -> Result<Message, DeviceError> {
        self.apart(turn, unit, question).await?;
        // The main board has no channel, and brings the port back into step itself.
        let between = (unit != MAIN_BOARD).then(|| asking(other_than(question), unit, CHANNEL));
        let answer = self.exchange.ask_again(what, asking(question, unit, subject), between).await?;
        answer.lines.into_iter().next_back().ok_or_else(|| self.exchange.senseless("an answer without a message"))
    }

    /// Sees to it that a question is not the neighbour of one of its kind.
    async fn apart(&self, turn: &mut Turn, unit: u8, question: u16) -> Result<(), DeviceError> {
        if turn.last == Some((question, unit)) {
            let other = other_than(question);
            // Before it is written: dropped from here on, it is written all the same.
            turn.last = Some((other, unit));
            self.exchange.ask("answer", asking(other, unit, CHANNEL)).await?;
        }
        turn.last = Some((question, unit));
        Ok(())
    }

    /// Commands, and asks something behind it in the same breath: a command alone is not answered. Sent once.
    pub(super) async fn command(
        &self,
        turn: &mut Turn,
        what: &str,
        commands: &[Message],
        (question, unit): (u16, u8),
        generation: u64,
    ) -> Result<Message, DeviceError> {
        self.apart(turn, unit, question).await?;
        let mut bytes: Vec<u8> = commands.iter().flat_map(Message::bytes).collect();
        bytes.extend(asking(question, unit, CHANNEL));
        let answer = self.exchange.command(what, bytes, generation).await?;
        answer.lines.into_iter().next_back().ok_or_else(|| self.exchange.senseless("an answer without a message"))
    }

    /// Commands, and asks for the position behind it: a question that has no other use, and so no like neighbour.
    pub(super) async fn tell(
        &self,
        turn: &mut Turn,
        unit: u8,
        what: &str,
        command: Message,
        generation: u64,
    ) -> Result<(), DeviceError> {
        self.command(turn, what, &[command], (id::REQ_POSITION, unit), generation).await.map(drop)
    }

    /// Asks for position and status at once.
    pub(super) async fn state(&self, turn: &mut Turn, unit: u8) -> Result<(i32, Bits), DeviceError> {
        let question = state_question(self.model.motor);
        let answer = self.ask(turn, unit, "tell its state", question, CHANNEL).await?;
        let (Some(position), Some(bits)) = (answer.long(2), answer.long(10)) else {
            return Err(self.exchange.senseless("a state that is too short"));
        };
        Ok((position, Bits(bits as u32)))
    }

    async fn bits(&self, turn: &mut Turn, unit: u8) -> Result<Bits, DeviceError> {
        let answer = self.ask(turn, unit, "tell its status", id::REQ_BITS, CHANNEL).await?;
        let bits = answer.long(2).ok_or_else(|| self.exchange.senseless("status bits that are too short"))?;
        Ok(Bits(bits as u32))
    }

    /// Position and status, asked for in two ways: there is no checksum, and a state out of whose midst a byte was lost,
    /// made whole by what came next, shows by a status that is another's. Where it stands is asked last, and so is as new
    /// as can be.
    pub(super) async fn whole(&self, turn: &mut Turn, unit: u8) -> Result<(i32, Bits), DeviceError> {
        let mut tries = 2;
        loop {
            tries -= 1;
            let before = self.bits(turn, unit).await?;
            let (position, bits) = self.state(turn, unit).await?;
            if bits.steady() == before.steady() {
                return Ok((position, bits));
            }
            if tries == 0 {
                let said = format!("status {:#010x} and {:#010x} of the same moment", before.0, bits.0);
                return Err(self.exchange.senseless(said));
            }
        }
    }

    /// Sets speed and acceleration, and commands what is to be done with them, in the same breath: told a moment later, an
    /// axis on its way might brake already. Reads them back. They are lost when the power is.
    pub(super) async fn at_speed(
        &self,
        turn: &mut Turn,
        axis: &Axis,
        speed: f64,
        command: Message,
        generation: u64,
    ) -> Result<(), DeviceError> {
        let motor = self.model.motor;
        let acceleration = motor.acceleration(axis.facts.acceleration_mm_per_s2, axis.scale);
        let wanted = [acceleration, motor.speed(speed, axis.scale)]
            .map(|number| number.round().clamp(1.0, f64::from(i32::MAX)) as i32);
        let set = Message::numbers(id::SET_SPEED, axis.unit, &[0, wanted[0], wanted[1]]);
        let asked = (id::REQ_SPEED, axis.unit);
        let answer = self.command(turn, "take a speed", &[set, command], asked, generation).await;
        let answer = answer.map_err(|error| match error {
            // Refused, the speed; what was told with it may have begun.
            DeviceError::Refused { reason, .. } => self.exchange.senseless(format!("a refusal of a speed: {reason}")),
            other => other,
        })?;
        for (name, at, wanted) in [("acceleration", 6, wanted[0]), ("speed", 10, wanted[1])] {
            let taken = answer.long(at).unwrap_or_default();
            if (f64::from(taken) - f64::from(wanted)).abs() > 0.01 * f64::from(wanted) + 1.0 {
                let detail = format!("told {wanted} as its {name}, it has {taken}");
                return Err(self.exchange.senseless(detail));
            }
        }
        Ok(())
    }
}
