//! Mip levels for images that have none: Bevy makes none for PNG and JPEG files.
//!
//! They are made with a box filter; colors are averaged as light.

use bevy::image::{Image, ImageFilterMode, ImageSampler};
use bevy::render::render_resource::{TextureDimension, TextureFormat};

/// Adds all smaller mip levels to an image with 8 bits a channel. Other images, and those with mip levels, stay as they are.
///
/// `cutoff`: that of a cutout. Its mip levels keep the share of texels that reach the cutoff, so that sparse leaves do not dissolve.
pub fn add_mips(image: &mut Image, cutoff: Option<f32>) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let codes = Codes::of(image.texture_descriptor.format);
    let (Some(codes), Some(texels), true) = (codes, &image.data, has_one_level(image)) else {
        return;
    };
    let first = Page { width, height, channels: codes.channels, texels: texels.clone() };
    let halved = |page: &Page| (page.width.max(page.height) > 1).then(|| page.halved(&codes));
    let mut levels: Vec<_> = std::iter::successors(Some(first), halved).collect();
    if let Some(cutoff) = cutoff.filter(|_| codes.channels == TEXEL) {
        keep_share(&mut levels, (255.0 * cutoff).ceil() as u8);
    }
    image.texture_descriptor.mip_level_count = levels.len() as u32;
    image.data = Some(levels.into_iter().flat_map(|level| level.texels).collect());
    if let ImageSampler::Descriptor(sampler) = &mut image.sampler {
        sampler.mipmap_filter = ImageFilterMode::Linear;
    }
}

fn has_one_level(image: &Image) -> bool {
    let descriptor = &image.texture_descriptor;
    let is_flat = descriptor.dimension == TextureDimension::D2 && descriptor.size.depth_or_array_layers == 1;
    is_flat && descriptor.mip_level_count == 1
}

/// Changes alpha of all levels after the first: as many of their texels reach this alpha as of the first.
fn keep_share(levels: &mut [Page], cutoff: u8) {
    let Some((first, smaller)) = levels.split_first_mut() else {
        return;
    };
    let share = first.shares()[usize::from(cutoff)];
    for level in smaller {
        level.bend(level.least_alpha(share), cutoff);
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

    fn mean(&self, channel: usize, codes: [u8; 4]) -> u8 {
        if channel < self.linear_from {
            let light: f32 = codes.iter().map(|&code| self.light[usize::from(code)]).sum();
            return (srgb_of(light / 4.0) * 255.0).round() as u8;
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

/// Channels of a texel with alpha, which is the last one.
const TEXEL: usize = 4;

struct Page {
    width: usize,
    height: usize,
    channels: usize,
    texels: Vec<u8>,
}

impl Page {
    /// Returns the page of half the size. The last row and column of an odd size are left out.
    fn halved(&self, codes: &Codes) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity(width * height * codes.channels);
        for y in 0..height {
            let rows = [2 * y, (2 * y + 1).min(self.height - 1)];
            for x in 0..width {
                let columns = [2 * x, (2 * x + 1).min(self.width - 1)];
                for channel in 0..codes.channels {
                    let code = |row: usize, column: usize| {
                        self.texels[(rows[row] * self.width + columns[column]) * codes.channels + channel]
                    };
                    texels.push(codes.mean(channel, [code(0, 0), code(0, 1), code(1, 0), code(1, 1)]));
                }
            }
        }
        Self { width, height, channels: self.channels, texels }
    }

    /// Returns for each alpha the share of texels that reach it.
    fn shares(&self) -> [f32; 256] {
        let mut counts = [0; 256];
        self.texels.chunks_exact(TEXEL).for_each(|texel| counts[usize::from(texel[TEXEL - 1])] += 1);
        (0..255).rev().for_each(|alpha| counts[alpha] += counts[alpha + 1]);
        counts.map(|count| count as f32 / (self.width * self.height) as f32)
    }

    /// Returns the alpha that a share of texels nearest to this one reaches.
    fn least_alpha(&self, share: f32) -> u8 {
        let shares = self.shares();
        let error = |least: &u8| (shares[usize::from(*least)] - share).abs();
        (1..=255).min_by(|one, other| error(one).total_cmp(&error(other))).unwrap_or(255)
    }

    /// Stretches alpha below and above a value so that this value becomes the cutoff.
    fn bend(&mut self, least: u8, cutoff: u8) {
        let (from, to) = (f32::from(least) - 0.5, f32::from(cutoff) - 0.5);
        let bent: [u8; 256] = std::array::from_fn(|code| {
            let code = code as f32;
            let new =
                if code < from { code / from * to } else { 255.0 - (255.0 - code) / (255.0 - from) * (255.0 - to) };
            new.round() as u8
        });
        for texel in self.texels.chunks_exact_mut(TEXEL) {
            texel[TEXEL - 1] = bent[usize::from(texel[TEXEL - 1])];
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

    #[test]
    fn alpha_is_averaged_as_it_is_and_color_as_light() {
        let texels = [[255, 0, 188, 255], [0, 0, 188, 0], [255, 0, 188, 255], [0, 0, 188, 0]];
        let mut page = image(2, 2, TextureFormat::Rgba8UnormSrgb, texels.concat());
        add_mips(&mut page, None);
        assert_eq!(page.texture_descriptor.mip_level_count, 2);
        // Half of the light is the sRGB code 188, and half of the alpha is 128.
        assert_eq!(page.data.unwrap()[16..], [188, 0, 188, 128]);
    }

    #[test]
    fn numbers_are_averaged_as_they_are() {
        let mut page = image(2, 2, TextureFormat::Rgba8Unorm, [[8, 0, 255, 1], [16, 0, 255, 2]].concat().repeat(2));
        add_mips(&mut page, None);
        assert_eq!(page.data.unwrap()[16..], [12, 0, 255, 2]);
    }

    #[test]
    fn levels_end_with_one_texel() {
        for (width, height, sizes) in
            [(8, 8, vec![64, 16, 4, 1]), (8, 2, vec![16, 4, 2, 1]), (5, 3, vec![15, 2, 1]), (1, 1, vec![1])]
        {
            let mut page = image(width, height, TextureFormat::R8Unorm, vec![7; (width * height) as usize]);
            add_mips(&mut page, None);
            assert_eq!(page.texture_descriptor.mip_level_count as usize, sizes.len());
            assert_eq!(page.data.unwrap(), vec![7; sizes.iter().sum()]);
        }
    }

    #[test]
    fn images_with_mip_levels_stay() {
        let mut page = image(2, 2, TextureFormat::R8Unorm, vec![1, 2, 3, 4]);
        add_mips(&mut page, None);
        let once = page.data.clone();
        add_mips(&mut page, None);
        assert_eq!(page.data, once);
    }

    #[test]
    fn mip_levels_of_a_cutout_keep_the_drawn_share() {
        let drawn = |texels: &[u8]| texels.iter().skip(3).step_by(4).filter(|&&alpha| alpha >= 80).count();
        // Of the 16 blocks of 2 × 2 texels, eight have one texel of the cutoff and four have two. No mean reaches the cutoff.
        let is_drawn = |x: usize, y: usize| x % 2 == 0 && (y < 4 && y % 2 == 0 || y == 4 || y == 5);
        let texel = |number: usize| [0, 90, 0, if is_drawn(number % 8, number / 8) { 80 } else { 0 }];
        let mut page = image(8, 8, TextureFormat::Rgba8UnormSrgb, (0..64).flat_map(texel).collect());
        add_mips(&mut page, Some(80.0 / 255.0));
        let data = page.data.unwrap();
        assert_eq!([drawn(&data[..256]), drawn(&data[256..320])], [16, 4]);
    }

    #[test]
    fn other_formats_stay() {
        let mut page = image(2, 2, TextureFormat::R32Float, vec![0; 16]);
        add_mips(&mut page, None);
        assert_eq!(page.texture_descriptor.mip_level_count, 1);
    }
}
