//! Progress reports and cancellation of long work.

use crate::error::{Error, Result};

/// Callback with the stage's name and the share done, in [0, 1]; returns whether to continue.
pub type Report<'a> = dyn Fn(&str, f64) -> bool + Sync + 'a;

/// A part of the whole work, from `start` to `end` in [0, 1].
#[derive(Clone, Copy)]
pub struct Progress<'a> {
    report: Option<&'a Report<'a>>,
    start: f64,
    end: f64,
}

impl<'a> Progress<'a> {
    /// Makes a progress without a listener.
    #[must_use]
    pub const fn silent() -> Self {
        Self { report: None, start: 0.0, end: 1.0 }
    }

    /// Makes a progress of the whole work that reports to `report`.
    pub fn new(report: &'a Report<'a>) -> Self {
        Self { report: Some(report), start: 0.0, end: 1.0 }
    }

    /// Returns the part from `start` to `end` of this part, both in [0, 1].
    #[must_use]
    pub fn part(self, start: f64, end: f64) -> Self {
        let length = self.end - self.start;
        Self { report: self.report, start: self.start + start * length, end: self.start + end * length }
    }

    /// Reports that `share` of this part is done.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the listener requests a stop.
    pub fn tell(self, stage: &str, share: f64) -> Result<()> {
        let fraction = self.start + share.clamp(0.0, 1.0) * (self.end - self.start);
        match self.report {
            Some(report) if !report(stage, fraction) => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn parts_nest() {
        let told = Mutex::new(Vec::new());
        let report = |stage: &str, fraction: f64| {
            told.lock().unwrap().push((stage.to_owned(), fraction));
            true
        };
        let half = Progress::new(&report).part(0.5, 1.0);
        half.part(0.0, 0.5).tell("fit", 1.0).unwrap();
        half.tell("bake", 2.0).unwrap();
        assert_eq!(*told.lock().unwrap(), [("fit".to_owned(), 0.75), ("bake".to_owned(), 1.0)]);
    }

    #[test]
    fn a_listener_cancels() {
        assert!(matches!(Progress::new(&|_, _| false).tell("fit", 0.0), Err(Error::Cancelled)));
        assert!(Progress::silent().tell("fit", 0.0).is_ok());
    }
}
