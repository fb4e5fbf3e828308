//! Random bits by integer hashing (PCG): the same on every device, for every tiling, on every run. Twin of
//! `addon/core/random.py`.

/// One step of PCG-RXS-M-XS (O'Neill 2014), as a hash.
#[inline(always)]
pub fn pcg(input: u32) -> u32 {
    let state = input.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[inline(always)]
pub fn hash(seed: u64, values: [u32; 2]) -> u32 {
    let mut state = pcg(seed as u32 ^ pcg((seed >> 32) as u32));
    for value in values {
        state = pcg(state ^ value);
    }
    state
}

/// In (0, 1), never an end.
#[inline(always)]
pub fn unit(bits: u32) -> f32 {
    ((bits >> 9) as f32 + 0.5) * (1.0 / (1 << 23) as f32)
}

/// Owen scrambling of bits in reverse order (Laine and Karras 2011, constants of Vegdahl 2021).
pub fn scrambled(reversed: u32, seed: u32) -> u32 {
    let mut x = reversed;
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x
}

/// Which fragments are there of what is partly opaque: each by chance, drawn anew for every sample. A fragment's draws
/// are spread over its samples, a van der Corput sequence scrambled and shuffled by Owen's nested permutations (Burley
/// 2020), so that of 2^n samples from the first on a share is there that differs from its opacity by less than 2^-n; and
/// each fragment's by themselves, so that what lies behind one another lets through the product. Twin of
/// `addon/effects/shared/chance.glsl`.
#[derive(Clone, Copy, Default)]
pub struct Draw {
    pub seed: u32,
    pub sample: u32,
}

impl Draw {
    /// What the draws of a triangle's fragments have in common.
    #[inline(always)]
    pub fn of_triangle(self, [instance, triangle]: [usize; 2]) -> OfTriangle {
        let key = pcg(pcg(self.seed ^ instance as u32) ^ triangle as u32);
        OfTriangle {
            key,
            sample: self.sample,
        }
    }
}

/// The draws of a triangle.
#[derive(Clone, Copy)]
pub struct OfTriangle {
    key: u32,
    sample: u32,
}

impl OfTriangle {
    /// Whether the fragment at a pixel or texel, of this opacity, is there.
    #[inline(always)]
    pub fn is_there(self, [x, y]: [i32; 2], opacity: f32) -> bool {
        let key = pcg(pcg(self.key ^ x.cast_unsigned()) ^ y.cast_unsigned());
        // Samples are shuffled within each group of 2^n that belong together.
        let index = scrambled(self.sample.reverse_bits(), pcg(key)).reverse_bits();
        unit(scrambled(index, key).reverse_bits()) < opacity
    }
}
