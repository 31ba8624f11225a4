//! Fits, chains and cost curves: blocking with the GIL released, or as a `Job` on a separate thread.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use leafcloud::geometry::Frame;
use leafcloud::lod::ChainSettings;
use leafcloud::{Foliage, Progress};
use leafcloud_choose::{Chosen, Wanted};
use leafcloud_curve::{Curve, Sweep, sweep};
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::chain::PyChain;
use crate::cloud::{CloudInFrame, PyCloud};
use crate::curve::PyCurve;
use crate::errors::{Failure, read, refuse, shown};
use crate::foliage::PyFoliage;
use crate::options::Options;
use crate::work::{self, OfThisProcess, PATIENCE, guard};

/// The result of work.
#[derive(Clone)]
enum Output {
    Cloud(CloudInFrame),
    Chain(Box<Chosen>, Frame),
    Curve(Arc<Curve>),
}

impl Output {
    fn into_python(self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(match self {
            Self::Cloud(cloud) => Py::new(py, PyCloud(cloud))?.into_any(),
            Self::Chain(chosen, frame) => Py::new(py, PyChain { chosen: *chosen, frame })?.into_any(),
            Self::Curve(curve) => Py::new(py, PyCurve(curve))?.into_any(),
        })
    }
}

/// Work with all its input.
enum Work {
    Fit(Arc<Foliage>, leafcloud::fit::FitSettings),
    Chain(Arc<Foliage>, Option<Arc<Foliage>>, Wanted),
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
        let wishes = options.wishes()?;
        let (settings, wish, last) = (options.chain()?, options.wish()?, options.last()?);
        options.finish()?;
        Ok(Self::Chain(Arc::clone(&foliage.0), trunk_of(trunk)?, Wanted { settings, wish, wishes, last }))
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
            Self::Chain(foliage, trunk, wanted) => {
                let chosen = wanted.build(foliage, trunk.as_deref(), progress)?;
                Ok(Output::Chain(Box::new(chosen), *foliage.frame()))
            }
            Self::Curve(foliage, trunk, settings, wanted) => {
                let curve = sweep(foliage, trunk.as_deref(), settings, *wanted, progress)?;
                Ok(Output::Curve(Arc::new(curve)))
            }
        }
    }

    /// Runs the work on a separate thread. This thread, the only one that receives Ctrl-C, calls `progress` meanwhile.
    ///
    /// After Ctrl-C the call raises at once, and the work stops at its next report.
    fn run_here(self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<Py<PyAny>> {
        if let Some(progress) = progress.as_ref().map(|p| p.bind(py)).filter(|p| !p.is_callable()) {
            return Err(refuse(format!(
                "progress is {}; it must be a function of a stage and a fraction",
                shown(progress)
            )));
        }
        let (events, happened) = mpsc::channel();
        let (answer, answers) = mpsc::channel();
        let (mut happened, mut answer) = (OfThisProcess::new(happened), OfThisProcess::new(answer));
        let stopped = Arc::new(AtomicBool::new(false));
        let caller =
            Caller { listens: progress.is_some(), events, answers: Mutex::new(answers), stopped: Arc::clone(&stopped) };
        work::start(move || {
            let report = |stage: &str, fraction: f64| caller.tell(stage, fraction);
            let result = guard(|| self.run(Progress::new(&report), None));
            let _ = caller.events.send(Event::Ended(Box::new(result))); // Nobody receives it after Ctrl-C.
        })?;
        let stop = |_: &PyErr| stopped.store(true, Ordering::Relaxed);
        loop {
            let waited = happened.get()?; // A signal handler may have forked.
            match py.detach(move || waited.recv_timeout(PATIENCE)) {
                Ok(Event::Ended(result)) => return (*result)?.into_python(py),
                Ok(Event::Told { stage, fraction, waits }) => {
                    let callback = progress.as_ref().map(|callback| callback.bind(py).call1((stage, fraction)));
                    let wish = callback.transpose().inspect_err(stop)?;
                    if wish.is_some_and(|wish| matches!(wish.extract(), Ok(false))) {
                        stopped.store(true, Ordering::Relaxed);
                    }
                    if waits {
                        let _ = answer.get()?.send(()); // The function may have forked.
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(refuse("the work ended without a result")),
            }
            py.check_signals().inspect_err(stop)?;
        }
    }
}

/// A message of the work to its caller.
enum Event {
    Told { stage: String, fraction: f64, waits: bool },
    Ended(Box<Result<Output, Failure>>),
}

/// The calling thread as the work sees it.
struct Caller {
    /// Whether the caller wants to hear of progress.
    listens: bool,
    events: mpsc::Sender<Event>,
    answers: Mutex<mpsc::Receiver<()>>,
    stopped: Arc<AtomicBool>,
}

impl Caller {
    /// Tells the caller of progress, and returns whether to continue.
    ///
    /// The work waits for the caller's answer, except on rayon's threads: the caller's function may itself call the core, which needs
    /// these threads.
    fn tell(&self, stage: &str, fraction: f64) -> bool {
        if self.listens {
            let waits = rayon::current_thread_index().is_none();
            let answers = waits.then(|| lock(&self.answers));
            let told = self.events.send(Event::Told { stage: stage.to_owned(), fraction, waits });
            if let (Ok(()), Some(answers)) = (told, answers) {
                let _ = answers.recv();
            }
        }
        !self.stopped.load(Ordering::Relaxed)
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
pub struct PyJob {
    shared: Arc<Shared>,
    /// The process that runs the work.
    process: u32,
}

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
        Ok(Self { shared, process: std::process::id() })
    }

    /// Returns the result once the work has ended. In a forked child it ends at once: a fork does not copy the thread of the work, and may
    /// copy its lock while it is held.
    fn ended(&self) -> Option<Result<Output, Failure>> {
        if self.process == std::process::id() {
            return lock(&self.shared.result).clone();
        }
        let known = self.shared.result.try_lock().ok().and_then(|result| result.clone());
        known.or_else(|| work::check_process(self.process).err().map(Err))
    }
}

impl PyJob {
    /// Returns the stage of the work, or its best result so far. A forked child may get the default: a fork copies the lock, perhaps while
    /// the work holds it.
    fn reported<T: Clone + Default>(&self, value: &Mutex<T>) -> T {
        if self.process == std::process::id() {
            return lock(value).clone();
        }
        value.try_lock().map(|value| value.clone()).unwrap_or_default()
    }
}

#[pymethods]
impl PyJob {
    #[getter]
    fn stage(&self) -> String {
        self.reported(&self.shared.stage)
    }

    #[getter]
    fn fraction(&self) -> f64 {
        f64::from_bits(self.shared.fraction.load(Ordering::Relaxed))
    }

    #[getter]
    fn done(&self) -> bool {
        self.ended().is_some()
    }

    #[getter]
    fn best(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        match self.ended() {
            Some(Ok(output)) => output.into_python(py).map(Some),
            _ => self.reported(&self.shared.best).map(|output| output.into_python(py)).transpose(),
        }
    }

    fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
    }

    #[pyo3(signature = (timeout = None))]
    fn result(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Py<PyAny>> {
        let wait = timeout.map(|seconds| Duration::try_from_secs_f64(seconds.max(0.0)).unwrap_or(Duration::MAX));
        let started = Instant::now();
        loop {
            if let Some(result) = self.ended() {
                return result?.into_python(py);
            }
            py.check_signals()?;
            if wait.is_some_and(|w| started.elapsed() >= w) {
                return Err(PyTimeoutError::new_err(format!("not done after {} s", timeout.unwrap_or_default())));
            }
            py.detach(|| {
                let result = lock(&self.shared.result);
                let pause = wait.map_or(PATIENCE, |w| w.saturating_sub(started.elapsed()).min(PATIENCE));
                drop(self.shared.ended.wait_timeout_while(result, pause, |r| r.is_none()));
            });
        }
    }
}

/// Locks a mutex, also after a panic of another thread. The guarded values are always replaced whole, so they stay valid.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
