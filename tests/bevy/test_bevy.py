"""A GLB file in Bevy switches its levels by itself. Needs Vulkan and the example of engines/bevy (BEVY_PICTURES)."""

from __future__ import annotations

import json
import math
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_views import drawn_levels, fade_behind, hand_overs, levels_of, sphere_of
from glb import Node, rewritten
from laws import Floats
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SHRUB = ROOT / "examples" / "shrub.glb"
MEASURED = ROOT.parent / "shared" / "foliage" / "pine_cards_20k.glb"
PROGRAM = shlex.split(os.environ.get("BEVY_PICTURES", ""))

pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="needs the environment variable BEVY_PICTURES, which make test-bevy sets"),
    pytest.mark.night,
]

SHARES = (0.5, 0.9, 1.5, 2.0, 4.0)
"""Distances of the pictures over those of the hand-overs."""


@dataclass(frozen=True)
class Shot:
    """A picture, as the example draws it."""

    name: str
    file: str
    centre: tuple[float, ...]
    distance: float
    is_plain: bool = False
    tree: int = 0
    lod_distance: float = 1.0
    scale: float = 1.0
    turn: float = 0.0
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    field_of_view: float = 50.0
    pixels: int = 1080
    is_multisampled: bool = False


@dataclass(frozen=True)
class Baked:
    """A file with all levels of one tree."""

    file: Path
    levels: list[Node]

    @property
    def centre(self) -> Floats:
        return sphere_of(self.levels[0])[0]

    @property
    def ends(self) -> list[float]:
        return hand_overs(self.levels)

    @property
    def slides(self) -> list[bool]:
        return ["transition_end" in level.extras["leafcloud"] for level in self.levels]

    def shot(self, name: str, distance: float, **settings: Any) -> Shot:
        centre = settings.pop("centre", self.centre)
        return Shot(name, settings.pop("file", str(self.file)), tuple(centre), distance, **settings)

    def drawn(self, distance: float) -> list[int]:
        return drawn_levels(distance, self.ends, self.slides)


def bake(folder: Path, trees: list[Path], *settings: str) -> Path:
    """Bake trees for Bevy. Return the file with all levels."""
    command = [
        sys.executable,
        str(ROOT / "bake.py"),
        "--input",
        *map(str, trees),
        "--out",
        str(folder),
        "--files",
        "levels",
    ]
    subprocess.run([*command, "--engine", "bevy", *settings], check=True, capture_output=True, timeout=240)
    return folder / f"{'_'.join(tree.stem for tree in trees)}.glb"


def draw(folder: Path, shots: list[Shot]) -> dict[str, dict[str, Any]]:
    """Draw the shots into the folder. Return for each name the levels drawn, and the weights of morph targets."""
    folder.mkdir(exist_ok=True)
    (folder / "shots.json").write_text(json.dumps([asdict(shot) for shot in shots]))
    command = [*PROGRAM, str(folder / "shots.json"), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "ERROR" not in done.stdout, done.stdout
    drawn: dict[str, dict[str, Any]] = json.loads((folder / "drawn.json").read_text())
    return drawn


def colors(path: Path) -> Floats:
    """Return the pixels (h, w, 3) in [0, 1]."""
    return np.asarray(Image.open(path).convert("RGB"), np.float64) / 255.0


def seen(picture: Floats) -> NDArray[np.bool_]:
    """Return where (h, w) the picture differs from the background in its corner."""
    return np.abs(picture - picture[0, 0]).max(axis=-1) > 0.02


def hidden(picture: Floats) -> float:
    """Return how many pixels of the blue background are hidden, with parts of pixels. Trees have no blue."""
    blue = picture[..., 2] ** 2.2
    return float((1.0 - blue / blue[0, 0]).sum())


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Baked:
    tree = MEASURED if MEASURED.is_file() else SHRUB
    file = bake(tmp_path_factory.mktemp("bevy"), [tree])
    return Baked(file, levels_of(file))


def test_each_distance_has_its_level(baked: Baked, tmp_path: Path) -> None:
    distances = {f"{number}_{share}": share * end for number, end in enumerate(baked.ends) for share in SHARES}
    drawn = draw(tmp_path, [baked.shot(name, distance) for name, distance in distances.items()])
    for name, distance in distances.items():
        assert sorted(drawn[name]["levels"]) == baked.drawn(distance), name
        assert seen(colors(tmp_path / f"{name}.png")).any(), name
    assert {tuple(found["levels"]) for found in drawn.values()} >= {(n,) for n in range(len(baked.levels))}


def test_leaves_slide_with_the_distance(baked: Baked, tmp_path: Path) -> None:
    wanted: dict[tuple[int, float], float] = {}
    for number, level in enumerate(baked.levels):
        extras = level.extras["leafcloud"]
        if "transition_end" in extras:
            start, length = extras["transition_start"], extras["transition_end"] - extras["transition_start"]
            wanted |= {(number, a): start + a * length for a in (0.0, 0.25, 0.5, 0.9)}
    drawn = draw(tmp_path, [baked.shot(f"{key}", distance) for key, distance in wanted.items()])
    assert wanted
    for number, a in wanted:
        assert drawn[f"{number, a}"]["weights"][str(number)] == pytest.approx(a, abs=1e-3)


# This lens shows the tree larger than the levels are made for, so that all of them differ.
LENS: dict[str, Any] = {"pixels": 512, "field_of_view": 10.0}
ZOOM = 512.0 / 1080.0 * math.tan(math.radians(25.0)) / math.tan(math.radians(5.0))


def test_a_level_looks_like_its_own_file(baked: Baked, tmp_path: Path) -> None:
    """Bevy draws the files of single levels as its own scenes, without the plugin."""
    distances = [0.5 * baked.ends[0], *(1.3 * end for end in baked.ends)]
    files = [baked.file.with_name(f"{baked.file.stem}_LOD{number}.glb") for number in range(len(baked.levels))]
    shots = []
    for number, distance in enumerate(distances):
        shots.append(baked.shot(f"{number}", distance, lod_distance=1.0 / ZOOM, **LENS))
        for other, file in enumerate(files):
            shots.append(baked.shot(f"{number}_{other}", distance, file=str(file), is_plain=True, **LENS))
    drawn = draw(tmp_path, shots)
    for number in range(len(files)):
        assert drawn[f"{number}"]["levels"] == [number]
        picture = colors(tmp_path / f"{number}.png")
        plain = [colors(tmp_path / f"{number}_{other}.png") for other in range(len(files))]
        apart = [float(np.abs(picture - other).mean()) for other in plain]
        print(f"level {number}: difference from the file of each level {np.round(apart, 5)}")
        own = apart.pop(number)
        assert own < 0.5 * min(apart)


def test_leaves_are_drawn_where_they_have_slid_to(baked: Baked, tmp_path: Path) -> None:
    """Bevy draws, as its own scenes, a copy of the level's file with moved leaves, and the file with leaves at rest."""
    shots = []
    sliding = [number for number, slides in enumerate(baked.slides) if slides]
    for number in sliding:
        extras = baked.levels[number].extras["leafcloud"]
        start, end = extras["transition_start"], extras["transition_end"]
        distance = start + 0.9 * (end - start)
        own = baked.file.with_name(f"{baked.file.stem}_LOD{number}.glb")
        moved = rewritten(own, tmp_path / f"moved_{number}.glb", partial(move_leaves, 0.9))
        shots.append(baked.shot(f"{number}", distance, lod_distance=1.0 / ZOOM, **LENS))
        shots += [
            baked.shot(f"{number}_{name}", distance, file=str(file), is_plain=True, **LENS)
            for name, file in (("own", own), ("moved", moved))
        ]
    draw(tmp_path, shots)
    assert sliding
    for number in sliding:
        picture = colors(tmp_path / f"{number}.png")
        moved_apart, own_apart = (
            float(np.abs(picture - colors(tmp_path / f"{number}_{name}.png")).mean()) for name in ("moved", "own")
        )
        print(f"level {number}: {moved_apart:.5f} from leaves that were moved, {own_apart:.5f} from those at rest")
        assert moved_apart < 0.3 * own_apart


def move_leaves(a: float, document: dict[str, Any], data: bytearray) -> None:
    """Move the leaves of a level a of the way to their morph target, which is removed."""

    def numbers(index: int) -> NDArray[np.float32]:
        accessor = document["accessors"][index]
        start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, np.float32, 3 * accessor["count"], start)

    for mesh in document["meshes"]:
        mesh.pop("weights", None)
        for primitive in mesh["primitives"]:
            places = numbers(primitive["attributes"]["POSITION"])
            places += np.float32(a) * numbers(primitive.pop("targets")[0]["POSITION"])


@pytest.mark.parametrize("is_multisampled", [False, True])
def test_a_level_covers_as_much_as_the_one_before_it(baked: Baked, tmp_path: Path, is_multisampled: bool) -> None:
    """Compare levels from eight sides, because single pixels decide in one picture."""
    shots, turns = [], [math.tau * i / 8 for i in range(8)]
    for number, end in enumerate(baked.ends):
        fade = end * fade_behind(baked.slides[number])
        factors = {"before": 1.0, "after": 1.0 / 1.3, "within": 0.99 * end / (end + 0.5 * fade)}
        for (name, factor), (side, turn) in product(factors.items(), enumerate(turns)):
            settings = {"lod_distance": factor, "is_multisampled": is_multisampled, **around(baked, turn)}
            shots.append(baked.shot(f"{name}_{number}_{side}", 0.99 * end, **settings))
    drawn = draw(tmp_path, shots)
    for number in range(len(baked.ends)):
        levels = {"before": [number], "after": [number + 1], "within": [number, number + 1]}
        covered, light = dict.fromkeys(levels, 0.0), dict.fromkeys(levels, 0.0)
        for name, side in product(levels, range(len(turns))):
            assert sorted(drawn[f"{name}_{number}_{side}"]["levels"]) == levels[name]
            picture = colors(tmp_path / f"{name}_{number}_{side}.png")
            covered[name] += hidden(picture)
            light[name] += float((picture[seen(picture)] ** 2.2).mean())
        ratios = covered["after"] / covered["before"], light["after"] / light["before"]
        print(f"{number}: {covered}, coverage {ratios[0]:.3f}, luminance {ratios[1]:.3f}")
        assert 0.92 < ratios[0] < 1.08
        assert 0.93 < ratios[1] < 1.07
        least, most = sorted((covered["before"], covered["after"]))
        assert 0.95 * least < covered["within"] < 1.05 * most


def around(baked: Baked, turn: float) -> dict[str, Any]:
    """Return settings with which the tree is turned around the center of its leaves."""
    x, _, z = baked.centre
    cosine, sine = math.cos(turn), math.sin(turn)
    return {"turn": turn, "position": (x - cosine * x - sine * z, 0.0, z + sine * x - cosine * z)}


def test_a_tree_that_is_scaled_turned_and_moved_switches_alike(baked: Baked, tmp_path: Path) -> None:
    scale, turn, position = 0.05, 2.0, np.array([30.0, -5.0, 7.0])
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    centre = scale * turned @ baked.centre + position
    place: dict[str, Any] = {"centre": centre, "scale": scale, "turn": turn, "position": tuple(position)}
    check_borders(baked, tmp_path, scale, **place)


def test_levels_follow_field_of_view_and_height_of_the_picture(baked: Baked, tmp_path: Path) -> None:
    factor = 540.0 / 1080.0 * math.tan(math.radians(25.0)) / math.tan(math.radians(10.0))
    check_borders(baked, tmp_path, factor, field_of_view=20.0, pixels=540)


def test_lod_distance_is_a_factor_on_distances(baked: Baked, tmp_path: Path) -> None:
    check_borders(baked, tmp_path, 2.0, lod_distance=2.0)


def check_borders(baked: Baked, folder: Path, factor: float, **settings: Any) -> None:
    """Levels hand over within 1 % of `factor` times the file's distances, and leaves have arrived there."""
    distances = {f"{number}_{share}": share * end for number, end in enumerate(baked.ends) for share in (0.99, 1.01)}
    shots = [baked.shot(name, factor * distance, **settings) for name, distance in distances.items()]
    drawn = draw(folder, shots)
    for name, distance in distances.items():
        assert sorted(drawn[name]["levels"]) == baked.drawn(distance), name
    for number in (number for number, slides in enumerate(baked.slides) if slides):
        assert drawn[f"{number}_1.01"]["weights"][str(number)] > 0.99
    assert seen(colors(folder / "0_0.99.png")).sum() > 100


def test_each_tree_of_a_file_has_its_own_levels(tmp_path: Path) -> None:
    other = tmp_path / "bush.glb"
    shutil.copy(SHRUB, other)
    file = bake(tmp_path / "baked", [SHRUB, other], "--epsilon", "0.1")
    names = [node.name.rpartition("_LOD")[0] for node in levels_of(file) if node.extras["leafcloud"]["level"] == 0]
    assert sorted(names) == ["bush", "shrub"]
    for number, name in enumerate(names):
        levels = [node for node in levels_of(file) if node.name.startswith(f"{name}_LOD")]
        baked = Baked(file, levels)
        assert len(levels) >= 2
        distances = {f"{number}": share * baked.ends[0] for number, share in enumerate((0.5, 0.99, 1.01, 4.0))}
        drawn = draw(tmp_path / name, [baked.shot(key, each, tree=number) for key, each in distances.items()])
        for key, distance in distances.items():
            assert sorted(drawn[key]["levels"]) == baked.drawn(distance)
            assert seen(colors(tmp_path / name / f"{key}.png")).any()
