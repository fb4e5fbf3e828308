//! Subpixels, pixels and the tiles that they are drawn in.

use std::ops::Range;

/// Fractional bits of a snapped vertex: positions on the image are whole 1/256 pixels, so that edge
/// functions are exact integers and a shared edge can neither leak nor cover a pixel twice.
pub const SUBPIXEL_BITS: u32 = 8;
pub const SUBPIXELS: i32 = 1 << SUBPIXEL_BITS;

/// In subpixels.
pub type Point = [i32; 2];

/// Side of a tile in pixels. At four depths a texel, a tile is 64 KiB: it stays in the second-level cache.
pub const TILE: usize = 64;

/// First and last pixel of a box: x and y.
pub type Pixels = [[i32; 2]; 2];

/// The tiles that cover a rectangle of pixels, in an image or reaching beyond it.
#[derive(Clone, Copy)]
pub struct Grid {
    /// First pixel that is wanted, column and row, from the image's own.
    pub first: [i32; 2],
    pub width: usize,
    pub height: usize,
    /// Tiles are counted from the image's pixel (0, 0), so that a pixel's blocks do not depend on what is wanted.
    first_tile: [i32; 2],
    pub columns: usize,
    rows: usize,
    /// How far from their centres pixels are sampled, subpixels.
    pub reach: i32,
}

impl Grid {
    pub fn new([columns, rows]: [Range<i32>; 2]) -> Self {
        let tiles = |pixels: &Range<i32>| {
            let first = pixels.start.div_euclid(TILE as i32);
            (
                first,
                ((pixels.end - 1).div_euclid(TILE as i32) + 1 - first) as usize,
            )
        };
        let ((left, across), (bottom, along)) = (tiles(&columns), tiles(&rows));
        Grid {
            first: [columns.start, rows.start],
            width: columns.len(),
            height: rows.len(),
            first_tile: [left, bottom],
            columns: across,
            rows: along,
            reach: 0,
        }
    }

    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// First pixel of a tile, in image coordinates.
    pub fn origin(&self, tile: usize) -> [i32; 2] {
        let [left, bottom] = self.first_tile;
        [
            (left + (tile % self.columns) as i32) * TILE as i32,
            (bottom + (tile / self.columns) as i32) * TILE as i32,
        ]
    }

    /// Columns and rows of a tile that are wanted, from its origin.
    pub fn extent(&self, tile: usize) -> [Range<usize>; 2] {
        let (origin, sides) = (self.origin(tile), [self.width, self.height]);
        std::array::from_fn(|axis| {
            let first = self.first[axis] - origin[axis];
            first.max(0) as usize..(first + sides[axis] as i32).min(TILE as i32) as usize
        })
    }

    /// The tile that holds a pixel.
    #[inline(always)]
    pub fn tile_at(&self, axis: usize, pixel: i32) -> usize {
        (pixel.div_euclid(TILE as i32) - self.first_tile[axis]) as usize
    }

    /// Deals the rows of an image of what is wanted to the tiles, `take` gets a tile, its row's number among those of
    /// it that are wanted, and its part.
    pub fn deal<'a, T>(&self, image: &'a mut [T], mut take: impl FnMut(usize, usize, &'a mut [T])) {
        let [left, bottom] = self.first;
        for (index, mut row) in image.chunks_mut(self.width).enumerate() {
            let (y, mut x) = (bottom + index as i32, left);
            let tiles = self.tile_at(1, y) * self.columns;
            let number = (y.rem_euclid(TILE as i32) as usize).min(index);
            for column in 0..self.columns {
                let count = row.len().min(TILE - x.rem_euclid(TILE as i32) as usize);
                let (part, rest) = row.split_at_mut(count);
                take(tiles + column, number, part);
                (row, x) = (rest, x + count as i32);
            }
        }
    }

    /// First and last pixel that may be sampled in the bounding box; None where there is none.
    #[inline(always)]
    pub fn pixels(&self, points: &[Point]) -> Option<Pixels> {
        let (mut low, mut high) = (points[0], points[0]);
        for p in &points[1..] {
            low = [low[0].min(p[0]), low[1].min(p[1])];
            high = [high[0].max(p[0]), high[1].max(p[1])];
        }
        let first = |at: i32| (at + SUBPIXELS - 1) >> SUBPIXEL_BITS;
        let [x, y] = std::array::from_fn(|axis| {
            let (start, side) = (self.first[axis], [self.width, self.height][axis] as i32);
            [
                first(low[axis] - self.reach).max(start),
                ((high[axis] + self.reach) >> SUBPIXEL_BITS).min(start + side - 1),
            ]
        });
        (x[0] <= x[1] && y[0] <= y[1]).then_some([[x[0], y[0]], [x[1], y[1]]])
    }
}
