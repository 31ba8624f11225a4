//! Chains and pictures of barely visible foliage: the result shows something, or a named error says why not.

use glam::{DVec3, Vec4};
use leafcloud::atlas::{Atlas, AtlasSettings};
use leafcloud::foliage::{AlphaMode, Attributes, Material, Opacity};
use leafcloud::geometry::Plane;
use leafcloud::lod::{Chain, ChainSettings, build_chain};
use leafcloud::metrics::{View, render};
use leafcloud::outlines::outlines;
use leafcloud::textures::{Channels, Drawn, Samples, bake};
use leafcloud::transition::Projection;
use leafcloud::{Cloud, Foliage, Progress};

use crate::common::random::Random;
use crate::common::soups::{quick, random_corners, soup};
use crate::common::stability::{case, worse};

const GROUP: &str = "Levels";

fn settings() -> ChainSettings {
    ChainSettings {
        texture_size: 128.into(),
        samples: Samples::new(2).unwrap(),
        fit: quick(),
        ..ChainSettings::default()
    }
}

fn chain(foliage: &Foliage, trunk: Option<&Foliage>, settings: &ChainSettings) -> leafcloud::Result<Chain> {
    build_chain(foliage, trunk, settings, Progress::silent())
}

/// Needles of length 1 and this width in a ball.
fn needles(width: f64) -> Foliage {
    let mut random = Random(71);
    let needle = |_| {
        let (at, along) = (random.in_ball() * 0.5, random.in_ball().normalize() * 0.5);
        [at - along, at + along, at + along + along.any_orthonormal_vector() * width]
    };
    soup(&(0..40).map(needle).collect::<Vec<_>>())
}

/// Squares in one horizontal plane.
fn lying() -> Foliage {
    let mut random = Random(72);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for leaf in 0..60u32 {
        let at = DVec3::new(random.signed(), random.signed(), 0.0);
        positions.extend([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]].map(|[x, y]| at + DVec3::new(x, y, 0.0)));
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * leaf + i);
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
}

/// Returns the least number of drawn texels on any page.
fn fewest_drawn(chain: &Chain) -> usize {
    let drawn = |level: &leafcloud::lod::Level| {
        let cutoff = (f64::from(level.alpha_cutoff) * 255.0).ceil() as u8;
        level.page.base_color.pixels().iter().filter(|p| p[3] >= cutoff.max(1)).count()
    };
    chain.levels.iter().map(drawn).min().unwrap()
}

#[test]
fn leaves_thinner_than_a_texel() {
    let thin = chain(&needles(0.003), None, &settings()).unwrap();
    case(GROUP, "needles a tenth of a texel thin", "definition: every page shows something")
        .equals(fewest_drawn(&thin) > 0, true);
    let found = chain(&needles(1e-9), None, &settings()).map(|_| ());
    case(GROUP, "needles of aspect 10⁹, thinner than any sample", "a named error")
        .refuses(found, "no leaf shows on an atlas page");
}

#[test]
fn foliage_that_lies_flat() {
    let flat = chain(&lying(), None, &settings()).unwrap();
    let cross = flat.levels.last().unwrap();
    assert_eq!((cross.method, cross.atlas.billboards.len()), ("cross", 1));
    assert!(fewest_drawn(&flat) > 0);
    // Seen along the plane, neither leaves nor cross impostor cover anything; from everywhere else both cover the same.
    let off = (cross.coverage - 1.0).abs();
    case(
        GROUP,
        "coverage lost by the cross impostor of leaves in one plane",
        "closed form: 0, except for texels at edges",
    )
    .holds(off, 0.05);
}

/// Horizontal squares at random heights, slightly tilted, and a stem.
fn tiers(tilt: f64) -> (Foliage, Foliage) {
    let mut random = Random(78);
    let square = |_| {
        let (at, size) = (random.in_ball(), 0.15);
        let corner = |x: f64, y: f64| at + DVec3::new(x * size, y * size, (x + y) * size * tilt);
        [[corner(-1., -1.), corner(1., -1.), corner(1., 1.)], [corner(-1., -1.), corner(1., 1.), corner(-1., 1.)]]
    };
    let leaves = soup(&(0..60).flat_map(square).collect::<Vec<_>>());
    let stem = soup(&[[DVec3::new(0.0, 0.0, -1.2), DVec3::new(0.02, 0.0, -1.2), DVec3::Z]]);
    (leaves, stem)
}

#[test]
#[ignore = "long: make test-night runs it"]
fn foliage_of_horizontal_tiers() {
    let mut lost: f64 = 0.0;
    for tilt in [0.0, 1e-4, 0.03, 0.1] {
        let (leaves, stem) = tiers(tilt);
        for trunk in [None, Some(&stem)] {
            let cross = chain(&leaves, trunk, &ChainSettings { levels: 0, ..settings() }).unwrap().levels.remove(0);
            lost = worse(lost, 1.0 - cross.coverage);
        }
    }
    // Seen obliquely, the tiers overlap more on one plane than in space: about half of the coverage is kept.
    case(
        GROUP,
        "coverage lost by the cross impostor of horizontal tiers, with and without a stem",
        "bound: three fifths",
    )
    .holds(lost, 0.6);
}

/// A wall of single-sided squares that face along an axis.
fn wall(normal: DVec3) -> Foliage {
    let (x, y) = normal.any_orthonormal_pair();
    let mut random = Random(79);
    let square = |_| {
        let at = x * random.signed() + y * random.signed();
        let corner = |a: f64, b: f64| at + (x * a + y * b) * 0.2;
        [[corner(-1., -1.), corner(1., -1.), corner(1., 1.)], [corner(-1., -1.), corner(1., 1.), corner(-1., 1.)]]
    };
    let squares: Vec<_> = (0..40).flat_map(square).collect();
    soup(&squares).with_materials(|m| Material { double_sided: false, ..m.clone() })
}

#[test]
#[ignore = "long: make test-night runs it"]
fn one_sided_leaves_that_face_away() {
    let mut blank = 0;
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for normal in [axis, -axis] {
            for back_sides in [None, Some(false), Some(true)] {
                let found = chain(&wall(normal), None, &ChainSettings { back_sides, ..settings() }).unwrap();
                blank += usize::from(found.levels[0].coverage < 0.9) + usize::from(fewest_drawn(&found) == 0);
                // One plane shows the wall; planes that would show it edge-on are left out.
                let planes = found.levels.last().unwrap().atlas.billboards.iter().filter(|b| !b.back).count();
                blank += usize::from(planes != 1);
            }
        }
    }
    case(GROUP, "single-sided walls that face along each axis: levels that do not show them", "definition: none")
        .holds(blank as f64, 0.0);
}

#[test]
fn barely_visible_leaves() {
    let faint = |alpha: f32, mode: AlphaMode| {
        let color = Vec4::new(1.0, 1.0, 1.0, alpha);
        soup(&random_corners(30, 80)).with_materials(|m| Material { base_color: color, alpha_mode: mode, ..m.clone() })
    };
    for (name, alpha, mode) in [
        ("leaves of alpha 10⁻³⁰, blended, without an image", 1e-30, AlphaMode::Blend),
        ("leaves of alpha 0, blended, without an image", 0.0, AlphaMode::Blend),
        ("leaves of alpha 0.4 at a cutoff of 0.5, without an image", 0.4, AlphaMode::Mask(0.5)),
    ] {
        case(GROUP, name, "a named error")
            .refuses(chain(&faint(alpha, mode), None, &settings()).map(|_| ()), "no leaf is visible");
    }
    let tiny: Vec<_> =
        random_corners(40, 81).into_iter().map(|[a, b, c]| [a, a + (b - a) * 0.01, a + (c - a) * 0.01]).collect();
    let found = chain(&soup(&tiny), None, &settings());
    let answered = found.as_ref().map_or_else(|e| e.to_string().contains("no leaf shows"), |c| fewest_drawn(c) > 0);
    case(GROUP, "leaves of R/2000", "definition: levels that show something, or a named error").equals(answered, true);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn foliage_that_is_faint_all_over() {
    // Needles that cover no pixel of the metrics renderer by half, and leaves that are blended everywhere.
    let mut lost: f64 = 0.0;
    for alpha in [0.03, 0.06, 0.1, 0.15, 0.25, 0.4] {
        let leaves = soup(
            &random_corners(200, 82)
                .into_iter()
                .map(|[a, b, c]| [a, a + (b - a) * 6.0, a + (c - a) * 6.0])
                .collect::<Vec<_>>(),
        );
        let color = Vec4::new(1.0, 1.0, 1.0, alpha);
        let faint =
            leaves.with_materials(|m| Material { base_color: color, alpha_mode: AlphaMode::Blend, ..m.clone() });
        let levels = chain(&faint, None, &ChainSettings { texture_size: 512.into(), ..settings() }).unwrap().levels;
        lost = levels.iter().map(|level| 1.0 - level.coverage).fold(lost, worse);
    }
    let thin = chain(&needles(0.006), None, &ChainSettings { texture_size: 1024.into(), ..settings() }).unwrap();
    lost = thin.levels.iter().map(|level| 1.0 - level.coverage).fold(lost, worse);
    // A cutoff draws faint leaves as opaque or not at all: too much is better than nothing.
    case(GROUP, "coverage lost of faint leaves and needles", "bound: four fifths").holds(lost, 0.8);
}

#[test]
fn nothing_asked_for() {
    let none = ChainSettings { levels: 0, cross: false, ..settings() };
    case(GROUP, "no levels and no cross impostor", "a named error")
        .refuses(chain(&lying(), None, &none).map(|_| ()), "`levels` is 0");
    let cross = chain(&lying(), None, &ChainSettings { levels: 0, ..settings() }).unwrap();
    case(GROUP, "no levels, only the cross impostor", "definition: one level").equals(cross.levels.len(), 1);
}

#[test]
fn trunk_out_of_proportion() {
    let leaves = soup(&random_corners(50, 73));
    let trunk = |scale: f64, at: f64| {
        soup(&random_corners(20, 74).into_iter().map(|t| t.map(|p| p * scale + DVec3::X * at)).collect::<Vec<_>>())
    };
    for (name, trunk) in
        [("a trunk 10³⁰ times as large as the leaves", trunk(1e30, 0.0)), ("a trunk 10⁹ R away", trunk(1.0, 1e9))]
    {
        case(GROUP, name, "a named error")
            .refuses(chain(&leaves, Some(&trunk), &settings()).map(|_| ()), "the trunk reaches");
    }
    let fine = ChainSettings { texture_size: 1024.into(), ..settings() };
    let tall = chain(&leaves, Some(&trunk(20.0, 0.0)), &fine).unwrap();
    case(GROUP, "a trunk twenty times as large as the leaves", "definition: every page shows something")
        .equals(fewest_drawn(&tall) > 0, true);
}

#[test]
fn a_collapsed_triangle_far_away() {
    let mut corners = random_corners(50, 75);
    let found = |corners: &[[DVec3; 3]]| {
        let triangles = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Foliage::new(&corners.concat(), triangles, Attributes::default(), vec![])
    };
    corners.push([DVec3::splat(1e9); 3]);
    case(GROUP, "a triangle of zero area at 10⁹ R", "a named error")
        .refuses(found(&corners).map(|_| ()), "triangle 50 has zero area and lies");
    // The ball has a radius of about one: just beyond the limit, and just within.
    corners[50] = [DVec3::X * 1100.0; 3];
    assert!(found(&corners).is_err());
    corners[50] = [DVec3::X * 900.0; 3];
    assert!(found(&corners).is_ok());
    corners[50] = [DVec3::splat(3.0); 3];
    case(GROUP, "a triangle of zero area at 5 R", "definition: accepted like any other")
        .equals(found(&corners).is_ok(), true);
}

#[test]
fn views_that_see_nothing() {
    let leaves = soup(&random_corners(50, 76));
    let view = View {
        direction: DVec3::Y,
        up: DVec3::Z,
        centre: DVec3::ZERO,
        radius: 1.0,
        size: 32,
        samples: Samples::new(1).unwrap(),
    };
    let refused = |name, parts: &[&Foliage], view: View, naming| {
        case(GROUP, name, "a named error").refuses(render(parts, &view).map(|_| ()), naming);
    };
    refused("a picture of nothing", &[], view, "no parts");
    refused("a center of NaN", &[&leaves], View { centre: DVec3::NAN, ..view }, "the view's centre");
    refused("an up at infinity", &[&leaves], View { up: DVec3::INFINITY, ..view }, "the view's up");
    refused("a direction of no length", &[&leaves], View { direction: DVec3::ZERO, ..view }, "the view's direction");
    refused("a radius of 10⁻³⁰⁰", &[&leaves], View { radius: 1e-300, ..view }, "radii from the image's center");
    refused("a radius of NaN", &[&leaves], View { radius: f64::NAN, ..view }, "an image with the radius NaN");
    refused("a picture of no pixels", &[&leaves], View { size: 0, ..view }, "0 pixels");
    let along = render(&[&leaves], &View { up: DVec3::Y, ..view }).unwrap();
    case(GROUP, "a view along up", "definition: still a picture").equals(along.pixels().iter().any(|p| p[3] > 0), true);
}

#[test]
fn a_plane_for_each_of_65_537_triangles() {
    let foliage = soup(&random_corners(65_537, 77));
    let plane = |t: usize| {
        let [a, b, c] = foliage.corners(t);
        Plane::through_points([a, b, c]).expect("a triangle with an area")
    };
    let count = foliage.triangle_count();
    let cloud = Cloud::new(&foliage, (0..count).map(plane).collect(), (0..count as u32).collect(), 1.0);
    let projection = Projection::new(&foliage, &cloud, 1.0);
    let found = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], &Opacity::of(&foliage));
    let atlas =
        Atlas::pack(&cloud.planes, &found, AtlasSettings { size: 4096.into(), gutter: 2, back_sides: false }).unwrap();
    let page = bake(&atlas, Samples::new(4).unwrap(), (&Channels::default(), None), |p| {
        let t = p as usize;
        vec![Drawn {
            reach: f64::INFINITY,
            foliage: &foliage,
            triangle: t,
            targets: projection.targets[t],
            corners: foliage.corners(t),
        }]
    })
    .base_color;
    let blank = |b: &&leafcloud::atlas::Billboard| {
        let row = |y: usize| &page.pixels()[y * page.width() + b.region.x..][..b.region.width];
        (b.region.y..b.region.y + b.region.height).all(|y| row(y).iter().all(|p| p[3] == 0))
    };
    // A sample hits a triangle that is wider than a quarter of a texel: all but slivers.
    let wide = |b: &&leafcloud::atlas::Billboard| {
        let corners = foliage.corners(b.plane as usize);
        let longest = (0..3).map(|i| corners[i].distance(corners[(i + 1) % 3])).fold(0.0, f64::max);
        2.0 * foliage.area_vector(b.plane as usize).length() / longest > atlas.texel()
    };
    let asked = atlas.billboards.iter().filter(wide).count();
    assert!(asked > 1000, "{asked}");
    case(
        GROUP,
        "65 537 planes projected, packed and baked: billboards wider than a texel that show nothing",
        "definition: none",
    )
    .holds(atlas.billboards.iter().filter(wide).filter(blank).count() as f64, 0.0);
    let heights = cloud.deviations.iter().copied().fold(0.0, worse);
    case(GROUP, "deviation where each triangle has its own plane, of 65 537", "closed form: 0")
        .holds(heights, 8.0 * f64::EPSILON);
    let uvs = atlas.billboards.iter().flat_map(|b| atlas.uvs(b)).all(|uv| uv.iter().all(|x| (0.0..=1.0).contains(x)));
    case(GROUP, "texture coordinates of 65 537 billboards", "definition: on the page").equals(uvs, true);
}
