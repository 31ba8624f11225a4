//! The laws of levels: numbers in, numbers out. Distances are those of a file, for its view.

use std::ops::Range;

/// The a at which the next level takes over: at 1 itself overlapping leaves have almost no depth order.
const HAND_OVER: f32 = 0.998;

/// Length of a cross-fade after a morph, and without one, as a fraction of the distance where it starts.
const FADE_AFTER_MORPH: f32 = 0.08;
const FADE_WITHOUT_MORPH: f32 = 0.15;

/// Largest change of a tree's switch distances by its place, as a fraction.
pub const STAGGER: f32 = 0.1;

/// A distance that no camera reaches.
pub const NEVER: f32 = 1e30;

/// Vertical field of view in radians and height in pixels of the view that a file's distances are for.
const FILE_FIELD_OF_VIEW: f32 = 50.0 * std::f32::consts::PI / 180.0;
const FILE_PIXELS: f32 = 1080.0;

/// Steps of [`stepped`] in a factor of 2.
const STEPS: f32 = 64.0;

/// Returns a, how far the leaves are on their way onto the billboards of the next level, from 0 to 1.
#[must_use]
pub fn transition_at(distance: f32, transition: &Range<f32>) -> f32 {
    let length = (transition.end - transition.start).max(1e-30);
    ((distance - transition.start) / length).clamp(0.0, 1.0)
}

/// Returns the distances between which a level fades out and the next one fades in.
///
/// `transition`: the distances between which the level's leaves slide, if they do. `next`: the distance at which the next level takes
/// over, if there is one.
#[must_use]
pub fn fade_out(transition: Option<&Range<f32>>, next: Option<f32>) -> Range<f32> {
    let (start, length) = match (transition, next) {
        (_, None) => return NEVER..NEVER,
        (Some(slide), _) => (slide.start + HAND_OVER * (slide.end - slide.start), FADE_AFTER_MORPH),
        (None, Some(next)) => (next, FADE_WITHOUT_MORPH),
    };
    start..start * (1.0 + length)
}

/// Returns the factor on the distances of the tree at a place in the world, `lc_stagger` of `leafcloud.glsl`: trees at the same distance do
/// not switch together.
#[must_use]
pub fn stagger_at(place: [f32; 3], amount: f32) -> f32 {
    let turns = 0.7549 * place[0] + 0.4387 * place[1] - 0.5698 * place[2] - 0.25;
    1.0 + amount * (4.0 * (turns - turns.floor() - 0.5).abs() - 1.0)
}

/// Returns the factor on a file's distances at which levels take over at the size in pixels for which they were baked.
///
/// `field_of_view`: vertical, in radians. `pixels`: height of the picture.
#[must_use]
pub fn view_factor(field_of_view: f32, pixels: f32) -> f32 {
    pixels / FILE_PIXELS * (0.5 * FILE_FIELD_OF_VIEW).tan() / (0.5 * field_of_view).tan()
}

/// Returns a factor greater than 0 rounded by at most 0.6 %.
///
/// Bevy keeps every visibility range that it has ever seen, up to 65,535: a camera that zooms must not make new ones for ever.
#[must_use]
pub fn stepped(factor: f32) -> f32 {
    ((factor.log2() * STEPS).round() / STEPS).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f32, wanted: f32) {
        assert!((found - wanted).abs() <= 1e-5 * wanted.abs().max(1.0), "{found} instead of {wanted}");
    }

    #[test]
    fn leaves_slide_in_proportion_to_the_distance() {
        let slide = 10.0..30.0;
        for (distance, a) in [(0.0, 0.0), (10.0, 0.0), (15.0, 0.25), (20.0, 0.5), (30.0, 1.0), (1e9, 1.0)] {
            assert_near(transition_at(distance, &slide), a);
        }
    }

    #[test]
    fn places_spread_switches_around_their_distance() {
        for (turns, wave) in [(0.0, 0.0), (0.25, 1.0), (0.5, 0.0), (0.75, -1.0), (1.125, 0.5)] {
            assert_near(stagger_at([turns / 0.7549, 0.0, 0.0], 0.1), 1.0 + 0.1 * wave);
        }
    }

    #[test]
    fn leaves_jump_where_a_transition_has_no_length() {
        assert_near(transition_at(9.9, &(10.0..10.0)), 0.0);
        assert_near(transition_at(10.1, &(10.0..10.0)), 1.0);
    }

    #[test]
    fn a_level_that_slides_fades_from_just_before_the_end() {
        let fade = fade_out(Some(&(500.0..1000.0)), Some(1000.0));
        assert_near(fade.start, 999.0);
        assert_near(fade.end, 999.0 * 1.08);
    }

    #[test]
    fn a_level_that_does_not_slide_fades_from_the_switch() {
        let fade = fade_out(None, Some(80.0));
        assert_near(fade.start, 80.0);
        assert_near(fade.end, 92.0);
    }

    #[test]
    fn the_last_level_never_fades() {
        assert_eq!(fade_out(None, None), NEVER..NEVER);
    }

    #[test]
    fn the_view_of_the_file_has_the_factor_1() {
        assert_near(view_factor(50_f32.to_radians(), 1080.0), 1.0);
    }

    #[test]
    fn a_tree_of_the_same_size_in_pixels_has_the_same_level() {
        // A sphere of radius 1 at distance d is pixels / (d tan(fov / 2)) pixels large.
        let size = |factor: f32, fov: f32, pixels: f32| pixels / (100.0 * factor * (0.5 * fov).tan());
        let of_file = size(1.0, 50_f32.to_radians(), 1080.0);
        for (degrees, pixels) in [(20_f32, 1080.0), (90.0, 1080.0), (50.0, 2160.0), (35.0, 720.0)] {
            let fov = degrees.to_radians();
            assert_near(size(view_factor(fov, pixels), fov, pixels), of_file);
        }
    }

    #[test]
    fn steps_are_few_and_near() {
        let factors = (0..10_000).map(|i| 0.1 * 1.001_f32.powi(i % 4_000));
        let mut steps: Vec<u32> = Vec::new();
        for factor in factors {
            assert!((stepped(factor) / factor - 1.0).abs() < 0.006);
            steps.push(stepped(factor).to_bits());
        }
        steps.sort_unstable();
        steps.dedup();
        // 1.001 to the power of 4,000 is 2 to the power of 5.77.
        assert!(steps.len() <= 372, "{} steps", steps.len());
        assert_near(stepped(1.0), 1.0);
    }
}
