//! What a service manager is told: that the daemon serves, that it still makes progress, that it ends.
//!
//! The watchdog is fed only after a request has gone the whole way through the router and the service's own watchers have
//! shown a sign of life: a runtime that is stuck starves it, and the manager starts the daemon anew.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use sd_notify::NotifyState;
use tokio::task::JoinHandle;
use tower::ServiceExt as _;

use crate::control::Service;

/// Longest wait for a sign of progress.
const PROGRESS: Duration = Duration::from_secs(2);

/// Says that the daemon serves, and feeds the manager's watchdog, where there is one, while it makes progress.
pub(super) fn serving(service: &Arc<Service>, router: axum::Router) -> Option<JoinHandle<()>> {
    notify(&[NotifyState::Ready]);
    let allowed = sd_notify::watchdog_enabled()?;
    let service = Arc::clone(service);
    Some(tokio::spawn(async move {
        let mut tick = tokio::time::interval(allowed / 3);
        loop {
            tick.tick().await;
            if progresses(&service, &router).await {
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

async fn progresses(service: &Arc<Service>, router: &axum::Router) -> bool {
    let answered = async {
        let Ok(request) = Request::get("/healthz").header("host", "localhost").body(Body::empty()) else {
            return false;
        };
        let answer = router.clone().oneshot(request).await;
        let answered = answer.is_ok_and(|response| response.status().is_success());
        answered && service.shows_life().await
    };
    tokio::time::timeout(PROGRESS, answered).await == Ok(true)
}

fn notify(state: &[NotifyState]) {
    // Where no manager listens there is nothing to be told.
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!(%error, "the service manager could not be told");
    }
}
