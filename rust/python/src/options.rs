//! Conversion of keyword options to the core's settings. Each option is removed when read; the remaining ones are unknown and refused.

use glam::DVec3;
use leafcloud::atlas::PageSize;
use leafcloud::fit::{FitSettings, ImageBound, Named, Preference};
use leafcloud::lod::{ChainSettings, CloudStep, PruneSettings, RefinedParts, ViewCounts};
use leafcloud::textures::Channels;
use leafcloud_choose::{Form, Last, Wishes};
use leafcloud_curve::{Preset, Sweep, Wish};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::errors::{Failure, read, refuse};

const COUNT: &str = "a whole number between 0 and 2^64 - 1";

/// Keyword options. Reading an option removes it.
pub struct Options<'py>(Option<Bound<'py, PyDict>>);

impl<'py> Options<'py> {
    pub fn new(options: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        options.map(PyDictMethods::copy).transpose().map(Self)
    }

    fn take<T>(&self, name: &str, read: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<T>, default: T) -> PyResult<T> {
        let Some(options) = &self.0 else { return Ok(default) };
        let Some(value) = options.get_item(name)? else { return Ok(default) };
        options.del_item(name)?;
        read(&value)
    }

    fn number(&self, name: &str, default: f64) -> PyResult<f64> {
        self.take(name, |v| read(v, name, "a number"), default)
    }

    fn count(&self, name: &str, default: usize) -> PyResult<usize> {
        self.take(name, |v| read(v, name, COUNT), default)
    }

    fn some<T>(&self, name: &str, wanted: &str) -> PyResult<Option<T>>
    where
        T: for<'a> FromPyObject<'a, 'py>,
    {
        self.take(name, |v| read(v, name, wanted), None)
    }

    fn named<T: Named>(&self, default: T) -> PyResult<T> {
        let read = |v: &Bound<'py, PyAny>| {
            let name: String = read(v, T::WHAT, "a name")?;
            Ok(T::from_name(&name).map_err(Failure::from)?)
        };
        self.take(T::WHAT, read, default)
    }

    fn image_bound(&self) -> PyResult<Option<ImageBound>> {
        let angle = self.some("image_epsilon", "a number or None")?;
        let distance = self.some("viewing_distance", "a number or None")?;
        match (angle, distance) {
            (None, None) => Ok(None),
            (Some(angle), Some(distance)) => Ok(Some(ImageBound { angle, distance })),
            _ => Err(refuse("`image_epsilon` and `viewing_distance` need each other: give both or neither")),
        }
    }

    fn preference(&self, up: DVec3) -> PyResult<Preference> {
        let views = |v: &Bound<'py, PyAny>| {
            let views: Vec<Bound<'py, PyAny>> = read(v, "views", "a list of directions, three floats each")?;
            views.iter().map(|view| arrays::vector(view, "a direction of views")).collect()
        };
        let default = Preference::default();
        Ok(Preference {
            views: self.take("views", views, default.views)?,
            facing_views: self.number("facing_views", default.facing_views)?,
            vertical: self.number("vertical", default.vertical)?,
            up: Some(up),
        })
    }

    fn up(&self) -> PyResult<DVec3> {
        self.take("up", |v| arrays::vector(v, "up"), DVec3::Z)
    }

    fn flag(&self, name: &str, default: bool) -> PyResult<bool> {
        self.take(name, |v| read(v, name, "True or False"), default)
    }

    /// Returns the page of level 1, and whether it may be made smaller: only if no size is given.
    fn texture_size(&self, default: PageSize) -> PyResult<(PageSize, bool)> {
        let side = |name| self.some(name, "a whole number between 0 and 2^64 - 1, or None");
        let (given, height) = (side("texture_size")?, side("texture_height")?);
        let width = given.unwrap_or(default.width);
        Ok((PageSize { width, height: height.unwrap_or(width) }, given.is_none() && height.is_none()))
    }

    pub fn fit(&self) -> PyResult<FitSettings> {
        let up = self.up()?;
        self.fit_with(up)
    }

    fn fit_with(&self, up: DVec3) -> PyResult<FitSettings> {
        let default = FitSettings::default();
        let count = "a whole number between 0 and 2^64 - 1, or None";
        Ok(FitSettings {
            method: self.named(default.method)?,
            effort: self.named(default.effort)?,
            epsilon: self.number("epsilon", default.epsilon)?,
            candidates: self.count("candidates", default.candidates)?,
            seed: self.count("seed", default.seed as usize)? as u64,
            whole_leaves: self.flag("whole_leaves", default.whole_leaves)?,
            facing: self.number("facing", default.facing)?,
            gather: self.number("gather", default.gather)?,
            max_billboards: self.some("max_billboards", count)?,
            extra_error: self.number("extra_error", default.extra_error)?,
            max_texels: self.some("max_texels", count)?,
            max_size: self.some("max_size", "a number or None")?,
            compact: self.some("compact", "a number or None")?,
            trim: self.flag("trim", default.trim)?,
            penalty: self.number("penalty", default.penalty)?,
            preference: self.preference(up)?,
            image: self.image_bound()?,
        })
    }

    fn pruning(&self) -> PyResult<Option<PruneSettings>> {
        let default = PruneSettings::default();
        let keep: Option<f64> = self.some("keep", "a number or None")?;
        let settings = PruneSettings {
            keep: keep.unwrap_or(default.keep),
            leaf_pixels: self.number("leaf_pixels", default.leaf_pixels)?,
            half: self.number("prune_half", default.half)?,
            contrast: self.flag("contrast", default.contrast)?,
        };
        Ok(keep.map(|_| settings))
    }

    fn refined_parts(&self, default: RefinedParts) -> PyResult<RefinedParts> {
        let parts = |v: &Bound<'py, PyAny>| {
            let names: Vec<String> = read(v, "refine_parts", "a list of names")?;
            match names.iter().find(|name| !["planes", "texels"].contains(&name.as_str())) {
                Some(other) => Err(refuse(format!("refine_parts has {other:?}; use \"planes\" and \"texels\""))),
                None => Ok(RefinedParts {
                    planes: names.iter().any(|name| name == "planes"),
                    texels: names.iter().any(|name| name == "texels"),
                }),
            }
        };
        self.take("refine_parts", parts, default)
    }

    pub fn chain(&self) -> PyResult<ChainSettings> {
        let default = ChainSettings::default();
        let sides = |v: &Bound<'py, PyAny>| read(v, "back_sides", "True, False or None");
        let up = self.up()?;
        let (texture_size, fitting_pages) = self.texture_size(default.texture_size)?;
        Ok(ChainSettings {
            fit: self.fit_with(up)?,
            levels: self.count("levels", default.levels)?,
            cross: self.flag("cross", default.cross)?,
            steps: self.steps()?,
            upright_planes: default.upright_planes,
            every_level: self.flag("every_level", default.every_level)?,
            up,
            triangles: self.some("triangles", "a whole number between 0 and 2^64 - 1, or None")?,
            max_corners: self.count("max_corners", default.max_corners)?,
            min_visibility: self.number("min_visibility", default.min_visibility)?,
            texture_size,
            fitting_pages,
            samples: self.take("samples", arrays::samples, default.samples)?,
            channels: Channels {
                normal: self.some("normals", "the fraction in [0, 1] by which normals bend, or None")?,
                orm: self.flag("orm", default.channels.orm)?,
                translucency: self.flag("translucency", default.channels.translucency)?,
                occlusion: self.flag("occlusion", default.channels.occlusion)?,
                bent_normal: self.flag("bent_normal", default.channels.bent_normal)?,
                leaf_map: self.flag("leaf_map", default.channels.leaf_map)?,
            },
            back_sides: self.take("back_sides", sides, default.back_sides)?,
            pruning: self.pruning()?,
            close_gaps: self.flag("close_gaps", default.close_gaps)?,
            blended: self.flag("blended", default.blended)?,
            tight_pages: self.flag("tight_pages", default.tight_pages)?,
            pixels: self.number("pixels", default.pixels)?,
            refine: self.named(default.refine)?,
            refined_parts: self.refined_parts(default.refined_parts)?,
            views: match (self.flag("few_views", false)?, self.flag("order_by_visibility", true)?) {
                (true, _) => ViewCounts::FEW,
                (false, true) => default.views,
                (false, false) => ViewCounts { order: 0, ..default.views },
            },
        })
    }

    /// Reads ε and size of each cloud.
    fn steps(&self) -> PyResult<Vec<CloudStep>> {
        let pairs: Option<Vec<(f64, f64)>> = self.some("steps", "a list of (epsilon, crown_pixels)")?;
        let step = |(epsilon, crown_pixels)| CloudStep { epsilon, crown_pixels, share: 1.0 };
        Ok(pairs.unwrap_or_default().into_iter().map(step).collect())
    }

    /// Reads the sweep of a cost curve.
    pub fn sweep(&self) -> PyResult<Sweep> {
        Ok(if self.flag("quick", false)? { Sweep::Quick } else { Sweep::Full })
    }

    /// Reads the wish for a chain: at most one of seconds, image error and preset.
    pub fn wish(&self) -> PyResult<Option<Wish>> {
        let seconds: Option<f64> = self.some("seconds", "a number or None")?;
        let error: Option<f64> = self.some("image_error", "a number or None")?;
        let preset: Option<String> = self.some("preset", "draft, balanced, final or None")?;
        let preset = preset.map(|name| Preset::from_name(&name).map_err(Failure::from)).transpose()?;
        let wishes = [seconds.map(Wish::Seconds), error.map(Wish::ImageError), preset.map(Wish::Preset)];
        let mut given = wishes.into_iter().flatten();
        match (given.next(), given.next()) {
            (wish, None) => Ok(wish),
            _ => Err(refuse("`seconds`, `image_error` and `preset` exclude each other; give one of them")),
        }
    }

    /// Reads the wishes; `None` without `quality`. Call it before the options of the chain.
    pub fn wishes(&self) -> PyResult<Option<Wishes>> {
        let default = Wishes::default();
        let quality: Option<f64> = self.some("quality", "a number or None")?;
        let form: Option<String> = self.some("form", "a name or None")?;
        let sizes: Option<Vec<f64>> = self.some("sizes", "a list of shares of the picture's height, or None")?;
        let wishes = Wishes {
            quality: quality.unwrap_or(default.quality),
            scene: self.number("scene", default.scene)?,
            memory_budget: self.number("memory_budget", default.memory_budget)?,
            shares: self.flag("shares", default.shares)?,
            twigs: self.flag("twigs", default.twigs)?,
            free: !self.0.as_ref().is_some_and(|options| options.contains("epsilon").unwrap_or(true)),
            form: match form.as_deref() {
                None | Some("auto") => Form::Auto,
                Some("billboards") => Form::Billboards,
                Some("leaves") if quality.is_none() => {
                    return Err(refuse("form=\"leaves\" needs `quality`, which judges the simplified leaves"));
                }
                Some("leaves") => Form::Leaves,
                Some(other) => {
                    return Err(refuse(format!("form is {other:?}; use \"auto\", \"billboards\" or \"leaves\"")));
                }
            },
            sizes: sizes.unwrap_or_default(),
        };
        if !wishes.sizes.is_empty() && quality.is_none() {
            return Err(refuse("`sizes` needs `quality`, which judges the levels"));
        }
        Ok(quality.map(|_| wishes))
    }

    /// Reads the form of the last level.
    pub fn last(&self) -> PyResult<Last> {
        let last: Option<String> = self.some("last", "a name or None")?;
        match last.as_deref() {
            Some("auto") => Ok(Last::Auto),
            None | Some("cross") => Ok(Last::Cross),
            Some("octahedral") => Ok(Last::Octahedral),
            Some(other) => Err(refuse(format!("last is {other:?}; use \"auto\", \"cross\" or \"octahedral\""))),
        }
    }

    /// Refuses the remaining options as unknown.
    pub fn finish(self) -> PyResult<()> {
        let left: Vec<String> = self.0.iter().flat_map(PyDictMethods::keys).map(|key| key.to_string()).collect();
        if left.is_empty() { Ok(()) } else { Err(refuse(format!("unknown option {}", left.join(", ")))) }
    }
}
