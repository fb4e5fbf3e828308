//! The surface that a view sees: a visibility buffer first, then only the attributes asked for.

use super::bins::{Bins, TILE};
use super::camera::Camera;
use super::hit::{Finder, Hit};

use super::simd::{LANES, Lanes, Vector, Work, run_widest};
use super::tile::{BLOCK_WIDTH, BLOCKS, Sink, draw_tile, quarter};
use crate::cancel::CancelFlag;
use crate::vector::dot;
use pyo3::prelude::*;
use rayon::prelude::*;

/// No triangle.
const NOTHING: u32 = u32::MAX;

/// What lies before a surface by less than this share of its distance touches it: single precision tells no more.
const CONTACT: f32 = 1e-6;

/// Nearest triangle of each pixel. Items come in the order of their ids and only a smaller depth
/// replaces, so that equal depths go to the lowest (instance, triangle).
struct Visibility {
    depths: Vec<Lanes<f32>>,
    ids: Vec<Lanes<i32>>,
}

impl Sink for Visibility {
    #[inline(always)]
    fn wants<V: Vector>(&self, v: V, block: usize, depths: V::Float) -> bool {
        v.bits(v.less(depths, v.floats(&self.depths[block]))) != 0
    }

    #[inline(always)]
    fn keep<V: Vector>(&mut self, v: V, block: usize, depths: V::Float, id: u32) {
        let (kept, ids) = (v.floats(&self.depths[block]), v.ints(&self.ids[block]));
        let nearer = v.less(depths, kept);
        v.store_floats(v.select(nearer, depths, kept), &mut self.depths[block]);
        let id = v.splat_int(id.cast_signed());
        v.store_ints(v.select_int(nearer, id, ids), &mut self.ids[block]);
    }
}

impl Visibility {
    fn new() -> Self {
        Visibility {
            depths: vec![Lanes([f32::INFINITY; LANES]); BLOCKS],
            ids: vec![Lanes([NOTHING.cast_signed(); LANES]); BLOCKS],
        }
    }

    fn clear(&mut self) {
        self.depths.fill(Lanes([f32::INFINITY; LANES]));
        self.ids.fill(Lanes([NOTHING.cast_signed(); LANES]));
    }

    /// Lets in only what is nearer than a pixel of a tile already shows.
    fn limit(&mut self, x: usize, y: usize, depth: f32) {
        let (block, lane) = quarter(x, y);
        self.depths[block].0[lane + x % BLOCK_WIDTH] = depth * (1.0 - CONTACT);
    }

    /// The triangle at a tile's pixel.
    fn id(&self, x: usize, y: usize) -> u32 {
        let (block, lane) = quarter(x, y);
        self.ids[block].0[lane + x % BLOCK_WIDTH].cast_unsigned()
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
    fn run<V: Vector>(self, v: V) {
        draw_tile(v, self.bins, self.tile, self.finder, self.visibility);
    }
}

/// Arrays to fill, row-major over the wanted rows; None is not wanted and costs nothing.
#[derive(Default)]
pub struct Attributes<T3, T2, T1, I> {
    pub position: Option<T3>,
    pub geometric_normal: Option<T3>,
    pub shading_normal: Option<T3>,
    pub uv: Option<T2>,
    pub depth: Option<T1>,
    pub object_id: Option<I>,
    pub instance: Option<I>,
    pub triangle: Option<I>,
    pub material: Option<I>,
}

pub type Images = Attributes<Vec<[f32; 3]>, Vec<[f32; 2]>, Vec<f32>, Vec<i32>>;
type Row<'a> = Attributes<&'a mut [[f32; 3]], &'a mut [[f32; 2]], &'a mut [f32], &'a mut [i32]>;

/// One tile's part of every row.
fn split<'a>(images: &'a mut Images, bins: &Bins) -> Vec<Vec<Row<'a>>> {
    let grid = bins.grid;
    let mut tiles: Vec<Vec<Row>> = Vec::new();
    for tile in 0..grid.count() {
        let (_, rows) = grid.extent(tile);
        let mut parts = Vec::new();
        parts.resize_with(rows.len(), Row::default);
        tiles.push(parts);
    }
    macro_rules! deal {
        ($($field:ident),*) => {$(
            if let Some(image) = &mut images.$field {
                for (index, row) in image.chunks_mut(grid.width).enumerate() {
                    let y = grid.y0 + index;
                    let tile_row = y / TILE - grid.first_row;
                    let inside = y - (y / TILE * TILE).max(grid.y0);
                    for (column, part) in row.chunks_mut(TILE).enumerate() {
                        tiles[tile_row * grid.columns + column][inside].$field = Some(part);
                    }
                }
            }
        )*};
    }
    deal!(
        position,
        geometric_normal,
        shading_normal,
        uv,
        depth,
        object_id,
        instance,
        triangle,
        material
    );
    tiles
}

fn to_f32(v: [f64; 3]) -> [f32; 3] {
    v.map(|x| x as f32)
}

/// Writes a pixel's attributes. `Images` start zeroed, so only what differs from zero is written where nothing is seen.
fn shade(row: &mut Row, x: usize, camera: &Camera, pixel: [usize; 2], hit: Option<&Hit>) {
    let Some(hit) = hit else {
        if let Some(depth) = &mut row.depth {
            depth[x] = f32::INFINITY;
        }
        let ids = [
            &mut row.object_id,
            &mut row.instance,
            &mut row.triangle,
            &mut row.material,
        ];
        for ids in ids.into_iter().flatten() {
            ids[x] = -1;
        }
        return;
    };
    if let Some(ids) = &mut row.object_id {
        ids[x] = hit.instance.object_id;
    }
    if let Some(ids) = &mut row.instance {
        ids[x] = hit.instance_index as i32;
    }
    if let Some(ids) = &mut row.triangle {
        ids[x] = hit.triangle as i32;
    }
    if let Some(ids) = &mut row.material {
        ids[x] = hit.material() as i32;
    }
    let normals = row.geometric_normal.is_some() || row.shading_normal.is_some();
    if row.position.is_none() && row.depth.is_none() && row.uv.is_none() && !normals {
        return;
    }
    let weights = hit.weights(camera, pixel);
    let position = hit.position(weights);
    if let Some(positions) = &mut row.position {
        positions[x] = to_f32(position);
    }
    if let Some(depth) = &mut row.depth {
        depth[x] = dot(position, camera.axes[2]) as f32;
    }
    if let Some(uv) = &mut row.uv {
        uv[x] = hit.uv(weights);
    }
    if normals {
        let ray = camera.ray(pixel[0], pixel[1]);
        let [geometric, shading] = hit.normals(&ray, weights);
        if let Some(normals) = &mut row.geometric_normal {
            normals[x] = to_f32(geometric);
        }
        if let Some(normals) = &mut row.shading_normal {
            normals[x] = to_f32(shading);
        }
    }
}

/// Fills the wanted attributes of the grid's rows.
pub fn surface(bins: &Bins, finder: &Finder, images: &mut Images, cancel: &CancelFlag) -> PyResult<()> {
    let (grid, camera) = (bins.grid, finder.camera);
    let tiles = split(images, bins);
    let tiles = tiles.into_par_iter().enumerate();
    tiles.try_for_each_init(Visibility::new, |visibility, (tile, mut parts)| {
        cancel.check()?;
        visibility.clear();
        run_widest(DrawTile {
            bins,
            finder,
            tile,
            visibility,
        });
        let (origin, (columns, rows)) = (grid.origin(tile), grid.extent(tile));
        let mut last: Option<(u32, Hit)> = None;
        for (row, y) in parts.iter_mut().zip(rows) {
            for x in columns.clone() {
                let id = visibility.id(x - origin[0], y - origin[1]);
                if id != NOTHING && last.as_ref().is_none_or(|(shown, _)| *shown != id) {
                    last = Some((id, finder.find(id)));
                }
                let hit = last.as_ref().filter(|_| id != NOTHING).map(|(_, hit)| hit);
                shade(row, x - origin[0], camera, [x, y], hit);
            }
        }
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
    let tiles = split(&mut images, bins).into_par_iter().enumerate();
    tiles.try_for_each_init(Visibility::new, |visibility, (tile, mut parts)| {
        cancel.check()?;
        if bins.is_empty(tile) {
            return Ok(());
        }
        visibility.clear();
        let (origin, (columns, rows)) = (grid.origin(tile), grid.extent(tile));
        for y in rows.clone() {
            let shown = &depths[(y - grid.y0) * grid.width..][..grid.width];
            for x in columns.clone() {
                visibility.limit(x - origin[0], y - origin[1], shown[x]);
            }
        }
        run_widest(DrawTile {
            bins,
            finder,
            tile,
            visibility,
        });
        for (row, y) in parts.iter_mut().zip(rows) {
            let objects = row.object_id.as_deref_mut().expect("it was asked for");
            for (x, object) in objects.iter_mut().enumerate() {
                let id = visibility.id(x, y - origin[1]);
                if id != NOTHING {
                    *object = finder.instance(id).object_id;
                }
            }
        }
        Ok::<(), PyErr>(())
    })?;
    Ok(images.object_id.unwrap_or_default())
}
