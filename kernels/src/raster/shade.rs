//! What is seen at the pixels of an image, written to the arrays that are asked for.

use super::grid::Grid;
use super::hit::{Finder, Hit};
use super::wide::{WIDE, lane, wide_dot};
use crate::surface::{Images, Row};
use std::ops::Range;

/// One tile's part of every row.
pub fn split<'a>(images: &'a mut Images, grid: Grid) -> Vec<Vec<Row<'a>>> {
    let mut tiles: Vec<Vec<Row>> = Vec::new();
    for tile in 0..grid.count() {
        let [_, rows] = grid.extent(tile);
        let mut parts = Vec::new();
        parts.resize_with(rows.len(), Row::default);
        tiles.push(parts);
    }
    macro_rules! deal {
        ($($field:ident),*) => {$(
            if let Some(image) = &mut images.$field {
                grid.deal(image, |tile, row, part| tiles[tile][row].$field = Some(part));
            }
        )*};
    }
    deal!(
        position,
        geometric_normal,
        shading_normal,
        corner_colour,
        terminator_lift,
        uv,
        depth,
        object_id,
        instance,
        triangle,
        material
    );
    tiles
}

/// Writes what a triangle shows in some columns of a row's part of a tile; `origin` is the pixel of its first one.
#[inline(always)]
pub fn shade(row: &mut Row, columns: Range<usize>, finder: &Finder, origin: [i32; 2], hit: &Hit) {
    let camera = finder.camera;
    for (ids, id) in [
        (&mut row.object_id, hit.instance.object_id),
        (&mut row.instance, hit.instance_index as i32),
        (&mut row.triangle, hit.triangle as i32),
        (&mut row.material, hit.material() as i32),
    ] {
        if let Some(ids) = ids {
            ids[columns.clone()].fill(id);
        }
    }
    let lifting = row.terminator_lift.as_ref().and_then(|_| hit.lifting());
    let normals = row.geometric_normal.is_some() || row.shading_normal.is_some() || lifting.is_some();
    let values = row.uv.is_some() || row.corner_colour.is_some();
    if row.position.is_none() && row.depth.is_none() && !values && !normals {
        return;
    }
    for first in columns.clone().step_by(WIDE) {
        let count = WIDE.min(columns.end - first);
        let pixels = finder.pixels(
            [origin[0] + first as i32, origin[1]],
            std::array::from_fn(|l| l < count),
        );
        let part = first..first + count;
        let weights = hit.weights(camera, pixels);
        if row.position.is_some() || row.depth.is_some() {
            let positions = hit.positions(&weights);
            if let Some(image) = &mut row.position {
                put(&mut image[part.clone()], &positions);
            }
            if let Some(image) = &mut row.depth {
                let depths = wide_dot(camera.axes[2], &positions).map(|x| x as f32);
                image[part.clone()].copy_from_slice(&depths[..count]);
            }
        }
        if let Some(image) = &mut row.uv {
            put(&mut image[part.clone()], &hit.uvs(&weights));
        }
        if let Some(image) = &mut row.corner_colour {
            put(&mut image[part.clone()], &hit.colours(&weights));
        }
        if normals {
            let [geometric, shading] = hit.normals(camera, pixels, &weights);
            if let Some(image) = &mut row.geometric_normal {
                put(&mut image[part.clone()], &geometric);
            }
            if let Some(image) = &mut row.shading_normal {
                put(&mut image[part.clone()], &shading);
            }
            if let (Some(image), Some(lifting)) = (&mut row.terminator_lift, &lifting) {
                for (l, pixel) in image[part].iter_mut().enumerate() {
                    *pixel = lifting
                        .at(lane(&weights, l), lane(&geometric, l))
                        .map(|x| x as f32);
                }
            }
        }
    }
}

/// Writes the first of some vectors.
#[inline(always)]
fn put<const N: usize>(image: &mut [[f32; N]], vectors: &[[f64; WIDE]; N]) {
    let rounded = vectors.map(|axis| axis.map(|x| x as f32));
    for (l, pixel) in image.iter_mut().enumerate() {
        *pixel = std::array::from_fn(|k| rounded[k][l]);
    }
}
