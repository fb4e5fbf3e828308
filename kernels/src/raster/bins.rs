//! Sorting set-up triangles into tiles, in parallel and in a fixed order.

use super::camera::{Camera, winding_normal};
use super::edge::edge;
use super::grid::{Grid, Pixels, Point, SUBPIXELS};
use super::presence::{Presence, Rule};
use super::setup::{Polygon, Triangle};
use crate::cancel::CancelFlag;
use crate::geometry::Data;
use crate::simd::{Simd, Work, dispatch};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::ops::Range;

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
    rule: Rule,
    pieces: &'a [Piece],
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
            let edge = edge(a, b);
            // Of pixels that are sampled beside their centres.
            let beside = i64::from(self.grid.reach / SUBPIXELS + i32::from(self.grid.reach > 0));
            edge.largest(origin) + (edge.dx.abs() + edge.dy.abs()) * beside >= 0
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
            let materials = instance.slot_materials.iter();
            let slots: Vec<Presence> = materials
                .map(|&material| self.rule.presence(&self.data.materials[material as usize]))
                .collect();
            let uniform =
                (slots.iter().all(|&a| a == slots[0]) || mesh.triangle_slots.is_empty()).then_some(slots[0]);
            if uniform == Some(Presence::Never) {
                continue;
            }
            for index in piece.triangles.clone() {
                let presence = uniform.unwrap_or_else(|| {
                    let slot = mesh.triangle_slots[index] as usize;
                    slots[slot.min(slots.len() - 1)]
                });
                if presence == Presence::Never {
                    continue;
                }
                let id = piece.first_id + index as u32;
                let [a, b, c] = mesh.triangle_positions(index);
                let p = [to_view.point(a), to_view.point(b), to_view.point(c)];
                let normal = to_view.normal(winding_normal([a, b, c]));
                let drawable = camera.is_drawable(p[0]) & camera.is_drawable(p[1]) & camera.is_drawable(p[2]);
                if drawable && presence == Presence::Always {
                    if let Some((triangle, pixels)) = camera.set_up(grid, &p, normal, id) {
                        self.bin(&triangle.points, pixels, triangles.len() as u32, &mut pairs);
                        triangles.push(triangle);
                    }
                } else {
                    let tested = presence == Presence::Tested;
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
    rule: Rule,
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
                rule,
                pieces,
            }))
        })
        .collect::<PyResult<Vec<Chunk>>>()?;
    Ok(Bins { grid, chunks })
}
