//! Decides whether front and back of a cloud need separate textures.
//!
//! They do if leaves are single-sided, or if the different depth order changes the picture seen from the back. For that, both sides are
//! baked small, aligned and compared.

use crate::atlas::{Atlas, AtlasSettings, Billboard, Region};
use crate::cloud::Cloud;
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Outline;
use crate::textures::{Channels, Samples, bake};
use crate::transition::Projection;

use super::drawn::own_triangles;

/// Side of the compared atlas pages, in texels.
const PAGE: usize = 512;

/// Mean difference of covered texels, as a share of full scale, above which the sides count as different.
const DIFFERENCE: f64 = 0.1;

/// Returns whether front and back differ by more than [`DIFFERENCE`].
pub fn differ(foliage: &Foliage, cloud: &Cloud, projection: &Projection, outlines: &[Outline]) -> Result<bool> {
    if (0..foliage.triangle_count()).any(|t| !foliage.material(t).double_sided) {
        return Ok(true);
    }
    let Ok(front) =
        Atlas::pack_loosely(&cloud.planes, outlines, AtlasSettings { size: PAGE.into(), gutter: 1, back_sides: false })
    else {
        return Ok(false); // too many billboards for the small page
    };
    let back = Atlas { billboards: front.billboards.iter().map(Billboard::mirrored).collect(), ..front };
    let rendered = |atlas: &Atlas| -> Result<Image> {
        let drawn = own_triangles(foliage, cloud, projection);
        Ok(bake(atlas, Samples::new(2)?, (&Channels::default(), None), drawn).base_color)
    };
    Ok(mean_difference(&front, &rendered(&front)?, &rendered(&back)?) > DIFFERENCE)
}

/// Returns the mean, over covered texels, of the greatest difference in a channel. The back's regions are mirrored.
fn mean_difference(atlas: &Atlas, front: &Image, back: &Image) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for Region { x, y, width, height } in atlas.billboards.iter().map(|b| b.region) {
        for row in y..y + height {
            for column in 0..width {
                let a = front.pixels()[row * atlas.size.width + x + column];
                let b = back.pixels()[row * atlas.size.width + x + width - 1 - column];
                if a[3].max(b[3]) > 127 {
                    sum += f64::from((0..4).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0));
                    count += 1;
                }
            }
        }
    }
    sum / (255 * count.max(1)) as f64
}
