//! Fits, chains and cost curves: blocking with the GIL released, or as a `Job` on a separate thread.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

use leafcloud::lod::{self, Chain, ChainSettings};
use leafcloud::{Foliage, Progress};
use leafcloud_curve::{Built, Curve, Offer, Sweep, Wish, build_within, sweep};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::curve::PyCurve;
use crate::errors::{Failure, read, refuse, shown};
use crate::foliage::PyFoliage;
use crate::levels::{CloudInFrame, PyChain, PyCloud};
use crate::options::Options;
use crate::work::{self, PATIENCE, guard};

/// The result of work.
#[derive(Clone)]
enum Output {
    Cloud(CloudInFrame),
    Chain(Arc<Chain>, f64, Option<Offer>),
    Curve(Arc<Curve>),
}

impl Output {
    fn into_python(self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(match self {
            Self::Cloud(cloud) => Py::new(py, PyCloud(cloud))?.into_any(),
            Self::Chain(chain, radius, offer) => Py::new(py, PyChain { chain, radius, offer })?.into_any(),
            Self::Curve(curve) => Py::new(py, PyCurve(curve))?.into_any(),
        })
    }
}

/// Work with all its input.
enum Work {
    Fit(Arc<Foliage>, leafcloud::fit::FitSettings),
    Chain(Arc<Foliage>, Option<Arc<Foliage>>, ChainSettings, Option<Wish>),
    Curve(Arc<Foliage>, Option<Arc<Foliage>>, ChainSettings, Sweep),
}

impl Work {
    fn fit(foliage: &PyFoliage, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let options = Options::new(options)?;
        let settings = options.fit()?;
        options.finish()?;
        Ok(Self::Fit(Arc::clone(&foliage.0), settings))
    }

    fn chain(
        foliage: &PyFoliage,
        trunk: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let options = Options::new(options)?;
        let (settings, wish) = (options.chain()?, options.wish()?);
        options.finish()?;
        Ok(Self::Chain(Arc::clone(&foliage.0), trunk_of(trunk)?, settings, wish))
    }

    fn curve(
        foliage: &PyFoliage,
        trunk: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let options = Options::new(options)?;
        let (settings, sweep) = (options.chain()?, options.sweep()?);
        options.finish()?;
        Ok(Self::Curve(Arc::clone(&foliage.0), trunk_of(trunk)?, settings, sweep))
    }

    /// Runs the work. Calls `better` with complete intermediate results, each better than the one before.
    fn run(&self, progress: Progress, better: Option<&(dyn Fn(Output) + Sync)>) -> leafcloud::Result<Output> {
        match self {
            Self::Fit(foliage, settings) => {
                let output = |cloud: leafcloud::Cloud| {
                    Output::Cloud(CloudInFrame {
                        mean_deviation: cloud.mean_deviation(foliage),
                        cloud: Arc::new(cloud),
                        frame: *foliage.frame(),
                        radius: foliage.frame().radius,
                    })
                };
                let Some(better) = better else { return leafcloud::fit::fit(foliage, settings, progress).map(output) };
                let tell = |cloud: leafcloud::Cloud| better(output(cloud));
                leafcloud::fit::fit_watched(foliage, settings, progress, &tell).map(output)
            }
            Self::Chain(foliage, trunk, settings, wish) => {
                let (chain, offer) = match wish {
                    None => (lod::build_chain(foliage, trunk.as_deref(), settings, progress)?, None),
                    Some(wish) => {
                        let Built { chain, offer, .. } =
                            build_within(foliage, trunk.as_deref(), settings, *wish, progress)?;
                        (chain, Some(offer))
                    }
                };
                Ok(Output::Chain(Arc::new(chain), foliage.frame().radius, offer))
            }
            Self::Curve(foliage, trunk, settings, wanted) => {
                let curve = sweep(foliage, trunk.as_deref(), settings, *wanted, progress)?;
                Ok(Output::Curve(Arc::new(curve)))
            }
        }
    }

    /// Runs the work on a separate thread. This thread, the only one that receives Ctrl-C, calls `progress` meanwhile.
    fn run_here(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<Py<PyAny>> {
        if let Some(progress) = progress.as_ref().map(|p| p.bind(py)).filter(|p| !p.is_callable()) {
            return Err(refuse(format!(
                "progress is {}; it must be a function of a stage and a fraction",
                shown(progress)
            )));
        }
        let cancelled = AtomicBool::new(false);
        let (told, tells) = mpsc::channel::<(String, f64)>();
        let (answered, answers) = mpsc::channel::<()>();
        let (tells, answers) = (Mutex::new(tells), Mutex::new(answers));
        let asks = progress.is_some();
        let report = move |stage: &str, fraction: f64, told: &mpsc::Sender<(String, f64)>| {
            if asks && told.send((stage.to_owned(), fraction)).is_ok() {
                let _ = lock(&answers).recv();
            }
        };
        let mut raised: Option<PyErr> = None;
        let result = py.detach(|| {
            std::thread::scope(|scope| {
                let cancelled = &cancelled;
                let told = Mutex::new(told);
                let work = scope.spawn(move || {
                    let report = |stage: &str, fraction: f64| {
                        report(stage, fraction, &lock(&told));
                        !cancelled.load(Ordering::Relaxed)
                    };
                    guard(|| self.run(Progress::new(&report), None))
                });
                while !work.is_finished() {
                    let tell = lock(&tells).recv_timeout(PATIENCE).ok();
                    let wish = Python::attach(|py| {
                        py.check_signals()?;
                        let (Some(callback), Some((stage, fraction))) = (&progress, &tell) else { return Ok(true) };
                        let answer = callback.bind(py).call1((stage, *fraction))?;
                        Ok(answer.extract::<bool>().unwrap_or(true))
                    });
                    let goes_on = wish.unwrap_or_else(|error| {
                        raised.get_or_insert(error);
                        false
                    });
                    if !goes_on {
                        cancelled.store(true, Ordering::Relaxed);
                    }
                    if tell.is_some() {
                        let _ = answered.send(());
                    }
                }
                work.join()
            })
        });
        if let Some(error) = raised {
            return Err(error);
        }
        match result {
            Ok(result) => result?.into_python(py),
            Err(_) => Err(refuse("the work ended without a result".to_owned())),
        }
    }
}

fn trunk_of(trunk: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Arc<Foliage>>> {
    let trunk: Option<Bound<'_, PyFoliage>> =
        trunk.map_or(Ok(None), |trunk| read(trunk, "trunk", "a Foliage or None").map(Some))?;
    Ok(trunk.map(|trunk| Arc::clone(&trunk.get().0)))
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
#[pyo3(signature = (foliage, *, trunk = None, progress = None, **options))]
pub fn build_chain(
    py: Python<'_>,
    foliage: &PyFoliage,
    trunk: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<PyAny>> {
    Work::chain(foliage, trunk, options)?.run_here(py, progress)
}

#[pyfunction]
#[pyo3(signature = (foliage, **options))]
pub fn start_fit(foliage: &PyFoliage, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyJob> {
    PyJob::start(Work::fit(foliage, options)?)
}

#[pyfunction]
#[pyo3(signature = (foliage, *, trunk = None, **options))]
pub fn start_chain(
    foliage: &PyFoliage,
    trunk: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<PyJob> {
    PyJob::start(Work::chain(foliage, trunk, options)?)
}

#[pyfunction]
#[pyo3(signature = (foliage, *, trunk = None, progress = None, **options))]
pub fn cost_curve(
    py: Python<'_>,
    foliage: &PyFoliage,
    trunk: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<PyAny>> {
    Work::curve(foliage, trunk, options)?.run_here(py, progress)
}

#[pyfunction]
#[pyo3(signature = (foliage, *, trunk = None, **options))]
pub fn start_cost_curve(
    foliage: &PyFoliage,
    trunk: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<PyJob> {
    PyJob::start(Work::curve(foliage, trunk, options)?)
}

/// State shared by the worker and the threads that watch it.
#[derive(Default)]
struct Shared {
    stage: Mutex<String>,
    /// The bits of an f64 in [0, 1]. Such numbers order like their bits, so the atomic maximum never decreases.
    fraction: AtomicU64,
    cancelled: AtomicBool,
    /// The best complete result so far.
    best: Mutex<Option<Output>>,
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
    /// Cancels the work: without the job nothing can take the result.
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
            let better = |output: Output| *lock(&worker.best) = Some(output);
            let result = guard(|| work.run(Progress::new(&report), Some(&better)));
            *lock(&worker.result) = Some(result);
            worker.ended.notify_all();
        };
        work::start(body)?;
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
            _ => lock(&self.0.best).clone().map(|output| output.into_python(py)).transpose(),
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

/// Locks a mutex, also after a panic of another thread. The guarded values are always replaced whole, so they stay valid.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
