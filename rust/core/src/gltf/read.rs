//! Foliage from a .glb or .gltf file: positions, normals, vertex colors, UVs of the base color, and the textures of base color, roughness
//! and metallic, and normals. The latter two are read only if they use the base color's UV set.
//!
//! A part is foliage if the name of its node, mesh or material contains one of the requested names. Y up becomes Z up:
//! (x, y, z) → (x, −z, y), like in Blender's importer, and v is flipped to point up.
//!
//! The document may be broken or hostile. It is checked before it is read (`source`, `accessors`), and only images that foliage uses are
//! decoded.

use std::collections::HashSet;
use std::path::Path;

use glam::{DMat4, DVec3, Vec2, Vec3, Vec4};
use gltf::mesh::Mode;

use super::accessors;
use super::source::{Source, read_file};
use crate::error::{Error, Result};
use crate::foliage::{AlphaMode, Attributes, Foliage, Image, Material};

/// Default name parts of foliage.
pub const DEFAULT_NAMES: [&str; 5] = ["leaf", "leaves", "foliage", "needle", "frond"];

/// Reads the parts whose names contain one of `names`, ignoring case.
///
/// # Errors
/// The file cannot be read or is not glTF; no part has such a name; an error of [`Foliage::new`].
pub fn read<S: AsRef<str>>(path: &Path, names: &[S]) -> Result<Foliage> {
    let fail = |reason: String| Error::File { path: path.display().to_string(), reason };
    let bytes = read_file(path).map_err(fail)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    parse(&bytes, Some(folder), names).map_err(|error| match error {
        Error::Invalid(reason) => fail(reason),
        other => other,
    })
}

/// Reads foliage from memory, like [`read`]. `folder` is the folder of external files; without one, the document may not refer to any.
///
/// # Errors
/// Those of [`read`], without the file's name.
pub fn parse<S: AsRef<str>>(bytes: &[u8], folder: Option<&Path>, names: &[S]) -> Result<Foliage> {
    check_header(bytes)?;
    let gltf::Gltf { document, blob } =
        gltf::Gltf::from_slice_without_validation(bytes).map_err(|e| Error::invalid(e.to_string()))?;
    let root = document.into_json();
    accessors::check_references(&root).map_err(Error::Invalid)?;
    let document = gltf::Document::from_json(root).map_err(|e| Error::invalid(e.to_string()))?;
    let mut source = Source::of(&document, blob, folder).map_err(Error::Invalid)?;
    let mut soup = Soup::default();
    let names: Vec<String> = names.iter().map(|n| n.as_ref().to_lowercase()).collect();
    let is_foliage = |found: Option<&str>| {
        let found = found.unwrap_or_default().to_lowercase();
        names.iter().any(|n| found.contains(n))
    };
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots = scene.iter().flat_map(gltf::Scene::nodes);
    let mut open: Vec<(gltf::Node, DMat4)> = roots.map(|n| (n, DMat4::IDENTITY)).collect();
    let mut visited = vec![false; document.nodes().len()];
    while let Some((node, parent)) = open.pop() {
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(Error::invalid(format!("node {} is reached twice; glTF nodes form trees", node.index())));
        }
        let local = glam::Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        let matrix = parent * local;
        if let Some(mesh) = node.mesh() {
            let named = is_foliage(node.name()) || is_foliage(mesh.name());
            for primitive in mesh.primitives().filter(|p| p.mode() == Mode::Triangles) {
                if named || is_foliage(primitive.material().name()) {
                    soup.add(&primitive, &source, matrix).map_err(Error::Invalid)?;
                }
            }
        }
        open.extend(node.children().map(|child| (child, matrix)));
    }
    if soup.triangles.is_empty() {
        return Err(Error::invalid(format!(
            "no triangles of a node, mesh or material named like {}",
            names.join(", ")
        )));
    }
    let used: HashSet<u32> = soup.attributes.material_ids.iter().copied().collect();
    let materials = (0u32..).zip(document.materials()).map(|(i, m)| {
        let surface = m.pbr_metallic_roughness();
        let mut image = |texture: Option<(gltf::Texture, u32)>| {
            let texture = texture.filter(|(_, set)| *set == set_of(&m) && used.contains(&i));
            texture.map(|(texture, _)| source.image(&texture.source())).transpose().map_err(Error::Invalid)
        };
        let color = image(surface.base_color_texture().map(|t| (t.texture(), t.tex_coord())))?;
        let orm = image(surface.metallic_roughness_texture().map(|t| (t.texture(), t.tex_coord())))?;
        let normal = image(m.normal_texture().map(|t| (t.texture(), t.tex_coord())))?;
        material(&m, color, orm, normal)
    });
    let materials = materials.collect::<Result<_>>()?;
    soup.into_foliage(materials)
}

/// Checks that a binary file's length field covers its header; the crate `gltf` does not.
fn check_header(bytes: &[u8]) -> Result<()> {
    const HEADER: usize = 12;
    let Some([b'g', b'l', b'T', b'F', _, _, _, _, length @ ..]) = bytes.first_chunk::<HEADER>() else { return Ok(()) };
    let length = u32::from_le_bytes(*length) as usize;
    if length >= HEADER {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "the binary header gives the file a length of {length} bytes; the header alone has {HEADER}"
    )))
}

/// Returns the UV set of a material's leaves: the set of its base color.
fn set_of(material: &gltf::Material) -> u32 {
    material.pbr_metallic_roughness().base_color_texture().map_or(0, |texture| texture.tex_coord())
}

/// Triangles gathered from all primitives.
#[derive(Default)]
struct Soup {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    attributes: Attributes,
}

impl Soup {
    fn add(&mut self, primitive: &gltf::Primitive, source: &Source, matrix: DMat4) -> std::result::Result<(), String> {
        let set = set_of(&primitive.material());
        accessors::check(primitive, set, source)?;
        let reader = primitive.reader(|buffer| source.buffer(buffer.index()));
        let positions: Vec<[f32; 3]> = reader.read_positions().ok_or("a primitive has no positions")?.collect();
        let count = positions.len();
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count as u32).collect(),
        };
        if let Some(index) = indices.iter().find(|&&i| i as usize >= count) {
            return Err(format!("index {index} is out of range: there are {count} vertices"));
        }
        let uvs: Option<Vec<[f32; 2]>> = reader.read_tex_coords(set).map(|uvs| uvs.into_f32().collect());
        let normals: Option<Vec<[f32; 3]>> = reader.read_normals().map(Iterator::collect);
        let colors: Option<Vec<[f32; 4]>> = reader.read_colors(0).map(|colors| colors.into_rgba_f32().collect());
        if u32::try_from(self.positions.len() + count).is_err() {
            return Err("all primitives together have 2³² vertices or more; split the file".to_owned());
        }
        let first = self.positions.len() as u32;
        let to_z_up = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
        let place = |p: &[f32; 3]| to_z_up(matrix.transform_point3(DVec3::from_array(p.map(f64::from))));
        self.positions.extend(positions.iter().map(place));
        // Missing or short arrays give UVs of 0, zero normals (the triangle's own normal is used instead) and white.
        let uv =
            |i: u32| uvs.as_ref().and_then(|u| u.get(i as usize)).map_or(Vec2::ZERO, |u| Vec2::new(u[0], 1.0 - u[1]));
        let color =
            |i: u32| colors.as_ref().and_then(|c| c.get(i as usize)).map_or(Vec4::ONE, |&c| Vec4::from_array(c));
        // A singular matrix has no inverse. It gives zero normals, so the triangles' own normals are used.
        let across = glam::DMat3::from_mat4(matrix).inverse().transpose();
        let turned = |n: &[f32; 3]| {
            let normal = to_z_up(across * DVec3::from_array(n.map(f64::from)));
            normal.try_normalize().unwrap_or(DVec3::ZERO).as_vec3()
        };
        let normal = |i: u32| normals.as_ref().and_then(|n| n.get(i as usize)).map_or(Vec3::ZERO, turned);
        let mirrored = matrix.determinant() < 0.0;
        for &[a, b, c] in indices.as_chunks::<3>().0 {
            // Mirroring reverses the winding; swapping two corners keeps the front side.
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            self.triangles.push(corners.map(|i| first + i));
            self.attributes.uvs.push(corners.map(uv));
            self.attributes.colors.push(corners.map(color));
            self.attributes.normals.push(corners.map(normal));
            // A primitive without a material uses the default material, appended after all others.
            self.attributes.material_ids.push(primitive.material().index().map_or(u32::MAX, |i| i as u32));
        }
        Ok(())
    }

    fn into_foliage(mut self, mut materials: Vec<Material>) -> Result<Foliage> {
        let default = materials.len() as u32;
        for id in self.attributes.material_ids.iter_mut().filter(|id| **id == u32::MAX) {
            *id = default;
        }
        materials.push(Material::default());
        if self.attributes.colors.iter().flatten().all(|c| *c == Vec4::ONE) {
            self.attributes.colors.clear();
        }
        if self.attributes.normals.iter().flatten().all(|n| *n == Vec3::ZERO) {
            self.attributes.normals.clear();
        }
        Foliage::new(&self.positions, self.triangles, self.attributes, materials)
    }
}

fn material(
    source: &gltf::Material,
    image: Option<Image>,
    orm: Option<Image>,
    normal: Option<Image>,
) -> Result<Material> {
    let unread = orm.is_none() && source.pbr_metallic_roughness().metallic_roughness_texture().is_some();
    let made = Material {
        name: source.name().unwrap_or("material").to_owned(),
        base_color: Vec4::from_array(source.pbr_metallic_roughness().base_color_factor()),
        image,
        alpha_mode: match source.alpha_mode() {
            gltf::material::AlphaMode::Opaque => AlphaMode::Opaque,
            gltf::material::AlphaMode::Mask => AlphaMode::Mask(source.alpha_cutoff().unwrap_or(0.5)),
            gltf::material::AlphaMode::Blend => AlphaMode::Blend,
        },
        double_sided: source.double_sided(),
        roughness: source.pbr_metallic_roughness().roughness_factor(),
        // With a texture, the factor is 1. If the texture is not read, leaves are not metallic.
        metallic: if unread { 0.0 } else { source.pbr_metallic_roughness().metallic_factor() },
        // Red is not read as occlusion: glTF stores occlusion in a texture of its own.
        orm: orm.map(|image| image.mapped(|[_, g, b, a]| [255, g, b, a])),
        normal,
        ..Material::default()
    };
    made.check()?;
    Ok(made)
}
