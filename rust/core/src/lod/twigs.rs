//! Thin branches on clouds: they are fitted and baked like leaves. In the simplified trunk of a level they would need triangles of their own, and most
//! would be left out.

use std::time::Instant;

use super::references::References;
use super::settings::ChainSettings;
use crate::error::Result;
use crate::foliage::Foliage;

/// The twigs that the clouds so far have come to show.
pub(super) struct Twigs<'a> {
    of_clouds: &'a [Option<Foliage>],
    /// All of them.
    all: Vec<&'a Foliage>,
    /// Those that no cloud that was made shows yet.
    new: Vec<&'a Foliage>,
    /// What the clouds are compared with, once it is rendered.
    compared: Option<Compared>,
    /// Seconds of rendering it.
    pub seconds: f64,
}

/// The leaves with all twigs, `None` without twigs, and their renderings.
type Compared = (Option<Foliage>, References);

impl<'a> Twigs<'a> {
    pub fn new(of_clouds: &'a [Option<Foliage>]) -> Self {
        Self { of_clouds, all: Vec::new(), new: Vec::new(), compared: None, seconds: 0.0 }
    }

    /// Adds the twigs of the cloud with this number, from 0.
    pub fn add(&mut self, cloud: usize) {
        if let Some(added) = self.of_clouds.get(cloud).and_then(Option::as_ref) {
            self.all.push(added);
            self.new.push(added);
            self.compared = None;
        }
    }

    /// Returns leaves or billboards with the twigs that they do not show yet; `None` if there are none.
    pub fn with(&self, finer: &Foliage) -> Option<Foliage> {
        joined(finer, &self.new)
    }

    /// Returns the leaves that levels show with all twigs, `None` without twigs, and the renderings that levels are compared with. `whole`: the
    /// leaves that the report compares them with.
    ///
    /// # Errors
    /// Those of [`References::new`].
    pub fn compared(&mut self, shown: &Foliage, whole: &Foliage, settings: &ChainSettings) -> Result<&Compared> {
        let compared = match self.compared.take() {
            Some(known) => known,
            None => self.rendered(shown, whole, settings)?,
        };
        Ok(self.compared.insert(compared))
    }

    fn rendered(&mut self, shown: &Foliage, whole: &Foliage, settings: &ChainSettings) -> Result<Compared> {
        let started = Instant::now();
        let [shown_all, whole_all] = [shown, whole].map(|leaves| joined(leaves, &self.all));
        let parts = [&[shown_all.as_ref().unwrap_or(shown)], &[whole_all.as_ref().unwrap_or(whole)]];
        let references = References::new(parts[0], parts[1], whole.frame(), settings)?;
        self.seconds += started.elapsed().as_secs_f64();
        Ok((shown_all, references))
    }

    /// Takes the twigs as shown by the cloud with this number. Returns how many of the clouds' sets it shows.
    pub fn shown(&mut self, cloud: usize) -> usize {
        self.new.clear();
        (cloud + 1).min(self.of_clouds.len())
    }
}

fn joined(finer: &Foliage, twigs: &[&Foliage]) -> Option<Foliage> {
    let (first, others) = twigs.split_first()?;
    Some(others.iter().fold(finer.joined(first), |all, twigs| all.joined(twigs)))
}
