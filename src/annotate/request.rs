//! Errors of requests from the page, and their responses.

use axum::{
    Json,
    http::StatusCode,
    response::{IntoResponse, Response},
};
use serde::Serialize;
use serde_json::{Value, json};

use crate::text::message;

/// Why a request fails.
#[derive(Debug)]
pub enum RequestError {
    /// No such sequence, frame or file.
    NotFound(String),
    /// The request is invalid: a position outside the image, a file that cannot be read.
    Refused(String),
    /// The sequence was changed elsewhere since the page read it; with its current state.
    Conflict(Value),
    /// The user must first allow something.
    Consent(String),
    /// The disk or the native library failed.
    Failed(String),
}

impl RequestError {
    /// A refusal with the text of an error.
    pub fn refused(error: impl std::fmt::Display) -> Self {
        Self::Refused(message(&error.to_string()).into_owned())
    }

    /// A failure with the text of an error.
    pub fn failed(error: impl std::fmt::Display) -> Self {
        Self::Failed(message(&error.to_string()).into_owned())
    }

    /// A conflict with the current state.
    pub fn conflict(current: &impl Serialize) -> Self {
        Self::Conflict(serde_json::to_value(current).unwrap_or_default())
    }
}

impl std::fmt::Display for RequestError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotFound(reason) | Self::Refused(reason) | Self::Consent(reason) | Self::Failed(reason) => reason,
            Self::Conflict(_) => CHANGED_ELSEWHERE,
        })
    }
}

/// Message of a conflict.
const CHANGED_ELSEWHERE: &str = "the sequence was changed elsewhere";

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        let (status, body) = match self {
            Self::NotFound(reason) => (StatusCode::NOT_FOUND, json!({ "error": reason })),
            Self::Refused(reason) => (StatusCode::UNPROCESSABLE_ENTITY, json!({ "error": reason })),
            Self::Conflict(current) => (StatusCode::CONFLICT, json!({ "error": CHANGED_ELSEWHERE, "current": current })),
            Self::Consent(reason) => (StatusCode::PRECONDITION_REQUIRED, json!({ "error": reason, "consent": true })),
            Self::Failed(reason) => (StatusCode::INTERNAL_SERVER_ERROR, json!({ "error": reason })),
        };
        (status, Json(body)).into_response()
    }
}
