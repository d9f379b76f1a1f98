//! Why there is no connection to the broker, in words that say what to do.

use rumqttc::TlsError;
use rumqttc::v5::mqttbytes::v5::{ConnectReturnCode, DisconnectReasonCode};
use rumqttc::v5::{ConnectionError, StateError};

/// Why a connection ended or could not be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Trouble {
    /// The word for it in the metrics.
    pub(super) word: &'static str,
    /// What happened, and what would mend it.
    pub(super) detail: String,
}

impl Trouble {
    pub(super) fn new(word: &'static str, detail: impl Into<String>) -> Self {
        Self { word, detail: detail.into() }
    }

    /// The library's word for it put into ours. `client_id` and `user` are as this daemon says them.
    pub(super) fn of(error: &ConnectionError, client_id: &str, user: &str) -> Self {
        match error {
            ConnectionError::Timeout(_) => Self::new("timeout", "the broker does not answer in time"),
            ConnectionError::Io(error) => Self::new("unreachable", format!("the broker cannot be reached: {error}")),
            ConnectionError::Tls(error) => Self::new("tls", tls(error)),
            ConnectionError::ConnectionRefused(code) => refused(*code, client_id, user),
            ConnectionError::MqttState(error) => state(error, client_id),
            ConnectionError::NotConnAck(_) => Self::new("protocol", "what answers is no broker of MQTT 5"),
            ConnectionError::RequestsDone => Self::new("lost", "the connection was given up"),
        }
    }
}

fn tls(error: &TlsError) -> String {
    let said = match error {
        TlsError::Io(error) => error.to_string(),
        error => error.to_string(),
    };
    let mend = if said.contains("UnknownIssuer") || said.contains("BadSignature") {
        "; mqtt.tls.ca names the authority that vouches for the broker"
    } else if said.contains("not valid for name") {
        "; the broker's certificate has to have the name, or the address, that mqtt.broker has"
    } else if said.contains("certificate expired") || said.contains("not valid yet") {
        "; the broker needs another certificate, or this machine's clock is wrong"
    } else if said.contains("CertificateRequired") || said.contains("HandshakeFailure") {
        "; the broker may want mqtt.tls.certificate"
    } else if said.contains("corrupt message") || said.contains("InvalidContentType") {
        "; is TLS spoken at that port?"
    } else {
        ""
    };
    format!("no TLS with the broker: {said}{mend}")
}

fn refused(code: ConnectReturnCode, client_id: &str, user: &str) -> Trouble {
    use ConnectReturnCode as Code;
    let detail = match code {
        Code::BadUserNamePassword | Code::NotAuthorized if user.is_empty() => {
            "the broker lets in nobody without a user name: mqtt.user and mqtt.password_file say who this is".to_owned()
        }
        Code::BadUserNamePassword | Code::NotAuthorized => {
            format!(
                "the broker does not let {user:?} in: user name or password is wrong (mqtt.user, mqtt.password_file)"
            )
        }
        Code::BadClientId | Code::ClientIdentifierNotValid => {
            format!("the broker does not take the client id {client_id:?}: choose another (mqtt.client_id)")
        }
        Code::RefusedProtocolVersion | Code::UnsupportedProtocolVersion => {
            "the broker does not speak MQTT 5".to_owned()
        }
        Code::RetainNotSupported => "the broker keeps no retained messages, which birth and death are".to_owned(),
        Code::QoSNotSupported => "the broker knows no QoS 1, which birth and death need".to_owned(),
        Code::TopicNameInvalid => {
            "the broker does not take the topic of the last will: see mqtt.topic_prefix".to_owned()
        }
        code => format!("the broker refuses the connection: {code:?}"),
    };
    Trouble::new("refused", detail)
}

fn state(error: &StateError, client_id: &str) -> Trouble {
    match error {
        StateError::ServerDisconnect { reason_code: DisconnectReasonCode::SessionTakenOver, .. } => Trouble::new(
            "taken_over",
            format!(
                "another program has connected with the client id {client_id:?}: give each bench a name of its own \
                     (mqtt.bench, or mqtt.client_id)"
            ),
        ),
        StateError::ServerDisconnect { reason_code, reason_string } => {
            let why = reason_string.as_ref().map_or_else(String::new, |why| format!(": {why}"));
            Trouble::new("lost", format!("the broker closed the connection: {reason_code:?}{why}"))
        }
        StateError::AwaitPingResp => Trouble::new("timeout", "the broker has fallen silent"),
        // Some brokers say no more to whom they cut off for another of the same name.
        StateError::ConnectionAborted => Trouble::new(
            "lost",
            format!(
                "the broker closed the connection without a word; where that comes again and again, another program \
                 has the client id {client_id:?} (mqtt.bench, or mqtt.client_id)"
            ),
        ),
        StateError::Io(error) => Trouble::new("lost", format!("the connection broke: {error}")),
        error => Trouble::new("protocol", format!("what the broker says cannot be used: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_to_be_mended_is_named() {
        let of = |code, user| Trouble::of(&ConnectionError::ConnectionRefused(code), "plenalign-a-b", user);
        assert!(of(ConnectReturnCode::NotAuthorized, "ada").detail.contains("mqtt.password_file"));
        assert!(of(ConnectReturnCode::NotAuthorized, "").detail.contains("nobody without a user name"));
        let taken =
            StateError::ServerDisconnect { reason_code: DisconnectReasonCode::SessionTakenOver, reason_string: None };
        let taken = Trouble::of(&ConnectionError::MqttState(taken), "plenalign-a-b", "");
        assert!(taken.word == "taken_over" && taken.detail.contains("\"plenalign-a-b\""), "{taken:?}");
        let issuer = std::io::Error::other("invalid peer certificate: UnknownIssuer");
        let tls = Trouble::of(&ConnectionError::Tls(TlsError::Io(issuer)), "", "");
        assert!(tls.word == "tls" && tls.detail.contains("mqtt.tls.ca"), "{tls:?}");
    }
}
