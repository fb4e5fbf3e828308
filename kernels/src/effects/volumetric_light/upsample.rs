//! From a coarse image back to every pixel, without bleeding across edges of depth; and transmittance.

use crate::cancel::CancelFlag;
use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Depths that differ by this share count half.
const LIKENESS: f32 = 0.02;

/// The coarse image (ch, cw, 3) f32, whose texel (x, y) was evaluated at pixel (x, y) * `stride` + `offset` (a pixel
/// of the image) with depth `coarse_depth` (ch, cw), at every pixel of `depth` (h, w): bilinear weights of the four
/// around it, less where their depth is another. Raises ValueError on bad shapes.
#[pyfunction]
#[pyo3(signature = (coarse, coarse_depth, depth, stride, offset, cancel=None))]
fn upsample_by_depth<'py>(
    py: Python<'py>,
    coarse: PyReadonlyArray3<'py, f32>,
    coarse_depth: PyReadonlyArray2<'py, f32>,
    depth: PyReadonlyArray2<'py, f32>,
    stride: usize,
    offset: (usize, usize),
    cancel: Option<PyRef<'py, CancelFlag>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let [rows, columns] = [coarse_depth.shape()[0], coarse_depth.shape()[1]];
    let [height, width] = [depth.shape()[0], depth.shape()[1]];
    if coarse.shape() != [rows, columns, 3] || stride == 0 || rows * columns == 0 || width == 0 {
        return Err(PyValueError::new_err(
            "coarse is (ch, cw, 3), coarse_depth (ch, cw)",
        ));
    }
    let texels = coarse.as_slice()?.as_chunks::<3>().0;
    let coarse_depth = coarse_depth.as_slice()?;
    let depth = depth.as_slice()?;
    let cancel = CancelFlag::of(cancel);
    let mut image = vec![[0.0f32; 3]; height * width];
    py.detach(|| {
        image.par_chunks_mut(width).enumerate().try_for_each(|(y, row)| {
            cancel.check()?;
            let place = |pixel: usize, offset: usize, count: usize| {
                let at = (pixel as f32 - offset as f32) / stride as f32;
                let first = at.floor().clamp(0.0, (count.max(2) - 2) as f32);
                (first as usize, (at - first).clamp(0.0, 1.0))
            };
            let (y0, fy) = place(y, offset.1, rows);
            for (x, pixel) in row.iter_mut().enumerate() {
                let (x0, fx) = place(x, offset.0, columns);
                let own = depth[y * width + x];
                let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
                for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
                    for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
                        let index = (y0 + dy).min(rows - 1) * columns + (x0 + dx).min(columns - 1);
                        let other = coarse_depth[index];
                        let away = if own == other {
                            0.0 // both infinite too
                        } else {
                            (own - other).abs() / own.min(other) / LIKENESS
                        };
                        // None is nothing: where all four differ the most alike wins.
                        let weight = (wx * wy + 1e-4) / (1.0 + (away * away).min(1e12));
                        total += weight;
                        for c in 0..3 {
                            sum[c] += weight * texels[index][c];
                        }
                    }
                }
                *pixel = sum.map(|s| s / total);
            }
            PyResult::Ok(())
        })
    })?;
    image
        .into_flattened()
        .into_pyarray(py)
        .reshape([height, width, 3])
}

/// exp(-extinction length), (h, w, 3) f32: what gets through `metres` (h, w) f32 of a medium of `extinction` (3,)
/// f64 per metre. Infinite lengths let nothing through, unless there is no extinction.
#[pyfunction]
fn transmittance<'py>(
    py: Python<'py>,
    metres: PyReadonlyArray2<'py, f32>,
    extinction: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let &[height, width] = metres.shape() else {
        unreachable!("two axes by type")
    };
    let &[r, g, b] = extinction.as_slice()? else {
        return Err(PyValueError::new_err("extinction is three numbers"));
    };
    let metres = metres.as_slice()?;
    let image: Vec<[f32; 3]> = py.detach(|| {
        let through = |length: f32, e: f64| {
            if e > 0.0 {
                (-e * f64::from(length)).exp() as f32
            } else {
                1.0
            }
        };
        metres
            .par_iter()
            .map(|&length| [through(length, r), through(length, g), through(length, b)])
            .collect()
    });
    image
        .into_flattened()
        .into_pyarray(py)
        .reshape([height, width, 3])
}

/// Metres of each ray inside a bounded medium, (h, w) f32: `spans` (layers, h, w) f32 and `ends` (h, w) f32, both
/// along the ray, from `starts` (h, w) f32 on.
#[pyfunction]
fn metres_inside<'py>(
    py: Python<'py>,
    spans: PyReadonlyArray3<'py, f32>,
    starts: PyReadonlyArray2<'py, f32>,
    ends: PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, numpy::PyArray2<f32>>> {
    let &[layers, height, width] = spans.shape() else {
        unreachable!("three axes by type")
    };
    if ends.shape() != [height, width] || starts.shape() != [height, width] {
        return Err(PyValueError::new_err(
            "spans are (layers, h, w), starts and ends (h, w)",
        ));
    }
    let (spans, starts, ends) = (spans.as_slice()?, starts.as_slice()?, ends.as_slice()?);
    let plane = height * width;
    let metres: Vec<f32> = py.detach(|| {
        (0..plane)
            .into_par_iter()
            .map_init(Vec::new, |inside, i| {
                let depths = (0..layers).map(|layer| spans[layer * plane + i]);
                super::spans::inside(depths, f64::from(starts[i]), f64::from(ends[i]), inside);
                inside.iter().map(|(from, to)| to - from).sum::<f64>() as f32
            })
            .collect()
    });
    metres.into_pyarray(py).reshape([height, width])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(upsample_by_depth, module)?)?;
    module.add_function(wrap_pyfunction!(metres_inside, module)?)?;
    module.add_function(wrap_pyfunction!(transmittance, module)?)
}
