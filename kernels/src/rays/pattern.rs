//! Light samples: an Owen-scrambled Sobol' (0, 2) sequence, whose first n points are well spread for every n.
//!
//! Randomness is integer hashing (PCG) of seed, point and sample. A point takes one of [`TABLES`] scrambled
//! copies and turns over random bits of all its samples: that keeps every stratum, since it maps dyadic
//! intervals to dyadic intervals, and makes each sample uniform, so that estimates are free of bias.

use crate::random::{hash, pcg, scrambled, unit};
use crate::simd::{LANES, Lanes};

const TABLES: usize = 64;

/// Second dimension of Sobol's sequence, bits in reverse order.
fn sobol(index: u32) -> u32 {
    let (mut result, mut column) = (0u32, 1u32 << 31);
    for bit in 0..32 {
        if index >> bit & 1 != 0 {
            result ^= column;
        }
        column ^= column >> 1;
    }
    result.reverse_bits()
}

fn interleaved(x: u32, y: u32) -> u64 {
    (0..16).fold(0, |key, bit| {
        let (x, y) = (u64::from(x >> (16 + bit) & 1), u64::from(y >> (16 + bit) & 1));
        key | x << (2 * bit) | y << (2 * bit + 1)
    })
}

pub struct Pattern {
    pub count: usize,
    batches: usize,
    /// Bits of u and v: by table, then by batch.
    bits: Vec<[[u32; LANES]; 2]>,
}

/// A point's own copy of the pattern.
#[derive(Clone, Copy)]
pub struct Turn {
    table: usize,
    flip: [u32; 2],
}

impl Pattern {
    /// `count` samples of the sequence from its number `first` on.
    pub fn new(first: u32, count: usize, seed: u64) -> Self {
        let batches = count.div_ceil(LANES);
        let mut bits = Vec::with_capacity(TABLES * batches);
        for table in 0..TABLES as u32 {
            let keys = [hash(seed, [table, 0x51]), hash(seed, [table, 0xa7])];
            let mut samples: Vec<[u32; 2]> = (first..first + count as u32)
                .map(|i| [scrambled(i, keys[0]), scrambled(sobol(i), keys[1])].map(u32::reverse_bits))
                .collect();
            // Neighbours on the light into one packet: its rays then visit the same boxes.
            samples.sort_by_key(|&[x, y]| interleaved(x, y));
            bits.extend(samples.chunks(LANES).map(|chunk| {
                let mut batch = [[0; LANES]; 2];
                for (lane, sample) in chunk.iter().enumerate() {
                    batch[0][lane] = sample[0];
                    batch[1][lane] = sample[1];
                }
                batch
            }));
        }
        Pattern { count, batches, bits }
    }

    #[inline(always)]
    pub fn batches(&self) -> usize {
        self.batches
    }

    /// `key`: a hash of the point.
    #[inline(always)]
    pub fn turn(&self, key: u32) -> Turn {
        Turn {
            table: key as usize % TABLES,
            flip: [pcg(key ^ 0x68bc_21eb), pcg(key ^ 0x02e5_be93)],
        }
    }

    /// u and v of a batch of samples; lanes beyond `count` repeat something.
    #[inline(always)]
    pub fn samples(&self, turn: Turn, batch: usize) -> [Lanes; 2] {
        let bits = &self.bits[turn.table * self.batches + batch];
        let mut result = [[0.0; LANES]; 2];
        for axis in 0..2 {
            for lane in 0..LANES {
                result[axis][lane] = unit(bits[axis][lane] ^ turn.flip[axis]);
            }
        }
        result
    }
}
