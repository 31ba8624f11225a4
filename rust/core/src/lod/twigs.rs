//! Thin branches on clouds: they are fitted and baked like leaves. In the simplified trunk of a level they would need triangles of their own, and most
//! would be left out.

use std::sync::Arc;
use std::time::Instant;

use super::measured::Measured;
use super::references::References;
use super::settings::ChainSettings;
use crate::error::Result;
use crate::foliage::Foliage;

/// The twigs that the clouds so far have come to show.
pub(super) struct Twigs {
    of_clouds: Vec<Option<Foliage>>,
    /// Number of sets of twigs that were added so far.
    added: usize,
    /// Number of sets of twigs that the last cloud shows.
    shown: usize,
    /// What the clouds are compared with, once it is rendered.
    compared: Option<Compared>,
    /// Seconds of rendering it.
    pub seconds: f64,
}

/// The leaves with all twigs, `None` without twigs, and their renderings.
type Compared = (Option<Foliage>, Arc<References>);

impl Twigs {
    pub fn new(of_clouds: Vec<Option<Foliage>>) -> Self {
        Self { of_clouds, added: 0, shown: 0, compared: None, seconds: 0.0 }
    }

    /// Adds the twigs of the next cloud.
    pub fn add(&mut self) {
        self.added += 1;
        if self.of_clouds.get(self.added - 1).is_some_and(Option::is_some) {
            self.compared = None;
        }
    }

    /// Returns leaves or billboards with the twigs that they do not show yet; `None` if there are none.
    pub fn with(&self, finer: &Foliage) -> Option<Foliage> {
        self.joined(finer, self.shown)
    }

    /// Returns the leaves that levels show with all twigs, `None` without twigs, and the renderings that levels are compared with.
    ///
    /// # Errors
    /// Those of [`References::new`].
    pub fn compared(&mut self, measured: &Measured, settings: &ChainSettings) -> Result<&Compared> {
        let compared = match self.compared.take() {
            Some(known) => known,
            None => self.rendered(measured, settings)?,
        };
        Ok(self.compared.insert(compared))
    }

    fn rendered(&mut self, measured: &Measured, settings: &ChainSettings) -> Result<Compared> {
        let started = Instant::now();
        let (shown, leaves) = (measured.shown(), measured.origin.leaves);
        let compared = match [shown, leaves].map(|leaves| self.joined(leaves, 0)) {
            [Some(shown), Some(leaves)] => {
                let references = References::new(&[&shown], &[&leaves], measured.origin.leaves.frame(), settings)?;
                (Some(shown), Arc::new(references))
            }
            _ => (None, measured.of_leaves(settings)?),
        };
        self.seconds += started.elapsed().as_secs_f64();
        Ok(compared)
    }

    /// Takes the twigs as shown by the last cloud. Returns how many of the clouds' sets it shows.
    pub fn show(&mut self) -> usize {
        self.shown = self.added;
        self.added.min(self.of_clouds.len())
    }

    /// Returns leaves with the twigs of the clouds from number `first` on; `None` if there are none.
    fn joined(&self, leaves: &Foliage, first: usize) -> Option<Foliage> {
        let end = self.added.min(self.of_clouds.len());
        let mut twigs = self.of_clouds[first.min(end)..end].iter().flatten();
        let with_one = leaves.joined(twigs.next()?);
        Some(twigs.fold(with_one, |all, twigs| all.joined(twigs)))
    }
}
