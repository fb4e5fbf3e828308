//! Surface attributes as entries return them; `addon/core/surface.py` says what they are.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;

/// Arrays to fill, a value for each point; None is not wanted and costs nothing.
#[derive(Default)]
pub struct Attributes<T3, T2, T1, I> {
    pub position: Option<T3>,
    pub geometric_normal: Option<T3>,
    pub shading_normal: Option<T3>,
    pub corner_colour: Option<T3>,
    pub terminator_lift: Option<T3>,
    pub uv: Option<T2>,
    pub depth: Option<T1>,
    pub object_id: Option<I>,
    pub instance: Option<I>,
    pub triangle: Option<I>,
    pub material: Option<I>,
}

pub type Images = Attributes<Vec<[f32; 3]>, Vec<[f32; 2]>, Vec<f32>, Vec<i32>>;
pub type Row<'a> = Attributes<&'a mut [[f32; 3]], &'a mut [[f32; 2]], &'a mut [f32], &'a mut [i32]>;

impl Images {
    /// Zeroed arrays for the attributes of these names.
    pub fn wanted(names: &[String], count: usize) -> PyResult<Self> {
        let mut images = Images::default();
        for name in names {
            match name.as_str() {
                "position" => images.position = Some(vec![[0.0; 3]; count]),
                "geometric_normal" => images.geometric_normal = Some(vec![[0.0; 3]; count]),
                "shading_normal" => images.shading_normal = Some(vec![[0.0; 3]; count]),
                "corner_colour" => images.corner_colour = Some(vec![[0.0; 3]; count]),
                "terminator_lift" => images.terminator_lift = Some(vec![[0.0; 3]; count]),
                "depth" => images.depth = Some(vec![0.0; count]),
                "uv" => images.uv = Some(vec![[0.0; 2]; count]),
                "object_id" => images.object_id = Some(vec![0; count]),
                "instance" => images.instance = Some(vec![0; count]),
                "triangle" => images.triangle = Some(vec![0; count]),
                "material" => images.material = Some(vec![0; count]),
                other => {
                    return Err(PyValueError::new_err(format!(
                        "a surface has no attribute '{other}'"
                    )));
                }
            }
        }
        Ok(images)
    }

    /// Parts of `length` of the `count` points, the last one of what is left.
    pub fn parts(&mut self, count: usize, length: usize) -> Vec<Row<'_>> {
        let mut parts = Vec::new();
        parts.resize_with(count.div_ceil(length), Row::default);
        macro_rules! deal {
            ($($field:ident),*) => {$(
                if let Some(image) = &mut self.$field {
                    for (row, part) in parts.iter_mut().zip(image.chunks_mut(length)) {
                        row.$field = Some(part);
                    }
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
        parts
    }

    /// The arrays by name, points in this shape.
    pub fn into_dict<'py>(self, py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyDict>> {
        let result = PyDict::new(py);
        macro_rules! give {
            ($field:ident, $flatten:expr, $channels:expr) => {
                if let Some(image) = self.$field {
                    let shape = [shape, &$channels].concat();
                    let array = PyArray1::from_vec(py, $flatten(image)).reshape(shape)?;
                    result.set_item(stringify!($field), array)?;
                }
            };
        }
        give!(position, Vec::into_flattened, [3]);
        give!(geometric_normal, Vec::into_flattened, [3]);
        give!(shading_normal, Vec::into_flattened, [3]);
        give!(corner_colour, Vec::into_flattened, [3]);
        give!(terminator_lift, Vec::into_flattened, [3]);
        give!(uv, Vec::into_flattened, [2]);
        give!(depth, std::convert::identity, []);
        give!(object_id, std::convert::identity, []);
        give!(instance, std::convert::identity, []);
        give!(triangle, std::convert::identity, []);
        give!(material, std::convert::identity, []);
        Ok(result)
    }
}

impl Row<'_> {
    /// Writes that there is nothing at some points. Images start zeroed: only what differs is written.
    pub fn clear(&mut self, points: Range<usize>) {
        if let Some(depth) = &mut self.depth {
            depth[points.clone()].fill(f32::INFINITY);
        }
        let ids = [
            &mut self.object_id,
            &mut self.instance,
            &mut self.triangle,
            &mut self.material,
        ];
        for ids in ids.into_iter().flatten() {
            ids[points.clone()].fill(-1);
        }
    }
}
