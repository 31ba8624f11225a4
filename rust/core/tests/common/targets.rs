//! Fuzz targets, for the fuzzer (`make fuzz`) and for replay in every test run (`corpus.rs`). They turn any bytes into input and check the
//! promises of the result; a refusal is a valid result.

use arbitrary::{Arbitrary, Result, Unstructured};
use glam::{DVec2, DVec3, Vec2, Vec3};
use leafcloud::atlas::{Atlas, AtlasSettings, PageSize};
use leafcloud::fit::{Effort, FitSettings, Method, fit};
use leafcloud::foliage::{AlphaMode, Attributes, Image, Material};
use leafcloud::geometry::{Outline, Plane, minimum_rectangle};
use leafcloud::textures::{Channel, Samples, ScreenTriangle, Window, rasterise};
use leafcloud::{Foliage, Progress, gltf};

/// A fuzz target: a function of any bytes.
pub type Target = fn(&[u8]);

/// All targets with their names.
pub const TARGETS: [(&str, Target); 4] =
    [("fit", fit_anything), ("pack", pack_anything), ("raster", draw_anything), ("read_gltf", read_anything)];

/// Fits a foliage of any numbers by any method.
pub fn fit_anything(bytes: &[u8]) {
    let _ = try_fit(&mut Unstructured::new(bytes));
}

/// Packs outlines of any size on any page.
pub fn pack_anything(bytes: &[u8]) {
    let _ = try_pack(&mut Unstructured::new(bytes));
}

/// Draws triangles anywhere on and outside a small canvas.
pub fn draw_anything(bytes: &[u8]) {
    let _ = try_draw(&mut Unstructured::new(bytes));
}

/// Reads a glTF document without a folder, with meshes of any name.
pub fn read_anything(bytes: &[u8]) {
    if let Ok(foliage) = gltf::parse(bytes, None, &[""]) {
        assert!((0..foliage.triangle_count()).all(|t| foliage.corners(t).iter().all(|p| p.is_finite())));
    }
}

/// Returns mostly ordinary numbers, sometimes huge ones or arbitrary bits.
fn number(u: &mut Unstructured) -> Result<f64> {
    Ok(match u.int_in_range(0..=31)? {
        0 => f64::from_bits(u64::arbitrary(u)?),
        1 => f64::from(f32::from_bits(u32::arbitrary(u)?)),
        2 => f64::from(i16::arbitrary(u)?) * 1e6,
        _ => f64::from(i16::arbitrary(u)?) / 32768.0,
    })
}

fn point(u: &mut Unstructured) -> Result<DVec3> {
    Ok(DVec3::new(number(u)?, number(u)?, number(u)?))
}

fn some_foliage(u: &mut Unstructured) -> Result<leafcloud::Result<Foliage>> {
    let vertices = u.int_in_range(3..=90)?;
    let positions = (0..vertices).map(|_| point(u)).collect::<Result<Vec<_>>>()?;
    let count = u.int_in_range(1..=60)?;
    let triangles = (0..count)
        .map(|_| Ok([(); 3].map(|()| u.int_in_range(0..=vertices as u32 - 1).unwrap_or(0))))
        .collect::<Result<Vec<_>>>()?;
    let leaf_ids = if bool::arbitrary(u)? { (0..count).map(|t| t / 3).collect() } else { vec![] };
    Ok(Foliage::new(&positions, triangles, Attributes { leaf_ids, ..Attributes::default() }, vec![]))
}

fn try_fit(u: &mut Unstructured) -> Result<()> {
    let Ok(foliage) = some_foliage(u)? else { return Ok(()) };
    let method = *u.choose(&[Method::Stochastic, Method::Stochastic, Method::Density, Method::KMeans])?;
    // The density method's grid is as fine as ε, so a small ε is slow, though not wrong; a budget would try several ε.
    let epsilons: &[f64] =
        if method == Method::Density { &[0.1, 0.3, 1.0] } else { &[0.04, 0.3, 1.0, 1e-3, 1e-6, 1e-9] };
    let settings = FitSettings {
        method,
        effort: *u.choose(&[Effort::Literal, Effort::Default, Effort::Default])?,
        epsilon: *u.choose(epsilons)?,
        candidates: u.int_in_range(1..=40)?,
        whole_leaves: bool::arbitrary(u)?,
        gather: *u.choose(&[0.0, 0.0, 4.0])?,
        max_billboards: u.choose(&[None, None, Some(1), Some(7)])?.filter(|_| method != Method::Density),
        extra_error: *u.choose(&[0.0, 0.25, 1.0])?,
        max_size: *u.choose(&[None, None, Some(1.0)])?,
        compact: *u.choose(&[None, None, Some(0.1)])?,
        seed: u64::from(u8::arbitrary(u)?),
        ..FitSettings::default()
    };
    let Ok(cloud) = fit(&foliage, &settings, Progress::silent()) else { return Ok(()) };
    assert_eq!(cloud.parents.len(), foliage.triangle_count());
    let bound = cloud.bound / foliage.frame().radius;
    // The bound is the requested ε, except with a budget, which determines it, and for k-means, which reports one.
    if settings.max_billboards.is_none() && settings.method != Method::KMeans {
        assert!(bound <= settings.epsilon * (1.0 + 1e-15), "{settings:?}: {bound}");
    }
    for (t, &parent) in cloud.parents.iter().enumerate() {
        let plane = cloud.planes[parent as usize];
        assert!((plane.normal.length() - 1.0).abs() < 1e-9, "{settings:?}: {plane:?}");
        for p in foliage.corners(t) {
            assert!(plane.height(p).abs() <= bound, "{settings:?}: {} > {bound}", plane.height(p).abs());
        }
    }
    Ok(())
}

fn some_outline(u: &mut Unstructured) -> Result<Outline> {
    let count = u.int_in_range(1..=12)?;
    // Outlines lie in the unit ball of the local frame: larger coordinates are replaced.
    let coordinate = |u: &mut Unstructured| number(u).map(|x| if x.abs() <= 2.0 { x } else { 0.5 });
    let points = (0..count).map(|_| Ok(DVec2::new(coordinate(u)?, coordinate(u)?))).collect::<Result<Vec<_>>>()?;
    let outline = minimum_rectangle(&points);
    for p in &points {
        let q = DVec2::new(outline.x.dot(*p), outline.x.perp().dot(*p));
        assert!((outline.low - q).max(q - outline.high).max_element() <= 1e-9, "{p} lies outside {outline:?}");
    }
    Ok(outline)
}

fn try_pack(u: &mut Unstructured) -> Result<()> {
    let count = u.int_in_range(1..=40)?;
    let outlines = (0..count).map(|_| some_outline(u)).collect::<Result<Vec<_>>>()?;
    let settings = AtlasSettings {
        size: PageSize { width: u.int_in_range(0..=300)?, height: u.int_in_range(0..=300)? },
        gutter: u.int_in_range(0..=5)?,
        back_sides: bool::arbitrary(u)?,
    };
    let planes = vec![Plane { normal: DVec3::Z, distance: 0.0 }; outlines.len()];
    let Ok(atlas) = Atlas::pack(&planes, &outlines, settings) else { return Ok(()) };
    let mut owned = vec![false; atlas.size.texels()];
    for b in &atlas.billboards {
        assert!(b.corners.iter().all(|c| c.is_finite()));
        assert!(b.region.x + b.region.width <= atlas.size.width && b.region.y + b.region.height <= atlas.size.height);
        for y in b.region.y..b.region.y + b.region.height {
            for x in b.region.x..b.region.x + b.region.width {
                assert!(!std::mem::replace(&mut owned[y * atlas.size.width + x], true), "two regions share {x} {y}");
            }
        }
    }
    Ok(())
}

fn try_draw(u: &mut Unstructured) -> Result<()> {
    let (width, height) = (u.int_in_range(1..=70)?, u.int_in_range(1..=70)?);
    let samples = Samples::new(u.int_in_range(1..=5)?).expect("within the range");
    let alpha = <[u8; 4]>::arbitrary(u)?;
    let image = Image::new(2, 2, alpha.map(|a| [10, 200, 30, a]).to_vec()).expect("two by two");
    let material = Material {
        image: Some(image),
        alpha_mode: *u.choose(&[AlphaMode::Opaque, AlphaMode::Mask(0.5), AlphaMode::Blend])?,
        double_sided: bool::arbitrary(u)?,
        ..Material::default()
    };
    let uv = |u: &mut Unstructured| number(u).map(|x| if x.is_finite() { x as f32 } else { 0.0 });
    let uvs = [Vec2::new(uv(u)?, uv(u)?), Vec2::new(uv(u)?, uv(u)?), Vec2::new(uv(u)?, uv(u)?)];
    let attributes = Attributes { uvs: vec![uvs], ..Attributes::default() };
    let Ok(foliage) = Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], attributes, vec![material])
    else {
        return Ok(());
    };
    let count = u.int_in_range(1..=12)?;
    let cut = Window { columns: 3..40, ..Window::WHOLE };
    let mut triangles = Vec::new();
    for _ in 0..count {
        let corners = [(); 3].map(|()| point(u).map_or(Vec3::ZERO, |p| (p * 64.0).as_vec3()));
        let window = if bool::arbitrary(u)? { &Window::WHOLE } else { &cut };
        triangles.push(ScreenTriangle { reach: f32::INFINITY, corners, foliage: &foliage, triangle: 0, window });
    }
    let channels = [Channel::BaseColor, Channel::Normal(0.3), Channel::Orm(None), Channel::Translucency];
    for (canvas, channel) in rasterise(&triangles, width, height, samples, &channels).iter().zip(channels) {
        assert_eq!(canvas.pixels.len(), width * height);
        assert!(canvas.pixels.iter().all(|p| p.is_finite() && (0.0..=1.0).contains(&p.w)), "{channel:?}");
        assert_eq!(channel.to_image(canvas).width(), width);
    }
    Ok(())
}
