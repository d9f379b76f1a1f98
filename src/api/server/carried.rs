//! Requests that change something: carried to their end, whether or not their client still listens.

use std::panic::resume_unwind;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::http::{Method, Request};
use axum::response::{IntoResponse as _, Response};
use tokio_util::task::TaskTracker;
use tower::ServiceExt as _;
use tracing::Instrument as _;

use super::slots::Slot;
use crate::api::error::Problem;

/// Whether a request only reads.
const fn only_reads(method: &Method) -> bool {
    matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS)
}

/// What carries a connection's requests out.
///
/// When a client hangs up, hyper drops what answers it at whatever it waits for. What has been begun by then goes on
/// all the same, and would be in no audit log. So whatever does not only read runs in a task of its own. That keeps the
/// connection's place: there are no more such tasks than there are places, since a connection has one request in work
/// at a time. A body that has not come by then never does, which ends the task.
#[derive(Clone)]
pub(super) struct Carrier {
    pub(super) router: Router,
    pub(super) slot: Arc<Slot>,
    /// Those that are waited for, for a while, when the server ends.
    pub(super) tasks: TaskTracker,
}

impl Carrier {
    /// Has the router answer.
    pub(super) async fn answer(self, request: Request<Body>) -> Response {
        let reads = only_reads(request.method());
        let Self { router, slot, tasks } = self;
        let answer = async move {
            let answered = router.oneshot(request).await;
            drop(slot);
            answered.unwrap_or_else(|never| match never {})
        };
        if reads {
            return answer.await;
        }
        match tasks.spawn(answer.in_current_span()).await {
            Ok(response) => response,
            // Beyond what the router catches: it ends the connection, as it would without a task between.
            Err(error) => match error.try_into_panic() {
                Ok(panic) => resume_unwind(panic),
                Err(_) => Problem::internal().into_response(),
            },
        }
    }
}
