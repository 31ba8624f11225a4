//! Mip levels for images that have none: Bevy makes none for PNG and JPEG files.
//!
//! Atlas pages take those of their file. Those of other images are made with a box filter; colors are averaged as light.

use bevy::image::{Image, ImageFilterMode, ImageSampler};
use bevy::render::render_resource::{TextureDimension, TextureFormat};

/// Adds all smaller mip levels to an image with 8 bits a channel. Other images, and those with mip levels, stay as they are.
pub fn add_mips(image: &mut Image) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let codes = Codes::of(image.texture_descriptor.format);
    let (Some(codes), Some(texels), true) = (codes, &image.data, has_one_level(image)) else {
        return;
    };
    let mut last = Page { width, height, texels: texels.clone() };
    let mut all = texels.clone();
    while last.width > 1 || last.height > 1 {
        last = last.halved(&codes);
        all.extend_from_slice(&last.texels);
    }
    set_levels(image, all);
}

/// Gives an atlas page the mip levels that lie under one another in another image, at its left side. The first replaces the page.
/// A page of another size, as other tools write, stays.
pub fn use_levels(page: &mut Image, levels: &Image) {
    const TEXEL: usize = 4;
    let sizes = sizes_of(page.width() as usize, page.height() as usize);
    let height: usize = sizes.iter().map(|(_, height)| height).sum();
    let is_of_page = [&*page, levels]
        .iter()
        .all(|image| image.texture_descriptor.format == TextureFormat::Rgba8UnormSrgb && has_one_level(image))
        && (levels.width(), levels.height() as usize) == (page.width(), height);
    let (Some(texels), true) = (&levels.data, is_of_page) else {
        return;
    };
    let widths = sizes.iter().flat_map(|&(width, height)| std::iter::repeat_n(width, height));
    let rows = texels.chunks_exact(TEXEL * levels.width() as usize);
    set_levels(page, rows.zip(widths).flat_map(|(row, width)| &row[..TEXEL * width]).copied().collect());
}

fn has_one_level(image: &Image) -> bool {
    let descriptor = &image.texture_descriptor;
    let is_flat = descriptor.dimension == TextureDimension::D2 && descriptor.size.depth_or_array_layers == 1;
    is_flat && descriptor.mip_level_count == 1
}

/// Returns width and height of an image and of its mip levels.
fn sizes_of(width: usize, height: usize) -> Vec<(usize, usize)> {
    let smaller =
        |&(width, height): &(usize, usize)| (width.max(height) > 1).then(|| ((width / 2).max(1), (height / 2).max(1)));
    std::iter::successors(Some((width, height)), smaller).collect()
}

/// Replaces an image by the texels of all its mip levels, the largest first.
fn set_levels(image: &mut Image, texels: Vec<u8>) {
    image.texture_descriptor.mip_level_count = sizes_of(image.width() as usize, image.height() as usize).len() as u32;
    image.data = Some(texels);
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
    fn the_levels_of_the_file_replace_the_page() {
        // Levels of 4 × 2, 2 × 1 and 1 × 1 texels, each of one color.
        let row = |colors: [u8; 4]| colors.map(|color| [color; 4]).concat();
        let stack = [row([1; 4]), row([1; 4]), row([2, 2, 0, 0]), row([3, 0, 0, 0])].concat();
        let mut page = image(4, 2, TextureFormat::Rgba8UnormSrgb, vec![9; 32]);
        use_levels(&mut page, &image(4, 4, TextureFormat::Rgba8UnormSrgb, stack.clone()));
        assert_eq!(page.texture_descriptor.mip_level_count, 3);
        assert_eq!(page.data.clone().unwrap(), [vec![1; 32], vec![2; 8], vec![3; 4]].concat());
        add_mips(&mut page);
        assert_eq!(page.data.unwrap().len(), 44);
    }

    #[test]
    fn levels_of_a_page_of_another_size_or_format_are_no_use() {
        let levels = image(4, 4, TextureFormat::Rgba8UnormSrgb, vec![1; 64]);
        for (width, height, format) in [(2, 2, TextureFormat::Rgba8UnormSrgb), (4, 2, TextureFormat::Rgba8Unorm)] {
            let texels = vec![9; (4 * width * height) as usize];
            let mut page = image(width, height, format, texels.clone());
            use_levels(&mut page, &levels);
            assert_eq!((page.data.unwrap(), page.texture_descriptor.mip_level_count), (texels, 1));
        }
    }

    #[test]
    fn other_formats_stay() {
        let mut page = image(2, 2, TextureFormat::R32Float, vec![0; 16]);
        add_mips(&mut page);
        assert_eq!(page.texture_descriptor.mip_level_count, 1);
    }
}
