//! What each route needs: the one table of it. The contract's `security` is made from it, and a route that is not in
//! it is refused to everybody; a test names such a route.

use axum::http::Method;

use crate::access::Scope;
use crate::api::server::InReserve;

/// What a route needs of who asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::api) enum Need {
    /// Nothing.
    Nothing,
    /// At least this scope.
    AtLeast(Scope),
}

const NOTHING: Need = Need::Nothing;
const VIEW: Need = Need::AtLeast(Scope::View);
const CONTROL: Need = Need::AtLeast(Scope::Control);
const ADMIN: Need = Need::AtLeast(Scope::Admin);

/// The stop: whoever may see the bench may stop it, however often, and when there is room for nothing else.
pub(in crate::api) const STOP: (&str, &str) = ("POST", "/api/v1/stop");

/// What the API still serves where there is room for nothing else.
pub const IN_RESERVE: InReserve = InReserve {
    is_served: |method, path| (method.as_str(), path) == STOP,
    words: "a stop still gets through here: POST /api/v1/stop",
};

/// Measuring a frame, which whoever may look may do, so often that it does not fill the history.
const MEASURE: (&str, &str) = ("POST", "/api/v1/measurements");

/// Working out a draft of a camera, which is arithmetic.
const DRAFT: (&str, &str) = ("POST", "/api/v1/design");
const PLAN: (&str, &str) = ("POST", "/api/v1/plan");

/// What is made to go wrong with the simulated bench.
const FAULTS: &str = "/api/v1/simulation/faults";
const FAULT_PLAN: &str = "/api/v1/simulation/fault-plan";

/// Method and path of every route. HEAD needs what GET does.
const TABLE: &[(&str, &str, Need)] = &[
    ("GET", "/healthz", NOTHING),
    ("GET", "/readyz", NOTHING),
    ("GET", "/metrics", VIEW),
    ("GET", "/api/v1/docs", NOTHING),
    ("POST", "/api/v1/session", NOTHING),
    ("GET", "/api/v1/session", VIEW),
    ("DELETE", "/api/v1/session", VIEW),
    (STOP.0, STOP.1, VIEW),
    ("GET", "/api/v1/stop", VIEW),
    ("DELETE", "/api/v1/stop", CONTROL),
    ("POST", "/api/v1/tickets", VIEW),
    ("GET", "/api/v1/ws", VIEW),
    ("GET", "/api/v1/frame.png", VIEW),
    ("GET", "/api/v1/snapshot.jpg", VIEW),
    ("GET", "/api/v1/stream.mjpg", VIEW),
    ("GET", "/api/v1/view", VIEW),
    ("GET", "/api/v1/view.jpg", VIEW),
    ("GET", "/api/v1/view.png", VIEW),
    ("GET", "/api/v1/bench", VIEW),
    ("PUT", "/api/v1/shell", CONTROL),
    ("POST", "/api/v1/axes/{axis}/move", CONTROL),
    ("POST", "/api/v1/axes/{axis}/home", CONTROL),
    ("POST", "/api/v1/axes/{axis}/leave-switch", CONTROL),
    ("POST", "/api/v1/axes/{axis}/jog", CONTROL),
    ("DELETE", "/api/v1/axes/{axis}/jog", CONTROL),
    ("GET", "/api/v1/camera/controls", VIEW),
    ("PUT", "/api/v1/camera/controls/{control}", CONTROL),
    ("POST", "/api/v1/camera/auto-exposure", CONTROL),
    ("GET", "/api/v1/camera/histogram", VIEW),
    ("GET", "/api/v1/lease", VIEW),
    ("POST", "/api/v1/lease", CONTROL),
    ("DELETE", "/api/v1/lease", CONTROL),
    ("POST", "/api/v1/lease/heartbeat", CONTROL),
    ("POST", "/api/v1/lease/takeover", ADMIN),
    ("GET", "/api/v1/jobs", VIEW),
    ("POST", "/api/v1/jobs", CONTROL),
    ("GET", "/api/v1/jobs/{id}", VIEW),
    ("DELETE", "/api/v1/jobs/{id}", CONTROL),
    ("GET", "/api/v1/jobs/{id}/log", VIEW),
    ("GET", "/api/v1/jobs/{id}/iterations", VIEW),
    ("GET", "/api/v1/jobs/{id}/measurements", VIEW),
    ("GET", "/api/v1/jobs/{id}/moves", VIEW),
    ("GET", "/api/v1/jobs/{id}/export.json", VIEW),
    ("GET", "/api/v1/jobs/{id}/export.csv", VIEW),
    ("GET", "/api/v1/jobs/{id}/report.html", VIEW),
    ("GET", "/api/v1/jobs/{id}/recording", VIEW),
    ("GET", "/api/v1/audit", ADMIN),
    ("POST", "/api/v1/jobs/{id}/confirm", CONTROL),
    ("POST", "/api/v1/jobs/{id}/repeat", CONTROL),
    // An administrator, or who shows the key of the job's lease: the handler looks.
    ("POST", "/api/v1/jobs/{id}/confirm-key", CONTROL),
    ("GET", "/api/v1/measurement", VIEW),
    ("GET", "/api/v1/recent", VIEW),
    // Nothing moves by it.
    (MEASURE.0, MEASURE.1, VIEW),
    ("GET", MEASURE.1, VIEW),
    ("GET", DRAFT.1, VIEW),
    (DRAFT.0, DRAFT.1, VIEW),
    (PLAN.0, PLAN.1, VIEW),
    ("GET", "/api/v1/devices", VIEW),
    ("GET", FAULTS, VIEW),
    ("PUT", FAULTS, CONTROL),
    ("GET", FAULT_PLAN, VIEW),
    ("PUT", FAULT_PLAN, CONTROL),
    ("DELETE", FAULT_PLAN, CONTROL),
    ("GET", "/api/v1/openapi.json", VIEW),
    ("GET", "/api/v1/config", VIEW),
    ("PUT", "/api/v1/config", ADMIN),
    ("GET", "/api/v1/config/schema", VIEW),
    ("POST", "/api/v1/config/validate", CONTROL),
    ("GET", "/api/v1/tokens", ADMIN),
    ("POST", "/api/v1/tokens", ADMIN),
    ("DELETE", "/api/v1/tokens/{id}", ADMIN),
];

/// What a method on a route's path needs; `None` for what is not in the table.
pub(in crate::api) fn need(method: &str, route: &str) -> Option<Need> {
    let method = if method == Method::HEAD.as_str() { Method::GET.as_str() } else { method };
    TABLE.iter().find(|(known, path, _)| *known == method && *path == route).map(|(.., need)| *need)
}

/// A route of the table by its path.
pub(in crate::api) fn known_route(route: &str) -> Option<&'static str> {
    TABLE.iter().find(|(_, path, _)| *path == route).map(|(_, path, _)| *path)
}

/// What reading a path needs, as it is asked for: `/api/v1/jobs/1` rather than its route.
pub(in crate::api) fn need_to_read(path: &str) -> Option<Need> {
    TABLE.iter().find(|(method, route, _)| *method == "GET" && fits(route, path)).map(|(.., need)| *need)
}

/// The paths that can be read, as a regular expression.
pub(in crate::api) fn readable_pattern() -> String {
    let read = TABLE.iter().filter(|(method, ..)| *method == "GET").map(|(_, route, _)| {
        let parts = route
            .split('/')
            .map(|part| if part.starts_with('{') { "[^/?#]+".into() } else { part.replace('.', "\\.") });
        parts.collect::<Vec<_>>().join("/")
    });
    format!("^({})$", read.collect::<Vec<_>>().join("|"))
}

/// Whether a part of a path can stand for a parameter.
fn is_name(part: &str) -> bool {
    !part.is_empty() && !part.contains(['?', '#'])
}

/// Whether a route's path, with its parameters in braces, is that of a path asked for.
fn fits(route: &str, path: &str) -> bool {
    let (mut route, mut path) = (route.split('/'), path.split('/'));
    loop {
        match (route.next(), path.next()) {
            (None, None) => return true,
            (Some(name), Some(part)) if name == part || name.starts_with('{') && is_name(part) => {}
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Method and path of every route there is.
    fn routes() -> BTreeSet<(String, String)> {
        let contract = serde_json::to_value(crate::api::openapi()).unwrap();
        let mut routes = BTreeSet::new();
        for (path, item) in contract["paths"].as_object().unwrap() {
            for method in item.as_object().unwrap().keys() {
                routes.insert((method.to_uppercase(), path.clone()));
            }
        }
        routes
    }

    #[test]
    fn every_route_is_in_the_table_and_the_table_has_no_other() {
        let table: BTreeSet<_> = TABLE.iter().map(|(method, path, _)| ((*method).into(), (*path).into())).collect();
        assert_eq!(table.len(), TABLE.len(), "a route is there twice");
        let missing: Vec<_> = routes().difference(&table).cloned().collect();
        assert!(missing.is_empty(), "say in src/api/scopes.rs what these need: {missing:?}");
        let idle: Vec<_> = table.difference(&routes()).cloned().collect();
        assert!(idle.is_empty(), "src/api/scopes.rs names what is no route: {idle:?}");
    }

    #[test]
    fn what_changes_something_takes_more_than_to_look() {
        for (method, path, need) in TABLE {
            let changes = *method != "GET";
            let exempt = [STOP, MEASURE, DRAFT, PLAN].contains(&(*method, *path))
                || ["/api/v1/session", "/api/v1/tickets"].contains(path);
            if changes && !exempt {
                assert!(*need == CONTROL || *need == ADMIN, "{method} {path}");
            }
        }
        assert_eq!(need("HEAD", "/api/v1/bench"), Some(VIEW));
        assert_eq!(need("PATCH", "/api/v1/bench"), None);
    }

    #[test]
    fn a_path_is_told_from_its_neighbours() {
        assert_eq!(need_to_read("/api/v1/jobs/17"), Some(VIEW));
        assert_eq!(need_to_read("/api/v1/tokens"), Some(ADMIN));
        for none in
            ["/api/v1/jobs/17/18", "/api/v1/jobs/", "/api/v1/tokens/1", "/", "/api/v1/stop/x", "/api/v1/jobs/1?q=2"]
        {
            assert_eq!(need_to_read(none), None, "{none}");
        }
    }
}
