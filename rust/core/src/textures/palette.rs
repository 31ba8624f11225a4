//! Palettes by median cut: a box of colors is cut in two where its greatest variance is, until there are enough boxes.

use crate::error::{Error, Result};
use crate::foliage::Image;

/// Bits of each channel that tell colors apart.
const BITS: usize = 5;
const BINS: usize = 1 << (3 * BITS);

/// A palette of the colors of pictures, without alpha.
pub struct Palette {
    /// sRGB colors.
    pub colors: Vec<[u8; 3]>,
    /// Index of the color for each bin.
    index: Vec<u8>,
}

/// The pixels of one coarse color: the first [`BITS`] of each channel are equal.
#[derive(Clone, Copy)]
struct Bin {
    number: usize,
    count: u64,
    sum: [u64; 3],
}

impl Palette {
    /// Returns at most `most` colors for the frames.
    ///
    /// # Errors
    /// `most` outside [2, 256].
    pub fn of(frames: &[Image], most: usize) -> Result<Self> {
        if !(2..=256).contains(&most) {
            return Err(Error::invalid(format!("a palette of {most} colors; it must have 2 to 256")));
        }
        let with_spread = |colors: Vec<Bin>| (spread(&colors), colors);
        let mut boxes = vec![with_spread(bins(frames))];
        while boxes.len() < most {
            let widest = (0..boxes.len()).max_by_key(|&i| (boxes[i].0.0, usize::MAX - i)).unwrap_or(0);
            let ((variance, channel), colors) = &boxes[widest];
            if *variance == 0 {
                break;
            }
            let (low, high) = cut(colors, *channel);
            boxes[widest] = with_spread(low);
            boxes.push(with_spread(high));
        }
        let boxes: Vec<Vec<Bin>> = boxes.into_iter().map(|(_, colors)| colors).collect();
        let mut index = vec![0; BINS];
        for (i, colors) in boxes.iter().enumerate() {
            for bin in colors {
                index[bin.number] = i as u8;
            }
        }
        Ok(Self { colors: boxes.iter().map(|colors| mean(colors)).collect(), index })
    }

    /// Returns the index of the color of each pixel.
    #[must_use]
    pub fn indices(&self, frame: &Image) -> Vec<u8> {
        frame.pixels().iter().map(|&pixel| self.index[bin_of(pixel)]).collect()
    }
}

fn bin_of([red, green, blue, _]: [u8; 4]) -> usize {
    [red, green, blue].iter().fold(0, |bin, code| bin << BITS | usize::from(code >> (8 - BITS)))
}

/// Returns the bins that hold pixels.
fn bins(frames: &[Image]) -> Vec<Bin> {
    let mut bins: Vec<Bin> = (0..BINS).map(|number| Bin { number, count: 0, sum: [0; 3] }).collect();
    for &pixel in frames.iter().flat_map(Image::pixels) {
        let bin = &mut bins[bin_of(pixel)];
        bin.count += 1;
        for (sum, code) in bin.sum.iter_mut().zip(pixel) {
            *sum += u64::from(code);
        }
    }
    bins.retain(|bin| bin.count > 0);
    bins
}

/// Returns the pixels and the sum of their colors.
fn total(colors: &[Bin]) -> (u64, [u64; 3]) {
    colors.iter().fold((0, [0; 3]), |(count, sum), bin| {
        (count + bin.count, [0, 1, 2].map(|channel| sum[channel] + bin.sum[channel]))
    })
}

fn mean(colors: &[Bin]) -> [u8; 3] {
    let (count, sum) = total(colors);
    sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8)
}

/// Returns the greatest sum of squared distances from the mean in one channel, and that channel; 0 for a single bin.
fn spread(colors: &[Bin]) -> (u128, usize) {
    let (count, sum) = total(colors);
    let of_channel = |channel: usize| {
        let squares: u128 = colors.iter().map(|bin| u128::from(bin.sum[channel]).pow(2) / u128::from(bin.count)).sum();
        (squares.saturating_sub(u128::from(sum[channel]).pow(2) / u128::from(count.max(1))), channel)
    };
    if colors.len() < 2 { (0, 0) } else { (0..3).map(of_channel).max_by_key(|(squares, _)| *squares).unwrap_or((0, 0)) }
}

/// Cuts a box with a variance in two at the mean of a channel. Neither part is empty.
fn cut(colors: &[Bin], channel: usize) -> (Vec<Bin>, Vec<Bin>) {
    let (count, sum) = total(colors);
    let is_below =
        |bin: &Bin| u128::from(bin.sum[channel]) * u128::from(count) < u128::from(sum[channel]) * u128::from(bin.count);
    let (low, high): (Vec<Bin>, Vec<Bin>) = colors.iter().copied().partition(is_below);
    if low.is_empty() { (high[..1].to_vec(), high[1..].to_vec()) } else { (low, high) }
}
