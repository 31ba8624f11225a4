// The laws of Leafcloud's levels: transition, pruning, wind, contrast, fades and self-shadowing, for any engine.
//
// Pure functions: no uniforms, no attributes, no built-in variables, no extensions. GLSL ES 3.00 with highp, and GLSL
// 3.30 and later, Blender's among them. The same laws move leaves in Blender (addon/build/lod_nodes.py, wind_nodes.py) and
// stand in rust/core/src/prune.rs; a leaf that one of them draws is drawn by all. Where each number is found in a GLB file says
// docs/guide.md.
//
// Distances are from the camera to the centre of the leaves, all in one unit, of the tree's own scale (world distance / scale).
// Shares lie in [0, 1]. A negative rank is that of a protected leaf: it is always drawn, does not grow, and its area is
// not in the sums.

// Entries of the table of areas, at the ranks (i / 64)². They tell few leaves apart, where the scale is large.
const int LC_SHARES = 65;
// ρ at most: the share of the leaves drawn that is growing in or out.
const float LC_RAMP = 0.05;
// What stands for 0 in a divisor.
const float LC_TINY = 1e-30;

// a = clamp((d − start) / (end − start), 0, 1): 0 at rest, 1 on the billboards. 0 ≤ start; a step at `start` when `end`
// is not greater.
float lc_transition(float distance, float start, float end) {
    return clamp((distance - start) / max(end - start, LC_TINY), 0.0, 1.0);
}

// λ = min((d₀/d)^(log_h ½), 1): the share of leaves that is drawn. `start` d₀ > 0; `half_at` h in (0, ½]: λ(d₀/h) = ½.
// Exactly 1 up to d₀. Below λ = 0.005 a cheaper level should stand in.
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

// C(rank): the share of the leaves' area that has a lower rank, linear between the entries of the table. `rank` in
// [0, 1].
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
// for a ramp of length has a third of its area left. Areas are taken to be even over the ramp, so s² is off by at most the
// share of the area that is not: with n equal leaves about 1/(λn) of it. 1 where nothing is pruned, or nothing left.
float lc_area_scale(float keep, float shares[LC_SHARES]) {
    float whole = lc_share_below(keep * (1.0 - min(LC_RAMP, 1.0 - keep)), shares);
    float drawn = mix(whole, lc_share_below(keep, shares), 1.0 / 3.0);
    return keep < 1.0 && drawn > 0.0 ? inversesqrt(drawn) : 1.0;
}

// γ = exp(c₁ L + c₂ L²) with L = ln λ, for the measured `numbers` (c₁, c₂): 1 where nothing is pruned, or nothing left.
float lc_trend(float keep, vec2 numbers) {
    float logarithm = log(max(keep, LC_TINY));
    return keep > 0.0 && keep < 1.0 ? exp(logarithm * (numbers.x + numbers.y * logarithm)) : 1.0;
}

// s·γ·r, by how much a leaf grows: 0 where it is not drawn, 1 for a protected leaf and where nothing is pruned. `scale`
// is s·γ = lc_area_scale(λ, shares) · lc_trend(λ, growth); s alone for leaves whose growth was not measured.
float lc_growth(float rank, float keep, float scale) {
    return rank < 0.0 ? 1.0 : scale * lc_ramp(rank, keep);
}

// p' = pivot(a) + (p(a) − pivot(a))·s·γ·r: the leaf moved to its billboard by `transition` a, and grown about its pivot
// by `growth` s·γ·r. At a = 0 and s·γ·r = 1 the position itself, bit for bit; at s·γ·r = 0 the corners of a triangle are
// one point, so that nothing is drawn.
vec3 lc_place(vec3 position, vec3 target, vec3 pivot, vec3 pivot_target, float transition, float growth) {
    vec3 point = mix(position, target, transition);
    vec3 centre = mix(pivot, pivot_target, transition);
    return growth == 1.0 ? point : centre + (point - centre) * growth;
}

// What blows on a tree, and how it stands, in the coordinates of its positions. `direction` and `up` are of length 1;
// `force` σ and `turns` τ come from lc_wind_force and lc_wind_turns, the rest stands in the file.
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
// Turns of a tree per unit of the world, Y-up as in glTF, so that trees are not in step: (x, z, −y) of Blender's.
const vec3 LC_PLACE_TURNS = vec3(0.1732, 0.2236, -0.1414);

// The angle of so many `turns`, in [−π, π], where sines are exact enough on any hardware.
float lc_angle(float turns) {
    return LC_TURN * (turns - round(turns));
}

// σ = S / (|S| + 4): how hard a wind of `strength` S blows, in (−1, 1); 0: nothing moves.
float lc_wind_force(float strength) {
    return strength / (abs(strength) + 4.0);
}

// τ: how often the tree at `place` in the world has swayed after `seconds`, with a `period` > 0 in seconds.
float lc_wind_turns(float seconds, float period, vec3 place) {
    return seconds / period + dot(LC_PLACE_TURNS, place);
}

// W_c(x): by how much the wind moves `point` x with the branch at `pivot` c. Affine in the point, so that billboards stay
// flat and what lies on them stays there. Wood, and all that has no pivot, passes its point for both.
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

// The `point` of a leaf turned about its `pivot`, each where `transition` a has brought it. `phase` in [0, 1) is the
// leaf's own, `freedom` in [0, 1] how freely it flutters; at 0, as of billboards and wood, the point itself.
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

// p': where the wind has a point that was placed by lc_place and fluttered by lc_flutter. `pivot` is that of its leaf or
// billboard at rest, `billboard_pivot` that of the billboard that it goes to. At a = 1 it lies where the next level shows
// it: that is closed at any time. At force 0 the point itself, bit for bit.
vec3 lc_blown(vec3 point, vec3 pivot, vec3 billboard_pivot, float transition, LcWind wind) {
    if (wind.force == 0.0) {
        return point;
    }
    vec3 own = lc_sway(point, pivot, wind);
    return point + (transition > 0.0 ? mix(own, lc_sway(point, billboard_pivot, wind), transition) : own);
}

// κ = min(1, exp(k₁ L + k₂ L²)): how far colours keep their distance from the mean, so that fewer leaves do not mean more
// contrast. `numbers` (k₁, k₂) are measured; with (0, 0) colours stay.
float lc_contrast(float keep, vec2 numbers) {
    return min(lc_trend(keep, numbers), 1.0);
}

// c̄ + (c − c̄) κ, of linear colours. At κ = 1 the colour itself.
vec3 lc_toward_mean(vec3 color, vec3 mean, float contrast) {
    return contrast == 1.0 ? color : mean + (color - mean) * contrast;
}

// The share of a billboard that is shown where it is seen at a grazing angle: 0 edge-on, 1 from |cos| = `width` on,
// smooth between. `cos_view`: of the angle between the billboard's normal and the direction to the viewer.
// 0 ≤ width < 1; 0: no fade.
float lc_grazing(float cos_view, float width) {
    return width > 0.0 ? smoothstep(0.0, width, abs(cos_view)) : 1.0;
}

// The least half width of a shadow's edge, as a cosine: some of the directions that a crown is looked at from.
const float LC_EDGE = 0.1;

// As lc_sun_share, where no more than half of the sky is open; `along` is b·cos.
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

// V(l): the share of the light from the direction `light` (of length 1, toward it) that reaches a place, of which textures
// keep two moments: `open` m, the mean of V over all directions, and `toward` b, three times the mean of V·l. Of all ramps
// clamp(c + k·cos), cos the angle's to b, the one that has both: m + b·l where that is a share everywhere. (That, cut to
// [0, 1], is too bright in what is deep, and never dark behind a roof.) b's length is at most 3m(1 − m), that of a cone.
float lc_sun_share(float open, vec3 toward, vec3 light) {
    bool most = open > 0.5; // Then what is closed is a gap.
    float along = dot(toward, light);
    float gap = lc_gap_share(most ? 1.0 - open : open, length(toward), most ? -along : along);
    return most ? 1.0 - gap : gap;
}

// Whether a pixel of what is shown to the `share` is one of those that are: a fade without blending. `pixel`:
// gl_FragCoord.xy. Of two levels in one place, one shows the pixels where this holds, the other the rest. The pattern is
// interleaved gradient noise (Jimenez 2014), which is even among any few neighbours.
bool lc_shown(float share, vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))) < share;
}
