//! Conversion of the core's errors to Python exceptions.

use leafcloud::Error;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(leafcloud, LeafcloudError, PyException);
create_exception!(leafcloud, CancelledError, LeafcloudError);

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("LeafcloudError", module.py().get_type::<LeafcloudError>())?;
    module.add("CancelledError", module.py().get_type::<CancelledError>())
}

/// A failure that can be stored and raised more than once.
#[derive(Clone, Debug)]
pub enum Failure {
    Cancelled,
    Refused(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::Cancelled => Self::Cancelled,
            other => Self::Refused(other.to_string()),
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Cancelled => CancelledError::new_err("cancelled"),
            Failure::Refused(message) => LeafcloudError::new_err(message),
        }
    }
}

/// Returns a [`LeafcloudError`] with this message.
pub fn refuse(message: impl Into<String>) -> PyErr {
    LeafcloudError::new_err(message.into())
}

/// Reads the value as a `T`.
///
/// # Errors
/// The value is not a `T`; the message shows the value and describes the `wanted` one.
pub fn read<'py, T>(value: &Bound<'py, PyAny>, name: &str, wanted: &str) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'py>,
{
    value.extract().map_err(|_| refuse(format!("{name} is {}; it must be {wanted}", shown(value))))
}

/// Returns the value's Python representation, cut after 60 characters.
pub fn shown(value: &Bound<'_, PyAny>) -> String {
    let written = value.repr().map_or_else(|_| "unprintable".to_owned(), |repr| repr.to_string_lossy().into_owned());
    match written.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &written[..end]),
        None => written,
    }
}
