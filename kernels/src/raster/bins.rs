//! Sorting set-up triangles into tiles, in parallel and in a fixed order.

use super::camera::{Camera, SUBPIXEL_BITS, SUBPIXELS, winding_normal};
use super::edge::edge;
use super::setup::{Point, Polygon, Triangle};
use crate::cancel::CancelFlag;
use crate::geometry::{Data, Instance};
use crate::simd::{Simd, Work, dispatch};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile in pixels. At four depths a texel, a tile is 64 KiB: it stays in the second-level cache.
pub const TILE: usize = 64;

/// Triangles set up by one task; fixed, so that the order of work never depends on the thread count.
const CHUNK: usize = 8192;

/// Marks an item of a bin as an index into the polygons.
const POLYGON: u32 = 1 << 31;

/// Triangles of one instance.
struct Piece {
    instance: usize,
    triangles: Range<usize>,
    /// Id of the instance's triangle 0.
    first_id: u32,
}

/// What one task set up, sorted by tile.
pub struct Chunk {
    triangles: Vec<Triangle>,
    polygons: Vec<Polygon>,
    /// Items of tile `t` are `items[starts[t]..starts[t + 1]]`, in the order of their ids.
    starts: Vec<u32>,
    items: Vec<u32>,
}

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
    fn tile_at(&self, axis: usize, pixel: i32) -> usize {
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

    /// First and last pixel whose centre lies in the bounding box; None where there is none.
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
                first(low[axis]).max(start),
                (high[axis] >> SUBPIXEL_BITS).min(start + side - 1),
            ]
        });
        (x[0] <= x[1] && y[0] <= y[1]).then_some([[x[0], y[0]], [x[1], y[1]]])
    }
}

/// What a tile draws.
pub enum Item<'a> {
    Triangle(&'a Triangle),
    Polygon(&'a Polygon),
}

pub struct Bins {
    pub grid: Grid,
    /// In the order of their ids.
    pub chunks: Vec<Chunk>,
}

impl Chunk {
    /// What a tile draws, in the order of the ids; for [`Chunk::item`].
    #[inline(always)]
    pub fn items(&self, tile: usize) -> &[u32] {
        &self.items[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    #[inline(always)]
    pub fn item(&self, item: u32) -> Item<'_> {
        if item & POLYGON == 0 {
            Item::Triangle(&self.triangles[item as usize])
        } else {
            Item::Polygon(&self.polygons[(item & !POLYGON) as usize])
        }
    }
}

impl Bins {
    pub fn is_empty(&self, tile: usize) -> bool {
        self.chunks.iter().all(|chunk| chunk.items(tile).is_empty())
    }
}

/// Id of each instance's triangle 0, and the number of all triangles at the end.
pub fn first_ids(data: &Data) -> PyResult<Vec<u32>> {
    let mut total = 0usize;
    let mut ids = Vec::with_capacity(data.instances.len() + 1);
    for instance in &data.instances {
        ids.push(total as u32);
        total += data.meshes[instance.mesh].triangles.len();
        if total >= u32::MAX as usize {
            return Err(PyValueError::new_err(
                "more than 4294967294 triangles over all instances",
            ));
        }
    }
    ids.push(total as u32);
    Ok(ids)
}

/// Groups the triangles of the drawn instances into tasks of about [`CHUNK`].
fn tasks(data: &Data, drawn: &[bool], ids: &[u32]) -> Vec<Vec<Piece>> {
    let (mut tasks, mut pieces, mut filled) = (Vec::new(), Vec::new(), 0);
    for (index, instance) in data.instances.iter().enumerate().filter(|(i, _)| drawn[*i]) {
        let count = data.meshes[instance.mesh].triangles.len();
        let mut start = 0;
        while start < count {
            let end = count.min(start + CHUNK - filled);
            pieces.push(Piece {
                instance: index,
                triangles: start..end,
                first_id: ids[index],
            });
            filled += end - start;
            start = end;
            if filled == CHUNK {
                tasks.push(std::mem::take(&mut pieces));
                filled = 0;
            }
        }
    }
    if !pieces.is_empty() {
        tasks.push(pieces);
    }
    tasks
}

struct SetUpChunk<'a> {
    data: &'a Data,
    camera: &'a Camera,
    grid: Grid,
    pieces: &'a [Piece],
}

/// Whether a triangle is there, not there, or there where its alpha says so.
#[derive(Clone, Copy, PartialEq)]
enum Alpha {
    Opaque,
    Absent,
    Tested,
}

fn alpha(data: &Data, instance: &Instance, slot: u32) -> Alpha {
    let cutout = &data.cutouts[instance.material(slot) as usize];
    if !cutout.is_uniform() {
        Alpha::Tested
    } else if cutout.is_opaque([0.0; 2]) {
        Alpha::Opaque
    } else {
        Alpha::Absent
    }
}

impl SetUpChunk<'_> {
    /// Notes the item for every tile that the outline may touch.
    #[inline(always)]
    fn bin(&self, points: &[Point], [[x0, y0], [x1, y1]]: Pixels, item: u32, pairs: &mut Vec<(u32, u32)>) {
        let (tx0, tx1) = (self.grid.tile_at(0, x0), self.grid.tile_at(0, x1) + 1);
        let (ty0, ty1) = (self.grid.tile_at(1, y0), self.grid.tile_at(1, y1) + 1);
        let few = tx1 - tx0 <= 2 && ty1 - ty0 <= 2;
        for ty in ty0..ty1 {
            for tx in tx0..tx1 {
                let tile = ty * self.grid.columns + tx;
                if few || self.touches(points, tile) {
                    pairs.push((tile as u32, item));
                }
            }
        }
    }

    fn touches(&self, points: &[Point], tile: usize) -> bool {
        let origin = self.grid.origin(tile);
        (0..points.len()).all(|i| {
            let [a, b] = [points[i], points[(i + 1) % points.len()]].map(|p| p.map(i64::from));
            edge(a, b).largest(origin) >= 0
        })
    }
}

impl Work for SetUpChunk<'_> {
    type Output = Chunk;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Chunk {
        let (camera, grid) = (self.camera, &self.grid);
        let count = self.pieces.iter().map(|piece| piece.triangles.len()).sum();
        let mut triangles: Vec<Triangle> = Vec::with_capacity(count);
        let mut pairs = Vec::with_capacity(count + count / 4);
        let mut polygons = Vec::new();
        for piece in self.pieces {
            let instance = &self.data.instances[piece.instance];
            let mesh = &self.data.meshes[instance.mesh];
            let to_view = self.camera.object_to_view(&instance.matrix);
            let slots: Vec<Alpha> = (0..instance.slot_materials.len() as u32)
                .map(|slot| alpha(self.data, instance, slot))
                .collect();
            let uniform =
                (slots.iter().all(|&a| a == slots[0]) || mesh.triangle_slots.is_empty()).then_some(slots[0]);
            if uniform == Some(Alpha::Absent) {
                continue;
            }
            for index in piece.triangles.clone() {
                let alpha = uniform.unwrap_or_else(|| {
                    let slot = mesh.triangle_slots[index] as usize;
                    slots[slot.min(slots.len() - 1)]
                });
                if alpha == Alpha::Absent {
                    continue;
                }
                let id = piece.first_id + index as u32;
                let [a, b, c] = mesh.triangle_positions(index);
                let p = [to_view.point(a), to_view.point(b), to_view.point(c)];
                let normal = to_view.normal(winding_normal([a, b, c]));
                let drawable = camera.is_drawable(p[0]) & camera.is_drawable(p[1]) & camera.is_drawable(p[2]);
                if drawable && alpha == Alpha::Opaque {
                    if let Some((triangle, pixels)) = camera.set_up(grid, &p, normal, id) {
                        self.bin(&triangle.points, pixels, triangles.len() as u32, &mut pairs);
                        triangles.push(triangle);
                    }
                } else {
                    let tested = alpha == Alpha::Tested;
                    if let Some((polygon, pixels)) = camera.set_up_polygon(grid, &p, normal, id, tested) {
                        let item = polygons.len() as u32 | POLYGON;
                        self.bin(polygon.points(), pixels, item, &mut pairs);
                        polygons.push(polygon);
                    }
                }
            }
        }
        let (starts, items) = sort_by_tile(&pairs, self.grid.count());
        Chunk {
            triangles,
            polygons,
            starts,
            items,
        }
    }
}

/// A stable counting sort.
fn sort_by_tile(pairs: &[(u32, u32)], tiles: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; tiles + 1];
    for &(tile, _) in pairs {
        starts[tile as usize + 1] += 1;
    }
    for tile in 0..tiles {
        starts[tile + 1] += starts[tile];
    }
    let (mut next, mut items) = (starts.clone(), vec![0; pairs.len()]);
    for &(tile, item) in pairs {
        let at = &mut next[tile as usize];
        items[*at as usize] = item;
        *at += 1;
    }
    (starts, items)
}

/// Sets up the triangles of the drawn instances and sorts them into the grid's tiles.
pub fn bin_triangles(
    data: &Data,
    drawn: &[bool],
    ids: &[u32],
    camera: &Camera,
    grid: Grid,
    cancel: &CancelFlag,
) -> PyResult<Bins> {
    let chunks = tasks(data, drawn, ids)
        .par_iter()
        .map(|pieces| {
            cancel.check()?;
            Ok(dispatch(SetUpChunk {
                data,
                camera,
                grid,
                pieces,
            }))
        })
        .collect::<PyResult<Vec<Chunk>>>()?;
    Ok(Bins { grid, chunks })
}
