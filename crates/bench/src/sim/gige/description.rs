//! The camera's description of itself: its features, by the names of the SFNC, and the registers behind them.

use super::settings::Identity;

/// What does not differ from one simulated camera to another.
const TEMPLATE: &str = include_str!("description.xml");
/// Where the formats go.
const FORMATS: &str = "<!-- formats -->";

/// The description of a camera.
pub(super) struct Description(String);

impl Description {
    /// The description of this one.
    pub(super) fn of(identity: &Identity) -> Self {
        let entry = |name: &str, code: u32| {
            format!("<EnumEntry Name=\"{name}\" NameSpace=\"Standard\"><Value>{code}</Value></EnumEntry>")
        };
        let entries: String = identity.formats.iter().map(|format| entry(format.name, format.code)).collect();
        Self(TEMPLATE.replace(FORMATS, &entries))
    }

    /// Its bytes, up to a whole register.
    pub(super) fn bytes(self) -> Vec<u8> {
        let mut bytes = self.0.into_bytes();
        bytes.resize(bytes.len().next_multiple_of(4), b'\n');
        bytes
    }
}
