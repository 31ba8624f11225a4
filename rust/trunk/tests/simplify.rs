//! Simplified meshes stay within the error. Measured here with random points and closed forms, independent of the crate.

use glam::{DMat3, DVec3, Vec2, Vec3};
use leafcloud::{Attributes, Foliage, Material, Progress};
use leafcloud_trunk::{Simplified, simplify};

/// Positions, triangles, and attributes of the corners.
#[derive(Clone, Default)]
struct Mesh {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    attributes: Attributes,
    materials: usize,
}

impl Mesh {
    /// A grid of `n` × `m` squares. `place` maps (0 … 1, 0 … 1) to vertex positions; the same pair is the texture coordinates.
    fn grid(n: u32, m: u32, place: impl Fn(f64, f64) -> DVec3) -> Self {
        let share = |i: u32| (f64::from(i % (n + 1)) / f64::from(n), f64::from(i / (n + 1)) / f64::from(m));
        let square = |i: u32| {
            let a = i / n * (n + 1) + i % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        let triangles: Vec<[u32; 3]> = (0..n * m).flat_map(square).collect();
        let uv = |i: u32| Vec2::new(share(i).0 as f32, share(i).1 as f32);
        let uvs = triangles.iter().map(|t| t.map(uv)).collect();
        let positions = (0..(n + 1) * (m + 1)).map(|i| place(share(i).0, share(i).1)).collect();
        Self { positions, triangles, attributes: Attributes { uvs, ..Attributes::default() }, materials: 1 }
    }

    /// A tube about the z axis, open at both ends, with a texture seam at y = 0.
    fn tube(radius: f64, height: f64, sides: u32, rings: u32) -> Self {
        let around = |u: f64| DVec3::new((std::f64::consts::TAU * u).cos(), (std::f64::consts::TAU * u).sin(), 0.0);
        // The last vertex of a ring lies exactly where the first does.
        let place = |u: f64, v: f64| around(if u == 1.0 { 0.0 } else { u }) * radius + DVec3::Z * height * v;
        let mut tube = Self::grid(sides, rings, place);
        let normal = |v: u32| (tube.positions[v as usize] * DVec3::new(1.0, 1.0, 0.0)).normalize().as_vec3();
        tube.attributes.normals = tube.triangles.iter().map(|t| t.map(normal)).collect();
        tube
    }

    fn moved(mut self, change: impl Fn(DVec3) -> DVec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = change(*p));
        self
    }

    /// Joins two meshes without shared vertices.
    fn with(mut self, other: &Self) -> Self {
        let shift = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + shift)));
        self.attributes.uvs.extend(&other.attributes.uvs);
        self.attributes.normals.extend(&other.attributes.normals);
        self
    }

    fn simplified(&self, error: f64) -> Simplified {
        let materials = vec![Material::default(); self.materials];
        let trunk =
            Foliage::new(&self.positions, self.triangles.clone(), self.attributes.clone(), materials).expect("a mesh");
        simplify(&trunk, error, Progress::silent()).expect("an error above 0")
    }

    fn corner(&self, corner: u32) -> DVec3 {
        self.positions[self.triangles[corner as usize / 3][corner as usize % 3] as usize]
    }

    fn surface(&self) -> Vec<[DVec3; 3]> {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize])).collect()
    }

    fn surface_of(&self, simplified: &Simplified) -> Vec<[DVec3; 3]> {
        simplified.corners.iter().map(|t| t.map(|c| self.corner(c))).collect()
    }
}

/// Returns the greatest distance from 4,000 random points on `from` to `to`, by comparing all triangles.
fn distance(from: &[[DVec3; 3]], to: &[[DVec3; 3]]) -> f64 {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut greatest = 0.0_f64;
    for i in 0..4_000 {
        let [a, b, c] = from[i % from.len()];
        let (mut s, mut t) = (random(), random());
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        let p = a + (b - a) * s + (c - a) * t;
        greatest = greatest.max(to.iter().map(|t| to_triangle(p, *t)).fold(f64::INFINITY, f64::min));
    }
    greatest
}

/// Returns the distance from a point to a triangle, by the inverse of the matrix of its edges and its normal.
fn to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let edges = [(a, b), (b, c), (c, a)];
    let to_edge = |(a, b): (DVec3, DVec3)| {
        let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        (p - a - (b - a) * t).length()
    };
    let nearest_edge = edges.map(to_edge).into_iter().fold(f64::INFINITY, f64::min);
    // Above the inside, the foot of the perpendicular has no negative weight.
    let matrix = DMat3::from_cols(b - a, c - a, (b - a).cross(c - a));
    let weights = matrix.inverse() * (p - a);
    let above = weights.x >= 0.0 && weights.y >= 0.0 && weights.x + weights.y <= 1.0;
    if above { weights.z.abs() * (b - a).cross(c - a).length() } else { nearest_edge }
}

#[test]
fn a_finely_tessellated_square_becomes_two_triangles() {
    let square = Mesh::grid(20, 20, |u, v| DVec3::new(u, v, 0.0));
    let simplified = square.simplified(1e-3);
    assert_eq!(simplified.corners.len(), 2);
    assert!(simplified.error < 1e-6, "{}", simplified.error);
    let area: f64 = square.surface_of(&simplified).iter().map(|[a, b, c]| (b - a).cross(c - a).z / 2.0).sum();
    assert!((area - 1.0).abs() < 1e-12, "{area}: all of it, and wound as before");
}

/// On a circle of radius r, the chord of an arc of angle α lies r (1 − cos α/2) below the arc.
#[test]
fn a_tube_keeps_as_many_sides_as_the_error_requires() {
    let tube = Mesh::tube(1.0, 10.0, 64, 40);
    let counts = [0.005, 0.02, 0.1].map(|error| {
        let simplified = tube.simplified(error);
        assert!(simplified.error <= error);
        let left = tube.surface_of(&simplified);
        let whole = tube.surface();
        assert!(distance(&whole, &left) <= error, "lost at {error}");
        assert!(distance(&left, &whole) <= error, "added at {error}");
        let sides = std::f64::consts::PI / (1.0 - error).acos();
        let triangles = simplified.corners.len() as f64;
        assert!(triangles < 8.0 * sides && triangles >= sides, "{triangles} where {sides} sides are enough");
        simplified.corners.len()
    });
    assert!(counts.is_sorted_by(|a, b| a > b), "{counts:?}");
}

/// The tips of thin branches weigh nothing in a mean over area, so the distance must be measured.
#[test]
fn thin_branches_keep_their_length() {
    let branch = Mesh::tube(0.05, 10.0, 8, 30).moved(|p| p + DVec3::X * (p.z / 4.0).sin());
    for error in [0.02, 0.1, 0.5, 2.0] {
        let simplified = branch.simplified(error);
        let left = branch.surface_of(&simplified);
        assert!(simplified.corners.len() < 480, "{error}");
        assert!(distance(&branch.surface(), &left) <= error.max(simplified.error));
        assert!(simplified.error <= error);
    }
}

#[test]
fn parts_smaller_than_the_error_are_removed() {
    let twig = Mesh::tube(0.01, 0.5, 6, 4).moved(|p| p + DVec3::X * 3.0);
    let tree = Mesh::tube(1.0, 10.0, 12, 10).with(&twig);
    let of_twig = |s: &Simplified| s.corners.iter().flatten().filter(|&&c| c >= 3 * 240).count();
    assert!(of_twig(&tree.simplified(0.2)) > 0, "its sphere has the radius 0.25");
    let without = tree.simplified(0.26);
    assert_eq!(of_twig(&without), 0);
    assert!(!without.corners.is_empty());
    assert!(without.error >= 0.25, "{}: removed parts count", without.error);
    assert_eq!(tree.simplified(6.0).corners.len(), 0);
}

#[test]
fn size_and_place_change_nothing() {
    let tube = Mesh::tube(1.0, 10.0, 24, 20);
    let simplified = tube.simplified(0.05);
    for scale in [0.125, 1024.0] {
        let scaled = tube.clone().moved(|p| p * scale).simplified(0.05 * scale);
        assert_eq!(scaled.corners, simplified.corners);
        assert!((scaled.error / scale - simplified.error).abs() < 1e-12);
    }
    // Integers and a shift by a power of two: no coordinate is rounded.
    let block = Mesh::grid(8, 8, |u, v| DVec3::new(8.0 * u, 8.0 * v, (8.0 * u * v).floor()));
    let far = DVec3::new(f64::from(1 << 20), -f64::from(1 << 20), 0.0);
    assert_eq!(block.simplified(0.7).corners, block.clone().moved(|p| p + far).simplified(0.7).corners);
}

#[test]
fn materials_do_not_mix_and_their_border_stays() {
    let mut square = Mesh::grid(16, 16, |u, v| DVec3::new(u, v, 0.0));
    square.materials = 2;
    square.attributes.material_ids = square
        .triangles
        .iter()
        .map(|t| u32::from(t.iter().map(|&v| square.positions[v as usize].x).sum::<f64>() > 1.5))
        .collect();
    let simplified = square.simplified(0.01);
    assert!(simplified.corners.len() <= 8, "{}", simplified.corners.len());
    for corners in &simplified.corners {
        let material = square.attributes.material_ids[corners[0] as usize / 3];
        for &corner in corners {
            assert_eq!(square.attributes.material_ids[corner as usize / 3], material);
            let x = square.corner(corner).x;
            assert!(if material == 0 { x <= 0.5 } else { x >= 0.5 }, "material {material} at {x}");
        }
    }
}

#[test]
fn texture_seams_stay_closed() {
    let tube = Mesh::tube(1.0, 10.0, 24, 20);
    let simplified = tube.simplified(0.1);
    for corners in &simplified.corners {
        let u = corners.map(|c| tube.attributes.uvs[c as usize / 3][c as usize % 3].x);
        let angle = corners.map(|c| tube.corner(c)).map(|p| p.y.atan2(p.x) / std::f64::consts::TAU);
        for i in 0..3 {
            let turn = f64::from(u[i]) - angle[i];
            assert!((turn - turn.round()).abs() < 1e-6, "a corner's u is its angle");
        }
        assert!(
            u.iter().copied().fold(0.0, f32::max) - u.iter().copied().fold(1.0, f32::min) < 0.6,
            "{u:?}: across the seam"
        );
    }
}

/// Flat shading splits the normals at every vertex; that must not prevent collapses.
#[test]
fn flat_shading_is_simplified() {
    let mut square = Mesh::grid(12, 12, |u, v| DVec3::new(u, v, 1e-4 * (40.0 * u).sin()));
    square.attributes.normals =
        square.surface().into_iter().map(|[a, b, c]| [(b - a).cross(c - a).normalize().as_vec3(); 3]).collect();
    assert!(square.simplified(0.01).corners.len() <= 8);
}

#[test]
fn broken_meshes_give_sane_ones() {
    let tube = Mesh::tube(1.0, 4.0, 8, 8);
    let mut broken = tube.clone();
    // Degenerate by index and by position, a duplicate, a reversed triangle, an edge of five triangles.
    broken.positions.extend([DVec3::X * 3.0, DVec3::X * 3.0, DVec3::X * 4.0, DVec3::Z * -1.0, DVec3::Y * 3.0]);
    let n = tube.positions.len() as u32;
    let first = tube.triangles[0];
    broken.triangles.extend([
        [0, 0, 1],
        [n, n + 1, n + 2],
        first,
        first,
        [first[1], first[0], first[2]],
        [first[0], first[1], n + 3],
        [first[0], first[1], n + 4],
    ]);
    broken.attributes = Attributes::default();
    let count = 3 * broken.triangles.len() as u32;
    for error in [1e-9, 0.05, 0.5, 1e3] {
        let simplified = broken.simplified(error);
        assert!(simplified.corners.len() <= broken.triangles.len());
        assert!(simplified.corners.iter().flatten().all(|&c| c < count));
        assert!(simplified.error <= error);
    }
    let points = Mesh { positions: vec![DVec3::ONE; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let mut all = tube.with(&points);
    all.attributes = Attributes::default();
    assert!(all.simplified(0.1).corners.iter().flatten().all(|&c| c < 3 * 128), "a point shows nothing");
}

#[test]
fn one_triangle_stays() {
    let one = Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
        materials: 1,
        ..Mesh::default()
    };
    assert_eq!(one.simplified(0.1), Simplified { corners: vec![[0, 1, 2]], error: 0.0 });
}

#[test]
fn threads_change_nothing() {
    let mut forest = Mesh::tube(1.0, 10.0, 16, 12);
    for i in 0..20 {
        let turn = DMat3::from_rotation_y(0.3 * f64::from(i));
        let branch = Mesh::tube(0.2, 4.0, 8, 10).moved(|p| turn * p + DVec3::Z * 0.4 * f64::from(i));
        forest = forest.with(&branch);
    }
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| forest.simplified(0.1))
    };
    assert_eq!(on(1), on(7));
}

#[test]
fn an_error_that_is_no_length_is_refused() {
    let trunk =
        Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], Attributes::default(), vec![]).unwrap();
    for error in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(simplify(&trunk, error, Progress::silent()).unwrap_err().to_string().contains("a length above 0"));
    }
}

#[test]
fn zero_normals_are_accepted() {
    let mut square = Mesh::grid(4, 4, |u, v| DVec3::new(u, v, 0.0));
    square.attributes.normals = vec![[Vec3::ZERO; 3]; square.triangles.len()];
    assert_eq!(square.simplified(0.01).corners.len(), 2);
}
