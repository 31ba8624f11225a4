//! Mip levels for images that have none: Bevy makes none for PNG and JPEG files.
//!
//! They are made with a box filter; colors are averaged as light. Those of cutouts keep the share of texels that are drawn.

use bevy::image::{Image, ImageFilterMode, ImageSampler};
use bevy::render::render_resource::{TextureDimension, TextureFormat};

/// Alpha in codes at which Bevy draws the edge of a cutout.
const EDGE: f32 = 127.5;

/// Adds all smaller mip levels to an image with 8 bits a channel. Other images, and those with mip levels, stay as they are.
pub fn add_mips(image: &mut Image) {
    if let Some(levels) = levels_of(image, false) {
        set_levels(image, &levels);
    }
}

/// Adds the mip levels of a cutout: as many texels of each level reach half of the alpha as reach the cutoff in the image.
pub fn add_cutout_mips(image: &mut Image, cutoff: f32) {
    let Some(mut levels) = levels_of(image, true) else {
        return;
    };
    if levels[0].channels > ALPHA {
        let least = (255.0 * cutoff).ceil() as u8;
        let share = levels[0].shares()[usize::from(least)];
        for at in (1..levels.len()).rev() {
            let (larger, smaller) = levels.split_at_mut(at);
            larger[at - 1].fill_transparent(&smaller[0]);
            smaller[0].bend(smaller[0].least_alpha(share));
        }
        levels[0].bend(least);
    }
    set_levels(image, &levels);
}

/// Returns the image and its smaller mip levels.
fn levels_of(image: &Image, is_cutout: bool) -> Option<Vec<Page>> {
    let descriptor = &image.texture_descriptor;
    let is_flat = descriptor.dimension == TextureDimension::D2 && descriptor.size.depth_or_array_layers == 1;
    let codes = Codes::of(descriptor.format).filter(|_| is_flat && descriptor.mip_level_count == 1)?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let first = Page { width, height, channels: codes.channels, texels: image.data.clone()? };
    let smaller = |page: &Page| (page.width.max(page.height) > 1).then(|| page.halved(&codes, is_cutout));
    Some(std::iter::successors(Some(first), smaller).collect())
}

fn set_levels(image: &mut Image, levels: &[Page]) {
    image.texture_descriptor.mip_level_count = levels.len() as u32;
    image.data = Some(levels.iter().flat_map(|level| &level.texels).copied().collect());
    if let ImageSampler::Descriptor(sampler) = &mut image.sampler {
        sampler.mipmap_filter = ImageFilterMode::Linear;
    }
}

/// The meaning of the bytes of a texel.
struct Codes {
    channels: usize,
    /// Channels before this one are sRGB codes.
    linear_from: usize,
    light: [f32; 256],
}

impl Codes {
    fn of(format: TextureFormat) -> Option<Self> {
        let (channels, linear_from) = match format {
            TextureFormat::R8Unorm => (1, 0),
            TextureFormat::Rg8Unorm => (2, 0),
            TextureFormat::Rgba8Unorm => (4, 0),
            TextureFormat::Rgba8UnormSrgb => (4, 3),
            _ => return None,
        };
        Some(Self { channels, linear_from, light: std::array::from_fn(|code| light_of(code as f32 / 255.0)) })
    }

    /// `weights`: those of colors.
    fn mean(&self, channel: usize, codes: [u8; 4], weights: [f32; 4]) -> u8 {
        if channel < self.linear_from {
            let light: f32 =
                codes.iter().zip(weights).map(|(&code, weight)| self.light[usize::from(code)] * weight).sum();
            return (srgb_of(light / weights.iter().sum::<f32>()) * 255.0).round() as u8;
        }
        let sum: u16 = codes.iter().map(|&code| u16::from(code)).sum();
        ((sum + 2) / 4) as u8
    }
}

fn light_of(srgb: f32) -> f32 {
    if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

fn srgb_of(light: f32) -> f32 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Channel of alpha.
const ALPHA: usize = 3;

struct Page {
    width: usize,
    height: usize,
    channels: usize,
    texels: Vec<u8>,
}

impl Page {
    /// Returns the page of half the size. The last row and column of an odd size are left out. Colors of a cutout are weighted by alpha.
    fn halved(&self, codes: &Codes, is_cutout: bool) -> Self {
        let (width, height, channels) = ((self.width / 2).max(1), (self.height / 2).max(1), self.channels);
        let mut texels = Vec::with_capacity(width * height * channels);
        for y in 0..height {
            let rows = [2 * y, (2 * y + 1).min(self.height - 1)];
            for x in 0..width {
                let columns = [2 * x, (2 * x + 1).min(self.width - 1)];
                let block =
                    rows.map(|row| columns.map(|column| &self.texels[(row * self.width + column) * channels..]));
                let block = [block[0][0], block[0][1], block[1][0], block[1][1]];
                let is_weighted = is_cutout && channels > ALPHA && block.iter().any(|texel| texel[ALPHA] > 0);
                let weights = block.map(|texel| if is_weighted { f32::from(texel[ALPHA]) } else { 1.0 });
                texels.extend(
                    (0..channels).map(|channel| codes.mean(channel, block.map(|texel| texel[channel]), weights)),
                );
            }
        }
        Self { width, height, channels, texels }
    }

    /// Gives texels of no alpha the color of the next smaller level, because filters mix it into leaves.
    fn fill_transparent(&mut self, smaller: &Self) {
        for (number, texel) in self.texels.chunks_exact_mut(self.channels).enumerate() {
            if texel[ALPHA] == 0 {
                let row = (number / self.width / 2).min(smaller.height - 1);
                let column = (number % self.width / 2).min(smaller.width - 1);
                let from = (row * smaller.width + column) * smaller.channels;
                texel[..ALPHA].copy_from_slice(&smaller.texels[from..from + ALPHA]);
            }
        }
    }

    /// Returns for each alpha the share of texels that have at least this alpha.
    fn shares(&self) -> [f32; 256] {
        let mut counts = [0; 256];
        self.texels.iter().skip(ALPHA).step_by(self.channels).for_each(|&alpha| counts[usize::from(alpha)] += 1);
        (0..255).rev().for_each(|alpha| counts[alpha] += counts[alpha + 1]);
        counts.map(|count| count as f32 / (self.width * self.height) as f32)
    }

    /// Returns the alpha that a share of texels nearest to this one has at least.
    fn least_alpha(&self, share: f32) -> u8 {
        let shares = self.shares();
        let error = |least: &u8| (shares[usize::from(*least)] - share).abs();
        (1..=255).min_by(|one, other| error(one).total_cmp(&error(other))).unwrap_or(255)
    }

    /// Changes alpha so that this value is the first above the edge.
    fn bend(&mut self, least: u8) {
        let pivot = f32::from(least) - 0.5;
        let bent: [u8; 256] = std::array::from_fn(|code| {
            let code = code as f32;
            let part = if code < pivot { code / pivot } else { 1.0 + (code - pivot) / (255.0 - pivot) };
            (EDGE * part).round() as u8
        });
        for alpha in self.texels.iter_mut().skip(ALPHA).step_by(self.channels) {
            *alpha = bent[usize::from(*alpha)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::RenderAssetUsages;
    use bevy::render::render_resource::Extent3d;

    fn image(width: u32, height: u32, format: TextureFormat, data: Vec<u8>) -> Image {
        let size = Extent3d { width, height, depth_or_array_layers: 1 };
        Image::new(size, TextureDimension::D2, data, format, RenderAssetUsages::default())
    }

    /// Returns the number of texels that Bevy draws.
    fn drawn(texels: &[u8]) -> usize {
        texels.iter().skip(3).step_by(4).filter(|&&alpha| alpha >= 128).count()
    }

    #[test]
    fn alpha_is_averaged_as_it_is_and_color_as_light() {
        let texels = [[255, 0, 188, 255], [0, 0, 188, 0], [255, 0, 188, 255], [0, 0, 188, 0]];
        let mut page = image(2, 2, TextureFormat::Rgba8UnormSrgb, texels.concat());
        add_mips(&mut page);
        assert_eq!(page.texture_descriptor.mip_level_count, 2);
        // Half of the light is the sRGB code 188, and half of the alpha is 128.
        assert_eq!(page.data.unwrap()[16..], [188, 0, 188, 128]);
    }

    #[test]
    fn numbers_are_averaged_as_they_are() {
        let mut page = image(2, 2, TextureFormat::Rgba8Unorm, [[8, 0, 255, 1], [16, 0, 255, 2]].concat().repeat(2));
        add_mips(&mut page);
        assert_eq!(page.data.unwrap()[16..], [12, 0, 255, 2]);
    }

    #[test]
    fn levels_end_with_one_texel() {
        for (width, height, sizes) in
            [(8, 8, vec![64, 16, 4, 1]), (8, 2, vec![16, 4, 2, 1]), (5, 3, vec![15, 2, 1]), (1, 1, vec![1])]
        {
            let mut page = image(width, height, TextureFormat::R8Unorm, vec![7; (width * height) as usize]);
            add_mips(&mut page);
            assert_eq!(page.texture_descriptor.mip_level_count as usize, sizes.len());
            assert_eq!(page.data.unwrap(), vec![7; sizes.iter().sum()]);
        }
    }

    #[test]
    fn images_with_mip_levels_stay() {
        let mut page = image(2, 2, TextureFormat::R8Unorm, vec![1, 2, 3, 4]);
        add_mips(&mut page);
        let once = page.data.clone();
        add_mips(&mut page);
        assert_eq!(page.data, once);
    }

    #[test]
    fn mip_levels_of_a_cutout_keep_the_drawn_share() {
        // Of the 16 blocks of 2 × 2 texels, eight have one texel of the cutoff and four have two. No mean reaches the cutoff.
        let is_drawn = |x: usize, y: usize| x % 2 == 0 && (y < 4 && y % 2 == 0 || y == 4 || y == 5);
        let texel = |number: usize| [0, 90, 0, if is_drawn(number % 8, number / 8) { 80 } else { 0 }];
        let mut page = image(8, 8, TextureFormat::Rgba8UnormSrgb, (0..64).flat_map(texel).collect());
        add_cutout_mips(&mut page, 80.0 / 255.0);
        let data = page.data.unwrap();
        assert_eq!([drawn(&data[..256]), drawn(&data[256..320])], [16, 4]);
    }

    #[test]
    fn colors_of_a_cutout_are_those_of_its_drawn_texels() {
        let data = [[0, 90, 0, 255], [255, 0, 0, 0], [255, 0, 0, 0], [255, 0, 0, 0]].concat();
        let mut page = image(2, 2, TextureFormat::Rgba8UnormSrgb, data);
        add_cutout_mips(&mut page, 0.5);
        assert!(page.data.unwrap().chunks(4).all(|texel| texel[..3] == [0, 90, 0]));
    }

    #[test]
    fn a_cutout_without_alpha_has_plain_mip_levels() {
        let mut page = image(2, 1, TextureFormat::R8Unorm, vec![10, 20]);
        add_cutout_mips(&mut page, 0.5);
        assert_eq!(page.data.unwrap(), [10, 20, 15]);
    }

    #[test]
    fn other_formats_stay() {
        let mut page = image(2, 2, TextureFormat::R32Float, vec![0; 16]);
        add_mips(&mut page);
        assert_eq!(page.texture_descriptor.mip_level_count, 1);
    }
}
