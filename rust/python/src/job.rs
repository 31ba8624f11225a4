//! Fits and chains: blocking with the GIL released, or as a job on a thread of its own.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use leafcloud::lod::{self, Chain, ChainSettings};
use leafcloud::{Foliage, Progress};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{Failure, guard, refuse};
use crate::foliage::PyFoliage;
use crate::levels::{CloudInFrame, PyChain, PyCloud};
use crate::options::Options;

/// How long a wait goes on before it looks for Ctrl-C.
const PATIENCE: Duration = Duration::from_millis(50);

/// What work gives.
#[derive(Clone)]
enum Output {
    Cloud(CloudInFrame),
    Chain(Arc<Chain>, f64),
}

impl Output {
    fn into_python(self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(match self {
            Self::Cloud(cloud) => Py::new(py, PyCloud(cloud))?.into_any(),
            Self::Chain(chain, radius) => Py::new(py, PyChain { chain, radius })?.into_any(),
        })
    }
}

/// What is to be done, with everything that it needs.
enum Work {
    Fit(Arc<Foliage>, leafcloud::fit::FitSettings),
    Chain(Arc<Foliage>, Option<Arc<Foliage>>, ChainSettings),
}

impl Work {
    fn fit(foliage: &PyFoliage, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let options = Options::new(options)?;
        let settings = options.fit()?;
        options.finish()?;
        Ok(Self::Fit(Arc::clone(&foliage.0), settings))
    }

    fn chain(foliage: &PyFoliage, wood: Option<&PyFoliage>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let options = Options::new(options)?;
        let settings = options.chain()?;
        options.finish()?;
        Ok(Self::Chain(Arc::clone(&foliage.0), wood.map(|w| Arc::clone(&w.0)), settings))
    }

    fn run(&self, progress: Progress) -> leafcloud::Result<Output> {
        match self {
            Self::Fit(foliage, settings) => {
                let cloud = leafcloud::fit::fit(foliage, settings, progress)?;
                Ok(Output::Cloud(CloudInFrame {
                    mean_deviation: cloud.mean_deviation(foliage),
                    cloud: Arc::new(cloud),
                    frame: *foliage.frame(),
                    radius: foliage.frame().radius,
                }))
            }
            Self::Chain(foliage, wood, settings) => {
                let chain = lod::build_chain(foliage, wood.as_deref(), settings, progress)?;
                Ok(Output::Chain(Arc::new(chain), foliage.frame().radius))
            }
        }
    }

    /// Runs on this thread without the GIL; `progress` is called with it.
    fn run_here(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<Py<PyAny>> {
        let raised: Mutex<Option<PyErr>> = Mutex::new(None);
        let report = |stage: &str, fraction: f64| {
            let answer = Python::attach(|py| {
                py.check_signals()?;
                let Some(callback) = &progress else { return Ok(true) };
                let answer = callback.bind(py).call1((stage, fraction))?;
                Ok(answer.extract::<bool>().unwrap_or(true))
            });
            answer.unwrap_or_else(|error| {
                *lock(&raised) = Some(error);
                false
            })
        };
        let result = py.detach(|| guard(|| self.run(Progress::new(&report))));
        if let Some(error) = lock(&raised).take() {
            return Err(error);
        }
        result?.into_python(py)
    }
}

#[pyfunction]
#[pyo3(signature = (foliage, *, progress = None, **options))]
pub fn fit(
    py: Python<'_>,
    foliage: &PyFoliage,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<PyAny>> {
    Work::fit(foliage, options)?.run_here(py, progress)
}

#[pyfunction]
#[pyo3(signature = (foliage, *, wood = None, progress = None, **options))]
pub fn build_chain(
    py: Python<'_>,
    foliage: &PyFoliage,
    wood: Option<&PyFoliage>,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<PyAny>> {
    Work::chain(foliage, wood, options)?.run_here(py, progress)
}

#[pyfunction]
#[pyo3(signature = (foliage, **options))]
pub fn start_fit(foliage: &PyFoliage, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyJob> {
    PyJob::start(Work::fit(foliage, options)?)
}

#[pyfunction]
#[pyo3(signature = (foliage, *, wood = None, **options))]
pub fn start_chain(
    foliage: &PyFoliage,
    wood: Option<&PyFoliage>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<PyJob> {
    PyJob::start(Work::chain(foliage, wood, options)?)
}

/// What the worker and its watchers share.
#[derive(Default)]
struct Shared {
    stage: Mutex<String>,
    /// The bits of an f64 in [0, 1]; such numbers order like their bits, so that a maximum never falls.
    fraction: AtomicU64,
    cancelled: AtomicBool,
    result: Mutex<Option<Result<Output, Failure>>>,
    ended: Condvar,
}

impl Shared {
    fn report(&self, stage: &str, fraction: f64) -> bool {
        stage.clone_into(&mut lock(&self.stage));
        self.fraction.fetch_max(fraction.to_bits(), Ordering::Relaxed);
        !self.cancelled.load(Ordering::Relaxed)
    }
}

#[pyclass(name = "Job", module = "leafcloud", frozen, generic)]
pub struct PyJob(Arc<Shared>);

impl Drop for PyJob {
    /// Nobody is left to take the result.
    fn drop(&mut self) {
        self.cancel();
    }
}

impl PyJob {
    fn start(work: Work) -> PyResult<Self> {
        let shared = Arc::new(Shared::default());
        let worker = Arc::clone(&shared);
        let body = move || {
            let report = |stage: &str, fraction: f64| worker.report(stage, fraction);
            let result = guard(|| work.run(Progress::new(&report)));
            *lock(&worker.result) = Some(result);
            worker.ended.notify_all();
        };
        std::thread::Builder::new()
            .name("leafcloud".to_owned())
            .spawn(body)
            .map_err(|e| refuse(format!("no thread could be started: {e}")))?;
        Ok(Self(shared))
    }

    fn ended(&self) -> Option<Result<Output, Failure>> {
        lock(&self.0.result).clone()
    }
}

#[pymethods]
impl PyJob {
    #[getter]
    fn stage(&self) -> String {
        lock(&self.0.stage).clone()
    }

    #[getter]
    fn fraction(&self) -> f64 {
        f64::from_bits(self.0.fraction.load(Ordering::Relaxed))
    }

    #[getter]
    fn done(&self) -> bool {
        lock(&self.0.result).is_some()
    }

    #[getter]
    fn best(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        match self.ended() {
            Some(Ok(output)) => output.into_python(py).map(Some),
            _ => Ok(None),
        }
    }

    fn cancel(&self) {
        self.0.cancelled.store(true, Ordering::Relaxed);
    }

    #[pyo3(signature = (timeout = None))]
    fn result(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Py<PyAny>> {
        let wait = timeout.map(|seconds| Duration::try_from_secs_f64(seconds.max(0.0)).unwrap_or(Duration::MAX));
        let started = Instant::now();
        loop {
            py.detach(|| {
                let result = lock(&self.0.result);
                let pause = wait.map_or(PATIENCE, |w| w.saturating_sub(started.elapsed()).min(PATIENCE));
                drop(self.0.ended.wait_timeout_while(result, pause, |r| r.is_none()));
            });
            if let Some(result) = self.ended() {
                return result?.into_python(py);
            }
            py.check_signals()?;
            if wait.is_some_and(|w| started.elapsed() >= w) {
                return Err(PyTimeoutError::new_err(format!("not done after {} s", timeout.unwrap_or_default())));
            }
        }
    }
}

/// A lock that a panic elsewhere does not spoil: what it guards is replaced whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
