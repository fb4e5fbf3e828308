//! Cancelling: a flag that the interface sets and that kernels poll once a tile.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

pyo3::create_exception!(
    strata_kernels,
    Cancelled,
    PyRuntimeError,
    "The caller set the cancel flag"
);

/// Shared with a running kernel; `set()` may be called from any thread.
#[pyclass(frozen)]
#[derive(Clone, Default)]
pub struct CancelFlag {
    raised: Arc<AtomicBool>,
}

#[pymethods]
impl CancelFlag {
    #[new]
    pub fn new() -> Self {
        Self::default()
    }

    pub fn set(&self) {
        self.raised.store(true, Ordering::Relaxed);
    }

    pub fn is_set(&self) -> bool {
        self.raised.load(Ordering::Relaxed)
    }
}

impl CancelFlag {
    /// The caller's flag, or one that nobody sets.
    pub fn of(given: Option<PyRef<'_, CancelFlag>>) -> Self {
        given.map_or_else(Self::default, |flag| flag.clone())
    }

    /// The error a kernel returns when it finds the flag raised.
    pub fn check(&self) -> PyResult<()> {
        if self.is_set() {
            Err(Cancelled::new_err("cancelled"))
        } else {
            Ok(())
        }
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<CancelFlag>()?;
    module.add("Cancelled", module.py().get_type::<Cancelled>())
}
