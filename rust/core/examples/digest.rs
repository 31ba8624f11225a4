//! A digest of everything that a chain of the shrub decides, for every method: planes, parents, places on the page, pages, ranks, coverage.
//! Builds of all kinds and any number of threads must print the same (`tools/same_bytes.sh`).

use std::path::PathBuf;

use glam::DVec3;
use leafcloud::fit::{Effort, FitSettings, Method};
use leafcloud::lod::{Chain, ChainSettings, Refinement, build_chain};
use leafcloud::textures::{Channels, Samples};
use leafcloud::{Progress, gltf};

/// FNV-1a.
struct Digest(u64);

impl Digest {
    fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    fn add_chain(&mut self, chain: &Chain) {
        for level in &chain.levels {
            if let Some(cloud) = &level.cloud {
                let planes = cloud.planes.iter().flat_map(|p| [p.normal.x, p.normal.y, p.normal.z, p.distance]);
                self.add(planes.flat_map(f64::to_le_bytes));
                self.add(cloud.parents.iter().flat_map(|p| p.to_le_bytes()));
                self.add(cloud.deviations.iter().flat_map(|d| d.to_le_bytes()));
            }
            for b in &level.atlas.billboards {
                let region = [b.region.x, b.region.y, b.region.width, b.region.height];
                self.add(region.into_iter().flat_map(usize::to_le_bytes));
                self.add(b.corners.iter().flat_map(DVec3::to_array).flat_map(f64::to_le_bytes));
                self.add(level.atlas.uvs(b).flatten().flat_map(f32::to_le_bytes));
            }
            self.add(level.alpha_cutoff.to_le_bytes());
            for (_, image) in level.page.images() {
                self.add(image.pixels().iter().flatten().copied());
            }
            self.add(level.ranks.iter().flat_map(|r| r.to_le_bytes()));
            self.add(level.coverage.to_le_bytes());
        }
        self.add(chain.ranks.iter().flat_map(|r| r.to_le_bytes()));
    }
}

fn main() {
    let shrub = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples/shrub.glb");
    let foliage = gltf::read(&shrub, &gltf::DEFAULT_NAMES).expect("the shrub comes with the repository");
    let mut digest = Digest(0xCBF2_9CE4_8422_2325);
    for (method, effort) in [
        (Method::Stochastic, Effort::Literal),
        (Method::Stochastic, Effort::Default),
        (Method::Stochastic, Effort::Final),
        (Method::Density, Effort::Default),
        (Method::KMeans, Effort::Default),
    ] {
        let fit = FitSettings {
            method,
            effort,
            candidates: 60,
            max_billboards: (method == Method::KMeans).then_some(8),
            ..FitSettings::default()
        };
        let samples = Samples::new(2).expect("within the range");
        // Suns are slow without optimisation: once is enough.
        let sky = (method, effort) == (Method::Stochastic, Effort::Default);
        let channels = Channels {
            normal: Some(0.3),
            orm: true,
            translucency: true,
            occlusion: sky,
            bent_normal: sky,
            leaf_map: sky,
        };
        let settings = ChainSettings { fit, texture_size: 128.into(), samples, channels, ..ChainSettings::default() };
        digest.add_chain(&build_chain(&foliage, None, &settings, Progress::silent()).expect("the shrub has a chain"));
    }
    let (refine, samples) = (Refinement::Short, Samples::new(2).expect("within the range"));
    let settings = ChainSettings { texture_size: 128.into(), samples, levels: 1, refine, ..ChainSettings::default() };
    digest.add_chain(&build_chain(&foliage, None, &settings, Progress::silent()).expect("the shrub has a chain"));
    println!("{:016x}", digest.0);
}
