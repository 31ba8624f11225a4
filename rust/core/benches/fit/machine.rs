//! Limits of the machine, measured in the same run: roofline for the arithmetic of the search, and memory.

use std::hint::black_box;
use std::time::Instant;

use leafcloud::Foliage;
use leafcloud::fit::{FitSettings, sweep_once};

use crate::bandwidth::bandwidth;

/// Rates of the sweep over all offsets and limits of one core.
#[derive(Clone, Copy, Debug)]
pub struct Roofline {
    /// Multiply-adds per second in the sweep (three for each point or area vector and direction), and in a loop that does nothing else.
    pub sweep: f64,
    pub peak: f64,
    /// Bins changed per second in the sweep (two for each piece and direction), and in a loop over a table of the same size.
    pub updates: f64,
    pub most_updates: f64,
    /// Least bytes per second that the sweep must read, eight directions at a time, and bytes per second of a copy.
    pub bytes: f64,
    pub bandwidth: f64,
}

fn best_of<T>(times: usize, mut run: impl FnMut() -> T) -> f64 {
    let time = |_| {
        let started = Instant::now();
        black_box(run());
        started.elapsed().as_secs_f64()
    };
    (0..times).map(time).fold(f64::INFINITY, f64::min)
}

/// Separate multiplies and adds on many independent sums, in the widest registers that `pulp` offers.
struct MultiplyAdds(usize);

impl pulp::NullaryFnOnce for MultiplyAdds {
    type Output = f32;

    #[inline(always)]
    #[allow(clippy::inline_always)] // so that it is compiled for the processor's features
    fn call(self) -> f32 {
        let mut sums = [1.0f32; 64];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = *sum * 0.999_9 + 0.000_1;
            }
        }
        sums.iter().sum()
    }
}

/// Returns the entries changed per second by adding to scattered entries of a table in the first-level cache, as a sweep does to its bins.
fn updates() -> f64 {
    const ROWS: usize = 512;
    const TIMES: usize = 1 << 22;
    let places: Vec<u32> = (0..4096u32).map(|i| i.wrapping_mul(2_654_435_761) % (8 * ROWS as u32)).collect();
    let mut table = vec![0i32; 8 * ROWS];
    let seconds = best_of(5, || {
        for _ in 0..TIMES / places.len() {
            for &place in black_box(&places) {
                table[place as usize] += 1;
            }
        }
        table[0]
    });
    TIMES as f64 / seconds
}

pub fn roofline(foliage: &Foliage) -> Roofline {
    const ROUNDS: usize = 200_000;
    const OCTETS: usize = 32;
    let epsilon = FitSettings::default().epsilon;
    // The time for three times the directions minus the time for once: the work before the sweep cancels out.
    let twice = best_of(5, || sweep_once(foliage, epsilon, 3 * OCTETS));
    let once = best_of(5, || sweep_once(foliage, epsilon, OCTETS));
    let (vectors, updated, _) = sweep_once(foliage, epsilon, 2 * OCTETS);
    let seconds = twice - once;
    let peak = best_of(5, || pulp::Arch::new().dispatch(MultiplyAdds(black_box(ROUNDS))));
    Roofline {
        sweep: 3.0 * vectors as f64 / seconds,
        peak: (64 * ROUNDS) as f64 / peak,
        updates: updated as f64 / seconds,
        most_updates: updates(),
        bytes: 12.0 * vectors as f64 / 8.0 / seconds,
        bandwidth: bandwidth(),
    }
}

/// Returns the peak memory of this process in bytes; 0 on systems that do not report it.
pub fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Resets the peak memory to the current use.
pub fn forget_peak() {
    // Writing 5 resets the peak (proc(5)). If that is not allowed, the old peak stays, which is at least as high.
    drop(std::fs::write("/proc/self/clear_refs", "5"));
}
