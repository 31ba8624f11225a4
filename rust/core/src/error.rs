//! Everything that the crate refuses. A message names the thing, its value, its limit and the remedy, in one line.
//! A remedy names settings as Python's arguments, in backticks: interfaces put their own names there.

use thiserror::Error;

/// What went wrong.
#[derive(Debug, Error)]
pub enum Error {
    /// An input array or setting is outside what is allowed.
    #[error("{0}")]
    Invalid(String),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    File {
        /// The file, as the caller named it.
        path: String,
        /// What the system or the format says.
        reason: String,
    },
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Invalid`] with this message.
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::Invalid(message.into())
    }
}

/// A number as people write it: digits while there are few of them, a power of ten otherwise.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 || (1e-9..1e15).contains(&value.abs()) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}
