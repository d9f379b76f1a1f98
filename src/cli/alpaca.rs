//! The Alpaca facade beside the daemon's own server.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use tokio::net::{TcpListener, UdpSocket};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::listen::bind;
use crate::access::Gate;
use crate::alpaca::{Alpaca, DISCOVERY_PORT, IN_RESERVE, UniqueIds, answer_searches};
use crate::api::server::Connections;
use crate::config::AlpacaConfig;
use crate::control::Service;

/// The port taken, and the devices' identities: what can fail has been done.
pub(super) struct Prepared {
    listener: TcpListener,
    address: SocketAddr,
    ids: UniqueIds,
    discovery: bool,
}

/// The facade while it is served.
pub(super) struct Serving {
    pub(super) address: SocketAddr,
    task: JoinHandle<()>,
}

impl Prepared {
    /// Takes the port, where the configuration names one. Beyond loopback only with `insecure`.
    pub(super) async fn take(config: &AlpacaConfig, state: &Path, insecure: bool) -> anyhow::Result<Option<Self>> {
        let Some(address) = config.address() else { return Ok(None) };
        if !address.ip().is_loopback() {
            if !insecure {
                bail!(
                    "alpaca.listen: {address} can be reached from other machines, and Alpaca knows neither tokens nor TLS: \
                     use 127.0.0.1:{}; --insecure serves it there, for whoever is on the network to move the axes",
                    address.port()
                );
            }
            tracing::warn!(%address, "INSECURE: whoever is on the network may move the axes by Alpaca");
            eprintln!("plenalign: INSECURE: whoever reaches {address} may move the axes by Alpaca, without a token");
        }
        let listener = bind(&config.listen).await.context("alpaca.listen")?;
        let address = listener.local_addr()?;
        Ok(Some(Self { listener, address, ids: UniqueIds::open(state)?, discovery: config.discovery }))
    }

    /// Serves until `closing`, beside the daemon's own connections.
    pub(super) async fn serve(
        self,
        service: Arc<Service>,
        gate: Arc<Gate>,
        connections: &Connections,
        closing: CancellationToken,
    ) -> Serving {
        let address = self.address;
        if gate.demands() {
            tracing::warn!(%address, "a token is demanded of everybody but of Alpaca clients, who have none");
        }
        if self.discovery {
            match UdpSocket::bind((Ipv4Addr::UNSPECIFIED, DISCOVERY_PORT)).await {
                Ok(socket) => {
                    let rate = gate.settings().requests_per_s;
                    let searches = answer_searches(socket, address.port(), address.ip().is_loopback(), rate);
                    tokio::spawn(closing.clone().run_until_cancelled_owned(searches));
                }
                Err(error) => {
                    tracing::warn!(%error, port = DISCOVERY_PORT, "alpaca.discovery: clients have to be told the address");
                }
            }
        }
        let router = Alpaca::new(service, gate, address, self.ids).router();
        let task = tokio::spawn(connections.without_tls().serve(self.listener, router, IN_RESERVE, closing));
        tracing::info!(%address, "serving Alpaca");
        Serving { address, task }
    }
}

impl Serving {
    /// Waits for the end of the last connection.
    pub(super) async fn end(self) {
        let _ = self.task.await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn take(listen: &str, insecure: bool) -> anyhow::Result<Option<Prepared>> {
        let state = tempfile::tempdir()?;
        let config = AlpacaConfig { listen: listen.to_owned(), ..AlpacaConfig::default() };
        Prepared::take(&config, state.path(), insecure).await
    }

    #[tokio::test]
    async fn it_is_off_unless_asked_for_and_stays_on_this_machine_unless_insisted() {
        assert!(take("", false).await.unwrap().is_none());
        let near = take("127.0.0.1:0", false).await.unwrap().unwrap();
        assert!(near.address.ip().is_loopback() && near.address.port() != 0);
        for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:11111"] {
            let refused = format!("{:#}", take(address, false).await.err().unwrap());
            for words in ["alpaca.listen", "127.0.0.1", "--insecure"] {
                assert!(refused.contains(words), "{refused}");
            }
        }
        assert!(take("0.0.0.0:0", true).await.unwrap().is_some());
        let taken = take(&near.address.to_string(), false).await.err().unwrap();
        assert!(format!("{taken:#}").contains("taken by another program"), "{taken:#}");
    }
}
