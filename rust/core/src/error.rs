//! Errors of the crate. A message names the thing, its value, its limit and the remedy, in one line.
//! A remedy names settings as Python's arguments, in backticks; each interface replaces them by its own names.

use thiserror::Error;

/// An error of the crate.
#[derive(Debug, Error)]
pub enum Error {
    /// An input array or setting is outside its allowed range.
    #[error("{0}")]
    Invalid(String),
    /// The caller requested cancellation.
    #[error("cancelled")]
    Cancelled,
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    File {
        /// The path, as the caller gave it.
        path: String,
        /// The reason, from the operating system or the reader of the format.
        reason: String,
    },
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Makes an [`Error::Invalid`] with a message.
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::Invalid(message.into())
    }
}

/// Formats a number: plain digits for common magnitudes, scientific notation for the rest.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 || (1e-9..1e15).contains(&value.abs()) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}
