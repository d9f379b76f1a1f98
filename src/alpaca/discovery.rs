//! Telling clients that look for Alpaca devices where this one is.

use serde_json::json;
use tokio::net::UdpSocket;

/// Where clients send their search, by UDP.
pub const PORT: u16 = 32_227;
/// What a search begins with: its name and version.
const SEARCH: &[u8] = b"alpacadiscovery1";
/// Rest after the system gave no datagram.
const AFTER_FAILURE: std::time::Duration = std::time::Duration::from_secs(1);

/// Answers searches with the port on which Alpaca is spoken, for ever. With `loopback_only`, those of this machine.
pub async fn answer_searches(socket: UdpSocket, alpaca_port: u16, loopback_only: bool) {
    let answer = json!({ "AlpacaPort": alpaca_port }).to_string();
    let mut buffer = [0; 64];
    loop {
        match socket.recv_from(&mut buffer).await {
            Ok((length, from)) => {
                let near = from.ip().to_canonical().is_loopback() || !loopback_only;
                if near
                    && buffer[..length].starts_with(SEARCH)
                    && let Err(error) = socket.send_to(answer.as_bytes(), from).await
                {
                    tracing::debug!(%from, %error, "a search for Alpaca devices could not be answered");
                }
            }
            Err(error) => {
                tracing::debug!(%error, "no search for Alpaca devices can be heard");
                tokio::time::sleep(AFTER_FAILURE).await;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::time::timeout;

    use super::*;

    #[tokio::test]
    async fn a_search_is_answered_and_nothing_else() {
        let near = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let at = near.local_addr().unwrap();
        tokio::spawn(answer_searches(near, 11_111, true));
        let client = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let mut buffer = [0; 64];
        for noise in [&b"alpacadiscovery"[..], b"", b"hello"] {
            client.send_to(noise, at).await.unwrap();
        }
        assert!(timeout(Duration::from_millis(200), client.recv_from(&mut buffer)).await.is_err());
        client.send_to(SEARCH, at).await.unwrap();
        let (length, from) = timeout(Duration::from_secs(5), client.recv_from(&mut buffer)).await.unwrap().unwrap();
        assert_eq!((from, &buffer[..length]), (at, &b"{\"AlpacaPort\":11111}"[..]));
    }
}
