// The law for alpha that is the share of a texel that leaves cover: thin leaves neither dissolve nor flicker.
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

// A cutoff that an alpha exceeds in that share of all places. `place`: on the leaves at rest. `texel`: place on the texture, in texels.
// `level`: the mip level that is read. A texel of it keeps its cutoff at each place on the leaves, as large as a pixel, so that leaves
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

// The share that was bent to this alpha: a share of `pivot` became the material's cutoff, as readers that cut alpha out want.
float lc_share(float alpha, float pivot, float cutoff) {
    return alpha < cutoff ? pivot * alpha / cutoff : pivot + (alpha - cutoff) * (1.0 - pivot) / max(1.0 - cutoff, 1e-3);
}

// The pivot at the mip level that is read, by the pivots of all mip levels.
float lc_pivot(float pivots[LC_MIPS], float level) {
    int finer = int(min(level, float(LC_MIPS - 1)));
    return mix(pivots[finer], pivots[min(finer + 1, LC_MIPS - 1)], fract(level));
}

// The share of a pixel's samples to draw, as alpha for alpha to coverage; without multisampling 0 or 1. Magnified texels have sharp
// outlines at the material's `cutoff`. From mip level 1 on `random`, the cutoff of the place, decides about whole pixels, also with
// multisampling: alpha to coverage draws the same samples of leaves behind one another, so that crowns would cover up to half less.
float lc_drawn(float alpha, float cutoff, float pivot, float random, float level, bool multisampled) {
    float minified = min(level, 1.0);
    float sharp = clamp((alpha - cutoff) / max(fwidth(alpha), 1e-4) + 0.5, 0.0, 1.0);
    float whole = mix(sharp, lc_share(alpha, pivot, cutoff), minified) < mix(0.5, random, minified) ? 0.0 : 1.0;
    return multisampled ? mix(sharp, whole, minified) : whole;
}
