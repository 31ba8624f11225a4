//! `SETTINGS`, the range and the default of each number among the options, and constants of the levels. The values are the core's.

use leafcloud::fit::FitSettings;
use leafcloud::limits::{self, Limits};
use leafcloud::lod::{ChainSettings, EPSILON_STEP, LEAST_SAVING, PruneSettings};
use leafcloud::polygons::FRAGMENTS_PER_TRIANGLE;
use leafcloud::{metrics, prune, transition};
use leafcloud_choose::yardstick::UNJUDGED;
use leafcloud_choose::{HORIZON, LARGEST_CROWN, LATER_CROWN, MEMORY, QUALITY, SIZE, Wishes};
use leafcloud_curve::{IMAGE_ERROR, SECONDS};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMappingProxy};

/// A number of Python: int or float.
#[derive(Clone, Copy, IntoPyObject)]
enum Number {
    Count(u64),
    Real(f64),
}

#[pyclass(name = "Setting", module = "leafcloud", frozen, get_all)]
struct PySetting {
    low: Number,
    high: Number,
    above: bool,
    below: bool,
    default: Option<Number>,
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let settings = PyDict::new(module.py());
    for (name, setting) in fit_settings().into_iter().chain(chain_settings()) {
        settings.set_item(name, Bound::new(module.py(), setting)?)?;
    }
    module.add_class::<PySetting>()?;
    module.add("SETTINGS", PyMappingProxy::new(module.py(), settings.as_mapping()))?;
    module.add("EPSILON_STEP", EPSILON_STEP)?;
    module.add("LARGEST_CROWN", LARGEST_CROWN)?;
    module.add("LATER_CROWN", LATER_CROWN)?;
    module.add("UNJUDGED_CROWN", UNJUDGED)?;
    module.add("LEAST_SAVING", LEAST_SAVING)?;
    module.add("FRAGMENTS_PER_TRIANGLE", FRAGMENTS_PER_TRIANGLE)?;
    module.add("HAND_OVER", transition::HAND_OVER)?;
    module.add("RAMP", prune::RAMP)?;
    module.add("SKY", metrics::SKY)
}

type Named = (&'static str, PySetting);

fn fit_settings() -> Vec<Named> {
    let fit = FitSettings::default();
    vec![
        real("epsilon", limits::EPSILON, Some(fit.epsilon)),
        count("candidates", limits::CANDIDATES, Some(fit.candidates as u64)),
        count("seed", limits::SEED, Some(fit.seed)),
        real("facing", limits::FACING, Some(fit.facing)),
        real("gather", limits::GATHER, Some(fit.gather)),
        count("max_billboards", limits::MAX_BILLBOARDS, fit.max_billboards.map(|most| most as u64)),
        real("extra_error", limits::EXTRA_ERROR, Some(fit.extra_error)),
        count("max_texels", limits::MAX_TEXELS, fit.max_texels.map(|most| most as u64)),
        real("max_size", limits::MAX_SIZE, fit.max_size),
        real("compact", limits::COMPACT, fit.compact),
        real("penalty", limits::PENALTY, Some(fit.penalty)),
        count("views", limits::VIEWS, Some(fit.preference.views.len() as u64)),
        real("facing_views", limits::FACING_VIEWS, Some(fit.preference.facing_views)),
        real("vertical", limits::VERTICAL, Some(fit.preference.vertical)),
        real("image_epsilon", limits::IMAGE_EPSILON, fit.image.map(|image| image.angle)),
        real("viewing_distance", limits::VIEWING_DISTANCE, fit.image.map(|image| image.distance)),
    ]
}

fn chain_settings() -> Vec<Named> {
    let (chain, pruning, wishes) = (ChainSettings::default(), PruneSettings::default(), Wishes::default());
    vec![
        count("levels", limits::LEVELS, Some(chain.levels as u64)),
        count("triangles", limits::TRIANGLES, chain.triangles.map(|most| most as u64)),
        count("max_corners", limits::MAX_CORNERS, Some(chain.max_corners as u64)),
        real("min_visibility", limits::MIN_VISIBILITY, Some(chain.min_visibility)),
        count("texture_size", limits::TEXTURE_SIZE, Some(chain.texture_size.width as u64)),
        count("texture_height", limits::TEXTURE_SIZE, None),
        count("samples", limits::SAMPLES, Some(chain.samples.side() as u64)),
        real("normals", limits::NORMALS, chain.channels.normal.map(f64::from)),
        real("pixels", limits::PIXELS, Some(chain.pixels)),
        real("keep", limits::KEEP, chain.pruning.map(|pruning| pruning.keep)),
        real("leaf_pixels", limits::LEAF_PIXELS, Some(pruning.leaf_pixels)),
        real("prune_half", limits::PRUNE_HALF, Some(pruning.half)),
        real("seconds", SECONDS, None),
        real("image_error", IMAGE_ERROR, None),
        real("quality", QUALITY, Some(wishes.quality)),
        real("scene", HORIZON, Some(wishes.scene)),
        real("memory_budget", MEMORY, Some(wishes.memory_budget)),
        real("sizes", SIZE, None),
    ]
}

fn real(name: &'static str, limits: Limits, default: Option<f64>) -> Named {
    of(name, limits, Number::Real, default.map(Number::Real))
}

fn count(name: &'static str, limits: Limits, default: Option<u64>) -> Named {
    of(name, limits, |end| Number::Count(end as u64), default.map(Number::Count))
}

fn of(name: &'static str, limits: Limits, number: fn(f64) -> Number, default: Option<Number>) -> Named {
    let Limits { low, high, above, below } = limits;
    (name, PySetting { low: number(low), high: number(high), above, below, default })
}
