"""The form of a glTF document, as a table: the type and range of each field that Blender's importer reads.

`check` walks a document once. Fields that are not in the table may have any value. References are checked to be in
range; their meaning (loops of nodes, data outside of a buffer) is the subject of `gltf_checks`.

Source: the glTF 2.0 specification, section 5. Limits on the length of lists are our own: Blender's importer takes up to
some milliseconds for each entry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from .input_files import shown

Document: TypeAlias = dict[str, Any]


class Broken(Exception):
    """A part of a document that is not as glTF demands: the part, its value, its limit."""


_MOST_BYTES = 2**32
"""No buffer exceeds the largest GLB file."""

_FLOAT_MAX = 3.4028235e38
"""The largest number in single precision."""


@dataclass(frozen=True)
class Whole:
    """A whole number."""

    least: int = 0
    most: int = _MOST_BYTES

    def fault(self, value: Any, document: Document) -> str | None:
        right = type(value) is int and self.least <= value <= self.most
        return None if right else f"a whole number from {self.least} to {self.most}"


@dataclass(frozen=True)
class Index:
    """The number of an entry in a list of the document. Dots divide the names on the way to the list."""

    of: str

    def fault(self, value: Any, document: Document) -> str | None:
        count = len(self._entries(document))
        if type(value) is int and 0 <= value < count:
            return None
        return f"a number from 0 to {count - 1} in {self.of!r}" if count else f"in {self.of!r}, which is empty"

    def _entries(self, document: Document) -> list[Any]:
        part: Any = document
        for name in self.of.split("."):
            part = part.get(name) if isinstance(part, dict) else None
        return part if isinstance(part, list) else []


@dataclass(frozen=True)
class Number:
    """A number that single precision holds."""

    def fault(self, value: Any, document: Document) -> str | None:
        right = type(value) in (int, float) and math.isfinite(value) and abs(value) <= _FLOAT_MAX
        return None if right else "a finite number in single precision"


@dataclass(frozen=True)
class Truth:
    """True or false."""

    def fault(self, value: Any, document: Document) -> str | None:
        return None if isinstance(value, bool) else "true or false"


@dataclass(frozen=True)
class Text:
    """A text without lone surrogates, which Blender cannot store."""

    def fault(self, value: Any, document: Document) -> str | None:
        if not isinstance(value, str):
            return "a text"
        try:
            value.encode()
        except UnicodeEncodeError:
            return "a text in Unicode, without half surrogate pairs"
        return None


@dataclass(frozen=True)
class OneOf:
    """One of some values."""

    values: tuple[Any, ...]

    def fault(self, value: Any, document: Document) -> str | None:
        right = any(type(value) is type(each) and value == each for each in self.values)
        return None if right else f"one of {', '.join(map(str, self.values))}"


@dataclass(frozen=True)
class Several:
    """A list of a kind."""

    kind: Kind
    least: int = 0
    most: int = 1_000_000

    def fault(self, value: Any, document: Document) -> str | None:
        if not isinstance(value, list):
            return "a list"
        if self.least <= len(value) <= self.most:
            return None
        length = f"{self.least}" if self.least == self.most else f"{self.least} to {self.most}"
        return f"a list of {length} entries"


@dataclass(frozen=True)
class Named:
    """An object with any names, of one kind."""

    kind: Kind

    def fault(self, value: Any, document: Document) -> str | None:
        if not isinstance(value, dict):
            return "an object"
        return next(filter(None, (Text().fault(name, document) for name in value)), None)


@dataclass(frozen=True)
class Record:
    """An object with fields; some are needed."""

    fields: Mapping[str, Kind]
    needed: tuple[str, ...] = ()
    exclusive: tuple[str, ...] = ()
    """Fields that exclude each other in an object."""

    def fault(self, value: Any, document: Document) -> str | None:
        if not isinstance(value, dict):
            return "an object"
        missing = next((name for name in self.needed if name not in value), None)
        if missing is not None:
            return f"an object with {missing!r}"
        both = [name for name in self.exclusive if name in value]
        return f"an object with only one of {' and '.join(map(repr, both))}" if len(both) > 1 else None


Kind: TypeAlias = Whole | Index | Number | Truth | Text | OneOf | Several | Named | Record

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""The types of components, as numpy names them."""

SHAPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""The number of components of each type of an accessor."""


def _numbers(count: int) -> Several:
    return Several(Number(), count, count)


def _extended(fields: Mapping[str, Kind], extensions: Mapping[str, Kind], needed: tuple[str, ...] = ()) -> Record:
    return Record({**fields, "name": Text(), "extensions": Record(extensions)}, needed)


_TEXTURE = Record(
    {
        "index": Index("textures"),
        "texCoord": Whole(0, 255),
        "scale": Number(),
        "strength": Number(),
        "extensions": Record(
            {
                "KHR_texture_transform": Record(
                    {"offset": _numbers(2), "scale": _numbers(2), "rotation": Number(), "texCoord": Whole(0, 255)}
                )
            }
        ),
    },
    needed=("index",),
)


def _shading(textures: str = "", numbers: str = "", colors: str = "", extensions: Kind = Record({})) -> Record:
    """Return an object of a material with the named textures, numbers and colors (RGB)."""
    return Record(
        {
            **dict.fromkeys(textures.split(), _TEXTURE),
            **dict.fromkeys(numbers.split(), Number()),
            **dict.fromkeys(colors.split(), _numbers(3)),
            "diffuseFactor": _numbers(4),
            "baseColorFactor": _numbers(4),
            "extensions": extensions,
        }
    )


_MATERIAL = _extended(
    {
        "pbrMetallicRoughness": _shading("baseColorTexture metallicRoughnessTexture", "metallicFactor roughnessFactor"),
        "normalTexture": _TEXTURE,
        "occlusionTexture": _TEXTURE,
        "emissiveTexture": _TEXTURE,
        "emissiveFactor": _numbers(3),
        "alphaMode": OneOf(("OPAQUE", "MASK", "BLEND")),
        "alphaCutoff": Number(),
        "doubleSided": Truth(),
    },
    {
        "KHR_materials_pbrSpecularGlossiness": _shading(
            "diffuseTexture specularGlossinessTexture", "glossinessFactor", "specularFactor"
        ),
        "KHR_materials_clearcoat": _shading(
            "clearcoatTexture clearcoatRoughnessTexture clearcoatNormalTexture",
            "clearcoatFactor clearcoatRoughnessFactor",
        ),
        "KHR_materials_emissive_strength": _shading(numbers="emissiveStrength"),
        "KHR_materials_transmission": _shading("transmissionTexture", "transmissionFactor"),
        "KHR_materials_specular": _shading(
            "specularTexture specularColorTexture", "specularFactor", "specularColorFactor"
        ),
        "KHR_materials_sheen": _shading(
            "sheenColorTexture sheenRoughnessTexture", "sheenRoughnessFactor", "sheenColorFactor"
        ),
        "KHR_materials_ior": _shading(numbers="ior"),
        "KHR_materials_volume": _shading("thicknessTexture", "thicknessFactor attenuationDistance", "attenuationColor"),
        "KHR_materials_anisotropy": _shading("anisotropyTexture", "anisotropyStrength anisotropyRotation"),
        "KHR_materials_unlit": Record({}),
        "KHR_materials_diffuse_transmission": _shading(
            "diffuseTransmissionTexture diffuseTransmissionColorTexture",
            "diffuseTransmissionFactor",
            "diffuseTransmissionColorFactor",
        ),
    },
)

_MESHOPT = Record(
    {
        "buffer": Index("buffers"),
        "byteOffset": Whole(),
        "byteLength": Whole(1),
        "byteStride": Whole(1, 256),
        "count": Whole(1),
        "mode": Text(),
        "filter": Text(),
    },
    ("buffer", "byteLength", "byteStride", "count", "mode"),
)

_ATTRIBUTES = Named(Index("accessors"))

_PRIMITIVE = Record(
    {
        "attributes": _ATTRIBUTES,
        "indices": Index("accessors"),
        "material": Index("materials"),
        "mode": Whole(0, 6),
        "targets": Several(_ATTRIBUTES, most=1000),
        "extensions": Record(
            {
                "KHR_draco_mesh_compression": Record(
                    {"bufferView": Index("bufferViews"), "attributes": Named(Whole())}, ("bufferView", "attributes")
                ),
                "KHR_materials_variants": Record(
                    {
                        "mappings": Several(
                            Record({"material": Index("materials"), "variants": Several(Whole(0, 10_000))}),
                            most=10_000,
                        )
                    }
                ),
            }
        ),
    },
    needed=("attributes",),
)

_NODE = Record(
    {
        "name": Text(),
        "children": Several(Index("nodes")),
        "mesh": Index("meshes"),
        "camera": Index("cameras"),
        "skin": Index("skins"),
        "matrix": _numbers(16),
        "translation": _numbers(3),
        "rotation": _numbers(4),
        "scale": _numbers(3),
        "weights": Several(Number(), most=1000),
        "extensions": Record(
            {
                "EXT_mesh_gpu_instancing": Record({"attributes": _ATTRIBUTES}, ("attributes",)),
                "KHR_lights_punctual": Record({"light": Index("extensions.KHR_lights_punctual.lights")}, ("light",)),
                "MSFT_lod": Record({"ids": Several(Index("nodes"))}),
            }
        ),
    },
)

_SPARSE = Record(
    {
        "count": Whole(1),
        "indices": Record(
            {
                "bufferView": Index("bufferViews"),
                "byteOffset": Whole(),
                "componentType": OneOf((5121, 5123, 5125)),
            },
            ("bufferView", "componentType"),
        ),
        "values": Record({"bufferView": Index("bufferViews"), "byteOffset": Whole()}, ("bufferView",)),
    },
    ("count", "indices", "values"),
)

_ACCESSOR = Record(
    {
        "bufferView": Index("bufferViews"),
        "byteOffset": Whole(),
        "componentType": OneOf(tuple(COMPONENTS)),
        "normalized": Truth(),
        "count": Whole(1, 2**31 - 1),
        "type": OneOf(tuple(SHAPES)),
        "min": Several(Number(), 1, 16),
        "max": Several(Number(), 1, 16),
        "name": Text(),
        "sparse": _SPARSE,
    },
    ("componentType", "count", "type"),
)

_ANIMATION = Record(
    {
        "name": Text(),
        "channels": Several(
            Record(
                {
                    "sampler": Whole(0, 100_000),
                    "target": Record(
                        {"node": Index("nodes"), "path": Text(), "extensions": Named(Record({}))}, ("path",)
                    ),
                },
                ("sampler", "target"),
            ),
            1,
            100_000,
        ),
        "samplers": Several(
            Record(
                {
                    "input": Index("accessors"),
                    "output": Index("accessors"),
                    "interpolation": OneOf(("LINEAR", "STEP", "CUBICSPLINE")),
                },
                ("input", "output"),
            ),
            1,
            100_000,
        ),
    },
    ("channels", "samplers"),
)

_CAMERA = Record(
    {
        "name": Text(),
        "type": OneOf(("perspective", "orthographic")),
        "perspective": _shading(numbers="aspectRatio yfov zfar znear"),
        "orthographic": _shading(numbers="xmag ymag zfar znear"),
    },
    ("type",),
)

_LIGHT = Record(
    {
        "name": Text(),
        "color": _numbers(3),
        "intensity": Number(),
        "range": Number(),
        "type": OneOf(("directional", "point", "spot")),
        "spot": _shading(numbers="innerConeAngle outerConeAngle"),
    },
    ("type",),
)

_FALLBACK = Record(
    {name: Record({"fallback": Truth()}) for name in ("EXT_meshopt_compression", "KHR_meshopt_compression")}
)

_DOCUMENT = Record(
    {
        "asset": Record({"version": OneOf(("2.0",)), "generator": Text(), "copyright": Text()}, ("version",)),
        "extensionsUsed": Several(Text(), most=1000),
        "extensionsRequired": Several(Text(), most=1000),
        "scene": Index("scenes"),
        "scenes": Several(Record({"name": Text(), "nodes": Several(Index("nodes"))}), most=100),
        "nodes": Several(_NODE, most=10_000),
        "meshes": Several(
            Record(
                {
                    "name": Text(),
                    "primitives": Several(_PRIMITIVE, 1, 2000),
                    "weights": Several(Number(), most=1000),
                },
                ("primitives",),
            ),
            most=5000,
        ),
        "materials": Several(_MATERIAL, most=2000),
        "accessors": Several(_ACCESSOR, most=100_000),
        "bufferViews": Several(
            Record(
                {
                    "buffer": Index("buffers"),
                    "byteOffset": Whole(),
                    "byteLength": Whole(1),
                    "byteStride": Whole(0, 252),
                    "target": Whole(),
                    "name": Text(),
                    "extensions": Record({"EXT_meshopt_compression": _MESHOPT, "KHR_meshopt_compression": _MESHOPT}),
                },
                ("buffer", "byteLength"),
            ),
            most=100_000,
        ),
        "buffers": Several(
            Record({"byteLength": Whole(1), "uri": Text(), "name": Text(), "extensions": _FALLBACK}, ("byteLength",)),
            most=1000,
        ),
        "images": Several(
            Record(
                {"uri": Text(), "bufferView": Index("bufferViews"), "mimeType": Text(), "name": Text()},
                exclusive=("uri", "bufferView"),
            ),
            most=1000,
        ),
        "textures": Several(
            Record(
                {
                    "source": Index("images"),
                    "sampler": Index("samplers"),
                    "name": Text(),
                    "extensions": Record(
                        {
                            "EXT_texture_webp": Record({"source": Index("images")}),
                            "KHR_texture_basisu": Record({"source": Index("images")}, ("source",)),
                        }
                    ),
                }
            ),
            most=10_000,
        ),
        "samplers": Several(
            Record({"magFilter": Whole(), "minFilter": Whole(), "wrapS": Whole(), "wrapT": Whole()}), most=10_000
        ),
        "skins": Several(
            Record(
                {
                    "joints": Several(Index("nodes"), 1, 10_000),
                    "skeleton": Index("nodes"),
                    "inverseBindMatrices": Index("accessors"),
                    "name": Text(),
                },
                ("joints",),
            ),
            most=1000,
        ),
        "animations": Several(_ANIMATION, most=1000),
        "cameras": Several(_CAMERA, most=1000),
        "extensions": Record(
            {
                "KHR_lights_punctual": Record({"lights": Several(_LIGHT, most=1000)}, ("lights",)),
                "KHR_materials_variants": Record({"variants": Several(Record({"name": Text()}), most=1000)}),
            }
        ),
    },
    needed=("asset",),
)


def check(document: Any) -> None:
    """Raise `Broken` with the first field of a document that differs from the table, its value and its limits."""
    waiting: list[tuple[str, Kind, Any]] = [("the document", _DOCUMENT, document)]
    while waiting:
        place, kind, value = waiting.pop()
        fault = kind.fault(value, document if isinstance(document, dict) else {})
        if fault is not None:
            raise Broken(f"{place} is {shown(value)}, but must be {fault}")
        within = "" if place == "the document" else f"{place}."
        if isinstance(kind, Record):
            waiting += [(f"{within}{name}", each, value[name]) for name, each in kind.fields.items() if name in value]
        elif isinstance(kind, Named):
            waiting += [(f"{within}{shown(name)}", kind.kind, each) for name, each in value.items()]
        elif isinstance(kind, Several):
            waiting += [(f"{place}[{number}]", kind.kind, each) for number, each in enumerate(value)]
