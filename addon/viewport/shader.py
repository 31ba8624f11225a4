"""The shader of the preview: the laws of shaders/leafcloud.glsl, and what calls them."""

from __future__ import annotations

from pathlib import Path

import gpu

from .look import Look

ATTRIBUTES = {
    "position": "VEC3",
    "target": "VEC3",
    "pivot": "VEC3",
    "pivot_target": "VEC3",
    "rank": "FLOAT",
    "normal": "VEC3",
    "uv": "VEC2",
}
"""Of each corner; a level that is not pruned has the rank −1."""

UNIFORMS = {
    "to_clip": "MAT4",
    "transition_at": "VEC4",  # d, start, end, s·γ
    "keep_at": "VEC4",  # d, d₀, h, |cos| below which faces fade
    "fade": "VEC2",  # share of the next level, 1 for the level that comes
    "contrast": "VEC2",
    "mean": "VEC3",
    "eye": "VEC3",  # in the object's coordinates
    "tint": "VEC4",
    "cutoff": "FLOAT",
}

VARYINGS = {"seen_uv": "VEC2", "seen_normal": "VEC3", "seen_point": "VEC3"}

VERTEX = """
void main() {
    float a = lc_transition(transition_at.x, transition_at.y, transition_at.z);
    float kept = lc_keep(keep_at.x, keep_at.y, keep_at.z);
    float growth = lc_growth(rank, kept, kept < 1.0 ? transition_at.w : 1.0);
    vec3 place = lc_place(position, target, pivot, pivot_target, a, growth);
    seen_uv = uv;
    seen_normal = normal;
    seen_point = place;
    gl_Position = to_clip * vec4(place, 1.0);
}
"""

FRAGMENT = """
void main() {
    if (lc_shown(fade.x, gl_FragCoord.xy) != (fade.y > 0.5)) discard;
    vec3 view = normalize(eye - seen_point);
    vec3 face = normalize(cross(dFdx(seen_point), dFdy(seen_point)));
    if (!lc_shown(lc_grazing(dot(face, view), keep_at.w), gl_FragCoord.xy)) discard;
    vec4 texel = texture(page, seen_uv) * tint;
    // What is blended has a cutoff of 0, and is dithered; what is opaque has one below.
    if (cutoff > 0.0 ? texel.a <= cutoff : cutoff == 0.0 && !lc_shown(texel.a, gl_FragCoord.xy)) discard;
    float kept = lc_keep(keep_at.x, keep_at.y, keep_at.z);
    vec3 color = lc_toward_mean(texel.rgb, mean, lc_contrast(kept, contrast));
    // From the eye, and half of it from everywhere. A 3D view encodes what is drawn into it.
    float light = 0.5 + 0.5 * abs(dot(normalize(seen_normal), view));
    shown_color = vec4(color * light, 1.0);
}
"""


def uniforms_of(look: Look) -> dict[str, float | tuple[float, ...]]:
    """The uniforms that follow from how far away a level is seen."""
    return {
        "transition_at": (*look.transition, look.scale),
        "keep_at": (*look.keep, look.grazing),
        "fade": (look.next_share, float(look.coming)),
        "contrast": look.contrast,
        "mean": look.mean_color,
    }


def laws() -> str:
    """The text of leafcloud.glsl, which lies beside the add-on in the repository, and in its folder when installed."""
    here = Path(__file__).resolve().parents[1]
    file = next(root / "shaders" / "leafcloud.glsl" for root in (here, here.parent) if (root / "shaders").is_dir())
    return file.read_text(encoding="utf-8")


def compiled() -> gpu.types.GPUShader:
    """The shader; needs a window, or what `gpu.init` makes in its place."""
    info = gpu.types.GPUShaderCreateInfo()
    for slot, (name, kind) in enumerate(ATTRIBUTES.items()):
        info.vertex_in(slot, kind, name)
    for name, kind in UNIFORMS.items():
        info.push_constant(kind, name)
    info.sampler(0, "FLOAT_2D", "page")
    varyings = gpu.types.GPUStageInterfaceInfo("leafcloud_seen")
    for name, kind in VARYINGS.items():
        varyings.smooth(kind, name)
    info.vertex_out(varyings)
    info.fragment_out(0, "VEC4", "shown_color")
    info.vertex_source(laws() + VERTEX)
    info.fragment_source(laws() + FRAGMENT)
    return gpu.shader.create_from_info(info)
