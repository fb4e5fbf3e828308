//! Blocks of 4 x 2 pixels, which are drawn together.

use super::grid::TILE;

pub const BLOCK_WIDTH: usize = 4;
pub const BLOCK_HEIGHT: usize = 2;
pub const BLOCK_PIXELS: usize = BLOCK_WIDTH * BLOCK_HEIGHT;
pub const BLOCKS_ACROSS: usize = TILE / BLOCK_WIDTH;
/// Blocks in a tile.
pub const BLOCKS: usize = BLOCKS_ACROSS * (TILE / BLOCK_HEIGHT);

/// One value a pixel: lane = x + 4 y. Aligned so that a register of them is on one cache line.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Block<T>(pub [T; BLOCK_PIXELS]);

/// Four neighbouring pixels, `x` to `x + 3`, of a tile's row: their block and first lane.
#[inline(always)]
pub fn quarter(x: usize, y: usize) -> (usize, usize) {
    let block = (y / BLOCK_HEIGHT) * BLOCKS_ACROSS + x / BLOCK_WIDTH;
    (block, (y % BLOCK_HEIGHT) * BLOCK_WIDTH)
}
