//! Input of the core: triangles, their leaves and their materials, in a local frame.

mod joined;
mod leaves;
pub(crate) mod mask;
mod material;
mod opaque;
mod part;
mod placed;
mod pyramid;
mod source_texel;
mod surface;
mod texel_mask;

use std::sync::{Arc, OnceLock};

use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

pub use material::{AlphaMode, Image, Material};
pub use opaque::{Opacity, Visible, place};
pub use source_texel::source_texel;
pub(crate) use surface::{BLOCK, Spot, Surface, a_hair_less};

use crate::error::{Error, Result};
use crate::geometry::Frame;
use crate::groups::{Groups, number_by_appearance};
use pyramid::Pyramid;

/// Attributes of the triangles; each array is empty or has one entry per triangle.
#[derive(Clone, Debug, Default)]
pub struct Attributes {
    /// UVs: origin in the lower left corner, v up.
    pub uvs: Vec<[Vec2; 3]>,
    /// Corner normals, in the caller's orientation.
    pub normals: Vec<[Vec3; 3]>,
    /// Linear RGBA that multiplies the material's base color.
    pub colors: Vec<[Vec4; 3]>,
    /// Linear RGB that replaces `colors` on the back (the side with clockwise winding), for baked light; empty: the same on both sides.
    pub back_colors: Vec<[Vec3; 3]>,
    /// Index into the materials; empty: the first for all.
    pub material_ids: Vec<u32>,
    /// Leaf of each triangle, by arbitrary values; empty: leaves are connected components.
    pub leaf_ids: Vec<i64>,
    /// Whether a triangle's leaf is never pruned; one such triangle protects the leaf.
    pub protected: Vec<bool>,
}

/// Foliage in its local frame (center of the bounding box at the origin, R = 1). Copies share their arrays.
#[derive(Clone, Debug)]
pub struct Foliage {
    frame: Frame,
    positions: Arc<[DVec3]>,
    triangles: Arc<[[u32; 3]]>,
    attributes: Arc<Attributes>,
    materials: Arc<[Material]>,
    /// Pyramids of the drawn share of each material's texels, built on first use from afar.
    coverage: Arc<[OnceLock<Pyramid<u8>>]>,
    leaf_ids: Arc<[u32]>,
    leaf_count: usize,
    /// Number of triangles, from the first, that are leaves, which get labels on an atlas page. Trunks have none.
    labelled: usize,
}

impl Foliage {
    /// Checks the input and moves it into the local frame.
    ///
    /// # Errors
    /// No triangles; too many triangles or vertices for 32 bits; an index out of range; a coordinate that is not finite or beyond 10³⁷; an
    /// attribute of the wrong length or with values that are not finite; UVs beyond 2²⁰; all triangles of zero area; a stray triangle of
    /// zero area.
    pub fn new(
        positions: &[DVec3],
        triangles: Vec<[u32; 3]>,
        attributes: Attributes,
        materials: Vec<Material>,
    ) -> Result<Self> {
        if triangles.is_empty() {
            return Err(Error::invalid("the foliage has no triangles; select a mesh with faces"));
        }
        check_indices(&triangles, positions.len())?;
        let materials = if materials.is_empty() { vec![Material::default()] } else { materials };
        let materials: Arc<[Material]> = materials.into_iter().map(Material::settled).collect();
        check_attributes(&attributes, triangles.len(), materials.len())?;
        let (frame, local) = located(positions, &triangles)?;
        let (leaf_ids, leaf_count) = if attributes.leaf_ids.is_empty() {
            leaves::components(&local, &triangles)
        } else {
            number_by_appearance(attributes.leaf_ids.iter())
        };
        let (coverage, labelled) = (unmade(&materials), triangles.len());
        Ok(Self {
            frame,
            positions: local,
            triangles: triangles.into(),
            attributes: Arc::new(attributes),
            materials,
            coverage,
            leaf_ids: leaf_ids.into(),
            leaf_count,
            labelled,
        })
    }

    /// Returns the local frame in the caller's coordinates.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Returns the number of triangles; at least one.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Returns the local positions of a triangle's corners.
    #[must_use]
    #[inline]
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Returns a triangle's vertex indices.
    #[must_use]
    pub fn triangle(&self, triangle: usize) -> [u32; 3] {
        self.triangles[triangle]
    }

    /// Returns the local area vector of a triangle: unit normal × area, oriented by the winding.
    #[must_use]
    #[inline]
    pub fn area_vector(&self, triangle: usize) -> DVec3 {
        area_vector(self.corners(triangle))
    }

    /// Returns the leaf of each triangle, 0 … [`Self::leaf_count`] − 1 in order of first appearance.
    #[must_use]
    pub fn leaf_ids(&self) -> &[u32] {
        &self.leaf_ids
    }

    /// Returns the number of leaves.
    #[must_use]
    pub fn leaf_count(&self) -> usize {
        self.leaf_count
    }

    /// Returns the triangles of each leaf.
    #[must_use]
    pub fn leaves(&self) -> Groups {
        Groups::by_key(&self.leaf_ids, self.leaf_count)
    }

    /// Returns the attributes of the triangles.
    #[must_use]
    pub fn attributes(&self) -> &Attributes {
        &self.attributes
    }

    /// Returns a triangle's material.
    #[must_use]
    pub fn material(&self, triangle: usize) -> &Material {
        &self.materials[self.material_id(triangle)]
    }

    /// Returns the index of a triangle's material; `None` for a trunk.
    pub(crate) fn label_of_material(&self, triangle: usize) -> Option<usize> {
        (triangle < self.labelled).then(|| self.material_id(triangle))
    }

    /// Returns the same triangles as a trunk, without leaf labels.
    pub(crate) fn without_labels(&self) -> Self {
        Self { labelled: 0, ..self.clone() }
    }

    fn material_id(&self, triangle: usize) -> usize {
        self.attributes.material_ids.get(triangle).map_or(0, |&m| m as usize)
    }

    /// Returns the pyramid of the drawn share of the texels of a triangle's material. Built on one thread: a thread that waits may be a
    /// worker that a parallel build would need.
    ///
    /// # Panics
    /// If the material has no image.
    fn coverage(&self, triangle: usize) -> &Pyramid<u8> {
        let material = self.material_id(triangle);
        self.coverage[material].get_or_init(|| self.materials[material].coverage().expect("a material with an image"))
    }

    /// Returns whether any triangle shows on one side only.
    #[must_use]
    pub fn is_single_sided(&self) -> bool {
        (0..self.triangle_count()).any(|t| !self.material(t).double_sided)
    }

    /// Returns whether any triangle has a texture with transparent parts.
    #[must_use]
    pub fn has_cutouts(&self) -> bool {
        (0..self.triangle_count()).any(|t| {
            let material = self.material(t);
            material.image.is_some() && material.alpha_mode != AlphaMode::Opaque
        })
    }

    /// Returns the same leaves with double-sided materials.
    #[must_use]
    pub fn double_sided(&self) -> Self {
        let double_sided = |material: &Material| Material { double_sided: true, ..material.clone() };
        // Sides do not change the drawn share of texels.
        Self { materials: self.materials.iter().map(double_sided).collect(), ..self.clone() }
    }

    /// Returns the same foliage with the normals of its faces where it has none of its own, so that leaves that move later keep them.
    #[must_use]
    pub fn with_normals(&self) -> Self {
        if !self.attributes.normals.is_empty() {
            return self.clone();
        }
        let normal = |triangle: usize| self.area_vector(triangle).normalize_or_zero().as_vec3();
        let normals = (0..self.triangle_count()).map(|triangle| [normal(triangle); 3]).collect();
        let attributes = Arc::new(Attributes { normals, ..Attributes::clone(&self.attributes) });
        Self { attributes, ..self.clone() }
    }

    /// Returns the same foliage with `change` applied to each material.
    #[must_use]
    pub fn with_materials(&self, change: impl Fn(&Material) -> Material) -> Self {
        let materials: Arc<[Material]> = self.materials.iter().map(change).collect();
        Self { coverage: unmade(&materials), materials, ..self.clone() }
    }
}

/// Checks positions. Returns the local frame of the triangles and the positions there.
fn located(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<(Frame, Arc<[DVec3]>)> {
    check_finite(positions)?;
    // Only used vertices count: a stray vertex must not set the scale.
    let corners = triangles.iter().flatten().map(|&v| positions[v as usize]);
    let frame = Frame::of(corners.clone()).ok_or_else(|| degenerate(corners.clone()))?;
    check_strays(positions, triangles, &frame)?;
    let local: Vec<DVec3> = positions.par_iter().map(|&p| frame.to_local(p)).collect();
    if triangles.iter().all(|t| area_vector(t.map(|v| local[v as usize])).length() == 0.0) {
        return Err(degenerate(corners));
    }
    Ok((frame, local.into()))
}

/// Returns the error for triangles of zero area.
fn degenerate(corners: impl Iterator<Item = DVec3>) -> Error {
    let (mut far, mut count) = (0.0, 0);
    for corner in corners {
        (far, count) = (corner.length().max(far), count + 1);
    }
    Error::invalid(format!(
        "all {} triangles have zero area; check the scale of the mesh, and its place: {far:.1e} from the origin coordinates are \
         rounded by {:.1e}",
        count / 3,
        far * f64::EPSILON
    ))
}

fn unmade(materials: &[Material]) -> Arc<[OnceLock<Pyramid<u8>>]> {
    materials.iter().map(|_| OnceLock::new()).collect()
}

/// Returns unit normal × area, in the units of the corners.
#[must_use]
#[inline]
pub fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a) * 0.5
}

/// Returns the leaf of each triangle, numbered by first appearance: its connected component.
///
/// # Errors
/// Too many triangles or vertices for 32 bits; an index out of range.
pub fn leaf_ids(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<Vec<u32>> {
    check_indices(triangles, positions.len())?;
    Ok(leaves::components(positions, triangles).0)
}

fn check_indices(triangles: &[[u32; 3]], vertices: usize) -> Result<()> {
    check_counts(triangles.len(), vertices)?;
    match triangles.iter().flatten().find(|&&v| v as usize >= vertices) {
        Some(v) => Err(Error::invalid(format!("triangle index {v} is out of range: there are {vertices} vertices"))),
        None => Ok(()),
    }
}

/// Checks that corners, three per triangle, and vertices can be numbered in 32 bits.
fn check_counts(triangles: usize, vertices: usize) -> Result<()> {
    let corners = triangles.checked_mul(3).and_then(|corners| u32::try_from(corners).ok());
    if corners.is_some() && u32::try_from(vertices).is_ok() {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "{triangles} triangles of {vertices} vertices; at most {} and {} are allowed: split the foliage",
        u32::MAX / 3,
        u32::MAX
    )))
}

/// Greatest coordinate: larger ones would overflow single precision in files and in Blender.
const FARTHEST: f64 = 1e37;

fn check_finite(positions: &[DVec3]) -> Result<()> {
    if let Some(i) = positions.iter().position(|p| p.is_finite() && p.abs().max_element() > FARTHEST) {
        return Err(Error::invalid(format!(
            "vertex {i} lies at {:?}, farther than {FARTHEST:e} from the origin; remove it or repair the mesh",
            positions[i].to_array()
        )));
    }
    match positions.iter().position(|p| !p.is_finite()) {
        Some(i) => Err(Error::invalid(format!(
            "vertex {i} lies at {:?}, which is not finite; remove it or repair the mesh",
            positions[i].to_array()
        ))),
        None => Ok(()),
    }
}

/// Greatest distance of a triangle without area, in radii of the triangles with an area.
const STRAY: f64 = 1000.0;

/// Refuses a collapsed triangle far away: it would set the scale although it is invisible, and ε is a share of R.
fn check_strays(positions: &[DVec3], triangles: &[[u32; 3]], frame: &Frame) -> Result<()> {
    let corners = |t: &[u32; 3]| t.map(|v| frame.to_local(positions[v as usize]));
    let has_area = |t: &[u32; 3]| area_vector(corners(t)).length() > 0.0;
    let seen = triangles.iter().filter(|t| has_area(t)).flat_map(corners);
    let Some(seen) = Frame::of(seen) else { return Ok(()) };
    let distance = |t: &[u32; 3]| corners(t).into_iter().map(|p| p.distance(seen.centre)).fold(0.0, f64::max);
    let stray = triangles.iter().position(|t| !has_area(t) && distance(t) > STRAY * seen.radius);
    let Some(stray) = stray else { return Ok(()) };
    Err(Error::invalid(format!(
        "triangle {stray} has zero area and lies {:.1e} times the radius of the others away; the limit is {STRAY}; remove it",
        distance(&triangles[stray]) / seen.radius
    )))
}

/// Greatest UV: beyond it, single precision cannot resolve a texel of a 16-texel texture.
const FARTHEST_UV: f32 = 1_048_576.0;

fn check_attributes(attributes: &Attributes, triangles: usize, materials: usize) -> Result<()> {
    let Attributes { uvs, normals, colors, back_colors, material_ids, leaf_ids, protected } = attributes;
    let lengths = [
        ("uvs", uvs.len()),
        ("normals", normals.len()),
        ("colors", colors.len()),
        ("back_colors", back_colors.len()),
        ("material_ids", material_ids.len()),
        ("leaf_ids", leaf_ids.len()),
        ("protected", protected.len()),
    ];
    if let Some((name, length)) = lengths.iter().find(|(_, length)| *length != 0 && *length != triangles) {
        return Err(Error::invalid(format!("{name} has {length} rows, but there are {triangles} triangles")));
    }
    let not_finite = |name| Err(Error::invalid(format!("{name} has a value that is not finite; repair the mesh")));
    if !uvs.iter().flatten().all(|uv| uv.is_finite()) {
        return not_finite("uvs");
    }
    if let Some(uv) = uvs.iter().flatten().find(|uv| uv.abs().max_element() > FARTHEST_UV) {
        return Err(Error::invalid(format!(
            "uvs has the value {:?}; a texture may repeat at most {FARTHEST_UV} times, because single precision misses texels beyond that",
            uv.to_array()
        )));
    }
    if !colors.iter().flatten().all(|c| c.is_finite()) {
        return not_finite("colors");
    }
    if !back_colors.iter().flatten().all(|c| c.is_finite()) {
        return not_finite("back_colors");
    }
    if !normals.iter().flatten().all(|n| n.is_finite()) {
        return not_finite("normals");
    }
    match material_ids.iter().find(|&&m| m as usize >= materials) {
        Some(m) => Err(Error::invalid(format!("material id {m} is out of range: there are {materials} materials"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::stability::case;

    fn foliage(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Result<Foliage> {
        Foliage::new(positions, triangles, Attributes::default(), vec![])
    }

    const RIGHT: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    #[test]
    fn one_triangle() {
        let f = foliage(&RIGHT, vec![[0, 1, 2]]).unwrap();
        assert_eq!((f.triangle_count(), f.leaf_count()), (1, 1));
        assert_eq!(f.frame().radius, 0.5f64.sqrt());
        let area = f.area_vector(0) * f.frame().radius.powi(2);
        assert!(area.distance(DVec3::Z * 0.5) < 1e-15);
    }

    #[test]
    fn stray_vertices_do_not_set_the_scale() {
        let mut positions = RIGHT.to_vec();
        positions.push(DVec3::splat(1e9));
        assert_eq!(foliage(&positions, vec![[0, 1, 2]]).unwrap().frame().radius, 0.5f64.sqrt());
    }

    #[test]
    fn refusals_name_the_value() {
        let message = |r: Result<Foliage>| r.unwrap_err().to_string();
        assert!(message(foliage(&RIGHT, vec![])).contains("no triangles"));
        assert!(message(foliage(&RIGHT, vec![[0, 1, 3]])).contains("index 3"));
        assert!(message(foliage(&[DVec3::NAN, DVec3::X, DVec3::Y], vec![[0, 1, 2]])).contains("vertex 0"));
        assert!(message(foliage(&RIGHT, vec![[0, 1, 1]])).contains("zero area"));
        assert!(message(foliage(&[DVec3::ONE; 3], vec![[0, 1, 2]])).contains("zero area"));
        let short = Attributes { uvs: vec![[Vec2::ZERO; 3]; 2], ..Attributes::default() };
        assert!(message(Foliage::new(&RIGHT, vec![[0, 1, 2]], short, vec![])).contains("uvs has 2 rows"));
        let unknown = Attributes { material_ids: vec![1], ..Attributes::default() };
        assert!(message(Foliage::new(&RIGHT, vec![[0, 1, 2]], unknown, vec![])).contains("material id 1"));
    }

    #[test]
    fn counts_that_thirty_two_bits_cannot_hold() {
        let most = u32::MAX as usize / 3;
        case("Geometry", "as many triangles as 32 bits can number the corners of", "definition")
            .equals(check_counts(most, 3).is_ok(), true);
        let refuse = |name, triangles, vertices| {
            case("Geometry", name, "a named error").refuses(check_counts(triangles, vertices), "split the foliage");
        };
        refuse("one triangle more than that", most + 1, 3);
        refuse("2⁶³ triangles", 1 << 63, 3);
        refuse("2³² vertices", 1, 1 << 32);
    }

    #[test]
    fn leaves_as_told() {
        let told = Attributes { leaf_ids: vec![40, -3, 40], ..Attributes::default() };
        let f = Foliage::new(&RIGHT, vec![[0, 1, 2]; 3], told, vec![]).unwrap();
        assert_eq!((f.leaf_ids(), f.leaf_count()), (&[0, 1, 0][..], 2));
    }
}
