//! Reads the foliage of a .glb or .gltf file: positions, texture coordinates, base colours, alpha.
//!
//! A part is foliage when its node's, mesh's or material's name contains one of the names asked for. Y up becomes Z up:
//! (x, y, z) → (x, −z, y), as Blender's importer does, and v is turned to point up.

use std::path::Path;

use glam::{DMat4, DVec3, Vec2, Vec4};
use gltf::mesh::Mode;

use crate::error::{Error, Result};
use crate::foliage::{AlphaMode, Attributes, Foliage, Image, Material};

/// What names foliage when nothing else was asked for.
pub const DEFAULT_NAMES: [&str; 5] = ["leaf", "leaves", "foliage", "needle", "frond"];

/// Reads the parts whose names contain one of `names`, whatever their case.
///
/// # Errors
/// The file cannot be read or is not glTF; no part has such a name; what [`Foliage::new`] refuses.
pub fn read<S: AsRef<str>>(path: &Path, names: &[S]) -> Result<Foliage> {
    let fail = |reason: String| Error::File { path: path.display().to_string(), reason };
    let (document, buffers, images) = gltf::import(path).map_err(|e| fail(e.to_string()))?;
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
            return Err(fail(format!("node {} is reached twice; glTF nodes form trees", node.index())));
        }
        let local = glam::Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        let matrix = parent * local;
        if let Some(mesh) = node.mesh() {
            let named = is_foliage(node.name()) || is_foliage(mesh.name());
            for primitive in mesh.primitives().filter(|p| p.mode() == Mode::Triangles) {
                if named || is_foliage(primitive.material().name()) {
                    soup.add(&primitive, &buffers, matrix).map_err(fail)?;
                }
            }
        }
        open.extend(node.children().map(|child| (child, matrix)));
    }
    if soup.triangles.is_empty() {
        return Err(fail(format!("no triangles of a node, mesh or material named like {}", names.join(", "))));
    }
    let materials = document.materials().map(|m| material(&m, &images)).collect::<Result<_>>()?;
    soup.into_foliage(materials)
}

/// Triangles as they are gathered from the primitives.
#[derive(Default)]
struct Soup {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    attributes: Attributes,
}

impl Soup {
    fn add(
        &mut self,
        primitive: &gltf::Primitive,
        buffers: &[gltf::buffer::Data],
        matrix: DMat4,
    ) -> std::result::Result<(), String> {
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
        let positions: Vec<[f32; 3]> = reader.read_positions().ok_or("a primitive has no positions")?.collect();
        let count = positions.len();
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count as u32).collect(),
        };
        if let Some(index) = indices.iter().find(|&&i| i as usize >= count) {
            return Err(format!("index {index} is out of range: there are {count} vertices"));
        }
        let uvs: Option<Vec<[f32; 2]>> = reader.read_tex_coords(0).map(|uvs| uvs.into_f32().collect());
        let colors: Option<Vec<[f32; 4]>> = reader.read_colors(0).map(|colors| colors.into_rgba_f32().collect());
        let first = self.positions.len() as u32;
        let to_z_up = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
        let place = |p: &[f32; 3]| to_z_up(matrix.transform_point3(DVec3::from_array(p.map(f64::from))));
        self.positions.extend(positions.iter().map(place));
        // Missing or short arrays read as zeros (texture coordinates) and white (colours).
        let uv =
            |i: u32| uvs.as_ref().and_then(|u| u.get(i as usize)).map_or(Vec2::ZERO, |u| Vec2::new(u[0], 1.0 - u[1]));
        let color =
            |i: u32| colors.as_ref().and_then(|c| c.get(i as usize)).map_or(Vec4::ONE, |&c| Vec4::from_array(c));
        let mirrored = matrix.determinant() < 0.0;
        for &[a, b, c] in indices.as_chunks::<3>().0 {
            // A mirrored node shows the front of its triangles where they wind the other way.
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            self.triangles.push(corners.map(|i| first + i));
            self.attributes.uvs.push(corners.map(uv));
            self.attributes.colors.push(corners.map(color));
            // A primitive without a material has the default one, behind all others.
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
        Foliage::new(&self.positions, self.triangles, self.attributes, materials)
    }
}

fn material(source: &gltf::Material, images: &[gltf::image::Data]) -> Result<Material> {
    let pbr = source.pbr_metallic_roughness();
    let image =
        pbr.base_color_texture().and_then(|t| images.get(t.texture().source().index())).map(rgba).transpose()?;
    let made = Material {
        name: source.name().unwrap_or("material").to_owned(),
        base_color: Vec4::from_array(pbr.base_color_factor()),
        image,
        alpha_mode: match source.alpha_mode() {
            gltf::material::AlphaMode::Opaque => AlphaMode::Opaque,
            gltf::material::AlphaMode::Mask => AlphaMode::Mask(source.alpha_cutoff().unwrap_or(0.5)),
            gltf::material::AlphaMode::Blend => AlphaMode::Blend,
        },
        double_sided: source.double_sided(),
    };
    made.check()?;
    Ok(made)
}

fn rgba(data: &gltf::image::Data) -> Result<Image> {
    use gltf::image::Format;
    let pixels: Vec<[u8; 4]> = match data.format {
        Format::R8 => data.pixels.iter().map(|&g| [g, g, g, 255]).collect(),
        Format::R8G8 => data.pixels.as_chunks::<2>().0.iter().map(|&[g, a]| [g, g, g, a]).collect(),
        Format::R8G8B8 => data.pixels.as_chunks::<3>().0.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
        Format::R8G8B8A8 => data.pixels.as_chunks::<4>().0.to_vec(),
        other => return Err(Error::invalid(format!("an image of the format {other:?}; use 8 bits a channel"))),
    };
    Image::new(data.width as usize, data.height as usize, pixels)
}
