// The law of octahedral impostors, for any engine. Pure functions as in leafcloud.glsl; GLSL ES 3.00 with highp, or GLSL
// 3.30 and later.
//
// One quad faces the eye. Its pixels blend three of grid × grid views of the tree, each shifted by the stored depth.
// Blender's node groups (addon/nodes/octahedral.py) and rust/core/src/lod/octahedral implement the same law.
//
// Points and directions are in the impostor's axes: `to_layout` takes them there from the tree's coordinates, with the
// middle of the tree at 0, up as z and the stored depth as the unit. A GLB file has the numbers in the extras of the
// last level's node (leafcloud.octahedral) and the two pages in the extras of its material (docs/files.md).

struct LcOctahedral {
    vec2 extent; // half of the width and of the height of a view's picture
    vec3 half_box; // half of the tree's box
    float grid; // views along each side of the page
    float texels; // texels along each side of a view
};

// Three views around a ray: their columns and rows, and weights that sum to 1.
struct LcViews {
    vec3 ray;
    vec2 tiles[3];
    vec3 weights;
};

// How far the views reach below the horizon, and the corrections of the height by the stored depth.
const float LC_BELOW = 0.5;
const int LC_STEPS = 2;
// Light over the stored openness, which stands for the shadows of the leaves on each other.
const float LC_OPEN = 1.5;

// The direction from the tree to the viewer of a view.
vec3 lc_view_direction(vec2 tile, float grid) {
    vec2 p = tile * (2.0 / (grid - 1.0)) - 1.0;
    vec2 flat_part = 0.5 * vec2(p.x + p.y, p.x - p.y);
    float level = abs(flat_part.x) + abs(flat_part.y);
    return normalize(vec3(flat_part, max(1.0 - level, 0.0) - LC_BELOW * level));
}

// The axes to the right and up of a picture seen from `direction`. Straight from above, x is to the right.
void lc_view_axes(vec3 direction, out vec3 right, out vec3 up) {
    vec2 across = vec2(-direction.y, direction.x);
    right = length(across) > 1e-6 ? vec3(normalize(across), 0.0) : vec3(1.0, 0.0, 0.0);
    up = cross(direction, right);
}

// The ray to an `eye` in this direction, of length 1: eyes deeper than 45° below the horizon see the picture from 45°.
vec3 lc_ray(vec3 eye) {
    return normalize(vec3(eye.xy, max(eye.z, -length(eye.xy))));
}

// A point of the ray through `point`, in the picture from `ray`.
vec3 lc_in_picture(vec3 point, vec3 eye, vec3 ray) {
    vec3 right, up, upright;
    lc_view_axes(ray, right, upright);
    lc_view_axes(eye, right, up);
    return right * dot(right, point) + upright * dot(up, point);
}

// A normal from x and y in the axes of the picture from `direction`; it faces the viewer.
vec3 lc_view_normal(vec2 stored, vec3 direction) {
    vec3 right, up;
    lc_view_axes(direction, right, up);
    return right * stored.x + up * stored.y + direction * sqrt(max(1.0 - dot(stored, stored), 0.0));
}

// The views around the direction `eye`, of length 1.
LcViews lc_views(vec3 eye, float grid) {
    float level = abs(eye.x) + abs(eye.y);
    float sum = level + max(eye.z + LC_BELOW * level, 0.0);
    vec2 place = (vec2(eye.x + eye.y, eye.x - eye.y) / sum * 0.5 + 0.5) * (grid - 1.0);
    vec2 cell = clamp(floor(place), 0.0, grid - 2.0);
    vec2 within = clamp(place - cell, 0.0, 1.0);
    float right = within.x > within.y ? 1.0 : 0.0;
    LcViews views;
    views.ray = lc_ray(eye);
    views.tiles[0] = cell;
    views.tiles[1] = cell + vec2(right, 1.0 - right);
    views.tiles[2] = cell + 1.0;
    float least = min(within.x, within.y);
    // Squares of barycentric weights: less of the leaves' texture is lost in the blend.
    vec3 near = vec3(1.0 - max(within.x, within.y), abs(within.x - within.y), least);
    near *= near;
    views.weights = near / (near.x + near.y + near.z);
    return views;
}

// The place on the page where the ray through `point` is at a `height` toward the viewer of the view. Row 0 is at v = 0.
// `border`: half of a texel of the sampled mip level, as a fraction of a view.
vec2 lc_view_place(vec2 tile, vec3 point, vec3 ray, float height, float border, LcOctahedral impostor) {
    vec3 toward = lc_view_direction(tile, impostor.grid);
    vec3 right, up;
    lc_view_axes(toward, right, up);
    vec3 there = point + ray * ((height - dot(toward, point)) / dot(toward, ray));
    vec2 share = vec2(dot(right, there), dot(up, there)) / impostor.extent * vec2(0.5, -0.5) + 0.5;
    return (tile + clamp(share, border, 1.0 - border)) / impostor.grid;
}

// Color with straight alpha, normal and light of the ray through `point` toward the direction `eye`. `light` is the fraction
// of the light that the other leaves let through. `color` and `normal_depth` are the pages, the former decoded to linear
// light. `lod`: mip level, log₂ of texels per pixel; at most
// log₂(texels) − 2, so that views do not mix.
void lc_octahedral(
    sampler2D color, sampler2D normal_depth, vec3 point, vec3 eye, float lod, LcOctahedral impostor,
    out vec4 shown, out vec3 normal, out float light
) {
    LcViews views = lc_views(eye, impostor.grid);
    vec3 place_seen = lc_in_picture(point, eye, views.ray);
    float level = clamp(lod, 0.0, log2(impostor.texels) - 2.0);
    float border = 0.5 * exp2(ceil(level)) / impostor.texels;
    vec4 sum = vec4(0.0);
    normal = vec3(0.0);
    light = 0.0;
    for (int i = 0; i < 3; i++) {
        float height = 0.0;
        for (int step = 0; step < LC_STEPS; step++) {
            vec2 flat_place = lc_view_place(views.tiles[i], place_seen, views.ray, height, border, impostor);
            height = 2.0 * textureLod(normal_depth, flat_place, level).a - 1.0;
        }
        vec2 place = lc_view_place(views.tiles[i], place_seen, views.ray, height, border, impostor);
        vec4 texel = textureLod(color, place, level);
        float share = texel.a * views.weights[i];
        sum += vec4(texel.rgb * share, share);
        vec3 shading = textureLod(normal_depth, place, level).xyz;
        normal += share * lc_view_normal(2.0 * shading.xy - 1.0, lc_view_direction(views.tiles[i], impostor.grid));
        light += share * shading.z;
    }
    light = sum.a > 0.0 ? min(LC_OPEN * light / sum.a, 1.0) : 1.0;
    shown = vec4(sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0), sum.a);
    normal = dot(normal, normal) > 0.0 ? normalize(normal) : eye;
}

// A corner of the quad as seen from the direction `eye`; `corner` is (±1, ±1).
vec3 lc_octahedral_corner(vec2 corner, vec3 eye, LcOctahedral impostor) {
    vec3 right, up;
    lc_view_axes(eye, right, up);
    float height = min(length(up.xy) * impostor.extent.x + abs(up.z) * impostor.half_box.z, impostor.extent.y);
    return right * (corner.x * impostor.extent.x) + up * (corner.y * height);
}
