//! Layers joined into one picture: the light of lamps on diffuse surfaces, and what effects make of it.

use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray3, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Pixels that one thread joins at a time: few enough that they stay in its cache from join to join.
const CHUNK: usize = 2048;

/// One image, by its channels: V, RGB, RGBA.
#[derive(Clone, Copy)]
enum Image<'a> {
    Grey(&'a [f32]),
    Light(&'a [[f32; 3]]),
    Colour(&'a [[f32; 4]]),
}

impl Image<'_> {
    /// Red, green and blue.
    #[inline(always)]
    fn colour(&self, pixel: usize) -> [f32; 3] {
        match self {
            Image::Grey(values) => [values[pixel]; 3],
            Image::Light(values) => values[pixel],
            Image::Colour(values) => [values[pixel][0], values[pixel][1], values[pixel][2]],
        }
    }
}

enum Join<'a> {
    /// Irradiance and what scales it: in grey, then in colour; and the light's colour.
    Light(Vec<&'a [f32]>, Vec<Image<'a>>, [f32; 3]),
    Multiply(Image<'a>),
    Add(Image<'a>),
    Over(&'a [[f32; 4]]),
    /// Each with its depth: the farthest first, of equal ones the earlier.
    OverByDepth(Vec<(&'a [[f32; 4]], &'a [f32])>),
}

impl Join<'_> {
    fn apply(&self, first: usize, albedo: &[[f32; 4]], total: &mut [[f32; 4]]) {
        match self {
            Join::Light(images, colours, share) => {
                let mut shown = [1.0; CHUNK];
                for image in images {
                    for (shown, value) in shown.iter_mut().zip(&image[first..]) {
                        *shown *= value;
                    }
                }
                if colours.is_empty() {
                    for ((total, albedo), shown) in total.iter_mut().zip(albedo).zip(&shown) {
                        for c in 0..3 {
                            total[c] += albedo[c] * (shown * share[c]);
                        }
                    }
                    return;
                }
                for (i, (total, albedo)) in total.iter_mut().zip(albedo).enumerate() {
                    let mut arriving = [shown[i]; 3];
                    for image in colours {
                        let colour = image.colour(first + i);
                        for c in 0..3 {
                            arriving[c] *= colour[c];
                        }
                    }
                    for c in 0..3 {
                        total[c] += albedo[c] * (arriving[c] * share[c]);
                    }
                }
            }
            Join::Multiply(image) => {
                for (i, total) in total.iter_mut().enumerate() {
                    let colour = image.colour(first + i);
                    for c in 0..3 {
                        total[c] *= colour[c];
                    }
                }
            }
            Join::Add(image) => {
                for (i, total) in total.iter_mut().enumerate() {
                    let colour = image.colour(first + i);
                    for c in 0..3 {
                        total[c] += colour[c];
                    }
                }
            }
            Join::Over(image) => {
                for (total, layer) in total.iter_mut().zip(&image[first..]) {
                    over(total, layer);
                }
            }
            Join::OverByDepth(layers) => {
                let mut order: Vec<usize> = Vec::with_capacity(layers.len());
                for (i, total) in total.iter_mut().enumerate() {
                    let depth = |layer: usize| layers[layer].1[first + i];
                    order.clear();
                    for layer in 0..layers.len() {
                        let mut place = order.len();
                        while place > 0 && depth(order[place - 1]) < depth(layer) {
                            place -= 1;
                        }
                        order.insert(place, layer);
                    }
                    for &layer in &order {
                        over(total, &layers[layer].0[first + i]);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn over(total: &mut [f32; 4], layer: &[f32; 4]) {
    for c in 0..4 {
        total[c] = layer[c] + (1.0 - layer[3]) * total[c];
    }
}

/// Joins images into (h, w, 4) f32, one after the other; alpha is that of `albedo` (h, w, 4), premultiplied.
///
/// Each of `joins` is a kind, its images (h, w), (h, w, 3) or (h, w, 4), and a colour that only lights have. "light": adds albedo
/// times the product of its images, the first of which is grey, times the colour; "multiply", "add": red, green and blue only; "over": a
/// premultiplied colour image before what is there; "over by depth": such images, each followed by its depths (h, w), the farthest
/// first. Raises ValueError on other kinds and shapes.
#[pyfunction]
fn composite<'py>(
    py: Python<'py>,
    albedo: PyReadonlyArray3<'py, f32>,
    joins: Vec<(String, Vec<PyReadonlyArrayDyn<'py, f32>>, [f32; 3])>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let &[height, width, 4] = albedo.shape() else {
        return Err(PyValueError::new_err("albedo is (h, w, 4)"));
    };
    let size = [height, width];
    let joins = joins
        .iter()
        .map(|(kind, images, colour)| join(kind, images, *colour, size))
        .collect::<PyResult<Vec<Join<'_>>>>()?;
    let albedo = albedo.as_slice()?.as_chunks::<4>().0;
    let mut total = vec![0.0f32; 4 * height * width];
    py.detach(|| {
        let chunks = total.as_chunks_mut::<4>().0.par_chunks_mut(CHUNK);
        chunks
            .zip(albedo.par_chunks(CHUNK))
            .enumerate()
            .for_each(|(chunk, (total, albedo))| {
                for (total, albedo) in total.iter_mut().zip(albedo) {
                    total[3] = albedo[3];
                }
                for join in &joins {
                    join.apply(chunk * CHUNK, albedo, total);
                }
            })
    });
    total.into_pyarray(py).reshape([height, width, 4])
}

fn join<'a>(
    kind: &str,
    images: &'a [PyReadonlyArrayDyn<'_, f32>],
    colour: [f32; 3],
    size: [usize; 2],
) -> PyResult<Join<'a>> {
    let images = images
        .iter()
        .map(|array| image(array, size))
        .collect::<PyResult<Vec<Image<'a>>>>()?;
    if kind == "light" {
        let (mut grey, mut colours) = (Vec::new(), Vec::new());
        for image in &images {
            match image {
                Image::Grey(values) => grey.push(*values),
                _ => colours.push(*image),
            }
        }
        if matches!(images.first(), Some(Image::Grey(_))) {
            return Ok(Join::Light(grey, colours, colour));
        }
    }
    if kind == "over by depth" {
        let pairs = images.chunks(2).map(|pair| match pair {
            &[Image::Colour(values), Image::Grey(depths)] => Some((values, depths)),
            _ => None,
        });
        if let Some(layers) = pairs.collect::<Option<Vec<_>>>() {
            return Ok(Join::OverByDepth(layers));
        }
    }
    match (kind, &images[..]) {
        ("multiply", &[image]) => Ok(Join::Multiply(image)),
        ("add", &[image]) => Ok(Join::Add(image)),
        ("over", &[Image::Colour(values)]) => Ok(Join::Over(values)),
        _ => Err(PyValueError::new_err(format!(
            "'{kind}' is no join of such images"
        ))),
    }
}

fn image<'a>(array: &'a PyReadonlyArrayDyn<'_, f32>, [height, width]: [usize; 2]) -> PyResult<Image<'a>> {
    let values = array.as_slice()?;
    match *array.shape() {
        [h, w] if [h, w] == [height, width] => Ok(Image::Grey(values)),
        [h, w, 3] if [h, w] == [height, width] => Ok(Image::Light(values.as_chunks::<3>().0)),
        [h, w, 4] if [h, w] == [height, width] => Ok(Image::Colour(values.as_chunks::<4>().0)),
        _ => Err(PyValueError::new_err("images are (h, w[, 3 or 4]), as albedo is")),
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(composite, module)?)
}
