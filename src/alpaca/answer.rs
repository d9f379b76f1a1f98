//! Answers on the wire.

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value, json};

use super::fault::Fault;
use super::image::Picture;

/// What a member answers with.
pub(super) enum Answer {
    /// It is done.
    Done,
    /// A value.
    Value(Value),
    /// A picture, which has a wire of its own.
    Picture(Picture),
}

impl Answer {
    /// A value.
    pub(super) fn of(value: impl Into<Value>) -> Self {
        Self::Value(value.into())
    }
}

/// The numbers by which a request and its answer are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Transaction {
    /// The client's own, given back.
    pub(super) client: u32,
    /// Counted here.
    pub(super) server: u32,
}

/// An answer with a value, or none.
pub(super) fn done(transaction: Transaction, value: Option<Value>) -> Response {
    respond(transaction, value, 0, "")
}

/// An answer with a device's error.
pub(super) fn fault(transaction: Transaction, fault: &Fault) -> Response {
    respond(transaction, None, fault.number, &fault.message)
}

fn respond(transaction: Transaction, value: Option<Value>, number: i32, message: &str) -> Response {
    let mut members = Map::new();
    if let Some(value) = value {
        members.insert("Value".to_owned(), value);
    }
    members.insert("ClientTransactionID".to_owned(), json!(transaction.client));
    members.insert("ServerTransactionID".to_owned(), json!(transaction.server));
    members.insert("ErrorNumber".to_owned(), json!(number));
    members.insert("ErrorMessage".to_owned(), json!(message));
    Json(Value::Object(members)).into_response()
}

/// A refusal outside the device's own errors, in words.
pub(super) fn refused(status: StatusCode, words: &str) -> Response {
    let kind = HeaderValue::from_static("text/plain; charset=utf-8");
    (status, [(header::CONTENT_TYPE, kind)], words.to_owned()).into_response()
}
