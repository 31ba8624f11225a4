//! Bounds on the motion of pieces: ε, or less where a viewer may come near.
//!
//! Décoret et al. 2003, §2, view-dependent case: the error is the angle at which a motion appears. If a viewer stays at least the
//! distance D from the center, a vertex at distance |v| from the center is at least D − |v| away. So a motion of
//! φ · (D − |v|) appears at an angle of at most φ, in any direction.

use glam::DVec3;

use super::settings::ImageBound;

/// The bound at every point of the foliage, in local units.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The greatest bound anywhere.
    pub greatest: f64,
    /// Least distance and angle of a viewer, if given.
    pub image: Option<ImageBound>,
}

impl Bounds {
    /// Returns the bound for a piece with these vertices (local), rounded down to f32.
    pub fn of(&self, vertices: impl IntoIterator<Item = DVec3>) -> f32 {
        let seen = self.image.map_or(f64::INFINITY, |ImageBound { angle, distance }| {
            let farthest = vertices.into_iter().map(DVec3::length).fold(0.0, f64::max);
            angle * (distance - farthest)
        });
        rounded_down(seen.min(self.greatest))
    }
}

fn rounded_down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_near_the_viewer_move_less() {
        let bounds = Bounds { greatest: 0.04, image: Some(ImageBound { angle: 0.01, distance: 3.0 }) };
        assert_eq!(bounds.of([DVec3::X, DVec3::ZERO]), 0.02);
        assert_eq!(bounds.of([DVec3::ZERO]), 0.03);
        assert!(f64::from(Bounds { image: None, ..bounds }.of([DVec3::X])) <= 0.04);
    }
}
