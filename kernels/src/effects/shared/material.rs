//! The colour of each point's material, constant or from a texture, times what corners of faces carry.

use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Points that one thread colours at a time.
const CHUNK: usize = 4096;

struct Texture<'a> {
    texels: &'a [[f32; 4]],
    width: usize,
    height: usize,
    share: f32,
}

impl Texture<'_> {
    /// Bilinear and repeated, texel centres at halves.
    fn at(&self, uv: [f32; 2]) -> [f32; 3] {
        // Whole turns are taken off first: float32 keeps few digits of a uv far from 0.
        let place = |value: f32, count: usize| {
            let at = (value - value.floor()) * count as f32 - 0.5;
            let low = at.floor();
            let index = |step: i64| (low as i64 + step).rem_euclid(count as i64) as usize;
            (index(0), index(1), at - low)
        };
        let (left, right, along) = place(uv[0], self.width);
        let (bottom, top, up) = place(uv[1], self.height);
        let row = |row: usize, channel: usize| {
            let texel = |column: usize| self.texels[row * self.width + column][channel];
            texel(left) * (1.0 - along) + texel(right) * along
        };
        std::array::from_fn(|c| self.share * (row(bottom, c) * (1.0 - up) + row(top, c) * up))
    }
}

/// (h, w, 4) f32, alpha 1; all 0 where `material` (h, w) is -1. `colours` (M, 3) by material; each of `textures` is a
/// material, its texels (rows, columns, 4) at `uv` (h, w, 2), and the share of them that counts; the last of a material holds.
/// Of materials where `by_corner` (M,) is 1, all that times `corner_colour` (h, w, 3). Raises ValueError on other shapes and
/// on materials that are none.
#[pyfunction]
#[pyo3(signature = (material, uv, colours, textures, corner_colour=None, by_corner=None))]
fn material_colour<'py>(
    py: Python<'py>,
    material: PyReadonlyArray2<'py, i32>,
    uv: Option<PyReadonlyArray3<'py, f32>>,
    colours: PyReadonlyArray2<'py, f32>,
    textures: Vec<(usize, PyReadonlyArray3<'py, f32>, f32)>,
    corner_colour: Option<PyReadonlyArray3<'py, f32>>,
    by_corner: Option<PyReadonlyArray1<'py, u8>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let wrong = || {
        PyValueError::new_err(
            "material (h, w), uv (h, w, 2), colours (M, 3), texels (h, w, 4), corner_colour (h, w, 3)",
        )
    };
    let &[height, width] = material.shape() else {
        return Err(wrong());
    };
    let colours = match *colours.shape() {
        [_, 3] => colours.as_slice()?.as_chunks::<3>().0,
        _ => return Err(wrong()),
    };
    let uv = match &uv {
        Some(uv) if *uv.shape() == [height, width, 2] => uv.as_slice()?.as_chunks::<2>().0,
        None if textures.is_empty() => &[],
        _ => return Err(wrong()),
    };
    let tints = match (&corner_colour, &by_corner) {
        (Some(tints), Some(which))
            if *tints.shape() == [height, width, 3] && which.len() == colours.len() =>
        {
            Some((tints.as_slice()?.as_chunks::<3>().0, which.as_slice()?))
        }
        (None, None) => None,
        _ => return Err(wrong()),
    };
    let mut of_material: Vec<Option<Texture<'_>>> = colours.iter().map(|_| None).collect();
    for (index, texels, share) in &textures {
        let &[height, width, 4] = texels.shape() else {
            return Err(wrong());
        };
        let place = of_material.get_mut(*index).ok_or_else(wrong)?;
        *place = (width * height > 0).then_some(Texture {
            texels: texels.as_slice()?.as_chunks::<4>().0,
            width,
            height,
            share: *share,
        });
    }
    let found = material.as_slice()?;
    if found.iter().any(|&index| index >= colours.len() as i32) {
        return Err(wrong());
    }
    let mut result = vec![0.0f32; 4 * height * width];
    py.detach(|| {
        let chunks = result.as_chunks_mut::<4>().0.par_chunks_mut(CHUNK);
        chunks
            .zip(found.par_chunks(CHUNK))
            .enumerate()
            .for_each(|(chunk, (result, found))| {
                for (i, (result, &index)) in result.iter_mut().zip(found).enumerate() {
                    let Ok(index) = usize::try_from(index) else {
                        continue;
                    };
                    let [r, g, b] = match &of_material[index] {
                        Some(texture) => texture.at(uv[chunk * CHUNK + i]),
                        None => colours[index],
                    };
                    *result = [r, g, b, 1.0];
                    if let Some((tints, _)) = tints.filter(|(_, which)| which[index] != 0) {
                        for (value, tint) in result.iter_mut().zip(tints[chunk * CHUNK + i]) {
                            *value *= tint;
                        }
                    }
                }
            })
    });
    result.into_pyarray(py).reshape([height, width, 4])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(material_colour, module)?)
}
