//! How far a piece may move: ε, or less where a viewer comes near.
//!
//! Décoret et al. 2003, §2, view-dependent case: the error that counts is the angle at which a motion is seen. A viewer who stays at the
//! distance D or farther from the centre sees a vertex at distance |v| from the centre from no nearer than D − |v|, so that a motion of
//! φ · (D − |v|) is seen at an angle of at most φ, whatever its direction.

use glam::DVec3;

use super::settings::ImageBound;

/// The bound at every point of the foliage, local units.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The greatest bound anywhere.
    pub greatest: f64,
    /// Where a viewer may come.
    pub image: Option<ImageBound>,
}

impl Bounds {
    /// The bound of what has these vertices (local), rounded down to f32.
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
