// The laws of Leafcloud's levels: transition, pruning, wind, contrast, fades and self-shadowing, for any engine.
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

// a = clamp((d − start) / (end − start), 0, 1): 0 at rest, 1 on the billboards. 0 ≤ start. A step at `start` if `end`
// is not greater.
float lc_transition(float distance, float start, float end) {
    return clamp((distance - start) / max(end - start, LC_TINY), 0.0, 1.0);
}

// Turns per world unit of a tree's place for lc_stagger. Y-up as in glTF: (x, z, −y) of Blender's.
const vec3 LC_STAGGER_TURNS = vec3(0.7549, 0.4387, -0.5698);

// 1 + s·w(t): the factor on the distances of the tree at `place` in the world, so that neighbors do not switch together.
// `amount` s in [0, 1); w is a triangle wave of t = place · LC_STAGGER_TURNS, in [−1, 1] and 0 at the origin. A random
// number would have jumps, where processors and shaders disagree.
float lc_stagger(vec3 place, float amount) {
    return 1.0 + amount * (4.0 * abs(fract(dot(place, LC_STAGGER_TURNS) - 0.25) - 0.5) - 1.0);
}

// λ = min((d₀/d)^(log_h ½), 1): the fraction of leaves to draw. `start` d₀ > 0; `half_at` h in (0, ½]: λ(d₀/h) = ½.
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

// C(rank): the fraction of the leaves' area with a lower rank, linear between the entries of the table. 0 ≤ `rank` ≤ 1.
float lc_share_below(float rank, float shares[LC_SHARES]) {
    int i = clamp(int(sqrt(rank) * float(LC_SHARES - 1)), 0, LC_SHARES - 2);
    float below = float(i * i) / float((LC_SHARES - 1) * (LC_SHARES - 1));
    float above = float((i + 1) * (i + 1)) / float((LC_SHARES - 1) * (LC_SHARES - 1));
    return mix(shares[i], shares[i + 1], clamp((rank - below) / (above - below), 0.0, 1.0));
}

// s = √(ΣA / Σ(A·r²)), the factor of length that keeps the covered area, from the table `shares`:
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

// γ = exp(c₁ L + c₂ L²) with L = ln λ, for the measured `numbers` (c₁, c₂): 1 if no leaf is pruned, or all are.
float lc_trend(float keep, vec2 numbers) {
    float logarithm = log(max(keep, LC_TINY));
    return keep > 0.0 && keep < 1.0 ? exp(logarithm * (numbers.x + numbers.y * logarithm)) : 1.0;
}

// s·γ·r, the growth of a leaf: 0 for a pruned leaf, 1 for a protected leaf and at λ = 1. `scale` is
// s·γ = lc_area_scale(λ, shares) · lc_trend(λ, growth); s alone for leaves without measured growth.
float lc_growth(float rank, float keep, float scale) {
    return rank < 0.0 ? 1.0 : scale * lc_ramp(rank, keep);
}

// p' = pivot(a) + (p(a) − pivot(a))·s·γ·r: the leaf moved to its billboard by `transition` a, and scaled about its
// pivot by `growth` s·γ·r. At a = 0 and s·γ·r = 1 the position itself, bit for bit. At s·γ·r = 0 the corners of a
// triangle coincide, so it is not drawn.
vec3 lc_place(vec3 position, vec3 target, vec3 pivot, vec3 pivot_target, float transition, float growth) {
    vec3 point = mix(position, target, transition);
    vec3 centre = mix(pivot, pivot_target, transition);
    return growth == 1.0 ? point : centre + (point - centre) * growth;
}

// The wind and the shape of a tree, in the coordinates of its positions. `direction` and `up` have length 1.
// lc_wind_force and lc_wind_turns compute `force` σ and `turns` τ; the file has the rest.
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

// The angle of `turns` in [−π, π], where sines are exact enough on any hardware.
float lc_angle(float turns) {
    return LC_TURN * (turns - round(turns));
}

// σ = S / (|S| + 4): the force of a wind of `strength` S, in (−1, 1); 0: no motion.
float lc_wind_force(float strength) {
    return strength / (abs(strength) + 4.0);
}

// τ: the number of sways of the tree at `place` in the world after `seconds`, with a `period` > 0 in seconds.
float lc_wind_turns(float seconds, float period, vec3 place) {
    return seconds / period + dot(LC_PLACE_TURNS, place);
}

// W_c(x): the offset by which the wind moves `point` x with the branch at `pivot` c. Affine in the point, so that
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

// The `point` of a leaf rotated about its `pivot`, both after `transition` a. `phase` in [0, 1) is the leaf's own.
// `freedom` in [0, 1] is the amount of flutter; at 0, as for billboards and trunk, the point itself.
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

// p': a point, after lc_place and lc_flutter, moved by the wind. `pivot` is the pivot of its leaf or billboard at
// rest, `billboard_pivot` that of its target billboard. At a = 1 the point coincides with the next level's at any
// time. At force 0 the point itself, bit for bit.
vec3 lc_blown(vec3 point, vec3 pivot, vec3 billboard_pivot, float transition, LcWind wind) {
    if (wind.force == 0.0) {
        return point;
    }
    vec3 own = lc_sway(point, pivot, wind);
    return point + (transition > 0.0 ? mix(own, lc_sway(point, billboard_pivot, wind), transition) : own);
}

// κ = min(1, exp(k₁ L + k₂ L²)), L = ln λ: the factor on colors' distance from their mean, so that fewer leaves do not
// increase contrast. `numbers` (k₁, k₂) are measured; with (0, 0) colors stay.
float lc_contrast(float keep, vec2 numbers) {
    return min(lc_trend(keep, numbers), 1.0);
}

// c̄ + (c − c̄) κ, for linear colors. At κ = 1 the color itself.
vec3 lc_toward_mean(vec3 color, vec3 mean, float contrast) {
    return contrast == 1.0 ? color : mean + (color - mean) * contrast;
}

// Minimum half width of a shadow's edge, as a cosine: a few of the bake's depth images lie within it.
const float LC_EDGE = 0.1;

// lc_sun_share for `open` ≤ ½; `along` is |b|·cos, `toward` |b|.
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

// V(l): the fraction of the light from the direction `light` (of length 1, toward it) that reaches a place. Textures
// store two moments of V: `open` m, its mean over all directions, and `toward` b, three times the mean of V·l. The
// result is the ramp clamp(c + k·cos), with cos of the angle to b, that has both moments: m + b·l if that is in [0, 1]
// everywhere. (Clamping m + b·l is too bright deep in the crown, and never dark behind a roof.) |b| is at most
// 3m(1 − m), a cone's.
float lc_sun_share(float open, vec3 toward, vec3 light) {
    bool most = open > 0.5; // Then treat the closed part as the gap.
    float along = dot(toward, light);
    float gap = lc_gap_share(most ? 1.0 - open : open, length(toward), most ? -along : along);
    return most ? 1.0 - gap : gap;
}

// True if a level with the visible fraction `share` draws this pixel: a fade without blending. `pixel`:
// gl_FragCoord.xy. When two levels cross-fade, one draws the pixels where this is true, the other the rest. The
// pattern is interleaved gradient noise (Jimenez 2014), which is even among any few neighbors.
bool lc_shown(float share, vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))) < share;
}
