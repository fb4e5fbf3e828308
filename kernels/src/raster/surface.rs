//! The surface that a view sees: a visibility buffer first, then only the attributes asked for.

use super::bins::Bins;
use super::block::{BLOCK_PIXELS, BLOCK_WIDTH, BLOCKS, Block, quarter};
use super::hit::{Finder, Hit};
use super::shade::{shade, split};
use super::sink::Sink;
use super::tile::draw_tile;
use crate::cancel::CancelFlag;
use crate::simd::{Eight, Simd, Work, dispatch};
use crate::surface::{Images, Row};
use pyo3::prelude::*;
use rayon::prelude::*;

/// No triangle.
const NOTHING: u32 = u32::MAX;

/// What lies before a surface by less than this share of its distance touches it: single precision tells no more.
const CONTACT: f32 = 1e-6;

/// Nearest triangle of each pixel. Items come in the order of their ids and only a smaller depth
/// replaces, so that equal depths go to the lowest (instance, triangle).
struct Visibility {
    depths: Vec<Block<f32>>,
    ids: Vec<Block<u32>>,
    /// The farthest depth of each block.
    farthest: Vec<f32>,
}

impl Sink for Visibility {
    #[inline(always)]
    fn hides(&self, block: usize, nearest: f32) -> bool {
        nearest >= self.farthest[block]
    }

    #[inline(always)]
    fn wants<V: Eight>(&self, v: V, block: usize, depths: V::Floats) -> bool {
        v.bits(v.less(depths, v.load(&self.depths[block].0))) != 0
    }

    #[inline(always)]
    fn keep<V: Eight>(&mut self, v: V, block: usize, depths: V::Floats, id: u32) {
        let (kept, ids) = (v.load(&self.depths[block].0), v.load_ints(&self.ids[block].0));
        let nearer = v.less(depths, kept);
        let kept = v.select(nearer, depths, kept);
        v.store(kept, &mut self.depths[block].0);
        self.farthest[block] = v.largest(kept);
        let id = v.splat_int(id.cast_signed());
        v.store_ints(v.select_ints(nearer, id, ids), &mut self.ids[block].0);
    }
}

impl Visibility {
    fn new() -> Self {
        Visibility {
            depths: vec![Block([f32::INFINITY; BLOCK_PIXELS]); BLOCKS],
            ids: vec![Block([NOTHING; BLOCK_PIXELS]); BLOCKS],
            farthest: vec![f32::INFINITY; BLOCKS],
        }
    }

    fn clear(&mut self) {
        self.depths.fill(Block([f32::INFINITY; BLOCK_PIXELS]));
        self.ids.fill(Block([NOTHING; BLOCK_PIXELS]));
        self.farthest.fill(f32::INFINITY);
    }

    /// Lets in only what is nearer than what a tile shows already: `rows`, depths from column `left` on, by row of the
    /// tile.
    fn limit<'a>(&mut self, left: usize, rows: impl Iterator<Item = (usize, &'a [f32])>) {
        for (y, depths) in rows {
            for (x, depth) in (left..).zip(depths) {
                let (block, lane) = quarter(x, y);
                self.depths[block].0[lane + x % BLOCK_WIDTH] = depth * (1.0 - CONTACT);
            }
        }
        for (farthest, depths) in self.farthest.iter_mut().zip(&self.depths) {
            *farthest = depths.0.into_iter().fold(f32::NEG_INFINITY, f32::max);
        }
    }

    /// The triangle at a tile's pixel.
    fn id(&self, x: usize, y: usize) -> u32 {
        let (block, lane) = quarter(x, y);
        self.ids[block].0[lane + x % BLOCK_WIDTH]
    }
}

struct DrawTile<'a> {
    bins: &'a Bins,
    finder: &'a Finder<'a>,
    tile: usize,
    visibility: &'a mut Visibility,
}

impl Work for DrawTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        draw_tile(simd.eight(), self.bins, self.tile, self.finder, self.visibility);
    }
}

/// Triangles found lately, by the low bits of their ids: rows show mostly what the row below showed.
const FOUND: usize = 64;

struct ShadeTile<'a, 'b> {
    bins: &'a Bins,
    finder: &'a Finder<'a>,
    tile: usize,
    visibility: &'a Visibility,
    rows: &'a mut [Row<'b>],
}

impl Work for ShadeTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let grid = self.bins.grid;
        let (origin, [columns, rows]) = (grid.origin(self.tile), grid.extent(self.tile));
        let left = columns.start;
        let mut found: [Option<(u32, Hit)>; FOUND] = [const { None }; FOUND];
        for (row, y) in self.rows.iter_mut().zip(rows) {
            let id = |x: usize| self.visibility.id(left + x, y);
            let first = [origin[0] + left as i32, origin[1] + y as i32];
            let mut x = 0;
            while x < columns.len() {
                let (start, here) = (x, id(x));
                x += 1;
                while x < columns.len() && id(x) == here {
                    x += 1;
                }
                if here == NOTHING {
                    row.clear(start..x);
                    continue;
                }
                let place = &mut found[here as usize % FOUND];
                if place.as_ref().is_none_or(|(id, _)| *id != here) {
                    *place = Some((here, self.finder.find(here)));
                }
                if let Some((_, hit)) = place {
                    shade(row, start..x, self.finder, first, hit);
                }
            }
        }
    }
}

/// Fills the wanted attributes of the grid's rows.
pub fn surface(bins: &Bins, finder: &Finder, images: &mut Images, cancel: &CancelFlag) -> PyResult<()> {
    let tiles = split(images, bins.grid).into_par_iter().enumerate();
    tiles.try_for_each_init(Visibility::new, |visibility, (tile, mut rows)| {
        cancel.check()?;
        visibility.clear();
        dispatch(DrawTile {
            bins,
            finder,
            tile,
            visibility,
        });
        dispatch(ShadeTile {
            bins,
            finder,
            tile,
            visibility,
            rows: &mut rows,
        });
        Ok::<(), PyErr>(())
    })
}

/// The objects of what lies before `depths`, both over the grid's rows; -1 where nothing does.
pub fn before(bins: &Bins, finder: &Finder, depths: &[f32], cancel: &CancelFlag) -> PyResult<Vec<i32>> {
    let grid = bins.grid;
    let mut images = Images {
        object_id: Some(vec![-1; depths.len()]),
        ..Images::default()
    };
    let tiles = split(&mut images, bins.grid).into_par_iter().enumerate();
    tiles.try_for_each_init(Visibility::new, |visibility, (tile, mut parts)| {
        cancel.check()?;
        if bins.is_empty(tile) {
            return Ok(());
        }
        visibility.clear();
        let (origin, [columns, rows]) = (grid.origin(tile), grid.extent(tile));
        let [across, along] = [0, 1].map(|axis| (origin[axis] - grid.first[axis]) as isize);
        let place = |from: isize, inside: usize| (from + inside as isize) as usize;
        let shown = rows.clone().map(|y| {
            let row = &depths[place(along, y) * grid.width..][..grid.width];
            (y, &row[place(across, columns.start)..place(across, columns.end)])
        });
        visibility.limit(columns.start, shown);
        dispatch(DrawTile {
            bins,
            finder,
            tile,
            visibility,
        });
        for (row, y) in parts.iter_mut().zip(rows) {
            let objects = row.object_id.as_deref_mut().expect("it was asked for");
            for (x, object) in objects.iter_mut().enumerate() {
                let id = visibility.id(columns.start + x, y);
                if id != NOTHING {
                    *object = finder.instance(id).object_id;
                }
            }
        }
        Ok::<(), PyErr>(())
    })?;
    Ok(images.object_id.unwrap_or_default())
}
