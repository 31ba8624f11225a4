//! Arithmetic on eight floats at once: AVX2 if the processor has it (`pulp` detects it at run time), else plain arrays.
//!
//! Only operations that IEEE 754 defines to the last bit are used, none of them fused: results are the same on every processor.

/// Numbers per operation.
pub const LANES: usize = 8;

/// Eight integers.
pub type Integers = [i32; LANES];

/// 2²³: adding it to a number below 2²³ rounds to an integer and leaves its bits in the mantissa.
const WHOLE_FROM: f32 = 8_388_608.0;
const MANTISSA: u32 = 0x007F_FFFF;

/// Operations on eight floats.
pub trait Eight: Copy {
    /// Eight floats.
    type Floats: Copy;

    fn load(self, x: [f32; LANES]) -> Self::Floats;
    fn splat(self, x: f32) -> Self::Floats;
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn abs(self, a: Self::Floats) -> Self::Floats;
    /// Returns the smaller numbers; inputs must not be NaN.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Returns the greater numbers; inputs must not be NaN.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Returns the nearest integers; inputs must lie in [0, 2²²).
    fn nearest(self, a: Self::Floats) -> Integers;
    /// Returns a bit for each lane, lane 0 lowest: whether `a` ≤ `b`.
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// Returns `value` in lanes with `from` < `to` and `a` ≥ `b`, else 0.
    fn chosen(self, value: Integers, from: Integers, to: Integers, a: Self::Floats, b: Self::Floats) -> Integers;
}

/// A computation that runs on any [`Eight`].
pub trait Kernel {
    type Output;

    fn run<E: Eight>(self, eight: E) -> Self::Output;
}

/// Runs a kernel with the best available instructions.
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return v3.vectorize(OnAvx2(kernel, v3));
    }
    kernel.run(Plain)
}

#[cfg(target_arch = "x86_64")]
struct OnAvx2<K>(K, pulp::x86::V3);

#[cfg(target_arch = "x86_64")]
#[allow(clippy::inline_always)] // only code inlined into a function with the processor's features can use them
impl<K: Kernel> pulp::NullaryFnOnce for OnAvx2<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.0.run(self.1)
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(clippy::inline_always)] // as above
impl Eight for pulp::x86::V3 {
    type Floats = pulp::f32x8;

    #[inline(always)]
    fn load(self, x: [f32; LANES]) -> Self::Floats {
        pulp::cast(x)
    }
    #[inline(always)]
    fn splat(self, x: f32) -> Self::Floats {
        self.splat_f32x8(x)
    }
    #[inline(always)]
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.add_f32x8(a, b)
    }
    #[inline(always)]
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.sub_f32x8(a, b)
    }
    #[inline(always)]
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.mul_f32x8(a, b)
    }
    #[inline(always)]
    fn abs(self, a: Self::Floats) -> Self::Floats {
        self.abs_f32x8(a)
    }
    #[inline(always)]
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.min_f32x8(a, b)
    }
    #[inline(always)]
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        self.max_f32x8(a, b)
    }
    #[inline(always)]
    fn nearest(self, a: Self::Floats) -> Integers {
        let bits: pulp::u32x8 = pulp::cast(self.add_f32x8(a, self.splat_f32x8(WHOLE_FROM)));
        pulp::cast(self.and_u32x8(bits, self.splat_u32x8(MANTISSA)))
    }
    #[inline(always)]
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32 {
        self.avx._mm256_movemask_ps(pulp::cast(self.cmp_le_f32x8(a, b))) as u32
    }
    #[inline(always)]
    fn chosen(self, value: Integers, from: Integers, to: Integers, a: Self::Floats, b: Self::Floats) -> Integers {
        let both = self.and_m32x8(self.cmp_lt_i32x8(pulp::cast(from), pulp::cast(to)), self.cmp_ge_f32x8(a, b));
        pulp::cast(self.select_i32x8(both, pulp::cast(value), self.splat_i32x8(0)))
    }
}

/// Scalar implementation on arrays.
#[derive(Clone, Copy, Debug)]
pub struct Plain;

fn each(a: [f32; LANES], b: [f32; LANES], operation: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|l| operation(a[l], b[l]))
}

impl Eight for Plain {
    type Floats = [f32; LANES];

    fn load(self, x: [f32; LANES]) -> Self::Floats {
        x
    }
    fn splat(self, x: f32) -> Self::Floats {
        [x; LANES]
    }
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        each(a, b, |a, b| a + b)
    }
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        each(a, b, |a, b| a - b)
    }
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        each(a, b, |a, b| a * b)
    }
    fn abs(self, a: Self::Floats) -> Self::Floats {
        a.map(f32::abs)
    }
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    fn nearest(self, a: Self::Floats) -> Integers {
        a.map(|x| ((x + WHOLE_FROM).to_bits() & MANTISSA) as i32)
    }
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> u32 {
        (0..LANES).map(|l| u32::from(a[l] <= b[l]) << l).sum()
    }
    fn chosen(self, value: Integers, from: Integers, to: Integers, a: Self::Floats, b: Self::Floats) -> Integers {
        std::array::from_fn(|l| if from[l] < to[l] && a[l] >= b[l] { value[l] } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Runs every operation on the same numbers.
    struct All([f32; LANES], [f32; LANES]);

    impl Kernel for All {
        type Output = Vec<i32>;

        fn run<E: Eight>(self, e: E) -> Vec<i32> {
            let (a, b) = (e.load(self.0), e.load(self.1));
            let inside = |x| e.min(e.max(x, e.splat(0.0)), e.splat(4096.0));
            let floats = [e.add(a, b), e.sub(a, b), e.mul(a, b), e.abs(a), e.min(a, b), e.max(a, b)];
            let mut seen: Vec<i32> =
                floats.into_iter().flat_map(|x| e.nearest(inside(e.mul(x, e.splat(8.0))))).collect();
            let (from, to) = (e.nearest(inside(a)), e.nearest(inside(b)));
            seen.extend(e.chosen([1, 2, 3, 4, 5, 6, 7, 8], from, to, a, b));
            seen.push(e.at_most(a, b) as i32);
            seen
        }
    }

    proptest! {
        #[test]
        fn the_processors_best_gives_the_same_bits(a in prop::array::uniform8(-600f32..600.0), b in prop::array::uniform8(-600f32..600.0)) {
            prop_assert_eq!(dispatch(All(a, b)), All(a, b).run(Plain));
        }
    }

    #[test]
    fn nearest_and_chosen_by_definition() {
        let e = Plain;
        assert_eq!(e.nearest([0.0, 0.4, 0.6, 1.0, 2.5, 3.5, 100.2, 4_000_000.0]), [0, 0, 1, 1, 2, 4, 100, 4_000_000]);
        let (from, to) = ([0, 1, 2, 3, 0, 0, 0, 0], [1, 1, 3, 2, 1, 1, 1, 1]);
        let chosen = e.chosen([9; 8], from, to, [1.0; 8], [1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 0.0, 1.5]);
        assert_eq!(chosen, [9, 0, 9, 0, 0, 9, 9, 0]);
    }
}
