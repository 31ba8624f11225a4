//! Mip levels for images that have none: Bevy makes none for PNG and JPEG files.
//!
//! The atlas pages of a bake keep their coverage with box-filtered mip levels, so these are made here. Colors are averaged as light.

use bevy::image::{Image, ImageFilterMode, ImageSampler};
use bevy::render::render_resource::{TextureDimension, TextureFormat};

/// Adds all smaller mip levels to an image with 8 bits a channel. Other images, and those with mip levels, stay as they are.
pub fn add_mips(image: &mut Image) {
    let descriptor = &image.texture_descriptor;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let is_plain = descriptor.mip_level_count == 1
        && descriptor.dimension == TextureDimension::D2
        && descriptor.size.depth_or_array_layers == 1;
    let (Some(codes), Some(data), true) = (Codes::of(descriptor.format), &mut image.data, is_plain) else {
        return;
    };
    let mut last = Page { width, height, texels: data.clone() };
    let mut levels = 1;
    while last.width > 1 || last.height > 1 {
        last = last.halved(&codes);
        data.extend_from_slice(&last.texels);
        levels += 1;
    }
    image.texture_descriptor.mip_level_count = levels;
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

struct Page {
    width: usize,
    height: usize,
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
        Self { width, height, texels }
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
    fn other_formats_stay() {
        let mut page = image(2, 2, TextureFormat::R32Float, vec![0; 16]);
        add_mips(&mut page);
        assert_eq!(page.texture_descriptor.mip_level_count, 1);
    }
}
