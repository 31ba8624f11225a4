// The cutoff for mip levels with the share of drawn texels as alpha: thin leaves neither dissolve nor flicker.
//
// For fragment shaders, because of derivatives; otherwise as leafcloud.glsl. A mean of alpha below the cutoff would draw no texel, one
// above it all. Here each place on the leaves has a random cutoff of its own (Wyman and McGuire, "Hashed Alpha Testing", 2017), so that
// the drawn share of all places is that of the texels. Known limit: single leaves get grains, as large as a pixel.

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
