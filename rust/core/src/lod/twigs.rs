//! Thin branches on clouds. A trunk keeps few triangles at a distance, so its twigs vanish, and with them a share of what a tree covers. On a cloud
//! they cost no triangle: they are fitted and baked like leaves.

use crate::foliage::Foliage;

/// The twigs that the clouds so far have come to show.
pub(super) struct Twigs<'a> {
    of_clouds: &'a [Option<Foliage>],
    /// All of them.
    all: Vec<&'a Foliage>,
    /// Those that no cloud that was made shows yet.
    new: Vec<&'a Foliage>,
}

impl<'a> Twigs<'a> {
    pub fn new(of_clouds: &'a [Option<Foliage>]) -> Self {
        Self { of_clouds, all: Vec::new(), new: Vec::new() }
    }

    /// Adds the twigs of the cloud with this number, from 0. Returns whether it has some.
    pub fn add(&mut self, cloud: usize) -> bool {
        let added = self.of_clouds.get(cloud).and_then(Option::as_ref);
        self.all.extend(added);
        self.new.extend(added);
        added.is_some()
    }

    /// Returns leaves or billboards with the twigs that they do not show yet; `None` if there are none.
    pub fn with(&self, finer: &Foliage) -> Option<Foliage> {
        joined(finer, &self.new)
    }

    /// Returns the leaves with all twigs; `None` without twigs.
    pub fn with_all(&self, leaves: &Foliage) -> Option<Foliage> {
        joined(leaves, &self.all)
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
