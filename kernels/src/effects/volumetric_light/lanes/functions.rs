//! Elementary functions of single precision that compilers can do sixteen of at once.

#[inline(always)]
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// e^x for x <= 0, to 2 units in the last place; 0 below -87.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let clamped = if x > -87.0 { x } else { -87.0 };
    let shifted = clamped * std::f32::consts::LOG2_E + SHIFT;
    let whole = shifted - SHIFT;
    let rest = (clamped - whole * 0.693_359_4) + whole * 2.121_944_4e-4;
    let series = 1.0
        + rest
            * (1.0
                + rest
                    * (0.5
                        + rest
                            * (0.166_666_55
                                + rest * (0.041_666_485 + rest * (0.008_363_913 + rest * 0.001_381_777_8)))));
    let power = f32::from_bits(((shifted.to_bits() as i32) << 23).wrapping_add(0x3f80_0000) as u32);
    if x < -87.0 { 0.0 } else { series * power }
}

/// ln(1 + x) for x >= 0: the logarithm of the rounded sum, times what the rounding did to x (Goldberg 1991).
#[inline(always)]
pub fn ln_1p(x: f32) -> f32 {
    let sum = 1.0 + x;
    // The mantissa between sqrt(1/2) and sqrt(2).
    let bits = sum.to_bits() as i32 - 0x3f35_04f3;
    let exponent = (bits >> 23) as f32;
    let m = f32::from_bits(((bits & 0x007f_ffff) + 0x3f35_04f3) as u32) - 1.0;
    let t = m / (2.0 + m);
    let t2 = t * t;
    let series = 2.0 * t * (1.0 + t2 * (0.333_333_3 + t2 * (0.200_000_5 + t2 * (0.142_8 + t2 * 0.117))));
    let log = exponent * std::f32::consts::LN_2 + series;
    let grown = sum - 1.0;
    if grown == 0.0 { x } else { log * (x / grown) }
}

/// sinh for |x| <= 1, by its series.
#[inline(always)]
pub fn sinh(x: f32) -> f32 {
    let x2 = x * x;
    x * (1.0 + x2 / 6.0 * (1.0 + x2 / 20.0 * (1.0 + x2 / 42.0 * (1.0 + x2 / 72.0))))
}

/// sinh(x) and cosh(x) - 1 for |x| <= 2: from a panel's start, where z = c sinh(y) has the slope c cosh(y), x further
/// z has grown by z (cosh(x) - 1) + slope sinh(x), and the slope by slope (cosh(x) - 1) + z sinh(x).
#[inline(always)]
pub fn further(x: f32) -> (f32, f32) {
    let half = sinh(0.5 * x);
    let twice = 2.0 * half;
    (twice * (1.0 + half * half).sqrt(), twice * half)
}

/// 1 / sqrt(x) for 1e-30 < x < 1e30, to 3 units in the last place: three of Newton's steps from a guess by halving the
/// exponent (Lomont 2003). A third of the time of a root and a division, and the same on every processor.
#[inline(always)]
pub fn inverse_root(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86 - (x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// acos for |x| <= 1, to 7e-5 (Abramowitz and Stegun 4.4.45).
#[inline(always)]
pub fn acos(x: f32) -> f32 {
    let y = x.abs();
    let series = 1.570_728_8 + y * (-0.212_114_4 + y * (0.074_261 - y * 0.018_729_3));
    let angle = (1.0 - y).sqrt() * series;
    if x < 0.0 {
        std::f32::consts::PI - angle
    } else {
        angle
    }
}

/// cos for x from 0 to pi, as the sine of what is missing to a quarter turn, by its series, to 4e-6.
#[inline(always)]
pub fn cos(x: f32) -> f32 {
    let t = std::f32::consts::FRAC_PI_2 - x;
    let t2 = t * t;
    t * (1.0 - t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0))))
}
