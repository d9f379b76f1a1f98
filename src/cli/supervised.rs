//! What a service manager is told: that the daemon serves, that it still makes progress, that it ends.
//!
//! The watchdog is fed only after a request has gone the whole way through the router and the service's own watchers have
//! shown a sign of life: a runtime that is stuck starves it, and the manager starts the daemon anew.

use std::sync::Arc;
use std::time::Duration;

use sd_notify::NotifyState;
use tokio::task::JoinHandle;

use crate::api::Api;
use crate::control::Service;

/// Longest wait for a sign of progress.
const PROGRESS: Duration = Duration::from_secs(2);

/// Says that the daemon serves, and feeds the manager's watchdog, where there is one, while it makes progress.
pub(super) fn serving(service: &Arc<Service>, api: &Api) -> Option<JoinHandle<()>> {
    notify(&[NotifyState::Ready]);
    let allowed = sd_notify::watchdog_enabled()?;
    let (service, api) = (Arc::clone(service), api.clone());
    Some(tokio::spawn(async move {
        let mut tick = tokio::time::interval(allowed / 3);
        loop {
            tick.tick().await;
            if progresses(&service, &api).await {
                notify(&[NotifyState::Watchdog]);
            } else {
                tracing::error!("no progress within {PROGRESS:?}: the watchdog is not fed");
            }
        }
    }))
}

/// Says that the daemon is ending.
pub(super) fn stopping() {
    notify(&[NotifyState::Stopping]);
}

async fn progresses(service: &Service, api: &Api) -> bool {
    let alive = async { api.answers().await && service.shows_life().await };
    tokio::time::timeout(PROGRESS, alive).await == Ok(true)
}

fn notify(state: &[NotifyState]) {
    // Where no manager listens there is nothing to be told.
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!(%error, "the service manager could not be told");
    }
}
