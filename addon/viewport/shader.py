"""The shader of the preview: the laws of shaders/leafcloud.glsl, and vertex and fragment shaders that call them."""

from __future__ import annotations

from pathlib import Path

import gpu

from .look import Uniforms
from .paint import Paint

ATTRIBUTES = {
    "position": "VEC3",
    "target": "VEC3",
    "pivot": "VEC3",
    "pivot_target": "VEC3",
    "rank": "FLOAT",
    "normal": "VEC3",
    "uv": "VEC2",
    "front_color": "VEC4",
    "back_color": "VEC4",
}
"""The attributes of each corner. A level that is not pruned has the rank −1."""

UNIFORMS = {
    "to_clip": "MAT4",
    "transition_at": "VEC4",  # d, start, end, s·γ
    "keep_at": "VEC3",  # d, d₀, h
    "fade": "VEC2",  # share of pixels of the next level; 1 if this is the next level
    "contrast": "VEC2",
    "mean": "VEC3",
    "eye": "VEC3",  # in the object's coordinates
    "handed": "FLOAT",  # −1 for objects that are mirrored, else 1
    "tint": "VEC4",
    "opacity_weights": "VEC4",
    "cutoff": "FLOAT",
    "double_sided": "FLOAT",
    "headlight": "FLOAT",
}

SAMPLERS = ("page", "opacity")

VARYINGS = {
    "seen_uv": "VEC2",
    "seen_normal": "VEC3",
    "seen_point": "VEC3",
    "seen_front": "VEC4",
    "seen_back": "VEC4",
}

VERTEX = """
void main() {
    float a = lc_transition(transition_at.x, transition_at.y, transition_at.z);
    float kept = lc_keep(keep_at.x, keep_at.y, keep_at.z);
    float growth = lc_growth(rank, kept, kept < 1.0 ? transition_at.w : 1.0);
    vec3 place = lc_place(position, target, pivot, pivot_target, a, growth);
    seen_uv = uv;
    seen_normal = normal;
    seen_point = place;
    seen_front = front_color;
    seen_back = back_color;
    gl_Position = to_clip * vec4(place, 1.0);
}
"""

FRAGMENT = """
void main() {
    // Textures come first: their derivatives are undefined where a neighboring fragment was discarded.
    vec3 texel = texture(page, seen_uv).rgb;
    float coverage = dot(texture(opacity, seen_uv), opacity_weights);
    bool front = gl_FrontFacing == (handed > 0.0);
    vec4 factor = tint * (front ? seen_front : seen_back);
    if (!front && double_sided < 0.5) discard;
    if (lc_shown(fade.x, gl_FragCoord.xy) != (fade.y > 0.5)) discard;
    vec3 view = normalize(eye - seen_point);
    // Blended materials have a cutoff of 0 and are dithered. Opaque materials have a negative cutoff.
    float alpha = coverage * factor.a;
    if (cutoff > 0.0 ? alpha <= cutoff : cutoff == 0.0 && !lc_shown(alpha, gl_FragCoord.xy)) discard;
    float kept = lc_keep(keep_at.x, keep_at.y, keep_at.z);
    vec3 color = lc_toward_mean(texel * factor.rgb, mean, lc_contrast(kept, contrast));
    // Light from the eye, and the rest from everywhere. The 3D view converts the colors for display.
    float light = 1.0 - headlight + headlight * abs(dot(normalize(seen_normal), view));
    shown_color = vec4(color * light, 1.0);
}
"""


def uniforms_of(look: Uniforms) -> dict[str, float | tuple[float, ...]]:
    """Return the uniforms that depend on a level's distance."""
    return {
        "transition_at": (*look.transition, look.scale),
        "keep_at": look.keep,
        "fade": (look.next_share, float(look.coming)),
        "contrast": look.contrast,
        "mean": look.mean_color,
    }


def uniforms_of_paint(paint: Paint) -> dict[str, float | tuple[float, ...]]:
    """Return the uniforms that depend on a material."""
    return {
        "tint": paint.tint,
        "opacity_weights": paint.opacity_weights,
        "cutoff": paint.cutoff,
        "double_sided": float(paint.double_sided),
        "headlight": paint.headlight,
    }


def laws() -> str:
    """Return the text of leafcloud.glsl. It is beside the add-on in the repository, and inside it when installed."""
    here = Path(__file__).resolve().parents[1]
    file = next(root / "shaders" / "leafcloud.glsl" for root in (here, here.parent) if (root / "shaders").is_dir())
    return file.read_text(encoding="utf-8")


def compiled() -> gpu.types.GPUShader:
    """Compile the shader. This needs a window, or the context that `gpu.init` creates without one."""
    info = gpu.types.GPUShaderCreateInfo()
    for slot, (name, kind) in enumerate(ATTRIBUTES.items()):
        info.vertex_in(slot, kind, name)
    for name, kind in UNIFORMS.items():
        info.push_constant(kind, name)
    for slot, name in enumerate(SAMPLERS):
        info.sampler(slot, "FLOAT_2D", name)
    varyings = gpu.types.GPUStageInterfaceInfo("leafcloud_seen")
    for name, kind in VARYINGS.items():
        varyings.smooth(kind, name)
    info.vertex_out(varyings)
    info.fragment_out(0, "VEC4", "shown_color")
    info.vertex_source(laws() + VERTEX)
    info.fragment_source(laws() + FRAGMENT)
    return gpu.shader.create_from_info(info)
