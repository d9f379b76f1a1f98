//! Telling clients that look for Alpaca devices where this one is.

use serde_json::json;
use tokio::net::UdpSocket;

use crate::access::Buckets;

/// Where clients send their search, by UDP.
pub const PORT: u16 = 32_227;
/// What a search begins with: its name and version.
const SEARCH: &[u8] = b"alpacadiscovery1";
/// Rest after the system gave no datagram.
const AFTER_FAILURE: std::time::Duration = std::time::Duration::from_secs(1);

/// How many times a second's answers an address may have at once.
const BURST_SECONDS: f64 = 4.0;

/// Answers searches with the port on which Alpaca is spoken, for ever: `per_second` of each address, in the long run.
/// With `loopback_only`, those of this machine.
pub async fn answer_searches(socket: UdpSocket, alpaca_port: u16, loopback_only: bool, per_second: f64) {
    // Its own: a datagram's sender may be made up, and must not use up what another may ask over its connections.
    let rates = Buckets::new(per_second, per_second * BURST_SECONDS);
    let answer = json!({ "AlpacaPort": alpaca_port }).to_string();
    let mut buffer = [0; 64];
    loop {
        match socket.recv_from(&mut buffer).await {
            Ok((length, from)) => {
                let near = from.ip().to_canonical().is_loopback() || !loopback_only;
                if near
                    && buffer[..length].starts_with(SEARCH)
                    && rates.take(&from.ip()).is_ok()
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
        tokio::spawn(answer_searches(near, 11_111, true, 100.0));
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
    #[tokio::test]
    async fn a_flood_of_searches_gets_no_more_answers_than_an_address_may_have() {
        let near = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let at = near.local_addr().unwrap();
        tokio::spawn(answer_searches(near, 11_111, true, 1.0 / BURST_SECONDS));
        let client = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let mut buffer = [0; 64];
        let other = UdpSocket::bind("127.0.0.2:0").await.unwrap();
        for _ in 0..20 {
            client.send_to(SEARCH, at).await.unwrap();
        }
        other.send_to(SEARCH, at).await.unwrap();
        timeout(Duration::from_secs(5), other.recv_from(&mut buffer)).await.unwrap().unwrap();
        let mut answers = 0;
        while client.try_recv(&mut buffer).is_ok() {
            answers += 1;
        }
        assert_eq!(answers, 1);
    }
}
