//! Meshes as rows of four floats, as the tables of a GPU hold them.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Rows that one thread writes at a time.
const CHUNK: usize = 1 << 14;

fn same_length(a: &[usize], b: &[usize]) -> PyResult<()> {
    if a[0] == b[0] && a[1] == 3 && b[1] == 4 {
        return Ok(());
    }
    Err(PyValueError::new_err(
        "rows are (N, 4), what they are made of (N, 3)",
    ))
}

/// Low and high corner of the box around `positions` (N, 3) f32: (3,) each, all NaN where any number is not finite, and
/// infinite the wrong way round where there are none. Raises ValueError on other shapes.
#[pyfunction]
fn extent(py: Python<'_>, positions: PyReadonlyArray2<'_, f32>) -> PyResult<([f32; 3], [f32; 3])> {
    if positions.shape()[1] != 3 {
        return Err(PyValueError::new_err("positions are (N, 3)"));
    }
    let positions = positions.as_slice()?.as_chunks::<3>().0;
    const NOTHING: Box = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    type Box = ([f32; 3], [f32; 3]);
    let join = |(low, high): Box, (other_low, other_high): Box| {
        // A NaN of either stays.
        let lower = |a: f32, b: f32| if a < b || a.is_nan() { a } else { b };
        let higher = |a: f32, b: f32| if a > b || a.is_nan() { a } else { b };
        let low = std::array::from_fn(|axis| lower(low[axis], other_low[axis]));
        let high = std::array::from_fn(|axis| higher(high[axis], other_high[axis]));
        (low, high)
    };
    let around = |points: &[[f32; 3]]| {
        let (mut low, mut high, mut is_finite) = (NOTHING.0, NOTHING.1, true);
        for point in points {
            for axis in 0..3 {
                let value = point[axis];
                low[axis] = if value < low[axis] { value } else { low[axis] };
                high[axis] = if value > high[axis] { value } else { high[axis] };
                is_finite &= value.is_finite();
            }
        }
        if is_finite {
            (low, high)
        } else {
            ([f32::NAN; 3], [f32::NAN; 3])
        }
    };
    Ok(py.detach(|| positions.par_chunks(CHUNK).map(around).reduce(|| NOTHING, join)))
}

/// Writes `positions` (N, 3) f32 less `centre`, and 0, to `rows` (N, 4) f32. Raises ValueError on other shapes.
#[pyfunction]
fn position_rows(
    py: Python<'_>,
    positions: PyReadonlyArray2<'_, f32>,
    centre: [f32; 3],
    mut rows: PyReadwriteArray2<'_, f32>,
) -> PyResult<()> {
    same_length(positions.shape(), rows.shape())?;
    let positions = positions.as_slice()?.as_chunks::<3>().0;
    let rows = rows.as_slice_mut()?.as_chunks_mut::<4>().0;
    let [cx, cy, cz] = centre;
    let chunks = rows.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK));
    py.detach(|| {
        chunks.for_each(|(rows, positions)| {
            for (row, &[x, y, z]) in rows.iter_mut().zip(positions) {
                *row = [x - cx, y - cy, z - cz, 0.0];
            }
        })
    });
    Ok(())
}

/// Writes `vertices` (N, 3) i32 and each triangle's number, its index where `order` (N,) i64 is None, to `rows` (N, 4)
/// f32; exact below 2^24. Raises ValueError on other shapes.
#[pyfunction]
#[pyo3(signature = (vertices, order, rows))]
fn triangle_rows(
    py: Python<'_>,
    vertices: PyReadonlyArray2<'_, i32>,
    order: Option<PyReadonlyArray1<'_, i64>>,
    mut rows: PyReadwriteArray2<'_, f32>,
) -> PyResult<()> {
    same_length(vertices.shape(), rows.shape())?;
    if order
        .as_ref()
        .is_some_and(|order| order.shape()[0] != vertices.shape()[0])
    {
        return Err(PyValueError::new_err("order has one number for each triangle"));
    }
    let order = order.as_ref().map(|order| order.as_slice()).transpose()?;
    let vertices = vertices.as_slice()?.as_chunks::<3>().0;
    let rows = rows.as_slice_mut()?.as_chunks_mut::<4>().0;
    let chunks = rows.par_chunks_mut(CHUNK).zip(vertices.par_chunks(CHUNK));
    py.detach(|| {
        chunks.enumerate().for_each(|(chunk, (rows, vertices))| {
            let first = chunk * CHUNK;
            for (index, (row, &[a, b, c])) in rows.iter_mut().zip(vertices).enumerate() {
                *row = [a as f32, b as f32, c as f32, (first + index) as f32];
            }
            if let Some(order) = order {
                for (row, number) in rows.iter_mut().zip(&order[first..]) {
                    row[3] = *number as f32;
                }
            }
        })
    });
    Ok(())
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(extent, module)?)?;
    module.add_function(wrap_pyfunction!(position_rows, module)?)?;
    module.add_function(wrap_pyfunction!(triangle_rows, module)?)
}
