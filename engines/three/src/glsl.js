// Copies of the laws in shaders/, made by tools/copy_laws.py.

export const LAWS = `// The laws of Leafcloud's levels: transition, pruning, wind, contrast, fades and self-shadowing, for any engine.
//
// Pure functions: no uniforms, no attributes, no built-in variables, no extensions. GLSL ES 3.00 with highp, and GLSL
// 3.30 and later, including Blender's. Blender's node groups (addon/nodes/lod.py, wind.py) and
// rust/core/src/prune implement the same laws, so all of them draw the same leaves. docs/files.md lists the place of
// each number in a GLB file.
//
// Distances are from the camera to the center of the leaves, in units of the tree's own scale (world distance / scale).
// Fractions lie in [0, 1]. A protected leaf has a negative rank: it is always drawn, does not grow, and its area is
// not in the sums.

// Entries of the table of areas, at the ranks (i / 64)²: dense for few kept leaves, where the scale is large.
const int LC_SHARES = 65;
// Maximum of ρ: the fraction of the drawn leaves that is growing in or out.
const float LC_RAMP = 0.05;
// Replaces 0 in a divisor.
const float LC_TINY = 1e-30;

// a = clamp((d − start) / (end − start), 0, 1): 0 at rest, 1 on the billboards. 0 ≤ start. A step at \`start\` if \`end\`
// is not greater.
float lc_transition(float distance, float start, float end) {
    return clamp((distance - start) / max(end - start, LC_TINY), 0.0, 1.0);
}

// Turns per world unit of a tree's place for lc_stagger. Y-up as in glTF: (x, z, −y) of Blender's.
const vec3 LC_STAGGER_TURNS = vec3(0.7549, 0.4387, -0.5698);

// 1 + s·w(t): the factor on the distances of the tree at \`place\` in the world, so that neighbors do not switch together.
// \`amount\` s in [0, 1); w is a triangle wave of t = place · LC_STAGGER_TURNS, in [−1, 1] and 0 at the origin. A random
// number would have jumps, where processors and shaders disagree.
float lc_stagger(vec3 place, float amount) {
    return 1.0 + amount * (4.0 * abs(fract(dot(place, LC_STAGGER_TURNS) - 0.25) - 0.5) - 1.0);
}

// λ = min((d₀/d)^(log_h ½), 1): the fraction of leaves to draw. \`start\` d₀ > 0; \`half_at\` h in (0, ½]: λ(d₀/h) = ½.
// Exactly 1 up to d₀. Below λ = 0.005 draw a cheaper level instead.
float lc_keep(float distance, float start, float half_at) {
    float nearness = start / max(distance, start);
    return nearness < 1.0 ? exp2(-log2(nearness) / log2(half_at)) : 1.0;
}

// r = clamp((λ − rank) / (λ·ρ), 0, 1), ρ = min(0.05, 1 − λ): the last leaves drawn grow in and out. 0 for rank ≥ λ, 1
// for a protected leaf.
float lc_ramp(float rank, float keep) {
    if (rank < 0.0) {
        return 1.0;
    }
    float width = min(LC_RAMP, 1.0 - keep) * keep;
    return rank < keep ? clamp((keep - rank) / max(width, LC_TINY), 0.0, 1.0) : 0.0;
}

// C(rank): the fraction of the leaves' area with a lower rank, linear between the entries of the table. 0 ≤ \`rank\` ≤ 1.
float lc_share_below(float rank, float shares[LC_SHARES]) {
    int i = clamp(int(sqrt(rank) * float(LC_SHARES - 1)), 0, LC_SHARES - 2);
    float below = float(i * i) / float((LC_SHARES - 1) * (LC_SHARES - 1));
    float above = float((i + 1) * (i + 1)) / float((LC_SHARES - 1) * (LC_SHARES - 1));
    return mix(shares[i], shares[i + 1], clamp((rank - below) / (above - below), 0.0, 1.0));
}

// s = √(ΣA / Σ(A·r²)), the factor of length that keeps the covered area, from the table \`shares\`:
//
//     s² = 1 / (C(λ(1−ρ)) + (C(λ) − C(λ(1−ρ))) / 3)
//
// because a linear ramp of lengths keeps a third of the area. This assumes that areas are even over the ramp. The error
// of s² is at most the fraction of the area that is not: about 1/(λn) for n equal leaves. 1 if no leaf is pruned, or all
// are.
float lc_area_scale(float keep, float shares[LC_SHARES]) {
    float whole = lc_share_below(keep * (1.0 - min(LC_RAMP, 1.0 - keep)), shares);
    float drawn = mix(whole, lc_share_below(keep, shares), 1.0 / 3.0);
    return keep < 1.0 && drawn > 0.0 ? inversesqrt(drawn) : 1.0;
}

// γ = exp(c₁ L + c₂ L²) with L = ln λ, for the measured \`numbers\` (c₁, c₂): 1 if no leaf is pruned, or all are.
float lc_trend(float keep, vec2 numbers) {
    float logarithm = log(max(keep, LC_TINY));
    return keep > 0.0 && keep < 1.0 ? exp(logarithm * (numbers.x + numbers.y * logarithm)) : 1.0;
}

// s·γ·r, the growth of a leaf: 0 for a pruned leaf, 1 for a protected leaf and at λ = 1. \`scale\` is
// s·γ = lc_area_scale(λ, shares) · lc_trend(λ, growth); s alone for leaves without measured growth.
float lc_growth(float rank, float keep, float scale) {
    return rank < 0.0 ? 1.0 : scale * lc_ramp(rank, keep);
}

// p' = pivot(a) + (p(a) − pivot(a))·s·γ·r: the leaf moved to its billboard by \`transition\` a, and scaled about its
// pivot by \`growth\` s·γ·r. At a = 0 and s·γ·r = 1 the position itself, bit for bit. At s·γ·r = 0 the corners of a
// triangle coincide, so it is not drawn.
vec3 lc_place(vec3 position, vec3 target, vec3 pivot, vec3 pivot_target, float transition, float growth) {
    vec3 point = mix(position, target, transition);
    vec3 centre = mix(pivot, pivot_target, transition);
    return growth == 1.0 ? point : centre + (point - centre) * growth;
}

// The wind and the shape of a tree, in the coordinates of its positions. \`direction\` and \`up\` have length 1.
// lc_wind_force and lc_wind_turns compute \`force\` σ and \`turns\` τ; the file has the rest.
struct LcWind {
    vec3 direction;
    vec3 up;
    vec3 foot;
    float height; // > 0
    float spread; // > 0
    float force;
    float gusts;
    float turns;
    float sway;
    float branches;
    float flutter; // radians
};

const float LC_TURN = 6.283185307179586;
// Turns per world unit of a tree's place, so that trees do not sway in step. Y-up as in glTF: (x, z, −y) of Blender's.
const vec3 LC_PLACE_TURNS = vec3(0.1732, 0.2236, -0.1414);

// The angle of \`turns\` in [−π, π], where sines are exact enough on any hardware.
float lc_angle(float turns) {
    return LC_TURN * (turns - round(turns));
}

// σ = S / (|S| + 4): the force of a wind of \`strength\` S, in (−1, 1); 0: no motion.
float lc_wind_force(float strength) {
    return strength / (abs(strength) + 4.0);
}

// τ: the number of sways of the tree at \`place\` in the world after \`seconds\`, with a \`period\` > 0 in seconds.
float lc_wind_turns(float seconds, float period, vec3 place) {
    return seconds / period + dot(LC_PLACE_TURNS, place);
}

// W_c(x): the offset by which the wind moves \`point\` x with the branch at \`pivot\` c. Affine in the point, so that
// billboards stay flat and leaves stay on them. Points without a pivot, such as the trunk's, pass the point for both.
vec3 lc_sway(vec3 point, vec3 pivot, LcWind wind) {
    vec3 arm = pivot - wind.foot;
    vec3 beyond = point - pivot;
    float rise = dot(wind.up, arm);
    float eta = max(rise, 0.0) / wind.height;
    vec3 outward = (arm - rise * wind.up) / wind.spread;
    vec3 waves = 2.0 * (wind.direction + cross(wind.up, wind.direction));
    float angle = lc_angle(2.3 * wind.turns - dot(waves, arm) / (LC_TURN * wind.spread));
    float square = dot(outward, outward);

    float bend = eta * (eta + 2.0 * dot(wind.up, beyond) / wind.height);
    float reach = square + 2.0 * dot(outward, beyond) / wind.spread;
    float twig = reach * sin(angle) - square * dot(waves, beyond) / wind.spread * cos(angle);
    float gust = 0.6 * sin(lc_angle(wind.turns)) + 0.4 * sin(lc_angle(0.618 * wind.turns));
    float lean = wind.sway * wind.height * (1.0 - wind.gusts + wind.gusts * gust);
    vec3 swing = 0.5 * wind.branches * wind.spread * twig * (wind.direction + wind.up);
    return wind.force * (lean * bend * wind.direction + swing);
}

// The \`point\` of a leaf rotated about its \`pivot\`, both after \`transition\` a. \`phase\` in [0, 1) is the leaf's own.
// \`freedom\` in [0, 1] is the amount of flutter; at 0, as for billboards and trunk, the point itself.
vec3 lc_flutter(vec3 point, vec3 pivot, float phase, float freedom, float transition, LcWind wind) {
    vec3 across = cross(wind.up, wind.direction);
    float along = sin(lc_angle(5.0 * wind.turns + phase));
    float beside = sin(lc_angle(6.9 * wind.turns + 3.0 * phase));
    vec3 axis = (along * wind.direction + beside * across) * 0.7071067811865476;
    float size = length(axis);
    float angle = abs(wind.force) * wind.flutter * freedom * (1.0 - transition) * size;
    if (angle == 0.0) {
        return point;
    }
    vec3 n = axis / size;
    vec3 arm = point - pivot;
    return pivot + arm * cos(angle) + cross(n, arm) * sin(angle) + n * (dot(n, arm) * (1.0 - cos(angle)));
}

// p': a point, after lc_place and lc_flutter, moved by the wind. \`pivot\` is the pivot of its leaf or billboard at
// rest, \`billboard_pivot\` that of its target billboard. At a = 1 the point coincides with the next level's at any
// time. At force 0 the point itself, bit for bit.
vec3 lc_blown(vec3 point, vec3 pivot, vec3 billboard_pivot, float transition, LcWind wind) {
    if (wind.force == 0.0) {
        return point;
    }
    vec3 own = lc_sway(point, pivot, wind);
    return point + (transition > 0.0 ? mix(own, lc_sway(point, billboard_pivot, wind), transition) : own);
}

// κ = min(1, exp(k₁ L + k₂ L²)), L = ln λ: the factor on colors' distance from their mean, so that fewer leaves do not
// increase contrast. \`numbers\` (k₁, k₂) are measured; with (0, 0) colors stay.
float lc_contrast(float keep, vec2 numbers) {
    return min(lc_trend(keep, numbers), 1.0);
}

// c̄ + (c − c̄) κ, for linear colors. At κ = 1 the color itself.
vec3 lc_toward_mean(vec3 color, vec3 mean, float contrast) {
    return contrast == 1.0 ? color : mean + (color - mean) * contrast;
}

// Minimum half width of a shadow's edge, as a cosine: a few of the bake's depth images lie within it.
const float LC_EDGE = 0.1;

// lc_sun_share for \`open\` ≤ ½; \`along\` is |b|·cos, \`toward\` |b|.
float lc_gap_share(float open, float toward, float along) {
    if (toward <= open) {
        return open + along;
    }
    float cosine = along / toward;
    float reach = 3.0 - toward / max(open, LC_TINY);
    if (reach >= 4.0 * open) {
        return 4.0 * open / (reach * reach) * max(cosine - 1.0 + reach, 0.0);
    }
    float edge = max(2.0 * sqrt(max(3.0 * open * (1.0 - open) - toward, 0.0)), LC_EDGE);
    return clamp(0.5 + 0.5 * (cosine - 1.0 + 2.0 * open) / edge, 0.0, 1.0);
}

// V(l): the fraction of the light from the direction \`light\` (of length 1, toward it) that reaches a place. Textures
// store two moments of V: \`open\` m, its mean over all directions, and \`toward\` b, three times the mean of V·l. The
// result is the ramp clamp(c + k·cos), with cos of the angle to b, that has both moments: m + b·l if that is in [0, 1]
// everywhere. (Clamping m + b·l is too bright deep in the crown, and never dark behind a roof.) |b| is at most
// 3m(1 − m), a cone's.
float lc_sun_share(float open, vec3 toward, vec3 light) {
    bool most = open > 0.5; // Then treat the closed part as the gap.
    float along = dot(toward, light);
    float gap = lc_gap_share(most ? 1.0 - open : open, length(toward), most ? -along : along);
    return most ? 1.0 - gap : gap;
}

// True if a level with the visible fraction \`share\` draws this pixel: a fade without blending. \`pixel\`:
// gl_FragCoord.xy. When two levels cross-fade, one draws the pixels where this is true, the other the rest. The
// pattern is interleaved gradient noise (Jimenez 2014), which is even among any few neighbors.
bool lc_shown(float share, vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))) < share;
}
`;

export const OCTAHEDRAL = `// The law of octahedral impostors, for any engine. Pure functions as in leafcloud.glsl; GLSL ES 3.00 with highp, or GLSL
// 3.30 and later.
//
// One quad faces the eye. Its pixels blend three of grid × grid views of the tree, each shifted by the stored depth.
// Blender's node groups (addon/nodes/octahedral.py) and rust/core/src/lod/octahedral implement the same law.
//
// Points and directions are in the impostor's axes: \`to_layout\` takes them there from the tree's coordinates, with the
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

// The axes to the right and up of a picture seen from \`direction\`. Straight from above, x is to the right.
void lc_view_axes(vec3 direction, out vec3 right, out vec3 up) {
    vec2 across = vec2(-direction.y, direction.x);
    right = length(across) > 1e-6 ? vec3(normalize(across), 0.0) : vec3(1.0, 0.0, 0.0);
    up = cross(direction, right);
}

// The ray to an \`eye\` in this direction, of length 1: eyes deeper than 45° below the horizon see the picture from 45°.
vec3 lc_ray(vec3 eye) {
    return normalize(vec3(eye.xy, max(eye.z, -length(eye.xy))));
}

// A point of the ray through \`point\`, in the picture from \`ray\`.
vec3 lc_in_picture(vec3 point, vec3 eye, vec3 ray) {
    vec3 right, up, upright;
    lc_view_axes(ray, right, upright);
    lc_view_axes(eye, right, up);
    return right * dot(right, point) + upright * dot(up, point);
}

// A normal from x and y in the axes of the picture from \`direction\`; it faces the viewer.
vec3 lc_view_normal(vec2 stored, vec3 direction) {
    vec3 right, up;
    lc_view_axes(direction, right, up);
    return right * stored.x + up * stored.y + direction * sqrt(max(1.0 - dot(stored, stored), 0.0));
}

// The views around the direction \`eye\`, of length 1.
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

// The place on the page where the ray through \`point\` is at a \`height\` toward the viewer of the view. Row 0 is at v = 0.
// \`border\`: half of a texel of the sampled mip level, as a fraction of a view.
vec2 lc_view_place(vec2 tile, vec3 point, vec3 ray, float height, float border, LcOctahedral impostor) {
    vec3 toward = lc_view_direction(tile, impostor.grid);
    vec3 right, up;
    lc_view_axes(toward, right, up);
    vec3 there = point + ray * ((height - dot(toward, point)) / dot(toward, ray));
    vec2 share = vec2(dot(right, there), dot(up, there)) / impostor.extent * vec2(0.5, -0.5) + 0.5;
    return (tile + clamp(share, border, 1.0 - border)) / impostor.grid;
}

// Color with straight alpha, normal and light of the ray through \`point\` toward the direction \`eye\`. \`light\` is the fraction
// of the light that the other leaves let through. \`color\` and \`normal_depth\` are the pages, the former decoded to linear
// light. \`lod\`: mip level, log₂ of texels per pixel; at most
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

// A corner of the quad as seen from the direction \`eye\`; \`corner\` is (±1, ±1).
vec3 lc_octahedral_corner(vec2 corner, vec3 eye, LcOctahedral impostor) {
    vec3 right, up;
    lc_view_axes(eye, right, up);
    float height = min(length(up.xy) * impostor.extent.x + abs(up.z) * impostor.half_box.z, impostor.extent.y);
    return right * (corner.x * impostor.extent.x) + up * (corner.y * height);
}
`;

export const SHARES = `// The law for alpha that is the share of a texel that leaves cover: thin leaves neither dissolve nor flicker.
//
// For fragment shaders, because of derivatives; otherwise as leafcloud.glsl. A mean of alpha below the cutoff would draw no texel, one
// above it all. Here each place on the leaves has a random cutoff of its own (Wyman and McGuire, "Hashed Alpha Testing", 2017), so that
// the drawn share of all places is that of the texels. Known limit: single leaves get grains, as large as a pixel.

const int LC_MIPS = 16;

// A number that seems random, from another one.
uint lc_mixed(uint number) {
    number = (number ^ (number >> 16u)) * 2246822519u;
    number = (number ^ (number >> 13u)) * 3266489917u;
    return number ^ (number >> 16u);
}

// A cutoff that an alpha exceeds in that share of all places. \`place\`: on the leaves at rest. \`texel\`: place on the texture, in texels.
// \`level\`: the mip level that is read. A texel of it keeps its cutoff at each place on the leaves, as large as a pixel, so that leaves
// do not flicker. Leaves in one place have cutoffs of their own if they face other ways; else they would cover less together.
float lc_share_cutoff(vec3 place, vec2 texel, float level) {
    vec3 across = cross(dFdx(place), dFdy(place));
    float area = max(length(across), 1e-30);
    float size = exp2(floor(0.5 * log2(area) + 0.5));
    // Leaves may lie in planes of round numbers.
    ivec3 cell = ivec3(floor((place + 0.31371) / size));
    ivec3 facing = ivec3(floor(8.0 * across / area + 0.5));
    ivec2 part = ivec2(floor(texel * exp2(-floor(level + 0.5))));
    uint random = lc_mixed(lc_mixed(lc_mixed(uint(cell.x)) + uint(cell.y)) + uint(cell.z));
    random = lc_mixed(random + uint(facing.x + 17 * (facing.y + 17 * facing.z)));
    random = lc_mixed(lc_mixed(random + uint(part.x)) + uint(part.y));
    return (float(random >> 16u) + 0.5) / 65536.0;
}

// The mip level that is read at a place on the texture, in texels.
float lc_mip_level(vec2 texel) {
    vec2 across = dFdx(texel), down = dFdy(texel);
    return max(0.5 * log2(max(dot(across, across), dot(down, down))), 0.0);
}

// The share that was bent to this alpha: a share of \`pivot\` became the material's cutoff, as readers that cut alpha out want.
float lc_share(float alpha, float pivot, float cutoff) {
    return alpha < cutoff ? pivot * alpha / cutoff : pivot + (alpha - cutoff) * (1.0 - pivot) / max(1.0 - cutoff, 1e-3);
}

// The pivot at the mip level that is read, by the pivots of all mip levels.
float lc_pivot(float pivots[LC_MIPS], float level) {
    int finer = int(min(level, float(LC_MIPS - 1)));
    return mix(pivots[finer], pivots[min(finer + 1, LC_MIPS - 1)], fract(level));
}

// The share of a pixel's samples to draw, as alpha for alpha to coverage; without multisampling 0 or 1. Magnified texels have sharp
// outlines at the material's \`cutoff\`. From mip level 1 on \`random\`, the cutoff of the place, decides about whole pixels, also with
// multisampling: alpha to coverage draws the same samples of leaves behind one another, so that crowns would cover up to half less.
float lc_drawn(float alpha, float cutoff, float pivot, float random, float level, bool multisampled) {
    float minified = min(level, 1.0);
    float sharp = clamp((alpha - cutoff) / max(fwidth(alpha), 1e-4) + 0.5, 0.0, 1.0);
    float whole = mix(sharp, lc_share(alpha, pivot, cutoff), minified) < mix(0.5, random, minified) ? 0.0 : 1.0;
    return multisampled ? mix(sharp, whole, minified) : whole;
}
`;
