//! Simplified meshes look like the whole ones. Measured here with rays and closed forms, independent of the crate.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use leafcloud::{Attributes, Foliage, Material, Progress};
use leafcloud_simplify::{Sight, Simplified, simplify, unrolled};

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

    fn foliage(&self) -> Foliage {
        let materials = vec![Material::default(); self.materials];
        Foliage::new(&self.positions, self.triangles.clone(), self.attributes.clone(), materials).expect("a mesh")
    }

    /// Simplifies without leaves and without a limit of triangles.
    fn simplified(&self, pixel: f64, change: f64) -> Simplified {
        self.behind(None, pixel, change, usize::MAX)
    }

    fn behind(&self, leaves: Option<&Self>, pixel: f64, change: f64, most: usize) -> Simplified {
        let leaves = leaves.map(Self::foliage);
        let sight = Sight { leaves: leaves.as_ref(), pixel, up: DVec3::Z };
        simplify(&self.foliage(), sight, change, most, Progress::silent()).expect("valid arguments")
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

/// Returns the area that parallel rays along `direction` see of a surface within `radius` of the origin, by a grid of rays against all
/// triangles.
fn seen_area(surface: &[[DVec3; 3]], direction: DVec3, radius: f64) -> f64 {
    const SIDE: usize = 160;
    let (u, v) = direction.normalize().any_orthonormal_pair();
    let flat: Vec<[DVec2; 3]> = surface.iter().map(|t| t.map(|p| DVec2::new(u.dot(p), v.dot(p)))).collect();
    let cell = 2.0 * radius / SIDE as f64;
    let place = |i: usize| (i as f64 + 0.5) * cell - radius;
    let hit = |p: DVec2| flat.iter().any(|t| inside(*t, p));
    let hits = (0..SIDE * SIDE).filter(|i| hit(DVec2::new(place(i % SIDE), place(i / SIDE)))).count();
    hits as f64 * cell * cell
}

fn inside([a, b, c]: [DVec2; 3], p: DVec2) -> bool {
    let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(p - from));
    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)
}

/// Directions that are not among the crate's views.
const DIRECTIONS: [DVec3; 3] = [DVec3::new(1.0, 0.3, 0.1), DVec3::new(-0.4, 1.0, 0.2), DVec3::new(0.5, -0.7, 0.6)];

#[test]
fn a_finely_tessellated_square_becomes_two_triangles() {
    let square = Mesh::grid(20, 20, |u, v| DVec3::new(u, v, 0.0));
    let simplified = square.simplified(0.01, 0.0);
    assert_eq!(simplified.corners.len(), 2);
    assert_eq!(simplified.change, 0.0);
    let area: f64 = square.surface_of(&simplified).iter().map(|[a, b, c]| (b - a).cross(c - a).z / 2.0).sum();
    assert!((area - 1.0).abs() < 1e-12, "{area}: all of it, and wound as before");
}

/// Coarser pixels and a larger change give fewer triangles, and pictures from other directions hardly change.
#[test]
fn a_tube_keeps_its_outline() {
    let tube = Mesh::tube(1.0, 10.0, 64, 40);
    let whole: Vec<f64> = DIRECTIONS.iter().map(|d| seen_area(&tube.surface(), *d, 11.0)).collect();
    let counts = [(0.02, 0.002), (0.1, 0.01), (0.5, 0.05)].map(|(pixel, change)| {
        let simplified = tube.simplified(pixel, change);
        assert!(simplified.change <= change);
        for (direction, whole) in DIRECTIONS.iter().zip(&whole) {
            let left = seen_area(&tube.surface_of(&simplified), *direction, 11.0);
            assert!((left / whole - 1.0).abs() < 2.0 * change + 0.01, "{left} of {whole} at {change}");
        }
        simplified.corners.len()
    });
    assert!(counts.is_sorted_by(|a, b| a > b), "{counts:?}");
    assert!(counts[0] < 5120 / 2, "{counts:?}");
}

/// Each twig of a shrub is thinner than half a pixel, but together they are the picture.
#[test]
fn thin_branches_that_are_the_picture_stay() {
    let twig = |i: u32| {
        let turn = DMat3::from_rotation_z(2.4 * f64::from(i)) * DMat3::from_rotation_x(0.1 + 0.03 * f64::from(i));
        Mesh::tube(0.02, 10.0, 6, 10).moved(move |p| turn * (p + DVec3::Z))
    };
    let shrub = (1..40).fold(twig(0), |shrub, i| shrub.with(&twig(i)));
    let simplified = shrub.simplified(0.1, 0.02);
    assert!(simplified.corners.len() < shrub.triangles.len() / 4, "{}", simplified.corners.len());
    let left: std::collections::HashSet<u32> = simplified.corners.iter().map(|t| t[0] / (3 * 120)).collect();
    assert!(left.len() >= 38, "{} of 40 twigs are left", left.len());
}

/// A closed box around `centre`.
fn box_around(centre: DVec3, half: f64) -> Mesh {
    let side = |turn: DMat3| {
        Mesh::grid(1, 1, |u, v| DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 1.0)).moved(move |p| turn * p * half + centre)
    };
    let turns = (1..4).map(|i| DMat3::from_rotation_x(f64::from(i) * std::f64::consts::FRAC_PI_2));
    let ends = [-1.0, 1.0].map(|i| DMat3::from_rotation_y(i * std::f64::consts::FRAC_PI_2));
    turns.chain(ends).fold(side(DMat3::IDENTITY), |all, turn| all.with(&side(turn)))
}

#[test]
fn branches_hidden_by_leaves_go_first() {
    let branch = |x: f64| Mesh::tube(0.2, 4.0, 12, 12).moved(|p| p + DVec3::X * x);
    let trunk = branch(0.0).with(&branch(10.0));
    let leaves = box_around(DVec3::new(10.0, 0.0, 2.0), 2.5);
    let of_hidden = |s: &Simplified| s.corners.iter().flatten().filter(|&&c| c >= 3 * 288).count();
    let hidden = trunk.behind(Some(&leaves), 0.05, 0.0, usize::MAX);
    assert_eq!(of_hidden(&hidden), 0, "nobody sees it");
    assert_eq!(hidden.change, 0.0);
    assert!(!hidden.corners.is_empty());
    assert!(of_hidden(&trunk.behind(None, 0.05, 0.0, usize::MAX)) > 0);
}

/// The limit comes before the change: thick branches are left, thin ones go.
#[test]
fn the_limit_of_triangles_holds() {
    let thin = |i: u32| Mesh::tube(0.01, 3.0, 6, 4).moved(|p| p + DVec3::X * f64::from(i + 2));
    let tree = (0..8).fold(Mesh::tube(1.0, 10.0, 24, 20), |tree, i| tree.with(&thin(i)));
    for most in [0, 1, 7, 40, 200, 700] {
        let simplified = tree.behind(None, 0.1, 0.0, most);
        assert!(simplified.corners.len() <= most, "{} of {most}", simplified.corners.len());
        let thick = simplified.corners.iter().filter(|t| t[0] < 3 * 960).count();
        assert!(most < 40 || 2 * thick >= simplified.corners.len(), "{thick} of {}", simplified.corners.len());
    }
    let free = tree.behind(None, 0.1, 0.0, usize::MAX);
    assert!(tree.behind(None, 0.1, 0.0, 40).change > free.change);
}

#[test]
fn size_and_place_change_nothing() {
    let tube = Mesh::tube(1.0, 10.0, 24, 20);
    let simplified = tube.simplified(0.05, 0.01);
    for scale in [0.125, 1024.0] {
        assert_eq!(tube.clone().moved(|p| p * scale).simplified(0.05 * scale, 0.01), simplified);
    }
    // Integers and a shift by a power of two: no coordinate is rounded.
    let block = Mesh::grid(8, 8, |u, v| DVec3::new(8.0 * u, 8.0 * v, (8.0 * u * v).floor()));
    let far = DVec3::new(f64::from(1 << 20), -f64::from(1 << 20), 0.0);
    assert_eq!(block.simplified(0.2, 0.01), block.clone().moved(|p| p + far).simplified(0.2, 0.01));
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
    let simplified = square.simplified(0.01, 0.0);
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
    let simplified = tube.simplified(0.02, 0.02);
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

/// Each square of the bark has a texture of its own, so every vertex is on a seam. A limit must not remove all of it.
#[test]
fn seams_everywhere_do_not_prevent_few_triangles() {
    let mut tube = Mesh::tube(1.0, 10.0, 24, 20);
    for (t, uvs) in tube.attributes.uvs.iter_mut().enumerate() {
        *uvs = uvs.map(|uv| uv + Vec2::X * (t / 2) as f32);
    }
    let simplified = tube.behind(None, 0.1, 0.0, 60);
    assert!(simplified.corners.len() <= 60);
    assert!(simplified.change < 0.1, "{}", simplified.change);
}

/// Flat shading splits the normals at every vertex; that must not prevent collapses.
#[test]
fn flat_shading_is_simplified() {
    let mut square = Mesh::grid(12, 12, |u, v| DVec3::new(u, v, 1e-4 * (40.0 * u).sin()));
    square.attributes.normals =
        square.surface().into_iter().map(|[a, b, c]| [(b - a).cross(c - a).normalize().as_vec3(); 3]).collect();
    assert!(square.simplified(0.01, 0.001).corners.len() <= 8);
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
    for change in [0.0, 0.05, 0.5, 1.0] {
        let simplified = broken.simplified(0.02, change);
        assert!(simplified.corners.len() <= broken.triangles.len());
        assert!(simplified.corners.iter().flatten().all(|&c| c < count));
        assert!(simplified.change <= change);
    }
    let points = Mesh { positions: vec![DVec3::ONE; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let mut all = tube.with(&points);
    all.attributes = Attributes::default();
    assert!(all.simplified(0.1, 0.01).corners.iter().flatten().all(|&c| c < 3 * 128), "a point shows nothing");
}

#[test]
fn one_triangle_stays() {
    let one = Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
        materials: 1,
        ..Mesh::default()
    };
    assert_eq!(one.simplified(0.1, 0.0), Simplified { corners: vec![[0, 1, 2]], change: 0.0 });
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
        pool.install(|| forest.simplified(0.1, 0.01))
    };
    assert_eq!(on(1), on(7));
}

#[test]
fn arguments_out_of_range_are_refused() {
    let trunk = Mesh::tube(1.0, 4.0, 8, 8).foliage();
    let refused = |pixel: f64, change: f64| {
        let sight = Sight { leaves: None, pixel, up: DVec3::Z };
        simplify(&trunk, sight, change, usize::MAX, Progress::silent()).unwrap_err().to_string()
    };
    for pixel in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(pixel, 0.1).contains("a length above 0"));
    }
    for change in [-0.1, 1.1, f64::NAN] {
        assert!(refused(0.1, change).contains("between 0 and 1"));
    }
}

#[test]
fn zero_normals_are_accepted() {
    let mut square = Mesh::grid(4, 4, |u, v| DVec3::new(u, v, 0.0));
    square.attributes.normals = vec![[Vec3::ZERO; 3]; square.triangles.len()];
    assert_eq!(square.simplified(0.01, 0.0).corners.len(), 2);
}

// Texture coordinates

/// A tube whose v starts anew at each ring: each ring of squares has the whole texture.
fn ringed_tube(sides: u32, rings: u32) -> Mesh {
    let mut tube = Mesh::tube(1.0, f64::from(rings), sides, rings);
    for (t, uvs) in (0..).zip(&mut tube.attributes.uvs) {
        let ring = t / (2 * sides);
        *uvs = uvs.map(|uv| Vec2::new(uv.x, (uv.y * rings as f32).round() - ring as f32));
    }
    tube
}

fn unrolled_all(mesh: &Mesh) -> Vec<[Vec2; 3]> {
    unrolled(&mesh.foliage(), &vec![true; mesh.triangles.len()])
}

#[test]
fn coordinates_that_start_anew_at_each_ring_run_on() {
    let tube = ringed_tube(6, 9);
    for (t, uvs) in unrolled_all(&tube).iter().enumerate() {
        for (k, uv) in uvs.iter().enumerate() {
            let before = tube.attributes.uvs[t][k];
            assert_eq!((uv.x, uv.y - before.y), (before.x, (t / 12) as f32), "triangle {t}: a repeat for each ring");
            assert_eq!(f64::from(uv.y), tube.corner(3 * t as u32 + k as u32).z);
        }
    }
}

#[test]
fn coordinates_that_turn_back_at_each_ring_run_on() {
    let mut tube = ringed_tube(6, 9);
    let rings = tube.attributes.uvs.clone();
    for (t, uvs) in tube.attributes.uvs.iter_mut().enumerate().filter(|(t, _)| t / 12 % 2 == 1) {
        *uvs = rings[t].map(|uv| Vec2::new(uv.x, 1.0 - uv.y));
    }
    let expected = (0..).zip(rings).map(|(t, uvs)| uvs.map(|uv| uv + Vec2::Y * (t / 12) as f32));
    assert!(unrolled_all(&tube).into_iter().eq(expected));
}

/// The texture of every square lies elsewhere, by whole numbers. No texel moves.
#[test]
fn unrolled_coordinates_show_the_same_texels() {
    let tube = Mesh::tube(1.0, 10.0, 12, 8);
    let mut torn = tube.clone();
    for (t, uvs) in torn.attributes.uvs.iter_mut().enumerate() {
        let shift = Vec2::new((t / 2 * 7 % 5) as f32, -((t / 2 * 3 % 4) as f32));
        *uvs = uvs.map(|uv| uv + shift);
    }
    let unrolled = unrolled_all(&torn);
    for (uvs, before) in unrolled.as_flattened().iter().zip(tube.attributes.uvs.as_flattened()) {
        let shift = *uvs - *before;
        assert!((shift - shift.round()).abs().max_element() < 1e-5, "{uvs} from {before}");
    }
    let across = |t: usize, axis: usize| unrolled[t].map(|uv| uv[axis]);
    let span =
        |values: [f32; 3]| values.into_iter().fold(f32::MIN, f32::max) - values.into_iter().fold(f32::MAX, f32::min);
    assert!((0..torn.triangles.len()).all(|t| span(across(t, 0)) < 0.1 && span(across(t, 1)) < 0.2));
    let jumps = edges(&torn, &unrolled).filter(|jump| *jump > 1e-4).count();
    assert_eq!(jumps, 8, "one seam along the tube");
}

/// Returns how far the coordinates of two triangles are apart at the ends of their common edge, for each such edge.
fn edges(mesh: &Mesh, uvs: &[[Vec2; 3]]) -> impl Iterator<Item = f32> {
    let place = |t: usize, k: usize| mesh.corner(3 * t as u32 + k as u32);
    let sides: Vec<_> = (0..uvs.len()).flat_map(|t| [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (t, a, b))).collect();
    let mut jumps = Vec::new();
    for (i, &(t, a, b)) in sides.iter().enumerate() {
        for &(s, c, d) in &sides[i + 1..] {
            if (place(t, a), place(t, b)) == (place(s, d), place(s, c)) {
                jumps.push((uvs[t][a] - uvs[s][d]).abs().max_element());
            }
        }
    }
    jumps.into_iter()
}

#[test]
fn coordinates_of_textures_that_do_not_repeat_stay() {
    let tube = ringed_tube(6, 4);
    let clamped = |t: usize| t >= 24;
    let repeats: Vec<bool> = (0..tube.triangles.len()).map(|t| !clamped(t)).collect();
    let unrolled = unrolled(&tube.foliage(), &repeats);
    assert_eq!(unrolled[24..], tube.attributes.uvs[24..]);
    assert_ne!(unrolled[..24], tube.attributes.uvs[..24]);
}

#[test]
fn coordinates_that_turn_back_within_a_repeat_stay() {
    let mut square = Mesh::grid(8, 1, |u, v| DVec3::new(u, v, 0.0));
    for uv in square.attributes.uvs.as_flattened_mut() {
        uv.x = 0.5 - (uv.x - 0.5).abs();
    }
    assert_eq!(unrolled_all(&square), square.attributes.uvs);
}

/// Bark keeps its texels on a stem that loses its rings: v spans as many repeats as the tube has rings, and the same length each.
#[test]
fn a_simplified_tube_keeps_its_repeats() {
    let mut tube = ringed_tube(12, 16);
    tube.attributes.uvs = unrolled_all(&tube);
    let simplified = tube.behind(None, 0.1, 0.0, 40);
    assert!((12..=40).contains(&simplified.corners.len()), "{}", simplified.corners.len());
    let mut highest = 0.0;
    for &corner in simplified.corners.as_flattened() {
        let v = tube.attributes.uvs[corner as usize / 3][corner as usize % 3].y;
        assert_eq!(f64::from(v), tube.corner(corner).z);
        highest = v.max(highest);
    }
    assert_eq!(highest, 16.0);
}
